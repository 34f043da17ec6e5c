"""Softened conditions: every bracket that jumps becomes a sigmoid of the distance to its surface.

    rule       [g > 0] → 1/(1 + exp(-g/(|∇g|·σ))); & is a product, | is 1 - Π(1 - ·), ~ is 1 - ·; then plain automatic differentiation
    bias       of the order of σ², where the integrand and the surface are smooth; of the order of σ beside a kink, a corner or a bound
    variance   about |boundary|·jump²·|velocity|²/(6σ·N): only samples within some σ of the surface contribute, each with 1/(4σ)
    limits     exact as σ → 0 after N → ∞; with few samples and a σ below their spacing the estimate is 0, as plain automatic
               differentiation has it
    source     Liu et al. 2019, "Soft Rasterizer"; their probability of a face is the sigmoid of a signed squared distance, ours of the
               distance |g|/|∇g|, to first order

The value of a program is not softened, only its derivative is. Both branches of a softened condition are evaluated, so a branch that is
NaN where its condition fails makes the derivative NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, cast

from teg.analysis.jumps import surface_terms
from teg.analysis.surfaces import owned_surfaces
from teg.ir.expr import (
    ONE,
    ZERO,
    And,
    Compare,
    Cond,
    Expr,
    Not,
    Or,
    Param,
    Truth,
    Var,
    Where,
    add,
    call,
    const,
    div,
    mul,
    sub,
    where,
)
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.traverse import rebuild
from teg.passes.differentiate.estimators.estimator import Estimator, check_positive
from teg.passes.differentiate.estimators.ignore import ignore_discontinuities
from teg.passes.differentiate.estimators.nests import squared_slopes
from teg.passes.differentiate.reverse import gradient_of


@dataclass(frozen=True)
class Smooth(Estimator):
    """`sigma`: the width of the sigmoid, a distance in the variables of integration."""

    sigma: float = 0.01

    name: ClassVar[str] = "smooth"

    def checked(self) -> Estimator:
        """Returns the estimator if its options are in their ranges."""
        check_positive("sigma", self.sigma)
        return self

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the derivatives of the softened program by each parameter."""
        return [ignore_discontinuities(s) for s in gradient_of(softened(e, self.sigma), wrt).children]


def softened(e: Expr, sigma: float) -> Expr:
    """Returns the program with a sigmoid of width `sigma` for each atom across whose surface an integrand jumps."""
    scales: dict[Expr, Expr] = {}
    for node in postorder([e]):
        if isinstance(node, Integral):
            for g, _ in surface_terms(node.body, owned_surfaces(node.body, node.var)):
                variables = sorted((v for v in g.free if isinstance(v, Var)), key=lambda v: v.name)
                scales[g] = mul(call("sqrt", squared_slopes(g, variables)[1]), const(2.0 * sigma))
    new: dict[Node, Node] = {}
    truths: dict[Node, Expr] = {}
    for node in postorder([e]):
        result = rebuild(node, tuple([new[c] for c in node.children]))
        if isinstance(node, Cond) and isinstance(result, Cond):
            truths[node] = _truth(node, result, truths, scales)
        elif isinstance(node, Where) and _is_soft(node.condition, scales):
            truth, then, otherwise = truths[node.condition], cast(Expr, new[node.then]), cast(Expr, new[node.otherwise])
            result = add(mul(truth, then), mul(sub(ONE, truth), otherwise))
        new[node] = result
    return cast(Expr, new[e])


def _is_soft(condition: Cond, scales: dict[Expr, Expr]) -> bool:
    return any(isinstance(n, Compare) and n.g in scales for n in postorder([condition]))


def _truth(node: Cond, result: Cond, truths: dict[Node, Expr], scales: dict[Expr, Expr]) -> Expr:
    """Returns the truth value of a condition as a number from 0 to 1."""
    match node:
        case Compare() if node.g in scales:  # 1/(1 + exp(-z)) = (1 + tanh(z/2))/2
            g = result.g if isinstance(result, Compare) else node.g
            return mul(const(0.5), add(ONE, call("tanh", div(g, scales[node.g]))))
        case Not():
            return sub(ONE, truths[node.operand])
        case And():
            return mul(*(truths[c] for c in node.children))
        case Or():
            return sub(ONE, mul(*(sub(ONE, truths[c]) for c in node.children)))
        case Truth():
            return ONE if node.data else ZERO
        case _:
            return where(result, ONE, ZERO)
