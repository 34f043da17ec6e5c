"""Surfaces in charts weighted by slope: roots of one variable, kinks, implicit curves and surfaces, births and saddles."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import teg
from teg.analysis.isolation import MAX_ROOTS, isolate, max_roots
from teg.analysis.kinks import Extremes, kinks_of
from teg.ir.expr import Call, Where
from teg.ir.integral import PointMasses
from teg.ir.node import postorder
from teg.passes.eliminate.implicit import Implicit, match_implicit
from teg.passes.normalise.canonicalise import canonicalise
from tests.passes.eliminate.differences import second_differences

x, y, z = teg.vars("x y z")
t, a, b, r = teg.params("t a b r")
SQUARE = ((x, -1, 1), (y, -1, 1))


# -- matching and counting -------------------------------------------------------------------------------------------------


def test_matches() -> None:
    assert match_implicit(x**2 + y**2 - t, [x, y]) == Implicit((y, x))
    assert match_implicit(x**5 - x - t, [x]) == Implicit((x,))
    assert match_implicit(x**2 + y**2 + z**2 - t, [x, y, z]) == Implicit((z, y, x))
    assert match_implicit(teg.integral(teg.exp(x * z), (z, 0, 1)) - t, [x]) is None


@pytest.mark.parametrize(
    ("g", "count"),
    [
        (x**5 - t * x + a, 5),
        (x * teg.exp(-x) - t, 2),
        (teg.exp(x) + teg.exp(2 * x) - t * x, 3),
        (teg.sin(3 * x) - t, MAX_ROOTS),
        (x**40 - t, 40),
        (x**400 - t, MAX_ROOTS),
        (Extremes().of(teg.abs(x) + teg.abs(x - 1) - t), 7),
    ],
    ids=str,
)
def test_how_many_roots_there_can_be(g: teg.Expr, count: int) -> None:
    assert max_roots(g, x) == count


def test_what_cannot_be_isolated() -> None:
    assert isolate(teg.floor(x) - t, x) is None
    assert isolate(teg.integral(x * z, (z, 0, 1)) - t, x) is None
    assert isolate(t - a, x) is None


def test_weights_have_no_kinks_of_their_own() -> None:
    """A surface that is affine in each of its variables: its slopes change their signs, but no chart breaks where one of them overtakes
    another."""
    e = teg.integral(teg.bracket(x * y + y * z + z * x < t), (x, -1, 1), (y, -1, 1), (z, -1, 1))
    derivative = teg.eliminate(teg.diff(e, t))
    assert not [n for n in postorder([derivative]) if isinstance(n, Call) and n.name == "max" and n.free]


# -- one variable ----------------------------------------------------------------------------------------------------------


def _polynomial_case(coefficients: list[float], shift: float) -> tuple[float, float, float]:
    """∫ [p(x) < s]·e^x over (-1.5, 1.5), its first and second derivative by s, from numpy's roots."""
    p = np.polynomial.Polynomial(coefficients)
    roots = sorted(float(u.real) for u in (p - shift).roots() if abs(u.imag) < 1e-9 and -1.5 < u.real < 1.5)
    ends = [-1.5, *roots, 1.5]
    value = sum(math.exp(v) - math.exp(u) for u, v in pairwise(ends) if p(0.5 * (u + v)) < shift)
    d1, d2 = p.deriv(), p.deriv(2)
    gradient = sum(math.exp(u) / abs(d1(u)) for u in roots)
    hessian = sum(math.exp(u) * (1 / (d1(u) * abs(d1(u))) - d2(u) / (d1(u) ** 2 * abs(d1(u)))) for u in roots)
    return value, gradient, hessian


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("coefficients", "shift"),
    [
        ([0.1, -1.0, -0.3, 0.0, 0.0, 1.0], 0.05),
        ([0.0, 0.3, 0.0, -1.0], 0.02),
        ([0.3, -0.1, -1.2, 0.2, 0.8], 0.1),
        ([0.05, 0.9, -0.2, -2.1, 0.1, 1.0, 0.3, -0.4, 0.7], 0.2),
    ],
)
def test_polynomials(coefficients: list[float], shift: float, backend: str) -> None:
    p: teg.Expr = sum((c * x**k for k, c in enumerate(coefficients) if k), coefficients[0] + 0 * x)
    f = teg.compile(teg.integral(teg.bracket(p < t) * teg.exp(x), (x, -1.5, 1.5)), backend=backend)
    value, gradient, hessian = _polynomial_case(coefficients, shift)
    found, slopes = f.value_and_grad(t=shift)
    assert found == pytest.approx(value, rel=1e-12)
    assert slopes["t"] == pytest.approx(gradient, rel=1e-11)
    assert f.hessian(t=shift)["t", "t"] == pytest.approx(hessian, rel=1e-10)


