"""Second derivatives at ties: the mean of those on both sides.

Where a vertex lies in a corner of a box, or three lines run through one place, a gradient is continuous and a Hessian H jumps. It is a sum
over such places, each of which counts where several conditions hold, and all of them are ties at once: no order of the surfaces decides
them as one of the sides does. So where a program of second derivatives met a tie, it is run beside that place, with parameters p moved
along a direction d, forth and back,

    M(h) = ½(H(p + h·d) + H(p - h·d))        H(p) := 2·M(h) - M(2h)

where the places are apart, all in one arrangement. d is that of a product of the Hessian, which thus is the mean of both one-sided
derivatives of the gradient along d. A whole Hessian is taken along two directions without an order: entries that differ have more than
two sides, and are NaN. What d leaves tied keeps the mean over the two orders; so do results that have no limit along d, as where a line
turns on another one: there the gradient has ties of its own. Where surfaces meet at places only, these are NaN.

Cost: four runs, or eight; nothing where no tie is met.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from teg.evaluator.arguments import Call
from teg.ir.index import ArrayName
from teg.numerics.cells import apart
from teg.passes.differentiate.through_sums import Parameter

if TYPE_CHECKING:
    import numpy as np

STEP, SINGLE_STEP = 2.0**-36, 2.0**-16
"""The distance to either side, relative to the largest moved number: in double, and in single precision."""
SAME = 1e-5
"""A relative difference of results that have the same limit."""
RIGHT = 1e-9
"""A relative difference of a result that is right already."""

Run = Callable[[Call], Any]
"""A run of a kernel: gives an outcome."""


@dataclass(frozen=True)
class Rates:
    """The rates of change of a call's columns and arrays, by their numbers."""

    columns: dict[int, Any]
    arrays: dict[int, Any]


def along_product(directions: Sequence[tuple[Parameter, Parameter]], arguments: Sequence[Parameter], call: Call) -> Rates:
    """Returns the rates of a product: each parameter moves as its component of the direction says."""
    scalars = [p for p in arguments if not isinstance(p, ArrayName)]
    arrays = [p for p in arguments if isinstance(p, ArrayName)]
    found = Rates({}, {})
    for p, rate in directions:
        if isinstance(p, ArrayName):
            found.arrays[arrays.index(p)] = call.arrays[arrays.index(rate)]
        else:
            found.columns[scalars.index(p)] = call.columns[scalars.index(rate)]
    return found


def without_order(call: Call, seed: int) -> Rates:
    """Returns rates of all numbers that are no integers, each relative to its size, so that no few of them cancel."""
    import numpy as np

    sizes = [np.abs(np.asarray(c, dtype=np.float64)) for c in call.columns]
    most = max((float(s.max(initial=0.0)) for s in sizes), default=0.0) or 1.0
    rates = [apart(2 * k + seed) for k in range(len(sizes))]
    return Rates(
        {
            k: math.copysign(1.0 + abs(r), r) * np.where(s > 0.0, s, most)
            for k, (r, s) in enumerate(zip(rates, sizes, strict=True))
            if k not in call.integers
        },
        {},
    )


@dataclass(frozen=True)
class BothSides:
    """Calls of a kernel on both sides of a place. `which` of the results are second derivatives."""

    run: Run
    which: slice

    def beside(self, call: Call, rates: Rates, steps: float) -> np.ndarray:
        """Returns second derivatives so many steps away, (elements, numbers)."""
        return self.numbers(self.run(moved(call, rates, steps)).values)

    def numbers(self, values: Sequence[np.ndarray]) -> np.ndarray:
        """Returns the second derivatives among results, (elements, numbers)."""
        import numpy as np

        return np.concatenate([np.reshape(v, (len(v), -1)) for v in list(values)[self.which]], axis=1)

    def mean(self, call: Call, rates: Rates) -> tuple[np.ndarray, np.ndarray]:
        """Returns the mean of both sides, and which of its numbers have a limit."""
        import numpy as np

        with np.errstate(all="ignore"):
            near, far = (0.5 * (self.beside(call, rates, s) + self.beside(call, rates, -s)) for s in (1.0, 2.0))
            return 2.0 * near - far, _are_same(near, far)


