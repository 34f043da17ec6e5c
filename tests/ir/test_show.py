"""Printing for reading and for debugging."""

from __future__ import annotations

import pytest

import teg
from teg.ir.show import show, show_within
from tests.references import REFERENCES, Reference

x, y = teg.vars("x y")
t, a = teg.params("t a")


@pytest.mark.parametrize(
    ("e", "text"),
    [
        (x + t, "x + t"),
        (x - t, "x - t"),
        (x - 2 * t, "x - 2·t"),
        (2 * (x + t), "2·(x + t)"),
        ((x + t) ** 2, "(x + t)²"),
        (x / t, "x/t"),
        (1 / x, "1/x"),
        (teg.sqrt(x + t), "√(x + t)"),
        (x**t, "x^t"),
        (teg.exp(-x), "exp(-x)"),
        (teg.bracket(x < t), "[x < t]"),
        (teg.bracket(x >= t), "[t ≤ x]"),
        (a * teg.bracket(x < t), "[x < t]·a"),
        (teg.where(x < t, a, 2), "where(x < t, a, 2)"),
        (teg.integral(x * t, (x, 0, t)), "∫[x: 0..t] x·t"),
        (teg.integral(x + t, (x, 0, 1)), "∫[x: 0..1] (x + t)"),
        (teg.delta(t - x), "δ(t - x)"),
        (teg.tuple(x, t), "(x, t)"),
    ],
    ids=lambda e: str(e),
)
def test_one_line(e: teg.Expr, text: str) -> None:
    assert str(e) == repr(e) == text


def test_deltas_are_visible_in_a_derivative() -> None:
    d = teg.diff(teg.integral(teg.bracket(x < t), (x, 0, 1)), t)
    assert str(d) == "∫[x: 0..1] δ(t - x)"


def test_conditions() -> None:
    assert str((x < t) & (x > a)) == "x < t & a < x"
    assert str((x < t) | (x > a)) == "x < t | a < x"
    assert str(~(x < t)) == "~(x < t)"


def test_a_listing_shows_sharing() -> None:
    u = teg.sin(x) + t
    lines = teg.dump(u * u + teg.exp(u)).splitlines()
    assert sum("sin" in line for line in lines) == 1
    assert lines[0] == "%0 = sin(x)"
    assert lines[-1].startswith("result %")


def test_a_listing_of_several() -> None:
    lines = teg.dump(x + t, x * t).splitlines()
    assert [line for line in lines if line.startswith("result")] == ["result %0", "result %1"]


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda r: r.id)
def test_the_listing_has_one_line_a_node(reference: Reference) -> None:
    e = reference.build()
    lines = teg.dump(e).splitlines()
    assert len(lines) <= teg.size(e) + 1
    assert len(set(lines)) == len(lines)


def test_what_is_shared_exponentially_often_becomes_a_listing() -> None:
    e: teg.Expr = x
    for _ in range(60):
        e = e * e + teg.sin(e)
    assert str(e).startswith("%0 = ")
    assert len(str(e)) < 10_000


def test_what_is_too_long_for_a_line_has_no_text_of_one_line() -> None:
    e = teg.sin(x) + teg.cos(t)
    assert show_within(e, len(str(e))) == str(e) == "sin(x) + cos(t)"
    assert show_within(e, len(str(e)) - 1) is None
    assert show(e, len(str(e)) - 1) == teg.dump(e)
