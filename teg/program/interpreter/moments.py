"""The meaning of `Hyperbola`: moments of a bilinear function on the unit square, by `teg.numerics.moments`."""

from __future__ import annotations

import math
from math import comb
from typing import TYPE_CHECKING

from teg.numerics.moments import highest, moment, series
from teg.program.limits import LARGEST_RATIO, NEAR_SIDE, NO_FLUX, SADDLE, SMALLEST, TIE_EPS
from teg.program.operations import divide
from teg.program.statements import Hyperbola, Moments

if TYPE_CHECKING:
    from teg.program.interpreter.machine import Machine

Powers = tuple[int, int]
MIDDLES = ((0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5))


def hyperbola(machine: Machine, stmt: Hyperbola) -> list[float]:
    """Returns the results."""
    f = machine.numbers(stmt.corners)
    on = _tied(machine, stmt, f)
    f = [0.0 if tied else v for tied, v in zip(on, f, strict=True)]
    above = [v > 0.0 or (tied and machine.order > 0) for tied, v in zip(on, f, strict=True)]
    if not all(map(math.isfinite, f)):
        return [math.nan] * len(stmt.results)
    powers, turn = [(j, k) for m in stmt.moments for j, k, _ in m.terms], math.nan if any(on) else machine.number(stmt.turn)
    curve = _Curve(f, turn, above, powers) if len(set(above)) == 2 else None
    return [_result(machine, m, curve, above[0]) for m in stmt.moments]


def _tied(machine: Machine, stmt: Hyperbola, f: list[float]) -> list[bool]:
    """Returns the corners at the ends of sides along which g is 0 to rounding; none, if these are all corners."""
    sizes = [abs(f[i]) + abs(f[(i + 1) % 4]) for i in range(4)]
    if not stmt.ties or not min(sizes) <= NEAR_SIDE * (sizes[0] + sizes[2]):
        return [False] * 4
    machine.run(stmt.scales)
    zero = [abs(v) <= TIE_EPS * scale for v, scale in zip(f, machine.numbers(stmt.scale), strict=True)]
    sides = [zero[i] and zero[(i + 1) % 4] for i in range(4)]
    on = [sides[i] or sides[i - 1] for i in range(4)]
    if all(on):
        return [False] * 4
    machine.met.update(k for k, ties in zip(stmt.ties, sides, strict=True) if ties)
    return on


def _result(machine: Machine, wanted: Moments, curve: _Curve | None, all_above: bool) -> float:
    """Returns one result. Without a curve the region is the whole square, or empty."""
    if curve is None:
        if wanted.kind == "border" or (wanted.kind == "above") != all_above:
            return 0.0
        return sum(machine.number(c) / ((j + 1) * (k + 1)) for j, k, c in wanted.terms)
    terms = {(j, k): machine.number(c) for j, k, c in wanted.terms}
    if wanted.kind == "border":
        there = _polynomial(terms, *curve.saddle)
        if curve.crosses and abs(there) > NO_FLUX * sum(abs(_polynomial(terms, u, v)) for u, v in MIDDLES):
            return math.copysign(math.inf, there)
        return sum(machine.number(c) * curve.border(j, k) for j, k, c in wanted.terms)
    if wanted.kind == "above":
        return sum(machine.number(c) * curve.inside(j, k) for j, k, c in wanted.terms)
    return sum(machine.number(c) * (1.0 / ((j + 1) * (k + 1)) - curve.inside(j, k)) for j, k, c in wanted.terms)


def _polynomial(terms: dict[Powers, float], u: float, v: float) -> float:
    return sum(c * (u**j * v**k) for (j, k), c in terms.items())


