"""Softened conditions: every bracket that jumps becomes a sigmoid of the distance to its surface.

    rule       [g > 0] → 1/(1 + exp(-g/(|∇g|·σ))); & is a product, | is 1 - Π(1 - ·), ~ is 1 - ·; then plain automatic differentiation
    bias       of the order of σ², where the integrand and the surface are smooth; of the order of σ beside a kink, a corner or a bound
    variance   about |boundary|·jump²·|velocity|²/(6σ·N): only samples within some σ of the surface contribute, each with 1/(4σ)
    limits     exact as σ → 0 after N → ∞; with few samples and a σ below their spacing the estimate is 0, as plain automatic
               differentiation has it
    source     Liu et al. 2019, "Soft Rasterizer"; their probability of a face is the sigmoid of a signed squared distance, ours of the
               distance |g|/|∇g|, to first order

With `gamma`, `teg.nearest` becomes a mean of its candidates by coverage and depth (`aggregate.py`); σ and γ then both have to go to 0.

The value of a program is not softened, only its derivative is. Both branches of a softened condition are evaluated, so a branch that is
NaN where its condition fails makes the derivative NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import ClassVar, cast

from teg.analysis.jumps import surface_terms
from teg.analysis.surfaces import owned_surfaces
from teg.errors import OptionError
from teg.ir.expr import ONE, Compare, Cond, Expr, Param, Where
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, mul, sub
from teg.ir.traverse import rebuild
from teg.passes.differentiate.estimators.aggregate import aggregated
from teg.passes.differentiate.estimators.coverage import plain, scale_of, truth_of
from teg.passes.differentiate.estimators.estimator import Estimator, check_positive
from teg.passes.differentiate.estimators.ignore import ignore_discontinuities
from teg.passes.differentiate.reverse import gradient_of


@dataclass(frozen=True)
class Smooth(Estimator):
    """`sigma`: the width of the sigmoid, a distance in the variables of integration. `gamma`: the width of the order of depths of
    `teg.nearest`, in the unit of its key, None for a program without it. `far`: the key of what is seen where there is no candidate."""

    sigma: float = 0.01
    gamma: float | None = None
    far: float = 1.0

    name: ClassVar[str] = "smooth"

    def checked(self) -> Estimator:
        """Returns the estimator if its options are in their ranges."""
        check_positive("sigma", self.sigma)
        if self.gamma is not None:
            check_positive("gamma", self.gamma)
        if isinstance(self.far, bool) or not isinstance(self.far, Real) or not isfinite(self.far):
            raise OptionError(f"far={self.far!r} is not a number")
        return self

    def source_of(self, e: Expr) -> Expr | None:
        """Returns the program with SoftRas's aggregates in the place of `teg.nearest`; None for choices without `gamma`."""
        return super().source_of(e if self.gamma is None else aggregated(e, self.sigma, self.gamma, self.far))

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the derivatives of the softened program by each parameter."""
        return [ignore_discontinuities(s) for s in gradient_of(softened(e, self.sigma), wrt).children]


def softened(e: Expr, sigma: float) -> Expr:
    """Returns the program with a sigmoid of width `sigma` for each atom across whose surface an integrand jumps."""
    scales: dict[Expr, Expr] = {}
    for node in postorder([e]):
        if isinstance(node, Integral):
            for g, _ in surface_terms(node.body, owned_surfaces(node.body, node.var)):
                scales[g] = scale_of(g, sigma)
    new: dict[Node, Node] = {}
    truths: dict[Node, Expr] = {}
    for node in postorder([e]):
        result = rebuild(node, tuple([new[c] for c in node.children]))
        if isinstance(node, Cond) and isinstance(result, Cond):
            truths[node] = truth_of(node, result, truths, scales, plain)
        elif isinstance(node, Where) and _is_soft(node.condition, scales):
            truth, then, otherwise = truths[node.condition], cast(Expr, new[node.then]), cast(Expr, new[node.otherwise])
            result = add(mul(truth, then), mul(sub(ONE, truth), otherwise))
        new[node] = result
    return cast(Expr, new[e])


def _is_soft(condition: Cond, scales: dict[Expr, Expr]) -> bool:
    return any(isinstance(n, Compare) and n.g in scales for n in postorder([condition]))
