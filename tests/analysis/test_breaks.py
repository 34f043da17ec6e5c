"""Where the pieces begin and end, and the degrees that give the number of nodes."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg.analysis.breaks import MAX_ISOLATED, SOME_ISOLATED, BreakAnalysis, Breaks
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.pipeline import normal_form
from teg.program import Adaptive, Gauss, Integrate, statements
from tests.backends.c_checks import in_c

x, y, z = teg.vars("x y z")
t, a, b, c = teg.params("t a b c")


def breaks(e: teg.Expr) -> list[str]:
    assert isinstance(e, Integral)
    return [str(p) for p in BreakAnalysis().of(e).points]


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (teg.integral(teg.bracket(x < t), (x, 0, 1)), 1),
        (teg.integral(teg.bracket((x < t) & (x < a)), (x, 0, 1)), 2),
        (teg.integral(teg.bracket(x < t) * teg.bracket(2 * x < 2 * t), (x, 0, 1)), 1),
        (teg.integral(teg.abs(x - t), (x, 0, 1)), 1),
        (teg.integral(teg.bracket(x**2 < t), (x, -1, 1)), 2),
        (teg.integral(teg.exp(x), (x, 0, 1)), 0),
        (teg.integral(teg.bracket(t < a) * x, (x, 0, 1)), 0),
        (teg.integral(teg.bracket(x < 2), (x, 0, 1)), 0),
    ],
    ids=lambda v: str(v),
)
def test_the_inner_variable(e: teg.Expr, expected: int) -> None:
    assert len(breaks(e)) == expected


def rules(e: teg.Expr) -> list[object]:
    program = teg.compile(e).program(0)
    return [s.rule for s in statements(program.body) if isinstance(s, Integrate)]


def test_the_outer_variable_breaks_where_the_inner_picture_changes() -> None:
    inner = teg.integral(teg.bracket(a * x + b * y < c), (x, 0, 1))
    outer = teg.integral(inner, (y, 0, 1))
    assert isinstance(outer, Integral)
    found = BreakAnalysis().of(outer)
    assert found.complete
    assert len(found.points) == 2  # the line leaves the box at x = 0 and at x = 1
    at = {"a": 0.7, "b": 1.1, "c": 0.9}
    assert {round(float(teg.evaluate(p, at)), 12) for p in found.points} == {round(0.9 / 1.1, 12), round(0.2 / 1.1, 12)}


def test_two_lines_meet() -> None:
    inner = teg.integral(teg.bracket(x + y < t) * teg.bracket(x - y < a), (x, 0, 1))
    outer = teg.integral(inner, (y, 0, 1))
    assert isinstance(outer, Integral)
    points = {round(float(teg.evaluate(p, {"t": 0.8, "a": 0.3})), 12) for p in BreakAnalysis().of(outer).points}
    assert 0.25 in points  # y = (t - a)/2


def test_a_product_is_0_where_a_factor_is() -> None:
    """sin(y)·(e^y - t) has no formula as one function."""
    e = teg.integral(teg.bracket(teg.sin(y) ** 2 * (teg.exp(y) - t) > x), (x, 0, 2), (y, -1, 1))
    assert isinstance(e, Integral)
    points = {float(teg.evaluate(p, {"t": 1.5})) for p in BreakAnalysis().of(e).points}
    assert {0.0, math.log(1.5)} <= points


def test_conditions_on_the_outer_variable_alone() -> None:
    e = teg.integral(teg.bracket(x < t) * teg.bracket(y < t), (x, 0, 1), (y, 0, 1))
    assert teg.evaluate(e, {t: 0.3}) == pytest.approx(0.09, rel=1e-15)


@pytest.mark.parametrize(
    ("e", "nodes"),
    [
        (teg.integral(teg.bracket(x < t), (x, 0, 1)), []),  # short polynomials have no rule: they are straight lines
        (teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), []),
        (teg.integral(teg.bracket(x < t) * x**2, (x, 0, 1)), []),
        (teg.integral(teg.bracket(x < t) * x**4, (x, 0, 1)), [3]),
        (teg.integral(teg.bracket(x < t) * x**5, (x, 0, 1)), [3]),
        (teg.integral(teg.bracket(x < t) * x**6, (x, 0, 1)), [4]),
        (teg.integral(teg.bracket(x + y < t) + teg.bracket(x > y), (x, 0, 1), (y, 0, 1)), []),  # clipped polygons
        (teg.integral(teg.sin(teg.bracket(x + y < t)), (x, 0, 1), (y, 0, 1)), [1]),  # the inner one has no rule: it is a straight line
        (teg.integral(teg.sin(teg.bracket(x + y < t)) * x, (x, 0, 1), (y, 0, 1)), [2]),
        (teg.integral(teg.sin(teg.bracket(x + y < t)) * x * y, (x, 0, 1), (y, 0, 1)), [2]),
        (teg.integral(teg.sin(teg.bracket(x + y < t)) * (x + 2 * y) ** 4, (x, 0, 1), (y, 0, 1)), [3, 3]),
    ],
    ids=lambda v: str(v),
)
def test_polynomials_get_the_nodes_they_need_and_no_more(e: teg.Expr, nodes: list[int]) -> None:
    found = rules(e)
    assert all(isinstance(r, Gauss) for r in found)
    assert [r.nodes for r in found if isinstance(r, Gauss)] == nodes


def test_what_is_no_polynomial_is_adaptive() -> None:
    for e in (
        teg.integral(teg.exp(x * x), (x, 0, 1)),
        teg.integral(teg.bracket(x * teg.sin(x) < t) * teg.sqrt(x + 2), (x, 0, 1)),
        teg.integral(1 / (x * x + 2), (x, 0, 1)),
    ):
        (rule,) = rules(e)
        assert isinstance(rule, Adaptive)


def test_a_square_root_end_is_smoothed() -> None:
    f = teg.compile(teg.integral(teg.sqrt(x), (x, 0, 1)))
    (loop,) = [s for s in statements(f.program(0).body) if isinstance(s, Integrate)]
    assert [b.kind for b in loop.bends] == ["root"]
    assert f() == pytest.approx(2 / 3, rel=1e-15)
    assert f.evaluations() == 8


def test_the_analysis_is_done_once() -> None:
    e = normal_form(teg.integral(teg.bracket(x + y < t), (x, 0, 1), (y, 0, 1)))
    assert isinstance(e, Integral)
    analysis = BreakAnalysis()
    assert analysis.of(e) is analysis.of(e)


@pytest.mark.parametrize("shift", [0.0, 512.0, 2.0**20])
def test_far_from_the_origin(shift: float) -> None:
    """A triangle of area 1e-3 at a distance keeps its digits: coefficients are taken at a local origin."""
    corners = [(0.25, 0.25), (0.3125, 0.25), (0.25, 0.28125)]
    ps = [teg.params(f"x{i} y{i}") for i in range(3)]
    inside: teg.Expr = teg.ir.expr.ONE
    for (px, py), (qx, qy) in zip(ps, [*ps[1:], ps[0]], strict=True):
        inside = inside * teg.bracket((qx - px) * (y - py) - (qy - py) * (x - px) > 0)
    e = teg.integral(inside, (x, shift, shift + 1), (y, shift, shift + 1))
    f = teg.compile(e, [p for pair in ps for p in pair])
    at = {p.name: v + shift for pair, corner in zip(ps, corners, strict=True) for p, v in zip(pair, corner, strict=True)}
    area, gradient = f.value_and_grad(at)
    assert area == pytest.approx(0.0625 * 0.03125 / 2, rel=1e-12)
    assert gradient["x1"] == pytest.approx(0.03125 / 2, rel=1e-9 if shift > 1e5 else 1e-12)
    assert gradient["y2"] == pytest.approx(0.0625 / 2, rel=1e-9 if shift > 1e5 else 1e-12)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize(
    "level",
    [
        lambda c, d, e: c * x + d * y,
        lambda c, d, e: c * x + d * y**2,
        lambda c, d, e: c * x + d * teg.exp(y),
        lambda c, d, e: c * x + d * y + (e - 1) * y**2,
        lambda c, d, e: c * x + d * (y * y + y) + d * teg.abs(y - 0.3),
    ],
)
@pytest.mark.parametrize("zero", [0.0, 1e-200])
def test_a_line_that_does_not_depend_on_the_inner_variable(backend: str, level: Any, zero: float) -> None:
    """d = 0 makes it a border of the outer variable: the curve is followed from x = 0 to s/c only."""
    c, d, e, s, r = teg.params("c d e s r")
    curve = teg.bracket(x**3 + y**2 < r) * teg.bracket(level(c, d, e) < s)
    f = teg.compile(teg.integral(curve, (x, 0, 1), (y, 0, 1)), [r], backend=backend)
    given = {name: v for name, v in {"c": 0.75, "d": zero, "e": 1.0, "s": 0.26, "r": 0.6}.items() if name in f.parameters}
    exact = float(mpmath.quad(lambda at: 1 / (2 * mpmath.sqrt(mpmath.mpf("0.6") - at**3)), [0, 0.26 / 0.75]))
    assert f.grad(given)["r"] == pytest.approx(exact, rel=1e-9)


def test_roots_that_leave_the_range_are_bends() -> None:
    """A ball that sides of its cube cut: a slice that passes a side takes a power 3/2 with it. Against 40 nodes in every piece."""
    z, r = teg.var("z"), teg.param("r")
    e = teg.integral(teg.bracket(x * x + (y - 0.13) ** 2 + z * z < r), (x, 0, 1), (y, 0, 1), (z, 0, 1))
    f = teg.compile(e, [r])
    (outer, *_) = [s for s in statements(f.program(0).body) if isinstance(s, Integrate)]
    assert [b.kind for b in outer.bends] == ["root"] * 4  # through x = 1, over the middle, through y = 0 and y = 1
    for square in (0.3, 0.8, 1.3):
        radius = math.sqrt(square)
        ends = [0.0, 1.0, radius]
        ends += [math.sqrt(v) for d in (1.0, 0.13**2, 0.87**2, 1.0 + 0.13**2, 1.0 + 0.87**2) if (v := square - d) > 0.0]
        places = sorted({min(p, 1.0) for p in ends})
        assert f(r=square) == pytest.approx(sum(_slices(p, q, square) for p, q in pairwise(places)), rel=1e-10)
        assert f.evaluations(r=square) <= 140


def _slices(p: float, q: float, square: float) -> float:
    """Returns the part of the ball between z = p and z = q, its ends smooth."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    total = 0.0
    for u, w in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
        s = square - (p + (q - p) * u * u * (3.0 - 2.0 * u)) ** 2
        total += w * 6.0 * u * (1.0 - u) * (q - p) * (_area(0.87, s) + _area(0.13, s) if s > 0.0 else 0.0)
    return total


