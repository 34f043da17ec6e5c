"""Points of `teg.numerics.sobol`, for NumPy and JAX: coordinates in (0, 1) by 64-bit arithmetic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from teg.numerics.sobol import BITS, GAMMA, LOW_BITS, MIX, SCRAMBLE, key, replicated, reversed_directions
from teg.program import SAME_MEANS


@dataclass(frozen=True, slots=True)
class Points:
    """The points of a rule that samples: its kind, its seed, and how many there are."""

    kind: str
    seed: int
    count: int


def coordinate(xp: Any, points: Points, dimension: int, replicate: Any, index: Any) -> Any:
    """Returns a coordinate of points of a rule; their numbers `index` in their replicates are 64-bit, without a sign."""
    replicates, each = replicated(points.kind, points.count)
    keys = xp.asarray([key(points.seed, r, dimension) for r in range(replicates)], dtype=xp.uint64)[replicate]
    if points.kind == "montecarlo":
        return _unit(xp, mix(xp, keys + index * xp.uint64(GAMMA)) >> xp.uint64(12))
    gray = (index ^ index >> xp.uint64(1)).astype(xp.uint32)
    x = xp.zeros(index.shape, xp.uint32)
    columns = reversed_directions(dimension)
    for j in range(min(BITS, (each - 1).bit_length())):
        x = x ^ (gray >> xp.uint32(j) & xp.uint32(1)) * xp.uint32(columns[j])
    y = _reverse(xp, _scramble(xp, x, keys)).astype(xp.uint64)
    low = mix(xp, keys + y * xp.uint64(GAMMA)) >> xp.uint64(64 - LOW_BITS)
    return _unit(xp, y << xp.uint64(LOW_BITS) | low)


def standard_error(xp: Any, each: int, means: Any, first: Any, squares: Any) -> Any:
    """Returns the standard errors of means over replicates of so many points, from the means, the first values and the sums of squares
    relative to these; the first axis is that of replicates."""
    replicates = means.shape[0]
    mean = means.mean(axis=0)
    scatter = xp.square(means - mean).sum(axis=0)
    total = each * scatter + xp.maximum(squares - each * xp.square(means - first), 0.0).sum(axis=0)
    if replicates == 1:
        return xp.sqrt(total / (each - 1.0) / each)
    variance = total / (replicates * each)
    hidden = scatter <= SAME_MEANS**2 * (xp.square(mean) + variance)
    return xp.sqrt(xp.maximum(scatter / (replicates * (replicates - 1.0)), xp.where(hidden, variance / each**2, 0.0)))


def mix(xp: Any, z: Any) -> Any:
    """64 bits well mixed, of each."""
    for shift, factor in MIX:
        z = (z ^ z >> xp.uint64(shift)) * xp.uint64(factor)
    return z


def _unit(xp: Any, cell: Any) -> Any:
    """Returns the centre of a cell of width 2⁻⁵²."""
    return (xp.uint64(2) * cell + xp.uint64(1)).astype(xp.float64) * 2.0**-53


def _scramble(xp: Any, x: Any, keys: Any) -> Any:
    """Returns a nested uniform scramble of reversed bits."""
    before, *after = SCRAMBLE
    x = x ^ x * xp.uint32(before)
    x = (x + keys.astype(xp.uint32)) * ((keys >> xp.uint64(32)).astype(xp.uint32) | xp.uint32(1))
    for factor in after:
        x = x ^ x * xp.uint32(factor)
    return x


def _reverse(xp: Any, x: Any) -> Any:
    """32 bits in reverse: halves, then quarters of them, and so on, change places."""
    for shift, mask in ((16, 0x0000FFFF), (8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        x = (x >> xp.uint32(shift) & xp.uint32(mask)) | (x & xp.uint32(mask)) << xp.uint32(shift)
    return x
