"""Features of integrands that nodes of the whole range would miss: what they are, and how many breaks they add.

exponentials      of linear and quadratic polynomials; a narrow Gaussian adds a break in its middle and at both ends
centres           around which an integrand on an infinite range has its features, or where those of inner integrals meet
two ends          a piece that is singular at both ends is cut in the middle; one to infinity beside the end where it is singular
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import comb
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.centres import Centres, is_high
from teg.analysis.endless import factor_of_logarithm
from teg.analysis.polynomial import Shadow
from teg.analysis.tails import infinite_ends, is_unbounded
from teg.ir.expr import MINUS_ONE, ZERO, Add, Call, Const, Expr, Var, called, calls_of
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import div, mul
from teg.ir.traverse import substitute
from teg.passes.lower.rules import Rules

MAX_SCALES = 4
GENTLE = 2.0
"""A power of at least so much at the end of a tail costs less than a piece of its own."""


class Features:
    """Features of the integrals of one program. `binders` returns the variables of the integrals inside of nodes."""

    def __init__(self, rules: Rules, binders: Callable[[Sequence[Node]], frozenset[Var]]) -> None:
        self.rules, self.binders = rules, binders
        self.analysis = rules.analysis
        self.centres = Centres(self.analysis.functions.degrees, self.analysis.functions.key)

    def count(self, node: Integral, depth: int) -> int:
        """Returns how many breaks the features of an integral add to those of its surfaces."""
        middle = int(self.ends_at_both(node)) + 2 * len(self.singular_places(node))
        finite = infinite_ends(node).count(0.0)
        if self.rules.is_exact(node, depth):
            return middle + (finite == 0)
        edges = infinite_ends(node).count(0.0) + len(self.analysis.of(node).points)
        peaks = 3 * len(self.exponentials([node])[1]) + edges * len(self.tails([node]))
        met = len(self.centres.met(node))
        if not is_unbounded(node):
            known = sum(c.reach > 0 for c in self.centres.met(node))
            return middle + peaks + 3 * known + met - known + comb(met - known, 2)
        centres = len(self.centres.of(node))
        between = comb(finite + centres, 2) if met else 0
        return middle + peaks + (centres + between if finite + centres else 1)

    def ends_at_both(self, node: Integral) -> bool:
        """Returns whether an integrand may be singular at both ends of a piece of a finite range."""
        ends = [turn for turn in self.analysis.of(node).bends if turn.kind == "end"]
        return not is_unbounded(node) and (len(ends) > 1 or any(Shadow((node.var,)).degree(turn.function) == 2 for turn in ends))

    def singular_places(self, node: Integral) -> list[Expr]:
        """Returns the places on an infinite range at which a root or a power of a linear function may be singular, and more so than at the
        power GENTLE."""
        if not is_unbounded(node):
            return []
        gentle = {self.analysis.functions.key(u) for u in _gentle_bases(node)}
        x, functions = node.var, [turn.function for turn in self.analysis.of(node).bends if turn.kind in ("root", "end")]
        inner = self.binders([node.body])
        linear = [
            f for f in functions if not f.free & inner and Shadow((x,)).degree(f) == 1 and self.analysis.functions.key(f) not in gentle
        ]
        at_0 = [cast(Expr, substitute(f, {x: ZERO})) for f in linear]
        return list(dict.fromkeys(div(mul(MINUS_ONE, c), slope(f, x)) for c, f in zip(at_0, linear, strict=True)))[:MAX_SCALES]

    def exponentials(self, group: Sequence[Integral]) -> tuple[list[Expr], list[tuple[Expr, Expr]]]:
        """Returns the rates of linear exponents in the integrands, and slope at 0 and curvature of the quadratic ones."""
        pairs = dict.fromkeys(pair for _, pair in self._exponents(group))
        linear = [rate for rate, curvature in pairs if curvature is ZERO]
        return linear[:MAX_SCALES], [pair for pair in pairs if pair[1] is not ZERO][:MAX_SCALES]

    def tails(self, group: Sequence[Integral]) -> list[tuple[Expr, Expr]]:
        """Returns slope at 0 and curvature of the quadratic exponents that may be positive in the middle: the tail of such a Gaussian from
        an edge of its range may be large although the middle is not in it."""
        x, inner = group[0].var, self.binders([i.body for i in group])
        found: dict[tuple[Expr, Expr], None] = {}
        for exponent, pair in self._exponents(group):
            if pair[1] is not ZERO:
                middle = div(mul(MINUS_ONE, pair[0]), pair[1])
                if is_high(cast(Expr, substitute(self._at_ridge(exponent, inner), {x: middle}))):
                    found[pair] = None
        return list(found)[:MAX_SCALES]

    def _exponents(self, group: Sequence[Integral]) -> Iterator[tuple[Expr, tuple[Expr, Expr]]]:
        """Yields the linear and quadratic exponents in the integrands, with slope at 0 and curvature."""
        x, bodies = group[0].var, [i.body for i in group]
        inner = self.binders(bodies)
        for node in calls_of(called("exp"), *bodies):
            if x in node.free:
                pair = self.quadratic(node, x, inner)
                if pair is not None:
                    yield node.children[0], pair

    def quadratic(self, node: Call, x: Var, inner: frozenset[Var]) -> tuple[Expr, Expr] | None:
        """Returns slope at 0 and curvature of the exponent of an exponential of a linear or quadratic polynomial; curvature ZERO for a
        linear one."""
        exponent = self._at_ridge(node.children[0], inner)
        degree = self.analysis.functions.degrees.of(exponent, x)
        if degree not in (1, 2):
            return None
        rate = slope(exponent, x)
        at_0, curvature = (cast(Expr, substitute(e, {x: ZERO})) for e in (rate, slope(rate, x)))
        if (at_0.free | curvature.free) & inner:
            return None
        return at_0, ZERO if degree == 1 else curvature

    def _at_ridge(self, exponent: Expr, inner: frozenset[Var]) -> Expr:
        """Returns an exponent that is quadratic in variables of inner integrals, at its stationary point in these."""
        for v in [v for v in inner if v in exponent.free]:
            if self.analysis.functions.degrees.of(exponent, v) != 2:
                return exponent
            rate = slope(exponent, v)
            at_0, curvature = (cast(Expr, substitute(e, {v: ZERO})) for e in (rate, slope(rate, v)))
            exponent = cast(Expr, substitute(exponent, {v: div(mul(MINUS_ONE, at_0), curvature)}))
        return exponent


def _gentle_bases(node: Integral) -> Iterator[Expr]:
    """Yields the u of powers uᵏ, and of exp(k·log u + …), with numbers k >= GENTLE."""
    for e in postorder([node.body]):
        if isinstance(e, Call) and node.var in e.free and e.name == "pow" and _is_gentle(e.children[1]):
            yield e.children[0]
        elif isinstance(e, Call) and node.var in e.free and e.name == "exp":
            for term in e.children[0].children if isinstance(e.children[0], Add) else e.children:
                if _is_gentle(factor_of_logarithm(term, node.var)):
                    yield next(n.children[0] for n in postorder([term]) if isinstance(n, Call) and n.name in ("log", "log1p"))


def _is_gentle(exponent: Expr | None) -> bool:
    return isinstance(exponent, Const) and exponent.data >= GENTLE