def _area(height: float, square: float) -> float:
    """Returns the area of 0 < x < 1, 0 < y < height in a disk around 0."""
    radius = math.sqrt(square)

    def below(u: float) -> float:
        v = math.sqrt(max(square - u * u, 0.0))
        return 0.5 * (u * v + square * math.atan2(u, v))

    width, top = min(1.0, radius), min(height, radius)
    corner = math.sqrt(max(square - top * top, 0.0))  # up to here the height counts
    return top * width if corner >= width else top * corner + below(width) - below(corner)


@pytest.mark.parametrize("backend", ["numpy", "c", "jax"])
def test_ends_where_all_roots_vanish_together(backend: Any, x64: None) -> None:
    """Lengths that go with a power 1/4 or 1/6 of the distance from their end, exact at once: against closed forms."""
    a = teg.param("a")
    fourth = teg.integral(teg.bracket(x**4 + a * y**4 < t), (x, -1, 1), (y, -1, 1))
    sixth = teg.integral(teg.bracket(x**6 + a * y < t), (x, -1, 1), (y, -1, 1))
    at = {"a": 1.3, "t": 0.4}
    area = 4.0 * math.gamma(1.25) ** 2 / math.gamma(1.5) * math.sqrt(0.4 / math.sqrt(1.3))
    wide = 2.0 * (1.0 - 0.6 / 1.3)  # where t - a·y > 1; behind it the length is 2·(t - a·y)^(1/6)
    assert teg.evaluate(fourth, **at, backend=backend) == pytest.approx(area, rel=1e-14)
    assert teg.evaluate(sixth, **at, backend=backend) == pytest.approx(wide + 12.0 / 7.0 / 1.3, rel=1e-14)


