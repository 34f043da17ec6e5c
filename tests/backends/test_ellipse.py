"""Moments of ellipses on boxes, and along their arcs there, in every backend: as statements, and as the programs that become them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg.backends.numpy.kernel import compile_numpy
from teg.ir.traverse import parameters
from teg.program import Ellipse, Moments, Program, size, statements
from teg.program.interpreter import interpret
from tests.backends.c_checks import any_number_of_threads_gives_the_same, behaviour_is_defined, text_compiles_without_warnings
from tests.backends.ellipse_moments import ASKED, BACKENDS, LEANS, LONG, ROUND, Matrix, Place, exact, kernels, needs_c
from tests.backends.programs import Case, Row, columns, expected, program

pytestmark = pytest.mark.usefixtures("x64")


ROWS: list[Place] = [
    (0.5, 0.5, 0.55, 1.0, 1.0),
    (0.5, 0.5, 0.3, 1.0, 1.0),
    (0.5, 0.5, 3.0, 1.0, 1.0),
    (3.0, 0.5, 1.0, 1.0, 1.0),
    (0.1, 0.2, 0.4, 1.0, 0.7),
    (0.0, 0.0, 0.5, 1.0, 1.0),
    (0.0, 0.0, 1.0, 1.0, 1.0),
    (-0.3, 0.4, 0.6, 1.0, 1.0),
    (0.5, -0.9, 1.0, 1.0, 1.0),
    (1.2, 1.3, 0.9, 1.0, 1.0),
    (0.4, 0.6, 0.5, -1.0, 1.0),
    (-0.4, -0.6, 0.5, -1.0, -1.0),
    (0.3, 0.2, 0.25, 1e-3, 1.0),
    (0.5, 1e-9, 1e-8, 1.0, 1.0),
    (0.5, 0.5, 1e-8, 1.0, 1.0),
    (-60.0, -80.0, 100.5, 1.0, 1.0),
    (0.5, 0.5, 0.5 + 2.0**-40, 1.0, 1.0),
    (0.6, 0.8, 1.0 - 1e-9, 1.0, 1.0),
]
LOOSE = {ROWS[-1], ROWS[-2], ROWS[-3]}
"""Those in which the ends of an arc lose digits: along a side that the circle touches, and far from the centre."""


def of_place(matrix: Matrix, asked: Sequence[Moments], least: float = 0.0, when: str | None = None) -> Program:
    """Moments of the ellipse with p0, …, p4 as its place."""
    results = tuple(f"v{i}" for i in range(len(asked)))
    return program(5, (Ellipse(matrix, ("p0", "p1", "p2", "p3", "p4", least), tuple(asked), results, when),), *results)


def case_of(name: str, matrix: Matrix, rows: Sequence[Place], tolerance: float, asked: Sequence[Moments] = ASKED) -> Case:
    """All of these ellipses in one batch."""

    @cache  # when a test asks, not when it is collected
    def answers() -> tuple[Row, ...]:
        return tuple(tuple(exact(matrix, row, m.kind, *m.terms[0][:2], axes=m.axes) for row in rows) for m in asked)

    given: list[Row] = [tuple(row[i] for row in rows) for i in range(5)]
    return Case(name, of_place(matrix, asked), tuple(given), answers, len(rows), tolerance)


NAN, INF = math.nan, math.inf
AREA, REST, LENGTH = (Moments(kind, ((0, 0, 1.0),)) for kind in ("above", "below", "border"))
SPECIAL = Case(
    "infinite, unknown and empty",
    of_place(ROUND, (AREA, REST, LENGTH)),
    ((0.5, INF, INF, NAN, 0.5, 0.5, 0.5), (0.5,) * 7, (INF, 1.0, INF, 1.0, 0.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0),
     (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0)),
    ((1.0, 0.0, NAN, NAN, 0.0, 0.0, 0.0), (0.0, 1.0, NAN, NAN, 1.0, 0.0, 0.0), (0.0, 0.0, NAN, NAN, math.pi, 0.0, 0.0)),
    7,
)  # fmt: skip
LEAST = Case(
    "a least radius", of_place(ROUND, (AREA, LENGTH), least=0.25), ((0.5, 0.0), (0.5, 0.5), (0.0, 1e-3), (1.0, 1.0), (1.0, 1.0)),
    ((0.0, 0.5e-6 * math.pi), (math.pi, 0.5 * math.pi)), 2,
)  # fmt: skip
ALONG = [Moments("border", ((j, k, 1.0),), axes) for j, k, axes in ((0, 0, (2, 0)), (0, 0, (0, 1)), (1, 0, (0, 2)), (0, 1, (1, 1)))]
PLAIN = [row for row in ROWS if row not in LOOSE]
CASES = [
    case_of("circles", ROUND, PLAIN, 4e-15),
    case_of("circles that touch and large ones", ROUND, sorted(LOOSE), 1e-6),
    case_of("leaning ellipses", LEANS, PLAIN[:2] + PLAIN[4:12:2], 4e-15),
    case_of("long ellipses", LONG, PLAIN[:2] + PLAIN[4:10:2], 4e-15),
    case_of("powers along axes", LEANS, [*PLAIN[:2], PLAIN[6]], 4e-15, ALONG),
    case_of("powers along axes, turned over", (-0.2, 0.7, 1.3, 0.4), PLAIN[:2], 4e-15, ALONG),
    SPECIAL,
    LEAST,
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@pytest.mark.parametrize("backend", BACKENDS)
def test_statements(case: Case, backend: str) -> None:
    kernel = kernels(backend)(case.program)
    np.testing.assert_allclose(kernel(columns(case), case.n), expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_interpreter(case: Case) -> None:
    for i in range(case.n):
        found = interpret(case.program, [column[i] for column in case.columns]).outputs
        np.testing.assert_allclose(found, expected(case)[:, i], rtol=case.tolerance, atol=case.tolerance)


def test_circles_that_touch_lose_digits_of_the_border_only() -> None:
    """The area is right to rounding also where the length of an arc is not."""
    kernel = compile_numpy(of_place(ROUND, (AREA,)))
    rows = [*ROWS, (0.5, 0.5, 0.5 + 1e-13, 1.0, 1.0), (0.5, 0.5, 0.5 - 1e-16, 1.0, 1.0), (1.0, 1.0, 1.0 + 1e-15, 1.0, 1.0)]
    found = kernel([np.array(column) for column in zip(*rows, strict=True)], len(rows))[0]
    np.testing.assert_allclose(found, [exact(ROUND, row, "above", 0, 0) for row in rows], rtol=3e-14, atol=1e-16)


@needs_c
def test_the_text_is_c99_without_warnings_and_its_behaviour_defined(tmp_path: Path) -> None:
    some = [CASES[0], CASES[-2], CASES[-1]]
    text_compiles_without_warnings(tmp_path, some)
    behaviour_is_defined(tmp_path, some)


@needs_c
def test_any_number_of_threads_gives_the_same() -> None:
    any_number_of_threads_gives_the_same(CASES[2], 300)


# -- programs --------------------------------------------------------------------------------------------------------------

x, y, z = teg.vars("x y z")
a, b, r, t, s = teg.params("a b r t s")
DISK = (x - a) ** 2 + (y - b) ** 2 < r**2
PROGRAMS = {
    "a disk": teg.bracket(DISK),
    "what a disk leaves": 1 - teg.bracket(DISK),
    "a quadratic inside": teg.bracket(DISK) * (1 + x * y - s * x**2),
    "two colours": teg.where(DISK, t + x, s * y),
    "an ellipse written out": teg.bracket(2 * x**2 + x * y + 3 * y**2 - a * x - b * y < r),
    "not inside": teg.bracket((2 * x - a) ** 2 + (y + x - b) ** 2 > r),
    "by level": teg.bracket(x**2 + y**2 < t),
    "axes": teg.bracket(((x - a) / r) ** 2 + ((y - b) / s) ** 2 < 1) * (1 + x),
    "axes over squares": teg.bracket((x - a) ** 2 / r**2 + (y - b) ** 2 / s**2 > t),
    "turned": teg.bracket(
        (((x - a) * teg.cos(t) + (y - b) * teg.sin(t)) / r) ** 2 + teg.exp(t) * ((y - b) * teg.cos(t) - (x - a) * teg.sin(t)) ** 2 < 0.5
    ),
}
AT = {"a": np.array([0.5, 0.1, 2.0]), "b": np.array([0.45, -0.2, 0.3]), "r": np.array([0.55, 0.6, 0.4]), "t": 0.4, "s": 0.73}


def integral(name: str) -> teg.Expr:
    return teg.integral(PROGRAMS[name], (x, 0, 1), (y, -0.25, 1))


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_is_one_statement(name: str) -> None:
    e = integral(name)
    f = teg.compile(e, parameters(e))
    for order in (0, 1):
        kinds = [type(stmt).__name__ for stmt in statements(f.program(order).body) if type(stmt).__name__ != "Assign"]
        assert kinds == ["Ellipse"], kinds
        assert size(f.program(order)) < 200


def test_second_derivatives_are_those_without_intrinsics() -> None:
    e = integral("a quadratic inside")
    on, off = (teg.compile(e, [a, r], intrinsics=flag) for flag in (True, False))
    at = {"a": 0.5, "b": 0.4, "r": 0.57, "s": 0.7}
    first, second = on.hessian(at), off.hessian(at)
    assert first == pytest.approx(second, abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_slices_of_a_ball(backend: str) -> None:
    """The gradient breaks where a slice goes through an edge of the box, or touches a side."""
    ball = teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 + (z - t) ** 2 < r**2) * (1 + s * z * x), (x, 0, 1), (y, 0, 1), (z, 0, 1))
    f = teg.compile(ball, [a, b, t, r, s], backend=backend)
    exact_one = teg.compile(ball, [a, b, t, r, s], intrinsics=False, tol=1e-12)
    at = {"a": 0.1, "b": 0.3, "t": 0.5, "r": 0.4, "s": 0.7}
    (value, slopes), (true, others) = f.value_and_grad(at), exact_one.value_and_grad(at)
    assert value == pytest.approx(true, abs=1e-11)
    for name, slope in slopes.items():
        assert slope == pytest.approx(others[name], abs=1e-11), name


def test_integrals_of_one_slice_share_it() -> None:
    """Each of three integrals over z has its own disks, of which two integrands use the same."""
    disk = teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 + z**2 < r**2) * (1 + x), (x, 0, 1), (y, 0, 1))
    parts = [(k + 1) * teg.integral(disk * (1 + k * z) + teg.exp(k * z) * disk, (z, 0.1 * k, 0.1 * (k + 1))) for k in range(3)]
    on = teg.compile(sum(parts), [a, b, r], tol=1e-12)
    off = teg.compile(sum(parts), [a, b, r], intrinsics=False, tol=1e-12, backend="c")
    at = {"a": 0.4, "b": 0.3, "r": 0.45}
    (value, slopes), (true, others) = on.value_and_grad(at), off.value_and_grad(at)
    assert value == pytest.approx(true, abs=1e-12)
    assert slopes == pytest.approx(others, abs=1e-11)


def test_a_disk_is_born_with_the_mean_of_both_sides() -> None:
    f = teg.compile(teg.integral(teg.bracket((x - a) ** 2 + y**2 < t), (x, -1, 1), (y, -1, 1)), [t])
    assert [f.grad(a=0.3, t=level)["t"] for level in (-1e-3, 0.0, 1e-3)] == pytest.approx([0.0, 0.5 * math.pi, math.pi], rel=1e-12)


def test_estimates_hold_where_a_circle_nearly_touches() -> None:
    f = teg.compile(teg.integral(teg.bracket(DISK), (x, 0, 1), (y, 0, 1)), [a, b, r])
    for excess in (1e-3, 1e-6, 1e-9, 1e-12):
        at = {"a": 0.5, "b": 0.5, "r": 0.5 + excess}
        slopes, errors = f.grad_and_error(at)
        with mpmath.workdps(40):
            radius = mpmath.mpf(at["r"])
            true = float(2 * radius * (mpmath.pi - 4 * mpmath.acos(mpmath.mpf(0.5) / radius)))
        assert abs(slopes["r"] - true) <= errors["r"] + 1e-15
        assert errors["r"] <= 1e-7


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_picture_of_disks(backend: str) -> None:
    """In loops over pixels and disks, value and gradient of the sum of what each disk covers, weighted."""
    i, j, k = teg.index("i"), teg.index("j"), teg.index("k")
    disks, picture = teg.array("D", 2), teg.array("T", 2)
    covered = teg.integral(teg.bracket((x - disks[k, 0]) ** 2 + (y - disks[k, 1]) ** 2 < disks[k, 2] ** 2), (x, i, i + 1), (y, j, j + 1))
    e = teg.sum(picture[i, j] * covered, (k, 0, teg.length(disks, 0)), (i, 0, 6), (j, 0, 5))
    rng = np.random.default_rng(3)
    at = {"D": np.array([[2.3, 2.1, 1.7], [3.0, 3.0, 1.0], [0.2, 4.9, 0.6], [9.0, 1.0, 1.5]]), "T": rng.uniform(-1.0, 1.0, (6, 5))}
    value, slopes = teg.compile(e, [disks], backend=backend).value_and_grad(at)
    area, gradient = 0.0, np.zeros((4, 3))
    for (row, column), weight in np.ndenumerate(at["T"]):
        for number, (u, v, radius) in enumerate(at["D"]):
            place = (u - row, v - column, radius, 1.0, 1.0)
            area += weight * exact(ROUND, place, "above", 0, 0)
            length, first, second = (exact(ROUND, place, "border", *powers) for powers in ((0, 0), (1, 0), (0, 1)))
            gradient[number] += 2.0 * weight * np.array([first - place[0] * length, second - place[1] * length, radius * length])
    assert value == pytest.approx(area, abs=1e-13)
    np.testing.assert_allclose(slopes["D"], gradient, atol=1e-12)


def thin(weight: str, turned: bool) -> teg.Expr:
    """A polynomial on an ellipse with half-axes a and b around (0.2, 0.1), turned by t or not."""
    u, v = x - 0.2, y - 0.1
    u, v = (u * teg.cos(t) + v * teg.sin(t), v * teg.cos(t) - u * teg.sin(t)) if turned else (u, v)
    return teg.integral(
        teg.bracket((u / a) ** 2 + (v / b) ** 2 < 1) * (x + 2 * y if weight == "x + 2y" else x**2 * y), (x, -2, 2), (y, -2, 2)
    )


def thin_slopes(weight: str, long: float, short: float, angle: float) -> list[float]:
    """The derivatives by a, b and t, of π·a·b times the mean of the weight, with the variances of x and y in an ellipse."""

    def mean(long: Any, short: Any, angle: Any) -> Any:
        cx, cy, c, s = mpmath.mpf(0.2), mpmath.mpf(0.1), mpmath.cos(angle), mpmath.sin(angle)
        spread, both = (long**2 * c**2 + short**2 * s**2) / 4, (long**2 - short**2) * c * s / 4
        return mpmath.pi * long * short * (cx + 2 * cy if weight == "x + 2y" else (cx**2 + spread) * cy + 2 * cx * both)

    with mpmath.workdps(40):
        at = [mpmath.mpf(v) for v in (long, short, angle)]
        return [float(mpmath.diff(mean, at, n, h=mpmath.mpf(10) ** -16)) for n in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]


@pytest.mark.parametrize(("weight", "turned"), [("x + 2y", True), ("xxy", True), ("xxy", False)])
@pytest.mark.parametrize("backend", BACKENDS)
def test_gradients_of_thin_ellipses(backend: str, weight: str, turned: bool) -> None:
    """By half-axes and angle; in powers of x and y the coefficients are 1/b² larger than what their sum is."""
    widths = [10.0**-k for k in range(7)]
    f = teg.compile(thin(weight, turned), [a, b, t] if turned else [a, b], backend=backend)
    at = {"a": 1.0, "b": np.array(widths)} | ({"t": 0.3} if turned else {})
    slopes = f.grad(at)
    for i, short in enumerate(widths):
        true = dict(zip("abt", thin_slopes(weight, 1.0, short, 0.3 if turned else 0.0), strict=True))
        for name in at:
            assert slopes[name][i] == pytest.approx(true[name], rel=1e-11, abs=1e-12), (name, short)


def test_estimates_of_thin_ellipses() -> None:
    f = teg.compile(thin("xxy", True), [a, b, t])
    for short in (1e-2, 1e-4):
        slopes, errors = f.grad_and_error({"a": 1.0, "b": short, "t": 0.3})
        for name, true in zip("abt", thin_slopes("xxy", 1.0, short, 0.3), strict=True):
            assert abs(slopes[name] - true) <= errors[name] + 1e-15
            assert errors[name] <= 1e-11 / short
