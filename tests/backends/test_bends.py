"""Bends, tails, estimates and missed tolerances, in every backend: exact values, agreement, and what they cost."""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from teg.backends.c.kernel import compile_c, print_kernel
from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from teg.program import MAX_DEPTH, MAX_INTERVALS, Adaptive, Assign, Gauss, Integrate, Outcome, Program, statements
from tests.backends.bend_programs import (
    BENT,
    FIELDS,
    INSIDE_PLACES,
    NODES,
    PLACES,
    TWO_BENDS,
    WHEN,
    Place,
    of_places,
)
from tests.backends.c_checks import (
    LIMITS,
    any_number_of_threads_gives_the_same,
    behaviour_is_defined,
    in_turn,
    limits_change_no_bit,
    lines_are_short,
    text_compiles_without_warnings,
)
from tests.backends.missed_programs import MISSED, RESTLESS, estimated, of_waves
from tests.backends.programs import CASES, TIGHT, Case, columns, expected, integrate, let, program
from tests.backends.tail_programs import TAILS

needs_c = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
QUICK = (*(PLACES[i][0] for i in (0, 2, 6, 7)), TWO_BENDS, TAILS[0], MISSED[1])
"""Those that JAX compiles in the quick run."""
SLOW = tuple(case for case in BENT if case not in QUICK)


def name(case: Case) -> str:
    return case.name


def columns_of(case: Case, i: int) -> list[npt.NDArray[np.float64]]:
    """The columns of one element of a batch."""
    return [column[i : i + 1] if column.ndim else column.reshape(1) for column in columns(case)]


def evaluations(program: Program, given: Sequence[npt.NDArray[np.float64]]) -> int:
    """How many a run of one element takes."""
    return compile_numpy(program).outcome(given, 1).evaluations


def has_its_values(found: Outcome, case: Case) -> None:
    np.testing.assert_allclose(found.values, expected(case), rtol=case.tolerance, atol=case.tolerance)
    assert found.missed == case.missed


# Values


@pytest.mark.parametrize("case", BENT, ids=name)
def test_value_in_numpy(case: Case) -> None:
    has_its_values(compile_numpy(case.program).outcome(columns(case), case.n), case)


@needs_c
@pytest.mark.parametrize("case", BENT, ids=name)
def test_value_in_c(case: Case) -> None:
    found = compile_c(case.program).outcome(columns(case), case.n)
    has_its_values(found, case)
    np.testing.assert_allclose(found.values, compile_numpy(case.program)(columns(case), case.n), rtol=1e-13, atol=1e-15)


