"""The jump of a whole expression across a surface."""

from __future__ import annotations

import itertools
import math
import random

import pytest

import teg
from teg.analysis.jumps import assign, jump, surface_terms, vanishes_on
from teg.ir.expr import FALSE, ONE, TRUE, ZERO, const
from teg.passes.normalise.canonicalise import canonicalise

x, y = teg.vars("x y")
t, a, b = teg.params("t a b")
G = t - x
STEP = teg.bracket(x < t)
OTHER = teg.bracket(x < a)


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (STEP, ONE),
        (STEP * STEP, ONE),
        (STEP**2 + STEP, const(2)),
        (x * t, ZERO),
        (OTHER, ZERO),
        (teg.sin(2 * STEP), const(math.sin(2))),
        (x * STEP, x),
        (STEP * OTHER, OTHER),
        (teg.where(x < t, a, b), a - b),
        (teg.where(x < t, a, b) * x, (a - b) * x),
        (teg.where(b > 0, x, a * STEP), teg.where(b > 0, ZERO, a)),
        (teg.bracket((x < t) & (x < a)), OTHER),
        (teg.bracket(~(x < t)), const(-1)),
        (teg.integral(STEP * y, (y, 0, 1)), teg.integral(y, (y, 0, 1))),
        (teg.integral(y, (y, 0, STEP)), teg.integral(y, (y, 0, 1))),
        (teg.where(teg.integral(STEP, (y, 0, 1)) < b, ONE, ZERO), teg.bracket(teg.integral(ONE, (y, 0, 1)) < b) - teg.bracket(b > 0)),
    ],
    ids=lambda e: str(e),
)
def test_jump(e: teg.Expr, expected: teg.Expr) -> None:
    assert jump(e, G) is expected


def values(e: teg.Expr, at: dict[teg.Expr, float]) -> float:
    """The value with variables read as parameters."""
    inner = e
    for v in (x, y):
        inner = teg.ir.traverse.substitute(inner, {v: teg.param(f"value_of_{v.name}")})  # type: ignore[assignment]
    return float(teg.evaluate(inner, {(k.name if k.name in "tab" else f"value_of_{k.name}"): v for k, v in at.items()}))  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "e",
    [
        (STEP - OTHER) ** 3,
        teg.where(x < t, a, b) * (STEP + 2),
        STEP * OTHER * (STEP + x) * teg.exp(STEP * t),
        teg.where((x < t) & (x < a), x * STEP, teg.where(x < t, OTHER, t)) * (2 - STEP),
        teg.where((x < t) | ~(x < a), STEP * a, b / (1 + STEP)),
        teg.integral(y * STEP + OTHER, (y, STEP, 2 + OTHER)),
        teg.sqrt(a * STEP + 1) * teg.maximum(STEP, x),
        teg.tuple(STEP, x * STEP)[1] ** 2 / (2 + STEP),
    ],
    ids=str,
)
def test_the_rules_equal_the_difference_of_two_copies(e: teg.Expr) -> None:
    copies = assign(e, G, True) - assign(e, G, False)  # type: ignore[operator]
    for at in ({x: 0.3, t: 0.7, a: 0.2, b: 1.3}, {x: 0.9, t: 0.7, a: 1.2, b: -0.4}):
        assert values(jump(e, G), at) == pytest.approx(values(copies, at), abs=1e-14)  # type: ignore[arg-type]


def test_assign() -> None:
    assert assign(STEP * x, G, True) is x
    assert assign(STEP * x, G, False) is ZERO
    assert assign(x < t, G, True) is TRUE
    assert assign(x < t, G, False) is FALSE
    assert assign(OTHER, G, True) is OTHER


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (G, True),
        (2 * G * x, True),
        (G**2, True),
        (x - t, True),
        (x**2 - t**2, True),
        (teg.sin(x) - teg.sin(t), True),
        (ONE, False),
        (x, False),
        (x + t, False),
        (ZERO, True),
        (a * (x - t), True),
    ],
    ids=lambda v: str(v),
)
def test_what_vanishes_on_the_surface(e: teg.Expr, expected: bool) -> None:
    assert vanishes_on(e, G) == expected


@pytest.mark.parametrize("kink", [teg.abs(x - t), teg.minimum(x, t), teg.maximum(x, t) * x, teg.where(x < t, x**2, t * x)], ids=str)
def test_kinks_have_no_boundary_term(kink: teg.Expr) -> None:
    surface = teg.analysis.surfaces.atoms_of(kink)[0].g
    assert surface_terms(kink, [surface]) == []


