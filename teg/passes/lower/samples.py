"""Rules that know no breaks: nests of integrals as means over points of the unit cube ("montecarlo", "qmc"), and the midpoint rule.

    ∫ₗʰ F(x) dx = E[(h - l)·F(l + (h - l)·u)],  u uniform in (0, 1)

A nest becomes one `Sample` with a coordinate a variable; bounds inside may depend on variables outside. An integral belongs to the nest
around it if that is linear in it: it stands there in a sum, in a branch, or as the only integral of a product. One that stands elsewhere
(inside sin, in a condition, in a bound, beside another one in a product) cannot be replaced by one value of its integrand: it is
integrated to the tolerance, by the rule "auto", at every point. Integrals in one sum may share a coordinate, those inside each other
may not. Nests with the same guard share the points, so that value and gradient are one loop.

Conditions are decided at the points. A tail is brought to (0, 1) by

    (l, ∞)    x = l + u/(1 - u)                         dx = du/(1 - u)²
    (-∞, h)   x = h - (1 - u)/u                         dx = du/u²
    (-∞, ∞)   x = t/(1 - t²), t = 2u - 1                dx = 2(1 + t²)/(1 - t²)² du
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import inf
from typing import cast

from teg.analysis.settings import Integration
from teg.analysis.surfaces import binders_inside
from teg.errors import OptionError
from teg.ir.expr import Add, Compare, Const, Expr, Mul, Where
from teg.ir.integral import Integral, masses_of
from teg.ir.node import Node, postorder, postorder_to
from teg.numerics.sobol import DIMENSIONS
from teg.passes.lower.emit import Emitter
from teg.passes.lower.levels import Level, Plan
from teg.program import Arg, Integrate, Midpoint, Sample

SAMPLED = ("montecarlo", "qmc")
SAMPLES, MIDPOINTS, DEEP_SAMPLES = 2**14, 256, 2**17
"""The default orders of rules: samples in all, points a variable, and samples of a nest that is too deep for another rule."""


class Samples:
    """Integrates without breaks, by one of these rules, or a nest that is too deep for another one.

    `deciding` holds the integrals in conditions and bounds.
    """

    def __init__(self, out: Emitter, plan: Plan, how: Integration, is_too_deep: Callable[[Integral], bool]) -> None:
        self.out, self.plan, self.how, self.is_too_deep = out, plan, how, is_too_deep
        self.deciding: set[Node] = set()

    def is_sampled(self, node: Integral, level: Level) -> bool:
        """Returns whether an integral of this level is the outermost one of a nest that is sampled."""
        if level.coordinates is not None or node in self.deciding:
            return False
        return self.how.rule in SAMPLED or (self.how.rule == "auto" and level.var is None and self.is_too_deep(node))

    def is_unbroken(self, node: Integral, level: Level) -> bool:
        """Returns whether an integral of this level has no breaks."""
        return self.how.rule == "midpoint" or self.is_sampled(node, level)

    # -- nests ---------------------------------------------------------------------------------------------------------

    def sample(self, group: Sequence[Integral], home: Level, when: str | None) -> tuple[Arg, ...]:
        """Returns the means of nests over the same points."""
        nests = [nest(node, self.deciding) for node in group]
        dimensions = 1 + max((d for found in nests for d in found.values()), default=0)
        if self.how.rule != "montecarlo" and dimensions > DIMENSIONS:
            hint = 'rule="montecarlo" takes any number'
            raise OptionError(f'rule="qmc" takes up to {DIMENSIONS} integrals inside each other, here are {dimensions}', group[0], hint)
        points = tuple(self.out.fresh("x") for _ in range(dimensions))
        loop = Level(None, None, 0)
        values = []
        for node, found in zip(group, nests, strict=True):
            inside = home.inside(node.var, points[0])
            inside.block, inside.computed = loop.block, loop.computed
            inside.coordinates = {i: points[d] for i, d in found.items()}
            values.append(self._at_point(node, points[0], home, inside))
        results = tuple(self.out.fresh("v") for _ in group)
        block = tuple(loop.block)
        kind = self.how.rule if self.how.rule in SAMPLED else "qmc"
        count = (self.how.order or SAMPLES) if self.how.rule in SAMPLED else DEEP_SAMPLES
        home.block.append(Sample(points, count, kind, self.how.seed, block, tuple(values), results, when=when))
        return results

    def sample_inside(self, node: Integral, home: Level) -> None:
        """Gives an integral of a nest a name, at the present point."""
        inside = home.inside(node.var, "")
        inside.block, inside.computed = home.block, home.computed
        home.names[node] = self._at_point(node, cast("dict[Integral, str]", home.coordinates)[node], home, inside)

    def _at_point(self, node: Integral, u: str, home: Level, inside: Level) -> Arg:
        """Returns the integrand at the coordinate u in (0, 1), times dx/du."""
        inside.names[node.var], weight = self._place(node, u, home, inside)
        self.plan(inside, [node.body])
        value = self.out.number(node.body, inside)
        return value if weight == 1.0 else self.out.assign(inside, "mul", weight, value)

    def _place(self, node: Integral, u: str, home: Level, inside: Level) -> tuple[Arg, Arg]:
        """Returns the variable at u, and dx/du."""

        def put(op: str, *args: Arg) -> str:
            return self.out.assign(inside, op, *args)

        backwards = is_infinite(node.lo, inf) or is_infinite(node.hi, -inf)
        lo, hi = (node.hi, node.lo) if backwards else (node.lo, node.hi)
        from_below, to_above = is_infinite(lo, -inf), is_infinite(hi, inf)
        if not from_below and not to_above:
            return self._stretched(self.out.number(lo, home), self.out.number(hi, home), u, home, inside)
        rest = put("sub", 1.0, u)
        if from_below and to_above:
            t = put("sub", put("mul", 2.0, u), 1.0)
            below = put("mul", 4.0, u, rest)  # 1 - t², without cancellation
            x, rate = put("div", t, below), put("div", put("add", 2.0, put("mul", 2.0, t, t)), put("mul", below, below))
        elif to_above:
            x, rate = put("add", self.out.number(lo, home), put("div", u, rest)), put("div", 1.0, put("mul", rest, rest))
        else:
            x, rate = put("sub", self.out.number(hi, home), put("div", rest, u)), put("div", 1.0, put("mul", u, u))
        return x, put("neg", rate) if backwards else rate

    def _stretched(self, lo: Arg, hi: Arg, u: str, home: Level, inside: Level) -> tuple[Arg, Arg]:
        """Returns the same between finite bounds: l + (h - l)·u and h - l."""
        if isinstance(lo, str) or isinstance(hi, str):
            length: Arg = hi if lo == 0.0 else self.out.assign(home, "sub", hi, lo)
        else:
            length = hi - lo
        way = u if length == 1.0 else self.out.assign(inside, "mul", length, u)
        return way if lo == 0.0 else self.out.assign(inside, "add", lo, way), length

    # -- the midpoint rule ---------------------------------------------------------------------------------------------

    def midpoint(self, group: Sequence[Integral], home: Level, when: str | None) -> tuple[Arg, ...]:
        """Returns integrals of one variable over the same bounds by the midpoint rule, as one loop."""
        node = group[0]
        for bound in (node.lo, node.hi):
            if is_infinite(bound, inf) or is_infinite(bound, -inf):
                raise OptionError('rule="midpoint" needs finite bounds', node, 'rule="auto" and rule="qmc" substitute tails')
        lo, hi = self.out.number(node.lo, home), self.out.number(node.hi, home)
        var = self.out.fresh("x")
        level = home.inside(node.var, var)
        bodies = [i.body for i in group]
        self.plan(level, bodies)
        values = tuple(self.out.number(b, level) for b in bodies)
        results = tuple(self.out.fresh("v") for _ in group)
        home.block.append(
            Integrate(var, lo, hi, (), (), None, tuple(level.block), values, results, Midpoint(self.how.order or MIDPOINTS), when)
        )
        return results


def is_infinite(bound: Expr, value: float) -> bool:
    """Returns whether a bound is that infinity."""
    return isinstance(bound, Const) and bound.data == value


def deciding_integrals(roots: Iterable[Expr]) -> set[Node]:
    """Returns the integrals in conditions and bounds: a small error there is not a small error of the program."""
    found: set[Node] = set()
    for node in reversed(postorder_to(roots, Integral.bit)):
        if node in found or isinstance(node, Compare):
            found.update(node.children)
        elif isinstance(node, Integral):
            found.update(node.children[1:])
    return found


def nest(root: Integral, deciding: set[Node]) -> dict[Integral, int]:
    """Returns the inner integrals that are sampled together with `root`, and their coordinates 1, 2, …: larger than those around them."""
    order = postorder([root.body])
    bound = binders_inside(root)
    holds: dict[Node, bool] = {}  # integrals of the nest, in any position
    for node in order:
        mine = isinstance(node, Integral)
        holds[node] = bool(node.free & bound) if mine else any(holds[c] for c in node.children)
    depth: dict[Node, int] = {root.body: 1}
    aside = set(deciding)
    for node in reversed(order):
        if not holds[node] or node not in depth:  # below an integral that does not depend on the nest
            continue
        linear = () if node in aside else _linear(node, holds)
        below = depth[node] + (isinstance(node, Integral) and masses_of(node.body, node.var) is None)
        for child in node.children:
            if holds[child]:
                depth[child] = max(depth.get(child, 0), below)
        aside.update(child for i, child in enumerate(node.children) if i not in linear)
    return {
        node: depth[node]
        for node in order
        if isinstance(node, Integral) and holds[node] and node in depth and node not in aside and masses_of(node.body, node.var) is None
    }


def _linear(node: Node, holds: dict[Node, bool]) -> Sequence[int]:
    """Returns the places of the children in which a node is linear, if they hold integrals of the nest."""
    match node:
        case Integral():
            return (0,)
        case Where():
            return [i for i, child in enumerate(node.children) if child is not node.condition]
        case Add():
            return range(len(node.children))
        case Mul():
            holding = [i for i, child in enumerate(node.children) if holds[child]]
            return holding if len(holding) == 1 else ()
        case _:
            return ()
