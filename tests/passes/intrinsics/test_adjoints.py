"""Moments that loops add up in place of derivatives: what is added up, and that results are the same."""

from __future__ import annotations

from itertools import count
from typing import Any
from unittest import mock

import numpy as np
import pytest

import teg
from teg.evaluator import derivation
from teg.passes.intrinsics.polygon.adjoints import with_adjoints
from teg.passes.intrinsics.polygon.polynomials import ONE, POINTS, Steady, derivative
from teg.program import Polygon, compound
from teg.program.arrays import ArrayProgram, Run, steps
from teg.program.interpreter import interpret_arrays
from teg.program.residues import residue_of
from tests.backends.c_checks import in_c

pytestmark = [*in_c, pytest.mark.filterwarnings("error")]

x, y = teg.vars("x y")
SIZE = 24
KINDS = ["constant", "linear", "plane", "quadratic"]
PLACES = ["anywhere", "on the grid", "thin", "tiny", "clockwise", "without area"]
COLOURS = {"constant": 3, "linear": 9, "plane": 9, "quadratic": 18}


def picture(kind: str) -> tuple[teg.Expr, list[Any]]:
    """A loss of triangles against a picture with three channels; `s` moves both."""
    vertices, colours, target = teg.array("V", 2), teg.array("C", 2), teg.array("T", 3)
    faces, boxes = teg.indices("F", 2), teg.indices("B", 2)
    k, i, j = teg.index("k"), teg.index("i"), teg.index("j")
    s = teg.param("s")
    corners = [(vertices[faces[k, n], 0], vertices[faces[k, n], 1]) for n in range(3)]
    edges = []
    for n in range(3):
        (px, py), (qx, qy) = corners[(n + 1) % 3], corners[(n + 2) % 3]
        edges.append((qx - px) * (y - py) - (qy - py) * (x - px))
    inside = (edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0)
    weights: list[teg.Expr] = [e / (edges[0] + edges[1] + edges[2]) for e in edges]
    if kind == "constant":
        weights = [1 + 0 * x]
    elif kind == "plane":
        weights = [1 + 0 * x, x - s, y + s]
    elif kind == "quadratic":
        weights = [w * (2 * w - 1) for w in weights] + [4 * weights[n] * weights[n - 1] for n in range(3)]
    loss: teg.Expr = 0 * x
    for c in range(3):
        colour = sum((colours[k, 3 * n + c] * w for n, w in enumerate(weights)), start=0 * x)
        loss = loss + (colour - target[j, i, c]) ** 2
    pixel = teg.integral(teg.bracket(inside) * loss, (x, i + s, i + s + 1), (y, j - s, j - s + 1))
    columns, rows = (i, boxes[k, 0], boxes[k, 1]), (j, boxes[k, 2], boxes[k, 3])
    return teg.sum(pixel, columns, rows, (k, 0, teg.length(faces, 0))), [vertices, colours]


def scene(kind: str, place: str, n: int = 9) -> dict[str, Any]:
    """Triangles, counterclockwise unless the place says otherwise, and a picture."""
    rng = np.random.default_rng(KINDS.index(kind))
    p = rng.uniform(1.0, SIZE - 1.0, (n, 3, 2))
    if place == "on the grid":
        p = np.round(2.0 * p) / 2.0
    elif place == "thin":
        p[:, 2] = p[:, 0] + rng.uniform(0.2, 0.8, (n, 1)) * (p[:, 1] - p[:, 0]) + 10.0 ** rng.uniform(-6, -1, (n, 1))
    elif place == "tiny":
        p = p[:, :1] + 10.0 ** rng.uniform(-3, -0.5, (n, 1, 1)) * rng.standard_normal((n, 3, 2))
    first, second = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    turned = (first[:, 0] * second[:, 1] < first[:, 1] * second[:, 0]) != (place == "clockwise")
    p[turned] = p[turned][:, ::-1]
    if place == "without area":
        p[::3, 2], p[1::3, 2] = p[::3, 1], 0.5 * (p[1::3, 0] + p[1::3, 1])
    p = np.round(p * 2.0**30) / 2.0**30
    low, high = np.clip(np.floor(p.min(1)), 0, SIZE).astype(int), np.clip(np.ceil(p.max(1)), 0, SIZE).astype(int)
    boxes = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)
    data = {"V": p.reshape(-1, 2), "F": np.arange(3 * n).reshape(n, 3), "B": boxes, "s": 0.0}
    return data | {"C": rng.random((n, COLOURS[kind])), "T": rng.random((SIZE, SIZE, 3))}


def program_of(kind: str) -> ArrayProgram:
    return without_moments(*picture(kind))


def without_moments(e: teg.Expr, wrt: list[Any]) -> ArrayProgram:
    """The program of value and gradient before the pass."""
    with mock.patch.object(derivation, "with_loops", lambda program: program):
        program = teg.compile(e, wrt, backend="c").program(1)
    assert isinstance(program, ArrayProgram)
    return program


def the_polygon(program: ArrayProgram) -> tuple[Run, Polygon]:
    """The polygon of a program, and the flat program that it stands in."""
    runs = [s for s in steps(program.body) if isinstance(s, Run)]
    ((run, polygon),) = ((r, s) for r in runs for s in compound(r.program.body) if isinstance(s, Polygon))
    return run, polygon


@pytest.mark.parametrize("kind", KINDS)
def test_moments_are_few_and_short(kind: str) -> None:
    """For linear colours: each residual with 1, λ₁ and λ₂, the loss, and two numbers for each side."""
    before = program_of(kind)
    after = with_adjoints(before)
    (_, first), (new, second) = (the_polygon(p) for p in (before, after))
    assert len(new.results) <= {"constant": 10, "linear": 16, "plane": 16, "quadratic": 25}[kind]
    assert len(second.body) <= len(first.body) + 2
    assert kind != "linear" or len(second.body) < 0.4 * len(first.body)
    assert with_adjoints(after) is after


