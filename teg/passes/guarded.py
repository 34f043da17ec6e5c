"""The guard of an adaptive integral: bounds of its integrands and of their sharp values over a box, for `teg.program` (Integrate).

A feature that lies between all nodes changes no value that the rule has; but the node it comes from (`teg.sharp`) has an enclosure over
the gap, to be compared with its values at the nodes beside it. Of integrals inside, the largest value at their nodes is taken (`peaks`),
and what the sharp value is at the ends of their range: a ridge that leaves the domain has a layer there.
"""

from __future__ import annotations

from collections.abc import Sequence

from teg.expr import ONE, Expr, Var
from teg.intervals import Enclosure
from teg.passes.emit import Emitter, Level
from teg.program import Adaptive, Guard
from teg.quadrature import gauss_legendre
from teg.sharp import Sharp, bounds, sizes
from teg.traverse import fresh

CUBIC_RATE = 1.5
"""How much faster than on a straight line a cubic's place goes."""


def widest_gap(rule: Adaptive) -> float:
    """The largest part of a piece that lies between neighbouring nodes, or beside an end, on a straight line or a cubic."""
    widest = 0.0
    for nodes in {rule.first, rule.order}:
        places = [-1.0, *gauss_legendre(nodes)[0], 1.0]
        widest = max(widest, *(0.5 * (b - a) for a, b in zip(places, places[1:], strict=False)))
    return widest * (CUBIC_RATE if rule.cubic else 1.0)


def guard_of(
    emitter: Emitter, x: Var, bodies: Sequence[Expr], sharp: Sequence[Sharp], level: Level, home: Level
) -> Guard | None:
    """The guard of an integral over x with these sharp values; None where none of them has bounds."""
    taken = frozenset[Var]().union(*(b.free for b in bodies), *(s.value.free for s in sharp))
    left, right = fresh(x.name + "₋", taken), fresh(x.name + "₊", taken)
    boxed = Enclosure({x: (left, right)})
    known = [(s, b) for s in sharp if (b := bounds(s, boxed)) is not None]
    if not known:
        return None
    seen = tuple(emitter.number(s.value if s.wave is None else ONE, level) for s, _ in known)
    left_name, right_name = emitter.fresh("x"), emitter.fresh("x")
    at_left = home.inside(left, left_name)
    at_both = at_left.inside(right, right_name)
    extents = tuple(emitter.number(e, at_both) for e in sizes(bodies, boxed))
    upper = tuple(emitter.number(b[0], at_both) for _, b in known)
    lower = tuple(emitter.number(b[1], at_both) for _, b in known)
    return Guard(left_name, right_name, (*at_left.block, *at_both.block), extents, upper, lower, seen)
