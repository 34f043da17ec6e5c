"""Surfaces that coincide: results are means over both orders."""

from __future__ import annotations

from teg.program import INSIDE
from tests.backends.case import INF, NAN, Case, integrate, let, program

TIES = (
    Case(
        "a tie is the average of both orders, far from it g > 0",
        program(
            2,
            (
                let("v0", "sub", "p0", "p1"),
                let("v1", "abs", "p0"),
                let("b0", "tie", "v0", "v1", True, 0),
                let("v2", "select", "b0", 10.0, 4.0),
            ),
            "v2",
            "p0",
            ties=1,
        ),
        ((1.0, 2.0, 0.0, 0.1 + 0.2), (1.0, 1.0, 1.0, 0.3)),
        ((7.0, 10.0, 4.0, 7.0), (1.0, 2.0, 0.0, 0.1 + 0.2)),
        4,
        ties=(0,),
    ),
    Case(
        "tied conditions move together: their r decides the order",
        program(
            2,
            (
                let("v0", "sub", "p0", "p1"),
                let("v1", "sub", "p1", "p0"),
                let("b0", "tie", "v0", 1.0, True, 0),
                let("b1", "tie", "v1", 1.0, False, 1),
                let("v2", "select", "b0", 1.0, 0.0),
                let("v3", "select", "b1", 1.0, 0.0),
                let("v4", "add", "v2", "v3"),
                let("v5", "mul", "v2", "v3"),
            ),
            "v4",
            "v5",
            ties=2,
        ),
        ((2.0, 2.0), (2.0, 5.0)),
        ((1.0, 1.0), (0.0, 0.0)),
        2,
        ties=(0, 1),
    ),
    Case(
        "no tie: g is not near 0, is NaN, or is infinite at infinite scale",
        program(
            2,
            (let("b0", "tie", "p0", "p1", True, 0), let("v0", "select", "b0", 1.0, 0.0)),
            "v0",
            ties=1,
        ),
        ((1.0, NAN, INF, -1e-12), (1.0, 1.0, INF, 1.0)),
        ((1.0, 0.0, 1.0, 0.0),),
        4,
    ),
    Case(
        "ties in the flags and the body of an integral",
        program(
            1,
            (
                integrate(
                    "v9",
                    "x0",
                    0.0,
                    1.0,
                    (
                        let("b1", "tie", "p0", 1.0, "b0", 1),
                        let("v1", "select", "b1", "x0", 0.0),
                    ),
                    "v1",
                    breaks=(0.5,),
                    flags=(let("v0", "sub", "x0", 0.5 + INSIDE * (1.0 - 0.5)), let("b0", "tie", "v0", "x0", True, 0)),
                ),
            ),
            "v9",
            ties=2,
        ),
        ((0.0, 1.0, -1.0),),
        ((0.4375, 0.5, 0.0),),
        3,
        ties=(0, 1),
    ),
    Case(
        "ties below a false when are not met",
        program(
            1,
            (
                let("b0", "gt0", "p0"),
                integrate(
                    "v9",
                    "x0",
                    0.0,
                    1.0,
                    (let("b1", "tie", 0.0, 1.0, True, 0), let("v1", "select", "b1", 2.0, 0.0)),
                    "v1",
                    when="b0",
                ),
            ),
            "v9",
            ties=1,
        ),
        (-1.0,),
        (0.0,),
    ),
)
