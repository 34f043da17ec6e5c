"""Applications of functions, written out where a pass has to see the body; slots in the place of the other functions.

    f(e, …)   →   body[e, …/formals]

A body that is not opaque (`teg.function`) is written out. So is an application in a condition, a bound, a δ, an argument of floor and
the like, a divisor, or under a root or logarithm, because its jumps or singularities must be found there. So is an application in an
integral with an infinite bound, whose tails have to be measured; where features of the body may be narrow (`teg.analysis.sharp`), as far
as that is known in numbers; and where an exponential in the body becomes one of a polynomial of degree 2 or more in the variables,
because narrow peaks must be known. If the arguments are linear and the exponent quadratic, a visible exponential is enough,

    f(e)   →   h(e, exp(q(e)))

with h and the exponent q as functions, which have slots like other functions. Everything else stays.

The first of all passes; idempotent; linear in the program and the bodies written out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import cast

from teg.analysis.bodies import everywhere_written_out, with_peaks_outside, written_out
from teg.analysis.intervals import Interval
from teg.analysis.polynomial import Degrees
from teg.analysis.sharp import numeric_range, sharp_values, tame_ones
from teg.analysis.tails import is_unbounded
from teg.ir.expr import Add, Call, Compare, Const, Expr, Pow, Var, called, calls_of, const
from teg.ir.function import Apply, Function, Slot, degrees_in, functions_of
from teg.ir.integral import Delta, Integral, PointMasses
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call
from teg.ir.traverse import parameters, rebuild, rewrite

_SINGULAR = frozenset(
    (
        "sqrt",
        "root",
        "log",
        "log1p",
        "erfinv",
        "erfcinv",
        "pow",
        "tan",
        "asin",
        "acos",
        "atan2",
        "floor",
        "ceil",
        "round",
        "mod",
        "magnitude",
        "min",
        "max",
        "chosen",
        "exact",
    )
)


WIDEST = 0.25
"""The largest fraction of a piece between two nodes, for most rules."""
STEEP = "its exponential may be a narrow peak"
NARROW = "a feature of it may be narrow"
PEAKED = "its exponential may be a narrow peak, which alone is written out"


def write_out(e: Expr) -> Expr:
    """Returns the expression with those applications written out that a pass has to look into, and log1p as a logarithm."""
    while any(reasons(e).values()):
        e = _rewritten(e)
    return _with_plain_logarithms(e)


def _with_plain_logarithms(e: Expr) -> Expr:
    """Returns the expression with log(1 + u) for log1p(u), where u has variables: passes must see where 1 + u vanishes.

    Lowering computes log(1 + u) as log1p(u).
    """
    if not any(n.free for n in calls_of(called("log1p"), e)):
        return e

    def visit(old: Node, new: Node) -> Node:
        return call("log", _one_more(new.children[0])) if isinstance(new, Call) and new.name == "log1p" and new.free else new

    return cast(Expr, rewrite([e], visit)[e])


def _one_more(u: Expr) -> Expr:
    """Returns 1 + u, with one number in a sum: 1 + (x - 1) is x."""
    terms = u.children if isinstance(u, Add) else (u,)
    number = math.fsum((1.0, *(c.data for c in terms if isinstance(c, Const))))
    return add(const(number), *(c for c in terms if not isinstance(c, Const)))


def reasons(root: Expr) -> dict[Apply, str]:
    """Returns the applications in an expression, each with the reason why it must be written out somewhere; "" if it need not be."""
    if not root.kinds & Apply.bit:
        return {}
    order = postorder([root])
    why = _own_reasons(order)
    places: dict[Node, str] = {}
    for place, child in _looked_into(order) if why else ():
        places.setdefault(child, place)
    for node in reversed(order if places else ()):  # a node comes after all nodes that contain it
        if node in places:
            for child in node.children:
                places.setdefault(child, places[node])
            if isinstance(node, Apply) and node in why:
                why[node] = why[node] or f"it stands in {places[node]}"
    return why


def _own_reasons(order: list[Node]) -> dict[Apply, str]:
    """Returns the applications among nodes, each with the reason why it must be written out wherever it stands."""
    why = {n: n.callee.obstacle for n in order if isinstance(n, Apply) and isinstance(n.callee, Function)}
    for integral in order if why else ():
        if isinstance(integral, Integral) and is_unbounded(integral):
            for node in postorder([integral.body]):
                if isinstance(node, Apply) and node in why and integral.var in node.free:
                    why[node] = why[node] or "it stands in an integral with an infinite bound"
    steep = {n: f.facts.exponent for n in why if not why[n] and n.free and isinstance(f := n.callee, Function) and f.inline is None}
    if any(steep.values()):
        degrees = degrees_in(order, {n for n in order if isinstance(n, Var)})
        for node, exponent in steep.items():
            if exponent * max((degrees[c] or 0 for c in node.children), default=0) > 1:
                why[node] = PEAKED if exponent == 2 and all(degrees[c] in (0, 1) for c in node.children) else STEEP
    smooth = [n for n in why if not why[n] and n.free and isinstance(f := n.callee, Function) and f.inline is None and f.degree is None]
    why.update(dict.fromkeys(_narrow_ones(smooth, order), NARROW))
    return why


def _narrow_ones(smooth: list[Apply], order: list[Node]) -> Iterator[Apply]:
    """Yields the applications whose bodies may have narrow features, if ranges and bodies are known in numbers.

    Nodes may miss such features, so their bounds over an interval must be known.
    """
    ranges: dict[Var, Interval] = {}
    for node in reversed(order if smooth else ()):
        if isinstance(node, Integral):
            ranges = numeric_range(node, ranges)
    degrees = Degrees()
    for node in smooth:
        body = written_out(node, node.children)
        for x in (v for v in node.free if v in ranges):
            known = [s for s in sharp_values([body], x, frozenset(), degrees, 2) if not parameters(s.node)]
            if not all(tame_ones(known, ranges, x, WIDEST)):
                yield node
                break


def _looked_into(order: list[Node]) -> Iterator[tuple[str, Node]]:
    """Yields the places where applications are written out, with a name for each."""
    for node in order:
        match node:
            case Compare():
                yield "a condition", node.g
            case Integral():
                yield "a bound", node.lo
                yield "a bound", node.hi
            case Delta() | PointMasses():
                yield "a delta", node.children[0]
            case Pow() if _is_looked_into(node):
                yield "a divisor", node.base
            case Call() if _is_looked_into(node):
                for child in node.children:
                    yield f"an argument of {node.name}", child
            case _:
                pass


def _is_looked_into(node: Node) -> bool:
    """Returns whether passes have to see the bodies of all applications below the node."""
    match node:
        case Delta() | PointMasses():
            return True
        case Pow():
            return node.exponent < 0
        case Call():
            return node.name in _SINGULAR and not isinstance(node, Apply)
        case _:
            return False


def _rewritten(root: Expr) -> Expr:
    """Returns the expression with one level written out: everywhere inside of visible places, elsewhere the applications with a reason."""
    order = postorder([root])
    own = _own_reasons(order)
    everywhere = everywhere_written_out([child for _, child in _looked_into(order)])
    new: dict[Node, Node] = {}
    for node in order:
        match node:
            case Compare():
                children = (everywhere[node.g], *(new[c] for c in node.children[1:]))
            case Integral():
                children = (new[node.body], everywhere[node.lo], everywhere[node.hi])
            case _ if _is_looked_into(node):
                children = tuple(everywhere[c] for c in node.children)
            case _:
                children = tuple(new[c] for c in node.children)
        outside = with_peaks_outside(node, children) if isinstance(node, Apply) and own.get(node) == PEAKED else None
        if outside is not None:
            new[node] = outside
        else:
            new[node] = written_out(node, children) if isinstance(node, Apply) and own.get(node) else rebuild(node, children)
    return cast(Expr, new[root])


# -- slots ---------------------------------------------------------------------------------------------------------------


def with_slots(e: Expr) -> tuple[Expr, tuple[Function, ...]]:
    """Returns the expression with slots in the place of its functions, numbered in order of appearance, and the functions."""
    if not functions_of(e):
        return e, ()
    slots: dict[Function, Slot] = {}
    new: dict[Node, Node] = {}
    for node in postorder([e]):
        children = tuple(new[c] for c in node.children)
        new[node] = rebuild(node, children)
        if isinstance(node, Apply) and isinstance(node.callee, Function):
            f = node.callee
            slot = slots.setdefault(f, Slot.make((len(slots), f.formal, f.arity, f.degree), ()))
            new[node] = Apply.make((slot, node.derivative), children)
    return cast(Expr, new[e]), tuple(slots)


def without_slots(e: Expr, functions: tuple[Function, ...]) -> Expr:
    """Returns the expression with functions in the place of slots."""
    new: dict[Node, Node] = {}
    for node in postorder([e]):
        children = tuple(new[c] for c in node.children)
        new[node] = rebuild(node, children)
        if isinstance(node, Apply) and isinstance(node.callee, Slot):
            new[node] = Apply.make((functions[node.callee.number], node.derivative), children)
    return cast(Expr, new[e])
