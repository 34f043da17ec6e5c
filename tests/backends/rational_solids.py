"""Boxes cut by half-spaces in rational numbers: integrals of powers of linear functions, exactly.

The corners are all points where three planes meet, on the right side of all others; a face is what lies on one plane, in the order of
angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache, cmp_to_key
from itertools import combinations, combinations_with_replacement
from math import factorial, gcd, lcm, prod
from typing import TypeVar

N = TypeVar("N", int, Fraction)
Number = float | Fraction
Point = tuple[Fraction, ...]
Plane = tuple[int, ...]
"""a, b, c and d of a·x + b·y + c·z + d."""


def planes_of(box: Sequence[Number], half_spaces: Sequence[Sequence[Number]]) -> list[Plane] | None:
    """The planes of the box (x₀, x₁, y₀, y₁, z₀, z₁) and of half-spaces, each once; None if one contains nothing at all."""
    found: list[Plane] = []
    sides: list[list[Number]] = []
    for axis in range(3):
        near, far = box[2 * axis : 2 * axis + 2]
        for sign, at in ((1, near), (-1, far)):
            sides.append([*(sign if j == axis else 0 for j in range(3)), -sign * at])
    for plane in (*sides, *half_spaces):
        if not any(plane[:3]):
            if plane[3] <= 0:
                return None
            continue
        whole = _whole(plane)
        if whole not in found:
            found.append(whole)
    return found


def _whole(plane: Sequence[Number]) -> Plane:
    """The same half-space in whole numbers without a common divisor."""
    exact = [Fraction(v) for v in plane]
    common = lcm(*(v.denominator for v in exact))
    numbers = [v.numerator * (common // v.denominator) for v in exact]
    divisor = gcd(*numbers)
    return tuple(v // divisor for v in numbers)


def integral(
    box: Sequence[Number], half_spaces: Sequence[Sequence[Number]], linear: Sequence[float] = (0, 0, 0, 1), power: int = 0
) -> Fraction:
    """∫∫∫ over the box where all half-spaces are positive of (linear[0]·x + linear[1]·y + linear[2]·z + linear[3])^power."""
    total = Fraction(0)
    for volume, ends in _tetrahedra(tuple(box), tuple(map(tuple, half_spaces))):
        if power == 0:
            total += volume
            continue
        values = [sum((Fraction(a) * v for a, v in zip(linear, p, strict=False)), Fraction(linear[3])) for p in ends]
        symmetric = sum((prod(chosen) for chosen in combinations_with_replacement(values, power)), Fraction(0))
        total += volume * symmetric * Fraction(6 * factorial(power), factorial(power + 3))
    return total


@cache
def _tetrahedra(box: tuple[Number, ...], half_spaces: tuple[tuple[Number, ...], ...]) -> list[tuple[Fraction, list[Point]]]:
    """Tetrahedra that the solid consists of: the volume and the corners of each."""
    planes = planes_of(box, half_spaces)
    corners = {} if planes is None else _corners(planes)
    if planes is None or len(corners) < 4:
        return []
    apex = _mean(list(corners))
    found = []
    for plane in planes:
        face = _around(plane, [p for p, through in corners.items() if plane in through])
        for k in range(1, len(face) - 1):
            ends = [apex, face[0], face[k], face[k + 1]]
            found.append((abs(_determinant([_minus(p, apex) for p in ends[1:]])) / 6, ends))
    return found


def _corners(planes: Sequence[Plane]) -> dict[Point, frozenset[Plane]]:
    """The corners and the planes through each; in whole numbers over one more until it is known that a point is a corner."""
    found: dict[Point, frozenset[Plane]] = {}
    for p, q, r in combinations(planes, 3):
        normal = _cross(p, q)
        whole = _dot(normal, r)
        if whole == 0:
            continue
        across, sign = (_cross(q, r), _cross(r, p), normal), -1 if whole > 0 else 1
        x, y, z = (sign * (p[3] * across[0][j] + q[3] * across[1][j] + r[3] * across[2][j]) for j in range(3))
        heights = [a * x + b * y + c * z + d * abs(whole) for a, b, c, d in planes]
        if min(heights) >= 0:
            through = frozenset(plane for plane, height in zip(planes, heights, strict=True) if height == 0)
            found[Fraction(x, abs(whole)), Fraction(y, abs(whole)), Fraction(z, abs(whole))] = through
    return found


def _around(plane: Plane, points: list[Point]) -> list[Point]:
    """The points of a face in the order of their angles around its middle."""
    if len(points) < 3:
        return []
    middle, normal = _mean(points), tuple(map(Fraction, plane[:3]))
    first = _minus(points[0], middle)

    def half(v: Point) -> int:
        side = _dot(normal, _cross(first, v))
        return 0 if side > 0 or (side == 0 and _dot(first, v) > 0) else 1

    def compare(p: tuple[int, Point, Point], q: tuple[int, Point, Point]) -> int:
        if p[0] != q[0]:
            return p[0] - q[0]
        turn = _dot(normal, _cross(p[1], q[1]))
        return -1 if turn > 0 else 1 if turn < 0 else 0

    beside = [(half(v), v, p) for p in points for v in [_minus(p, middle)]]
    return [p for _, _, p in sorted(beside, key=cmp_to_key(compare))]


def _dot(u: tuple[N, ...], v: tuple[N, ...]) -> N:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _minus(p: Point, q: Point) -> Point:
    return tuple(a - b for a, b in zip(p, q, strict=True))


def _cross(u: tuple[N, ...], v: tuple[N, ...]) -> tuple[N, ...]:
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def _determinant(rows: Sequence[Point]) -> Fraction:
    return _dot(rows[0], _cross(rows[1], rows[2]))


def _mean(points: Sequence[Point]) -> Point:
    return tuple(sum(column, Fraction(0)) / len(points) for column in zip(*points, strict=True))
