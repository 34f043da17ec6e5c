"""The integral: squared colour difference between a triangle and a pixel, over the part of the pixel inside it.

    loss(triangle, pixel) = ∫∫_pixel [(x, y) inside the triangle] · Σₖ (colourₖ - targetₖ)² dx dy

This is all that is written about the problem. The derivative by the vertices (boundary integrals along the
edges, which automatic differentiation of a rendered picture does not have), by the colours, and the colours'
second derivative are the compiler's.
"""

from __future__ import annotations

from dataclasses import dataclass

import teg
from teg.compile import Evaluator
from teg.expr import Cond, Expr

VERTICES = ("x0", "y0", "x1", "y1", "x2", "y2")
COLOUR = ("red", "green", "blue")
TARGET = ("target_red", "target_green", "target_blue")
CORNER = ("left", "top")


def pixel_loss() -> Expr:
    """The loss of one (triangle, pixel) pair; the triangle's vertices in positive order, the pixel of side 1."""
    x, y = teg.vars("x y")
    left, top = (teg.param(name) for name in CORNER)
    corners = [tuple(teg.param(name) for name in VERTICES[i : i + 2]) for i in (0, 2, 4)]
    difference = sum((teg.param(c) - teg.param(t)) ** 2 for c, t in zip(COLOUR, TARGET, strict=True))

    def left_of(a: tuple[Expr, ...], b: tuple[Expr, ...]) -> Cond:
        return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0

    a, b, c = corners
    inside = left_of(a, b) & left_of(b, c) & left_of(c, a)
    return teg.integral(teg.where(inside, difference, 0), (x, left, left + 1), (y, top, top + 1))


def colour_equations() -> Expr:
    """(loss, its derivative by each colour channel, its second derivative by any of them) of one pair.

    The loss is quadratic in the colours, with a diagonal and equal second derivative: with these five numbers,
    summed over the pixels of a triangle, one Newton step gives the best colour exactly.
    """
    loss = pixel_loss()
    red, green, blue = (teg.param(name) for name in COLOUR)
    slopes = (teg.diff(loss, channel) for channel in (red, green, blue))
    return teg.tuple(loss, *slopes, teg.diff(teg.diff(loss, red), red))


@dataclass(frozen=True)
class CompiledScene:
    """The two compiled programs of the optimisation, each a function over a batch of (triangle, pixel) pairs."""

    loss: Evaluator
    colours: Evaluator
    backend: str


def compile_scene(backend: str, discontinuities: str = "sift", threads: int = 1) -> CompiledScene:
    """Compile the loss (to be differentiated by the vertices) and the equations of the best colours."""
    vertices = [teg.param(name) for name in VERTICES]
    return CompiledScene(
        teg.compile(pixel_loss(), vertices, backend=backend, discontinuities=discontinuities, threads=threads),
        teg.compile(colour_equations(), [], backend=backend, threads=threads),
        backend,
    )
