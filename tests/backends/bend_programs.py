"""Integrals with branch points, poles and singular ends: their bends and substitutions.

One program takes many places: a row of a table is one element of its batch. The values are known in closed form, here
with 40 digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import mpmath

from teg.program import Adaptive, Arg, Bend, Integrate, Program
from teg.program.dce import without_dead_code
from tests.backends.missed_programs import MISSED
from tests.backends.programs import INF, NAN, TIGHT, Case, integrate, let, program
from tests.backends.tail_programs import TAILS

NODES = TIGHT.first
"""The evaluations of a first look."""


@dataclass(frozen=True)
class Place:
    """A piece (lo, hi) and D(v) = c₀ + c₁w + c₂w², w = v - base. `extra` is added to the bend's c₀ only, `when` > 0 lets it count, `power`
    is for singular ends. `looks`: how many looks at the piece it takes, 0 if that is not known; one look has NODES evaluations."""

    name: str
    lo: float
    hi: float
    c0: float
    c1: float
    c2: float = 0.0
    base: float = 0.0
    extra: float = 0.0
    when: float = 1.0
    power: float = 0.0
    looks: int = 0

    @property
    def absent(self) -> bool:
        """Whether the bend does not count."""
        return not self.when > 0.0 or not math.isfinite(self.extra)


FIELDS = ("lo", "hi", "c0", "c1", "c2", "base", "extra", "when")
WHEN = FIELDS.index("when")


def fields_of(values: tuple[str, ...]) -> tuple[str, ...]:
    """The parameters of a program of places."""
    return (*FIELDS, "power") if "power" in values else FIELDS


def of_places(kind: str, values: tuple[str, ...], rule: Adaptive = TIGHT) -> Program:
    """∫ of these functions of D, over a place, with its bend: "root" √|D|, "inverse root" 1/√|D|, "pole" 1/D, "double pole" 1/D²,
    "power" |D|^power, "log" log|D|, "one" 1."""
    body = (
        let("vw", "sub", "x0", "p5"),
        let("vq", "mul", "p4", "vw"),
        let("vl", "add", "p3", "vq"),
        let("vm", "mul", "vl", "vw"),
        let("vd", "add", "p2", "vm"),
        let("va", "abs", "vd"),
    )
    made = {
        "root": (let("v1", "sqrt", "va"),),
        "inverse root": (let("v1", "sqrt", "va"), let("v2", "div", 1.0, "v1")),
        "pole": (let("v3", "div", 1.0, "vd"),),
        "double pole": (let("v4", "powi", "vd", -2),),
        "power": (let("v5", "pow", "va", "p8"),),
        "log": (let("v6", "log", "va"),),
        "one": (),
    }
    names: dict[str, Arg] = {"root": "v1", "inverse root": "v2", "pole": "v3", "double pole": "v4", "power": "v5", "log": "v6", "one": 1.0}
    needed = {stmt.name: stmt for value in values for stmt in made[value]}
    results = tuple(f"vr{i}" for i in range(len(values)))
    integral = integrate(
        " ".join(results),
        "x0",
        "p0",
        "p1",
        (*body, *needed.values()),
        *(names[value] for value in values),
        rule=rule,
        bends=(Bend(kind, ("vc", "p3", "p4"), "b0"),),
        base="p5",
    )
    whole = program(len(fields_of(values)), (let("vc", "add", "p2", "p6"), let("b0", "gt0", "p7"), integral), *results)
    return without_dead_code(whole)


def exact(place: Place, value: str) -> float:
    """∫ of a function of D over a place, by its antiderivative, which is the same all over a piece without zeros inside."""
    with mpmath.workdps(40):
        c0, c1, c2 = (mpmath.mpf(c) for c in (place.c0, place.c1, place.c2))
        low, high = (mpmath.mpf(v) - mpmath.mpf(place.base) for v in (place.lo, place.hi))
        if c0 + (low + high) / 2 * (c1 + c2 * (low + high) / 2) < 0 and value != "pole":
            c0, c1, c2 = -c0, -c1, -c2  # |D|
        area = _ANTIDERIVATIVES[value](c0, c1, c2, mpmath.mpf(place.power))
        return float(mpmath.re(area(high) - area(low)))


def _root(c0: mpmath.mpf, c1: mpmath.mpf, c2: mpmath.mpf, _: mpmath.mpf) -> Callable[[mpmath.mpf], mpmath.mpf]:
    if c2 == 0:
        return lambda w: 2 * (c0 + c1 * w) ** 1.5 / (3 * c1)
    gap, inverse = 4 * c2 * c0 - c1 * c1, _inverse_root(c0, c1, c2, _)

    def area(w: mpmath.mpf) -> mpmath.mpf:
        first = (2 * c2 * w + c1) * mpmath.sqrt(c0 + c1 * w + c2 * w * w) / (4 * c2)
        return first + (gap / (8 * c2) * inverse(w) if gap else 0)

    return area


def _inverse_root(c0: mpmath.mpf, c1: mpmath.mpf, c2: mpmath.mpf, _: mpmath.mpf) -> Callable[[mpmath.mpf], mpmath.mpf]:
    if c2 == 0:
        return lambda w: 2 * mpmath.sqrt(c0 + c1 * w) / c1
    if c2 < 0:
        return lambda w: -mpmath.asin((2 * c2 * w + c1) / mpmath.sqrt(c1 * c1 - 4 * c2 * c0)) / mpmath.sqrt(-c2)
    return lambda w: mpmath.log(abs(2 * mpmath.sqrt(c2 * (c0 + c1 * w + c2 * w * w)) + 2 * c2 * w + c1)) / mpmath.sqrt(c2)


def _pole(c0: mpmath.mpf, c1: mpmath.mpf, c2: mpmath.mpf, _: mpmath.mpf) -> Callable[[mpmath.mpf], mpmath.mpf]:
    if c2 == 0:
        return lambda w: mpmath.log(abs(c0 + c1 * w)) / c1
    gap = mpmath.sqrt(abs(4 * c2 * c0 - c1 * c1))
    if 4 * c2 * c0 > c1 * c1:
        return lambda w: 2 / gap * mpmath.atan((2 * c2 * w + c1) / gap)
    return lambda w: mpmath.log(abs((2 * c2 * w + c1 - gap) / (2 * c2 * w + c1 + gap))) / gap


def _double_pole(c0: mpmath.mpf, c1: mpmath.mpf, c2: mpmath.mpf, _: mpmath.mpf) -> Callable[[mpmath.mpf], mpmath.mpf]:
    if c2 == 0:
        return lambda w: -1 / (c1 * (c0 + c1 * w))
    simple, gap = _pole(c0, c1, c2, _), 4 * c2 * c0 - c1 * c1
    return lambda w: (2 * c2 * w + c1) / (gap * (c0 + c1 * w + c2 * w * w)) + 2 * c2 / gap * simple(w)


_ANTIDERIVATIVES: dict[str, Callable[..., Callable[[mpmath.mpf], mpmath.mpf]]] = {
    "root": _root,
    "inverse root": _inverse_root,
    "pole": _pole,
    "double pole": _double_pole,
    "power": lambda c0, c1, _, power: lambda w: (c0 + c1 * w) ** (power + 1) / (c1 * (power + 1)),
    "log": lambda c0, c1, *_: lambda w: 0 if c0 + c1 * w == 0 else (c0 + c1 * w) * (mpmath.log(c0 + c1 * w) - 1) / c1,
    "one": lambda *_: lambda w: w,
}


def table(
    name: str,
    kind: str,
    values: tuple[str, ...],
    places: tuple[Place, ...],
    rule: Adaptive = TIGHT,
    tolerance: float = 1e-12,
) -> Case:
    """One program over a table of places."""
    columns = tuple(tuple(getattr(place, field) for place in places) for field in fields_of(values))
    expected = tuple(tuple(exact(place, value) for place in places) for value in values)
    return Case(name, of_places(kind, values, rule), columns, expected, len(places), tolerance)


# One zero: p <= v <= q is the same piece from either side of it

ONE_ROOT = (
    Place("at p", 0.0, 1.0, 0.0, 1.0, looks=1),
    Place("at q", -1.0, 0.0, 0.0, -2.0, looks=1),
    Place("at q, the bounds reversed", 0.0, -1.0, 0.0, -2.0, looks=1),
    Place("near p", 0.0, 1.0, 1e-7, 1.0, looks=1),
    Place("near q", -1.0, 0.0, 1e-3, -1.0, looks=1),
    Place("some way off", 0.0, 1.0, 0.5, 1.0, looks=1),
    Place("far away: no bend", 0.0, 1.0, 6.0, 1.0),
    Place("a base inside the piece", -1.0, 1.0, 3.0, 3.0, base=0.0, looks=1),
    Place("a base off the zero", 1.0, 2.0, 1.0, 1.0, base=2.0, looks=1),
    Place("a coefficient that is too small for a second zero", 0.0, 1.0, 0.0, 1.0, c2=1e-15, looks=1),
    Place("at p, but not now", 0.0, 1.0, 0.0, 1.0, when=-1.0),
    Place("at p, but a coefficient is NaN", 0.0, 1.0, 0.0, 1.0, extra=NAN),
    Place("at p, but a coefficient is infinite", 0.0, 1.0, 0.0, 1.0, extra=INF),
    Place("no zero: the coefficients are those of a constant", 0.0, 1.0, 2.0, 1e-14),
)
TWO_ROOTS = (
    Place("between them", -1.0, 1.0, 1.0, 0.0, -1.0),
    Place("between them, from the middle to one", 0.0, 1.0, 1.0, 0.0, -1.0),
    Place("between them, near both", -0.999, 0.99999, 1.0, 0.0, -1.0),
    Place("beyond the right one", 1.0, 2.0, -1.0, 0.0, 1.0),
    Place("beyond the left one", -3.0, -1.0, -1.0, 0.0, 1.0),
    Place("near the right one", 1.0 + 2**-20, 2.0, -1.0, 0.0, 1.0),
    Place("near the left one, the bounds reversed", -1.0 - 2**-20, -1.5, -1.0, 0.0, 1.0),
    Place("two zeros close to each other, beyond them", 2.0**-10, 1.0, -(2.0**-20), 0.0, 1.0),
    Place("complex, near", -1.0, 1.0, 1e-4, 0.0, 1.0),
    Place("complex, very near, and not in the middle", -1.0, 2.0, 1e-10, 0.0, 1.0, base=0.5),
    Place("complex, far away: no bend", 0.0, 1.0, 30.0, 0.0, 1.0),
    Place("a double zero at p is none", 0.0, 1.0, 0.0, 0.0, 1.0),
    Place("between them, but not now", -1.0, 1.0, 1.0, 0.0, -1.0, when=0.0),
    Place("between them, but a coefficient is NaN", -1.0, 1.0, 1.0, 0.0, -1.0, extra=NAN),
)
INSIDE_PLACES = (
    Place("a little inside of p", 0.0, 1.0, -(2.0**-31), 1.0),
    Place("a little inside of q", 0.0, 1.0, 1.0 - 2.0**-31, -1.0),
    Place("two, a little inside of either end", -1.0 - 2.0**-31, 1.0 + 2.0**-32, 1.0, 0.0, -1.0),
    Place("two, one of them a little inside of p", 1.0 - 2.0**-31, 3.0, -1.0, 0.0, 1.0),
    Place("two, one of them a little inside of q", -4.0, -1.0 + 2.0**-31, -1.0, 0.0, 1.0),
    Place("two close to each other, a little inside of p", 1.0, 2.0, (1.0 + 2.0**-31) ** 2 - 2.0**-72, -2.0 - 2.0**-30, 1.0),
    Place("well inside", -1.0, 1.0, -0.3, 1.0),
    Place("inside of p, and more than a little", 0.0, 1.0, -1e-6, 1.0),
    Place("two, well inside", -2.0, 2.0, 1.0, 0.0, -1.0),
    Place("two, one of them well inside", 0.0, 2.0, 1.0, 0.0, -1.0),
)
"""Zeros inside a piece, that the breaks have missed."""
FAR_BASE = (
    Place("one zero, a million away", 1e6, 1e6 + 1.0, 0.0, 1.0, base=1e6),
    Place("between two zeros, a million away", 1e6 - 1.0, 1e6 + 1.0, 1.0, 0.0, -1.0, base=1e6),
    Place("complex zeros, a million away", 1e6 - 1.0, 1e6 + 1.0, 1e-4, 0.0, 1.0, base=1e6),
)
POLES = (
    Place("left of p", 0.0, 1.0, 1e-2, 1.0),
    Place("right of q", -1.0, 0.0, 1e-2, -1.0),
    Place("right of q, negative", -1.0, 0.0, -1.0, 1.0),
    Place("far away: no bend", 0.0, 1.0, 9.0, 1.0),
    Place("two, the nearer one is left of p", 0.0, 1.0, 0.02, 0.3, 1.0),
    Place("two, one on either side", 0.0, 1.0, 0.011, 1.09, -1.0),
    Place("complex", -1.0, 1.0, 1e-2, 0.0, 1.0),
    Place("complex, nearer", -1.0, 1.0, 1e-8, 0.0, 1.0),
    Place("left of p, but not now", 0.0, 1.0, 1e-2, 1.0, when=-1.0),
)
ENDS = (
    Place("x^0.3 at p", 0.0, 1.0, 0.0, 1.0, power=0.3),
    Place("x^-0.5 at q", -2.0, 0.0, 0.0, -1.0, power=-0.5),
    Place("x^1.7 at p", 0.0, 1.0, 0.0, 3.0, power=1.7),
    Place("not at an end", 0.0, 1.0, 1e-3, 1.0, power=0.3),
    Place("far away", 0.0, 1.0, 5.0, 1.0, power=-0.3),
)

BENT_ROOTS = tuple(place for place in ONE_ROOT if not place.absent)
BENT_SQUARES = tuple(place for place in TWO_ROOTS if not place.absent and "double" not in place.name)
LOGARITHMS = tuple(replace(place, power=0.0) for place in ENDS)
PLACES = (
    (table("√ of one branch point", "root", ("root", "one"), ONE_ROOT), ONE_ROOT),
    (table("1/√ of one branch point", "root", ("inverse root", "root"), BENT_ROOTS), BENT_ROOTS),
    (table("√ of two branch points", "root", ("root", "one"), TWO_ROOTS, tolerance=4e-12), TWO_ROOTS),
    (table("1/√ of two branch points", "root", ("inverse root", "root"), BENT_SQUARES), BENT_SQUARES),
    (table("a base far away", "root", ("root", "one"), FAR_BASE, Adaptive(1e-8), 1e-10), FAR_BASE),
    (table("poles", "pole", ("pole", "one"), POLES), POLES),
    (table("double poles", "pole", ("double pole", "one"), POLES), POLES),
    (table("powers at ends", "end", ("power", "one"), ENDS), ENDS),
    (table("logarithms at ends", "end", ("log", "one"), LOGARITHMS, Adaptive(1e-8), 1e-8), LOGARITHMS),
)
"""The programs of one bend, with the rows of their batches."""

# Several bends, tails


def _two_values(results: str, lo: Arg, hi: Arg, bends: tuple[Bend, ...], rule: Adaptive = TIGHT) -> Integrate:
    """∫ √(x - p0)·√(p1 - x) and ∫ 1/(√…·√…) dx."""
    body = (
        let("v0", "sub", "x0", "p0"),
        let("v1", "sub", "p1", "x0"),
        let("v2", "sqrt", "v0"),
        let("v3", "sqrt", "v1"),
        let("v4", "mul", "v2", "v3"),
        let("v5", "div", 1.0, "v4"),
    )
    return integrate(results, "x0", lo, hi, body, "v4", "v5", rule=rule, bends=bends)


def _half_disc(lo: float, hi: float, a: float, b: float) -> tuple[float, float]:
    """∫ √((x - a)(b - x)) and ∫ 1/√((x - a)(b - x)) over (lo, hi) within (a, b)."""
    centre, r = (a + b) / 2, (b - a) / 2
    t = [math.asin((v - centre) / r) for v in (lo, hi)]
    return r * r / 2 * (t[1] - t[0] + (math.sin(2 * t[1]) - math.sin(2 * t[0])) / 2), t[1] - t[0]


_LEFT, _RIGHT = Bend("root", ("v10", 1.0, 0.0)), Bend("root", ("p1", -1.0, 0.0))
_SPANS = ((0.0, 1.0), (0.0, 1.5), (-0.5, 1.0), (-(2.0**-10), 1.0), (-1.0, 1.0 + 2.0**-10))
TWO_BENDS = Case(
    "two bends on (0, 1): at both ends, at one of them, the nearer one counts",
    program(2, (let("v10", "neg", "p0"), _two_values("v8 v9", 0.0, 1.0, (_LEFT, _RIGHT))), "v8", "v9"),
    (tuple(a for a, _ in _SPANS), tuple(b for _, b in _SPANS)),
    tuple(zip(*(_half_disc(0.0, 1.0, a, b) for a, b in _SPANS), strict=True)),
    len(_SPANS),
    1e-12,
)

BALL = Case(
    "the volume of a half ball: the bend of its chords depends on the outer variable, and a flag lets it count",
    program(
        1,
        (
            let("v0", "sqrt", "p0"),
            let("v1", "neg", "v0"),
            integrate(
                "v9",
                "x1",
                "v1",
                "v0",
                (
                    let("v2", "powi", "x1", 2),
                    let("v3", "sub", "p0", "v2"),
                    let("v4", "sqrt", "v3"),
                    let("v5", "neg", "v4"),
                    integrate(
                        "v8",
                        "x0",
                        "v5",
                        "v4",
                        (let("v6", "powi", "x0", 2), let("v7", "sub", "v3", "v6"), let("v10", "abs", "v7"), let("v11", "sqrt", "v10")),
                        "v11",
                        rule=TIGHT,
                        flags=(let("v12", "powi", "x0", 2), let("v13", "sub", "v3", "v12"), let("b0", "gt0", "v13")),
                        need="b0",
                        bends=(Bend("root", ("v3", 0.0, -1.0), "b0"),),
                    ),
                ),
                "v8",
                rule=Adaptive(1e-11),
            ),
        ),
        "v9",
    ),
    ((1.0, 4.0),),
    ((2 * math.pi / 3, 16 * math.pi / 3),),
    2,
    1e-11,
)


BENT = (*(case for case, _ in PLACES), TWO_BENDS, BALL, *TAILS, *MISSED)
"""Every program with exact values of this file, and of those of tails and of missed tolerances."""
