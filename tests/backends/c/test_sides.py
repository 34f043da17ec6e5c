"""Segments that are sides of a polygon: which are found, and what they save."""

from __future__ import annotations

import re

import pytest

import teg
from teg.backends.branches import with_branches
from teg.backends.c.crossed import POINTS, _residues, unconnected
from teg.backends.c.kernel import print_kernel
from teg.backends.c.sides import Side, side_of
from teg.program import Polygon, Program, Segment, statements
from tests.bench.scenes import half_planes, triangle_pixel

x, y = teg.vars("x y")
v = teg.params("x0 y0 x1 y1 x2 y2")
a, b = teg.params("a b")


def sides(e: teg.Expr, wrt: list[teg.Expr]) -> list[Side | None]:
    """The sides that the segments of a program of value and gradient are."""
    program = teg.compile(e, wrt, backend="numpy").program(1)
    assert isinstance(program, Program)
    program = with_branches(program)
    block = list(statements(program.body))
    points = [_residues(program, known) for known in unconnected(program)]
    assert len(points) == POINTS
    (polygon,) = (s for s in block if isinstance(s, Polygon))
    return [side_of(polygon, s, points) for s in block if isinstance(s, Segment)]


def edge(i: int, j: int) -> teg.Expr:
    (px, py), (qx, qy) = v[2 * i : 2 * i + 2], v[2 * j : 2 * j + 2]
    return (qx - px) * (y - py) - (qy - py) * (x - px)


INSIDE = (edge(0, 1) > 0) & (edge(1, 2) > 0) & (edge(2, 0) > 0)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_sides_of_a_triangle(order: int) -> None:
    found = sides(*triangle_pixel(order))
    assert sorted(s.line for s in found if s) == [0, 1, 2]
    assert all(s and abs(s.sign) == 1 and len(s.ahead) == 2 for s in found)


def test_a_triangle_cut_by_a_half_plane() -> None:
    e = teg.integral(teg.bracket(INSIDE & (x + a * y < b)) * x, (x, 0, 1), (y, 0, 1))
    found = sides(e, v)
    assert len(found) == 3
    assert all(s and len(s.ahead) == 2 for s in found)


def test_other_segments_are_none() -> None:
    assert not any(sides(*half_planes(3)))


def test_sides_are_not_cut_again() -> None:
    """Nothing is divided in the lanes: what is divided by is the same for all boxes of a triangle."""
    vertices, faces = teg.array("V", 2), teg.indices("F", 2)
    k, i, j = teg.index("k"), teg.index("i"), teg.index("j")
    corners = [(vertices[faces[k, n], 0], vertices[faces[k, n], 1]) for n in range(3)]
    lines = [
        (corners[n - 2][0] - corners[n - 1][0]) * (y - corners[n - 1][1])
        - (corners[n - 2][1] - corners[n - 1][1]) * (x - corners[n - 1][0])
        for n in range(3)
    ]
    inside = (lines[0] > 0) & (lines[1] > 0) & (lines[2] > 0)
    pixel = teg.integral(teg.bracket(inside) * x * y, (x, i, i + 1), (y, j, j + 1))
    e = teg.sum(pixel, (i, 0, 9), (j, 0, 9), (k, 0, teg.length(faces, 0)))
    source = teg.compile(e, [vertices], backend="c").source
    steady, crossed = (re.findall(rf"(?:static|TEG_EIGHT) void {name}_\d+\(.*?\n}}", source, re.DOTALL) for name in ("steady", "crossed"))
    assert " / " in steady[0]
    assert " / " not in crossed[0]


def test_a_gradient_agrees_with_numpy_where_a_side_is_a_pixel_s() -> None:
    e = teg.integral(teg.bracket(INSIDE) * (1 + x * y), (x, 0, 1), (y, 0, 1))
    at = dict(zip([p.name for p in v], [-0.5, 0.0, 1.5, 0.0, 0.25, 2.0], strict=True))
    assert print_kernel(teg.compile(e, v, backend="numpy").program(1)).count("crossed") >= 2
    ours, theirs = (teg.compile(e, v, backend=name).value_and_grad(at) for name in ("c", "numpy"))
    assert ours[0] == pytest.approx(theirs[0], abs=1e-14)
    assert {k: pytest.approx(g, abs=1e-13) for k, g in theirs[1].items()} == ours[1]
