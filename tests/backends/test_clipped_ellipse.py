"""Moments of ellipses on boxes that half-planes clip, in every backend: as statements, and as the programs that become them."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import teg
from teg.ir.traverse import parameters
from teg.program import Ellipse, HalfPlane, Moments, Program, statements
from teg.program.interpreter import interpret
from tests.backends.c_checks import behaviour_is_defined, text_compiles_without_warnings
from tests.backends.ellipse_moments import ASKED, BACKENDS, LEANS, LONG, ROUND, Line, Matrix, Place, exact, kernels, needs_c
from tests.backends.programs import Case, Row, columns, expected, program

pytestmark = pytest.mark.usefixtures("x64")

ROWS: list[tuple[Place, Line, Line]] = [
    ((0.5, 0.5, 0.55, 1.0, 1.0), (-1.0, -0.5, 0.9), (0.3, -1.0, 0.5)),
    ((0.5, 0.5, 0.3, 1.0, 1.0), (1.0, 0.0, -0.4), (0.0, 1.0, 0.5)),
    ((0.5, 0.5, 3.0, 1.0, 1.0), (-1.0, 1.0, 0.1), (-1.0, -1.0, 1.2)),
    ((3.0, 0.5, 1.0, 1.0, 1.0), (1.0, 1.0, -0.9), (-1.0, 1.0, 1.9)),
    ((0.1, 0.2, 0.4, 1.0, 0.7), (1.0, -1.0, 0.05), (1.0, 3.0, -0.3)),
    ((0.5, 0.5, 0.25, 1.0, 1.0), (1.0, 1.0, -0.6), (-1.0, 1.0, 0.4)),
    ((0.3, 0.3, 0.1, 1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, 1.0, 0.9)),
    ((0.0, 0.0, 0.5, 1.0, 1.0), (1.0, -1.0, 0.0), (-1.0, 2.0, 0.0)),
    ((0.5, 0.5, 0.4, 1.0, 1.0), (1.0, 0.0, 0.0), (-1.0, -1.0, 2.0)),
    ((0.5, 0.5, 0.6, 1.0, 1.0), (-1.0, -1.0, 1.0), (-2.0, -2.0, 2.0)),
    ((0.5, 0.5, 0.5, 1.0, 1.0), (-1.0, 1.0, 2.0), (1.0, 1.0, -2.0)),
    ((0.4, 0.6, 0.5, -1.0, 1.0), (1.0, 1.0, 0.1), (-1.0, 2.0, -0.5)),
    ((-0.4, -0.6, 0.5, -1.0, -1.0), (1.0, 0.2, 0.6), (-1.0, 2.0, 1.5)),
    ((-60.0, -80.0, 100.3, 1.0, 1.0), (-1.0, 0.5, 0.3), (1.0, 1.0, -0.2)),
    ((0.5, 0.5, 0.6, 1.0, 1.0), (1.0, 1.0, -0.7), (-1.0, -1.0, 0.7 + 1e-9)),
    ((0.5, 0.5, 0.7, 1.0, 1.0), (-1.0, -1.0, 2.0 - 2.0**-26), (1.0, -1.0, 0.9)),
    ((1.0, 1.0, 1.2, 1.0, 1.0), (1.0, 1.0, -(2.0**-20)), (0.0, -1.0, 0.8)),
    ((0.5, 1e-9, 1e-8, 1.0, 1.0), (1.0, 1.0, -0.5), (-1.0, 3.0, 0.5)),
    ((0.5, 0.5, 0.5 + 2.0**-40, 1.0, 1.0), (1.0, 1.0, -0.3), (-1.0, 1.0, 0.7)),
    ((0.5, 0.5, 0.3 + 5e-15, 1.0, 1.0), (1.0, 0.0, -0.2), (math.cos(5e-7), math.sin(5e-7), 0.3 - 0.5 * (math.cos(5e-7) + math.sin(5e-7)))),
]
LOOSE = ROWS[-3:]
"""A circle so small that its lines have fewer digits, one that touches a side, one that crosses two nearly equal lines a little."""


def of_place(matrix: Matrix, asked: list[Moments]) -> Program:
    """Moments with p0, …, p4 as the place and p5, …, p10 as two half-planes."""
    planes = HalfPlane("p5", "p6", "p7"), HalfPlane("p8", "p9", "p10", closed=True)
    results = tuple(f"v{i}" for i in range(len(asked)))
    return program(11, (Ellipse(matrix, ("p0", "p1", "p2", "p3", "p4", 0.0), tuple(asked), results, None, planes),), *results)


def given_of(rows: list[tuple[Place, Line, Line]]) -> tuple[Row, ...]:
    """The values of p0, …, p10."""
    return tuple(zip(*([*row, *first, *second] for row, first, second in rows), strict=True))


def case_of(name: str, matrix: Matrix, rows: list[tuple[Place, Line, Line]], tolerance: float) -> Case:
    """All of these ellipses in one batch."""

    @cache  # when a test asks, not when it is collected
    def answers() -> tuple[Row, ...]:
        return tuple(tuple(exact(matrix, row, m.kind, *m.terms[0][:2], lines=tuple(lines)) for row, *lines in rows) for m in ASKED)

    return Case(name, of_place(matrix, ASKED), given_of(rows), answers, len(rows), tolerance)


NAN, INF = math.nan, math.inf
AREA, REST, LENGTH = (Moments(kind, ((0, 0, 1.0),)) for kind in ("above", "below", "border"))
FAR_AND_WIDE: list[tuple[Place, Line, Line]] = [
    ((0.5, 0.5, INF, 1.0, 1.0), (1.0, 1.0, -1.0), (0.0, 0.0, 0.0)),
    ((INF, 0.5, 1.0, 1.0, 1.0), (1.0, 1.0, -1.0), (0.0, 0.0, 0.0)),
    ((0.5, 0.5, 1.0, 1.0, 1.0), (NAN, 1.0, 0.0), (0.0, 0.0, 0.0)),
    ((0.5, 0.5, 0.4, 1.0, 1.0), (1.0, 1.0, -3.0), (0.0, 0.0, 0.0)),
    ((0.7, 0.7, 0.2, 1.0, 1.0), (-1.0, -1.0, 0.8), (0.0, 0.0, 1.0)),
    ((0.5, 0.5, 0.4, 1.0, 1.0), (1.0, 1.0, -1.0), (1.0, 0.0, 1.0)),
    ((0.5, 0.5, 0.4, 1.0, 1.0), (1.0, 0.0, -0.5), (-1.0, 0.0, 0.5)),
]
EIGHTH = 0.08 * math.pi
SPECIAL = Case(
    "infinite, unknown and empty",
    of_place(ROUND, [AREA, REST, LENGTH]),
    given_of(FAR_AND_WIDE),
    (
        (0.5, 0.0, NAN, 0.0, 0.0, EIGHTH, 0.0),
        (0.0, 0.5, NAN, 0.0, 0.32, 0.5 - EIGHTH, 0.0),
        (0.0, 0.0, NAN, 0.0, 0.0, 0.5 * math.pi, 0.0),
    ),
    len(FAR_AND_WIDE),
)
PLAIN = [row for row in ROWS if row not in LOOSE]
CASES = [
    case_of("circles", ROUND, PLAIN, 4e-15),
    case_of("circles that touch", ROUND, LOOSE, 1e-6),
    case_of("leaning ellipses", LEANS, [*PLAIN[:2], *PLAIN[4:10:2]], 4e-15),
    case_of("long ellipses", LONG, [*PLAIN[:2], *PLAIN[4:10:2]], 4e-15),
]


@pytest.mark.parametrize("case", [*CASES, SPECIAL], ids=lambda case: case.name)
@pytest.mark.parametrize("backend", BACKENDS)
def test_statements(case: Case, backend: str) -> None:
    kernel = kernels(backend)(case.program)
    np.testing.assert_allclose(kernel(columns(case), case.n), expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.parametrize("case", [*CASES, SPECIAL], ids=lambda case: case.name)
def test_the_interpreter(case: Case) -> None:
    for i in range(case.n):
        found = interpret(case.program, [column[i] for column in case.columns]).outputs
        np.testing.assert_allclose(found, expected(case)[:, i], rtol=case.tolerance, atol=case.tolerance)


@needs_c
def test_the_text_is_c99_without_warnings_and_its_behaviour_defined(tmp_path: Path) -> None:
    """The length of an arc alone needs no nodes, and no matrix."""
    some = [CASES[0], SPECIAL]
    single = [Case("one", of_place(ROUND, [m]), SPECIAL.columns, (), SPECIAL.n) for m in (AREA, REST, LENGTH)]
    text_compiles_without_warnings(tmp_path, [*some, *single])
    behaviour_is_defined(tmp_path, some)


# -- programs --------------------------------------------------------------------------------------------------------------

x, y, z = teg.vars("x y z")
a, b, c, d, r, s, t = NAMED = teg.params("a b c d r s t")
DISK = teg.bracket((x - a) ** 2 + (y - b) ** 2 < r**2)
LINE = teg.bracket(c * x + d * y < s)
MORE = [(1, 0, 0.1), (0, 1, 0.1), (-1, 0.1, -0.9), (1, 1, 0.3), (1, -1, -0.8)]
PROGRAMS = {
    "half of a disk": DISK * LINE,
    "the other half": DISK * (1 - LINE) * (1 + x * y),
    "outside": (1 - DISK) * LINE * (1 + s * x),
    "a wedge": DISK * LINE * teg.bracket(d * x - c * y > t) * (1 + x * y - s * x**2),
    "a triangle, along both axes": DISK * teg.bracket(y > 0.2 * t) * teg.bracket(x > 0.1) * teg.bracket(x + y < s + 0.5),
    "a leaning ellipse": teg.bracket((2 * x - a + y * s) ** 2 + (y + x - b) ** 2 < r**2) * LINE * teg.bracket(x < t),
    "two colours": teg.where((x - a) ** 2 + (y - b) ** 2 < r**2, t + x, s * y) * teg.bracket(x - y < c) * teg.bracket(x + y > d),
    "six lines": DISK * LINE * math.prod(teg.bracket(p * x + q * y > w) for p, q, w in MORE),
}  # fmt: skip
AT = {
    "a": np.array([0.5, 0.1, 0.75, 0.5, 0.5]), "b": np.array([0.45, -0.2, 0.25, 0.5, 0.5]), "c": np.array([0.8, 0.6, 0.75, 1.0, 1.0]),
    "d": np.array([0.5, 0.9, 0.25, 0.0, 1.0]), "r": np.array([0.55, 0.8, 1.0, 0.25, 0.25]), "s": np.array([0.7, 0.6, 0.25, 0.75, 1.0]),
    "t": np.array([0.4, 0.3, 0.5, 0.25, 0.5]),
}  # fmt: skip
"""The line of the last but one touches the disk, the last one goes through its centre and two corners of the box."""


def integral(name: str) -> teg.Expr:
    return teg.integral(PROGRAMS[name], (x, 0, 1), (y, 0, 1))


def values_of(name: str, **options: Any) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    e = integral(name)
    used = parameters(e)
    return teg.compile(e, used, **options).value_and_grad({p.name: AT[p.name] for p in used})


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_is_one_statement_and_its_chords(name: str) -> None:
    e = integral(name)
    f = teg.compile(e, parameters(e))
    for order, others in ((0, set()), (1, {"Integrate", "Segment"})):
        kinds = [type(stmt).__name__ for stmt in statements(f.program(order).body) if type(stmt).__name__ != "Assign"]
        assert kinds.count("Ellipse") == 1
        assert set(kinds) <= {"Ellipse"} | others


@pytest.mark.parametrize("name", ["half of a disk", "outside", "a wedge"])
def test_values_and_gradients_are_those_by_pieces(name: str) -> None:
    value, slopes = values_of(name)
    true, others = values_of(name, intrinsics=False, tol=1e-12)
    np.testing.assert_allclose(value, true, atol=1e-13)
    for p, slope in slopes.items():
        np.testing.assert_allclose(slope, others[p], atol=1e-12, err_msg=p)


@pytest.mark.parametrize("name", PROGRAMS)
def test_backends_agree(name: str) -> None:
    (value, slopes), (true, others) = (values_of(name, backend=backend) for backend in ("c", "numpy"))
    np.testing.assert_allclose(value, true, atol=1e-14)
    for p, slope in slopes.items():
        np.testing.assert_allclose(slope, others[p], atol=1e-13, err_msg=p)


def test_gradients_are_differences_of_values() -> None:
    """With parameters in the axes, where pieces would need charts."""
    e = integral("a leaning ellipse")
    f, step = teg.compile(e, NAMED), 1e-6
    at = {name: values[0] for name, values in AT.items()} | {"a": 0.8, "r": 0.9}
    for name, slope in f.grad(at).items():
        assert slope == pytest.approx((f({**at, name: at[name] + step}) - f({**at, name: at[name] - step})) / (2 * step), abs=1e-8), name


def test_second_derivatives_are_those_without_intrinsics() -> None:
    e = teg.integral(DISK * LINE * (1 + x), (x, 0, 1), (y, 0, 1))
    on, off = (teg.compile(e, [a, s], intrinsics=flag) for flag in (True, False))
    at = {"a": 0.5, "b": 0.4, "r": 0.45, "c": 0.8, "d": 0.6, "s": 0.7}
    assert on.hessian(at) == pytest.approx(off.hessian(at), abs=1e-10)


def test_estimates_hold() -> None:
    """At random, of lines that nearly touch, and of two that are nearly parallel."""
    e = teg.integral(DISK * LINE * teg.bracket(x + y > t), (x, 0, 1), (y, 0, 1))
    f = teg.compile(e, [r, s])
    rng = np.random.default_rng(5)
    rows = [dict(zip("abcdrst", (*rng.uniform(0.2, 0.8, 4), *rng.uniform(0.2, 0.7, 3)), strict=True)) for _ in range(6)]
    rows += [dict(rows[0], c=1.0, d=0.0, a=0.5, r=0.3, t=0.1, s=0.8 - excess) for excess in (1e-3, 1e-6, 1e-9, 1e-12)]
    rows += [dict(rows[0], c=1.0, d=1.0 + excess, s=0.9, t=0.9 - excess / 3) for excess in (1e-3, 1e-6, 1e-9)]
    for at in rows:
        place = at["a"], at["b"], at["r"], 1.0, 1.0
        lines = (-at["c"], -at["d"], at["s"]), (1.0, 1.0, -at["t"])
        value, error = f.value_and_error(at)
        slopes, errors = f.grad_and_error(at)
        assert abs(value - exact(ROUND, place, "above", 0, 0, lines)) <= error + 1e-15
        assert abs(slopes["r"] - 2.0 * at["r"] * exact(ROUND, place, "border", 0, 0, lines)) <= errors["r"] + 1e-15
        assert error <= 1e-12
        assert errors["r"] <= 1e-6


def test_two_equal_lines_move_half_of_the_chord_each() -> None:
    e = teg.integral(DISK * teg.bracket(x < s) * teg.bracket(x < t), (x, 0, 1), (y, 0, 1))
    slopes = teg.compile(e, [s, t]).grad(a=0.5, b=0.5, r=0.5, s=0.7, t=0.7)
    assert slopes == pytest.approx({"s": math.sqrt(0.21), "t": math.sqrt(0.21)}, abs=1e-14)


def test_slices_of_a_ball_that_a_plane_cuts() -> None:
    """The gradient breaks where a slice goes through a corner of its polygon, or touches a line."""
    ball = teg.bracket((x - a) ** 2 + (y - b) ** 2 + (z - t) ** 2 < r**2)
    e = teg.integral(ball * teg.bracket(x + z < s) * (1 + x * z), (x, 0, 1), (y, 0, 1), (z, 0, 1))
    on, off = teg.compile(e, [a, r, s], tol=1e-11), teg.compile(e, [a, r, s], intrinsics=False, tol=1e-11, backend="c")
    at = {"a": 0.1, "b": 0.3, "r": 0.4, "t": 0.5, "s": 0.5}
    (value, slopes), (true, others) = on.value_and_grad(at), off.value_and_grad(at)
    assert value == pytest.approx(true, abs=1e-11)
    assert slopes == pytest.approx(others, abs=1e-10)


def test_more_lines_than_a_statement_has_go_by_pieces() -> None:
    many = math.prod(teg.bracket(x * math.cos(k) + y * math.sin(k) < 1.2 + k * s) for k in range(9))
    f = teg.compile(teg.integral(DISK * many, (x, 0, 1), (y, 0, 1)), [r])
    assert not any(isinstance(stmt, Ellipse) for stmt in statements(f.program(0).body))
    assert f(a=0.5, b=0.5, r=0.2, s=0.01) == pytest.approx(0.04 * math.pi, abs=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_pieces_of_many_disks(backend: str) -> None:
    """In a loop over disks, each cut by its own line."""
    k = teg.index("k")
    disks = teg.array("D", 2)
    inside = teg.bracket((x - disks[k, 0]) ** 2 + (y - disks[k, 1]) ** 2 < disks[k, 2] ** 2)
    cut = teg.bracket(disks[k, 3] * x + disks[k, 4] * y < 0.5)
    e = teg.sum(teg.integral(inside * cut, (x, 0, 1), (y, 0, 1)), (k, 0, teg.length(disks, 0)))
    at = np.random.default_rng(3).uniform(0.1, 0.9, (5, 5))
    value, slopes = teg.compile(e, [disks], backend=backend).value_and_grad({"D": at})
    area, radial = 0.0, []
    for u, v, radius, p, q in at:
        place, line = (u, v, radius, 1.0, 1.0), (-p, -q, 0.5)
        area += exact(ROUND, place, "above", 0, 0, (line,))
        radial.append(2.0 * radius * exact(ROUND, place, "border", 0, 0, (line,)))
    assert value == pytest.approx(area, abs=1e-13)
    np.testing.assert_allclose(slopes["D"][:, 2], radial, atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("ends", [(0.2, 0.3, 0.7, 0.6), (0.58, 0.36, 0.22, 0.21), (0.29, 0.78, 0.73, 0.69), (0.2, 0.5, 0.7, 0.5)])
def test_strokes_between_places_that_are_numbers(ends: tuple[float, ...], backend: str) -> None:
    """Two half disks and a strip, |p - s·d|² < t² with s clipped to (0, 1): roundings of numbers make the strip an ellipse, 10⁸ times as
    long as the box, whose centre has no digits."""
    (ax, ay, bx, by), t = ends, teg.param("t")
    u, v, dx, dy = x - ax, y - ay, bx - ax, by - ay
    s = teg.minimum(teg.maximum((u * dx + v * dy) / (dx * dx + dy * dy), 0), 1)
    within = (u - s * dx) ** 2 + (v - s * dy) ** 2 < t * t
    f = teg.compile(teg.integral(teg.bracket(within), (x, 0, 1), (y, 0, 1)), [t], backend=backend)
    (value, error), gradient = f.value_and_error(t=0.1), f.grad(t=0.1)
    length = math.hypot(dx, dy)
    assert (value, error) == (pytest.approx(0.01 * math.pi + 0.2 * length, abs=1e-14), pytest.approx(0.0, abs=1e-12))
    assert gradient["t"] == pytest.approx(0.2 * math.pi + 2.0 * length, abs=1e-13)