def settled(outcome: Any, call: Call, sides: BothSides, rates: Callable[[Call], Sequence[Rates]], meets: Callable[[Call], bool]) -> Any:
    """Returns an outcome with second derivatives at ties as the mean of both sides.

    `rates` gives the directions, one or two; `meets` says of an element whether its surfaces meet at places only.
    """
    import numpy as np

    tied = _tied(outcome, call, sides.run)
    given = sides.numbers(outcome.values)
    result = given.copy()
    part = taken(call, tied)
    (means, known), *others = [sides.mean(part, r) for r in rates(part)]
    sure = known
    for other, also in others:
        sure = sure & also & _are_same(means, other)
    with np.errstate(all="ignore"):
        size = np.abs(np.where(np.isfinite(means), means, 0.0)).max(axis=1, keepdims=True, initial=0.0)
        changes = ~(np.abs(means - given[tied]) <= RIGHT * size)
    for row, k in enumerate(tied):
        finite = np.isfinite(given[k])
        if not sure[row][finite].all() and not meets(taken(call, [k])):
            continue
        better = np.where(sure[row], np.where(changes[row], means[row], given[k]), np.nan)
        result[k] = np.where(finite, better, given[k])
    return outcome._replace(values=_with_numbers(outcome.values, sides.which, result))


def gradient_is_same(sides: BothSides, call: Call) -> bool:
    """Returns whether a gradient is the same on both sides of a place."""
    rates = without_order(call, 0)
    return bool(_are_same(sides.beside(call, rates, 1.0), sides.beside(call, rates, -1.0)).all())


def taken(call: Call, elements: Sequence[int]) -> Call:
    """Returns a call of some elements of a batch."""
    import numpy as np

    which = np.asarray(elements, dtype=int)
    columns = [c[which] if c.ndim else c for c in call.columns]
    arrays = [a[which] if a.ndim > len(own) else a for a, own in zip(call.arrays, call.shapes, strict=True)]
    integers = {k: v[which] if np.ndim(v) else v for k, v in call.integers.items()}
    return call._replace(columns=columns, arrays=arrays, n=len(which), shape=(len(which),), integers=integers)


def moved(call: Call, rates: Rates, steps: float) -> Call:
    """Returns a call beside another one."""
    import numpy as np

    pairs = [(call.columns[k], r, 0) for k, r in rates.columns.items()]
    pairs += [(call.arrays[k], r, len(call.shapes[k])) for k, r in rates.arrays.items()]
    most, fastest = np.zeros(call.n), np.zeros(call.n)
    for value, rate, dimensions in pairs:
        most = np.maximum(most, _largest(np.where(np.asarray(rate) != 0.0, value, 0.0), dimensions))
        fastest = np.maximum(fastest, _largest(rate, dimensions))
    single = any(c.dtype == np.float32 for c in call.columns)
    step = steps * (SINGLE_STEP if single else STEP) * np.where(most > 0.0, most, 1.0) / np.where(fastest > 0.0, fastest, 1.0)
    columns, arrays = list(call.columns), list(call.arrays)
    for k, rate in rates.columns.items():
        columns[k] = np.asarray(columns[k] + step * rate, dtype=columns[k].dtype)
    for k, rate in rates.arrays.items():
        arrays[k] = arrays[k] + step.reshape(call.n, *[1] * len(call.shapes[k])) * rate
    return call._replace(columns=columns, arrays=arrays)


def _largest(values: Any, dimensions: int) -> np.ndarray:
    """Returns the largest size of an element's numbers, (n,) or ()."""
    import numpy as np

    sizes = np.abs(np.asarray(values, dtype=np.float64))
    return np.asarray(sizes.max(axis=tuple(range(sizes.ndim - dimensions, sizes.ndim)), initial=0.0))


def _are_same(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Returns which numbers are the same, relative to the largest one of the element."""
    import numpy as np

    with np.errstate(all="ignore"):
        both = np.maximum(np.abs(one), np.abs(other))
        size = np.where(np.isfinite(both), both, 0.0).max(axis=1, keepdims=True, initial=0.0)
        return np.abs(one - other) <= SAME * np.maximum(size, 1e-300)


def _tied(outcome: Any, call: Call, run: Run) -> list[int]:
    """Returns the elements that met ties; where a backend only knows whether any did, those of halves that do are looked for."""
    import numpy as np

    if isinstance(outcome.tied, np.ndarray):
        return [int(k) for k in np.flatnonzero(outcome.tied)]
    found, waiting = [], [list(range(call.n))]
    while waiting:
        some = waiting.pop()
        if len(some) == 1:
            found += some
            continue
        for half in (some[: len(some) // 2], some[len(some) // 2 :]):
            if np.any(run(taken(call, half)).tied):
                waiting.append(half)
    return sorted(found)


def _with_numbers(values: Sequence[np.ndarray], which: slice, numbers: np.ndarray) -> Any:
    """Returns results with other second derivatives, in the form they have."""
    import numpy as np

    rows, at = list(values), 0
    for k in range(len(rows))[which]:
        count = int(np.prod(np.shape(rows[k])[1:], dtype=int))
        rows[k] = numbers[:, at : at + count].reshape(np.shape(rows[k])).astype(rows[k].dtype)
        at += count
    return np.stack(rows) if isinstance(values, np.ndarray) else rows
