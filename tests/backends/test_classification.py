"""What is decided before any work: pixels that a triangle misses, covers, or touches; what such a decision must not hide."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import teg
from teg import Expr
from teg.backends import plan as array_plan
from teg.backends.branches import with_branches, with_selects
from teg.backends.c.kernel import compile_c
from teg.backends.numpy.kernel import compile_numpy
from teg.ir.expr import Param
from teg.program import Polygon, Segment, When, statements
from tests.bench.scenes import picture, triangle_pixel

pytestmark = [pytest.mark.filterwarnings("error")]

Corners = tuple[float, float, float, float, float, float]
UNIT = (0.0, 1.0, 0.0, 1.0)
x, y = teg.vars("x y")
FACES: dict[str, tuple[Corners, float, dict[str, float]]] = {
    "far away": ((5, 5, 7, 5, 6, 8), 0.0, {}),
    "beside it, the box inside of two sides": ((1.5, 0, 3, 0.5, 1.5, 1), 0.0, {}),
    "a side on the border, outside": ((1, 0, 2, 0.5, 1, 1), 0.0, {"x0": -0.25, "x2": -0.25}),
    "a side on the border, inside": ((0, -5, 10, 0.5, 0, 6), 1.0, {"x0": -0.25, "x2": -0.25}),
    "a vertex on a corner, outside": ((1, 1, 2, 1.5, 1.5, 2), 0.0, {}),
    "a side through a corner, outside": ((3, -1, 3, 3, -1, 3), 0.0, {}),
    "covered": ((-5, -5, 9, -4, 0, 9), 1.0, {}),
}
"""Counterclockwise triangles, their overlap with the unit box, and its slopes that are not 0."""


def given(order: int, corners: Corners, box: tuple[float, float, float, float] = UNIT, colour: float = 1.0) -> dict[str, float]:
    """Arguments: one colour channel of `colour`, the others and the target 0."""
    _, wrt = triangle_pixel(order)
    names = ["x0", "y0", "x1", "y1", "x2", "y2"]
    at = dict(zip(names, map(float, corners), strict=True)) | dict(zip(("left", "right", "bottom", "top"), box, strict=True))
    at |= {p.name: (colour if p.name[-1] == "0" else 0.0) for p in wrt if p.name.startswith("c")}
    return at | {f"t{k}": 0.0 for k in range(3)}


def columns(kernel: Any, at: dict[str, float]) -> list[npt.NDArray[np.float64]]:
    return [np.asarray(at[p]) for p in kernel.program.parameters]


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("order", [0, 1])
def test_exactly_touching(order: int, backend: str, request: pytest.FixtureRequest) -> None:
    if backend == "jax":
        request.getfixturevalue("x64")
    f = teg.compile(*triangle_pixel(order), backend=backend)
    for name, (corners, area, slopes) in FACES.items():
        value, gradient = f.value_and_grad(given(order, corners))
        assert value == pytest.approx(area, abs=1e-13), name
        for p in ("x0", "y0", "x1", "y1", "x2", "y2"):
            assert gradient[p] == pytest.approx(slopes.get(p, 0.0), abs=1e-13), (name, p)


@pytest.mark.parametrize("moved", [-1e-3, -1e-12, -(2.0**-53), 0.0, 2.0**-52, 1e-12, 1e-3])
def test_near_the_border_the_branches_are_those_of_pieces(moved: float) -> None:
    """A side that the box nearly touches, from either side, and boxes whose ends are exchanged."""
    e, wrt = triangle_pixel(0)
    f, pieces = teg.compile(e, wrt, backend="c"), teg.compile(e, wrt, backend="c", rule="gauss", order=8)
    for box in (UNIT, (1.0, 0.0, 0.0, 1.0), (1.0, 0.0, 1.0, 0.0)):
        for corners in ((1 + moved, 0, 2, 0.5, 1, 1), (moved, -5, 10, 0.5, 0, 6)):
            at = given(0, corners, box)
            (value, gradient), (expected, slopes) = f.value_and_grad(at), pieces.value_and_grad(at)
            assert value == pytest.approx(expected, abs=1e-13)
            for p in wrt:
                assert gradient[p.name] == pytest.approx(slopes[p.name], abs=1e-11), (box, corners, p)


@pytest.mark.parametrize("compiled", [compile_numpy, lambda program: compile_c(program, counted=True)], ids=["numpy", "c"])
@pytest.mark.parametrize("order", range(3))
def test_nothing_is_evaluated_where_nothing_is(order: int, compiled: Any) -> None:
    """An empty pixel evaluates no integrand, and a covered one that of the inside only."""
    kernel = compiled(teg.compile(*triangle_pixel(order), backend="numpy").program(1))
    inside = {0: 1, 1: 2 * 3, 2: 2 * 6}[order]
    for name, (corners, area, slopes) in FACES.items():
        outcome = kernel.outcome(columns(kernel, given(order, corners)), 1)
        if not area and not slopes:
            assert outcome.evaluations == 0, name
        elif not slopes:
            assert outcome.evaluations == inside, name


def test_behind_the_branches_is_everything_but_the_classification() -> None:
    for order in range(3):
        plain = teg.compile(*triangle_pixel(order), backend="numpy").program(1)
        program = with_branches(plain)
        (outer,) = [s for s in program.body if isinstance(s, When)]
        (inner,) = [s for s in outer.body if isinstance(s, When)]
        assert set(program.outputs) == set(outer.results)
        assert [type(s) for s in statements(outer.body) if isinstance(s, Polygon)] == [Polygon]
        assert [type(s) for s in statements(inner.body) if isinstance(s, Polygon | Segment)] == [Segment] * 3
        assert len(program.body) < 90
        assert not any(isinstance(s, When) for made in (plain, with_selects(plain)) for s in statements(made.body))


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_what_is_not_a_number_comes_out_unless_a_side_decides_without_it(backend: str) -> None:
    f = teg.compile(*triangle_pixel(1), backend=backend)
    for corners, _, _ in FACES.values():
        for p in ("left", "right", "bottom", "top"):
            value, gradient = f.value_and_grad(given(1, corners) | {p: math.nan})
            assert math.isnan(value)
            assert all(math.isnan(g) for g in gradient.values()), (corners, p)
    covered, far = FACES["covered"][0], FACES["far away"][0]
    for p in ("x0", "y0", "x1", "y1", "x2", "y2"):
        assert math.isnan(f(given(1, covered) | {p: math.nan}))
        assert math.isnan(f.value_and_grad(given(1, covered) | {p: math.nan})[1]["x1"])
    for p in ("t0", "c00"):
        assert math.isnan(f(given(1, covered) | {p: math.nan}))
        value, gradient = f.value_and_grad(given(1, far) | {p: math.nan})
        assert value == 0.0
        assert not any(gradient.values())


def test_no_slope_of_a_triangle_without_area_beside_the_box() -> None:
    """Linear colours are divided by the area; where nothing is covered that does not matter, in value and gradient."""
    for backend in ("numpy", "c"):
        value, gradient = teg.compile(*triangle_pixel(1), backend=backend).value_and_grad(given(1, (5, 5, 6, 6, 7, 7)))
        assert value == 0.0
        assert not any(gradient.values())


@pytest.mark.parametrize("strict", [True, False], ids=["open", "closed"])
def test_negated_half_planes(strict: bool) -> None:
    """A wedge and what its complements leave, boundaries open and closed, boxes on all sides of it."""
    t, a = teg.params("t a")
    one, other = (x + a * y < t, x - a * y < t) if strict else (x + a * y <= t, x - a * y <= t)
    parts = [one & other, one & ~other, ~one & other, ~one & ~other]
    left, bottom = teg.params("left bottom")
    bounds = (x, left, left + 1), (y, bottom, bottom + 1)
    e = teg.tuple(*[teg.integral(teg.bracket(p) * (1 + x * y), *bounds) for p in parts])
    whole = teg.compile(teg.integral(1 + x * y, *bounds), [t, a])
    corners = np.stack(np.meshgrid(np.arange(-3.0, 3.0, 0.5), np.arange(-3.0, 3.0, 0.5)), axis=-1).reshape(-1, 2)
    at = {"t": 0.3, "a": 0.8, "left": corners[:, 0], "bottom": corners[:, 1]}
    for backend in ("numpy", "c"):
        f = teg.compile(e, [t, a], backend=backend)
        pieces = teg.compile(e, [t, a], backend=backend, rule="gauss", order=8)
        (values, gradient), (expected, slopes) = f.value_and_grad(at), pieces.value_and_grad(at)
        np.testing.assert_allclose(
            sum(values), whole({"left": at["left"], "bottom": at["bottom"], "t": 0.3, "a": 0.8}), rtol=1e-13, atol=1e-13
        )
        for v, w in zip(values, expected, strict=True):
            np.testing.assert_allclose(v, w, rtol=1e-12, atol=1e-13)
        for p in ("t", "a"):
            for v, w in zip(gradient[p], slopes[p], strict=True):
                np.testing.assert_allclose(v, w, rtol=1e-11, atol=1e-12)


def test_a_factor_in_front_and_terms_beside() -> None:
    """What is added to a vanishing integral stays, and so does a function of it that is not 0 at 0."""
    e, wrt = triangle_pixel(0)
    s = teg.param("s")
    both: Expr = teg.exp(s * e) + s * e + s * s
    wanted: list[Param] = [s, *wrt]
    for backend in ("numpy", "c"):
        value, gradient = teg.compile(both, wanted, backend=backend).value_and_grad(given(0, FACES["far away"][0]) | {"s": 0.7})
        assert value == pytest.approx(1 + 0.49, abs=1e-14)
        assert gradient["s"] == pytest.approx(1.4, abs=1e-14)
        assert all(gradient[p.name] == 0.0 for p in wrt)


def test_several_polygons_have_a_branch_each() -> None:
    wedges = [teg.params(f"a{i} b{i} c{i}") for i in range(4)]
    terms = [teg.integral(teg.bracket((x + a * y < b) & (x - y > c)) * (i + x), (x, 0, 1), (y, 0, 1)) for i, (a, b, c) in enumerate(wedges)]
    e, wrt = sum(terms[1:], start=terms[0]) * terms[0], [p for wedge in wedges for p in wedge]
    rng = np.random.default_rng(5)
    at = {p.name: rng.uniform(-2, 2, 200) for p in wrt}
    pieces = teg.compile(e, wrt, backend="c", rule="gauss", order=8)
    expected, slopes = pieces.value_and_grad(at)
    for backend in ("numpy", "c"):
        f = teg.compile(e, wrt, backend=backend)
        assert sum(isinstance(s, When) for s in with_branches(f.program(1)).body) == 4
        value, gradient = f.value_and_grad(at)
        np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-13)
        for p in wrt:
            np.testing.assert_allclose(gradient[p.name], slopes[p.name], rtol=1e-10, atol=1e-11)


def test_many_polygons_have_none() -> None:
    """A branch saves one polygon's time, and takes the compiler some: of many it would be little for much."""
    wedges = [teg.params(f"a{i} b{i} c{i}") for i in range(40)]
    e = sum(
        (teg.integral(teg.bracket((x + a * y < b) & (x - y > c)), (x, 0, 1), (y, 0, 1)) for a, b, c in wedges), start=0 * teg.param("a0")
    )
    program = with_branches(teg.compile(e, [p for wedge in wedges for p in wedge], backend="numpy").program(1))
    assert not any(isinstance(s, When) for s in statements(program.body))
    assert all(s.met is True for s in statements(program.body) if isinstance(s, Polygon))


