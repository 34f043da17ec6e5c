"""Warped areas: the motion of the surfaces is carried into the interior by a velocity field, and the divergence theorem does the rest.

rule       ∂∫ G = ∫ (∂G)ₐₑ + ∇·(G·V)ₐₑ      for every V that is continuous, has the normal velocity of each surface on it, and no normal
           component on the sides of the cube;  v_j = -(∂g_j)·∇g_j/|∇g_j|² is the velocity of the surface g_j = 0
known      V(x) = Σ_j w_j(x)·v_j(x) / Σ_j w_j(x),  w_j = (g_j²/|∇g_j|²)^-p: weights by the distance to each surface, to first order. The
           sides are surfaces of velocity 0. Unbiased; its divergence grows like 1/r where surfaces meet.
auxiliary  V(x) = Σᵢ Σ_j w(x, x′ᵢ; j)·v_j(x′ᵢ)/q(x′ᵢ|x) / Σᵢ Σ_j w(x, x′ᵢ; j)/q(x′ᵢ|x),  w = (|x - x′|² + B_j(x′)²)^-p,  with M points x′
           around x, about as far as the nearest surface is, B_j = |g_j|/|∇g_j|. The points stay where they are while x is
           differentiated: moved along, the weights' own jumps would be missing from the derivative. The sides come in with their
           distance. A quotient of means: a bias of order 1/M. V is needed in the limit only, so no point needs to lie on a surface.
truncated  the limit of M = 1, 2, 4, …, as its first term and a random one of the differences, each divided by its probability; unbiased
           up to the last of 2^`levels` points
variance   of order 1/N; that of ∇·V, with a logarithm where surfaces meet
source     Bangaru, Li, Durand 2020, "Unbiased warped-area sampling for differentiable rendering"; McLeish 2011 and Rhee, Glynn 2015 for
           the truncation
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, cast

from teg.analysis.calculus import slope
from teg.errors import OptionError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Cond, Expr, Param, Var, const
from teg.ir.simplify import add, call, conjunction, div, integer_power, mul, positive, sub, where
from teg.ir.traverse import substitute
from teg.passes.differentiate.estimators.estimator import Estimator, check_count
from teg.passes.differentiate.estimators.nests import Cube, along, check_dimensions, divergence, slopes_through_nests, squared_slopes

MOST_POINTS, MOST_LEVELS = 64, 6


@dataclass(frozen=True)
class Warp(Estimator):
    """`power`: p of the weights. `auxiliary`: the number M of auxiliary points, 0 for weights by the known surfaces. `levels`: with a
    random truncation, the largest M is 2^`levels`; 0 for none."""

    power: int = 2
    auxiliary: int = 0
    levels: int = 0

    name: ClassVar[str] = "warp"

    def checked(self) -> Estimator:
        """Returns the estimator if its options are in their ranges."""
        check_count("power", self.power, 8)
        check_count("auxiliary", self.auxiliary, MOST_POINTS)
        check_count("levels", self.levels, MOST_LEVELS)
        if self.power < 1:
            raise OptionError("power=0 gives each surface the same weight everywhere", None, "a whole number from 1 to 8")
        if self.levels and self.auxiliary:
            raise OptionError("levels= chooses the number of auxiliary points itself", None, "auxiliary=M, or levels=k, not both")
        return self

    def slopes(self, e: Expr, wrt: Sequence[Param]) -> Sequence[Expr]:
        """Returns the derivatives by each parameter."""
        return slopes_through_nests(e, wrt, self._of_cube)

    def _of_cube(self, cube: Cube, moving: Sequence[Param]) -> Sequence[Expr]:
        check_dimensions(cube, self.name)
        if self.levels:
            return [cube.integral(*self._truncated(cube, p)) for p in moving]
        if self.auxiliary:
            noise, points = auxiliary_points(cube, self.auxiliary)
            found = []
            for p in moving:
                field = field_of_points(cube, p, self.power, points)
                found.append(cube.integral(add(cube.slope(p), _placed(transported(cube, field), points)), noise))
            return found
        return [cube.integral(add(cube.slope(p), transported(cube, known_field(cube, p, self.power)))) for p in moving]

    def _truncated(self, cube: Cube, p: Param) -> tuple[Expr, Sequence[Var]]:
        """Returns the integrand with a random truncation, and its random variables."""
        noise, points = auxiliary_points(cube, 2**self.levels)
        coin = Var.make("level", ())
        terms = [transported(cube, field_of_points(cube, p, self.power, points[: 2**k])) for k in range(self.levels + 1)]
        total = terms[0]
        for k in range(1, self.levels + 1):
            likely = 2.0 ** (-k)
            total = add(total, where(positive(sub(const(likely), coin)), mul(const(1 / likely), sub(terms[k], terms[k - 1])), ZERO))
        return add(cube.slope(p), _placed(total, points)), [coin, *noise]


def velocity(g: Expr, p: Param, variables: Sequence[Var]) -> list[Expr]:
    """Returns v = -(∂g)·∇g/|∇g|², the velocity of the surface g = 0 along its normal."""
    slopes, square = squared_slopes(g, variables)
    rate = mul(MINUS_ONE, div(slope(g, p), square))
    return [mul(rate, s) for s in slopes]


def transported(cube: Cube, field: Sequence[Expr]) -> Expr:
    """Returns ∇·(G·V) between the discontinuities."""
    return add(mul(cube.body, divergence(field, cube.variables)), along(cube.body, field, cube.variables))


def known_field(cube: Cube, p: Param, power: int) -> list[Expr]:
    """Returns the mean of the surfaces' velocities, weighted by the inverse distances to them."""
    moved: list[list[Expr]] = [[] for _ in cube.variables]
    weights = side_weights(cube.variables, 2 * power)
    for g in cube.surfaces:
        slopes, square = squared_slopes(g, cube.variables)
        near = integer_power(g, -2 * power)
        weights.append(mul(near, integer_power(square, power)))
        rate = mul(MINUS_ONE, slope(g, p), near, integer_power(square, power - 1))
        for terms, s in zip(moved, slopes, strict=True):
            terms.append(mul(rate, s))
    scale = integer_power(add(*weights), -1)
    return [mul(scale, add(*terms)) for terms in moved]


