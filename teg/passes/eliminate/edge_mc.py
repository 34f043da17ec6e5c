"""Edge sampling: the integral over each surface as a mean over points of it.

    rule       ∂I = ∫ (∂f)ₐₑ + Σ_j ∫_{g_j=0} jump_j·∂g_j/|∇g_j| ds, both sampled
    charts     affine: uniform on the part of the line inside of the box and of all affine conditions, before any point is drawn
               other: one chart a variable, weighted by φᵢ = (gᵢXᵢ)²/Σ(gⱼXⱼ)²; the integrand φᵢ/|gᵢ| has no pole where the surface turns
               back in xᵢ, so the variance is finite. Roots are isolated at every point.
    bias       none
    variance   of order 1/N, of the contribution along each surface; every surface gets all samples. rule="qmc" stratifies them
    source     Li, Aittala, Durand, Lehtinen 2018, "Differentiable Monte Carlo ray tracing through edge sampling". They draw one of very
               many edges by its importance; a program here evaluates each of its few, which has a smaller variance for the same points.

The jump across a surface is that of the whole integrand, with ties resolved, so edges that coincide are counted once for each side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, cast

from teg.analysis.calculus import slope
from teg.analysis.nest import Chain
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import (
    MINUS_ONE,
    ONE,
    ZERO,
    Add,
    And,
    Compare,
    Cond,
    Expr,
    Not,
    Param,
    Var,
    Where,
    add,
    call,
    conjunction,
    const,
    div,
    mul,
    positive,
    sub,
    where,
)
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node
from teg.ir.traverse import rewrite, substitute
from teg.passes.differentiate.estimators.estimator import Estimator
from teg.passes.differentiate.reverse import gradient_of
from teg.passes.eliminate.affine import match_affine, match_partly_affine, rewrite_affine
from teg.passes.eliminate.families import Families, Rewrite, eliminate_deltas
from teg.passes.eliminate.implicit import match_implicit, rewrite_implicit
from teg.passes.eliminate.univariate import match_solvable, rewrite_solvable
from teg.passes.normalise.finite_bounds import with_finite_bounds

FLAT = 2.0**-26
"""The rate of a condition along a chart, relative to its terms, below which it does not clip: rounding alone would say where."""


@dataclass(frozen=True)
class EdgeMc(Estimator):
    """Samples the surfaces. It has no options; `rule="qmc"` stratifies."""

    name: ClassVar[str] = "edge-mc"

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the derivatives by each parameter, the surfaces in charts that are clipped before they are sampled."""
        raw = with_finite_bounds(gradient_of(e, wrt))
        return eliminate_deltas(raw, families=FAMILIES).children  # type: ignore[return-value]


def _clipped(rewriting: Rewrite, g: Expr, coefficient: Expr, chain: Chain, data: Any) -> Expr | None:
    """Returns the chart of a family, clipped by the conditions that are affine in its variables."""
    result = rewriting(g, coefficient, chain, data)
    return None if result is None else clipped(result)


def clipped(e: Expr) -> Expr:
    """Returns e with the bounds of each integral over (0, 1) drawn in to where affine conditions hold."""

    def visit(old: Node, new: Node) -> Node:
        if isinstance(new, Integral) and new.lo is ZERO and new.hi is ONE:
            lo, hi = _limits(new.body, new.var)
            return integral_over(new.body, new.var, lo, call("max", lo, hi) if lo is not ZERO or hi is not ONE else hi)
        return new

    return cast(Expr, rewrite([e], visit)[e])


def _limits(body: Expr, s: Var) -> tuple[Expr, Expr]:
    """Returns the part of (0, 1) outside of which a body is 0 because an affine condition fails."""
    lo: Expr = ZERO
    hi: Expr = ONE
    for condition in _conditions(body):
        atom, sign = (condition.operand, MINUS_ONE) if isinstance(condition, Not) else (condition, ONE)
        if not isinstance(atom, Compare) or s not in atom.g.free or any(s in a.free for a in atoms_of(atom.g)):
            continue
        rate = slope(atom.g, s)
        if s in rate.free or atom.g.free - rate.free - {s} - body.free:
            continue
        start = cast(Expr, substitute(atom.g, {s: ZERO}))
        place = div(mul(MINUS_ONE, start), rate)
        steep = positive(sub(call("magnitude", rate), mul(const(FLAT), _size(atom.g, s))))
        rises = positive(mul(sign, rate))
        lo = call("max", lo, where(conjunction(steep, rises), place, ZERO))
        hi = call("min", hi, where(conjunction(steep, Not.make(None, (rises,))), place, ONE))
    return lo, hi


def _conditions(body: Expr) -> Sequence[Cond]:
    """Returns conditions without which a body is 0."""
    if not isinstance(body, Where) or body.otherwise is not ZERO:
        return ()
    return body.condition.children if isinstance(body.condition, And) else (body.condition,)


def _size(g: Expr, s: Var) -> Expr:
    """Returns the size of the terms of g on (0, 1)."""
    match g:
        case Add():
            return add(*(_size(c, s) for c in g.children))
        case Where():
            return where(g.condition, _size(g.then, s), _size(g.otherwise, s))
        case _ if s in g.free:
            return add(*(call("magnitude", cast(Expr, substitute(g, {s: end}))) for end in (ZERO, ONE)))
        case _:
            return call("magnitude", g)


FAMILIES: Families = (
    (match_affine, partial(_clipped, rewrite_affine)),
    (match_implicit, partial(rewrite_implicit, power=2)),
    (match_solvable, rewrite_solvable),
    (match_partly_affine, partial(_clipped, rewrite_affine)),
)
