"""Unions of ellipses a·u² + b·u·v + c·v² < 1 over the unit square, u and v from their centres, by arcs, in NumPy alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]
Seen = Callable[[int, float, float], float]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
TURN = np.arange(8) * np.pi / 4


def random_ellipses(n: int, seed: int, aspect: float = 4.0) -> np.ndarray:
    """Rows (x, y, a, b, c): middles in the square, half axes from 0.1 to 0.3, the shorter one divided by up to `aspect`, turned."""
    rng = np.random.default_rng(seed)
    long, turn = rng.uniform(0.1, 0.3, n), rng.uniform(0.0, np.pi, n)
    p, q = long**-2.0, (long / rng.uniform(1.0, aspect, n)) ** -2.0
    c, s = np.cos(turn), np.sin(turn)
    return np.c_[rng.uniform(0.0, 1.0, (n, 2)), p * c * c + q * s * s, 2 * (p - q) * c * s, p * s * s + q * c * c]


def integral_over_union(rows: np.ndarray, f: Function, primitive: Function) -> float:
    """∫∫ f by Green's theorem: ∮ F dy around the union, F the integral of f over x from 0."""
    total = sum(float(weights @ primitive(*at)) for _, at, _, weights in _arcs(rows, _alone(rows)))
    for p, q in pairwise(np.unique(np.clip([0.0, 1.0, *_on_line(rows, 1.0)], 0.0, 1.0))):
        if (_levels(rows, 1.0, 0.5 * (p + q)) > 0).any():
            height = 0.5 * (p + q + (q - p) * NODES)
            total += 0.5 * (q - p) * float(WEIGHTS @ primitive(np.ones_like(height), height))
    return total


def slopes_of_union(rows: np.ndarray, f: Function) -> np.ndarray:
    """The derivatives of that integral by the rows."""
    return slopes(rows, f, _alone(rows))


def slopes(rows: np.ndarray, f: Function, seen: Seen) -> np.ndarray:
    """∮ f·s·∂g/∂row/|∇g| over the arcs in the square, g = 1 - Q; s is how much more is seen inside than outside of an arc at a place."""
    found = np.zeros_like(rows)
    for k, (x, y), weights, _ in _arcs(rows, seen):
        u, v, (a, b, c) = x - rows[k, 0], y - rows[k, 1], rows[k, 2:]
        found[k] += (weights * f(x, y)) @ np.stack([2 * a * u + b * v, b * u + 2 * c * v, -u * u, -u * v, -v * v], axis=1)
    return found


def _alone(rows: np.ndarray) -> Seen:
    return lambda k, x, y: float(not (np.delete(_levels(rows, x, y), k) > 0).any())


def _levels(rows: np.ndarray, x: float, y: float) -> np.ndarray:
    u, v = x - rows[:, 0], y - rows[:, 1]
    return np.asarray(1 - rows[:, 2] * u * u - rows[:, 3] * u * v - rows[:, 4] * v * v)


def _arcs(rows: np.ndarray, seen: Seen) -> Iterator[tuple[int, tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray]]:
    """Yields for each arc its ellipse, nodes, the weights of ∫ … δ(g) there, and those of ∫ … dy, both times what is seen."""
    for k, (x, y, a, b, c) in enumerate(rows):
        root = np.linalg.cholesky(np.linalg.inv([[a, b / 2], [b / 2, c]]))
        middle = np.array([x, y])

        def at(angle: np.ndarray, middle: np.ndarray = middle, root: np.ndarray = root) -> np.ndarray:
            return middle[:, None] + root @ np.stack([np.cos(angle), np.sin(angle)])

        px, py = at(TURN)
        functions = [px, 1 - px, py, 1 - py, *np.stack([_levels(rows, u, v) for u, v in zip(px, py, strict=True)], axis=1)]
        cuts = [r for j, values in enumerate(functions) if j != k + 4 for r in _roots(values)]
        for p, q in pairwise(np.unique([-np.pi, np.pi, *cuts])):
            (u,), (v,) = at(np.array([0.5 * (p + q)]))
            share = seen(k, float(u), float(v)) if 0 < u < 1 and 0 < v < 1 else 0.0
            if share:
                angle = 0.5 * (p + q + (q - p) * NODES)
                step = 0.5 * (q - p) * WEIGHTS * share
                rise = root @ np.stack([-np.sin(angle), np.cos(angle)])
                yield k, tuple(at(angle)), 0.5 * np.linalg.det(root) * step, rise[1] * step


def _roots(values: np.ndarray) -> list[float]:
    """Returns the zeros of a trigonometric polynomial of degree 2 from its values at the eight angles of TURN."""
    c = np.fft.fft(values) / 8
    z = np.roots([c[2], c[1], c[0], c[-1], c[-2]] if abs(c[2]) > 1e-12 * abs(c).max() else [c[1], c[0], c[-1]])
    return [float(angle) for angle in np.angle(z[abs(abs(z) - 1) < 1e-6])]


def _on_line(rows: np.ndarray, x: float) -> list[float]:
    """Returns the heights at which ellipses cross an upright line."""
    found: list[float] = []
    for middle, y, a, b, c in rows:
        u = x - middle
        if (square := (b * u) ** 2 - 4 * c * (a * u * u - 1)) > 0:
            found += [y + (sign * np.sqrt(square) - b * u) / (2 * c) for sign in (-1, 1)]
    return found
