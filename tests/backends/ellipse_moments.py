"""Moments of ellipses on clipped boxes to 18 digits, for the tests of `Ellipse`: row by row, or by the angle between crossings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import combinations, pairwise
from typing import Any

import mpmath
import pytest

from teg.backends.c.kernel import compile_c
from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from teg.program import Moments
from tests.backends.c_checks import in_c

Matrix = tuple[float, float, float, float]
Place = tuple[float, float, float, float, float]
"""u and v of the centre, the radius, width and height."""
Line = tuple[float, float, float]
"""a, b and c of c + a·u + b·v > 0."""

ROUND, LEANS, LONG = (1.0, 0.0, 0.0, 1.0), (1.3, 0.4, -0.2, 0.7), (8.0, 0.0, 0.0, 0.125)
needs_c = in_c[0]
BACKENDS = ["numpy", pytest.param("c", marks=needs_c), pytest.param("jax", marks=pytest.mark.slow)]
RULE = {"method": "gauss-legendre", "maxdegree": 5}


@cache
def exact(matrix: Matrix, place: Place, kind: str, j: int, k: int, lines: tuple[Line, ...] = (), axes: tuple[int, int] = (0, 0)) -> float:
    """∫∫ uʲvᵏ w over the part of the box inside of all lines."""
    with mpmath.workdps(20):
        if kind == "border":
            return float(_along(matrix, place, (j, k, *axes), lines))
        inside = _inside(matrix, place, j, k, lines)
        if kind == "above":
            return float(inside)
        width, height = map(mpmath.mpf, place[3:])
        around = (1.0, 0.0, 0.0, 1.0), (*place[:2], 4.0 * float(sum(map(abs, place))), *place[3:])
        return float((_inside(*around, j, k, lines) if lines else width ** (j + 1) * height ** (k + 1) / ((j + 1) * (k + 1))) - inside)


def _along(matrix: Matrix, place: Sequence[float], powers: Sequence[int], lines: Sequence[Line]) -> Any:
    """½/|det A|·∮ uʲvᵏpᵐqⁿ dφ over the part of the ellipse in the box."""
    a, b, c, d = map(mpmath.mpf, matrix)
    u0, v0, radius, width, height = map(mpmath.mpf, place)
    whole = a * d - b * c
    (left, right), (bottom, top) = sorted((mpmath.mpf(0), width)), sorted((mpmath.mpf(0), height))
    rows = (d * radius / whole, -b * radius / whole, u0, left, right), (-c * radius / whole, a * radius / whole, v0, bottom, top)
    cuts = {-mpmath.pi, mpmath.pi}
    across = [(p, q, side - at) for p, q, at, low, high in rows for side in (low, high)]  # p cos φ + q sin φ is so much on a side
    for e, f, g in (map(mpmath.mpf, line) for line in lines):
        (p, q, at, *_), (s, t, at_too, *_) = rows
        across.append((e * p + f * s, e * q + f * t, -g - e * at - f * at_too))
    for p, q, distance in across:
        if abs(distance) < mpmath.hypot(p, q):
            middle, turn = mpmath.atan2(q, p), mpmath.acos(distance / mpmath.hypot(p, q))
            cuts |= {mpmath.atan2(mpmath.sin(phi), mpmath.cos(phi)) for phi in (middle - turn, middle + turn)}

    def at_angle(phi: Any) -> list[Any]:
        return [at + p * mpmath.cos(phi) + q * mpmath.sin(phi) for p, q, at, _, _ in rows]

    def value(phi: Any) -> Any:
        coordinates = *at_angle(phi), radius * mpmath.cos(phi), radius * mpmath.sin(phi)
        return mpmath.fprod(x**power for x, power in zip(coordinates, powers, strict=True))

    total = mpmath.mpf(0)
    for first, last in pairwise(sorted(cuts)):
        u, v = at_angle((first + last) / 2)
        if left < u < right and bottom < v < top and all(e * u + f * v + g > 0 for e, f, g in lines):
            total += mpmath.quad(value, [first, (first + last) / 2, last], **RULE)
    return (1 if (width >= 0) == (height >= 0) else -1) * total / (2 * abs(whole))


def _inside(matrix: Matrix, place: Sequence[Any], j: int, k: int, lines: Sequence[Line]) -> Any:
    """∫∫ uʲvᵏ over the part of the ellipse in the box, row by row."""
    a, b, c, d = map(mpmath.mpf, matrix)
    u0, v0, radius, width, height = map(mpmath.mpf, place)
    uu, uv, vv, whole = a * a + c * c, a * b + c * d, b * b + d * d, abs(a * d - b * c)
    (left, right), (bottom, top) = sorted((mpmath.mpf(0), width)), sorted((mpmath.mpf(0), height))
    sign = (1 if width >= 0 else -1) * (1 if height >= 0 else -1)
    low, high = max(bottom, v0 - radius * mpmath.sqrt(uu) / whole), min(top, v0 + radius * mpmath.sqrt(uu) / whole)
    if low >= high:
        return mpmath.mpf(0)
    cuts = {low, high}
    for u in (left, right):
        rest = (uv * (u - u0)) ** 2 - vv * (uu * (u - u0) ** 2 - radius**2)
        if rest > 0:
            cuts |= {v for s in (-1, 1) if low < (v := v0 + (-uv * (u - u0) + s * mpmath.sqrt(rest)) / vv) < high}

    for e, f, g in (map(mpmath.mpf, line) for line in lines):  # where a line meets a side, another line, the ellipse
        if e == 0:
            cuts |= {-g / f} if f and low < -g / f < high else set()
            continue
        cuts |= {v for u in (left, right) if f and low < (v := -(g + e * u) / f) < high}
        p, q = -f / e, -g / e - u0 + -f / e * v0  # u - u0 = p·(v - v0) + q
        square, half, rest = uu * p * p + 2 * uv * p + vv, uu * p * q + uv * q, uu * q * q - radius**2
        root = half * half - square * rest
        cuts |= {v for s in (-1, 1) if root > 0 and low < (v := v0 + (-half + s * mpmath.sqrt(root)) / square) < high}
    for (e, f, g), (p, q, r) in combinations([tuple(map(mpmath.mpf, line)) for line in lines], 2):
        cuts |= {v for turn in [e * q - f * p] if turn and low < (v := (g * p - e * r) / turn) < high}

    def row(v: Any) -> Any:
        rest = (uv * (v - v0)) ** 2 - uu * (vv * (v - v0) ** 2 - radius**2)
        ends = [u0 + (-uv * (v - v0) + s * mpmath.sqrt(max(rest, 0))) / uu for s in (-1, 1)]
        start, stop = (min(max(u, left), right) for u in ends)
        for e, f, g in lines:
            if e > 0:
                start = max(start, -(g + f * v) / mpmath.mpf(e))
            elif e < 0:
                stop = min(stop, -(g + f * v) / mpmath.mpf(e))
            elif g + f * v <= 0:
                return mpmath.mpf(0)
        return (stop ** (j + 1) - start ** (j + 1)) / (j + 1) * v**k if start < stop else mpmath.mpf(0)

    total = mpmath.mpf(0)
    for first, last in pairwise(sorted(cuts)):
        middle, half = (first + last) / 2, (last - first) / 2
        total += mpmath.quad(
            lambda s, m=middle, h=half: row(m + h * mpmath.sin(s)) * h * mpmath.cos(s), [-mpmath.pi / 2, 0, mpmath.pi / 2], **RULE
        )
    return sign * total


def moments(kind: str, powers: Sequence[tuple[int, int]]) -> list[Moments]:
    """Each power alone."""
    return [Moments(kind, ((j, k, 1.0),)) for j, k in powers]


ASKED = [*moments("above", [(0, 0), (1, 0), (2, 2)]), *moments("below", [(0, 0)]), *moments("border", [(0, 0), (1, 2)])]


def kernels(name: str) -> Any:
    return {"numpy": compile_numpy, "c": compile_c, "jax": compile_jax}[name]
