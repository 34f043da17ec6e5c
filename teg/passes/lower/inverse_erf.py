"""The inverses of erf and erfc, written out in functions that every backend has.

    w₀     Winitzki's approximation, within 2e-3 of the value (relative)
    w ← w - s/(1 + w·s),  s = (erf(w) - c)/erf′(w)              Halley's method, where |c| < 1/2
    w ← w + log(erfc(w)/p)·erfc(w)/erf′(w)                      Newton's method for log(erfc(w)) = log p, p = 1 - |c| <= 1/2

Two steps of third order, or three of second order, leave rounding only, for every double.
Source of w₀: S. Winitzki, A handy approximation for the error function and its inverse (2008).
"""

from __future__ import annotations

import math

from teg.ir.expr import MINUS_ONE, ONE, Expr, const
from teg.ir.simplify import add, call, div, integer_power, mul, positive, sub, where

_WINITZKI = 0.147


def inverse_of_erf(c: Expr) -> Expr:
    """Returns w with erf(w) = c, for -1 < c < 1."""
    size = call("magnitude", c)
    return _signed(c, size, sub(ONE, size))


def inverse_of_erfc(c: Expr) -> Expr:
    """Returns w with erfc(w) = c, for 0 < c < 2."""
    above = sub(ONE, c)
    return _signed(above, call("magnitude", above), call("min", c, sub(const(2.0), c)))


def _signed(c: Expr, size: Expr, rest: Expr) -> Expr:
    root = where(positive(sub(const(0.5), size)), _near(size), _far(rest))
    return where(positive(c), root, mul(MINUS_ONE, root))


def _winitzki(log: Expr) -> tuple[Expr, Expr]:
    """Returns b = 2/(πa) + L/2 and √(b² - L/a), for L = log(1 - c²)."""
    b = add(const(2.0 / (math.pi * _WINITZKI)), mul(const(0.5), log))
    return b, call("sqrt", sub(integer_power(b, 2), mul(const(1.0 / _WINITZKI), log)))


def _near(c: Expr) -> Expr:
    """Returns w with erf(w) = c for 0 <= c < 1/2."""
    log = call("log1p", mul(MINUS_ONE, integer_power(c, 2)))
    b, root = _winitzki(log)
    w = call("sqrt", div(mul(const(-1.0 / _WINITZKI), log), add(root, b)))
    for _ in range(2):
        step = mul(sub(call("erf", w), c), _inverse_slope(w))
        w = sub(w, div(step, add(ONE, mul(w, step))))
    return w


def _far(p: Expr) -> Expr:
    """Returns w with erfc(w) = p for 0 < p <= 1/2."""
    b, root = _winitzki(call("log", mul(p, sub(const(2.0), p))))
    w = call("sqrt", sub(root, b))
    for _ in range(3):
        tail = call("erfc", w)
        w = add(w, mul(call("log", div(tail, p)), tail, _inverse_slope(w)))
    return w


def _inverse_slope(w: Expr) -> Expr:
    """Returns 1/erf′(w)."""
    return mul(const(0.5 * math.sqrt(math.pi)), call("exp", integer_power(w, 2)))
