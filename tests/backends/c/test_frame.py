"""Long C functions are cut into parts: with the limit forced small every kind of statement is cut, and no bit of a result changes."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import inf
from pathlib import Path

import numpy as np
import pytest

import teg
from teg import Expr, bracket, integral, param, params, vars
from teg.backends.branches import with_branches
from teg.backends.c import build as c_build
from teg.backends.c import frame as c_frame
from teg.backends.c import polygon as c_polygon
from teg.backends.c.frame import Frame, Step
from teg.backends.c.kernel import compile_c
from teg.backends.c.unit import print_kernel
from teg.program import (
    Assign,
    Gauss,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Midpoint,
    Polygon,
    Program,
    Rational,
    Sample,
    Segment,
    SumOver,
    When,
    statements,
)
from tests.backends.c_checks import STRICT, in_c, in_turn
from tests.references import REFERENCES, Reference

pytestmark = in_c

x, y = vars("x y")
a, b, c, p, q, t = params("a b c p q t")
CORNERS = [params(f"x{i} y{i}") for i in range(3)]
LIMITS = (
    {"PART": 1},
    {"PART": 3, "BY_VALUE": 0},
    {"PART": 2, "BY_VALUE": 3, "ON_STACK": 1, "INLINE": 0},
    {"PART": 5, "BY_VALUE": 6, "LITERALS": 0},
    {"PART": 7, "LITERALS": 10**6, "BY_VALUE": 2},
)
"""Limits of the text that are made small together."""


def _cross(u: tuple[Expr | float, ...], v: tuple[Expr | float, ...], w: tuple[Expr | float, ...]) -> Expr:
    return (v[0] - u[0]) * (w[1] - u[1]) - (v[1] - u[1]) * (w[0] - u[0])  # type: ignore[return-value]


def pixel(power: int) -> Expr:
    """A power of a triangle's linear colour against a target, over a pixel."""
    weights = [_cross(CORNERS[(i + 1) % 3], CORNERS[(i + 2) % 3], (x, y)) for i in range(3)]
    inside = bracket(weights[0] > 0) * bracket(weights[1] > 0) * bracket(weights[2] > 0)
    colour = sum(w * param(f"c{i}") for i, w in enumerate(weights)) / _cross(*CORNERS)
    return integral((inside * colour - t) ** power, (x, 0, 1), (y, 0, 1))


@dataclass(frozen=True)
class Scene:
    """A program in which statements of this kind occur, and parameters at which it is run."""

    name: str
    build: Callable[[], Expr]
    kind: type | tuple[type, type]
    orders: int = 1
    rule: str = "auto"
    order: int | None = None


SCENES = (
    Scene("polygon", lambda: pixel(1), Polygon),
    Scene("segment", lambda: integral(bracket(a * x + b * y < t) * bracket(p * x + y > q) * x, (x, 0, c), (y, 0, 1)), Segment),
    Scene("hyperbola", lambda: integral(bracket(a * x * y + b * x - c * y < t) * (1 + p * x), (x, 0, 1), (y, 0, 1)), Hyperbola),
    Scene("branch", lambda: integral(bracket(a * x + b * y < t) * bracket(x > p * y), (x, 0, 1), (y, 0, 1)), When),
    Scene("roots", lambda: integral(bracket(teg.exp(a * x) + x * x < 1.5 + t), (x, 0, 1)), Isolate, 2),
    Scene(
        "places",
        lambda: integral(bracket(teg.exp(a * x) + y * y * y + x * y < 1.7 + t), (x, -1, 1), (y, -1, 1)),
        Locate,
    ),
    Scene("sums over roots", lambda: integral(bracket(teg.exp(a * x) + teg.sin(b * x) < 1.5 + t) * x, (x, 0, 1)), SumOver),
    Scene("adaptive", lambda: integral(teg.exp(-a * x) * bracket(x < t) / (1.3 + b * x * x), (x, 0, 1)), Integrate),
    Scene(
        "tails",
        lambda: integral(teg.exp(-a * x * x) / (1 + x * x) * bracket(x < t), (x, -inf, inf)),
        Integrate,
    ),
    Scene("a pole", lambda: integral((1 + x) ** 2 / (x + a) * bracket(x < t), (x, 0, 1)), (Integrate, Rational)),
    Scene("gauss", lambda: integral(x * bracket(x < t * y) * bracket(teg.exp(y) < a * 3), (x, 0, 1), (y, 0, 1)), (Integrate, Gauss)),
    Scene("midpoint", lambda: integral(teg.exp(-a * x) * bracket(x < t), (x, 0, 1)), (Integrate, Midpoint), 1, "midpoint", 32),
    Scene("points", lambda: integral(teg.exp(-a * x * y) * bracket(x < t), (x, 0, 1), (y, 0, 1)), Sample, 1, "qmc", 64),
    Scene("random points", lambda: integral(teg.exp(-a * x) * bracket(x < t), (x, 0, 1), (y, 0, 1)), Sample, 1, "montecarlo", 64),
)
SCENE = {scene.name: scene for scene in SCENES}


