"""Unions of disks over the unit square, by slices and by arcs, in NumPy alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

Function = Callable[..., np.ndarray]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def integral_over_union(disks: np.ndarray, f: Function) -> float:
    """∫∫ f over the union, by slices of y between all heights at which the union changes its shape."""
    total = 0.0
    for p, q in pairwise(np.unique(np.clip([0.0, 1.0, *_heights(disks)], 0.0, 1.0))):
        u = 0.5 * (NODES + 1)  # both ends may be like square roots
        for height, weight in zip(p + (q - p) * u * u * (3 - 2 * u), (q - p) * 3 * u * (1 - u) * WEIGHTS, strict=True):
            for left, right in _covered(disks, height):
                places = left + (right - left) * u
                total += weight * 0.5 * (right - left) * float(WEIGHTS @ f(places, height))
    return total


def slopes_of_union(disks: np.ndarray, f: Function) -> np.ndarray:
    """The derivatives of that integral by centres and radii: f times the velocity of the border, over the arcs that are seen."""
    found = np.zeros_like(disks)
    for k, (a, b, r) in enumerate(disks):
        for p, q in pairwise(np.unique(_angles(disks, k))):
            x, y = a + r * np.cos(0.5 * (p + q)), b + r * np.sin(0.5 * (p + q))
            hidden = [(x - c) ** 2 + (y - d) ** 2 < s * s for j, (c, d, s) in enumerate(disks) if j != k]
            if any(hidden) or not (0 < x < 1 and 0 < y < 1):
                continue
            angle = 0.5 * (p + q + (q - p) * NODES)
            along = 0.5 * (q - p) * r * WEIGHTS * f(a + r * np.cos(angle), b + r * np.sin(angle))
            found[k] += [along @ np.cos(angle), along @ np.sin(angle), along.sum()]
    return found


def _covered(disks: np.ndarray, height: float) -> Iterator[tuple[float, float]]:
    """Yields the intervals of a slice that are in the union, ascending."""
    half = np.sqrt(np.maximum(disks[:, 2] ** 2 - (height - disks[:, 1]) ** 2, 0.0))
    end = 0.0
    for left, right in sorted(zip(disks[:, 0] - half, disks[:, 0] + half, strict=True)):
        left, right = max(left, end), min(right, 1.0)
        if right > left:
            yield left, right
            end = right


def _heights(disks: np.ndarray) -> Iterator[float]:
    for k, (a, b, r) in enumerate(disks):
        yield from (b - r, b + r)
        for side in (0.0, 1.0):
            if abs(side - a) < r:
                yield from (b - np.sqrt(r * r - (side - a) ** 2), b + np.sqrt(r * r - (side - a) ** 2))
        for c, d, s in disks[:k]:
            apart = np.hypot(c - a, d - b)
            if abs(r - s) < apart < r + s:
                along = (apart**2 + r * r - s * s) / (2 * apart)
                across = np.sqrt(max(r * r - along**2, 0.0))
                yield from (b + (along * (d - b) + sign * across * (c - a)) / apart for sign in (1, -1))


def _angles(disks: np.ndarray, k: int) -> list[float]:
    (a, b, r), found = disks[k], [-np.pi, np.pi]
    for side in (0.0, 1.0):
        if abs(side - a) < r:
            found += [np.arccos((side - a) / r), -np.arccos((side - a) / r)]
        if abs(side - b) < r:
            found += [np.arcsin((side - b) / r), np.pi - np.arcsin((side - b) / r)]
    for j, (c, d, s) in enumerate(disks):
        apart = np.hypot(c - a, d - b)
        if j != k and abs(r - s) < apart < r + s:
            half = np.arccos((apart**2 + r * r - s * s) / (2 * apart * r))
            found += [np.arctan2(d - b, c - a) + half, np.arctan2(d - b, c - a) - half]
    return [(angle + np.pi) % (2 * np.pi) - np.pi if abs(angle) > np.pi else angle for angle in found]


# -- disks with depths and colours, the nearest one seen ---------------------------------------------------------------


def integral_of_layers(disks: np.ndarray, depths: np.ndarray, colours: np.ndarray, ground: float) -> float:
    """∫∫ of the colour of the nearest disk, by the same slices."""
    total = 0.0
    for p, q in pairwise(np.unique(np.clip([0.0, 1.0, *_heights(disks)], 0.0, 1.0))):
        u = 0.5 * (NODES + 1)
        for height, weight in zip(p + (q - p) * u * u * (3 - 2 * u), (q - p) * 3 * u * (1 - u) * WEIGHTS, strict=True):
            half = np.sqrt(np.maximum(disks[:, 2] ** 2 - (height - disks[:, 1]) ** 2, 0.0))
            ends = np.unique(np.clip([0.0, 1.0, *(disks[:, 0] - half), *(disks[:, 0] + half)], 0.0, 1.0))
            for left, right in pairwise(ends):
                total += weight * (right - left) * _seen_at(0.5 * (left + right), height, disks, depths, colours, ground)
    return total


def slopes_of_layers(disks: np.ndarray, depths: np.ndarray, colours: np.ndarray, ground: float) -> np.ndarray:
    """The derivatives of that integral by centres and radii: over the arcs that are seen, the colour less the one behind."""
    found = np.zeros_like(disks)
    for k, (a, b, r) in enumerate(disks):
        others = np.arange(len(disks)) != k
        for p, q in pairwise(np.unique(_angles(disks, k))):
            x, y = a + r * np.cos(0.5 * (p + q)), b + r * np.sin(0.5 * (p + q))
            before = depths < depths[k]
            front = _seen_at(x, y, disks[before], depths[before], colours[before], np.nan)
            if not np.isnan(front) or not (0 < x < 1 and 0 < y < 1):
                continue
            step = colours[k] - _seen_at(x, y, disks[others], depths[others], colours[others], ground)
            found[k] += r * step * np.array([np.sin(q) - np.sin(p), np.cos(p) - np.cos(q), q - p])
    return found


def _seen_at(x: float, y: float, disks: np.ndarray, depths: np.ndarray, colours: np.ndarray, ground: float) -> float:
    inside = (x - disks[:, 0]) ** 2 + (y - disks[:, 1]) ** 2 < disks[:, 2] ** 2
    return float(colours[inside][np.argmin(depths[inside])]) if inside.any() else ground
