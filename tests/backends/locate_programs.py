"""Programs with `Locate`, written by hand, with known answers: every backend runs over this table."""

from __future__ import annotations

import math

from teg.program import LOCATE_HALVINGS, Adaptive, Arg, Locate
from tests.backends.isolate_surfaces import numbered, sum_over
from tests.backends.locate_pairs import (
    BOTTOM,
    LEFT,
    RIGHT,
    TOP,
    Pair,
    chord,
    circle,
    corner,
    ends,
    exchanged,
    locate,
    point,
    root,
    sloped_circles,
    sloped_ends,
    sloped_wave,
    two_circles,
    wave,
)
from tests.backends.programs import INF, NAN, Case, Row, integrate, let, program

LAST = 2.0**-LOCATE_HALVINGS  # width of the last rectangles in the unit square, in v and in u
NEAR = 8 * LAST  # of places in a range of a few units

MULTIPLE = (let("vz0", "mul", 0.0, LEFT), let("vz1", "mul", 0.0, RIGHT))
ZERO = Pair(MULTIPLE, ("vz0", "vz1", "vz0", "vz1"))
SAME = Pair(circle("f", 0.0, 0.0, 1.0), ("vf0", "vf1", "vf0", "vf1"))
UPRIGHT = Pair((let("va", "sub", LEFT, 0.3), let("vb", "sub", RIGHT, 0.3)), ("va", "vb", "va", "vb"))
LEVEL = Pair((let("va", "sub", BOTTOM, 0.3), let("vb", "sub", TOP, 0.3)), ("va", "vb", "va", "vb"))


def places_of(
    name: str,
    pair: Pair,
    columns: tuple[Row, ...],
    expected: tuple[Row, ...],
    n: int = 1,
    v: tuple[Arg, Arg] = (-2.0, 3.0),
    u: tuple[Arg, Arg] = (-1.5, 1.75),
    tolerance: float = NEAR,
) -> Case:
    """The places of a pair in order, as many results as there are rows expected."""
    results = numbered(len(expected))
    return Case(name, program(len(columns), (locate(results, pair, *v, *u),), *results.split()), columns, expected, n, tolerance)


def lost_in(
    name: str,
    pair: Pair,
    columns: tuple[Row, ...],
    expected: tuple[Row, ...],
    n: int = 1,
    v: tuple[Arg, Arg] = (-2.0, 3.0),
    u: tuple[Arg, Arg] = (-1.5, 1.75),
    tolerance: float = NEAR,
) -> Case:
    """The same, and in the last row what was given up."""
    results = numbered(len(expected) - 1)
    return Case(
        name,
        program(len(columns), (locate(results, pair, *v, *u, lost="vlost"),), *results.split(), "vlost"),
        columns,
        expected,
        n,
        tolerance,
    )


