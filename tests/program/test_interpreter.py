"""The meaning of programs: the exact values of the tables that the backends are tested by, and what NumPy's kernels give."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import teg
from teg.analysis.settings import Integration
from teg.backends.numpy.kernel import compile_numpy
from teg.backends.numpy.loops import LaneKernel
from teg.ir.traverse import parameters
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.program.errors_in_loops import with_array_error_estimates
from teg.pipeline import compiled_outputs, flatten, program_for
from teg.program import Called, Integrate, Program, Rational, Sample, statements
from teg.program.arrays import ArrayProgram, ArraySpec, Integers, Like, Load, Loop, Number, Run, Scatter
from teg.program.interpreter import interpret, interpret_arrays
from teg.program.operations import OPERATIONS
from tests.backends.bend_programs import BENT
from tests.backends.isolate_programs import ISOLATE_CASES
from tests.backends.locate_programs import LOCATE_CASES
from tests.backends.programs import CASES, Case, columns, expected, let
from tests.backends.test_arrays import PROGRAMS, VALUES
from tests.references import REFERENCES, Reference

LONG = {  # seconds
    "the quarter of a disc, the inner break watched, not given: ∫∫ [x² + y² < p0] and its moment ∫∫ … x",
    "an integral, a sum and a rectangle in the enclosure",
}
MOST = 20_000
"""Evaluations of an integrand that the interpreter is asked for."""
SPECIALISED = "a function of a sum in an integral"
"""Compiled for the lengths of its arrays."""


def marked(case: Case) -> Any:
    return pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.name in LONG else [])


@pytest.mark.parametrize("case", [marked(c) for c in (*CASES, *BENT, *ISOLATE_CASES, *LOCATE_CASES)])
def test_exact_values(case: Case) -> None:
    given = [np.broadcast_to(column, (case.n,)) for column in columns(case)]
    found = [interpret(case.program, [float(column[i]) for column in given]) for i in range(case.n)]
    values = np.array([f.outputs for f in found]).T
    np.testing.assert_allclose(values, expected(case), rtol=case.tolerance, atol=case.tolerance)
    assert tuple(sorted({k for f in found for k in f.ties})) == case.ties
    kernel = compile_numpy(case.program).outcome(columns(case), case.n)
    np.testing.assert_allclose(values, kernel.values, rtol=1e-13, atol=1e-13)
    assert any(f.missed for f in found) == kernel.missed
    assert any(f.crowded for f in found) == kernel.crowded


def assert_alike(program: Program, arguments: list[float], outputs: int, most: float = math.inf) -> None:
    """NumPy's kernel gives the same, the ties, what was missed and how many evaluations it took included; error estimates, behind the
    outputs, are alike as far as roundings are."""
    given = [np.asarray(a) for a in arguments]
    kernel = compile_numpy(program)
    outcome, ties = kernel.outcome(given, 1), kernel.met_ties(given, 1)
    if outcome.evaluations > most:
        return
    found = interpret(program, arguments)
    np.testing.assert_allclose(found.outputs[:outputs], outcome.values[:outputs, 0], rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(found.outputs[outputs:], outcome.values[outputs:, 0], rtol=1e-2, atol=1e-14)
    assert found[1:] == (ties, outcome.missed, outcome.crowded, outcome.evaluations)


@pytest.mark.parametrize(
    "reference", [pytest.param(r, id=r.id, marks=[pytest.mark.slow] if i % 4 else []) for i, r in enumerate(REFERENCES)]
)
def test_references_are_alike(reference: Reference) -> None:
    """Values and gradients of programs of every kind, with their error estimates."""
    e = reference.build()
    by = parameters(e)
    outputs = [leaf for output in compiled_outputs(e, by, 1, Exact()) for leaf in flatten(output)]
    program = program_for(outputs, [p.name for p in by], Integration(), errors=True)
    assert_alike(program, [reference.params[p.name] for p in by], len(outputs), MOST)


x, y = teg.vars("x y")
t, a = teg.params("t a")
OTHERS: dict[str, tuple[teg.Expr, Integration]] = {
    "a pole beside the interval": (teg.integral((1 + x) ** 2 / (x + a), (x, 0, 1)), Integration()),
    "a pole of a power, far and near": (teg.integral(x / (t * x + a) ** 3 + 1 / (x + 9 * a) ** 2, (x, 0, 1)), Integration()),
    "pseudo-random points": (teg.integral(teg.sin(x * t) * y + a, (x, 0, 1), (y, 0, t)), Integration(rule="montecarlo", order=50)),
    "Sobol' points": (teg.integral(teg.sin(x * t) * y + a, (x, 0, 1), (y, 0, t)), Integration(rule="qmc", order=64)),
    "the midpoint rule": (teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), Integration(rule="midpoint", order=16)),
    "a narrow peak": (teg.integral(teg.exp(-(((x - t) * 4e3) ** 2) * a) * teg.cos(x), (x, 0, 1)), Integration()),
    "infinite bounds": (teg.integral(teg.exp(-(x**2) * a) * teg.bracket(x < t), (x, -math.inf, math.inf)), Integration()),
    "a function": (teg.integral(teg.function("shade", [y], teg.sin(3 * y) * y)(x * a), (x, 0, t)), Integration()),
    "a power at an end": (teg.integral(x**-0.7 * teg.cos(a * x), (x, 0, t)), Integration()),
}


def other(name: str) -> Program:
    e, how = OTHERS[name]
    return program_for([leaf for output in compiled_outputs(e, [t, a], 1, Exact()) for leaf in flatten(output)], ["t", "a"], how, True)


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("point", [[0.6, 0.3], [0.45, 1.2]])
def test_other_programs_are_alike(name: str, point: list[float]) -> None:
    assert_alike(other(name), point, 3)


def test_these_are_of_every_kind() -> None:
    found = {name: list(statements(other(name).body)) for name in OTHERS}
    integrals = {name: [s for s in every if isinstance(s, Integrate)] for name, every in found.items()}
    assert any(isinstance(s.rule, Rational) for s in integrals["a pole of a power, far and near"])
    assert any(isinstance(s, Sample) for s in found["Sobol' points"])
    assert any(s.guard is not None for s in integrals["a narrow peak"])
    assert any(s.infinite for s in integrals["infinite bounds"])
    assert any(b.kind == "end" for s in integrals["a power at an end"] for b in s.bends)
    assert other("a function").functions


def assert_arrays_alike(program: ArrayProgram, arguments: list[float], arrays: list[Any]) -> None:
    """NumPy's loops give the same numbers, and the same arrays where there were scatters."""
    kernel = LaneKernel(program, compile_numpy).results([np.asarray(v) for v in arguments], arrays, 1)
    found = interpret_arrays(program, arguments, arrays)
    assert (found.missed, found.crowded) == (kernel.missed, kernel.crowded)
    for output, value, there in zip(program.outputs, found.outputs, kernel.values, strict=True):
        if isinstance(output, Like):
            assert isinstance(value, dict)
            whole = np.zeros(arrays[output.array].shape)
            for place, entry in value.items():
                whole[place] = entry
            np.testing.assert_allclose(whole, there[0], rtol=1e-11, atol=1e-13)
        else:
            np.testing.assert_allclose(value, there[0], rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("name", [name for name in PROGRAMS if name != SPECIALISED])
def test_programs_with_arrays_are_alike(name: str) -> None:
    program: Any = teg.compile(PROGRAMS[name], backend="numpy").program(1)
    assert isinstance(program, ArrayProgram)
    arrays = [np.asarray(VALUES[spec.name], dtype=np.int64 if spec.integers else np.float64) for spec in program.arrays]
    assert_arrays_alike(program, [VALUES[p] for p in program.parameters], arrays)


def test_so_are_loops_with_error_estimates() -> None:
    """Σ_k W[F[k]]·exp(…) over a range that begins at a parameter, scattered too, in a loop over its own length."""
    kernel = Program(("w", "k"), (let("v1", "exp", "p0"), let("v2", "mul", "v1", "p1")), ("v2", "v1"))
    inner = (
        Integers("i4", "gather", ("i3",), 1),
        Load("v5", 0, ("i4",)),
        Number("v6", "i3"),
        Run(kernel, ("v5", "v6"), ("v7", "v8")),
        Scatter(1, 0, ("i4",), "v8"),
    )
    body = (
        Integers("i0", "param", (0,)),
        Integers("i1", "length", (0,), 1),
        Integers("i2", "mod", ("i1", 4)),
        Loop("i9", "i0", "i2", (Loop("i3", "i9", "i1", inner, ("v7",), ("v10",)),), ("v10",), ("v11",)),
    )
    arrays = ArraySpec("W", 1, False), ArraySpec("F", 1, True)
    program = with_array_error_estimates(ArrayProgram(("n",), arrays, body, ("v11", Like(0))))
    assert len(program.outputs) == 4
    assert_arrays_alike(program, [1.0], [np.array([0.3, -0.2, 0.7]), np.array([2, 0, 1, 1, 2, 0, 0])])


SPECIAL = (0.0, -0.0, 0.5, -0.5, 1.0, -2.0, 3.0, 1e200, -1e200, 1e-320, math.inf, -math.inf, math.nan)
OF_NUMBERS = [op for op, o in OPERATIONS.items() if set(o.operands) == {"number"} and op != "call"]


@pytest.mark.parametrize("op", OF_NUMBERS)
def test_operations_are_those_of_ieee_arithmetic(op: str) -> None:
    """Zeros and their signs, infinities and NaN, against NumPy's."""
    operands = len(OPERATIONS[op].operands) if not OPERATIONS[op].repeated else 2
    points = [(u,) for u in SPECIAL] if operands == 1 else [(u, v) for u in SPECIAL for v in SPECIAL]
    names = tuple(f"p{i}" for i in range(operands))
    body = (let("v0", op, *names),) if OPERATIONS[op].result == "number" else (let("b0", op, *names), let("v0", "select", "b0", 1.0, 0.0))
    program = Program(names, body, ("v0",))
    there = compile_numpy(program)([np.array(column) for column in zip(*points, strict=True)], len(points))[0]
    for point, value in zip(points, there, strict=True):
        (found,) = interpret(program, list(point)).outputs
        np.testing.assert_allclose(found, value, rtol=1e-14, err_msg=f"{op}{point}")
        if op not in ("min", "max") and not math.isnan(value):  # of 0 and -0 either may be the smaller
            assert math.copysign(1.0, found) == math.copysign(1.0, value), f"{op}{point}"


def test_a_function_without_a_body_has_no_meaning() -> None:
    program = Program(("x",), (let("v0", "call", 0, "p0"),), ("v0",), (), (Called(None, (0,)),))
    with pytest.raises(AssertionError, match="without a body"):
        interpret(program, [1.0])
