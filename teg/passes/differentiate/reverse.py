"""Reverse mode: the derivatives by all parameters in one sweep, deltas visible.

    sweep(e, z) gives the adjoints of the leaves of e: its maximal subexpressions in value position that are free of the bound variable z.

    adj[e] := 1; nodes that depend on z in reverse topological order by the usual rules, and
      where(b, p, q) with adjoint w:   p += where(b, w, 0);  q += where(b, 0, w);  b gets nothing
      I = ∫ₗʰ F dx with adjoint w:     for (u, F̄) in sweep(F, x):                u += w·∫ₗʰ F̄ dx
                                       for g owned by I, J = jump_g(F), (u, ḡ) in sweep(g, x):   u += w·∫ₗʰ J·ḡ·δ(g) dx
                                       h += w·F|ₓ₌ₕ ;  l -= w·F|ₓ₌ₗ

      I with a δ in it, or with singularities that move:   u += w·(its forward derivative by u), one sweep a parameter

The leaves may also be the parameters themselves: the smaller of the two cuts is taken. A surface that depends on an outer variable is
always cut at the parameters, so that its δ can be eliminated over that variable with one integral a parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from teg.analysis.calculus import factor_cofactors, partials, value_children
from teg.analysis.jumps import surface_terms
from teg.analysis.singularities import sharp_nodes
from teg.analysis.surfaces import bound_surface, open_surfaces, owned_surfaces, restrict
from teg.errors import DeltaError
from teg.ir import simplify
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Call, Const, Expr, Mul, Param, Pow, Tuple, Var, Where, const
from teg.ir.integral import Delta, Integral, delta, integral_over
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, guarded_sum, integer_power, mul, where
from teg.passes.differentiate.forward import Transport, carried, tangent_of

Adjoints = dict[Expr, Expr]


def gradient_of(e: Expr, wrt: Sequence[Param]) -> Tuple:
    """Returns the derivatives of e by each parameter, a tuple; for a tuple e, one such tuple an entry."""
    if isinstance(e, Tuple):
        return simplify.tuple_of(*(gradient_of(entry, wrt) for entry in e.children))
    sweep = _Sweep(e, frozenset(wrt))
    adjoints = sweep.run(e, None)
    for g, jump in surface_terms(e, [g for g in open_surfaces(e) if g in sweep.active]):  # surfaces of an outer integral
        for p, slope in sweep.run(g, None).items():
            adjoints[p] = add(adjoints.get(p, ZERO), mul(jump, slope, delta(g)))
    return simplify.tuple_of(*(adjoints.get(p, ZERO) for p in wrt))


class _Sweep:
    """One gradient. The nodes that depend on the chosen parameters are determined once."""

    def __init__(self, root: Expr, wrt: frozenset[Param]) -> None:
        self.wrt = sorted(wrt, key=lambda p: p.name)
        self.active: set[Node] = set()
        for node in postorder([root]):
            if node in wrt or any([c in self.active for c in node.children]):
                self.active.add(node)
        self.sharp = sharp_nodes([root])

    def run(self, e: Expr, var: Var | None) -> Adjoints:
        """Returns the adjoints of the leaves of e (`var` given), or of the parameters."""
        if var is None or var not in e.free:
            return self._sweep(e, lambda node: isinstance(node, Param))
        at_leaves, at_parameters = self._leaves(e, var)
        if at_leaves <= at_parameters:
            return self._sweep(e, lambda node: var not in node.free)
        return self._sweep(e, lambda node: isinstance(node, Param))

    def _moving(self, node: Expr) -> list[Expr]:
        return [c for c in value_children(node) if c in self.active]

    def _leaves(self, e: Expr, var: Var) -> tuple[int, int]:
        """Returns the number of leaves, and the number of parameters, below e."""
        leaves, parameters = 0, 0
        seen: set[Expr] = set()
        stack: list[tuple[Expr, bool]] = [(e, True)]
        while stack:
            node, above = stack.pop()
            if node in seen or node not in self.active:
                continue
            seen.add(node)
            is_leaf = above and var not in node.free
            leaves += is_leaf
            parameters += isinstance(node, Param)
            stack.extend((c, above and not is_leaf) for c in self._moving(node))
        return leaves, parameters

    def _order(self, e: Expr) -> list[Expr]:
        order: list[Node] = []
        seen: set[Node] = set()
        stack: list[tuple[Node, bool]] = [(e, False)]
        while stack:
            node, done = stack.pop()
            if done:
                order.append(node)
            elif node not in seen and node in self.active:
                seen.add(node)
                stack.append((node, True))
                # also through conditions and below leaves: the leaves of a surface, or of an inner integral, may stand there
                stack.extend((c, False) for c in node.children if c in self.active)
        return [n for n in order if isinstance(n, Expr)]

    def _sweep(self, e: Expr, is_leaf: Callable[[Expr], bool]) -> Adjoints:
        parts: dict[Expr, list[Expr]] = {e: [ONE]}
        leaves: Adjoints = {}
        for node in reversed(self._order(e)):
            w = guarded_sum(parts.pop(node, ()))
            if w is ZERO:
                continue
            if is_leaf(node):
                leaves[node] = w
                continue
            for child, cotangent in self._back(node, w):
                if child in self.active and cotangent is not ZERO:
                    parts.setdefault(child, []).append(cotangent)
        return leaves

    def _back(self, node: Expr, w: Expr) -> list[tuple[Expr, Expr]]:
        match node:
            case Const() | Var() | Param():
                return []
            case Add():
                return [(c, w) for c in node.children]
            case Mul():
                if len(self._moving(node)) == 1:
                    child = self._moving(node)[0]
                    others = [c for c in node.children if c is not child]
                    return [(child, mul(w, *others))]
                return [(c, mul(w, cofactor)) for c, cofactor in zip(node.children, factor_cofactors(node), strict=True)]
            case Pow():
                return [(node.base, mul(const(node.exponent), w, integer_power(node.base, node.exponent - 1)))]
            case Call():
                return [(c, mul(w, p)) for c, p in zip(node.children, partials(node), strict=True) if c in self.active]
            case Where():
                return [
                    (node.then, where(node.condition, w, ZERO)),
                    (node.otherwise, where(node.condition, ZERO, w)),
                ]
            case Integral() if node.has_delta:  # one forward sweep a parameter
                return [(p, mul(w, carried(node, {p: ONE}))) for p in self.wrt if p in self.active]
            case Integral() if (moved := self._transported(node)) is not None:
                return [(p, mul(w, change)) for p, change in moved]
            case Integral():
                return self._through(node, w)
            case Delta():
                raise DeltaError(
                    "a delta outside of the integrals over its variables cannot be differentiated", node, "use teg.eliminate first"
                )
            case _:
                raise AssertionError(f"unknown node {type(node).__name__}")

    def _transported(self, node: Integral) -> list[tuple[Expr, Expr]] | None:
        """Returns the derivatives of an integral with singularities that move, one forward sweep a parameter; None if there are none."""
        if node not in self.sharp:
            return None
        moved = {p: Transport(node, {p: ONE}, self.sharp).of(node) for p in self.wrt if p in self.active}
        if all(change is None for change in moved.values()):
            return None
        return [(p, tangent_of(node, {p: ONE}) if change is None else change) for p, change in moved.items()]

    def _through(self, node: Integral, w: Expr) -> list[tuple[Expr, Expr]]:
        x, lo, hi, body = node.var, node.lo, node.hi, node.body
        back: list[tuple[Expr, Expr]] = []
        if body in self.active:
            for u, adjoint in self.run(body, x).items():
                back.append((u, mul(w, integral_over(adjoint, x, lo, hi))))
            surfaces = [g for g in owned_surfaces(body, x) if g in self.active]
            for g, jump in surface_terms(body, surfaces):
                outer = g.free - {x}
                adjoints = self._sweep(g, lambda n: isinstance(n, Param)) if outer else self.run(g, x)
                for u, adjoint in adjoints.items():
                    back.append((u, mul(w, integral_over(mul(jump, adjoint, delta(g)), x, lo, hi))))
        for bound, sign in ((hi, ONE), (lo, MINUS_ONE)):
            if bound in self.active:
                value = restrict(body, {x: bound}, bound_surface(x, bound), (x,))
                back.append((bound, mul(sign, w, value)))
        return back
