"""SoftRas's aggregate: the nearest of candidates as a mean of all of them, by their coverage and their depth.

    nearest_k(v, z | c; o)   →   Σ_k w_k·v_k + w_o·o,      w_k = D_k·exp(-z_k/γ)/S,   w_o = exp(-z_o/γ)/S,   Σ w = 1

D_k is the softened condition c_k (`coverage.py`), z_o is `far`, the depth of what is seen where there is no candidate. Without such a value
w_o is 0. The source has z the other way round, from 1 at the near plane to 0 at the far one, and ε in the place of -far.

    bias         a border at which the depth changes by Δ is seen Δ·σ/γ too far out, since its tail exp(-d/σ) is weighted by exp(Δ/γ);
                 a candidate behind shows through by exp(-Δ/γ). So both γ and σ/γ have to go to 0
    not here     their code leaves out candidates whose D is below 10⁻⁴: where exp(Δ/γ) is larger than 10⁴ that is a new jump, which no
                 derivative sees

The choice is written out, so the number of its candidates is known when it is compiled; its cost is linear in that number.
Source: Liu, Li, Chen, Li 2019, "Soft Rasterizer", equations 4 and 5.
"""

from __future__ import annotations

from typing import cast

from teg.errors import EstimatorError
from teg.ir.choices import NOTHING, Nearest
from teg.ir.expr import Expr, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, div, mul, sub
from teg.ir.traverse import rebuild
from teg.passes.differentiate.estimators.coverage import coverage
from teg.passes.normalise.choices import candidates_of

LEAST = 1e-290
"""A smaller coverage is none."""


def aggregated(e: Expr, sigma: float, gamma: float, far: float) -> Expr:
    """Returns the program with means in the place of the choices that depend on variables.

    Raises EstimatorError if there is none, NeedsLengths if the number of candidates is known at run time only, ArrayIndexError for too
    many.
    """
    if not any(isinstance(n, Nearest) and n.free for n in postorder([e])):
        hint = "write the choice by depth as teg.nearest(value, depth, (k, 0, n), where=inside, otherwise=background)"
        raise EstimatorError(f"gamma={gamma:g} softens the order of depths of teg.nearest, of which this program has none", e, hint)
    new: dict[Node, Node] = {}
    for node in postorder([e]):
        result = rebuild(node, tuple([new[c] for c in node.children]))
        new[node] = _mean(result, sigma, gamma, far) if isinstance(result, Nearest) and result.free else result
    return cast(Expr, new[e])


def _mean(node: Nearest, sigma: float, gamma: float, far: float) -> Expr:
    candidates = candidates_of(node, "its aggregate is a sum of all candidates")
    has_background = node.otherwise is not NOTHING
    keys = [key for _, key, _, _ in candidates]
    covers = [coverage(c, sigma) for _, _, c, _ in candidates]
    heights = [sub(key, mul(const(gamma), call("log", add(d, const(LEAST))))) for key, d in zip(keys, covers, strict=True)]
    front: Expr = const(far) if has_background else heights[0]  # weights are relative to the largest one: no exponential overflows
    for height in heights:
        front = call("min", front, height)
    weights = [mul(d, _depth_weight(front, key, gamma)) for key, d in zip(keys, covers, strict=True)]
    values = [value for value, _, _, _ in candidates]
    if has_background:
        weights.append(_depth_weight(front, const(far), gamma))
        values.append(node.otherwise)
    return div(add(*(mul(w, v) for w, v in zip(weights, values, strict=True))), add(*weights))


def _depth_weight(front: Expr, key: Expr, gamma: float) -> Expr:
    """Returns exp(-key/γ), relative to that of the front."""
    return call("exp", mul(const(1 / gamma), sub(front, key)))
