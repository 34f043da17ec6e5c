"""The design of two cords: SciPy's constrained optimiser on the derivatives of the compiled integrals, or on others, to compare.

minimise    T/(1 s) + weight · (F(D)/m - g)/g          the time of the fall, and the largest acceleration, in units of g
such that   E(D) = 0                                    D is where the fall ends
            D ≤ drop - MARGIN                           above the ground
            give·(1 + k₁/k₂) ≤ EARLY·(D - slack)          string 1 locks, and before the fall ends
            D - slack - give ≤ drop/2                   string 2, which would stop the fall at once, does not
            D ≥ DEEP·drop                               a jump
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teg.evaluator.accuracy import AccuracyWarning
from teg.evaluator.evaluator import Evaluator
from teg.examples.springs.scene import DESIGN, GRAVITY

MARGIN = 2.0  # m above the ground
SCALES = np.array([100.0, 100.0, 10.0, 10.0, 10.0])  # of the design's entries
DEEP, EARLY = 0.8, 0.9
DIFFERENCE = 1e-6  # of the scaled design
TOLERANCE = 1e-6  # of the constraints, as fractions of the energy of the fall, and of the drop
WALL = 1e3  # s
SHORTEST = 1.0  # m that the cords stretch at least


@dataclass
class Jump:
    """A jump of `mass` kg from `drop` m above the ground, the weight of its acceleration, and the compiled fall."""

    drop: float
    mass: float
    weight: float
    fall: Evaluator

    def start(self) -> np.ndarray:
        """Returns cords that are too stiff: two equal ones, a third of the drop long."""
        slack, lowest = self.drop / 3, 0.9 * self.drop
        stiffness = 2 * self.mass * GRAVITY * lowest / (lowest - slack) ** 2
        return np.array([1.5 * stiffness, 1.5 * stiffness, slack, self.drop / 6, lowest])

    def bounds(self) -> list[tuple[float, float]]:
        """Returns the least and the largest value of each entry of the design."""
        h = self.drop
        return [(20, 2000), (20, 2000), (0.02 * h, h), (0.02 * h, h), (DEEP * h, h)]

    def outcome(self, design: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the loss and the constraints (energy = 0; the others ≥ 0), (5,), and their derivatives by the design, (5, 5)."""
        (time, pull, energy), slopes = self.fall.value_and_grad(self._values(design))
        by_design = np.array([[float(part) for part in slopes[name]] for name in DESIGN]).T
        weight = self.mass * GRAVITY
        factors = np.array([[1, self.weight / weight, 0], [0, 0, 1 / (weight * self.drop)]])
        rated = self._rated(design, float(time), float(pull), float(energy))
        return rated, np.array([*factors @ by_design, *self._spare_slopes(design)])

    def _spare_slopes(self, design: np.ndarray) -> np.ndarray:
        """Returns the derivatives of the constraints without integrals, (3, 5)."""
        k1, k2, _, give, _ = design
        locks = [-give / k2, give * k1 / k2**2, -EARLY, -(1 + k1 / k2), EARLY]
        return np.array([[0, 0, 0, 0, -1], locks, [0, 0, 1, 1, -1]]) / self.drop

    def differences(self, design: np.ndarray) -> np.ndarray:
        """Returns the derivatives of `outcome`, those of the integrals as central differences, from values only."""
        columns = []
        for k in range(len(design)):
            step = np.zeros(len(design))
            step[k] = DIFFERENCE * SCALES[k]
            columns.append((self.values(design + step) - self.values(design - step)) / (2 * step[k]))
        return np.array([*np.array(columns).T[:2], *self._spare_slopes(design)])

    def values(self, design: np.ndarray) -> np.ndarray:
        """Returns the loss and the constraints, (5,)."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)  # of a design that does not stop the jumper
            time, pull, energy = (float(v) for v in self.fall(self._values(design)))
        return self._rated(design, time, pull, energy)

    def _rated(self, design: np.ndarray, time: float, pull: float, energy: float) -> np.ndarray:
        k1, k2, slack, give, lowest = design
        weight = self.mass * GRAVITY
        time = time if np.isfinite(time) else WALL  # cords too weak to stop the jumper
        loss = time + self.weight * (pull / weight - 1)
        early = EARLY * (lowest - slack) - give * (1 + k1 / k2)
        spare = np.array([self.drop - MARGIN - lowest, early, self.drop / 2 + slack + give - lowest]) / self.drop
        return np.array([loss, energy / (weight * self.drop), *spare])

    def simulated(self, design: np.ndarray) -> dict[str, np.ndarray]:
        """Returns times, ways fallen and forces until the lowest point or the ground, by an integrator that knows none of the above."""
        from scipy.integrate import solve_ivp

        def acceleration(t: float, state: np.ndarray) -> list[float]:
            return [state[1], GRAVITY - float(pull_of(design, state[0])) / self.mass]

        def stops(t: float, state: np.ndarray) -> float:
            return float(state[1]) if t > 0 else 1.0

        def hits(t: float, state: np.ndarray) -> float:
            return self.drop - float(state[0])

        for event in (stops, hits):
            event.terminal = True  # type: ignore[attr-defined]
        end = solve_ivp(acceleration, (0, 60), [0.0, 0.0], events=[stops, hits], rtol=1e-9, atol=1e-9, max_step=0.02)
        return {"time": end.t, "way": end.y[0], "force": pull_of(design, end.y[0])}

    def _values(self, design: np.ndarray) -> dict[str, float]:
        return dict(zip(DESIGN, design.tolist(), strict=True)) | {"mass": self.mass}


def pull_of(design: np.ndarray, way: Any) -> np.ndarray:
    """Returns the force of the cords after a way, in closed form."""
    k1, k2, slack, give, _ = design
    y = np.maximum(np.asarray(way, dtype=float) - slack, 0)
    first = give * (1 + k1 / k2)
    return np.asarray(k1 * k2 / (k1 + k2) * np.minimum(y, first) + k2 * np.maximum(y - first, 0))


@dataclass
class Optimum:
    """The end of an optimisation: the design, loss and constraints there and at each step before, evaluations, and what went wrong."""

    design: np.ndarray
    outcomes: list[np.ndarray] = field(default_factory=list)
    evaluations: int = 0
    seconds: float = 0.0
    failure: str = ""

    @property
    def violation(self) -> float:
        """Returns the largest violation of a constraint."""
        return violation(self.outcomes[-1])


def violation(outcome: np.ndarray) -> float:
    """Returns the largest violation of a constraint, relative."""
    return float(max(abs(outcome[1]), *np.maximum(-outcome[2:], 0)))


def optimise(jump: Jump, derivatives: Callable[[np.ndarray], np.ndarray], steps: int, start: np.ndarray) -> Optimum:
    """Returns the end of SLSQP (SciPy), given a function that returns the derivatives of `outcome`."""
    from scipy.optimize import minimize

    found = Optimum(start, [jump.values(start)])

    def values(z: np.ndarray) -> np.ndarray:
        found.evaluations += 1
        return jump.values(z * SCALES)

    def slopes(z: np.ndarray) -> np.ndarray:
        return np.asarray(derivatives(z * SCALES) * SCALES)

    def reached(z: np.ndarray) -> None:
        found.design = z * SCALES
        found.outcomes.append(jump.values(found.design))

    constraints: list[Mapping[str, Any]] = [
        {"type": "eq", "fun": lambda z: values(z)[1], "jac": lambda z: slopes(z)[1]},
        {"type": "ineq", "fun": lambda z: values(z)[2:], "jac": lambda z: slopes(z)[2:]},
        {"type": "ineq", "fun": lambda z: [(SCALES[4] * z[4] - SCALES[2] * z[2] - SHORTEST) / jump.drop], "jac": _stretch_slopes(jump)},
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)  # of designs that do not stop the jumper, which `values` rates
        end = minimize(
            lambda z: values(z)[0],
            start / SCALES,
            jac=lambda z: slopes(z)[0],
            method="SLSQP",
            bounds=[(low / scale, high / scale) for (low, high), scale in zip(jump.bounds(), SCALES, strict=True)],
            constraints=constraints,
            callback=reached,
            options={"maxiter": max(steps, 1), "ftol": 1e-10},
        )
    if violation(found.outcomes[-1]) > TOLERANCE:
        found.failure = f"a constraint is violated by {found.violation:.1e}"
    elif not end.success:
        found.failure = f"SciPy says: {end.message}"
    return found


def _stretch_slopes(jump: Jump) -> Callable[[np.ndarray], np.ndarray]:
    slopes = np.zeros((1, len(SCALES)))
    slopes[0, [2, 4]] = -SCALES[2] / jump.drop, SCALES[4] / jump.drop
    return lambda z: slopes
