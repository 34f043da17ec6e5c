"""The program: the part of a pixel that a triangle covers, ∫∫_pixel [(x, y) inside the triangle] dx dy, as a function of JAX.

The compiler gets nothing else. A colour is constant on a triangle and a picture on a pixel, so the squared difference of the two,
integrated over the pixel, is this area times a number. The loss of a whole mesh, its best colours and the network in front of it are
ordinary JAX.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import teg
from teg.evaluator.options import Discontinuities
from teg.ir.expr import Cond, Expr

Cover = Callable[[Any], Any]
"""A function from corners of triangles, (…, 3, 2), in the coordinates of one pixel [0, 1]², to the covered areas of the pixel, (…)."""

CORNERS = teg.params("ax ay bx by cx cy")
SAMPLES = 4  # per side of a pixel


def covered_area() -> Expr:
    """Returns the area of [0, 1]² inside the triangle a, b, c, given in positive order; 0 for a triangle that is turned over."""
    x, y = teg.vars("x y")
    ax, ay, bx, by, cx, cy = CORNERS

    def left_of(px: Expr, py: Expr, qx: Expr, qy: Expr) -> Cond:
        return (qx - px) * (y - py) - (qy - py) * (x - px) > 0

    inside = left_of(ax, ay, bx, by) & left_of(bx, by, cx, cy) & left_of(cx, cy, ax, ay)
    return teg.integral(teg.bracket(inside), (x, 0, 1), (y, 0, 1))


def exact_cover(discontinuities: Discontinuities = "exact") -> Cover:
    """Returns the compiled integral and its derivatives. "ignore": with the derivative of plain automatic differentiation."""
    area = teg.jax_function(covered_area(), discontinuities=discontinuities)
    names = [p.name for p in CORNERS]

    def cover(corners: Any) -> Any:
        flat = corners.reshape(*corners.shape[:-2], 6)
        return area({name: flat[..., k] for k, name in enumerate(names)})

    return cover


def sampled_cover(corners: Any) -> Any:
    """Returns the same area in JAX alone, the fraction of SAMPLES² points that is inside: its derivative is 0."""
    import jax.numpy as jnp

    places = (jnp.arange(SAMPLES) + 0.5) / SAMPLES
    x, y = places, places[:, None]

    def left_of(p: Any, q: Any) -> Any:
        px, py, qx, qy = (v[..., k, None, None] for v in (p, q) for k in range(2))
        return (qx - px) * (y - py) - (qy - py) * (x - px) > 0

    a, b, c = (corners[..., k, :] for k in range(3))
    inside = left_of(a, b) & left_of(b, c) & left_of(c, a)
    return jnp.where(inside, 1.0, 0.0).mean(axis=(-2, -1))
