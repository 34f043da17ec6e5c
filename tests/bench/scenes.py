"""Programs that are timed and counted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import teg
from teg import Cond, Expr
from teg.ir.expr import Param


def triangle_pixel(order: int = 1) -> tuple[Expr, list[Param]]:
    """∫ over a pixel of [in the triangle]·Σ_k (colour_k - target_k)², colours constant (order 0), linear (1) or quadratic (2); the triangle
    is counterclockwise.

    Returns the loss and the parameters to differentiate by: six coordinates, then 3 colours, or 9, or 18 (those of the vertices, then those
    of the middles of the sides 01, 12, 20).
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
        area = edges[0] + edges[1] + edges[2]
        weights = [e / area for e in edges]
        if order == 2:
            sides = [4 * weights[i] * weights[(i + 1) % 3] for i in range(3)]
            weights = [w * (2 * w - 1) for w in weights] + sides
        colours = [teg.param(f"c{i}{k}") for i in range(len(weights)) for k in range(3)]
        residuals = [sum((w * colours[3 * i + k] for i, w in enumerate(weights)), start=0 * x) - target[k] for k in range(3)]
    loss = teg.bracket(inside) * sum((r * r for r in residuals), start=0 * x)
    wrt = [p for pair in zip(vx, vy, strict=True) for p in pair] + colours
    return teg.integral(loss, (x, lo_x, hi_x), (y, lo_y, hi_y)), wrt


def picture(listed: bool = False) -> tuple[Expr, list[Any]]:
    """The loss of a whole picture: Σ over faces k and the pixels of their boxes of `triangle_pixel`, linear colours.

    Arrays: vertices V (nv, 2), faces F (m, 3), colours C (m, 9), picture T (rows, columns, 3), and boxes B (m, 4): columns from … to, and
    rows from … to. A `listed` one has pairs P (n, 3) instead, face, column and row, and is one sum over these.
    Returns the loss and V and C, to differentiate by.
    """
    x, y = teg.vars("x y")
    vertices, colours, target = teg.array("V", 2), teg.array("C", 2), teg.array("T", 3)
    faces, boxes, pairs = teg.indices("F", 2), teg.indices("B", 2), teg.indices("P", 2)
    pair, face, column, row = teg.index("n"), teg.index("k"), teg.index("i"), teg.index("j")
    at = (pairs[pair, 0], pairs[pair, 1], pairs[pair, 2]) if listed else (face, column, row)
    corners = [(vertices[faces[at[0], i], 0], vertices[faces[at[0], i], 1]) for i in range(3)]

    def edge(i: int, j: int) -> Expr:
        (ax, ay), (bx, by) = corners[i], corners[j]
        return (bx - ax) * (y - ay) - (by - ay) * (x - ax)

    edges = [edge(1, 2), edge(2, 0), edge(0, 1)]
    area = edges[0] + edges[1] + edges[2]
    inside = (edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0)
    residuals = [
        sum((e / area * colours[at[0], 3 * i + k] for i, e in enumerate(edges)), start=0 * x) - target[at[2], at[1], k] for k in range(3)
    ]
    loss = teg.bracket(inside) * sum((r * r for r in residuals), start=0 * x)
    pixel = teg.integral(loss, (x, at[1], at[1] + 1), (y, at[2], at[2] + 1))
    if listed:
        return teg.sum(pixel, (pair, 0, teg.length(pairs, 0))), [vertices, colours]
    columns, rows = (column, boxes[face, 0], boxes[face, 1]), (row, boxes[face, 2], boxes[face, 3])
    return teg.sum(pixel, columns, rows, (face, 0, teg.length(faces, 0))), [vertices, colours]


def bilinear_pixel() -> tuple[Expr, list[Param]]:
    """∫ over [0, 1]² of Σ_k (colour_k - target_k)², the colour being `above` where corner values, interpolated, exceed t, else `below`.

    Returns the loss and the parameters to differentiate by: the values at (0, 0), (1, 0), (0, 1), (1, 1), t, and both colours.
    """
    x, y = teg.vars("x y")
    corners, t = teg.params("c00 c10 c01 c11"), teg.param("t")
    above, below, target = ([teg.param(f"{name}{k}") for k in range(3)] for name in ("above", "below", "target"))
    value = (corners[0] * (1 - x) + corners[1] * x) * (1 - y) + (corners[2] * (1 - x) + corners[3] * x) * y

    def difference(colour: list[Param]) -> Expr:
        return sum(((u - v) ** 2 for u, v in zip(colour, target, strict=True)), start=0 * x)

    loss = teg.where(value > t, difference(above), difference(below))
    return teg.integral(loss, (x, 0, 1), (y, 0, 1)), [*corners, t, *above, *below]


