"""`teg.check_gradient`: a gradient against differences of the value."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

from teg.compile import Evaluator
from teg.errors import ParameterError

_OFFSETS = (1.0, 2.0, 3.0, 4.0)
_WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)  # central differences of order 8 (Fornberg 1988)
_STEPS = tuple(0.1 * 2.0**-k for k in range(4, 22, 2))


@dataclass(frozen=True)
class GradientReport:
    """One row a parameter: the derivative, the difference quotient, and their distance relative to max(1, |derivative|)."""

    rows: dict[str, tuple[float, float, float]]
    tol: float

    @property
    def ok(self) -> bool:
        """All within the tolerance."""
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


def check_gradient(f: Evaluator, *args: Any, tol: float = 1e-6, **named: Any) -> GradientReport:
    """Compare f's gradient at one point with central differences of order 8 of its value; of ten steps the most consistent one counts.

    Differences are good to some ten digits at best, and wrong where a step crosses a non-smooth point.
    """
    import numpy as np

    offsets = np.array(_OFFSETS)
    given = f._values(args, named)
    for k, v in given.items():
        if np.ndim(v) != 0:
            raise ParameterError(f"a gradient is checked at one point, but {k!r} is an array of shape {np.shape(v)}", None, "give numbers")
    values = {k: float(v) for k, v in given.items()}
    gradient = f.grad(values)
    rows: dict[str, tuple[float, float, float]] = {}
    for p in f.wrt:
        exact = np.atleast_1d(np.asarray(gradient[p.name], dtype=float)).ravel()
        scale = max(abs(values[p.name]), 1.0)
        quotients = []
        for h in (step * scale for step in _STEPS):
            points = values[p.name] + h * np.concatenate([offsets, -offsets])
            ys = f({**values, p.name: points})
            table = np.asarray(ys, dtype=float).reshape(-1, 8)
            quotients.append((table[:, :4] - table[:, 4:]) @ _WEIGHTS / h)
        spread = [np.abs(a - b).max() for a, b in itertools.pairwise(quotients)]
        best = quotients[int(np.nanargmin(spread)) + 1]
        worst = int(np.argmax(np.abs(best - exact)))
        error = float(abs(best[worst] - exact[worst]) / max(1.0, abs(exact[worst])))
        rows[p.name] = (float(exact[worst]), float(best[worst]), error)
    return GradientReport(rows, tol)
