"""Other integrators: those of SciPy and vegas, and a uniform midpoint rule, on a plain integrand.

Only `split` is told where the integrand jumps. Each takes a problem, the values of its parameters, a setting and the most evaluations that
it may use, and returns a value with the method's own error estimate. Derivatives are central differences.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from teg.backends.c.build import find_compiler
from teg.errors import TegError
from teg.examples.charts.breaks import BREAKS
from teg.examples.charts.c_integrand import CIntegrand
from teg.examples.charts.problem import Integrand, Problem, TooManyEvaluationsError
from teg.examples.charts.regions import REGIONS

CHUNK = 2**20
"""The number of points of the midpoint rule that are evaluated at a time."""
TRAINING, ITERATIONS = 5, 10
"""The number of iterations in which vegas adapts, and of those that count, as in its documentation."""
LARGEST_COUNT = 10**6
"""The number of subdivisions of cubature, if there is no limit to the evaluations."""
SEED = 20210809
SMALLEST_STEP, LARGEST_STEP = 1e-5, 0.05
"""The range of steps of a central difference, relative to the parameter."""


@dataclass(frozen=True)
class Outcome:
    """A number, the method's own estimate of its error (NaN: none), a warning it gave, and the number of evaluations."""

    value: float
    error: float = math.nan
    warning: str = ""
    evaluations: int = 0


Method = Callable[[Problem, Mapping[str, float], float, float], Outcome]


def midpoint(problem: Problem, parameters: Mapping[str, float], n: float, most: float = math.inf) -> Outcome:
    """Midpoint rule with n points a variable."""
    f, side = Integrand(problem, parameters, most), int(n)
    total, points = 0.0, side**problem.dimension
    for first in range(0, points, CHUNK):
        index = np.arange(first, min(first + CHUNK, points))
        place = np.stack(np.unravel_index(index, (side,) * problem.dimension), axis=-1)
        total += float(f.on_cube((place + 0.5) / side).sum())
    return Outcome(total / points, evaluations=f.evaluations)


def dblquad(problem: Problem, parameters: Mapping[str, float], tol: float, most: float = math.inf) -> Outcome:
    """scipy.integrate.dblquad, or quad in one variable: QUADPACK, Gauss-Kronrod with extrapolation; the integrand in C, if there is a
    compiler."""
    from scipy import integrate

    f, scalar = _callback(problem, parameters, most)
    limits = [Integrand(problem, parameters).limits(i) for i in range(problem.dimension)]
    with collected_warnings(integrate.IntegrationWarning, others_shown=False) as said:
        if problem.dimension == 1:
            value, error = integrate.quad(scalar, limits[0][0](), limits[0][1](), epsabs=tol, epsrel=tol)[:2]
        else:
            value, error = integrate.dblquad(scalar, limits[1][0](), limits[1][1](), *limits[0], epsabs=tol, epsrel=tol)
    if f.is_stopped:
        raise TooManyEvaluationsError
    return Outcome(float(value), float(error), said[0] if said else "", f.evaluations)


def split(problem: Problem, parameters: Mapping[str, float], tol: float, most: float = math.inf) -> Outcome:
    """Nested scipy.integrate.quad over the pieces between the jumps of a region, which are known by hand (`breaks.py`); the integrand in
    C."""
    from scipy import integrate

    known = next(BREAKS[name] for name, p in REGIONS.items() if p is problem)
    f, scalar = _callback(problem, parameters, most)

    def pieces(places: Sequence[float]) -> list[tuple[float, float]]:
        return list(pairwise([0.0, *sorted(z for z in places if 0 < z < 1), 1.0]))

    def line(y: float) -> float:
        ends = pieces(known.inner(y, **parameters))
        return float(sum(integrate.quad(scalar, a, b, args=(y,), epsabs=tol, epsrel=tol)[0] for a, b in ends))

    with collected_warnings(integrate.IntegrationWarning, others_shown=False) as said:
        found = [integrate.quad(line, a, b, epsabs=tol, epsrel=tol)[:2] for a, b in pieces(known.outer(**parameters))]
    if f.is_stopped:
        raise TooManyEvaluationsError
    value, error = (float(sum(column)) for column in zip(*found, strict=True))
    return Outcome(value, error, said[0] if said else "", f.evaluations)


def _callback(problem: Problem, parameters: Mapping[str, float], most: float) -> tuple[Any, Any]:
    """Returns an integrand that counts its evaluations, and what SciPy is to call: C if there is a compiler, else Python."""
    if _has_compiler():
        compiled = CIntegrand(problem, parameters, most)
        return compiled, compiled.callback
    plain = Integrand(problem, parameters, most)
    return plain, plain.scalar


@cache
def _has_compiler() -> bool:
    try:
        find_compiler()
    except TegError:
        return False
    return True


