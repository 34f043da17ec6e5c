"""Whether maps cover the integrals they are used for, checked at sample points for the parameter values of every call."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from teg.analysis.evaluate import values_of
from teg.analysis.nest import Chain
from teg.ir.expr import Const, Expr, Param, Var
from teg.ir.traverse import parameters
from teg.maps.diffeomorphism import Diffeomorphism
from teg.maps.verification import SAMPLES, TOLERANCE, TRIALS, Samples, halton, hold

if TYPE_CHECKING:
    import numpy as np

SAMPLES_ONCE, ROUNDS = 2048, 3
"""The number of points of a nest at the first check of a map, and the number of refinements near the end of its domain."""
NEAREST, AROUND = 8, 32
SAMPLES_LATER = 64
MOST_CORNERS = 64
NEAR_END = 1e-7
_LEAVE_OUT = "integrate inside the domain of the map, widen its `domain` or `bounds`, or leave the map out"


def verify_covered(chain: Chain, m: Diffeomorphism, values: Mapping[Param, Any], samples: int, body: Expr, rounds: int = 0) -> bool:
    """Checks that the map reaches the sample points of a nest (outermost first) at parameter values: numbers, or arrays of one length.

    Raises DiffeomorphismError if it does not reach a point at which the integrand `body` does not vanish. Returns whether all points
    were reached without evaluating the integrand. Points are a low-discrepancy sequence and the corners. In each of `rounds` more points
    are taken around the points nearest to the end of the domain. A nest with integrals in its bounds is not checked.
    """
    import numpy as np

    if not _is_closed(chain):
        return True
    places, reached = _places(samples, len(chain)), True
    radius = 0.1
    for _ in range(rounds + 1):
        with np.errstate(all="ignore"):
            all_reached, room = _verify_points(chain, m, values, places, body)
        reached &= all_reached
        nearest = np.argsort(room, kind="stable")[:NEAREST]
        around = np.clip(places[nearest][:, None, :] + radius * (2.0 * _places(AROUND, len(chain)) - 1.0), NEAR_END, 1.0 - NEAR_END)
        places, radius = around.reshape(-1, len(chain)), radius / 4.0
    return reached


def _verify_points(chain: Chain, m: Diffeomorphism, values: Mapping[Param, Any], places: np.ndarray, body: Expr) -> tuple[bool, np.ndarray]:
    """Returns whether the map reaches all of these points of a nest, and the distance of each from the end of the
    domain; raises as above."""
    import numpy as np

    reached = True
    at = _points_of(chain, values, places)
    old = [at[x] for x in m.old]
    new = values_of(list(m.inverse.values()), at)
    there: dict[Any, Any] = {**values, **dict(zip(m.new, new, strict=True))}
    shape = np.broadcast_shapes(*(np.shape(v) for v in at.values()))
    counts = np.all([np.broadcast_to(np.isfinite(v), shape) for v in old], axis=0)
    least = np.full(len(places), np.inf)

    def covered(holds: Any, expected: Any, computed: Any, text: str) -> None:
        nonlocal reached
        if np.any(counts & ~holds) and not (body.has_integral or body.has_delta):
            reached, holds = False, holds | (values_of([body], at)[0] == 0.0)
        hold(Samples(m, counts, at), holds, (expected, computed), f"which is integrated over, {text}", _LEAVE_OUT)

    for x, old_value, value in zip(m.old, old, values_of(list(m.forward.values()), there), strict=True):
        same = np.abs(value - old_value) <= TOLERANCE * np.maximum(1.0, np.abs(old_value))
        covered(same, old_value, value, f"forward(inverse) gives {x.name} = {{1}} instead of {{0}}")
    for u, value in zip(m.new, new, strict=True):
        for kind, interval in (("domain", m.domain[u]), ("bounds", m.bounds.get(u, m.domain[u]))):
            lo, hi = values_of(interval, there)
            for end, room in ((lo, value - lo), (hi, hi - value)):
                enough = room >= -TOLERANCE * np.maximum(1.0, np.abs(end))
                covered(enough, end, value, f"{u.name} = {{1}} is beyond its {kind}, which end at {{0}}")
                share = np.broadcast_to(np.where(np.isfinite(room), room / np.maximum(1.0, np.abs(end)), np.inf), shape)
                least = np.minimum(least, share.reshape(len(places), -1).min(axis=1))
    return reached, least


def verify_reached(chain: Chain, m: Diffeomorphism, body: Expr) -> None:
    """Checks that a map reaches all of a nest, before parameters have values.

    Raises DiffeomorphismError. The check is made only if `check_at` has values for all parameters of the map and the bounds. Infinite
    bounds are not checked.
    """
    import numpy as np

    ends = [e for b in chain for e in (b.lo, b.hi)]
    known = parameters(*ends, *m.forward.values(), *m.inverse.values(), *(e for pair in m.domain.values() for e in pair))
    if any(isinstance(e, Const) and math.isinf(e.data) for e in ends) or not set(known) <= set(m.check_at):
        return
    every = list(dict.fromkeys([*known, *parameters(body)]))
    values = {p: np.asarray(v) for p, v in m.sample_values(every, 0).items()}
    verify_covered(chain, m, values, SAMPLES_ONCE, body, ROUNDS)


def verify_exact(chain: Chain, image: Chain, m: Diffeomorphism, body: Expr) -> None:
    """Checks, at sample points and values, that bounds given as the exact image of a nest are exact.

    Raises DiffeomorphismError unless they hold all of the nest where the integrand does not vanish, and nothing else.
    """
    import numpy as np

    if not _is_closed(chain) or not _is_closed(image):
        return
    ends = (e for b in (*chain, *image) for e in (b.lo, b.hi))
    known = parameters(*ends, *m.forward.values(), *m.inverse.values(), body)
    for trial in range(TRIALS):
        values = {p: np.asarray(v) for p, v in m.sample_values(known, trial).items()}
        verify_covered(chain, m, values, SAMPLES_ONCE, body, ROUNDS)
        at = _points_of(image, values, _places(SAMPLES, len(image)))
        there = {**at, **dict(zip(m.old, values_of(list(m.forward.values()), at), strict=True))}
        for b in chain:
            point, lo, hi = values_of([b.var, b.lo, b.hi], there)
            for end, room in ((np.minimum(lo, hi), point - np.minimum(lo, hi)), (np.maximum(lo, hi), np.maximum(lo, hi) - point)):
                text = f"which lies in the new bounds, {b.var.name} = {{1}} is beyond its old bound {{0}}"
                holds = room >= -TOLERANCE * np.maximum(1.0, np.abs(end))
                hint = "these are not the exact image: correct them, or leave out exact=True"
                hold(Samples(m, True, at), holds, (end, point), text, hint)


def _is_closed(chain: Chain) -> bool:
    """Returns whether the bounds can be evaluated from the outermost inwards."""
    known: set[Var] = set()
    for b in chain:
        if b.lo.has_integral or b.hi.has_integral or not b.lo.free | b.hi.free <= known:
            return False
        known.add(b.var)
    return True


def _points_of(chain: Chain, values: Mapping[Param, Any], places: np.ndarray) -> dict[Any, Any]:
    """Returns points of a nest, with their parameters. The points, rows of the unit cube, have an axis in front of the parameters' axes."""
    at: dict[Any, Any] = dict(values)
    behind = (1,) * max((len(v.shape) for v in values.values()), default=0)
    for i, b in enumerate(chain):
        lo, hi = values_of([b.lo, b.hi], at)
        at[b.var] = _between(lo, hi, places[:, i].reshape(-1, *behind))
    return at


