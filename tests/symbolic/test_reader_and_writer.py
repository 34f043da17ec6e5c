"""SymPy: the forms of every node, there and back, exactness, scopes, refusals."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import teg
from teg import errors, symbolic
from teg.evaluator.accuracy import AccuracyWarning
from teg.ir import expr as ex
from teg.ir.expr import FUNCTIONS, Compare, Const, Param, const
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import call
from teg.ir.traverse import substitute
from teg.symbolic import from_sympy, jacobian_determinant, to_sympy
from teg.symbolic.nodes import sympy_package
from teg.symbolic.reader import builders
from tests.end_to_end.strategies import Scene, scenes
from tests.references import REFERENCES, Reference

sympy: Any = pytest.importorskip("sympy")
cfunctions: Any = pytest.importorskip("sympy.codegen.cfunctions")

x, y, r, p = teg.vars("x y r p")
t, a, b = teg.params("t a b")
X, Y, T, A, B = (sympy.Symbol(name, real=True) for name in ["x", "y", "t", "a", "b"])
F, G = sympy.Heaviside, sympy.DiracDelta
PROPERTY = settings(max_examples=25, deadline=None)


def value(e: Any, **values: float) -> Any:
    return teg.evaluate(e, values)


def same(found: float, wanted: float, tolerance: float = 1e-13) -> bool:
    return found == wanted or (found != found and wanted != wanted) or abs(found - wanted) <= tolerance * max(abs(wanted), 1e-3)


def distinct(s: Any) -> int:
    """How many objects a SymPy expression is made of."""
    seen: dict[int, Any] = {}
    stack = [s]
    while stack:
        node = stack.pop()
        if id(node) not in seen:
            seen[id(node)] = node
            stack.extend(node.args)
    return len(seen)


# -- to SymPy -----------------------------------------------------------------------------------------------------------

SAME_NAME = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "floor", "erf", "erfc")
FORMS: list[tuple[Any, Any]] = [
    (ex.ONE, sympy.Integer(1)),
    (const(0.1), sympy.Float(0.1)),
    (const(math.inf), sympy.oo),
    (const(-math.inf), -sympy.oo),
    (const(math.nan), sympy.nan),
    (t, T),
    (x, X),
    (x + 2 * t, X + 2 * T),
    (x - t, X - T),
    (x * t**3 / a, X * T**3 / A),
    (x**t, X**T),
    (teg.sqrt(1 + t), sympy.sqrt(1 + T)),
    (call("root", t), sympy.sqrt(sympy.Abs(T))),
    (call("magnitude", t), sympy.Abs(T)),
    (call("min", t, a), sympy.Min(T, A)),
    (call("max", t, a), sympy.Max(T, A)),
    *(
        (getattr(teg, f)(t), getattr(sympy, f)(T))
        for f in ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "floor", "erf", "erfc"]
    ),
    (call("erfinv", t), sympy.erfinv(T)),
    (call("erfcinv", t), sympy.erfcinv(T)),
    (teg.log1p(t), sympy.log(1 + T)),
    (teg.expm1(t), sympy.exp(T) - 1),
    (call("ceil", t), sympy.ceiling(T)),
    (teg.atan2(t, a), sympy.atan2(T, A)),
    (teg.mod(t, a), sympy.Mod(T, A)),
    (teg.abs(t), sympy.Abs(T)),
    (teg.sign(t - a), sympy.sign(T - A)),
    (teg.minimum(t, a), sympy.Min(T, A)),
    (teg.maximum(t, a), sympy.Max(T, A)),
    (teg.bracket(x < t), F(T - X, 0)),
    (teg.bracket(x <= t), F(T - X, 1)),
    (teg.bracket(~(x < t)), F(X - T, 1)),
    (teg.bracket((x < t) & (x > a)) * x, X * F(T - X, 0) * F(X - A, 0)),
    (teg.bracket(x > 0) * teg.log(x), sympy.Piecewise((sympy.log(X), X > 0), (0, True))),
    (teg.bracket((x < t) | (x < a)), sympy.Piecewise((1, (X < T) | (X < A)), (0, True))),
    (teg.where(x < t, a, b), sympy.Piecewise((A, X < T), (B, True))),
    (teg.where(~((x < t) & (x < a)), a, b), sympy.Piecewise((B, (X < T) & (X < A)), (A, True))),
    (teg.integral(teg.bracket(x < t), (x, 0, a)), sympy.Integral(F(T - X, 0), (X, 0, A))),
    (teg.integral(x * y, (x, 0, y), (y, 0, 1)), sympy.Integral(X * Y, (X, 0, Y), (Y, 0, 1))),
    (teg.integral(teg.delta(x - t), (x, 0, 1)), sympy.Integral(G(X - T), (X, 0, 1))),
    (teg.tuple(t, a), sympy.Tuple(T, A)),
    (x < t, X < T),
    (x <= t, X <= T),
    ((x < t) & ~(x <= a), (X < T) & (X > A)),
    ((x < t) | (x < a), (X < T) | (X < A)),
    (ex.TRUE, sympy.true),
    (ex.FALSE, sympy.false),
]


@pytest.mark.parametrize(("e", "form"), FORMS, ids=lambda v: str(v)[:60])
def test_forms(e: Any, form: Any) -> None:
    assert to_sympy(e, evaluate=True) == form
    written = to_sympy(e)
    assert type(written) is type(form) or isinstance(written, sympy.Not | sympy.Mul | sympy.Add)
    if isinstance(form, sympy.Expr) and not form.has(sympy.Integral):  # what was not evaluated means the same
        point = {X: sympy.Rational(3, 10), T: sympy.Rational(2, 5), A: sympy.Rational(1, 7), B: 5}
        assert sympy.simplify(written.xreplace(point) - form.xreplace(point)) == 0 or form in (sympy.oo, -sympy.oo, sympy.nan)


def test_the_forms_are_all_nodes_and_functions_of_the_language() -> None:
    nodes = [n for e, _ in FORMS for n in postorder([e])]
    unknown = {
        "PointMasses",
        "ClosedForm",
        "Arcs",
        "Border",
        "UncountedFloor",
    }  # what the compiler leaves of a δ, after elimination and when it schedules
    unknown |= {"Apply"}  # written out
    unknown |= {"Sum", "Product", "AnyOf", "Nearest", "Winner", "Gather", "Unit", "IndexValue"}  # refused
    unknown |= {
        "Partition",
        "Pullback",
        "SeenSum",
        "Slope",
        "Table",
        "RowSum",
        "TableEntry",
        "TableUnit",
        "Collected",
    }  # made by the compiler
    unknown |= {"Still", "StillGather"}  # refused, too
    unknown |= {"HalfAngle"}  # an atan2, which a pass makes
    leaves: set[type[Node]] = set()
    stack: list[type[Node]] = [teg.Expr, teg.Cond]
    while stack:
        kind = stack.pop()
        stack += kind.__subclasses__()
        leaves |= {kind} if not kind.__subclasses__() else set()
    assert {c.__name__ for c in leaves} - {type(n).__name__ for n in nodes} <= unknown
    assert set(FUNCTIONS) - {n.data for n in nodes if isinstance(n, ex.Call)} <= {"round"}  # which has a test of its own


def test_what_does_not_move_is_refused() -> None:
    with pytest.raises(errors.OperandError, match="stands still"):
        to_sympy(teg.integral(teg.stop_delta(teg.bracket(x < t)), (x, 0, 1)))


def test_a_bracket_knows_its_border() -> None:
    for condition, at in ((t < a, 0), (t <= a, 1), (~(t < a), 1), (~(t <= a), 0), ((t <= a) & (a <= t), 1), ((t < a) | (a <= t), 1)):
        for how in symbolic.CONDITIONS:
            for evaluate in (False, True):
                s = to_sympy(teg.bracket(condition), conditions=how, evaluate=evaluate)
                assert s.xreplace({T: sympy.Integer(2), A: sympy.Integer(2)}).doit() == at
                assert value(from_sympy(s), t=2, a=2) == at


def test_conditions_as_asked() -> None:
    e = teg.where(x < t, a, b) + teg.bracket(x < a) * x + teg.bracket((x < a) | (x < b))
    assert not to_sympy(e, conditions="heaviside").has(sympy.Piecewise)
    assert not to_sympy(e, conditions="piecewise").has(F)
    point = {X: sympy.Rational(1, 2), T: 1, A: sympy.Rational(1, 4), B: 3}
    forms = [to_sympy(e, conditions=how).xreplace(point) for how in symbolic.CONDITIONS]
    assert [sympy.simplify(f) for f in forms] == [sympy.Rational(5, 4)] * 3
    with pytest.raises(errors.OptionError):
        to_sympy(e, conditions="sometimes")


def test_a_branch_that_is_not_finite_stays_a_branch() -> None:
    for f in (teg.log(x), 1 / x, teg.sqrt(x), x**t, teg.tan(x), teg.asin(x), teg.mod(x, t), teg.atan2(x, t), const(math.inf) * x):
        assert isinstance(to_sympy(teg.bracket(x > a) * f), sympy.Piecewise)
    for f in (teg.exp(x) / 3, teg.atan(x) ** 2, teg.mod(x, 2), teg.where(x < a, x, 1), call("round", x)):
        assert isinstance(to_sympy(teg.bracket(x > a) * f), sympy.Mul)
    product = to_sympy(teg.bracket((x > a) & ~(x < b)) * -(x - t) * (x - a))  # the minus of a product is no ~
    assert from_sympy(product, "x") is teg.bracket((x > a) & ~(x < b)) * -(x - t) * (x - a)
    assert value(from_sympy(F(-(X - T) * A, 1)), x=1.0, t=2.0, a=3.0) == 1.0


def test_round_goes_to_the_even_side() -> None:
    s = to_sympy(call("round", t))
    back = from_sympy(s)
    for i in range(-12, 13):
        assert s.xreplace({T: sympy.Rational(i, 4)}) == round(i / 4)
        assert value(back, t=i / 4) == round(i / 4)


def test_numbers_that_are_no_numbers_of_the_language() -> None:
    assert to_sympy(3) == 3
    assert to_sympy(np.float64(0.1)) == sympy.Float(0.1)
    with pytest.raises(errors.OperandError):
        to_sympy("x")


def test_what_the_compiler_alone_writes() -> None:
    tie = Compare.make((True, ("g", "h")), (x - t, t > a))
    assert to_sympy(tie, evaluate=True) == (T < X)
    eliminated = teg.eliminate(teg.grad(teg.integral(teg.bracket(x + y * a < t) * teg.bracket(x < b), (x, 0, 1), (y, 0, 1)), [t, a]))
    found = value(from_sympy(to_sympy(eliminated)), t=0.7, a=0.5, b=0.4)
    np.testing.assert_allclose(found, value(eliminated, t=0.7, a=0.5, b=0.4), rtol=1e-12)


# -- exact numbers ------------------------------------------------------------------------------------------------------


@given(st.floats())
@settings(deadline=None)
def test_no_bit_of_a_number_is_lost(v: float) -> None:
    e = const(v)
    s = to_sympy(e)
    back = from_sympy(s)
    assert isinstance(back, Const)
    assert back.data == v or (v != v and back.data != back.data)
    if math.isfinite(v):
        assert sympy.Rational(*v.as_integer_ratio()) == sympy.Rational(s)
        assert s.is_Integer == v.is_integer()


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


def test_sympy_is_imported_when_it_is_needed() -> None:
    program = "import sys, teg; before = 'sympy' in sys.modules; teg.to_sympy(1); print(before, 'sympy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split() == ["False", "True"]


# -- there and back -----------------------------------------------------------------------------------------------------

WRITTEN: list[Any] = [
    t - t,
    0 * t + a,
    t**0,
    teg.where(t < a, b, b),
    teg.integral(0 * t, (x, 0, 1)),
    teg.integral(x, (x, t, t)),
    (1 / t) * t,
    2 * (t + a) * (t + a),
    -(t + 1e-300),
    teg.bracket(x < t) * teg.bracket(x < a) * teg.log(x),
    teg.where((x < t) & (x < a) | ~(x < b), teg.where(x < a, 1, t), teg.sqrt(x)),
    teg.integral(teg.bracket(teg.integral(teg.bracket(y < t) * y, (y, 0, 1)) < x), (x, 0, 1)),
    teg.exp(teg.integral(teg.maximum(x, t, a), (x, t, -a))),
]


def test_functions_of_c() -> None:
    assert from_sympy(cfunctions.log1p(T)) is teg.log1p(t)
    assert from_sympy(cfunctions.expm1(T)) is teg.expm1(t)
    assert from_sympy(sympy.erf2(T, A)) is teg.erf(a) - teg.erf(t)


@pytest.mark.parametrize("e", [*WRITTEN, *(e for e, _ in FORMS if not isinstance(e, ex.Truth))], ids=lambda v: str(v)[:60])
def test_the_same_expression_comes_back(e: Any) -> None:
    back = from_sympy(to_sympy(e), [v for v in (x, y) if v in e.free])
    if any(isinstance(n, ex.Call) and n.name in ("root", "magnitude", "min", "max", "log1p", "expm1") for n in postorder([e])):
        return  # they come back as square roots, |u|, minimum and maximum, log(1 + u), exp(u) - 1
    assert back is e or (isinstance(back, Const) and math.isnan(back.data))


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda reference: reference.id)
def test_references_there_and_back(reference: Reference) -> None:
    e = reference.build()
    back = from_sympy(to_sympy(e))
    evaluated = from_sympy(to_sympy(e, evaluate=True, conditions="piecewise"))
    for found in (back, evaluated):
        v = float(teg.evaluate(found, reference.params))
        assert same(v, float(reference.value), reference.tolerance)


@given(scenes(1) | scenes(2))
@PROPERTY
def test_random_programs_there_and_back(scene: Scene) -> None:
    e = scene.expression
    s = to_sympy(e)
    wanted = value(e, **scene.values)
    assert same(value(from_sympy(s), **scene.values), wanted)
    assert same(value(from_sympy(to_sympy(e, evaluate=True)), **scene.values), wanted, 1e-11)
    for how in ("heaviside", "piecewise"):
        assert same(value(from_sympy(to_sympy(e, conditions=how)), **scene.values), wanted, 1e-11)


@given(scenes(2), st.integers(-4, 4), st.integers(-4, 4), st.data())
@PROPERTY
def test_sympy_computes_the_same_values(scene: Scene, i: int, j: int, data: st.DataObject) -> None:
    """Of the integrand at a point, on borders as well: parameters are small integers, so many are met."""
    values = {k: float(data.draw(st.integers(-2, 2))) for k in scene.values}
    here = {x: teg.param("x"), y: teg.param("y")}
    e = substitute(scene.integrand, here)
    how = data.draw(st.sampled_from(symbolic.CONDITIONS))
    s = to_sympy(e, conditions=how, evaluate=data.draw(st.booleans()))
    point = {**values, "x": i / 2, "y": j / 2}
    found = s.xreplace({symbol: sympy.Rational(point[symbol.name]) for symbol in s.free_symbols}).doit().evalf(20)
    assert same(float(found), value(e, **point), 1e-12)


def test_sympy_can_use_what_it_gets() -> None:
    s = to_sympy(teg.integral(teg.bracket(x < t) * (x + a), (x, 0, 1)), conditions="piecewise")
    half = s.subs({T: sympy.Rational(1, 2), A: 0})
    assert half.doit() == sympy.Rational(1, 8)
    g = sympy.lambdify([T, A], to_sympy(teg.sin(t) * a + teg.maximum(t, a) ** 2), "numpy")
    np.testing.assert_allclose(g(0.5, 2.0), math.sin(0.5) * 2 + 4, rtol=1e-15)
    assert sympy.latex(s)
    assert sympy.simplify(to_sympy(teg.sin(t) ** 2 + teg.cos(t) ** 2)) == 1


# -- derivatives --------------------------------------------------------------------------------------------------------


def test_a_delta_is_seen() -> None:
    d = teg.diff(teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), t)
    s = to_sympy(d, evaluate=True)
    assert s == sympy.Integral(sympy.exp(A * X) * G(T - X), (X, 0, 1))
    assert value(from_sympy(s), t=0.4, a=2.0) == pytest.approx(math.exp(0.8), rel=1e-14)


@pytest.mark.parametrize(
    "e",
    [
        teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)),
        teg.integral(teg.bracket((x < t) & (x * x > a)) * teg.cos(x + t) ** 2, (x, 0, t * t + 1)),
        teg.integral(teg.where(x < t, x, a * t), (x, 0, 1)),
        teg.integral(teg.bracket(x + y < t) * teg.bracket(x - y <= a) * x, (x, 0, 1), (y, 0, 1)),
        teg.integral(teg.bracket((x < t) | (x > a)) * teg.sin(x * t), (x, 0, 1)),
        teg.integral(teg.abs(x - t) * teg.maximum(x, a), (x, 0, 1)),
    ],
    ids=str,
)
def test_sympy_differentiates_to_the_same(e: Any) -> None:
    """Of Heavisides SymPy's derivative holds the deltas; the compiler eliminates them."""
    values = {"t": 0.55, "a": 0.2}
    s = to_sympy(e, conditions="heaviside")
    for parameter, symbol in ((t, T), (a, A)):
        theirs = from_sympy(sympy.diff(s, symbol))
        assert value(theirs, **values) == pytest.approx(value(teg.diff(e, parameter), **values), rel=1e-10)
