"""This package's own rules, compiled."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

import teg
from teg.analysis.settings import Rule
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.charts.problem import Problem, expression

BATCH = 256
REPEATED = 0.03
"""Seconds for which a quick call is repeated."""


@dataclass(frozen=True)
class Timed:
    """Results of a call: a value, its gradient (None: not requested), seconds of one call and evaluations (None: not counted)."""

    value: float
    gradient: dict[str, float] | None
    seconds: float
    evaluations: int | None


def compiled(problem: Problem, rule: str, setting: float, backend: Backend, discontinuities: Discontinuities = "exact") -> Evaluator:
    """Returns the evaluator of a problem. The setting is a tolerance for the rules "auto" and "adaptive", an order for the others."""
    e, parameters = expression(problem)
    options: dict[str, Any] = {"tol": setting} if rule in ("auto", "adaptive") else {"order": int(setting)}
    return teg.compile(e, parameters, backend=backend, rule=cast(Rule, rule), discontinuities=discontinuities, **options)


def call(f: Evaluator, parameters: Mapping[str, float], derivatives: int) -> Timed:
    """Returns the results of one call at the parameters, and its cost."""
    value, gradient = f.value_and_grad(**parameters) if derivatives else (f(**parameters), None)
    slopes = None if gradient is None else {k: float(d) for k, d in gradient.items()}
    return Timed(float(value), slopes, seconds_of(f, parameters, derivatives), evaluations(f, parameters, derivatives))


def evaluations(f: Evaluator, parameters: Mapping[str, float], derivatives: int) -> int | None:
    """Returns the number of evaluations of the innermost integrands in one call, if the evaluator counts them."""
    count = getattr(f, "evaluations", None)
    return None if count is None else int(np.sum(count(**parameters, derivatives=derivatives)))


def seconds_in_a_batch(f: Evaluator, parameters: Mapping[str, float], derivatives: int) -> float:
    """Returns the seconds of one element of a batch of equal ones, without the cost of a call from Python."""
    return seconds_of(f, {k: np.full(BATCH, v) for k, v in parameters.items()}, derivatives) / BATCH


def seconds_of(f: Evaluator, parameters: Mapping[str, Any], derivatives: int) -> float:
    """Returns the seconds of the quickest of several calls; of one call, if it is slow."""
    run = f.value_and_grad if derivatives else f
    quickest, spent = np.inf, 0.0
    while spent < REPEATED:
        begun = time.perf_counter()
        run(**parameters)
        took = time.perf_counter() - begun
        quickest, spent = min(quickest, took), spent + took
    return float(quickest)
