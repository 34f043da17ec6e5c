"""Simultaneous perturbation: all parameters move at once, in a direction of random signs.

rule       (G(u; θ + h∘Δ) - G(u; θ - h∘Δ))·Δᵢ/(2hᵢ), averaged over samples u; each sample draws its own signs Δᵢ = ±1
cost       two evaluations a sample, whatever the number of parameters
bias       that of central differences, of order h²: h²·(I_iii + 3·Σ_j≠i I_ijj)/6 for equal steps
variance   about Σ_j |boundary|·jump²·|velocity_j|/(2h·N): as central differences, summed over all parameters
step       as for central differences
source     Spall 1992, "Multivariate stochastic approximation using a simultaneous perturbation gradient approximation"; here the
           average over directions is taken inside of the integral, so a call needs no random state of its own
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, cast

from teg.analysis.settings import Integration
from teg.ir.expr import MINUS_ONE, ONE, Expr, Param, Var, const
from teg.ir.simplify import add, div, mul, positive, sub, where
from teg.ir.traverse import replace_node
from teg.passes.differentiate.estimators.differences import balanced_step, length
from teg.passes.differentiate.estimators.estimator import Estimator, check_positive
from teg.passes.differentiate.estimators.nests import Cube, slopes_through_nests


@dataclass(frozen=True)
class Spsa(Estimator):
    """`step`: h relative to max(1, |θ|); None for the rule of central differences."""

    step: float | None = None

    name: ClassVar[str] = "spsa"

    def checked(self) -> Estimator:
        """Returns the estimator if its options are in their ranges."""
        if self.step is not None:
            check_positive("step", self.step)
        return self

    def fitted(self, how: Integration) -> Estimator:
        """Returns the estimator with the step that the number of samples calls for."""
        return self if self.step is not None else replace(self, step=balanced_step(how, False))

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the estimates of the derivatives by each parameter."""
        return slopes_through_nests(e, wrt, self._of_cube)

    def _of_cube(self, cube: Cube, moving: Sequence[Param]) -> Sequence[Expr]:
        coins = [Var.make(f"sign {i}", ()) for i in range(len(moving))]
        signs = [where(positive(sub(coin, const(0.5))), ONE, MINUS_ONE) for coin in coins]
        steps = [length(p, cast(float, self.step)) for p in moving]
        names = [Param.make(f"moved {p.name}", ()) for p in moving]  # all parameters move at once: a step may depend on another one
        body = cube.body
        for p, name in zip(moving, names, strict=True):
            body = cast(Expr, replace_node(body, p, name))
        sides = []
        for way in (ONE, MINUS_ONE):
            side = body
            for p, name, sign, h in zip(moving, names, signs, steps, strict=True):
                side = cast(Expr, replace_node(side, name, add(p, mul(way, sign, h))))
            sides.append(side)
        change = sub(*sides)
        return [cube.integral(mul(div(sign, mul(const(2.0), h)), change), coins) for sign, h in zip(signs, steps, strict=True)]
