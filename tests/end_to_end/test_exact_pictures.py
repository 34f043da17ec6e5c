"""Gradients of pictures beside a clipper in rational numbers, which shares nothing with the compiler: no rounding, no formula in common."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

import teg
from tests.bench.scenes import picture

Point = tuple[Fraction, Fraction]
STEP = Fraction(1, 2**20)


def clipped(polygon: list[Point], a: Fraction, b: Fraction, c: Fraction) -> list[Point]:
    """What a·x + b·y + c >= 0 leaves of a polygon."""
    result: list[Point] = []
    for p, q in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True):
        first, last = a * p[0] + b * p[1] + c, a * q[0] + b * q[1] + c
        if first >= 0:
            result.append(p)
        if first * last < 0:
            t = first / (first - last)
            result.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
    return result


def integral(polygon: list[Point], f: Callable[[Fraction, Fraction], Fraction]) -> Fraction:
    """The integral of a quadratic polynomial: a fan of triangles, the middles of their sides."""
    total, (a, *rest) = Fraction(0), polygon
    for b, c in pairwise(rest):
        area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2
        sides = ((a, b), (b, c), (c, a))
        total += area * sum(f((p[0] + q[0]) / 2, (p[1] + q[1]) / 2) for p, q in sides) / 3
    return total


def loss(corners: list[Point], colours: list[Fraction], target: list[list[list[Fraction]]]) -> Fraction:
    """The loss of one triangle with linear colours over all pixels."""
    lines = []
    for (ax, ay), (bx, by) in zip([*corners[1:], corners[0]], [corners[2], *corners[:2]], strict=True):
        lines.append((ay - by, bx - ax, (by - ay) * ax - (bx - ax) * ay))
    area = sum((c for _, _, c in lines), start=Fraction(0))
    total = Fraction(0)
    for row, pixels in enumerate(target):
        for column, wanted in enumerate(pixels):
            polygon = [(Fraction(column + u), Fraction(row + v)) for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))]
            for line in lines:
                polygon = clipped(polygon, *line)

            def squares(x: Fraction, y: Fraction, wanted: list[Fraction] = wanted) -> Fraction:
                weights = [(a * x + b * y + c) / area for a, b, c in lines]
                found = (sum(w * colours[3 * i + k] for i, w in enumerate(weights)) - wanted[k] for k in range(3))
                return sum((r * r for r in found), start=Fraction(0))

            total += integral(polygon, squares) if len(polygon) > 2 else 0
    return total


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("corners", [[(0.7, 0.4), (3.6, 1.1), (1.2, 3.3)], [(0.5, 0.25), (3.5, 0.3125), (2.1, 0.34375)]])
def test_gradients_by_the_corners(backend: str, corners: list[tuple[float, float]]) -> None:
    rng = np.random.default_rng(2)
    colours, target = rng.random((1, 9)), rng.random((4, 4, 3))
    e, wrt = picture()
    given = {"V": np.array(corners), "F": np.array([[0, 1, 2]]), "B": np.array([[0, 4, 0, 4]]), "C": colours, "T": target}
    value, slopes = teg.compile(e, wrt, backend=backend).value_and_grad(given)
    exact = [Fraction(c) for c in colours[0].tolist()]
    wanted = [[[Fraction(c) for c in pixel] for pixel in row] for row in target.tolist()]

    def at(number: int, axis: int, steps: int) -> Fraction:
        moved = [(Fraction(px), Fraction(py)) for px, py in corners]
        place = list(moved[number])
        place[axis] += steps * STEP
        moved[number] = (place[0], place[1])
        return loss(moved, exact, wanted)

    assert value == pytest.approx(float(at(0, 0, 0)), rel=1e-14)
    for number in range(3):
        for axis in range(2):
            differences = 8 * (at(number, axis, 1) - at(number, axis, -1)) - at(number, axis, 2) + at(number, axis, -2)
            assert slopes["V"][number, axis] == pytest.approx(float(differences / (12 * STEP)), rel=1e-11, abs=1e-13)
