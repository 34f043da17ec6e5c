"""Programs to SymPy and back: what is shared stays shared, deep expressions, and short messages about long ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import teg
from teg import errors
from teg.symbolic import from_sympy, to_sympy
from teg.symbolic.nodes import as_it_is

sympy: Any = pytest.importorskip("sympy")

x = teg.var("x")
t, a, b = teg.params("t a b")


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


def squares(n: int) -> teg.Expr:
    e: teg.Expr = t
    for _ in range(n):
        e = e * e + 1
    return e


def pieces(n: int) -> teg.Expr:
    e: teg.Expr = t
    for _ in range(n):
        e = teg.where(e * t < a, teg.sin(e), e + 1)
    return e


def steps(n: int) -> teg.Expr:
    e: teg.Expr = t
    for _ in range(n):
        e = teg.bracket((e > a) & ~(e < b)) * teg.sin(e) + e
    return e


def nests(n: int) -> teg.Expr:
    e: teg.Expr = t
    for i in range(n):
        v = teg.var(f"v{i}")
        e = teg.integral(e * v, (v, 0, t))
    return e


def bounds(n: int) -> teg.Expr:
    e: teg.Expr = t
    for _ in range(n):
        e = teg.integral(x * e, (x, e, e + 1))
    return e


@pytest.mark.parametrize("chain", [squares, pieces, steps, nests, bounds], ids=lambda chain: chain.__name__)
def test_what_is_shared_stays_shared(chain: Callable[[int], teg.Expr]) -> None:
    counts = [distinct(to_sympy(chain(n))) / teg.size(chain(n)) for n in (50, 100, 200)]
    assert counts[2] < 1.05 * counts[0] < 6
    back = from_sympy(to_sympy(chain(200)))
    assert teg.size(back) <= 1.5 * teg.size(chain(200))
    assert chain is steps or back is chain(200)


def test_two_thousand_squares() -> None:
    e = squares(2000)
    assert from_sympy(to_sympy(e)) is e
    assert to_sympy(e) is not to_sympy(e)  # comparing them would take SymPy 2²⁰⁰⁰ steps: its caches must not be asked
    with pytest.raises(errors.OptionError):
        to_sympy(e, evaluate=True)


@pytest.mark.slow
def test_depth() -> None:
    e: teg.Expr = t
    for _ in range(30_000):
        e = teg.sin(e) * a
    assert from_sympy(to_sympy(e)) is e
    c = t < a
    for i in range(3000):
        c = ~(c & (t < i)) | (a < i)
    assert from_sympy(to_sympy(c)) is c
    deep = teg.where(c, t, 0)
    assert from_sympy(to_sympy(deep)) is deep
    assert teg.size(from_sympy(to_sympy(deep, conditions="heaviside"))) < 10 * teg.size(deep)


def test_too_deep_for_sympy_is_said() -> None:
    e: teg.Expr = t
    for _ in range(1500):
        e = teg.sin(e)
    with pytest.raises(errors.OptionError):
        to_sympy(e, evaluate=True)


def test_an_error_in_something_long_is_short() -> None:
    s = to_sympy(squares(300))
    with pytest.raises(errors.OperandError) as caught:
        from_sympy(as_it_is(sympy.gamma, s))
    assert len(str(caught.value)) < 500
