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

Cost: one run for a product along which nothing jumps, else five; eight for a Hessian; nothing where no tie is met that matters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from teg.evaluator.arguments import Call
from teg.ir.expr import Param
from teg.ir.index import ArrayName
from teg.numerics.cells import apart
from teg.report.diagnose import Second

if TYPE_CHECKING:
    import numpy as np

STEP, SINGLE_STEP = 2.0**-36, 2.0**-16
"""The distance to either side, relative to the largest moved number: in double, and in single precision."""
SAME = 1e-5
"""A relative difference of results that have the same limit."""
CHANGE = 1e-6
"""A relative difference of the two sides of a jump."""
ROUNDING = 1e-10
"""The rounding of second derivatives, relative to a gradient by relative changes of parameters."""
RIGHT = 1e-8
"""A relative difference of a result that is right already."""

Argument = Param | ArrayName
Run = Callable[[Call], Any]
"""A run of a kernel: gives an outcome."""


@dataclass(frozen=True)
class Rates:
    """The rates of change of a call's columns and arrays, by their numbers."""

    columns: dict[int, Any]
    arrays: dict[int, Any]


def along_product(directions: Sequence[tuple[Argument, Argument]], arguments: Sequence[Argument], call: Call) -> Rates:
    """Returns the rates of a product: each parameter moves as its component of the direction says."""
    scalars = [p for p in arguments if isinstance(p, Param)]
    arrays = [p for p in arguments if isinstance(p, ArrayName)]
    found = Rates({}, {})
    for p, rate in directions:
        if isinstance(p, ArrayName) and isinstance(rate, ArrayName):
            found.arrays[arrays.index(p)] = call.arrays[arrays.index(rate)]
        elif isinstance(p, Param) and isinstance(rate, Param):
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

        return np.concatenate([np.reshape(v, (len(v), math.prod(np.shape(v)[1:]))) for v in list(values)[self.which]], axis=1)

    def means(self, call: Call, rates: Rates) -> tuple[np.ndarray, np.ndarray]:
        """Returns the mean of both sides, and how far it changes with the distance."""
        import numpy as np

        with np.errstate(all="ignore"):
            near, far = (0.5 * (self.beside(call, rates, s) + self.beside(call, rates, -s)) for s in (1.0, 2.0))
            return 2.0 * near - far, np.abs(near - far)


class Ways(NamedTuple):
    """What is asked of an evaluator's program at ties: the directions of a call, one or two; the rounding of its second derivatives, one
    number for each element; and whether the surfaces of an element meet at places only."""

    rates: Callable[[Call], Sequence[Rates]]
    rounding: Callable[[Call], np.ndarray]
    meets: Callable[[Call], bool]


def settled(outcome: Any, call: Call, sides: BothSides, ways: Ways) -> Any:
    """Returns an outcome with second derivatives at ties as the mean of both sides."""
    import numpy as np

    given, result = (sides.numbers(outcome.values) for _ in range(2))
    tied = _tied(outcome, call, sides.run)
    part = taken(call, tied)
    rates = ways.rates(part)
    if len(rates) == 1:
        tied = [k for k, right in zip(tied, _are_right(given[tied], sides.beside(part, rates[0], 1.0)), strict=True) if not right]
        part = taken(call, tied)
        rates = ways.rates(part)
    if not tied:
        return outcome
    (means, off), *others = [sides.means(part, r) for r in rates]
    with np.errstate(all="ignore"):
        size = _largest_of(means)
        off = np.maximum.reduce([off, *(np.maximum(also, np.abs(means - other)) for other, also in others)])
        sure = off <= SAME * size
        if not sure.all():
            sure |= off <= ways.rounding(part)[:, None]
        right = np.abs(means - given[tied]) <= RIGHT * size
    for row, k in enumerate(tied):
        finite = np.isfinite(given[k])
        if sure[row][finite].all() or ways.meets(taken(call, [k])):
            better = np.where(sure[row], np.where(right[row], given[k], means[row]), np.nan)
            result[k] = np.where(finite, better, given[k])
    return outcome._replace(values=_with_numbers(outcome.values, sides.which, result))


