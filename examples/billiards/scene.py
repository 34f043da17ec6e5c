"""The integral: the action of balls between two moments, with contacts of each other and of walls.

    S = ∫₀ᵀ Σᵢ mᵢ·(½|vᵢ(t)|² - g·yᵢ(t)) dt

Unknown are the time of each contact and the places of the balls there. A ball flies freely from contact to contact, and brackets [t <
contact] select the arc. In a contact with a wall one coordinate is the wall's, and the other one is unknown. In a contact of two balls the
place of the first is unknown, and the angle at which the second one touches it. All velocities jump at a contact, and so does the
integrand. Where S is stationary, momentum is conserved in each contact (derivatives by the places), there is no friction (by the angle),
and energy is conserved (by the time): the collisions are elastic. S is no minimum there, so Newton's method looks for the zero of its
gradient, with its exact second derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.ir.expr import Expr
from teg.ir.operands import as_number

Knot = tuple[Expr, Expr, Expr]  # time, x, y


@dataclass(frozen=True)
class Ball:
    """A disk: mass in kg, radius in m, place in m and velocity in m/s at the start."""

    mass: float
    radius: float
    place: tuple[float, float]
    velocity: tuple[float, float]


@dataclass(frozen=True)
class Contact:
    """A contact of ball `first` with ball `second`, or with the wall where coordinate `axis` of its centre is `at`."""

    first: int
    second: int | None = None
    axis: int = 0
    at: float = 0.0


def unknowns(contacts: Sequence[Contact]) -> list[str]:
    """Returns the names of the unknowns: all times; then for each contact x, y and angle, or the place along a wall."""
    places = [[f"along_{k}"] if c.second is None else [f"x_{k}", f"y_{k}", f"angle_{k}"] for k, c in enumerate(contacts)]
    return [f"time_{k}" for k in range(len(contacts))] + [name for names in places for name in names]


def knots(balls: Sequence[Ball], contacts: Sequence[Contact]) -> list[list[Knot]]:
    """Returns the knots of each ball's path, from its start to its end."""
    paths: list[list[Knot]] = [[(as_number(0), as_number(b.place[0]), as_number(b.place[1]))] for b in balls]
    for k, contact in enumerate(contacts):
        time = teg.param(f"time_{k}")
        if contact.second is None:
            along, wall = teg.param(f"along_{k}"), as_number(contact.at)
            paths[contact.first].append((time, wall, along) if contact.axis == 0 else (time, along, wall))
        else:
            x, y, angle = teg.params(f"x_{k} y_{k} angle_{k}")
            reach = balls[contact.first].radius + balls[contact.second].radius
            paths[contact.first].append((time, x, y))
            paths[contact.second].append((time, x + reach * teg.cos(angle), y + reach * teg.sin(angle)))
    for i, path in enumerate(paths):
        path.append((teg.param("duration"), teg.param(f"end_x_{i}"), teg.param(f"end_y_{i}")))
    return paths


def action(balls: Sequence[Ball], contacts: Sequence[Contact], gravity: float) -> Expr:
    """Returns the action of all balls."""
    t = teg.var("t")

    def lagrangian(mass: float, begin: Knot, end: Knot) -> Expr:
        length, passed = end[0] - begin[0], t - begin[0]
        across, rise = (end[1] - begin[1]) / length, (end[2] - begin[2]) / length
        velocity = rise + gravity * (length / 2 - passed)
        y = begin[2] + passed * (rise + gravity / 2 * (length - passed))
        return mass * ((across**2 + velocity**2) / 2 - gravity * y)

    total = as_number(0)
    for ball, path in zip(balls, knots(balls, contacts), strict=True):
        *arcs, selected = (lagrangian(ball.mass, a, b) for a, b in pairwise(path))
        for arc, knot in zip(reversed(arcs), reversed(path[1:-1]), strict=True):
            selected = teg.where(t < knot[0], arc, selected)
        total = total + selected
    return teg.integral(total, (t, 0, teg.param("duration")))


def compile_action(
    balls: Sequence[Ball], contacts: Sequence[Contact], gravity: float, backend: Backend, discontinuities: Discontinuities = "exact"
) -> Evaluator:
    """Returns the compiled action, to be differentiated by all unknowns."""
    wanted = [teg.param(name) for name in unknowns(contacts)]
    return teg.compile(action(balls, contacts, gravity), wanted, backend=backend, discontinuities=discontinuities)
