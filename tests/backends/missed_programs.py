"""Integrals whose tolerance is missed or that diverge, and estimates of their errors."""

from __future__ import annotations

import math
from typing import Any

from teg.program import Adaptive, Arg, Bend, Gauss, Program, Stmt
from tests.backends.programs import INF, NAN, TIGHT, Case, Row, integrate, let, program


def _missed(
    name: str,
    body: tuple[Stmt, ...],
    values: tuple[Arg, ...],
    expected: tuple[Row, ...],
    columns: tuple[tuple[float, ...], ...] = (),
    bounds: tuple[float, float] = (0.0, 1.0),
    tolerance: float = 1e-12,
    missed: bool = True,
    **options: Any,
) -> Case:
    """∫ values over the bounds, to a tolerance that is missed, or nearly."""
    results = tuple(f"vr{i}" for i in range(len(values)))
    integral = integrate(" ".join(results), "x0", *bounds, body, *values, **{"rule": TIGHT, **options})
    n = max(map(len, columns), default=1)
    return Case(name, program(len(columns), (integral,), *results), columns, expected, n, tolerance, missed=missed)


_C = 0.3
_POWER = (let("v0", "pow", "x0", "p0"),)
MISSED = (
    _missed(
        "1/√|x - 0.3|, no bend, no break: nearly right, and missed",
        (let("v0", "sub", "x0", _C), let("v1", "abs", "v0"), let("v2", "sqrt", "v1"), let("v3", "div", 1.0, "v2")),
        ("v3",),
        (2 * (math.sqrt(_C) + math.sqrt(1 - _C)),),
        tolerance=1e-7,
    ),
    _missed(
        "1/x over (0, 1) is +inf, -1/x² is -inf, 1 beside them is 1",
        (let("v0", "div", 1.0, "x0"), let("v1", "powi", "x0", -2), let("v2", "neg", "v1")),
        ("v0", "v2", 1.0),
        (INF, -INF, 1.0),
    ),
    _missed("1/x over (1, 0) is -inf", (let("v0", "div", 1.0, "x0"),), ("v0",), (-INF,), bounds=(1.0, 0.0)),
    _missed(
        "1/x with its pole at the end known is no better",
        (let("v0", "div", 1.0, "x0"),),
        ("v0",),
        (INF,),
        bends=(Bend("pole", (0.0, 1.0, 0.0)),),
    ),
    _missed(
        "x^p0 with its singular end known is right",
        _POWER,
        ("v0",),
        ((10.0, 2.0, 1.0, 1 / 1.1),),
        ((-0.9, -0.5, 0.0, 0.1),),
        bends=(Bend("end", (0.0, 1.0, 0.0)),),
        rule=Adaptive(1e-7),
        missed=False,
        tolerance=1e-7,
    ),
    _missed("x^-0.9 with nothing known is called divergent", _POWER, ("v0",), (INF,), ((-0.9,),), rule=Adaptive(1e-7)),
    _missed("x^-1.5 diverges whatever is known", _POWER, ("v0",), (INF,), ((-1.5,),), bends=(Bend("end", (0.0, 1.0, 0.0)),)),
    _missed(
        "a jump to a NaN is no divergence; what is not a number is not missed",
        (let("v0", "sub", "x0", 0.25), let("b0", "gt0", "v0"), let("v1", "select", "b0", 1.0, NAN)),
        ("v1",),
        (NAN,),
        missed=False,
    ),
    _missed(
        "a watched jump is followed to WATCH_WIDTH and not missed",
        (let("v0", "sub", "p0", "x0"), let("b0", "gt0", "v0"), let("v1", "select", "b0", 1.0, 0.0)),
        ("v1",),
        ((1 / 3, 0.1),),
        ((1 / 3, 0.1),),
        watch=("b0",),
        missed=False,
    ),
)
RESTLESS = program(  # ∫ sin(p0·x) dx, and ∫ [sin(p0·x) > 0] dx watched, over (0, 1)
    1,
    (
        integrate("v8", "x0", 0.0, 1.0, (let("v0", "mul", "p0", "x0"), let("v1", "sin", "v0")), "v1", rule=TIGHT),
        integrate(
            "v9",
            "x1",
            0.0,
            1.0,
            (let("v2", "mul", "p0", "x1"), let("v3", "sin", "v2"), let("b0", "gt0", "v3"), let("v4", "select", "b0", 1.0, 0.0)),
            "v4",
            rule=Adaptive(1e-9),
            watch=("b0",),
        ),
    ),
    "v8",
    "v9",
)

# Estimates

_WAVE = (let("v0", "mul", "p0", "x0"), let("v1", "sin", "v0"), let("v2", "sqrt", "x0"), let("v3", "exp", "v0"))


def estimated(rule: Adaptive | Gauss, estimates: int) -> Program:
    """∫ sin(p0·x), exp(p0·x) and √x over (0, 1), the first of them with estimates, which are the last outputs."""
    results, errors = "v7 v8 v9", " ".join(f"ve{i}" for i in range(estimates))
    integral = integrate(results, "x0", 0.0, 1.0, _WAVE, "v1", "v3", "v2", rule=rule, estimates=errors)
    return program(1, (integral,), *results.split(), *errors.split())


def of_waves(p: float) -> tuple[float, float, float]:
    """The values of `estimated`."""
    return (1 - math.cos(p)) / p, math.expm1(p) / p, 2 / 3
