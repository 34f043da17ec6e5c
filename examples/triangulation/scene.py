"""The program: squared colour difference between a picture and triangles, summed over all pixels under all triangles.

    loss = 1/pixels Σ_faces weight Σ_rows Σ_columns ∫∫_pixel [(x, y) inside the face] · Σₖ (colourₖ(x, y) - targetₖ)² dx dy

The colour of a triangle is a polynomial of degree 0, 1 or 2 in the place, written in coordinates u, v whose origin and unit are the
triangle's own anchor. The weights are 1: the derivative by a weight is the loss of that triangle.

This is the complete statement of the problem. The compiler makes the derivative by the vertices (boundary integrals along the edges,
which automatic differentiation of a rendered picture does not have) and the derivative by the colours. It also makes the loops, decides
which values are computed once a face and once a row, and where derivatives are added.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.treatments import compiled
from teg.ir.expr import Cond, Expr
from teg.ir.index import Index

VERTICES = teg.array("vertices", 2)  # (n, 2)
COLOURS = teg.array("colours", 2)  # (m, 3·terms): red, green and blue of the first monomial, then of the second, …
WEIGHTS = teg.array("weights")  # (m,)
ANCHORS = teg.array("anchors", 2)  # (m, 3): x and y of the origin, and 1/unit
TARGET = teg.array("target", 3)  # (rows, columns, 3)
FACES = teg.indices("faces", 2)  # (m, 3), in positive order
BOXES = teg.indices("boxes", 2)  # (m, 4): first and end column, first and end row of the pixels that a face may touch


def monomials(u: Any, v: Any, degree: int) -> list[Any]:
    """Returns all monomials up to a degree: 1; u, v; u², uv, v²."""
    return [1] + [u, v] * (degree > 0) + ([u * u, u * v, v * v] if degree > 1 else [])


def pixel_loss(face: Index, column: Index, row: Index, degree: int = 0) -> Expr:
    """Returns the loss of one triangle on one pixel of side 1."""
    x, y = teg.vars("x y")
    corners = [(VERTICES[FACES[face, c], 0], VERTICES[FACES[face, c], 1]) for c in range(3)]
    u, v = ((z - ANCHORS[face, n]) * ANCHORS[face, 2] for n, z in enumerate((x, y)))
    terms = monomials(u, v, degree)

    def colour(k: int) -> Expr:
        total: Expr = sum(COLOURS[face, 3 * j + k] * term for j, term in enumerate(terms))
        return total

    difference = sum((colour(k) - TARGET[row, column, k]) ** 2 for k in range(3))

    def left_of(a: tuple[Expr, Expr], b: tuple[Expr, Expr]) -> Cond:
        return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0

    a, b, c = corners
    inside = left_of(a, b) & left_of(b, c) & left_of(c, a)
    return teg.integral(teg.where(inside, difference, 0), (x, column, column + 1), (y, row, row + 1))


def picture_loss(degree: int = 0) -> Expr:
    """Returns the loss of a whole picture, per pixel."""
    face, column, row = teg.index("face"), teg.index("column"), teg.index("row")
    columns, rows = (column, BOXES[face, 0], BOXES[face, 1]), (row, BOXES[face, 2], BOXES[face, 3])
    of_face = teg.sum(pixel_loss(face, column, row, degree), columns, rows)
    return per_pixel(teg.sum(WEIGHTS[face] * of_face, (face, 0, teg.length(FACES, 0))))


def per_pixel(total: Expr) -> Expr:
    """Returns a sum over pixels, divided by the number of pixels."""
    pixels: Index = teg.length(TARGET, 0) * teg.length(TARGET, 1)
    return total / pixels


@dataclass(frozen=True)
class CompiledScene:
    """The loss, to be differentiated by the vertices, and to be differentiated by colours and weights."""

    by_vertices: Evaluator
    by_colours: Evaluator
    backend: Backend
    degree: int
    threads: int = 1

    @cached_property
    def by_both(self) -> Evaluator:
        """Returns the program, compiled for second derivatives by vertices and colours."""
        return teg.compile(picture_loss(self.degree), [VERTICES, COLOURS], backend=self.backend, threads=self.threads)


def compile_scene(backend: Backend, discontinuities: Discontinuities = "exact", threads: int = 1, degree: int = 0) -> CompiledScene:
    """Returns the program, compiled for both."""
    loss = picture_loss(degree)
    return CompiledScene(
        compiled(loss, [VERTICES], backend, discontinuities, threads=threads),
        teg.compile(loss, [COLOURS, WEIGHTS], backend=backend, threads=threads),
        backend,
        degree,
        threads,
    )
