"""Integrands that are rational with one pole: P(x)/D(x)ᵐ on each piece between breaks, D linear.

The pole is known to the breaks of the integrand as a bend; degree and power are those of the normal form in the finite field, from which
the zero of D is divided out of numerator and denominator.
"""

from __future__ import annotations

from dataclasses import dataclass

from teg.analysis.breaks import BreakAnalysis
from teg.analysis.polynomial import Poly
from teg.analysis.projection import Turn
from teg.ir.expr import FALSE
from teg.ir.integral import Integral
from teg.numerics.field import P, divided

MAX_NUMERATOR, MAX_POWER = 4, 3
"""Degree of the numerator, power in the denominator."""


@dataclass(frozen=True)
class Pole:
    """The pole of a rational integrand: a linear function, the degree of the numerator, and the power in the denominator."""

    turn: Turn
    degree: int
    power: int


def match_pole(node: Integral, analysis: BreakAnalysis) -> Pole | None:
    """The pole of an integrand that is a polynomial over a power of a linear function on each piece, and a polynomial where that does
    not count; None if it has none, or has others, or is not known to be like this."""
    breaks, x = analysis.of(node), node.var
    turns = [turn for turn in breaks.bends if turn.kind == "pole" and turn.when is not FALSE]
    if not breaks.complete or breaks.isolated or len(turns) != 1:
        return None
    turn, shadow = turns[0], analysis.shadow((x,))
    linear, ratio = shadow.polynomial(turn.function), shadow.of(node.body)
    if ratio is None or linear is None or max(linear) != (1,):
        return None
    at = divided(-linear.get((0,), 0), linear[1,])
    above, numerator = _without_zero(ratio[0], at)
    below, denominator = _without_zero(ratio[1], at)
    degree, power = max((i for (i,) in numerator), default=0), below - above
    if max(denominator) != (0,) or not 0 < power <= MAX_POWER or degree > MAX_NUMERATOR:
        return None
    return Pole(turn, degree, power)


def _without_zero(poly: Poly, at: int) -> tuple[int, Poly]:
    """Returns how often a polynomial in one variable has a zero there, and the quotient without it."""
    times, coefficients = 0, [poly.get((i,), 0) for i in range(max((i for (i,) in poly), default=0), -1, -1)]
    while len(coefficients) > 1:
        quotient = [coefficients[0]]
        for c in coefficients[1:]:
            quotient.append((quotient[-1] * at + c) % P)
        if quotient.pop():
            break
        times, coefficients = times + 1, quotient
    return times, {(i,): c for i, c in enumerate(reversed(coefficients)) if c}
