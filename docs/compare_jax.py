"""Measure what docs/jax.md says: `python docs/compare_jax.py` prints its tables, `--page docs/jax.md` writes them into the page.

Some minutes, nearly all of which XLA takes to compile derivatives of nested quadax; `--quick` leaves those out.
quadax is no requirement of this package: `pip install quadax`; without it its rows are left out, and the page is not written.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax_methods import PROBLEMS, Function, Problem, exact, marked, pieced, quadax_is_there, sampled, softened, unmarked

from teg.errors import InputError

WIDTHS = (0.1, 0.03, 0.01, 0.003, 0.001)
METHODS: dict[str, Callable[[Problem], Function]] = {
    "`jax.grad` of midpoints": sampled,
    "softened, width 0.01": lambda problem: softened(problem, 0.01),
    "quadax": unmarked,
    "quadax, breaks marked": marked,
    "quadax, one rule a piece": pieced,
    "`teg.jax_function`": exact,
}
BY_HAND = ("a step", "a half-plane")  # those whose breaks are written out for quadax
TIMED = "a half-plane"
REPEATS = 20
Rows = list[list[str]]


@dataclass(frozen=True)
class Measurement:
    """Relative error (of a derivative that is 0 throughout: 1), seconds of processors to trace and compile, and to run once."""

    error: float
    compiled: float
    warm: float


def measure(function: Function, problem: Problem, orders: int = 3) -> list[Measurement]:
    """The value and its derivatives, each compiled alone."""
    found = []
    at = jnp.float64(problem.t)
    for true in problem.derivatives[:orders]:
        begun = time.process_time()
        call = jax.jit(function).lower(at).compile()
        compiled = time.process_time() - begun
        error = abs(float(call(at)) / true - 1)
        found.append(Measurement(error, compiled, min(_once(call, at) for _ in range(REPEATS))))
        function = jax.grad(function)
    return found


def measure_all(quick: bool = False) -> dict[str, dict[str, list[Measurement]]]:
    """By method and program; quadax only where its breaks are written out, adaptive and nested without the second derivative."""
    found: dict[str, dict[str, list[Measurement]]] = {}
    for label, method in METHODS.items():
        if "quadax" not in label:
            found[label] = {p.name: measure(method(p), p) for p in PROBLEMS}
        elif quadax_is_there():
            slow = method is not pieced
            chosen = [p for p in PROBLEMS if p.name in BY_HAND and not (quick and slow and len(p.box) > 1)]
            found[label] = {p.name: measure(method(p), p, 4 - len(p.box) if slow else 3) for p in chosen}
    return found


def error_table(found: dict[str, dict[str, list[Measurement]]]) -> Rows:
    """A row a method, a column a program: errors of value, first and second derivative."""
    names = [p.name for p in PROBLEMS]
    cells = [[label, *(", ".join(error_text(m.error) for m in row.get(name, [])) or "–" for name in names)] for label, row in found.items()]
    return [["", *names], *cells]


def width_table() -> Rows:
    """What the softened triangle is off by, a row a width."""
    problem = PROBLEMS[-1]
    rows = [["width", "value", "first derivative", "second derivative"]]
    return rows + [[f"{w:g}", *(error_text(m.error) for m in measure(softened(problem, w), problem))] for w in WIDTHS]


def time_table(found: dict[str, dict[str, list[Measurement]]]) -> Rows:
    """Seconds to compile and to run, of the half-plane."""
    rows = [["", "compile: value", "first", "second", "run: value", "first", "second"]]
    for label, row in found.items():
        if TIMED in row:
            filled = [*row[TIMED], *[None] * 3][:3]
            times = [[m.compiled if m else None for m in filled], [m.warm if m else None for m in filled]]
            rows.append([label, *("–" if s is None else duration(s) for part in times for s in part)])
    return rows


def error_text(error: float) -> str:
    """One digit; "0" for a derivative that is not there, "nan" for none."""
    if error == 1:
        return "**is 0**"
    return (
        "exact"
        if error == 0
        else "nan"
        if math.isnan(error)
        else f"{error:.0e}".replace("e-0", "e-").replace("e+0", "e+").replace("e+", "e")
    )


def duration(seconds: float) -> str:
    """Two digits and a unit."""
    unit, size = next(((u, s) for u, s in (("s", 1.0), ("ms", 1e-3)) if seconds >= s), ("µs", 1e-6))
    return f"{seconds / size:.2g} {unit}" if seconds / size < 100 else f"{seconds / size:.0f} {unit}"


def markdown(rows: Rows) -> str:
    """A table, its first row the heading."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]]) + "\n"


def write_page(page: Path, tables: dict[str, Rows]) -> None:
    """Put each table between its marks. Raises InputError where the page has none."""
    text = page.read_text(encoding="utf-8")
    for name, rows in tables.items():
        begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
        if begin not in text or end not in text:
            raise InputError(f"the page {str(page)!r} has no place for {name}", None, f"it goes between the lines\n{begin}\n{end}")
        text = text[: text.index(begin)] + begin + "\n" + markdown(rows) + text[text.index(end) :]
    page.write_text(text, encoding="utf-8")


def _once(call: Any, at: Any) -> float:
    begun = time.perf_counter()
    jax.block_until_ready(call(at))
    return time.perf_counter() - begun


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables, and write them if a page is named."""
    parser = argparse.ArgumentParser(description="The tables of docs/jax.md.")
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="the page whose tables, between marks, are written anew")
    parser.add_argument("--quick", action="store_true", help="without nested quadax")
    options = parser.parse_args(arguments)
    if options.page is not None and (options.quick or not quadax_is_there()):
        raise InputError("the page has all rows, and some are missing", None, "install quadax, and leave --quick out")
    jax.config.update("jax_enable_x64", True)
    found = measure_all(options.quick)
    tables = {"errors": error_table(found), "widths": width_table(), "times": time_table(found)}
    for name, rows in tables.items():
        sys.stdout.write(f"{name}\n\n{markdown(rows)}\n")
    if not quadax_is_there():
        sys.stdout.write("quadax is not installed (pip install quadax): its rows are missing\n")
    if options.page is not None:
        write_page(options.page, tables)
    return 0


if __name__ == "__main__":
    sys.exit(main())