@pytest.mark.slow
@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("case", [*QUICK, *SLOW], ids=name)
def test_value_in_jax(case: Case) -> None:
    found = compile_jax(case.program).outcome(columns(case), case.n)
    has_its_values(found, case)
    np.testing.assert_allclose(found.values, compile_numpy(case.program)(columns(case), case.n), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("case", BENT, ids=name)
@pytest.mark.parametrize("memory", [1, 20_000])
def test_a_small_memory_changes_rounding_only(case: Case, memory: int) -> None:
    found = compile_numpy(case.program, memory=memory).outcome(columns(case), case.n)
    whole = compile_numpy(case.program).outcome(columns(case), case.n)
    np.testing.assert_allclose(found.values, whole.values, rtol=1e-14, atol=1e-15)
    assert found[1:] == whole[1:]


# Random places


def random_places(kind: str, count: int) -> list[npt.NDArray[np.float64]]:
    """Columns of `of_places`: pieces of any length, linear and quadratic functions with zeros at, near, between and far from their ends,
    also inside, where they do not count."""
    random = np.random.default_rng(ord(kind[0]))
    lo = random.choice([0.0, -1.0, 7.0], count)
    hi = lo + random.choice([1.0, 1e-3, 30.0], count) * random.choice([1.0, -1.0], count)
    base = np.where(random.random(count) < 0.5, lo, random.choice([0.0, 2.0], count))
    near = random.choice([0.0, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 5.0], (2, count)) * random.choice([1.0, -1.0], (2, count))
    first, second = (np.where(random.random(count) < 0.5, lo, hi) - base + near[i] * (hi - lo) for i in range(2))
    sort = random.integers(0, 3, count)  # linear, two real zeros, two complex ones
    gap = np.abs(second) + 1e-6
    sign = random.choice([1.0, -3.0], count)
    c0 = sign * np.select([sort == 0, sort == 1], [-first, first * second], first * first + gap * gap)
    c1 = sign * np.select([sort == 0, sort == 1], [1.0, -(first + second)], -2 * first)
    c2 = np.where(sort == 0, 0.0, sign)
    return [lo, hi, c0, c1, c2, base, np.zeros(count), np.ones(count)]


@needs_c
@pytest.mark.parametrize("kind", ["root", "end", "pole"])
def test_random_places_are_the_same_in_numpy_and_c(kind: str) -> None:
    """And wherever the zeros are the whole piece is integrated over."""
    count = 1000
    values, given = {"root": ("root", "one"), "end": ("root", "one"), "pole": ("one",)}[kind], random_places(kind, count)
    whole = of_places(kind, values, Adaptive(1e-7))
    c = compile_c(whole, counted=True).outcome(given, count)
    numpy = compile_numpy(whole).outcome(given, count)
    np.testing.assert_allclose(c.values, numpy.values, rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(numpy.values[-1], given[1] - given[0], rtol=1e-8 if kind == "pole" else 1e-13, atol=4e-15)
    assert c.evaluations == pytest.approx(numpy.evaluations, rel=1e-2)
    if kind != "pole":
        given[WHEN][:] = -1.0
        plain = compile_numpy(whole).outcome(given, count)
        np.testing.assert_allclose(numpy.values, plain.values, rtol=3e-6, atol=3e-8)
        assert numpy.evaluations < plain.evaluations / 1.5


@pytest.mark.slow
@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("kind", ["root", "end", "pole"])
def test_random_places_are_the_same_in_numpy_and_jax(kind: str) -> None:
    count = 200
    values, given = {"root": ("root", "one"), "end": ("root", "one"), "pole": ("one",)}[kind], random_places(kind, count)
    whole = of_places(kind, values, Adaptive(1e-7))
    found = compile_jax(whole)(given, count)
    np.testing.assert_allclose(found, compile_numpy(whole)(given, count), rtol=1e-11, atol=1e-14)


@pytest.mark.slow
@needs_c
@pytest.mark.usefixtures("x64")
def test_no_zero_inside_makes_a_substitution_leave_something_out() -> None:
    """At an end it is moved there, elsewhere the bend does not count."""
    whole = of_places("root", ("one", "root"), Adaptive(1e-10))
    given = [np.array([getattr(place, field) for place in INSIDE_PLACES]) for field in FIELDS]
    plain = [*given[:WHEN], -given[WHEN]]
    count = len(INSIDE_PLACES)
    for kernel in (compile_numpy(whole), compile_c(whole), compile_jax(whole)):
        ones, roots = kernel(given, count)
        np.testing.assert_allclose(ones, given[1] - given[0], rtol=1e-15)
        np.testing.assert_allclose(roots, kernel(plain, count)[1], rtol=1e-9)
    for i, place in enumerate(INSIDE_PLACES):
        bent, straight = (evaluations(whole, [column[i : i + 1] for column in columns]) for columns in (given, plain))
        assert (bent < straight) == ("a little inside" in place.name and "close" not in place.name)


# Cost


def of_every_place() -> list[tuple[Case, int, Place]]:
    return [(case, i, place) for case, places in PLACES for i, place in enumerate(places)]


@pytest.mark.parametrize(("case", "i", "place"), of_every_place(), ids=lambda a: a.name if isinstance(a, (Case, Place)) else "")
def test_a_bend_pays(case: Case, i: int, place: Place) -> None:
    """Where √D, or its inverse, is a polynomial in t, one look is enough; where the zero is at or near the piece many are saved."""
    given = columns_of(case, i)
    bent = evaluations(case.program, given)
    given[WHEN] = np.array([-1.0])
    plain = evaluations(case.program, given)
    if place.absent or "none" in place.name or "no bend" in place.name or "no zero" in place.name:
        assert bent == plain
    else:
        assert bent < plain or bent == NODES
    if place.looks:
        assert bent == place.looks * NODES
        assert plain > 2 * NODES


def test_two_bends_at_the_ends_pay() -> None:
    """Without them both ends are bisected again and again."""
    for i, most in enumerate((28, 64, 64, 388, 28)):
        given = columns_of(TWO_BENDS, i)
        assert evaluations(TWO_BENDS.program, given) <= most
    body = tuple(replace(s, bends=()) if isinstance(s, Integrate) else s for s in TWO_BENDS.program.body)
    assert evaluations(replace(TWO_BENDS.program, body=body), columns_of(TWO_BENDS, 0)) > 100 * 28


def is_counted_alike(case: Case) -> bool:
    """Whether C and NumPy evaluate at the same points: C stops in an interval that will be halved, and starts again only where a tie
    was met."""
    watched = [s for s in statements(case.program.body) if isinstance(s, Integrate) and s.watch]
    nested = any(isinstance(inner, Integrate) for s in watched for inner in statements(s.body))
    return not nested and not any(isinstance(s, Assign) and s.op == "tie" for s in statements(case.program.body))


COUNTED = [c for c in (*CASES, *BENT) if is_counted_alike(c) and any(isinstance(s, Integrate) for s in statements(c.program.body))]


@needs_c
@pytest.mark.parametrize("case", COUNTED, ids=name)
def test_c_and_numpy_count_the_same_evaluations(case: Case) -> None:
    """One element at a time: what a batch shares NumPy evaluates once."""
    c, numpy = compile_c(case.program, counted=True), compile_numpy(case.program)
    for i in range(case.n):
        by_c, by_numpy = (kernel.outcome(columns_of(case, i), 1) for kernel in (c, numpy))
        assert by_c.evaluations == by_numpy.evaluations
        assert by_c.missed == by_numpy.missed


@needs_c
def test_a_batch_counts_what_its_elements_do() -> None:
    case = TWO_BENDS
    kernel = compile_c(case.program, counted=True, threads=2)
    alone = sum(kernel.outcome(columns_of(case, i), 1).evaluations for i in range(case.n))
    assert kernel.outcome(columns(case), case.n).evaluations == alone
    assert compile_numpy(case.program).outcome(columns(case), case.n).evaluations == alone
    assert compile_c(case.program).outcome(columns(case), case.n).evaluations == 0
    assert "evaluations +=" not in print_kernel(case.program)


# Tolerances that are missed


@needs_c
@pytest.mark.usefixtures("x64")
def test_a_piece_takes_at_most_so_many_intervals() -> None:
    """In C and JAX those that still wait are measured once more, in NumPy all of a level are; which ones these are differs."""
    kernels = (compile_numpy(RESTLESS), compile_c(RESTLESS, counted=True), compile_jax(RESTLESS))
    for p, missed in ((100.0, False), (1e4, True)):
        found = [kernel.outcome([np.array([p])], 1) for kernel in kernels]
        assert [f.missed for f in found] == [missed] * 3
        np.testing.assert_allclose(found[1].values, found[2].values, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose([f.values[0, 0] for f in found], [(1 - np.cos(p)) / p] * 3, rtol=1e-8)
        np.testing.assert_allclose([f.values[1, 0] for f in found], [0.5] * 3, rtol=0.1)
        if missed:
            assert found[1].evaluations < (MAX_INTERVALS + MAX_DEPTH) * (18 + 20)
            assert found[0].evaluations < 2 * MAX_INTERVALS * (18 + 20)


@needs_c
@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("p", [9e3, 4e4])
def test_intervals_in_which_a_watched_sign_changes_have_an_estimate_when_there_is_no_more_room(p: float) -> None:
    """∫ [sin(p0·x) > 0] exp(x) over (0, 1): the sum of the last intervals, which are long, errs by no more than they say."""
    body = (let("v2", "mul", "p0", "x1"), let("v3", "sin", "v2"), let("b0", "gt0", "v3"), let("v1", "exp", "x1"))
    body += (let("v4", "select", "b0", "v1", 0.0),)
    whole = program(1, (integrate("v9", "x1", 0.0, 1.0, body, "v4", rule=Adaptive(1e-9), watch=("b0",), estimates="v8"),), "v9", "v8")
    starts = np.arange(0.0, p / (2 * np.pi)) * (2 * np.pi / p)
    exact = math.fsum(np.exp(np.minimum(starts + np.pi / p, 1.0)) - np.exp(starts))
    for kernel in (compile_numpy(whole), compile_c(whole), compile_jax(whole)):
        found = kernel.outcome([np.array([p])], 1)
        assert found.missed
        value, estimate = found.values[:, 0]
        assert abs(value - exact) <= estimate


def test_one_element_that_misses_is_told_of_its_batch() -> None:
    case = MISSED[4]
    kernel = compile_numpy(replace(case.program, body=tuple(replace(s, bends=()) for s in case.program.body if isinstance(s, Integrate))))
    assert not kernel.outcome([np.array([1.0, 2.0])], 2).missed
    assert kernel.outcome([np.array([1.0, 2.0, -0.9])], 3).missed


def tied(first: float, second: float) -> Program:
    """∫₀¹ x^q dx, q the `first` exponent in the one order of a tie, the `second` in the other."""
    body = (
        let("b0", "tie", "p0", 1.0, True, 0),
        let("v0", "select", "b0", first, second),
        integrate("v2", "x0", 0.0, 1.0, (let("v1", "pow", "x0", "v0"),), "v1", rule=Adaptive(1e-9)),
    )
    return program(1, body, "v2", ties=1)


@needs_c
@pytest.mark.usefixtures("x64")
def test_either_order_of_a_tie_may_miss() -> None:
    for kernel in (compile_numpy(tied(1.0, -0.9)), compile_c(tied(-0.9, 1.0)), compile_c(tied(1.0, -0.9)), compile_jax(tied(1.0, -0.9))):
        assert kernel.outcome([np.array([0.0])], 1).missed
        assert kernel.outcome([np.array([5.0, -5.0])], 2).missed  # one of them has the exponent -0.9
    for kernel in (compile_numpy(tied(1.0, 2.0)), compile_c(tied(1.0, 2.0))):
        found = kernel.outcome([np.array([0.0])], 1)
        assert found.values[0, 0] == pytest.approx(5 / 12)
        assert not found.missed


WATCHED_ENDS = program(  # ∫₀¹ [x < p0] ∫₀¹ y^q dy dx, q = 0 but at x = 0, where no node is
    1,
    (
        integrate(
            "v9",
            "x0",
            0.0,
            1.0,
            (
                let("b1", "gt0", "x0"),
                let("v0", "select", "b1", 0.0, -0.9),
                integrate("v2", "x1", 0.0, 1.0, (let("v1", "pow", "x1", "v0"),), "v1", rule=Adaptive(1e-9)),
                let("v3", "sub", "p0", "x0"),
                let("b0", "gt0", "v3"),
                let("v4", "select", "b0", "v2", 0.0),
            ),
            "v4",
            rule=Adaptive(1e-9),
            watch=("b0",),
        ),
    ),
    "v9",
)


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=needs_c), pytest.param("jax", marks=pytest.mark.slow)])
def test_what_is_missed_at_the_ends_of_a_watched_interval_does_not_count(backend: str, request: pytest.FixtureRequest) -> None:
    if backend == "jax":
        request.getfixturevalue("x64")
    compiled: Any = {"numpy": compile_numpy, "c": compile_c, "jax": compile_jax}[backend]
    found = compiled(WATCHED_ENDS).outcome([np.array([0.3])], 1)
    assert found.values[0, 0] == pytest.approx(0.3, rel=1e-9)
    assert not found.missed


