"""Constants that are rounded products of powers of one another, as symbols.

Differentiation multiplies constants: of c = √(2π) it makes 2c and 2c², each of them rounded, and what cancels by their relation leaves a
rounding, 2c²/(c·s)³ - 2/(c·s³). With a symbol in place of c it is exactly 0. A constant v belongs to c and d if v = r·cᵏ·dᵐ to TOLERANCE,
with a number r of few bits and |k| + |m| <= MOST_POWER. Numbers of few bits themselves are exact, and stay.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import cast

from teg.ir.expr import Add, Const, Expr, Mul, Param, Pow, const
from teg.ir.node import Node
from teg.ir.simplify import integer_power, mul
from teg.ir.traverse import rewrite, rewrite_below

BITS = 12
"""The bits of a number that is exact."""
TOLERANCE = 2.0**-50
"""The largest relative difference that roundings leave."""
MOST_POWER = 4
MOST, MOST_BASES = 24, 4
"""The largest sum of powers; the largest numbers of constants, and of symbols that are multiplied with another one."""
RANGE = range(-MOST_POWER, MOST_POWER + 1)
POWERS = sorted(
    ((j, k) for j in RANGE for k in RANGE if 0 < abs(j) + abs(k) <= MOST_POWER), key=lambda p: (abs(p[0]) + abs(p[1]), p[0] < 0)
)
"""The powers that are looked for, small ones first."""

Symbols = dict[Node, Expr]


def with_symbols(expressions: Sequence[Expr]) -> tuple[list[Expr], Symbols]:
    """Returns expressions with symbols in place of constants of many bits, outside of functions and conditions; and their values."""
    values = [v for v in dict.fromkeys(c.data for e in expressions for c in _constants(e)) if not _is_exact(v)]
    if not values or len(values) > MOST:
        return list(expressions), {}
    replaced: dict[float, Expr] = {}
    bases: dict[float, Expr] = {}
    while left := [v for v in values if v not in replaced]:
        others = list(bases)[:MOST_BASES]
        relations = {base: _relations(left, base, others) for base in left}
        base = max(left, key=lambda b: len(relations[b]))
        bases[base] = Param.make(f"constant {base!r}", ())
        for v, (factor, powers) in relations[base].items():
            replaced[v] = mul(const(factor), *(integer_power(bases[b], k) for b, k in powers.items()))

    def replacement(node: Node) -> Node | None:
        if isinstance(node, Const):
            return replaced.get(node.data, node)
        return None if isinstance(node, Add | Mul | Pow) else node

    changed = rewrite_below(expressions, replacement)
    return [cast(Expr, changed[e]) for e in expressions], {symbol: const(base) for base, symbol in bases.items()}


def with_values(expressions: Iterable[Expr], symbols: Symbols) -> list[Expr]:
    """Returns expressions with constants in place of their symbols."""
    roots = list(expressions)
    if not symbols:
        return roots
    changed = rewrite(roots, lambda old, node: symbols.get(old, node))
    return [cast(Expr, changed[e]) for e in roots]


def _constants(e: Expr) -> list[Const]:
    """Returns the constants outside of functions and conditions."""
    order: list[Const] = []
    stack, seen = [e], {e}
    while stack:
        node = stack.pop()
        if isinstance(node, Const):
            order.append(node)
        for c in cast("Sequence[Expr]", node.children) if isinstance(node, Add | Mul | Pow) else ():
            if c not in seen:
                seen.add(c)
                stack.append(c)
    return order


def _is_exact(v: float) -> bool:
    """Returns whether a number has few bits, or is none."""
    return not math.isfinite(v) or v == 0.0 or _few_bits(v) == v


def _few_bits(v: float) -> float:
    """Returns a number rounded to a few bits."""
    mantissa, exponent = math.frexp(v)
    return math.ldexp(round(math.ldexp(mantissa, BITS)), exponent - BITS)


def _relations(values: Sequence[float], base: float, others: Sequence[float]) -> dict[float, tuple[float, dict[float, int]]]:
    """Returns the values that belong to a base, or to it and another one, each with its factor and the powers."""
    known: dict[float, tuple[float, dict[float, int]]] = {}
    for some in [(base,), *((base, other) for other in others)]:
        for v in values:
            if v not in known and (relation := _relation(v, some)) is not None:
                known[v] = relation[0], dict(zip(some, relation[1], strict=False))
    return known


def _relation(v: float, bases: Sequence[float]) -> tuple[float, tuple[int, int]] | None:
    """Returns r and the powers of one or two bases whose product v is, but for rounding; None if there are none."""
    for powers in POWERS:
        if len(bases) == 1 and powers[1]:
            continue
        try:
            quotient = v / math.prod(b**k for b, k in zip(bases, powers, strict=False))
        except (OverflowError, ZeroDivisionError):
            continue
        if math.isfinite(quotient) and quotient != 0.0:
            factor = _few_bits(quotient)
            if abs(quotient - factor) <= TOLERANCE * abs(quotient):
                return factor, powers
    return None
