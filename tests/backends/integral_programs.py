"""Integrals in one and in two variables, with breaks."""

from __future__ import annotations

import math

from teg.program import Adaptive, Gauss
from tests.backends.case import INF, NAN, TWO, Case, integrate, let, program

CUBE = (let("v0", "powi", "x0", 3),)

ONE_VARIABLE = (
    Case(
        "x³ over (p0, p1): bounds in order, reversed, equal, NaN, infinite",
        program(2, (integrate("v9", "x0", "p0", "p1", CUBE, "v0", rule=TWO),), "v9"),
        ((0.0, 2.0, 1.0, NAN, 0.0, 1.0, -INF, INF), (2.0, 0.0, 1.0, 1.0, NAN, INF, 1.0, INF)),
        ((4.0, -4.0, 0.0, NAN, NAN, NAN, NAN, NAN),),
        8,
    ),
    Case(
        "an integral of shared values only, in a batch",
        program(2, (integrate("v9", "x0", 0.0, "p0", CUBE, "v0"), let("v8", "add", "v9", "p1")), "v8", "v9"),
        (2.0, (0.0, 1.0)),
        ((4.0, 5.0), 4.0),
        2,
    ),
    Case(
        "values free of the variable: a literal, a parameter, a flag",
        program(
            1,
            (
                integrate(
                    "v7 v8 v9",
                    "x0",
                    -1.0,
                    2.0,
                    (),
                    0.5,
                    "p0",
                    "v0",
                    flags=(let("v0", "neg", "p0"),),
                ),
            ),
            "v7",
            "v8",
            "v9",
        ),
        ((1.0, 3.0),),
        (1.5, (3.0, 9.0), (-3.0, -9.0)),
        2,
    ),
    Case(
        "[x < p0]·x on (0, 1): the break inside, outside on both sides, absent",
        program(
            1,
            (
                integrate(
                    "v9",
                    "x0",
                    0.0,
                    1.0,
                    (let("v1", "select", "b0", "x0", 0.0),),
                    "v1",
                    breaks=("p0",),
                    flags=(let("v0", "sub", "x0", "p0"), let("b0", "lt0", "v0")),
                ),
            ),
            "v9",
        ),
        ((0.3, -1.0, 2.0, NAN, 0.0, 1.0),),
        ((0.045, 0.0, 0.5, 0.0, 0.0, 0.5),),
        6,
    ),
    Case(
        "unsorted breaks, one repeated, one a literal: ∫ floor(4x) x over (0, 1) and back",
        program(
            2,
            (
                let("v4", "const", 0.75),
                let("v5", "const", NAN),
                integrate(
                    "v9",
                    "x0",
                    "p0",
                    "p1",
                    (let("v2", "mul", "v1", "x0"),),
                    "v2",
                    breaks=("v4", 0.25, 0.5, 0.25, "v5"),
                    flags=(let("v0", "mul", 4.0, "x0"), let("v1", "floor", "v0")),
                ),
            ),
            "v9",
        ),
        ((0.0, 1.0), (1.0, 0.0)),
        (((3 - (1 + 4 + 9) / 16) / 2, -(3 - (1 + 4 + 9) / 16) / 2),),
        2,
    ),
    Case(
        "need: pieces that it refuses are not evaluated (1/(x - ½) there is not finite at the middle)",
        program(
            0,
            (
                integrate(
                    "v9",
                    "x0",
                    0.0,
                    3.0,
                    (let("v0", "div", 1.0, "v2"),),
                    "v0",
                    breaks=(1.0, 2.0),
                    flags=(
                        let("v1", "sub", "x0", 1.0),
                        let("b0", "gt0", "v1"),
                        let("v3", "sub", "x0", 0.5),
                        let("v2", "select", "b0", 2.0, "v3"),
                    ),
                    need="b0",
                ),
            ),
            "v9",
        ),
        (),
        (1.0,),
    ),
    Case(
        "need may name a condition from outside",
        program(
            1,
            (let("b0", "gt0", "p0"), integrate("v9", "x0", 0.0, 2.0, CUBE, "v0", need="b0")),
            "v9",
        ),
        ((1.0, -1.0),),
        ((4.0, 0.0),),
        2,
    ),
    Case(
        "when: 0 where it is false, whatever stands below, NaN bounds included",
        program(
            1,
            (
                let("b0", "gt0", "p0"),
                let("v1", "sqrt", "p0"),
                integrate("v8 v9", "x0", 0.0, "v1", (let("v0", "mul", "x0", "v1"),), "v0", 1.0, when="b0"),
            ),
            "v8",
            "v9",
        ),
        ((4.0, -4.0, 0.0),),
        ((4.0, 0.0, 0.0), (2.0, 0.0, 0.0)),
        3,
    ),
    Case(
        "NaN in the body is NaN in its own element only",
        program(1, (integrate("v9", "x0", 0.0, 1.0, (let("v0", "sqrt", "p0"),), "v0"),), "v9"),
        ((4.0, -4.0),),
        ((2.0, NAN),),
        2,
    ),
)
DISC = program(  # area and second moment ∫∫ x² of the disc of radius √p0
    1,
    (
        let("v0", "sqrt", "p0"),
        let("v1", "neg", "v0"),
        integrate(
            "v8 v9",
            "x1",
            -2.0,
            2.0,
            (
                let("v2", "powi", "x1", 2),
                let("v3", "sub", "p0", "v2"),
                let("v4", "sqrt", "v3"),
                let("v5", "neg", "v4"),
                integrate("v6 v7", "x0", "v5", "v4", (let("v10", "powi", "x0", 2),), 1.0, "v10", rule=TWO),
            ),
            "v6",
            "v7",
            breaks=("v1", "v0"),
            flags=(let("v11", "powi", "x1", 2), let("v12", "sub", "p0", "v11"), let("b0", "gt0", "v12")),
            need="b0",
            rule=Adaptive(1e-13, cubic=True),
        ),
    ),
    "v8",
    "v9",
)

