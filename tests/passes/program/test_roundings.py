"""Estimates hold the roundings of numbers that cancel before an intrinsic uses them, and stay small where nothing cancels."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from fractions import Fraction

import mpmath
import numpy as np
import pytest

import teg

x, y = teg.vars("x y")
a, b, c, d, q, k, m, t = teg.params("a b c d q k m t")
BACKENDS = ("numpy", "c")
PIXEL = ((x, k, k + 1), (y, m, m + 1))
SHIFTS = (0.0, 4096.0, 65536.0, 2.0**22, 2.0**30)
Point = tuple[Fraction, Fraction]


def clipped(lines: Sequence[tuple[float, float, float]], corner: float) -> list[Point]:
    """Returns the corners of a pixel in half-planes, exactly."""
    o = Fraction(corner)
    corners: list[Point] = [(o, o), (o + 1, o), (o + 1, o + 1), (o, o + 1)]
    for line in lines:
        u, v, w = map(Fraction, line)
        kept: list[Point] = []
        for p, r in zip(corners, corners[1:] + corners[:1], strict=True):
            at, after = u * p[0] + v * p[1] + w, u * r[0] + v * r[1] + w
            if at >= 0:
                kept.append(p)
            if (at > 0) != (after > 0) and at != after:
                s = at / (at - after)
                kept.append((p[0] + s * (r[0] - p[0]), p[1] + s * (r[1] - p[1])))
        corners = kept
    return corners


def integral_over(corners: Sequence[Point], f: Callable[[Fraction, Fraction], Fraction]) -> Fraction:
    """Returns the integral of a polynomial of degree 2, by the middles of the sides of triangles."""
    total = Fraction(0)
    for p, r in itertools.pairwise(corners[1:]):
        o = corners[0]
        twice = (p[0] - o[0]) * (r[1] - o[1]) - (p[1] - o[1]) * (r[0] - o[0])
        middles = [((u[0] + v[0]) / 2, (u[1] + v[1]) / 2) for u, v in ((o, p), (p, r), (r, o))]
        total += twice / 6 * sum((f(*at) for at in middles), Fraction(0))
    return total


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("shift", SHIFTS)
def test_an_offset_and_a_colour_that_cancel_far_from_the_origin(shift: float, backend: str) -> None:
    residual = (t - (q + 0.25 * x + 0.5 * y)) ** 2
    f = teg.compile(teg.integral(teg.bracket((a * x + b * y + c > 0) & (y - x > d)) * residual, *PIXEL), backend=backend)
    rng = np.random.default_rng(3)
    for _ in range(10):
        (u, v), (px, py) = rng.normal(size=2), rng.uniform(0.2, 0.8, 2) + shift
        at = {"a": u, "b": v, "c": -(u * px + v * py), "d": rng.uniform(-0.5, 0.5), "q": 0.3 - 0.75 * shift, "t": 2.0}
        value, estimate = f.value_and_error({**at, "k": shift, "m": shift})
        base, wanted = Fraction(at["q"]), Fraction(at["t"])
        domain = clipped([(u, v, at["c"]), (-1.0, 1.0, -at["d"])], shift)
        exact = integral_over(domain, lambda p, r, base=base, wanted=wanted: (wanted - (base + p / 4 + r / 2)) ** 2)
        assert abs(Fraction(float(value)) - exact) <= estimate <= 1e-14 * max(shift, 10.0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_hyperbola_whose_corners_cancel(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(x * y > t), *PIXEL), backend=backend)
    for corner in (0.3, 1000.1, 1e6 + 0.1, 1e8 + 0.1):
        place = {"k": corner, "m": corner, "t": (corner + 0.5) * (corner + 0.4)}
        value, estimate = f.value_and_error(place)
        with mpmath.workdps(40):
            o, level = mpmath.mpf(corner), mpmath.mpf(place["t"])
            ends = sorted({o, o + 1, *(p for p in (level / o, level / (o + 1)) if o < p < o + 1)})
            exact = mpmath.quad(lambda s, o=o, level=level: max(0, min(1, o + 1 - level / s)), ends)
            assert abs(exact - value) <= estimate <= 1e-14 * max(corner, 1.0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_ties_are_no_roundings(backend: str) -> None:
    """A pixel cut along its sides, and in its corners: estimates stay a few roundings."""
    f = teg.compile(teg.integral(teg.bracket((x > a) & (x + y < b)), (x, 0, 1), (y, 0, 1)), backend=backend)
    for at, by_a, by_b in (((0.0, 1.0), -0.5, 1.0), ((0.0, 2.0), -0.5, 0.0), ((0.5, 1.5), -1.0, 0.5)):
        gradient, estimates = f.grad_and_error(a=at[0], b=at[1])
        assert abs(gradient["a"] - by_a) <= 1e-15
        assert abs(gradient["b"] - by_b) <= 1e-15
        assert max(estimates.values()) <= 1e-13
