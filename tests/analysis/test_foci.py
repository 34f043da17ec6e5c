"""Borders between two distances and a number: found however they are written, and told apart from others."""

from __future__ import annotations

from typing import cast

import pytest

import teg
from teg.analysis.foci import borders_of, with_common_focus
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import Var
from teg.ir.traverse import parameters

x, y = cast("tuple[Var, Var]", teg.vars("x y"))
a, b, c, d, s, t = teg.params("a b c d s t")
NEAR = teg.sqrt((x - a) ** 2 + (y - b) ** 2)
FAR = teg.sqrt((c - x) ** 2 + (y - d) ** 2)
AT = {"x": 0.3, "y": 0.8, "a": 0.2, "b": 0.1, "c": 0.9, "d": 0.4, "s": 1.3, "t": 0.7}


@pytest.mark.parametrize(
    "g",
    [
        NEAR - FAR + t,
        2 * (FAR - NEAR) - t,
        s * NEAR - s * FAR,
        teg.sqrt(x**2 - 2 * a * x + a**2 + (y - b) ** 2) - FAR + t,
        teg.sqrt(3 * (x - a) ** 2 + 3 * (y - b) ** 2) - teg.sqrt(3 * (x - c) ** 2 + 3 * (y - d) ** 2) + t,
        teg.sqrt(s * (x - a) ** 2 + 0.7 * (y - b) ** 2) - teg.sqrt(s * (x - c) ** 2 + 0.7 * (y - d) ** 2) + t,
    ],
    ids=str,
)
def test_about_either_focus(g: teg.Expr) -> None:
    borders = borders_of(g, (x, y))
    assert borders is not None
    for border in borders:
        again = border.about(border.focus, (x, y))
        assert _number(again) == pytest.approx(_number(g), rel=1e-14)
    foci = sorted(tuple(_number(e) for e in border.focus) for border in borders)
    assert foci == [pytest.approx((0.2, 0.1)), pytest.approx((0.9, 0.4))]


def _number(e: teg.Expr) -> float:
    at = teg.substitute(e, {v: AT[v.name] for v in e.free})
    return float(teg.evaluate(at, {p: AT[p.name] for p in parameters(at)}))


@pytest.mark.parametrize(
    "g",
    [
        NEAR + FAR - t,
        NEAR - 2 * FAR + t,
        NEAR - FAR + t * x,
        NEAR - t,
        teg.sqrt((x - a) ** 2 + (y - b) ** 2 + s**2) - FAR + t,  # above the plane
        teg.sqrt((x - a) ** 2 + 2 * (y - b) ** 2) - teg.sqrt((x - c) ** 2 + 3 * (y - d) ** 2),  # a metric each
        teg.sqrt(x**2 + x * y + 2 * y**2) - teg.sqrt((x - a) ** 2 + (x - a) * y + 2 * y**2),  # axes that lean
        (x - a) ** 2 + (y - b) ** 2 - t,
    ],
    ids=str,
)
def test_other_functions(g: teg.Expr) -> None:
    assert borders_of(g, (x, y)) is None


def test_a_focus_that_all_share() -> None:
    """Variables take its place in each border, so that a chart knows it again."""
    other = teg.sqrt((x - s) ** 2 + (y - t) ** 2)
    found = with_common_focus((NEAR - other + 1 > 0) & (x < a), NEAR - FAR + t, (x, y))
    assert found is not None
    condition, names, focus = found
    assert focus == (a, b)
    (border,) = [atom.g for atom in atoms_of(condition) if names[0] in atom.free]
    assert cast("tuple", borders_of(border, (x, y)))[0].focus == names
    assert with_common_focus(FAR - other > 0, NEAR - FAR + t, (x, y)) is not None
    assert with_common_focus(other - 2 * FAR > 0, NEAR - FAR + t, (x, y)) is None
    assert with_common_focus(NEAR - other > 0, x - a, (x, y)) is None
