"""Check `teg.jax_function(kernel="xla")` on every reference, and measure how long programs take to compile; about ten minutes:

    python tests/bench/jax_references.py [--every N] [--only ID …] [--double] [--options] [--json FILE]

Value and gradient, by `jax.jit(jax.value_and_grad(f))`: in double precision against the exact digits and against the C backend (NumPy's
where there is no compiler), and in single precision, with JAX's 64-bit mode off, against the double ones at the rounded parameters. Errors
are relative to max(1, |exact|). A reference's own tolerance holds for double precision, 1e-4 for single; exit 1 where one is missed.

Printed too: the seconds until the first value and gradient (tracing and compiling, without JAX's cache on disk), and which programs need
more than FIRST. Some programs without references stand behind them, in `PROGRAMS`: a probit in two variables, the auction, the field of a
plate with a pole in it, the distance from a box, a flower, and a pinwheel.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
import teg
from teg.examples.auction import Values, revenue
from tests.references import REFERENCES

SINGLE = 1e-4
FIRST = 5.0
"""Seconds that a program may take to its first value and gradient."""
EXACT = "c" if any(map(shutil.which, ("cc", "gcc", "clang"))) else "numpy"


class Problem(NamedTuple):
    """A program at a point; `digits` are the exact value ("") and derivatives, of those that are known."""

    id: str
    build: Callable[[], teg.Expr]
    params: dict[str, float]
    digits: dict[str, str]
    tolerance: float


def probit() -> teg.Expr:
    """The probability of a half-plane under a normal distribution in the plane."""
    x, y = teg.vars("x y")
    t, a = teg.params("t a")
    bell = teg.exp(-(x * x + y * y) / 2) / (2 * math.pi)
    return teg.integral(teg.bracket(a * x + y < t) * bell, (x, -math.inf, math.inf), (y, -math.inf, math.inf))


def about_a_centre(kind: str) -> teg.Expr:
    """An integral over the unit square of what is seen from the point (a, b)."""
    x, y = teg.vars("x y")
    a, b, t = teg.params("a b t")
    u, v = x - a, y - b
    angle = teg.atan2(v, u)
    match kind:
        case "field":
            body = v / (u * u + v * v)
        case "box":
            outside = [teg.maximum(teg.abs(d) - half, 0) for d, half in ((u, 0.2), (v, 0.1))]
            body = teg.bracket(teg.sqrt(outside[0] ** 2 + outside[1] ** 2) < t)
        case "flower":
            body = teg.bracket(teg.sqrt(u * u + v * v) < 0.4 + t * teg.sin(3 * angle))
        case _:
            body = x * teg.bracket(teg.mod(angle, 1.0) < t)
    return teg.integral(body, (x, 0, 1), (y, 0, 1))


CENTRE = {"a": 0.4, "b": 0.3}
PROGRAMS = (
    Problem("probit", probit, {"t": 0.3, "a": 1.2}, {}, 1e-8),
    Problem("auction", lambda: revenue(3, Values()), {"r": 0.4}, {}, 1e-11),
    Problem("field", lambda: about_a_centre("field"), CENTRE, {}, 1e-8),
    Problem("box", lambda: about_a_centre("box"), {**CENTRE, "t": 0.15}, {}, 1e-11),
    Problem("flower", lambda: about_a_centre("flower"), {**CENTRE, "t": 0.1}, {}, 1e-8),
    Problem("pinwheel", lambda: about_a_centre("pinwheel"), {**CENTRE, "t": 0.3}, {}, 1e-11),
)


def problems() -> Iterator[Problem]:
    """Yields the references, then the other programs."""
    for r in REFERENCES:
        yield Problem(r.id, r.build, r.params, {"": r.value, **r.grad}, r.tolerance)
    yield from PROGRAMS


def distance(found: float, wanted: float) -> float:
    """Relative to max(1, |wanted|); 0 where both are the same infinity or no number."""
    if found == wanted or (math.isnan(found) and math.isnan(wanted)):
        return 0.0
    return abs(found - wanted) / max(1.0, abs(wanted)) if math.isfinite(wanted) else math.inf


class Measured(NamedTuple):
    """Value ("") and derivatives; seconds until they were there for the first time, of which XLA took `compile`, and of a call after that;
    seconds of processors; operations in the graph that XLA is given."""

    found: dict[str, float]
    first: float
    compile: float
    call: float
    processor: float
    operations: int


def evaluated(e: teg.Expr, at: dict[str, Any], options: bool) -> Measured:
    """Returns the value and the gradient of a program, and what they cost; with `options`, those of the function for XLA."""
    import jax

    start, begun = time.perf_counter(), time.process_time()
    f = teg.jax_function(e, [teg.param(k) for k in at], kernel="xla")
    lowered = jax.jit(jax.value_and_grad(f) if at else lambda p: (f(p), {})).lower(at)
    traced = time.perf_counter()
    compiled = lowered.compile(compiler_options=f.compiler_options if options else None)
    seconds = time.perf_counter() - traced
    jax.block_until_ready(compiled(at))
    first, processor = time.perf_counter() - start, time.process_time() - begun
    start = time.perf_counter()
    value, slopes = jax.block_until_ready(compiled(at))
    call = time.perf_counter() - start
    operations = lowered.as_text().count("stablehlo.")
    return Measured({"": float(value), **{k: float(v) for k, v in slopes.items()}}, first, seconds, call, processor, operations)


def checked(problem: Problem, double: bool, options: bool) -> dict[str, Any]:
    """Returns one row: the largest errors, and what the program cost in double precision."""
    import jax

    e, names = problem.build(), [teg.param(k) for k in problem.params]
    exact = teg.compile(e, names, backend=EXACT, inaccurate="ignore")
    with jax.enable_x64(True):
        measured = evaluated(e, {k: np.float64(v) for k, v in problem.params.items()}, options)
    found = measured.found
    same = {"": exact(problem.params), **exact.grad(problem.params)}
    row = {
        "id": problem.id,
        "double": max((distance(found[k], float(v)) for k, v in (problem.digits or same).items())),
        "against C": max(distance(found[k], float(v)) for k, v in same.items()),
        "single": 0.0,
        **{name: getattr(measured, name) for name in Measured._fields[1:]},
        "tolerance": problem.tolerance,
    }
    if double:
        return row
    rounded = {k: np.float32(v) for k, v in problem.params.items()}
    with jax.enable_x64(False):
        single = evaluated(e, rounded, options).found
    near = {"": exact(rounded), **exact.grad(rounded)}
    return row | {"single": max(distance(single[k], float(v)) for k, v in near.items())}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only each N-th program")
    parser.add_argument("--only", nargs="*", metavar="ID", help="these programs")
    parser.add_argument("--double", action="store_true", help="leave single precision out")
    parser.add_argument("--options", action="store_true", help="compile with the function's compiler_options")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    rows = []
    for problem in [p for p in problems() if not options.only or p.id in options.only][:: options.every]:
        row = checked(problem, options.double, options.options)
        rows.append(row)
        missed = row["double"] > row["tolerance"] or row["single"] > SINGLE
        if missed or row["first"] > FIRST:
            print(f"{'missed' if missed else 'slow'}: {row}", flush=True)
        if options.json:
            options.json.write_text(json.dumps(rows, indent=1))
    missed = [r["id"] for r in rows if r["double"] > r["tolerance"] or r["single"] > SINGLE]
    print(f"{len(rows) - len(missed)} of {len(rows)} programs")
    for name in ("double", "against C", "single"):
        worst = max(rows, key=lambda r: r[name])
        print(f"{name}: worst {worst[name]:.2g} ({worst['id']})")
    for name in ("first", "compile", "processor", "operations"):
        ordered = sorted(rows, key=lambda r: r[name])
        most = ", ".join(f"{r['id']} {r[name]:.5g}" for r in ordered[:-8:-1])
        print(f"{name}: median {ordered[len(rows) // 2][name]:.3g}, all {sum(r[name] for r in rows):.4g}, most {most}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
