"""Families of difficult shapes for the stability report: touching, crossing, cusped, empty, full, and conditions on integrals.

Closed forms, as in `families_of_cases`. Where a body holds an integral it is one of this package, so other integrators do not get these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import teg
from teg.examples.charts.case import SYMMETRIC, UNIT, Case, case
from teg.examples.charts.curves import SQUARE, _segment


def touching() -> Iterator[Case]:
    """A disk whose rightmost point is 2^-k beyond a side, or before it."""
    for k in (4, 10, 16, 22, 28, 34, 40):
        for sign in (1, -1):
            yield case(
                f"a disk that ends 2^-{k} {'beyond' if sign > 0 else 'before'} a side",
                lambda m, x, y, c: m.bracket((x - c) ** 2 + y * y < 0.25),
                SQUARE,
                {"c": 0.5 + sign * 2.0**-k},
                lambda m, c: m.pi / 4 - (_segment(m, m.mpf(1) / 2, 1 - c) if c > 0.5 else 0),
            )


def saddles() -> Iterator[Case]:
    """xy > t near the crossing."""
    for k in (2, 4, 6, 8, 10, 12):
        for sign in (1.0, -1.0):
            yield case(
                f"xy > {'-' if sign < 0 else ''}10^-{k}",
                lambda m, x, y, t: m.bracket(x * y > t),
                SQUARE,
                {"t": sign * 10.0**-k},
                lambda m, t: 2 * (1 - t + t * m.log(t)) if t > 0 else 4 - 2 * (1 + t - t * m.log(-t)),
            )


def cusps() -> Iterator[Case]:
    """Curves with a cusp or a crossing at the origin that do not change their form."""
    for n in (3, 5, 7, 9):
        yield case(
            f"a cusp, y² < t²x^{n}",
            lambda m, x, y, t, n=n: m.bracket(y * y < t * t * x**n),
            (UNIT, SYMMETRIC),
            {"t": 0.75},
            lambda m, t, n=n: 4 * t / (n + 2),
        )
    for t in (0.25, 0.5, 0.75):
        yield case(
            f"a lemniscate of Gerono, t = {t}",
            lambda m, x, y, t: m.bracket(y * y < t * t * x * x * (1 - x * x)),
            SQUARE,
            {"t": t},
            lambda m, t: 4 * t / 3,
        )
        yield case(
            f"two crossed lines, slope {t}",
            lambda m, x, y, t: m.bracket(y * y < t * t * x * x),
            SQUARE,
            {"t": t},
            lambda m, t: 2 * t,
        )
    for a in (0.5, 0.875):
        yield case(
            f"a lemniscate of Bernoulli, a = {a}",
            lambda m, x, y, a: m.bracket((x * x + y * y) ** 2 < a * a * (x * x - y * y)),
            SQUARE,
            {"a": a},
            lambda m, a: a * a,
        )
    for a in (0.25, 0.5):
        yield case(
            f"the loop of Descartes' folium, a = {a}",
            lambda m, x, y, a: m.bracket(x**3 + y**3 < 3 * a * x * y),
            (UNIT, UNIT),
            {"a": a},
            lambda m, a: 3 * a * a / 2,
        )


def empty_and_full() -> Iterator[Case]:
    """Regions that are empty, or the whole domain."""
    shapes: dict[str, tuple[Callable[..., Any], Any, float, float]] = {
        "a disk of negative square": (lambda m, x, y, t: x * x + y * y < t, SQUARE, -0.5, 0.0),
        "a disk around the domain": (lambda m, x, y, t: x * x + y * y < t, SQUARE, 3.0, 4.0),
        "a half-plane beside the domain": (lambda m, x, y, t: x + y < t, (UNIT, UNIT), -1.0, 0.0),
        "a half-plane around the domain": (lambda m, x, y, t: x + y < t, (UNIT, UNIT), 3.0, 1.0),
        "a ring inside out": (lambda m, x, y, t: (x * x + y * y < t) & (x * x + y * y > 0.5), SQUARE, 0.25, 0.0),
        "x < t below the domain": (lambda m, x, t: x < t, (UNIT,), -0.5, 0.0),
        "x < t above the domain": (lambda m, x, t: x < t, (UNIT,), 1.5, 1.0),
        "exp(x) > t, always": (lambda m, x, t: m.exp(x) > t, (UNIT,), 0.5, 1.0),
        "exp(x) > t, never": (lambda m, x, t: m.exp(x) > t, (UNIT,), 5.0, 0.0),
        "sin(9x) > t, never": (lambda m, x, t: m.sin(9 * x) > t, (UNIT,), 2.0, 0.0),
    }
    for name, (inside, bounds, t, value) in shapes.items():
        yield case(
            name,
            lambda m, *values, inside=inside: m.bracket(inside(m, *values)),
            bounds,
            {"t": t},
            lambda m, t, value=value: m.mpf(value) + 0 * t,
        )


def _over(f: Callable[[Any], Any]) -> Any:
    """Returns the integral of f over (0, 1), in a variable of its own."""
    w = teg.var("w")
    return teg.integral(f(w), (w, 0, 1))


def conditions_on_integrals() -> Iterator[Case]:
    """Integrals in conditions inside of another integral."""
    for c in (0.125, 0.25, 0.375):
        yield case(
            f"[∫ [w < tx] dw > {c}]",
            lambda m, x, t, c=c: m.bracket(_over(lambda w: m.bracket(w < t * x)) > c),
            (UNIT,),
            {"t": 0.5},
            lambda m, t, c=c: 1 - c / t,
        )
        yield case(
            f"x·[∫ w·[w < x] dw > t], t = {c}",
            lambda m, x, t: m.where(_over(lambda w: w * m.bracket(w < x)) > t, x, 0.0),
            (UNIT,),
            {"t": c},
            lambda m, t: m.mpf(1) / 2 - t,
        )


def edges_on_bounds() -> Iterator[Case]:
    """Lines through corners and along sides of the domain."""
    for a in (0.25, 0.5, 1.0):
        yield case(
            f"y < t + {a}x through a corner",
            lambda m, x, y, t, a=a: m.bracket(y < t + a * x),
            (UNIT, UNIT),
            {"t": 0.0},
            lambda m, t, a=a: _below(m, t, a),
        )
    for t in (0.0, 1.0):
        yield case(
            f"y < t along the side at {t:g}",
            lambda m, x, y, t: m.bracket(y < t),
            (UNIT, UNIT),
            {"t": t},
            lambda m, t: min(max(t, 0), 1) + 0 * t,
            kinked=True,
        )
    yield case(
        "x + y < t through two corners", lambda m, x, y, t: m.bracket(x + y < t), (UNIT, UNIT), {"t": 1.0}, lambda m, t: _below(m, t, -1)
    )


def _below(m: Any, t: Any, a: Any) -> Any:
    """Returns the area of y < t + a·x in the unit square, of a line through both sides x = 0 and x = 1 or near their corners."""
    at_0, at_1 = t, t + a
    lo, hi = min(at_0, at_1), max(at_0, at_1)

    def primitive(z: Any) -> Any:  # ∫ of z clamped to between 0 and 1
        return 0 * z if z < 0 else z * z / 2 if z < 1 else z - m.mpf(1) / 2

    return (primitive(hi) - primitive(lo)) / (hi - lo)


def products() -> Iterator[Case]:
    """Products, quotients, and powers of brackets in two variables."""
    uses: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
        "[x < t]·[y < t]": (lambda m, a, b: a * b, lambda m, t: t * t),
        "[x < t]·exp([y < t])": (lambda m, a, b: a * m.exp(b), lambda m, t: t * (t * m.e + 1 - t)),
        "(1 + [x < t])/(1 + [y < t])": (lambda m, a, b: (1 + a) / (1 + b), lambda m, t: (1 + t) * (1 - t / 2)),
        "|[x < t] - [y < t]|": (lambda m, a, b: m.abs(a - b), lambda m, t: 2 * t * (1 - t)),
        "max([x < t], [y < t])": (lambda m, a, b: m.maximum(a, b), lambda m, t: 1 - (1 - t) ** 2),
        "([x < t] + [y < t])³": (lambda m, a, b: (a + b) ** 3, lambda m, t: 8 * t * t + 2 * t * (1 - t)),
        "sin([x < t]·[y < t])": (lambda m, a, b: m.sin(a * b), lambda m, t: t * t * m.sin(1)),
        "[[x < t] + [y < t] > 3/2]": (lambda m, a, b: m.bracket(a + b > 1.5), lambda m, t: t * t),
    }
    for name, (use, value) in uses.items():
        yield case(
            name,
            lambda m, x, y, t, use=use: use(m, m.bracket(x < t), m.bracket(y < t)),
            (UNIT, UNIT),
            {"t": 0.375},
            lambda m, t, value=value: value(m, t),
        )


def narrow_and_smooth() -> Iterator[Case]:
    """Features without a jump that are narrow: decays, and steps of a logistic function."""
    for k in range(1, 7):
        yield case(
            f"exp(-x·10^{k})",
            lambda m, x, r: m.exp(-r * x),
            (UNIT,),
            {"r": 10.0**k},
            lambda m, r: (1 - m.exp(-r)) / r,
        )
    for k in range(1, 6):
        w = 10.0**-k
        yield case(
            f"a logistic step of width 10^-{k}",
            lambda m, x, t, w=w: 1 / (1 + m.exp((x - t) / w)),
            (UNIT,),
            {"t": 0.375},
            lambda m, t, w=w: _logistic(m, t, m.mpf(w)),
        )


def _logistic(m: Any, t: Any, w: Any) -> Any:
    return 1 - w * m.log(1 + m.exp((1 - t) / w)) + w * m.log(1 + m.exp(-t / w))


SHAPES: dict[str, tuple[Case, ...]] = {
    "touching at a distance": tuple(touching()),
    "saddles": tuple(saddles()),
    "cusps and crossings": tuple(cusps()),
    "empty and full regions": tuple(empty_and_full()),
    "conditions on integrals": tuple(conditions_on_integrals()),
    "edges on bounds": tuple(edges_on_bounds()),
    "products of brackets": tuple(products()),
    "narrow and smooth": tuple(narrow_and_smooth()),
}
"""More classes of the stability report."""
