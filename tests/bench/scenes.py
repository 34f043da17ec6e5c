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


def disk() -> tuple[Expr, list[Param]]:
    """∫∫ [(x - a)² + (y - b)² < t]·(1 + x/2) over a square: three parameters."""
    x, y = teg.vars("x y")
    t, a, b = teg.params("t a b")
    return teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 < t) * (1 + 0.5 * x), (x, -1, 1), (y, -1, 1)), [t, a, b]


def superellipse() -> tuple[Expr, list[Param]]:
    """∫∫ [x⁴ + a·y⁴ < t] over a square."""
    x, y = teg.vars("x y")
    t, a = teg.params("t a")
    return teg.integral(teg.bracket(x**4 + a * y**4 < t), (x, -1, 1), (y, -1, 1)), [t, a]


def heart() -> tuple[Expr, list[Param]]:
    """The area of (x² + y² - t)³ < x²·y³, roots isolated at run time."""
    x, y = teg.vars("x y")
    t = teg.param("t")
    return teg.integral(teg.bracket((x * x + y * y - t) ** 3 < x**2 * y**3), (x, -1.4, 1.4), (y, -1.4, 1.4)), [t]


def sphere() -> tuple[Expr, list[Param]]:
    """The volume of a ball, three integrals inside each other."""
    x, y, z = teg.vars("x y z")
    t = teg.param("t")
    return teg.integral(teg.bracket(x * x + y * y + z * z < t), (x, -1, 1), (y, -1, 1), (z, -1, 1)), [t]


def distances(n: int) -> tuple[Expr, list[Param]]:
    """∫₀¹ [Σᵢ |x - cᵢ| < r] dx: one condition with n kinks, n + 1 parameters."""
    x, r = teg.var("x"), teg.param("r")
    centres = [teg.param(f"c{i}") for i in range(n)]
    return teg.integral(teg.bracket(sum((teg.abs(x - c) for c in centres), start=0 * x) < r), (x, 0, 1)), [r, *centres]


def nested_sines(n: int) -> Expr:
    """An expression of n nodes, n/2 deep: sin(sin(…) + t)."""
    t = teg.param("t")
    e: Expr = t
    for _ in range(n // 2):
        e = teg.sin(e) + t
    return e


def squares(n: int) -> Expr:
    """e² + 1 of itself, n times: 2ⁿ terms if it were written out."""
    e: Expr = teg.param("t")
    for _ in range(n):
        e = e * e + 1
    return e