def scene(rng: np.random.Generator) -> dict[str, Any]:
    """A few triangles in a picture of 12 by 10, among them one whose box is larger than it has to be and one with an empty box."""
    vertices = np.array([[1.0, 1.0], [9.0, 2.0], [4.0, 8.0], [2.0, 9.0], [10.0, 9.5], [6.0, 6.0]])
    faces = np.array([[0, 1, 2], [3, 2, 4], [5, 1, 4], [0, 1, 4]])
    boxes = np.array([[0, 10, 0, 9], [0, 12, 5, 10], [6, 11, 2, 10], [3, 3, 0, 0]])
    return {"V": vertices, "F": faces, "B": boxes, "C": rng.random((4, 9)), "T": rng.random((10, 12, 3))}


def test_a_picture_skips_pixels_and_is_the_sum_of_its_pairs() -> None:
    at = scene(np.random.default_rng(2))
    compiled = {backend: teg.compile(*picture(), backend=backend) for backend in ("numpy", "c")}
    assert "spans_" in compiled["c"].source
    pixel = teg.compile(*triangle_pixel(1), backend="c")
    total, by_vertex = 0.0, np.zeros((6, 2))
    for face, (first, last, low, high), colour in zip(at["F"], at["B"], at["C"], strict=True):
        for j in range(low, high):
            for i in range(first, last):
                values = given(1, tuple(at["V"][face].ravel()), (i, i + 1.0, j, j + 1.0)) | {f"t{k}": at["T"][j, i, k] for k in range(3)}
                value, slopes = pixel.value_and_grad(values | {f"c{m}{k}": colour[3 * m + k] for m in range(3) for k in range(3)})
                total += value
                by_vertex[face] += [[slopes[f"x{m}"], slopes[f"y{m}"]] for m in range(3)]
    for f in compiled.values():
        value, gradient = f.value_and_grad(at)
        assert value == pytest.approx(total, rel=1e-13)
        np.testing.assert_allclose(gradient["V"], by_vertex, rtol=1e-11, atol=1e-12)


def test_ranges_between_two_columns_need_no_enumeration(monkeypatch: pytest.MonkeyPatch) -> None:
    at = scene(np.random.default_rng(2))
    f = teg.compile(*picture(), backend="c")
    expected = f(at)
    wrong = at | {"B": np.array([[0, 10, 0, 9], [0, 12, 5, 10], [11, 6, 2, 10], [3, 3, 0, 0]])}
    with pytest.raises(teg.ArrayIndexError, match="negative length: from 11 to 6"):
        f(wrong)
    outside = at | {"B": np.array([[0, 10, 0, 9], [0, 13, 5, 10], [6, 11, 2, 10], [3, 3, 0, 0]])}
    with pytest.raises(teg.ArrayIndexError, match="out of range"):
        f(outside)
    monkeypatch.delattr(array_plan, "_Exact")
    assert f(at) == expected
