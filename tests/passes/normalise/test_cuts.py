"""Jumps of functions that have no condition: the cut of atan2, and functions with other limits on the other side of a pole."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import mpmath
import numpy as np
import pytest

import teg
from teg.analysis.surfaces import atoms_of
from teg.ir.traverse import size
from teg.passes.normalise.cuts import with_cuts
from teg.pipeline import normal_form

pytestmark = pytest.mark.usefixtures("x64_for_jax")

x, y = teg.vars("x y")
a, b, t = teg.params("a b t")
theta = teg.atan2(y - a, x - b)
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
Number = mpmath.mpf
PROGRAMS: dict[str, tuple[teg.Expr, Callable[[Number, Number, Number], Number]]] = {
    "a cut that moves": (teg.atan2(x - a, b - 1) * x, lambda s, p, q: mpmath.atan2(s - p, q - 1) * s),
    "a cut that ends": (teg.atan2(x - a, x - b) * x, lambda s, p, q: mpmath.atan2(s - p, s - q) * s),
    "no cut": (teg.atan2(x - a, b) * x, lambda s, p, q: mpmath.atan2(s - p, q) * s),
    "an angle by a quotient": (teg.atan(b / (x - a)) * x, lambda s, p, q: mpmath.atan(q / (s - p)) * s),
    "an angle of a tangent": (teg.atan(teg.tan(3 * x - a - 1)), lambda s, p, q: mpmath.atan(mpmath.tan(3 * s - p - 1))),
    "an error function of a pole": (teg.erf(1 / (x - a)), lambda s, p, q: mpmath.erf(1 / (s - p))),
    "a peak of a pole": (teg.exp(-1 / (x - a) ** 2) * x, lambda s, p, q: mpmath.exp(-1 / (s - p) ** 2) * s),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", PROGRAMS)
def test_jumps_of_functions_move(name: str, backend: str) -> None:
    """References integrate between the jumps, and difference the integrals."""
    e, f = PROGRAMS[name]
    at = (0.4, 0.75)

    def integral(p: Number, q: Number) -> Number:
        pole = (p + 1 + mpmath.pi / 2) / 3
        ends = sorted({Number(0), Number(1), *(u for u in (p, q, pole) if 0 < u < 1)})
        return mpmath.quad(lambda s: f(s, p, q), ends)

    with mpmath.workdps(30):
        h = mpmath.mpf(10) ** -7
        p, q = map(Number, at)
        exact = integral(p, q)
        slopes = [
            (integral(p + h, q) - integral(p - h, q)) / (2 * h),
            (integral(p, q + h) - integral(p, q - h)) / (2 * h),
        ]
    evaluator = teg.compile(teg.integral(e + 0 * b, (x, 0, 1)), [a, b], backend=backend)
    value, gradient = evaluator.value_and_grad(a=at[0], b=at[1])
    assert value == pytest.approx(float(exact), rel=1e-11)
    assert gradient["a"] == pytest.approx(float(slopes[0]), rel=1e-9)
    assert gradient["b"] == pytest.approx(float(slopes[1]), rel=1e-9, abs=1e-12)


def test_the_pass_is_idempotent_and_leaves_what_has_no_jump_that_moves() -> None:
    e = teg.integral(teg.atan2(x - a, b) + teg.erf(1 / (x - a)), (x, 0, 1))
    once = with_cuts(e)
    assert once is not e
    assert with_cuts(once) is once
    for u in (teg.atan2(x, b), teg.atan2(x - a, 2.0), teg.atan(x - a), teg.atan2(a, b), teg.exp(-1 / (x - a) ** 2)):
        assert with_cuts(teg.integral(u, (x, 0, 1))) is teg.integral(u, (x, 0, 1))
    for condition in (teg.atan2(x, 2.0) < b, teg.atan2(a, x) < b, teg.atan(x - a) < b):
        assert with_cuts(teg.integral(teg.bracket(condition), (x, 0, 1))) is teg.integral(teg.bracket(condition), (x, 0, 1))
    turned = with_cuts(teg.integral(teg.bracket(1 - 2 * teg.atan2(y - a, x) < b), (x, 0, 1)))
    assert with_cuts(turned) is turned


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("condition", "exact", "slopes"),
    [
        (teg.atan2(x - a, -1) < b, 0.4, {"a": 1.0, "b": 0.0}),
        (teg.atan2(x - 0.4, -1) < b, 0.4, {"b": 0.0}),
        (teg.exp(1 / (x - a)) < b, 0.4, {"a": 1.0, "b": 0.0}),
        (teg.atan(1 / (x - a)) < 1.5 * b, 1 - 1 / math.tan(1.125), {"a": 0.0, "b": 1.5 / math.sin(1.125) ** 2}),
        (teg.tanh(1 / (x - 0.4)) < b, 0.4, {"b": 0.0}),
    ],
    ids=str,
)
def test_jumps_in_conditions(condition: teg.Expr, exact: float, slopes: dict[str, float], backend: str) -> None:
    """The condition holds on one side of the jump, where the function has no root: the value was 0 or 1."""
    f = teg.compile(teg.integral(teg.bracket(condition), (x, 0, 1)), backend=backend)
    at = {name: {"a": 0.4, "b": 0.75}[name] for name in f.parameters}
    value, gradient = f.value_and_grad(**at)
    assert value == pytest.approx(exact, rel=1e-12)
    assert gradient == pytest.approx(slopes, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("condition", "sign"),
    [(theta < t, 1), (theta > t, -1), (1 - 2 * theta > 1 - 2 * t, 1), (~(theta < t), -1)],
    ids=["below", "above", "a multiple", "not below"],
)
def test_an_angle_around_a_centre_that_moves(condition: teg.Expr, sign: int, backend: str) -> None:
    """What lies below the cut, and a triangle: 2(a + 1) + ½·tan t·(1 - b)². The derivative by a was 0.8, second derivatives were wrong."""
    f = teg.compile(teg.integral(teg.bracket(condition), (x, -1, 1), (y, -1, 1)), [t, a, b], backend=backend)
    at = {"t": 0.6, "a": 0.1, "b": 0.2}
    tangent, secant = math.tan(0.6), 1 / math.cos(0.6) ** 2
    value, gradient = f.value_and_grad(**at)
    area = 2.2 + 0.32 * tangent
    assert value == pytest.approx(area if sign > 0 else 4 - area, rel=1e-13)
    assert gradient == pytest.approx({"t": sign * 0.32 * secant, "a": sign * 2.0, "b": -sign * 0.8 * tangent}, rel=1e-12)
    second = {("t", "t"): 0.64 * secant * tangent, ("t", "b"): -0.8 * secant, ("b", "b"): tangent}
    for (p, q), found in f.hessian(**at).items():
        assert found == pytest.approx(sign * second.get((p, q), second.get((q, p), 0.0)), rel=1e-12, abs=1e-12)


phi = teg.atan2(y, x)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("reverse", [False, True], ids=["xy", "yx"])
@pytest.mark.parametrize(
    ("condition", "limit", "slope"),
    [
        (t > phi, 2.0, 1.0),
        (3 - 2 * phi > 3 - 2 * t, 2.0, 1.0),
        (phi < 2, 2.0, None),
        (teg.exp(phi) < t, math.log(2.0), 0.5),
        (phi**3 < t, 2.0 ** (1 / 3), 2.0 ** (-2 / 3) / 3),
    ],
    ids=["below", "a multiple", "a number", "an exponential", "a cube"],
)
def test_a_cut_that_stays(condition: teg.Expr, limit: float, slope: float | None, reverse: bool, backend: str) -> None:
    """Below the limit lies a wedge of a disk around the cut's end. With y inside, the wedge also had the quarter above the cut, without a
    warning."""
    ranges = [(x, -1, 1), (y, -1, 1)]
    inside = teg.bracket(condition & (x * x + y * y < a))
    f = teg.compile(teg.integral(inside, *(ranges[::-1] if reverse else ranges)), [t, a] if slope else [a], backend=backend)
    at = {"a": 0.5, **({"t": 2.0} if slope else {})}
    value, gradient = f.value_and_grad(**at)
    assert value == pytest.approx(0.25 * (math.pi + limit), rel=1e-10)
    assert gradient["a"] == pytest.approx(0.5 * (math.pi + limit), rel=1e-9)
    if slope is not None:
        assert gradient["t"] == pytest.approx(0.25 * slope, rel=1e-9)


@pytest.mark.parametrize("reverse", [False, True], ids=["xy", "yx"])
def test_steps_of_an_angle(reverse: bool) -> None:
    """The remainders of angles in a disk: ½a·∫(θ - ⌊θ⌋) dθ. With y inside the value was wrong, without a warning."""
    ranges = [(x, -1, 1), (y, -1, 1)]
    body = teg.mod(phi, 1.0) * teg.bracket(x * x + y * y < a)
    f = teg.compile(teg.integral(body, *(ranges[::-1] if reverse else ranges)), [a])
    mean = 0.5 * (1 - (4 - math.pi) ** 2) + 3 + 0.5 * (math.pi - 3) ** 2
    assert f(a=0.5) == pytest.approx(0.25 * mean, rel=1e-9)
    assert f.grad(a=0.5)["a"] == pytest.approx(0.5 * mean, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("reverse", [False, True], ids=["xy", "yx"])
def test_a_spiral_ends_on_the_cut(reverse: bool, backend: str) -> None:
    """r < tθ is ½∫t²θ² dθ. Its roots are isolated, by slopes that say nothing across the cut: with y inside a third was missing."""
    ranges = [(x, -1, 1), (y, -1, 2)]
    body = teg.bracket(teg.sqrt(x * x + y * y) < t * phi)
    f = teg.compile(teg.integral(body, *(ranges[::-1] if reverse else ranges)), [t], backend=backend)
    assert f(t=0.3) == pytest.approx(0.09 * math.pi**3 / 6, rel=1e-9)


@pytest.mark.parametrize("reverse", [False, True], ids=["xy", "yx"])
def test_the_cut_is_a_break_of_an_integrand(reverse: bool) -> None:
    """∫∫ atan2(y, x) over (-1, 1) and (-1, 2) is π: what lies below y = 1 cancels, and above it the mean angle is ½π."""
    ranges = [(x, -1, 1), (y, -1, 2)]
    f = teg.compile(teg.integral(phi, *(ranges[::-1] if reverse else ranges)))
    assert f() == pytest.approx(math.pi, rel=1e-14)


@pytest.mark.parametrize("angle", [-3.0, -1.0, 0.0, 2.0, math.pi, 3.5, -3.5])
def test_an_angle_in_every_direction(angle: float) -> None:
    """A wedge at the middle of a disk is a part of it."""
    condition = (theta < t) & ((x - b) ** 2 + (y - a) ** 2 < 0.25)
    f = teg.compile(teg.integral(teg.bracket(condition), (x, -1, 1), (y, -1, 1)), [t, a, b])
    part = min(max((angle + math.pi) / (2 * math.pi), 0.0), 1.0)
    assert f(t=angle, a=0.1, b=0.2) == pytest.approx(0.25 * math.pi * part, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("reverse", [False, True], ids=["xy", "yx"])
@pytest.mark.parametrize(
    ("condition", "moves"),
    [(theta + x < t, True), (teg.atan2(y - 0.1, x - 0.2) - 2 * x > t, False), (-2 * theta - 3 * y + x > -t, True)],
    ids=["a cut that moves", "a cut that stays", "a factor"],
)
def test_angles_in_longer_conditions(condition: teg.Expr, moves: bool, reverse: bool, backend: str) -> None:
    """The derivatives of [θ + x < t] were 0.8 for 2 by the centre, those of [θ - 2x > t] had roots on the cut. References are differences
    of values, and values are those of a fine grid."""
    ranges = [(x, -1, 1), (y, -1, 1)]
    f = teg.compile(teg.integral(teg.bracket(condition), *(ranges[::-1] if reverse else ranges)), backend=backend)
    at = {name: {"a": 0.1, "b": 0.2, "t": 0.6}[name] for name in f.parameters}
    value, gradient = f.value_and_grad(**at)
    p, q = np.meshgrid(*[(np.arange(2000) + 0.5) / 1000 - 1] * 2)
    angle = np.arctan2(q - 0.1, p - 0.2)
    holds = angle - 2 * p > 0.6 if not moves else -2 * angle - 3 * q + p > -0.6 if "3" in str(condition) else angle + p < 0.6
    assert value == pytest.approx(4 * holds.mean(), abs=1e-5)
    for name, slope in gradient.items():
        change = (f(**{**at, name: at[name] + 1e-4}) - f(**{**at, name: at[name] - 1e-4})) / 2e-4
        assert slope == pytest.approx(change, rel=1e-5, abs=1e-5)


def sector(a: float, b: float, start: float, end: float) -> float:
    """The area of the directions from `start` to `end`, half a turn apart at most, from (a, b) in the unit square: a clipped triangle."""
    far = 10.0
    polygon = [(a, b), *((a + far * math.cos(angle), b + far * math.sin(angle)) for angle in (start, end))]
    for axis, low in ((0, True), (0, False), (1, True), (1, False)):

        def depth(p: tuple[float, float], axis: int = axis, low: bool = low) -> float:
            return p[axis] if low else 1.0 - p[axis]

        clipped = []
        for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            d, e = depth(p), depth(q)
            clipped += [p] if d >= 0.0 else []
            if d * e < 0.0:
                s = d / (d - e)
                clipped.append((p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1])))
        polygon = clipped
    return 0.5 * sum(p[0] * q[1] - p[1] * q[0] for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True))


def pinwheel(at: dict[str, float], width: float) -> float:
    """The area of the directions θ in (-π, π) with mod(θ, width) < t."""
    first, total = math.floor(-math.pi / width), 0.0
    for k in range(first, math.ceil(math.pi / width)):
        start, end = max(k * width, -math.pi), min(k * width + at["t"], math.pi)
        parts = max(1, math.ceil((end - start) / 1.5))
        edges = [start + (end - start) * i / parts for i in range(parts + 1)]
        total += sum(sector(at["a"], at["b"], p, q) for p, q in pairwise(edges) if q > p)
    return total


@pytest.mark.parametrize(
    ("width", "backend"), [(1.0, "numpy"), (3.0, "numpy"), (math.pi / 2, "numpy"), (math.pi / 5, "numpy"), (3.0, "c"), (math.pi / 2, "c")]
)
def test_a_pinwheel_about_a_moving_centre(width: float, backend: str) -> None:
    """Rays at 0 and π lie along the cut, and coincide with it."""
    e = teg.integral(teg.bracket(teg.mod(teg.atan2(y - b, x - a), width) < t), (x, 0, 1), (y, 0, 1))
    at = {"a": 0.4, "b": 0.55, "t": 0.3}
    value, gradient = teg.compile(e, [a, b, t], backend=backend).value_and_grad(at)
    assert value == pytest.approx(pinwheel(at, width), rel=1e-12)
    for name, slope in gradient.items():
        h = 1e-3
        far, near = (pinwheel({**at, name: at[name] + k * h}, width) - pinwheel({**at, name: at[name] - k * h}, width) for k in (2, 1))
        assert slope == pytest.approx((8 * near - far) / (12 * h), abs=1e-8)


def test_steps_of_an_angle_are_at_known_places() -> None:
    """An angle is in (-π, π), wherever its centre is; by its range in the box, which parameters decide, it took minutes to compile."""
    e = normal_form(teg.integral(teg.floor(teg.atan2(y - b, x - a)), (x, 0, 1), (y, 0, 1)))
    levels = {g for atom in atoms_of(e) for g in [atom.g] if not g.free}
    assert not levels
    assert size(e) < 300


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("k", [1, 3])
@pytest.mark.parametrize("name", ["atan", "tanh", "erf"])
def test_a_pole_of_even_order_over_one_of_odd_order_jumps(name: str, k: int, backend: str) -> None:
    """u/u² is 1/u, and u/u⁴ is 1/u³: functions of them jump at u = 0, where the denominators have one sign."""
    u, f = y - t, getattr(teg, name)
    found = teg.compile(teg.integral(f(u / u ** (k + 1)), (y, 0, 1)), [t], backend=backend).grad(t=0.6)["t"]
    g = {"atan": mpmath.atan, "tanh": mpmath.tanh, "erf": mpmath.erf}[name]
    assert found == pytest.approx(float(g((-mpmath.mpf("0.6")) ** -k) - g(mpmath.mpf("0.4") ** -k)), rel=1e-12)


OVER = {
    "a multiple": ((2 * y - 2 * t) / (y - t) ** 2, lambda u, p: 2 / u),
    "a negative": ((t - y) / (y - t) ** 2, lambda u, p: -1 / u),
    "a square written out": ((y - t) / (y * y - 2 * y * t + t * t), lambda u, p: 1 / u),
    "a quadratic": ((y * y - t * t) / (y - t) ** 2, lambda u, p: 1 + 2 * p / u),
    "a rate of parameters": ((a * y - a * t) / (y - t) ** 2, lambda u, p: mpmath.mpf("0.3") / u),
    "odd over odd": ((y - t) / (y - t) ** 3, lambda u, p: 1 / u**2),
    "beside a function": ((y - t) * teg.exp(y) / (y - t) ** 2, lambda u, p: mpmath.exp(u + p) / u),
    "no common root": ((y + t) / (y - t) ** 2, lambda u, p: (u + 2 * p) / u**2),
}
"""Quotients with a pole at y = t, and what they are in u = y - t."""


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", OVER)
def test_quotients_with_a_common_root(name: str, backend: str) -> None:
    e, quotient = OVER[name]
    found = teg.compile(teg.integral(teg.tanh(e), (y, 0, 1)), [t, a], backend=backend).grad(t=0.6, a=0.3)["t"]

    def integral(p: Number) -> Number:
        return mpmath.quad(lambda u: mpmath.tanh(quotient(u, p)), [-p, 0, 1 - p])

    assert found == pytest.approx(float(mpmath.diff(integral, mpmath.mpf("0.6"))), rel=1e-7)


def _turned(v: Number) -> Number:
    """Returns π/2 with the sign of v."""
    return mpmath.pi / 2 * mpmath.sign(v)


ON_AN_AXIS: dict[str, tuple[teg.Expr, Callable[[Number, Number, Number], Number]]] = {
    "upwards": (teg.atan2(x - a, 0), lambda s, p, q: _turned(s - p)),
    "upwards, times the variable": ((1 + x) * teg.atan2(x - a, x - x), lambda s, p, q: (1 + s) * _turned(s - p)),
    "in a function": (teg.exp(teg.atan2(x - a, 0 * b)), lambda s, p, q: mpmath.exp(_turned(s - p))),
    "along": (teg.atan2(0, x - a), lambda s, p, q: mpmath.pi if s < p else mpmath.mpf(0)),
    "along, written with variables": (x * teg.atan2(x - x, x - a), lambda s, p, q: s * mpmath.pi if s < p else mpmath.mpf(0)),
    "along, in a condition": (teg.bracket(teg.atan2(0, x - a) <= b), lambda s, p, q: mpmath.mpf(s > p)),
    "along, compared with itself": (teg.bracket(teg.atan2(x - x, x - a) <= 0), lambda s, p, q: mpmath.mpf(s > p)),
}
"""Angles to points of an axis, and what they are at x = s, a = p, b = q."""


@pytest.mark.parametrize("name", ON_AN_AXIS)
def test_angles_to_points_of_an_axis(name: str) -> None:
    """Such an angle is one of three numbers: it jumps where the point crosses the origin."""
    e, angle = ON_AN_AXIS[name]
    f = teg.compile(teg.integral(e, (x, -1, 1)), [a, b])
    value, slopes = f.value_and_grad(a=0.3, b=0.2)
    p, q = mpmath.mpf("0.3"), mpmath.mpf("0.2")
    assert value == pytest.approx(float(mpmath.quad(lambda s: angle(s, p, q), [-1, p, 1])), rel=1e-12)
    with mpmath.workdps(40):
        jump = angle(p - mpmath.mpf("1e-30"), p, q) - angle(p + mpmath.mpf("1e-30"), p, q)
    assert slopes["a"] == pytest.approx(float(jump), rel=1e-12)
    assert slopes["b"] == 0


def test_an_angle_of_zero_compared_with_steps() -> None:
    """atan2(0, √x) <= floor(2·y) is y >= 0."""
    condition = teg.atan2(y - y, teg.sqrt(teg.maximum(x, 0))) <= teg.floor(2 * y)
    f = teg.compile(teg.integral(teg.bracket(condition) * y, (x, 0, 2), (y, -1, a)))
    value, slopes = f.value_and_grad(a=0.4)
    assert value == pytest.approx(0.16, rel=1e-14)
    assert slopes["a"] == pytest.approx(0.8, rel=1e-14)


OVER_A_PARAMETER: dict[str, tuple[teg.Expr, Callable[[Number, Number], Number]]] = {
    "a pole": (teg.tanh(1 / (y - t) / a), lambda u, q: mpmath.tanh(1 / (u * q))),
    "a square": (teg.exp(-1 / (y - t) ** 2 / a), lambda u, q: mpmath.exp(-1 / (u * u * q))),
    "a factor of both": (teg.atan((y - t) / (y - t) ** 2 / a), lambda u, q: mpmath.atan(1 / (u * q))),
}
"""Functions of a pole that is divided by a parameter a = q, and what they are in u = y - t."""


@pytest.mark.parametrize("name", OVER_A_PARAMETER)
def test_a_pole_that_is_divided_by_a_parameter(name: str) -> None:
    e, function = OVER_A_PARAMETER[name]
    value, slopes = teg.compile(teg.integral(e, (y, 0, 1)), [t, a]).value_and_grad(t=0.3, a=1.2)

    def integral(p: Number, q: Number) -> Number:
        return mpmath.quad(lambda u: function(u, q), [-p, 0, 1 - p])

    p, q = mpmath.mpf("0.3"), mpmath.mpf("1.2")
    assert value == pytest.approx(float(integral(p, q)), rel=1e-9)
    assert slopes["t"] == pytest.approx(float(function(-p, q) - function(1 - p, q)), rel=1e-9)
    assert slopes["a"] == pytest.approx(float(mpmath.diff(lambda r: integral(p, r), q)), rel=1e-6)


@pytest.mark.parametrize("factor", [1, -2])
def test_an_angle_is_not_less_than_itself(factor: int) -> None:
    """atan2(sin x, cos x) is x between -π and π."""
    angle = teg.atan2(teg.sin(x), teg.cos(x))
    conditions = factor * angle < factor * x, factor * x < factor * angle, factor * angle <= factor * x, factor * x <= factor * angle
    values = [teg.evaluate(teg.integral(teg.bracket(c), (x, -1, 2))) for c in conditions]
    assert values == [0.0, 0.0, 3.0, 3.0]


@pytest.mark.parametrize("factor", [1, -2])
def test_a_direction_is_not_less_than_itself(factor: int) -> None:
    """The angle to a point of a ray is that of the ray, all along it."""
    angle = teg.atan2(x * teg.sin(t), x * teg.cos(t))
    conditions = factor * angle < factor * t, factor * t < factor * angle, factor * angle <= factor * t, factor * t <= factor * angle
    for at in (0.5, -1.2):
        values = [teg.evaluate(teg.integral(teg.bracket(c), (x, 0, 1)), t=at) for c in conditions]
        assert values == [0.0, 0.0, 1.0, 1.0]


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_an_angle_compared_with_what_it_is_the_angle_of(backend: str) -> None:
    """atan2(sin u, cos u) < u holds where u > π: it is no tie where both are equal. The gradient was ½ where it is 0, -½ where it is -1."""
    u = x - a
    wrapped = teg.atan2(teg.sin(u), teg.cos(u))
    f = teg.compile(teg.integral(teg.bracket(wrapped < u) * teg.bracket(2 * wrapped + b < 2 * u + b + 1), (x, 0, 7)), [a], backend=backend)
    for at in (0.2, 1.7, -3.0):
        value, gradient = f.value_and_grad(a=at, b=0.3)
        assert value == pytest.approx(7 - (at + math.pi), rel=1e-14)
        assert gradient["a"] == -1.0
    assert f.grad(a=4.0, b=0.3)["a"] == 0.0