def test_a_jump_has_one() -> None:
    assert surface_terms(STEP * x, [G]) == [(G, x)]
    assert [g for g, _ in surface_terms(teg.sign(t - x), [G])] == [G]


@pytest.mark.parametrize("kink", [teg.abs(teg.sin(t * x)), teg.abs(teg.sin(x) * teg.cos(t * x)), teg.abs(teg.cos(t * x)) ** 3])
def test_kinks_of_waves_have_no_delta(kink: teg.Expr) -> None:
    assert not teg.diff(kink, x).has_delta
    assert not teg.diff(teg.integral(kink, (x, 0, 1)), t).has_delta


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ((x < t) & (y < a) | ~(y < a) & (x < b), teg.bracket(y < a)),
        ((x < t) | (y < a), teg.bracket(~(y < a))),
        (~(x < t) & (y < a) | (y < b) & ~(y < a), -teg.bracket(y < a)),
    ],
    ids=["exclusive", "overlapping", "falling"],
)
def test_the_jump_of_alternatives_is_one_condition(condition: teg.Cond, expected: teg.Expr) -> None:
    """As a difference of two conditions it would be 0·NaN where a slope is NaN and both hold."""
    assert jump(teg.bracket(condition), G) is canonicalise(expected)


def random_condition(rng: random.Random, depth: int) -> teg.Cond:
    if depth == 0 or rng.random() < 0.2:
        c: teg.Cond = rng.choice([x < t, x < t, a > 0, b > 0, x < 0.5])
        return ~c if rng.random() < 0.4 else c
    if rng.random() < 0.4:  # as a condition is hoisted
        p = rng.choice([a > 0, b > 0, x < 0.5])
        return (p & random_condition(rng, depth - 1)) | (~p & random_condition(rng, depth - 1))
    u, v = random_condition(rng, depth - 1), random_condition(rng, depth - 1)
    return u & v if rng.random() < 0.5 else u | v


@pytest.mark.parametrize("seed", range(4))
def test_the_jump_of_random_conditions(seed: int) -> None:
    rng = random.Random(seed)
    for _ in range(6):
        condition = random_condition(rng, 4)
        jumps = jump(teg.where(condition, 3 * y, 1), G)
        copies = assign(teg.where(condition, 3 * y, 1), G, True) - assign(teg.where(condition, 3 * y, 1), G, False)  # type: ignore[operator]
        for x_at, a_at, b_at in itertools.product((0.2, 0.8), (-1.0, 1.0), (-1.0, 1.0)):
            at: dict[teg.Expr, float] = {x: x_at, y: 0.7, t: 0.4, a: a_at, b: b_at}
            assert values(jumps, at) == pytest.approx(values(copies, at), abs=1e-14), condition


def test_the_jump_of_nested_alternatives_is_where_the_surface_decides() -> None:
    """As the quadrants of a superellipse: the others, which are not numbers there, are left out."""
    p, q, others = x > 0, y > 0, [teg.sqrt(y) < a, teg.sqrt(-x) < a, teg.sqrt(-x - y) < a]
    condition = (p & ((q & (x < t)) | (~q & others[0]))) | (~p & ((q & others[1]) | (~q & others[2])))
    assert jump(teg.bracket(condition), G) is canonicalise(teg.bracket(p & q))


A_CHOICE = teg.where(x > 0.5, teg.sqrt(x - t), 0.1)
CHOICES = {
    "a root": (A_CHOICE, 0.3, -(math.sqrt(0.7) - math.sqrt(0.2))),
    "a logarithm": (teg.where(x < 0.5, teg.log(0.5 - x + t), 0.25), 0.25, math.log(0.75 * math.e)),
    "a part of a root": (teg.sqrt(0.04 + teg.maximum(0, t - x)), 0.5, math.sqrt(0.54) - math.sqrt(0.04)),
    "a power of a part": (teg.maximum(0, t - x) ** 1.5, 0.5, 0.5**1.5),
}
"""Heights with a branch that is NaN, or has a slope that is, where it is not taken; and the slope by t of the area below."""


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", CHOICES)
def test_what_is_not_taken_does_not_matter_in_a_moving_condition(name: str, backend: str) -> None:
    height, at, wanted = CHOICES[name]
    f = teg.compile(teg.integral(teg.bracket(y < height), (y, -1, 1), (x, 0, 1)), [t], backend=backend)
    assert f.grad(t=at)["t"] == pytest.approx(wanted, rel=1e-9)