PLACES = (
    places_of(
        "the ends of a circle: two, one in the rectangle, none",
        ends(0.0, 0.0, "p0"),
        ((1.0, 0.5, 2.25, 6.25, 16.0, -0.5),),
        ((-1.0, -math.sqrt(0.5), -1.5, 2.5, INF, INF), (1.0, math.sqrt(0.5), 1.5, INF, INF, INF), INF),
        6,
    ),
    places_of("g before f", exchanged(ends(0.0, 0.0, "p0")), ((1.0, 0.5),), ((-1.0, -math.sqrt(0.5)), (1.0, math.sqrt(0.5))), 2),
    places_of("the centre outside of the rectangle", ends(0.0, "p0", 1.0), ((1.8, -1.6, 1.7),), ((INF, INF, -1.0), (INF, INF, 1.0)), 3),
    places_of(
        "two circles that cross",
        two_circles("p0", "p1", "p2", "p3"),
        ((-1.0, 7.0, -1.0, 20.0), (7.0, 1.0, 7.0, 0.0), (25.0, 25.0, 25.0, 25.0), (25.0, 25.0, 1.0, 1.0)),
        ((-4.0, 3.0, INF, INF), (3.0, 4.0, INF, INF), INF),
        4,
        v=(-6.0, 5.0),
        u=(-6.5, 7.0),
        tolerance=2 * NEAR,
    ),
    places_of(
        "a tiny circle off the grid",
        ends("p0", "p1", 1e-6),
        ((0.3712, 0.7071, -1.0001), (0.2345, 0.1, 0.0003)),
        ((0.3702, 0.7061, -1.0011), (0.3722, 0.7081, -0.9991), INF),
        3,
    ),
    places_of("a circle thinner than the last rectangles", ends("p0", 0.2345, 1e-30), ((0.3712, -0.1),), ((0.3712, -0.1), INF), 2),
    places_of("a point", ends("p0", 0.2345, 0.0), ((0.3712, -0.1),), ((0.3712, -0.1), INF), 2),
    places_of("two solutions at one v are one place", chord("p0", 1.0), ((0.3, -0.8, 1.5),), ((0.3, -0.8, INF), INF), 3),
    places_of("in the middle of the rectangle", point(0.0, 0.0), (), (0.0, INF), v=(-1.0, 1.0), u=(-1.0, 1.0), tolerance=0.0),
    places_of(
        "on the border of the rectangle",
        point("p0", "p1"),
        ((0.0, 1.0, 0.0, 1.0, -1e-9), (0.0, 1.0, 1.0, 0.5, 0.5)),
        ((0.5 * LAST, 1 - 0.5 * LAST, 0.5 * LAST, 1 - 0.5 * LAST, INF), INF),
        5,
        v=(0.0, 1.0),
        u=(0.0, 1.0),
        tolerance=0.0,
    ),
    places_of(
        "many places",
        wave(math.pi, "p0"),
        ((0.3, 2.0),),
        (*((float(i), INF) for i in range(1, 17)), INF),
        2,
        v=(0.4, 16.75),
        tolerance=4 * NEAR,
    ),
    places_of(
        "as many places as results, or more",
        wave("p0", 0.3),
        ((math.pi, 5.0, 2.0),),
        ((1.0, math.pi / 5, math.pi / 2), (2.0, 2 * math.pi / 5, math.pi), (3.0, 3 * math.pi / 5, INF)),
        3,
        v=(0.4, 3.5),
    ),
    places_of("a single result", ends("p0", 0.0, 1.0), ((2.5, -2.5, 0.0),), ((1.5, -1.5, -1.0),), 3),
    lost_in("zero everywhere: both ends of what was given up", ZERO, (), (-2.0, 3.0, 1.0)),
    lost_in("zero on a circle: the coarse rectangles about it", SAME, (), (-1.0, 1.0, INF, 0.25), tolerance=0.3),
    lost_in("zero on a line of constant v: halved in v", UPRIGHT, (), (0.3, INF, INF, 0.0)),
    lost_in("zero on a line of constant u", LEVEL, (), (-2.0, 3.0, INF, 0.0), tolerance=2e-3),
    lost_in("bounds that know nothing: behind the last result all is lost", Pair((), (-INF, INF, -INF, INF)), (), (-2.0, 1.0)),
    lost_in("three zeros, two results", wave(math.pi, 0.3), (), (1.0, 2.0, 1.5 / 3.1), v=(0.4, 3.5)),
    lost_in("nothing lost", ends(0.0, 0.0, 1.0), (), (-1.0, 1.0, INF, 0.0)),
    places_of("bounds that exclude 0", Pair((), (1.0, 2.0, -1.0, 1.0)), (), (INF, INF)),
    lost_in(
        "as many rectangles as there is room for, or given up a level before",
        corner("p0", "p1"),
        (tuple(i * LAST for i in (32, 64, 64, 1, 1)), tuple(i * LAST for i in (32, 64, 66, 1, 1024))),
        ((16 * LAST, 32 * LAST, 32 * LAST, 0.5 * LAST, 0.5 * LAST), INF, 0.0),
        5,
        v=(0.0, 1.0),
        u=(0.0, 1.0),
        tolerance=0.0,
    ),
    places_of(
        "undefined on the left: the border is a place where the upper bound says nothing",
        root("p0", "p1"),
        ((1.5, 0.5, 2.5, 0.0, -1.0, 1.5), (0.3, 0.3, 0.3, 0.3, 0.3, 2.0)),
        ((2.25, 0.25, INF, 0.0, 0.0, INF), INF),
        6,
        v=(-1.0, 4.0),
    ),
    places_of("undefined everywhere in the rectangle", root(1.0, 0.3), (), (INF, INF), v=(-4.0, -1.0)),
    places_of("f is undefined", Pair((), (NAN, NAN, -1.0, 1.0)), (), (INF, INF)),
    places_of("g is undefined", Pair((), (-1.0, 1.0, NAN, NAN)), (), (INF, INF)),
    places_of("NaN in, no place out", ends("p0", "p1", "p2"), ((NAN, 0.0, 0.0), (0.0, NAN, 0.0), (1.0, 1.0, NAN)), (INF, INF), 3),
    places_of(
        "bounds of v: reversed, NaN, infinite, equal",
        point(0.25, 0.5),
        ((0.0, 1.0, NAN, 0.0, -INF, 0.0, 0.25, 0.5, 1.0), (1.0, 0.0, 1.0, NAN, 1.0, INF, 0.25, 0.75, 0.5)),
        ((0.25, 0.25, INF, INF, INF, INF, INF, INF, INF), INF),
        9,
        v=("p0", "p1"),
        u=(0.0, 1.0),
        tolerance=0.0,
    ),
    places_of(
        "bounds of u: reversed, NaN, infinite, equal",
        point(0.25, 0.5),
        ((0.0, 1.0, NAN, 0.0, -INF, 0.0, 0.5, 0.75, 0.25), (1.0, 0.0, 1.0, NAN, 1.0, INF, 0.5, 1.0, -0.5)),
        ((0.25, 0.25, INF, INF, INF, INF, INF, INF, INF), INF),
        9,
        v=(0.0, 1.0),
        u=("p0", "p1"),
        tolerance=0.0,
    ),
    places_of("far from 0, and wide", point("p0", 0.5), (1e6 + 1 / 3,), (1e6 + 1 / 3,), v=(-1e7, 1e7), tolerance=2 * NEAR),
    places_of(
        "a side that cannot be halved so often: rectangles repeat where the middle is an end",
        point("p0", 0.3),
        ((1.0 + 2.0**-52, 1.0),),
        ((1.0, 1.0), (1.0 + 2.0**-51, 1.0 + 2.0**-52)),
        2,
        v=(1.0, 1.0 + 2.0**-51),
        u=(0.0, 1.0),
        tolerance=0.0,
    ),
    lost_in(
        "with slopes: the ends of a circle, to rounding",
        sloped_ends(0.013, -0.007, "p0"),
        ((1.0, 0.5, 6.25, 16.0, -0.5),),
        ((-0.987, 0.013 - math.sqrt(0.5), 2.513, INF, INF), (1.013, 0.013 + math.sqrt(0.5), INF, INF, INF), 0.0),
        5,
        tolerance=1e-14,
    ),
    lost_in(
        "with slopes: two circles that cross, one that touches another",
        sloped_circles("p0", "p1", "p2", "p3"),
        ((-1.0, 7.0, 5.0), (7.0, 1.0, 0.0), (25.0, 25.0, 4.0), (25.0, 25.0, 9.0)),
        ((-4.0, 3.0, 2.0), (3.0, 4.0, INF), 0.0),
        3,
        v=(-6.05, 5.01),
        u=(-6.52, 7.03),
        tolerance=2 * NEAR,
    ),
    lost_in(
        "with slopes: many zeros, and more than results",
        sloped_wave(math.pi, "p0"),
        ((0.3, 2.0),),
        (*((float(i), INF) for i in range(1, 9)), (8.75 / 16.35, 0.0)),
        2,
        v=(0.4, 16.75),
        tolerance=1e-13,
    ),
    lost_in("with slopes: too many zeros to be counted", sloped_wave(700.0, 0.3), (), (INF, 1.0), v=(0.4, 3.5)),
    lost_in(
        "with slopes: a tiny circle",
        sloped_ends("p0", 0.2345, 1e-16),
        ((0.3712, -0.1),),
        ((0.37119999, -0.10000001), (0.37120001, -0.09999999), 0.0),
        2,
        tolerance=1e-14,
    ),
)