# Estimates

ESTIMATED = [(rule, estimates) for rule in (Gauss(20), TIGHT, Adaptive(1e-6)) for estimates in (1, 2, 3)]


@needs_c
@pytest.mark.parametrize(("rule", "estimates"), ESTIMATED, ids=str)
def test_estimates(rule: Adaptive | Gauss, estimates: int) -> None:
    """Those with estimates meet their tolerance, and err by no more than they say, √x with its branch point too."""
    whole = estimated(rule, estimates)
    p = np.array([1.0, 20.0, -3.0])
    found = compile_numpy(whole).outcome([p], 3)
    exact = np.array([of_waves(float(v)) for v in p]).T
    values, errors = found.values[:3], found.values[3:]
    if isinstance(rule, Adaptive):
        assert not found.missed
        assert (np.abs(values - exact)[:estimates] <= errors + 1e-16).all()
        assert (errors <= 2 * rule.tol * np.maximum(1.0, np.abs(exact[:estimates]))).all()
    assert (errors > 0).all()
    assert errors.shape == (estimates, 3)
    c = compile_c(whole, counted=True).outcome([p], 3)
    np.testing.assert_allclose(c.values[:3], values, rtol=1e-14)
    np.testing.assert_allclose(c.values[3:], errors, rtol=1e-3, atol=1e-15)
    assert c.evaluations == found.evaluations


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(("rule", "estimates"), [(TIGHT, 2), *(pytest.param(*e, marks=pytest.mark.slow) for e in ESTIMATED)], ids=str)
def test_estimates_in_jax(rule: Adaptive | Gauss, estimates: int) -> None:
    whole = estimated(rule, estimates)
    p = np.array([1.0, 20.0, -3.0])
    found, reference = compile_jax(whole).outcome([p], 3), compile_numpy(whole).outcome([p], 3)
    np.testing.assert_allclose(found.values[:3], reference.values[:3], rtol=1e-14)
    np.testing.assert_allclose(found.values[3:], reference.values[3:], rtol=1e-3, atol=1e-15)
    assert not found.missed


