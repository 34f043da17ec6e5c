"""Edge sampling: the integral over each surface as a mean over points of it.

    rule       ∂I = ∫ (∂f)ₐₑ + Σ_j ∫_{g_j=0} jump_j·∂g_j/|∇g_j| ds, both sampled
    charts     affine: uniform on the part of the line inside of the box and of all affine conditions, before any point is drawn
               other: one chart a variable, weighted by φᵢ = (gᵢXᵢ)²/Σ(gⱼXⱼ)²; the integrand φᵢ/|gᵢ| has no pole where the surface turns
               back in xᵢ, so the variance is finite. Roots are isolated at every point.
    sampling   "uniform": every surface gets all samples. "stratified": with a point in each of `parts` parts of it. "importance": every
               sample goes to one part of one surface, drawn from a hierarchy by length × contribution (`edge_hierarchy.py`)
    bias       none
    variance   of order 1/N, of the contribution along each surface, for K strata over K³. Of "importance": of the contribution over its
               share, and of which surface is drawn; that pays in samples where there are many surfaces. rule="qmc" stratifies all
    source     Li, Aittala, Durand, Lehtinen 2018, "Differentiable Monte Carlo ray tracing through edge sampling". They draw one of very
               many edges by its importance, from a tree over bounding boxes; here the tree is over the parts of the clipped edges

The jump across a surface is that of the whole integrand, with ties resolved, so edges that coincide are counted once for each side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from teg.analysis.nest import Chain
from teg.errors import EstimatorError, OptionError
from teg.ir.expr import Expr, Param
from teg.ir.integral import Integral
from teg.ir.simplify import add
from teg.passes.differentiate.estimators.estimator import Estimator, check_count
from teg.passes.differentiate.estimators.nests import Cube, chains_of, slopes_of_nests
from teg.passes.differentiate.reverse import gradient_of
from teg.passes.eliminate.affine import match_affine, match_partly_affine, rewrite_affine
from teg.passes.eliminate.clip import clipped
from teg.passes.eliminate.edge_hierarchy import by_importance, split_by_dimension, stratified
from teg.passes.eliminate.families import Families, Rewrite, eliminate_deltas
from teg.passes.eliminate.implicit import match_implicit, rewrite_implicit
from teg.passes.eliminate.univariate import match_solvable, rewrite_solvable
from teg.passes.normalise.finite_bounds import with_finite_bounds

SAMPLINGS, MOST_PARTS = ("uniform", "stratified", "importance"), 64


@dataclass(frozen=True)
class EdgeMc(Estimator):
    """`sampling`: "uniform", "stratified" or "importance". `parts`: into how many an edge is cut for the latter two."""

    sampling: str = "uniform"
    parts: int = 4

    name: ClassVar[str] = "edge-mc"

    def checked(self) -> Estimator:
        """Returns the estimator if its options are in their ranges."""
        if self.sampling not in SAMPLINGS:
            raise OptionError(f"sampling={self.sampling!r} is not known", None, "one of: " + ", ".join(map(repr, SAMPLINGS)))
        check_count("parts", self.parts, MOST_PARTS)
        if self.parts < 1:
            raise OptionError("parts=0 leaves nothing of an edge", None, f"a whole number from 1 to {MOST_PARTS}")
        return self

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the derivatives by each parameter, the surfaces in charts that are clipped before they are sampled."""
        try:
            return slopes_of_nests(e, wrt, self._of_nest)
        except EstimatorError:  # not integrals over boxes: uniform, and clipped only as far as the charts are
            if self.sampling != "uniform":
                raise
            return _boundaries(e, wrt)

    def _of_nest(self, node: Integral, moving: Sequence[Param]) -> Sequence[Expr]:
        dimension = max(map(len, chains_of(node)))
        found = []
        for total in _boundaries(node, moving):
            others, edges = split_by_dimension(total, dimension)
            found.append(add(others, self._drawn(edges)) if edges else total)
        return found

    def _drawn(self, edges: Sequence[Cube]) -> Expr:
        """Returns the sum of the integrals over edges, as it is sampled. Uniform points are strata of one part."""
        if self.sampling == "importance":
            return by_importance(edges, self.parts)
        return stratified(edges, self.parts if self.sampling == "stratified" else 1)


def _boundaries(e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
    """Returns the derivatives as integrals over the interior and over clipped charts of the surfaces."""
    raw = with_finite_bounds(gradient_of(e, wrt))
    return eliminate_deltas(raw, families=FAMILIES).children  # type: ignore[return-value]


def _clipped(rewriting: Rewrite, g: Expr, coefficient: Expr, chain: Chain, data: Any) -> Expr | None:
    """Returns the chart of a family, clipped by the conditions that are affine in its variables."""
    result = rewriting(g, coefficient, chain, data)
    return None if result is None else clipped(result)


FAMILIES: Families = (
    (match_affine, partial(_clipped, rewrite_affine)),
    (match_implicit, partial(rewrite_implicit, power=2)),
    (match_solvable, rewrite_solvable),
    (match_partly_affine, partial(_clipped, rewrite_affine)),
)
