"""The scenes, and the flight of balls from contact to contact, by the laws of collisions: what the search has to find without them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from teg.errors import InputError
from teg.examples.billiards.scene import Ball, Contact

LATER = 1e-9  # s: contacts of one ball closer in time than this are one
MOST = 24  # contacts of a scene
LARGEST = 6  # balls of a scene that is read


@dataclass(frozen=True)
class Scene:
    """Balls on a table or above a floor: walls at the least and the largest x and y (None: no wall), gravity in m/s², s."""

    balls: tuple[Ball, ...]
    walls: tuple[tuple[float | None, float | None], tuple[float | None, float | None]]
    gravity: float
    duration: float


OPEN = ((None, None), (None, None))
TABLE = ((0.0, 2.0), (0.0, 1.0))


def _rack(seed: int) -> tuple[Ball, ...]:
    """Returns a cue ball and three that touch nothing yet, a little out of place."""
    random = np.random.default_rng(seed)
    spots = [(1.25, 0.5), (1.42, 0.58), (1.42, 0.42)]
    near = [(x + random.uniform(-0.01, 0.01), y + random.uniform(-0.01, 0.01)) for x, y in spots]
    return (Ball(0.17, 0.06, (0.35, 0.46), (2.2, 0.08)), *(Ball(0.17, 0.06, place, (0.0, 0.0)) for place in near))


def scene(name: str, seed: int = 0) -> Scene:
    """Returns a scene by its name."""
    scenes: Mapping[str, Any] = {
        "exchange": lambda: Scene((Ball(1.0, 0.1, (1.0, 0.0), (0.0, 0.0)), Ball(1.0, 0.1, (0.0, 0.0), (1.0, 0.0))), OPEN, 0.0, 2.0),
        "collision": lambda: Scene((Ball(2.0, 0.12, (0.0, 0.0), (1.2, 0.2)), Ball(1.0, 0.1, (1.4, 0.1), (-0.8, 0.2))), OPEN, 0.0, 1.6),
        "cushions": lambda: Scene((Ball(0.17, 0.06, (0.3, 0.3), (1.9, 1.3)), Ball(0.17, 0.06, (1.5, 0.8), (0.0, 0.0))), TABLE, 0.0, 1.6),
        "break": lambda: Scene(_rack(seed), TABLE, 0.0, 1.15),
        "stack": lambda: Scene(
            (Ball(0.6, 0.12, (0.0, 0.5), (0.0, 0.0)), Ball(0.06, 0.05, (0.015, 0.73), (0.0, 0.0))), (OPEN[0], (0.0, None)), 9.81, 0.8
        ),
    }
    return scenes[name]()  # type: ignore[no-any-return]


def read_scene(file: Path) -> Scene:
    """Returns the scene in a JSON file: "balls" with "mass", "radius", "place" and "velocity", "duration", perhaps "walls" and "gravity".

    The walls are [[left, right], [floor, ceiling]], each a number or null; without them there is none. Raises InputError if the file cannot
    be read, has something else, or its balls overlap or stick in walls.
    """
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))
        balls = tuple(Ball(float(b["mass"]), float(b["radius"]), _pair(b["place"]), _pair(b["velocity"])) for b in stored["balls"])
        walls = tuple(
            (low if low is None else float(low), high if high is None else float(high)) for low, high in stored.get("walls", OPEN)
        )
        read = Scene(balls, walls, float(stored.get("gravity", 0.0)), float(stored["duration"]))  # type: ignore[arg-type]
    except OSError as problem:
        raise InputError(f"cannot read {str(file)!r}", None, str(problem.strerror)) from None
    except (ValueError, KeyError, TypeError, AttributeError) as problem:
        raise InputError(f"{str(file)!r} is not a scene ({type(problem).__name__}: {problem})", None, EXAMPLE) from None
    _check(file, read)
    return read


EXAMPLE = '{"balls": [{"mass": 1, "radius": 0.1, "place": [0, 0], "velocity": [1, 0]}, …], "walls": [[0, 2], [0, null]], "duration": 2}'


def _pair(values: Sequence[float]) -> tuple[float, float]:
    x, y = values
    return float(x), float(y)


def _check(file: Path, read: Scene) -> None:
    numbers = [read.gravity, read.duration, *(z for b in read.balls for z in (b.mass, b.radius, *b.place, *b.velocity))]
    if not np.isfinite(numbers).all() or not 0 < len(read.balls) <= LARGEST or len(read.walls) != 2:
        raise InputError(f"the scene {str(file)!r} has numbers that are not finite, or too many balls", None, f"1 to {LARGEST} balls")
    if min(read.duration, *(z for b in read.balls for z in (b.mass, b.radius))) <= 0:
        raise InputError(f"a mass, a radius or the duration of {str(file)!r} is not above 0", None, "kg, m and s")
    for i, ball in enumerate(read.balls):
        for axis, (low, high) in enumerate(read.walls):
            at = ball.place[axis]
            if (low is not None and at < low + ball.radius) or (high is not None and at > high - ball.radius):
                raise InputError(f"ball {i} of {str(file)!r} is not between the walls", None, "a whole radius away from each")
        for j in range(i):
            if math.dist(ball.place, read.balls[j].place) <= ball.radius + read.balls[j].radius:
                raise InputError(f"balls {j} and {i} of {str(file)!r} overlap", None, "places further apart")


@dataclass(frozen=True)
class Flight:
    """The contacts in their order, the unknowns of the action there, and the places of the balls at the end, (balls, 2)."""

    contacts: tuple[Contact, ...]
    unknowns: np.ndarray
    ends: np.ndarray
    velocities: np.ndarray


def fly(scene: Scene) -> Flight:
    """Returns the flight of the balls. Raises InputError for more contacts than MOST, or none."""
    x, v = (np.array([getattr(ball, what) for ball in scene.balls]) for what in ("place", "velocity"))
    now = 0.0
    contacts: list[Contact] = []
    times: list[float] = []
    places: list[float] = []
    fall = np.array([0.0, -scene.gravity])
    while True:
        wait, contact = _next(scene, x, v)
        if contact is None or now + wait >= scene.duration:
            break
        if len(contacts) == MOST:
            raise InputError(f"the balls touch more than {MOST} times", None, "a shorter --duration")
        now, x, v = now + wait, x + wait * v + wait**2 / 2 * fall, v + wait * fall
        v = _after(scene, contact, x, v)
        contacts.append(contact)
        times.append(now)
        i, j = contact.first, contact.second
        places += [x[i, 1 - contact.axis]] if j is None else [*x[i], np.arctan2(*(x[j] - x[i])[::-1])]
    if not contacts:
        raise InputError("no ball touches anything in that time", None, "a longer --duration")
    wait = scene.duration - now
    return Flight(tuple(contacts), np.array(times + places), x + wait * v + wait**2 / 2 * fall, v + wait * fall)


def _next(scene: Scene, x: np.ndarray, v: np.ndarray) -> tuple[float, Contact | None]:
    """Returns the time until the next contact, and the contact."""
    best: tuple[float, Contact | None] = np.inf, None
    for i, ball in enumerate(scene.balls):
        for axis in (0, 1):
            pull = -scene.gravity if axis else 0.0
            for side, wall in zip((1, -1), scene.walls[axis], strict=True):
                if wall is not None:
                    at = wall + side * ball.radius
                    best = min(best, (_first(pull / 2, v[i, axis], x[i, axis] - at, side), Contact(i, None, axis, at)), key=lambda c: c[0])
        for j in range(i + 1, len(scene.balls)):
            dx, dv = x[j] - x[i], v[j] - v[i]
            reach = ball.radius + scene.balls[j].radius
            best = min(best, (_first(dv @ dv, 2 * dx @ dv, dx @ dx - reach**2, 1), Contact(i, j)), key=lambda c: c[0])
    return best


def _first(a: float, b: float, c: float, side: int) -> float:
    """Returns the first time after now at which side·(a·t² + b·t + c) falls through 0, inf if there is none."""
    roots = np.roots([a, b, c]) if a else np.array([-c / b]) if b else np.array([])
    falling = [float(t.real) for t in roots if abs(t.imag) == 0 and t.real > LATER and side * (2 * a * t.real + b) < 0]
    return min(falling, default=np.inf)


def _after(scene: Scene, contact: Contact, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Returns the velocities after an elastic contact."""
    v, i, j = v.copy(), contact.first, contact.second
    if j is None:
        v[i, contact.axis] *= -1
        return v
    normal = (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
    first, second = scene.balls[i].mass, scene.balls[j].mass
    impulse = 2 * first * second / (first + second) * float((v[j] - v[i]) @ normal)
    v[i] += impulse / first * normal
    v[j] -= impulse / second * normal
    return v