def test_a_bracket_beside_a_root() -> None:
    """Two points of one line meet for single values of the parameters only."""
    f = teg.compile(teg.integral(teg.bracket(x * teg.exp(-x) < t) * teg.bracket(x < a) * teg.exp(x), (x, 0, 5)))
    at = {"t": 0.2, "a": 3.0}
    hessian = f.hessian(at)
    assert hessian["a", "a"] == pytest.approx(math.exp(3.0), rel=1e-13)
    assert hessian["a", "t"] == hessian["t", "a"] == 0.0
    assert hessian["t", "t"] == pytest.approx(second_differences(f, at)["t", "t"], rel=1e-9)


# -- kinks -----------------------------------------------------------------------------------------------------------------


def test_continuous_branches_become_sizes() -> None:
    e = teg.abs(x - a) + teg.minimum(x, t) - teg.maximum(2 * x, 1 - x)
    assert len(kinks_of(e)) == 3
    smooth = Extremes().of(e)
    assert not any(isinstance(n, Where) for n in postorder([smooth]))
    for at in ((0.3, 0.1, 0.7), (-2.0, 0.4, -1.0)):
        values = dict(zip("xat", at, strict=True))
        pair = [teg.evaluate(teg.integral(u, (x, values["x"], values["x"] + 1)), {"a": values["a"], "t": values["t"]}) for u in (e, smooth)]
        assert pair[0] == pytest.approx(pair[1], rel=1e-12)
    jump = teg.where(x < t, 1.0, 2.0 + x)
    assert Extremes().of(jump) is jump


@pytest.mark.parametrize("n", [3, 5, 10, 20])
def test_a_sum_of_many_distances(n: int) -> None:
    """[Σ|x - cᵢ| < r]: an interval, whose ends move with 1/|slope|; linear in n."""
    centres = [0.0517 * i + 0.1 * (i % 3) for i in range(n)]
    total: teg.Expr = sum((teg.abs(x - (c - 0.1 * (i % 3) + t * (i % 3))) for i, c in enumerate(centres)), 0 * x)
    e = teg.integral(teg.bracket(total < r) * teg.exp(x), (x, -1, 2))
    assert teg.size(canonicalise(e)) < 40 * n + 60
    f = teg.compile(e)
    at = {"t": 0.1, "r": 0.35 * n}
    ends = []
    for low, high in ((-1.0, float(np.median(centres))), (float(np.median(centres)), 2.0)):
        inside = [sum(abs(u - c) for c in centres) < at["r"] for u in (low, high)]
        if inside[0] == inside[1]:
            ends.append(low if low == -1.0 else high)
            continue
        for _ in range(200):
            middle = 0.5 * (low + high)
            if (sum(abs(middle - c) for c in centres) < at["r"]) == inside[0]:
                low = middle
            else:
                high = middle
        ends.append(low)
    value, gradient = f.value_and_grad(at)
    assert value == pytest.approx(math.exp(ends[1]) - math.exp(ends[0]), rel=1e-12)
    moving = [e for e in ends if -1 < e < 2]
    exact = sum(math.exp(e) / abs(sum(math.copysign(1, e - c) for c in centres)) for e in moving)
    assert gradient["r"] == pytest.approx(exact, rel=1e-11)


POLYGON = teg.integral(teg.bracket(teg.abs(x - a) + teg.abs(y) + teg.abs(x + y) < t) * teg.exp(0.3 * x + 0.2 * y), *SQUARE)


def test_a_polygon_in_the_l1_norm() -> None:
    assert teg.check_gradient(teg.compile(POLYGON, tol=1e-12, backend="c"), {"t": 0.8, "a": 0.1}, tol=1e-7)


@pytest.mark.slow
def test_second_derivatives_of_a_polygon_in_the_l1_norm() -> None:
    """The kinks of the surface are corners of the region, and move them."""
    f = teg.compile(POLYGON, tol=1e-12, backend="c")
    at = {"t": 0.8, "a": 0.1}
    hessian, differences = f.hessian(at), second_differences(f, at, 1e-3)
    for pair, exact in differences.items():
        assert hessian[pair] == pytest.approx(exact, rel=1e-10, abs=1e-10)


