"""NumPy, as the formulas that it shares with JAX see it."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from teg.backends.shared.arrays import Arrays, Values
from teg.backends.shared.bends import Substitution, place


def _choose(mask: Any, compute: Callable[..., Values], operands: Values, otherwise: Values) -> Values:
    index = np.flatnonzero(mask)
    if not index.size:
        return otherwise
    if index.size == np.size(mask):
        return compute(*operands)
    results = tuple(old.copy() for old in otherwise)
    for result, new in zip(results, compute(*(v[..., index] if np.ndim(v) else v for v in operands)), strict=True):
        result[..., index] = new
    return results


def _rows(values: Values, like: Any) -> Any:
    return np.stack([np.broadcast_to(v, np.shape(like)) for v in values])


def _any_of(condition: Callable[[Any], Any], values: Any) -> Any:
    return reduce(np.logical_or, map(condition, values))


NUMPY = Arrays(np, _choose, _rows, _any_of)


def places_of(s: Substitution, u: Any) -> tuple[Any, Any]:
    """Returns the places and dv/du of u, (nodes, pieces)."""
    return place(NUMPY, s, np.unique(s.kind), u)
