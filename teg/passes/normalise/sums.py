"""Sums out of integrals: afterwards no sum depends on a variable of integration.

    ∫ Σ_k f_k dx  =  Σ_k ∫ f_k dx                   where the integrand is linear in the sum: the integral keeps one term's breaks
    Σ_{k=0}^{2} f_k  =  f_0 + f_1 + f_2             elsewhere (in a condition, in a function, in a product of sums), written out

A sum that has to be written out must have bounds that are numbers. If its bounds are lengths of arrays, or data, it is written out when
these are known, at the first call with them (`teg.passes.normalise.padded`); the exception `NeedsLengths` asks the evaluator for them.
Cost: a visit a node; written out, a body a term.
"""

from __future__ import annotations

from typing import cast

from teg.errors import ArrayIndexError
from teg.ir.arrays import Ranged, Sum, sum_over
from teg.ir.cells import indices_apart
from teg.ir.expr import ONE, ZERO, Add, Expr, Mul, Var, Where
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, mul, where
from teg.ir.traverse import rebuild
from teg.passes.normalise.padded import at_place, most_of

MOST_TERMS = 20_000
"""A sum of more terms is not written out."""


class NeedsLengths(Exception):  # a request to the caller, not an error
    """The bounds of a sum that must be written out are known at run time only."""

    def __init__(self, node: Ranged) -> None:
        super().__init__("the bounds of a sum inside an integral must be known")
        self.node = node


def sums_outside(root: Expr) -> Expr:
    """Returns the program with no sum that depends on a variable of integration. Raises NeedsLengths."""
    if not any(isinstance(n, Sum) and n.free for n in postorder([root])):
        return root
    new: dict[Node, Node] = {}
    for node in postorder([indices_apart(root)]):
        children = tuple(new[c] for c in node.children)
        if isinstance(node, Integral):
            body, lo, hi = cast("tuple[Expr, Expr, Expr]", children)
            new[node] = _integral(body, node.var, _written_out(lo), _written_out(hi))
        else:
            new[node] = rebuild(node, children)
            last = node
    return cast(Expr, new[last if not isinstance(node, Integral) else node])


def _integral(body: Expr, x: Var, lo: Expr, hi: Expr) -> Expr:
    """Returns ∫ body dx with every sum that depends on x outside, or written out."""
    if not any(isinstance(n, Sum) and x in n.free for n in postorder([body])):
        return integral_over(body, x, lo, hi)
    terms: list[Expr] = []
    for chain, term in _linear_terms(body, x):
        if any(isinstance(n, Sum) and x in n.free for n in postorder([term])):
            term = _written_out(term, x)
        result = integral_over(term, x, lo, hi)
        for s in reversed(chain):
            result = sum_over(result, s.index, s.lo, s.hi)
        terms.append(result)
    return add(*terms)


def _linear_terms(body: Expr, x: Var) -> list[tuple[tuple[Sum, ...], Expr]]:
    """Returns pairs of sums and terms, with body = Σ over the pairs of Σ…Σ term. The sums come from linear positions;
    a term may have none."""
    done: list[tuple[tuple[Sum, ...], Expr]] = []
    plain: list[Expr] = []
    stack: list[tuple[tuple[Sum, ...], Expr, Expr]] = [((), ONE, body)]  # sums around, factor, expression still to be split
    while stack:
        chain, factor, e = stack.pop()
        through = [c for c in e.children if _has_sum(c, x)]
        if isinstance(e, Sum) and x in e.free:
            stack.append(((*chain, e), factor, e.body))
        elif isinstance(e, Add) and through:
            stack.extend((chain, factor, c) for c in reversed(e.children))
        elif isinstance(e, Mul) and len(through) == 1:
            others = mul(*(c for c in e.children if c is not through[0]))
            stack.append((chain, mul(factor, others), cast(Expr, through[0])))
        elif isinstance(e, Where) and through and e.condition not in through:
            for c, branch in ((where(e.condition, ONE, ZERO), e.then), (where(e.condition, ZERO, ONE), e.otherwise)):
                if branch is not ZERO:
                    stack.append((chain, mul(factor, c), branch))
        elif chain:
            done.append((chain, mul(factor, e)))
        else:
            plain.append(mul(factor, e))
    return [*done, *([((), add(*plain))] if plain else [])]


def _has_sum(node: Node, x: Var) -> bool:
    return x in node.free and any(isinstance(n, Sum) and x in n.free for n in postorder([node]))


def _written_out(root: Expr, x: Var | None = None) -> Expr:
    """Returns the expression with every sum that depends on variables (or on x) written out as its terms."""
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        result = rebuild(node, tuple(new[c] for c in node.children))
        if isinstance(result, Sum) and (x in result.free if x is not None else result.free):
            result = _terms(result)
        new[node] = result
    return cast(Expr, new[root])


def _terms(s: Sum) -> Expr:
    most = most_of(s)
    if most is None:
        raise NeedsLengths(s)
    if most > MOST_TERMS:
        hint = "write the integral inside the sum if the integrand is linear in it"
        raise ArrayIndexError(f"this sum inside an integral has {most} terms to be written out; {MOST_TERMS} at most", s, hint)
    terms: list[Expr] = []
    for j in range(most):
        there, (body,) = at_place(s, j)
        terms.append(where(there, cast(Expr, body), ZERO))
    return add(*terms)
