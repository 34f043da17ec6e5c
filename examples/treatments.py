"""The treatments of jumps that demonstrations compare: exact derivatives, those of plain automatic differentiation, smoothed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.ir.expr import Expr

LABELS = {
    "exact": "exact gradient",
    "ignore": "plain automatic differentiation",
    "smooth": "smoothed brackets",
    "differences": "finite differences",
}


@dataclass(frozen=True)
class SmoothedSlopes:
    """Exact values, and derivatives of a program whose brackets are softened."""

    exact: Evaluator
    smoothed: Evaluator

    @property
    def parameters(self) -> tuple[str, ...]:
        """Returns the names of the parameters."""
        return self.exact.parameters

    def value_and_grad(self, values: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Returns the exact value, and the derivatives of the softened program."""
        return self.exact(values), self.grad(values)

    def grad(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the derivatives of the softened program."""
        return self.smoothed.grad(values)


def compiled(e: Expr, wrt: Sequence[Any], backend: Backend, kind: Discontinuities, width: float, points: int = 8, threads: int = 1) -> Any:
    """Returns the evaluator of a program with these derivatives.

    Smoothed ones are those on a grid of `points` for each variable of integration. Sigmoids are half as wide as its cells, where `width` is
    the range of the variables.
    """
    if kind != "smooth":
        return teg.compile(e, wrt, backend=backend, discontinuities=kind, threads=threads)
    grid: dict[str, Any] = {"rule": "midpoint", "order": points, "sigma": width / (2 * points)}
    smoothed = teg.compile(e, wrt, backend=backend, discontinuities=kind, threads=threads, **grid)
    return SmoothedSlopes(teg.compile(e, wrt, backend=backend, threads=threads), smoothed)
