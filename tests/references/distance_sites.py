"""The site of least |z - p| - v in the unit square: values over the angle about each site, in NumPy alone, and their differences."""

from __future__ import annotations

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
STEPS = np.array([-4, -3, -2, -1, 1, 2, 3, 4])
OF_ORDER_8 = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280])


def random_sites(n: int, seed: int) -> np.ndarray:
    """Rows (x, y, v, value): some of the places are outside of the square, and some sites have no cell."""
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(-0.2, 1.2, (n, 2)), rng.uniform(0.0, 0.3, n), rng.normal(size=n)]


def mean(rows: np.ndarray) -> float:
    """The integral of (1 + xy)·value over the unit square: in the direction e a cell ends at the least r of its rivals, r = N/(2M)."""
    return float(sum(_of_site(rows, k) for k in range(len(rows))))


def slope_along(rows: np.ndarray, direction: np.ndarray, step: float = 1e-4) -> float:
    """The derivative of the mean along a direction, by differences of order 8."""
    return float(OF_ORDER_8 @ [mean(rows + s * step * direction) for s in STEPS]) / step


def mean_by_places(rows: np.ndarray, side: int = 1500) -> float:
    """The same, over the middles of small squares."""
    at = (np.arange(side) + 0.5) / side
    x, y = np.meshgrid(at, at)
    keys = [np.hypot(x - p, y - q) - v for p, q, v, _ in rows]
    return float((rows[np.argmin(keys, axis=0), 3] * (1 + x * y)).mean())


def _of_site(rows: np.ndarray, k: int) -> float:
    p, q = rows[k, :2]
    apart, shift = np.delete(rows[:, :2] - rows[k, :2], k, axis=0), np.delete(rows[:, 2] - rows[k, 2], k)
    opened = (apart**2).sum(axis=1) - shift**2
    if (shift[opened <= 0] > 0).any():
        return 0.0  # a rival is nearer everywhere
    rivals = np.c_[opened, shift, apart][opened > 0]
    sides = [[1 - p, 0, 0.5, 0], [p, 0, -0.5, 0], [1 - q, 0, 0, 0.5], [q, 0, 0, -0.5]]
    ends = np.r_[rivals, sides]
    cuts = [-np.pi, np.pi]
    for i, (n, c, *d) in enumerate(ends):
        cuts += _roots(c, *d)
        for m, b, *e in ends[:i]:
            cuts += _roots(n * b - m * c, n * e[0] - m * d[0], n * e[1] - m * d[1])
        cuts += [np.arctan2(-d[1], -d[0]) + s * 10.0**-j for s in (1, -1) for j in np.arange(0, 7, 0.5)]  # where a thin cell is long
    angles = np.unique((np.array(cuts) + np.pi) % (2 * np.pi) - np.pi)
    first, last = angles, np.append(angles[1:], np.pi)
    half = 0.5 * (last - first)[:, None]
    angle, weight = 0.5 * (first + last)[:, None] + half * NODES, half * WEIGHTS
    u, v = np.cos(angle), np.sin(angle)
    near, far = np.zeros_like(u), np.full_like(u, np.inf)
    for n, c, *d in rivals:
        ahead = c + u * d[0] + v * d[1]
        far = np.where(ahead > 0, np.minimum(far, n / np.where(ahead > 0, 2 * ahead, 1.0)), far)
    for start, e in ((p, u), (q, v)):
        to_sides = np.stack([-start / e, (1 - start) / e])
        near, far = np.maximum(near, to_sides.min(axis=0)), np.minimum(far, to_sides.max(axis=0))

    def up_to(r: np.ndarray) -> np.ndarray:
        return (1 + p * q) * r**2 / 2 + (p * v + q * u) * r**3 / 3 + u * v * r**4 / 4

    return float(rows[k, 3] * np.sum(weight * np.where(far > near, up_to(np.where(far > near, far, near)) - up_to(near), 0.0)))


def _roots(a: float, b: float, c: float) -> list[float]:
    """The angles at which a + b·cos + c·sin is 0."""
    size = np.hypot(b, c)
    if size <= abs(a):
        return []
    middle, apart = np.arctan2(c, b), np.arccos(-a / size)
    return [middle - apart, middle + apart]
