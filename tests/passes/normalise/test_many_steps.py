"""Random programs of steps, and how many steps make programs grow."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np
import pytest

import teg
from teg.analysis.staircase import is_step
from teg.analysis.surfaces import atoms_of
from teg.ir.node import postorder
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.normalise.steps import enumerate_steps
from teg.pipeline import compiled_outputs, normal_form
from tests.passes.normalise.step_problems import INT, SQUARE, B, Formula, a, b, board, t, x, y


class Random:
    """Programs of floors of one variable, and the same in NumPy."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)

    def number(self) -> float:
        return round(float(self.random.uniform(-3, 3)), 2)

    def affine(self) -> Formula:
        p, q = self.number(), self.number()
        formulas: list[Formula] = [
            (p * x + t + q, lambda x, t, a: p * x + t + q),
            (p * x + q, lambda x, t, a: p * x + q),
            (a * x + q * t, lambda x, t, a: a * x + q * t),
        ]
        return formulas[self.random.choice(3, p=[0.7, 0.2, 0.1])]

    def step(self, depth: int) -> Formula:
        e, f = self.affine()
        if depth and self.random.uniform() < 0.3:
            (g, h), weight = self.step(depth - 1), abs(self.number()) + 0.2
            return teg.floor(e + weight * g), lambda *v: np.floor(f(*v) + weight * h(*v))
        period = (abs(self.number()) + 0.4) * float(self.random.choice([-1, 1]))
        formulas: list[Formula] = [
            (teg.floor(e), lambda *v: np.floor(f(*v))),
            (teg.ceil(e), lambda *v: np.ceil(f(*v))),
            (teg.round(e), lambda *v: np.floor(f(*v) + 0.5)),
            (teg.mod(e, period), lambda *v: np.mod(f(*v), period)),
        ]
        return formulas[self.random.integers(4)]

    def value(self) -> Formula:
        (e, f), (g, h) = self.step(1), self.step(0)
        formulas: list[Formula] = [
            (e + g * x, lambda *v: f(*v) + h(*v) * v[0]),
            (e * g, lambda *v: f(*v) * h(*v)),
            (teg.sin(e) + teg.cos(g), lambda *v: np.sin(f(*v)) + np.cos(h(*v))),
            (teg.where(e < g, x, e), lambda *v: np.where(f(*v) < h(*v), v[0], f(*v))),
            (teg.where((e < 0.7) & (g > -0.5), x * x, 2), lambda *v: np.where((f(*v) < 0.7) & (h(*v) > -0.5), v[0] ** 2, 2.0)),
            (g / (1 + e * e), lambda *v: h(*v) / (1 + f(*v) ** 2)),
        ]
        return formulas[self.random.integers(6)]


@pytest.mark.parametrize("seed", range(24))
def test_random_programs(seed: int) -> None:
    """The value against 400 000 points; the gradient against differences of the value, where these agree among themselves."""
    program = Random(seed)
    (e, f), at = program.value(), {"t": program.number() + 0.000317, "a": program.number() + 0.000113}
    compiled = teg.compile(INT(e, (x, -0.6, 0.9)), [t, a])
    points = -0.6 + 1.5 * (np.arange(400_000) + 0.5) / 400_000
    samples = f(points, at["t"], at["a"]) + 0 * points
    assert compiled(at) == pytest.approx(1.5 * float(np.mean(samples)), abs=1e-4 * (1 + float(np.max(np.abs(samples)))))
    gradient = compiled.grad(at)
    for k in at:
        wide, narrow = ((compiled({**at, k: at[k] + h}) - compiled({**at, k: at[k] - h})) / (2 * h) for h in (1e-5, 3e-6))
        if abs(wide - narrow) < 1e-4 * (1 + abs(wide)):
            assert gradient[k] == pytest.approx(narrow, rel=2e-4, abs=2e-4), k


def slope(sizes: dict[int, int]) -> float:
    """The exponent of growth between the first and the last."""
    (n0, s0), *_, (n1, s1) = sizes.items()
    return math.log(s1 / s0) / math.log(n1 / n0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "most"),
    [
        (lambda n: INT(teg.exp(x) * teg.floor(n * x + t), (x, 0, 1)), 1.1),
        (lambda n: INT(x * B(teg.mod(n * x + t, 1) < a), (x, 0, 1)), 1.1),
        (lambda n: INT(teg.sin(teg.floor(n * x + t) * a), (x, 0, 1)), 1.1),
        (lambda n: INT(teg.floor(n * (x + 0.5 * y) + t) * x, *SQUARE), 1.1),
        (lambda n: INT(board(n**0.5 * x + t, n**0.5 * y, a, b), *SQUARE), 1.1),
    ],
)
def test_code_is_linear_in_the_number_of_cells(program: Callable[[int], teg.Expr], most: float) -> None:
    sizes = {n: teg.size(*compiled_outputs(program(n), [t], 1, Exact())) for n in (16, 64, 144)}
    assert slope(sizes) <= most


def test_one_surface_a_step() -> None:
    body = cast(teg.Expr, normal_form(INT(teg.sin(teg.floor(10 * x)) * teg.floor(10 * x), (x, 0, 1))))
    assert len({atom.g for atom in atoms_of(body)}) == 9


@pytest.mark.slow
def test_deep_expressions() -> None:
    e: teg.Expr = teg.floor(2 * x + t)
    for _ in range(20_000):
        e = teg.sin(e) + 1
    assert not any(is_step(n) for n in postorder([enumerate_steps(INT(e, (x, 0, 1)))]))
    f: teg.Expr = teg.floor(2 * x + t)
    for _ in range(20_000):
        f = f * 0.5 + 1
    assert not any(is_step(n) for n in postorder([enumerate_steps(INT(f, (x, 0, 1)))]))
