"""Which atoms there are, and who owns them."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import permutations

import pytest

import teg
from teg.analysis.surfaces import atoms_of, binders_inside, comes_first, open_surfaces, owned_surfaces
from teg.ir.integral import Integral

x, y, z = teg.vars("x y z")
t, a, c = teg.params("t a c")


def test_atoms() -> None:
    e = teg.bracket(x < t) * teg.where(y < a, teg.bracket(x < t), 2)
    assert [str(c) for c in atoms_of(e)] == ["x < t", "y < a"]
    assert [str(c) for c in atoms_of(e, x)] == ["x < t"]


def test_atoms_inside_atoms() -> None:
    e = teg.bracket(teg.bracket(x < t) * x < 0.2)
    assert len(atoms_of(e)) == 2


def test_the_owner_is_the_innermost_integral_whose_variable_occurs() -> None:
    inner = teg.integral(teg.bracket(x + y < t) * teg.bracket(y < a) * teg.bracket(t < a), (x, 0, 1))
    outer = teg.integral(inner, (y, 0, 1))
    assert isinstance(outer, Integral)
    assert isinstance(inner, Integral)
    assert owned_surfaces(inner.body, x) == [(t - (x + y))]
    assert owned_surfaces(outer.body, y) == [a - y]


def test_open_surfaces_belong_to_an_integral_still_to_come() -> None:
    assert open_surfaces(teg.bracket(x < t)) == [t - x]
    assert open_surfaces(teg.integral(teg.bracket(x + y < t), (x, 0, 1))) == []
    assert open_surfaces(teg.integral(teg.bracket(y < t) * x, (x, 0, 1))) == [t - y]
    assert open_surfaces(teg.bracket(t < a)) == []


def test_binders() -> None:
    e = teg.integral(x * teg.integral(y, (y, 0, x)), (x, 0, 1))
    assert binders_inside(e) == {x, y}
    assert binders_inside(x + t) == frozenset()


def test_the_order_of_ties_is_total() -> None:
    surfaces = [t - x, a - x, x + y - t, 1 - x]
    for g in surfaces:
        assert not comes_first(g, g)
        for h in surfaces:
            if h is not g:
                assert comes_first(g, h) != comes_first(h, g)


@pytest.mark.parametrize("names", [*permutations("abt")], ids="".join)
def test_where_three_surfaces_tie_the_derivatives_are_those_of_one_arrangement(names: tuple[str, str, str]) -> None:
    """The least of three numbers grows like all of them together; also where one of them is a bound."""
    p, q, r = teg.params(" ".join(names))
    for e in (
        teg.integral(teg.bracket((x < p) & (x < q) & (x < r)), (x, 0, 1)),
        teg.integral(teg.bracket((x < p) & (x < q)), (x, 0, r)),
        teg.integral(teg.bracket((x > -p) & (x > -q)), (x, -r, 0)),
    ):
        gradient = teg.compile(e, [p, q, r], backend="numpy").grad(a=0.5, b=0.5, t=0.5)
        assert sorted(gradient.values()) == [0.0, 0.5, 0.5]


@pytest.mark.parametrize(
    ("lo", "hi", "sign"), [(-math.inf, math.inf, 1), (math.inf, -math.inf, -1), (0, math.inf, 1), (math.inf, 0, -1), (-math.inf, 1, 1)]
)
def test_every_point_is_below_an_infinite_bound(lo: float, hi: float, sign: int) -> None:
    e = teg.integral(teg.bracket(x < t) * teg.exp(-(x**2)), (x, lo, hi))
    assert teg.evaluate(teg.diff(e, t), {t: 0.3}) == pytest.approx(sign * math.exp(-0.09), rel=1e-14)


TURNED = {
    "a line": c * x + y,
    "a line about a point": c * (x - 0.4) + y,
    "a direction": x * teg.sin(c) + y * teg.cos(c),
    "a parabola": c * x**2 + y,
    "a circle by its curvature": c * (x**2 + y**2) + y,
    "a hyperbola": y * (1 + c * x),
    "a quotient": y / (1 + c * x),
    "a sine": teg.sin(c * x) + y,
    "a kink": c * abs(x - 0.3) + y,
}
TOGETHER: dict[str, tuple[Callable[[teg.Cond, teg.Cond], teg.Expr], float]] = {
    "and": (lambda p, q: teg.bracket(p & q), 1.0),
    "or": (lambda p, q: teg.bracket(p | q), 1.0),
    "not": (lambda p, q: teg.bracket(p & ~q), 0.0),
    "where": (lambda p, q: teg.where(p, 3.0, teg.where(q, 2.0, 1.0)), 2.0),
}


@pytest.mark.parametrize(("way", "backend"), [*((way, "numpy") for way in TOGETHER), ("and", "c")])
@pytest.mark.parametrize("surface", TURNED)
def test_surfaces_that_coincide_where_a_parameter_is_0(surface: str, way: str, backend: str) -> None:
    """At c = 0 both conditions are y < t; by x, the inner variable, the second one is constant then."""
    together, factor = TOGETHER[way]
    e = teg.integral(together(y < t, TURNED[surface] < t) * (1 + x * y), (x, 0, 1), (y, 0, 1))
    f = teg.compile(e, [t, c], backend=backend)
    assert f.grad(t=0.55, c=0.0)["t"] == pytest.approx(factor * (1 + 0.55 / 2), abs=1e-12)


@pytest.mark.parametrize("surface", TURNED)
def test_surfaces_that_coincide_by_the_outer_variable(surface: str) -> None:
    e = teg.integral(teg.bracket((y < t) & (TURNED[surface] < t)) * (1 + x * y), (y, 0, 1), (x, 0, 1))
    assert teg.compile(e, [t, c], backend="numpy").grad(t=0.55, c=0.0)["t"] == pytest.approx(1 + 0.55 / 2, abs=1e-12)


@pytest.mark.parametrize(("names", "backend"), [("xyz", "numpy"), ("zyx", "numpy"), ("xzy", "c")])
def test_cylinders_that_coincide_where_a_parameter_is_0(names: str, backend: str) -> None:
    disk = y**2 + z**2
    ranges = {"x": (x, 0, 1), "y": (y, -1, 1), "z": (z, -1, 1)}
    e = teg.integral(teg.bracket((disk < t) & (disk + c * x < t)) * (1 + x), *(ranges[k] for k in names))
    assert teg.compile(e, [t, c], backend=backend).grad(t=0.55, c=0.0)["t"] == pytest.approx(1.5 * math.pi, rel=1e-11)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_moving_bound_on_which_a_surface_lies_where_a_parameter_is_0(backend: str) -> None:
    for ranges in permutations(((x, 0, 1), (y, 0, t))):
        f = teg.compile(teg.integral(teg.bracket(c * x + y < t) * (1 + x), *ranges), [t, c], backend=backend)
        assert f.grad(t=0.55, c=0.0)["t"] == pytest.approx(1.5, rel=1e-14)


def test_a_surface_that_lies_on_none_is_no_tie() -> None:
    """c·x < a has no point in common with y = t, also where all of it is 0."""
    either = teg.integral(teg.bracket((y < t) | (c * x < a)), (x, 0, 1), (y, 0, 1))
    assert teg.compile(either, [t, a, c], backend="numpy").grad(t=0.55, a=0.0, c=0.0)["t"] == 1.0
