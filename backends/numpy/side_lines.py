"""The squares whose tables are added up where lines of candidates lie on sides (`teg.numerics.side_lines`), for many squares at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.numerics.cells import EPSILON, Layout, Row
from teg.numerics.side_lines import ENDS, displaced

Array = npt.NDArray[Any]
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


class Squares(NamedTuple):
    """The squares that are moved one way: of which lane each is, its weight, and the candidates of those in which lines are displaced."""

    lanes: list[int]
    weights: list[float]
    candidates: dict[int, Sequence[Row]]


def both_ways(lanes: Array) -> dict[float, Squares]:
    """Returns lanes as they are, moved both ways."""
    return {sign: Squares(lanes.tolist(), [0.5] * len(lanes), {}) for sign in (1.0, -1.0)}


def squares_beside(shape: Layout, rows: Array, counts: Array, lanes: Array) -> dict[float, Squares]:
    """Returns the squares of some lanes by the way in which they are moved, 1 and -1; `rows` are the candidates of all lanes, `counts` of
    each."""
    found = {sign: Squares([], [], {}) for sign in (1.0, -1.0)}
    several, starts = _with_several(shape, rows, counts), np.cumsum(counts) - counts
    for lane in lanes.tolist():
        own = rows[starts[lane] : starts[lane] + counts[lane]].tolist() if several[lane] else []
        for weight, sign, candidates in displaced(shape, own):
            if candidates is not own:
                found[sign].candidates[len(found[sign].lanes)] = candidates
            found[sign].lanes.append(lane)
            found[sign].weights.append(weight)
    return found


def _with_several(shape: Layout, rows: Array, counts: Array) -> Array:
    """Returns in which lanes several regions have lines on one side."""
    forms = rows[:, : shape.forms - 3].reshape(len(rows) * shape.parts, shape.guards, 3)
    size = np.hypot(forms[..., 1], forms[..., 2])
    with np.errstate(all="ignore"):
        at = np.abs(forms[..., :1] + forms[..., 1:] @ CORNERS.T) <= (EPSILON * size)[..., None]
    lane = np.repeat(np.arange(len(counts)), counts * shape.parts)
    sides = [np.bincount(lane, (at[..., i] & at[..., j] & (size > 0.0)).any(axis=1), len(counts)) for i, j in ENDS]
    return np.asarray(np.max(sides, axis=0) > 1.0)
