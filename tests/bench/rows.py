"""What is measured: one row of a table each."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numpy as np

import teg
from teg.backends.c.kernel import compile_c
from teg.program import Program, size
from teg.symbolic import from_sympy, to_sympy
from tests.references import REFERENCES

Row = dict[str, Any]


@contextmanager
def empty_cache() -> Iterator[None]:
    """In the block nothing has been compiled before, and what is compiled is not kept."""
    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, TEG_CACHE_DIR=folder):
        yield


def median_time(action: Callable[[], object], runs: int = 7, warm: bool = False) -> float:
    """Seconds, the median; `warm`: after a run that is not counted."""
    if warm:
        action()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def compile_row(name: str, e: teg.Expr, wrt: list[Any]) -> Row:
    """Derive, eliminate, schedule; sizes."""
    start = time.perf_counter()
    gradient = teg.eliminate(teg.grad(e, wrt))
    derived = time.perf_counter() - start
    start = time.perf_counter()
    f = teg.compile(e, wrt)
    program = f.program(1)
    scheduled = time.perf_counter() - start
    return {
        "program": name,
        "parameters": len(wrt),
        "nodes": teg.size(e),
        "gradient nodes": teg.size(gradient),
        "derive + eliminate, s": derived,
        "to statements, s": scheduled,
        "statements": size(program),
    }


def triangle_pairs(n: int, order: int) -> dict[str, np.ndarray]:
    """Triangles of about 10 pixels and pixels that they cover partly, counterclockwise, in an image of 512²."""
    rng = np.random.default_rng(1)
    kept: list[np.ndarray] = []
    while sum(len(k) for k in kept) < n:
        corner = rng.integers(0, 512, (4 * n, 2)).astype(float)
        v = corner[:, None, :] + 0.5 + 10 * rng.standard_normal((4 * n, 3, 2))
        a, b, c = v[:, 0], v[:, 1], v[:, 2]
        turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        v[turn < 0] = v[turn < 0][:, ::-1]
        centre = corner + 0.5
        outside, inside = np.zeros(4 * n, bool), np.ones(4 * n, bool)
        for i in range(3):
            p, e = v[:, i], v[:, (i + 1) % 3] - v[:, i]
            at = e[:, 0] * (centre - p)[:, 1] - e[:, 1] * (centre - p)[:, 0]
            reach = 0.5 * np.abs(e).sum(1)
            outside |= at < -reach
            inside &= at > reach
        partial = ~outside & ~inside & (v.min(1) < corner + 1).all(1) & (v.max(1) > corner).all(1)
        kept.append(np.concatenate([v.reshape(-1, 6), corner], axis=1)[partial])
    rows = np.concatenate(kept)[:n]
    values = {f"{'xy'[j]}{i}": rows[:, 2 * i + j] for i in range(3) for j in range(2)}
    values |= {"left": rows[:, 6], "right": rows[:, 6] + 1, "bottom": rows[:, 7], "top": rows[:, 7] + 1}
    values |= {f"t{k}": rng.random(n) for k in range(3)}
    names = [f"c{k}" for k in range(3)] if order == 0 else [f"c{i}{k}" for i in range(3) for k in range(3)]
    return values | {name: rng.random(n) for name in names}


def evaluation_row(name: str, e: teg.Expr, wrt: list[Any], values: dict[str, np.ndarray], backend: str) -> Row:
    """Nanoseconds of value and gradient an element."""
    f = teg.compile(e, wrt, backend=backend)
    n = max(np.size(v) for v in values.values())
    f.value_and_grad(values)
    return {"program": name, "backend": backend, "elements": n, "ns an element": 1e9 * median_time(lambda: f.value_and_grad(values)) / n}


def curved_row(name: str, e: teg.Expr, wrt: list[Any], values: dict[str, float], n: int, hessian: bool) -> Row:
    """Compile, and microseconds of value, value and gradient, and Hessian an element, in C, parameters varied by a millionth."""
    start = time.perf_counter()
    f = teg.compile(e, wrt, backend="c")
    shifts = 1.0 + 1e-6 * np.random.default_rng(2).standard_normal(n)
    batch = {k: v * shifts for k, v in values.items()}
    f.value_and_grad(batch)
    row: Row = {"program": name, "derivatives": len(wrt), "compile with gradient, s": time.perf_counter() - start}
    row["value, µs"] = 1e6 * median_time(lambda: f(batch), 5) / n
    row["value and gradient, µs"] = 1e6 * median_time(lambda: f.value_and_grad(batch), 5) / n
    if hessian:
        f.hessian(batch)
        row["Hessian, µs"] = 1e6 * median_time(lambda: f.hessian(batch), 3) / n
    else:
        row["Hessian, µs"] = "-"
    return row


def kink_row(n: int, e: teg.Expr, wrt: list[Any]) -> Row:
    """Seconds from a condition of n kinks to value and gradient, NumPy."""
    start = time.perf_counter()
    f = teg.compile(e, wrt)
    centres = {f"c{i}": (i + 0.5) / n for i in range(n)}
    f.value_and_grad({"r": 0.3 * n, **centres})
    return {"kinks": n, "nodes": teg.size(e), "compile and run with gradient, s": time.perf_counter() - start}


def search_row(name: str, program: Program, columns: list[np.ndarray]) -> Row:
    """Nanoseconds of one search for roots or places, C backend."""
    n = max(c.size for c in columns)
    kernel = compile_c(program)
    found = kernel(columns, n)
    took = median_time(lambda: kernel(columns, n))
    return {"search": name, "found": f"{np.isfinite(found).sum() / n:.2f}", "ns": 1e9 * took / n}


def sympy_rows(long: teg.Expr, shared: teg.Expr) -> list[Row]:
    """Seconds to SymPy and back, and how many reference programs come back as the same expression."""
    rows: list[Row] = []
    for name, e in (("long", long), ("shared", shared)):
        start = time.perf_counter()
        s = to_sympy(e)
        there = time.perf_counter() - start
        start = time.perf_counter()
        back = from_sympy(s)
        rows.append({"program": name, "nodes": teg.size(e), "to, s": there, "back, s": time.perf_counter() - start, "same": str(back is e)})
    built = [r.build() for r in REFERENCES]
    start = time.perf_counter()
    forms = [to_sympy(e) for e in built]
    there = time.perf_counter() - start
    start = time.perf_counter()
    same = sum(from_sympy(s) is e for s, e in zip(forms, built, strict=True))
    back_time = time.perf_counter() - start
    nodes = sum(map(teg.size, built))
    return [
        *rows,
        {"program": "references", "nodes": nodes, "to, s": there, "back, s": back_time, "same": f"{same} of {len(built)}"},
    ]


def import_time() -> float:
    """Seconds of `import teg` in an interpreter of its own."""
    program = "import time; start = time.perf_counter(); import teg; print(time.perf_counter() - start)"
    runs = [subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout for _ in range(5)]
    return statistics.median(map(float, runs))