TWO_VARIABLES = (
    Case(
        "∫∫ x y over 0 < x < p0·y, 0 < y < 1",
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
                        integrate("v2", "x0", 0.0, "v0", (let("v1", "mul", "x0", "x1"),), "v1"),
                    ),
                    "v2",
                ),
            ),
            "v9",
        ),
        ((1.0, 2.0, -2.0),),
        ((0.125, 0.5, 0.5),),
        3,
    ),
    Case(
        "∫∫ [x + y < p0] over the unit square, the inner bounds and the flag from both levels",
        program(
            1,
            (
                let("v0", "sub", "p0", 1.0),
                integrate(
                    "v9",
                    "x1",
                    0.0,
                    1.0,
                    (
                        let("v1", "sub", "p0", "x1"),
                        integrate(
                            "v5",
                            "x0",
                            0.0,
                            1.0,
                            (let("v3", "select", "b0", 1.0, 0.0),),
                            "v3",
                            breaks=("v1",),
                            flags=(let("v2", "sub", "v1", "x0"), let("b0", "gt0", "v2")),
                            rule=Gauss(1),
                        ),
                    ),
                    "v5",
                    breaks=("p0", "v0"),
                    rule=Gauss(1),
                ),
            ),
            "v9",
        ),
        ((0.5, 1.0, 1.75, -1.0, 3.0),),
        ((0.125, 0.5, 1 - 0.03125, 0.0, 1.0),),
        5,
    ),
    Case(
        "area and second moment of a disc; 0 where it is empty",
        DISC,
        ((1.0, 2.25, -1.0),),
        ((math.pi, 2.25 * math.pi, 0.0), (math.pi / 4, 2.25**2 * math.pi / 4, 0.0)),
        3,
        1e-12,
    ),
    Case(
        "when inside an integral, false at some nodes",
        program(
            1,
            (
                integrate(
                    "v8 v9",
                    "x1",
                    -1.0,
                    1.0,
                    (
                        let("b0", "gt0", "x1"),
                        let("v0", "log", "x1"),
                        integrate("v2 v3", "x0", 0.0, "x1", (let("v1", "exp", "v0"),), "v1", "p0", when="b0"),
                    ),
                    "v2",
                    "v3",
                    breaks=(0.0,),
                ),
            ),
            "v8",
            "v9",
        ),
        (5.0,),
        (1.0 / 3.0, 2.5),
    ),
)
