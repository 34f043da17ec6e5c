"""The backends beside each other: times to compile, and warm times, of value and gradient of five programs."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import teg
from teg.ir.expr import Expr, Param
from teg.ir.traverse import parameters
from tests.bench.rows import Row, empty_cache, median_time
from tests.bench.scenes import bilinear_pixel, disk, triangle_pixel

BATCH = 4096
Values = dict[str, Any]


def programs() -> dict[str, tuple[Expr, list[Param], Values]]:
    """A program, what to differentiate by, and values for a batch."""
    x, y = teg.vars("x y")
    t, a = teg.params("t a")
    random = np.random.default_rng(0)
    places = {"t": random.uniform(0.1, 0.9, BATCH), "a": random.uniform(0.1, 0.6, BATCH), "b": random.uniform(-0.3, 0.0, BATCH)}
    corners = random.uniform(-0.5, 1.5, (BATCH, 3, 2))
    clockwise = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    corners[clockwise] = corners[clockwise][:, [0, 2, 1]]
    triangle = {f"{axis}{i}": corners[:, i, k] for i in range(3) for k, axis in enumerate("xy")}
    triangle |= {"left": np.zeros(BATCH), "right": np.ones(BATCH), "bottom": np.zeros(BATCH), "top": np.ones(BATCH)}
    chosen = {
        "step": (teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), [t, a], places),
        "half-plane": (teg.integral(teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1)), [t, a], places),
        "bilinear pixel": (*bilinear_pixel(), {}),
        "triangle pixel, constant": (*triangle_pixel(0), triangle),
        "disk": (*disk(), places),
    }
    found = {}
    for name, (e, wrt, known) in chosen.items():
        at = {p.name: known[p.name] if p.name in known else random.uniform(size=BATCH) for p in parameters(e)}
        found[name] = e, wrt, at
    return found


def backend_rows() -> list[Row]:
    """From the expression to the first value and gradient, with nothing in the cache; and the time for each element of a batch, of one
    thread but for XLA's own."""
    rows = []
    for name, (e, wrt, at) in programs().items():
        row: Row = {"program": name}
        scalar = {k: float(v[0]) for k, v in at.items()}
        for backend in ("numpy", "c"):
            with empty_cache():
                start = time.perf_counter()
                f = teg.compile(e, wrt, backend=backend)
                f.value_and_grad(scalar)
                row[f"{backend}: first, s"] = time.perf_counter() - start
                row[f"{backend}: µs each"] = 1e6 * median_time(lambda f=f, at=at: f.value_and_grad(at)) / BATCH
        rows.append(row | _in_jax(e, wrt, scalar, at))
    return rows


def _in_jax(e: Expr, wrt: list[Param], scalar: Values, at: Values) -> Row:
    import jax

    with empty_cache(), jax.enable_x64(True):
        start = time.perf_counter()
        f = teg.jax_function(e, wrt)
        jax.block_until_ready(jax.jit(jax.value_and_grad(f))(scalar))
        first = time.perf_counter() - start
        many = jax.jit(jax.vmap(jax.value_and_grad(f)))
        given = {k: jax.numpy.asarray(v) for k, v in at.items()}
        return {"jax: first, s": first, "jax: µs each": 1e6 * median_time(lambda: jax.block_until_ready(many(given))) / BATCH}
