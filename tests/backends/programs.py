"""Programs written by hand, with exact values: every backend runs over this table.

A column is a number (shared by the batch) or a tuple (one entry an element); `expected` has one row an
output, and a row is a number where all elements agree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from teg.program import INSIDE, Adaptive, Arg, Assign, Bend, Gauss, Integrate, Program, Rule, Stmt, Tie

Row = float | tuple[float, ...]
NAN, INF = math.nan, math.inf
FOUR, TWO, TIGHT = Gauss(4), Gauss(2), Adaptive(1e-12)


@dataclass(frozen=True)
class Case:
    """One call: a program, its columns, and the exact outputs to a tolerance, both relative and absolute; the ties it meets, and whether
    it misses a tolerance of the program."""

    name: str
    program: Program
    columns: tuple[Row, ...]
    expected: tuple[Row, ...]
    n: int = 1
    tolerance: float = 2e-15
    ties: tuple[int, ...] = ()
    missed: bool = False


def program(parameters: int, body: tuple[Stmt, ...], *outputs: Arg, ties: int = 0) -> Program:
    """A program of p0, p1, …"""
    names = tuple(f"parameter {i}" for i in range(parameters))
    return Program(names, body, outputs, tuple(Tie((f"surface {k}", "the other")) for k in range(ties)))


def let(name: str, op: str, *args: Arg) -> Assign:
    return Assign(name, op, args)


def integrate(
    results: str,
    var: str,
    lo: Arg,
    hi: Arg,
    body: tuple[Stmt, ...],
    *values: Arg,
    rule: Rule = FOUR,
    breaks: tuple[Arg, ...] = (),
    flags: tuple[Stmt, ...] = (),
    need: str | None = None,
    when: str | None = None,
    watch: tuple[str, ...] = (),
    bends: tuple[Bend, ...] = (),
    base: Arg = 0.0,
    infinite: bool = False,
    scale: Arg = 1.0,
    estimates: str = "",
) -> Integrate:
    """An integral that watches the signs of conditions; the names of its results, and those of its estimates, are in one string each."""
    named, errors = tuple(results.split()), tuple(estimates.split())
    signs = tuple(f"v7{condition[1:]}" for condition in watch)
    body += tuple(let(sign, "select", condition, 1.0, -1.0) for sign, condition in zip(signs, watch, strict=True))
    return Integrate(var, lo, hi, breaks, flags, need, body, values, named, rule, when, signs, bends, base, infinite, scale, errors)


def operation(op: str, args: tuple[Arg, ...], columns: tuple[Row, ...], expected: Row, n: int = 1) -> Case:
    """One operation on the parameters, alone in a program."""
    shown = f"{op}({', '.join(map(str, args))})"
    return Case(
        f"{shown} at {columns}",
        program(len(columns), (let("v0", op, *args),), "v0"),
        columns,
        (expected,),
        n,
    )


def condition(op: str, args: tuple[Arg, ...], columns: tuple[Row, ...], expected: Row, n: int = 1) -> Case:
    """One boolean operation, read through `select`; conditions b0, b1, … are p0 > 0, p1 > 0, …"""
    body = (
        *(let(f"b{i}", "gt0", f"p{i}") for i in range(len(columns))),
        let("b9", op, *args),
        let("v0", "select", "b9", 1.0, 0.0),
    )
    shown = f"{op}({', '.join(map(str, args))})"
    return Case(f"{shown} at {columns}", program(len(columns), body, "v0"), columns, (expected,), n)


THIRDS, SEVENTHS = tuple(i / 3 for i in range(1, 6)), tuple(i / 7 for i in range(1, 6))
X, Y = ("p0",), ("p0", "p1")

OPERATIONS = (
    operation("const", (2.5,), (), 2.5),
    operation("const", (NAN,), (), NAN),
    operation("const", (-INF,), (), -INF),
    operation("add", ("p0", "p1", 0.5, "p0"), ((1.0, 2.0), 3.0), (5.5, 7.5), 2),
    operation("add", ("p0", "p1", "p2"), (1e16, 1.0, -1e16), 0.0),
    operation("add", (1.0, 2.0), (), 3.0),
    operation("sub", Y, (1.0, (4.0, -4.0)), (-3.0, 5.0), 2),
    operation("sub", ("p0", -2.0), (1.0,), 3.0),
    operation("mul", ("p0", -2.0, "p1"), (3.0, (0.5, INF)), (-3.0, -INF), 2),
    operation("mul", ("p0", "p1", "p2"), (1e200, 1e200, 1e-200), INF),
    operation("div", Y, ((1.0, -1.0, 0.0, 6.0), (0.0, 0.0, 0.0, 4.0)), (INF, -INF, NAN, 1.5), 4),
    operation("div", ("p0", "p1"), (1.0, 0.0), INF),
    operation("div", (1.0, 0.0), (), INF),
    operation("neg", X, ((1.0, -2.0),), (-1.0, 2.0), 2),
    operation("neg", (-0.5,), (), 0.5),
    operation("powi", ("p0", 0), ((3.0, 0.0),), 1.0, 2),
    operation("powi", ("p0", 1), (3.0,), 3.0),
    operation("powi", ("p0", 2), ((3.0, -3.0),), 9.0, 2),
    operation("powi", ("p0", 7), ((2.0, -2.0),), (128.0, -128.0), 2),
    operation("powi", ("p0", -2), ((2.0, 0.0),), (0.25, INF), 2),
    operation("powi", ("p0", -3), (-2.0,), -0.125),
    operation("pow", Y, ((4.0, 2.0, -1.0), (0.5, -1.0, 0.5)), (2.0, 0.5, NAN), 3),
    Case(
        "products are rounded before sums: a b - round(a b) is 0",
        program(
            4,
            (
                let("v0", "mul", "p0", "p1"),
                let("v1", "sub", "v0", "p2"),
                let("v2", "powi", "p0", 2),
                let("v3", "sub", "v2", "p3"),
                let("v4", "powi", "p0", 5),
                let("v5", "mul", "v2", "v2", "p0"),
                let("v6", "sub", "v4", "v5"),
            ),
            "v1",
            "v3",
            "v6",
        ),
        (
            THIRDS,
            SEVENTHS,
            tuple(a * b for a, b in zip(THIRDS, SEVENTHS, strict=True)),
            tuple(a * a for a in THIRDS),
        ),
        (0.0, 0.0, 0.0),
        5,
        0.0,
    ),
    operation("abs", X, ((-2.0, 3.0),), (2.0, 3.0), 2),
    operation("floor", X, ((-0.5, 1.5, 2.0),), (-1.0, 1.0, 2.0), 3),
    operation("mod", Y, ((5.5, -5.5, 5.5, -5.5), (2.0, 2.0, -2.0, -2.0)), (1.5, 0.5, -0.5, -1.5), 4),
    operation("mod", ("p0", 1.0), (-0.25,), 0.75),
    operation("sin", X, ((0.0, 0.5),), (0.0, math.sin(0.5)), 2),
    operation("cos", X, ((0.0, 0.5),), (1.0, math.cos(0.5)), 2),
    operation("tan", X, (0.5,), math.tan(0.5)),
    operation("asin", X, ((0.5, 2.0),), (math.asin(0.5), NAN), 2),
    operation("acos", X, (0.5,), math.acos(0.5)),
    operation("atan", X, ((0.5, -INF),), (math.atan(0.5), -math.pi / 2), 2),
    operation("atan2", Y, ((1.0, -1.0), (-2.0, 2.0)), (math.atan2(1, -2), math.atan2(-1, 2)), 2),
    operation("sinh", X, (0.5,), math.sinh(0.5)),
    operation("cosh", X, (0.5,), math.cosh(0.5)),
    operation("tanh", X, ((0.5, 50.0),), (math.tanh(0.5), 1.0), 2),
    operation("exp", X, ((1.0, 1000.0, -1000.0),), (math.e, INF, 0.0), 3),
    operation("log", X, ((2.0, 0.0, -1.0),), (math.log(2), -INF, NAN), 3),
    operation("expm1", X, ((1e-10, 1000.0, -1000.0),), (math.expm1(1e-10), INF, -1.0), 3),
    operation("log1p", X, ((1e-10, -1.0, -2.0),), (math.log1p(1e-10), -INF, NAN), 3),
    operation("erf", X, ((0.5, -3.0, INF, NAN),), (math.erf(0.5), math.erf(-3.0), 1.0, NAN), 4),
    operation("erfc", X, ((0.5, 10.0, -3.0, -INF),), (math.erfc(0.5), math.erfc(10.0), math.erfc(-3.0), 2.0), 4),
    operation("sqrt", X, ((2.0, -1.0),), (math.sqrt(2), NAN), 2),
    condition("gt0", X, ((1.0, 0.0, -1.0, NAN),), (1.0, 0.0, 0.0, 0.0), 4),
    condition("ge0", X, ((1.0, 0.0, -1.0, NAN),), (1.0, 1.0, 0.0, 0.0), 4),
    condition("lt0", X, ((1.0, 0.0, -1.0, NAN),), (0.0, 0.0, 1.0, 0.0), 4),
    condition("le0", X, ((1.0, 0.0, -1.0, NAN),), (0.0, 1.0, 1.0, 0.0), 4),
    condition("ok", X, ((1.0, INF, NAN),), (1.0, 1.0, 0.0), 3),
    condition("gt0", (2.0,), (), 1.0),
    condition("not", ("b0",), ((1.0, -1.0),), (0.0, 1.0), 2),
    condition("not", ("b0",), (1.0,), 0.0),
    condition("not", (True,), (), 0.0),
    condition("and", ("b0", "b1", True), ((1.0, 1.0, -1.0), (1.0, -1.0, -1.0)), (1.0, 0.0, 0.0), 3),
    condition("or", ("b0", "b1", False), ((1.0, 1.0, -1.0), (1.0, -1.0, -1.0)), (1.0, 1.0, 0.0), 3),
    condition("and", (True, False), (), 0.0),
    Case(
        "select never lets the other value through",
        program(
            1,
            (
                let("b0", "gt0", "p0"),
                let("v0", "sqrt", "p0"),
                let("v1", "div", 1.0, "p0"),
                let("v2", "select", "b0", "v0", 7.0),
                let("v3", "select", "b0", "v1", 0.0),
            ),
            "v2",
            "v3",
            -1.0,
        ),
        ((4.0, -4.0, 0.0),),
        ((2.0, 7.0, 7.0), (0.25, 0.0, 0.0), -1.0),
        3,
    ),
)

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

EXPONENTIAL = (let("v0", "mul", "p0", "x0"), let("v1", "exp", "v0"))
ADAPTIVE = (
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

CASES = (*OPERATIONS, *ONE_VARIABLE, *TWO_VARIABLES, *ADAPTIVE, *WATCHED, *TIES)


def columns(case: Case) -> list[np.ndarray]:
    """The columns of a case as arrays, of shape () or (n,)."""
    return [np.array(column, dtype=np.float64) for column in case.columns]


def expected(case: Case) -> np.ndarray:
    """The exact outputs of a case, (outputs, n)."""
    return np.array([np.broadcast_to(np.array(row, dtype=np.float64), (case.n,)) for row in case.expected])
