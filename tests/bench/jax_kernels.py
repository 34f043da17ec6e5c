"""Measure C, JAX with C, and JAX with XLA on five programs: python tests/bench/jax_kernels.py. About three minutes.

The processors' seconds from an expression to its first value and gradient, nothing cached; the time of a call at one point after that, and
of an element of a batch, by calls in turns: the least of REPEATS. Printed as the table of docs/how-to/in-jax.md, and what an element costs
in the graph that XLA made of the batch: operations, and bytes that kernels read and write.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
import teg
from teg.examples.auction import Values, revenue
from tests.bench.jax_references import probit
from tests.bench.rows import empty_cache

REPEATS, BATCH = 7, 1024
x, y = teg.vars("x y")
t, a = teg.params("t a")
CORNERS = teg.params("ax ay bx by cx cy")
AT = {"ax": 0.2, "ay": 0.1, "bx": 1.4, "by": 0.4, "cx": 0.3, "cy": 0.8}
Program = tuple[teg.Expr, dict[str, float], int]


def triangle(colour: Any = 1 + x + 2 * y) -> teg.Expr:
    """A pixel of a triangle with a linear colour."""
    ax, ay, bx, by, cx, cy = CORNERS
    sides = ((ax, ay, bx, by), (bx, by, cx, cy), (cx, cy, ax, ay))
    inside = [teg.bracket((qx - px) * (y - py) - (qy - py) * (x - px) > 0) for px, py, qx, qy in sides]
    return teg.integral(inside[0] * inside[1] * inside[2] * colour, (x, 0, 1), (y, 0, 1))


def programs() -> dict[str, Program]:
    """Returns programs, where they are evaluated, and the elements of a batch (1: none)."""
    disk = teg.bracket(x * x + y * y < t * t)
    return {
        "half-plane, eˣ": (teg.integral(teg.bracket(x + a * y < t) * teg.exp(x), (x, 0, 1), (y, 0, 1)), {"t": 0.3, "a": 1.2}, BATCH),
        "triangle, linear colour": (triangle(), AT, BATCH),
        "disk": (teg.integral(disk * (1 + x), (x, -1, 1), (y, -1, 1)), {"t": 0.6}, BATCH),
        "auction with a reserve": (revenue(3, Values()), {"r": 0.4}, BATCH),
        "probit in two variables": (probit(), {"t": 0.3, "a": 1.2}, 1),
    }


def batched(at: dict[str, float], n: int) -> dict[str, Any]:
    """Returns n points near one."""
    return {k: v * (1 + 0.1 * np.random.default_rng(i).uniform(-1, 1, n)) for i, (k, v) in enumerate(at.items())}


def processors() -> float:
    """Returns the seconds that processors have spent on this process and those that it has run, as a compiler."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def first(kind: str, e: teg.Expr, at: dict[str, float]) -> tuple[float, Callable[[Any], Any]]:
    """Returns the processors' seconds to the first value and gradient, and the function."""
    import jax

    wrt = [teg.param(k) for k in at]
    start = processors()
    if kind == "C":
        f = teg.compile(e, wrt, backend="c", threads=1)
        f.value_and_grad(at)
        return processors() - start, f.value_and_grad
    g = teg.jax_function(e, wrt, kernel="c" if kind == "JAX with C" else "xla")
    both = jax.jit(jax.value_and_grad(lambda p: g(p).sum()))
    jax.block_until_ready(both({k: np.float64(v) for k, v in at.items()}))
    return processors() - start, lambda p: jax.block_until_ready(both(p))


def warm(calls: dict[str, Callable[[Any], Any]], at: Any) -> dict[str, float]:
    """Returns the least seconds of each, called in turns."""
    least = dict.fromkeys(calls, np.inf)
    for _ in range(REPEATS + 1):
        for kind, call in calls.items():
            start = time.perf_counter()
            call(at)
            least[kind] = min(least[kind], time.perf_counter() - start)
    return least


def graph(e: teg.Expr, many: dict[str, Any], n: int) -> tuple[float, float]:
    """Returns the operations, and the bytes that are read and written, of an element of a batch in XLA's program."""
    import jax

    f = teg.jax_function(e, [teg.param(k) for k in many], kernel="xla")
    cost = jax.jit(jax.value_and_grad(lambda p: f(p).sum())).lower(many).compile().cost_analysis()
    return cost["flops"] / n, cost["bytes accessed"] / n


def main() -> None:
    import jax

    jax.config.update("jax_enable_x64", True)
    kinds = ("C", "JAX with C", "JAX with XLA")
    print(f"| program | {' | '.join(kinds)} |\n|---|---|---|---|")
    for name, (e, at, n) in programs().items():
        seconds, calls = {}, {}
        for kind in kinds:
            with empty_cache():
                seconds[kind], calls[kind] = first(kind, e, at)
        single = warm(calls, {k: np.float64(v) for k, v in at.items()})
        each = warm(calls, batched(at, n)) if n > 1 else {}
        cells = [f"{seconds[k]:.2g} s, {1e6 * single[k]:.0f} µs" + (f", {1e6 * each[k] / n:.2g} µs" if each else "") for k in kinds]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
        if n > 1:
            operations, moved = graph(e, batched(at, n), n)
            print(f"  {name}: {operations:.0f} operations, {moved:.0f} bytes an element", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
