"""A surface inside of itself: a condition on variables of inner integrals, at points of the same surface in variables of outer ones.

    ∫ exp(∫ [c·x + y < t] dx) dy        its derivative is on c·x1 + y = t, and there the condition inside is c·(x1 - x) > 0

So the condition is on differences, often with rates that no variable is in. Where all rates are 0, the surface stands across the inner
variables: all that is inside jumps at once, and the condition, 0 > 0, would be false. The two ways in which the surface may begin to
lean are the two arrangements of a tie (`teg.analysis.surfaces`). Written in this way the condition is also exact where c·x + y - t has
no digit left: for small rates, and where what is inside ends, as the chord of a disk does, of which its logarithm is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

from teg.analysis.calculus import slope
from teg.analysis.expanded import expanded
from teg.analysis.polynomial import is_null
from teg.errors import NotDifferentiableError
from teg.ir.cells import replaced
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Cond, Const, Expr, Var
from teg.ir.simplify import add, call, conjunction, disjunction, mul, negation, positive, sub, where
from teg.ir.traverse import parameters, substitute

MOST = 3
"""The largest number of inner variables of a surface that is compared."""


def as_twin(g: Expr, surface: Expr, inner: Sequence[Var], rivals: tuple[str, str]) -> Cond | None:
    """Returns g > 0 at points of `surface`, if g is that surface with variables of `inner` for other ones; a tie where it stands across.

    No variable of `inner` occurs in `surface`. None if g is another surface, or its difference has other variables.
    """
    own = [v for v in inner if v in g.free]
    others = sorted(surface.free - g.free, key=lambda w: w.name)
    if not 0 < len(own) == len(others) <= MOST:
        return None
    for order in permutations(others):
        if substitute(g, dict(zip(own, order, strict=True))) is surface:
            try:
                return _condition(g, surface, list(zip(own, order, strict=True)), rivals)
            except NotDifferentiableError:
                return None
    return None


def _condition(g: Expr, surface: Expr, pairs: Sequence[tuple[Var, Var]], rivals: tuple[str, str]) -> Cond | None:
    rates = [slope(g, v) for v, _ in pairs]
    steps = [sub(v, w) for v, w in pairs]
    if not any(rate.free for rate in rates):
        if any(isinstance(rate, Const) and rate is not ZERO for rate in rates):
            return positive(_sum(rates, steps))
        return _product(rates[0], steps[0], rivals) if len(pairs) == 1 else _leaning(rates, steps, rivals)
    difference = sub(g, surface)
    if (cancelled := expanded(difference)) is not None:
        difference = cancelled
    for p in parameters(difference):
        side = slope(difference, p)
        (rest,) = replaced([difference], {p: ZERO})
        if p not in parameters(side) and (rest is ZERO or is_null(rest)):
            return _product(p, side, rivals)
    return positive(difference) if difference.free <= {u for pair in pairs for u in pair} else None


def _product(factor: Expr, side: Expr, rivals: tuple[str, str]) -> Cond:
    """Returns [factor·side > 0]."""
    rising, beyond = positive(factor, True, TRUE, rivals), positive(side)
    return disjunction(conjunction(rising, beyond), conjunction(negation(rising), negation(beyond)))


def _leaning(rates: Sequence[Expr], steps: Sequence[Expr], rivals: tuple[str, str]) -> Cond:
    """Returns [Σ rate·step > 0]. If all rates are 0, the innermost one stands for them."""
    size = add(*(call("magnitude", rate) for rate in rates))
    first = where(positive(size), rates[0], where(positive(size, True, TRUE, rivals), ONE, MINUS_ONE))
    return positive(_sum([first, *rates[1:]], steps))


def _sum(rates: Sequence[Expr], steps: Sequence[Expr]) -> Expr:
    return add(*(mul(rate, step) for rate, step in zip(rates, steps, strict=True)))
