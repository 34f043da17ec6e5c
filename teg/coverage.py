"""Do maps reach what they are used for? At sample points of the nests of a program, for the parameter values of every call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from teg.diffeomorphism import Diffeomorphism
from teg.expr import Expr, Param, Var
from teg.integral import Integral
from teg.nest import Binder, Chain
from teg.node import Node
from teg.numerics import values_of
from teg.traverse import parameters
from teg.verification import BATCH_SAMPLES, SAMPLES, SAMPLES_A_CALL, TOLERANCE, TRIALS, hold, shares

_LEAVE_OUT = "integrate inside the domain of the map, widen its `domain` or `bounds`, or leave the map out"


def verify_covered(chain: Chain, m: Diffeomorphism, values: Mapping[Param, Any], samples: int, body: Expr) -> bool:
    """Raise DiffeomorphismError if the map does not reach a sample point of a nest, outermost first, at parameter values (numbers, or
    arrays of one length), and the integrand, `body`, does not vanish there. Was it reached without asking the integrand?

    A nest with integrals in its bounds is passed over."""
    import numpy as np

    reached = True
    if not _is_closed(chain):
        return reached
    with np.errstate(all="ignore"):
        at = _points_of(chain, values, samples)
        old = [at[x] for x in m.old]
        new = values_of(list(m.inverse.values()), at)
        there: dict[Any, Any] = {**values, **dict(zip(m.new, new, strict=True))}
        shape = np.broadcast_shapes(*(np.shape(v) for v in at.values()))
        counts = np.all([np.broadcast_to(np.isfinite(v), shape) for v in old], axis=0)

        def covered(holds: Any, expected: Any, found: Any, text: str) -> None:
            nonlocal reached
            if np.any(counts & ~holds) and not (body.has_integral or body.has_delta):
                reached, holds = False, holds | (values_of([body], at)[0] == 0.0)
            hold(m, holds, counts, at, expected, found, f"which is integrated over, {text}", _LEAVE_OUT)

        for b in chain:
            for bound in values_of([b.lo, b.hi], at):
                hold(m, ~np.isinf(bound), True, at, bound, bound, f"the bound of {b.var.name} is {{1}}", _LEAVE_OUT)
        for x, given, found in zip(m.old, old, values_of(list(m.forward.values()), there), strict=True):
            same = np.abs(found - given) <= TOLERANCE * np.maximum(1.0, np.abs(given))
            covered(same, given, found, f"forward(inverse) gives {x.name} = {{1}} instead of {{0}}")
        for u, found in zip(m.new, new, strict=True):
            for kind, interval in (("domain", m.domain[u]), ("bounds", m.bounds.get(u, m.domain[u]))):
                lo, hi = values_of(interval, there)
                for end, room in ((lo, found - lo), (hi, hi - found)):
                    enough = room >= -TOLERANCE * np.maximum(1.0, np.abs(end))
                    covered(enough, end, found, f"{u.name} = {{1}} is beyond its {kind}, which end at {{0}}")
    return reached


def verify_exact(chain: Chain, image: Chain, m: Diffeomorphism, body: Expr) -> None:
    """Raise DiffeomorphismError if bounds that are said to be the exact image of a nest are not, at sample points and values: they hold
    all of it where the integrand does not vanish, and nothing else."""
    import numpy as np

    if not _is_closed(chain) or not _is_closed(image):
        return
    ends = (e for b in (*chain, *image) for e in (b.lo, b.hi))
    known = parameters(*ends, *m.forward.values(), *m.inverse.values(), body)
    for trial in range(TRIALS):
        values = {p: np.asarray(v) for p, v in m.sample_values(known, trial).items()}
        verify_covered(chain, m, values, SAMPLES, body)
        at = _points_of(image, values, SAMPLES)
        there = {**at, **dict(zip(m.old, values_of(list(m.forward.values()), at), strict=True))}
        for b in chain:
            point, lo, hi = values_of([b.var, b.lo, b.hi], there)
            for end, room in ((np.minimum(lo, hi), point - np.minimum(lo, hi)), (np.maximum(lo, hi), np.maximum(lo, hi) - point)):
                text = f"which lies in the new bounds, {b.var.name} = {{1}} is beyond its old bound {{0}}"
                hold(
                    m,
                    room >= -TOLERANCE * np.maximum(1.0, np.abs(end)),
                    True,
                    at,
                    end,
                    point,
                    text,
                    "these are not the exact image: correct them, or leave out exact=True",
                )


def _is_closed(chain: Chain) -> bool:
    """The bounds can be evaluated, from the outermost inwards."""
    known: set[Var] = set()
    for b in chain:
        if b.lo.has_integral or b.hi.has_integral or not b.lo.free | b.hi.free <= known:
            return False
        known.add(b.var)
    return True


def _points_of(chain: Chain, values: Mapping[Param, Any], samples: int) -> dict[Any, Any]:
    """Sample points of a nest, with their parameters; the points have an axis in front of that of the parameters."""
    at: dict[Any, Any] = dict(values)
    for i, b in enumerate(chain):
        lo, hi = values_of([b.lo, b.hi], at)
        at[b.var] = lo + shares(samples, i, at) * (hi - lo)
    return at


def nests_over(e: Expr, variables: Sequence[Var]) -> list[tuple[Chain, Expr]]:
    """The nests of integrals, from the outermost of the program inwards, that bind all these variables, and what they integrate."""
    wanted = set(variables)
    found: dict[tuple[Chain, Expr], None] = {}
    seen: set[tuple[Node, frozenset[Var]]] = set()
    stack: list[tuple[Node, Chain]] = [(e, ())]
    while stack:
        node, chain = stack.pop()
        key = (node, frozenset(b.var for b in chain) & wanted)
        if not node.has_integral or key in seen:
            continue
        seen.add(key)
        if isinstance(node, Integral):
            stack += [(node.lo, chain), (node.hi, chain)]
            inner = (*chain, Binder(node.var, node.lo, node.hi))
            if wanted <= {b.var for b in inner}:
                found[inner, node.body] = None
            else:
                stack.append((node.body, inner))
        else:
            stack.extend((c, chain) for c in node.children)
    return list(found)


class _Case(NamedTuple):
    """A map with the nests that it, or its inverse, is for; the parameters of it and their bounds, and of all with what is integrated."""

    map: Diffeomorphism
    nests: list[tuple[Diffeomorphism, Chain, Expr]]
    deciding: list[Param]
    every: list[Param]


class MapChecks:
    """The maps of a compiled program, verified for the parameter values of each call; what was verified last is not verified again."""

    def __init__(self, e: Expr, maps: Sequence[Diffeomorphism]) -> None:
        self.cases: list[_Case] = []
        for m in maps:
            nests = [(way, *found) for way in (m, m.inverse_map()) for found in nests_over(e, way.old)]
            ends = parameters(*(end for _, chain, _ in nests for b in chain for end in (b.lo, b.hi)))
            deciding = list(dict.fromkeys([*m.parameters, *ends]))
            every = list(dict.fromkeys([*deciding, *parameters(*(body for _, _, body in nests))]))
            self.cases.append(_Case(m, nests, deciding, every))
        self.verified: dict[int, object] = {}

    def run(self, values: Mapping[str, Any]) -> None:
        """Raise DiffeomorphismError if a map is none, or does not reach a nest, at parameter values: arrays of shape () or (n,)."""
        import numpy as np

        for i, case in enumerate(self.cases):
            n = max((len(values[p.name]) for p in case.every if values[p.name].ndim), default=1)
            chosen = np.unique(np.linspace(0, n - 1, min(n, BATCH_SAMPLES)).astype(int)) if n else np.zeros(0, dtype=int)
            columns = {p: np.broadcast_to(values[p.name], (n,))[chosen] for p in case.every}
            key = tuple(columns[p].tobytes() for p in case.deciding)
            if self.verified.get(i) == key:
                continue
            numbers = np.ones(len(chosen), dtype=bool)  # NaN in is NaN out, and no error
            for column in columns.values():
                numbers &= np.isfinite(column)
            if not numbers.any():
                continue
            at = {p: column[numbers] for p, column in columns.items()}
            case.map.verify({p: at[p] for p in case.map.parameters}, SAMPLES_A_CALL)
            reached = [verify_covered(chain, way, at, SAMPLES_A_CALL, body) for way, chain, body in case.nests]
            if all(reached) and numbers.all():
                self.verified[i] = key
