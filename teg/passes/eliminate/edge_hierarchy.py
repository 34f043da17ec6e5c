"""Which part of which edge a sample goes to: strata of every edge, or one leaf of a hierarchy of all edges by their importance.

    stratified   ∫₀¹ f(s) ds = E Σ_k f((k + v_k)/K)/K                       K parts an edge, one point in each; the v_k are independent
    importance   Σ_j ∫₀¹ F_j(v) dv = E F_j((u - c_j)/p_j)/p_j, c_j ≤ u < c_j + p_j         j: the K parts of each edge; c_j: sums of p
                 p_j = (1 - α)·w_j/Σw + α/n,  w_j = |F_j(½)| = length × contribution at the middle,  n: parts with a length

The importances w depend on parameters only, so they are computed once a call. The leaf is found by halving, as in a binary tree whose nodes
hold the probability of all leaves below them. No leaf with a length has the probability 0 (α), so both are unbiased. Each derivative has
its own probabilities: shared ones are cheaper, and their standard errors were two to eight times as large.

Cost: a sample needs one leaf, in a number of decisions that grows with the logarithm of their number; but the leaves are branches of
`where`, all of which this compiler's backends compute. So it saves samples here, and no time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from teg.analysis.nest import Binder, Chain, nest
from teg.ir.expr import ONE, ZERO, Expr, Mul, Var, Where, const
from teg.ir.operands import less
from teg.ir.simplify import add, call, div, mul, positive, sub, where
from teg.ir.traverse import substitute
from teg.passes.differentiate.estimators.nests import Cube, chains_of, unit_cube
from teg.passes.eliminate.clip import clipped

DEFENSIVE = 1 / 64
"""α, the part of the samples that go to all leaves alike."""
LARGEST = 1e300
"""A larger importance counts as none: a pole at the middle of a leaf says nothing about its integral."""


def split_by_dimension(e: Expr, most: int) -> tuple[Expr, list[Cube]]:
    """Returns the part of a linear expression of integrals without integrals over edges, and these as integrals over unit cubes.

    An edge has some variables, and fewer than `most`, which is the dimension of the interior.
    """
    chains = chains_of(e)
    edges = [edge for chain, body in chains.items() if 0 < len(chain) < most and body is not ZERO for edge in _clipped(chain, body)]
    others = [nest(body, chain) for chain, body in chains.items() if not 0 < len(chain) < most]
    return add(*others), edges


def _clipped(chain: Chain, body: Expr) -> list[Cube]:
    """Returns an integral as ones over unit cubes, of the part where its affine conditions hold."""
    whole = unit_cube(chain, body)
    factors = whole.body.children if isinstance(whole.body, Mul) else (whole.body,)
    under = next((f for f in factors if isinstance(f, Where) and f.otherwise is ZERO), None)
    if under is not None:
        others = [f for f in factors if f is not under]
        whole = replace(whole, body=where(under.condition, mul(*others, under.then), ZERO))
    return [unit_cube(*part) for part in chains_of(clipped(whole.integral(whole.body))).items()]


def stratified(edges: Sequence[Cube], parts: int) -> Expr:
    """Returns the sum of integrals with a point in each of the parts of each first coordinate."""
    points = [Var.make(f"point {k}", ()) for k in range(parts)]
    others = _other_coordinates(edges)
    total = add(*(leaf for edge in edges for leaf in leaves_of(edge, points)))
    return nest(total, [Binder(v, ZERO, ONE) for v in (*points, *others)])


def by_importance(edges: Sequence[Cube], parts: int) -> Expr:
    """Returns the sum of integrals by one leaf a sample, from a hierarchy of all parts of all edges."""
    u = Var.make("choice", ())
    others = _other_coordinates(edges)
    leaves = [leaf for edge in edges for leaf in leaves_of(edge, [u] * parts)]
    likely = probabilities([_importance(leaf, (u, *others)) for leaf in leaves], [_presence(edge) for edge in edges for _ in range(parts)])
    return nest(_descent(u, leaves, likely, ZERO), [Binder(v, ZERO, ONE) for v in (u, *others)])


def leaves_of(edge: Cube, points: Sequence[Var]) -> list[Expr]:
    """Returns the integrands of the equal parts of an edge, as functions of these variables from 0 to 1."""
    first, share = edge.variables[0], const(1 / len(points))
    return [mul(share, cast(Expr, substitute(edge.body, {first: mul(share, add(const(float(k)), v))}))) for k, v in enumerate(points)]


def probabilities(importances: Sequence[Expr], presences: Sequence[Expr]) -> list[Expr]:
    """Returns the probability of each leaf: mostly in proportion to its importance, and a share for each leaf that is present."""
    total, count = add(*importances), call("max", add(*presences), ONE)
    alike = [div(present, count) for present in presences]
    mixed = [add(mul(const(1 - DEFENSIVE), div(w, total)), mul(const(DEFENSIVE), a)) for w, a in zip(importances, alike, strict=True)]
    return [where(positive(total), m, a) for m, a in zip(mixed, alike, strict=True)]


def _other_coordinates(edges: Sequence[Cube]) -> tuple[Var, ...]:
    """Returns the coordinates beside the first one of the edge that has most."""
    return max((edge.variables[1:] for edge in edges), key=len)


def _importance(leaf: Expr, variables: Sequence[Var]) -> Expr:
    """Returns |integrand| in the middle of a leaf, 0 if that is no number."""
    middle = call("magnitude", cast(Expr, substitute(leaf, dict.fromkeys(variables, const(0.5)))))
    return where(less(middle, const(LARGEST), True), middle, ZERO)


def _presence(edge: Cube) -> Expr:
    """Returns 1 if the edge has a length, else 0."""
    length = call("magnitude", edge.extent)
    return where(positive(length), ONE, ZERO)


def _descent(u: Var, leaves: Sequence[Expr], likely: Sequence[Expr], start: Expr) -> Expr:
    """Returns F_j/p_j of the leaf j in which u lies: a decision between the halves, and so on."""
    if len(leaves) == 1:
        p = call("max", likely[0], const(1 / LARGEST))
        place = call("max", call("min", div(sub(u, start), p), ONE), ZERO)
        return div(cast(Expr, substitute(leaves[0], {u: place})), p)
    half = len(leaves) // 2
    border = add(start, add(*likely[:half]))
    left, right = _descent(u, leaves[:half], likely[:half], start), _descent(u, leaves[half:], likely[half:], border)
    return where(less(u, border, True), left, right)
