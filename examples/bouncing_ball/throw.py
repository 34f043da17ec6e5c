"""A throw: a ball between the floor and the ceiling of a lift that rises steadily, and its exact path.

Seen from inside, the lift is at rest, and the ball bounces off floor and ceiling with its speed unchanged. With speed U at the floor it
has √(U² - 2gz) at height z, so U determines all arcs, and the duration determines U.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from teg.errors import InputError

CONTACTS = (1, 12)
LEISURE = 0.7  # the default duration, as a fraction of the longest possible


@dataclass(frozen=True)
class Throw:
    """From height `start` at time 0 to height `end` at time `duration`, both above the floor as it is then.

    Lengths in m, times in s, `speed` of the lift in m/s, `mass` in kg, `gravity` in m/s²; `room` is the height of the
    lift. The ball first falls to the floor, then flies between floor and ceiling, `contacts` in all.
    """

    contacts: int
    speed: float
    duration: float
    room: float = 2.0
    start: float = 1.2
    end: float = 0.9
    mass: float = 1.0
    gravity: float = 9.81

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

    def energy(self, times: np.ndarray, heights: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Returns the energy in J of the ball on such a path, seen from inside, where it is the same at all times of the true one."""
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


def make_throw(contacts: int, speed: float, duration: float | None = None) -> Throw:
    """Returns a throw with that many contacts. Raises InputError if there is none, or none in that time."""
    if not CONTACTS[0] <= contacts <= CONTACTS[1]:
        raise InputError(f"{contacts} contacts are not possible", None, f"between {CONTACTS[0]} and {CONTACTS[1]}")
    if not math.isfinite(speed):
        raise InputError(f"a lift cannot have the speed {speed}", None, "a number of m/s")
    longest = _duration(Throw(contacts, speed, math.inf), _slowest(Throw(contacts, speed, math.inf)))
    if duration is None:
        return Throw(contacts, speed, LEISURE * longest)
    if not 0 < duration <= longest:
        count = f"{contacts} contact{'s' if contacts > 1 else ''}"
        raise InputError(f"no ball makes {count} in {duration:g} s", None, f"more than 0 s, at most {longest:.3f} s")
    return Throw(contacts, speed, duration)


def straight(throw: Throw) -> tuple[np.ndarray, np.ndarray]:
    """Returns the start of the descent: contacts at equal distances of time, straight lines between them."""
    times = np.linspace(0, throw.duration, throw.contacts + 2)[1:-1]
    _, ends = throw.knots(times)
    return times, (ends[:-1] + ends[1:]) / 2


def exact(throw: Throw) -> tuple[np.ndarray, np.ndarray, float]:
    """Returns the true path: times of its contacts, heights of its arcs half-way, and its action."""
    from scipy.optimize import brentq

    slowest = _slowest(throw)
    fastest = slowest + 1
    while _duration(throw, fastest) > throw.duration:
        fastest *= 2
    at_floor = brentq(lambda u: _duration(throw, u) - throw.duration, slowest, fastest, xtol=1e-15)
    down, across, _ = _arcs(throw, at_floor)
    times = down + across * np.arange(throw.contacts)
    knots, ends = throw.knots(times)
    length, first, last = np.diff(knots), ends[:-1], ends[1:]
    m, g = throw.mass, throw.gravity
    action = m * (last - first) ** 2 / (2 * length) - m * g * (first + last) / 2 * length - m * g**2 * length**3 / 24
    return times, (first + last) / 2 + g * length**2 / 8, float(np.sum(action))


def _slowest(throw: Throw) -> float:
    """Returns the speed at the floor with which the ball just reaches all the required heights."""
    highest = max(throw.start, throw.end, throw.room if throw.contacts > 1 else 0.0)
    return math.sqrt(2 * throw.gravity * highest)


def _arcs(throw: Throw, at_floor: float) -> tuple[float, float, float]:
    """Returns the times from the start to the floor, between floor and ceiling, and from the last contact to the end."""
    at = {z: math.sqrt(max(at_floor**2 - 2 * throw.gravity * z, 0.0)) for z in (throw.start, throw.room, throw.end)}
    down, across = at_floor - at[throw.start], at_floor - at[throw.room]
    last = at_floor - at[throw.end] if throw.contacts % 2 else at[throw.end] - at[throw.room]
    return down / throw.gravity, across / throw.gravity, last / throw.gravity


def _duration(throw: Throw, at_floor: float) -> float:
    down, across, last = _arcs(throw, at_floor)
    return down + (throw.contacts - 1) * across + last
