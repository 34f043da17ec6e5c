"""An exact clipper that shares nothing with the compiler: convex polygons, cut by half-planes and by each other.

A half-plane is (c, a, b) for c + a·x + b·y >= 0, a convex region a list of them, a polygon its corners in order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

Form = tuple[float, float, float]
Polygon = list[tuple[float, float]]


def form(a: Sequence[float], b: Sequence[float]) -> Form:
    """The half-plane on the left of the line from a to b."""
    return a[0] * b[1] - a[1] * b[0], a[1] - b[1], b[0] - a[0]


def region(corners: Sequence[Sequence[float]]) -> list[Form]:
    """The half-planes of a convex polygon, whichever way it turns."""
    forms = [form(p, q) for p, q in zip(corners, [*corners[1:], corners[0]], strict=True)]
    (ax, ay), (bx, by), (cx, cy) = (tuple(p[:2]) for p in corners[:3])
    left = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0
    return forms if left else [(-c, -a, -b) for c, a, b in forms]


def cut(polygon: Polygon, half: Form) -> Polygon:
    """The part of a convex polygon in a half-plane."""
    heights = [half[0] + half[1] * x + half[2] * y for x, y in polygon]
    kept: Polygon = []
    for n, (p, h) in enumerate(zip(polygon, heights, strict=True)):
        (q, g) = polygon[n - 1], heights[n - 1]
        if (h >= 0) != (g >= 0):
            s = g / (g - h)
            kept.append((q[0] + s * (p[0] - q[0]), q[1] + s * (p[1] - q[1])))
        if h >= 0:
            kept.append(p)
    return kept


def within(polygon: Polygon, forms: Sequence[Form]) -> Polygon:
    """The part of a convex polygon in a convex region."""
    for half in forms:
        polygon = cut(polygon, half)
    return polygon


def without(polygons: Sequence[Polygon], forms: Sequence[Form]) -> list[Polygon]:
    """The parts of convex polygons that are not in a convex region."""
    left: list[Polygon] = []
    for polygon in polygons:
        if len(within(polygon, forms)) < 3:
            left.append(polygon)
            continue
        for c, a, b in forms:
            beyond = cut(polygon, (-c, -a, -b))
            if len(beyond) > 2:
                left.append(beyond)
            polygon = cut(polygon, (c, a, b))
    return left


def area(polygons: Sequence[Polygon]) -> float:
    """The area of convex polygons that do not overlap."""
    return math.fsum(
        0.5 * abs(math.fsum(p[n - 1][0] * p[n][1] - p[n][0] * p[n - 1][1] for n in range(len(p)))) for p in polygons if len(p) > 2
    )


def box(left: float, right: float, bottom: float, top: float) -> Polygon:
    return [(left, bottom), (right, bottom), (right, top), (left, top)]


def slope(function: Callable[[float], float], h: float) -> float:
    """The derivative at 0, by differences of fourth order."""
    return (8 * (function(h) - function(-h)) - (function(2 * h) - function(-2 * h))) / (12 * h)
