"""Conditions on square roots as conditions on polynomials: they hold at the same points."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.ir.expr import Call, Compare
from teg.ir.node import postorder
from teg.passes.normalise.canonicalise import canonicalise
from teg.passes.normalise.radicals import without_radical

x, y = teg.vars("x y")
t, k, a, b = teg.params("t k a b")
U, V = a - x * x - y * y, 0.7 - (x - b) ** 2 - y * y
ROOT, OTHER = teg.sqrt(U), teg.sqrt(V)
FUNCTIONS = {
    "rising": 0.5 * ROOT + 0.4 * x + 0.3 * y - t,
    "falling": 0.4 * x + 0.3 * y - t - 2 * ROOT,
    "factor of a parameter": k * ROOT + x - t,
    "a root alone": 0.5 * ROOT,
    "minus a root": -1.5 * ROOT,
    "a root and a number": ROOT - 0.4,
    "two roots": 2 * ROOT - OTHER + t,
    "two roots without a number": ROOT - OTHER,
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("strict", [True, False])
def test_holds_at_the_same_points(name: str, strict: bool) -> None:
    g = FUNCTIONS[name]
    condition = without_radical(g, strict)
    assert condition is not None
    assert not any(isinstance(n, Call) and n.name == "sqrt" for n in postorder([condition]))
    random = np.random.default_rng(7)
    at = {v: random.uniform(-1.2, 1.2, 4000) for v in (x, y, t, k, b)} | {a: random.uniform(-0.2, 1.2, 4000)}
    at[k][:500] = 0.0
    at[t][::7] = 0.0
    value, holds = values_of([g, teg.bracket(condition)], at)
    value, holds = np.broadcast_arrays(value, holds)
    expected = value > 0.0  # no number holds
    assert 0 < expected.sum() < expected.size or name == "minus a root"
    assert np.array_equal(holds > 0.5, expected)


def test_surfaces_of_one_degree_less_where_squares_cancel() -> None:
    """Of two spheres whose centres are at one height, the nearer one is told by a line."""
    condition = without_radical(ROOT - teg.sqrt(0.3 - (x - b) ** 2 - y * y), True)
    assert condition is not None
    lines = [n.g for n in postorder([condition]) if isinstance(n, Compare) and n.g.free == {x}]
    assert len(lines) == 1


@pytest.mark.parametrize("g", [teg.sqrt(x * x + y * y) - t, teg.sqrt(U) + teg.sqrt(V) - t, x * ROOT - t, ROOT + teg.sqrt(V) * k])
def test_others_stay(g: teg.Expr) -> None:
    assert without_radical(g, True) is None


def test_a_factor_without_variables_is_taken_off_first() -> None:
    alone = canonicalise(teg.bracket(k * x + ROOT > 0))
    assert canonicalise(teg.bracket((k * x + ROOT) / teg.sqrt(b) > 0)) is alone
    assert canonicalise(teg.bracket((k * x + ROOT) / b**2 > 0)) is alone
    either = canonicalise(teg.bracket((k * x + ROOT) / b > 0))
    surfaces = {n.g for n in postorder([either]) if isinstance(n, Compare)}
    assert surfaces == {n.g for n in postorder([alone]) if isinstance(n, Compare)} | {b}