def test_derivatives_of_polynomials() -> None:
    """5u³v + 2u + 7v by u is 15u²v + 2."""
    steady = Steady(count())
    numbers = {(("u", 3), ("v", 1)): 5.0, (("u", 1),): 2.0, (("v", 1),): 7.0}
    found = derivative({monomial: steady.number(c) for monomial, c in numbers.items()}, "u")
    assert found == {(("u", 2), ("v", 1)): (residue_of(15.0),) * POINTS, ONE: (residue_of(2.0),) * POINTS}


def test_what_has_no_moments_stays_as_it_is() -> None:
    k = teg.index("k")
    a = teg.array("a", 1)
    e = teg.sum(teg.integral(teg.bracket(x < a[k]) * teg.exp(x * a[k]), (x, 0, 1)), (k, 0, teg.length(a, 0)))
    program = without_moments(e, [a])
    assert with_adjoints(program) is program


@pytest.mark.parametrize("kind", ["linear", "plane"])
def test_the_meaning_is_the_same(kind: str) -> None:
    """By the interpreter, of two triangles in four pixels."""
    program = program_of(kind)
    data = scene(kind, "anywhere", 2)
    data["V"] = np.array([[0.2, 0.3], [1.7, 0.6], [0.9, 1.8], [-1.0, -1.0], [3.0, -1.0], [-1.0, 4.0]])
    data["B"] = np.array([[0, 2, 0, 2]] * 2)
    arrays = [data[a.name] for a in program.arrays]
    first, second = (interpret_arrays(p, [0.0], arrays).outputs for p in (program, with_adjoints(program)))
    for a, b in zip(first, second, strict=True):
        ours, theirs = (v if isinstance(v, dict) else {0: v} for v in (b, a))
        assert dict(ours) == pytest.approx(dict(theirs), rel=1e-13, abs=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_pictures_with_and_without_moments(kind: str) -> None:
    e, wrt = picture(kind)
    ours = teg.compile(e, wrt, backend="c")
    for place in PLACES:
        data = scene(kind, place)
        value, slopes = ours.value_and_grad(data)
        with mock.patch.object(derivation, "with_loops", lambda program: program):
            expected, exact = teg.compile(e, wrt, backend="numpy").value_and_grad(data)
        assert value == pytest.approx(expected, rel=1e-12), place
        for name in ("V", "C"):
            size = max(1.0, np.abs(exact[name]).max())
            np.testing.assert_allclose(slopes[name], exact[name], rtol=0, atol=2e-13 * size, err_msg=place)


@pytest.mark.parametrize(("backend", "kind"), [("numpy", "linear"), ("jax", "constant")])
def test_every_backend_adds_up_moments(backend: str, kind: str, request: pytest.FixtureRequest) -> None:
    if backend == "jax":
        pytest.importorskip("jax")
        request.getfixturevalue("x64")
    e, wrt = picture(kind)
    data = scene(kind, "on the grid", 3)
    ours, theirs = (teg.compile(e, wrt, backend=b).value_and_grad(data) for b in ("c", backend))
    assert ours[0] == pytest.approx(theirs[0], rel=1e-13)
    for leaf in ("V", "C"):
        np.testing.assert_allclose(ours[1][leaf], theirs[1][leaf], rtol=0, atol=2e-13 * np.abs(ours[1][leaf]).max())


def test_coordinates_begin_near_the_boxes() -> None:
    """The half-planes are near, another point that the integrand is written from is not: 2³⁰ away, it would cost nine digits."""
    k, i = teg.index("k"), teg.index("i")
    places, colours, target, far = teg.array("P", 1), teg.array("C", 2), teg.array("T", 1), teg.param("far")
    colour = colours[k, 0] + colours[k, 1] * (x - far) / far + colours[k, 2] * (x - places[k]) + colours[k, 3] * (x - places[k]) * y
    pixel = teg.integral(teg.bracket((x - places[k]) + y > 0.3) * (colour - target[i]) ** 2, (x, i, i + 1), (y, 0, 1))
    e = teg.sum(pixel, (i, 0, teg.length(target, 0)), (k, 0, teg.length(places, 0)))
    rng = np.random.default_rng(3)
    data = {"P": rng.uniform(2.0, 5.0, 3), "C": rng.random((3, 4)), "T": rng.random(8), "far": 2.0**30}
    ours = teg.compile(e, [places, colours], backend="c")
    before = without_moments(e, [places, colours])
    assert with_adjoints(before) is not before
    slopes = ours.value_and_grad(data)[1]
    with mock.patch.object(derivation, "with_loops", lambda program: program):
        exact = teg.compile(e, [places, colours], backend="numpy").value_and_grad(data)[1]
    for name in ("P", "C"):
        np.testing.assert_allclose(slopes[name], exact[name], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("kind", ["constant", "linear"])
def test_nothing_is_lost_far_from_the_origin(kind: str) -> None:
    e, wrt = picture(kind)
    f = teg.compile(e, wrt, backend="c")
    data = scene(kind, "anywhere")
    value, slopes = f.value_and_grad(data)
    for s in (4096.0, 65536.0):
        moved = f.value_and_grad({**data, "V": data["V"] + [s, -s], "s": s})
        assert moved[0] == pytest.approx(value, rel=1e-13)
        for name in ("V", "C"):
            np.testing.assert_allclose(moved[1][name], slopes[name], rtol=0, atol=1e-13 * np.abs(slopes[name]).max())
