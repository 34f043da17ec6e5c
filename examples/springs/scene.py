"""The integrals: time, force and energy of a fall into two bungee cords in series, whose stiffness jumps where a string locks.

The cords together are `slack` metres long. Stretched by y beyond that, they pull with the force F(y) = ∫₀ʸ κ. Beside cord 1 runs a
string that locks it when it is stretched by `give` metres; that of cord 2 must never become taut, which is a constraint (design.py).

    κ(y) = 1/(1/k₁ + 1/k₂)   for 0 < y < give·(1 + k₁/k₂)        both cords stretch
         = k₂                beyond                              cord 1 is locked

κ jumps where the parameters say: automatic differentiation of F sees the heights of the step, not its place.

With x the way fallen and D the lowest point, v² = 2·E(x) and E(D) = 0, so the time of the fall is

    T = √(2·slack/g) + ∫ dx/√(2E(x)) from x = slack to D

Its integrand has a singularity at D, which moves with the parameters. In s with D - x = (D - slack)·s² it has none:

    E(x) = (D - x)·G,    G = F(D)/m - g - (D - x)/m ∫₀¹ τ·κ(x + (D - x)τ - slack) dτ,    T = √(2·slack/g) + ∫₀¹ √(2(D - slack)/G) ds
"""

from __future__ import annotations

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.ir.expr import Expr

DESIGN = ("k1", "k2", "slack", "give", "lowest")  # N/m, N/m, m, m, m
GRAVITY = 9.81


def stiffness(y: Expr) -> Expr:
    """Returns κ, in N/m, of cords stretched by y > 0."""
    k1, k2, give = teg.params("k1 k2 give")
    return teg.where(y < give * (1 + k1 / k2), k1 * k2 / (k1 + k2), k2)


def force(y: Expr) -> Expr:
    """Returns the force of cords stretched by y, in N."""
    z = teg.var("z")
    return teg.where(y > 0, teg.integral(stiffness(z), (z, 0, y)), 0)


def fall() -> Expr:
    """Returns the time of the fall in s, the force at its lowest point in N, and the energy there, in J, 0 where the fall ends there."""
    slack, lowest, mass = teg.params("slack lowest mass")
    s, tau = teg.vars("s tau")
    reach = lowest - slack
    pull = force(reach)

    def over_distance(way: Expr) -> Expr:
        """Returns G where the way to the lowest point is `way`."""
        inner = teg.integral(tau * stiffness(reach - way + way * tau), (tau, 0, 1))
        return pull / mass - GRAVITY - way / mass * inner

    time = teg.sqrt(2 * slack / GRAVITY) + teg.integral(teg.sqrt(2 * reach / over_distance(reach * s**2)), (s, 0, 1))
    energy = mass * (GRAVITY * slack - reach * over_distance(reach))
    return teg.tuple(time, pull, energy)


def compile_fall(backend: Backend, discontinuities: Discontinuities = "exact") -> Evaluator:
    """Returns the compiled fall, to be differentiated by the design."""
    return teg.compile(fall(), [teg.param(name) for name in DESIGN], backend=backend, discontinuities=discontinuities)
