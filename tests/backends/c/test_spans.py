"""The spans of rows against exact arithmetic: no iteration that is live is left out, and each covered one is."""

from __future__ import annotations

import ctypes
from fractions import Fraction
from math import isfinite

import numpy as np
import pytest

from teg.backends.c.build import load_library
from teg.backends.c.lanes import SIDE
from teg.backends.c.ranges import Narrowing
from teg.backends.c.ranges import function as narrow
from teg.backends.c.runtime import runtime
from teg.backends.c.spans import function
from teg.backends.c.text import TRUTH
from teg.program import Assign
from tests.backends.c_checks import in_c

pytestmark = in_c

HEIGHTS, COVERS = 2, 3
LINES = HEIGHTS + COVERS
WIDTH = 6 + 2 * COVERS
ENTRY = f"""
TEG_INLINE {TRUTH} narrow_0({", ".join(f"double p{i}" for i in range(2 * LINES + 1))}, double *height)
{{
    %s
}}

%s

void rows(const double (*q)[{SIDE}], const double *lo, const double *length, double (*spans)[{SIDE}])
{{
    spans_0({", ".join(f"q[{i}]" for i in range(2 * LINES))}, lo, length, spans);
}}
"""


def rows() -> ctypes.CDLL:
    """Number m of iteration i is p(2m + 1)·i + p(2m + 2); the first ones must not be negative, the others cover."""
    body: list[Assign] = []
    for m in range(LINES):
        body += [Assign(f"v{LINES + m}", "mul", (f"p{2 * m + 1}", "p0")), Assign(f"v{m}", "add", (f"v{LINES + m}", f"p{2 * m + 2}"))]
    names = [f"v{m}" for m in range(LINES)]
    known = Narrowing(tuple(names[:HEIGHTS]), (), True, tuple(names[HEIGHTS:]), (), tuple(range(COVERS)), tuple(body))
    inside = function("narrow_0", known, {0}, set(range(1, 2 * LINES + 1)), True).replace("@", "spans_0")
    text = ENTRY % ("\n    ".join(narrow(known)), inside)
    return load_library("\n\n".join([*runtime([text]), text]), optimise=("-O3",))


def spans_of(lines: np.ndarray, lo: np.ndarray, length: np.ndarray) -> np.ndarray:
    """The spans of eight rows: `lines` has slope and offset of each number, in each row."""
    found = np.full((WIDTH, SIDE), np.nan)
    columns = np.ascontiguousarray(lines.reshape(2 * LINES, SIDE), dtype=float)
    given = [np.ascontiguousarray(a, dtype=float) for a in (columns, lo, length)]
    rows().rows(*(ctypes.c_void_p(a.ctypes.data) for a in given), ctypes.c_void_p(found.ctypes.data))
    return found


def values(slope: float, offset: float, iterations: range) -> list[Fraction] | None:
    """The number at some iterations; None if it is not finite."""
    if not (isfinite(slope) and isfinite(offset)):
        return None
    return [Fraction(slope) * i + Fraction(offset) for i in iterations]


def check(lines: np.ndarray, lo: np.ndarray, length: np.ndarray) -> int:
    """Compares the spans of eight rows; returns how many iterations are covered."""
    found, count = spans_of(lines, lo, length), 0
    for k in range(SIDE):
        iterations = range(int(lo[k]), int(lo[k] + length[k]))
        start, stop, since, until = (int(end) for end in found[:4, k])
        assert 0 <= start <= since <= until <= stop <= max(length[k], 0) or stop <= start == since == until
        numbers = [values(*lines[m, :, k], iterations) for m in range(LINES)]
        for i in range(len(iterations)):
            if all(g is None or g[i] >= 0 for g in numbers[:HEIGHTS]):
                assert start <= i < stop or any(np.isinf(lines[m, :, k]).any() for m in range(HEIGHTS))
            if since <= i < until:
                assert all(g is not None and g[i] > 0 for g in numbers[HEIGHTS:])
                count += 1
    return count


@pytest.mark.parametrize("seed", range(4))
def test_lines_of_all_slopes(seed: int) -> None:
    """Many are level, or pass a whole iteration exactly."""
    rng = np.random.default_rng(seed)
    slopes = rng.choice([0.0, -0.0, 0.5, -0.25, 1.0, -3.0, 1e-9, -(2.0**-40)], (LINES, SIDE))
    at = rng.integers(-4, 40, (LINES, SIDE))
    lines = np.stack([slopes, -slopes * at + rng.choice([0.0, 0.0, 2.0**-45, 1.0], (LINES, SIDE))], axis=1)
    lines[HEIGHTS:, 1] += rng.choice([0.0, 20.0], (COVERS, SIDE))
    lo = rng.choice([0.0, -3.0, 5.0], SIDE)
    assert check(lines, lo, rng.integers(0, 34, SIDE).astype(float)) > 0


@pytest.mark.parametrize("seed", range(4))
def test_numbers_that_overflow(seed: int) -> None:
    rng = np.random.default_rng(10 + seed)
    lines = rng.choice([0.0, 1.0, -1.0, 5e-324, -5e-324, 1e307, -1e307, 1.7e308, -1.7e308, np.inf, -np.inf, np.nan], (LINES, 2, SIDE))
    lines[:, :, :3] = rng.choice([1.0, 1.7e308, -1.2e308, 1e308], (LINES, 2, 3))
    check(lines, np.zeros(SIDE), rng.integers(0, 20, SIDE).astype(float))


def test_a_fall_that_overflows_leaves_nothing_out() -> None:
    """From 1.5e308 down to -1.5e308: the first six of eleven iterations are live."""
    lines = np.tile(np.array([[-3e307, 1.5e308], *[[0.0, 1.0]] * (LINES - 1)])[:, :, None], SIDE)
    found = spans_of(lines, np.zeros(SIDE), np.full(SIDE, 11.0))
    assert (found[0] == 0.0).all()
    assert (found[1] >= 6.0).all()


def test_what_a_row_is_beside_its_covered_part() -> None:
    """One half-plane alone crosses the iterations on each side; the ends in which each holds are told too."""
    lines = np.tile(np.array([[0.0, 1.0], [0.0, 1.0], [1.0, -2.5], [-1.0, 6.5], [0.0, 1.0]])[:, :, None], SIDE)
    found = spans_of(lines, np.zeros(SIDE), np.full(SIDE, 10.0))
    assert found[:, 0].tolist() == [0.0, 10.0, 3.0, 7.0, 1.0, 2.0, 3.0, 10.0, 0.0, 7.0, 0.0, 10.0]
