"""Volumes of tetrahedra in a cube, degenerate ones too, against rational numbers."""

from __future__ import annotations

import random
from fractions import Fraction

import numpy as np
import pytest

import teg
from teg.program import Gauss, Integrate, statements
from tests.backends.rational_solids import integral
from tests.bench.scenes import tetrahedron

Vertices = list[list[Fraction]]
Plane = tuple[Fraction, Fraction, Fraction, Fraction]
"""a, b, c, d: the half-space a·x + b·y + c·z + d ≥ 0."""

FACES = ((0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2))
ZERO = Fraction(0)


def plane(vertices: Vertices, face: tuple[int, int, int]) -> Plane:
    """The half-space on the inner side of a face."""
    p, q, r = (vertices[i] for i in face)
    u, v = [b - a for a, b in zip(p, q, strict=True)], [b - a for a, b in zip(p, r, strict=True)]
    n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    return n[0], n[1], n[2], -sum((a * b for a, b in zip(n, p, strict=True)), ZERO)


def volume(vertices: Vertices) -> Fraction:
    """The volume in the unit cube."""
    return integral([0, 1] * 3, [plane(vertices, face) for face in FACES])


def tetrahedra(count: int) -> list[Vertices]:
    """Tetrahedra of positive volume, with edges along axes, faces on sides of the cube, and vertices nearly there."""
    rng = random.Random(7)
    made: list[Vertices] = []
    while len(made) < count:
        step, nearly = Fraction(1, rng.choice((1, 2, 4))), Fraction(rng.choice((0.0, 0.0, 1e-9, -1e-12, 1e-15)))
        vertices = [[rng.randint(-2, 6) * step + nearly * rng.randint(0, 1) for _ in range(3)] for _ in range(4)]
        vertices = [[Fraction(float(c)) for c in v] for v in vertices]
        a, b, c, d = plane(vertices, FACES[0])
        size = a * vertices[3][0] + b * vertices[3][1] + c * vertices[3][2] + d
        if size != 0:
            made.append(vertices if size > 0 else [*vertices[:2], vertices[3], vertices[2]])
    return made


@pytest.mark.parametrize(("backend", "count"), [("c", 400), ("numpy", 100)])
def test_tetrahedra_in_a_cube(backend: str, count: int) -> None:
    check(backend, tetrahedra(count))


@pytest.mark.slow
@pytest.mark.usefixtures("x64")
def test_tetrahedra_in_a_cube_in_jax() -> None:
    check("jax", tetrahedra(20))


def check(backend: str, scenes: list[Vertices]) -> None:
    """Compares the volumes of one batch with the exact ones."""
    e, parameters = tetrahedron()
    f = teg.compile(e, parameters, backend=backend)
    flat = np.array([[float(c) for vertex in v for c in vertex] for v in scenes])
    values = f({p.name: flat[:, i] for i, p in enumerate(parameters)})
    np.testing.assert_allclose(values, [float(volume(v)) for v in scenes], rtol=0, atol=1e-14)


def test_slices_of_polytopes_are_quadratic_between_breaks() -> None:
    e, parameters = tetrahedron()
    program = teg.compile(e, parameters, backend="numpy", intrinsics=False).program(0)
    rules = [s.rule for s in statements(program.body) if isinstance(s, Integrate)]
    assert rules[0] == Gauss(2)
