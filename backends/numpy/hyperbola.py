"""Moments of hyperbolas over lanes, which the printed NumPy programs call as `hyperbolas`.

    v1, v2 = hyperbola_0(run, (v0, p1, p2, p3, v4), (v5, 1.0), (v6,))   corners and turn; coefficients; values for scales

Lanes on which g has one sign at all corners are done with; the moments of the others are computed side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.lanes import Block, Run, Value, gather, on_lanes
from teg.backends.shared.moments import Kind, has_near_side, settled, totals

Array = npt.NDArray[Any]
WIDTH = 96
"""Doubles that a lane takes, beside its arguments."""


@dataclass(frozen=True, slots=True)
class HyperbolaMoments:
    """A `Hyperbola`: the block that gives the scales of the corners, the numbers of the ties of the sides, and what each result is."""

    scales: Block
    ties: tuple[int, ...]
    kinds: tuple[Kind, ...]

    def __call__(
        self,
        run: Run,
        corners: tuple[Value, ...],
        coefficients: tuple[Value, ...],
        for_scales: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape; `corners`: the values there, then where the hyperbola turns."""
        border = 5 + len(coefficients)

        def work(given: Sequence[Array], lanes: int) -> Array:
            at, rest = ([np.broadcast_to(v, (lanes,)) for v in part] for part in (given[:5], given[5:border]))
            return self._lanes(run, at, rest, given[border:])

        step = run.chunk(WIDTH + border + len(for_scales))
        return on_lanes(work, (*corners, *coefficients, *for_scales), when, len(self.kinds), 0.0, step)

    def _lanes(self, run: Run, corners: Sequence[Array], coefficients: Sequence[Array], for_scales: Sequence[Array]) -> Array:
        *f, turn = [np.asarray(v, dtype=np.float64) for v in corners]
        also: Sequence[Any] = [False] * 4
        if self.ties and np.any(near := has_near_side(f, np)):
            scales = self.scales(run, *for_scales)
            f, on, sides = settled(np, f, scales, near)
            run.met.update(k for k, ties in zip(self.ties, sides, strict=True) if np.any(ties))
            also = on if run.order > 0 else also
            turn = np.where(on[0] | on[1] | on[2] | on[3], np.nan, turn)
        above = [(v > 0.0) | b for v, b in zip(f, also, strict=True)]
        plain = (above[0] == above[1]) & (above[1] == above[2]) & (above[2] == above[3]) & np.isfinite(sum(abs(v) for v in f))
        found = np.empty((len(self.kinds), plain.size))
        done, crossed = np.flatnonzero(plain), np.flatnonzero(~plain)
        found[:, done] = self._whole(above[0][done], [v[done] for v in coefficients])
        if crossed.size:
            some = ([gather(v, crossed) for v in part] for part in ([*f, turn], above, coefficients))
            cut, higher, rest = some
            found[:, crossed] = totals(np, cut, higher, self.kinds, self._by_result(rest))
        return found

    def _whole(self, above: Array, coefficients: Sequence[Array]) -> Array:
        """Returns the results where the region is all of the square, or nothing."""
        rows = []
        for (kind, powers), given in zip(self.kinds, self._by_result(coefficients), strict=True):
            total = sum(c / ((j + 1) * (k + 1)) for (j, k), c in zip(powers, given, strict=True)) if kind != "border" else 0.0
            rows.append(np.where(above if kind == "above" else ~above, total, 0.0))
        return np.array(rows).reshape(len(self.kinds), above.size)

    def _by_result(self, coefficients: Sequence[Array]) -> list[Sequence[Array]]:
        parts, first = [], 0
        for _, powers in self.kinds:
            parts.append(coefficients[first : first + len(powers)])
            first += len(powers)
        return parts
