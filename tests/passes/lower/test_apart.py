"""Integrals of sums of conditions in parts: which are taken apart, and their values."""

from __future__ import annotations

import math

import pytest

import teg
from teg.analysis.breaks import BreakAnalysis
from teg.ir.integral import Integral
from teg.passes.lower.apart import MOST, with_terms_apart
from teg.pipeline import normal_form
from teg.program import Integrate, Program, compound

x = teg.var("x")
a, b, c, t, u = teg.params("a b c t u")


def parts(e: teg.Expr) -> int:
    """How many integrals an integral becomes."""
    (found,) = with_terms_apart([normal_form(e)], BreakAnalysis(16))
    return len([n for n in found.children if isinstance(n, Integral)]) or len([n for n in [found] if isinstance(n, Integral)])


def steps(e: teg.Expr) -> list[Integrate]:
    """The integrals that are computed piece by piece, in a program of value and gradient."""
    program = teg.compile(e, backend="numpy").program(1)
    assert isinstance(program, Program)
    return [s for s in compound(program.body) if isinstance(s, Integrate)]


def brackets(n: int, body: teg.Expr) -> teg.Expr:
    terms = [teg.param(f"c{k}") * teg.bracket(x < teg.param(f"t{k}")) for k in range(n)]
    return teg.integral(body * sum(terms, start=0 * x), (x, 0, 1))


def test_a_sum_of_brackets_times_an_exponential() -> None:
    assert not steps(brackets(5, teg.exp(a * x)))
    assert not steps(brackets(3, teg.exp(a * x) * x))


@pytest.mark.parametrize(
    "e",
    [
        teg.integral(teg.exp(x * x) * (b * teg.bracket(x < t) + c * teg.bracket(x < u)), (x, 0, 1)),  # no closed form
        teg.integral(teg.exp(a * x) * (b * teg.bracket(x < t) + c * teg.bracket(teg.sin(9 * x) < u)), (x, -1, 1)),  # many places
        teg.integral(teg.exp(a * x) * teg.bracket(x < t), (x, 0, 1)),  # one interval as it is
    ],
)
def test_others_stay_whole(e: teg.Expr) -> None:
    assert parts(e) == 1


def test_many_terms_are_no_straight_line() -> None:
    terms = [teg.param(f"c{k}") * teg.bracket(teg.param(f"r{k}") * x < 1 + k * x) for k in range(MOST + 1)]
    assert parts(teg.integral(teg.exp(a * x) * sum(terms, start=0 * x), (x, 0, 1))) == 1


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_values_and_gradients(backend: str) -> None:
    """∫₀¹ e^{ax}(b·[x < t] + c·[x > u] + 1) dx, by its antiderivative, with places in any order and outside."""
    e = teg.integral(teg.exp(a * x) * (b * teg.bracket(x < t) + c * teg.bracket(x > u) + 1), (x, 0, 1))
    f = teg.compile(e, [a, b, c, t, u], backend=backend)
    for at in ((0.7, 0.3), (0.2, 0.9), (1.5, -0.5), (-1.0, 2.0), (0.5, 0.5)):
        for rate in (-1.3, 1e-9, 2.5):
            lo, hi = (min(max(v, 0.0), 1.0) for v in at)
            value, slopes = f.value_and_grad(a=rate, b=0.4, c=-1.7, t=at[0], u=at[1])
            below, above, whole = (math.expm1(rate * v) / rate for v in (lo, hi, 1.0))
            assert value == pytest.approx(0.4 * below - 1.7 * (whole - above) + whole, rel=1e-12, abs=1e-13)
            assert slopes["b"] == pytest.approx(below, rel=1e-12, abs=1e-14)
            assert slopes["c"] == pytest.approx(whole - above, rel=1e-12, abs=1e-13)
            assert slopes["t"] == pytest.approx(0.4 * math.exp(rate * at[0]) if 0 < at[0] < 1 else 0.0, rel=1e-12)
            assert slopes["u"] == pytest.approx(1.7 * math.exp(rate * at[1]) if 0 < at[1] < 1 else 0.0, rel=1e-12)
