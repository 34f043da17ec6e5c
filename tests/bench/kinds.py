"""Twelve kinds of how a triangle lies to a pixel, with the loss and its gradient to 60 digits: `python tests/bench/kinds.py` writes
tests/backends/triangle_kinds.json.

The reference is computed by other means than any program here: the polygon is clipped in 60 digits, the squared colour difference is
integrated over a fan of it by a product rule of sufficient degree, and the derivatives are differences of that, (f(p + h) - f(p - h))/2h
with h = 10⁻²². Where the loss has a kink at p that is the mean of the one-sided derivatives, which is what the language gives.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

STORED = Path(__file__).resolve().parents[1] / "backends" / "triangle_kinds.json"
PER_KIND = {0: 2, 1: 4, 2: 2}
"""How many cases of each kind are stored, by the order of the colours."""
FUNCTIONS = (1, 3, 6)
SIDE = 16
FAR = 480.0
DIGITS = 60
Random = np.random.Generator


@dataclass(frozen=True)
class Case:
    """One pair: vertices (6,), counterclockwise, box (left, right, bottom, top), colours (3·functions,), target (3,); the loss and then its
    derivatives by vertices and colours."""

    kind: str
    order: int
    vertices: tuple[float, ...]
    box: tuple[float, ...]
    colours: tuple[float, ...]
    target: tuple[float, ...]
    expected: tuple[float, ...] = ()


def near(rng: Random, centre: np.ndarray, scale: float) -> np.ndarray:
    """A random point about another one."""
    return np.asarray(centre + scale * rng.standard_normal(2))


def anywhere(rng: Random, corner: np.ndarray) -> np.ndarray:
    """A random point of a pixel."""
    return np.asarray(corner + rng.random(2))


def a_corner(rng: Random, corner: np.ndarray) -> np.ndarray:
    """One of the four corners of a pixel."""
    return np.asarray(corner + rng.integers(0, 2, 2))


def scattered(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """A triangle about as large as the pixel."""
    return [near(rng, corner + 0.5, 1.0) for _ in range(3)]


def vertex_in_pixel(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """One vertex in the pixel, the others far away."""
    return [anywhere(rng, corner), near(rng, corner + 0.5, 5.0), near(rng, corner + 0.5, 5.0)]


def side_through_corner(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """A side through a corner of the pixel, exactly: its direction is dyadic."""
    way, through = rng.integers(1, 9, 2) / 4 * rng.choice([-1.0, 1.0], 2), a_corner(rng, corner)
    return [through - 2 * way, through + 2 * way, near(rng, corner + 0.5, 3.0)]


def triangle_in_pixel(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """The whole triangle in the pixel."""
    return [anywhere(rng, corner) for _ in range(3)]


def pixel_in_triangle(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """The whole pixel in the triangle."""
    angles = 2 * np.pi * (rng.random() + np.arange(3) / 3)
    return list(corner + 0.5 + rng.uniform(5, 10) * np.stack([np.cos(angles), np.sin(angles)], axis=1))


def thin(rng: Random, corner: np.ndarray, height: float) -> list[np.ndarray]:
    """A sliver of that height across the pixel."""
    angle = 2 * np.pi * rng.random()
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    middle = near(rng, corner + 0.5, 0.2)
    tip = middle + 0.5 * rng.standard_normal() * along + height * across
    return [middle - 2 * rng.random() * along, middle + 3 * rng.random() * along, tip]


def axis_aligned(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """Two sides along the axes."""
    first, (width, height) = anywhere(rng, corner), 3 * rng.standard_normal(2)
    return [first, first + np.array([width, 0.0]), first + np.array([0.0, height])]


def coincident(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """A side on the line of a side of the pixel."""
    axis, first, second = rng.integers(0, 2), near(rng, corner + 0.5, 0.7), near(rng, corner + 0.5, 0.7)
    first[axis] = second[axis] = corner[axis] + rng.integers(0, 2)
    return [first, second, near(rng, corner + 0.5, 2.0)]


def vertex_on_corner(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """A vertex on a corner of the pixel."""
    return [a_corner(rng, corner), near(rng, corner + 0.5, 2.0), near(rng, corner + 0.5, 2.0)]


def large_coordinates(rng: Random, corner: np.ndarray) -> list[np.ndarray]:
    """A vertex in the pixel, the others anywhere in a picture of 512²."""
    return [anywhere(rng, corner), 512 * rng.random(2), 512 * rng.random(2)]


KINDS = {
    "scattered": scattered,
    "vertex in pixel": vertex_in_pixel,
    "side through corner": side_through_corner,
    "triangle in pixel": triangle_in_pixel,
    "pixel in triangle": pixel_in_triangle,
    "thin 1e-2": lambda rng, corner: thin(rng, corner, 1e-2),
    "thin 1e-4": lambda rng, corner: thin(rng, corner, 1e-4),
    "thin 1e-6": lambda rng, corner: thin(rng, corner, 1e-6),
    "axis-aligned": axis_aligned,
    "coincident": coincident,
    "vertex on corner": vertex_on_corner,
    "large coordinates": large_coordinates,
}


def draw(kind: str, order: int, rng: Random) -> Case:
    """A random case of a kind with its expected values; a triangle that misses the pixel is drawn again, but for the kinds that may touch
    it from outside."""
    while True:
        corner = rng.integers(0, SIDE, 2).astype(float) + (FAR if kind == "large coordinates" else 0.0)
        points = np.array(KINDS[kind](rng, corner))
        (ax, ay), (bx, by), (cx, cy) = points
        if (bx - ax) * (cy - ay) < (cx - ax) * (by - ay):
            points = points[::-1]
        vertices, box = tuple(points.ravel().tolist()), (corner[0], corner[0] + 1, corner[1], corner[1] + 1)
        colours, target = tuple(rng.random(3 * FUNCTIONS[order]).tolist()), tuple(rng.random(3).tolist())
        case = Case(kind, order, vertices, tuple(map(float, box)), colours, target)
        found = expected(case)
        if found[0] > 0 or kind in ("coincident", "vertex on corner"):
            return replace(case, expected=found)


def clipped(polygon: list[Any], axis: int, sign: int, limit: Any) -> list[Any]:
    """The part of a polygon where sign·(limit - coordinate) > 0."""
    kept = []
    rooms = [sign * (limit - p[axis]) for p in polygon]
    for i, p in enumerate(polygon):
        q, room, before = polygon[i - 1], rooms[i], rooms[i - 1]
        if (room > 0) != (before > 0) and room != before:
            part = before / (before - room)
            kept.append((q[0] + part * (p[0] - q[0]), q[1] + part * (p[1] - q[1])))
        if room > 0:
            kept.append(p)
    return kept


def exact_loss(order: int, v: list[Any], colours: list[Any], box: list[Any], target: list[Any]) -> Any:
    """The loss in the precision of mpmath."""
    import mpmath

    half, reach = mpmath.mpf(1) / 2, mpmath.sqrt(mpmath.mpf(3) / 5) / 2
    rule = [(half - reach, mpmath.mpf(5) / 18), (half, mpmath.mpf(4) / 9), (half + reach, mpmath.mpf(5) / 18)]
    polygon = [(v[0], v[1]), (v[2], v[3]), (v[4], v[5])]
    for axis, sign, limit in ((0, 1, box[1]), (0, -1, box[0]), (1, 1, box[3]), (1, -1, box[2])):
        polygon = clipped(polygon, axis, sign, limit)
    total = mpmath.mpf(0)
    twice = (v[2] - v[0]) * (v[5] - v[1]) - (v[4] - v[0]) * (v[3] - v[1])
    for b, c in pairwise(polygon[1:]):
        a = polygon[0]
        size = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        for r, first in rule:  # the square folded to a triangle; with the factor r of degree 5 in r
            for s, second in rule:
                x, y = (p + r * ((1 - s) * (q - p) + s * (o - p)) for p, q, o in zip(a, b, c, strict=True))
                l1 = ((x - v[0]) * (v[5] - v[1]) - (v[4] - v[0]) * (y - v[1])) / twice
                l2 = ((v[2] - v[0]) * (y - v[1]) - (x - v[0]) * (v[3] - v[1])) / twice
                shapes = weights = [1 - l1 - l2, l1, l2]
                if order == 0:
                    shapes = [mpmath.mpf(1)]
                elif order == 2:
                    shapes = [w * (2 * w - 1) for w in weights] + [4 * weights[i] * weights[(i + 1) % 3] for i in range(3)]
                squares = (sum((n * colours[3 * m + k] for m, n in enumerate(shapes)), start=-target[k]) ** 2 for k in range(3))
                total += size * r * first * second * sum(squares)
    return total


def expected(case: Case) -> tuple[float, ...]:
    """The loss and its derivatives by vertices and colours, correctly rounded."""
    import mpmath

    with mpmath.workdps(DIGITS):
        v, colours, box, target = ([mpmath.mpf(n) for n in part] for part in (case.vertices, case.colours, case.box, case.target))
        step = mpmath.mpf(10) ** -22
        found = [exact_loss(case.order, v, colours, box, target)]
        for moved in (v, colours):
            for i, at in enumerate(list(moved)):
                ends = []
                for moved[i] in (at + step, at - step):
                    ends.append(exact_loss(case.order, v, colours, box, target))
                moved[i] = at
                found.append((ends[0] - ends[1]) / (2 * step))
        return tuple(map(float, found))


def stored() -> list[Case]:
    """The cases on disk."""
    rows = json.loads(STORED.read_text(encoding="utf-8"))
    return [Case(**{k: tuple(v) if isinstance(v, list) else v for k, v in row.items()}) for row in rows]


def main() -> None:
    """Draw, compute and store."""
    rng, rows = np.random.default_rng(5), []
    for order, count in PER_KIND.items():
        for kind in KINDS:
            for _ in range(count):
                rows.append(asdict(draw(kind, order, rng)))
    text = ",\n".join(json.dumps(row) for row in rows)
    STORED.write_text(f"[\n{text}\n]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
