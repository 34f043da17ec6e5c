"""Whether a map is one-to-one with the given inverse and Jacobian, decided at sample points.

Points are from Halton's sequence (1960), the same in every run. Every element of a batch of parameter values is checked.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

from teg.analysis.calculus import slope
from teg.analysis.evaluate import values_of
from teg.analysis.intervals import Interval
from teg.errors import DiffeomorphismError
from teg.ir.expr import Expr, Param, Var
from teg.ir.show import number

if TYPE_CHECKING:
    import numpy as np

SAMPLES = 256
"""The number of points of the domain at which a map is verified when it is made."""
TRIALS = 2
"""The number of sets of parameter values at which it is verified then."""
SAMPLES_A_CALL = 8
BATCH_SAMPLES = 64
"""The number of elements of a batch whose parameter values are verified in one call."""
TOLERANCE = 1e-6
"""The tolerance of identities, relative to the extent of a domain or the size of a variable. Well-posed maps have 1e-12."""
_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19)


class Constraint(NamedTuple):
    """lo < value < hi on the new variables: an additional condition for a domain that is not a box."""

    value: Expr
    lo: Expr
    hi: Expr


class Map(Protocol):
    """The interface of the maps that are verified (`teg.Diffeomorphism`)."""

    @property
    def forward(self) -> Mapping[Var, Expr]: ...
    @property
    def inverse(self) -> Mapping[Var, Expr]: ...
    @property
    def domain(self) -> Mapping[Var, Interval]: ...
    @property
    def jacobian(self) -> Expr: ...
    @property
    def within(self) -> Sequence[Constraint]: ...


def verify(m: Map, values: Mapping[Param, Any], samples: int, derive: bool) -> None:
    """Checks a map at parameter values (numbers, or arrays of one length). Raises DiffeomorphismError.

    At each point u of the domain: inverse(forward(u)) = u; the Jacobian is a number, not 0 and of one sign; with `derive`, it is the
    determinant of the derivatives.
    """
    import numpy as np

    with np.errstate(all="ignore"):
        at: dict[Any, Any] = {p: np.asarray(v, dtype=np.float64) for p, v in values.items()}
        at |= _points(m.domain, at, samples)
        shape = np.broadcast_shapes(*(np.shape(v) for v in at.values()))
        inside = np.ones(shape, dtype=bool)
        for c in m.within:
            value, lo, hi = values_of(c, at)
            inside &= (lo < value) & (value < hi)
        sampled = Samples(m, inside, at)
        olds = dict(zip(m.forward, values_of([*m.forward.values()], at), strict=True))
        for x, value in olds.items():
            hold(sampled, np.isfinite(value), (value, value), f"the forward map gives {x.name} = {{1}}")
        back = values_of([*m.inverse.values()], {**at, **olds})
        for u, value in zip(m.inverse, back, strict=True):
            lo, hi = values_of(m.domain[u], at)
            extent = np.where(np.isfinite(hi - lo), hi - lo, np.maximum(1.0, np.abs(at[u])))
            same = np.abs(value - at[u]) <= TOLERANCE * extent
            hold(sampled, same, (at[u], value), f"inverse(forward) gives {u.name} = {{1}} instead of {{0}}")
        _verify_jacobian(m, sampled, derive)


def _verify_jacobian(m: Map, samples: Samples, derive: bool) -> None:
    import numpy as np

    at, inside = samples.at, samples.inside
    determinant = np.broadcast_to(values_of([m.jacobian], at)[0], inside.shape)
    if derive:
        slopes = values_of([slope(e, u) for e in m.forward.values() for u in m.inverse], at)
        n = len(m.inverse)
        matrix = np.stack([np.broadcast_to(s, inside.shape) for s in slopes], axis=-1).reshape(*inside.shape, n, n)
        derived = np.linalg.det(matrix)
        same = np.abs(np.abs(determinant) - np.abs(derived)) <= TOLERANCE * np.abs(derived)
        hold(samples, same, (derived, determinant), "the Jacobian is {0} by differentiation, and {1} as given")
    regular = np.isfinite(determinant) & (determinant != 0.0)
    hold(samples, regular, (determinant, determinant), "the Jacobian is {1}")
    first = np.take_along_axis(determinant, np.argmax(inside, axis=0)[None], axis=0)
    text = "the Jacobian is {1}, and {0} at another point: it changes its sign"
    hold(samples, determinant * first > 0.0, (first, determinant), text)


_CORRECT = "correct the formulas, or restrict `domain`; if parameters cannot have these values, give others in `check_at`"


class Samples(NamedTuple):
    """Sample points of a map: the values `at` of variables and parameters, of which those marked `inside` count."""

    map: object
    inside: Any
    at: Mapping[Any, Any]


def hold(samples: Samples, holds: Any, values: tuple[Any, Any], text: str, hint: str = _CORRECT) -> None:
    """Raises DiffeomorphismError at the first sample point inside the domain where a condition does not hold.

    `values` are the expected and the computed value, {0} and {1} in the text.
    """
    import numpy as np

    at = samples.at
    failing = samples.inside & ~np.asarray(holds)
    if not failing.any():
        return
    shape = np.broadcast_shapes(failing.shape, *(np.shape(v) for v in at.values()))
    place = tuple(np.argwhere(np.broadcast_to(failing, shape))[0])
    point = {k.name: float(np.broadcast_to(v, shape)[place]) for k, v in at.items()}
    pair = cast("tuple[float, float]", tuple(float(np.broadcast_to(v, shape)[place]) for v in values))
    names = ", ".join(f"{k} = {number(v)}" for k, v in point.items())
    raise DiffeomorphismError(
        f"the map is not a diffeomorphism: at {names}, {text.replace('{0}', number(pair[0])).replace('{1}', number(pair[1]))}",
        samples.map,
        hint,
        point,
        pair,
    )


def _points(domain: Mapping[Var, Interval], at: Mapping[Any, Any], samples: int) -> dict[Any, Any]:
    """Returns points of a domain; unbounded intervals are sampled up to 100 units, or 5 on both sides."""
    import numpy as np

    points: dict[Any, Any] = {}
    for i, (v, ends) in enumerate(domain.items()):
        share = shares(samples, i, at)
        lo, hi = values_of(ends, at)
        odds = share / (1.0 - share)
        above = np.where(np.isfinite(hi), hi - 1.0 / odds, np.log(odds))
        points[v] = np.where(np.isfinite(lo), np.where(np.isfinite(hi), lo + share * (hi - lo), lo + odds), above)
    return points


def shares(count: int, axis: int, at: Mapping[Any, Any]) -> np.ndarray:
    """Returns points between 0.01 and 0.99 on one axis, an array whose axis stands in front of the axes of the values in `at`."""
    behind = (1,) * max((len(v.shape) for k, v in at.items() if isinstance(k, Param)), default=0)
    return 0.01 + 0.98 * halton(count, axis).reshape(-1, *behind)


@functools.lru_cache(maxsize=64)
def halton(count: int, axis: int) -> np.ndarray:
    """Returns points between 0 and 1 on one axis of Halton's sequence."""
    import numpy as np

    base = _PRIMES[axis % len(_PRIMES)]
    index, result, scale = np.arange(1, count + 1), np.zeros(count), 1.0
    while index.any():
        scale /= base
        result += scale * (index % base)
        index //= base
    return result
