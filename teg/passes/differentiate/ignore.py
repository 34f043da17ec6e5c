"""Plain automatic differentiation: every δ is dropped.

The result is the limit, for many samples, of discretising first and differentiating afterwards: the derivative between the
discontinuities, without the contribution of their motion. For comparison only.
"""

from __future__ import annotations

from teg.analysis.sift import deltas_of, without
from teg.ir.expr import Expr


def ignore_discontinuities(e: Expr) -> Expr:
    """Returns e with each δ replaced by 0."""
    return without(e, set(deltas_of(e)))
