"""Blurred velocities: the velocity of the nearest surface, averaged over a Gaussian around each point.

rule       ∂∫ G ≈ ∫ (∂G)ₐₑ + ∇·(G·V)ₐₑ,  V(x) = E v(x′),  x′ = x + κ·ξ, ξ normal;  v(x′) is the velocity of the surface nearest to x′, 0 if
           that is a side of the cube.  ∇·V = E v(x′)·(x′ - x)/κ², so nothing but G is differentiated; ξ and -ξ are both taken
bias       V is the velocity of the boundary only up to the change of v within κ: of order κ² where velocity and surface are smooth, of
           order κ where surfaces meet each other or a side; 0 for a translation far from the sides
variance   of order 1/(κ²·M·N): the price of a small κ
source     Loubet, Holzschuch, Jakob 2019, "Reparameterizing discontinuous integrands for differentiable rendering": one change of
           variables for each neighbourhood, blurred by a kernel; they estimate the motion from samples, here the surfaces are known
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, cast

from teg.errors import OptionError
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Expr, Param, Var, const
from teg.ir.simplify import add, call, div, integer_power, mul, positive, sub, where
from teg.ir.traverse import substitute
from teg.passes.differentiate.estimators.estimator import Estimator, check_count, check_positive
from teg.passes.differentiate.estimators.nests import Cube, along, check_dimensions, slopes_through_nests, squared_slopes
from teg.passes.differentiate.estimators.warp import velocity

MOST_PAIRS = 32


@dataclass(frozen=True)
class WarpBlur(Estimator):
    """`sigma`: κ, the width of the Gaussian in the unit cube. `auxiliary`: the number M of pairs of points."""

    sigma: float = 0.05
    auxiliary: int = 1

    name: ClassVar[str] = "warp-blur"

    def checked(self) -> Estimator:
        """Returns the estimator if its options are in their ranges."""
        check_positive("sigma", self.sigma)
        check_count("auxiliary", self.auxiliary, MOST_PAIRS)
        if self.auxiliary < 1:
            raise OptionError("auxiliary=0 leaves no point to take a velocity from", None, f"a whole number from 1 to {MOST_PAIRS}")
        return self

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the derivatives by each parameter."""
        return slopes_through_nests(e, wrt, self._of_cube)

    def _of_cube(self, cube: Cube, moving: Sequence[Param]) -> Sequence[Expr]:
        check_dimensions(cube, self.name)
        coins, offsets = gaussians(cube, self.auxiliary)
        found = []
        for p in moving:
            nearest = nearest_velocity(cube, p)
            terms = [self._at(cube, nearest, [mul(const(sign), xi) for xi in xis]) for xis in offsets for sign in (1.0, -1.0)]
            mean = mul(const(0.5 / self.auxiliary), add(*terms))
            found.append(cube.integral(add(cube.slope(p), mean), coins))
        return found

    def _at(self, cube: Cube, nearest: Sequence[Expr], offset: Sequence[Expr]) -> Expr:
        """Returns G·∇·V + V·∇G with the velocity at x + κ·ξ."""
        at = {x: add(x, mul(const(self.sigma), xi)) for x, xi in zip(cube.variables, offset, strict=True)}
        field = [cast(Expr, substitute(v, at)) for v in nearest]
        spread = mul(const(1 / self.sigma), add(*(mul(v, xi) for v, xi in zip(field, offset, strict=True))))
        return add(mul(cube.body, spread), along_values(cube, field))


def along_values(cube: Cube, field: Sequence[Expr]) -> Expr:
    """Returns V·∇G between the discontinuities."""
    return along(cube.body, field, cube.variables)


def gaussians(cube: Cube, count: int) -> tuple[list[Var], list[list[Expr]]]:
    """Returns uniform variables, and vectors of normal ones made of them (Box and Muller 1958)."""
    coins: list[Var] = []
    vectors: list[list[Expr]] = []
    for i in range(count):
        vector: list[Expr] = []
        for k in range(0, len(cube.variables), 2):
            u, w = (Var.make(f"normal {i}.{k}.{part}", ()) for part in "ab")
            coins += [u, w]
            radius, angle = call("sqrt", mul(const(-2.0), call("log", u))), mul(const(2 * math.pi), w)
            vector += [mul(radius, call("cos", angle)), mul(radius, call("sin", angle))]
        vectors.append(vector[: len(cube.variables)])
    return coins, vectors


def nearest_velocity(cube: Cube, p: Param) -> list[Expr]:
    """Returns the velocity of the surface nearest to the point, to first order; 0 where a side of the cube is nearer."""
    best: Expr = ONE
    for u in cube.variables:
        for d in (u, sub(ONE, u)):
            best = call("min", best, integer_power(call("max", d, ZERO), 2))
    field: list[Expr] = [ZERO for _ in cube.variables]
    for g in cube.surfaces:
        away = div(mul(g, g), squared_slopes(g, cube.variables)[1])
        nearer = positive(add(best, mul(MINUS_ONE, away)))
        field = [where(nearer, v, f) for v, f in zip(velocity(g, p, cube.variables), field, strict=True)]
        best = call("min", best, away)
    return field
