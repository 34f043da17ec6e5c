"""The program: squared colour difference between a picture and triangles, summed over all pixels under all triangles.

    loss = 1/size² Σ_faces Σ_rows Σ_columns ∫∫_pixel [(x, y) inside the face] · Σₖ (colourₖ - targetₖ)² dx dy

This is the complete statement of the problem. The compiler makes the derivative by the vertices (boundary integrals along the edges,
which automatic differentiation of a rendered picture does not have), the derivative by the colours, and the colours' second derivative.
It also makes the loops, decides which values are computed once a face and once a row, and where derivatives are added.
"""

from __future__ import annotations

from dataclasses import dataclass

import teg
from teg.evaluator.evaluator import Evaluator
from teg.ir.expr import Cond, Expr
from teg.ir.index import Index

VERTICES = teg.array("vertices", 2)  # (n, 2)
COLOURS = teg.array("colours", 2)  # (m, 3)
TARGET = teg.array("target", 3)  # (size, size, 3): row, column, channel
FACES = teg.indices("faces", 2)  # (m, 3), in positive order
BOXES = teg.indices("boxes", 2)  # (m, 4): first and end column, first and end row of the pixels that a face may touch


def pixel_loss(face: Index, column: Index, row: Index) -> Expr:
    """Returns the loss of one triangle on one pixel of side 1."""
    x, y = teg.vars("x y")
    corners = [(VERTICES[FACES[face, c], 0], VERTICES[FACES[face, c], 1]) for c in range(3)]
    difference = sum((COLOURS[face, k] - TARGET[row, column, k]) ** 2 for k in range(3))

    def left_of(a: tuple[Expr, Expr], b: tuple[Expr, Expr]) -> Cond:
        return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0

    a, b, c = corners
    inside = left_of(a, b) & left_of(b, c) & left_of(c, a)
    return teg.integral(teg.where(inside, difference, 0), (x, column, column + 1), (y, row, row + 1))


def picture_loss() -> Expr:
    """Returns the loss of a whole picture, per pixel."""
    face, column, row = teg.index("face"), teg.index("column"), teg.index("row")
    columns, rows = (column, BOXES[face, 0], BOXES[face, 1]), (row, BOXES[face, 2], BOXES[face, 3])
    total = teg.sum(pixel_loss(face, column, row), columns, rows, (face, 0, teg.length(FACES, 0)))
    return per_pixel(total)


def per_pixel(total: Expr) -> Expr:
    """Returns a sum over pixels, divided by the number of pixels."""
    pixels: Index = teg.length(TARGET, 0) * teg.length(TARGET, 1)
    return total / pixels


@dataclass(frozen=True)
class CompiledScene:
    """The loss, to be differentiated by the vertices, and to be differentiated by the colours."""

    by_vertices: Evaluator
    by_colours: Evaluator
    backend: str


def compile_scene(backend: str, discontinuities: str = "exact", threads: int = 1) -> CompiledScene:
    """Returns the program, compiled for both."""
    loss = picture_loss()
    return CompiledScene(
        teg.compile(loss, [VERTICES], backend=backend, discontinuities=discontinuities, threads=threads),
        teg.compile(loss, [COLOURS], backend=backend, threads=threads),
        backend,
    )
