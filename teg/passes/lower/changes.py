"""What a small value can change: bounds of the part of an integrand that comes from one of its nodes, for guards.

A power, an exponential or a cosh that is at most s in size on a box changes an integrand there by no more than s times the largest
derivative by that node. The size of the whole integrand is no such bound: (u/r)²⁰ may be 10⁻³⁰ in a gap, beside a constant; and natural
bounds of an inner integral are those of its whole range, although a ridge that leaves it at an end has a known size there.

An integrable singularity, as 1/√g, has no bound, but its integral has one: what is nearer to g = 0 than NEAR_ROOT times the largest |g|
holds a negligible part of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.intervals import Enclosure
from teg.analysis.polynomial import value_children
from teg.analysis.sharp import LARGEST, range_of, sizes
from teg.analysis.surfaces import binders_inside
from teg.errors import NotDifferentiableError
from teg.ir.expr import ZERO, Add, Call, Const, Expr, Mul, Pow, Var, Where, called, calls_of, const
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import call, mul, positive, sub, where
from teg.ir.traverse import fresh, rewrite_below

SIZES = ("pow", "exp", "cosh", "sinh")
"""Functions whose values are no larger than their sharp values, as those of powers."""
CURVED = frozenset(("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "erf", "erfc", "sqrt", "pow"))
"""Functions whose derivative depends on their argument."""
_INFINITY = const(math.inf)
NEAR_ROOT = 2.0**-48
"""Where |g| is below this part of its largest value in a box, a power of it that is integrable counts as it is there."""


class Changes:
    """How much integrands change by a node of theirs, or of an inner integral, that is small: bounds over a box."""

    def __init__(self, bodies: Sequence[Expr], boxed: Enclosure) -> None:
        self.bodies, self.boxed = bodies, boxed
        taken = frozenset[Var]().union(*(e.free for e in bodies), *(binders_inside(e) for e in bodies), boxed.box)
        self.value = fresh("value", taken)
        self.known: dict[tuple[Expr, ...], Expr] = {}
        self._curved: dict[tuple[Expr, ...], set[Node]] = {}

    def of(self, node: Expr, most: Expr, inner: Integral | None = None) -> Expr:
        """Returns the bound where the node, in an inner integral if one is given, is at most so large; infinite where none is known.

        Beside log u, half of a power of u belongs to the logarithm: the product has a bound.
        """
        if not (isinstance(node, Pow) or (isinstance(node, Call) and node.name in SIZES)):
            return _INFINITY
        part: Expr = self.value
        base = cast(Expr, node.children[0])
        if any(n.children[0] is base for n in calls_of(called("log"), *self.bodies)):
            exponent = const(float(node.exponent)) if isinstance(node, Pow) else node.children[-1]
            part, most = mul(self.value, call("pow", base, mul(const(0.5), exponent))), call("sqrt", most)
        key = (node,) if inner is None else (node, inner)
        if key not in self.known:
            self.known[key] = self._rate(self.bodies, node, part, self.boxed) if inner is None else self._inside(inner, node, part)
        return mul(self.known[key], most)

    def _inside(self, inner: Integral, node: Expr, part: Expr) -> Expr:
        """Returns the bound for a node of an inner integral, where the value is 1."""
        low, high = range_of(inner, self.boxed.box)
        if low is None or high is None:
            return _INFINITY
        rate = self._rate([inner.body], node, part, Enclosure({**self.boxed.box, inner.var: (low, high)}))
        return mul(self._rate(self.bodies, inner, self.value, self.boxed), sub(high, low), rate)

    def _rate(self, bodies: Sequence[Expr], node: Expr, part: Expr, boxed: Enclosure) -> Expr:
        """Returns a bound of the derivatives by the value, with `part`, where it stands, for a node; infinite where they depend on it."""
        if tuple(bodies) not in self._curved:
            self._curved[tuple(bodies)] = curved_nodes(bodies)
        if node in self._curved[tuple(bodies)]:
            return _INFINITY
        new = rewrite_below(bodies, lambda n: part if n is node else None)
        try:
            rates = [slope(cast(Expr, new[b]), self.value) for b in bodies]
        except NotDifferentiableError:  # it stands in an inner integral
            return _INFINITY
        if any(self.value in rate.free for rate in rates):
            return _INFINITY
        bounded = rewrite_below(rates, lambda n: _bound_of_singular(n, boxed))
        return reduce(lambda a, b: call("max", a, b), sizes([cast(Expr, bounded[rate]) for rate in rates], boxed))


def curved_nodes(bodies: Sequence[Expr]) -> set[Node]:
    """Returns the nodes in powers and functions, in value position: no body is linear in one of them. Linear."""
    curved: set[Node] = set()
    for node in reversed(postorder(bodies)):
        if node in curved or isinstance(node, Pow) or (type(node) is Call and node.name in CURVED):
            curved.update(value_children(node) if isinstance(node, Add | Mul | Pow | Where) or type(node) is Call else ())
    return curved


def _bound_of_singular(node: Node, boxed: Enclosure) -> Expr | None:
    """Returns a bound of a power of g between -1 and 0 over a box, but for what is very near to g = 0, if |g| has a largest value there;
    None for other nodes."""
    match node:
        case Pow(base=Call(name="sqrt" | "root") as root):
            g, exponent = root.children[0], 0.5 * float(node.exponent)
        case Pow(base=Call(name="pow", children=(g, Const() as k))):
            exponent = k.data * float(node.exponent)
        case Call(name="pow", children=(g, Const() as k)):
            exponent = k.data
        case _:
            return None
    if not -1.0 < exponent < 0.0 or g.has_integral:
        return None
    least, most = boxed.of(call("magnitude", g))
    near = where(positive(sub(const(LARGEST), most)), mul(const(NEAR_ROOT), most), ZERO)
    return call("pow", call("max", least, near), const(exponent))
