"""Integrals of rational functions with one pole, for NumPy: `Rational` of `teg.program`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from teg.backends.numpy.bends import Substitution, substitution
from teg.backends.numpy.runtime import Array, Integral, Run, Value, cut, parts, rounding
from teg.backends.shared.poles import pole_weights
from teg.numerics.quadrature import gauss_legendre, null_rules
from teg.program import EDGE, POLE, RESIDUE


@dataclass(slots=True)
class Poles(Substitution):
    """Straight pieces, the values `low` and `high` of D at their ends, whether the pole counts there, whether it is `clear` of the piece,
    and how well D is known."""

    low: Array
    high: Array
    counts: Array
    clear: Array
    loss: Array


@dataclass(frozen=True, slots=True)
class RationalIntegral(Integral):
    """Gauss-Legendre with weights that know the pole, on each piece."""

    nodes: int = 1
    power: int = 1

    def _places(self, p: Array, q: Array, base: Value, bends: Sequence[Any], scale: Value) -> Poles:
        ((_, c0, c1, _, when),) = bends
        first, last = p - base, q - base
        low, high = c0 + c1 * first, c0 + c1 * last
        counts = np.broadcast_to(when & np.isfinite(c0) & np.isfinite(c1), p.shape)
        least = np.minimum(np.abs(low), np.abs(high))
        clear = counts & (low * high > 0.0) & (least > POLE * np.maximum(np.abs(p), np.abs(q)) * np.abs(c1))
        size = np.abs(c0) + np.abs(c1) * np.maximum(np.abs(first), np.abs(last))
        loss = np.where(clear, self.power * EDGE * size / least, 0.0)
        s = substitution(p, q, base, (), False, scale)
        return Poles(s.p, s.q, s.kind, s.centre, s.radius, s.start, s.step, low, high, counts, clear, loss)

    def _rule(self, run: Run, places: Substitution, values: Sequence[Value]) -> Array:
        assert isinstance(places, Poles)
        nodes, plain = (np.array(column) for column in gauss_legendre(self.nodes))
        highest = np.array(null_rules(self.nodes)[0])
        p, q = places.p, places.q
        middle, half = 0.5 * (p + q), 0.5 * (q - p)
        w = np.where(places.clear, pole_weights(np, self.nodes, self.power, places.low, places.high), plain[:, None])
        met = places.counts & ~places.clear
        sums = np.empty((self.results, p.size))
        self._count(run, p.size * self.nodes)
        for part in parts(p.size, run.chunk(self.node_width, self.nodes)):
            x = middle[part] + half[part] * nodes[:, None]
            found = [np.broadcast_to(v, x.shape) for v in self.body(run, x, *(cut(v, part) for v in values))]
            for total, value in zip(sums, found, strict=False):
                total[part] = (w[:, part] * value).sum(axis=0)
                if met[part].any():
                    endless = met[part] & (np.abs(highest @ value) > RESIDUE * (plain @ np.abs(value)))
                    run.missed |= bool(endless.any())
                    total[part] = np.where(endless, np.copysign(np.inf, total[part]), total[part])
            if self.estimated:
                for total, value in zip(sums[self.values :], found, strict=False):
                    total[part] = (rounding(p[part], q[part]) + places.loss[part]) * np.abs(w[:, part] * value).sum(axis=0)
        sums *= half
        return sums
