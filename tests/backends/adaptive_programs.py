"""Adaptive integrals, and integrals that watch the signs of conditions."""

from __future__ import annotations

import math

from teg.program import Adaptive
from tests.backends.case import INF, NAN, TIGHT, Case, integrate, let, program

EXPONENTIAL = (let("v0", "mul", "p0", "x0"), let("v1", "exp", "v0"))
HIDDEN = (1e-3, 2e-4, 1e-5, 0.5 - 2e-4, 0.5 + 1e-5, 0.75 - 1e-4, 1 - 1e-3, 1 - 1e-4, 1 - 1e-5)
"""Places near the ends of dyadic intervals, between these and the outermost nodes."""
BESIDE = (
    let("v0", "sub", "x0", "p0"),
    let("b0", "gt0", "v0"),
    let("v1", "max", 0.0, "v0"),
    let("v2", "sqrt", "v1"),
    let("v10", "neg", "v0"),
    let("v5", "max", 0.0, "v10"),
)
ADAPTIVE = (
    Case(
        "places at which a closed rule looks between the outermost nodes and the ends: a jump, a root that begins, one that ends",
        program(
            1,
            (
                *(
                    integrate(result, "x0", 0.0, 1.0, (*BESIDE, last), last.name, rule=Adaptive(1e-11, closed=True))
                    for result, last in (
                        ("v7", let("v3", "select", "b0", 1.0, 2.0)),
                        ("v8", let("v4", "add", 1.0, "v2")),
                        ("v9", let("v6", "sqrt", "v5")),
                    )
                ),
            ),
            *("v7", "v8", "v9"),
        ),
        (HIDDEN,),
        (
            tuple(1.0 + p for p in HIDDEN),
            tuple(1.0 + 2.0 / 3.0 * (1.0 - p) ** 1.5 for p in HIDDEN),
            tuple(2.0 / 3.0 * p**1.5 for p in HIDDEN),
        ),
        len(HIDDEN),
        1e-10,
    ),
    Case(
        "exp(p0 x) over (0, 1), and over (1, 0)",
        program(
            1,
            (
                integrate("v8", "x0", 0.0, 1.0, EXPONENTIAL, "v1", rule=TIGHT),
                integrate(
                    "v9",
                    "x1",
                    1.0,
                    0.0,
                    (let("v2", "mul", "p0", "x1"), let("v3", "exp", "v2")),
                    "v3",
                    rule=TIGHT,
                ),
            ),
            "v8",
            "v9",
        ),
        ((1.0, 30.0, -30.0),),
        tuple(tuple(sign * math.expm1(t) / t for t in (1.0, 30.0, -30.0)) for sign in (1, -1)),
        3,
        1e-13,
    ),
    Case(
        "a slow part, √(x - p0), behind a fast one: it counts that p0 is a break beside the interval, behind another one at its end",
        program(
            1,
            (
                integrate(
                    "v9",
                    "x0",
                    0.0,
                    1.0,
                    (
                        let("v0", "sub", "x0", "p0"),
                        let("v1", "sqrt", "v0"),
                        let("v2", "mul", 1e-3, "v1"),
                        let("v3", "mul", 3.0, "x0"),
                        let("v4", "cos", "v3"),
                        let("v5", "add", "v2", "v4"),
                    ),
                    "v5",
                    breaks=("p0", -1e-12),
                    rule=Adaptive(1e-8),
                ),
            ),
            "v9",
        ),
        ((-0.03, -0.01),),
        (tuple(math.sin(3.0) / 3.0 + 2e-3 / 3.0 * ((1.0 + p) ** 1.5 - p**1.5) for p in (0.03, 0.01)),),
        2,
        1e-11,
    ),
    Case(
        "√ at one end, with and without flat ends; x² beside it; values free of the variable",
        program(
            1,
            (
                integrate("v7", "x0", 0.0, "p0", (let("v0", "sqrt", "x0"),), "v0", rule=TIGHT),
                integrate(
                    "v8 v9 v6 v5",
                    "x1",
                    0.0,
                    "p0",
                    (let("v1", "sqrt", "x1"), let("v2", "powi", "x1", 2)),
                    "v1",
                    "v2",
                    2.0,
                    "p0",
                    rule=Adaptive(1e-12, cubic=True),
                ),
            ),
            *("v7", "v8", "v9", "v6", "v5"),
        ),
        ((1.0, 4.0),),
        ((2 / 3, 16 / 3), (2 / 3, 16 / 3), (1 / 3, 64 / 3), (2.0, 8.0), (1.0, 16.0)),
        2,
        1e-12,
    ),
    Case(
        "a jump that no break announces, found by bisection",
        program(
            1,
            (
                integrate(
                    "v9",
                    "x0",
                    0.0,
                    1.0,
                    (
                        let("v0", "sub", "p0", "x0"),
                        let("b0", "gt0", "v0"),
                        let("v1", "select", "b0", 1.0, 0.0),
                    ),
                    "v1",
                    rule=Adaptive(1e-10),
                ),
            ),
            "v9",
        ),
        ((0.3, math.sqrt(0.5)),),
        ((0.3, math.sqrt(0.5)),),
        2,
        1e-9,
    ),
    Case(
        "the pieces of an adaptive integral: |x - p0| with its break, and NaN where the body is NaN",
        program(
            1,
            (
                integrate(
                    "v8 v9",
                    "x0",
                    -1.0,
                    1.0,
                    (let("v0", "sub", "x0", "p0"), let("v1", "abs", "v0"), let("v2", "sqrt", "p0")),
                    "v1",
                    "v2",
                    breaks=("p0",),
                    rule=TIGHT,
                ),
            ),
            "v8",
            "v9",
        ),
        ((0.5, -0.25, 3.0),),
        ((1.25, 1.0625, 6.0), (math.sqrt(2), NAN, 2 * math.sqrt(3))),
        3,
    ),
    Case(
        "nested adaptive: ∫∫ exp(p0 x y) over the unit square",
        program(
            1,
            (
                integrate(
                    "v9",
                    "x1",
                    0.0,
                    1.0,
                    (
                        let("v0", "mul", "p0", "x1"),
                        integrate(
                            "v3",
                            "x0",
                            0.0,
                            1.0,
                            (let("v1", "mul", "v0", "x0"), let("v2", "exp", "v1")),
                            "v2",
                            rule=TIGHT,
                        ),
                    ),
                    "v3",
                    rule=TIGHT,
                ),
            ),
            "v9",
        ),
        ((1.0, -2.0),),
        # Ein(-p)/p: Σ pᵏ/(k!·(k+1)²)
        (tuple(sum(p**k / (math.factorial(k) * (k + 1) ** 2) for k in range(40)) for p in (1.0, -2.0)),),
        2,
        1e-12,
    ),
)

