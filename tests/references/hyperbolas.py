"""Unions of regions s·((x - a)·(y - b) - c) > 0 in the unit square, by intervals of x on lines along it. Shares nothing with the code."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def covered(rows: np.ndarray, y: float) -> list[tuple[float, float]]:
    """Returns the disjoint intervals of x on which a point (x, y) is in one of the regions with the rows (a, b, c, s)."""
    found = []
    for a, b, c, s in rows:
        rate = s * (y - b)
        if rate == 0.0:
            found += [(0.0, 1.0)] if -s * c > 0.0 else []
        else:
            end = min(max(a + s * c / rate, 0.0), 1.0)
            found.append((end, 1.0) if rate > 0.0 else (0.0, end))
    joined: list[tuple[float, float]] = []
    for lo, hi in sorted(found):
        if joined and lo <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], hi)
        elif lo < hi:
            joined.append((lo, hi))
    return joined


def integral_over_union(rows: np.ndarray) -> float:
    """Returns ∫∫ 1 + x·y over the union: Gauss's rule in y between the places where an end meets a side or another one."""
    places = [0.0, 1.0, *(b for _, b, _, _ in rows)]
    for i, (a, b, c, _) in enumerate(rows):
        places += [b + c / (side - a) for side in (0.0, 1.0) if side != a]
        for p, q, r, _ in rows[:i]:  # a + c/(y - b) = p + r/(y - q)
            equation = np.polyadd((a - p) * np.poly([b, q]), np.polysub(c * np.poly([q]), r * np.poly([b])))
            places += [z.real for z in np.roots(equation) if abs(z.imag) < 1e-9]
    places = sorted({z for z in places if 0.0 <= z <= 1.0})
    total = 0.0
    for lo, hi in pairwise(places):
        middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
        for node, weight in zip(middle + half * NODES, half * WEIGHTS, strict=True):
            total += weight * sum((q - p) + 0.5 * node * (q * q - p * p) for p, q in covered(rows, node))
    return float(total)


def slope_of_union(rows: np.ndarray, direction: np.ndarray, step: float = 1e-4) -> float:
    """Returns the derivative of that integral along a direction, by differences of order 4."""

    def difference(h: float) -> float:
        return (integral_over_union(rows + h * direction) - integral_over_union(rows - h * direction)) / (2 * h)

    return (4 * difference(step) - difference(2 * step)) / 3


def random_rows(number: int, seed: int, level: float = 0.2) -> np.ndarray:
    """Returns rows whose middles and levels have no relation to each other."""
    rng = np.random.default_rng(seed)
    c = rng.uniform(0.02, level, number) * rng.choice([-1.0, 1.0], number)
    return np.stack([rng.uniform(-0.2, 1.2, number), rng.uniform(-0.2, 1.2, number), c, rng.choice([-1.0, 1.0], number)], axis=1)


def crossing_rows(number: int, seed: int) -> np.ndarray:
    """Returns rows of c = 0, pairs of lines, whose middles are tenths, and no two of which share a line or have one on a side."""
    rng = np.random.default_rng(seed)
    a, b = (rng.permutation(np.arange(1, 10))[:number] / 10 for _ in range(2))
    return np.stack([a, b, np.zeros(number), rng.choice([-1.0, 1.0], number)], axis=1)
