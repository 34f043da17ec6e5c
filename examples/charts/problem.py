"""An integral that every method gets in its own notation, from one definition.

The body of a problem is a function of a *notation* m, the variables and the parameters: `m.exp(x) * m.bracket(x < t)`. With `teg` as the
notation it is an expression, with NUMPY a plain vectorised integrand, with SCALAR one of Python numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

import teg
from teg.ir.expr import Expr, Param

Body = Callable[..., Any]
Bound = float | Callable[..., Any]  # a number, or a function of (m, the outer variables, parameters by name)


class TooManyEvaluationsError(Exception):
    """An integrand was evaluated more often than it may be."""


@dataclass(frozen=True)
class Problem:
    """∫…∫ body over `bounds`, innermost first, at the values of `parameters`; the gradient is by all parameters."""

    body: Body
    bounds: tuple[tuple[Bound, Bound], ...]
    parameters: Mapping[str, float]

    @property
    def dimension(self) -> int:
        return len(self.bounds)


def expression(problem: Problem) -> tuple[Expr, list[Param]]:
    """Returns the integral as an expression, and its parameters."""
    variables = [teg.var(name) for name in "xyz"[: problem.dimension]]
    symbols = {name: teg.param(name) for name in problem.parameters}
    e = problem.body(teg, *variables, **symbols)
    triples = [
        (x, *(bound_at(b, teg, variables[i + 1 :], symbols) for b in bounds))
        for i, (x, bounds) in enumerate(zip(variables, problem.bounds, strict=True))
    ]
    return teg.integral(e, *triples), list(symbols.values())


class Integrand:
    """A problem as a function of points, which counts its evaluations and may have a limit to them.

    `scalar(x, y, …)` takes numbers, innermost first, within `limits`; `on_cube(points)` takes an array (n, dimension) of
    points of the unit cube, and includes the Jacobian of the map to the problem's own bounds.
    """

    def __init__(self, problem: Problem, parameters: Mapping[str, float], most: float = math.inf) -> None:
        self.problem, self.parameters, self.most, self.evaluations = problem, dict(parameters), most, 0

    @property
    def dimension(self) -> int:
        return self.problem.dimension

    is_stopped = False
    """Whether the limit was passed without an error."""

    def scalar(self, *point: float) -> float:
        self._count(1)
        return float(self.problem.body(SCALAR, *point, **self.parameters))

    def limits(self, i: int) -> tuple[Callable[..., float], Callable[..., float]]:
        """Returns the bounds of variable i, as functions of the variables outside it."""
        lower, upper = self.problem.bounds[i]
        return lambda *outer: bound_at(lower, SCALAR, outer, self.parameters), lambda *outer: bound_at(
            upper, SCALAR, outer, self.parameters
        )

    def on_cube(self, points: np.ndarray) -> np.ndarray:
        self._count(len(points))
        weight: Any = 1.0
        inner: list[Any] = []
        with np.errstate(all="ignore"):
            for i in reversed(range(self.dimension)):
                lower, upper = (bound_at(b, NUMPY, inner, self.parameters) for b in self.problem.bounds[i])
                inner.insert(0, lower + (upper - lower) * points[:, i])
                weight = weight * (upper - lower)
            values = self.problem.body(NUMPY, *inner, **self.parameters) * weight
        return np.array(np.broadcast_to(values, len(points)), dtype=float)

    def _count(self, n: int) -> None:
        self.evaluations += n
        if self.evaluations > self.most:
            raise TooManyEvaluationsError


def bound_at(bound: Bound, m: Any, outer: Any, parameters: Mapping[str, Any]) -> Any:
    """Returns a bound as a number, or what it is in a notation at the outer variables."""
    return bound(m, *outer, **parameters) if callable(bound) else bound


def _or_nan(f: Callable[[float], float]) -> Callable[[float], float]:
    """Returns the function with NumPy's conventions: NaN outside of its domain, inf where it overflows."""

    def total(x: float) -> float:
        try:
            return f(x)
        except ValueError:
            return math.nan
        except OverflowError:
            return math.inf

    return total


FUNCTIONS = ("sin", "cos", "exp", "log", "sqrt", "abs", "floor", "minimum", "maximum", "where")
"""Functions that have the same name in NumPy and in JAX."""
NUMPY = SimpleNamespace(
    **{name: getattr(np, name) for name in FUNCTIONS},
    atan=np.arctan,
    bracket=lambda c: np.where(c, 1.0, 0.0),
)
SCALAR = SimpleNamespace(
    **{name: _or_nan(getattr(math, name)) for name in ["sin", "cos", "exp", "log", "sqrt", "atan"]},
    abs=abs,
    floor=math.floor,
    minimum=min,
    maximum=max,
    where=lambda c, a, b: a if c else b,
    bracket=lambda c: 1.0 if c else 0.0,
)
