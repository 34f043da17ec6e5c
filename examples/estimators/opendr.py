"""OpenDR: the derivative of a picture by the places of vertices, from differences between its pixels.

rule       pixel p of a triangle moves with the mean of its vertices' motion by barycentric weights:  ∂I_p/∂v_k = -b_k(p)·∇I(p)
∇I         away from silhouettes: the mean of the differences to those neighbours that are no silhouette pixels;
           on a silhouette: the central difference of the whole picture, doubled, because a step spreads over two pixels and the line
           of silhouette pixels is one wide. Its pixels belong to the two ends of the edge
bias       the picture is differentiated, not the scene: exact for linear colours inside; on a silhouette right only where both
           neighbours show the two sides. A feature thinner than two pixels has neighbours of one colour, hence no derivative; the
           derivative does not change while the edge moves within a pixel
variance   none
source     Loper and Black 2014, "OpenDR: an approximate differentiable renderer", section 4, and their package for
           the neighbours that are left out and for the doubling
"""

from __future__ import annotations

import numpy as np

from teg.examples.estimators.raster import Array, Mask, Picture, pixels


def image_slopes(picture: Picture) -> Array:
    """Returns the derivatives of the pixels by the corners, (n, n, 3, 2)."""
    border, weights = silhouette(picture)
    steps = np.stack([_slopes_along(picture.image, border, axis) for axis in (1, 0)], axis=-1)
    moved = np.where(border[..., None], weights, picture.weights * picture.inside[..., None])
    return -moved[..., :, None] * steps[..., None, :]


def silhouette(picture: Picture) -> tuple[Mask, Array]:
    """Returns the pixels of lines one pixel wide along the edges, and the weights of the corners in each, (n, n, 3)."""
    n = len(picture.image)
    x, y = pixels(n)
    border, weights = np.zeros((n, n), dtype=bool), np.zeros((n, n, 3))
    for i in range(3):
        j = (i + 1) % 3
        (x0, y0), (x1, y1) = picture.corners[i], picture.corners[j]
        across, along, a0, a1, l0, l1 = (x, y, x0, x1, y0, y1) if abs(y1 - y0) >= abs(x1 - x0) else (y, x, y0, y1, x0, x1)
        s = (along - l0) / (l1 - l0)
        on = (s >= 0) & (s <= 1) & (np.abs(across - (a0 + s * (a1 - a0))) <= 0.5 / n)
        border |= on
        weights[on] = 0.0
        weights[on, i], weights[on, j] = 1 - s[on], s[on]
    return border, weights


def _slopes_along(image: Array, border: Mask, axis: int) -> Array:
    """Returns ∂I along an axis, in the units of the square."""
    n = len(image)
    step = np.diff(image, axis=axis)
    usable = ~(border.take(range(n - 1), axis) | border.take(range(1, n), axis))
    pad = [(1, 1) if k == axis else (0, 0) for k in range(2)]
    steps, counts = np.pad(np.where(usable, step, 0.0), pad), np.pad(usable.astype(float), pad)
    total, count = (q.take(range(n), axis) + q.take(range(1, n + 1), axis) for q in (steps, counts))
    whole = np.gradient(image, axis=axis)
    return n * np.where(border | (count == 0), 2 * whole, total / np.maximum(count, 1))
