"""The choice of a rule and its number of nodes for each integral.

Gauss with as many nodes as a polynomial, or one in sines and cosines, between known breaks needs; an exact rule of an intrinsic; adaptive
for all others, with a tighter tolerance inside, and fewer first nodes for a larger tolerance. A fixed order is an adaptive rule that
accepts everything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from teg.analysis.breaks import BreakAnalysis
from teg.analysis.settings import Integration
from teg.analysis.tails import is_unbounded
from teg.analysis.waves import gauss_nodes
from teg.ir.expr import Compare, Const, Expr
from teg.ir.integral import Integral, masses_of
from teg.ir.node import Node, nodes_of, postorder
from teg.passes.lower.intrinsic import CLOSED_FORM, ExactRule
from teg.passes.lower.means import Mean, mean_of
from teg.program import Adaptive, Gauss, Rule

MAX_GAUSS = 24
TIGHTEST = 1e-14
ORDERS = ((1e-6, 6, 12), (0.5e-10, 8, 16), (1e-13, 10, 16), (0.0, 10, 18))
"""By tolerance: the nodes of the first look at a piece (OUTER more for an inner integral, twice that for an adaptive one) and of the
intervals after it. A first look that is not accepted is lost, with all evaluations of the integrals inside."""
OUTER = 2
MAX_NEST = 6
"""The largest depth of nested adaptive integrals; deeper nests are sampled."""
FIXED = 16
"""The default number of nodes of the rule "gauss"."""
INNER_TIGHTER = 0.1
"""An inner integral is computed to a tenth of its tolerance, so that the outer one sees a smooth function."""


class Rules:
    """The rules of the integrals of one program; `exact` are those of intrinsics."""

    def __init__(self, how: Integration, exact: Sequence[ExactRule] = (), differentiated: Sequence[Expr] = ()) -> None:
        self.how, self.analysis = how, BreakAnalysis(how.max_roots, differentiated)
        self._exact = {e.rule: e for e in exact}
        self._known: dict[tuple[Integral, int], tuple[Rule, str]] = {}

    def of(self, node: Integral, depth: int) -> Rule:
        """Returns the rule of an integral at that depth."""
        if (node, depth) not in self._known:
            self._known[node, depth] = self._choose(node, depth)
        return self._known[node, depth][0]

    def reason(self, node: Integral, depth: int) -> str:
        """Returns the reason for that rule."""
        self.of(node, depth)
        return self._known[node, depth][1]

    def _choose(self, node: Integral, depth: int) -> tuple[Rule, str]:
        how, bounded = self.how, not is_unbounded(node)
        degree = None if how.rule == "adaptive" else self.analysis.degree(node)
        most = (how.order or FIXED) if how.rule == "gauss" else MAX_GAUSS
        if degree is not None and degree // 2 + 1 <= most and bounded:
            return Gauss(degree // 2 + 1), f"a polynomial of degree {degree} between known breaks"
        nodes = gauss_nodes(node) if how.rule == "auto" and bounded and self.analysis.of(node).complete else None
        if nodes is not None:
            return Gauss(nodes), "a polynomial in sines and cosines between known breaks"
        if how.closed_forms and self._has_mean(node):
            return Mean(1), "an antiderivative is known"
        for intrinsic in self._exact.values() if bounded else ():
            if (rule := intrinsic.match(node, self.analysis)) is not None:
                return rule, "the shape of an intrinsic"
        breaks = self.analysis.of(node)
        cubic, closed = breaks.rooted, not breaks.complete
        if how.rule == "gauss":
            return Adaptive(math.inf, most, most, cubic), f"{most} nodes are asked for"
        tol = max(how.tol * INNER_TIGHTER**depth, TIGHTEST)
        if how.order is not None:
            return Adaptive(tol, how.order, how.order + 8, cubic, closed), f"{how.order} nodes for the first look are asked for"
        _, first, order = next(row for row in ORDERS if tol >= row[0])
        first += OUTER * self._inside(node, depth)
        return Adaptive(tol, first, order, cubic, closed), "no exact rule is known" if how.rule == "auto" else "asked for"

    def _inside(self, node: Integral, depth: int) -> int:
        """Returns 0 for an integrand without integrals, 1 for one with integrals, 2 if one of them is adaptive."""
        if not node.body.has_integral:
            return 0
        inside = [n for n in postorder([node.body]) if isinstance(n, Integral) and masses_of(n.body, n.var) is None]
        return bool(inside) + any(isinstance(self.of(n, depth + 1), Adaptive) for n in inside)

    def _has_mean(self, node: Integral) -> bool:
        """Returns whether an integrand has a mean in closed form, its conditions being constant on each piece."""
        breaks = self.analysis.of(node)
        if not breaks.complete or (means := mean_of(node.body, node.var)) is None:
            return False
        if is_unbounded(node) and (means.gaussians is None or not _is_ascending(node)):
            return False
        return all(n.g in breaks.handled for n in postorder([node.body]) if isinstance(n, Compare) and node.var in n.free)

    def title(self, rule: Rule) -> str:
        """Returns the name of a rule in reports."""
        match rule:
            case Mean():
                return CLOSED_FORM
            case Gauss():
                return "Gauss, exact"
            case Adaptive() if rule.tol == math.inf:
                return f"Gauss, {rule.order} nodes"
            case Adaptive():
                return f"adaptive to {rule.tol:.0e}" + (", smooth ends" if rule.cubic else "")
            case _ if type(rule) in self._exact:
                return self._exact[type(rule)].title
            case _:
                raise AssertionError(f"no integral has the rule {rule}")

    def kind(self, node: Integral, depth: int) -> object:
        """Returns a key that is equal for integrals that can share a loop if everything else agrees."""
        rule = type(self.of(node, depth))
        return (rule, self._exact[rule].key(node, self.analysis)) if rule in self._exact else rule

    def shared(self, group: Sequence[Integral], depth: int) -> Rule:
        """Returns one rule for all integrals of a loop, which are of one kind."""
        rules = [self.of(node, depth) for node in group]
        first = rules[0]
        if type(first) in self._exact:
            return self._exact[type(first)].shared(rules)
        if isinstance(first, Adaptive):
            adaptive = cast(list[Adaptive], rules)
            flags = {name: any(getattr(r, name) for r in adaptive) for name in ("cubic", "closed")}
            return replace(first, first=max(r.first for r in adaptive), **flags)
        return max(rules, key=lambda r: cast(Gauss, r).nodes)

    def is_exact(self, node: Integral, depth: int) -> bool:
        """Returns whether a rule relies on all breaks."""
        return not isinstance(self.of(node, depth), Adaptive)

    def bend_of(self, rule: Rule) -> str | None:
        """Returns the kind of bend that a rule of an intrinsic has as an operand."""
        return self._exact[type(rule)].bend if type(rule) in self._exact else None

    def is_too_deep(self, node: Integral) -> bool:
        """Returns whether more than MAX_NEST adaptive integrals are nested: their nodes multiply."""
        if not any(c.has_integral for c in node.children):
            return False
        if len(nodes_of(Integral, node)) <= MAX_NEST:
            return False
        depth: dict[Node, int] = {}
        for n in postorder([node]):
            most = max((depth[c] for c in n.children), default=0)
            if isinstance(n, Integral) and masses_of(n.body, n.var) is None and not self.is_exact(n, 0):
                most += 1
            depth[n] = most
        return depth[node] > MAX_NEST


def _is_ascending(node: Integral) -> bool:
    """Returns whether an infinite lower bound is -∞, and an infinite upper one ∞."""
    return not (isinstance(node.lo, Const) and node.lo.data == math.inf) and not (isinstance(node.hi, Const) and node.hi.data == -math.inf)
