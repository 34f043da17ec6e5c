"""Statements of the same text become rows of one: exact forms on small programs, what is refused, and values that stay the same."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.jax.alike import Rows, with_rows
from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from teg.program import Ellipse, Gauss, HalfPlane, Integrate, Isolate, Moments, Program, Stmt, Tie
from tests.backends.isolate_surfaces import cubic, isolate
from tests.backends.programs import let
from tests.backends.programs import program as program_of

pytest.importorskip("jax")


def integral(result: str, var: str, body: tuple[Stmt, ...], value: Any, hi: Any = 1.0, nodes: int = 4) -> Integrate:
    return Integrate(var, 0.0, hi, (), (), None, body, (value,), (result,), Gauss(nodes))


def program(parameters: int, *parts: Any) -> Program:
    """Statements, then the names of the outputs."""
    return program_of(parameters, tuple(s for s in parts if not isinstance(s, str)), *(s for s in parts if isinstance(s, str)))


def rows_of(p: Program) -> list[Rows]:
    return [s for s in with_rows(p).body if isinstance(s, Rows)]


def agree(p: Program, *columns: Any) -> None:
    at = [np.asarray(c, float) for c in columns]
    n = max(c.size for c in at)
    np.testing.assert_allclose(compile_jax(p)(at, n), compile_numpy(p)(at, n), rtol=1e-14)


def two(first: tuple[Stmt, ...], second: tuple[Stmt, ...], **options: Any) -> Program:
    """∫ vf dx0 and ∫ vs dx1, multiplied."""
    one, other = integral("va", "x0", first, "vf"), integral("vb", "x1", second, "vs", **options)
    return program(2, one, other, let("vc", "mul", "va", "vb"), "vc")


@pytest.mark.usefixtures("x64")
def test_numbers_names_and_signs_are_columns() -> None:
    p = two(
        (let("v1", "mul", 2.0, "x0"), let("v2", "exp", "v1"), let("vf", "mul", "p0", "v2")),
        (let("v3", "mul", 3.0, "x1"), let("v4", "neg", "v3"), let("v5", "exp", "v4"), let("vs", "mul", "p1", "v5")),
    )
    (rows,) = rows_of(p)
    assert set(rows.rows) == {(1.0, -1.0), (2.0, 3.0), ("p0", "p1")}
    assert rows.results == ("va", "vb")
    agree(p, [0.5, -0.3], [1.5, 2.0])


@pytest.mark.usefixtures("x64")
def test_a_factor_may_be_missing_and_the_order_of_statements_is_free() -> None:
    p = two(
        (let("v1", "mul", 2.0, "x0", "x0"), let("v2", "cos", "x0"), let("vf", "add", "v1", "v2")),
        (let("v3", "cos", "x1"), let("v4", "mul", "x1", "x1"), let("vs", "add", "v4", "v3")),
    )
    (rows,) = rows_of(p)
    assert rows.rows == ((2.0, 1.0),)
    agree(p, 0.5, 1.5)


@pytest.mark.usefixtures("x64")
def test_what_only_they_use_moves_into_the_rows() -> None:
    first, second = (let("vf", "mul", "v1", "x0"),), (let("vs", "mul", "v2", "x1"),)
    inner = integral("va", "x0", first, "vf"), integral("vb", "x1", second, "vs")
    shared = let("v0", "mul", "p0", "p1")
    own = let("v1", "add", "v0", "p0"), let("v2", "add", "v0", "p1")
    p = program(2, shared, *own, *inner, let("vc", "add", "va", "vb"), "vc")
    changed = with_rows(p)
    assert [type(s).__name__ for s in changed.body] == ["Assign", "Rows", "Assign"]
    agree(p, [0.5, 0.1], 1.5)
    kept = with_rows(program(2, shared, *own, *inner, let("vc", "add", "va", "vb", "v1"), "vc"))
    assert [type(s).__name__ for s in kept.body] == ["Assign", "Assign", "Assign", "Rows", "Assign"]


@pytest.mark.usefixtures("x64")
def test_texts_that_differ_and_results_that_are_needed_stay_apart() -> None:
    sine, cosine = (let("vf", "sin", "x0"),), (let("vs", "cos", "x1"),)
    assert rows_of(two(sine, cosine)) == []
    assert rows_of(two(sine, (let("vs", "sin", "x1"),), nodes=5)) == []
    assert rows_of(two((let("vf", "powi", "x0", 2),), (let("vs", "powi", "x1", 3),))) == []
    one = integral("va", "x0", (let("vf", "mul", "p0", "x0"),), "vf")
    other = integral("vb", "x1", (let("vs", "mul", "va", "x1"),), "vs")
    assert rows_of(program(2, one, other, "vb")) == []
    agree(two(sine, cosine), 0.5, 1.5)


@pytest.mark.usefixtures("x64")
def test_what_rows_compute_differently_is_selected() -> None:
    """In long texts, of which one has a sine where the other has a cosine, and the operands of a sum in another order."""

    def text(k: int, x: str, op: str) -> tuple[Stmt, ...]:
        powers = [let(f"v{k + i}", "mul", f"v{k + i - 1}" if i else x, x) for i in range(8)]
        return (*powers, let(f"v{k + 8}", op, f"v{k + 7}"), let(f"v{k + 9}", "exp", f"v{k + 8}"))

    p = two((*text(10, "x0", "sin"), let("vf", "add", "v19", "x0")), (*text(30, "x1", "cos"), let("vs", "add", "x1", "v39")))
    (rows,) = rows_of(p)
    inner = [s.op for s in rows.body[-1].body]
    assert sorted(inner) == ["add", "cos", "exp", *["mul"] * 8, "select", "sin"]
    assert rows.rows == ((False, True),)
    agree(p, 0.5, 1.5)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-0.0, 1.0)])
def test_a_selection_and_equal_numbers_are_columns_of_their_own(low: float, high: float) -> None:
    """False, True is not the column 0.0, 1.0, nor is that with a negative zero, although they are equal in Python."""

    def text(k: int, x: str, op: str, number: float, zero: float) -> tuple[Stmt, ...]:
        powers = [let(f"v{k + i}", "mul", f"v{k + i - 1}" if i else x, x) for i in range(8)]
        sums = let(f"v{k + 8}", op, f"v{k + 7}"), let(f"v{k + 9}", "add", f"v{k + 8}", number), let(f"v{k + 10}", "max", zero, f"v{k + 9}")
        return (*powers, *sums)

    p = two(
        (*text(10, "x0", "sin", low, 0.0), let("vf", "exp", "v20")),
        (*text(30, "x1", "cos", high, 1.0), let("vs", "exp", "v40")),
    )
    (rows,) = rows_of(p)
    assert (False, True) in rows.rows
    assert len(rows.rows) == (2 if repr(low) == "0.0" else 3)
    agree(p, 0.5, 1.5)


@pytest.mark.usefixtures("x64")
def test_places_that_change_roles_are_selected() -> None:
    """A bound and a factor, computed in one row, and a variable in the other one."""

    def text(k: int, x: str, bound: str) -> Integrate:
        powers = [let(f"v{k + i}", "mul", f"v{k + i - 1}" if i else x, x) for i in range(8)]
        return integral(f"v{k + 10}", x, (*powers, let(f"v{k + 8}", "mul", bound, f"v{k + 7}")), f"v{k + 8}", hi=bound)

    second = (let("v5", "mul", "p1", "x1"), text(30, "x3", "v5"))
    p = program(
        2, integral("va", "x0", (text(10, "x2", "x0"),), "v20"), integral("vb", "x1", second, "v40"), let("vc", "add", "va", "vb"), "vc"
    )
    assert len(rows_of(p)) == 1
    agree(p, 0.5, [1.5, 0.2])


@pytest.mark.usefixtures("x64")
def test_variables_are_selected_where_they_are_known() -> None:
    """A factor that is one row's outer variable, to a power, and the other row's inner variable."""

    def nested(k: int, outer: str, inner: str, factor: str) -> Integrate:
        powers = [let(f"v{k + i}", "mul", f"v{k + i - 1}" if i else inner, inner) for i in range(8)]
        text = (*powers, let(f"v{k + 8}", "mul", factor, f"v{k + 7}"), let(f"v{k + 9}", "exp", f"v{k + 8}"))
        within = integral(f"v{k + 10}", inner, text, f"v{k + 9}", hi=outer)
        return integral(f"va{k}", outer, (let(f"v{k + 11}", "sin", outer), within), f"v{k + 10}")

    p = program(2, nested(20, "x0", "x1", "v31"), nested(50, "x2", "x3", "x3"), let("vc", "sub", "va20", "va50"), "vc")
    assert len(rows_of(p)) == 1
    agree(p, 0.5, 1.5)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("scale", [1.0, "p0"], ids=["a number", "a name"])
def test_ties_are_met_by_their_own_row_only(scale: Any) -> None:
    """The mean of both orders where a node of the second integral is on p1, and one where only the first one has one on its border."""

    def text(k: int, x: str, condition: Stmt) -> tuple[Stmt, ...]:
        powers = [let(f"v{k + i}", "mul", f"v{k + i - 1}" if i else x, x) for i in range(8)]
        return (condition, *powers, let(f"v{k + 8}", "select", f"b{k}", f"v{k + 7}", 0.0), let(f"v{k + 9}", "exp", f"v{k + 8}"))

    middle = 0.5 + 0.5 * float(np.polynomial.legendre.leggauss(4)[0][2])
    compared = (let("v9", "sub", "x0", 2.0 * middle), *text(10, "x0", let("b10", "gt0", "v9")))
    tied = (let("v29", "sub", "x1", "p1"), *text(30, "x1", let("b30", "tie", "v29", scale, True, 0)))
    p = replace(
        program(2, integral("va", "x0", compared, "v19", hi=2.0), integral("vb", "x1", tied, "v39"), "va", "vb"), ties=(Tie(("x1", "p1")),)
    )
    assert len(rows_of(p)) == 1
    at = [np.array([1.0, 1.0]), np.array([middle, 0.5])]
    np.testing.assert_allclose(compile_jax(p)(at, 2), compile_numpy(p)(at, 2), rtol=1e-14)
    assert [_notes(p, 1.0, v) for v in (middle, 0.5)] == [1, 0]


def _notes(p: Program, *at: float) -> int:
    """Whether a tie was met at parameters."""
    return int(compile_jax(p).run(*at)[1]) & 1


@pytest.mark.usefixtures("x64")
def test_integrals_with_other_numbers_of_breaks() -> None:
    """A break that is NaN is none: one row gets as many as the other has."""
    one = integral("va", "x0", (let("v1", "sub", "x0", 5.0), let("b2", "gt0", "v1"), let("vf", "select", "b2", "p0", "x0")), "vf")
    other = integral("vb", "x1", (let("v3", "sub", "x1", "p1"), let("b4", "gt0", "v3"), let("vs", "select", "b4", "p0", "x1")), "vs")
    p = program(2, one, replace(other, breaks=("p1", 0.25)), let("vc", "mul", "va", "vb"), "vc")
    (rows,) = rows_of(p)
    (inside,) = (s for s in rows.body if isinstance(s, Integrate))
    assert len(inside.breaks) == 2
    columns = dict(zip(rows.names, rows.rows, strict=True))
    assert [columns[b][1] for b in inside.breaks] == ["p1", 0.25]  # type: ignore[index]
    assert np.isnan([columns[b][0] for b in inside.breaks]).all()  # type: ignore[index]
    agree(p, [0.5, -0.3, 2.0], [0.1, 0.4, 0.9])


@pytest.mark.usefixtures("x64")
def test_rows_of_integrals_in_integrals() -> None:
    def nested(result: str, outer: str, inner: str, p: str, k: int) -> Integrate:
        within = integral(f"v{k}1", inner, (let(f"v{k}2", "mul", p, inner, outer),), f"v{k}2", hi=outer)
        return integral(result, outer, (within, let(f"v{k}3", "mul", f"v{k}1", outer)), f"v{k}3")

    p = program(2, nested("va", "x0", "x1", "p0", 1), nested("vb", "x2", "x3", "p1", 2), let("vc", "sub", "va", "vb"), "vc")
    (rows,) = rows_of(p)
    assert rows.rows == (("p0", "p1"),)
    agree(p, [0.5, 0.1], [1.5, 2.5])


@pytest.mark.usefixtures("x64")
def test_open_and_closed_half_planes_are_rows() -> None:
    """Ellipses clipped by lines through corners of the box, where it matters which of them are closed."""

    def clipped(result: str, r: str, closed: bool) -> Ellipse:
        planes = HalfPlane(1.0, 1.0, -1.0, closed), HalfPlane(0.0, "p1", 0.0, not closed)
        return Ellipse((1.0, 0.0, 0.0, 1.0), (0.5, 0.5, r, 1.0, 1.0, 0.0), (Moments("above", ((0, 0, 1.0),)),), (result,), None, planes)

    p = program(2, clipped("va", "p0", False), clipped("vb", 0.25, True), let("vc", "sub", "va", "vb"), "va", "vb", "vc")
    (rows,) = rows_of(p)
    assert set(rows.rows) == {("p0", 0.25), (False, True), (True, False)}
    agree(p, [0.4, 0.3, 0.2], [1.0, 0.0, -1.0])


@pytest.mark.usefixtures("x64")
def test_searches_with_other_tolerances_are_rows() -> None:
    """Each keeps its own: which tolerances are missed stays the same."""

    def search(result: str, p: str, tol: float, soft: bool) -> Isolate:
        return replace(isolate(result, cubic(p), 0.25, 4.0), tol=tol, soft=soft)

    p = program(2, search("va", "p0", 1e-7, True), search("vb", "p1", 1e-10, False), "va", "vb")
    (rows,) = rows_of(p)
    assert set(rows.rows) == {("p0", "p1"), (1e-7, 1e-10)}
    agree(p, [1.0, 2.25], [4.0, 0.5])


@pytest.mark.slow
@pytest.mark.usefixtures("x64")
def test_the_quarters_of_a_disk_are_rows_of_one() -> None:
    """Two over x and two over y; and its gradient is that of NumPy."""
    x, y = teg.vars("x y")
    r = teg.param("r")
    f = teg.compile(teg.integral(teg.bracket(x * x + y * y < r * r) * teg.exp(x), (x, -1, 1), (y, -1, 1)), [r], backend="jax")
    rows = rows_of(f.program(1))
    assert [len(row.results) for row in rows] == [4]
    exact = teg.compile(f.expression, [r], backend="numpy")
    np.testing.assert_allclose(f.grad(r=np.array([0.6, 1.1]))["r"], exact.grad(r=np.array([0.6, 1.1]))["r"], rtol=1e-12)
