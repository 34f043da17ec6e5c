"""To SymPy: the forms of every node, conditions as asked, exact numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import teg
from teg import errors, symbolic
from teg.ir import expr as ex
from teg.ir.expr import FUNCTIONS, Compare, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import call
from teg.symbolic import from_sympy, to_sympy
from tests.symbolic.in_sympy import FORMS, A, B, F, T, X, a, b, sympy, t, value, x, y


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
        "Uncovered",
        "Gaps",
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
    assert set(FUNCTIONS) - {n.data for n in nodes if isinstance(n, ex.Call)} <= {
        "round",
        "chosen",
        "exact",
    }  # which have tests of their own


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