def test_companions_do_not_count() -> None:
    """√x needs bisection; as a value without an estimate it gets the nodes that the first value needs."""
    alone, both = (compile_numpy(estimated(TIGHT, n)).outcome([np.array([1.0])], 1) for n in (1, 3))
    assert alone.evaluations == NODES
    assert both.evaluations > 20 * NODES
    assert abs(alone.values[2, 0] - 2 / 3) > 1e-6 > 1e-11 > abs(both.values[2, 0] - 2 / 3)


@needs_c
@pytest.mark.usefixtures("x64")
def test_estimates_of_no_integral_and_of_none_at_all() -> None:
    """0 where `when` is false or nothing is wide enough, NaN where a bound is NaN, and the sign of the bounds does not matter."""
    (integral,) = estimated(TIGHT, 1).body
    assert isinstance(integral, Integrate)
    moved = replace(integral, lo="p1", hi="p2", when="b0")
    whole = Program(("p", "lo", "hi"), (Assign("b0", "gt0", ("p0",)), moved), ("v7", "ve0"))
    p, lo, hi = np.array([-1.0, 2.0, 2.0, 2.0, 2.0]), np.array([0.0, 1.0, 0.0, 1.0, 0.0]), np.array([1.0, 1.0, np.nan, 0.0, 1.0])
    for kernel in (compile_numpy(whole), compile_c(whole), compile_jax(whole)):
        values, errors = kernel.outcome([p, lo, hi], 5).values
        np.testing.assert_array_equal(errors[:3], [0.0, 0.0, np.nan])
        assert errors[3] == errors[4] > 0
        assert values[3] == -values[4] < 0