def test_they_are_bends() -> None:
    a = teg.param("a")
    e = teg.integral(teg.bracket(x**4 + a * y**4 < t), (x, -1, 1), (y, -1, 1))
    value, gradient = (teg.compile(e, [t, a]).program(order) for order in (0, 1))
    kinds = [[b.kind for b in s.bends] for p in (value, gradient) for s in statements(p.body) if isinstance(s, Integrate)]
    assert kinds[0] == ["end"]
    assert kinds[1:] == [["end"], [], []]  # along the curve nothing vanishes


# -- breaks of outer integrals -------------------------------------------------------------------------------------------------


def outermost(e: teg.Expr) -> Breaks:
    normal = normal_form(e)
    (node,) = [n for n in postorder([normal]) if isinstance(n, Integral) and not n.free]
    return BreakAnalysis().of(node)


def test_roots_that_pass_each_other_at_different_places_are_no_breaks() -> None:
    """Three planes in a box: 12 places where two of them meet a side, 12 where one meets an edge, and the corner, in three ways."""
    planes = [rate * x + y * (k + 1) + z * (2 - k * k) > t + 0.1 * k for k, rate in enumerate((a, b, c))]
    inside = teg.bracket(planes[0] & planes[1] & planes[2])
    box = (x, 0, 1), (y, 0, 1), (z, 0, 1)
    assert len(outermost(teg.integral(inside, *box)).functions) == 12 + 12 + 3
    squared = teg.integral(teg.integral(inside, box[0]) ** 2, *box[1:])
    assert len(outermost(squared).functions) > 12 + 12 + 3


