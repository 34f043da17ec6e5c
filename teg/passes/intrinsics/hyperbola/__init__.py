"""Moments of hyperbolas: `match` recognises integrals and boundary terms, `lowering` makes the statement, `errors` its estimates.

operands    the values of a bilinear g at the corners of the unit square; coefficients of polynomials
results     Σ c·∫∫ uʲvᵏ over g > 0, over g <= 0, or along g = 0
off         two integrals by pieces, with rational integrands; boundary terms in the charts of their family
"""

from __future__ import annotations

from typing import Any

from teg.analysis.nest import Chain
from teg.ir.expr import Expr
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.passes.eliminate.bilinear import Bilinear
from teg.passes.intrinsics.hyperbola.errors import numbers_of, with_errors
from teg.passes.intrinsics.hyperbola.lowering import HyperbolaLowering
from teg.passes.intrinsics.hyperbola.match import match_border, match_hyperbola
from teg.passes.lower.intrinsic import CLOSED_FORM, Description, Intrinsic, Statement
from teg.program import Hyperbola


def boundary(g: Expr, coefficient: Expr, chain: Chain, data: Any) -> Expr | None:
    """Returns the boundary term of a bilinear surface, if the coefficient is a polynomial; else None."""
    return match_border(g, coefficient, chain) if isinstance(data, Bilinear) else None


def describe(node: Integral) -> Description | None:
    """Returns the description of moments of a hyperbola."""
    if match_hyperbola(node) is None:
        return None
    inside = tuple(n for n in postorder([node.body]) if isinstance(n, Integral))
    return Description(f"hyperbola, {CLOSED_FORM}", None, None, 1, inside)


def _none(stmt: Hyperbola) -> int:
    return 0


HYPERBOLA = Intrinsic(
    "hyperbola",
    HyperbolaLowering,
    boundary=boundary,
    describe=describe,
    statements={Hyperbola: Statement(with_errors, numbers_of, _none, _none)},
)
