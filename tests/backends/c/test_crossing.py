"""Weights of nodes for polynomials on half-planes over a box, against the same domain clipped corner by corner."""

from __future__ import annotations

from itertools import count, pairwise

import numpy as np
import pytest

import teg
from teg.backends.c import crossing as c_crossing
from teg.backends.c.crossing import MOST_DEGREE, MOST_LINES, Writer, crossing, nodes_of, weights_of
from teg.program import Arg, HalfPlane
from teg.program.operations import OPERATIONS

PLANES = list[tuple[float, float, float]]


def computed(w: Writer, known: dict[Arg, float]) -> dict[Arg, float | bool]:
    """The values of assignments; `lower` and `upper` are C's a < b ? a : b and a > b ? a : b."""
    values: dict[Arg, float | bool] = dict(known)
    for line in w.lines:
        args = [values[a] if isinstance(a, str) else a for a in line.args]
        if line.op in ("lower", "upper"):
            first, second = args
            values[line.name] = first if (first < second if line.op == "lower" else first > second) else second
            continue
        meaning = OPERATIONS[line.op].meaning
        assert meaning is not None
        values[line.name] = meaning(*args)
    return values


def weights(planes: PLANES, width: float, height: float, degree: int, alone: int | None = None) -> tuple[np.ndarray, bool]:
    """The weights of the nodes, and whether they are right; of one half-plane that stands `alone`, if there is one."""
    names = [HalfPlane(*(f"p{3 * i + k}" for k in range(3))) for i in range(len(planes))]
    w = Writer(count(1))
    found = crossing(w, names, (width, height), degree, 0, alone)
    given = c_crossing.weights(w, found.moments, degree)
    values = computed(w, {f"p{3 * i + k}": planes[i][k] for i in range(len(planes)) for k in range(3)})
    right = all(bool(values[c]) for c in found.conditions)
    return np.array([values.get(v, v) for v in given], dtype=float), right


def clipped(planes: PLANES, width: float, height: float) -> list[tuple[float, float]]:
    """The corners of the box cut by the half-planes, in [-1, 1]²."""
    corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    for a, b, c in planes:
        at = [c + a * width * (1 + x) / 2 + b * height * (1 + y) / 2 for x, y in corners]
        kept: list[tuple[float, float]] = []
        for i, (x, y) in enumerate(corners):
            (px, py), last = corners[i - 1], at[i - 1]
            if last * at[i] < 0.0:
                t = last / (last - at[i])
                kept.append((px + t * (x - px), py + t * (y - py)))
            if at[i] >= 0.0:
                kept.append((x, y))
        corners = kept
    return corners


def moment(corners: list[tuple[float, float]], p: int, q: int) -> float:
    """∫∫ XᵖY^q over a polygon, by a product rule on the triangles of a fan."""
    nodes, node_weights = np.polynomial.legendre.leggauss(8)
    u, v = (0.5 + 0.5 * part.ravel() for part in np.meshgrid(nodes, nodes))
    weight = 0.25 * np.outer(node_weights, node_weights).ravel() * u
    total = 0.0
    for (ax, ay), (bx, by) in pairwise(corners[1:]):
        ox, oy = corners[0]
        twice = (ax - ox) * (by - oy) - (bx - ox) * (ay - oy)
        xs, ys = ox + u * ((ax - ox) * (1 - v) + (bx - ox) * v), oy + u * ((ay - oy) * (1 - v) + (by - oy) * v)
        total += twice * float(weight @ (xs**p * ys**q))
    return total


@pytest.mark.parametrize("degree", range(MOST_DEGREE + 1))
def test_nodes_and_moments_are_inverse(degree: int) -> None:
    """With the weights of one moment alone a polynomial gives its coefficient."""
    powers = [(p, q) for p in range(degree + 1) for q in range(degree + 1 - p)]
    for key in powers:
        row = [dict(parts).get(key, 0.0) for parts in weights_of(degree)]
        for p, q in powers:
            total = sum(v * x**p * y**q for v, (x, y) in zip(row, nodes_of(degree), strict=True))
            assert total == pytest.approx(float((p, q) == key), abs=1e-14)


@pytest.mark.parametrize("degree", range(MOST_DEGREE + 1))
@pytest.mark.parametrize("lines", [1, 2, 3, MOST_LINES])
def test_moments_of_a_clipped_box(lines: int, degree: int) -> None:
    """Of random half-planes, slopes of 0 and equal lines among them: where the weights are right, they are the moments' of the polygon."""
    rng = np.random.default_rng(10 * lines + degree)
    checked = 0
    for _ in range(60):
        slopes = rng.standard_normal((lines, 2))
        slopes[rng.random((lines, 2)) < 0.1] = 0.0
        width, height = float(rng.choice([1.0, 0.5, -2.0])), float(rng.choice([1.0, 3.0]))
        inside = rng.random(2) * (width, height)
        planes = [(float(a), float(b), float(rng.exponential(0.3) - a * inside[0] - b * inside[1])) for a, b in slopes]
        if lines > 1 and rng.random() < 0.1:
            planes[1] = planes[0]
        found, right = weights(planes, width, height, degree)
        if right:
            corners = clipped(planes, width, height)
            for p in range(degree + 1):
                for q in range(degree + 1 - p):
                    total = sum(v * x**p * y**q for v, (x, y) in zip(found, nodes_of(degree), strict=True))
                    assert total == pytest.approx(moment(corners, p, q), abs=2e-14)
            checked += 1
    assert checked > 15


