"""Domains on which an integral vanishes: conditions that intervals refute on all of it, before any quadrature.

A nest ∫dy ∫dx [g > 0]·… contributes nothing where an upper bound of g over the whole box is negative, and a sum over the roots of g
nothing where g has one sign there. Where a condition may tie, or a root lie on the border, by rounding only, nothing is refuted.
"""

from __future__ import annotations

import math
from typing import cast

from teg.analysis.guards import support
from teg.analysis.intervals import Enclosure
from teg.analysis.isolation import MARGIN
from teg.analysis.polynomial import Shadow
from teg.analysis.surfaces import atoms_of
from teg.errors import NotDifferentiableError
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, Add, And, Compare, Cond, Const, Expr, Mul, Where, const
from teg.ir.integral import Integral, masses_of
from teg.ir.node import postorder
from teg.ir.simplify import add, call, conjunction, disjunction, mul, negation, positive, where
from teg.ir.traverse import rewrite, substitute

MAX_LEVELS = 32
MAX_SIDES = 4
"""The largest number of surfaces and sides of the domain whose signs are tested."""
MAX_NODES = 400
"""The largest number of nodes of the test. A longer one costs more than it saves."""


def certainly_empty(node: Integral) -> Cond:
    """Returns a condition on outer values under which an integrand vanishes everywhere; FALSE if none is known."""
    conditions, nest = _reach(node)
    enclosure = Enclosure({})
    fails: list[Cond] = []
    try:
        for inner in nest:
            ends = [*enclosure.of(inner.lo), *enclosure.of(inner.hi)]
            enclosure.box[inner.var] = _extreme("min", ends), _extreme("max", ends)
        inside = [c for c in conditions if all(v in enclosure.box for v in c.free)]
        for c in inside:
            fails += _refutations(c, enclosure)
        if len(nest) == 1:
            fails += _one_sided(inside, node)
        masses = masses_of(nest[-1].body, nest[-1].var)
        if masses is not None and all(v in enclosure.box for v in masses.free):
            fails += [_clearly_negative(g, enclosure) for g in (masses.g, mul(MINUS_ONE, masses.g))]
    except NotDifferentiableError:  # bounds are not known
        return FALSE
    total = disjunction(*fails)
    return FALSE if len(postorder([total])) > MAX_NODES else total


def _reach(node: Integral) -> tuple[list[Cond], list[Integral]]:
    """Returns conditions outside of which nothing contributes, and the integrals whose variables they may contain, outermost first."""
    conditions: list[Cond] = []
    nest: list[Integral] = []
    e: Expr = node
    for _ in range(MAX_LEVELS):
        if isinstance(e, Integral):
            nest.append(e)
            e = e.body
        elif isinstance(e, Where) and e.otherwise is ZERO:
            conditions.append(e.condition)
            e = e.then
        elif isinstance(e, Where) and e.then is ZERO:
            conditions.append(negation(e.condition))
            e = e.otherwise
        elif isinstance(e, Mul) and any(isinstance(f, Where | Integral) for f in e.children):
            first, *others = [f for f in e.children if isinstance(f, Where | Integral)]
            conditions += [support(f) for f in others]
            e = first
        else:
            break
    return [part for c in conditions for part in (c.children if isinstance(c, And) else (c,)) if part is not TRUE], nest


def _extreme(name: str, ends: list[Expr]) -> Expr:
    result = ends[0]
    for end in ends[1:]:
        result = result if result is end else call(name, result, end)
    return result


def _refutations(c: Cond, enclosure: Enclosure) -> list[Cond]:
    """Returns conditions under which c fails everywhere; if c may tie, by more than rounding."""
    if isinstance(c, Compare) and c.resolution is not None:
        return [_clearly_negative(c.g, enclosure)]
    return [enclosure.decision(c)[1]] if all(a.resolution is None for a in atoms_of(c)) else []


def _one_sided(conditions: list[Cond], node: Integral) -> list[Cond]:
    """Returns conditions under which all atoms that may tie have one sign between the bounds, if that refutes the whole.

    The whole is [y* < h] - [y* < l] of a surface that passes the domain, whatever the sign of its slope is. Atoms that may tie are
    affine here, so their ends decide.
    """
    ties = dict.fromkeys(a for c in conditions for a in atoms_of(c) if a.resolution is not None)
    functions = dict.fromkeys(a.g for a in ties)
    if not 1 < len(functions) <= MAX_SIDES or any(Shadow((node.var,)).degree(g) != 1 for g in functions):
        return []
    found = []
    for assumed, sign in ((TRUE, MINUS_ONE), (FALSE, ONE)):
        taken = rewrite(conditions, lambda old, new, assumed=assumed: assumed if old in ties else new)  # type: ignore[misc]
        if _is_refuted(conjunction(*(cast(Cond, taken[c]) for c in conditions))):
            ends = [cast(Expr, substitute(mul(sign, g), {node.var: bound})) for g in functions for bound in (node.lo, node.hi)]
            found.append(conjunction(*(_clearly_negative(end, Enclosure({})) for end in ends)))
    return found


def _is_refuted(c: Cond) -> bool:
    """Returns whether a conjunction contains a condition together with its negation."""
    parts = set(c.children if isinstance(c, And) else (c,))
    return c is FALSE or any(negation(part) in parts for part in parts)


def _clearly_negative(g: Expr, enclosure: Enclosure) -> Cond:
    """Returns a condition under which g < 0 everywhere, by more than rounding."""
    above = add(enclosure.of(g)[1], mul(const(MARGIN), _size(g, enclosure)))
    return positive(mul(MINUS_ONE, above))


def _size(g: Expr, enclosure: Enclosure) -> Expr:
    """Returns the size of the terms of g on the box, to which its rounding is relative; of a choice those of the case that is taken."""
    sizes: dict[Expr, Expr] = {}
    stack = [g]
    while stack:
        e = stack[-1]
        parts = _terms(e)
        missing = [p for p in parts if p not in sizes]
        stack += missing
        if missing:
            continue
        stack.pop()
        if isinstance(e, Where) and len(parts) == 2 and not any(v in enclosure.box for v in e.condition.free):
            sizes[e] = where(e.condition, *(sizes[p] for p in parts))
        elif parts:
            sizes[e] = add(*(sizes[p] for p in parts))
        else:
            sizes[e] = call("max", *(call("magnitude", end) for end in enclosure.of(e)))
    return sizes[g]


def _terms(e: Expr) -> list[Expr]:
    """Returns the terms of a sum, the cases of a choice that are numbers, and for a product with 1 or -1 the other factor."""
    if isinstance(e, Add):
        return list(e.children)
    if isinstance(e, Where):
        return [case for case in (e.then, e.otherwise) if not (isinstance(case, Const) and math.isnan(case.data))]
    if isinstance(e, Mul) and len(e.children) == 2 and e.children[0] in (ONE, MINUS_ONE):
        return [e.children[1]]
    return []
