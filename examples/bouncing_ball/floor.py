"""A ball over an uneven, moving floor: its path between two points of space-time, with several contacts, makes the action stationary.

    S = ∫₀ᵀ (½m·(ẋ² + ẏ²) - m·g·y) dt,        y = floor(x, t) at each contact

Unknown are the times and the places of the contacts; between them the ball flies freely, brackets [t < contact] select the arc. The
floor is any formula. Both components of the velocity jump at a contact, and so does the integrand. Where S is stationary, the ball
rebounds elastically from the floor as it stands and moves there. S is no minimum (between contacts with the floor alone it is a saddle),
so its gradient is brought to zero by Levenberg and Marquardt's method (SciPy) with the compiled second derivatives.

With a restitution e < 1 the ball leaves the floor at e times the speed of its approach, and a contact takes the energy
½m·(1 - e²)·approach². The derivative of S by the time of a contact is the energy gained there, as seen from the floor: minus that loss.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

import teg
from teg.errors import InputError
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.formula import read_formula
from teg.examples.replay import Keep, OfVector, not_kept
from teg.ir.expr import Expr
from teg.ir.operands import as_number

HEIGHT, STRIDE, MASS, GRAVITY = 1.2, 1.0, 1.0, 9.81  # start and end above the floor in m; m between contacts; kg; m/s²
HIGHEST = 1e6  # m
CONVERGED = 1e-9  # of the gradient, in J and N·s
STARTS = 12
JITTER = 0.15
QUIET: dict[str, Any] = {"inaccurate": "ignore"}  # a search may come where the floor is not finite; its end is checked
POINTS = 60  # of an arc, at which it must be above the floor


@dataclass(frozen=True)
class Flight:
    """From (0, start) at time 0 to (reach, end) at `duration`, in m and s, with that many contacts; `floor` gives height and slopes."""

    contacts: int
    duration: float
    start: float
    end: float
    reach: float
    floor: Evaluator
    restitution: float = 1.0

    def ground(self, x: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the floor's height, its slope by x, and its velocity, upwards."""
        height, slope, velocity = self.floor(x=x, t=t)
        return np.asarray(height), np.asarray(slope), np.asarray(velocity)

    def knots(self, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns times, places and heights of start, contacts and end; `moving` are the times and places of the contacts."""
        times, places = moving[: self.contacts], moving[self.contacts :]
        heights = self.ground(places, times)[0]
        return (
            np.concatenate([[0.0], times, [self.duration]]),
            np.concatenate([[0.0], places, [self.reach]]),
            np.concatenate([[self.start], heights, [self.end]]),
        )

    def path(self, moving: np.ndarray, points: int = POINTS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns times, places and heights along the path, (arcs, points)."""
        t, x, y = (knot[:, None] for knot in self.knots(moving))
        u, length = np.linspace(0, 1, points), t[1:] - t[:-1]
        fall = GRAVITY / 2 * u * (1 - u) * length**2
        return t[:-1] + u * length, x[:-1] + u * (x[1:] - x[:-1]), y[:-1] + u * (y[1:] - y[:-1]) + fall

    def depth(self, moving: np.ndarray) -> float:
        """Returns how far the path is below the floor between the contacts, at most, in m; 0 if nowhere."""
        t, x, y = self.path(moving)
        return float(np.max(self.ground(x, t)[0] - y, initial=0.0, where=np.isfinite(y)))

    def energies(self, moving: np.ndarray) -> np.ndarray:
        """Returns the energy of the ball on each arc, in J."""
        t, x, y = self.knots(moving)
        length = np.diff(t)
        speeds = (np.diff(x) / length) ** 2 + (np.diff(y) / length + GRAVITY * length / 2) ** 2
        return np.asarray(MASS * (speeds / 2 + GRAVITY * y[:-1]))

    def rebound_error(self, moving: np.ndarray) -> float:
        """Returns the largest difference, in m/s, between the velocity after a contact and that of a rebound with this restitution."""
        t, x, y = self.knots(moving)
        length = np.diff(t)
        across, rise = np.diff(x) / length, np.diff(y) / length
        before = np.stack([across, rise - GRAVITY * length / 2])[:, :-1]
        after = np.stack([across, rise + GRAVITY * length / 2])[:, 1:]
        _, slope, velocity = self.ground(x[1:-1], t[1:-1])
        normal = np.stack([-slope, np.ones_like(slope)]) / np.hypot(slope, 1)
        approach = np.sum(before * normal, axis=0) - velocity / np.hypot(slope, 1)
        return float(np.abs(after - before + (1 + self.restitution) * approach * normal).max())


def read_floor(formula: str, x: Expr, t: Expr) -> Expr:
    """Returns the height of the floor at a place and a time. Raises InputError for what is no formula of x and t."""
    return read_formula(formula, {"x": x, "t": t}, "the floor", "0.2*sin(3*x) + 0.5*t")


def level_arcs(contacts: int, restitution: float) -> np.ndarray:
    """Returns the durations of the arcs in s, on a level floor, of a ball that just comes back to its height after the last contact."""
    speed = np.sqrt(2 * GRAVITY * HEIGHT) / restitution**contacts  # at the first contact
    rising = np.sqrt(max(speed**2 - 2 * GRAVITY * HEIGHT, 0.0))
    arcs = 2 * speed * restitution ** np.arange(contacts + 1)
    arcs[0], arcs[-1] = rising + speed, arcs[-1] / 2
    return np.asarray(arcs / GRAVITY)


def make_flight(formula: str, contacts: int, duration: float | None, backend: Backend, restitution: float = 1.0) -> Flight:
    """Returns the flight; without a duration, that of a ball dropped on a flat floor. Raises InputError for an impossible one."""
    x, t = teg.params("x t")
    height = read_floor(formula, x, t)
    floor = teg.compile(teg.tuple(height, teg.diff(height, x), teg.diff(height, t)), [], backend=backend, **QUIET)
    time = float(level_arcs(contacts, restitution).sum()) if duration is None else duration
    if not 0 < time < 1e3:
        raise InputError(f"a flight cannot take {time:g} s", None, "more than 0 s, at most 1000 s")
    reach = STRIDE * contacts
    ends = [float(floor(x=x, t=t)[0]) for x, t in ((0.0, 0.0), (reach, time))]
    if not np.abs(ends).max() <= HIGHEST:
        hint = f"at most {HIGHEST:g} m for 0 ≤ x ≤ {reach:g}, 0 ≤ t ≤ {time:g}"
        raise InputError(f"the floor {formula!r} is not finite, or very high, where the ball starts or ends", None, hint)
    return Flight(contacts, time, ends[0] + HEIGHT, ends[1] + HEIGHT, reach, floor, restitution)


def names(contacts: int) -> list[str]:
    """Returns the names of what is looked for: times, then places of the contacts."""
    return [f"{what}_{k}" for what in ("time", "place") for k in range(1, contacts + 1)]


def floor_action(contacts: int, formula: str) -> Expr:
    """Returns the action of a path with that many contacts with the floor."""
    t = teg.var("t")
    duration, start, end, reach = (teg.param(name) for name in ("duration", "start", "end", "reach"))
    moving = [teg.param(name) for name in names(contacts)]
    inner_times, inner_places = moving[:contacts], moving[contacts:]
    times, places = [as_number(0), *inner_times, duration], [as_number(0), *inner_places, reach]
    heights = [start, *(read_floor(formula, x, s) for s, x in zip(inner_times, inner_places, strict=True)), end]

    def lagrangian(arc: int) -> Expr:
        length = times[arc + 1] - times[arc]
        passed = t - times[arc]
        across, rise = ((knots[arc + 1] - knots[arc]) / length for knots in (places, heights))
        y = heights[arc] + passed * (rise + GRAVITY / 2 * (length - passed))
        velocity = rise + GRAVITY * (length / 2 - passed)
        return MASS * (across**2 + velocity**2) / 2 - MASS * GRAVITY * y

    selected = lagrangian(contacts)
    for arc in reversed(range(contacts)):
        selected = teg.where(t < inner_times[arc], lagrangian(arc), selected)
    return teg.integral(selected, (t, 0, duration))


def lost_energies(contacts: int, formula: str, restitution: float) -> Expr:
    """Returns the energies in J that contacts with this restitution take, a tuple."""
    duration, start, end, reach = (teg.param(name) for name in ("duration", "start", "end", "reach"))
    moving = [teg.param(name) for name in names(contacts)]
    inner_times, inner_places = moving[:contacts], moving[contacts:]
    floors = [read_floor(formula, x, s) for s, x in zip(inner_times, inner_places, strict=True)]
    times, places, heights = [as_number(0), *inner_times, duration], [as_number(0), *inner_places, reach], [start, *floors, end]
    losses = []
    for k, (s, x, height) in enumerate(zip(inner_times, inner_places, floors, strict=True)):
        length = times[k + 1] - times[k]
        across, fall = (places[k + 1] - places[k]) / length, (heights[k + 1] - heights[k]) / length - GRAVITY * length / 2
        slope, velocity = teg.diff(height, x), teg.diff(height, s)
        losses.append(MASS * (1 - restitution**2) / 2 * (fall - slope * across - velocity) ** 2 / (1 + slope**2))
    return teg.tuple(*losses)


@dataclass
class Search:
    """The search for a stationary path: where it ended, the largest entry of the gradient at each evaluation, and its result."""

    flight: Flight
    moving: np.ndarray
    gradients: list[float] = field(default_factory=list)
    action: float = float("nan")
    failure: str = ""


def find_path(flight: Flight, formula: str, settings: dict[str, Any], discontinuities: Discontinuities, keep: Keep = not_kept) -> Search:
    """Returns the search from contacts at even distances, and if that fails from some near them.

    `failure` says what is wrong with its result: the gradient is not zero, or the path goes through the floor. Raises InputError where
    every start meets a floor that is not finite.
    """
    wanted = [teg.param(name) for name in names(flight.contacts)]
    how: dict[str, Any] = {"backend": settings["backend"], **QUIET}
    action = teg.compile(floor_action(flight.contacts, formula), wanted, discontinuities=discontinuities, **how)
    lost = None
    if flight.restitution < 1:
        lost = teg.compile(lost_energies(flight.contacts, formula, flight.restitution), wanted, **how)
    numbers, entries = keep("slopes", _slopes_of(flight, action, lost)), keep("bends", _bends_of(flight, action, lost))
    random = np.random.default_rng(settings["seed"])
    best: Search | None = None
    for start in range(STARTS):
        spread = random.uniform(-JITTER, JITTER, 2 * flight.contacts) * (start > 0)
        search = _from(flight, (numbers, entries), spread, settings["steps"])
        if best is None or not search.failure:
            best = search
        if not search.failure:
            break
    assert best is not None
    if not (np.isfinite(best.flight.path(best.moving)).all() and np.isfinite(flight.energies(best.moving)).all()):
        raise InputError(f"the floor {formula!r} is not finite where contacts are looked for", None, "a formula without poles on the way")
    return best


def _values_of(flight: Flight, moving: np.ndarray) -> dict[str, float]:
    given = {name: getattr(flight, name) for name in ("duration", "start", "end", "reach")}
    return dict(zip(names(flight.contacts), moving.tolist(), strict=True)) | given


def _read_by(program: Evaluator, flight: Flight, moving: np.ndarray) -> dict[str, float]:
    """Returns the values of the parameters that a program has."""
    return {name: value for name, value in _values_of(flight, moving).items() if name in program.parameters}


def _slopes_of(flight: Flight, action: Evaluator, lost: Evaluator | None) -> OfVector:
    """Returns the function from the times and places of the contacts to the action and its derivatives, by times plus the losses."""

    def slopes(moving: np.ndarray) -> np.ndarray:
        value, by_name = action.value_and_grad(_values_of(flight, moving))
        numbers = np.array([float(value), *(float(by_name[n]) for n in names(flight.contacts))])
        if lost is not None:
            numbers[1 : 1 + flight.contacts] += [float(loss) for loss in lost(_read_by(lost, flight, moving))]
        return numbers

    return slopes


def _bends_of(flight: Flight, action: Evaluator, lost: Evaluator | None) -> OfVector:
    """Returns the function from the times and places of the contacts to the derivatives of the numbers that are to be zero."""

    def bends(moving: np.ndarray) -> np.ndarray:
        entries = action.hessian(_values_of(flight, moving))
        matrix = np.array([[float(entries[a, b]) for b in names(flight.contacts)] for a in names(flight.contacts)])
        if lost is not None:
            slopes = lost.grad(_read_by(lost, flight, moving))
            matrix[: flight.contacts] += np.array([[float(loss) for loss in slopes[b]] for b in names(flight.contacts)]).T
        return matrix

    return bends


def _from(flight: Flight, action: tuple[OfVector, OfVector], spread: np.ndarray, steps: int) -> Search:
    """Returns the search from one start, given the first and second derivatives. The arcs' durations are exponentials: contacts keep their
    order."""
    from scipy.optimize import least_squares

    n, (slopes_at, bends_at) = flight.contacts, action
    search = Search(flight, np.zeros(2 * n))

    def moving(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        shares = np.exp(np.append(z[:n], 0.0) - max(z[:n].max(), 0.0))
        shares /= shares.sum()
        before = np.cumsum(shares)[:-1]
        slopes = flight.duration * shares[:-1] * ((np.arange(n)[:, None] >= np.arange(n)) - before[:, None])
        return np.concatenate([flight.duration * before, z[n:]]), slopes

    def residual(z: np.ndarray) -> np.ndarray:
        gradient = slopes_at(moving(z)[0])[1:]
        search.gradients.append(float(np.abs(gradient).max()))
        return np.where(np.isfinite(gradient), gradient, 1e150)

    def jacobian(z: np.ndarray) -> np.ndarray:
        matrix = bends_at(moving(z)[0])
        by_z = np.concatenate([matrix[:, :n] @ moving(z)[1], matrix[:, n:]], axis=1)
        return np.where(np.isfinite(by_z), by_z, 0.0)

    weights = level_arcs(n, flight.restitution)
    x = flight.reach * np.cumsum(weights)[:-1] / weights.sum()
    z = np.concatenate([np.log(weights[:-1] / weights[-1]), x]) + spread
    if steps:
        z = least_squares(residual, z, jacobian, method="lm", max_nfev=steps, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    else:
        residual(z)
    search.moving, search.action = moving(z)[0], float(slopes_at(moving(z)[0])[0])
    search.gradients.append(float(np.abs(residual(z)).max()))
    depth = flight.depth(search.moving)
    if not search.gradients[-1] <= CONVERGED:
        search.failure = f"the gradient of the action is {search.gradients[-1]:.1e} after {len(search.gradients)} evaluations"
    elif depth > 1e-9:
        search.failure = f"the path found is {depth:.2g} m below the floor between contacts"
    return search
