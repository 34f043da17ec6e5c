"""A triangle drawn with one sample a pixel, as the rasterisers draw it whose derivatives `opendr` and `nmr` are.

The picture is the unit square in n × n pixels, with the sample in the middle of each; row 0 is at y = 0. A colour is linear between the
corners, and the background has one colour. Its exact counterpart, the mean of the colour over each pixel, is an integral (`exact`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

import teg
from teg.evaluator.evaluator import Evaluator

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Picture:
    """A drawn triangle: `image` (n, n); `weights` (n, n, 3), the barycentric coordinates of each pixel; `inside` (n, n)."""

    corners: Array
    image: Array
    weights: Array
    inside: Mask


def pixels(n: int) -> tuple[Array, Array]:
    """Returns x and y of the middles of the pixels, (n, n) each."""
    middles = (np.arange(n) + 0.5) / n
    x, y = np.meshgrid(middles, middles)
    return x, y


def barycentric(corners: Array, x: Array, y: Array) -> Array:
    """Returns the coordinates of points by the corners (3, 2) of a triangle, on the last axis."""
    a, b, c = corners
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    first = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
    second = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
    return np.stack([first, second, 1 - first - second], axis=-1)


def drawn(corners: Array, colours: Array, background: float, n: int) -> Picture:
    """Returns the picture of a triangle with colours (3,) at its corners (3, 2)."""
    weights = barycentric(corners, *pixels(n))
    inside = np.asarray(weights.min(axis=-1) >= 0)
    return Picture(corners, np.where(inside, weights @ colours, background), weights, inside)


@cache
def exact() -> Evaluator:
    """Returns the mean colour of the pixel [left, left + size] × [low, low + size], with its derivatives by the corners V (3, 2)."""
    x, y = teg.vars("x y")
    left, low, size, background = (teg.param(name) for name in ("left", "low", "size", "background"))
    V, C = teg.array("V", 2), teg.array("C")

    def across(i: int, j: int) -> teg.Expr:
        return (V[j, 0] - V[i, 0]) * (y - V[i, 1]) - (V[j, 1] - V[i, 1]) * (x - V[i, 0])

    area = (V[1, 0] - V[0, 0]) * (V[2, 1] - V[0, 1]) - (V[1, 1] - V[0, 1]) * (V[2, 0] - V[0, 0])
    parts = [across(1, 2), across(2, 0), across(0, 1)]
    colour = (C[0] * parts[0] + C[1] * parts[1] + C[2] * parts[2]) / area
    seen = teg.where((parts[0] > 0) & (parts[1] > 0) & (parts[2] > 0), colour, background)
    return teg.compile(teg.integral(seen, (x, left, left + size), (y, low, low + size)) / size**2, [V])


def exact_slopes(corners: Array, colours: Array, background: float, n: int) -> Array:
    """Returns the derivatives of the pixels' mean colours by the corners, (n, n, 3, 2). The triangle turns to the left."""
    x, y = pixels(n)
    half = 0.5 / n
    values = {"left": x.ravel() - half, "low": y.ravel() - half, "size": 1 / n, "background": background}
    slopes = exact().grad(V=np.broadcast_to(corners, (n * n, 3, 2)), C=np.broadcast_to(colours, (n * n, 3)), **values)["V"]
    return np.asarray(slopes).reshape(n, n, 3, 2)