# The text of C


@needs_c
@pytest.mark.parametrize(("case", "limits"), in_turn([*QUICK, MISSED[8]], LIMITS[:-1], {}))
def test_limits_change_no_bit(case: Case, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    limits_change_no_bit(case, limits, monkeypatch)


@needs_c
@pytest.mark.parametrize("case", [PLACES[0][0], TAILS[0]], ids=name)
def test_any_number_of_threads(case: Case) -> None:
    any_number_of_threads_gives_the_same(case, 50)


def with_estimates(program: Program) -> Program:
    """The program with an estimate of every value, among its outputs."""
    body, errors = [], []
    for stmt in program.body:
        if isinstance(stmt, Integrate):
            stmt = replace(stmt, estimates=tuple(f"ve{result}" for result in stmt.results))
            errors += stmt.estimates
        body.append(stmt)
    return replace(program, body=tuple(body), outputs=(*program.outputs, *errors))


STRICT = [*BENT, *(replace(case, program=with_estimates(case.program)) for case in QUICK)]


def test_lines_are_short() -> None:
    lines_are_short(STRICT)


def test_only_what_is_needed_is_printed() -> None:
    roots, tail = print_kernel(PLACES[0][0].program), print_kernel(TAILS[0].program)
    assert "teg_bend(" in roots
    assert "teg_tail" not in roots
    assert "teg_tail(" in tail
    assert "teg_bend(" not in tail


@pytest.mark.slow
@needs_c
@pytest.mark.parametrize("counted", [False, True])
def test_text_compiles_without_warnings(counted: bool, tmp_path: Path) -> None:
    text_compiles_without_warnings(tmp_path, STRICT[::4] if counted else STRICT, counted)


@pytest.mark.slow
@needs_c
@pytest.mark.parametrize("counted", [pytest.param(False, marks=pytest.mark.slow), True])
def test_no_undefined_behaviour(counted: bool, tmp_path: Path) -> None:
    behaviour_is_defined(tmp_path, STRICT, counted)
