"""Search for the times of the contacts at which the action is stationary; the heights of the arcs are always the best ones.

With the heights eliminated, the gradient by the times is the one at the best heights (envelope theorem). With exact derivatives the steps
are Newton's, from the exact second derivatives through all jumps, wherever these have a least action. Elsewhere, and with the derivatives
of plain automatic differentiation and of smoothed brackets, whose second ones are not the derivative of the first, steps go down the
gradient by the length of Barzilai and Borwein (1988): it comes from the last two gradients and needs no value of the action. That matters
for the comparison: the gradient of plain automatic differentiation is not that of the action, so a descent that used the action would only
stop somewhere; this one shows where that gradient leads.

The derivative by the time of a contact is the energy gained there, seen from the lift. With a restitution, it is to be minus the energy
that the contact takes, and the sum of both goes to zero in its place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from teg.examples.bouncing_ball.scene import GIVEN, CompiledScene, contact_names, height_names
from teg.examples.bouncing_ball.throw import Throw, straight
from teg.examples.replay import Keep, not_kept

FIRST = 0.05  # the first step, as a fraction of the mean length of an arc
SHORTEST = 0.5  # an arc keeps at least this fraction of its time in one step
CONVERGED = 1e-12  # as a fraction of m·g·room


@dataclass(frozen=True)
class State:
    """Times of the contacts (n,), heights of the arcs (n + 1,), the gradient by the times plus losses (n,), the action in J·s."""

    times: np.ndarray
    heights: np.ndarray
    gradient: np.ndarray
    action: float


class ActionDescent:
    """The descent of one throw with one compiled scene. `states` holds all states, from straight lines on; `keep` keeps evaluations."""

    def __init__(self, throw: Throw, scene: CompiledScene, keep: Keep = not_kept) -> None:
        self.throw, self.scene = throw, scene
        self._slopes, self._bends = keep("slopes", self._slopes_at), keep("curvature", self._curvature_at)
        self._second = keep("hessian", self._hessian_at)
        self.given = {name: getattr(throw, name) for name in GIVEN} | {"end": throw.arrival}
        times, heights = straight(throw)
        _, gradient, action = self._evaluate(times, heights)
        self.states = [State(times, heights, gradient, action)]
        if scene.is_exact:
            self.hessian()  # compiled now, as a part of the set-up

    @property
    def converged(self) -> bool:
        """Returns whether the gradient is zero to rounding."""
        throw = self.throw
        energy = throw.mass * throw.gravity * throw.room / throw.restitution ** (2 * throw.contacts)  # of about this size at the start
        return bool(np.abs(self.states[-1].gradient).max() <= CONVERGED * energy)

    @property
    def finite(self) -> bool:
        """Returns whether the last state consists of numbers."""
        return bool(np.isfinite(self.states[-1].gradient).all())

    def step(self) -> None:
        """Makes one step of the times, then finds the best heights. The first step changes the heights only."""
        last = self.states[-1]
        times = last.times
        if len(self.states) > 1:
            times = last.times + self._limited(last.times, self._change())
        by_height, _, _ = self._evaluate(times, last.heights)
        heights = last.heights - by_height / self._curvature(times, last.heights)
        _, gradient, action = self._evaluate(times, heights)
        self.states.append(State(times, heights, gradient, action))

    def hessian(self) -> np.ndarray:
        """Returns all second derivatives at the last state, times first."""
        last = self.states[-1]
        return self._second(np.concatenate([last.times, last.heights]))

    def _hessian_at(self, moving: np.ndarray) -> np.ndarray:
        names = self.scene.action.parameters[: 2 * self.throw.contacts + 1]
        entries = self.scene.action.hessian(self._values(*np.split(moving, [self.throw.contacts])))
        return np.array([[entries[a, b] for b in names] for a in names])

    def _curvature(self, times: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Returns the second derivative by each height."""
        return self._bends(np.concatenate([times, heights]))

    def _curvature_at(self, moving: np.ndarray) -> np.ndarray:
        curvature = self.scene.curvature
        values = self._values(*np.split(moving, [self.throw.contacts]))
        return np.array(curvature({name: values[name] for name in curvature.parameters}))

    def _change(self) -> np.ndarray:
        """Returns the change of the times that makes the gradient zero to first order, or one down the gradient; the heights follow."""
        if not self.scene.is_exact:
            return self._down()
        last, n = self.states[-1], self.throw.contacts
        by_both = self.hessian()
        residual = by_both[:n] + self.throw.slopes_of_losses(last.times, last.heights)
        matrix = residual[:, :n] - residual[:, n:] @ (by_both[n:, :n] / np.diag(by_both)[n:, None])  # heights have no mixed terms
        is_least = self.throw.restitution < 1 or (np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix)[0] > 0)
        if not (np.isfinite(matrix).all() and is_least):
            return self._down()
        change = np.asarray(-np.linalg.solve(matrix, last.gradient))
        return change if self._limited(last.times, change) is change else self._down()

    def _down(self) -> np.ndarray:
        """Returns a change down the gradient, with the length that the last change of the gradient suggests."""
        last, before, unit = self.states[-1], self.states[-2], self._unit
        gradient, moved = unit * last.gradient, (last.times - before.times) / unit
        turned = gradient - unit * before.gradient
        if not moved.any():
            arc = self.throw.duration / (self.throw.contacts + 1)
            return np.asarray(-unit * gradient * (FIRST * arc / np.abs(unit * gradient).max()))
        return np.asarray(-unit * gradient * (abs(moved @ turned) / (turned @ turned)))

    @property
    def _unit(self) -> np.ndarray:
        """Returns the unit of each time. A restitution makes each arc slower and longer than the one before, and the action is about as
        curved as energy over duration².
        """
        return np.asarray(self.throw.restitution ** (-1.5 * np.arange(self.throw.contacts)))

    def _limited(self, times: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Returns the largest part of the change that leaves every arc half of its time: the contacts keep their order."""
        length = np.diff(self.throw.knots(times)[0])
        growth = np.diff(np.concatenate([[0.0], change, [0.0]]))
        shrinking = growth < 0
        most = np.min(SHORTEST * length[shrinking] / -growth[shrinking], initial=1.0)
        return change if most == 1 else change * most

    def _evaluate(self, times: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Returns the gradient by the heights, that by the times plus the energies that contacts take, and the action."""
        numbers = self._slopes(np.concatenate([times, heights]))
        by_height, by_time, (action,) = np.split(numbers, [len(heights), len(heights) + len(times)])
        return by_height, by_time + self.throw.losses(times, heights), float(action)

    def _slopes_at(self, moving: np.ndarray) -> np.ndarray:
        """Returns the derivatives by heights and times, then the action."""
        n = self.throw.contacts
        action, slopes = self.scene.action.value_and_grad(self._values(*np.split(moving, [n])))
        return np.array([*(float(slopes[name]) for name in height_names(n) + contact_names(n)), float(action)])

    def _values(self, times: np.ndarray, heights: np.ndarray) -> dict[str, float]:
        names = contact_names(len(times)) + height_names(len(times))
        return dict(zip(names, [*times, *heights], strict=True)) | self.given
