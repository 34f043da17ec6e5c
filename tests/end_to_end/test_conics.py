"""Conics whose six coefficients are parameters, through every degenerate form: against slices in 60 digits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import combinations_with_replacement, pairwise
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf

import teg

x, y = teg.vars("x y")
COEFFICIENTS = teg.params("cxx cxy cyy cx cy c1")
NAMES = [p.name for p in COEFFICIENTS]
CONIC = sum((c * m for c, m in zip(COEFFICIENTS, (x * x, x * y, y * y, x, y, 1 + 0 * x), strict=True)), 0 * x)
SQUARE = ((x, -1, 1), (y, -1, 1))
Slices = tuple[Any, list[Any]]


@cache
def conic(backend: str = "c") -> teg.Evaluator:
    """∫∫ [q < 0]·(1 + x/2) over the square."""
    return teg.compile(teg.integral(teg.bracket(CONIC < 0) * (1 + 0.5 * x), *SQUARE), list(COEFFICIENTS), backend=backend)


# -- slices --------------------------------------------------------------------------------------------------------------

DIGITS = 60
"""The nodes come as near as 1e-37 to where a slice's slope is 0."""
STEPS = 12
"""Nodes a unit of the rule's own coordinate; beside a critical value the slices change within a part of 1e-16, which takes more."""


@cache
def _nodes(steps: int) -> list[tuple[Any, Any]]:
    """Those of the double exponential rule on (0, 1), with weights (Takahasi and Mori 1974): singular ends do not matter."""
    with mp.workdps(DIGITS):
        found = []
        for k in range(-4 * steps, 4 * steps + 1):
            s = mp.pi * mp.sinh(mpf(k) / steps)
            u = 1 / (1 + mp.exp(-s))
            found.append((u, mp.pi * mp.cosh(mpf(k) / steps) * u / (1 + mp.exp(s)) / steps))
        return found


def _roots(a: Any, b: Any, c: Any) -> list[Any]:
    """The real roots of av² + bv + c, ascending."""
    square = b * b - 4 * a * c
    if a == 0 or square < 0:
        return [-c / b] if a == 0 and b != 0 else []
    q = -(b + (mp.sign(b) or 1) * mp.sqrt(square)) / 2
    return sorted([q / a, c / q if q else q / a])


def slices(coefficients: Sequence[Any], steps: int = STEPS) -> Slices:
    """The value and its gradient: slices in closed form, between every y where they change, or nearly do."""
    with mp.workdps(DIGITS):
        cxx, cxy, cyy, cx, cy, c1 = map(mpf, coefficients)
        breaks = {mpf(-1), mpf(1)}
        discriminant = (cxy**2 - 4 * cxx * cyy, 2 * cxy * cx - 4 * cxx * cy, cx**2 - 4 * cxx * c1)
        for a, b, c in ((cyy, cy - cxy, cxx - cx + c1), (cyy, cy + cxy, cxx + cx + c1), discriminant):
            breaks |= {v for v in (*_roots(a, b, c), *([-b / (2 * a)] if a else [])) if abs(v) < 1}
        value, gradient = mpf(0), [mpf(0)] * 6
        for low, high in pairwise(sorted(breaks)):
            for u, weight in _nodes(steps):
                v, w = low + (high - low) * u, weight * (high - low)
                b, c = cxy * v + cx, (cyy * v + cy) * v + c1
                roots = [r for r in _roots(cxx, b, c) if abs(r) < 1]
                for p, q in pairwise([mpf(-1), *roots, mpf(1)]):
                    m = (p + q) / 2
                    if (cxx * m + b) * m + c < 0:
                        value += w * (q - p) * (1 + m / 2)
                for r in roots:
                    slope = abs(2 * cxx * r + b)
                    gradient = _with_flux(gradient, r, v, w / slope if slope else mp.inf)
        for v in _horizontal_lines(cxx, cxy, cyy, cx, cy, c1):
            for low, high in pairwise(sorted({mpf(-1), mpf(1), *(r for r in _roots(mpf(0), cxy, 2 * cyy * v + cy) if abs(r) < 1)})):
                for u, weight in _nodes(steps):
                    h = low + (high - low) * u
                    slope = abs(cxy * h + 2 * cyy * v + cy)
                    gradient = _with_flux(gradient, h, v, weight * (high - low) / slope if slope else mp.inf)
        return value, gradient


