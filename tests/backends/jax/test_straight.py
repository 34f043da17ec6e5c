"""Straight lines in JAX: the numbers of programs that clip corner by corner, without loops, gathers and sorts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.numpy.kernel import compile_numpy
from teg.program import Program
from tests.bench.scenes import half_planes, triangle_pixel

jax = pytest.importorskip("jax")

from teg.backends.jax import straight as jax_straight  # noqa: E402
from teg.backends.jax.kernel import compile_jax  # noqa: E402
from teg.backends.jax.printer import DIALECT  # noqa: E402
from teg.backends.jax.straight import straight  # noqa: E402
from teg.backends.jax.together import together  # noqa: E402

pytestmark = [pytest.mark.usefixtures("x64", "derived_once")]
SCENES = {"one colour": triangle_pixel(0), "linear": triangle_pixel(1), "half-planes": half_planes(4)}
PLAIN = {
    "abs", "add", "and", "broadcast_in_dim", "convert_element_type", "copy", "div", "eq", "ge", "gt", "integer_pow", "le", "lt", "max",
    "min", "mul", "neg", "not", "or", "select_n", "sub",
}  # fmt: skip


def program_of(name: str) -> Program:
    """The program of value and gradient."""
    e, wrt = SCENES[name]
    program = teg.compile(e, wrt, backend="numpy").program(1)
    assert isinstance(program, Program)
    return program


def points(program: Program, n: int) -> list[Any]:
    """Triangles and half-planes around the unit box: stout, thin and tiny ones, those on a grid of the box, and what is no number."""
    rng = np.random.default_rng(3)
    size, thin = 10.0 ** rng.uniform(-6.0, 1.0, n), 10.0 ** rng.uniform(-12.0, 0.0, n) * (rng.random(n) < 0.4)
    turn, angle = rng.uniform(0.0, 6.3, n), 2.1 * np.arange(3)[:, None] + rng.uniform(0.0, 2.1, n)
    u, v = size * np.cos(angle), np.where(thin > 0.0, thin, 1.0) * size * np.sin(angle)
    middle = rng.random((2, n))
    named = {f"x{k}": middle[0] + u[k] * np.cos(turn) - v[k] * np.sin(turn) for k in range(3)}
    named |= {f"y{k}": middle[1] + u[k] * np.sin(turn) + v[k] * np.cos(turn) for k in range(3)}
    named |= {"left": np.zeros(n), "right": np.ones(n), "bottom": np.zeros(n), "top": np.ones(n)}
    columns = [named.get(p, rng.standard_normal(n)).copy() for p in program.parameters]
    for name, column in zip(program.parameters, columns, strict=True):
        if name not in ("left", "right", "bottom", "top"):
            column[::5] = np.round(2.0 * column[::5]) / 2.0
    for i, column in enumerate(columns):
        column[7 * i] = (np.nan, np.inf, -np.inf)[i % 3]
    return columns


@pytest.mark.parametrize("name", ["one colour", "half-planes", pytest.param("linear", marks=pytest.mark.slow)])
def test_points_of_all_kinds(name: str) -> None:
    program = program_of(name)
    columns = points(program, 1500)
    with np.errstate(all="ignore"):
        expected = compile_numpy(program)(columns, 1500)
    found = compile_jax(program)(columns, 1500)
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
    finite = np.isfinite(expected)
    np.testing.assert_allclose(found[finite], expected[finite], rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", SCENES)
def test_the_line_is_arithmetic(name: str) -> None:
    program = program_of(name)
    kernel = compile_jax(program)
    line: Any = kernel._straight
    traced = jax.make_jaxpr(lambda *scalars: line(-0.0, *scalars))(*(0.5,) * len(program.parameters))
    inside = [e.params["jaxpr"].jaxpr.eqns if e.primitive.name in ("jit", "pjit") else [e] for e in traced.eqns]
    assert {e.primitive.name for equations in inside for e in equations} <= PLAIN
    assert sum(map(len, inside)) <= 4000
    assert "def straight(" in kernel.source


def test_most_stout_triangles_are_good_and_none_outside_of_the_box_is_bad() -> None:
    program = program_of("linear")
    line: Any = compile_jax(program)._straight
    rng = np.random.default_rng(1)
    corners = {"x0": -1.0, "y0": -0.9, "x1": 2.0, "y1": -0.3, "x2": 0.4, "y2": 2.0}
    fixed = {"left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0}
    for shift, least in ((0.0, 0.95), (20.0, 1.0)):
        columns = [
            corners[p] + shift + rng.uniform(-0.5, 0.5, 500) if p in corners else np.full(500, fixed.get(p, 0.3))
            for p in program.parameters
        ]
        _, good = line(-0.0, *map(jax.numpy.asarray, columns))
        assert np.mean(np.broadcast_to(good, (500,))) >= least, shift


@pytest.mark.parametrize("name", ["one colour", *(pytest.param(name, marks=pytest.mark.slow) for name in ("linear", "half-planes"))])
def test_the_line_is_few_kernels_in_which_nothing_is_repeated(name: str, as_users_jit: dict[str, bool]) -> None:
    """One of quotients and one of everything else, and what makes truth values and the like of their results."""
    program = program_of(name)
    line: Any = compile_jax(program)._straight

    def results(*scalars: Any) -> list[Any]:
        outputs, good = line(-0.0, *scalars)
        return [*map(jax.numpy.asarray, outputs), good]

    def products(function: Any) -> tuple[int, int]:
        columns = [np.full(16, 0.5) for _ in program.parameters]
        text = jax.jit(jax.vmap(function)).lower(*columns).compile(as_users_jit).as_text()
        return text.count(" multiply("), text.count("kind=kLoop")

    once, kernels = products(lambda *scalars: together(results, *scalars))
    often, many = products(results)
    assert kernels <= 4
    assert 1.5 * once < often
    assert 3 * kernels < many


def test_products_to_which_something_is_added_have_one_rounding() -> None:
    """A product with a power of two is exact, and no sum is made of one that is compared, or multiplied again."""
    lines = [text.strip() for text in (straight(program_of("linear"), DIALECT) or "").splitlines()]
    guarded = [text for text in lines if text.endswith(" + zero")]
    assert 40 < len(guarded) < 120
    assert not [text for text in guarded if " 0.5 " in text or " 2.0 " in text]
    name = guarded[-1].split(" = ")[0]
    assert any(name in text.split(" = ")[1].split() for text in lines if " + " in text or " - " in text)


def test_programs_without_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    x, t = teg.var("x"), teg.param("t")
    program = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, 1)), [t], backend="numpy").program(1)
    assert isinstance(program, Program)
    assert straight(program, DIALECT) is None
    monkeypatch.setattr(jax_straight, "LONGEST", 10)
    assert straight(program_of("linear"), DIALECT) is None
