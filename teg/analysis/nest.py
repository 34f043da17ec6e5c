"""Nests of integrals: binders, chains of binders, and the ranges of their variables."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.polynomial import Shadow
from teg.ir.expr import MINUS_ONE, ONE, Expr, Var
from teg.ir.integral import integral_over
from teg.ir.simplify import mul, positive, sub, where
from teg.ir.traverse import substitute


@dataclass(frozen=True)
class Binder:
    """One integral sign: ∫ₗʰ d(var)."""

    var: Var
    lo: Expr
    hi: Expr


Chain = tuple[Binder, ...]
"""The integral signs of a nest, the outermost first."""


def nest(body: Expr, chain: Sequence[Binder]) -> Expr:
    """Returns the integrals of a chain around a body."""
    for b in reversed(chain):
        body = integral_over(body, b.var, b.lo, b.hi)
    return body


def ranges_of(chosen: Sequence[Binder]) -> list[tuple[Expr, Expr]] | None:
    """Returns, for each binder, outermost first, bounds that do not depend on the others: its own bounds, or their extreme values.

    None if a bound is not affine in an outer variable.
    """
    ranges: list[tuple[Expr, Expr]] = []
    outer: list[tuple[Var, Expr, Expr]] = []
    for b in chosen:
        mine = [(v, lo, hi) for v, lo, hi in outer if v in b.lo.free or v in b.hi.free]
        if mine:
            variables = [v for v, _, _ in mine]
            if any(Shadow((v,)).degree(e) is None or (Shadow((v,)).degree(e) or 0) > 1 for v in variables for e in (b.lo, b.hi)):
                return None
            corners: list[Expr] = [b.lo, b.hi]
            for v, lo, hi in mine:
                corners = [cast(Expr, substitute(e, {v: end})) for e in corners for end in (lo, hi)]
            corners = list(dict.fromkeys(corners))
            ranges.append((_extreme(corners, MINUS_ONE), _extreme(corners, ONE)))
        else:
            ranges.append((b.lo, b.hi))
        outer.append((b.var, *ranges[-1]))
    return ranges


def _extreme(values: list[Expr], sign: Expr) -> Expr:
    best = values[0]
    for v in values[1:]:
        best = where(positive(mul(sign, sub(v, best))), v, best)
    return best


def divided(chain: Chain, variables: Collection[Var]) -> tuple[Chain, Chain, Chain] | None:
    """Returns the binders of some variables, the other binders, and the former with bounds that depend on no variable of the chain.

    None if bounds of one part depend on the variables of the other, or a range is not known.
    """
    mine, others = (tuple(b for b in chain if (b.var in variables) == wanted) for wanted in (True, False))
    for some, rest in ((others, mine), (mine, others)):
        if not all(e.free.isdisjoint(b.var for b in rest) for c in some for e in (c.lo, c.hi)):
            return None
    ranges = ranges_of(mine)
    return None if ranges is None else (mine, others, tuple(Binder(b.var, lo, hi) for b, (lo, hi) in zip(mine, ranges, strict=True)))
