"""The programs of docs/jax.md, and the ways to write each in JAX: sampled, softened, with quadax, with Teg.

A method makes a function of t of a program; its derivatives are then `jax.grad` of it, and `jax.grad` of that. Needs JAX's 64-bit mode.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import util
from typing import Any

import jax
import jax.numpy as jnp
import mpmath as mp

import teg

SAMPLES = {1: 4000, 2: 400}  # midpoints a side, by the number of variables
Function = Callable[[Any], Any]


@dataclass(frozen=True)
class Problem:
    """∫ weight · [all levels > 0] over a box, as a function of t.

    `levels` and `weight` take t and the variables, numbers, arrays of JAX or expressions; `exact` is the integral as a formula in t, for
    numbers of mpmath; `breaks`, for quadax, takes t and the outer variables: none gives the outer breaks, y gives the inner ones.
    """

    name: str
    formula: str
    t: float
    box: tuple[tuple[float, float], ...]
    levels: Callable[..., tuple[Any, ...]]
    exact: Callable[[Any], Any]
    weight: Callable[[Any, Any], Any] = lambda module, x: 1.0
    breaks: Callable[..., tuple[Any, ...]] | None = None

    @property
    def derivatives(self) -> list[float]:
        """The integral and its first and second derivative, to double precision."""
        with mp.workdps(40):
            return [float(c * math.factorial(k)) for k, c in enumerate(mp.taylor(self.exact, mp.mpf(self.t), 2))]


SLOPE = 1.2


def triangle_levels(t: Any, x: Any, y: Any) -> tuple[Any, ...]:
    """The corners are (0.2, 0.1), (t, 0.4) and (0.3, 0.8)."""
    corners = ((0.2, 0.1), (t, 0.4), (0.3, 0.8))
    pairs = zip(corners, corners[1:] + corners[:1], strict=True)
    return tuple((q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in pairs)


def triangle_area(t: Any) -> Any:
    """The triangle without its tip beyond x = 1."""
    fifth, quarter = mp.mpf("0.2"), mp.mpf("0.28")
    tip = (t - 1) * (mp.mpf("0.7") - quarter / (t - mp.mpf("0.3")) - mp.mpf("0.24") / (t - fifth))
    return (mp.mpf("0.7") * t - mp.mpf("0.17") - tip) / 2


PROBLEMS = (
    Problem(
        "a step",
        "∫₀¹ [x < t]·eˣ dx",
        0.3,
        ((0, 1),),
        lambda t, x: (t - x,),
        lambda t: mp.exp(t) - 1,
        lambda module, x: module.exp(x),
        lambda t: (t,),
    ),
    Problem(
        "a half-plane",
        "∫₀¹∫₀¹ [x + 1.2y < t]·eˣ dx dy",
        0.5,
        ((0, 1), (0, 1)),
        lambda t, x, y: (t - x - SLOPE * y,),
        lambda t: (mp.exp(t) - 1 - t) / mp.mpf("1.2"),
        lambda module, x: module.exp(x),
        breaks=lambda t, *y: (t - SLOPE * y[0],) if y else ((t - 1) / SLOPE, t / SLOPE),
    ),
    Problem(
        "a disk",
        "∫∫ [x² + y² < t²]·eˣ dx dy over [-1, 1]²",
        0.6,
        ((-1, 1), (-1, 1)),
        lambda t, x, y: (t * t - x * x - y * y,),
        lambda t: 2 * mp.pi * t * mp.besseli(1, t),
        lambda module, x: module.exp(x),
    ),
    Problem(
        "a triangle",
        "∫∫_pixel [inside (0.2, 0.1), (t, 0.4), (0.3, 0.8)] dx dy",
        1.4,
        ((0, 1), (0, 1)),
        triangle_levels,
        triangle_area,
    ),
)


# -- methods -----------------------------------------------------------------------------------------------------------


def sampled(problem: Problem) -> Function:
    """The mean over midpoints, a jump written as `jnp.where`: what a rasteriser does."""
    return lambda t: _mean(problem, lambda levels, w: jnp.where(jnp.all(jnp.stack(levels) > 0, axis=0), w, 0.0), t)


def softened(problem: Problem, width: float) -> Function:
    """The same with a sigmoid for each jump."""
    return lambda t: _mean(problem, lambda levels, w: w * jnp.prod(jax.nn.sigmoid(jnp.stack(levels) / width), axis=0), t)


def unmarked(problem: Problem) -> Function:
    """quadax, integrals nested, told nothing of jumps."""
    return _nested(problem, marked=False, adaptive=True)


def marked(problem: Problem) -> Function:
    """quadax, integrals nested, each told where its integrand jumps, or where the inner integral has a kink."""
    return _nested(problem, marked=True, adaptive=True)


def pieced(problem: Problem) -> Function:
    """The same with one rule on each piece instead of an adaptive integrator."""
    return _nested(problem, marked=True, adaptive=False)


def exact(problem: Problem) -> Function:
    """`teg.jax_function`."""
    t = teg.param("t")
    variables = teg.vars("x y")[: len(problem.box)]
    condition = None
    for g in problem.levels(t, *variables):
        condition = g > 0 if condition is None else condition & (g > 0)
    bounds = [(v, *ends) for v, ends in zip(variables, problem.box, strict=True)]
    f = teg.jax_function(teg.integral(teg.bracket(condition) * problem.weight(teg, variables[0]), *bounds))
    return lambda t: f(t=t)


def quadax_is_there() -> bool:
    """Whether the methods that need it can be run."""
    return util.find_spec("quadax") is not None


def _mean(problem: Problem, integrand: Callable[[Any, Any], Any], t: Any) -> Any:
    n = SAMPLES[len(problem.box)]
    lines = [lo + (jnp.arange(n) + 0.5) * ((hi - lo) / n) for lo, hi in problem.box]
    points = jnp.meshgrid(*lines)
    area = math.prod(hi - lo for lo, hi in problem.box)
    return area * jnp.mean(integrand(problem.levels(t, *points), problem.weight(jnp, points[0])))


def _nested(problem: Problem, marked: bool, adaptive: bool) -> Function:
    import quadax

    rule = quadax.GaussKronrodRule(21)

    def ends(lo: float, hi: float, breaks: tuple[Any, ...], like: Any) -> Any:
        inside = [jnp.clip(b, lo, hi) for b in breaks] if marked else []
        return jnp.sort(jnp.stack([lo + 0 * like, *inside, hi + 0 * like]))

    def integrand(x: Any, t: Any, *outer: Any) -> Any:
        inside = jnp.all(jnp.stack(problem.levels(t, x, *outer)) > 0, axis=0)
        return jnp.where(inside, problem.weight(jnp, x), 0.0)

    def integral(t: Any, *outer: Any) -> Any:
        level = len(problem.box) - 1 - len(outer)
        inner = integrand if level == 0 else lambda y, t: integral(t, y)
        breaks = problem.breaks(t, *outer) if problem.breaks else ()
        points, given = ends(*problem.box[level], breaks, t), (t, *outer)
        if adaptive:
            return quadax.quadgk(inner, points, args=given)[0]
        return sum(rule.integrate(inner, points[k], points[k + 1], given)[0] for k in range(len(points) - 1))

    return integral