_INVERSE_SQUARE = (let("v0", "powi", "x0", -2),)
ADAPTIVE += (
    Case(
        "1/x² over (p0, p1): an infinite bound where none is announced is no number, and misses nothing",
        program(2, (integrate("v9", "x0", "p0", "p1", _INVERSE_SQUARE, "v0", rule=TIGHT, breaks=(2.0,)),), "v9"),
        ((1.0, 1.0, -INF, INF, -INF), (4.0, INF, -1.0, 1.0, INF)),
        ((0.75, NAN, NAN, NAN, NAN),),
        5,
        1e-12,
    ),
)

CUTS = (1e-4, 0.3, 0.5 + 1e-4, 0.5 - 1e-9, 0.5, 0.999)
BELOW = (let("v0", "sub", "p0", "x0"), let("b0", "gt0", "v0"))  # x < p0
DISCS = (1e-6, 0.25, 1.0)
WATCHED = (
    *(
        Case(
            f"[x < p0] exp(x) without its break, watched{', flat ends' * cubic}",
            program(
                1,
                (
                    integrate(
                        "v8 v9",
                        "x0",
                        0.0,
                        1.0,
                        (*BELOW, let("v1", "exp", "x0"), let("v2", "select", "b0", "v1", 0.0)),
                        "v2",
                        "v1",
                        rule=Adaptive(1e-12, cubic=cubic),
                        watch=("b0",),
                    ),
                ),
                "v8",
                "v9",
            ),
            (CUTS,),
            (tuple(map(math.expm1, CUTS)), math.expm1(1)),
            len(CUTS),
            1e-12,
        )
        for cubic in (False, True)
    ),
    Case(
        "two watched conditions, the other way round and one of them always true; NaN at both ends only",
        program(
            1,
            (
                integrate(
                    "v9",
                    "x0",
                    1.0,
                    0.0,
                    (
                        *BELOW,
                        let("b1", "lt0", -1.0),
                        let("v1", "sub", 1.0, "x0"),
                        let("v2", "mul", "v1", "x0"),
                        let("b2", "gt0", "v2"),
                        let("v3", "select", "b2", 1.0, NAN),
                        let("v4", "select", "b0", "v3", 2.0),
                    ),
                    "v4",
                    rule=TIGHT,
                    watch=("b1", "b0"),
                ),
            ),
            "v9",
        ),
        (CUTS,),
        (tuple(t - 2 for t in CUTS),),
        len(CUTS),
        1e-12,
    ),
    Case(
        "the quarter of a disc, the inner break watched, not given: ∫∫ [x² + y² < p0] and its moment ∫∫ … x",
        program(
            1,
            (
                let("v0", "sqrt", "p0"),
                integrate(
                    "v8 v9",
                    "x1",
                    0.0,
                    1.0,
                    (
                        let("v1", "powi", "x1", 2),
                        let("v2", "sub", "p0", "v1"),
                        integrate(
                            "v6 v7",
                            "x0",
                            0.0,
                            1.0,
                            (
                                let("v3", "powi", "x0", 2),
                                let("v4", "sub", "v2", "v3"),
                                let("b0", "gt0", "v4"),
                                let("v5", "select", "b0", "x0", 0.0),
                                let("v10", "select", "b0", 1.0, 0.0),
                            ),
                            "v10",
                            "v5",
                            rule=TIGHT,
                            watch=("b0",),
                        ),
                    ),
                    "v6",
                    "v7",
                    breaks=("v0",),
                    rule=Adaptive(1e-10, cubic=True),
                ),
            ),
            "v8",
            "v9",
        ),
        (DISCS,),
        (tuple(math.pi / 4 * t for t in DISCS), tuple(t**1.5 / 3 for t in DISCS)),
        len(DISCS),
        1e-11,
    ),
    Case(
        "a watched condition from a nested integral, and ties at the ends of intervals, which do not count",
        program(
            1,
            (
                integrate(
                    "v9",
                    "x1",
                    0.0,
                    1.0,
                    (
                        integrate("v0", "x0", 0.0, "x1", (let("v1", "mul", 2.0, "x0"),), "v1"),
                        let("v2", "sub", "p0", "v0"),
                        let("b0", "gt0", "v2"),
                        let("v3", "select", "b0", "v0", 0.0),
                        let("b1", "tie", "x1", 1.0, True, 0),
                        let("v4", "select", "b1", "v3", 1e9),
                    ),
                    "v4",
                    rule=TIGHT,
                    watch=("b0",),
                ),
            ),
            "v9",
            ties=1,
        ),
        (CUTS,),
        (tuple(t**1.5 / 3 for t in CUTS),),
        len(CUTS),
        1e-12,
    ),
)
