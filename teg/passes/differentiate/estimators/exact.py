"""Boundary integrals: the default of this compiler.

rule       ∂I = ∫ (∂f)ₐₑ + Σ_j ∫_{g_j=0} jump_j·∂g_j/|∇g_j|, the second sum by elimination of δ and integrated between its breaks
bias       none; the error is that of deterministic integration, below the tolerance
variance   none
source     Bangaru et al. 2021, and `teg.passes.eliminate` for the differences
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from teg.passes.differentiate.estimators.estimator import Estimator


@dataclass(frozen=True)
class Exact(Estimator):
    """Eliminates each δ (`teg.passes.eliminate.families`). It has no options; "sift" is another name of it."""

    name: ClassVar[str] = "exact"
    is_sampled: ClassVar[bool] = False
    has_all_orders: ClassVar[bool] = True
