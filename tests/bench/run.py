"""Measure: `make bench`. Medians of several runs; compare ratios of one run only, machines are noisy.

python tests/bench/run.py [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
import teg
from teg.program import size
from tests.bench.scenes import half_planes, heavisides, triangle_pixel

Row = dict[str, Any]


def median_time(action: Callable[[], object], runs: int = 7) -> float:
    """Seconds, the median."""
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


def table(rows: list[Row]) -> str:
    """Rows as Markdown."""
    heads = list(rows[0])
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for row in rows:
        cells = [f"{row[h]:.3g}" if isinstance(row[h], float) else str(row[h]) for h in heads]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Print the tables; write them as JSON too if asked to."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--json", type=Path)
    chosen = arguments.parse_args()
    compiled = [
        compile_row("triangle-pixel, constant colour", *triangle_pixel(0)),
        compile_row("triangle-pixel, linear colour", *triangle_pixel(1)),
        compile_row("12 half-planes", *half_planes(12)),
        *(compile_row(f"{n} Heavisides", *heavisides(n)) for n in (10, 100, 1000)),
    ]
    evaluated = []
    for order, colour in ((0, "constant"), (1, "linear")):
        for backend, n in (("c", 20_000), ("numpy", 2_000)):
            e, wrt = triangle_pixel(order)
            evaluated.append(evaluation_row(f"triangle-pixel, partial cover, {colour}", e, wrt, triangle_pairs(n, order), backend))
    x = teg.var("x")
    t = teg.param("t")
    scalar = teg.compile(teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), [t], backend="c")
    call = median_time(lambda: [scalar(t=0.5) for _ in range(1000)]) / 1000
    sys.stdout.write(table(compiled) + "\n\n" + table(evaluated) + f"\n\none scalar call, C backend: {1e6 * call:.1f} µs\n")
    if chosen.json:
        machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": os.cpu_count()}
        chosen.json.write_text(json.dumps({"machine": machine, "compile": compiled, "evaluate": evaluated, "call": call}, indent=1))


if __name__ == "__main__":
    main()
