"""Which rule integrates what, with how many nodes.

Gauss with as many nodes as a polynomial between known breaks needs; a rule of an intrinsic that is exact; adaptive for anything else,
tighter inside, with the fewer nodes to begin with the less is asked for. A fixed order is an adaptive rule that accepts everything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from teg.analysis.breaks import BreakAnalysis
from teg.analysis.settings import Integration
from teg.analysis.tails import is_unbounded
from teg.ir.integral import Integral, masses_of
from teg.ir.node import Node, postorder
from teg.passes.lower.intrinsic import ExactRule
from teg.program import Adaptive, Gauss, Rule

MAX_GAUSS = 24
TIGHTEST = 1e-14
ORDERS = ((1e-6, 6, 12), (1e-13, 8, 16), (0.0, 10, 18))
"""By tolerance: the nodes of the first look at a piece (OUTER more where an integral stands inside) and of the intervals after it."""
OUTER = 2
MAX_NEST = 6
"""Adaptive integrals inside each other; deeper nests are sampled."""
FIXED = 16
"""Nodes of the rule \"gauss\", unless told."""
INNER_TIGHTER = 0.1
"""An integral inside another one is computed to a tenth of its tolerance, so that the outer one sees a smooth function."""


class Rules:
    """The rules of the integrals of one program; `exact` are those of intrinsics."""

    def __init__(self, how: Integration, exact: Sequence[ExactRule] = ()) -> None:
        self.how, self.analysis = how, BreakAnalysis(how.max_roots)
        self._exact = {e.rule: e for e in exact}
        self._known: dict[tuple[Integral, int], tuple[Rule, str]] = {}

    def of(self, node: Integral, depth: int) -> Rule:
        """The rule of an integral that stands in so many others."""
        if (node, depth) not in self._known:
            self._known[node, depth] = self._choose(node, depth)
        return self._known[node, depth][0]

    def reason(self, node: Integral, depth: int) -> str:
        """Why it is that rule."""
        self.of(node, depth)
        return self._known[node, depth][1]

    def _choose(self, node: Integral, depth: int) -> tuple[Rule, str]:
        how, bounded = self.how, not is_unbounded(node)
        degree = None if how.rule == "adaptive" else self.analysis.degree(node)
        most = (how.order or FIXED) if how.rule == "gauss" else MAX_GAUSS
        if degree is not None and degree // 2 + 1 <= most and bounded:
            return Gauss(degree // 2 + 1), f"a polynomial of degree {degree} between known breaks"
        for intrinsic in self._exact.values() if bounded else ():
            if (rule := intrinsic.match(node, self.analysis)) is not None:
                return rule, "the shape of an intrinsic"
        cubic = self.analysis.of(node).rooted
        if how.rule == "gauss":
            return Adaptive(math.inf, most, most, cubic), f"{most} nodes are asked for"
        tol = max(how.tol * INNER_TIGHTER**depth, TIGHTEST)
        if how.order is not None:
            return Adaptive(tol, how.order, how.order + 8, cubic), f"{how.order} nodes for the first look are asked for"
        _, first, order = next(row for row in ORDERS if tol >= row[0])
        inside = postorder([node.body]) if node.body.has_integral else []
        outer = any(isinstance(n, Integral) and masses_of(n.body, n.var) is None for n in inside)
        return Adaptive(tol, first + OUTER * outer, order, cubic), "no exact rule is known" if how.rule == "auto" else "asked for"

    def title(self, rule: Rule) -> str:
        """What a rule is called in reports."""
        match rule:
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
        """The same for integrals that can share a loop if the rest agrees."""
        rule = type(self.of(node, depth))
        return (rule, self._exact[rule].key(node, self.analysis)) if rule in self._exact else rule

    def shared(self, group: Sequence[Integral], depth: int) -> Rule:
        """One rule for all integrals of a loop, which are of one kind."""
        rules = [self.of(node, depth) for node in group]
        first = rules[0]
        if type(first) in self._exact:
            return self._exact[type(first)].shared(rules)
        if isinstance(first, Adaptive):
            return replace(first, cubic=any(cast(Adaptive, r).cubic for r in rules))
        return max(rules, key=lambda r: cast(Gauss, r).nodes)

    def is_exact(self, node: Integral, depth: int) -> bool:
        """Whether a rule relies on all breaks."""
        return not isinstance(self.of(node, depth), Adaptive)

    def bend_of(self, rule: Rule) -> str | None:
        """The kind of bend that a rule of an intrinsic has as an operand."""
        return self._exact[type(rule)].bend if type(rule) in self._exact else None

    def is_too_deep(self, node: Integral) -> bool:
        """More than MAX_NEST adaptive integrals inside each other: their nodes multiply."""
        if not any(c.has_integral for c in node.children):
            return False
        nodes = postorder([node])
        if sum(isinstance(n, Integral) for n in nodes) <= MAX_NEST:
            return False
        depth: dict[Node, int] = {}
        for n in nodes:
            most = max((depth[c] for c in n.children), default=0)
            if isinstance(n, Integral) and masses_of(n.body, n.var) is None and not self.is_exact(n, 0):
                most += 1
            depth[n] = most
        return depth[node] > MAX_NEST
