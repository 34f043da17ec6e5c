"""Integrals over surfaces with kinks as sums over the regions between the kinks.

    ∫ [f(max(u, v)) > 0]·b   →   ∫ [u > v]·[f(u) > 0]·b  +  ∫ [u <= v]·[f(v) > 0]·b          u, v affine

The distance from a box, √(max(|x| - a, 0)² + max(|y| - b, 0)²), is a disk at each corner, half-planes at the sides, and 0 inside: surfaces
with closed forms, where the whole has none. So is the distance from a segment. An integral is divided if the surfaces with kinks become
planes or quadrics, and the regions are at most `MOST_REGIONS`. At the borders of regions nothing jumps. Cost: the number of regions.
"""

from __future__ import annotations

from typing import NamedTuple, cast

from teg.analysis.expanded import shorter_form
from teg.analysis.kinks import Kinks, kinks_of
from teg.analysis.polynomial import Shadow
from teg.analysis.proportional import Proportional
from teg.analysis.surfaces import atoms_of
from teg.ir.arrays import Ranged
from teg.ir.expr import FALSE, MINUS_ONE, TRUE, ZERO, And, Compare, Cond, Expr, Where
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, nodes_of
from teg.ir.simplify import add, conjunction, mul, negation, positive, where
from teg.ir.traverse import replace_node, rewrite, rewritten
from teg.passes.normalise.piecewise import alternatives
from teg.passes.normalise.squares import with_sizes
from teg.passes.normalise.thresholds import without_threshold

MOST_REGIONS = 64
"""The largest number of regions of an integral."""
MOST_DEGREE = 2
"""The largest degree of surfaces in a region: planes and quadrics have closed forms."""

Decision = tuple[Cond, tuple[tuple[Node, Node], ...]]
"""A condition, and pairs of a node and what it is where the condition holds."""


class Region(NamedTuple):
    """Conditions; what the integrand is where all of them hold, and the functions that were compared with 0 in it."""

    conditions: tuple[Cond, ...]
    body: Expr
    surfaces: tuple[Expr, ...]

    def part(self, decision: Decision) -> Region | None:
        """Returns the part of this region where a decision holds; None if it is empty by the form of its conditions."""
        condition, known = decision
        both = conjunction(*self.conditions, condition)
        if both is FALSE:
            return None
        new = rewrite([self.body, *self.surfaces], lambda old, node: next((v for k, v in known if k is old), node))
        body, *surfaces = (cast(Expr, with_sizes(new[e])) for e in (self.body, *self.surfaces))
        return Region(_parts(both), body, tuple(surfaces))


def with_regions(root: Expr) -> Expr:
    """Returns the program with such integrals as sums over regions. Its value is the same."""
    if not any(n.condition.free for n in nodes_of(Where, root)):
        return root
    borders = _Borders()

    def visit(_: Node, node: Node) -> Node:
        if not isinstance(node, Integral) or node.body.has_integral or node.body.has_delta or _has_loops(node.body):
            return node
        regions = borders.regions(node.body)
        parts = (where(conjunction(*r.conditions), r.body, ZERO) for r in regions)
        return add(*(integral_over(part, node.var, node.lo, node.hi) for part in parts)) if regions else node

    return rewritten(root, Integral.bit, visit)


