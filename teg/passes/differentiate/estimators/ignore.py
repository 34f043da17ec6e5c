"""Plain automatic differentiation: every δ is dropped.

    rule       ∂I ≈ ∫ (∂f)ₐₑ, the derivative between the discontinuities
    bias       all that the motion of the discontinuities contributes; for an area, the whole derivative
    variance   that of the integrand's derivative, without samples none
    source     what automatic differentiation of a sampled program does, Bangaru et al. 2021, section 2

The result is the limit, for many samples, of discretising first and differentiating afterwards. For comparison only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from teg.analysis.sift import deltas_of, without
from teg.ir.expr import Expr, Param
from teg.passes.differentiate.estimators.estimator import Estimator
from teg.passes.differentiate.reverse import gradient_of


def ignore_discontinuities(e: Expr) -> Expr:
    """Returns e with each δ replaced by 0."""
    return without(e, set(deltas_of(e)))


@dataclass(frozen=True)
class Ignore(Estimator):
    """Drops every δ. It has no options."""

    name: ClassVar[str] = "ignore"
    is_sampled: ClassVar[bool] = False
    has_all_orders: ClassVar[bool] = True

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the derivatives between the discontinuities."""
        return [ignore_discontinuities(slope) for slope in gradient_of(e, wrt).children]
