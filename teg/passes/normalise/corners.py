"""Integrals over boxes far from the origin, in coordinates of a corner of the box.

    ∫_l^{l+1} [(x - c)² < r] dx   =   ∫₀¹ [(x - (c - l))² < r] dx

Roots, breaks and nodes are places between the bounds. In absolute coordinates they are known to the rounding of l, and a disk in a pixel
at 4096 to eight digits. Relative to a corner nothing is rounded but the difference c - l. The origin o of a variable is its lower bound,
if that is a parameter, a parameter of both bounds (c of c - r and c + r), or a number that is far compared with the distance of the
bounds. A polynomial that does not change when x, o and other parameters move together (`teg.passes.normalise.origins`) is written with x
for x - o, s - o for each of these parameters s, and 0 for o; elsewhere x becomes o + x.

Applied to curved surfaces, and to one or two straight ones: the clipping of a polygon is relative to the corner already. All expressions
of the variable must be polynomial, or smooth functions such as exp(x - c): a singularity elsewhere would move with the origin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

from teg.analysis.calculus import SMOOTH
from teg.analysis.expanded import expanded
from teg.analysis.polynomial import Shadow
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Call, Compare, Const, Expr, Mul, Param, Pow, Var
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.ir.simplify import add, mul, sub
from teg.ir.traverse import remake
from teg.passes.normalise.origins import Group, groups_of, is_fixed, outermost_polynomials

FAR = 4.0
"""A variable is far away if it exceeds the distance of its bounds by this factor."""
MANY = 3
"""So many straight surfaces make a polygon."""


def with_local_boxes(root: Expr) -> Expr:
    """Returns the program with integrals over boxes that are, or may be, far away in coordinates of a corner."""
    order = postorder([root])
    origins: Mapping[Var, Expr] = _origins(order, root)
    if not origins:
        return root
    polynomials = {e: groups_of(e) for e in outermost_polynomials(order) if any(v in e.free for v in origins)}
    axes = {v: _axis(v, [*order, sub(v, o)], polynomials) for v, o in origins.items()}
    origins = {v: o for v, o in origins.items() if (isinstance(o, Const) or len(axes[v]) > 2) and _is_worth_it(order, v)}
    return _moved(order, origins, axes, polynomials) if origins else root


def _axis(v: Var, order: Sequence[Node], polynomials: Mapping[Expr, Sequence[Group]]) -> frozenset[Expr]:
    """Returns the variable, the parameters that it is compared with, and those that move with it in a polynomial."""
    axis: set[Expr] = {v}
    for node in order:
        for sign in (ONE, MINUS_ONE):
            if isinstance(node, Add) and len(node.children) == 2 and mul(sign, v) in node.children:
                (other,) = [c for c in node.children if c is not mul(sign, v)] or [ZERO]
                p = mul(MINUS_ONE, sign, other)
                axis.update([p] if isinstance(p, Param) else [])
    for groups in polynomials.values():
        for group in groups:
            axis.update(s for s in group if v in group and isinstance(s, Param))
    return frozenset(axis)


def _origins(order: Sequence[Node], root: Expr) -> dict[Var, Expr]:
    """Returns the origins of variables that may be far away, the same in all integrals over them.

    Where an origin is no number, only polynomials may depend on its variable, and functions without singularities of differences to
    parameters. Another function may be singular, or have steps, somewhere else than at the origin; moved with the origin, it would have no
    derivative by it.
    """
    origins: dict[Var, Expr | None] = {}
    polynomials: set[Node] = set()
    at_numbers: set[Var] = set()
    for node in order:
        if _is_of_a_polynomial(node) and polynomials.issuperset(node.children):
            polynomials.add(node)
        elif isinstance(node, Integral):
            o = _origin(node)
            origins[node.var] = o if origins.get(node.var, o) is o else None
        elif isinstance(node, Call) or (isinstance(node, Pow) and node.exponent < 0):
            smooth = isinstance(node, Call) and node.name in SMOOTH and polynomials.issuperset(node.children)
            at_numbers |= node.free - _differences(cast(Call, node)) if smooth else node.free
    return {v: o for v, o in origins.items() if o is not None and v not in root.free and (isinstance(o, Const) or v not in at_numbers)}


def _differences(node: Call) -> frozenset[Var]:
    """Returns the variables that move together with parameters in the argument of a function: x in exp(x - c)."""
    groups = groups_of(node.children[0])
    return frozenset(v for v in node.free if any(v in g and any(isinstance(s, Param) for s in g) for g in groups))


def _is_of_a_polynomial(node: Node) -> bool:
    return isinstance(node, Add | Mul | Param | Var | Const) or (isinstance(node, Pow) and node.exponent > 0)


def _origin(node: Integral) -> Expr | None:
    lo, hi = node.lo, node.hi
    if isinstance(lo, Param):
        return lo
    if isinstance(lo, Add) and isinstance(hi, Add):  # c - r and c + r
        return next((p for p in lo.children if isinstance(p, Param) and p in hi.children), None)
    if isinstance(lo, Const) and isinstance(hi, Const):
        extent = abs(hi.data - lo.data)
        return lo if FAR * extent < min(abs(lo.data), abs(hi.data)) < float("inf") and lo.data * hi.data > 0.0 else None
    return None


def _is_worth_it(order: Sequence[Node], v: Var) -> bool:
    """Returns whether there are curved surfaces in the variable, or few surfaces of which one depends on other variables."""
    surfaces = [n.g for n in order if isinstance(n, Compare) and n.g.free]
    mine = [g for g in surfaces if v in g.free]
    few = len(surfaces) < MANY and any(len(g.free) > 1 for g in mine)
    return few or any((Shadow(tuple(g.free)).degree(g) or 0) > 1 for g in mine)


def _moved(
    order: Sequence[Node], origins: Mapping[Var, Expr], axes: Mapping[Var, frozenset[Expr]], polynomials: Mapping[Expr, Sequence[Group]]
) -> Expr:
    """Returns the program in local coordinates."""
    local = {v: Var.make(f"({v.name} - {show(o, 40)})", ()) for v, o in origins.items()}
    whole = {v: add(o, local[v]) for v, o in origins.items()}
    new: dict[Node, Node] = {}
    for node in order:
        if isinstance(node, Integral) and node.var in origins:
            lo, hi = (_difference(cast(Expr, new[b]), origins[node.var]) for b in (node.lo, node.hi))
            new[node] = integral_over(cast(Expr, new[node.body]), local[node.var], lo, hi)
        elif isinstance(node, Var) and node in origins:
            new[node] = whole[node]
        elif isinstance(node, Expr) and node in polynomials:
            places: dict[Node, Expr] = {}
            for v in (v for v in origins if v in node.free):
                axis = _fixed_axis(node, v, axes[v], polynomials[node])
                places[v] = whole[v] if axis is None else local[v]
                places.update({s: _difference(s, origins[v]) for s in axis or () if isinstance(s, Param)})
            new[node] = _replaced(node, places)
        else:
            unchanged = all(new[c] is c for c in node.children)
            new[node] = node if unchanged else remake(node, tuple([new[c] for c in node.children]))
    return cast(Expr, new[order[-1]])


def _fixed_axis(e: Expr, v: Var, axis: frozenset[Expr], groups: Sequence[Group]) -> frozenset[Expr] | None:
    """Returns the parameters that move together with the variable without changing a polynomial, and the variable."""
    if is_fixed(e, axis):
        return axis
    return next((frozenset(g) for g in groups if v in g and all(s is v or isinstance(s, Param) for s in g)), None)


def _replaced(e: Expr, places: Mapping[Node, Expr]) -> Expr:
    """Returns a polynomial with other symbols. Numbers that meet in a sum are added."""
    new: dict[Node, Node] = {}
    for node in postorder([e]):
        children = [new[c] for c in node.children]
        if node in places:
            new[node] = places[node]
        elif isinstance(node, Add):
            terms = [t for c in children for t in (c.children if isinstance(c, Add) else (c,))]
            new[node] = add(*cast("list[Expr]", terms))
        elif isinstance(node, Mul | Pow):
            new[node] = remake(node, tuple(children))
        else:
            new[node] = node
    return cast(Expr, new[e])


def _difference(e: Expr, origin: Expr) -> Expr:
    apart = add(e, mul(MINUS_ONE, origin))
    short = expanded(apart)
    return apart if short is None else short
