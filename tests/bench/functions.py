"""What functions that are compiled by themselves save and cost: swapping a shader, and the time of a call."""

from __future__ import annotations

import time

import numpy as np

import teg
from teg.ir.expr import Expr, Param
from teg.ir.function import Function
from tests.bench.rows import Row, empty_cache
from tests.bench.scenes import shaded_brackets

SWAPS = 4


def swap_rows(n: int = 90) -> list[Row]:
    """From expressions to kernels of value and gradient, the compiler of C included, its cache empty: one shader, and then four others."""
    rows = []
    for backend in ("numpy", "c"):
        for kind in ("linked", "inlined"):
            with empty_cache():
                kept, times = [], []
                for _, e, wrt in shaded_brackets(n, SWAPS):
                    start = time.perf_counter()
                    kept.append(teg.compile(e, wrt, backend=backend, functions=kind))
                    kept[-1].kernel(1)
                    times.append(time.perf_counter() - start)
            row: Row = {
                "program": f"{n} brackets, {kind}", "backend": backend, "0 swaps, s": times[0], f"{SWAPS} swaps, s": sum(times),
                "ratio": sum(times) / times[0], "one swap, s": sum(times[1:]) / SWAPS,
            }  # fmt: skip
            rows.append(row)
    return rows


def _half_plane(shade: Function) -> tuple[Expr, list[Param]]:
    x, y = teg.vars("x y")
    t, a, b = teg.params("t a b")
    return teg.integral(teg.bracket(x + a * y < t) * (shade(x, y) - b) ** 2, (x, 0, 1), (y, 0, 1)), [t, a, b, teg.param("k")]


def call_time_rows(n: int = 1000, runs: int = 7) -> list[Row]:
    """Value and gradient by C of a shaded half-plane, linked and inlined: CPU nanoseconds an element, the least of several runs."""
    u, v, k = teg.params("u v k")
    bodies = {
        "quadratic": 1 + u * v * k + u * u - v,
        "one wave": teg.tanh(u + k * v) + teg.sin(u * v),
        "an invariant factor": teg.sin(3 * u) * teg.cos(2 * v) + k * u,
        "many functions": teg.exp(teg.sin(u) + teg.cos(v * k)) * teg.sin(u + v) + teg.tanh(u * k),
    }
    rng = np.random.default_rng(0)
    values = {name: rng.uniform(0.2, 0.8, n) for name in "tabk"}
    rows = []
    for name, body in bodies.items():
        e, wrt = _half_plane(teg.function("shade", [u, v], body))
        evaluators = {kind: teg.compile(e, wrt, backend="c", functions=kind) for kind in ("linked", "inlined")}
        times: dict[str, list[float]] = {kind: [] for kind in evaluators}
        for f in evaluators.values():
            f.value_and_grad(values)
        for _ in range(runs):
            for kind, f in evaluators.items():
                start = time.process_time()
                f.value_and_grad(values)
                times[kind].append(time.process_time() - start)
        linked, inlined = (min(times[kind]) / n * 1e9 for kind in ("linked", "inlined"))
        rows.append({"shader of a half-plane": name, "linked, ns": linked, "inlined, ns": inlined, "ratio": linked / inlined})
    return rows