def ball_in_four() -> tuple[Expr, list[Param]]:
    """The volume of a ball in four variables."""
    variables, t = teg.vars("x y z w"), teg.param("t")
    inside = teg.bracket(sum((v * v for v in variables), start=0 * variables[0]) < t)
    return teg.integral(inside, *((v, -1, 1) for v in variables)), [t]


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


def ball_across_sides() -> tuple[Expr, list[Param]]:
    """The volume of a ball in a cube, some sides of which cut it."""
    x, y, z = teg.vars("x y z")
    t, a, b = teg.params("t a b")
    return teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 + z * z < t), (x, -1, 1), (y, -1, 1), (z, -1, 1)), [t, a, b]


TETRAHEDRON = {"v0x": -0.3, "v0y": -0.2, "v0z": -0.1, "v1x": 1.3, "v1y": 0.2, "v1z": 0.1}
TETRAHEDRON |= {"v2x": 0.2, "v2y": 1.4, "v2z": 0.05, "v3x": 0.3, "v3y": 0.2, "v3z": 1.2}
"""A tetrahedron that all sides of the unit cube cut but one."""


def tetrahedron() -> tuple[Expr, list[Param]]:
    """The volume of a tetrahedron in the unit cube, by its vertices."""
    x, y, z = teg.vars("x y z")
    vertices = [[teg.param(f"v{i}{axis}") for axis in "xyz"] for i in range(4)]
    inside = inside_tetrahedron(vertices, (x, y, z))
    return teg.integral(teg.bracket(inside), (x, 0, 1), (y, 0, 1), (z, 0, 1)), [p for vertex in vertices for p in vertex]


def inside_tetrahedron(vertices: Sequence[Sequence[Expr]], at: Sequence[Expr]) -> Cond:
    """Whether a place is inside: above each face, whose vertices are counterclockwise from there."""

    def above(i: int, j: int, k: int) -> Expr:
        p, q, r = vertices[i], vertices[j], vertices[k]
        u, v = ([b - a for a, b in zip(p, other, strict=True)] for other in (q, r))
        normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        return normal[0] * (at[0] - p[0]) + normal[1] * (at[1] - p[1]) + normal[2] * (at[2] - p[2])

    return (above(0, 1, 2) > 0) & (above(0, 3, 1) > 0) & (above(0, 2, 3) > 0) & (above(1, 3, 2) > 0)


def cut_cells(power: int = 2) -> tuple[Expr, list[Any]]:
    """The volumes of a tetrahedron in the cells of a grid, to a power, together; by its vertices V (4, 3). The number of cells along each
    side is the length of N."""
    x, y, z = teg.vars("x y z")
    i, j, k = teg.index("cell_i"), teg.index("cell_j"), teg.index("cell_k")
    vertices, cells = teg.array("V", 2), teg.length(teg.array("N"))
    inside = inside_tetrahedron([[vertices[v, axis] for axis in range(3)] for v in range(4)], (x, y, z))
    share = teg.integral(teg.bracket(inside), (x, i, i + 1), (y, j, j + 1), (z, k, k + 1))
    return teg.sum(share**power, (k, 0, cells), (j, 0, cells), (i, 0, cells)), [vertices]


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


def shaded_brackets(n: int, swaps: int, inline: bool | None = None) -> list[tuple[str, Expr, list[Param]]]:
    """∫₀¹ Σᵢ [x < tᵢ]·shade(x, tᵢ) dx with n brackets, its shader swapped so many times: name, expression and n + 1 parameters of each."""
    x, (u, v), k = teg.var("x"), teg.params("u v"), teg.param("k")
    ts = [teg.param(f"t{i}") for i in range(n)]
    bodies = [
        teg.sin(3 * u) * k + v,
        teg.cos(u * v) - k * u,
        teg.tanh(k * u - v) * v,
        teg.exp(k * u) + u * v**3,
        k * u / (1 + v * v + u * u),
        teg.sin(u + k) ** 2 * teg.cos(2 * v),
    ]
    scenes = []
    for i in range(swaps + 1):
        shade = teg.function(f"shader {i}", [u, v], bodies[i % len(bodies)] * (1 + i // len(bodies)), inline=inline)
        scenes.append((f"shader {i}", teg.integral(sum((teg.bracket(x < t) * shade(x, t) for t in ts), start=0 * x), (x, 0, 1)), [*ts, k]))
    return scenes