def _with_flux(gradient: list[Any], u: Any, v: Any, weight: Any) -> list[Any]:
    """Less what a point of the curve gives."""
    return [g - weight * (1 + u / 2) * m for g, m in zip(gradient, (u * u, u * v, v * v, u, v, 1), strict=True)]


def _horizontal_lines(cxx: Any, cxy: Any, cyy: Any, cx: Any, cy: Any, c1: Any) -> list[Any]:
    """Where q = (y - v)·ℓ(x, y): lines that are in no slice."""
    if cxx != 0:
        return []
    candidates = _roots(cyy, cy, c1) if cyy or cy or c1 else _roots(mpf(0), cxy, cx)
    return sorted({v for v in candidates if abs(v) < 1 and abs(cxy * v + cx) < 1e-14})


def beside(coefficients: Sequence[float], component: int, by: float) -> list[Any]:
    """The coefficients with one of them moved, exactly."""
    with mp.workdps(DIGITS):
        return [mpf(c) + (mpf(by) if i == component else 0) for i, c in enumerate(coefficients)]


def test_slices_of_a_disk() -> None:
    """π·t, and its gradient by moments: ∮x²/|∇q| and so on."""
    value, gradient = slices((1.0, 0.0, 1.0, 0.0, 0.0, -0.5))
    exact = [-math.pi / 4, 0.0, -math.pi / 4, -math.pi / 8, 0.0, -math.pi]
    assert float(value) == pytest.approx(math.pi / 2, rel=1e-15)
    assert [float(g) for g in gradient] == pytest.approx(exact, rel=1e-15, abs=1e-15)


# -- at random -----------------------------------------------------------------------------------------------------------


def is_right(coefficients: Sequence[float]) -> None:
    """Value and gradient are those of slices. Where there is no gradient it is diagnosed: the mean of both sides, or infinite or NaN where
    sides are without bounds, in this coefficient or another."""
    f, at = conic(), dict(zip(NAMES, coefficients, strict=True))
    value, gradient = f.value_and_grad(at)
    exact_value, exact = slices(coefficients)
    assert value == pytest.approx(float(exact_value), abs=1e-9)
    scale = 1 + max(abs(float(e)) for e in exact)
    if all(abs(gradient[k] - float(e)) <= 1e-8 * scale < math.inf for k, e in zip(NAMES, exact, strict=True)):
        return
    assert f.diagnose(at)
    if not all(math.isfinite(gradient[k]) for k in NAMES):
        assert any(_is_endless(coefficients, i) for i in range(6))  # with the logarithm of the distance, or faster
    for i, (k, e) in enumerate(zip(NAMES, exact, strict=True)):
        if math.isfinite(gradient[k]) and not abs(gradient[k] - float(e)) <= 1e-8 * (1 + abs(float(e))):
            near = _sides(coefficients, i, 1e-8)  # not above: the slices of a neighbour may touch a corner, where they know nothing
            assert gradient[k] == pytest.approx(sum(near) / 2, abs=1e-3 * (1 + max(map(abs, near))))  # √h where it touches a side


def _is_endless(coefficients: Sequence[float], i: int) -> bool:
    """Whether the derivative by one coefficient grows towards this place, on either side."""
    near, far = (_sides(coefficients, i, h) for h in (1e-8, 1e-4))
    return any(abs(v) > 1.2 * abs(u) and abs(v) > 1 for v, u in zip(near, far, strict=True))


def _sides(coefficients: Sequence[float], i: int, h: float) -> list[float]:
    """The derivative by one coefficient, that being less and more by h."""
    return [float(slices(beside(coefficients, i, s * h), 3 * STEPS)[1][i]) for s in (-1, 1)]


AS_IT_IS = pytest.mark.filterwarnings("ignore::teg.evaluator.accuracy.AccuracyWarning")
"""A warning about accuracy, at critical values or beside them, excuses nothing."""

_number = st.sampled_from([0.0, 0.0, 1.0, -1.0, 0.5, -0.25, 2.0]) | st.floats(-2, 2).map(lambda v: round(v, 3))
_conics = st.tuples(*[_number] * 6).filter(lambda c: any(abs(v) > 0.1 for v in c[:5]))


@AS_IT_IS
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(_conics)
@example((0.5, 0.0, -1.0, 1.0, 0.0, 0.5))  # two lines that cross on a side of the box
def test_conics_at_random(coefficients: tuple[float, ...]) -> None:
    is_right(coefficients)


