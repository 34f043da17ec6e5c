"""Programs with `Isolate`, `SumOver`, `min` and `max`, written by hand, with known answers: every backend runs over this table."""

from __future__ import annotations

import math

from teg.program import Arg, Isolate
from tests.backends.isolate_surfaces import (
    NOWHERE_ZERO,
    UNDEFINED,
    ZERO,
    Surface,
    cubic,
    difference_of_cubes,
    isolate,
    kink,
    line,
    numbered,
    ramps,
    root,
    square,
    sum_over,
    wave,
)
from tests.backends.programs import INF, NAN, Case, Row, integrate, let, operation, program


def roots_of(
    name: str,
    g: Surface,
    columns: tuple[Row, ...],
    expected: tuple[Row, ...],
    n: int = 1,
    lo: Arg = -2.0,
    hi: Arg = 3.0,
    tolerance: float = 4e-16,
) -> Case:
    """The roots of g in order, as many results as there are rows expected."""
    results = numbered(len(expected))
    return Case(name, program(len(columns), (isolate(results, g, lo, hi),), *results.split()), columns, expected, n, tolerance)


NEAR = 4e-12  # of the roots that only bisection finds: 2⁻⁴⁰ of the interval

ROOTS = (
    roots_of(
        "a cubic with three roots, with one, in a batch",
        cubic("p0"),
        ((1.0, 0.25, -1.0, 2.25, 30.0, 6.25),),
        ((-1.0, -0.5, 0.0, -1.5, 0.0, 0.0), (0.0, 0.0, INF, 0.0, INF, 2.5), (1.0, 0.5, INF, 1.5, INF, INF), INF),
        6,
        tolerance=1e-15,
    ),
    roots_of("a triple root is one", cubic("p0"), (0.0,), (0.0, INF), tolerance=NEAR),
    roots_of("a root in the middle of a box", cubic("p0"), (1.0,), (-1.0, 0.0, 1.0), lo=-2.0, hi=2.0),
    roots_of("roots in the middle of many boxes", wave("p0"), (math.pi,), (*map(float, range(-3, 4)), INF), lo=-3.5, hi=3.5),
    roots_of("many roots", wave("p0"), (3.0,), (*(math.pi * j / 3 for j in range(1, 10)), *[INF] * 7), lo=0.1, hi=10.0),
    roots_of(
        "as many roots as results, or more than results",
        wave("p0"),
        ((math.pi, 5.0),),
        ((1.0, NAN), (2.0, NAN), (3.0, NAN)),
        2,
        lo=0.5,
        hi=3.5,
    ),
    roots_of("32 results", wave(math.pi), (), tuple(map(float, range(1, 33))), lo=0.5, hi=32.5),
    roots_of("a single result", wave("p0", 0.5), ((1.0, 2.0),), ((math.pi / 6, math.pi / 12),), 2, lo=0.0, hi=1.0),
    roots_of("a single result, two roots", wave("p0", 0.5), (1.0,), (NAN,), lo=0.0, hi=3.0),
    roots_of("more boxes than there is room for", wave("p0"), (1e4,), (NAN,) * 16),
    roots_of("zero everywhere: no root is isolated", ZERO, (), (INF, INF)),
    roots_of("undefined everywhere", UNDEFINED, (), (INF, INF)),
    roots_of("bounds that exclude 0", NOWHERE_ZERO, (), (INF, INF)),
    roots_of("0 on a part of the range", ramps("p0"), ((1.0, 0.75),), ((0.0, 0.0), (2.0, 1.5), INF), 2, tolerance=NEAR),
    roots_of(
        "a square: two roots, a tangency, none",
        square("p0", "p1"),
        ((0.3, 0.3, 0.5, 0.3, 0.3), (0.25, 0.0, 0.0, -1e-9, 4.0)),
        ((-0.2, 0.3, 0.5, INF, -1.7), (0.8, 0.3, 0.5, INF, 2.3), INF),
        5,
        tolerance=NEAR,
    ),
    roots_of("a tangency at an end is one root", square("p0"), ((1.0, 0.0),), ((1.0, 0.0), INF), 2, lo=0.0, hi=1.0, tolerance=NEAR),
    roots_of("two roots that are close", square(0.3, 1e-14), (), (0.3 - 1e-7, 0.3 + 1e-7), tolerance=1e-15),
    roots_of(
        "a kink on zero, under it, over it",
        kink("p0", "p1"),
        ((0.3, 0.3, 0.3), (0.0, 0.5, -0.5)),
        ((0.3, -0.2, INF), (0.3, 0.8, INF), INF),
        3,
        tolerance=NEAR,
    ),
    roots_of(
        "roots at the ends: [g > 0] has to change between them",
        line("p0", "p1"),
        ((1.0, -1.0, 1.0, -1.0, 1.0), (0.3, 0.3, 0.7, 0.7, 0.9)),
        ((0.3, INF, INF, 0.7, INF), INF),
        5,
        lo=0.3,
        hi=0.7,
    ),
    roots_of(
        "bounds: reversed, NaN, infinite, equal",
        line(1.0, 0.25),
        ((0.0, 1.0, NAN, 0.0, -INF, 0.0, 0.25, 0.5, 1.0), (1.0, 0.0, 1.0, NAN, 1.0, INF, 0.25, 0.5, 0.5)),
        ((0.25, 0.25, NAN, NAN, NAN, NAN, INF, INF, INF), (INF, INF, NAN, NAN, NAN, NAN, INF, INF, INF)),
        9,
        lo="p0",
        hi="p1",
    ),
    roots_of("equal bounds on a tangency", square(0.25), (0.25,), (INF, INF), lo="p0", hi="p0"),
    roots_of(
        "a box that cannot be halved",
        square(1.0 + 2.0**-51),
        (),
        (1.0 + 2.0**-51, 1.0 + 2.0**-51, INF),
        lo=1.0,
        hi=1.0 + 2.0**-50,
        tolerance=0.0,
    ),
    roots_of(
        "far from 0: boxes as thin as numbers are",
        kink(2.0**40 + 0.25),
        (),
        (2.0**40 + 0.25, 2.0**40 + 0.25, INF),
        lo=2.0**40,
        hi=2.0**40 + 1,
        tolerance=1e-16,
    ),
    roots_of("a steep line far from 0", line(1e9, "p0"), ((1e6 + 1 / 3, 1e-9),), ((1e6 + 1 / 3, 1e-9), INF), 2, lo=-1e5, hi=1e7),
    roots_of("undefined on the left", root("p0"), ((1.5, 0.5, 2.5, -1.0),), ((2.25, 0.25, INF, INF), INF), 4, lo=-1.0, hi=4.0),
    roots_of("undefined everywhere between the bounds", root(1.0), (), (INF, INF), lo=-4.0, hi=-1.0),
    *(
        roots_of(
            f"bounds undefined on the left, from {lo}",
            root("p0", strict=True),
            ((1.5, 0.5, 2.5, -1.0),),
            ((2.25, 0.25, INF, INF), INF),
            4,
            lo=lo,
            hi=4.0,
        )
        for lo in (-4.0, -1.0)
    ),
    roots_of("NaN in, no root out", line("p0", 0.0), (NAN,), (INF, INF), lo=-1.0, hi=1.0),
)

