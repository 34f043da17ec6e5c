"""The NumPy backend: exact values, ties, chunks, long programs."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from teg.backends.numpy.kernel import compile_numpy
from teg.program import Adaptive, Assign, Bend, Gauss, Integrate, Program
from teg.program.dce import without_dead_code
from tests.backends.programs import (
    ADAPTIVE,
    CASES,
    TWO_VARIABLES,
    WATCHED,
    Case,
    columns,
    expected,
    integrate,
    let,
    program,
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_value(case: Case) -> None:
    found = compile_numpy(case.program).outcome(columns(case), case.n)
    np.testing.assert_allclose(found.values, expected(case), rtol=case.tolerance, atol=case.tolerance)
    assert found.missed == case.missed


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_met_ties(case: Case) -> None:
    assert compile_numpy(case.program).met_ties(columns(case), case.n) == case.ties


@pytest.mark.parametrize("case", [*TWO_VARIABLES, *ADAPTIVE], ids=lambda case: case.name)
@pytest.mark.parametrize("memory", [1, 20_000])
def test_a_small_memory_changes_rounding_only(case: Case, memory: int) -> None:
    found = compile_numpy(case.program, memory=memory)(columns(case), case.n)
    whole = compile_numpy(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, whole, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("case", TWO_VARIABLES, ids=lambda case: case.name)
def test_a_large_batch_equals_its_elements(case: Case) -> None:
    kernel = compile_numpy(case.program, memory=2**20)
    many = [np.tile(column, 500) if column.ndim else column for column in columns(case)]
    np.testing.assert_allclose(kernel(many, 500 * case.n), np.tile(kernel(columns(case), case.n), 500), rtol=1e-14, atol=1e-15)


def test_an_empty_batch() -> None:
    kernel = compile_numpy(program(1, (let("v0", "sin", "p0"),), "v0", 1.0))
    assert kernel([np.empty(0)], 0).shape == (2, 0)


def test_no_outputs() -> None:
    assert compile_numpy(program(1, ()))([np.zeros(3)], 3).shape == (0, 3)


def test_pickles() -> None:
    case = TWO_VARIABLES[0]
    kernel = pickle.loads(pickle.dumps(compile_numpy(case.program, memory=4096)))
    assert kernel.memory == 4096
    np.testing.assert_allclose(kernel(columns(case), case.n), expected(case), rtol=1e-14)


def test_source_is_python_with_a_line_a_statement() -> None:
    kernel = compile_numpy(TWO_VARIABLES[0].program)
    assert "v0 = p0 * x1" in kernel.source
    assert "integral_0 = integrals.GaussIntegral(" in kernel.source
    compile(kernel.source, "text", "exec")


def evaluations(rule: Adaptive, bends: tuple[Bend, ...] = ()) -> int:
    """How many evaluations ∫₀¹√x dx takes."""
    root = integrate("v9", "x0", 0.0, 1.0, (let("v0", "sqrt", "x0"),), "v0", rule=rule, bends=bends)
    found = compile_numpy(program(0, (root,), "v9")).outcome([], 1)
    assert found.values[0, 0] == pytest.approx(2 / 3, rel=rule.tol)
    assert not found.missed
    return found.evaluations


def test_flat_ends_and_bends_save_evaluations_at_a_square_root() -> None:
    """With u²(3 - 2u) few intervals suffice for √x, with its bend one look; without them the end is bisected again and again."""
    plain = evaluations(Adaptive(1e-10))
    assert evaluations(Adaptive(1e-10, cubic=True)) < plain / 10
    assert evaluations(Adaptive(1e-10), (Bend("root", (0.0, 1.0, 0.0)),)) == 10
    assert plain < 60 * 18


def test_watched_conditions_are_not_dead_code() -> None:
    case = WATCHED[0]
    pruned = without_dead_code(program(1, case.program.body, "v8"))
    np.testing.assert_allclose(compile_numpy(pruned)(columns(case), case.n)[0], expected(case)[0], rtol=1e-12, atol=1e-13)
    (outer,) = without_dead_code(program(1, case.program.body, "v9")).body
    assert isinstance(outer, Integrate)
    assert [s.name for s in outer.body if isinstance(s, Assign)] == ["v0", "b0", "v1", "v70"]


def test_a_watched_jump_costs_two_intervals_a_bisection() -> None:
    """It is halved until WATCH_WIDTH = 2⁻⁴⁴, of 18 nodes and both ends each time."""
    found = compile_numpy(WATCHED[0].program).outcome([np.array([0.3])], 1)
    assert found.evaluations == (1 + 2 * 44) * (18 + 2)
    assert not found.missed


def test_what_is_shared_by_a_batch_is_evaluated_once() -> None:
    kernel = compile_numpy(program(1, (integrate("v9", "x0", 0.0, "p0", (), "x0", rule=Adaptive(1e-9)),), "v9"))
    assert kernel.outcome([np.array(2.0)], 5).evaluations == 10
    assert kernel.outcome([np.full(5, 2.0)], 5).evaluations == 50


def long_program(statements: int, integrals: int) -> Program:
    """A chain of statements, then integrals that each read the chain somewhere, and the sum of all."""
    body: list[Assign | Integrate] = []
    names = ["p0", "p1"]
    for i in range(statements):
        body.append(let(f"v{i}", ("add", "sub", "mul")[i % 3], names[-1], names[-1 - i % 37 % len(names)]))
        body.append(let(f"w{i}", "sin", f"v{i}"))
        names.append(f"w{i}")
    for i in range(integrals):
        flags = (let(f"f{i}", "sub", f"x{i}", names[i]), let(f"b{i}", "gt0", f"f{i}"))
        inner, one = (let(f"g{i}", "mul", f"x{i}", names[-1 - i]),), Gauss(1)
        cut = {"breaks": (names[i],), "flags": flags, "need": f"b{i}"}
        body.append(integrate(f"r{i}", f"x{i}", -1.0, 1.0, inner, f"g{i}", rule=one, **cut))
    body.append(let("total", "add", *(f"r{i}" for i in range(integrals)), names[-1]))
    return program(2, tuple(body), "total", names[-1])


def long_value(statements: int, integrals: int, p0: float, p1: float) -> tuple[float, float]:
    """The outputs of `long_program`, in plain Python."""
    values = [p0, p1]
    for i in range(statements):
        a, b = values[-1], values[-1 - i % 37 % len(values)]
        values.append(math.sin((a + b, a - b, a * b)[i % 3]))
    sums = [values[-1 - i] * (1 - values[i] ** 2) / 2 for i in range(integrals)]
    return math.fsum(sums) + values[-1], values[-1]


@pytest.mark.slow
@pytest.mark.parametrize(("statements", "integrals"), [(3, 2), (300, 200), (40_000, 10_000)])
def test_long_programs(statements: int, integrals: int) -> None:
    kernel = compile_numpy(long_program(statements, integrals))
    found = kernel([np.array([0.25, 0.5]), np.array(0.75)], 2)
    for i, p0 in enumerate((0.25, 0.5)):
        np.testing.assert_allclose(found[:, i], long_value(statements, integrals, p0, 0.75), rtol=1e-8, atol=1e-11)


def test_text_grows_linearly() -> None:
    """Values that live long are handed from part to part once, not once a part."""
    small, large = (len(compile_numpy(long_program(n, n // 4)).source) for n in (4_000, 16_000))
    assert large < 4.5 * small


def test_deep_nesting_within_a_small_memory() -> None:
    """∫∫∫ 1 over the simplex of side p0, with 3 nodes a level in chunks of one lane."""
    inner = integrate("v3", "x2", 0.0, "v2", (), 1.0, rule=Gauss(1))
    middle = integrate("v4", "x1", 0.0, "v1", (let("v2", "sub", "v1", "x1"), inner), "v3", rule=Gauss(2))
    outer = integrate("v5", "x0", 0.0, "p0", (let("v1", "sub", "p0", "x0"), middle), "v4", rule=Gauss(2))
    side = np.linspace(-1, 2, 7)
    for memory in (1, 2**28):
        found = compile_numpy(program(1, (outer,), "v5"), memory=memory)([side], 7)
        np.testing.assert_allclose(found[0], side**3 / 6, rtol=1e-14, atol=1e-15)