@cache
def program_of(scene: Scene, errors: bool = False) -> Program:
    f = teg.compile(scene.build(), backend="numpy", rule=scene.rule, order=scene.order)
    program = f.program(scene.orders, errors)
    assert isinstance(program, Program)
    return program


def has(program: Program, kind: type | tuple[type, type]) -> bool:
    outer, rule = kind if isinstance(kind, tuple) else (kind, object)
    return any(isinstance(s, outer) and isinstance(getattr(s, "rule", None), rule) for s in statements(program.body))


def given(program: Program) -> list[np.ndarray]:
    """Values of the parameters at a few points, in the order of the program."""
    rng = np.random.default_rng(7)
    at = {"x0": 0.1, "y0": 0.2, "x1": 0.9, "y1": 0.3, "x2": 0.4, "y2": 0.8, "t": 0.4}
    return [at.get(name, 0.5) + np.append(0.0, rng.normal(scale=0.1, size=4)) for name in program.parameters]


def lowered(limits: dict[str, int], patch: pytest.MonkeyPatch) -> None:
    for name, value in limits.items():
        patch.setattr(c_frame, name, value)


def compiles(folder: Path, texts: list[str]) -> None:
    """The text is C99 without a warning."""
    files = [folder / f"kernel_{i}.c" for i in range(len(texts))]
    for file, text in zip(files, texts, strict=True):
        file.write_text(text)
    compiler = c_build.find_compiler()
    for first in range(0, len(files), 40):
        some = map(str, files[first : first + 40])
        subprocess.run([*compiler, *STRICT, "-fsyntax-only", *some], check=True)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_every_kind_of_statement_is_cut(scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = program_of(scene)
    assert has(with_branches(program), scene.kind)
    texts = []
    for lanes in (c_polygon.LONGEST, 0):
        monkeypatch.setattr(c_polygon, "LONGEST", lanes)
        for limits in LIMITS:
            with monkeypatch.context() as patch:
                lowered(limits, patch)
                texts.append(print_kernel(program))
                assert "_part_" in texts[-1]
    with monkeypatch.context() as patch:
        lowered(LIMITS[0], patch)
        texts.append(print_kernel(program_of(scene, errors=True)))
        texts.append(print_kernel(program, counted=True))
    compiles(tmp_path, texts)


@pytest.mark.parametrize(("scene", "limits"), in_turn(SCENES, LIMITS[1:], LIMITS[0]))
def test_parts_change_no_bit(scene: Scene, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    program = program_of(scene)
    columns = given(program)
    for lanes in (c_polygon.LONGEST, 0):
        monkeypatch.setattr(c_polygon, "LONGEST", lanes)
        whole = compile_c(program)(columns, 5)
        with monkeypatch.context() as patch:
            lowered(limits, patch)
            np.testing.assert_array_equal(compile_c(program)(columns, 5), whole)


def known(reference: Reference) -> teg.Evaluator:
    return teg.compile(reference.build(), [teg.param(k) for k in reference.params])


REFERENCE_LIMITS = LIMITS[:3]


@pytest.mark.slow
@pytest.mark.parametrize("orders", [1, 2])
def test_every_reference_compiles_in_parts(orders: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = []
    for reference in REFERENCES:
        if orders == 2 and not reference.hess:
            continue
        program = known(reference).program(orders)
        for limits in REFERENCE_LIMITS:
            with monkeypatch.context() as patch:
                lowered(limits, patch)
                texts.append(print_kernel(program))
    compiles(tmp_path, texts)


@pytest.mark.slow
@pytest.mark.parametrize("reference", [r for r in REFERENCES if "slow" not in r.tags], ids=lambda r: r.id)
def test_no_bit_of_a_reference_changes_in_parts(reference: Reference, monkeypatch: pytest.MonkeyPatch) -> None:
    program = known(reference).program(1)
    columns = [np.array([reference.params[name]]) for name in program.parameters]
    whole = compile_c(program)(columns, 1)
    lowered({"PART": 3, "BY_VALUE": 4}, monkeypatch)
    np.testing.assert_array_equal(compile_c(program)(columns, 1), whole)


def test_a_function_with_its_derivatives_is_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    u, v = params("u v")
    f = teg.function("wave", [u, v], teg.exp(-u * u) * teg.cos(v) + u * v)
    program = teg.compile(integral(f(x, a) * bracket(x < t), (x, 0, 1))).program(2)
    assert any(isinstance(s, Assign) and s.op == "call" for s in statements(program.body))
    texts = []
    for limits in LIMITS:
        with monkeypatch.context() as patch:
            lowered(limits, patch)
            texts.append(print_kernel(program))
    compiles(tmp_path, texts)


def test_a_step_that_reads_more_than_it_declares_is_refused() -> None:
    """What a part takes follows from declarations, so a wrong one must not reach the C compiler."""
    step = Step((), ("p0",), lines=lambda scope: [f"f[0] = {scope('p0')} + {scope('p1')};"])
    frame = Frame(["p0", "p1"], [[step]], (), False)
    with pytest.raises(AssertionError, match="p1 is spelled by a step that does not declare it"):
        frame.block(0)


def _total(count: int) -> Expr:
    """A sum in whose integrals there are many literals, in a kernel that is cut."""
    terms = [integral(teg.exp(-(0.1234567 + k) * x * a) * bracket(x < t + 0.0123 * k), (x, 0, 1)) for k in range(count)]
    return sum(terms)  # type: ignore[return-value]


@pytest.mark.slow
def test_the_hessian_of_a_triangles_colour(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A body that is too long for lanes, and for one part: what adds up its values stands in parts too."""
    program = teg.compile(pixel(2)).program(2)
    columns = given(program)
    monkeypatch.setattr(c_polygon, "LONGEST", 0)
    whole = compile_c(program)(columns, 5)
    for part in (10, 60):
        monkeypatch.setattr(c_frame, "PART", part)
        np.testing.assert_array_equal(compile_c(program)(columns, 5), whole)
    lowered({"PART": 1}, monkeypatch)
    compiles(tmp_path, [print_kernel(program)])


def test_literals_of_a_cut_routine() -> None:
    """A literal that a routine passes through the workspace to another one is known in the part that does so."""
    program = teg.compile(integral(_total(12) * bracket(y < a), (y, 0, 1))).program(1)
    columns = [np.array([0.7]), np.array([0.4])]
    whole = compile_c(program)(columns, 1)
    with pytest.MonkeyPatch.context() as patch:
        lowered({"PART": 4, "BY_VALUE": 1, "LITERALS": 10**6}, patch)
        np.testing.assert_array_equal(compile_c(program)(columns, 1), whole)
