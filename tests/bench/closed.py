"""Closed forms, sums of alike terms, maxima of many lines: times to compile, and a point of value and gradient in C."""

from __future__ import annotations

import math
import time

import numpy as np

import teg
from tests.bench.rows import Row, median_time

N = 4096
x, y = teg.vars("x y")


def programs() -> dict[str, tuple[teg.Expr, list[teg.Param]]]:
    """Returns programs with their parameters."""
    t, c, a, s, m, k = teg.params("t c a s m k")
    bell = teg.exp(-(x**2) / 2) / math.sqrt(2 * math.pi)
    found = {
        "[x < t]·exp(ax)": (teg.integral(c * teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), [t, c, a]),
        "payoff, Gaussian": (teg.integral(teg.maximum(teg.exp(s * x + m) - k, 0) * bell, (x, -math.inf, math.inf)), [s, m, k]),
    }
    for n in (8, 50):
        ts, cs = ([teg.param(f"{name}{i}") for i in range(n)] for name in "tc")
        total = sum(q * teg.bracket(x < p) for p, q in zip(ts, cs, strict=True))
        found[f"{n} brackets × exp"] = teg.integral(teg.exp(a * x) * total, (x, 0, 1)), [*ts, *cs, a]
    for n in (3, 10, 30, 1000):
        rates, heights = ([teg.param(f"{name}{i}") for i in range(n)] for name in "sh")
        lines = (p * x + q for p, q in zip(rates, heights, strict=True))
        found[f"maximum of {n} lines"] = teg.integral(teg.maximum(*lines), (x, 0, 1)), [*rates, *heights]
    rates, heights = ([teg.param(f"{name}{i}") for i in range(1000)] for name in "sh")
    planes = sum(teg.integral(teg.bracket(p * x + y < q) * (x + y), (x, 0, 1), (y, 0, 1)) for p, q in zip(rates, heights, strict=True))
    found["1000 half-planes"] = planes, [*rates, *heights]
    return found


def closed_rows() -> list[Row]:
    """Returns a row a program."""
    rows: list[Row] = []
    for name, (e, parameters) in programs().items():
        n = max(64, N * 20 // max(20, len(parameters)))
        values = {p.name: v for p, v in zip(parameters, np.random.default_rng(1).uniform(0.1, 0.9, (len(parameters), n)), strict=True)}
        start = time.perf_counter()
        f = teg.compile(e, parameters, backend="c")
        f.value_and_grad({key: v[0] for key, v in values.items()})
        compiled = time.perf_counter() - start
        seconds = median_time(lambda f=f, values=values: f.value_and_grad(values), warm=True)
        rows.append({"program": name, "parameters": len(parameters), "compile, s": compiled, "value and gradient, ns": seconds / n * 1e9})
    return rows