WEIGHTED = (  # Σ x²/|g′| at the roots of x³ - p·x
    isolate(numbered(4), cubic("p0"), "p1", 3.0),
    sum_over(
        "vsum vnumber",
        "x1",
        ("vr0", "vr1", "vr2", "vr3"),
        (
            let("vx2", "powi", "x1", 2),
            let("vx23", "mul", 3.0, "vx2"),
            let("vslope", "sub", "vx23", "p0"),
            let("vsize", "abs", "vslope"),
            let("vterm", "div", "vx2", "vsize"),
        ),
        "vterm",
        1.0,
    ),
)

TRIANGLE = (  # ∫ dx2 over (0, p0) of ∫ [x1 < x2]·(1, x1·x2) dx1 over (0, 2), the border found as the root of x³ - y³
    integrate(
        "varea vmoment",
        "x2",
        0.0,
        "p0",
        (
            isolate("vr0 vr1", difference_of_cubes("x2"), 0.0, 2.0),
            integrate(
                "vin vinm",
                "x1",
                0.0,
                2.0,
                (let("vxy", "mul", "x1", "x2"),),
                1.0,
                "vxy",
                breaks=("vr0", "vr1"),
                flags=(let("vunder", "sub", "x2", "x1"), let("bunder", "gt0", "vunder")),
                need="bunder",
            ),
        ),
        "vin",
        "vinm",
    ),
)

