"""Roots and sums over them in the NumPy backend: exact values, chunks, cost, rounding, and polynomials at random."""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Sequence

import numpy as np
import pytest

from teg.backends.numpy import lanes
from teg.backends.numpy.kernel import compile_numpy
from teg.backends.shared.roots import Ends, examined
from teg.program import Arg, Program, Stmt
from teg.program.dce import without_dead_code
from tests.backends.isolate_programs import ISOLATE_CASES, ROOTS, SUMS
from tests.backends.isolate_surfaces import Surface, cubic, isolate, kink, numbered, root, square, wave
from tests.backends.programs import INF, NAN, Case, columns, expected, let, program


@pytest.mark.parametrize("case", ISOLATE_CASES, ids=lambda case: case.name)
def test_value(case: Case) -> None:
    found = compile_numpy(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.parametrize("case", ISOLATE_CASES, ids=lambda case: case.name)
def test_met_ties(case: Case) -> None:
    assert compile_numpy(case.program).met_ties(columns(case), case.n) == case.ties


@pytest.mark.parametrize("case", [*ROOTS, *SUMS], ids=lambda case: case.name)
def test_a_small_memory_changes_rounding_only(case: Case) -> None:
    found = compile_numpy(case.program, memory=1)(columns(case), case.n)
    whole = compile_numpy(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, whole, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("case", [*ROOTS, *SUMS], ids=lambda case: case.name)
def test_a_large_batch_equals_its_elements(case: Case) -> None:
    kernel = compile_numpy(case.program, memory=2**20)
    many = [np.tile(column, 50) if column.ndim else column for column in columns(case)]
    np.testing.assert_allclose(kernel(many, 50 * case.n), np.tile(kernel(columns(case), case.n), 50), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("case", [*ROOTS, *SUMS], ids=lambda case: case.name)
def test_dead_code_does_not_change_the_first_output(case: Case) -> None:
    one = program(len(case.program.parameters), case.program.body, case.program.outputs[0], ties=len(case.program.ties))
    found = compile_numpy(without_dead_code(one))(columns(case), case.n)
    np.testing.assert_allclose(found, expected(case)[:1], rtol=case.tolerance, atol=case.tolerance)


def test_source_has_a_function_a_block_and_pickles() -> None:
    case = SUMS[0]
    kernel = pickle.loads(pickle.dumps(compile_numpy(case.program)))
    for text in (
        "def enclosure_0(run, x0l, x0r, p0)",
        "def point_0(run, x0, p0)",
        "= isolation_0(run, (p1, 3.0), (p0,), (p0,))",
        "= sum_1(run, (",
    ):
        assert text in kernel.source
    np.testing.assert_allclose(kernel(columns(case), case.n), expected(case), rtol=1e-14, atol=1e-15)


def roots(g: Surface, parameters: int, room: int = 4, lo: Arg = -2.0, hi: Arg = 3.0) -> Program:
    """The roots of g, and the last parameters for bounds if they are named."""
    results = numbered(room)
    return program(parameters, (isolate(results, g, lo, hi),), *results.split())


def polynomial(coefficients: Sequence[Arg]) -> Surface:
    """Σ cᵢ·xⁱ and its slope by Horner's scheme, on points and on intervals."""
    point: list[Stmt] = []
    enclosure: list[Stmt] = []
    values: list[Arg] = []
    bounds: list[Arg] = []
    slopes: list[Arg] = []
    for i, c in enumerate(coefficients[1:], 1):
        point.append(let(f"vc{i}", "mul", float(i), c))
        enclosure.append(let(f"vd{i}", "mul", float(i), c))
        slopes.append(f"vc{i}")
    for kind, terms in (("g", list(coefficients)), ("s", slopes)):
        value, low, high = terms[-1], _on_box(terms[-1]), _on_box(terms[-1])
        for i, c in enumerate(reversed(terms[:-1])):
            name, inside = f"{kind}{i}", _on_box(c)
            point += [let(f"v{name}x", "mul", value, "x0"), let(f"v{name}", "add", f"v{name}x", c)]
            corners = [f"v{name}{j}" for j in range(4)]
            pairs = itertools.product((low, high), ("x0l", "x0r"))
            enclosure += [let(corner, "mul", *pair) for corner, pair in zip(corners, pairs, strict=True)]
            for end, op in (("l", "min"), ("h", "max")):
                enclosure += [let(f"v{name}{end}{j}", op, *corners[2 * j : 2 * j + 2]) for j in range(2)]
                enclosure += [
                    let(f"v{name}{end}", op, f"v{name}{end}0", f"v{name}{end}1"),
                    let(f"v{name}{end}c", "add", f"v{name}{end}", inside),
                ]
            value, low, high = f"v{name}", f"v{name}lc", f"v{name}hc"
        values.append(value)
        bounds += [low, high]
    return Surface(tuple(enclosure), (bounds[0], bounds[1], bounds[2], bounds[3]), tuple(point), values[0], values[1])


def _on_box(coefficient: Arg) -> Arg:
    return coefficient.replace("vc", "vd") if isinstance(coefficient, str) else coefficient


def polynomials_at_random(degree: int, n: int) -> tuple[Program, list[np.ndarray], np.ndarray]:
    """A program for the roots in (-2, 3), coefficients, and the roots by `numpy.roots`: (degree, n)."""
    rng = np.random.default_rng(degree)
    coefficients = rng.normal(size=(degree + 1, n))
    table = np.full((degree, n), INF)
    for j in range(n):
        found = np.roots(coefficients[::-1, j])
        inside = np.sort(found[np.abs(found.imag) < 1e-10].real)
        inside = inside[(inside > -2.0) & (inside < 3.0)]
        table[: inside.size, j] = inside
    return roots(polynomial([f"p{i}" for i in range(degree + 1)]), degree + 1, degree), list(coefficients), table


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 8, 12])
def test_polynomials_at_random(degree: int) -> None:
    kernel_program, coefficients, table = polynomials_at_random(degree, 200)
    np.testing.assert_allclose(compile_numpy(kernel_program)(coefficients, 200), table, rtol=1e-10, atol=1e-10)


def test_blocks_of_many_statements() -> None:
    """x⁸⁰ - ½ as a full polynomial: blocks longer than a printed function."""
    surface = polynomial([-0.5, *[0.0] * 79, 1.0])
    assert len(surface.enclosure) > 400
    found = compile_numpy(roots(surface, 0, lo=-1.25, hi=1.5))([], 1)
    np.testing.assert_allclose(found[:, 0], [-(0.5 ** (1 / 80)), 0.5 ** (1 / 80), INF, INF], rtol=1e-15)


def test_only_the_crowded_element_is_nan() -> None:
    found = compile_numpy(roots(wave("p0"), 1, lo=0.5, hi=3.5))([np.array([1.0, 1e4, 2.0])], 3)
    np.testing.assert_allclose(found[:, 0], [np.pi, INF, INF, INF])
    assert np.isnan(found[:, 1]).all()
    np.testing.assert_allclose(found[:, 2], [np.pi / 2, np.pi, INF, INF])


@pytest.mark.parametrize(("lo", "hi"), [(0, 1), (-1, 1), (-2, 2), (0, 2)])
def test_roots_at_box_ends_survive_rounding(lo: int, hi: int) -> None:
    """|x - a| = c with round numbers: roots are at ends of boxes, where bounds of both neighbours may exclude 0."""
    a, c = (v.ravel() for v in np.mgrid[1:20, 1:20])
    margin = 1e-9 * (hi - lo)
    exact = np.sort(np.stack([a - c, a + c]) / 20, axis=0)
    exact = np.sort(np.where((exact > lo - margin) & (exact < hi + margin), exact, INF), axis=0)
    found = compile_numpy(roots(kink("p0", "p1"), 2, 2, lo - margin, hi + margin))([a / 20, c / 20], a.size)
    np.testing.assert_allclose(found, exact, rtol=1e-15, atol=1e-15)


def test_a_rounded_tangency_has_an_even_number_of_roots() -> None:
    """x² - 2a·x + a², whose rounded values are of either sign near a."""
    a = np.arange(1, 100) / 100
    kernel = compile_numpy(roots(polynomial(["p0", "p1", 1.0]), 2, 16, -1e-9, 1 + 1e-9))
    found = kernel([a * a, -2 * a], a.size)
    count = np.isfinite(found).sum(axis=0)
    assert not np.isnan(found).any()
    assert (count % 2 == 0).all()
    assert (count > 0).mean() > 0.9
    np.testing.assert_allclose(np.where(np.isfinite(found), found, a), np.broadcast_to(a, found.shape), atol=1e-7)


def test_a_falling_function_that_begins_inside() -> None:
    """p - √x, undefined at the left end: no box is called monotone before its ends are known."""
    up = root("p0")
    enclosure = (*up.enclosure, let("vna", "neg", "va"), let("vnb", "neg", "vb"), let("vnl", "neg", "vdlow"), let("vnh", "neg", "vdhigh"))
    down = Surface(enclosure, ("vnb", "vna", "vnh", "vnl"), (*up.point, let("vng", "neg", "vg"), let("vnd", "neg", "vd")), "vng", "vnd")
    for surface in (up, down):
        found = compile_numpy(roots(surface, 1, 2, -1.0, 4.0))([np.array([1.0, 0.25, 1.9375, 0.0625])], 4)
        np.testing.assert_allclose(found[0], [1.0, 0.0625, 1.9375**2, 0.0625**2], rtol=4e-16)
        assert (found[1] == INF).all()


def test_the_border_of_the_domain_is_no_root() -> None:
    """Bounds that are NaN leave the box with the border undecided."""
    found = compile_numpy(roots(root("p0", strict=True), 1, 2, -1.0, 4.0))([np.array([1.0, 3.0])], 2)
    np.testing.assert_allclose(found, [[1.0, INF], [INF, INF]])


def test_steps_that_leave_the_box_are_bisected() -> None:
    """tanh(k·(x - a)): from where it is flat, Newton's method leaves the box at once."""
    surface = Surface(
        (),
        (-1.0, 1.0, 1e-300, "p0"),
        (
            let("vx", "sub", "x0", "p1"),
            let("vkx", "mul", "p0", "vx"),
            let("vg", "tanh", "vkx"),
            let("vc", "cosh", "vkx"),
            let("vc2", "powi", "vc", 2),
            let("vd", "div", "p0", "vc2"),
        ),
        "vg",
        "vd",
    )
    k, a = np.repeat([1.0, 30.0, 1e3, 1e6, 1e9], 4), np.tile([0.3, -1.9, 2.999, 1e-8], 5)
    found = compile_numpy(roots(surface, 2, 1))([k, a], k.size)
    np.testing.assert_allclose(found[0], a, rtol=4e-16)


def test_newton_needs_few_points_and_a_level_costs_its_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = {3: 0, 7: 0}
    evaluated = lanes.Sized.at

    def counted(block, run, lane, places, given):  # type: ignore[no-untyped-def]
        counts[block.results] += lane.size
        return evaluated(block, run, lane, places, given)

    monkeypatch.setattr(lanes.Sized, "at", counted)
    kernel = compile_numpy(roots(cubic("p0"), 1))
    kernel([np.full(100, 1.0)], 100)
    assert counts[7] <= 100 * 30  # boxes
    assert counts[3] - counts[7] <= 100 * (2 + 3 * 8)  # the ends, and Newton's method at three roots


def test_a_range_of_any_size() -> None:
    """(x - p)² = c in ranges from 1e-150 to 1e150."""
    scale = 10.0 ** np.arange(-150, 151, 25)
    kernel = compile_numpy(roots(square("p0", "p1"), 3, 3, 0.0, "p2"))
    found = kernel([0.3 * scale, (0.2 * scale) ** 2, scale], scale.size)
    np.testing.assert_allclose(found[:2], [0.1 * scale, 0.5 * scale], rtol=4e-15)
    assert (found[2] == INF).all()


def test_parameters_that_are_nan() -> None:
    found = compile_numpy(roots(square("p0", "p1"), 2, 2))([np.array([NAN, 0.3]), np.array([0.1, NAN])], 2)
    assert (found == INF).all()


def test_rounding_decides_the_sign() -> None:
    """A box is kept in which the function is as small as its rounding, though it does not reach 0 there by its slope."""
    for noise, kept in ((1e-16, True), (0.0, False)):
        bounds = np.array([-1.0, 1.0, -1e-15, 1e-15, -1.0, 1.0, noise])  # of g, its slope and its curvature
        found = examined(np, bounds, (np.float64(-1e-17), np.float64(0.0)), 1e-6, Ends(np.False_, np.True_, np.True_))
        assert bool(found.monotone | found.bent | found.left) == kept