# -- circles and other conics --------------------------------------------------------------------------------------------


def test_a_disk_weighted_with_an_exponential() -> None:
    """d²/dt² of ∫∫ [x² + y² < t] e^{0.3x + 0.5y} is π·0.34/4·I₁-like: 0.2727502143… at t = ½ (the charts' own borders must not count)."""
    f = teg.compile(teg.integral(teg.bracket(x * x + y * y < t) * teg.exp(0.3 * x + 0.5 * y), *SQUARE))
    k2 = 0.34
    terms = [math.pi * k2**n * 0.5 ** (n - 1) * n * (n + 1) / (4.0**n * math.factorial(n) * math.factorial(n + 1)) for n in range(1, 20)]
    assert f.hessian(t=0.5)["t", "t"] == pytest.approx(sum(terms), rel=1e-12)
    assert f.hessian(t=0.5)["t", "t"] == pytest.approx(0.27275, abs=5e-6)


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=pytest.mark.slow)])
def test_two_circles(backend: str) -> None:
    """A lens: its Hessian has point terms where the circles cross."""
    lens = teg.bracket(x * x + y * y < t) * teg.bracket((x - a) ** 2 + (y - 0.1) ** 2 < r * r)
    f = teg.compile(teg.integral(lens * (1 + y), *SQUARE), backend=backend)
    at = {"t": 0.4, "a": 0.5, "r": 0.45}
    hessian = f.hessian(at)
    for pair, quotient in second_differences(f, at).items():
        assert hessian[pair] == pytest.approx(quotient, rel=1e-7, abs=1e-8)


def test_a_region_born_at_a_point() -> None:
    f = teg.compile(teg.integral(teg.bracket(x * x + y * y < t), *SQUARE))
    assert f.grad(t=0.0)["t"] == pytest.approx(math.pi / 2, rel=1e-9)  # the mean of 0 and π
    assert f.diagnose(t=0.0)
    assert f.diagnose(t=0.1) == []


@pytest.mark.parametrize("e", [x * x - y * y - t, x * y - t, (x + y) * (x - 2 * y) + t], ids=str)
def test_two_branches_that_meet_give_an_infinite_derivative(e: teg.Expr) -> None:
    f = teg.compile(teg.integral(teg.bracket(e < 0) * (1 + x), *SQUARE))
    assert math.isinf(f.grad(t=0.0)["t"])
    assert [d.kind for d in f.diagnose(t=0.0)][-1] == "infinite derivative"
    assert math.isfinite(f.grad(t=1e-6)["t"])


def test_curves_that_coincide_are_diagnosed() -> None:
    f = teg.compile(teg.integral(teg.bracket(x * x + y * y < t) * teg.bracket(x * x + y * y < a), *SQUARE))
    gradient = f.grad(t=0.5, a=0.5)
    assert gradient == {"t": pytest.approx(math.pi / 2), "a": pytest.approx(math.pi / 2)}
    assert f.diagnose(t=0.5, a=0.5)


# -- implicit curves and surfaces --------------------------------------------------------------------------------------------

IMPLICIT = {
    "heart": ((x**2 + y**2 - 1) ** 3 - x**2 * y**3 < t, 1.4, {"t": 0.1, "a": 0.3}),
    "cubic": (x**3 + y**3 + x * y < t, 1.0, {"t": 0.3, "a": 0.5}),
    "waves": (x * teg.exp(y) + teg.sin(3 * x * y) + y**3 < t, 1.0, {"t": 0.1, "a": 0.3}),
    "sine": (y > teg.sin(3 * x) + t, 1.0, {"t": 0.2, "a": -0.4}),
    "product": (teg.sin(2 * x) * teg.cos(y) + 0.2 * x * y < t, 1.2, {"t": 0.15, "a": 0.2}),
}


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow if n in ("waves", "product") else ()) for n in IMPLICIT])
def test_implicit_curves(name: str) -> None:
    condition, side, at = IMPLICIT[name]
    f = teg.compile(teg.integral(teg.bracket(condition) * teg.exp(a * x), (x, -side, side), (y, -side, side)), tol=1e-11)
    assert teg.check_gradient(f, at, tol=1e-6)
    hessian = f.hessian(at)
    for pair, quotient in second_differences(f, at).items():
        assert hessian[pair] == pytest.approx(quotient, rel=1e-6, abs=1e-7)


