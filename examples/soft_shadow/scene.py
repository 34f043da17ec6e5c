"""The integral of a soft shadow: the share of a polygonal light that a point of the ground sees past a mesh.

The light lies in the plane G₀ + u·G₁ + v·G₂, and the domain of integration is this plane. A triangle hides the places whose ray from the
receiver passes through it. With the corners a, b, c and a place d as seen from the receiver, d = α·a + β·b + γ·c, that is

    α > 0,   β > 0,   γ > 0,   α + β + γ > 1 (in front of the light)

and α, β and γ are affine in u and v: the triangle, projected from the receiver onto the plane of the light. `teg.any` is the union.
"""

from __future__ import annotations

from functools import reduce
from operator import and_
from typing import Any

import teg
from teg.ir.expr import Cond, Expr

SIDES = 5
POSE = ("right", "ahead", "up", "turn")

u, v = teg.vars("u v")
RECEIVERS, TARGET = teg.array("Q", 2), teg.array("T")
VERTICES, LIGHT, PLANE = teg.array("P", 2), teg.array("L", 2), teg.array("G", 2)
TICKS = teg.array("E")
F, RANGES, LIST = teg.indices("F", 2), teg.indices("R", 4), teg.indices("I")
i, k, p, q = (teg.index(name) for name in "ikpq")


def cross(a: Any, b: Any) -> Any:
    """Returns a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Any, b: Any) -> Any:
    """Returns a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def placed(point: Any, pose: Any, of: Any) -> Any:
    """Returns a point of the mesh, turned about the vertical and moved, by the functions of a module: `teg` or `numpy`."""
    c, s = of.cos(pose["turn"]), of.sin(pose["turn"])
    return c * point[0] - s * point[1] + pose["right"], s * point[0] + c * point[1] + pose["ahead"], point[2] + pose["up"]


def on_light() -> Cond:
    """Returns whether a place of the plane is on the light, a convex polygon whose corners turn to the left."""
    corners = [(LIGHT[n, 0], LIGHT[n, 1]) for n in range(SIDES)]
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    within: Cond = reduce(and_, ((bx - ax) * (v - ay) - (by - ay) * (u - ax) > 0 for (ax, ay), (bx, by) in sides))
    return within


def hidden() -> Cond:
    """Returns whether triangle k hides a place of the plane from receiver i."""
    pose = {name: teg.param(name) for name in POSE}
    receiver = [RECEIVERS[i, n] for n in range(3)]
    corners = [placed([VERTICES[F[LIST[k], m], n] for n in range(3)], pose, teg) for m in range(3)]
    a, b, c = ([p - q for p, q in zip(corner, receiver, strict=True)] for corner in corners)
    d = [PLANE[0, n] + u * PLANE[1, n] + v * PLANE[2, n] - receiver[n] for n in range(3)]
    volume = dot(cross(a, b), c)
    alpha, beta, gamma = dot(cross(b, c), d) / volume, dot(cross(c, a), d) / volume, dot(cross(a, b), d) / volume
    between: Cond = (alpha > 0) & (beta > 0) & (gamma > 0) & (alpha + beta + gamma > 1)
    return between


def share() -> Expr:
    """Returns the share of the light that receiver i sees; the light lies in the square [-1, 1]² of u and v.

    The square is cut at ticks into tiles with lists of their own: a union costs the square of the number of candidates in a tile.
    """
    tile = (u, TICKS[p], TICKS[p + 1]), (v, TICKS[q], TICKS[q + 1])
    dark = teg.integral(teg.bracket(teg.any(on_light() & hidden(), (k, RANGES[i, q, p, 0], RANGES[i, q, p, 1]))), *tile)
    tiles = teg.length(TICKS) - 1
    light = teg.integral(teg.bracket(on_light()), (u, -1, 1), (v, -1, 1))
    return 1 - teg.sum(dark, (p, 0, tiles), (q, 0, tiles)) / light


def loss() -> Expr:
    """Returns the sum of squares of the differences between the shares and those of a picture T."""
    return teg.sum((share() - TARGET[i]) ** 2, (i, 0, teg.length(TARGET)))
