"""Moments of ellipses on boxes that half-planes clip, in every backend: as statements, and as the programs that become them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from teg.program import Ellipse, HalfPlane, Moments, Program
from teg.program.interpreter import interpret
from tests.backends.c_checks import behaviour_is_defined, text_compiles_without_warnings
from tests.backends.ellipse_moments import Line, Matrix, Place, exact
from tests.backends.programs import Case, Row, columns, expected, program
from tests.backends.test_ellipse import ASKED, BACKENDS, LEANS, LONG, ROUND, kernels, needs_c

pytestmark = pytest.mark.usefixtures("x64")

ROWS: list[tuple[Place, Line, Line]] = [
    ((0.5, 0.5, 0.55, 1.0, 1.0), (-1.0, -0.5, 0.9), (0.3, -1.0, 0.5)),
    ((0.5, 0.5, 0.3, 1.0, 1.0), (1.0, 0.0, -0.4), (0.0, 1.0, 0.5)),
    ((0.5, 0.5, 3.0, 1.0, 1.0), (-1.0, 1.0, 0.1), (-1.0, -1.0, 1.2)),
    ((3.0, 0.5, 1.0, 1.0, 1.0), (1.0, 1.0, -0.9), (-1.0, 1.0, 1.9)),
    ((0.1, 0.2, 0.4, 1.0, 0.7), (1.0, -1.0, 0.05), (1.0, 3.0, -0.3)),
    ((0.5, 0.5, 0.25, 1.0, 1.0), (1.0, 1.0, -0.6), (-1.0, 1.0, 0.4)),
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
    ((0.5, 0.5, 0.3, 1.0, 1.0), (1.0, 0.0, -0.2), (1.0, 2.0**-45, -0.2)),
]
LOOSE = ROWS[-3:]
"""A circle so small that its lines have fewer digits, one that touches a side, and one that touches two nearly equal lines."""


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
    answers: list[Row] = [tuple(exact(matrix, row, m.kind, *m.terms[0][:2], lines=tuple(lines)) for row, *lines in rows) for m in ASKED]
    return Case(name, of_place(matrix, ASKED), given_of(rows), tuple(answers), len(rows), tolerance)


NAN, INF = math.nan, math.inf
AREA, REST, LENGTH = (Moments(kind, ((0, 0, 1.0),)) for kind in ("above", "below", "border"))
FAR_AND_WIDE: list[tuple[Place, Line, Line]] = [
    ((0.5, 0.5, INF, 1.0, 1.0), (1.0, 1.0, -1.0), (0.0, 0.0, 0.0)),
    ((INF, 0.5, 1.0, 1.0, 1.0), (1.0, 1.0, -1.0), (0.0, 0.0, 0.0)),
    ((0.5, 0.5, 1.0, 1.0, 1.0), (NAN, 1.0, 0.0), (0.0, 0.0, 0.0)),
    ((0.5, 0.5, 0.4, 1.0, 1.0), (1.0, 1.0, -3.0), (0.0, 0.0, 0.0)),
    ((0.5, 0.5, 0.4, 1.0, 1.0), (1.0, 1.0, -1.0), (1.0, 0.0, 1.0)),
    ((0.5, 0.5, 0.4, 1.0, 1.0), (1.0, 0.0, -0.5), (-1.0, 0.0, 0.5)),
]
EIGHTH = 0.08 * math.pi
SPECIAL = Case(
    "infinite, unknown and empty",
    of_place(ROUND, [AREA, REST, LENGTH]),
    given_of(FAR_AND_WIDE),
    ((0.5, 0.0, NAN, 0.0, EIGHTH, 0.0), (0.0, 0.5, NAN, 0.0, 0.5 - EIGHTH, 0.0), (0.0, 0.0, NAN, 0.0, 0.5 * math.pi, 0.0)),
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
        np.testing.assert_allclose(found, [row[i] for row in case.expected], rtol=case.tolerance, atol=case.tolerance)


@needs_c
def test_the_text_is_c99_without_warnings_and_its_behaviour_defined(tmp_path: Path) -> None:
    some = [CASES[0], SPECIAL]
    text_compiles_without_warnings(tmp_path, some)
    behaviour_is_defined(tmp_path, some)