def test_a_curve_cut_by_a_line() -> None:
    f = teg.compile(teg.integral(teg.bracket(x**4 + y**4 < t) * teg.bracket(x < a * y) * teg.exp(x), *SQUARE))
    at = {"t": 0.3, "a": 0.3}
    hessian = f.hessian(at)
    for pair, quotient in second_differences(f, at).items():
        assert hessian[pair] == pytest.approx(quotient, rel=1e-8, abs=1e-9)


def test_spheres() -> None:
    """|∇|-weighted charts in three variables: the area of a sphere, inside and clipped."""
    box = ((x, -1, 1), (y, -1, 1), (z, -1, 1))
    f = teg.compile(teg.integral(teg.bracket(x * x + y * y + z * z < r * r), *box), backend="c")
    value, gradient = f.value_and_grad(r=0.7)
    assert value == pytest.approx(4 / 3 * math.pi * 0.7**3, rel=1e-9)
    assert gradient["r"] == pytest.approx(4 * math.pi * 0.7**2, rel=1e-9)
    assert f.hessian(r=0.7)["r", "r"] == pytest.approx(8 * math.pi * 0.7, rel=1e-8)
    caps = 6 * 2 * math.pi * 1.2 * (1.2 - 1)
    assert f.value_and_grad(r=1.2)[1]["r"] == pytest.approx(4 * math.pi * 1.2**2 - caps, rel=1e-8)


def test_point_masses_are_no_deltas() -> None:
    e = teg.eliminate(teg.diff(teg.integral(teg.bracket(x**5 - x < t), (x, -0.5, 0.5)), t))
    assert not e.has_delta
    assert any(isinstance(n, PointMasses) for n in postorder([e]))
    assert "masses" in str(e)
    assert teg.evaluate(e, {t: 0.05}) == pytest.approx(1 / abs(5 * 0.05**4 - 1), rel=1e-3)


@pytest.mark.parametrize("radius", [0.5, *(pytest.param(r, marks=pytest.mark.slow) for r in (0.1, 0.02)), 1e-3])
def test_a_loop_is_found_however_small(radius: float) -> None:
    """Where its roots are born is searched for in two dimensions: the nodes of the outer integral would step over it."""
    u, v = (x - a) / r, (y - b) / r
    f = teg.compile(teg.integral(teg.bracket(u**4 + 2 * v**4 + 0.3 * u * v + u**2 - 0.7 + 0.2 * u**3 < 0), *SQUARE))
    for centre in ((0.2, 0.3), (-0.37, 0.11)):
        at = {"a": centre[0], "b": centre[1], "r": radius}
        value, gradient = f.value_and_grad(at)
        assert value == pytest.approx(1.90292088286545 * radius**2, rel=1e-11)
        assert gradient["r"] == pytest.approx(2 * 1.90292088286545 * radius, rel=1e-9)


def test_births_inside_the_box_are_breaks() -> None:
    e = teg.bracket(x**5 + y**5 - 3 * a * x**2 * y + x * y**3 + b * x - t < 0) * (1 + x * y)
    for order in (SQUARE, SQUARE[::-1]):
        f = teg.compile(teg.integral(e, *order))
        value, gradient = f.value_and_grad(a=0.4, b=0.3, t=0.1)
        assert value == pytest.approx(2.456422169521843, rel=1e-12)
        assert gradient["t"] == pytest.approx(6.5108767084, rel=1e-9)


