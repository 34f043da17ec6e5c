"""Solids in a box by slices: values are right, and estimates hold their errors. References: caps and lenses in closed form."""

from __future__ import annotations

import math

import pytest

import teg
from tests.backends.c_checks import in_c

pytestmark = pytest.mark.filterwarnings("ignore::teg.AccuracyWarning")

x, y, z = teg.vars("x y z")
t, d = teg.params("t d")
u, v, w = teg.params("u v w")
CUBE = ((x, 0, 1), (y, 0, 1), (z, 0, 1))
BACKENDS = ("numpy", pytest.param("c", marks=in_c))


@pytest.mark.parametrize("backend", BACKENDS)
def test_caps_of_a_ball(backend: str) -> None:
    """In one of them the cap ends 3e-4 below the pole of the ball, where the error is 4.5e-11."""
    centre, r = (0.50165, 0.38558, 0.43603), 0.22347
    ball = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2 < t
    f = teg.compile(teg.integral(teg.bracket(ball & (u * x + v * y + w * z > d)), *CUBE), [t], backend=backend)
    for slopes, at in (((-0.478, -0.8712), 0.01345), ((0.6, -0.64), -0.1), ((0.28, 0.6), 0.15)):
        across = math.sqrt(1 - sum(s * s for s in slopes))
        normal = (*slopes, across)
        offset = sum(n * c for n, c in zip(normal, centre, strict=True)) + at
        value, estimate = f.value_and_error(t=r * r, d=offset, **dict(zip("uvw", normal, strict=True)))
        assert abs(value - math.pi * (r - at) ** 2 * (2 * r + at) / 3) <= max(estimate, 1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_two_balls(backend: str) -> None:
    first, second, r = (0.4, 0.4, 0.45), (0.6, 0.55, 0.5), 0.3
    balls = [(x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2 < t for a, b, c in (first, second)]
    f = teg.compile(teg.integral(teg.bracket(balls[0] & balls[1]), *CUBE), [t], backend=backend)
    apart = math.dist(first, second)
    value, estimate = f.value_and_error(t=r * r)
    assert abs(value - math.pi * (4 * r + apart) * (2 * r - apart) ** 2 / 12) <= max(estimate, 1e-14)
    slope = math.pi * ((2 * r - apart) ** 2 + (4 * r + apart) * (2 * r - apart)) / (6 * r)
    assert f.grad(t=r * r)["t"] == pytest.approx(slope, rel=1e-10)
