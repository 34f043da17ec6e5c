"""Programs that are timed and counted."""

from __future__ import annotations

import teg
from teg import Expr
from teg.expr import Param


def triangle_pixel(order: int = 1) -> tuple[Expr, list[Param]]:
    """∫ over a pixel of [in the triangle]·Σ_k (colour_k - target_k)², colours constant (order 0) or linear (1); counterclockwise.

    Returns the loss and the parameters to differentiate by: six coordinates, then three or nine colours.
    """
    x, y = teg.vars("x y")
    vx, vy = [teg.param(f"x{i}") for i in range(3)], [teg.param(f"y{i}") for i in range(3)]
    lo_x, hi_x, lo_y, hi_y = teg.params("left right bottom top")
    target = [teg.param(f"t{k}") for k in range(3)]

    def edge(i: int, j: int) -> Expr:
        return (vx[j] - vx[i]) * (y - vy[i]) - (vy[j] - vy[i]) * (x - vx[i])

    edges = [edge(1, 2), edge(2, 0), edge(0, 1)]
    inside = (edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0)
    if order == 0:
        colours = [teg.param(f"c{k}") for k in range(3)]
        residuals = [colours[k] - target[k] for k in range(3)]
    else:
        colours = [teg.param(f"c{i}{k}") for i in range(3) for k in range(3)]
        area = edges[0] + edges[1] + edges[2]
        weights = [e / area for e in edges]
        residuals = [sum((weights[i] * colours[3 * i + k] for i in range(3)), start=0 * x) - target[k] for k in range(3)]
    loss = teg.bracket(inside) * sum((r * r for r in residuals), start=0 * x)
    wrt = [p for pair in zip(vx, vy, strict=True) for p in pair] + colours
    return teg.integral(loss, (x, lo_x, hi_x), (y, lo_y, hi_y)), wrt


def heavisides(n: int) -> tuple[Expr, list[Param]]:
    """∫₀¹ Σᵢ [x < tᵢ] dx, n parameters."""
    x = teg.var("x")
    ts = [teg.param(f"t{i}") for i in range(n)]
    return teg.integral(sum((teg.bracket(x < t) for t in ts), start=0 * x), (x, 0, 1)), ts


def half_planes(n: int) -> tuple[Expr, list[Param]]:
    """The area of a product of n half-planes in the unit square, 3n parameters."""
    x, y = teg.vars("x y")
    body, wrt = 1 + 0 * x, []
    for i in range(n):
        a, b, c = teg.params(f"a{i} b{i} c{i}")
        body = body * teg.bracket(a * x + b * y < c)
        wrt += [a, b, c]
    return teg.integral(body, (x, 0, 1), (y, 0, 1)), wrt
