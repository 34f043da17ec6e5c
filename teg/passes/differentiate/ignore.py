"""Plain automatic differentiation: every δ is dropped.

What a program that discretises first and differentiates afterwards computes in the limit of many samples: the derivative between the
discontinuities, and nothing of their motion. For comparison only.
"""

from __future__ import annotations

from teg.analysis.sift import deltas_of, without
from teg.ir.expr import Expr


def ignore_discontinuities(e: Expr) -> Expr:
    """e with each δ replaced by 0."""
    return without(e, set(deltas_of(e)))
