"""Half-planes over boxes and half-lines over segments, for NumPy and JAX: `Polygon` and `Segment` of `teg.program`.

`zero` keeps a product and a sum apart (see `teg.backends.text`), and is 0.0 in NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def least_and_most(xp: Any, line: Sequence[Any], box: Sequence[Any], zero: Any = 0.0) -> tuple[Any, Any]:
    """Returns the bounds of a·x + b·y + c, the `line` (a, b, c), on a `box` from (0, 0) to (width, height)."""
    (a, b, c), (width, height) = line, box
    u, v = a * width + zero, b * height + zero
    least = c + xp.where(u >= 0.0, 0.0, u) + xp.where(v >= 0.0, 0.0, v)
    return least, c + xp.where(u <= 0.0, 0.0, u) + xp.where(v <= 0.0, 0.0, v)


def fails(xp: Any, least: Any, most: Any, closed: bool) -> Any:
    """Returns whether a half-plane, `closed` or open, has nothing of the box."""
    return (most <= 0.0) & xp.logical_not((least >= 0.0) & closed)


def misses(xp: Any, first: Any, last: Any, closed: bool) -> Any:
    """Returns whether a half-line, on which a linear function goes from first to last, has nothing of the segment."""
    return (first <= 0.0) & (last <= 0.0) & xp.logical_not((first == 0.0) & (last == 0.0) & closed)


def cut(xp: Any, start: Any, stop: Any, first: Any, last: Any, ties: Any) -> tuple[Any, Any]:
    """Returns the part (start, stop) of a segment that a half-line leaves, if it does not tie."""
    difference = first - last
    cuts = xp.logical_not(ties) & xp.isfinite(difference)
    root = first / xp.where(difference == 0.0, 1.0, difference)
    begins, ends = cuts & (first < 0.0) & (last > 0.0), cuts & (first > 0.0) & (last < 0.0)
    return xp.where(begins, xp.maximum(start, root), start), xp.where(ends, xp.minimum(stop, root), stop)