class _Curve:
    """The curve g = 0, g with values f at the corners, which are `above` or not: corners counterclockwise from (0, 0), side i from corner
    i."""

    def __init__(self, f: list[float], turn: float, above: list[bool], powers: list[Powers]) -> None:
        largest = max(map(abs, f))
        self.unit = 1.0 if SMALLEST <= largest <= 1.0 / SMALLEST else largest
        f = [v / self.unit for v in f]
        self.above = above
        self.a, self.b, self.c, self.d = f[0], f[1] - f[0], f[3] - f[0], (f[0] - f[1]) + (f[2] - f[3])
        # minus the product of both slopes, the same all along the curve
        turn = difference_of_products(f[0], f[2], f[1], f[3]) if turn != turn else turn / self.unit / self.unit
        along = [self.b, f[2] - f[1], f[2] - f[3], self.c]
        self.cut = [divide(f[i], -along[i] if i < 2 else along[i]) for i in range(4)]
        self.beyond = divide(f[2], along[1])  # what is left of the side u = 1 behind its cut
        sides = [i for i in range(4) if above[i] != above[(i + 1) % 4]]
        pairs = [(sides[0], sides[1])]
        if len(sides) == 4:  # corners 1 and 3 are cut off, or 0 and 2
            pairs = [(0, 1), (2, 3)] if turn > 0.0 else [(3, 0), (1, 2)]
        wanted = {(j + a, k + b) for j, k in powers for a, b in ((0, 0), (0, 1))}
        top = highest(frozenset(wanted))
        ends = {i: (*self._place(i), *self._slopes(i, along[i], turn)) for i in sides}
        self.branches = [_Branch(ends[i], ends[j], self.d, top) for i, j in pairs]
        size = 0.5 * sum(abs(f[i] + f[(i + 1) % 4]) for i in range(4))
        self.saddle = (-self.c / self.d, -self.b / self.d) if self.d != 0.0 else (-self.c, -self.b)
        flat = self.d != 0.0 and abs(turn) <= SADDLE * size * abs(self.d)
        self.crosses = flat and all(0.0 <= place <= 1.0 for place in self.saddle)

    def _place(self, i: int) -> tuple[float, float]:
        """Returns the place on side i at which g is 0."""
        at = self.cut[i]
        return ((at, 0.0), (1.0, at), (1.0 - at, 1.0), (0.0, 1.0 - at))[i]

    def _slopes(self, i: int, along: float, turn: float) -> tuple[float, float]:
        """Returns ∂g/∂v and ∂g/∂u at a place. The slope across the side may cancel where it is computed, so it is computed from the product
        of both."""
        other = -turn / along
        return (along, other) if i % 2 else (other, along)

    def border(self, j: int, k: int) -> float:
        """Returns ∫∫ uʲvᵏ δ(g)."""
        return sum(branch.moment(j, k) for branch in self.branches) / self.unit

    def inside(self, j: int, k: int) -> float:
        """Returns ∫∫ [g > 0] uʲvᵏ, by parts in u: the side u = 1, and the curve.

        On the curve u·∂g/∂u is -(a + c·v), which has digits where the curve is close to u = 0 and to v = 0.
        """
        one, two, at = self.above[1], self.above[2], self.cut[1]
        rest = self.beyond * sum(at**i for i in range(k + 1))  # 1 - at^(k + 1)
        side = 1.0 if one and two else at ** (k + 1) if one else rest if two else 0.0
        curve = sum(self.a * s.moment(j, k) + self.c * s.moment(j, k + 1) for s in self.branches)
        return (side / (k + 1) + curve) / (j + 1)


class _Branch:
    """A branch of the curve between two points (u, v, ∂g/∂v, ∂g/∂u)."""

    def __init__(self, start: tuple[float, ...], stop: tuple[float, ...], d: float, top: int) -> None:
        (x0, y0, up0, across0), (x1, y1, up1, across1) = start, stop
        self.half_x, self.half_y, self.x, self.y = 0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        up, across = 0.5 * (up0 + up1), 0.5 * (across0 + across1)
        steep = abs(across) >= abs(up)
        below = -across if steep else up
        rate = (self.half_y if steep else self.half_x) / (1.0 if below == 0.0 else below)
        self.rate, self.z = abs(rate), d * rate
        low, high = sorted((abs(across0), abs(across1)) if steep else (abs(up0), abs(up1)))
        ratio = high / low if low * LARGEST_RATIO > high else LARGEST_RATIO
        self.g = _integrals(self.z, ratio, top)

    def moment(self, j: int, k: int) -> float:
        """Returns ∫ uʲvᵏ along the branch, by the offsets from the middle of its chord."""
        total = 0.0
        for i in range(j + 1):
            for m in range(k + 1):
                value = sum(a * g for a, g in zip(moment(i, m), self.g, strict=False) if a)
                value = (value * self.z if (i + m) % 2 else value) * self.half_x**i * self.half_y**m
                total += comb(j, i) * comb(k, m) * self.x ** (j - i) * self.y ** (k - m) * value
        return self.rate * total


def _integrals(z: float, ratio: float, top: int) -> list[float]:
    """Returns G_0, …, G_top: downwards from a series where z² is small, upwards from the logarithm of the ratio of the slopes at the ends
    else."""
    table, square = series(top), z * z
    if square < table.border:
        g = [0.0]
        for a in reversed(table.coefficients):
            g[0] = g[0] * square + a
        for q in range(top - 1, -1, -1):
            g.insert(0, 1.0 / (2 * q + 1) + square * g[0])
        return g
    g = [0.5 * math.log(ratio) / math.sqrt(square)]
    for q in range(top):
        g.append((g[-1] - 1.0 / (2 * q + 1)) / square)
    return g


def difference_of_products(a: float, b: float, c: float, d: float) -> float:
    """Returns ab - cd, to a rounding or two, however much cancels (Dekker 1971)."""
    first, first_rest = _product(a, b)
    second, second_rest = _product(c, d)
    return (first - second) + (first_rest - second_rest)


def _product(a: float, b: float) -> tuple[float, float]:
    """Returns a product and its rounding error."""
    p = a * b
    high_a, high_b = _high(a), _high(b)
    low_a, low_b = a - high_a, b - high_b
    return p, (((high_a * high_b - p) + high_a * low_b) + low_a * high_b) + low_a * low_b


def _high(a: float) -> float:
    split = (2.0**27 + 1.0) * a
    return split - (split - a)