def pieces(shift: float) -> tuple[float, float]:
    """Returns ∫∫ (L + R)² dy dz and its derivative by t at t = shift, for L = min(½, y - z + t)⁺ and R = min(½, 1 - y - z)⁺, by an exact
    rule between all places where their kinks meet each other or the square."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    value = derivative = 0.0
    outer = np.unique(np.clip([0, shift, 0.5 + shift, 1 + shift, (1 + shift) / 2, shift / 2, 0.25 + shift / 2, 0.5, 1, shift - 0.5], 0, 1))
    for low, high in pairwise(outer):
        for at, weight in zip(0.5 * (low + high) + 0.5 * (high - low) * nodes, 0.5 * (high - low) * weights, strict=True):
            inner = np.unique(np.clip([0, at - shift, at - shift + 0.5, 1 - at, 0.5 - at, 1], 0, 1))
            for left, right in pairwise(inner):
                places = 0.5 * (left + right) + 0.5 * (right - left) * nodes
                rising = places - at + shift
                both = np.clip(rising, 0, 0.5) + np.clip(1 - places - at, 0, 0.5)
                steps = 0.5 * (right - left) * weights * weight
                value += float(steps @ both**2)
                derivative += float(steps @ (2 * both * ((rising > 0) & (rising < 0.5))))
    return value, derivative


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("backend", ["numpy", "jax", pytest.param("c", marks=in_c)])
def test_kinks_that_pass_each_other_in_a_square_are_breaks(backend: str) -> None:
    """Two pieces of one inner integral, far from each other in x, whose product has a kink where their ends are at the same y."""
    left, right = teg.bracket((x < y - z + t) & (x < 0.5)), teg.bracket((x > 0.5) & (x < 1.5 - y - z))
    f = teg.compile(teg.integral(teg.integral(left + right, (x, 0, 1)) ** 2, (y, 0, 1), (z, 0, 1)), [t], backend=backend)
    for shift in (-0.2, 0.05, 0.3):
        value, slope = pieces(shift)
        found, slopes = f.value_and_grad(t=shift)
        assert found == pytest.approx(value, rel=1e-12)
        assert slopes["t"] == pytest.approx(slope, rel=1e-10)


def test_all_functions_without_a_formula_are_isolated_or_some() -> None:
    waves = [teg.bracket(teg.sin(k * x) + x * x * x > t) for k in range(2, 30)]
    for count, isolated in ((MAX_ISOLATED, MAX_ISOLATED), (MAX_ISOLATED + 4, SOME_ISOLATED)):
        found = outermost(teg.integral(teg.exp(sum(waves[1:count], start=waves[0])), (x, 0, 1)))
        assert len(found.isolated) == isolated
        assert found.complete == (count == isolated)


def test_pieces_of_a_spline_meet_at_its_knot() -> None:
    """a + bx + c·(x - ½)³ and a + bx meet where (x - ½)³ is 0: as a root of three it had an error of 7e-4, with a warning."""
    a, b, c = teg.params("a b c")
    height = a + b * x + c * teg.maximum(x - 0.5, 0) ** 3
    for bounds in (((x, 0, 1), (y, 0, 1)), ((y, 0, 1), (x, 0, 1))):
        f = teg.compile(teg.integral(teg.bracket(y < height), *bounds), [a, b, c], backend="numpy")
        value, error = f.value_and_error(a=0.2, b=0.5, c=-1.0)
        assert value == pytest.approx(0.45 - 1 / 64, rel=1e-13)
        assert error < 1e-10
        assert f.grad(a=0.2, b=0.5, c=-1.0) == pytest.approx({"a": 1, "b": 0.5, "c": 1 / 64}, rel=1e-12)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("sign", [1, -1])
def test_surfaces_that_touch_from_either_side(sign: int, backend: str) -> None:
    """The part of a disk under t·x + b·y + √(a - r²)/2 = 0, half of an ellipse that touches the circle twice. Where the function that is 0
    there was at most 0, both zeros were lost, and the value was off by 4e-4, without a warning."""
    t, a, b = teg.params("t a b")
    square = x * x + y * y
    inside = square - a < 0 if sign > 0 else square < a
    e = teg.integral(teg.bracket(inside & (t * x + b * y + 0.5 * teg.sqrt(a - square) > 0)), (x, -1, 1), (y, -1, 1))
    at = {"t": 0.857891202400034, "b": 0.7128011327935113, "a": 0.9432422336516113}
    slope = 1 + 4 * (at["t"] ** 2 + at["b"] ** 2)
    assert teg.compile(e, [], backend=backend)(at) == pytest.approx(math.pi * at["a"] / 2 * (1 + slope**-0.5), rel=1e-12)


BESIDE_POLES = {
    "sine": (y < teg.sin(3 * x) + a, lambda v: np.sin(3 * v) + 0.5),
    "quotient": (y * teg.exp(x * x) < a + teg.cos(4 * x), lambda v: (np.cos(4 * v) + 0.5) * np.exp(-v * v)),
}


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", BESIDE_POLES)
@pytest.mark.parametrize("at", [0.4, 0.02])
def test_roots_are_looked_for_where_they_matter(at: float, name: str, backend: str, x64_for_jax: None) -> None:
    """Along x·y = t/2 the other curve is one of t/(2y), with roots without end at y = 0, where the hyperbola has left the square. Its
    derivative is ½∫ dx/|x| over those x at which y = t/(2x) is in the square and below the other curve."""
    other, curve = BESIDE_POLES[name]
    f = teg.compile(teg.integral(teg.bracket((x * y < 0.5 * t) & other), (x, -1, 1), (y, -1, 1)), [t], backend=backend)
    exact = 0.0
    for lo, hi in ((-1.0, -0.5 * at), (0.5 * at, 1.0)):
        grid = np.linspace(lo, hi, 20001)
        below = curve(grid) - 0.5 * at / grid
        changes = np.flatnonzero(below[:-1] * below[1:] < 0.0)
        places = [lo, *(float(_zero(lambda v: curve(v) - 0.5 * at / v, grid[i], grid[i + 1])) for i in changes), hi]
        for p, q in pairwise(places):
            exact += 0.5 * abs(math.log(q / p)) * bool(curve(0.5 * (p + q)) > at / (p + q))
    assert f.grad(t=at, a=0.5)["t"] == pytest.approx(exact, abs=1e-9)


def _zero(e: Any, lo: float, hi: float) -> float:
    above = e(lo) > 0.0
    for _ in range(80):
        middle = 0.5 * (lo + hi)
        lo, hi = (middle, hi) if (e(middle) > 0.0) == above else (lo, middle)
    return 0.5 * (lo + hi)
