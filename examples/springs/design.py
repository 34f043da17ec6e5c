"""The design of two cords: SciPy's constrained optimiser on the derivatives of the compiled integrals, or on others, to compare.

minimise    weight·(g - stress(apex)/m)²/(1 m²/s⁴) + T/(1 s)
such that   F(apex) = 0                    the fall ends at the apex, and not on the ground below
            k₁·apex ≤ (k₁ + k₂)·l₂         string 2 does not lock
            FIRST ≤ lock/apex ≤ LAST       string 1 locks at x = lock = l₁(1 + k₁/k₂)
            LEAST ≤ k₁, k₂ ≤ STIFFEST      as multiples of m·g/apex

The optimiser moves z = (log k₁, log k₂, lock/apex, log l₂): the lock's place has bounds then, and they hold at every step.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from teg.evaluator.accuracy import AccuracyWarning
from teg.evaluator.evaluator import Evaluator
from teg.examples.springs.scene import GRAVITY, WEAKENING

FIRST, LAST, LEAST, STIFFEST = 0.1, 0.9, 0.005, 50.0
LONGEST = 100.0  # string 2, as a multiple of the apex
DIFFERENCE = 1e-6  # relative to each entry of the design
TOLERANCE = 1e-10  # of the constraints
OPTIMAL = 1e-6  # of the gradient along the constraints, relative to the loss
WALL = 1e3  # the time in s of a design that stops the jumper on the way

OfDesign = Callable[[np.ndarray], np.ndarray]


@dataclass
class Jump:
    """A jump of `mass` kg to `apex` m below the rest position, the weight of its acceleration, and the compiled fall."""

    apex: float
    mass: float
    weight: float
    fall: Evaluator

    def start(self) -> np.ndarray:
        """Returns the published start, (1, 10; 2, 10) for 1 kg and 5 m, scaled."""
        stiffness, length = self.mass * 5 / self.apex, self.apex / 5
        return np.array([1.0 * stiffness, 10.0 * stiffness, 2.0 * length, 10.0 * length])

    def bounds(self) -> np.ndarray:
        """Returns the least and the largest value of each entry of z, (4, 2)."""
        stiffness = np.log(np.array([LEAST, STIFFEST]) * self.mass * GRAVITY / self.apex)
        return np.array([stiffness, stiffness, [FIRST, LAST], np.log([1e-3 * self.apex, LONGEST * self.apex])])

    def moved(self, design: np.ndarray) -> np.ndarray:
        """Returns z, which the optimiser moves."""
        a, b, first, second = design
        return np.array([np.log(a), np.log(b), first * (1 + a / b) / self.apex, np.log(second)])

    def design(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the design and its derivatives by z, (4, 4)."""
        a, b, second = np.exp(z[[0, 1, 3]])
        share, lock = b / (a + b), self.apex * z[2]
        slope = lock * share * a / (a + b)  # of l1, by log k2
        by_z = np.diag([a, b, self.apex * share, second])
        by_z[2, :2] = -slope, slope
        return np.array([a, b, lock * share, second]), by_z

    def outcome(self, design: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the loss and the constraints (F(apex) = 0; the other ≥ 0), (3,), and their derivatives by the design, (3, 4)."""
        (time, acceleration, energy), slopes = self.fall.value_and_grad(self.values_of(design))
        by_design = np.array([[*(float(slopes[name][i]) for name in ("k1", "k2", "l1")), 0.0] for i in range(3)])
        rated = self._rated(design, float(time), float(acceleration), float(energy))
        loss = by_design[0] + 2 * self.weight * float(acceleration) * by_design[1]
        return rated, np.array([loss, by_design[2] / (GRAVITY * self.apex), self._spare_slopes(design)])

    def _spare_slopes(self, design: np.ndarray) -> np.ndarray:
        """Returns the derivatives of the constraint on string 2."""
        a, b, _, second = design
        return np.asarray(np.array([-second * b / a**2, second / a, 0, 1 + b / a]) / self.apex)

    def differences(self, design: np.ndarray) -> np.ndarray:
        """Returns the derivatives of `outcome`, those of the integrals as central differences, from values only."""
        columns = []
        for k in range(len(design)):
            step = np.zeros(len(design))
            step[k] = DIFFERENCE * design[k]
            columns.append((self.values(design + step) - self.values(design - step)) / (2 * step[k]))
        return np.array([*np.array(columns).T[:2], self._spare_slopes(design)])

    def values(self, design: np.ndarray) -> np.ndarray:
        """Returns the loss and the constraints, (3,)."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)  # of a design that stops the jumper on the way
            time, acceleration, energy = (float(v) for v in self.fall(self.values_of(design)))
        return self._rated(design, time, acceleration, energy)

    def _rated(self, design: np.ndarray, time: float, acceleration: float, energy: float) -> np.ndarray:
        a, b, _, second = design
        loss = (time if np.isfinite(time) else WALL) + self.weight * acceleration**2
        return np.array([loss, energy / (GRAVITY * self.apex), second * (1 + b / a) / self.apex - 1])

    def stress(self, design: np.ndarray, way: Any) -> np.ndarray:
        """Returns the force of the cords after a way, in N, in closed form."""
        a, b, first, _ = design
        x = np.asarray(way, dtype=float)
        return np.asarray(np.where(b * x > (a + b) * first, WEAKENING * a * first + b * (x - first), 2 * a * b / (a + b) * x))

    def simulated(self, design: np.ndarray) -> dict[str, np.ndarray]:
        """Returns times, ways fallen and forces until the lowest point, by an integrator that knows none of the above."""
        from scipy.integrate import solve_ivp

        def acceleration(t: float, state: np.ndarray) -> list[float]:
            return [state[1], GRAVITY - float(self.stress(design, state[0])) / self.mass]

        def stops(t: float, state: np.ndarray) -> float:
            return float(state[1]) if t > 0 else 1.0

        def passes(t: float, state: np.ndarray) -> float:
            return 2 * self.apex - float(state[0])

        for event in (stops, passes):
            event.terminal = True  # type: ignore[attr-defined]
        longest = 60 * float(np.sqrt(self.apex / GRAVITY))
        end = solve_ivp(acceleration, (0, longest), [0.0, 0.0], events=[stops, passes], rtol=1e-9, atol=1e-9, max_step=longest / 3000)
        return {"time": end.t, "way": end.y[0], "force": self.stress(design, end.y[0])}

    def values_of(self, design: np.ndarray) -> dict[str, float]:
        """Returns the arguments of the compiled fall."""
        return dict(zip(("k1", "k2", "l1"), design[:3].tolist(), strict=True)) | {"apex": self.apex, "mass": self.mass}


@dataclass
class Optimum:
    """The end of an optimisation: the design, loss and constraints there and at each step before, evaluations, and what went wrong."""

    design: np.ndarray
    outcomes: list[np.ndarray] = field(default_factory=list)
    evaluations: int = 0
    seconds: float = 0.0
    failure: str = ""
    interrupted: bool = False

    @property
    def violation(self) -> float:
        """Returns the largest violation of a constraint."""
        return violation(self.outcomes[-1])


def violation(outcome: np.ndarray) -> float:
    """Returns the largest violation of a constraint, relative."""
    return float(max(abs(outcome[1]), *np.maximum(-outcome[2:], 0)))


def stationarity(jump: Jump, design: np.ndarray, outcome: np.ndarray, slopes: np.ndarray) -> float:
    """Returns the part of the loss's gradient by z that no multipliers of active constraints and bounds cancel, relative to the loss."""
    from scipy.optimize import lsq_linear

    by_z = slopes @ jump.design(jump.moved(design))[1]
    low, high = np.abs(jump.moved(design)[:, None] - jump.bounds()).T < 1e-7
    active = [by_z[1], -by_z[1], *by_z[2:][outcome[2:] < 1e-7], *np.eye(4)[low], *-np.eye(4)[high]]
    multipliers = lsq_linear(np.array(active).T, by_z[0], (0, np.inf), method="bvls").x
    return float(np.abs(by_z[0] - multipliers @ np.array(active)).max() / max(1.0, abs(outcome[0])))


def optimise(jump: Jump, evaluate: OfDesign, derivatives: OfDesign, steps: int) -> Optimum:
    """Returns the end of SLSQP (SciPy), given functions that return loss and constraints, and their derivatives. Ctrl-C ends it."""
    from scipy.optimize import minimize

    start = jump.start()
    optimum = Optimum(start, [evaluate(start)])

    def values(z: np.ndarray) -> np.ndarray:
        optimum.evaluations += 1
        return evaluate(jump.design(z)[0])

    def slopes(z: np.ndarray) -> np.ndarray:
        design, by_z = jump.design(z)
        return np.asarray(derivatives(design) @ by_z)

    def reached(z: np.ndarray) -> None:
        optimum.design = jump.design(z)[0]
        optimum.outcomes.append(evaluate(optimum.design))

    constraints: list[Mapping[str, Any]] = [
        {"type": "eq", "fun": lambda z: values(z)[1], "jac": lambda z: slopes(z)[1]},
        {"type": "ineq", "fun": lambda z: values(z)[2], "jac": lambda z: slopes(z)[2]},
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)  # of designs that stop the jumper on the way, which `values` rates
        try:
            end = minimize(
                lambda z: values(z)[0],
                jump.moved(start),
                jac=lambda z: slopes(z)[0],
                method="SLSQP",
                bounds=jump.bounds(),
                constraints=constraints,
                callback=reached,
                options={"maxiter": max(steps, 1), "ftol": 1e-13},
            )
            optimum.failure = _failure(jump, derivatives, optimum, "" if end.success else str(end.message))
        except KeyboardInterrupt:
            optimum.interrupted = True
    return optimum


def _failure(jump: Jump, derivatives: OfDesign, optimum: Optimum, message: str) -> str:
    """Returns what is wrong with the end: a constraint, the gradient, or what SciPy says; "" if nothing is."""
    if optimum.violation > TOLERANCE:
        return f"a constraint is violated by {optimum.violation:.1e}"
    left = stationarity(jump, optimum.design, optimum.outcomes[-1], derivatives(optimum.design))
    if left > OPTIMAL:
        return f"the gradient along the constraints is {left:.1e}" + (f"; SciPy says: {message}" if message else "")
    return ""
