"""The integral: the action of a ball between two points of space-time, in a lift, with contacts on its floor and ceiling.

    S = ∫₀ᵀ (½m·v(t)² - m·g·h(t)) dt

The path has an arc between any two contacts, a parabola through three points: its two ends and its height half-way in time. Brackets [t
< contact] select the arc at time t. The contacts are where the floor or the ceiling is at that time, so h is continuous. v is not: the
integrand jumps at every contact. Its derivative by the time of a contact has a boundary term there, which the compiler makes, like all
others.
"""

from __future__ import annotations

from dataclasses import dataclass

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.treatments import Grid, compiled
from teg.ir.expr import Expr, Param
from teg.ir.operands import as_number

GIVEN = ("duration", "start", "end", "speed", "room", "mass", "gravity")
SMOOTH_POINTS = 256  # of smoothed derivatives


def contact_names(contacts: int) -> list[str]:
    """Returns the names of the contacts' times."""
    return [f"time_{k}" for k in range(1, contacts + 1)]


def height_names(contacts: int) -> list[str]:
    """Returns the names of the arcs' heights half-way."""
    return [f"height_{k}" for k in range(contacts + 1)]


def action(contacts: int) -> Expr:
    """Returns the action of a path with that many contacts: floor, ceiling, floor, …; the floor is at height speed·t."""
    t = teg.var("t")
    duration, start, end, speed, room, mass, gravity = (teg.param(name) for name in GIVEN)
    contact_times = [teg.param(name) for name in contact_names(contacts)]
    times = [as_number(0), *contact_times, duration]
    heights = [start, *(speed * s + room * (k % 2) for k, s in enumerate(contact_times)), end]

    def lagrangian(arc: int, middle: Param) -> Expr:
        begin, length = times[arc], times[arc + 1] - times[arc]
        first, last = heights[arc], heights[arc + 1]
        u = (t - begin) / length
        slope, bend = 4 * middle - 3 * first - last, 2 * first - 4 * middle + 2 * last
        h = first + u * (slope + u * bend)
        v = (slope + 2 * u * bend) / length
        return mass * v**2 / 2 - mass * gravity * h

    *arcs, selected = (lagrangian(k, teg.param(name)) for k, name in enumerate(height_names(contacts)))
    for arc, contact in zip(reversed(arcs), reversed(contact_times), strict=True):
        selected = teg.where(t < contact, arc, selected)
    return teg.integral(selected, (t, 0, duration))


@dataclass(frozen=True)
class CompiledScene:
    """The action, to be differentiated by times and heights, its second derivative by each height, and whether derivatives are exact."""

    action: Evaluator
    curvature: Evaluator
    is_exact: bool


def compile_scene(contacts: int, backend: Backend, discontinuities: Discontinuities = "exact", seconds: float = 1.0) -> CompiledScene:
    """Returns the compiled action. It is quadratic in the heights without mixed terms: one Newton step finds the best heights.

    Smoothed derivatives are for a flight of that many `seconds`.
    """
    path = action(contacts)
    heights = [teg.param(name) for name in height_names(contacts)]
    moving = [teg.param(name) for name in contact_names(contacts)] + heights
    curvature = teg.tuple(*(teg.diff(teg.diff(path, h), h) for h in heights))
    return CompiledScene(
        compiled(path, moving, backend, discontinuities, Grid(SMOOTH_POINTS, seconds)),
        teg.compile(curvature, [], backend=backend),
        discontinuities == "exact",
    )
