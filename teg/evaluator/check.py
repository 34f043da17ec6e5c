"""`teg.check_gradient`: a gradient against differences of the value."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from teg.errors import OperandError, OptionError, ParameterError
from teg.evaluator.evaluator import Evaluator

if TYPE_CHECKING:
    import numpy as np

_OFFSETS = (1.0, 2.0, 3.0, 4.0)
_WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)  # central differences of order 8 (Fornberg 1988)
_STEPS = tuple(0.1 * 2.0**-k for k in range(4, 22, 2))


DIRECTIONS = 3
"""The number of random directions of an array, all of its entries at once,"""
ENTRIES = 4
"""and of single entries: the one with the largest derivative, and random ones."""


@dataclass(frozen=True)
class GradientReport:
    """The result of `teg.check_gradient`: a row for each parameter, `rows[name]` = (derivative, difference quotient, error).

    The error is their distance relative to max(1, |derivative|). An array has a row for each of some random directions, in which its
    largest entry is 1, and for some of its entries. `str()` is a table; a report is true if all errors are within `tol`.

        f = teg.compile(e, [t, a])
        teg.check_gradient(f, t=0.5, a=2.0).rows["t"][0]    # 0.25
    """

    rows: dict[str, tuple[float, float, float]]
    tol: float

    @property
    def ok(self) -> bool:
        """Returns whether all errors are within the tolerance.

        teg.check_gradient(f, t=0.5, a=2.0).ok          # True
        """
        return all(error <= self.tol for _, _, error in self.rows.values())

    def __bool__(self) -> bool:
        return self.ok

    def __str__(self) -> str:
        width = max([9, *(len(k) for k in self.rows)])
        lines = [f"{'parameter':<{width}}  {'derivative':>24}  {'differences':>24}  {'error':>8}"]
        for k, (d, q, err) in self.rows.items():
            lines.append(f"{k:<{width}}  {d:>24.16g}  {q:>24.16g}  {err:>8.1e}  {'ok' if err <= self.tol else 'WRONG'}")
        return "\n".join(lines)

    __repr__ = __str__


def check_gradient(f: Evaluator, *args: Any, tol: float = 1e-6, seed: int = 0, **named: Any) -> GradientReport:
    """Returns a comparison of f's gradient at one point with central differences of order 8 of its value, a `GradientReport`.

        f = teg.compile(e, [t, a])
        teg.check_gradient(f, t=0.5, a=2.0).ok              # True

    Of ten steps the most consistent one counts. Arrays are moved in random directions, from `seed`, and some of their entries alone.
    Differences are good to some ten digits at best, and wrong where a step crosses a non-smooth point. `tol` is the largest error that
    passes.

    Raises OperandError for what is no evaluator, OptionError for one in single precision, ParameterError for a batch, and the errors of the
    call.
    """
    import numpy as np

    if not isinstance(f, Evaluator):
        raise OperandError(f"a gradient is checked of a compiled function, not of {type(f).__name__}", f, "f = teg.compile(e)")
    if f.dtype != "float64":
        raise OptionError(
            f"a gradient is checked in float64, and this evaluator's results are {f.dtype}", None, "their differences are noise"
        )
    offsets = np.array(_OFFSETS)
    values = _at_one_point(f, args, named)
    gradient = {name: [np.asarray(leaf, dtype=float) for leaf in _leaves(slopes)] for name, slopes in f.grad(values).items()}
    rows: dict[str, tuple[float, float, float]] = {}
    for p in f.wrt:
        if p.name in f.integers:
            continue  # a count has no differences
        here = np.asarray(values[p.name], dtype=float)
        scale = max(float(np.abs(here).max(initial=1.0)), 1.0)
        for row, direction in _directions(p.name, here.shape, gradient[p.name], seed):
            exact = np.array([np.sum(slopes * direction) for slopes in gradient[p.name]])
            quotients = []
            for h in (step * scale for step in _STEPS):
                steps = h * np.concatenate([offsets, -offsets])
                ys = f({**values, p.name: here + steps.reshape(-1, *[1] * here.ndim) * direction})
                table = np.asarray(_leaves(ys), dtype=float).reshape(-1, 8)
                quotients.append((table[:, :4] - table[:, 4:]) @ _WEIGHTS / h)
            spread = [np.abs(a - b).max() for a, b in itertools.pairwise(quotients)]
            best = quotients[int(np.nanargmin(spread)) + 1]
            worst = int(np.argmax(np.abs(best - exact)))
            error = float(abs(best[worst] - exact[worst]) / max(1.0, abs(exact[worst])))
            rows[row] = (float(exact[worst]), float(best[worst]), error)
    return GradientReport(rows, tol)


def _at_one_point(f: Evaluator, args: tuple[Any, ...], named: dict[str, Any]) -> dict[str, Any]:
    """Returns the values by name; raises ParameterError for a batch."""
    import numpy as np

    dimensions = f.dimensions
    given = f.by_name(args, named)
    for k, v in given.items():
        if np.ndim(v) != dimensions[k]:
            wanted = f"an array of {dimensions[k]} dimensions" if dimensions[k] else "numbers"
            message = f"a gradient is checked at one point, but {k!r} is an array of shape {np.shape(v)}"
            raise ParameterError(message, None, f"give {wanted}")
    return {k: v if dimensions[k] else float(v) for k, v in given.items()}


def _leaves(value: Any) -> list[Any]:
    """Returns the entries of nested tuples, in order."""
    flat: list[Any] = []
    stack = [value]
    while stack:
        top = stack.pop()
        if isinstance(top, tuple):
            stack.extend(reversed(top))
        else:
            flat.append(top)
    return flat


def _directions(name: str, shape: tuple[int, ...], gradient: Sequence[np.ndarray], seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yields directions of a parameter, with the titles of their rows."""
    import numpy as np

    if not shape:
        yield name, np.ones(())
        return
    size = int(np.prod(shape))
    random = np.random.default_rng(seed)
    for i in range(DIRECTIONS if size > 1 else 0):
        direction = random.normal(size=shape)
        yield f"{name}, direction {i + 1}", direction / np.abs(direction).max()
    if size:
        largest = int(np.argmax(np.nan_to_num(np.max([np.abs(slopes) for slopes in gradient], axis=0))))
        for place in dict.fromkeys([largest, *map(int, random.permutation(size)[: ENTRIES - 1])]):
            at = np.unravel_index(place, shape)
            direction = np.zeros(shape)
            direction[at] = 1.0
            yield f"{name}[{', '.join(map(str, map(int, at)))}]", direction
