"""Simplification by identities, for expressions after a change of variables.

    sin²u + cos²u = 1      cosh²u - sinh²u = 1      √(v²) = v, or -v, where the sign of v is known
    √(x² + y²)·cos atan2(y, x) = x      √(x² + y²)·sin atan2(y, x) = y      tan atan u = sin asin u = cos acos u = log exp u = u
    exp u·exp v = exp(u + v), where that is simpler

A sum is rewritten only if it becomes shorter, or loses a variable: x² + y² is r² in polar coordinates. Linear in the number of nodes; of
each sum the nearest few hundred nodes are examined.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import cast

from teg.analysis.expanded import expanded
from teg.analysis.intervals import Interval, enclose
from teg.errors import NotDifferentiableError
from teg.ir import expr as ex
from teg.ir.expr import MINUS_ONE, ONE, Add, Call, Const, Expr, Mul, Pow, Var
from teg.ir.node import Node
from teg.ir.simplify import add, call, integer_power, mul, sub
from teg.ir.traverse import parameters, rewrite

_REGION = 200
"""The largest number of nodes of a sum, down to its functions, that is rewritten."""
_POSITIVE = frozenset(("exp", "cosh", "sqrt", "root", "magnitude"))
_WAVES = (("sin", "cos", -1.0), ("sinh", "cosh", 1.0))


def simplified(e: Expr, box: Mapping[Var, Interval] | None = None, known: Mapping[Node, Expr] | None = None) -> Expr:
    """Returns a simpler form of e, equal to it for variables in `box` (numbers and ±∞); the nodes of `known` are replaced."""
    signs = _Signs(box or {})
    names = known or {}

    def visit(old: Node, new: Node) -> Node:
        if old in names:
            return names[old]
        if isinstance(new, Add):
            return _shortened(new)
        if isinstance(new, Mul):
            return _cartesian(_joined(new))
        return _function(new, signs) if isinstance(new, Call) else new

    return cast(Expr, rewrite([e], visit)[e])


class _Signs:
    """The signs of expressions over a box of numbers."""

    def __init__(self, box: Mapping[Var, Interval]) -> None:
        self.box = box

    def of(self, e: Expr) -> int:
        """Returns 1 if e >= 0, -1 if e <= 0 on the whole box, 0 if neither is known."""
        if isinstance(e, Mul):
            return math.prod(self._of_factor(c) for c in e.children)
        return self._of_factor(e)

    def _of_factor(self, e: Expr) -> int:
        if (isinstance(e, Pow) and e.exponent % 2 == 0) or (isinstance(e, Call) and e.name in _POSITIVE):
            return 1
        if not e.free <= self.box.keys() or parameters(e):
            return 0
        try:
            lo, hi = enclose(e, self.box)
        except NotDifferentiableError:
            return 0
        if isinstance(lo, Const) and lo.data >= 0.0:
            return 1
        return -1 if isinstance(hi, Const) and hi.data <= 0.0 else 0


def sign_of(e: Expr, box: Mapping[Var, Interval]) -> int:
    """Returns 1 if e cannot be negative on a box of numbers, -1 if it cannot be positive, 0 if neither is known."""
    return _Signs(box).of(e)


def taken_out(e: Expr, box: Mapping[Var, Interval]) -> tuple[Expr, Expr]:
    """Returns a factor of e that is positive on the box, and the other factor.

    The first is the common factor of all terms of a sum, as far as its sign is known.
    """
    if not isinstance(e, Add):
        return ONE, e
    powers = [_powers(t) for t in e.children]
    signs = _Signs(box)
    factor: Expr = ONE
    for f in powers[0]:
        k = min(p.get(f, 0) for p in powers)
        sign = signs.of(f) if k > 0 else 0
        if sign:
            factor = mul(factor, integer_power(mul(_number(sign), f), k))
    return (factor, add(*(mul(t, integer_power(factor, -1)) for t in e.children))) if factor is not ONE else (ONE, e)


def _powers(term: Expr) -> dict[Expr, int]:
    parts = term.children if isinstance(term, Mul) else (term,)
    return {(p.base if isinstance(p, Pow) else p): p.exponent if isinstance(p, Pow) else 1 for p in parts}


# -- sums ----------------------------------------------------------------------------------------------------------------


def _shortened(e: Add) -> Expr:
    """Returns the sum with the squares of cosines, or of sines, replaced, if that makes it simpler."""
    best: Expr = e
    for sine, cosine, sign in _pairs(e):
        normal = expanded(best)
        if normal is None:
            return best
        one = ONE if sign > 0 else MINUS_ONE
        instead_of_cosines = add(ONE, mul(one, integer_power(sine, 2)))  # cos² = 1 - sin², cosh² = 1 + sinh²
        instead_of_sines = add(mul(MINUS_ONE, one), mul(one, integer_power(cosine, 2)))
        for square, other in ((cosine, instead_of_cosines), (sine, instead_of_sines)):
            replaced = _without_squares(normal, square, other)
            shorter = expanded(replaced) if replaced is not normal else None
            if shorter is not None and _is_simpler(shorter, best):
                best = normal = shorter
    return best


def _number(sign: float) -> Expr:
    return ONE if sign > 0 else MINUS_ONE


def _is_simpler(a: Expr, b: Expr) -> bool:
    return a.free < b.free or (a.free <= b.free and _length(a) < _length(b))


def _length(e: Expr) -> int:
    """Returns the number of nodes of sums, products and powers, down to functions and other generators."""
    seen: set[Expr] = set()
    stack = [e]
    while stack:
        node = stack.pop()
        if node not in seen:
            seen.add(node)
            stack.extend(cast("tuple[Expr, ...]", node.children) if isinstance(node, Add | Mul | Pow) else ())
    return len(seen)


def _pairs(e: Add) -> list[tuple[Call, Call, float]]:
    """Returns the pairs sin u and cos u, sinh u and cosh u, that stand in one sum, outside of other functions."""
    functions: dict[Call, None] = {}
    seen: set[Expr] = set()
    stack: list[Expr] = [e]
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if len(seen) > _REGION:
            return []
        if isinstance(node, Call):
            functions[node] = None
        elif isinstance(node, Add | Mul | Pow):
            stack.extend(cast("tuple[Expr, ...]", node.children[::-1]))
    pairs = []
    for f in functions:
        for sine, cosine, sign in _WAVES:
            other = Call.make(cosine, f.children) if f.name == sine else None
            if isinstance(other, Call) and other in functions:
                pairs.append((f, other, sign))
    return pairs


def _without_squares(normal: Expr, base: Call, square: Expr) -> Expr:
    """Returns a sum of monomials with `base`² replaced; the sum itself if it does not occur."""
    terms = []
    replaced = False
    for term in normal.children if isinstance(normal, Add) else (normal,):
        factors: list[Expr] = []
        for f in term.children if isinstance(term, Mul) else (term,):
            if isinstance(f, Pow) and f.base is base and f.exponent >= 2:
                factors += [integer_power(square, f.exponent // 2), integer_power(base, f.exponent % 2)]
                replaced = True
            else:
                factors.append(f)
        terms.append(mul(*factors))
    return add(*terms) if replaced else normal


# -- products ------------------------------------------------------------------------------------------------------------


def _joined(e: Mul) -> Expr:
    """Returns exp u·exp v with a simpler exponent."""
    exponents: list[Expr] = []
    others: list[Expr] = []
    for f in e.children:
        base, k = (f.base, f.exponent) if isinstance(f, Pow) else (f, 1)
        if isinstance(base, Call) and base.name == "exp":
            exponents.append(mul(ex.const(k), base.children[0]))
        else:
            others.append(f)
    if len(exponents) < 2:
        return e
    total = expanded(add(*exponents))
    return mul(*others, call("exp", total)) if total is not None and _length(total) < sum(map(_length, exponents)) else e


def _cartesian(e: Expr) -> Expr:
    """Returns √(x² + y²)·sin atan2(y, x) as y, and likewise with the cosine. The root is required: it is 0 where the angle is undefined."""
    done = False
    while isinstance(e, Mul) and not done:
        done = True
        for wave in e.children:
            angle = wave.children[0] if isinstance(wave, Call) and wave.name in ("sin", "cos") else None
            if not (isinstance(angle, Call) and angle.name == "atan2"):
                continue
            y, x = cast("tuple[Expr, Expr]", angle.children)
            square = add(integer_power(x, 2), integer_power(y, 2))
            length = next((c for c in e.children if _roots_in(c, square) > 0), None)
            if length is not None:
                left = integer_power(call("sqrt", square), _roots_in(length, square) - 1)
                side = y if cast(Call, wave).name == "sin" else x
                e, done = mul(side, left, *(c for c in e.children if c is not wave and c is not length)), False
                break
    return e


def _roots_in(factor: Expr, square: Expr) -> int:
    """Returns the k of a factor that is (√square)^k, else 0."""
    base, k = (factor.base, factor.exponent) if isinstance(factor, Pow) else (factor, 1)
    if isinstance(base, Call) and base.name == "sqrt":
        base = base.children[0]
    else:
        k *= 2
    if base is square:
        return k
    normal = expanded(sub(base, square)) if isinstance(base, Add) and base.free == square.free else None
    return k if normal is ex.ZERO else 0


# -- functions -----------------------------------------------------------------------------------------------------------


def _function(node: Call, signs: _Signs) -> Expr:
    u = node.children[0]
    match node.name, u.name if isinstance(u, Call) else "":
        case ("log", "exp") | ("log1p", "expm1") | ("expm1", "log1p"):
            return cast(Expr, u.children[0])
        case ("tan", "atan") | ("sin", "asin") | ("cos", "acos"):
            return cast(Expr, u.children[0])
        case "sqrt", _:
            return _root(u, signs)
        case "magnitude", _:
            sign = signs.of(u)
            return mul(_number(sign), u) if sign else node
        case _:
            return node


def _root(u: Expr, signs: _Signs) -> Expr:
    """Returns √u with the even powers in u taken out."""
    outside: list[Expr] = []
    inside: list[Expr] = []
    for f in u.children if isinstance(u, Mul) else (u,):
        half = integer_power(f.base, f.exponent // 2) if isinstance(f, Pow) and f.exponent % 2 == 0 else None
        sign = signs.of(half) if half is not None else 0
        if half is not None and sign:
            outside.append(mul(_number(sign), half))
        else:
            inside.append(f)
    if not outside or any(isinstance(f, Const) and f.data < 0.0 for f in inside):
        return call("sqrt", u)
    return mul(*outside, call("sqrt", mul(*inside)))