def _between(lo: Any, hi: Any, part: np.ndarray) -> np.ndarray:
    """Returns points that lie this part of the way from lo to hi, by a rational substitution where a bound is infinite."""
    import numpy as np

    endless_lo, endless_hi = np.isneginf(lo), np.isposinf(hi)
    up, down = part / (1.0 - part), (1.0 - part) / part
    both = up - down
    from_lo, from_hi = np.where(endless_lo, 0.0, lo) + up, np.where(endless_hi, 0.0, hi) - down
    with np.errstate(invalid="ignore"):
        inside = lo + part * (hi - lo)
    return np.where(endless_lo & endless_hi, both, np.where(endless_hi, from_lo, np.where(endless_lo, from_hi, inside)))


@functools.lru_cache(maxsize=32)
def _places(count: int, dimensions: int) -> np.ndarray:
    """Returns points of the unit cube, as rows: Halton's sequence, and points just inside of up to MOST_CORNERS corners."""
    import numpy as np

    inside = np.stack([halton(count, axis) for axis in range(dimensions)], axis=1)
    if 2**dimensions > min(MOST_CORNERS, count):
        return inside
    corners = np.array(list(itertools.product((NEAR_END, 1.0 - NEAR_END), repeat=dimensions)))
    return np.concatenate([inside, corners])
