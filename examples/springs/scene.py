"""The integrals: time and energy of a fall on two bungee cords in series, whose force drops where a string locks.

The model is that of Bangaru et al. (SIGGRAPH 2021; g = 10, weakening 0.2). A jumper at rest is stretched by x below the rest position. The
cords share the stretch, x₁ = k₂x/(k₁ + k₂) and x₂ = k₁x/(k₁ + k₂). A string of the length l₁ locks cord 1, which weakens as it yields:

    stress(x) = k₁x₁ + k₂x₂                    x₁ < l₁      both cords stretch
              = WEAKENING·k₁l₁ + k₂(x - l₁)    x₁ > l₁      cord 1 is locked

String 2, of the length l₂, must not become taut above the apex, the lowest point (design.py); swap the cords for the other case.

The speed is √(2F) with F(x) = ∫₀ˣ (g - stress/m), and the fall ends where F = 0. The published loss is

    (g - stress(apex)/m)² + T,      T = ∫ dx/√|2F(x)| from x = NADIR to the apex

Its integrand has a singularity where the fall ends, which moves with all of k₁, k₂, l₁. The constraint F(apex) = 0 admits the designs whose
fall ends at the apex. There ∂T is infinite, as the singularity reaches the bound. An optimiser needs a time that is the same on these
designs and smooth around them. It comes from F(x) - F(apex)·x/apex, which is 0 at both ends:

    T = √(2m·apex) ∫ dφ/√(S₂ - S₁),   x = apex·sin²φ,   S₁ = mean stress over (0, x),   S₂ = mean stress over (x, apex)
"""

from __future__ import annotations

import math

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.treatments import Grid, compiled
from teg.ir.expr import Expr
from teg.ir.operands import as_number

DESIGN = ("k1", "k2", "l1", "l2")  # N/m, N/m, m, m
GRAVITY, WEAKENING = 10.0, 0.2
NADIR = 1e-5  # m: where the time starts
GRID = Grid(64, 1.0)  # of smoothed derivatives

k1, k2, l1, l2 = teg.params("k1 k2 l1 l2")
apex, mass = teg.params("apex mass")


def stress(x: Expr) -> Expr:
    """Returns the force of cords stretched by x, in N."""
    return teg.where(k2 * x > (k1 + k2) * l1, WEAKENING * k1 * l1 + k2 * (x - l1), 2 * k1 * k2 / (k1 + k2) * x)


def published_loss(apex: float, mass: float) -> Expr:
    """Returns the loss of the paper, F written out on both sides of the place where cord 1 locks."""
    x = teg.var("x")
    lock = l1 * (k1 + k2) / k2
    both = x * (GRAVITY - k1 * k2 / (k1 + k2) * x / mass)
    at_lock = GRAVITY * lock - k1 * k2 / (k1 + k2) * lock**2 / mass
    one = at_lock + (GRAVITY - WEAKENING * k1 * l1 / mass) * (x - lock) - k2 * ((x - l1) ** 2 - (lock - l1) ** 2) / (2 * mass)
    pace = teg.where(x < lock, 1 / teg.sqrt(2 * both), 1 / teg.sqrt(abs(2 * one)))
    time = teg.integral(pace, (x, NADIR, apex))
    return (GRAVITY - stress(as_number(apex)) / mass) ** 2 + time + 0 * l2


def fall() -> Expr:
    """Returns the time of the fall, the acceleration at the apex, and F(apex), 0 where the fall ends there."""
    phi, tau = teg.vars("phi tau")

    def mean_stress(start: Expr, end: Expr) -> Expr:
        return teg.integral(stress(start + (end - start) * tau), (tau, 0, 1))

    x = apex * teg.sin(phi) ** 2
    rate = 1 / teg.sqrt(mean_stress(x, apex) - mean_stress(0 * x, x))
    time = teg.sqrt(2 * mass * apex) * teg.integral(rate, (phi, teg.asin(teg.sqrt(NADIR / apex)), math.pi / 2))
    return teg.tuple(time, GRAVITY - stress(apex) / mass, apex * (GRAVITY - mean_stress(0 * apex, apex) / mass))


def compile_fall(backend: Backend, discontinuities: Discontinuities = "exact") -> Evaluator:
    """Returns the compiled fall, to be differentiated by the design."""
    evaluator: Evaluator = compiled(fall(), [k1, k2, l1], backend, discontinuities, GRID)
    return evaluator
