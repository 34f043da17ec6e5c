"""Clipped polyhedra over lanes, which the printed NumPy programs call as `polyhedra`.

    v1, v2 = polyhedron_0(run, (width, height, depth, a, b, c, d, …), (v0,), (v0,))     box and half-spaces; values for setup, for body

Where no half-space fails on a lane's box, `setup` runs, the box is clipped, and `body` runs at the nodes of all tetrahedra, shape (nodes,
pieces).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from teg.backends.numpy.lanes import Run, gather
from teg.backends.numpy.polygon import Array, BoxDomain, Nodes, times
from teg.backends.shared import polygons, polyhedra
from teg.numerics.polyhedra import SIDES
from teg.numerics.quadrature import tetrahedron_rule


@dataclass(frozen=True, slots=True)
class PolyhedronIntegral(BoxDomain):
    """A `Polyhedron`."""

    def _room(self) -> int:
        return 24 * polyhedra.faces_of(len(self.closed)) ** 2

    def _lanes(self, run: Run, box: Sequence[Array], for_setup: Sequence[Array], for_body: Sequence[Array], lanes: int) -> Array:
        numbers = np.array([np.broadcast_to(v, (lanes,)) for v in box])
        extents, halves = numbers[:3], numbers[3:].reshape(-1, 4, lanes)
        bounds = [polyhedra.least_and_most(np, cast(polyhedra.Half, tuple(half)), tuple(extents)) for half in halves]
        fails, known = np.zeros(lanes, bool), np.isfinite(extents).all(axis=0)
        for (least, most, _), closed in zip(bounds, self.closed, strict=True):
            fails |= polygons.fails(np, least, most, closed)
            known &= np.isfinite(most - least)
        sums = np.where(fails | known, 0.0, np.nan) * np.ones((self.values, 1))
        active = np.flatnonzero(~fails & known)
        if not active.size:
            return sums
        solid = polyhedra.box(np, extents[:, active], polyhedra.faces_of(len(halves)))
        for k, (half, (least, _, scale)) in enumerate(zip(halves, bounds, strict=True)):
            if (least[active] < 0.0).any():
                a, b, c, d = half[:, active]
                solid = polyhedra.clipped(np, solid, SIDES + k, (a, b, c, d), scale[active])
        after = self.setup(run, *(gather(v, active) for v in for_setup))
        ends = len(after) - self.values
        given = [*(gather(v, active) for v in for_body), *after[:ends]]
        nodes = self._nodes(polyhedra.tetrahedra(np, solid))
        sums[:, active] = times(after[ends:], self._totals(run, nodes, given, active.size))
        return sums

    def _nodes(self, found: polyhedra.Tetrahedra) -> Nodes:
        """Returns the nodes of the rule on the polyhedra of all lanes."""
        if self.degree <= 1:
            at, volume = polyhedra.centroid(np, found)
            return Nodes([x[None] for x in at], np.ones(1), volume, np.arange(volume.size))
        face, other, lane = np.nonzero(found.volumes)
        u, v, w = (np.broadcast_to(side, (3, *found.volumes.shape))[:, face, other, lane] for side in found.sides)
        r, s, t, weights = (np.array(column)[:, None] for column in zip(*tetrahedron_rule(self.degree), strict=True))
        nodes = [o + r * x + s * y + t * z for o, x, y, z in zip(found.middle[:, lane], u, v, w, strict=True)]
        return Nodes(nodes, weights[:, 0], found.volumes[face, other, lane], lane)
