"""Clipped polygons and segments: `match` says which integrals are some, `lowering` makes the statements, `errors` their estimates.

operands    the box (width, height) or the unit interval; half-planes or half-lines; a polynomial body
results     factors · ∫∫ of each value over what the half-planes leave
off         two integrals by pieces, with a break wherever two lines meet or one crosses a side
"""

from __future__ import annotations

from teg.ir.integral import Integral, masses_of
from teg.numerics.quadrature import triangle_rule
from teg.passes.intrinsics.polygon.errors import with_errors
from teg.passes.intrinsics.polygon.lowering import PolygonLowering
from teg.passes.intrinsics.polygon.match import match_clipped
from teg.passes.lower.intrinsic import Description, Intrinsic
from teg.program import Polygon, Segment


def describe(node: Integral) -> Description | None:
    """A clipped polygon or interval, in words."""
    clipped = match_clipped(node) if masses_of(node.body, node.var) is None else None
    if clipped is None:
        return None
    if len(clipped.boxes) == 1:
        return Description("clipped interval", clipped.degree // 2 + 1, clipped.degree, 1, clipped.inside)
    pieces = len(clipped.halves) + 2 if clipped.degree else 1
    return Description("clipped polygon", len(triangle_rule(clipped.degree)), clipped.degree, pieces, clipped.inside)


POLYGON = Intrinsic("polygon", PolygonLowering, describe=describe, errors={Polygon: with_errors, Segment: with_errors})
