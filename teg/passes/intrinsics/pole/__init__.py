"""Rational integrands with one pole: P(x)/D(x)ᵐ, D linear, on each piece between breaks; `match` says which are some.

    operands    the pole, as the only bend of an `Integrate`
    results     exact with Gauss nodes and the weights of the rule `Rational`, however near the pole is
    off         the adaptive rule, in coordinates that follow the pole

The error rule is that of every integral: the rule has an estimate of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.breaks import BreakAnalysis
from teg.ir.integral import Integral
from teg.passes.intrinsics.pole.match import match_pole
from teg.passes.lower.intrinsic import Intrinsic
from teg.program import Rational, Rule


class PoleRule:
    """The rule of these integrands."""

    rule = Rational
    title = "Gauss with a pole, exact"
    bend = "pole"

    def match(self, node: Integral, analysis: BreakAnalysis) -> Rational | None:
        """As many nodes as the numerator needs."""
        pole = match_pole(node, analysis)
        return None if pole is None else Rational(pole.degree + 1, pole.power)

    def key(self, node: Integral, analysis: BreakAnalysis) -> object:
        """The pole, and where it counts."""
        pole = match_pole(node, analysis)
        assert pole is not None
        return analysis.functions.key(pole.turn.function), pole.turn.when

    def shared(self, rules: Sequence[Rule]) -> Rational:
        """The highest power: P/D is P·D over D²."""
        rational = cast("Sequence[Rational]", rules)
        power = max(r.power for r in rational)
        return Rational(max(r.nodes + power - r.power for r in rational), power)


POLE = Intrinsic("pole", rule=PoleRule())
