"""Alike terms of a sum as one term over the rows of a table.

    Σᵢ cᵢ·∫ e^{ax}·[x < tᵢ] dx  (written out)   →   Σ[k: 0..n] T[k, 0]·∫ e^{ax}·[x < T[k, 1]] dx,   T = ((c₀, t₀), (c₁, t₁), …)

Terms are alike that differ in their parameters and numbers only; what all rows share stays in the term. The program is then derived and
compiled for one term, whatever n is. A sum in an integral is taken apart where the integrand is linear in it, so that it can stand
outside of the integral (`teg.passes.normalise.sums`). Cost: a visit a node.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import cast

from teg.ir.arrays import has_arrays, sum_over
from teg.ir.expr import Add, Compare, Expr, Mul, Still, Where
from teg.ir.function import Apply
from teg.ir.index import IndexVar, index_const
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, mul, where
from teg.ir.traverse import Steps, rebuild, unrolled
from teg.passes.normalise.extremes import with_choices
from teg.passes.normalise.rows import ROW, Shape, Tables, shape_of, template_of

FEWEST = 12
"""So many alike terms are a loop."""


def with_tables(root: Expr) -> tuple[Expr, Tables]:
    """Returns a program in which alike terms are sums over rows, and the tables, of parameters and numbers. No table means no change."""
    if has_arrays(root) or root.has_delta or any(isinstance(n, Apply | Still) for n in postorder([root])):
        return root, {}
    return _Rows(root).run(root)


class _Rows:
    """Alike terms of one program. `heavy` are the nodes that hold a condition or an integral; other terms are as short as a row."""

    def __init__(self, root: Expr) -> None:
        self.tables: Tables = {}
        self.heavy: set[Node] = set()
        self._made: dict[Node, Expr] = {}
        for node in postorder([root]):
            if isinstance(node, Compare | Integral) or any(c in self.heavy for c in node.children):
                self.heavy.add(node)

    def run(self, root: Expr) -> tuple[Expr, Tables]:
        """Returns the program and its tables. Outside of integrals every sum is looked at, in them those in linear positions."""
        new: dict[Node, Node] = {}
        parts: dict[Node, tuple[list[Expr], list[Expr]]] = {}
        stack: list[Node] = [root]
        while stack:
            node = stack[-1]
            if isinstance(node, Add) and node not in parts:
                parts[node] = self._gathered(node)
            below: Sequence[Node] = parts[node][0] if isinstance(node, Add) else node.children
            if node in new or node not in self.heavy:
                new.setdefault(node, node)
                stack.pop()
            elif isinstance(node, Integral):
                choice = with_choices(node, self.tables)
                new[node] = unrolled(self._linear(node)) if choice is None else choice
            elif missing := [c for c in below if c not in new]:
                stack.extend(missing)
            elif isinstance(node, Add):
                terms, sums = parts[node]
                changed = sums or any(new[t] is not t for t in terms)
                new[node] = add(*(cast(Expr, new[t]) for t in terms), *sums) if changed else node
            else:
                new[node] = rebuild(node, tuple(new[c] for c in node.children))
        return (cast(Expr, new[root]), self.tables) if self.tables else (root, {})

    def _linear(self, e: Expr) -> Steps[Expr]:
        """Returns an expression with its alike terms as sums, in positions in which it is linear."""
        if e not in self.heavy:
            return e
        if e not in self._made:
            self._made[e] = yield self._made_linear(e)
        return self._made[e]

    def _made_linear(self, e: Expr) -> Steps[Expr]:
        match e:
            case Integral():
                return integral_over((yield self._linear(e.body)), e.var, e.lo, e.hi)
            case Add():
                terms, sums = self._gathered(e)
                parts = []
                for term in terms:
                    parts.append((yield self._linear(term)))
                changed = sums or any(part is not term for part, term in zip(parts, terms, strict=True))
                return add(*parts, *sums) if changed else e
            case Where():
                return where(e.condition, (yield self._linear(e.then)), (yield self._linear(e.otherwise)))
            case Mul():
                inner = [c for c in e.children if isinstance(c, Add | Integral | Where) and c in self.heavy]
                if len(inner) == 1:
                    found = yield self._linear(inner[0])
                    return mul(*(found if c is inner[0] else c for c in e.children))
        return e

    def _gathered(self, e: Add) -> tuple[list[Expr], list[Expr]]:
        """Returns the terms of a sum that stay, and sums over rows in the place of the others."""
        terms = list(_terms(e))
        if sum(t in self.heavy for t in terms) < FEWEST:
            return terms, []
        classes: dict[object, list[tuple[Expr, Shape]]] = {}
        for term in terms:
            shape = shape_of(term) if term in self.heavy else Shape((term,), (), ())
            classes.setdefault(shape.key, []).append((term, shape))
        kept: list[Expr] = []
        sums: list[Expr] = []
        for alike in classes.values():
            template = template_of(alike, self.tables) if len(alike) >= FEWEST else None
            if template is None:
                kept += [term for term, _ in alike]
            else:
                sums.append(sum_over(template, IndexVar.make(ROW, ()), index_const(0), index_const(len(alike))))
        return kept, sums


def _terms(e: Expr) -> Iterator[Expr]:
    """Yields the terms of a sum and of the sums among them."""
    stack = [e]
    while stack:
        term = stack.pop()
        if isinstance(term, Add):
            stack.extend(reversed(term.children))
        else:
            yield term
