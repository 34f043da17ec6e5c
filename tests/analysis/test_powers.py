"""Powers with exponents that are parameters, written with an order that is known."""

from __future__ import annotations

import pytest

import teg
from teg.analysis.powers import LEAST, merged_powers, raised_powers
from teg.ir.expr import TRUE, ZERO, Call, const
from teg.ir.node import postorder
from teg.ir.simplify import call, mul, positive, sub

x = teg.var("x")
a, k = teg.params("a k")


def over(e: teg.Expr) -> teg.Evaluator:
    return teg.compile(teg.integral(e, (x, 0.5, 1)))


def test_the_value_stays() -> None:
    e = (x - a) ** k * x + 3.0
    raised, _ = raised_powers(e)
    assert raised is not e
    assert over(raised)(a=0.3, k=2.2) == pytest.approx(over(e)(a=0.3, k=2.2), rel=1e-12)


def test_where_exponents_are_not_too_small() -> None:
    _, smooth = raised_powers((x - a) ** k)
    assert smooth == positive(sub(k, const(LEAST)), strict=False)
    assert raised_powers((x - a) ** 2.5) == ((x - a) ** 2.5, TRUE)
    assert raised_powers(a**k) == (a**k, TRUE)


def test_powers_of_nothing_are_nothing() -> None:
    raised, _ = raised_powers(call("pow", ZERO, k) + (x - a) ** k)
    assert not any(isinstance(n, Call) and n.children[0] is ZERO for n in postorder([raised]))


def test_products_of_powers_are_one() -> None:
    u = x - a
    merged = merged_powers(mul(const(3.0), u, u, call("pow", u, sub(k, const(3.0))), x))
    powers = [n for n in postorder([merged]) if isinstance(n, Call)]
    assert [n.children[1] for n in powers] == [k - 1.0]
    assert over(merged)(a=0.3, k=2.2) == pytest.approx(over(3.0 * x * (x - 0.3) ** 1.2)(), rel=1e-12)