@AS_IT_IS
@pytest.mark.slow
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(_conics)
def test_more_conics_at_random(coefficients: tuple[float, ...]) -> None:
    is_right(coefficients)


NOT_DIFFERENTIABLE = {
    "born in the square": (1.0, 0.0, 1.0, 0.0, 0.0, 0.0),
    "an ellipse born in the square": (1.0, 0.5, 2.0, -0.5, 0.25, 5 / 62),
    "a saddle": (1.0, 0.0, -1.0, 0.0, 0.0, 0.0),
    "two lines, y = 0 and x = -y": (0.0, 1.0, 1.0, 0.0, 0.0, 0.0),
    "two lines, one horizontal": (0.0, -1.5, -0.5, 0.0, 0.25, 0.0),
    "along a side": (0.0, 0.0, 0.0, 1.0, 0.0, -1.0),
    "along two sides": (0.0, 0.0, 1.0, 0.0, 0.0, -1.0),
    "a double line": (0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
}


QUICK = ("an ellipse born in the square", "a saddle", "along a side")


@pytest.mark.slow
@AS_IT_IS
@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n in QUICK else pytest.mark.slow) for n in NOT_DIFFERENTIABLE])
def test_conics_without_a_gradient(name: str) -> None:
    coefficients = NOT_DIFFERENTIABLE[name]
    assert conic().diagnose(dict(zip(NAMES, coefficients, strict=True)))
    is_right(coefficients)


@pytest.mark.parametrize("coefficients", [(0.0, 1.0, 0.0, -0.3, -2.0, 0.6), (0.0, 0.0, 1.0, 0.0, -2.3, 0.6)], ids=str)
def test_a_horizontal_line(coefficients: tuple[float, ...]) -> None:
    """(x - 2)(y - 0.3) and (y - 2)(y - 0.3)."""
    is_right(coefficients)


# -- by type -------------------------------------------------------------------------------------------------------------

TYPES = {
    "circle": (1.0, 0.0, 1.0, 0.0, 0.0, -0.5),
    "ellipse": (1.0, 0.0, 2.0, -0.2, 0.3, -0.4),
    "rotated": (1.0, 0.7, 1.3, 0.1, -0.2, -0.4),
    "parabola": (1.0, 0.0, 0.0, 0.0, -1.0, 0.1),
    "rotated-parabola": (1.0, 2.0, 1.0, 0.0, -1.0, 0.1),
    "hyperbola": (1.0, 0.0, -1.0, 0.0, 0.0, 0.2),
    "bilinear": (0.0, 1.0, 0.0, 0.2, 0.0, 0.1),
    "line": (0.0, 0.0, 0.0, 1.0, 0.5, 0.1),
    "nearly-a-parabola": (1.0, 1e-9, 1e-12, 0.0, -1.0, 0.1),
}


@pytest.mark.parametrize("name", TYPES)
def test_value_and_gradient(name: str) -> None:
    at = dict(zip(NAMES, TYPES[name], strict=True))
    exact_value, exact = slices(TYPES[name])
    value, gradient = conic().value_and_grad(at)
    assert value == pytest.approx(float(exact_value), rel=1e-12)
    assert [gradient[k] for k in NAMES] == pytest.approx([float(e) for e in exact], rel=1e-11, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n == "rotated" else pytest.mark.slow) for n in TYPES])
def test_second_derivatives(name: str) -> None:
    """Against differences of the slices' gradients, of sixth order."""
    h = 2e-3
    hessian = conic("numpy").hessian(dict(zip(NAMES, TYPES[name], strict=True)))
    for i, of in enumerate(NAMES):
        at = {s: slices(beside(TYPES[name], i, s * h))[1] for s in (-3, -2, -1, 1, 2, 3)}
        for j, by in enumerate(NAMES):
            quotient = float((45 * (at[1][j] - at[-1][j]) - 9 * (at[2][j] - at[-2][j]) + (at[3][j] - at[-3][j])) / (60 * h))
            assert hessian[of, by] == pytest.approx(quotient, rel=1e-8, abs=1e-9)
            assert hessian[of, by] == pytest.approx(hessian[by, of], rel=1e-9, abs=1e-10)


# -- lines that are written as squares -------------------------------------------------------------------------------------

