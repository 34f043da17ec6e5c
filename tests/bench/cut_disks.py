"""A disk across the sides of its box, cut by lines: moments in closed form beside pieces."""

from __future__ import annotations

import math
import time

import numpy as np

import teg
from teg.ir.expr import Expr, Param
from tests.bench.rows import Row, median_time

COUNTS = (0, 1, 2, 3, 6)
CLOSED, PIECES = 20_000, 500
"""Elements of a batch."""


def cut_disk(lines: int) -> tuple[Expr, list[Param]]:
    """The area of a disk in the unit square, inside of so many lines: 3 parameters, and 3 a line."""
    x, y = teg.vars("x y")
    a, b, r = wrt = teg.params("a b r")
    body = teg.bracket((x - a) ** 2 + (y - b) ** 2 < r**2)
    for i in range(lines):
        p, q, c = teg.params(f"p{i} q{i} c{i}")
        body = body * teg.bracket(p * x + q * y < c)
        wrt = [*wrt, p, q, c]
    return teg.integral(body, (x, 0, 1), (y, 0, 1)), wrt


def places(lines: int, n: int) -> dict[str, np.ndarray]:
    """Disks that mostly reach over the square, and lines that mostly cut them."""
    rng = np.random.default_rng(1)
    at = {"a": rng.uniform(0.3, 0.7, n), "b": rng.uniform(0.3, 0.7, n), "r": rng.uniform(0.2, 0.6, n)}
    for i in range(lines):
        angle = rng.uniform(0.0, 2.0 * math.pi, n)
        p, q = np.cos(angle), np.sin(angle)
        at |= {f"p{i}": p, f"q{i}": q, f"c{i}": p * at["a"] + q * at["b"] + at["r"] * rng.uniform(-0.2, 0.9, n)}
    return at


def cut_disk_rows() -> list[Row]:
    """Returns a row for each number of lines."""
    rows: list[Row] = []
    for lines in COUNTS:
        e, wrt = cut_disk(lines)
        row: Row = {"lines": lines, "parameters": len(wrt)}
        for name, n, intrinsics in (("", CLOSED, True), (" by pieces", PIECES, False)):
            at = places(lines, n)
            start = time.perf_counter()
            f = teg.compile(e, wrt, backend="c", intrinsics=intrinsics)
            f.value_and_grad({name: value[0] for name, value in at.items()})
            row[f"compile{name}, s"] = time.perf_counter() - start
            row[f"value{name}, µs"] = 1e6 * median_time(lambda f=f, at=at: f(at), warm=True) / n
            row[f"value and gradient{name}, µs"] = 1e6 * median_time(lambda f=f, at=at: f.value_and_grad(at), warm=True) / n
        rows.append(row)
    return rows
