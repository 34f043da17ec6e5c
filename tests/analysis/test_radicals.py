"""Sums of square roots and polynomials: factors, norms, and what is none."""

from __future__ import annotations

import pytest

import teg
from teg.analysis.polynomial import is_null
from teg.analysis.radicals import radical
from teg.ir.expr import const

x, y = teg.vars("x y")
t, k = teg.params("t k")
U = 1 - x * x - y * y


def test_factor_and_rest() -> None:
    found = radical(0.5 * teg.sqrt(U) + 3 * x - t)
    assert found is not None
    (root,) = found.roots
    assert root.factor == const(0.5)
    assert root.under is U
    assert is_null(found.rest - (3 * x - t))
    assert is_null(root.norm(found.rest) - (U - 4 * (3 * x - t) ** 2))
    assert found.ends


def test_norm_with_a_factor_of_unknown_sign() -> None:
    found = radical(k * teg.sqrt(U) + x)
    assert found is not None
    assert is_null(found.roots[0].norm(found.rest) - (k * k * U - x * x))


def test_two_roots() -> None:
    found = radical(teg.sqrt(U) - 2 * teg.sqrt(x * x + y * y) + t)
    assert found is not None
    assert sorted(r.factor.data for r in found.roots) == [-2.0, 1.0]
    assert not radical(teg.sqrt(x * x + y * y) - t).ends


@pytest.mark.parametrize(
    "e",
    [
        x * teg.sqrt(U) + y,  # a factor with a variable
        teg.sqrt(1 - x * x) + x,  # one variable
        teg.sqrt(x**4 + y) - t,  # of a higher degree
        teg.sqrt(U) * teg.sqrt(x + y) - t,
        teg.sqrt(U) + teg.exp(x),
        x + y,
    ],
)
def test_others(e: teg.Expr) -> None:
    assert radical(e) is None
