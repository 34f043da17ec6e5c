"""Boxes cut by half-spaces in rational numbers: integrals of powers of linear functions, exactly.

The corners are all points where three planes meet, on the right side of all others; a face is what lies on one plane, in the order of
angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cmp_to_key
from itertools import combinations, combinations_with_replacement
from math import factorial, prod

Point = tuple[Fraction, ...]
Plane = tuple[Fraction, ...]
"""a, b, c and d of a·x + b·y + c·z + d."""


def planes_of(box: Sequence[float], half_spaces: Sequence[Sequence[float]]) -> list[Plane] | None:
    """The planes of the box (x₀, x₁, y₀, y₁, z₀, z₁) and of half-spaces, each once; None if one contains nothing at all."""
    found: list[Plane] = []
    sides = []
    for axis in range(3):
        near, far = box[2 * axis : 2 * axis + 2]
        for sign, at in ((1, near), (-1, far)):
            sides.append([*(Fraction(sign) if j == axis else Fraction(0) for j in range(3)), -sign * Fraction(at)])
    for plane in (*sides, *([Fraction(v) for v in half] for half in half_spaces)):
        size = max(map(abs, plane[:3]))
        if size == 0:
            if plane[3] <= 0:
                return None
            continue
        scaled = tuple(v / size for v in plane)
        if scaled not in found:
            found.append(scaled)
    return found


def integral(
    box: Sequence[float], half_spaces: Sequence[Sequence[float]], linear: Sequence[float] = (0, 0, 0, 1), power: int = 0
) -> Fraction:
    """∫∫∫ over the box where all half-spaces are positive of (linear[0]·x + linear[1]·y + linear[2]·z + linear[3])^power."""
    planes = planes_of(box, half_spaces)
    corners = [] if planes is None else _corners(planes)
    if planes is None or len(corners) < 4:
        return Fraction(0)
    apex = _mean(corners)
    total = Fraction(0)
    for plane in planes:
        face = _around(plane, [p for p in corners if _at(plane, p) == 0])
        for k in range(1, len(face) - 1):
            ends = [apex, face[0], face[k], face[k + 1]]
            volume = abs(_determinant([_minus(p, apex) for p in ends[1:]])) / 6
            values = [sum((Fraction(a) * v for a, v in zip(linear, p, strict=False)), Fraction(linear[3])) for p in ends]
            symmetric = sum((prod(chosen) for chosen in combinations_with_replacement(values, power)), Fraction(0))
            total += volume * symmetric * Fraction(6 * factorial(power), factorial(power + 3))
    return total


def _corners(planes: Sequence[Plane]) -> list[Point]:
    found: dict[Point, None] = {}
    for three in combinations(planes, 3):
        whole = _determinant([p[:3] for p in three])
        if whole == 0:
            continue
        point = tuple(_determinant([(*p[:j], -p[3], *p[j + 1 : 3]) for p in three]) / whole for j in range(3))
        if all(_at(p, point) >= 0 for p in planes):
            found[point] = None
    return list(found)


def _around(plane: Plane, points: list[Point]) -> list[Point]:
    """The points of a face in the order of their angles around its middle."""
    if len(points) < 3:
        return []
    middle, normal = _mean(points), plane[:3]
    first = _minus(points[0], middle)

    def half(v: Point) -> int:
        side = _dot(normal, _cross(first, v))
        return 0 if side > 0 or (side == 0 and _dot(first, v) > 0) else 1

    def compare(p: Point, q: Point) -> int:
        u, v = _minus(p, middle), _minus(q, middle)
        if half(u) != half(v):
            return half(u) - half(v)
        turn = _dot(normal, _cross(u, v))
        return -1 if turn > 0 else 1 if turn < 0 else 0

    return sorted(points, key=cmp_to_key(compare))


def _at(plane: Plane, p: Point) -> Fraction:
    return _dot(plane[:3], p) + plane[3]


def _dot(u: Point, v: Point) -> Fraction:
    return sum((a * b for a, b in zip(u, v, strict=True)), Fraction(0))


def _minus(p: Point, q: Point) -> Point:
    return tuple(a - b for a, b in zip(p, q, strict=True))


def _cross(u: Point, v: Point) -> Point:
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def _determinant(rows: Sequence[Point]) -> Fraction:
    return _dot(rows[0], _cross(rows[1], rows[2]))


def _mean(points: Sequence[Point]) -> Point:
    return tuple(sum(column, Fraction(0)) / len(points) for column in zip(*points, strict=True))
