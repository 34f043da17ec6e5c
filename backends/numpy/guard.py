"""The guard of an adaptive integral, for NumPy: whether a sharp value is large where no node saw it (`Integrate` of `teg.program`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.arrays import places_of
from teg.backends.numpy.lanes import Run
from teg.backends.numpy.pieces import Pieces
from teg.backends.shared.bends import Substitution
from teg.backends.shared.rules import is_unseen
from teg.program import DEEP, GUARD_DEPTH

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class Guard:
    """The printed `block`: from (run, left, right, *values from outside) to bounds of sizes, then to the upper and the lower bounds of
    `sharp` values, and those of what is below the upper ones."""

    block: Callable[..., tuple[Any, ...]]
    sharp: int

    def hides(
        self,
        pieces: Pieces,
        ends: tuple[Array, Array],
        at: Array,
        seen: Array,
        enough: Array,
        depth: int,
    ) -> Array:
        """Returns whether something is hidden in each interval (u₀, u₁) = `ends` of a piece of its own: `at` are the nodes in u, (nodes,
        intervals), `seen` the sharp values there, (sharp, nodes, intervals), `enough` the errors that do not matter, (tested,
        intervals)."""
        left, right = (self._place(pieces.places, u) for u in ends)
        unseen = self._unseen(pieces.run, pieces.values, (left, right), np.fmin.reduce(seen, axis=1), enough)[0]
        asked = np.flatnonzero(unseen)
        hidden = np.zeros(left.size, dtype=np.bool_)
        if not asked.size:
            return hidden
        pieces, seen, enough = pieces.part(asked), seen[:, :, asked], enough[:, asked]
        inside = places_of(pieces.places, at[:, asked])[0]
        points = np.concatenate([left[asked][None], inside, right[asked][None]])
        padded = np.concatenate([seen[:, :1], seen, seen[:, -1:]], axis=1)
        largest = np.fmax(padded[:, :-1], padded[:, 1:])
        gaps = points.shape[0] - 1
        boxes = points[:-1].reshape(-1), points[1:].reshape(-1)
        flat = [np.tile(v, gaps) if np.ndim(v) else v for v in pieces.values]
        wanted = np.tile(enough, (1, gaps))
        last = np.zeros((gaps, asked.size), dtype=np.bool_)
        if depth >= DEEP:
            last[0], last[-1] = ends[0][asked] <= 0.0, ends[1][asked] >= 1.0
        found, endless = self._unseen(pieces.run, flat, boxes, largest.reshape(self.sharp, -1), wanted, last.reshape(-1))
        found, endless = found.reshape(gaps, -1), endless.reshape(gaps, -1)
        shallow = depth < GUARD_DEPTH
        endless[1:-1] &= shallow
        endless[0] &= (shallow & (ends[0][asked] > 0.0)) | np.isinf(points[0])
        endless[-1] &= (shallow & (ends[1][asked] < 1.0)) | np.isinf(points[-1])
        hidden[asked] = (found | endless).any(axis=0)
        return hidden

    def hidden(self, pieces: Pieces, ends: tuple[Array, Array], tested: int) -> Array:
        """Returns bounds of the integrals of |tested value| over intervals, (tested, intervals), infinite where they are not known; 0 where
        a value has no finite bound on a finite interval, as beside integrable singularities."""
        left, right = (self._place(pieces.places, u) for u in ends)
        sizes = self.block(pieces.run, left, right, *pieces.values)[:tested]
        length = right - left
        bounds = np.stack(
            [np.broadcast_to(np.where(np.isinf(size) & np.isfinite(length), 0.0, size * length), left.shape) for size in sizes]
        )
        return np.where(np.isnan(bounds), np.inf, bounds)

    def _place(self, places: Substitution, u: Array) -> Array:
        """Returns the place of u; the ends of a piece are its own."""
        inside = places_of(places, u[None])[0][0]
        at: Array = np.where(u <= 0.0, places.p, np.where(u >= 1.0, places.q, inside))
        return at

    def _unseen(
        self, run: Run, values: Sequence[Any], boxes: tuple[Array, Array], seen: Array, enough: Array, last: Array | None = None
    ) -> tuple[Array, Array]:
        """Returns whether each box, from left to right, matters and a sharp value is unseen there, (boxes,): of gaps those with finite
        upper bounds, then those with infinite ones, of other boxes all. `last` says which gaps lie at an end of a piece after DEEP
        bisections; None for other boxes."""
        left, right = boxes
        found = self.block(run, left, right, *values)
        length = right - left
        finite = np.isfinite(length)
        small = np.ones(left.size, dtype=np.bool_)
        for size, wanted in zip(found, enough, strict=False):
            small &= np.where(finite, size * length <= wanted, size == 0.0)
        matters = ~small
        unseen, endless = (np.zeros(left.size, dtype=np.bool_) for _ in range(2))
        first, least = len(enough), np.min(enough, axis=0)
        for i in range(self.sharp):
            upper, lower = found[first + i], found[first + self.sharp + i]
            large = is_unseen(np, upper, lower, seen[i], np.False_ if last is None else ~finite | last)
            large &= ~(found[first + 2 * self.sharp + i] * length <= least)
            infinite = np.False_ if last is None else np.isposinf(upper)
            unseen |= large & ~infinite
            endless |= large & infinite
        return unseen & matters, endless & matters
