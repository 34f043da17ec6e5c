"""Ranges of iterations that are narrowed: never an iteration with a result is left out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.c.lanes import Packed
from teg.backends.c.loops import print_arrays
from teg.backends.c.ranges import narrowing
from teg.program import Assign
from tests.backends.c_checks import in_c

pytestmark = [*in_c, pytest.mark.filterwarnings("error")]

x, y = teg.vars("x y")
i, j = teg.index("i"), teg.index("j")
lines = teg.array("L", 2)


def known(live: str, *settling: Assign) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """What is known of a decision in which p0 is the index and p9 changes otherwise."""
    found = narrowing(Packed(live, False, settling, (), (), ()), ["p0"], ["p0", "p9"])
    return None if found is None else (found.heights, found.unless)


AFFINE = (Assign("v1", "mul", ("p1", "p0")), Assign("v2", "add", ("v1", "p2")))
OTHER = (Assign("v3", "sub", ("p3", "p0")),)


def test_what_two_conditions_require() -> None:
    both = (Assign("b1", "gt0", ("v2",)), Assign("b2", "lt0", ("v3",)), Assign("b3", "not", ("b2",)), Assign("b4", "and", ("b1", "b3")))
    assert known("b4", *AFFINE, *OTHER, *both) == (("v2", "v3"), ())


def test_what_one_of_two_requires_is_what_both_do() -> None:
    atoms = (Assign("b1", "gt0", ("v2",)), Assign("b2", "ge0", ("v3",)), Assign("b3", "ge0", ("v2",)))
    either = (Assign("b4", "and", ("b1", "b2")), Assign("b5", "or", ("b4", "b3")))
    assert known("b5", *AFFINE, *OTHER, *atoms, *either) == (("v2",), ())
    apart = Assign("b5", "or", ("b1", "b2"))
    assert known("b5", *AFFINE, *OTHER, *atoms, apart) is None


def test_a_condition_that_is_the_same_everywhere() -> None:
    steady = Assign("b2", "gt0", ("p5",))
    assert known("b3", *AFFINE, Assign("b1", "gt0", ("v2",)), steady, Assign("b3", "or", ("b1", "b2"))) == (("v2",), ("b2",))
    assert known("b3", *AFFINE, Assign("b1", "gt0", ("v2",)), steady, Assign("b3", "and", ("b1", "b2"))) == (("v2",), ())


@pytest.mark.parametrize(
    ("bent", "convex"),
    [
        (Assign("v4", "abs", ("v2",)), True),
        (Assign("v4", "neg", ("v2",)), True),
        (Assign("v4", "mul", ("v2", "v3")), False),
        (Assign("v4", "mul", ("v2", "p9")), False),
        (Assign("v4", "add", ("v2", "p9")), False),
        (Assign("v4", "div", ("v2", "v3")), False),
    ],
)
def test_only_convex_numbers_count(bent: Assign, convex: bool) -> None:
    assert (known("b1", *AFFINE, *OTHER, bent, Assign("b1", "gt0", ("v4",))) is not None) is convex
    assert known("b2", *AFFINE, *OTHER, bent, Assign("b1", "gt0", ("v4",)), Assign("b2", "not", ("b1",))) is None
    away = (Assign("v5", "neg", ("v4",)), Assign("v6", "mul", (-2.0, "v4")))
    for name in ("v5", "v6"):
        concave = known("b1", *AFFINE, *OTHER, bent, *away, Assign("b1", "gt0", (name,)))
        assert (concave is not None) is (bent.op == "neg")


def picture() -> teg.Expr:
    """Two half-planes on pixels of rows of 70, the lines of row j being the rows of L."""
    inside = (lines[j, 0] * x + lines[j, 1] * y < lines[j, 2]) & (lines[j, 3] * x + lines[j, 4] * y < lines[j, 5])
    pixel = teg.integral(teg.where(inside, x + y * y, 0), (x, i, i + 1), (y, j, j + 1))
    return teg.sum(pixel, (i, 0, 70), (j, 0, teg.length(lines, 0)))


def placed(seed: int) -> dict[str, Any]:
    """Lines of all slopes; some stand on borders of pixels, some are level, some miss the row, some have no direction."""
    rng = np.random.default_rng(seed)
    n = 40
    found = np.empty((n, 6))
    for k in (0, 3):
        angle = rng.uniform(0, 2 * np.pi, n)
        angle[::5] = np.round(angle[::5] / (np.pi / 2)) * (np.pi / 2)
        found[:, k], found[:, k + 1] = np.cos(angle), np.sin(angle)
        at = rng.uniform(-10, 80, n)
        at[1::4] = np.round(at[1::4])
        found[:, k + 2] = found[:, k] * at + found[:, k + 1] * (np.arange(n) + rng.uniform(-1, 2, n))
    found[7, :2] = 0.0
    found[8] *= 1e-200
    found[9] *= 1e150
    return {"L": found}


@pytest.mark.parametrize("seed", range(3))
def test_as_numpy(seed: int) -> None:
    given = placed(seed)
    c, numpy = (teg.compile(picture(), [lines], backend=b) for b in ("c", "numpy"))
    value, slopes = c.value_and_grad(given)
    expected, wanted = numpy.value_and_grad(given)
    assert value == pytest.approx(expected, rel=1e-13)
    scale = np.abs(wanted["L"]).max(axis=1, keepdims=True)
    np.testing.assert_allclose(slopes["L"] / np.where(scale > 0, scale, 1), wanted["L"] / np.where(scale > 0, scale, 1), rtol=0, atol=1e-11)
    np.testing.assert_allclose(c.grad(given)["L"], slopes["L"], rtol=1e-10, atol=1e-10 * float(scale.min()))


def test_rows_are_narrowed() -> None:
    program = teg.compile(picture(), [lines], backend="numpy").program(1)
    assert "teg_narrow(" in print_arrays(program)  # type: ignore[arg-type]


def test_an_index_that_is_not_a_place_narrows_nothing() -> None:
    """The pixel of an iteration is looked up."""
    columns = teg.indices("columns", 1)
    at = columns[i]
    inside = lines[j, 0] * x + lines[j, 1] * y < lines[j, 2]
    pixel = teg.integral(teg.where(inside, x, 0), (x, at, at + 1), (y, j, j + 1))
    total = teg.sum(pixel, (i, 0, teg.length(columns, 0)), (j, 0, teg.length(lines, 0)))
    given = {**placed(4), "columns": np.random.default_rng(0).permutation(70)}
    found = [teg.compile(total, [lines], backend=b).value_and_grad(given)[0] for b in ("c", "numpy")]
    assert found[0] == pytest.approx(found[1], rel=1e-13)
    ordered = {**given, "columns": np.arange(70)}
    assert teg.compile(total, [lines], backend="c")(ordered) == pytest.approx(found[0], rel=1e-13)
