"""Path-space differentiable rendering: the boundary term of light paths with one bounce, sampled from the blocker's corners.

scene      a plane world: light from a lamp (0, b) at height H meets the ground at x in (0, 1), once, and is reflected to the eye above;
           a blocker stands at height h from p to p + w
radiance   I = ∫∫ f(x, y)·[the segment from x to y misses the blocker] dx dy,   f = cos²/r: both cosines H/r, over the distance r
boundary   a segment through the blocker's end at p is x = p - h·c, y = p + (H - h)·c, with c the cotangent of its angle.
           ∂I/∂p = ∫ Σ_ends ±f(x(c), y(c))·H dc:  an integral over directions at the corner, not over points of the ground
sampling   the direction is drawn first, then both ends of the segment are found by tracing it: no corner has to be searched for from
           a point of the ground. Uniform in c, within what reaches both the ground and the lamp
bias       none
variance   of order 1/N, of f along the directions
source     Zhang, Miller, Yan, Gkioulekas, Zhao 2020, "Path-space differentiable rendering", section 5: the boundary integral in the
           coordinates of the edge and of the direction through it
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import teg
from teg.ir.expr import Expr

HEIGHT, BLOCKER, WIDTH, LAMP = 1.0, 0.5, 0.25, 0.75
"""H, h, w and the default b."""
AT: Mapping[str, float] = {"p": 0.375, "b": LAMP}


def carried(x: Any, y: Any) -> Any:
    """Returns f, the light that goes from y on the lamp to the eye by x on the ground."""
    square = (x - y) ** 2 + HEIGHT**2
    return HEIGHT**2 / square**1.5


def radiance() -> Expr:
    """Returns I as an integral over the ground and the lamp, of the parameters p and b."""
    x, y = teg.vars("x y")
    p, b = teg.params("p b")
    crossing = x + (y - x) * (BLOCKER / HEIGHT)
    hit = (crossing > p) & (crossing < p + WIDTH)
    square = (x - y) ** 2 + HEIGHT**2
    return teg.integral(teg.where(hit, 0.0, HEIGHT**2 / (square * teg.sqrt(square))), (x, 0, 1), (y, 0, b))


def boundary_term(samples: int, seed: int = 0, p: float = AT["p"], b: float = AT["b"]) -> tuple[float, float]:
    """Returns an estimate of ∂I/∂p and its standard error, from directions at both ends of the blocker."""
    draws = np.random.default_rng(seed)
    total, variance = 0.0, 0.0
    for corner, sign in ((p, 1.0), (p + WIDTH, -1.0)):  # the shadow moves: lit on the left of the first, on the right of the second
        lo = max((corner - 1.0) / BLOCKER, -corner / (HEIGHT - BLOCKER))
        hi = min(corner / BLOCKER, (b - corner) / (HEIGHT - BLOCKER))
        if hi <= lo:
            continue
        c = draws.uniform(lo, hi, samples)
        values = sign * (hi - lo) * HEIGHT * carried(corner - BLOCKER * c, corner + (HEIGHT - BLOCKER) * c)
        total += float(values.mean())
        variance += float(values.var(ddof=1)) / samples
    return total, float(np.sqrt(variance))
