"""Polynomials in absolute coordinates: written by differences, so that a common shift changes nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg.ir.traverse import size
from teg.passes.normalise.origins import with_differences
from tests.bench import scenes

x, y = teg.vars("x y")
VERTICES = [teg.params(f"x{i} y{i}") for i in range(3)]
LEFT, RIGHT, BOTTOM, TOP = BOX = teg.params("left right bottom top")
COLOURS = teg.params("c0 c1 c2")


def edge(i: int, j: int, form: str) -> teg.Expr:
    """The line through two vertices: as a determinant, written out, or by differences."""
    (ax, ay), (bx, by) = VERTICES[i], VERTICES[j]
    if form == "determinant":
        return ax * by - bx * ay + x * (ay - by) + y * (bx - ax)
    if form == "written out":
        return ax * by - bx * ay + x * ay - x * by + y * bx - y * ax
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


def triangle(form: str) -> teg.Expr:
    """Σ of squared colours in a triangle in a pixel, the colours linear, divided by the area as a determinant."""
    edges = [edge(1, 2, form), edge(2, 0, form), edge(0, 1, form)]
    area = edges[0] + edges[1] + edges[2]
    if form != "differences":
        area = sum((a[0] * b[1] - b[0] * a[1] for a, b in zip(VERTICES, VERTICES[1:] + VERTICES[:1], strict=True)), start=0 * x)
    colour = sum((e / area * c for e, c in zip(edges, COLOURS, strict=True)), start=0 * x)
    inside = (edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0)
    return teg.integral(teg.bracket(inside) * colour**2, (x, LEFT, RIGHT), (y, BOTTOM, TOP))


def shifted(n: int, across: float, up: float) -> dict[str, Any]:
    """Counterclockwise triangles and the unit pixel, on a grid of 2⁻²⁰, all moved."""
    rng = np.random.default_rng(7)
    corners = np.round(rng.uniform(-0.6, 1.6, (n, 3, 2)) * 2**20) / 2**20
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turned = a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]
    corners[turned] = corners[turned][:, ::-1]
    found: dict[str, Any] = {f"x{i}": corners[:, i, 0] + across for i in range(3)} | {f"y{i}": corners[:, i, 1] + up for i in range(3)}
    found |= {"left": across, "right": across + 1, "bottom": up, "top": up + 1}
    return found | {f"c{i}": rng.uniform(0, 1, n) for i in range(3)}


@pytest.mark.parametrize("form", ["determinant", "written out"])
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_pixel_and_its_triangle_are_moved_together(form: str, backend: str) -> None:
    f = teg.compile(triangle(form), backend=backend)
    reference = teg.compile(triangle("differences"), backend=backend)
    known = [f"{axis}{i}" for axis in "xyc" for i in range(3)]
    value, gradient = f.value_and_grad(shifted(40, 0.0, 0.0))
    expected, slopes = reference.value_and_grad(shifted(40, 0.0, 0.0))
    np.testing.assert_allclose(value, expected, atol=1e-14)
    for name in known:
        np.testing.assert_allclose(gradient[name], slopes[name], atol=2e-12, rtol=1e-12)  # of slivers
    for across, up in ((4096.0, 4096.0), (65536.0, -32768.5)):
        there, moved = f.value_and_grad(shifted(40, across, up))
        assert np.abs(there - value).max() <= 1e-12
        assert max(np.abs(moved[name] - gradient[name]).max() for name in known) <= 1e-12


@pytest.mark.usefixtures("x64")
def test_a_triangle_far_away_in_jax() -> None:
    (ax, ay), (bx, by), (cx, cy) = VERTICES
    edges = [edge(1, 2, "determinant"), edge(2, 0, "determinant"), edge(0, 1, "determinant")]
    e = teg.integral(teg.bracket((edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0)), (x, LEFT, RIGHT), (y, BOTTOM, TOP))
    f = teg.compile(e, [ax, ay, bx, by, cx, cy], backend="jax")
    found = []
    for shift in (0.0, 65536.0):
        values = {k: v for k, v in shifted(40, shift, shift).items() if k in f.parameters}
        value, gradient = f.value_and_grad(values)
        found.append(np.stack([value, *(gradient[p.name] for p in (ax, ay, bx, by, cx, cy))]))
    assert np.abs(found[1] - found[0]).max() <= 1e-12


def test_a_sum_over_faces_that_are_moved() -> None:
    # arrays of vertices and faces; the box of a pixel by indices, moved by whole pixels
    vertices, faces = teg.array("V", 2), teg.indices("F", 2)
    face, first = teg.index("k"), teg.param("first")
    (ax, ay), (bx, by), (cx, cy) = [(vertices[faces[face, i], 0], vertices[faces[face, i], 1]) for i in range(3)]
    edges = [
        p * v - q * u + x * (u - v) + y * (q - p) for (p, u), (q, v) in (((bx, by), (cx, cy)), ((cx, cy), (ax, ay)), ((ax, ay), (bx, by)))
    ]
    inside = (edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0)
    pixel = teg.integral(teg.bracket(inside) * (1 + edges[0]), (x, first, first + 2), (y, first, first + 2))
    e = teg.sum(pixel, (face, 0, teg.length(faces, 0)))
    points = np.array([[0.25, 0.125], [1.5, 0.5], [0.75, 1.75], [1.875, 1.5]])
    numbers = np.array([[0, 1, 2], [1, 3, 2]])
    for backend in ("numpy", "c"):
        f = teg.compile(e, [vertices], backend=backend)
        here, there = (f.value_and_grad(V=points + s, F=numbers, first=s) for s in (0.0, 65536.0))
        assert abs(here[0] - there[0]) <= 1e-12
        assert np.abs(here[1]["V"] - there[1]["V"]).max() <= 1e-12


def test_what_is_written_by_differences_stays() -> None:
    for program in (scenes.triangle_pixel()[0], scenes.bilinear_pixel()[0], scenes.disk()[0], scenes.half_planes(5)[0], scenes.heart()[0]):
        assert with_differences(program) is program


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("x*x - 2*x*x0 + x0*x0", "(x - x0)²"),
        ("x*y - x*y0 - x0*y + x0*y0", "(x - x0)·(y - y0)"),
        ("x0*y1 - x1*y0 + x*(y0 - y1) + y*(x1 - x0)", "(x - x0)·(y0 - y1) + (y - y0)·(x1 - x0)"),
    ],
)
def test_normal_forms(written: str, expected: str) -> None:
    names = {"x": x, "y": y} | {f"{axis}{i}": VERTICES[i][k] for k, axis in enumerate("xy") for i in range(3)}
    assert str(with_differences(eval(written, {"__builtins__": {}}, names))) == expected
    assert with_differences(with_differences(eval(written, {"__builtins__": {}}, names))) is with_differences(
        eval(written, {"__builtins__": {}}, names)
    )


def test_what_changes_when_coordinates_move_stays() -> None:
    a, b = VERTICES[0]
    for e in (x * a + y * b - 1, x**2 + y**2 - a, a * b - a * LEFT + 1, (x + a) ** 2 - b * x, x * a - x * b):
        assert with_differences(e) is e


def test_the_cost_is_linear_in_the_number_of_surfaces() -> None:
    def disks(n: int) -> teg.Expr:
        body = 0 * x
        for i in range(n):
            p, q = teg.params(f"p{i} q{i}")
            body = body + teg.bracket(x * x - 2 * x * p + p * p + y * y - 2 * y * q + q * q < 1)
        return body

    sizes = [size(with_differences(disks(n))) for n in (10, 20, 40)]
    assert sizes[2] - sizes[1] == 2 * (sizes[1] - sizes[0])
