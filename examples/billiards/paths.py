"""Paths of balls between given knots: places, velocities and energies at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from teg.examples.billiards.table import Flight, Scene


@dataclass(frozen=True)
class Path:
    """The path of one ball through `knots`, (n, 3): times, x, y; it flies freely between them."""

    knots: np.ndarray
    gravity: float

    def place(self, t: np.ndarray) -> np.ndarray:
        """Returns the places at times, (times, 2)."""
        begin, length, rate = self._arc(t)
        passed = t - begin[:, 0]
        sag = np.stack([np.zeros_like(t), self.gravity / 2 * passed * (length - passed)], axis=1)
        return np.asarray(begin[:, 1:] + passed[:, None] * rate + sag)

    def velocity(self, t: np.ndarray) -> np.ndarray:
        """Returns the velocities at times, (times, 2); just after a contact."""
        begin, length, rate = self._arc(t)
        return np.asarray(rate + np.stack([np.zeros_like(t), self.gravity * (length / 2 - (t - begin[:, 0]))], axis=1))

    def _arc(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        arc = np.clip(np.searchsorted(self.knots[:, 0], t, side="right") - 1, 0, len(self.knots) - 2)
        begin, end = self.knots[arc], self.knots[arc + 1]
        length = end[:, 0] - begin[:, 0]
        return begin, length, (end[:, 1:] - begin[:, 1:]) / length[:, None]


def paths(scene: Scene, flight: Flight, z: np.ndarray) -> list[Path]:
    """Returns the path of each ball, given the unknowns."""
    knots = [[(0.0, *ball.place)] for ball in scene.balls]
    at = len(flight.contacts)
    for k, contact in enumerate(flight.contacts):
        if contact.second is None:
            place = (contact.at, z[at]) if contact.axis == 0 else (z[at], contact.at)
            knots[contact.first].append((z[k], *place))
            at += 1
        else:
            reach = scene.balls[contact.first].radius + scene.balls[contact.second].radius
            knots[contact.first].append((z[k], z[at], z[at + 1]))
            knots[contact.second].append((z[k], z[at] + reach * np.cos(z[at + 2]), z[at + 1] + reach * np.sin(z[at + 2])))
            at += 3
    return [
        Path(np.array([*through, (scene.duration, *end)], dtype=float), scene.gravity)
        for through, end in zip(knots, flight.ends, strict=True)
    ]


def energies(scene: Scene, found: list[Path], t: np.ndarray) -> np.ndarray:
    """Returns the energies of the balls at times, in J, (balls, times)."""
    rows = []
    for ball, path in zip(scene.balls, found, strict=True):
        height = path.place(t)[:, 1]
        rows.append(ball.mass * ((path.velocity(t) ** 2).sum(axis=1) / 2 + scene.gravity * height))
    return np.array(rows)