def side_weights(variables: Sequence[Var], power: int) -> list[Expr]:
    """Returns the weights of the sides of the cube, d^-power of the distance d to each."""
    return [integer_power(d, -power) for u in variables for d in (u, sub(ONE, u))]


@dataclass(frozen=True)
class AuxiliaryPoint:
    """A point x′ near x: `names` stand for its coordinates while x is differentiated, and are replaced by `place` afterwards.

    `weight` is 1/q of its density, and `inside` the condition that it is in the cube.
    """

    names: tuple[Var, ...]
    place: tuple[Expr, ...]
    weight: Expr
    inside: Cond


def auxiliary_points(cube: Cube, count: int) -> tuple[list[Var], list[AuxiliaryPoint]]:
    """Returns the random variables of auxiliary points, and the points.

    With d the distance of x to the nearest surface, they lie at d·r: P(r > ρ) = 1/(1 + ρ²), in one variable 1 - 2·atan(ρ)/π.
    """
    n = len(cube.variables)
    scale = distance_to_surfaces(cube)
    noise: list[Var] = []
    points = []
    for i in range(count):
        coins = [Var.make(f"coin {i}.{k}", ()) for k in range(max(n, 2))]
        noise += coins
        if n == 1:
            r = call("tan", mul(const(math.pi / 2), coins[0]))
            rarity = mul(const(math.pi / 2), add(ONE, mul(r, r)))
        else:
            r = call("sqrt", sub(integer_power(coins[0], -1), ONE))
            rarity = mul(const(0.5), integer_power(add(ONE, mul(r, r)), 2), integer_power(r, n - 2))
        away = [mul(scale, r, c) for c in _direction(coins, n)]
        place = tuple(add(x, a) for x, a in zip(cube.variables, away, strict=True))
        inside: Cond = TRUE
        for c in place:
            inside = conjunction(inside, positive(c), positive(sub(ONE, c)))
        names = tuple(Var.make(f"near {i}.{k}", ()) for k in range(n))
        sphere = {1: 2.0, 2: 2 * math.pi, 3: 4 * math.pi}[n]
        weight = mul(const(sphere), integer_power(scale, n), rarity)
        points.append(AuxiliaryPoint(names, place, weight, inside))
    return noise, points


def distance_to_surfaces(cube: Cube) -> Expr:
    """Returns the distance of a point to the nearest surface, to first order, at most 1."""
    best: Expr = ONE
    for g in cube.surfaces:
        best = call("min", best, div(mul(g, g), squared_slopes(g, cube.variables)[1]))
    return call("sqrt", best)


def _direction(coins: Sequence[Var], dimensions: int) -> list[Expr]:
    """Returns a uniform direction in one, two or three variables, from all coins but the first, which is the distance's."""
    if dimensions == 1:
        return [where(positive(sub(coins[1], const(0.5))), ONE, MINUS_ONE)]
    angle = mul(const(2 * math.pi), coins[1])
    flat = [call("cos", angle), call("sin", angle)]
    if dimensions == 2:
        return flat
    height = sub(mul(const(2.0), coins[2]), ONE)
    radius = call("root", sub(ONE, mul(height, height)))
    return [mul(radius, flat[0]), mul(radius, flat[1]), height]


def field_of_points(cube: Cube, p: Param, power: int, points: Sequence[AuxiliaryPoint]) -> list[Expr]:
    """Returns the mean of the velocities at auxiliary points, with the weights of their distances from x and from the surfaces.

    The points' coordinates are names of their own, and the conditions and densities are those of the points as they are placed.
    """
    moved: list[list[Expr]] = [[] for _ in cube.variables]
    weights = [mul(const(float(len(points))), w) for w in side_weights(cube.variables, max(2 * power - len(cube.variables), 1))]
    surfaces = [(g, velocity(g, p, cube.variables), squared_slopes(g, cube.variables)[1]) for g in cube.surfaces]
    for i, point in enumerate(points):
        at = dict(zip(cube.variables, point.names, strict=True))
        square = add(*(integer_power(sub(x, z), 2) for x, z in at.items()))
        for g, v, slopes in surfaces:
            away = cast(Expr, substitute(div(mul(g, g), slopes), at))
            weight = mul(_density(i), integer_power(add(square, away), -power))
            weights.append(weight)
            for terms, c in zip(moved, v, strict=True):
                terms.append(mul(weight, cast(Expr, substitute(c, at))))
    scale = integer_power(add(*weights), -1)
    return [mul(scale, add(*terms)) for terms in moved]


def _density(i: int) -> Var:
    """Returns the name of 1/q of a point, which is not differentiated."""
    return Var.make(f"weight {i}", ())


def _placed(e: Expr, points: Sequence[AuxiliaryPoint]) -> Expr:
    """Returns the expression with the places of the points and their densities in the place of their names."""
    at: dict[Var, Expr] = {}
    for i, point in enumerate(points):
        at |= dict(zip(point.names, point.place, strict=True))
        at[_density(i)] = where(point.inside, point.weight, ZERO)
    return cast(Expr, substitute(e, at))
