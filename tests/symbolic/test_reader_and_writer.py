"""To SymPy and back, and derivatives by both: nothing is lost."""

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
from teg import symbolic
from teg.ir import expr as ex
from teg.ir.expr import Const, const
from teg.ir.node import postorder
from teg.ir.traverse import substitute
from teg.symbolic import from_sympy, to_sympy
from tests.end_to_end.strategies import Scene, scenes
from tests.references import REFERENCES, Reference
from tests.symbolic.in_sympy import FORMS, A, G, T, X, a, b, same, sympy, t, value, x, y

PROPERTY = settings(max_examples=25, deadline=None)


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