@pytest.mark.parametrize("slope", [0.0, 1e-300, 1e-17, 1e-12, 1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("gap", [0.0, 1e-16, 1e-12, 1e-6, 1e-3, 0.1])
def test_lines_along_a_side(slope: float, gap: float) -> None:
    """Beside each of the four sides, nearly parallel to it: the area is right to rounding, or the line is left out."""
    for a, b, at in ((1.0, slope, 1.0), (1.0, slope, 0.0), (slope, 1.0, 1.0), (slope, 1.0, 0.0), (1.0, -slope, 1.0), (-slope, 1.0, 1.0)):
        for sign in (1.0, -1.0):
            planes = [(sign * a, sign * b, -sign * (at - gap))]
            found, right = weights(planes, 1.0, 1.0, 0)
            assert not right or found[0] == pytest.approx(moment(clipped(planes, 1.0, 1.0), 0, 0), abs=1e-14)


@pytest.mark.parametrize("turn", [0.0, 1e-16, 1e-14, 1e-11, 1e-8, 1e-5, 1e-2])
@pytest.mark.parametrize("gap", [0.0, 1e-16, 1e-13, 1e-9, 1e-6, 1e-2])
def test_lines_that_are_nearly_one(turn: float, gap: float) -> None:
    """Strips and wedges as thin as rounding: right to rounding, or left out."""
    for tilt in (0.3, 2.0, -1.0):
        planes = [(1.0, tilt, -0.5 * (1 + tilt)), (-1.0, -tilt * (1 + turn), 0.5 * (1 + tilt) + gap)]
        found, right = weights(planes, 1.0, 1.0, 0)
        assert not right or found[0] == pytest.approx(moment(clipped(planes, 1.0, 1.0), 0, 0), abs=1e-14)


@pytest.mark.parametrize("plane", [(0.0, 0.0, 1.0), (np.nan, 1.0, 0.0), (1.0, np.inf, 0.0), (1.0, 1.0, np.nan), (1e200, 1.0, 0.0)])
def test_what_is_no_line(plane: tuple[float, float, float]) -> None:
    """Without a slope, or not finite: not right."""
    found, right = weights([plane], 1.0, 1.0, 1)
    assert not right or not np.isfinite(found).all()


def test_a_speck_is_left_out() -> None:
    """Errors are relative to the box, so what is much smaller is clipped corner by corner."""
    for size, expected in ((0.1, True), (1e-4, False)):
        assert weights([(-1.0, -1.0, size)], 1.0, 1.0, 1)[1] is expected


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_a_corner_of_a_huge_box(backend: str) -> None:
    """A half-plane leaves a triangle at the corner of boxes of all sizes; relative to the largest it rounds to nothing. By hand."""
    x, y = teg.vars("x y")
    c, w = teg.params("c w")
    f = teg.compile(teg.integral(teg.bracket(x + 1.5 * y < c), (x, 0, w), (y, 0, w)), [c], backend=backend)
    value, slopes = f.value_and_grad(c=1.8, w=np.resize([1e3, 1e8, 1e15, 1e17, 1e50, 1e100, 1e150], 140))
    np.testing.assert_allclose(value, 1.08, rtol=1e-14)
    np.testing.assert_allclose(slopes["c"], 1.2, rtol=1e-14)


@pytest.mark.parametrize("alone", [0, 1, 2])
def test_one_half_plane_alone(alone: int) -> None:
    """The others hold on the box: the weights are those of all of them. Elsewhere they are not right."""
    rng = np.random.default_rng(alone)
    number = 0
    for _ in range(60):
        width, height = rng.uniform(0.5, 2.0, 2)
        planes: PLANES = [(a, b, abs(a) * width + abs(b) * height + 0.1) for a, b in rng.standard_normal((3, 2))]
        a, b, _ = planes[alone]
        planes[alone] = a, b, -a * width * rng.random() - b * height * rng.random()
        found, right = weights(planes, width, height, 2, alone)
        expected, known = weights(planes, width, height, 2)
        if right and known:
            number += 1
            np.testing.assert_allclose(found, expected, atol=1e-13)
        other = (alone + 1) % 3
        planes[other] = a, -b, -0.5 * (a * width - b * height)
        assert not weights(planes, width, height, 2, alone)[1]
    assert number > 50


@pytest.mark.parametrize("turn", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
@pytest.mark.parametrize("distance", [0.0, 1e-17, 1e-14, 1e-9, 1e-4])
def test_a_line_on_a_side(turn: tuple[float, float], distance: float) -> None:
    """On a side, the box inside, the weights are those of the box. Near a side they are off by the sliver at most, if they are right."""
    a, b = 3.0 * turn[0], 3.0 * turn[1]
    whole, _ = weights([(1.0, 1.0, 9.0)], 1.0, 1.0, 2)
    for moved in (distance, -distance):
        found, right = weights([(a, b, moved - min(a, 0.0) - min(b, 0.0))], 1.0, 1.0, 2)
        assert right or distance > 0.0
        if right:
            np.testing.assert_allclose(found, whole, atol=8.0 * distance + 1e-14)
        outside, right = weights([(-a, -b, moved + min(a, 0.0) + min(b, 0.0))], 1.0, 1.0, 2)
        if right:
            np.testing.assert_allclose(outside, 0.0, atol=8.0 * distance + 1e-14)
