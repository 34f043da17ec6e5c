"""From SymPy: every function, numbers to the nearest, scopes, refusals."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
import pytest

import teg
from teg import errors
from teg.evaluator.accuracy import AccuracyWarning
from teg.ir.expr import Param, const
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.symbolic import from_sympy, jacobian_determinant, to_sympy
from teg.symbolic.nodes import sympy_package
from teg.symbolic.reader import builders
from tests.symbolic.in_sympy import FORMS, A, B, F, G, T, X, Y, a, b, p, r, same, sympy, t, value, x, y

cfunctions: Any = pytest.importorskip("sympy.codegen.cfunctions")


@pytest.mark.parametrize(
    ("s", "wanted"),
    [
        (sympy.Float("0.1", 60), 0.1),
        (sympy.Integer(2**53 + 1), float(2**53 + 1)),
        (sympy.Rational(1, 2**1074), 5e-324),
        (sympy.Rational(10**400, 10**400 - 1), 1.0),
        (sympy.pi, math.pi),
        (sympy.E, math.e),
        (sympy.GoldenRatio, (1 + 5**0.5) / 2),
        (sympy.EulerGamma, 0.5772156649015329),
        (sympy.sqrt(2), math.sqrt(2)),
        (2, 2.0),
        (0.1, 0.1),
        (np.float64(0.1), 0.1),
    ],
    ids=str,
)
def test_numbers_to_the_nearest(s: Any, wanted: float) -> None:
    assert from_sympy(s) is const(wanted)


def test_a_fraction_stays_a_quotient() -> None:
    assert from_sympy(X / 3, "x") is x / 3
    assert from_sympy(sympy.Rational(3, 4) * X, "x") is 0.75 * x
    assert value(from_sympy(sympy.Rational(10**30 + 1, 3 * 10**30))) == pytest.approx(1 / 3, abs=1e-16)


@pytest.mark.parametrize("s", [sympy.Integer(10) ** 400, sympy.Float("1e400"), sympy.Rational(10**400, 3)], ids=lambda s: type(s).__name__)
def test_a_number_beyond_float64(s: Any) -> None:
    with pytest.raises(errors.OperandError):
        from_sympy(X + s)


# -- from SymPy ---------------------------------------------------------------------------------------------------------

U, V = sympy.symbols("u v", real=True)
INSIDE, ABOVE = (-0.7, -0.25, 0.3, 0.9), (1.1, 2.5, 7.0)
NUMBERS: list[tuple[Any, tuple[float, ...]]] = [
    *((f(U), INSIDE) for f in (sympy.sin, sympy.cos, sympy.tan, sympy.sec, sympy.csc, sympy.cot, sympy.sinc)),
    *((f(U), INSIDE) for f in (sympy.asin, sympy.acos, sympy.atan, sympy.acot)),
    *((f(U), ABOVE) for f in (sympy.asec, sympy.acsc)),
    *((f(U), INSIDE) for f in (sympy.sinh, sympy.cosh, sympy.tanh, sympy.sech, sympy.csch, sympy.coth)),
    *((f(U), INSIDE) for f in (sympy.asinh, sympy.atanh, sympy.acsch)),
    *((f(U), ABOVE) for f in (sympy.acosh, sympy.acoth)),
    *((f(U), INSIDE) for f in (sympy.erf, sympy.erfc, sympy.erfinv)),
    (sympy.asech(U), (0.1, 0.5, 1.0)),
    (sympy.asinh(U), (-1e8, -1e-3, 0.0, 1e8)),
    (sympy.sinc(U), (0.0,)),
    (sympy.exp(U) + sympy.E**2 + sympy.Pow(sympy.E, U, evaluate=False), INSIDE),
    (sympy.log(U) + sympy.log(U, 10) + sympy.log(U, 3, evaluate=False), ABOVE),
    (sympy.sqrt(U) + U ** sympy.Rational(1, 3) + U ** sympy.Rational(-3, 2) + U**-2 + U**V, ABOVE),
    (sympy.Abs(U) + sympy.sign(U), (*INSIDE, 0.0)),
    (sympy.Min(U, V, 0.25) + 2 * sympy.Max(U, -V, 0.1), INSIDE),
    (sympy.floor(3 * U) + 2 * sympy.ceiling(3 * U) + sympy.frac(U) + sympy.Mod(U, V) + sympy.Mod(U, -2), (*INSIDE, 1.0, 2.0)),
    (sympy.atan2(U, V), INSIDE),
    (sympy.re(sympy.Symbol("u")) + sympy.conjugate(sympy.Symbol("u")), INSIDE),
    (sympy.UnevaluatedExpr(U) + 1, INSIDE),
    (sympy.Piecewise((1, U < 0), (U, U < V), (V, True)), INSIDE),
    (sympy.Piecewise((1, sympy.Eq(U, 0)), (2, sympy.Ne(U, V)), (3, True)), (0.0, 0.5, 0.3)),
    (sympy.Piecewise((1, sympy.ITE(U > 0, U < V, U > -V)), (2, True)), (*INSIDE, 0.0)),
    (sympy.Piecewise((1, sympy.Xor(U > 0, U < V, U < 0.3)), (2, True)), (*INSIDE, 0.0)),
    (sympy.Piecewise((1, sympy.Not(sympy.And(U > 0, U <= V), evaluate=False)), (2, True)), INSIDE),
    (sympy.Piecewise((1, sympy.Or(sympy.Nand(U >= 0, U < V), sympy.Nor(U > 0, U >= V))), (2, True)), INSIDE),
    (sympy.Piecewise((1, sympy.Implies(U > 0, U < V)), (2, sympy.Equivalent(U > 0, U < 1)), (3, True)), INSIDE),
    (sympy.Piecewise((1, sympy.Equivalent(U > 0, U < V, evaluate=False)), (3, True)), INSIDE),
    (F(U) + 3 * F(U, 0) + 9 * F(U, 1) + 27 * F(U, sympy.Rational(1, 4)), (*INSIDE, 0.0)),
]


@pytest.mark.parametrize(("s", "points"), NUMBERS, ids=[str(i) for i in range(len(NUMBERS))])
def test_values_are_those_of_sympy(s: Any, points: tuple[float, ...]) -> None:
    e = from_sympy(s)
    v = 0.6
    for u in points:
        exact = {symbol: sympy.Rational(str(v if symbol == V else u)) for symbol in s.free_symbols}
        wanted = float(s.xreplace(exact).doit().evalf(30))
        assert same(value(e, u=u, v=v), wanted), u


def test_every_function_that_is_read_is_tested() -> None:
    pieces = {type(n) for s in [*(s for s, _ in NUMBERS), *(s for _, s in FORMS)] for n in sympy.preorder_traversal(s)}
    unevaluated = {sympy.Nand, sympy.Nor, sympy.Implies, sympy.Xor}  # which SymPy writes with And, Or and Not at once
    alone = {cfunctions.log1p, cfunctions.expm1, sympy.erf2}  # which SymPy does not evaluate: `test_functions_of_c`
    assert set(builders()) <= pieces | unevaluated | alone | {sympy.And, sympy.Or, sympy.Mul, sympy.Gt, sympy.Ge, sympy.Tuple}


def test_connectives_that_sympy_rewrites() -> None:
    C, D = U > 0, U < V
    for kind in (sympy.Nand, sympy.Nor, sympy.Implies, sympy.Xor, sympy.Equivalent):
        e = teg.bracket(builders()[kind](from_sympy(C), from_sympy(D)))
        for u, v in ((1.0, 2.0), (1.0, 0.5), (-1.0, 2.0), (-1.0, -2.0)):
            assert value(e, u=u, v=v) == (1.0 if kind(u > 0, u < v) else 0.0), kind


def test_heaviside_at_zero() -> None:
    free, bound = from_sympy(F(T)), from_sympy(sympy.Integral(F(T - X) * sympy.log(X), (X, 0, 1)))
    assert value(free, t=0.0) == 0.5
    assert bound is teg.integral(teg.bracket(x < t) * teg.log(x), (x, 0, 1))  # and the logarithm is guarded
    assert [value(from_sympy(F(T), heaviside_at_zero=v), t=0.0) for v in (0, 1, 0.25)] == [0.0, 1.0, 0.25]
    assert from_sympy(F(T - X), "x", heaviside_at_zero=1) is teg.bracket(x <= t)
    assert value(from_sympy(sympy.Integral(F(X - T) * G(X - T), (X, 0, 1))), t=0.5) == 0.5  # as SymPy has it
    assert value(from_sympy(sympy.Integral(F(X - T, 0) * G(X - T), (X, 0, 1))), t=0.5) == 0.0


def test_a_piecewise_without_a_default_is_nan_elsewhere() -> None:
    e = from_sympy(sympy.Piecewise((1, T < 0), (2, T > 1)))
    assert [value(e, t=v) for v in (-1.0, 2.0)] == [1.0, 2.0]
    with pytest.warns(AccuracyWarning, match="not a number"):
        assert math.isnan(value(e, t=0.5))
    steps = sympy.Integral(sympy.Piecewise((1, X < T), (2, (X >= T) & (X < A)), (3, X >= A)), (X, 0, 1))
    f = teg.compile(from_sympy(steps), [t, a])
    v, gradient = f.value_and_grad(t=0.25, a=0.5)
    assert (v, gradient["t"], gradient["a"]) == pytest.approx((2.25, -1.0, -1.0), abs=1e-14)


def test_tuples_and_matrices() -> None:
    assert from_sympy((T, 1)) is teg.tuple(t, 1)
    assert from_sympy([T, 1]) is teg.tuple(t, 1)
    assert from_sympy(sympy.Matrix([[T, 1], [A, B]])) is teg.tuple((t, 1), (a, b))
    assert from_sympy(sympy.ImmutableMatrix([[T, 1]])) is teg.tuple((t, 1))
    assert from_sympy(sympy.Tuple(T, (A, B))) is teg.tuple(t, (a, b))
    assert from_sympy(to_sympy(teg.tuple(t, (a, b)))) is teg.tuple(t, (a, b))


# -- what is a parameter, and what a variable ---------------------------------------------------------------------------


def test_bound_symbols_are_variables_and_others_parameters() -> None:
    s = sympy.Integral(sympy.sin(X * T), (X, 0, Y), (Y, 0, A))
    assert from_sympy(s) is teg.integral(teg.sin(t * x), (x, 0, y), (y, 0, a))
    assert from_sympy(X + T) is t + teg.param("x")
    for chosen in (["x"], "x", X, [X], x, [x]):
        assert from_sympy(X * T, chosen).free == {x}
    assert from_sympy(X * Y * T, "x, y").free == {x, y}
    with pytest.raises(errors.ParameterError):
        from_sympy(X, [1])


def test_a_symbol_bound_here_and_free_there() -> None:
    s = sympy.Integral(X**2, (X, 0, X)) * sympy.Integral(F(X - T), (T, 0, X)) + F(X) + X
    e = from_sympy(s)
    assert not e.free
    assert value(e, x=2.0) == pytest.approx(8 / 3 * 2 + 1 + 2, rel=1e-14)
    assert value(from_sympy(sympy.Integral(X**2, (X, 0, X)) + F(X)), x=0.0) == 0.5
    assert {n.name for n in postorder([e]) if isinstance(n, Param)} == {"x"}
    inner = from_sympy(sympy.Integral(X * sympy.Integral(X, (X, 0, X)), (X, 0, 1)))
    assert value(inner) == pytest.approx(1 / 8, rel=1e-14)
    kept = from_sympy(sympy.Integral(X * T, (X, 0, X)), [X])
    assert kept.free == {x}
    assert value(teg.integral(kept, (x, 0, 1)), t=6.0) == pytest.approx(1.0, rel=1e-14)


def test_shadowed_variables_there_and_back() -> None:
    for e in (
        teg.integral(x * teg.integral(x * x, (x, 0, x)), (x, 0, 1)),
        teg.integral(teg.integral(x, (x, 0, y)) + x, (x, 0, 1), (y, 0, 1)),
        teg.integral(teg.integral(teg.bracket(x < t), (x, 0, 1)), (x, 0, 2)),
        teg.integral(teg.integral(x * y, (y, 0, x), (x, 0, y)), (y, 0, 1)),
    ):
        back = from_sympy(to_sympy(e))
        assert back is e
        assert same(value(back, t=0.3), value(e, t=0.3))


def test_names_that_clash() -> None:
    clash = teg.integral(x * teg.param("x"), (x, 0, 1))
    with pytest.raises(errors.NameClashError):
        to_sympy(clash)
    s = to_sympy(clash, symbols={x: Y}, evaluate=True)
    assert s == sympy.Integral(X * Y, (Y, 0, 1))
    assert value(from_sympy(s), x=3.0) == 1.5
    with pytest.raises(errors.NameClashError):
        from_sympy(sympy.Symbol("x") + sympy.Symbol("x", real=True))
    with pytest.raises(errors.NameClashError):
        to_sympy(t + a, symbols={t: X, a: X})
    d1, d2 = sympy.Dummy("x"), sympy.Dummy("x")
    e = from_sympy(sympy.Integral(d1 * d2 + X, (d1, 0, 1), (d2, 0, 1)))
    assert sorted(n.var.name for n in postorder([e]) if isinstance(n, Integral)) == ["x′", "x′′"]
    assert value(e, x=1.0) == pytest.approx(1.25, rel=1e-14)


def test_symbols_of_ones_own() -> None:
    plain = sympy.Symbol("t")
    assert to_sympy(t + 1, symbols={t: plain}, evaluate=True) == plain + 1
    assert to_sympy(t + 1).free_symbols == {T}
    assert from_sympy(plain + 1) is from_sympy(T + 1)
    for wrong in ({"t": plain}, {t: 3}, {t + 1: plain}):
        with pytest.raises(errors.ParameterError):
            to_sympy(t + 1, symbols=wrong)


# -- refusals -----------------------------------------------------------------------------------------------------------

f = sympy.Function("f")
REFUSED: list[tuple[Any, type[errors.TegError], Any]] = [
    (1 + sympy.gamma(U), errors.OperandError, sympy.gamma(U)),
    (sympy.I * U, errors.OperandError, sympy.I),
    (U + sympy.zoo, errors.OperandError, sympy.zoo),
    (1 + f(U), errors.OperandError, f(U)),
    (1 + sympy.Derivative(f(U), U), errors.OperandError, sympy.Derivative(f(U), U)),
    (sympy.Sum(U, (U, 1, 3)), errors.OperandError, sympy.Sum(U, (U, 1, 3))),
    (2 * sympy.Indexed("A", 1), errors.OperandError, sympy.Indexed("A", 1)),
    (sympy.Lambda(U, U), errors.OperandError, sympy.Lambda(U, U)),
    (sympy.S.Reals, errors.OperandError, sympy.S.Reals),
    (sympy.Contains(U, sympy.Interval(0, 1)), errors.OperandError, sympy.Contains(U, sympy.Interval(0, 1))),
    (G(U, 1) + 1, errors.OperandError, G(U, 1)),
    (2 * sympy.Integral(U, U), errors.BoundError, sympy.Integral(U, U)),
    (sympy.Integral(U, (U, V)), errors.BoundError, sympy.Integral(U, (U, V))),
    (1 + sympy.Integral(sympy.exp(-(U**2)), (U, -sympy.oo, sympy.oo)), errors.BoundError, None),
    (sympy.exp(G(U)), errors.DeltaError, None),
    (sympy.And(sympy.Symbol("c"), U < 1), errors.ConditionError, None),
]


@pytest.mark.parametrize(("s", "error", "where"), REFUSED, ids=lambda v: str(v)[:60])
def test_what_the_language_does_not_have(s: Any, error: type[errors.TegError], where: Any) -> None:
    with pytest.raises(error) as caught:
        from_sympy(s)
    assert where is None or caught.value.where == where
    assert str(caught.value)


@pytest.mark.parametrize("s", ["x + 1", t, x < t, None, object(), {1, 2}], ids=lambda s: type(s).__name__)
def test_what_is_no_expression_of_sympy(s: Any) -> None:
    with pytest.raises(errors.OperandError):
        from_sympy(s)


def test_without_sympy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sympy", None)
    sympy_package.cache_clear()
    try:
        for use in (lambda: to_sympy(t), lambda: from_sympy(1)):
            with pytest.raises(errors.MissingPackageError) as caught:
                use()
            assert "teg-compiler[symbolic]" in caught.value.hint
        polar = {x: r * teg.cos(p), y: r * teg.sin(p)}
        assert "cos" in str(jacobian_determinant(polar, [r, p]))
    finally:
        sympy_package.cache_clear()


def test_functions_of_c() -> None:
    assert from_sympy(cfunctions.log1p(T)) is teg.log1p(t)
    assert from_sympy(cfunctions.expm1(T)) is teg.expm1(t)
    assert from_sympy(sympy.erf2(T, A)) is teg.erf(a) - teg.erf(t)
