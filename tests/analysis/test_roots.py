"""Roots of surfaces in one variable."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import teg
from teg.analysis.roots import Roots, discriminant, local_origin, quadratic_coefficients, solve
from teg.ir.expr import ONE, ZERO, const

x, y = teg.vars("x y")
a, b, c, t = teg.params("a b c t")


def points(roots: Roots | None, **values: float) -> list[float]:
    assert roots is not None
    return sorted(float(teg.evaluate(p, values)) for p in (r.point for r in roots.found))


def existing(roots: Roots | None, **values: float) -> list[float]:
    assert roots is not None
    places = (teg.evaluate(teg.where(r.exists, r.point, math.inf), values) for r in roots.found)
    return sorted(float(p) for p in places if math.isfinite(p))


def test_no_root_where_the_variable_does_not_occur() -> None:
    assert solve(t - a, x, ZERO, ONE) == Roots(())


def test_affine() -> None:
    assert points(solve(a * x + b, x, ZERO, ONE), a=2.0, b=-3.0) == [1.5]


def test_an_affine_root_is_taken_from_the_local_origin() -> None:
    corner = 2.0**26
    g = (x - (corner + 0.25)) * 3.0
    assert points(solve(g, x, teg.ir.expr.const(corner), teg.ir.expr.const(corner + 1))) == [corner + 0.25]


def test_the_local_origin_is_near_0_where_a_bound_may_be_far_away() -> None:
    far, wide, endless = const(1e10), const(-1e10), const(math.inf)
    assert local_origin(wide, far) is local_origin(ONE, wide) is local_origin(wide, ONE) is ZERO
    assert local_origin(ONE, far) is local_origin(far, ONE) is ONE
    assert local_origin(t, ONE) is local_origin(ONE, t) is ONE
    assert local_origin(t, far) is local_origin(t, a) is local_origin(t, endless) is t
    assert local_origin(endless, endless) is ZERO


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ((1.0, -3.0, 2.0), [1.0, 2.0]),
        ((1.0, 3.0, 2.0), [-2.0, -1.0]),
        ((2.0, 0.0, -2.0), [-1.0, 1.0]),
        ((1.0, -1e8, 1.0), [1e-8, 1e8]),
        ((-1.0, 0.5, 0.5), [-0.5, 1.0]),
    ],
)
def test_quadratic_roots_do_not_cancel(coefficients: tuple[float, float, float], expected: list[float]) -> None:
    found = points(solve(a * x**2 + b * x + c, x, ZERO, ONE), **dict(zip("abc", coefficients, strict=True)))
    assert found == pytest.approx(expected, rel=4e-16)


def test_a_vanishing_leading_coefficient_leaves_the_other_root() -> None:
    roots = solve(a * x**2 + b * x + c, x, ZERO, ONE)
    assert roots is not None
    found = [float(teg.evaluate(p, {"a": 0.0, "b": 2.0, "c": -1.0})) for p in (r.point for r in roots.found)]
    assert 0.5 in found
    assert not all(math.isfinite(v) for v in found)


def test_the_discriminant_of_a_shifted_square_is_no_difference_of_squares() -> None:
    found = points(solve(t - (x - c) ** 2, x, ZERO, ONE), t=1e-6, c=1e5)
    assert found == pytest.approx([1e5 - 1e-3, 1e5 + 1e-3], rel=1e-16)


def test_a_discriminant_without_a_linear_term_stays_a_product() -> None:
    """Its factors tell where it is 0: multiplied out, sin² and cos² had double zeros that were found to rounding only."""
    g = 4 * t * teg.sin(y) ** 2 * teg.cos(y) ** 2 - (1 + y) ** 2 * x**2
    assert str(discriminant(*quadratic_coefficients(g, x))) == "16·(y + 1)²·cos(y)²·sin(y)²·t"


def test_coefficients() -> None:
    found = quadratic_coefficients(a * x**2 + (b + y) * x - c, x)
    assert [str(e) for e in found] == ["a", "b + y", "-c"]


@pytest.mark.parametrize("g", [x * teg.sin(x) - t, x**5 + x - t, x * teg.exp(x) - t], ids=str)
def test_no_formula(g: teg.Expr) -> None:
    assert solve(g, x, ZERO, ONE) is None


@pytest.mark.usefixtures("x64_for_jax")
@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("lo", "exponent", "at", "area", "slope"),
    [
        (0.0, 1.5, 0.3, 0.3 ** (2 / 3), 0.3 ** (-1 / 3) / 1.5),
        (0.0, 1.5, 1e-300, 1e-200, 1e100 / 1.5),
        (0.0, 1.5, 0.0, 0.0, math.inf),
        (-1.0, 2.0, 0.3, 2 * math.sqrt(0.3), 1 / math.sqrt(0.3)),
        (-1.0, 3.0, 0.3, 1 + 0.3 ** (1 / 3), 0.3 ** (-2 / 3) / 3),
        (-1.0, 3.0, -0.3, 1 - 0.3 ** (1 / 3), 0.3 ** (-2 / 3) / 3),
        (0.25, -1.5, 2.0, 1 - 2.0 ** (-2 / 3), 2.0 ** (-5 / 3) / 1.5),
        (0.25, 0.0, 0.3, 0.0, 0.0),
    ],
)
def test_a_power_whose_exponent_is_a_parameter(lo: float, exponent: float, at: float, area: float, slope: float, backend: str) -> None:
    """The derivative at t = 0 and near it was 0, and [x³ < -0.3] had the area 0: bounds took no power for negative."""
    x, t, p = teg.var("x"), teg.param("t"), teg.param("p")
    f = teg.compile(teg.integral(teg.bracket(x**p < t), (x, lo, 1)), [t], backend=backend)
    value, gradient = f.value_and_grad(t=at, p=exponent)
    assert value == pytest.approx(area, rel=1e-12, abs=1e-300)
    assert gradient["t"] == pytest.approx(slope, rel=1e-12)


@pytest.mark.parametrize("u", [0.0, 0.3, -0.3])
def test_a_root_without_weight_is_found_once(u: float) -> None:
    """The line x = 0.2 is twice in the square of u·√(x² + 0.1) = x - 0.2 where u is 0."""
    known = solve(t * teg.sqrt(x**2 + 0.1) - (x - 0.2), x, const(-1.0), const(1.0))
    expected = (0.2 + u * math.sqrt(0.14 - 0.1 * u * u)) / (1 - u * u)
    assert existing(known, t=u) == pytest.approx([expected], abs=1e-14)


@pytest.mark.parametrize("u", [0.0, 0.3, -0.3])
def test_places_of_two_levels_are_found_once(u: float) -> None:
    """u·√(z + 1) = z - 2 with z = exp(x²) has one solution z, with two places each."""
    z = teg.exp(x**2)
    known = solve(t * teg.sqrt(z + 1) - (z - 2), x, const(-2.0), const(2.0))
    level = 2.0 + 0.5 * u * u + u * math.sqrt(3.0 + 0.25 * u * u)
    assert existing(known, t=u) == pytest.approx([-math.sqrt(math.log(level)), math.sqrt(math.log(level))])


def width_of_parabola(angle: float, p: float, q: float, level: float) -> float:
    """The length of all u for which the point (u, 3u² + level) of a plane that is turned around (p, q) is in the unit square."""
    cosine, sine = math.cos(angle), math.sin(angle)
    ends = []
    for square, linear, constant in ((-3 * sine, cosine, p - sine * level), (3 * cosine, sine, q + cosine * level)):
        for side in (0.0, 1.0):
            found = np.roots([square, linear, constant - side])
            ends += [r.real for r in found if abs(r.imag) < 1e-12]
    total = 0.0
    for first, last in itertools.pairwise(sorted(ends)):
        u = 0.5 * (first + last)
        v = 3 * u * u + level
        if 0 < p + cosine * u - sine * v < 1 and 0 < q + sine * u + cosine * v < 1:
            total += last - first
    return total


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("seed", range(8))
def test_parabolas_turned_by_a_number(seed: int, backend: str) -> None:
    """The square of y in their discriminant is a rounding: its vertex, 10¹⁵ away, must not be gone to."""
    generator = np.random.default_rng(seed)
    p, q = generator.uniform(0.3, 0.7, 2)
    angle = math.pi / 3 if seed == 0 else float(generator.uniform(0.2, 3.0))
    cosine, sine = math.cos(angle), math.sin(angle)
    u, v = cosine * (x - p) + sine * (y - q), -sine * (x - p) + cosine * (y - q)
    f = teg.compile(teg.integral(teg.bracket(v < 3 * u**2 + t), (x, 0, 1), (y, 0, 1)), [t], backend=backend)
    for level in (-0.2, -0.05, 0.1):
        value, gradient = f.value_and_grad(t=level)
        assert gradient["t"] == pytest.approx(width_of_parabola(angle, p, q, level), abs=1e-9)
        nodes, weights = np.polynomial.legendre.leggauss(8)
        between = [level + 0.05 * (n + 1) / 2 for n in nodes]
        rise = 0.025 * sum(w * width_of_parabola(angle, p, q, at) for w, at in zip(weights, between, strict=True))
        assert f(t=level + 0.05) - value == pytest.approx(rise, abs=1e-4)  # the width has bends where the curve meets a corner
