"""Integrals of rational functions with one pole, for NumPy and JAX: `Rational` of `teg.program`."""

from __future__ import annotations

from typing import Any, NamedTuple

from teg.numerics.quadrature import gauss_legendre, pole_table
from teg.program import EDGE, POLE


class Pole(NamedTuple):
    """The values `low` and `high` of D at the ends of pieces; whether the pole is `clear` of a piece, or `met` there; and the part of an
    integral of |values| that is lost because D is known to rounding only."""

    low: Any
    high: Any
    clear: Any
    met: Any
    loss: Any


def pole_at(xp: Any, power: int, ends: tuple[Any, Any], base: Any, line: tuple[Any, Any], when: Any) -> Pole:
    """Returns the pole of D = c0 + c1·(v - base), the `line` (c0, c1), to a power, and pieces between `ends` where it counts `when`."""
    (p, q), (c0, c1) = ends, line
    first, last = p - base, q - base
    low, high = c0 + c1 * first, c0 + c1 * last
    counts = when & xp.isfinite(c0) & xp.isfinite(c1)
    least = xp.minimum(xp.abs(low), xp.abs(high))
    clear = counts & (low * high > 0.0) & (least > POLE * xp.maximum(xp.abs(p), xp.abs(q)) * xp.abs(c1))
    size = xp.abs(c0) + xp.abs(c1) * xp.maximum(xp.abs(first), xp.abs(last))
    return Pole(low, high, clear, counts & ~clear, xp.where(clear, power * EDGE * size / least, 0.0))


def pole_weights(xp: Any, nodes: int, power: int, low: Any, high: Any) -> Any:
    """Returns the weights for polynomials over a power of a function that goes from low to high, (nodes, …) for low and high of shape (…).

    Moments of 1/(1 + zu)^m: downwards from a series for small z, upwards from a logarithm else.
    """
    table, at = pole_table(nodes, power), gauss_legendre(nodes)[0]
    z = (high - low) / (high + low)
    square, near = z * z, xp.abs(z) < table.border
    moments: list[Any] = [2.0 / (j + 1) if j % 2 == 0 else 0.0 for j in range(nodes)]
    for level in range(1, power + 1):
        top = xp.zeros_like(z)
        for c in reversed(table.series[level - 1]):
            top = top * square + c
        down: list[Any] = [-z * top if nodes % 2 == 0 else top]
        for before in reversed(moments[:-1]):
            down.insert(0, before - z * down[0])
        k = level - 1
        first = xp.log(high / low) if k == 0 else ((0.5 * (high + low) / low) ** k - (0.5 * (high + low) / high) ** k) / k
        up: list[Any] = [first / z]
        for before in moments[:-1]:
            up.append((before - up[-1]) / z)
        moments = [xp.where(near, d, u) for d, u in zip(down, up, strict=True)]
    rows = [sum(c * m for c, m in zip(row, moments, strict=True)) for row in table.lagrange]
    return xp.stack([row * (1.0 + z * u) ** power for row, u in zip(rows, at, strict=True)])
