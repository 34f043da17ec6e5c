"""Judges what the compiler says of a program: right, said, wrong, crash, slow; or that the reference does not know."""

from __future__ import annotations

import hashlib
import json
import math
import signal
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.errors import CompilerError, TegError
from tests.fuzz.answer import Answer, answer, direction_of, parameters_of
from tests.fuzz.laws import by_law, moved
from tests.fuzz.reference import NoReferenceError
from tests.fuzz.syntax import Program, Term, build, worded

VALUE, SLOPE = 1e-9, 1e-8
"""Relative errors that are right whatever the estimate: ten times `tol`, and for derivatives what the differences are good for."""
VALUE_FLOOR, SLOPE_FLOOR = 1e-3, 1e-4
"""Sizes below which these are absolute."""
ADMITTED = 10
ORDER = ("right", "said", "slow", "wrong", "crash")
"""From good to bad."""


class OutOfTimeError(Exception):
    """The time limit of one program is over."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raises OutOfTimeError in the main thread."""

    def stop(*_: object) -> None:
        raise OutOfTimeError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@dataclass(frozen=True)
class Judgement:
    """Of one program in one backend."""

    verdict: str
    what: str = ""
    seconds: float = 0.0


@dataclass
class Outcome:
    """What one backend gave."""

    value: float = math.nan
    gradient: dict[str, float] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    refused: str = ""
    crashed: str = ""
    evaluator: Any = None
    arguments: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0


def written(program: Program) -> Term:
    """The tree that the compiler is given."""
    tree = by_law(worded(program.tree), program.law, program.seed)
    return moved(tree, program.far) if program.far else tree


def given_values(program: Program) -> dict[str, float | tuple[float, ...]]:
    """The values of parameters that the compiler is given."""
    if not program.far:
        return program.values
    return {k: tuple(e + program.far for e in v) if isinstance(v, tuple) else v + program.far for k, v in program.values.items()}


def run(program: Program, backend: str, limit: float = 20.0) -> Outcome:
    """Compiles a program, and asks for its value and gradient. Raises OutOfTimeError."""
    outcome = Outcome()
    outcome.arguments = {k: np.array(v) if isinstance(v, tuple) else v for k, v in given_values(program).items()}
    started = time.perf_counter()
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        try:
            with time_limit(limit):
                wrt = [teg.array(k) if isinstance(v, tuple) else teg.param(k) for k, v in program.values.items()]
                f = teg.compile(build(written(program)), wrt, backend=backend)
                value, gradient = f.value_and_grad(outcome.arguments)
                outcome.evaluator = f
                outcome.value, outcome.gradient = float(value), _flat(gradient)
        except OutOfTimeError:
            raise
        except CompilerError as problem:
            outcome.crashed = f"CompilerError: {str(problem)[:300]}"
        except TegError as problem:
            outcome.refused = f"{type(problem).__name__}: {problem.what[:200]}"
        except Exception as problem:
            outcome.crashed = f"{type(problem).__name__}: {str(problem)[:300]}"
    outcome.said = [str(w.message).splitlines()[0] for w in given if issubclass(w.category, teg.AccuracyWarning)]
    others = [f"{w.category.__name__}: {w.message}" for w in given if not issubclass(w.category, teg.AccuracyWarning)]
    if others and not outcome.crashed:
        outcome.crashed = "a warning of another kind: " + others[0][:200]
    outcome.seconds = time.perf_counter() - started
    return outcome


def _flat(gradient: Mapping[str, Any]) -> dict[str, float]:
    flat: dict[str, float] = {}
    for name, slopes in gradient.items():
        entries = np.asarray(slopes, float)
        if entries.ndim:
            flat.update({f"{name}[{k}]": float(v) for k, v in enumerate(entries)})
        else:
            flat[name] = float(entries)
    return flat


def judge(program: Program, known: Answer, backend: str, limit: float = 20.0) -> Judgement:
    """What is to be thought of a backend's answer."""
    try:
        outcome = run(program, backend, limit)
    except OutOfTimeError:
        return Judgement("slow", f"no answer in {limit:g} s", limit)
    if outcome.crashed:
        return Judgement("crash", outcome.crashed, outcome.seconds)
    if outcome.refused:
        return Judgement("said", outcome.refused, outcome.seconds)
    faults = [w for w in (_value_fault(outcome, known, limit), _slope_fault(outcome, known, limit)) if w]
    if not faults:
        return Judgement("right", "; ".join(outcome.said[:1]), outcome.seconds)
    what = "; ".join(faults)
    if outcome.said:
        return Judgement("said", f"{what} — {outcome.said[0]}", outcome.seconds)
    return Judgement("wrong", what, outcome.seconds)


