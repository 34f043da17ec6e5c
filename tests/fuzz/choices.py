"""Random choices among rows of data, beside the same written out for each row, and beside NumPy on a grid.

    python -m tests.fuzz.choices -n 50                # seeds 0 to 49, in NumPy and C in turn

A program with data is followed along edges, or cut into cells; written out, it has surfaces and no data. Both are compiled here, so a
third answer comes from NumPy, which evaluates the same formulas at the middles of small squares.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import and_, or_
from random import Random
from typing import Any

import numpy as np

import teg

Row = Callable[[int], Any]
Formula = Callable[[Any, Any, Any, Row], Any]
"""Of functions (those of teg, or of NumPy), the place u, v, and a row: its number or condition there."""

x, y = teg.vars("x y")
D, k, t = teg.array("D", 2), teg.index("k"), teg.param("t")
ALL = (k, 0, teg.length(D, 0))
SIDE = 800
"""Squares along a side of the grid."""


@dataclass(frozen=True)
class Family:
    """A formula of rows, and the range of each of their numbers."""

    ranges: Sequence[tuple[float, float]]
    of: Formula

    def rows(self, n: int, generator: np.random.Generator) -> np.ndarray:
        low, high = np.array(self.ranges).T
        return generator.uniform(low, high, (n, len(low)))


def _squares(u: Any, v: Any, d: Row) -> Any:
    return (u - d(0)) ** 2 + (v - d(1)) ** 2


PLACE = ((0.0, 1.0), (0.0, 1.0))
REGIONS = {
    "half-plane": Family([(-1, 1), (-1, 1), (-0.3, 0.6)], lambda m, u, v, d: d(0) * u + d(1) * v < d(2)),
    "disk": Family([*PLACE, (0.1, 0.5)], lambda m, u, v, d: _squares(u, v, d) < d(2) ** 2),
    "outside of a disk": Family([*PLACE, (0.5, 0.9)], lambda m, u, v, d: _squares(u, v, d) > d(2) ** 2),
    "disk by its distance": Family([*PLACE, (0.1, 0.4)], lambda m, u, v, d: m.sqrt(_squares(u, v, d)) < d(2)),
    "level of a bell": Family([*PLACE, (0.8, 0.97)], lambda m, u, v, d: m.exp(-_squares(u, 1.5 * v, d)) > d(2)),
    "ellipse": Family([*PLACE, (4, 30), (4, 30)], lambda m, u, v, d: d(2) * (u - d(0)) ** 2 + d(3) * (v - d(1)) ** 2 < 1),
    "ellipse that leans": Family(
        [*PLACE, (6, 20), (-5, 5), (6, 20)],
        lambda m, u, v, d: d(2) * (u - d(0)) ** 2 + d(3) * (u - d(0)) * (v - d(1)) + d(4) * (v - d(1)) ** 2 < 1,
    ),
    "hyperbola": Family([*PLACE, (-0.1, 0.1)], lambda m, u, v, d: (u - d(0)) * (v - d(1)) > d(2)),
    "two quadrants": Family([*PLACE], lambda m, u, v, d: (u - d(0)) * (v - d(1)) > 0),
    "band": Family([(-1, 1), (-1, 1), (-0.5, 0.5), (0.02, 0.3)], lambda m, u, v, d: abs(d(0) * u + d(1) * v - d(2)) < d(3)),
    "strip": Family([(-0.1, 0.9), (0.05, 0.3)], lambda m, u, v, d: (u > d(0)) & (u < d(0) + d(1))),
    "below a parabola": Family([(-0.3, 0.6), (-1, 1), (-1, 1)], lambda m, u, v, d: v < d(0) + d(1) * u + d(2) * u**2),
    "square": Family([*PLACE, (0.05, 0.35)], lambda m, u, v, d: m.maximum(abs(u - d(0)), abs(v - d(1))) < d(2)),
    "part of a disk": Family(
        [*PLACE, (0.2, 0.5), (-1, 1), (-1, 1), (-0.2, 0.6)],
        lambda m, u, v, d: (_squares(u, v, d) < d(2) ** 2) & (d(3) * u + d(4) * v < d(5)),
    ),
}
KEYS = {
    "square of a distance": Family([*PLACE], lambda m, u, v, d: _squares(u, v, d)),
    "with a weight": Family([*PLACE, (0.5, 2)], lambda m, u, v, d: d(2) * _squares(u, v, d)),
    "distance": Family([*PLACE], lambda m, u, v, d: m.sqrt(_squares(u, v, d))),
    "distance and number": Family([*PLACE, (0, 0.25)], lambda m, u, v, d: m.sqrt(_squares(u, v, d)) - d(2)),
    "affine": Family([(-1, 1), (-1, 1), (-0.3, 0.3)], lambda m, u, v, d: d(0) * u + d(1) * v + d(2)),
    "own metric": Family([*PLACE, (0.5, 2), (0.5, 2)], lambda m, u, v, d: d(2) * (u - d(0)) ** 2 + d(3) * (v - d(1)) ** 2),
    "parabola": Family([(-0.3, 0.3), (-1, 1), (-1, 1), (-0.3, 0.3)], lambda m, u, v, d: d(0) + d(1) * u + d(2) * u**2 - d(3) * v),
    "bell": Family([*PLACE], lambda m, u, v, d: -m.exp(-_squares(u, v, d))),
    "number": Family([(0, 1)], lambda m, u, v, d: d(0)),
}
BODIES: list[Callable[[Any, Any, Any, Any], Any]] = [
    lambda m, u, v, s: 1.0 + 0.0 * u,
    lambda m, u, v, s: 1.0 + u * v,
    lambda m, u, v, s: u**2 + v,
    lambda m, u, v, s: m.exp(u * v),
    lambda m, u, v, s: 1.0 + s * u,
    lambda m, u, v, s: m.cos(u + 2.0 * v),
]
BOXES: list[tuple[tuple[Any, Any, Any], tuple[Any, Any, Any]]] = [
    *[((x, 0, 1), (y, 0, 1))] * 4,
    ((x, -0.2, 0.9), (y, 0, 0.8)),
    ((x, 0, t), (y, 0, 1)),
]


def shifted(d: Row, by: int) -> Row:
    """A row from a column on."""
    return lambda i: d(by + i)


class Scene:
    """A choice among a few rows over a box, times a body."""

    def __init__(self, seed: int) -> None:
        random = Random(seed)
        self.box, self.body, self.n = random.choice(BOXES), random.choice(BODIES), random.choice([2, 3, 3])
        self.operation = random.choice(
            ["any", "all", "any of two", "nearest", "nearest", "nearest where", "least", "greatest", "least below"]
        )
        families = [random.choice(list(REGIONS if "any" in self.operation or self.operation == "all" else KEYS))]
        if self.operation in ("any of two", "nearest where"):
            families.append(random.choice(list(REGIONS)))
        self.name = f"{self.operation}: {', '.join(families)}"
        self.first = (KEYS | REGIONS)[families[0]]
        self.second = REGIONS.get(families[-1], self.first)
        self.excludes = random.random() < 0.5
        self.width = len(self.first.ranges)
        generator = np.random.default_rng(seed)
        parts = [self.first.rows(self.n, generator), generator.normal(size=(self.n, 1)), self.second.rows(self.n, generator)]
        self.rows, self.t = np.hstack(parts), float(generator.uniform(0.5, 1.0))
        self.direction = generator.normal(size=self.rows.shape) * 0.3

    def region(self, m: Any, u: Any, v: Any, d: Row) -> Any:
        """Whether a row counts at a place."""
        one = self.first.of(m, u, v, d)
        if self.operation != "any of two":
            return one
        other = self.second.of(m, u, v, shifted(d, self.width + 1))
        return one & ~other if self.excludes else one | other

    def counts(self, m: Any, u: Any, v: Any, d: Row) -> Any:
        """Whether a row may be chosen."""
        return self.second.of(m, u, v, shifted(d, self.width + 1))

    def over_data(self) -> teg.Expr:
        row: Row = lambda i: D[k, i]  # noqa: E731
        if "any" in self.operation or self.operation == "all":
            made = teg.bracket((teg.all if self.operation == "all" else teg.any)(self.region(teg, x, y, row), ALL))
        elif self.operation.startswith("nearest"):
            where = {"where": self.counts(teg, x, y, row), "otherwise": 0.3} if "where" in self.operation else {}
            made = teg.nearest(row(self.width) * (1 + x), self.first.of(teg, x, y, row), ALL, **where)
        else:
            key = self.first.of(teg, x, y, row)
            least = teg.maximum_of(key, ALL) if self.operation == "greatest" else teg.minimum_of(key, ALL)
            made = teg.bracket(least < 0.25) if "below" in self.operation else least
        return teg.integral(made * self.body(teg, x, y, t), *self.box)

    def of_rows(self, m: Any, u: Any, v: Any, rows: Sequence[Row]) -> Any:
        """The choice at a place, written out; `m.number` makes a number of a condition."""
        if "any" in self.operation or self.operation == "all":
            return m.number(reduce(and_ if self.operation == "all" else or_, [self.region(m, u, v, d) for d in rows]))
        keys = [self.first.of(m, u, v, d) + 0.0 * u for d in rows]
        if not self.operation.startswith("nearest"):
            least = reduce(m.maximum if self.operation == "greatest" else m.minimum, keys)
            return m.number(least < 0.25) if "below" in self.operation else least
        there = [self.counts(m, u, v, d) for d in rows] if "where" in self.operation else None
        total = m.number(reduce(and_, [~c for c in there])) * 0.3 if there else 0.0
        for j, d in enumerate(rows):
            wins = [there[j]] if there else []
            for i in range(len(rows)):
                if i != j:
                    is_less = keys[j] < keys[i] if i < j else keys[j] <= keys[i]
                    wins.append(is_less | ~there[i] if there else is_less)
            total = total + m.number(reduce(and_, wins)) * d(self.width) * (1 + u)
        return total

    def written_out(self) -> tuple[teg.Expr, list[list[teg.Param]]]:
        names = [[teg.param(f"p{j}_{i}") for i in range(self.rows.shape[1])] for j in range(self.n)]
        made = self.of_rows(InTeg, x, y, [row.__getitem__ for row in names])
        return teg.integral(made * self.body(teg, x, y, t), *self.box), names

    def on_grid(self) -> float:
        (low, high), (left, right) = ([self.t if b is t else float(b) for b in side[1:]] for side in self.box)
        at = (np.arange(SIDE) + 0.5) / SIDE
        u, v = low + (high - low) * at[:, None], left + (right - left) * at
        u, v = np.broadcast_arrays(u, v)
        values = self.of_rows(InNumpy, u, v, [row.__getitem__ for row in self.rows]) * self.body(np, u, v, self.t)
        return float(np.mean(values)) * (high - low) * (right - left)


class InTeg:
    exp, sqrt, maximum, minimum, number = teg.exp, teg.sqrt, teg.maximum, teg.minimum, teg.bracket


class InNumpy:
    exp, sqrt, maximum, minimum = np.exp, np.sqrt, np.maximum, np.minimum

    @staticmethod
    def number(condition: Any) -> Any:
        return np.where(condition, 1.0, 0.0)


def complaints(seed: int, backend: str, products: bool = True) -> list[str]:
    """What is wrong with a scene's value, its gradient, or a product with its Hessian. A call that warns is believed."""
    scene = Scene(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("error", teg.AccuracyWarning)
        try:
            return _compared(scene, backend, products)
        except teg.AccuracyWarning:
            return []


def _compared(scene: Scene, backend: str, products: bool) -> list[str]:
    f, found = teg.compile(scene.over_data(), [D, t], backend=backend), []
    value, gradient = f.value_and_grad(D=scene.rows, t=scene.t)
    e, names = scene.written_out()
    order = [p for row in names for p in row]
    expected, slopes = teg.compile(e, [*order, t], backend="c").value_and_grad(*scene.rows.ravel(), scene.t)
    size = 1.0 + max(abs(s) for s in slopes.values())
    by_row = np.array([slopes[p.name] for p in order]).reshape(scene.rows.shape)
    if not abs(value - expected) < 1e-8:
        found.append(f"the value is {value!r}, written out {expected!r}")
    if not abs(value - (at := scene.on_grid())) < 8.0 * size / SIDE:
        found.append(f"the value is {value!r}, on a grid {at!r}")
    if not np.abs(gradient["D"] - by_row).max() < 1e-7 * size or not abs(gradient["t"] - slopes["t"]) < 1e-7 * size:
        found.append(f"the gradient is {gradient}, written out {by_row.tolist()}, {slopes['t']}")
    if products:
        product = f.hvp({"D": scene.rows, "t": scene.t}, {"D": scene.direction, "t": 0.0})["D"]
        around = [f.grad(D=scene.rows + s * 1e-4 * scene.direction, t=scene.t)["D"] for s in (-2, -1, 1, 2)]
        rough = (around[2] - around[1]) / 2e-4
        fine = (around[0] - 8 * around[1] + 8 * around[2] - around[3]) / 12e-4
        size = 1.0 + np.abs(product).max()
        if np.abs(fine - rough).max() < 1e-4 * size and not np.abs(product - fine).max() < 1e-3 * size:
            found.append(f"the product with the Hessian is {product.tolist()}, by differences {fine.tolist()}")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=50, help="how many scenes")
    parser.add_argument("--seed", type=int, default=0, help="of the first one")
    options = parser.parse_args()
    wrong = 0
    for seed in range(options.seed, options.seed + options.n):
        start = time.perf_counter()
        try:
            told = complaints(seed, ("numpy", "c")[seed % 2])
        except teg.TegError as error:
            told = [f"{type(error).__name__}: {error}"]
        wrong += bool(told)
        print(f"{seed} {Scene(seed).name}, {time.perf_counter() - start:.1f} s", *told, sep="\n    ", flush=True)
    raise SystemExit(bool(wrong))


if __name__ == "__main__":
    main()
