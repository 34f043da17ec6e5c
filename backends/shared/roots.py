"""Tests and steps of searches for roots and common zeros, for NumPy and JAX: `Isolate` and `Locate` of `teg.program`."""

from __future__ import annotations

from typing import Any, NamedTuple

from teg.program import LOCATE_HALVINGS


class Examined(NamedTuple):
    """The result of examining boxes: where the function is monotone, where it has at most one turning point, and where it is undecided.
    These are false where there is no root. `blurred` says where noise is as large as the terms of its Taylor polynomial, or, where the
    signs at the ends are the same, as the first one and its remainder."""

    monotone: Any
    bent: Any
    left: Any
    blurred: Any


class Ends(NamedTuple):
    """What is known of g at the ends of boxes: whether it `changes` its sign from one to the other, whether it is a number at both, and
    whether it has a slope at both."""

    changes: Any
    known: Any
    sloped: Any


def examined(xp: Any, bounds: Any, middle: tuple[Any, Any], h: Any, ends: Ends) -> Examined:
    """Returns the result of examining boxes of half-width h. `bounds` are those of g, its slope and its curvature, and the noise, (7, …);
    g and its slope in the `middle`."""
    (g, slope), (changes, known, sloped) = middle, ends
    least, most, slowest, fastest, bent_down, bent_up, noise = bounds
    bounded = xp.isfinite(slowest) & xp.isfinite(fastest)
    reach = xp.where(bounded, h * xp.maximum(xp.abs(slowest), xp.abs(fastest)), xp.inf)
    away = (least > 0.0) | (most < 0.0) | (xp.abs(g) - reach > xp.where(xp.isfinite(noise), noise, 0.0))
    away = away | (xp.isnan(least) & xp.isnan(most) & xp.isnan(g))
    level = ((slowest == 0.0) & (fastest == 0.0)) | ((least == 0.0) & (most == 0.0))
    open_ = (changes | ~away) & ~level
    below, above, down, up = least == -xp.inf, most == xp.inf, slowest == -xp.inf, fastest == xp.inf
    monotone = open_ & ((slowest > 0.0) | (fastest < 0.0)) & known & ~(below & above & (down | up))
    bent = open_ & ~monotone & ((bent_down > 0.0) | (bent_up < 0.0)) & known & sloped & ~((below | above) & down & up)
    bend = xp.maximum(xp.abs(bent_down), xp.abs(bent_up))
    blurred = (xp.abs(g) + h * xp.abs(slope) + 0.5 * h * h * bend <= noise) | (~changes & (xp.abs(g) + reach <= noise))
    return Examined(monotone, bent, open_ & ~monotone & ~bent, blurred & xp.isfinite(noise))


def touches(xp: Any, g: Any, curvature: Any, noise: Any) -> tuple[Any, Any]:
    """Returns whether g is 0 to rounding at a turning point, and how far the zero may be off."""
    return (xp.abs(g) <= noise) & xp.isfinite(noise), xp.sqrt(2.0 * noise / xp.abs(curvature))


class Step(NamedTuple):
    """A point v in (p, q), how far it moved, and whether it is a zero to rounding."""

    v: Any
    p: Any
    q: Any
    size: Any
    done: Any


def newton_step(xp: Any, values: tuple[Any, Any], v: Any, ends: tuple[Any, Any], above: Any, before: Any) -> Step:
    """Returns a step of Newton's method at v between the ends p and q, where g and its slope have these `values`; or to the middle if that
    leads outside, or is not half as long as the last but one, `before`; g > 0 at q if `above`."""
    (g, slope), (p, q) = values, ends
    at_right = (g > 0.0) == above
    p, q = xp.where(at_right, p, v), xp.where(at_right, v, q)
    step, middle = -g / slope, 0.5 * (p + q)
    newton = (v + step >= p) & (v + step <= q) & (step != 0.0) & ~(xp.abs(step) > 0.5 * before)
    size = xp.abs(xp.where(newton, step, middle - v))
    v = xp.where(g == 0.0, v, xp.where(newton, v + step, middle))
    return Step(v, p, q, size, (g == 0.0) | (size <= 2.0**-52 * xp.abs(v)))


def excluded(xp: Any, bounds: Any) -> Any:
    """Returns for each rectangle whether the bounds f-, f+, g-, g+ exclude a common zero."""
    f_least, f_most, g_least, g_most = bounds
    away = (f_least > 0.0) | (f_most < 0.0) | (g_least > 0.0) | (g_most < 0.0)
    return away | (xp.isnan(f_least) & xp.isnan(f_most)) | (xp.isnan(g_least) & xp.isnan(g_most))


def refuted(xp: Any, bounds: Any, at: Any, reach: Any) -> tuple[Any, Any]:
    """Returns for each rectangle whether the mean value theorem excludes a common zero, and whether Krawczyk's test proves that there is
    exactly one. `bounds` are those over rectangles with half the sides `reach`, `at` the values and slopes in their middles, components
    first."""
    (f, g), (h, k) = at[:2], reach
    least, most = bounds[4::2], bounds[5::2]
    middle, radius, sizes = 0.5 * (least + most), 0.5 * (most - least), xp.maximum(xp.abs(least), xp.abs(most))
    away = (xp.abs(f) > sizes[0] * h + sizes[1] * k) | (xp.abs(g) > sizes[2] * h + sizes[3] * k)
    (a, b, c, d), (ra, rb, rc, rd) = middle, radius
    det = xp.abs(a * d - b * c)
    a, b, c, d = a / det, b / det, c / det, d / det
    v, u = xp.abs(d * f - b * g), xp.abs(a * g - c * f)
    a, b, c, d = xp.abs(a), xp.abs(b), xp.abs(c), xp.abs(d)
    wide = (d * ra + b * rc) * h + (d * rb + b * rd) * k
    high = (c * ra + a * rc) * h + (c * rb + a * rd) * k
    away = away | (v > h + wide) | (u > k + high)
    return away, (wide <= 0.25 * h) & (high <= 0.25 * k) & (v + wide < h) & (u + high < k) & ~away


def plane_step(xp: Any, values: Any) -> Any:
    """Returns a step of Newton's method in the plane; `values` are f, g and their slopes, components first."""
    f, g, f_v, f_u, g_v, g_u = values
    det = f_v * g_u - f_u * g_v
    return xp.stack([(g_u * f - f_u * g) / det, (f_v * g - g_v * f) / det])


class Halving(NamedTuple):
    """How often rectangles were halved in v and in u, (2, …); which of them was the `last` one, -1 for none; whether it was useless, or
    useful, to halve in v and in u when that was last done, (2, …)."""

    times: Any
    last: Any
    useless: Any
    useful: Any


def next_halving(xp: Any, at: Halving, before: Any, left: Any) -> Halving:
    """Returns the next direction, if `left` rectangles are left of `before`. The directions v and u take turns, but one is repeated if
    halving in it is of use and halving in the other is not. The times stay as they are."""
    judged = xp.stack([at.last == 0, at.last == 1])
    useless = xp.where(judged, 50 * left >= 49 * before, at.useless)
    useful = xp.where(judged, 20 * left <= 11 * before, at.useful)
    across = at.times[0] <= at.times[1]
    across = xp.where(useless[1] & useful[0], True, xp.where(useless[0] & useful[1], False, across))
    across = (across & (at.times[0] < LOCATE_HALVINGS)) | (at.times[1] == LOCATE_HALVINGS)
    return Halving(at.times, xp.where(across, 0, 1), useless, useful)
