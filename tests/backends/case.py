"""A program written by hand with its exact values, and short ways to write it.

A column is a number (shared by the batch) or a tuple (one entry an element); `expected` has one row an output, and a row is a number where
all elements agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from teg.program import Adaptive, Arg, Assign, Bend, Gauss, Integrate, Program, Rule, Stmt, Tie

Row = float | tuple[float, ...]
NAN, INF = math.nan, math.inf
FOUR, TWO, TIGHT = Gauss(4), Gauss(2), Adaptive(1e-12)


@dataclass(frozen=True)
class Case:
    """One call: a program, its columns, and the exact outputs to a tolerance, both relative and absolute, or what computes them; the ties
    it meets, and whether it misses a tolerance of the program."""

    name: str
    program: Program
    columns: tuple[Row, ...]
    expected: tuple[Row, ...] | Callable[[], tuple[Row, ...]]
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
    reach: Arg = 0.0,
) -> Integrate:
    """An integral that watches the signs of conditions; the names of its results, and those of its estimates, are in one string each."""
    named, errors = tuple(results.split()), tuple(estimates.split())
    signs = tuple(f"v7{condition[1:]}" for condition in watch)
    body += tuple(let(sign, "select", condition, 1.0, -1.0) for sign, condition in zip(signs, watch, strict=True))
    return Integrate(
        var, lo, hi, breaks, flags, need, body, values, named, rule, when, signs, bends, base, infinite, scale, errors, reach=reach
    )


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


def columns(case: Case) -> list[np.ndarray]:
    """The columns of a case as arrays, of shape () or (n,)."""
    return [np.array(column, dtype=np.float64) for column in case.columns]


def expected(case: Case) -> np.ndarray:
    """The exact outputs of a case, (outputs, n)."""
    rows = case.expected() if callable(case.expected) else case.expected
    return np.array([np.broadcast_to(np.array(row, dtype=np.float64), (case.n,)) for row in rows])
