"""Moments of a half-space that a hyperbola bounds, and of its border, over a unit square, by NumPy or JAX: `Hyperbola` of `teg.program`.

Corners are numbered counterclockwise from (0, 0), and side i begins at corner i. `xp` is numpy or jax.numpy; `zero` keeps a product and a
sum apart (see `python_text`), and is 0.0 in NumPy. Everything is computed for all elements: there are masks, and no branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from typing import Any

from teg.numerics.moments import highest, moment, series
from teg.program import LARGEST_RATIO, NEAR_SIDE, NO_FLUX, SADDLE, SMALLEST, TIE_EPS

Powers = tuple[int, int]
Kind = tuple[str, tuple[Powers, ...]]
"""Of a result: "above", "below" or "border", and the powers in its polynomial."""
SPLITTER = 2.0**27 + 1.0
MIDDLES = ((0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5))


def has_near_side(f: Sequence[Any], xp: Any) -> Any:
    """Returns whether g is so small along a side, compared with the other corners, that it may be 0 there."""
    sizes = [abs(f[i]) + abs(f[(i + 1) % 4]) for i in range(4)]
    return xp.minimum(xp.minimum(sizes[0], sizes[1]), xp.minimum(sizes[2], sizes[3])) <= NEAR_SIDE * (sizes[0] + sizes[2])


def settled(xp: Any, f: Sequence[Any], scales: Sequence[Any], near: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """Returns the corners, those of sides that tie being 0; which ones these are; and which sides tie. None if all four do."""
    zero = [(abs(v) <= TIE_EPS * s) & near for v, s in zip(f, scales, strict=True)]
    sides = [zero[i] & zero[(i + 1) % 4] for i in range(4)]
    on = [sides[i] | sides[i - 1] for i in range(4)]
    some = ~(on[0] & on[1] & on[2] & on[3])
    on = [b & some for b in on]
    return [xp.where(b, 0.0, v) for b, v in zip(on, f, strict=True)], on, [b & some for b in sides]


def totals(
    xp: Any, f: Sequence[Any], above: Sequence[Any], kinds: Sequence[Kind], given: Sequence[Sequence[Any]], zero: Any = 0.0
) -> list[Any]:
    """Returns the results of a `Hyperbola` whose ties are settled; `f` are its corners and its `turn`, `given` the coefficients of
    each result."""
    inside = frozenset(p for kind, powers in kinds if kind != "border" for p in powers)
    border = frozenset(p for kind, powers in kinds if kind == "border" for p in powers)
    moments = Moments(xp, f, above, inside, border, zero)
    every, some = above[0] & above[1] & above[2] & above[3], above[0] | above[1] | above[2] | above[3]
    results = []
    for (kind, powers), coefficients in zip(kinds, given, strict=True):
        whole = [1.0 / ((j + 1) * (k + 1)) for j, k in powers]
        if kind == "border":
            terms = dict(zip(powers, coefficients, strict=True))
            found = _dot(coefficients, [moments.border[p] for p in powers], zero)
            there = _polynomial(terms, *moments.saddle, zero)
            endless = moments.crosses & (abs(there) > NO_FLUX * sum(abs(_polynomial(terms, u, v, zero)) for u, v in MIDDLES))
            value = xp.where(every | ~some, 0.0, xp.where(endless, xp.copysign(float("inf"), there), found))
        elif kind == "above":
            found = _dot(coefficients, [moments.inside[p] for p in powers], zero)
            value = xp.where(some, xp.where(every, _dot(coefficients, whole, zero), found), 0.0)
        else:
            found = _dot(coefficients, [w - moments.inside[p] for w, p in zip(whole, powers, strict=True)], zero)
            value = xp.where(every, 0.0, xp.where(some, found, _dot(coefficients, whole, zero)))
        results.append(xp.where(moments.known, value, xp.nan))
    return results


class Moments:
    """The moments of g with values f at the corners, behind which its `turn` stands, all of one shape: `inside[j, k]` = ∫∫ [g > 0] uʲvᵏ
    and `border[j, k]` = ∫∫ uʲvᵏ δ(g).

    `above` is where g > 0, of the corners, or where those that were settled count as that. `known` is false where a corner is not finite.
    `crosses` is where the curve crosses itself on the square, to rounding, in `saddle`.
    """

    def __init__(
        self,
        xp: Any,
        f: Sequence[Any],
        above: Sequence[Any],
        inside: frozenset[Powers],
        border: frozenset[Powers],
        zero: Any = 0.0,
    ) -> None:
        *f, turn = f
        self.xp, most = xp, _largest(xp, f)
        self.known = xp.isfinite(most)
        unit = xp.where((most >= SMALLEST) & (most <= 1.0 / SMALLEST) | ~(most > 0.0) | ~self.known, 1.0, most)
        f = [xp.where(self.known, v / unit, 1.0) for v in f]
        above = [a & self.known for a in above]
        self.b, self.c, self.d = f[1] - f[0], f[3] - f[0], (f[0] - f[1]) + (f[2] - f[3])
        # minus the product of both slopes on the curve
        self.turn = xp.where(xp.isnan(turn), _difference_of_products(f[0], f[2], f[1], f[3], zero), turn / unit / unit)
        self.wanted = border | {p for j, k in inside for p in ((j, k), (j, k + 1))}
        cuts = [above[i] ^ above[(i + 1) % 4] for i in range(4)]
        along = [xp.where(cut, slope, 1.0) for cut, slope in zip(cuts, (self.b, f[2] - f[1], f[2] - f[3], self.c), strict=True)]
        at = [f[i] / (-along[i] if i < 2 else along[i]) for i in range(4)]
        other = [-self.turn / slope for slope in along]  # the slope across the side, which may cancel where it is computed
        places = [(at[0], 0.0), (1.0, at[1]), (1.0 - at[2], 1.0), (0.0, 1.0 - at[3])]
        ups, acrosses = [other[0], along[1], other[2], along[3]], [along[0], other[1], along[2], other[3]]
        sides = [(*place, up, across) for place, up, across in zip(places, ups, acrosses, strict=True)]
        start: list[list[Any]] = []
        stop: list[list[Any]] = []
        for first, last in self._branches(cuts):
            for ends, which in ((start, first), (stop, last)):
                ends.append([sum(xp.where(w, p[axis], 0.0) for w, p in zip(which, sides, strict=True)) for axis in range(4)])
        met = cuts[0] | cuts[1] | cuts[2] | cuts[3]
        both = [xp.stack(pair) for pair in zip(*start, strict=True)], [xp.stack(pair) for pair in zip(*stop, strict=True)]
        self.sums = self._sums(xp.stack([met, cuts[0] & cuts[1] & cuts[2] & cuts[3]]), *both, zero)
        self.border = {p: self.sums[p] / unit for p in border}
        self.inside = {}
        for j, k in inside:
            beyond = f[2] / along[1] * sum(at[1] ** i for i in range(k + 1))  # 1 - at^(k + 1)
            side = xp.where(above[1], xp.where(above[2], 1.0, at[1] ** (k + 1)), xp.where(above[2], beyond, 0.0)) / (k + 1)
            bulge = (f[0] * self.sums[j, k] + zero) + (self.c * self.sums[j, k + 1] + zero)  # on the curve u·∂g/∂u is -(a + c·v)
            self.inside[j, k] = xp.where(above[0] & above[1] & above[2] & above[3], 1.0 / (k + 1), side + bulge) / (j + 1)
        self._find_saddle(f)

    def _branches(self, cuts: Sequence[Any]) -> list[tuple[list[Any], list[Any]]]:
        """Returns two branches of the curve: the side on which each begins, whether it is there, and the side on which it ends."""
        xp, both = self.xp, cuts[0] & cuts[1] & cuts[2] & cuts[3]
        odd = both & (self.turn > 0.0)  # corners 1 and 3 are cut off, else 0 and 2
        even, never = both & ~odd, both & False
        first, last, met = [], [], never
        for cut in cuts:
            first.append(cut & ~met)
            last.append(cut & met)
            met = met | cut
        one = [xp.where(both, b, a) for a, b in zip(first, (odd, never, never, even), strict=True)]
        other = [xp.where(both, b, a) for a, b in zip(last, (even, odd, never, never), strict=True)]
        return [(one, other), ([never, even, odd, never], [never, never, even, odd])]

    def _sums(self, there: Any, start: Sequence[Any], stop: Sequence[Any], zero: Any) -> dict[Powers, Any]:
        """Returns the moments along both branches, where they are there; their ends are u, v, the slope of g by v, and that by u,
        (2, …)."""
        xp, top = self.xp, highest(frozenset(self.wanted))
        (x0, y0, up0, across0), (x1, y1, up1, across1) = start, stop
        half_x, half_y, x, y = 0.5 * (x1 - x0), 0.5 * (y1 - y0), 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        up, across = 0.5 * (up0 + up1), 0.5 * (across0 + across1)
        steep = abs(across) >= abs(up)
        below = xp.where(steep, -across, up)
        rate = xp.where(steep, half_y, half_x) / xp.where(below == 0.0, 1.0, below)
        z = self.d * rate
        square = z * z
        low, high = abs(xp.where(steep, across0, up0)), abs(xp.where(steep, across1, up1))
        least, most = xp.minimum(low, high), xp.maximum(low, high)
        ratio = xp.where(least * LARGEST_RATIO > most, most / xp.where(least > 0.0, least, 1.0), LARGEST_RATIO)
        table = series(top)
        near = square < table.border
        down: list[Any] = [0.0 * z]
        for a in reversed(table.coefficients):
            down[0] = down[0] * square + a
        for q in range(top - 1, -1, -1):
            down.insert(0, 1.0 / (2 * q + 1) + square * down[0])
        far = xp.where(near, 1.0, square)
        up_to = [0.5 * xp.log(ratio) / xp.sqrt(far)]
        for q in range(top):
            up_to.append((up_to[-1] - 1.0 / (2 * q + 1)) / far)
        g = [xp.where(near, a, b) for a, b in zip(down, up_to, strict=True)]
        found: dict[Powers, Any] = {}
        sums: dict[Powers, Any] = {}
        weight = xp.where(there, abs(rate), 0.0)
        for j, k in self.wanted:
            total = 0.0
            for i in range(j + 1):
                for m in range(k + 1):
                    if (i, m) not in found:
                        value = sum(float(a) * v for a, v in zip(moment(i, m), g, strict=False) if a)
                        found[i, m] = (value * z if (i + m) % 2 else value) * half_x**i * half_y**m
                    total = total + comb(j, i) * comb(k, m) * x ** (j - i) * y ** (k - m) * found[i, m]
            terms = weight * total + zero
            sums[j, k] = terms[0] + terms[1]
        return sums

    def _find_saddle(self, f: Sequence[Any]) -> None:
        d = self.xp.where(self.d == 0.0, 1.0, self.d)
        size = 0.5 * sum(abs(f[i] + f[(i + 1) % 4]) for i in range(4))
        self.saddle = -self.c / d, -self.b / d
        self.crosses = self.known & (self.d != 0.0) & (abs(self.turn) <= SADDLE * size * abs(self.d))
        for place in self.saddle:
            self.crosses = self.crosses & (place >= 0.0) & (place <= 1.0)


def _dot(coefficients: Sequence[Any], moments: Sequence[Any], zero: Any) -> Any:
    return sum((c * m + zero for c, m in zip(coefficients, moments, strict=True)), start=0.0)


def _polynomial(terms: dict[Powers, Any], u: Any, v: Any, zero: Any) -> Any:
    return sum((c * (u**j * v**k) + zero for (j, k), c in terms.items()), start=0.0)


def _largest(xp: Any, f: Sequence[Any]) -> Any:
    return xp.maximum(xp.maximum(abs(f[0]), abs(f[1])), xp.maximum(abs(f[2]), abs(f[3])))


def _difference_of_products(a: Any, b: Any, c: Any, d: Any, zero: Any) -> Any:
    """Returns ab - cd, to a rounding or two, however much cancels (Dekker 1971)."""
    first, first_rest = _product(a, b, zero)
    second, second_rest = _product(c, d, zero)
    return (first - second) + (first_rest - second_rest)


def _product(a: Any, b: Any, zero: Any) -> tuple[Any, Any]:
    """Returns a product and its rounding error."""
    p = a * b + zero
    high_a, high_b = (_high(v, zero) for v in (a, b))
    low_a, low_b = a - high_a, b - high_b
    error = (((high_a * high_b + zero) - p) + (high_a * low_b + zero)) + (low_a * high_b + zero)
    return p, error + (low_a * low_b + zero)


def _high(a: Any, zero: Any) -> Any:
    split = SPLITTER * a + zero
    return split - (split - a)