def _value_fault(outcome: Outcome, known: Answer, limit: float) -> str:
    off = abs(outcome.value - known.value)
    if off <= VALUE * max(abs(known.value), VALUE_FLOOR) + ADMITTED * known.error:
        return ""
    estimate = _estimate(outcome, limit)
    if off <= ADMITTED * estimate:
        return ""
    return f"value {outcome.value!r} is {known.value!r}, off by {off:.2g}, estimate {estimate:.2g}"


def _slope_fault(outcome: Outcome, known: Answer, limit: float) -> str:
    if known.slope is None:
        return ""
    parts = [outcome.gradient[k] * d for k, d in known.direction.items()]
    slope = math.fsum(parts) if all(map(math.isfinite, parts)) else math.nan
    size = max(abs(known.slope), math.fsum(abs(p) for p in parts if math.isfinite(p)), SLOPE_FLOOR * max(1.0, abs(known.value)))
    off = abs(slope - known.slope)
    if off <= SLOPE * min(size, 1e3 * max(abs(known.slope), SLOPE_FLOOR)) + ADMITTED * known.slope_error:
        return ""
    estimate = _slope_estimate(outcome, known, limit)
    if off <= ADMITTED * estimate:
        return ""
    return f"derivative {slope!r} is {known.slope!r}, off by {off:.2g}, estimate {estimate:.2g}, along {_shown(known.direction)}"


def _shown(direction: Mapping[str, float]) -> str:
    return "(" + ", ".join(f"{k}: {v:.3g}" for k, v in direction.items()) + ")"


def _estimate(outcome: Outcome, limit: float) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with time_limit(limit):
                return float(outcome.evaluator.value_and_error(outcome.arguments)[1])
        except (TegError, OutOfTimeError):
            return math.nan


def _slope_estimate(outcome: Outcome, known: Answer, limit: float) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with time_limit(limit):
                errors = _flat(outcome.evaluator.grad_and_error(outcome.arguments)[1])
        except (TegError, OutOfTimeError):
            return math.nan
    return math.fsum(abs(errors[k] * d) for k, d in known.direction.items())


def known_of(program: Program, limit: float) -> Answer | str:
    """The reference's answer, or why there is none."""
    try:
        with time_limit(limit):
            return answer(program)
    except OutOfTimeError:
        return "the reference takes too long"
    except NoReferenceError as problem:
        return str(problem)


def digest(program: Program) -> str:
    """Names what the reference has to know of a program."""
    return hashlib.sha256(repr((program.tree, program.values, program.scales)).encode()).hexdigest()[:16]


def stored_references(path: Path) -> dict[str, Answer | str]:
    """References that were kept in a file, by digest."""
    if not path.exists():
        return {}
    found: dict[str, Answer | str] = {}
    for line in path.read_text().splitlines():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:  # the end of a run that was interrupted
            continue
        known = record["known"]
        found[record["digest"]] = known if isinstance(known, str) else Answer(**known)
    return found


def agreement(program: Program, backend: str, limit: float) -> Judgement:
    """Judges a program without a reference: by what the same backend gives for the program before the law."""
    try:
        one, other = run(replace(program, law=""), backend, limit), run(program, backend, limit)
    except OutOfTimeError:
        return Judgement("slow", f"no answer in {limit:g} s", limit)
    for outcome in (one, other):
        if outcome.crashed:
            return Judgement("crash", outcome.crashed, outcome.seconds)
        if outcome.refused or outcome.said:
            return Judgement("said", outcome.refused or outcome.said[0], outcome.seconds)
    direction = direction_of(program)
    slope = math.fsum(one.gradient[k] * d for k, d in direction.items()) if all(map(math.isfinite, one.gradient.values())) else math.nan
    try:
        with time_limit(limit):
            error = float(one.evaluator.value_and_error(one.arguments)[1])
    except (TegError, OutOfTimeError):
        error = 0.0
    slope_error = _slope_estimate(one, Answer(0.0, 0.0, direction=direction), limit)
    known = Answer(one.value, error, slope, slope_error if math.isfinite(slope_error) else 0.0, direction)
    faults = [w for w in (_value_fault(other, known, limit), _slope_fault(other, known, limit)) if w]
    return Judgement("wrong", f"not as before the law: {'; '.join(faults)}") if faults else Judgement("right")


def worst(judgements: Sequence[Judgement]) -> str:
    return max((j.verdict for j in judgements), key=ORDER.index)


__all__ = ["Judgement", "agreement", "judge", "known_of", "parameters_of", "run", "worst"]
