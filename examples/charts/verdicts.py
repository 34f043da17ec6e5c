"""The stability table: every difficult case by every method, and the verdicts on the answers.

    right            off by at most 1e-9, relative
    imprecise        by at most 1e-2
    says it cannot   by more, or no number at all, but not silently: an error of the package's own, a warning, a diagnosis, an
                     estimate of the error that admits it (a fifth of the true one or more), or no answer within the evaluations;
                     ours must say it in the call, `diagnose` does not count
    wrong            by more, silently
    crashes          any other exception

A value is compared with the exact one, relative to it; a gradient by its worst entry, relative to its largest one. Where the exact
answer is 0, errors are relative to the case's scale. Where one-sided derivatives differ, their mean is right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from teg import AccuracyWarning
from teg.errors import TegError
from teg.evaluator.options import Backend
from teg.examples.charts.case import Case
from teg.examples.charts.ours import compiled
from teg.examples.charts.peers import PEERS, Method, Outcome, best_step, collected_warnings, differences, gradient_error, relative_error
from teg.examples.charts.problem import Problem, TooManyEvaluationsError
from teg.examples.charts.references import Reference

RIGHT, IMPRECISE = 1e-9, 1e-2
VERDICTS = ("right", "imprecise", "says it cannot", "wrong", "crashes")
ADMITTED = 5
"""A method admits its error if its estimate, times this, covers the error."""
TOL = 1e-10
"""The tolerance of all methods that take one."""
MOST = 5 * 10**5
"""The most evaluations of one integral by another method."""
MIDPOINTS = {1: 5 * 10**5, 2: 700}
SETTINGS = {"dblquad": TOL, "cubature": TOL, "vegas": 10**4}
"""Ten times vegas's own number of samples."""
DIFFERENCED, PLAIN = "ours, differenced", "plain automatic differentiation"
COLUMNS: dict[str, tuple[str, ...]] = {
    "ours": ("value", "gradient"),
    **dict.fromkeys(PEERS, ("value", "gradient")),
    DIFFERENCED: ("gradient",),
    PLAIN: ("gradient",),
}

Answer = dict[str, Any]  # verdict, error, note


def verdict(error: float, admitted: bool) -> str:
    if error <= RIGHT:
        return "right"
    if error <= IMPRECISE:
        return "imprecise"
    return "says it cannot" if admitted else "wrong"


def judge(case: Case, exact: Reference, method: str, backend: Backend) -> dict[str, Answer]:
    """Returns the answers of one method to one case: "value", "gradient" or both."""
    if method == "ours":
        return _ours(case, exact, backend)
    if method == PLAIN:
        return {"gradient": _guarded(lambda: _plain(case, exact, backend))}
    if method == DIFFERENCED:
        return {"gradient": _guarded(lambda: _differences_of_ours(case, exact, backend))}
    return peer_answers(case, exact, method, None, SETTINGS.get(method) or MIDPOINTS[case.problem.dimension], MOST)


def _answer(error: float, note: str, admitted: bool) -> Answer:
    return {"verdict": verdict(error, admitted), "error": error if math.isfinite(error) else str(error), "note": note}


def _guarded(attempt: Callable[[], Answer], refusals: type[Exception] = TegError) -> Answer:
    """Returns the answer of an attempt, or the verdict on its exception.

    An error of this package is a refusal of ours; in an attempt of another package it is a fault of this program, and is raised.
    """
    try:
        return attempt()
    except TooManyEvaluationsError:
        return {"verdict": "says it cannot", "error": "inf", "note": "no answer in so many evaluations"}
    except TegError as problem:
        if not isinstance(problem, refusals):
            raise
        return {"verdict": "says it cannot", "error": "inf", "note": f"{type(problem).__name__}: {problem.what}"}
    except Exception as problem:
        return {"verdict": "crashes", "error": "inf", "note": f"{type(problem).__name__}: {problem}"}


def _ours(case: Case, exact: Reference, backend: Backend) -> dict[str, Answer]:
    parameters = case.problem.parameters

    def value() -> Answer:
        with collected_warnings(AccuracyWarning) as said:
            number = float(compiled(case.problem, "auto", TOL, backend)(**parameters))
        return _answer(relative_error(number, exact.value, case.scale), "; ".join(said), bool(said))

    def gradient() -> Answer:
        with collected_warnings(AccuracyWarning) as said:
            f = compiled(case.problem, "auto", TOL, backend)
            slopes = f.grad(**parameters)
        return _answer(gradient_error(slopes, exact.gradient, case.scale), "; ".join(said), bool(said))

    return {"value": _guarded(value), "gradient": _guarded(gradient)}


def _plain(case: Case, exact: Reference, backend: Backend) -> Answer:
    with collected_warnings(AccuracyWarning) as said:
        slopes = compiled(case.problem, "auto", TOL, backend, "ignore").grad(**case.problem.parameters)
    return _answer(gradient_error(slopes, exact.gradient, case.scale), "; ".join(said), bool(said))


def _differences_of_ours(case: Case, exact: Reference, backend: Backend) -> Answer:
    f = compiled(case.problem, "auto", TOL, backend)

    def method(problem: Problem, parameters: Mapping[str, float], setting: float, most: float) -> Outcome:
        return Outcome(float(f(**parameters)))

    with collected_warnings(AccuracyWarning) as said:
        error = relative_error(method(case.problem, case.problem.parameters, TOL, math.inf).value, exact.value, case.scale)
        outcomes = differences(method, case.problem, TOL, best_step(DIFFERENCED, TOL, error))[0]
    error = gradient_error({k: o.value for k, o in outcomes.items()}, exact.gradient, case.scale)
    return _answer(error, "; ".join(dict.fromkeys(said)), bool(said))


def peer_answers(case: Case, exact: Reference, name: str, method: Method | None, setting: float, most: float) -> dict[str, Answer]:
    """Returns the answers of another package, one of PEERS or the given method: its value, and central differences over the best step."""
    problem, method = case.problem, method or PEERS[name]
    errors = [1.0]

    def value() -> Answer:
        outcome = method(problem, problem.parameters, setting, most)
        error = relative_error(outcome.value, exact.value, case.scale)
        errors.append(error)
        return _answer(error, _note(outcome), _admits(outcome, exact.value))

    def gradient() -> Answer:
        outcomes = differences(method, problem, setting, best_step(name, setting, errors[-1]), most)[0]
        error = gradient_error({k: o.value for k, o in outcomes.items()}, exact.gradient, case.scale)
        admitted = any(_admits(outcomes[k], d) for k, d in exact.gradient.items())
        return _answer(error, next((n for n in map(_note, outcomes.values()) if n), ""), admitted)

    answers = {"value": _guarded(value, TooManyEvaluationsError)}
    late = answers["value"]["note"].startswith("no answer")
    return answers | {"gradient": answers["value"] if late else _guarded(gradient, TooManyEvaluationsError)}


def _admits(outcome: Outcome, exact: float) -> bool:
    return bool(outcome.warning) or not math.isfinite(outcome.value) or abs(outcome.value - exact) <= ADMITTED * outcome.error


def _note(outcome: Outcome) -> str:
    estimate = "" if math.isnan(outcome.error) else f"own estimate of the error {outcome.error:.1e}"
    return "; ".join(filter(None, [outcome.warning, estimate]))
