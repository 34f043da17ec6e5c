"""Which pieces have neighbours, by looking at every pair of places."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from teg.backends.numpy.arrays import NUMPY
from teg.backends.shared.rules import ends_of_pieces, is_wide, neighbours
from teg.program import AT_END, NEIGHBOUR, PIECE_EPS


def by_hand(pieces: Sequence[tuple[float, float]], breaks: Sequence[float]) -> list[tuple[bool, bool]]:
    """Returns for pieces whether another break is near their ends; one that differs by rounding is the same."""
    found = []
    for p, q in pieces:
        least, most = max(AT_END * (q - p), PIECE_EPS * q), NEIGHBOUR * (q - p)
        found.append((any(least < p - x < most for x in breaks), any(least < x - q < most for x in breaks)))
    return found


@pytest.mark.parametrize("seed", range(40))
def test_neighbours(seed: int) -> None:
    """Some breaks are doubled, some missing, some outside of the bounds."""
    random = np.random.default_rng(seed)
    lo, hi = (0.0, 1.0) if seed % 2 else (1.0, 0.0)
    breaks = list(random.uniform(-0.2, 1.2, 4))
    breaks += [x + 10.0 ** random.uniform(-7, -1) for x in (*breaks[:3], 0.0, 1.0)]
    breaks += [breaks[4] - 3e-10, breaks[0], breaks[1] * (1 + 2**-52), -1e-4, 1.0 + 1e-5, float("nan")]
    places = np.array(breaks)[:, None]
    points = np.sort(np.array(ends_of_pieces(np, np.array([lo]), np.array([hi]), list(places))), axis=0)
    first, last = neighbours(NUMPY, points, places)
    wide = is_wide(np, points[:-1], points[1:])
    pieces = [(float(p), float(q)) for p, q in zip(points[:-1][wide], points[1:][wide], strict=True)]
    expected = by_hand(pieces, breaks)
    told = [(bool(a), bool(b)) for a, b in zip(first[wide], last[wide], strict=True)]
    assert told == expected
    assert any(map(any, told))


def test_endless_pieces_have_none() -> None:
    points = np.array([[-np.inf], [0.0], [1e-3], [np.inf]])
    with np.errstate(invalid="ignore"):
        first, last = neighbours(NUMPY, points, points[1:3])
    assert not first.any()
    assert not last.any()
