"""Newton's method for the gradient of the action, with its exact second derivatives: times and places of all contacts at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from teg.examples.billiards.scene import Contact
from teg.examples.billiards.table import Flight, Scene

CONVERGED = 1e-10  # of a Newton step: s, m and radians
SHORTEST = 0.3  # an arc keeps at least this fraction of its time in one step
FURTHEST = 0.3  # radians and m of a place in one step
STARTS, JITTER = 16, 0.05  # s of each second, m and radians
OfUnknowns = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass
class Search:
    """The unknowns at the end, the largest entry of each Newton step, and of the gradient before it; what went wrong, or "".

    `starts` counts the starts that were tried.
    """

    z: np.ndarray
    steps: list[float] = field(default_factory=list)
    gradients: list[float] = field(default_factory=list)
    failure: str = ""
    interrupted: bool = False
    starts: int = 1
    seconds: dict[str, float] = field(default_factory=dict)


def even_start(scene: Scene, flight: Flight) -> np.ndarray:
    """Returns contacts at even distances of time, on the straight lines between start and end of their balls."""
    n = len(flight.contacts)
    times = scene.duration * np.arange(1, n + 1) / (n + 1)
    places: list[float] = []
    begin = np.array([ball.place for ball in scene.balls])
    for k, contact in enumerate(flight.contacts):
        share = times[k] / scene.duration
        middle = begin + share * (flight.ends - begin)
        if contact.second is None:
            places.append(middle[contact.first, 1 - contact.axis])
        else:
            apart = middle[contact.second] - middle[contact.first]
            places += [*middle[contact.first], np.arctan2(apart[1], apart[0])]
    return np.array([*times, *places])


def search(scene: Scene, flight: Flight, derivatives: OfUnknowns, steps: int, seed: int = 0) -> Search:
    """Returns the end of a search from an even start, or else of the first that ends well from one near it. `derivatives` returns
    gradient and Hessian. Ctrl-C ends it.
    """
    start, random = even_start(scene, flight), np.random.default_rng(seed)
    scale = np.concatenate([np.full(len(flight.contacts), scene.duration), np.ones(len(start) - len(flight.contacts))])
    first = best = newton(scene, flight, derivatives, start, steps)
    for tried in range(2, STARTS + 1):
        if best.interrupted or not best.failure:
            break
        best = newton(scene, flight, derivatives, start + JITTER * scale * random.normal(size=len(start)), steps)
        best.starts = tried
    if best.failure:
        best = replace(first, starts=best.starts)
    return best


def newton(scene: Scene, flight: Flight, derivatives: OfUnknowns, start: np.ndarray, steps: int) -> Search:
    """Returns the end of Newton's method. A step keeps the order of each ball's contacts."""
    found = Search(start)
    for _ in range(steps):
        try:
            gradient, hessian = derivatives(found.z)
        except KeyboardInterrupt:
            found.interrupted = True
            return found
        found.gradients.append(float(np.abs(gradient).max()))
        if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
            found.failure = "the action is not finite on the way"
            return found
        step = -np.linalg.lstsq(hessian, gradient, rcond=1e-14)[0]
        found.steps.append(float(np.abs(step).max()))
        found.z = found.z + _most(scene, flight.contacts, found.z, step) * step
        if found.steps[-1] < CONVERGED:
            return found
    found.failure = f"the last of {steps} Newton steps was {found.steps[-1] if steps else np.inf:.1e}"
    return found


def _most(scene: Scene, contacts: tuple[Contact, ...], z: np.ndarray, step: np.ndarray) -> float:
    """Returns the largest part of a step, up to 1, that shortens no arc too much and moves no place too far."""
    most = min(1.0, FURTHEST / float(np.abs(step[len(contacts) :]).max()))
    for i in range(len(scene.balls)):
        of = [k for k, c in enumerate(contacts) if i in (c.first, c.second)]
        length, growth = (np.diff([begin, *of_all[of], end]) for begin, of_all, end in ((0.0, z, scene.duration), (0.0, step, 0.0)))
        shrinking = growth < 0
        most = min(most, np.min((1 - SHORTEST) * length[shrinking] / -growth[shrinking], initial=1.0))
    return float(most)
