"""Integrals over infinite ranges: tails to both sides, in several scales, with and without breaks. Their values have closed forms."""

from __future__ import annotations

import math
from typing import Any

from teg.program import Arg, Bend, Stmt
from tests.backends.programs import INF, NAN, TIGHT, Case, integrate, let, program


def _half(p: float) -> float:
    """Returns ∫ (1 + x²)^-p dx over (0, ∞)."""
    return 0.5 * math.sqrt(math.pi) * math.gamma(p - 0.5) / math.gamma(p)


def _tail(lo: Arg, hi: Arg, body: tuple[Stmt, ...], value: Arg, **options: Any) -> tuple[Stmt, ...]:
    return (integrate("v9", "x0", lo, hi, body, value, infinite=True, rule=TIGHT, **options),)


_DECAY = (let("v0", "abs", "x0"), let("v1", "div", "v0", "p2"), let("v2", "neg", "v1"), let("v3", "exp", "v2"))
_POWER = (let("v0", "powi", "x0", 2), let("v1", "add", 1.0, "v0"), let("v2", "neg", "p2"), let("v3", "pow", "v1", "v2"))
_BELL = (let("v0", "powi", "x0", 2), let("v1", "add", 1.0, "v0"), let("v2", "powi", "v1", -2))
TAILS = (
    Case(
        "exp(-|x|/p2): right, left, both by way of 0, reversed, empty, finite, in two scales",
        program(3, _tail("p0", "p1", _DECAY, "v3", breaks=(0.0,), scale="p2"), "v9"),
        (
            (0.0, -INF, -INF, INF, INF, 0.0, 1.0, 1000.0, NAN),
            (INF, 0.0, INF, 0.0, INF, 1.0, INF, INF, INF),
            (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1000.0, 1.0),
        ),
        ((1.0, 1.0, 2.0, -1.0, 0.0, -math.expm1(-1.0), math.exp(-1.0), 1000 * math.exp(-1.0), NAN),),
        9,
        2e-12,
    ),
    Case(
        "(1 + x²)^-p2: right, left, both by way of 0, reversed, in two scales",
        program(4, _tail("p0", "p1", _POWER, "v3", breaks=(0.0,), scale="p3", reach=325.0), "v9"),
        (
            (0.0, -INF, -INF, INF, INF, 0.0, 0.0, NAN),
            (INF, 0.0, INF, 0.0, INF, INF, INF, INF),
            (0.55, 0.75, 1.25, 0.6, 0.75, 3.0, 0.75, 0.75),
            (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1000.0, 1.0),
        ),
        ((_half(0.55), _half(0.75), 2.0 * _half(1.25), -_half(0.6), 0.0, _half(3.0), _half(0.75), NAN),),
        8,
        2e-12,
    ),
    Case(
        "x^-p0 from 1, with several reaches",
        program(2, _tail(1.0, INF, (let("v0", "neg", "p0"), let("v3", "pow", "x0", "v0")), "v3", reach="p1"), "v9"),
        ((3.5, 1.5, 1.125), (20.0, 400.0, 600.0)),
        ((0.4, 2.0, 8.0),),
        3,
        2e-12,
    ),
    Case(
        "[x < 3]·x/(1 + x²)² with its break, decided in the middle of a tail",
        program(
            1,
            _tail(
                "p0",
                INF,
                (*_BELL, let("v4", "mul", "x0", "v2"), let("v5", "select", "b0", "v4", 0.0)),
                "v5",
                breaks=(3.0,),
                flags=(let("v6", "sub", 3.0, "x0"), let("b0", "gt0", "v6")),
            ),
            "v9",
        ),
        ((0.0, 1.0, 4.0),),
        ((0.45, 0.2, 0.0),),
        3,
        2e-12,
    ),
    Case(
        "1/(√x·(1 + x)²): a bend, then a tail",
        program(
            0,
            _tail(
                0.0,
                INF,
                (
                    let("v0", "sqrt", "x0"),
                    let("v1", "add", 1.0, "x0"),
                    let("v2", "powi", "v1", 2),
                    let("v3", "mul", "v0", "v2"),
                    let("v4", "div", 1.0, "v3"),
                ),
                "v4",
                breaks=(1.0,),
                bends=(Bend("root", (0.0, 1.0, 0.0)),),
            ),
            "v9",
        ),
        (),
        (math.pi / 2,),
        1,
        2e-12,
    ),
)