@pytest.mark.parametrize(
    "condition",
    [
        (y**2 - x**3 + x - t < 0) & (x**2 + y**2 < a),
        pytest.param((x**5 + y**3 + x * y + y < t) & (x * x + y * y < a), marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_a_curve_cut_by_a_circle(condition: teg.Cond) -> None:
    side = 1.5
    f = teg.compile(teg.integral(teg.bracket(condition), (x, -side, side), (y, -side, side)), tol=1e-12)
    at = {"t": 0.1, "a": 1.3}
    hessian = f.hessian(at)
    for pair, quotient in second_differences(f, at).items():
        assert hessian[pair] == pytest.approx(quotient, rel=1e-6, abs=1e-8)


def test_two_implicit_curves_have_first_derivatives_and_refuse_second_ones() -> None:
    f = teg.compile(teg.integral(teg.bracket(x**5 + y**3 + x * y < t) * teg.bracket(y**5 + x * x * y + x < a), *SQUARE))
    assert teg.check_gradient(f, {"t": 0.2, "a": 0.3}, tol=1e-6)
    with pytest.raises(teg.TegError) as caught:
        f.hessian(t=0.2, a=0.3)
    assert caught.value.hint


def test_an_eliminated_derivative_can_be_differentiated() -> None:
    e = teg.integral(teg.bracket(x * teg.exp(-x) < t) * teg.exp(x), (x, 0, 5))
    second = teg.diff(teg.eliminate(teg.diff(e, t)), t)
    assert teg.evaluate(second, {t: 0.2}) == pytest.approx(teg.compile(e).hessian(t=0.2)["t", "t"], rel=1e-12)


@pytest.mark.parametrize(
    ("g", "at", "exact"),
    [
        (teg.where(x < 0, x + t, x - a), {"t": 0.3, "a": 0.4}, 2.0),
        (teg.maximum(x - t, -x - a), {"t": 0.3, "a": -0.5}, 0.0),
        (teg.abs(x) - t, {"t": 0.3}, 2.0),
    ],
    ids=str,
)
def test_a_delta_of_a_piecewise_argument(g: teg.Expr, at: dict[str, float], exact: float) -> None:
    assert teg.evaluate(teg.integral(teg.delta(g), (x, -1, 1)), at) == pytest.approx(exact, rel=1e-13)


def test_deltas_of_two_curves() -> None:
    """Their product is a sum over crossings, 1/|∇g × ∇h| each, and can be differentiated."""
    e = teg.integral(teg.delta(x * x + y * y - t) * teg.delta((x - a) ** 2 + y * y - b) * (1 + x + y), (x, -2, 2), (y, -2, 2))
    f = teg.compile(e)
    at = {"t": 1.0, "a": 0.9, "b": 0.8}
    xs = (1.0 - 0.8 + 0.81) / 1.8
    ys = math.sqrt(1 - xs * xs)
    assert f(at) == pytest.approx(2 * (1 + xs) / (4 * 0.9 * ys), rel=1e-12)
    assert teg.check_gradient(f, at, tol=1e-8)


def test_where_a_curve_and_a_circle_cross_is_a_break_in_both_variables() -> None:
    """d/db is ½∮(1 + xy)dθ over the arcs of the circle inside the curve, between crossings found by bisection."""
    at = {"a": -1.307, "t": 0.46761384225033076, "b": 0.5813520610116472}
    g = a * x**2 * y - 0.548 * x * y + 0.304 * x * y**3 - 0.132 * x * y**2 - 0.75 * x**3 * y + 0.855 * x**2 * y**2 + 0.834 * y**2
    f = teg.compile(teg.integral(teg.bracket((g < t) & (x * x + y * y < b)) * (1 + x * y), (y, -1, 1), (x, -1, 1)))
    assert f.grad(at)["b"] == pytest.approx(2.359924269230896, rel=1e-11)


@pytest.mark.parametrize("bounds", [(1.3, -0.4), teg.params("high low")], ids=["numbers", "parameters"])
@pytest.mark.parametrize("surface", ["superellipse", "turned ellipse"])
def test_reversed_bounds_turn_the_sign(surface: str, bounds: Any) -> None:
    """Of each chart: a chart over x sums roots in y, and the other way round."""
    x, y = teg.vars("x y")
    a, t = teg.params("a t")
    inside = {"superellipse": (x - a) ** 4 + y**4 < t, "turned ellipse": (x - a * y) ** 2 + (y + a * x) ** 2 < t}[surface]
    body = teg.bracket(inside) * (1 + a * x * y)
    forward, reverse = (teg.integral(body, (x, *ends), (y, -0.7, 0.9)) for ends in ((-0.4, 1.3), bounds))
    at = {"a": 0.3, "t": 0.45}
    f, g = (teg.compile(e, [a, t], intrinsics=False) for e in (forward, reverse))
    ends = {"high": 1.3, "low": -0.4} if "high" in g.parameters else {}
    value, slopes = f.value_and_grad(at)
    turned, others = g.value_and_grad(at | ends)
    assert turned == pytest.approx(-value, rel=1e-9)
    for name, slope in slopes.items():
        assert others[name] == pytest.approx(-slope, abs=1e-9)
    assert g.hessian(at | ends)["t", "t"] == pytest.approx(-f.hessian(at)["t", "t"], abs=1e-7)


QUOTIENTS = {
    "a quotient": (t / (x + a), lambda t, a: [0.0, 1 / (1 + a) - 1 / a, t / a**2 - t / (1 + a) ** 2]),
    "x over a sum": (
        t * x / (x + a),
        lambda t, a: [0.0, a / a - (a / (1 + a) + math.log((1 + a) / a)), t * (-1 / (1 + a) + 1 / a - 1 / (1 + a) ** 2)],
    ),
}


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", QUOTIENTS)
def test_second_derivatives_of_the_area_under_a_quotient(name: str, backend: str) -> None:
    """The denominator's surface and the quotient's meet at t = 0 alone: a delta of t, which contributes nothing."""
    height, wanted = QUOTIENTS[name]
    f = teg.compile(teg.integral(teg.bracket(y < height), (x, 0, 1), (y, 0, 1)), [t, a], backend=backend)
    h = f.hessian(t=0.3, a=0.7)
    assert [h["t", "t"], h["t", "a"], h["a", "a"]] == pytest.approx(wanted(0.3, 0.7), abs=1e-12)


def superellipse_area(p: float, t: float) -> float:
    """Of |x|^p + |y|^p < t."""
    return 4 * t ** (2 / p) * math.gamma(1 + 1 / p) ** 2 / math.gamma(1 + 2 / p)


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("p", [0.5, 2.5])
def test_powers_of_sizes(p: float, backend: str, x64_for_jax: None) -> None:
    """Its gradient was NaN: a quarter's power is no number in the other quarters."""
    e = teg.integral(teg.bracket(teg.abs(x - a) ** p + teg.abs(y) ** p < t), (x, -2, 2), (y, -2, 2))
    value, gradient = teg.compile(e, [a, t], backend=backend).value_and_grad(a=0.1, t=0.8)
    assert value == pytest.approx(superellipse_area(p, 0.8), rel=1e-10)
    assert gradient["t"] == pytest.approx(2 / p / 0.8 * superellipse_area(p, 0.8), rel=1e-9)
    assert gradient["a"] == pytest.approx(0, abs=1e-9)


def test_a_power_that_is_a_parameter() -> None:
    e = teg.integral(teg.bracket(teg.abs(x) ** a + teg.abs(y) ** a < t), (x, -2, 2), (y, -2, 2))
    value, gradient = teg.compile(e, [a, t], backend="numpy").value_and_grad(a=0.6, t=0.8)
    assert value == pytest.approx(superellipse_area(0.6, 0.8), rel=1e-9)
    h = 1e-3
    far, near = (superellipse_area(0.6 + d, 0.8) - superellipse_area(0.6 - d, 0.8) for d in (2 * h, h))
    assert gradient["a"] == pytest.approx((8 * near - far) / (12 * h), rel=1e-8)


@pytest.mark.parametrize("inside", [(x < 0) & (teg.sqrt(-x) + y**2 < t), ~(x >= 0) & (teg.sqrt(-x) < t - y**2)])
def test_a_side_on_which_a_surface_is_no_number(inside: teg.Cond) -> None:
    """A factor where(x >= 0, 0, v) guards v as where(x < 0, v, 0) does. The area is ∫ (t - y²)² dy up to y = √t."""
    f = teg.compile(teg.integral(teg.bracket(inside), (x, -1, 0.5), (y, 0, 1)), [t], backend="numpy")
    value, gradient = f.value_and_grad(t=0.8)
    assert value == pytest.approx(8 / 15 * 0.8**2.5, rel=1e-10)
    assert gradient["t"] == pytest.approx(4 / 3 * 0.8**1.5, rel=1e-10)


def test_a_superellipse_that_turns() -> None:
    """Nothing jumps on its axes, whatever the signs of its semi-axes b and c are."""
    c = teg.param("c")
    u, v = x * teg.cos(a) + y * teg.sin(a), y * teg.cos(a) - x * teg.sin(a)
    inside = teg.abs(u / b) ** 2.5 + teg.abs(v / c) ** 2.5 < 1
    f = teg.compile(teg.integral(teg.bracket(inside), (x, -1, 1), (y, -1, 1)), [a, b, c], backend="numpy")
    value, gradient = f.value_and_grad(a=0.3, b=0.8, c=0.4)
    assert value == pytest.approx(0.32 * superellipse_area(2.5, 1), rel=1e-10)
    assert gradient["a"] == pytest.approx(0, abs=1e-9)
    assert gradient["b"] == pytest.approx(value / 0.8, rel=1e-9)
