"""Preimages: f(u) = c as conditions u = uᵢ, every branch of f⁻¹ inside the bounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.ir.expr import MINUS_ONE, ONE, TRUE, Call, Cond, Const, Expr, Pow, Var, const
from teg.ir.simplify import add, call, conjunction, disjunction, div, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import substitute

MAX_PERIODIC = 16
"""The number of roots of a periodic function for which code is made if the bounds are not known as numbers."""
MAX_NUMERIC = 64
"""The same if the bounds are known as numbers."""


def is_not_zero(e: Expr) -> Cond:
    """Returns the condition that an expression is not 0. A number counts as not 0: callers do not ask for 0."""
    return TRUE if isinstance(e, Const) else disjunction(positive(e), positive(mul(MINUS_ONE, e)))


def preimages(f: Call | Pow, c: Expr, x: Var, lo: Expr, hi: Expr) -> tuple[list[tuple[Expr, Cond]], bool] | None:
    """Returns surfaces u - uᵢ whose roots are those of f(u) = c, each with the condition under which uᵢ is a solution, and whether these
    are all."""
    u = cast(Expr, f.children[0])
    if isinstance(f, Pow):
        return [(sub(u, v), exists) for v, exists in _of_power(f.exponent, c)], True
    if f.name == "pow":
        k = f.children[1]
        if x in k.free:
            return None
        broken = isinstance(k, Const) and math.isfinite(k.data) and not float(k.data).is_integer()  # of no base below 0
        certain = broken or (isinstance(u, Var) and all(isinstance(b, Const) and b.data >= 0.0 for b in (lo, hi)))
        above = sub(u, call("pow", c, integer_power(k, -1))), conjunction(positive(c, strict=False), is_not_zero(k))
        return [above] if certain or k.free else [above, _below(u, k, c)], certain or not k.free
    if f.name == "atan2":  # the half-line at the angle c, of which there is one for c between -π and π
        b, a, s, k = u, f.children[1], call("sin", c), call("cos", c)
        exists = conjunction(_within(c, -math.pi, math.pi), positive(add(mul(a, k), mul(b, s))))
        return [(sub(mul(b, k), mul(a, s)), exists)], True
    if f.name in ("sin", "cos", "tan"):
        return _periodic(f.name, u, c, x, lo, hi)
    inverse = _INVERSES.get(f.name)
    if inverse is None:
        return None
    return [(sub(u, v), exists) for v, exists in inverse(c)], True


def _below(u: Expr, k: Expr, c: Expr) -> tuple[Expr, Cond]:
    """Returns u - v for the solution v < 0 of vᵏ = c, which an integer k has: an even one for c >= 0, an odd one for c <= 0."""
    parity = sub(k, mul(const(2), call("floor", mul(const(0.5), k))))
    even, odd = negation(positive(parity)), conjunction(positive(sub(parity, ONE), strict=False), negation(positive(sub(parity, ONE))))
    sign = disjunction(conjunction(even, positive(c, strict=False)), conjunction(odd, positive(mul(MINUS_ONE, c), strict=False)))
    return add(u, call("pow", call("magnitude", c), integer_power(k, -1))), conjunction(sign, is_not_zero(k))


def _of_power(k: int, c: Expr) -> list[tuple[Expr, Cond]]:
    if k < 0:
        c, k = integer_power(c, -1), -k
    if k == 1:
        return [(c, TRUE)]
    size_of_root = call("pow", call("magnitude", c), const(1.0 / k))
    if k % 2:
        return [(where(positive(c), size_of_root, mul(MINUS_ONE, size_of_root)), TRUE)]
    exists = positive(c, strict=False)
    return [(size_of_root, exists), (mul(MINUS_ONE, size_of_root), exists)]


def _within(c: Expr, least: float, most: float) -> Cond:
    return conjunction(positive(sub(c, const(least)), False), positive(sub(const(most), c), False))


def _between(c: Expr, least: float, most: float) -> Cond:
    return conjunction(positive(sub(c, const(least))), positive(sub(const(most), c)))


def _log_of(c: Expr) -> list[tuple[Expr, Cond]]:
    return [(call("log", c), positive(c))]


def _asinh(c: Expr) -> Expr:
    grown = call("log", add(call("magnitude", c), call("sqrt", add(integer_power(c, 2), ONE))))
    return where(positive(c), grown, mul(MINUS_ONE, grown))


def _acosh(c: Expr) -> list[tuple[Expr, Cond]]:
    grown = call("log", add(c, call("root", sub(integer_power(c, 2), ONE))))
    exists = positive(sub(c, ONE), False)
    return [(grown, exists), (mul(MINUS_ONE, grown), exists)]


_INVERSES: dict[str, Callable[[Expr], list[tuple[Expr, Cond]]]] = {
    "exp": _log_of,
    "expm1": lambda c: _log_of(add(ONE, c)),
    "log": lambda c: [(call("exp", c), TRUE)],
    "log1p": lambda c: [(call("expm1", c), TRUE)],
    "sqrt": lambda c: [(integer_power(c, 2), positive(c, False))],
    "root": lambda c: [(integer_power(c, 2), positive(c, False))],
    "asin": lambda c: [(call("sin", c), _within(c, -math.pi / 2, math.pi / 2))],
    "acos": lambda c: [(call("cos", c), _within(c, 0.0, math.pi))],
    "atan": lambda c: [(call("tan", c), _within(c, -math.pi / 2, math.pi / 2))],
    "erf": lambda c: [(call("erfinv", c), _between(c, -1.0, 1.0))],
    "erfc": lambda c: [(call("erfcinv", c), _between(c, 0.0, 2.0))],
    "sinh": lambda c: [(_asinh(c), TRUE)],
    "cosh": _acosh,
    "tanh": lambda c: [(mul(const(0.5), call("log", div(add(ONE, c), sub(ONE, c)))), _within(c, -1.0, 1.0))],
    "magnitude": lambda c: [(c, positive(c, False)), (mul(MINUS_ONE, c), positive(c, False))],
}


def _periodic(name: str, u: Expr, c: Expr, x: Var, lo: Expr, hi: Expr) -> tuple[list[tuple[Expr, Cond]], bool] | None:
    """Returns the preimages of c under a periodic function, for each m in reach of u.

    sin u = c: u = mπ + (-1)^m·asin c; cos u = c: u = ½π + that of sin with -c…; tan u = c: u = mπ + atan c.
    """
    if Shadow((x,)).degree(u) != 1:
        return None
    if name == "cos":  # cos u = sin(u + ½π)
        u, name = add(u, const(math.pi / 2)), "sin"
    if any(isinstance(b, Const) and math.isinf(b.data) for b in (lo, hi)):
        return None  # infinitely many
    ends = [cast(Expr, substitute(u, {x: b})) for b in (lo, hi)]
    exists = _within(c, -1.0, 1.0) if name == "sin" else TRUE
    base = call("asin" if name == "sin" else "atan", c)
    if all(isinstance(e, Const) for e in ends):
        least, most = sorted(cast(Const, e).data / math.pi for e in ends)
        count = math.floor(most + 0.5) - math.floor(least - 0.5) + 1
        first: Expr = const(float(math.floor(least - 0.5)))
        certain = count <= MAX_NUMERIC
        count = min(count, MAX_NUMERIC)
    else:
        least_end = where(positive(sub(ends[1], ends[0])), ends[0], ends[1])
        first, rate, width = call("floor", sub(div(least_end, const(math.pi)), const(0.5))), slope(u, x), sub(hi, lo)
        count, certain = MAX_PERIODIC, False
        if isinstance(rate, Const) and isinstance(width, Const):  # the range of u has a known length, if not a known place
            all_of_them = math.ceil(abs(rate.data * width.data) / math.pi) + 3
            certain = all_of_them <= MAX_PERIODIC
            count = min(all_of_them, MAX_PERIODIC)
    pairs: list[tuple[Expr, Cond]] = []
    for j in range(count):
        m = add(first, const(float(j)))
        if name == "tan":
            angle = base
        elif isinstance(m, Const):
            angle = base if m.data % 2 == 0 else mul(MINUS_ONE, base)
        else:
            even = sub(m, mul(const(2), call("floor", mul(const(0.5), m))))  # 0 or 1
            angle = mul(sub(ONE, mul(const(2), even)), base)
        pairs.append((sub(u, add(mul(m, const(math.pi)), angle)), exists))
    return pairs, certain
