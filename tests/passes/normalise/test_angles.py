"""Waves of an angle, times the radius: regular polygons, stars and petals written with mod and atan2."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import teg
from teg.ir.expr import Call
from teg.ir.node import postorder
from teg.passes.normalise.angles import with_lines_of_angles

x, y = teg.vars("x y")
a, b, c, t = teg.params("a b c t")
BACKENDS = ["c", "numpy", pytest.param("jax", marks=pytest.mark.slow)]
SQUARE = (x, -1, 1), (y, -1, 1)
r, angle = teg.sqrt((x - a) ** 2 + (y - b) ** 2), teg.atan2(y - b, x - a)


def sector(n: int) -> teg.Expr:
    """The angle from the middle of one of n sectors."""
    return teg.mod(angle + c, 2 * math.pi / n) - math.pi / n


def clipped_area(corners: np.ndarray) -> float:
    """Returns the area of a convex polygon in the square, cut side by side."""
    for normal in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        depths = 1 - corners @ normal
        kept = []
        for i, depth in enumerate(depths):
            if depths[i - 1] * depth < 0:
                kept.append(corners[i - 1] + (corners[i] - corners[i - 1]) * depths[i - 1] / (depths[i - 1] - depth))
            if depth >= 0:
                kept.append(corners[i])
        if not kept:
            return 0.0
        corners = np.array(kept)
    nxt = np.roll(corners, -1, axis=0)
    return float(0.5 * np.sum(corners[:, 0] * nxt[:, 1] - corners[:, 1] * nxt[:, 0]))


def polygon_area(n: int, a: float, b: float, c: float, t: float) -> float:
    at = 2 * math.pi * np.arange(n) / n - c
    return clipped_area(np.array([a, b]) + t / math.cos(math.pi / n) * np.stack([np.cos(at), np.sin(at)], axis=1))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("n", [3, pytest.param(7, marks=pytest.mark.slow)])
def test_a_regular_polygon_that_the_square_cuts(n: int, backend: Any, x64_for_jax: None) -> None:
    f = teg.compile(teg.integral(teg.bracket(r * teg.cos(sector(n)) < t), *SQUARE), [a, b, c, t], backend=backend)
    rng = np.random.default_rng(3)
    for _ in range(12):
        at = {"a": rng.uniform(-1, 1), "b": rng.uniform(-1, 1), "c": rng.uniform(-9, 9), "t": rng.uniform(0.1, 0.9)}
        value, gradient = f.value_and_grad(at)
        assert value == pytest.approx(polygon_area(n, **at), rel=1e-12)
        for name in at:
            far, near = (
                polygon_area(n, **{**at, name: at[name] + h}) - polygon_area(n, **{**at, name: at[name] - h}) for h in (2e-3, 1e-3)
            )
            assert gradient[name] == pytest.approx((8 * near - far) / 12e-3, rel=1e-5, abs=1e-5), (name, at)


@pytest.mark.parametrize(
    "inside",
    [r * teg.cos(sector(5)) < t, r < t / teg.cos(sector(5)), teg.cos(sector(5)) < t / r, (r * teg.cos(sector(5))) ** 2 < t**2],
    ids=["side", "polar", "quotient", "square"],
)
def test_a_pentagon_to_all_digits(inside: teg.Cond) -> None:
    """Area 5·tan(π/5)·t²: its gradient was off by 2e-8, with less than that as its estimate, and took a minute."""
    f = teg.compile(teg.integral(teg.bracket(inside), *SQUARE), [a, c, t], backend="numpy")
    value, gradient = f.value_and_grad(a=0.1, b=0.05, c=0.2, t=0.5)
    area = 5 * math.tan(math.pi / 5) * 0.25
    assert value == pytest.approx(area, rel=1e-13)
    assert gradient["t"] == pytest.approx(4 * area, rel=1e-13)
    assert gradient["a"] == pytest.approx(0, abs=1e-13)
    assert gradient["c"] == pytest.approx(0, abs=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_star(backend: Any, x64_for_jax: None) -> None:
    """cos m + |sin m|/2 < t/r: 2n triangles of the angle π/n, between the sides t and t/(cos π/n + sin(π/n)/2)."""
    n, (u, v) = 5, (r * teg.cos(sector(5)), r * teg.sin(sector(5)))
    f = teg.compile(teg.integral(teg.bracket(u + teg.abs(v) / 2 < t), *SQUARE), [c, t], backend=backend)
    value, gradient = f.value_and_grad(a=0.0, b=0.1, c=0.3, t=0.5)
    area = n * 0.5 * 0.5 / (math.cos(math.pi / n) + math.sin(math.pi / n) / 2) * math.sin(math.pi / n)
    assert value == pytest.approx(area, rel=1e-12)
    assert gradient["t"] == pytest.approx(2 * area / 0.5, rel=1e-12)
    assert gradient["c"] == pytest.approx(0, abs=1e-12)


u, v, s = x - a, y - b, c * c
phi = teg.atan2(v, u)
radius = teg.sqrt(u * u + v * v)


@pytest.mark.parametrize(
    ("wave", "line"),
    [
        (radius * teg.cos(phi), u),
        (radius * teg.sin(phi), v),
        (3 * radius * teg.cos(phi + s), 3 * (u * teg.cos(s) - v * teg.sin(s))),
        (radius * teg.sin(s - phi), u * teg.sin(s) - v * teg.cos(s)),
        (radius**3 * teg.cos(2 * s - phi), radius**2 * (u * teg.cos(2 * s) + v * teg.sin(2 * s))),
        (teg.sqrt(x * x - 2 * a * x + a * a + v**2) * teg.sin(phi - s), v * teg.cos(s) - u * teg.sin(s)),
        (radius * teg.cos(phi) * teg.sin(phi), u * teg.sin(phi)),
    ],
)
def test_the_line_of_a_wave(wave: teg.Expr, line: teg.Expr) -> None:
    new = with_lines_of_angles(wave)
    assert sum(isinstance(n, Call) and n.name == "atan2" for n in postorder([new])) == sum(
        isinstance(n, Call) and n.name == "atan2" for n in postorder([line])
    )
    for point in ({x: 0.3, y: -0.8}, {x: -0.7, y: 0.2}, {x: -0.2, y: -0.4}):
        values = [teg.evaluate(teg.substitute(e, point), a=0.1, b=0.3, c=0.7) for e in (wave, new, line)]
        assert values == pytest.approx([values[0]] * 3, rel=1e-14)


@pytest.mark.parametrize(
    "e",
    [
        teg.sqrt(x**2 + 2 * y**2) * teg.cos(teg.atan2(y, x)),  # not the radius of this angle
        teg.cos(teg.atan2(y, x)),
        teg.sqrt(x**2 + y**2) * teg.cos(2 * teg.atan2(y, x)),
        teg.sqrt(a**2 + b**2) * teg.cos(teg.atan2(b, a)),  # without variables: nothing to find
    ],
)
def test_others_stay(e: teg.Expr) -> None:
    assert with_lines_of_angles(e) is e


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_sign_of_a_wave_is_the_side_of_a_line(backend: Any, x64_for_jax: None) -> None:
    """The half-plane at the angle c, through a point on the left of the square's middle: x·cos c + y·sin c > a·cos c."""
    f = teg.compile(teg.integral(teg.bracket(-2 * teg.cos(teg.atan2(y, x - a) - c) <= 0), *SQUARE), [a, c], backend=backend)
    g = teg.compile(teg.integral(teg.bracket((x - a) * teg.cos(c) + y * teg.sin(c) > 0), *SQUARE), [a, c], backend=backend)
    for at in ({"a": -0.3, "c": 0.4}, {"a": 0.2, "c": 4.0}):
        (value, gradient), (one, expected) = f.value_and_grad(at), g.value_and_grad(at)
        assert value == pytest.approx(one, rel=1e-14)
        assert gradient == pytest.approx(expected, rel=1e-14)
