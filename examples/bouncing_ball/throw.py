"""A throw: a ball between the floor and the ceiling of a lift that rises steadily, and its exact path.

Seen from inside, the lift is at rest, and the ball bounces off floor and ceiling with its speed unchanged, or with `restitution` times
this speed. With speed U at the floor it has √(U² - 2gz) at height z, so the first U determines all arcs, and the duration determines U.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from teg.errors import InputError

CONTACTS = (1, 12)
LEISURE = 0.7  # the default duration, as a fraction of the longest possible


@dataclass(frozen=True)
class Throw:
    """From height `start` at time 0 to height `end` at time `duration`, both above the floor as it is then.

    Lengths in m, times in s, `speed` of the lift in m/s, `mass` in kg, `gravity` in m/s²; `room` is the height of the lift. The ball first
    falls to the floor, then flies between floor and ceiling, `contacts` in all. Seen from inside, a contact leaves `restitution` times the
    speed.
    """

    contacts: int
    speed: float
    duration: float
    room: float = 2.0
    start: float = 1.2
    end: float = 0.9
    mass: float = 1.0
    gravity: float = 9.81
    restitution: float = 1.0

    @property
    def arrival(self) -> float:
        """Returns the height of the end, not seen from inside."""
        return self.end + self.speed * self.duration

    def walls(self, times: np.ndarray) -> np.ndarray:
        """Returns the heights of the contacts at these times, floor and ceiling by turns."""
        return np.asarray(self.speed * times + self.room * (np.arange(len(times)) % 2))

    def knots(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns times and heights where arcs begin or end."""
        heights = np.concatenate([[self.start], self.walls(times), [self.arrival]])
        return np.concatenate([[0.0], times, [self.duration]]), heights

    def path(self, times: np.ndarray, heights: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Returns the ball's height at the times t, given `times` of the contacts and `heights` of the arcs half-way."""
        knots, ends = self.knots(times)
        arc = np.searchsorted(times, t, side="right")
        u = (t - knots[arc]) / (knots[arc + 1] - knots[arc])
        first, last, middle = ends[arc], ends[arc + 1], heights[arc]
        return np.asarray(first * (1 - u) * (1 - 2 * u) + 4 * middle * u * (1 - u) + last * u * (2 * u - 1))

    def depth(self, times: np.ndarray, heights: np.ndarray) -> float:
        """Returns how far a path is outside of the lift, at most, in m; 0 if nowhere."""
        t = np.linspace(0, self.duration, 100 * (len(times) + 1))
        inside = self.path(times, heights, t) - self.speed * t
        return float(max(0.0, -inside.min(), inside.max() - self.room))

    def energy(self, times: np.ndarray, heights: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Returns the energy in J of the ball on such a path, seen from inside, where on the true one it changes at contacts only."""
        knots, ends = self.knots(times)
        arc = np.searchsorted(times, t, side="right")
        length = knots[arc + 1] - knots[arc]
        u = (t - knots[arc]) / length
        velocity = (4 * heights[arc] * (1 - 2 * u) - ends[arc] * (3 - 4 * u) - ends[arc + 1] * (1 - 4 * u)) / length
        height = self.path(times, heights, t) - self.speed * t
        return np.asarray(self.mass * ((velocity - self.speed) ** 2 / 2 + self.gravity * height))

    def contact_speeds(self, times: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the ball's velocity just before and just after each contact."""
        knots, ends = self.knots(times)
        length, first, last = np.diff(knots), ends[:-1], ends[1:]
        into, out_of = (3 * last - 4 * heights + first) / length, (4 * heights - 3 * first - last) / length
        return into[:-1], out_of[1:]

    def losses(self, times: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Returns the energy in J that each contact takes, seen from inside."""
        into, _ = self.contact_speeds(times, heights)
        return np.asarray(self.mass / 2 * (1 - self.restitution**2) * (into - self.speed) ** 2)

    def slopes_of_losses(self, times: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Returns the derivatives of `losses` by times and heights, (contacts, 2·contacts + 1)."""
        into, _ = self.contact_speeds(times, heights)
        factor = self.mass * (1 - self.restitution**2) * (into - self.speed) / np.diff(self.knots(times)[0])[:-1]
        before = np.diag(factor[1:] * (into[1:] + self.speed), -1)  # by the time at which the arc begins
        return np.concatenate([np.diag(factor * (3 * self.speed - into)) + before, np.diag(-4 * factor), 0 * factor[:, None]], axis=1)


def make_throw(contacts: int, speed: float, duration: float | None = None, restitution: float = 1.0) -> Throw:
    """Returns a throw with that many contacts. Raises InputError if there is none, or none in that time."""
    if not CONTACTS[0] <= contacts <= CONTACTS[1]:
        raise InputError(f"{contacts} contacts are not possible", None, f"between {CONTACTS[0]} and {CONTACTS[1]}")
    if not math.isfinite(speed):
        raise InputError(f"a lift cannot have the speed {speed}", None, "a number of m/s")
    endless = Throw(contacts, speed, math.inf, restitution=restitution)
    longest = sum(_arcs(endless, _slowest(endless)))
    if duration is None:
        return replace(endless, duration=LEISURE * longest)
    if not 0 < duration <= longest:
        count = f"{contacts} contact{'s' if contacts > 1 else ''}"
        raise InputError(f"no ball makes {count} in {duration:g} s", None, f"more than 0 s, at most {longest:.3f} s")
    return replace(endless, duration=duration)


def straight(throw: Throw) -> tuple[np.ndarray, np.ndarray]:
    """Returns the start of the descent: straight lines between contacts, each as steep as the one before times the restitution."""
    lengths = throw.restitution ** -np.arange(throw.contacts + 1.0)
    times = throw.duration / lengths.sum() * np.cumsum(lengths)[:-1]
    _, ends = throw.knots(times)
    return times, (ends[:-1] + ends[1:]) / 2


def exact(throw: Throw) -> tuple[np.ndarray, np.ndarray, float]:
    """Returns the true path: times of its contacts, heights of its arcs half-way, and its action."""
    from scipy.optimize import brentq

    slowest = _slowest(throw)
    fastest = slowest + 1
    while sum(_arcs(throw, fastest)) > throw.duration:
        fastest *= 2
    at_floor = brentq(lambda u: sum(_arcs(throw, u)) - throw.duration, slowest, fastest, xtol=1e-15)
    times = np.cumsum(_arcs(throw, at_floor))[:-1]
    knots, ends = throw.knots(times)
    length, first, last = np.diff(knots), ends[:-1], ends[1:]
    m, g = throw.mass, throw.gravity
    action = m * (last - first) ** 2 / (2 * length) - m * g * (first + last) / 2 * length - m * g**2 * length**3 / 24
    return times, (first + last) / 2 + g * length**2 / 8, float(np.sum(action))


def _slowest(throw: Throw) -> float:
    """Returns the speed at the first contact with which the ball just reaches all the required heights."""
    square = 0.0  # of the speed needed before the next contact, or at the end
    for k in reversed(range(throw.contacts)):
        is_last, is_floor = k == throw.contacts - 1, k % 2 == 0
        climb = (throw.end if is_last else throw.room) if is_floor else (throw.end - throw.room if is_last else -throw.room)
        square = max(square + 2 * throw.gravity * climb, 0.0) / throw.restitution**2
    return math.sqrt(max(square, 2 * throw.gravity * throw.start))


def _arcs(throw: Throw, at_floor: float) -> list[float]:
    """Returns the durations of all arcs, for this speed at the first contact."""

    def after(speed: float, climb: float) -> float:
        return math.sqrt(max(speed**2 - 2 * throw.gravity * climb, 0.0))

    arcs, speed = [(at_floor - after(at_floor, throw.start)) / throw.gravity], at_floor
    for k in range(throw.contacts):
        here, there = throw.room * (k % 2), throw.end if k == throw.contacts - 1 else throw.room * ((k + 1) % 2)
        leaving = throw.restitution * speed
        speed = after(leaving, there - here)
        arcs.append(abs(leaving - speed) / throw.gravity)
    return arcs
