"""A difficult case of the stability table: a problem, and its exact answer as a closed form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from teg.examples.charts.problem import Bound, Problem

UNIT: tuple[Bound, Bound] = (0.0, 1.0)
SYMMETRIC: tuple[Bound, Bound] = (-1.0, 1.0)


@dataclass(frozen=True)
class Case:
    """A difficult case of the stability table.

    `exact(m, **parameters)` is the value near the parameters' values, with m the module mpmath; the derivatives come from it too. Where
    the one-sided derivatives differ (`kinked`) the right one is their mean, and where one of them is infinite it is given, in
    `infinite`. `scale` is the size by which an error is measured where the exact answer is 0.
    """

    name: str
    problem: Problem
    exact: Callable[..., Any]
    kinked: bool = False
    infinite: Mapping[str, float] = field(default_factory=dict)
    scale: float = 1.0


def case(
    name: str,
    body: Callable[..., Any],
    bounds: tuple[tuple[Bound, Bound], ...],
    parameters: Mapping[str, float],
    exact: Callable[..., Any],
    **options: Any,
) -> Case:
    """Returns a case. The body is a function of (m, variables, parameters in their order), `exact` of (m, parameters)."""

    def named(m: Any, *variables: Any, **values: Any) -> Any:
        return body(m, *variables, *(values[k] for k in parameters))

    return Case(name, Problem(named, bounds, parameters), lambda m, **values: exact(m, *(values[k] for k in parameters)), **options)
