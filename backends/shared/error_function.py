"""erf and erfc in double precision, for NumPy and JAX, by the expansions of `teg.numerics.error_function`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from teg.backends.shared.arrays import Arrays, Values
from teg.numerics.error_function import CENTRE, FAR, FAREST, NEAR, REACH, TURN

_STEPS = 2.0**20
"""A number below 28 rounded down to a multiple of 1/_STEPS has an exact square."""


def erf(arrays: Arrays, x: Any) -> Any:
    """Returns the error function of each element."""
    xp = arrays.xp
    x, size, shape = _flat(xp, x)
    near = size <= 1.0
    (values,) = arrays.choose(near, lambda u: (_near(u),), (x,), (x,))
    (values,) = arrays.choose(~near, lambda u, v: (xp.copysign(1.0 - _far(xp, v), u),), (x, size), (values,))
    return xp.reshape(values, shape)[()]


def erfc(arrays: Arrays, x: Any) -> Any:
    """Returns 1 - erf of each element, also where erf is 1 to rounding."""
    xp = arrays.xp
    x, size, shape = _flat(xp, x)
    near = (x < 0.5) & (x > -1.0)
    (values,) = arrays.choose(near, lambda u: (1.0 - _near(u),), (x,), (x,))
    (values,) = arrays.choose(~near, lambda u, v: _either_side(xp, u, v), (x, size), (values,))
    return xp.reshape(values, shape)[()]


def _flat(xp: Any, x: Any) -> tuple[Any, Any, tuple[int, ...]]:
    """Returns the elements in a row, their sizes up to FAREST, and the shape that they had."""
    x = xp.asarray(x, dtype=xp.float64)
    row = xp.reshape(x, (-1,))
    return row, xp.minimum(xp.abs(row), FAREST), x.shape


def _either_side(xp: Any, x: Any, size: Any) -> Values:
    tail = _far(xp, size)
    return (xp.where(x < 0.0, 2.0 - tail, tail),)


def _near(x: Any) -> Any:
    """Returns erf(x), |x| <= 1."""
    return x * _polynomial(NEAR, x * x)


def _far(xp: Any, x: Any) -> Any:
    """Returns erfc(x), 1/2 <= x <= FAREST. The exponential is taken in two parts: x² is not rounded."""
    u = ((x - TURN) / (x + TURN) - CENTRE) / REACH
    head = xp.floor(x * _STEPS) / _STEPS
    value = xp.exp(-(head * head)) * (_polynomial(FAR, u) / (1.0 + 2.0 * x))
    return value + value * xp.expm1((head - x) * (head + x))  # not a product of two exponentials, which XLA makes one


def _polynomial(coefficients: Sequence[float], x: Any) -> Any:
    value = coefficients[-1]
    for c in coefficients[-2::-1]:
        value = value * x + c
    return value
