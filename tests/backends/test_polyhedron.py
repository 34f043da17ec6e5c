"""Clipped polyhedra in the backends: against rational numbers, at degenerate places, and what is not a number."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

import teg
from teg import Expr
from teg.ir.expr import Param
from teg.ir.traverse import parameters
from teg.program import Polyhedron, statements
from teg.program.interpreter import interpret
from tests.backends.rational_solids import integral

pytestmark = pytest.mark.usefixtures("derived_once", "x64_for_jax")

x, y, z = teg.vars("x y z")
BACKENDS = ("numpy", "c", "jax")
SPACES = 4
BOX = ("left", "right", "bottom", "top", "near", "far")
Case = tuple[list[float], list[list[float]]]
"""A box, and half-spaces a·x + b·y + c·z + d > 0."""


def cut_box(power: int, spaces: int = SPACES) -> tuple[Expr, list[Param]]:
    """∫∫∫ over a box, inside of half-spaces, of (p·x + q·y + r·z + s)^power; by the numbers of the half-spaces."""
    wrt: list[Param] = []
    inside = teg.ir.expr.TRUE
    for i in range(spaces):
        a, b, c, d = (teg.param(f"solid_{letter}{i}") for letter in "abcd")
        inside = inside & (a * x + b * y + c * z + d > 0)
        wrt += [a, b, c, d]
    p, q, r, s = teg.params("solid_p solid_q solid_r solid_s")
    left, right, bottom, top, near, far = teg.params(" ".join(BOX))
    body = teg.bracket(inside) * (p * x + q * y + r * z + s) ** power
    return teg.integral(body, (x, left, right), (y, bottom, top), (z, near, far)), wrt


LINEAR = {"solid_p": 0.5, "solid_q": -1.25, "solid_r": 2.0, "solid_s": 0.75}


def numbers(case: Case) -> dict[str, float]:
    """The arguments of `cut_box`; half-spaces that are missing contain everything."""
    box, halves = case
    at = dict(zip(BOX, box, strict=True)) | LINEAR
    for i, half in enumerate([*halves, *([[0.0, 0.0, 0.0, 1.0]] * (SPACES - len(halves)))]):
        at |= {f"solid_{letter}{i}": v for letter, v in zip("abcd", half, strict=True)}
    return at


@cache
def cases(count: int) -> tuple[Case, ...]:
    """Boxes and half-spaces: some at random; others are nearly or exactly alike or opposite, or go through corners and middles of edges, or
    lie along a side."""
    rng = np.random.default_rng(11)
    found: list[Case] = []
    while len(found) < count:
        extents = rng.choice([1.0, 1.0, 2.0, 0.5, 3.7], 3)
        corner = rng.choice([0.0, 0.0, -1.0, 0.3], 3)
        halves: list[list[float]] = []
        for kind in rng.integers(0, 8, rng.integers(1, SPACES + 1)):
            normal, at = rng.normal(size=3), corner + extents * rng.random(3)
            little = rng.choice([0.0, 1e-16, 1e-13, 1e-9])
            if kind in (3, 4) and halves:
                scale = rng.choice([1.0, -1.0, 3.0, -0.7])
                halves.append([v * scale * (1 + (little if kind == 3 else 0.0) * rng.normal()) for v in halves[rng.integers(len(halves))]])
                continue
            if kind in (5, 6):
                p, q, r = (corner + extents * rng.integers(0, kind - 3, 3) / (kind - 4) for _ in range(3))
                normal, at = np.cross(q - p, r - p), p
            if kind == 7:
                axis = rng.integers(3)
                normal = np.eye(3)[axis] * rng.choice([1.0, -1.0]) + little * rng.normal(size=3)
                at = corner + extents * rng.integers(0, 2)
            if np.any(normal):
                halves.append([*map(float, normal), float(-normal @ at)])
        if halves:
            found.append(([float(v) for pair in zip(corner, corner + extents, strict=True) for v in pair], halves))
    return tuple(found)


def batch(given: tuple[Case, ...]) -> dict[str, np.ndarray]:
    rows = [numbers(case) for case in given]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@cache
def exact(count: int, power: int) -> np.ndarray:
    return np.array([float(integral(box, halves, tuple(LINEAR.values()), power)) for box, halves in cases(count)])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("power", "count"), [(0, 400), (1, 100), (2, 100), (3, 60), (5, 30)])
def test_values_are_those_of_rational_numbers(power: int, count: int, backend: str) -> None:
    if backend == "jax" and power in (1, 3):
        pytest.skip("the paths of other powers")
    f = teg.compile(cut_box(power)[0], backend=backend)
    assert any(isinstance(s, Polyhedron) for s in statements(f.program(0).body))
    at = batch(cases(count))
    size = np.prod([at[b] - at[a] for a, b in zip(BOX[::2], BOX[1::2], strict=True)], axis=0) * 8.0**power
    assert np.max(np.abs(f(at) - exact(count, power)) / size) < 2e-15


@pytest.mark.parametrize("power", [0, 1, 2])
def test_the_interpreter_is_right(power: int) -> None:
    program = teg.compile(cut_box(power)[0], backend="numpy").program(0)
    for case, expected in zip(cases(60), exact(60, power), strict=True):
        (found,) = interpret(program, [numbers(case)[name] for name in program.parameters]).outputs
        assert found == pytest.approx(expected, abs=2e-14 * 8.0**power)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_many_half_spaces(backend: str) -> None:
    """A ball of planes."""
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(16, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    inside = teg.ir.expr.TRUE
    halves = []
    for a, b, c in normals.tolist():
        inside = inside & (a * x + b * y + c * z < 0.8)
        halves.append([-a, -b, -c, 0.8])
    f = teg.compile(teg.integral(teg.bracket(inside), (x, -1, 1), (y, -1, 1), (z, -1, 1)), backend=backend)
    assert f() == pytest.approx(float(integral([-1, 1] * 3, halves)), abs=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_gradients_are_those_of_slices(backend: str) -> None:
    e, _ = cut_box(2, 2)
    by = parameters(e)
    at = {p.name: v for p, v in ((p, batch(tuple(filter(is_generic, cases(120))))[p.name]) for p in by)}
    value, gradient = teg.compile(e, by, backend=backend).value_and_grad(at)
    expected, slopes = teg.compile(e, by, backend="c", intrinsics=False).value_and_grad(at)
    assert len(value) > 15
    np.testing.assert_allclose(value, expected, rtol=1e-11, atol=1e-13)
    for name, slope in slopes.items():
        np.testing.assert_allclose(gradient[name], slope, rtol=1e-9, atol=1e-11 * max(1.0, float(np.abs(slope).max())))


def is_generic(case: Case) -> bool:
    """Whether the first two half-spaces are neither nearly alike nor along a side: derivatives would depend on the last digits."""
    normals = [np.array(half[:3]) / np.linalg.norm(half[:3]) for half in case[1][:2]]
    return all(np.abs(n).max() < 0.99 for n in normals) and (len(normals) < 2 or abs(normals[0] @ normals[1]) < 0.99)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_reversed_box_has_the_opposite_sign(backend: str) -> None:
    f = teg.compile(cut_box(2)[0], backend=backend)
    at = batch(cases(60))
    for a, b in zip(BOX[::2], BOX[1::2], strict=True):
        np.testing.assert_allclose(f(at | {a: at[b], b: at[a]}), -f(at), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["solid_a0", "solid_d1", "left", "far"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_a_number_stays_so(name: str, bad: float, backend: str) -> None:
    f = teg.compile(cut_box(0)[0], backend=backend, inaccurate="ignore")
    at = numbers(([0.0, 1.0] * 3, [[1.0, 1.0, 1.0, -1.2], [1.0, -1.0, 0.5, 0.3]]))
    assert f(at) > 0.0
    assert np.isnan(f(at | {name: bad}))


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_inside_is_exactly_nothing(backend: str) -> None:
    f = teg.compile(cut_box(2)[0], backend=backend)
    box = [0.0, 1.0] * 3
    beside = numbers((box, [[1.0, 1.0, 1.0, -4.0]]))
    touching = numbers((box, [[-1.0, 0.0, 0.0, 0.0]]))
    nowhere = numbers((box, [[1.0, 0.0, 0.0, -0.6], [-1.0, 0.0, 0.0, 0.4]]))
    flat = numbers(([0.0, 1.0, 0.0, 0.0, 0.0, 1.0], [[1.0, 1.0, 1.0, -1.0]]))
    assert [f(at) for at in (beside, touching, nowhere, flat)] == [0.0] * 4


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_estimates_hold_the_errors(backend: str) -> None:
    f = teg.compile(cut_box(2)[0], backend=backend)
    at = batch(cases(100))
    value, error = f.value_and_error(at)
    assert np.all(np.abs(value - exact(100, 2)) <= error + 1e-300)
    assert np.median(error) < 1e-12


@pytest.mark.parametrize("backend", BACKENDS)
def test_boxes_of_a_grid_add_up(backend: str) -> None:
    """Σ over cells of a grid is the whole, and so is its gradient."""
    i, j, k = (teg.index(f"solid_{letter}") for letter in "ijk")
    normal, offset = teg.array("solid_n", 1), teg.param("solid_offset")
    inside = (normal[0] * x + normal[1] * y + normal[2] * z < offset) & (x - y + 2 * z > 0.3)
    cell = teg.integral(teg.bracket(inside) * (x + y * z), (x, i, i + 1), (y, j, j + 1), (z, k, k + 1))
    total = teg.sum(cell, (i, 0, 3), (j, 0, 2), (k, 0, 2))
    whole = teg.integral(teg.bracket(inside) * (x + y * z), (x, 0, 3), (y, 0, 2), (z, 0, 2))
    at = {"solid_n": np.array([0.9, 0.4, 0.7]), "solid_offset": 2.1}
    by = [normal, offset]
    value, gradient = teg.compile(total, by, backend=backend).value_and_grad(at)
    expected, slopes = teg.compile(whole, by, backend="c").value_and_grad(at)
    assert value == pytest.approx(expected, rel=1e-13)
    for name, slope in slopes.items():
        np.testing.assert_allclose(gradient[name], slope, rtol=1e-11)


T, S = teg.params("solid_t solid_u")
TIED = {
    "alike": (x + y + z < T) & (2 * x + 2 * y + 2 * z < S),
    "opposite": (x + y + z < T) & (x + y + z > S),
    "a side": (x < T) & (x + y + z < 2.5) & (y < S),
    "diagonal": (x - y < T) & (y - x < S) & (z < 1.2),
    "bounds": (x + z < T) & (x - S < y + z),
}


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("kind", TIED)
def test_faces_that_coincide_count_half_as_without_intrinsics(kind: str, backend: str) -> None:
    """Planes along each other, along a side of the box, through its edges: derivatives are means of the one-sided ones."""
    e = teg.integral(teg.bracket(TIED[kind]) * (1 + x), (x, 0, S if kind == "bounds" else 1), (y, 0, 1), (z, 0, 1))
    f, slices = (teg.compile(e, [T, S], backend=backend, intrinsics=on) for on in (True, False))
    for t, u in ((1.0, 2.0), (1.0, 1.0), (0.0, 0.0), (1.0, 0.0), (0.5, 1.0), (3.0, 0.0)):
        (value, gradient), (expected, slopes) = (g.value_and_grad(solid_t=t, solid_u=u) for g in (f, slices))
        assert value == pytest.approx(expected, abs=1e-13)
        assert gradient == {name: pytest.approx(slope, abs=1e-12) for name, slope in slopes.items()}
        assert {d.kind for d in f.diagnose(solid_t=t, solid_u=u)} == {d.kind for d in slices.diagnose(solid_t=t, solid_u=u)}
