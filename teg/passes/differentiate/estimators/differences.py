"""Central differences of two sampled integrals at the same points.

rule       (I(θ + h) - I(θ - h))/(2h), both sides over the same points; Richardson: (4·D(h) - D(2h))/3
bias       h²·I‴/6 + …; with Richardson's extrapolation -h⁴·I⁽⁵⁾/30 + …
variance   about |boundary|·jump²·|velocity|/(2h·N) for N samples: only points that the surface sweeps over contribute, each with 1/h
step       h = s·max(1, |θ|); s = N^(-1/5), which balances the two; without samples tol^(1/3), with Richardson tol^(1/5)
programs   each nest of integrals is differenced at each sample, and the chain rule does the rest; a program with an integral inside a
           function of another one is differenced as a whole
source     Glynn 1989, "Optimization of stochastic systems via simulation", for the rates; Richardson 1911
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, cast

from teg.analysis.settings import Integration
from teg.errors import EstimatorError, OptionError
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Expr, Param, const
from teg.ir.simplify import add, call, div, mul, sub
from teg.ir.traverse import parameters, replace_node
from teg.passes.differentiate.estimators.estimator import SAMPLES, Estimator, check_positive
from teg.passes.differentiate.estimators.nests import slopes_through_nests


@dataclass(frozen=True)
class Differences(Estimator):
    """`step`: h relative to max(1, |θ|), None for the rule above. `richardson`: whether to extrapolate from h and 2h."""

    step: float | None = None
    richardson: bool = False

    name: ClassVar[str] = "differences"

    def checked(self) -> Estimator:
        """Returns the estimator if its options are in their ranges."""
        if self.step is not None:
            check_positive("step", self.step)
        if not isinstance(self.richardson, bool):
            raise OptionError(f"richardson={self.richardson!r} is not known", None, "True or False")
        return self

    def fitted(self, how: Integration) -> Estimator:
        """Returns the estimator with the step that the number of samples, or the tolerance, calls for."""
        return self if self.step is not None else replace(self, step=balanced_step(how, self.richardson))

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the difference quotients by each parameter."""
        try:
            return slopes_through_nests(e, wrt, lambda cube, moving: [cube.integral(self._slope(cube.body, p)) for p in moving])
        except EstimatorError:  # not integrals over boxes: of the program as a whole
            known = set(parameters(e))
            return [self._slope(e, p) if p in known else ZERO for p in wrt]

    def _slope(self, e: Expr, p: Param) -> Expr:
        h = length(p, cast(float, self.step))
        once = _quotient(e, p, h)
        if not self.richardson:
            return once
        return div(sub(mul(const(4.0), once), _quotient(e, p, mul(const(2.0), h))), const(3.0))


def balanced_step(how: Integration, richardson: bool) -> float:
    """Returns the relative step that balances bias and noise."""
    if how.rule in ("montecarlo", "qmc"):
        return float((how.order or SAMPLES) ** -0.2)
    return float(how.tol ** (1 / 5 if richardson else 1 / 3))


def length(p: Param, step: float) -> Expr:
    """Returns the step of a parameter: step·max(1, |p|)."""
    return mul(const(step), call("max", ONE, call("magnitude", p)))


def _quotient(e: Expr, p: Param, h: Expr) -> Expr:
    above, below = (cast(Expr, replace_node(e, p, add(p, mul(sign, h)))) for sign in (ONE, MINUS_ONE))
    return div(sub(above, below), mul(const(2.0), h))
