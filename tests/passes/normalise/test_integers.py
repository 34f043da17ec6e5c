"""Integers that are sums, as numbers; bounds whose distance is known."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.analysis.expanded import distance
from teg.ir.expr import Add, Const, Expr, Mul
from teg.ir.index import Index, IndexCall, IndexValue
from teg.ir.node import postorder
from teg.ir.operands import as_number
from teg.passes.normalise.integers import with_sums_of_integers
from tests.backends.c_checks import in_c

i, j = teg.index("i"), teg.index("j")
x, y = teg.vars("x y")
t, s = teg.params("t s")
COUNTED: dict[str, Index] = {
    "sum": i + 3,
    "difference": i - 2,
    "other side": 7 - i,
    "multiple": 2 * i + 1,
    "nested": 3 * (5 - (i + 1)) - 4,
    "two": i + j,
    "quotient": (i + 5) // 2 + 1,
    "remainder": 2 * ((i + 1) % 3) - 1,
}


@pytest.mark.parametrize("name", COUNTED)
def test_the_number_is_that_of_the_integer(name: str) -> None:
    total = teg.sum(COUNTED[name] * t, (i, 0, 6), (j, 0, 3))
    changed = with_sums_of_integers(total)
    for e in (total, changed):
        found = float(teg.compile(e, [t], backend="numpy")(t=1.0))
        assert found == teg.evaluate(teg.sum(COUNTED[name], (i, 0, 6), (j, 0, 3)))
    for node in postorder([changed]):
        if isinstance(node, IndexValue) and isinstance(node.index, IndexCall):
            assert node.index.data not in ("add", "sub") or all(isinstance(c, Index) and c.children == () for c in node.index.children)


def test_a_sum_is_taken_apart() -> None:
    e = with_sums_of_integers(as_number(2 * i + 1))
    assert isinstance(e, Add)
    assert {type(c) for c in e.children} == {Mul, Const}


def test_programs_without_such_integers_stay_as_they_are() -> None:
    e = teg.sum(teg.integral(teg.bracket(x < t), (x, i, 5)), (i, 0, 3))
    assert with_sums_of_integers(e) is e


def number(e: object) -> Expr:
    return with_sums_of_integers(as_number(e))


@pytest.mark.parametrize(
    ("lo", "hi", "size"),
    [
        (number(i), number(i + 1), 1.0),
        (number(2 * i - 1), number(2 * i + 3), 4.0),
        (number(i) / 512, number(i + 1) / 512, 1 / 512),
        (t, t + 0.5, 0.5),
        (s * t, s * (t + 1), s),
        (t + s, t, -1.0 * s),
        (as_number(0.25), as_number(1.0), 0.75),
    ],
)
def test_distances_that_are_known(lo: Expr, hi: Expr, size: Expr | float) -> None:
    assert distance(lo, hi) is as_number(size)


def test_other_distances_are_differences() -> None:
    assert distance(t, s) is teg.ir.simplify.sub(s, t)
    assert distance(t * t, teg.sin(s)) is teg.ir.simplify.sub(teg.sin(s), t * t)


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=in_c)])
def test_pixels_of_a_size_that_is_known(backend: str) -> None:
    """Gradients of areas in pixels add up to that of the whole; pixels far away have the same."""
    k = teg.index("k")
    inside = teg.bracket((x + 2 * y < t) & (y > s * x - 3))

    def total(origin: int) -> Expr:
        moved = teg.bracket((x - origin + 2 * (y - origin) < t) & (y - origin > s * (x - origin) - 3))
        pixel = teg.integral(moved, (x, k + origin, k + origin + 1), (y, j + origin, j + origin + 1))
        return teg.sum(pixel, (k, 0, 12), (j, 0, 12))

    whole = teg.compile(teg.integral(inside, (x, 0, 12), (y, 0, 12)), [t, s], backend=backend)
    value, slope = whole.value_and_grad(t=9.3, s=0.7)
    for origin in (0, 4096):
        f = teg.compile(total(origin), [t, s], backend=backend)
        found, slopes = f.value_and_grad(t=9.3, s=0.7)
        assert found == pytest.approx(value, rel=1e-13)
        assert [slopes["t"], slopes["s"]] == pytest.approx([slope["t"], slope["s"]], rel=1e-11)
        alone = f.grad(t=9.3, s=0.7)
        np.testing.assert_allclose([alone["t"], alone["s"]], [slopes["t"], slopes["s"]], rtol=1e-12)
