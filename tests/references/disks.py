"""Unions of disks over the unit square, by slices and by arcs, in NumPy alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

Function = Callable[..., np.ndarray]
Places = float | np.ndarray
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def integral_over_union(disks: np.ndarray, f: Function) -> float:
    """∫∫ f over the union, by slices of y between all heights at which the union changes its shape."""
    total = 0.0
    for p, q in pairwise(np.unique(np.clip([0.0, 1.0, *_heights(disks)], 0.0, 1.0))):
        u = 0.5 * (NODES + 1)  # both ends may be like square roots
        height = (p + (q - p) * u * u * (3 - 2 * u))[:, None]
        left, right = _covered(disks, height)
        places = left[..., None] + (right - left)[..., None] * u
        slices = 0.5 * (right - left) * (f(places, height[..., None]) @ WEIGHTS)
        total += (q - p) * float(3 * u * (1 - u) * WEIGHTS @ slices.sum(axis=1))
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


def _covered(disks: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the ends of intervals, one for each disk and most of them empty, of which the slices at these heights consist."""
    half = np.sqrt(np.maximum(disks[:, 2] ** 2 - (height - disks[:, 1]) ** 2, 0.0))
    left, right = disks[:, 0] - half, np.minimum(disks[:, 0] + half, 1.0)
    order = np.argsort(left, axis=1)
    left, right = np.take_along_axis(left, order, axis=1), np.take_along_axis(right, order, axis=1)
    covered = np.maximum.accumulate(np.maximum(right, 0.0), axis=1)  # up to where the disks before reach
    left[:, 1:] = np.maximum(left[:, 1:], covered[:, :-1])
    left[:, :1] = np.maximum(left[:, :1], 0.0)
    return left, np.maximum(left, right)


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
        height = (p + (q - p) * u * u * (3 - 2 * u))[:, None]
        half = np.sqrt(np.maximum(disks[:, 2] ** 2 - (height - disks[:, 1]) ** 2, 0.0))
        ends = [np.zeros_like(height), np.ones_like(height), disks[:, 0] - half, disks[:, 0] + half]
        ends = np.sort(np.clip(np.concatenate(ends, axis=1), 0.0, 1.0), axis=1)
        seen = _seen_at(0.5 * (ends[:, :-1] + ends[:, 1:]), height, disks, depths, colours, ground)
        total += (q - p) * float(3 * u * (1 - u) * WEIGHTS @ (seen * np.diff(ends, axis=1)).sum(axis=1))
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


def _seen_at(x: Places, y: Places, disks: np.ndarray, depths: np.ndarray, colours: np.ndarray, ground: float) -> np.ndarray:
    """Returns the colours at places, of the shape of x and y."""
    x, y = (np.asarray(at)[..., None] for at in (x, y))
    depth = np.where((x - disks[:, 0]) ** 2 + (y - disks[:, 1]) ** 2 < disks[:, 2] ** 2, depths, np.inf)
    first = np.append(depth, np.full((*depth.shape[:-1], 1), np.inf), axis=-1).argmin(axis=-1)
    return np.where(np.isfinite(depth).any(axis=-1), np.append(colours, ground)[first], ground)