class _Borders:
    """The planes between regions; those that are proportional are one."""

    def __init__(self) -> None:
        self._kinks = Kinks()
        self._planes = Proportional()

    def regions(self, body: Expr) -> list[Region]:
        """Returns the regions of an integrand in which its surfaces have no kinks; none if it has no kinks, or they do not become
        simple."""
        own = {n.condition for n in nodes_of(Where, body) if n.condition.free and self._kinks.sign(n)}
        bent = [a.g for a in atoms_of(body) if a not in own and a.resolution is None and len(a.g.free) > 1 and kinks_of(a.g)]
        waiting = [Region((), body, tuple(bent))] if bent else []
        done: list[Region] = []
        is_curved = False
        while waiting:
            region = waiting.pop()
            decisions = self._decisions(region)
            if len(done) + len(waiting) > MOST_REGIONS:
                return []
            if decisions:
                waiting += [part for d in reversed(decisions) if (part := region.part(d)) is not None]
                continue
            degrees = [_degree(f) for g in region.surfaces for f in self._smooth(g)]
            if any(d is None or d > MOST_DEGREE for d in degrees):
                return []
            is_curved = is_curved or MOST_DEGREE in degrees
            done.append(region)
        return done if is_curved else []

    def _smooth(self, g: Expr) -> list[Expr]:
        """Returns the smooth functions that a condition on g is one on: those of which g is an extreme."""
        parts = alternatives(g, self._kinks)
        return [f for part in parts for f in part] if isinstance(parts, list) else [g]

    def _decisions(self, region: Region) -> list[Decision]:
        """Returns decisions of which one holds everywhere, by which some kink is resolved; none if no kink is at planes."""
        found = [kink for g in region.surfaces for kink in kinks_of(g)]
        for kink in reversed(found):  # the largest first: max(x - a, -x - a, 0) has three regions
            if choices := self._choices(kink):
                return [(conjunction(*above), ((kink, operand),)) for operand, above in choices[1]]
            if isinstance(kink.condition, Compare) and (decisions := self._of_condition(kink.condition)):
                return decisions
        for kink in found:
            for atom in atoms_of(kink.condition):
                if not kinks_of(atom.g) and _degree(atom.g) in (0, 1):
                    side = self._side(atom.g)
                    return [(side, ((atom, TRUE),)), (negation(side), ((atom, FALSE),))]
        return []

    def _of_condition(self, atom: Compare) -> list[Decision]:
        """Returns the decisions of a condition on a function with one kink, as |x| > a; none for others."""
        inside = kinks_of(atom.g)
        choices = self._choices(inside[0]) if len(inside) == 1 else None
        if choices is None or not isinstance(found := alternatives(atom.g, self._kinks), list):
            return []
        largest = all(len(part) == 1 for part in found)
        values = [cast(Expr, replace_node(atom.g, inside[0], operand)) for operand, _ in choices[1]]
        if largest != choices[0] or any(_degree(v) not in (0, 1) for v in values):
            return []
        sides = [self._side(v) for v in values]
        if largest:
            rest, ones, all_sides, side = FALSE, sides, [negation(c) for c in sides], TRUE
        else:
            rest, ones, all_sides, side = TRUE, [negation(c) for c in sides], sides, FALSE
        decisions: list[Decision] = [
            (conjunction(c, *above), ((inside[0], operand), (atom, side))) for c, (operand, above) in zip(ones, choices[1], strict=True)
        ]
        return [*decisions, (conjunction(*all_sides), ((atom, rest),))]

    def _choices(self, kink: Where) -> tuple[bool, list[tuple[Expr, list[Cond]]]] | None:
        """Returns whether a function is a maximum of affine functions, not a minimum, and these with the conditions under which each is
        the extreme one; None for other functions."""
        found = alternatives(kink, self._kinks)
        if not isinstance(found, list):
            return None
        largest = all(len(part) == 1 for part in found)
        if not largest and len(found) > 1:
            return None
        operands = list(dict.fromkeys(f for part in found for f in part))
        if any(_degree(f) not in (0, 1) for f in operands):
            return None
        return largest, [(f, self._above(i, operands, largest)) for i, f in enumerate(operands)]

    def _above(self, i: int, operands: list[Expr], largest: bool) -> list[Cond]:
        """Returns the conditions under which an operand is the extreme one."""
        conditions = []
        for j in range(len(operands)):
            if i != j:
                first, second = operands[min(i, j)], operands[max(i, j)]
                side = self._side(add(first, mul(MINUS_ONE, second)))
                conditions.append(side if (i < j) == largest else negation(side))
        return conditions

    def _side(self, g: Expr) -> Cond:
        """Returns g > 0 as a condition on the plane that stands for it; where g is 0, a set of measure 0, it may hold as well."""
        plane, same = self._planes.representative(g if (short := shorter_form(g)) is None else short)
        return positive(plane) if same else negation(positive(plane))


def _degree(g: Expr) -> int | None:
    """Returns the degree of a surface in all variables together, without the function of a threshold; None if it is no polynomial."""
    level = without_threshold(g)
    return Shadow(tuple(g.free)).degree(g if level is None else level[1]) if g.free else 0


def _has_loops(body: Expr) -> bool:
    """Returns whether an integrand has sums or choices over an index, which conditions in them may name."""
    return body.kinds & Ranged.bit != 0


def _parts(condition: Cond) -> tuple[Cond, ...]:
    """Returns the conditions that hold together where this one does."""
    return () if condition is TRUE else condition.children if isinstance(condition, And) else (condition,)
