"""Colours that are polynomials over a triangle: their coordinates, and their products integrated exactly."""

from __future__ import annotations

import numpy as np

from teg.examples.triangulation.scene import monomials

DEGREES = {"constant": 0, "linear": 1, "quadratic": 2}
TERMS = (1, 3, 6)
RIDGE = 1e-13  # relative; a triangle without area has no best colours


def degree_of(colours: np.ndarray) -> int:
    """Returns the degree of colours (m, 3·terms)."""
    return TERMS.index(colours.shape[1] // 3)


def anchors(corners: np.ndarray) -> np.ndarray:
    """Returns the origin of each triangle's coordinates, its centroid, and the reciprocal of their unit, (m, 3); `corners` (m, 3, 2)."""
    x, y = np.ascontiguousarray(corners.transpose(2, 1, 0))  # corners and axes are few: loops over triangles are the quick ones
    centre = [(z[0] + z[1] + z[2]) / 3 for z in (x, y)]
    spread = np.maximum(*(np.abs(z - middle).max(axis=0) for z, middle in zip((x, y), centre, strict=True)))
    return np.column_stack([*centre, 1 / np.where(spread > 0, spread, 1)])


def products(corners: np.ndarray, degree: int) -> np.ndarray:
    """Returns the integrals of the products of any two monomials over each triangle, (m, terms, terms).

    Gauss's rule in the two coordinates of Duffy's map is exact for polynomials.
    """
    points, weights = np.polynomial.legendre.leggauss(degree + 1)
    s, t = (grid.reshape(-1, 1) for grid in np.meshgrid((points + 1) / 2, (points + 1) / 2))
    x, y = np.ascontiguousarray(corners.transpose(2, 1, 0))
    *centre, unit = anchors(corners).T
    u, v = ((z[0] - o + s * (z[1] - z[0]) + s * t * (z[2] - z[1])) * unit for z, o in zip((x, y), centre, strict=True))
    basis = np.stack([term + 0 * u for term in monomials(u, v, degree)])  # (terms, points, m)
    areas = np.abs((x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]))
    share = np.outer(weights, weights).reshape(-1, 1) / 4 * s * areas
    return np.asarray(np.einsum("jpm,kpm->mjk", basis * share, basis))


def least_squares(slopes: np.ndarray, corners: np.ndarray, pixels: int) -> np.ndarray:
    """Returns the change to colours, (m, 3·terms), that minimises the loss of each triangle; `slopes` are its derivatives by them.

    The loss is quadratic in the colours and its second derivative is 2·products/pixels, so one step is exact.
    """
    terms = slopes.shape[1] // 3
    matrix = products(corners, TERMS.index(terms))
    matrix += RIDGE * np.maximum(np.trace(matrix, axis1=1, axis2=2), 1e-300)[:, None, None] * np.eye(terms)
    right = slopes.reshape(-1, terms, 3) * (-pixels / 2)
    return np.asarray(np.linalg.solve(matrix, right)).reshape(slopes.shape)


def colours_at(places: np.ndarray, faces: np.ndarray, corners: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Returns the colours at places (…, 2) of the triangles `faces` (…): (…, 3)."""
    if colours.shape[1] == 3:
        return np.asarray(colours[faces])
    anchor = anchors(corners)[faces]
    u, v = ((places[..., k] - anchor[..., k]) * anchor[..., 2] for k in range(2))
    terms = monomials(u, v, degree_of(colours))
    return np.asarray(sum(colours[faces, 3 * j : 3 * j + 3] * (term + 0 * u)[..., None] for j, term in enumerate(terms)))