@contextmanager
def collected_warnings(category: type[Warning], others_shown: bool = True) -> Iterator[list[str]]:
    """Collects the first lines of the warnings of a category, when the block has ended; others are shown as usual, or dropped."""
    said: list[str] = []
    with warnings.catch_warnings(record=True) as recorded:
        warnings.simplefilter("always")
        yield said
    for w in recorded:
        if issubclass(w.category, category):
            said += str(w.message).strip().splitlines()[:1]
        elif others_shown:
            warnings.warn_explicit(w.message, w.category, w.filename, w.lineno)


def cubature(problem: Problem, parameters: Mapping[str, float], tol: float, most: float = math.inf) -> Outcome:
    """scipy.integrate.cubature: adaptive Gauss-Kronrod (21 points a variable), vectorised."""
    from scipy import integrate

    f = Integrand(problem, parameters)
    d = problem.dimension
    rounds = int(min(most / (42.0**d), LARGEST_COUNT))  # each subdivision has 21 points a variable in 2 parts a variable
    result = integrate.cubature(f.on_cube, np.zeros(d), np.ones(d), rtol=tol, atol=0.0, max_subdivisions=rounds)
    said = "" if result.status == "converged" else "not converged"
    return Outcome(float(result.estimate), float(result.error), said, f.evaluations)


def vegas(problem: Problem, parameters: Mapping[str, float], samples: float, most: float = math.inf) -> Outcome:
    """The vegas package (Lepage): adaptive importance and stratified sampling; always with the same random numbers."""
    import gvar
    import vegas as package

    f = Integrand(problem, parameters, most)
    gvar.ranseed(SEED)
    integrator = package.Integrator([[0.0, 1.0]] * problem.dimension)
    batch = package.lbatchintegrand(lambda x: f.on_cube(np.asarray(x)))
    integrator(batch, nitn=TRAINING, neval=int(samples))
    result = integrator(batch, nitn=ITERATIONS, neval=int(samples))
    return Outcome(float(result.mean), float(result.sdev), "", f.evaluations)


PEERS: dict[str, Method] = {"midpoint": midpoint, "dblquad": dblquad, "cubature": cubature, "vegas": vegas}
"""What any problem can be given to."""
PACKAGES = {"scipy": "scipy>=1.15", "vegas": "vegas", "matplotlib": "matplotlib", "tqdm": "tqdm"}


def best_step(name: str, setting: float, relative_error: float) -> float:
    """Returns the step at which the error of a central difference, ε/h + h², is least: the cube root of the value's relative error ε.

    ε is the true error, which a user does not know, but at least the error that the method can be trusted to reach at this setting,
    because a value may be right by accident.
    """
    trusted = {"midpoint": 1 / setting, "vegas": 1 / setting, "qmc": 1 / setting, "montecarlo": setting**-0.5}.get(name, setting)
    known = relative_error if math.isfinite(relative_error) else 1.0
    return float(np.clip(max(known, trusted) ** (1 / 3), SMALLEST_STEP, LARGEST_STEP))


def differences(
    method: Method, problem: Problem, setting: float, step: float, most: float = math.inf
) -> tuple[dict[str, Outcome], int, float]:
    """Returns central differences by all parameters over `step` of their size: outcomes, evaluations, and seconds."""
    begun, outcomes, evaluations = time.perf_counter(), {}, 0
    for name, p in problem.parameters.items():
        h = step * (abs(p) or 1.0)
        high, low = p + h, p - h
        ahead, behind = (method(problem, {**problem.parameters, name: q}, setting, most) for q in (high, low))
        evaluations += ahead.evaluations + behind.evaluations
        error = (ahead.error + behind.error) / (high - low)
        outcomes[name] = Outcome((ahead.value - behind.value) / (high - low), error, ahead.warning or behind.warning)
    return outcomes, evaluations, time.perf_counter() - begun


def relative_error(got: float, exact: float, scale: float = 1.0) -> float:
    """Returns |got - exact| / |exact|, or / scale if that is 0; 0 for the same infinity, inf if anything else is not finite."""
    if got == exact:
        return 0.0
    if not (math.isfinite(got) and math.isfinite(exact)):
        return math.inf
    return abs(got - exact) / (abs(exact) or scale)


def gradient_error(got: Mapping[str, Any], exact: Mapping[str, float], scale: float = 1.0) -> float:
    """Returns the largest error of a derivative, relative to the largest finite derivative (or to the scale, if all are 0)."""
    size = max((abs(d) for d in exact.values() if math.isfinite(d)), default=0.0) or scale
    return max(_entry_error(float(got[k]), d, size) for k, d in exact.items())


def _entry_error(got: float, exact: float, size: float) -> float:
    if got == exact:
        return 0.0
    return abs(got - exact) / size if math.isfinite(got) and math.isfinite(exact) else math.inf
