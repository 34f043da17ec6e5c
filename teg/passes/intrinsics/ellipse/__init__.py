"""Moments of ellipses: `match` recognises integrals and boundary terms, `lowering` makes the statement, `errors` its estimates.

operands    the axes, the centre and the radius of an ellipse, the extents of a box; coefficients of polynomials
results     Σ c·∫∫ uʲvᵏ over g > 0, over g <= 0, or along g = 0
off         two integrals by pieces, with square roots at their ends; boundary terms over four quarters by angle
"""

from __future__ import annotations

from typing import Any

from teg.analysis.nest import Chain
from teg.ir.expr import Expr
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.passes.eliminate.conic import Conic
from teg.passes.eliminate.implicit import Implicit
from teg.passes.intrinsics.ellipse.errors import numbers_of, with_errors
from teg.passes.intrinsics.ellipse.lowering import EllipseLowering
from teg.passes.intrinsics.ellipse.match import match_arcs, match_ellipse
from teg.passes.lower.intrinsic import CLOSED_FORM, Description, Intrinsic, Statement
from teg.program import Ellipse


def boundary(g: Expr, coefficient: Expr, chain: Chain, data: Any) -> Expr | None:
    """Returns the boundary term of an ellipse, if the coefficient is a polynomial; else None."""
    is_plane = isinstance(data, Conic | Implicit) and len(data.variables) == 2
    return match_arcs(g, coefficient, chain, data.variables) if is_plane else None


def describe(node: Integral) -> Description | None:
    """Returns the description of moments of an ellipse."""
    if match_ellipse(node) is None:
        return None
    inside = tuple(n for n in postorder([node.body]) if isinstance(n, Integral))
    return Description(f"ellipse, {CLOSED_FORM}", None, None, 1, inside)


def _none(stmt: Ellipse) -> int:
    return 0


ELLIPSE = Intrinsic(
    "ellipse", EllipseLowering, boundary=boundary, describe=describe, statements={Ellipse: Statement(with_errors, numbers_of, _none, _none)}
)
