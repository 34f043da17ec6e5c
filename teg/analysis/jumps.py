"""The jump of an expression across a surface.

    jump_g(F) = F|g:=true - F|g:=false, all atoms of the surface g together

The jump is computed by rules instead of by subtracting two copies: jump(Σ) = Σ jump; jump(a·b) = jump(a)·b₁ + a₀·jump(b); jump(∫ₗʰ a) =
∫ₗʰ jump(a), or ∫_{l₁}^{h₁} a₁ - ∫_{l₀}^{h₀} a₀ where bounds jump; 0 where g does not occur. So `[x<t]·[x<t]`, `sin(2[x<t])` and
conditions inside conditions are right. On the surface u/|u| is 0/0, so its sides are the limits there (`teg.analysis.limits`). Linear
in the number of nodes that contain the surface. Bangaru et al. 2021, section 4,
differentiate each occurrence alone; the rule for the whole integrand is new here.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from itertools import combinations
from typing import Any, cast

from teg.analysis.calculus import factor_cofactors
from teg.analysis.coincidence import ZeroSet
from teg.analysis.implied import decided_on
from teg.analysis.kinks import Extremes
from teg.analysis.limits import Poles
from teg.analysis.polynomial import Point
from teg.analysis.singularities import fades_at
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.expr import FALSE, TRUE, ZERO, Add, And, Call, Compare, Cond, Const, Expr, Mul, Not, Or, Pow, Tuple, Where, called
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder, postorder_to
from teg.ir.simplify import add, conjunction, disjunction, mul, negation, sub, where
from teg.ir.traverse import rebuild, replace_node, rewrite

_FADING = called("sqrt", "pow", "log")
MOST_ALTERNATIVES = 16
"""The largest number of alternatives with one surface that are compared with each other."""
Flip = tuple[Cond, Cond]
"""Where a condition holds on the side g > 0 of a surface only, and where on the other side only."""


def _containing(root: Node, surface: Expr, kinks: Collection[Node] = ()) -> list[Node]:
    """Returns the nodes that contain the surface (outside of resolutions), children first; conditions of `kinks` do not count."""
    contains: dict[Node, bool] = {}
    order: list[Node] = []
    for node in postorder_to([root], Compare.bit):
        children = node.children[:1] if isinstance(node, Compare) else node.children[1:] if node in kinks else node.children
        contains[node] = (isinstance(node, Compare) and node.g is surface) or any([contains.get(c, False) for c in children])
        if contains[node]:
            order.append(node)
    return order


def _jumping(e: Expr, surface: Expr, poles: Poles) -> list[Node]:
    """Returns the nodes that contain the surface and may jump on it. A kink on it has one limit from both sides, and so has what is made of
    kinks, but for their quotients with what is 0 there."""
    order = _containing(e, surface)
    if any((isinstance(n, Call) and n.name in ("pow", "log")) or poles.has(n) or any(map(poles.has, n.children)) for n in order):
        return order
    extremes = Extremes()
    own = [n for n in order if isinstance(n, Where) and isinstance(n.condition, Compare) and n.condition.g is surface]
    kinks = {n for n in own if extremes.is_kink(n)}
    return _containing(e, surface, kinks) if kinks else order


def _assign(order: list[Node], surface: Expr, value: Cond, limit: Callable[[Node], Node] = lambda node: node) -> dict[Node, Node]:
    """Returns the nodes with every atom of the surface replaced by a truth value, and products by their limits."""
    new: dict[Node, Node] = {}
    for node in order:
        if isinstance(node, Compare) and node.g is surface:
            new[node] = value
        else:
            new[node] = limit(rebuild(node, tuple([new.get(c, c) for c in node.children])))
    return new


def assign(e: Node, surface: Expr, value: bool) -> Node:
    """Returns e with every atom of the surface replaced by its truth value."""
    order = _containing(e, surface)
    return _assign(order, surface, TRUE if value else FALSE).get(e, e)


def jump(e: Expr, surface: Expr) -> Expr:
    """Returns F|g:=true - F|g:=false of the whole expression."""
    poles = Poles(surface)
    order = _jumping(e, surface, poles)
    if not order or order[-1] is not e:
        return ZERO
    one, zero = (_assign(order, surface, side) for side in (TRUE, FALSE))
    limits = {n for n in order if isinstance(n, Mul | Where) and any([poles.has(v[n]) for v in (one, zero)])}
    if limits:
        one, zero = (_assign(order, surface, side, poles.limit) for side in (TRUE, FALSE))
    jumps: dict[Node, Expr] = {}
    flips = _flips(order, surface)

    def of(node: Node) -> Expr:
        return jumps.get(node, ZERO)

    def at(values: dict[Node, Node], node: Node) -> Any:
        return values.get(node, node)

    for node in order:
        if not isinstance(node, Expr):
            continue
        match node:
            case Add():
                jumps[node] = add(*(of(c) for c in node.children))
            case Mul() if node not in limits:
                jumps[node] = _product_jump(node, of, lambda c: at(one, c), lambda c: at(zero, c))
            case Where() if node not in limits:
                c1, c0 = at(one, node.condition), at(zero, node.condition)
                a1, a0, b1, b0 = (
                    at(one, node.then),
                    at(zero, node.then),
                    at(one, node.otherwise),
                    at(zero, node.otherwise),
                )
                if c1 is c0:
                    jumps[node] = where(c1, of(node.then), of(node.otherwise))
                elif c0 is FALSE and node.otherwise not in one:
                    jumps[node] = where(c1, sub(a1, b0), ZERO)
                elif c1 is FALSE and node.otherwise not in one:
                    jumps[node] = where(c0, sub(b1, a0), ZERO)
                elif c0 is TRUE and node.then not in one:
                    jumps[node] = where(c1, ZERO, sub(b1, a0))
                elif c1 is TRUE and node.then not in one:
                    jumps[node] = where(c0, ZERO, sub(a1, b0))
                elif a1 is a0 and b1 is b0 and (flip := flips.get(node.condition)) is not None:
                    jumps[node] = add(where(flip[0], sub(a1, b1), ZERO), where(flip[1], sub(b1, a1), ZERO))
                else:
                    jumps[node] = sub(where(c1, a1, b1), where(c0, a0, b0))
            case Tuple():
                jumps[node] = simplify.tuple_of(*(of(c) for c in node.children))
            case Integral() if node.lo not in one and node.hi not in one:
                jumps[node] = integral_over(of(node.body), node.var, node.lo, node.hi)
            case _:
                jumps[node] = sub(at(one, node), at(zero, node))
    return jumps[e]


def _flips(order: Sequence[Node], surface: Expr) -> dict[Node, Flip]:
    """Returns for conditions that contain the surface where they begin to hold when it is crossed, and where they cease to hold.

    Known for conditions that are made of atoms of the surface by negation, by `&` of which one part contains it, and by `|` of parts that
    exclude each other.
    """
    flips: dict[Node, Flip] = {}
    contains = set(order)
    for node in order:
        touched = [cast(Cond, c) for c in node.children if c in contains]
        if isinstance(node, Compare) and node.g is surface:
            flips[node] = TRUE, FALSE
        elif not isinstance(node, And | Or | Not) or not all(c in flips for c in touched):
            continue
        elif isinstance(node, Not):
            flips[node] = flips[node.operand][::-1]
        elif isinstance(node, And) and len(touched) == 1:
            rising, falling = (conjunction(*(flip if c in contains else c for c in node.children)) for flip in flips[touched[0]])
            flips[node] = rising, falling
        elif isinstance(node, Or) and len(touched) <= MOST_ALTERNATIVES and all(_exclude(u, v) for u, v in combinations(touched, 2)):
            sides = {c: [negation(v) for v in node.children if v not in contains and not _exclude(c, v)] for c in touched}
            both = [disjunction(*(conjunction(flips[c][way], *others) for c, others in sides.items())) for way in (0, 1)]
            flips[node] = both[0], both[1]
    return flips


def _exclude(u: Cond, v: Cond) -> bool:
    """Returns whether two conditions have a part and its negation."""
    parts = set(u.children if isinstance(u, And) else (u,))
    return any(negation(c) in parts for c in (v.children if isinstance(v, And) else (v,)))


def _product_jump(node: Mul, of: Any, one: Any, zero: Any) -> Expr:
    """Returns Σᵢ a₀…·jump(aᵢ)·…a₁, the telescoping product rule."""
    factors = node.children
    changing = [c for c in factors if of(c) is not ZERO]
    if len(changing) == 1:
        i = factors.index(changing[0])
        return mul(of(changing[0]), factor_cofactors(Mul.make(None, tuple(zero(c) for c in factors)))[i])
    ones = [one(c) for c in factors]
    terms = []
    before: Expr = ex.ONE
    after: list[Expr] = [ex.ONE] * (len(factors) + 1)
    for i in range(len(factors) - 1, -1, -1):
        after[i] = mul(ones[i], after[i + 1])
    for i, c in enumerate(factors):
        if of(c) is not ZERO:
            terms.append(mul(before, of(c), after[i + 1]))
        before = mul(before, zero(c))
    return add(*terms)


def vanishes_on(e: Expr, surface: Expr) -> bool:
    """Returns whether e is 0 wherever the surface g is, so that e·δ(g) = 0: the kinks of abs, min, max, and every continuous `where`."""
    if isinstance(e, Const):
        return e is ZERO
    if Poles(surface).has(e):  # 0/0, which the field takes for 0
        return False
    if (surface.kinds | e.kinds) & (Call.bit | Compare.bit | Integral.bit):  # |g| has no jump, whatever g is; nor has a condition on it
        without = cast(Expr, replace_node(e, surface, ZERO))
        if all(Point(trial).value(without) == 0 for trial in ("0", "1")):
            return True
    return ZeroSet(surface).annuls(e)


def surface_terms(body: Expr, surfaces: list[Expr]) -> list[tuple[Expr, Expr]]:
    """Returns pairs (g, jump_g(body)) for the surfaces whose jump does not vanish on them."""
    terms = []
    for g in surfaces:
        j = decided_on(Poles(g).without_decaying(jump(body, g)), g)
        if j is not ZERO and not vanishes_on(j, g) and not fades_at(j, g):
            terms.append((g, _at_edges(j, g)))
    return terms


def _at_edges(e: Expr, surface: Expr) -> Expr:
    """Returns an expression that is equal on a surface, with 0 for its roots, powers, and products with logarithms that tend to 0 there:
    where a root of the surface is found to rounding, they may be no numbers."""
    if not e.kinds & _FADING:
        return e
    order = postorder([e])
    may_fade = [
        n for n in order if _is_root(n) or (isinstance(n, Mul) and any(isinstance(f, Call) and f.name == "log" for f in n.children))
    ]
    divisors = set(postorder([n for n in order if isinstance(n, Pow) and n.exponent < 0])) if may_fade else set()
    zeros = {n for n in may_fade if n not in divisors and fades_at(cast(Expr, n), surface)}
    return cast(Expr, rewrite([e], lambda old, new: ZERO if old in zeros else new)[e]) if zeros else e


def _is_root(n: Node) -> bool:
    return isinstance(n, Call) and n.name in ("sqrt", "pow")