SUMS = (
    Case(
        "the sum over the roots: three, one, none that are there, NaN",
        program(2, WEIGHTED, "vsum", "vnumber"),
        ((1.0, 4.0, -1.0, 1.0, 1.0, 4.0), (-2.0, -3.0, -2.0, 2.0, NAN, -0.5)),
        ((1.0, 1.0, 0.0, 0.0, NAN, 0.5), (3.0, 3.0, 1.0, 0.0, NAN, 2.0)),
        6,
        1e-15,
    ),
    Case(
        "points as they come: repeated, infinite of either sign, literal",
        program(
            2,
            (sum_over("vs vn", "x0", ("p0", 2.5, INF, "p1", -INF, 2.5), (let("v2", "powi", "x0", 2),), "v2", 1),),
            "vs",
            "vn",
        ),
        ((1.0, INF, -INF), (3.0, -INF, 4.0)),
        ((22.5, 12.5, 28.5), (4.0, 2.0, 3.0)),
        3,
    ),
    Case(
        "a NaN among the points, or in the body",
        program(2, (sum_over("vs", "x0", ("p0", INF, 1.0), (let("v1", "div", "x0", "p1"),), "v1"),), "vs"),
        ((NAN, 0.0, 2.0, INF), (1.0, 0.0, 2.0, 2.0)),
        ((NAN, NAN, 1.5, 0.5),),
        4,
    ),
    Case(
        "no points, no finite points",
        program(0, (sum_over("vs", "x0", (), (), 1.0), sum_over("vt vu", "x1", (INF, -INF), (), 1.0, "x1")), "vs", "vt", "vu"),
        (),
        (0.0, 0.0, 0.0),
    ),
    Case(
        "when: nothing is evaluated",
        program(
            2,
            (
                let("b0", "gt0", "p0"),
                isolate("vr0 vr1", line(1.0, "p1"), 0.0, 1.0, when="b0"),
                Isolate(
                    "x1", "p1", 0.0, "x1l", "x1r", (), (-INF, INF, 1.0, 1.0), (let("vy", "sub", "x1", 0.25),), "vy", 1.0, ("vq0",), "b0"
                ),
                sum_over("vs", "x2", ("p1", "vr0"), (let("vx1", "add", "x2", 1.0),), "vx1", when="b0"),
                sum_over("vt vn", "x3", ("p1", "vr0"), (), "x3", 1.0, when="b0"),
            ),
            "vr0",
            "vr1",
            "vq0",
            "vs",
            "vt",
            "vn",
        ),
        ((1.0, -1.0, 0.0, -1.0), (0.5, 0.5, 0.5, NAN)),
        ((0.5, INF, INF, INF), INF, (0.25, INF, INF, INF), (3.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0)),
        4,
    ),
    Case(
        "an integral in the body of a sum",
        program(
            1,
            (
                isolate("vr0 vr1 vr2", wave(math.pi), 0.5, "p0"),
                sum_over(
                    "vs",
                    "x1",
                    ("vr0", "vr1", "vr2"),
                    (
                        integrate("vi", "x2", 0.0, "x1", (let("vxx", "mul", "x2", "x1"),), "vxx"),
                        let("vterm", "add", "vi", "p0"),
                    ),
                    "vterm",
                ),
            ),
            "vs",
        ),
        ((2.5, 1.5, 0.75),),
        ((9.5, 2.0, 0.0),),
        3,
        4e-15,
    ),
    Case(
        "a sum in the body of a sum",
        program(
            1,
            (
                sum_over(
                    "vs",
                    "x0",
                    (1.0, "p0", INF),
                    (sum_over("vt", "x1", ("x0", 10.0, "p0"), (let("vm", "mul", "x0", "x1"),), "vm"),),
                    "vt",
                ),
            ),
            "vs",
        ),
        ((2.0, INF),),
        ((41.0, 11.0),),
        2,
    ),
    Case(
        "an isolation in the body of a sum and in that of an integral",
        program(
            1,
            (
                sum_over(
                    "vs",
                    "x3",
                    ("p0", 0.5),
                    (
                        integrate(
                            "vi",
                            "x2",
                            0.0,
                            "x3",
                            (isolate("vr0 vr1", line("x3", "x2"), 0.0, 2.0), sum_over("vt", "x1", ("vr0", "vr1"), (), "x1")),
                            "vt",
                        ),
                    ),
                    "vi",
                ),
            ),
            "vs",
        ),
        ((1.0, INF),),
        ((0.625, 0.125),),
        2,
    ),
    Case(
        "roots as the breaks of an inner integral",
        program(1, TRIANGLE, "varea", "vmoment"),
        ((1.0, 2.0),),
        ((0.5, 2.0), (0.125, 2.0)),
        2,
        4e-15,
    ),
    Case(
        "ties in the body of a sum: met at finite points only",
        program(
            2,
            (
                sum_over(
                    "vs",
                    "x0",
                    ("p0", "p1"),
                    (
                        let("vg", "sub", "x0", 1.0),
                        let("bg", "tie", "vg", 1.0, True, 0),
                        let("vj", "select", "bg", "x0", 0.0),
                    ),
                    "vj",
                ),
            ),
            "vs",
            ties=1,
        ),
        ((1.0, 2.0, INF), (3.0, INF, 0.5)),
        ((3.5, 2.0, 0.0),),
        3,
        ties=(0,),
    ),
)

EXTREMES = (
    operation(
        "min", ("p0", "p1"), ((1.0, 2.0, NAN, 1.0, NAN, INF, -INF), (2.0, 1.0, 1.0, NAN, NAN, 3.0, NAN)), (1, 1, NAN, NAN, NAN, 3, NAN), 7
    ),
    operation(
        "max", ("p0", "p1"), ((1.0, 2.0, NAN, 1.0, NAN, INF, INF), (2.0, 1.0, 1.0, NAN, NAN, 3.0, NAN)), (2, 2, NAN, NAN, NAN, INF, NAN), 7
    ),
    operation("min", ("p0", 2.0), ((1.0, 3.0, NAN),), (1.0, 2.0, NAN), 3),
    operation("max", (-1.5, "p0"), ((-2.0, 3.0, NAN),), (-1.5, 3.0, NAN), 3),
)

ISOLATE_CASES = (*EXTREMES, *ROOTS, *SUMS)
