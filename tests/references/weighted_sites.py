"""The site of least w·|z - c|² in the unit square, for sites of different weights: derivatives over arcs of circles, in NumPy alone."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(30)


def random_sites(n: int, seed: int) -> np.ndarray:
    """Rows (x, y, w, v): a place in the square, a weight and the value there."""
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(0.0, 1.0, (n, 2)), rng.uniform(0.5, 2.0, n), rng.normal(size=n)]


def mean_by_places(rows: np.ndarray, side: int = 2000) -> float:
    """The value of the site that wins, over the middles of small squares."""
    at = (np.arange(side) + 0.5) / side
    return float(rows[_keys(rows, *np.meshgrid(at, at)).argmin(axis=0), 3].mean())


def slopes(rows: np.ndarray) -> np.ndarray:
    """The derivatives of ∫∫ of the value of the site that wins, by the rows; those by values by the same places of small squares."""
    found = np.zeros_like(rows)
    for j, k in combinations(range(len(rows)), 2):
        lead, b, level = _difference(rows, j, k)
        centre = -b / (2 * lead)
        radius = np.sqrt(centre @ centre - level / lead)
        cuts = [-np.pi, np.pi]
        for axis in (0, 1):
            cuts += [angle for side in (0.0, 1.0) for angle in _roots(radius * np.eye(2)[axis], centre[axis] - side)]
        for other in set(range(len(rows))) - {j, k}:
            a, p, q = _difference(rows, j, other)
            cuts += _roots(radius * (2 * a * centre + p), a * (centre @ centre + radius**2) + p @ centre + q)
        for first, last in pairwise(np.unique(cuts)):
            angle = np.append(0.5 * (first + last + (last - first) * NODES), 0.5 * (first + last))
            x, y = centre[:, None] + radius * np.stack([np.cos(angle), np.sin(angle)])
            *_, u, v = *x, y[-1]
            keys = _keys(rows, u, v)
            if not (0 < u < 1 and 0 < v < 1) or (np.delete(keys, [j, k]) < keys[j]).any():
                continue
            along = 0.5 * (last - first) * WEIGHTS * radius / (2 * abs(lead) * radius) * (rows[k, 3] - rows[j, 3])
            for site, sign in ((j, 1.0), (k, -1.0)):
                c, d, w, _ = rows[site]
                rates = np.stack([-2 * w * (x - c), -2 * w * (y - d), (x - c) ** 2 + (y - d) ** 2])
                found[site, :3] += sign * rates[:, :-1] @ along
    return found


def _keys(rows: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack([w * ((x - c) ** 2 + (y - d) ** 2) for c, d, w, _ in rows])


def _difference(rows: np.ndarray, j: int, k: int) -> tuple[float, np.ndarray, float]:
    """The key of j less that of k, A·|z|² + b·z + d."""
    (p, u), (q, w) = (rows[j, :2], rows[j, 2]), (rows[k, :2], rows[k, 2])
    return u - w, 2 * (w * q - u * p), u * (p @ p) - w * (q @ q)


def _roots(a: np.ndarray, b: float) -> list[float]:
    """The angles at which a·(cos φ, sin φ) + b is 0."""
    size, turn = np.hypot(*a), np.arctan2(a[1], a[0])
    if size <= abs(b):
        return []
    half = np.arccos(-b / size)
    return [float((turn + sign * half + np.pi) % (2 * np.pi) - np.pi) for sign in (-1, 1)]
