"""The neural mesh renderer: a colour that jumps when an edge passes a pixel is taken to change linearly from here to there.

rule       an edge crosses a row of pixels at e; pixel p of the row has the colour I_p, and takes the colour I_q from beyond the edge
           when the edge has moved by p - e. In between a ramp:  ∂L/∂e = Σ_p δ_p·(I_q - I_p)/(p - e),   δ_p = ∂L/∂I_p
gate       only pixels for which that motion lowers the loss count: δ_p·(I_q - I_p) < 0
pixels     outside: those from the edge to the end of the row, which the inside's colour at the edge would cover; inside: those
           from the edge to where the row leaves the triangle, which the outside's colour would uncover
vertices   e = (1 - s)·v₀ + s·v₁: each end takes its share; rows give the derivatives by x, columns those by y
bias       it is no derivative of the picture: far pixels count by 1/distance, so that it does not converge to the exact one with
           more pixels, and where no pixel would gain it is 0
variance   none
source     Kato, Ushiku and Harada 2018, "Neural 3D mesh renderer" (arXiv 2017), section 3, and the rasteriser of their package, from
           which the pixels that count and the smallest distance are
"""

from __future__ import annotations

import numpy as np

from teg.examples.estimators.raster import Array, Mask, Picture

EPSILON = 1e-4
"""What is added to a distance, so that none is 0."""


def loss_slopes(picture: Picture, slopes: Array) -> Array:
    """Returns the derivatives of a loss by the corners, (3, 2), from those by the pixels (n, n)."""
    found = np.zeros((3, 2))
    for axis in range(2):
        image, by = (a.T if axis else a for a in (picture.image, slopes))
        inside = picture.inside.T if axis else picture.inside
        corners = picture.corners[:, ::-1] if axis else picture.corners
        for i in range(3):
            _edge(found[:, axis], corners, i, image, inside, by)
    return found


def _edge(found: Array, corners: Array, i: int, image: Array, inside: Mask, slopes: Array) -> None:
    """Adds the derivatives by the first coordinate of both ends of edge i, from the rows that it crosses."""
    n, j = len(image), (i + 1) % 3
    (x0, y0), (x1, y1) = corners[i], corners[j]
    for row in range(n):
        height = (row + 0.5) / n
        if (height - y0) * (height - y1) >= 0:
            continue
        s = (height - y0) / (y1 - y0)
        crossing = (1 - s) * x0 + s * x1
        below = int(np.floor(crossing * n - 0.5))  # the last pixel on the left of the edge
        if not 0 <= below < n - 1 or inside[row, below] == inside[row, below + 1]:
            continue
        rate = _row(image[row], inside[row], slopes[row], below, crossing)
        found[i] += (1 - s) * rate
        found[j] += s * rate


def _row(image: Array, inside: Mask, slopes: Array, below: int, crossing: float) -> float:
    """Returns Σ δ_p·(I_q - I_p)/(p - e) over the pixels of a row that count."""
    n = len(image)
    left, right = np.arange(below, -1, -1), np.arange(below + 1, n)
    total = 0.0
    for covered, beyond in ((left, below + 1), (right, below)):
        if inside[covered[0]]:  # until the row leaves the triangle
            leaves = np.flatnonzero(~inside[covered])
            covered = covered[: leaves[0]] if len(leaves) else covered
        gain = slopes[covered] * (image[beyond] - image[covered])
        distance = (covered + 0.5) / n - crossing
        distance = distance + np.where(distance > 0, EPSILON, -EPSILON)
        total += float(np.sum(np.where(gain < 0, gain / distance, 0.0)))
    return total