a, b, t, e = teg.params("a b t e")
BACKENDS = ["c", "numpy", pytest.param("jax", marks=pytest.mark.slow)]


@pytest.mark.usefixtures("x64_for_jax")
@pytest.mark.parametrize("intrinsics", [True, False])
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_strip_by_the_distance_from_its_foot(backend: str, intrinsics: bool) -> None:
    """Two squares of affine functions that are parallel whatever a and b are: no ellipse, and no critical point."""
    u, v = x + 0.2, y + 0.4
    along = (u * a + v * b) / (a * a + b * b)
    strip = (along > 0) & (along < 1) & ((u - along * a) ** 2 + (v - along * b) ** 2 < t * t)
    f = teg.compile(teg.integral(teg.bracket(strip), *SQUARE), [t, a, b], backend=backend, intrinsics=intrinsics)
    value, gradient = f.value_and_grad(t=0.3, a=0.15, b=0.62)
    length = math.hypot(0.15, 0.62)
    assert value == pytest.approx(0.6 * length, rel=1e-12)
    assert gradient == pytest.approx({"t": 2 * length, "a": 0.6 * 0.15 / length, "b": 0.6 * 0.62 / length}, rel=1e-11)


def test_a_strip_across_the_square() -> None:
    """Its area depends on its direction where it meets the sides: the same with the closed forms of ellipses and without."""
    u, v = x + 0.2, y + 0.4
    along = (u * a + v * b) / (a * a + b * b)
    strip = teg.integral(teg.bracket((u - along * a) ** 2 + (v - along * b) ** 2 < t * t), *SQUARE)
    closed, plain = (teg.compile(strip, [t, a, b], backend="numpy", intrinsics=on) for on in (True, False))
    at = {"t": 0.3, "a": 0.15, "b": 0.62}
    assert closed(at) == pytest.approx(0.6 * math.hypot(0.15, 0.62) / 0.62 * 2, rel=1e-12)  # a parallelogram between y = -1 and y = 1
    assert closed.value_and_grad(at)[1] == pytest.approx(plain.grad(at), rel=1e-11)


@pytest.mark.usefixtures("x64_for_jax")
@pytest.mark.parametrize("backend", BACKENDS)
def test_squares_that_are_nearly_parallel(backend: str) -> None:
    """An ellipse so long that its place has few digits: the estimate knows it."""
    p, q = x + 0.7 * y, x + (0.7 + e) * y - 0.3 * e
    f = teg.compile(teg.integral(teg.bracket(p**2 + q**2 < t**2) * (1 + 0.5 * x), *SQUARE), [t, e], backend=backend)
    for near in (1e-5, 1e-7, 1e-9, 1e-11, 1e-14):
        with mp.workdps(DIGITS):
            rows = [[mpf(c) for c in row] for row in ((1.0, 0.7, 0.0), (1.0, 0.7 + near, -0.3 * near))]
            xx, xy, x1, yy, y1, one = (sum(r[i] * r[j] for r in rows) for i, j in combinations_with_replacement(range(3), 2))
            exact, _ = slices((xx, 2 * xy, yy, 2 * x1, 2 * y1, one - mpf(0.4) ** 2))
        value, error = f.value_and_error(t=0.4, e=near)
        assert value == pytest.approx(float(exact), abs=10 * error + 1e-12)
        assert error < 1e-12 / near + 1e-10


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("slopes", [(-0.55, -0.6), (0.3, 0.7), (0.75, 0.5)])
def test_a_parabola_by_the_square_of_a_slanted_line(slopes: tuple[float, float], backend: str) -> None:
    """It has no critical point, though the determinant of numbers such as 0.55 and 0.6 is 0 to rounding only."""
    m, n = slopes
    body = teg.bracket((m * x + n * y) ** 2 - 0.27 * x + 0.54 * y - t < 0) * (1 + 0.5 * x)
    value, gradient = teg.compile(teg.integral(body, *SQUARE), [t], backend=backend).value_and_grad(t=0.36)
    with mp.workdps(DIGITS):
        exact, by = slices((mpf(m) ** 2, 2 * mpf(m) * mpf(n), mpf(n) ** 2, mpf(-0.27), mpf(0.54), mpf(-0.36)))
    assert value == pytest.approx(float(exact), rel=1e-12)
    assert gradient["t"] == pytest.approx(-float(by[5]), rel=1e-10)
