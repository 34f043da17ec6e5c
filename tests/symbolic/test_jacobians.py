"""Jacobian determinants that SymPy simplifies."""

from __future__ import annotations

import math
from typing import Any

import pytest

import teg
from teg import errors
from teg.ir import expr as ex
from teg.ir.expr import Var, const
from teg.ir.integral import Delta
from teg.ir.traverse import substitute
from teg.symbolic import jacobian_determinant, to_sympy

sympy: Any = pytest.importorskip("sympy")

x, y, z, r, p, q = teg.vars("x y z r p q")
t, a, b = teg.params("t a b")


def value(e: Any, **values: float) -> Any:
    return teg.evaluate(e, values)


def jacobian_values(forward: dict[Var, teg.Expr], by: list[Var], values: dict[str, float]) -> tuple[float, float]:
    """The determinant found, and that of SymPy's derivatives in numbers."""
    found = substitute(jacobian_determinant(forward, by), {v: teg.param(v.name) for v in by})
    symbols = [sympy.Symbol(v.name, real=True) for v in by]
    matrix = sympy.Matrix([to_sympy(e) for e in forward.values()]).jacobian(symbols)
    point = {sympy.Symbol(k, real=True): sympy.Rational(v) for k, v in values.items()}
    return value(found, **values), float(matrix.xreplace(point).det().evalf(20))


def test_jacobians_are_simplified() -> None:
    polar = {x: a + r * teg.cos(p), y: b + r * teg.sin(p)}
    assert jacobian_determinant(polar, [r, p]) is r
    assert value(substitute(jacobian_determinant(polar, [p, r]), {r: t}), t=2.0) == -2.0
    spherical = {x: r * teg.sin(q) * teg.cos(p), y: r * teg.sin(q) * teg.sin(p), z: r * teg.cos(q)}
    assert jacobian_determinant(spherical, [r, q, p]) is r**2 * teg.sin(q)
    turned = {x: r * teg.cos(a) - p * teg.sin(a), y: r * teg.sin(a) + p * teg.cos(a)}
    assert jacobian_determinant(turned, [r, p]) is ex.ONE
    assert jacobian_determinant({x: 2 * r + t}, [r]) is const(2.0)
    assert jacobian_determinant({x: r, y: r}, [r, p]) is ex.ZERO
    assert jacobian_determinant({x: r + t, y: 2 * r + 2 * p, z: p}, [r, p, q]) is ex.ZERO


@pytest.mark.parametrize(
    ("forward", "by"),
    [
        ({r: teg.sqrt(x * x + y * y), p: teg.atan2(y, x)}, [x, y]),
        ({x: a * teg.cosh(r) * teg.cos(p), y: a * teg.sinh(r) * teg.sin(p)}, [r, p]),
        ({x: 0.1 * r * teg.exp(p) + t, y: 0.3 * p**3 - r / 3}, [r, p]),
        ({x: r * r * (3 - 2 * r)}, [r]),
        ({x: teg.where(r < p, r * p, r + p), y: teg.abs(p) * r}, [r, p]),
        ({x: r * teg.exp(-a * r * r) * teg.cos(p) + b * p, y: teg.tan(r) * teg.sin(p) * teg.sqrt(1 + p * p)}, [r, p]),
        ({x: r * p * q, y: r * p * (1 - q), z: r * (1 - p)}, [r, p, q]),
    ],
    ids=str,
)
def test_jacobians_have_the_right_value(forward: dict[Var, teg.Expr], by: list[Var]) -> None:
    values = {"x": 0.5, "y": -0.75, "r": 0.625, "p": 1.25, "q": -0.375, "a": 0.5, "b": 2.0, "t": 1.0}
    found, wanted = jacobian_values(forward, by, values)
    assert found == pytest.approx(wanted, rel=1e-12)


def test_a_jacobian_that_is_long_is_as_the_compiler_expands_it() -> None:
    e: teg.Expr = r
    for _ in range(300):
        e = e * e + p
    d = jacobian_determinant({x: e, y: p}, [r, p])
    assert teg.size(d) < 4 * 300 + 100
    four = {teg.var(f"y{i}"): sum((teg.sin(a * i + j) * v for j, v in enumerate((x, y, z, r))), x * y * z * r) for i in range(4)}
    assert jacobian_determinant(four, [x, y, z, r]).free <= {x, y, z, r}
    held = jacobian_determinant({x: r * teg.integral(teg.exp(y * t), (y, 0, 1)), y: p}, [r, p])
    assert value(held, t=1.0) == pytest.approx(math.e - 1, rel=1e-13)


def test_jacobians_that_are_none() -> None:
    with pytest.raises(errors.ParameterError):
        jacobian_determinant({x: r}, [r, p])
    with pytest.raises(errors.ParameterError):
        jacobian_determinant({}, [])
    with pytest.raises(errors.NotDifferentiableError):
        jacobian_determinant({x: teg.floor(r)}, [r])
    assert isinstance(teg.delta(x), Delta)
