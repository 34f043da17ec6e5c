"""Integrators that are asked where they are installed: the cubature package and quadax."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from teg.backends.jax.precision import in_double_precision
from teg.examples.charts.peers import Method, Outcome
from teg.examples.charts.problem import FUNCTIONS, Body, Bound, Integrand, Problem, bound_at

EVALUATIONS = {1: 42, 2: 66, 3: 154}
"""Those of one subdivision by quadax, by dimension: two Gauss-Kronrod rules of 21 points, or two Genz-Malik rules of degree 9."""


def hcubature(problem: Problem, parameters: Mapping[str, float], tol: float, most: float = math.inf) -> Outcome:
    """The cubature package (S. G. Johnson's hcubature): adaptive Genz-Malik, or Gauss-Kronrod in one variable; vectorised."""
    import cubature

    f, d = Integrand(problem, parameters), problem.dimension
    limit = 0 if math.isinf(most) else int(most)
    value, error = cubature.cubature(
        f.on_cube, d, 1, np.zeros(d), np.ones(d), abserr=0.0, relerr=tol, maxEval=limit, adaptive="h", vectorized=True
    )
    said = "not converged" if error[0] > tol * abs(value[0]) else ""
    return Outcome(float(value[0]), float(error[0]), said, f.evaluations)


def quadax(problem: Problem, parameters: Mapping[str, float], tol: float, most: float = math.inf) -> Outcome:
    """quadax, in JAX and in double precision: quadgk in one variable, cubegm (Genz-Malik of degree 9) in more; it knows infinite and
    moving bounds."""
    rounds = max(1, int(min(most, 10**6) / EVALUATIONS[problem.dimension]))
    with in_double_precision():
        value, error, status, evaluations = _solver(problem.body, problem.bounds, tuple(parameters), tol, rounds)(*parameters.values())
    return Outcome(float(value), float(error), "not converged" if status else "", int(evaluations))


@lru_cache(maxsize=2)
def _solver(body: Body, bounds: tuple[tuple[Bound, Bound], ...], names: Sequence[str], tol: float, rounds: int) -> Any:
    """Returns a compiled function of the parameters. The variables of quadax are outermost first."""
    import jax
    import jax.numpy as jnp
    from quadax import cubegm, quadgk

    m = SimpleNamespace(
        **{name: getattr(jnp, name) for name in FUNCTIONS},
        atan=jnp.arctan,
        bracket=lambda c: jnp.where(c, 1.0, 0.0),
    )

    def integrand(z: Any, *values: Any) -> Any:
        return body(m, *jnp.atleast_1d(z)[::-1], **dict(zip(names, values, strict=True))) * 1.0

    def limits(i: int) -> Any:
        def at(outer: Any, *values: Any) -> Any:
            known = dict(zip(names, values, strict=True))
            return jnp.stack([jnp.asarray(bound_at(b, m, outer[::-1], known), float) for b in bounds[i]])

        return at

    def solve(*values: Any) -> Any:
        if len(bounds) == 1:
            ends = limits(0)(jnp.zeros(0), *values)
            y, info = quadgk(integrand, ends, args=values, epsabs=0.0, epsrel=tol, max_ninter=rounds)
        else:
            axes: list[Any] = [limits(i) if any(callable(b) for b in bounds[i]) else bounds[i] for i in reversed(range(len(bounds)))]
            y, info = cubegm(integrand, axes, args=values, epsabs=0.0, epsrel=tol, max_nregion=rounds)
        return y, info.err, info.status, info.neval

    return jax.jit(solve)


OPTIONAL: dict[str, Method] = {"hcubature": hcubature, "quadax": quadax}
MODULES = {"hcubature": "cubature", "quadax": "quadax"}


def is_installed(name: str) -> bool:
    """Returns whether an optional package is installed; yes for all others."""
    return name not in MODULES or importlib.util.find_spec(MODULES[name]) is not None