def told(given: np.ndarray, call: Call, sides: BothSides, ways: Ways) -> list[Second]:
    """Returns what is known of the second derivatives of each element, `given` as (elements, numbers)."""
    import numpy as np

    rates = ways.rates(call)[0]
    with np.errstate(all="ignore"):
        above, below, beyond, farther = (sides.beside(call, rates, s) for s in (1.0, -1.0, 2.0, -2.0))
        size, rounding = np.maximum(_largest_of(above), _largest_of(below)), ways.rounding(call)[:, None]
        change, longer = np.abs(above - below), np.abs(beyond - farther)
        jumps = (change > np.maximum(CHANGE * size, rounding)) & ~(longer > 1.5 * change)
        is_mean = np.abs(given - 0.5 * (above + below)) <= np.maximum(SAME * size, rounding)
    finite = np.isfinite(given).all(axis=1)
    jumps &= (finite | np.isnan(given).any(axis=1))[:, None] & np.isfinite(change)
    is_mean |= ~np.isfinite(change) | (longer > 1.5 * change)
    return [Second(bool(f), bool(j.any()), bool(m.all())) for f, j, m in zip(finite, jumps, is_mean, strict=True)]


def rounding_of(gradient: np.ndarray, call: Call, rates: Rates) -> np.ndarray:
    """Returns a size below which second derivatives may be rounding errors, for each element; from its gradient, (elements, numbers)."""
    import numpy as np

    most, fastest = _sizes(call, rates)
    finite = np.where(np.isfinite(gradient), np.abs(gradient), 0.0)
    return np.asarray(ROUNDING * finite.max(axis=1, initial=0.0) * fastest / most)


def gradient_is_same(sides: BothSides, call: Call) -> bool:
    """Returns whether a gradient is the same on both sides of a place."""
    import numpy as np

    one, other = (sides.beside(call, without_order(call, 0), s) for s in (1.0, -1.0))
    with np.errstate(all="ignore"):
        return bool((np.abs(one - other) <= SAME * np.maximum(_largest_of(one), _largest_of(other))).all())


def taken(call: Call, elements: Sequence[int]) -> Call:
    """Returns a call of some elements of a batch."""
    import numpy as np

    which = np.asarray(elements, dtype=int)
    columns = [c[which] if c.ndim else c for c in call.columns]
    arrays = [a[which] if a.ndim > len(own) else a for a, own in zip(call.arrays, call.shapes, strict=True)]
    integers = {k: v[which] if np.ndim(v) else v for k, v in call.integers.items()}
    return call._replace(columns=columns, arrays=arrays, n=len(which), shape=(len(which),), integers=integers)


def only(call: Call, arguments: Sequence[Argument], kept: Sequence[Argument]) -> Call:
    """Returns a call with some of its arguments."""
    scalars = [p for p in arguments if isinstance(p, Param)]
    arrays = [p for p in arguments if isinstance(p, ArrayName)]
    numbers = [scalars.index(p) for p in kept if isinstance(p, Param)]
    data = [arrays.index(p) for p in kept if isinstance(p, ArrayName)]
    integers = {numbers.index(k): v for k, v in call.integers.items() if k in numbers}
    names, columns = [call.names[k] for k in numbers], [call.columns[k] for k in numbers]
    return Call(names, columns, [call.arrays[k] for k in data], call.n, call.shape, [call.shapes[k] for k in data], integers)


def moved(call: Call, rates: Rates, steps: float) -> Call:
    """Returns a call beside another one."""
    import numpy as np

    most, fastest = _sizes(call, rates)
    single = any(c.dtype == np.float32 for c in call.columns)
    step = steps * (SINGLE_STEP if single else STEP) * most / fastest
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


def _are_right(given: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Returns the elements with the second derivatives that they have beside their place: nothing jumps along the direction."""
    import numpy as np

    with np.errstate(all="ignore"):
        same = (np.abs(given - beside) <= RIGHT * _largest_of(beside)) | ~np.isfinite(given)
    return np.asarray(same.all(axis=1))


def _sizes(call: Call, rates: Rates) -> tuple[np.ndarray, np.ndarray]:
    """Returns the largest number that moves, and the largest rate, of each element; 1 in the place of 0."""
    import numpy as np

    most, fastest = np.zeros(call.n), np.zeros(call.n)
    pairs = [(call.columns[k], r, 0) for k, r in rates.columns.items()]
    pairs += [(call.arrays[k], r, len(call.shapes[k])) for k, r in rates.arrays.items()]
    for value, rate, dimensions in pairs:
        most = np.maximum(most, _largest(np.where(np.asarray(rate) != 0.0, value, 0.0), dimensions))
        fastest = np.maximum(fastest, _largest(rate, dimensions))
    return np.where(most > 0.0, most, 1.0), np.where(fastest > 0.0, fastest, 1.0)


def _largest_of(numbers: np.ndarray) -> np.ndarray:
    """Returns the size of the largest finite number of each element, (elements, 1)."""
    import numpy as np

    return np.asarray(np.abs(np.where(np.isfinite(numbers), numbers, 0.0)).max(axis=1, keepdims=True, initial=0.0))


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
