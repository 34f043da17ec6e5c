"""Common zeros in the NumPy backend: values, the text in plain Python, chunks, cost, and circles at random."""

from __future__ import annotations

import math
import pickle

import numpy as np
import numpy.typing as npt
import pytest

import teg
from teg.backends.numpy import lanes
from teg.backends.numpy import locate as location
from teg.backends.numpy.kernel import compile_numpy
from teg.program import LOCATE_HALVINGS, LOCATE_WIDTH, Assign, Locate, Program
from teg.program.dce import without_dead_code
from tests.backends.isolate_surfaces import numbered
from tests.backends.locate_literally import literally
from tests.backends.locate_pairs import Pair, ends, locate, point, two_circles, wave
from tests.backends.locate_programs import LOCATE_CASES, PLACES
from tests.backends.programs import INF, Case, columns, expected, let, program

Columns = list[npt.NDArray[np.float64]]


@pytest.mark.parametrize("case", LOCATE_CASES, ids=lambda case: case.name)
def test_value(case: Case) -> None:
    found = compile_numpy(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.parametrize("case", LOCATE_CASES, ids=lambda case: case.name)
def test_met_ties(case: Case) -> None:
    assert compile_numpy(case.program).met_ties(columns(case), case.n) == case.ties


LITERAL = [case for case in PLACES if "as many rectangles" not in case.name and "too many zeros" not in case.name]  # plain Python is slow


@pytest.mark.parametrize("case", LITERAL, ids=lambda case: case.name)
def test_the_text_to_the_bit(case: Case) -> None:
    """Against plain Python; its `sin` and NumPy's may differ in the last bit, which no case depends on."""
    (stmt,) = case.program.body
    assert isinstance(stmt, Locate)
    found = compile_numpy(case.program)(columns(case), case.n)
    for j in range(case.n):
        given = {f"p{i}": float(column[j] if column.ndim else column) for i, column in enumerate(columns(case))}
        limits = [given[arg] if isinstance(arg, str) else float(arg) for arg in (stmt.lo, stmt.hi, stmt.low, stmt.high)]
        text = literally(Pair(stmt.enclosure, stmt.bounds), *limits, len(stmt.results), {**given})
        np.testing.assert_array_equal(found[:, j], text[: len(found)])


@pytest.mark.parametrize("case", LITERAL, ids=lambda case: case.name)
def test_a_small_memory_changes_nothing(case: Case) -> None:
    found = compile_numpy(case.program, memory=1)(columns(case), case.n)
    np.testing.assert_array_equal(found, compile_numpy(case.program)(columns(case), case.n))


@pytest.mark.parametrize("case", LOCATE_CASES, ids=lambda case: case.name)
def test_a_batch_in_chunks_equals_its_elements(case: Case) -> None:
    kernel = compile_numpy(case.program, memory=2**20)
    many = [np.tile(column, 9) if column.ndim else column for column in columns(case)]
    np.testing.assert_allclose(kernel(many, 9 * case.n), np.tile(kernel(columns(case), case.n), 9), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("case", LOCATE_CASES, ids=lambda case: case.name)
def test_dead_code_does_not_change_the_first_output(case: Case) -> None:
    one = program(len(case.program.parameters), case.program.body, case.program.outputs[0], ties=len(case.program.ties))
    found = compile_numpy(without_dead_code(one))(columns(case), case.n)
    np.testing.assert_allclose(found, expected(case)[:1], rtol=case.tolerance, atol=case.tolerance)


def test_dead_code_leaves_what_bounds_use() -> None:
    """The statement that nobody asks for goes; of the one that is asked for, what its bounds need stays, at home and outside."""
    pair = Pair((*point("vv", 0.5).enclosure, let("vdead", "mul", "va", "va")), ("va", "vb", "vc", "vd"))
    idle = Locate(0.0, 1.0, 0.0, 1.0, "x2l", "x2r", "x3l", "x3r", (), (0.0, "x2r", 0.0, "x3r"), ("vi",))
    body = (let("vv", "add", "p0", 0.25), let("vw", "add", "p0", 1.0), let("vx", "sub", "p0", 9.0), idle)
    live = without_dead_code(program(1, (*body, locate("va0 va1", pair, 0.0, "vw", 0.0, 1.0)), "va1"))
    names = [stmt.name if isinstance(stmt, Assign) else stmt.results for stmt in live.body]
    assert names == ["vv", "vw", ("va0", "va1")]
    (found,) = (stmt for stmt in live.body if isinstance(stmt, Locate))
    assert [stmt.name for stmt in found.enclosure if isinstance(stmt, Assign)] == ["va", "vb", "vc", "vd"]


def test_source_has_a_function_for_the_enclosure_and_pickles() -> None:
    case = PLACES[0]
    kernel = pickle.loads(pickle.dumps(compile_numpy(case.program)))
    assert "def enclosure_0(run, x0l, x0r, x1l, x1r, p0)" in kernel.source
    assert "= location_0(run, (-2.0, 3.0, -1.5, 1.75), (p0,))" in kernel.source
    np.testing.assert_allclose(kernel(columns(case), case.n), expected(case), rtol=case.tolerance, atol=case.tolerance)


def circles_at_random(n: int) -> tuple[Program, Columns, npt.NDArray[np.float64]]:
    """A program for where the unit circle and another one cross (16 results), its arguments, and the answer, (2, n)."""
    rng = np.random.default_rng(7)
    v, u, q = rng.uniform(-1.5, 1.5, n), rng.uniform(-1.5, 1.5, n), rng.uniform(0.01, 2.0, n)
    squared = v**2 + u**2
    along = 0.5 * (squared + 1.0 - q) / squared
    aside = np.sqrt(np.maximum(1.0 / squared - along**2, 0.0))
    exact = np.sort(np.stack([along * v + aside * u, along * v - aside * u]), axis=0)
    exact[:, 1.0 / squared < along**2] = INF
    results = numbered(16)
    places = (locate(results, two_circles("p0", "p1", 1.0, "p2"), -1.25, 1.5, -1.5, 1.25),)
    return program(3, places, *results.split()), [v, u, q], exact


def test_circles_at_random() -> None:
    """Each crossing is found; one of curves that are nearly parallel may be found as places that do not touch."""
    kernel_program, at, exact = circles_at_random(300)
    found = compile_numpy(kernel_program)(at, 300)
    apart = (exact[1] > exact[0] + 1e-3) | np.isinf(exact[0])  # neither nearly touching nor one above the other
    assert apart.mean() > 0.9
    found, exact = found[:, apart], exact[:, apart]
    crossing = np.isfinite(exact[0])
    assert (found[:, ~crossing] == INF).all()
    assert (np.isfinite(found[:, crossing]).sum(axis=0) == 2).mean() > 0.8
    gaps = np.abs(found[:, None, crossing] - exact[None, :, crossing])
    assert gaps.min(axis=0).max() < 1e-6  # every crossing has a place
    assert np.where(np.isfinite(gaps), gaps, 0.0).min(axis=1).max() < 1e-6  # every place has a crossing


def test_only_the_crowded_element_is_given_up() -> None:
    outcome = compile_numpy(
        program(1, (locate("va vb vc vd", wave("p0", 0.3), 0.5, 3.5, 0.0, 1.0, lost="vl"),), "va", "vb", "vc", "vd", "vl")
    ).outcome([np.array([1.0, 1e5, 2.0])], 3)
    found = outcome.values
    np.testing.assert_allclose(found[:, 0], [np.pi, INF, INF, INF, 0.0], rtol=1e-7, atol=1e-18)
    np.testing.assert_allclose(found[:, 1], [0.5, 3.5, INF, INF, found[4, 1]])
    assert found[4, 1] > 1e-12
    np.testing.assert_allclose(found[:, 2], [np.pi / 2, np.pi, INF, INF, 0.0], rtol=1e-7, atol=1e-18)
    assert outcome.missed


def test_what_is_not_given_up_is_not_missed() -> None:
    kernel = compile_numpy(program(1, (locate("va", ends(0.0, 0.1, "p0"), -2.0, 3.0, -1.5, 1.75),), "va"))
    assert kernel.outcome([np.array([1.0])], 1).missed  # two places, one result
    assert not kernel.outcome([np.array([8.0])], 1).missed


def test_a_level_costs_the_rectangles_that_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    evaluated = lanes.Sized.at

    def counted(block, run, lane, places, given):  # type: ignore[no-untyped-def]
        sizes.append(lane.size)
        return evaluated(block, run, lane, places, given)

    monkeypatch.setattr(lanes.Sized, "at", counted)
    radii = np.linspace(0.3, 1.2, 50)
    found = compile_numpy(program(1, (locate("va vb", ends(0.0, 0.1, "p0"), -2.0, 3.0, -1.5, 1.75),), "va", "vb"))([radii], 50)
    np.testing.assert_allclose(found, [-np.sqrt(radii), np.sqrt(radii)], atol=2e-7)
    assert len(sizes) == 2 * LOCATE_HALVINGS + 1
    assert sum(sizes) <= 50 * len(sizes) * 20


def test_a_crowded_lane_takes_no_memory() -> None:
    """Where f and g vanish everywhere the search ends before a level has more rectangles than there is room for."""
    sizes: list[int] = []

    def enclosure(run, left, right, bottom, top):  # type: ignore[no-untyped-def]
        sizes.append(left.size)
        return (0.0 * left,) * 4

    search = location.Location(lanes.Sized(enclosure, 4, 4), 2, counts=True)
    found = search(lanes.Run(1, 2**24), (np.zeros(3), 1.0, 0.0, 1.0), ())
    np.testing.assert_array_equal(found, [[0.0] * 3, [1.0] * 3, [1.0] * 3])
    assert max(sizes) == 3 * LOCATE_WIDTH
    assert sum(sizes) == 3 * (2 * LOCATE_WIDTH - 1)


def test_a_ring_costs_few_rectangles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the circles of (v² + u² + a)² < v² + u², where the surface is nearly 0, natural bounds alone keep thousands of rectangles."""
    v, u = teg.vars("v u")
    a = teg.param("a")
    sizes: list[int] = []
    refuted = location.refuted

    def counted(xp, bounds, at, reach):  # type: ignore[no-untyped-def]
        sizes.append(reach.shape[1])
        return refuted(xp, bounds, at, reach)

    monkeypatch.setattr(location, "refuted", counted)
    f = teg.compile(teg.integral(teg.bracket((v * v + u * u + a) ** 2 < v * v + u * u), (v, -1, 1), (u, -1, 1)), [a], backend="numpy")
    inner, outer = (0.5 + s * math.sqrt(0.25 - 0.2138) for s in (-1, 1))
    assert f(0.2138) == pytest.approx(math.pi * (outer**2 - inner**2), rel=1e-11)
    assert sum(sizes) < 800
