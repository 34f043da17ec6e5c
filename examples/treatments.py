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


@dataclass(frozen=True)
class Grid:
    """The grid of smoothed derivatives: so many points for each variable of integration, in a range of that width."""

    points: int
    width: float

    @property
    def sigma(self) -> float:
        """Returns the width of sigmoids: half a cell."""
        return self.width / (2 * self.points)


PIXEL = Grid(8, 1.0)


def compiled(e: Expr, wrt: Sequence[Any], backend: Backend, kind: Discontinuities, grid: Grid = PIXEL, threads: int = 1) -> Any:
    """Returns the evaluator of a program with these derivatives; smoothed ones are those of softened brackets on a grid."""
    if kind != "smooth":
        return teg.compile(e, wrt, backend=backend, discontinuities=kind, threads=threads)
    rule: dict[str, Any] = {"rule": "midpoint", "order": grid.points, "sigma": grid.sigma}
    smoothed = teg.compile(e, wrt, backend=backend, discontinuities=kind, threads=threads, **rule)
    return SmoothedSlopes(teg.compile(e, wrt, backend=backend, threads=threads), smoothed)
