"""The stability report: the gradient of every difficult case by every estimator and by other packages, and how each failed.

    right              off by at most 1e-9, relative
    imprecise          by at most 1e-2
    said in the call   by more, or no number, but the call said so: an error of this package, a warning, or an estimate of the error that
                       admits it (a fifth of the true one or more)
    said by diagnose   by more, and only `f.diagnose(…)` says that the derivative does not exist or is one-sided there
    silently wrong     by more, and nothing says so
    crash              any other exception
    too slow           more than MOST evaluations

The gradient is compared by its worst entry, relative to its largest one.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import teg
from teg import AccuracyWarning
from teg.errors import TegError
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend
from teg.examples.charts.case import Case
from teg.examples.charts.families_of_cases import FAMILIES
from teg.examples.charts.families_of_shapes import SHAPES
from teg.examples.charts.optional_peers import OPTIONAL, is_installed
from teg.examples.charts.peers import collected_warnings, gradient_error
from teg.examples.charts.problem import expression
from teg.examples.charts.references import Reference, case_reference, read
from teg.examples.charts.stability import GROUPS
from teg.examples.charts.verdicts import ADMITTED, IMPRECISE, RIGHT, peer_answers

CLASSES: dict[str, tuple[Case, ...]] = GROUPS | FAMILIES | SHAPES
SCORES = ("right", "imprecise", "said in the call", "said by diagnose", "silently wrong", "crash", "too slow")
SAMPLES, TOL, MOST = 2**12, 1e-12, 10**7
PATIENCE = 2.0
"""Seconds after which the evaluations of a call are counted."""
METHODS: dict[str, dict[str, Any]] = {
    "exact": {"tol": TOL},
    "edge-mc": {"discontinuities": "edge-mc", "samples": SAMPLES},
    "warp": {"discontinuities": "warp", "samples": SAMPLES},
    "warp-blur": {"discontinuities": "warp-blur", "samples": SAMPLES},
    "smooth": {"discontinuities": "smooth", "samples": SAMPLES},
    "differences": {"discontinuities": "differences", "samples": SAMPLES},
    "spsa": {"discontinuities": "spsa", "samples": SAMPLES},
    "ignore": {"discontinuities": "ignore", "tol": TOL},
}
PEERS = {
    "SciPy quad": ("dblquad", 1e-10, 5 * 10**5),
    "vegas": ("vegas", 2000.0, 5 * 10**5),
    "cubature": ("hcubature", 1e-10, 5 * 10**5),
    "quadax": ("quadax", 1e-10, 10**5),
}
"""Other packages, whose gradients are central differences: the method, its setting, and the most evaluations of one integral, fewer where
their number makes each slower. The last two are asked where they are installed."""
COLUMNS = (*METHODS, *PEERS)
PEERLESS = ("conditions on integrals",)
"""Classes whose bodies other packages cannot be given."""
FINITE_ONLY = ("vegas", "cubature")
"""Packages that have no infinite bounds."""
WORDS = {"says it cannot": "said in the call", "wrong": "silently wrong", "crashes": "crash"}
Answer = dict[str, Any]  # score, error, note


def cases() -> dict[str, tuple[str, Case]]:
    """Returns the class and the case of each name."""
    return {c.name: (name, c) for name, group in CLASSES.items() for c in group}


def reference_of(case: Case) -> Reference:
    """Returns the exact value and gradient of a case: stored ones, or those of its closed form."""
    stored = read("stability")
    if case.name in stored:
        return stored[case.name]
    value, gradient = case_reference(case)
    return Reference(str(value), {k: str(d) for k, d in gradient.items()})


def judge(case: Case, backend: Backend, methods: Sequence[str] = COLUMNS) -> dict[str, Answer]:
    """Returns the answer of each estimator, and of each package that can be asked, to a case."""
    exact = reference_of(case)
    asked = [m for m in methods if can_be_asked(m, case)]
    return {m: answer(case, exact, m, backend) if m in METHODS else answer_of_peer(case, exact, m) for m in asked}


def can_be_asked(method: str, case: Case) -> bool:
    """Returns whether a method takes a case: other packages must be installed, and some have no infinite bounds."""
    if method in METHODS:
        return True
    if any(case in CLASSES[name] for name in PEERLESS) or not is_installed(PEERS[method][0]):
        return False
    return method not in FINITE_ONLY or not any(isinstance(b, float) and math.isinf(b) for pair in case.problem.bounds for b in pair)


def answer_of_peer(case: Case, exact: Reference, name: str) -> Answer:
    """Returns the score of another package for one case, by differences with the best step (`verdicts`)."""
    method, setting, most = PEERS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = peer_answers(case, exact, method, OPTIONAL.get(method), setting, most)["gradient"]
    late = found["note"].startswith("no answer")
    return found | {"score": "too slow" if late else WORDS.get(found["verdict"], found["verdict"])}


def answer(case: Case, exact: Reference, method: str, backend: Backend) -> Answer:
    """Returns the score of one estimator for one case, the error of its gradient, and what it said."""
    values = case.problem.parameters
    try:
        with warnings.catch_warnings(), collected_warnings(AccuracyWarning) as said:
            warnings.simplefilter("ignore", RuntimeWarning)
            e, parameters = expression(case.problem)
            f = teg.compile(e, parameters, backend=backend, **METHODS[method])
            begun = time.perf_counter()
            slopes, estimates = _gradient(f, values, "samples" in METHODS[method])
            slow = time.perf_counter() - begun > PATIENCE and f.evaluations(**values, derivatives=1) > MOST
    except TegError as problem:
        return {"score": "said in the call", "error": "inf", "note": f"{type(problem).__name__}: {problem.what}"}
    except Exception as problem:
        return {"score": "crash", "error": "inf", "note": f"{type(problem).__name__}: {problem}"}
    error = gradient_error(slopes, exact.gradient, case.scale)
    admitted = bool(said) or any(_admits(slopes[k], estimates.get(k, 0.0), d) for k, d in exact.gradient.items())
    score = "too slow" if slow else score_of(error, admitted)
    if score == "silently wrong" and method in ("exact", "ignore") and f.diagnose(**values):
        score = "said by diagnose"
    return {"score": score, "error": error if math.isfinite(error) else str(error), "note": "; ".join(said)}


def _gradient(f: Evaluator, values: Mapping[str, float], is_sampled: bool) -> tuple[dict[str, float], dict[str, float]]:
    """Returns the gradient, and the standard errors of a sampled one."""
    if not is_sampled:
        return {k: float(d) for k, d in f.grad(**values).items()}, {}
    slopes, errors = f.grad_and_error(**values)
    return {k: float(d) for k, d in slopes.items()}, {k: float(d) for k, d in errors.items()}


def _admits(slope: float, estimate: float, exact: float) -> bool:
    """Returns whether an estimate of an error that is not 0 admits the true one."""
    return not math.isfinite(slope) or (estimate > 0 and abs(slope - exact) <= ADMITTED * estimate)


def score_of(error: float, admitted: bool) -> str:
    """Returns the score of an error."""
    if error <= RIGHT:
        return "right"
    if error <= IMPRECISE:
        return "imprecise"
    return "said in the call" if admitted else "silently wrong"


def counts(answers: Mapping[str, Mapping[str, Answer]]) -> dict[str, dict[str, int]]:
    """Returns, for each method, the number of cases of each score."""
    return {m: {s: sum(a[m]["score"] == s for a in answers.values() if m in a) for s in SCORES} for m in columns(answers)}


def columns(answers: Mapping[str, Mapping[str, Answer]]) -> list[str]:
    """Returns the methods that were asked."""
    return [m for m in COLUMNS if any(m in a for a in answers.values())]


def shares(answers: Mapping[str, Mapping[str, Answer]]) -> dict[str, dict[str, dict[str, int]]]:
    """Returns the same for each class of cases."""
    found, none = {}, {m: dict.fromkeys(SCORES, 0) for m in columns(answers)}
    for name, group in CLASSES.items():
        mine = {c.name: answers[c.name] for c in group if c.name in answers}
        if mine:
            found[name] = none | counts(mine)
    return found
