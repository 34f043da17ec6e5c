"""Where outer integrals are broken because surfaces turn back or meet: rings, slices of a torus, tiny regions.

References are closed forms in polar coordinates, and one-dimensional integrals by mpmath.
"""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

import teg
from teg.analysis.isolation import locate
from teg.evaluator.accuracy import AccuracyWarning

x, y, z = teg.vars("x y z")
a, b, c = teg.params("a b c")
BACKENDS = ("numpy", "c")


def annulus(offset: float, width: float) -> float:
    """The area of (r² + offset)² < width·r²."""
    root = math.sqrt(width)
    radii = sorted(r.real for s in (root, -root) for r in np.roots([1.0, -s, offset]) if abs(r.imag) < 1e-12 and r.real > 0)
    return math.pi * sum((-1) ** (len(radii) - 1 - i) * r * r for i, r in enumerate(radii))


@pytest.mark.parametrize("backend", BACKENDS)
def test_rings(backend: str) -> None:
    """One surface with two circles: natural bounds alone keep too many rectangles between them."""
    f = teg.compile(
        teg.integral(teg.bracket((x * x + y * y + a) ** 2 < b * (x * x + y * y)), (x, -2, 2), (y, -2, 2)), [a, b], backend=backend
    )
    rng = np.random.default_rng(3)
    offset, width = rng.uniform(-0.5, 0.12, 20), rng.uniform(0.55, 1.0, 20)
    offset[0], width[0] = 0.2138, 1.0
    step = 1e-6
    value, gradient = f.value_and_grad(a=offset, b=width)
    for i, (p, q) in enumerate(zip(offset, width, strict=True)):
        assert value[i] == pytest.approx(annulus(p, q), rel=1e-9)
        assert gradient["a"][i] == pytest.approx((annulus(p + step, q) - annulus(p - step, q)) / (2 * step), rel=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_slices_of_a_torus(backend: str) -> None:
    """Where the slice is one piece, two, or a figure like an eight; half of them were 0 without a warning."""
    torus = (x * x + y * y + c * c + a * a - b * b) ** 2 < 4 * a * a * (x * x + c * c)
    f = teg.compile(teg.integral(teg.bracket(torus), (x, -3, 3), (y, -2, 2)), [a, b, c], backend=backend)
    for major, minor, away in ((1.2246, 0.1204, 0.5154), (1.2796, 0.1938, 0.4628), (0.9, 0.5, 0.39), (1.1, 0.6, 1.2)):
        ends = [math.sqrt(r * r - away * away) for r in (major - minor, major + minor) if r > away]
        ends = [0.0, *ends] if len(ends) == 1 else ends
        half = mpmath.quad(lambda s: mpmath.sqrt(abs(minor**2 - (mpmath.sqrt(s * s + away**2) - major) ** 2)), ends)  # noqa: B023
        assert f(major, minor, away) == pytest.approx(4 * float(half), rel=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("radius", [1e-3, 1e-5, 1e-7])
def test_the_flux_of_a_tiny_region(backend: str, radius: float) -> None:
    """The derivative by the squared radius does not shrink with the region."""
    squared = (x - b) ** 2 + 2 * (y - c) ** 2
    f = teg.compile(teg.integral(teg.bracket(squared + squared**2 < a), (x, -1, 1), (y, -1, 1)), [a, b, c], backend=backend)
    area = radius**2
    exact = math.pi / math.sqrt(2) / math.sqrt(1 + 4 * area)
    assert f.grad(area, 0.3712, -0.2345)["a"] == pytest.approx(exact, rel=1e-6)


def test_inside_another_integral() -> None:
    """A torus whose slices are closed curves without a formula: they are looked for at every node of the outer integral."""
    torus = (x * x + y * y + z * z + a * a - b * b) ** 2 < 4 * a * a * (z * z + y * y)
    f = teg.compile(teg.integral(teg.bracket(torus), (x, -1.5, 1.5), (y, -1.5, 1.5), (z, -1.5, 1.5)), [a, b], backend="c")
    assert f(0.7, 0.3) == pytest.approx(2 * math.pi**2 * 0.7 * 0.09, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_given_up_is_said(backend: str) -> None:
    """A row of islands: they begin and end at twenty places, for which there is no room."""
    f = teg.compile(teg.integral(teg.bracket(y**4 + y**2 + teg.cos(30 * x) < a), (y, -1, 1), (x, 0, 2)), [a], backend=backend)
    with pytest.warns(AccuracyWarning, match="misses the tolerance"):
        f(-0.5)
    value, error = f.value_and_error(-0.5)
    at, weights = np.polynomial.legendre.leggauss(60)
    exact = 0.0
    for k in range(10):
        middle, half = (2 * k + 1) * math.pi / 30, math.acos(0.5) / 30
        for end in (middle - half, min(middle + half, 2.0)) if middle + half < 2.0 else (middle - half,):
            u = 0.5 * (at + 1)
            height = -0.5 - np.cos(30 * (end + (middle - end) * u * u))
            roots = 2 * np.sqrt(0.5 * (np.sqrt(1 + 4 * np.clip(height, 0, None)) - 1))
            exact += float(np.sum(weights * roots * u) * abs(middle - end))
    assert error > 1e-3
    assert abs(value - exact) < error


def test_the_shorter_sum_of_two_surfaces_is_located() -> None:
    small = teg.exp(-100 * x)
    found = locate(y + y**5 - small, y + y**5 + small, y, teg.ir.expr.const(-2.0), teg.ir.expr.const(2.0), x)
    assert found is not None
    assert {str(found.f), str(found.g)} == {"2·y + 2·y⁵", "-2·exp(-100·x)"}


def test_roots_are_searched_for_once() -> None:
    """Value and gradient need the same roots; the second search runs where the first one does not."""
    x, t = teg.var("x"), teg.param("t")
    f = teg.compile(teg.integral(teg.bracket(x * teg.exp(-x) < t), (x, 0, 8)))
    searches = [s for s in f.program(1).body if type(s).__name__ == "Isolate"]
    made = {s.name: s for s in f.program(1).body if type(s).__name__ == "Assign"}
    first, second = searches
    again = made[second.when]
    assert again.op == "and"
    assert made[again.args[0]].op == "not"
    assert made[again.args[0]].args == (first.when,)
    roots = [float(-mpmath.lambertw(-0.2, k).real) for k in (0, -1)]
    assert f(t=0.2) == pytest.approx(8 - roots[1] + roots[0], abs=1e-12)
    assert f.grad(t=0.2)["t"] == pytest.approx(sum(1 / abs((1 - r) * math.exp(-r)) for r in roots), abs=1e-12)
    assert (f(t=-0.1), f.grad(t=-0.1)["t"], f(t=0.5), f.grad(t=0.5)["t"]) == (0.0, 0.0, 8.0, 0.0)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("turned", [False, True])
def test_the_cut_of_an_angle_has_no_mass(backend: str, turned: bool) -> None:
    """Above the ray at the angle π - asin b: the box left of the origin has the cut in its middle, where sin θ does not jump."""
    box = ((x, -1, -0.2), (y, -0.5, 0.5))
    f = teg.compile(teg.integral(teg.bracket(teg.sin(teg.atan2(y, x)) > b), *(box[::-1] if turned else box)), [b], backend=backend)
    assert f.grad(b=0.3)["b"] == pytest.approx(-0.5 * (1 - 0.2**2) * (1 - 0.3**2) ** -1.5, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_flower(backend: str) -> None:
    """The area of r < 1 + b·sin(3θ + a) is π(1 + ½b²)."""
    radius = 1 + b * teg.sin(3 * teg.atan2(y, x) + a)
    f = teg.compile(teg.integral(teg.bracket(teg.sqrt(x * x + y * y) < radius), (x, -1.5, 1.5), (y, -1.5, 1.5)), [a, b], backend=backend)
    got = f.grad(a=0.2, b=0.1)
    assert (got["a"], got["b"]) == pytest.approx((0.0, math.pi * 0.1), abs=1e-9)