SPAN = (  # ∫ [v² < p0]·(1, √(p0 - v²)) dv over (-2, 3), broken at the ends of the circle
    locate("vr0 vr1 vr2", ends(0.0, 0.0, "p0"), -2.0, 3.0, -1.5, 1.75),
    integrate(
        "vspan varea",
        "x2",
        -2.0,
        3.0,
        (
            let("v22", "mul", "x2", "x2"),
            let("vunder", "sub", "p0", "v22"),
            let("vsafe", "max", "vunder", 0.0),
            let("vhigh2", "sqrt", "vsafe"),
        ),
        1.0,
        "vhigh2",
        rule=Adaptive(1e-10, cubic=True),
        breaks=("vr0", "vr1", "vr2"),
        flags=(let("vmm", "mul", "x2", "x2"), let("vin", "sub", "p0", "vmm"), let("bin", "gt0", "vin")),
        need="bin",
    ),
)

NESTS = (
    Case(
        "when: nothing is evaluated",
        program(
            2,
            (
                let("b0", "gt0", "p0"),
                locate("vr0 vr1", point("p1", 0.5), 0.0, 1.0, 0.0, 1.0, when="b0"),
                Locate("p1", 0.0, 0.0, 1.0, "x2l", "x2r", "x3l", "x3r", (), (0.0, "x2r", 0.0, "x3l"), ("vq0",), "b0", "vlost"),
            ),
            "vr0",
            "vr1",
            "vq0",
            "vlost",
        ),
        ((1.0, -1.0, 0.0, -1.0), (0.5, 0.5, 0.5, NAN)),
        ((0.5, INF, INF, INF), INF, (0.0, INF, INF, INF), (1.0, 0.0, 0.0, 0.0)),
        4,
    ),
    Case(
        "places as the breaks of an integral",
        program(1, SPAN, "vspan", "varea"),
        ((1.0, 0.3, 0.0, 2.25),),
        ((2.0, 2 * math.sqrt(0.3), 0.0, 3.0), (0.5 * math.pi, 0.15 * math.pi, 0.0, 1.125 * math.pi)),
        4,
        2e-7,
    ),
    Case(
        "in the body of an integral, and the places in that of a sum",
        program(
            1,
            (
                integrate(
                    "vi vj",
                    "x4",
                    0.0,
                    "p0",
                    (
                        let("v44", "mul", "x4", "x4"),
                        locate("vr0 vr1 vr2", ends("x4", 0.25, "v44"), -1.0, 5.0, -1.0, "x4"),
                        sum_over("vs vn", "x2", ("vr0", "vr1", "vr2"), (), "x2", 1.0),
                    ),
                    "vs",
                    "vn",
                    breaks=(0.25,),  # where the places, 0 and 2·x4, enter the rectangle
                ),
            ),
            "vi",
            "vj",
        ),
        ((2.0, 1.0, 0.125),),
        ((4.0 - 0.0625, 1.0 - 0.0625, 0.0), (3.5, 1.5, 0.0)),
        3,
        4e-7,
    ),
    Case(
        "an integral, a sum and a rectangle in the enclosure",
        program(
            1,
            (
                Locate(
                    0.0,
                    3.0,
                    -1.0,
                    0.75,
                    LEFT,
                    RIGHT,
                    BOTTOM,
                    TOP,
                    (
                        Locate(
                            0.0,
                            1.0,
                            0.0,
                            1.0,
                            "x2l",
                            "x2r",
                            "x3l",
                            "x3r",
                            (let("vm", "sub", "x2l", 0.5),),
                            ("vm", "x2r", 0.0, 1.0),
                            ("vi",),
                        ),
                        let("bi", "lt0", "vi"),
                        let("vp", "select", "bi", 0.0, "p0"),
                        integrate("vl", "x4", 0.0, LEFT, (let("v2t", "mul", 2.0, "x4"),), "v2t"),
                        integrate("vr", "x5", 0.0, RIGHT, (let("v2s", "mul", 2.0, "x5"),), "v2s"),
                        let("va", "sub", "vl", "vp"),
                        let("vb", "sub", "vr", "vp"),
                        sum_over("vc", "x6", (BOTTOM,), (let("vc6", "sub", "x6", 0.3),), "vc6"),
                        sum_over("vd", "x7", (TOP,), (let("vd7", "sub", "x7", 0.3),), "vd7"),
                    ),
                    ("va", "vb", "vc", "vd"),
                    ("vr0", "vr1"),
                ),
            ),
            "vr0",
            "vr1",
        ),
        ((0.25, 2.0, 9.5),),
        ((0.5, math.sqrt(2.0), INF), INF),
        3,
        NEAR,
    ),
)

LOCATE_CASES = (*PLACES, *NESTS)
