"""Integrals of rational functions with one pole, for NumPy: `Rational` of `teg.program`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from teg.backends.numpy.integrals import Integral
from teg.backends.numpy.lanes import Array, cut, parts
from teg.backends.numpy.pieces import Pieces
from teg.backends.shared.bends import Bends, Substitution, Tail
from teg.backends.shared.poles import pole_at, pole_weights
from teg.backends.shared.rules import rounding
from teg.numerics.quadrature import gauss_legendre, null_rules
from teg.program import RESIDUE


@dataclass(frozen=True, slots=True)
class RationalIntegral(Integral):
    """Gauss-Legendre with weights that know the pole, on each piece."""

    nodes: int = 1
    power: int = 1

    def _places(self, p: Array, q: Array, bends: Bends, tail: Tail) -> Substitution:
        return Integral._places(self, p, q, Bends(bends.base), tail)

    def _rule(self, pieces: Pieces, bends: Bends) -> Array:
        run, places, values = pieces.run, pieces.places, pieces.values
        base, ((_, c0, c1, _, when),) = bends
        nodes, plain = (np.array(column) for column in gauss_legendre(self.nodes))
        highest = np.array(null_rules(self.nodes)[0])
        p, q = places.p, places.q
        middle, half = 0.5 * (p + q), 0.5 * (q - p)
        pole = pole_at(np, self.power, (p, q), base, (c0, c1), when)
        w = np.where(pole.clear, pole_weights(np, self.nodes, self.power, pole.low, pole.high), plain[:, None])
        sums = np.empty((self.results, p.size))
        self._count(run, p.size * self.nodes)
        for part in parts(p.size, run.chunk(self.node_width, self.nodes)):
            x = middle[part] + half[part] * nodes[:, None]
            found = [np.broadcast_to(v, x.shape) for v in self.body(run, x, *(cut(v, part) for v in values))]
            for total, value in zip(sums, found, strict=False):
                total[part] = (w[:, part] * value).sum(axis=0)
                if pole.met[part].any():
                    endless = pole.met[part] & (np.abs(highest @ value) > RESIDUE * (plain @ np.abs(value)))
                    run.missed |= bool(endless.any())
                    total[part] = np.where(endless, np.copysign(np.inf, total[part]), total[part])
            if self.estimated:
                for total, value in zip(sums[self.values :], found, strict=False):
                    total[part] = (rounding(np, p[part], q[part]) + pole.loss[part]) * np.abs(w[:, part] * value).sum(axis=0)
        sums *= half
        return sums
