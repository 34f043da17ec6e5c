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
    """`exact(m, **parameters)` is the value near the parameters' values, m being mpmath; from it come the derivatives too.

    Where these differ from the two sides (`kinked`) the right one is their mean, and where one of them is infinite it is
    given, in `infinite`. `scale` is the size that an error is measured by where the exact answer is 0.
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
    """A case; the body is a function of (m, variables, parameters in their order), `exact` of (m, parameters)."""

    def named(m: Any, *variables: Any, **values: Any) -> Any:
        return body(m, *variables, *(values[k] for k in parameters))

    return Case(name, Problem(named, bounds, parameters), lambda m, **values: exact(m, *(values[k] for k in parameters)), **options)
