"""One region in other words: values, gradients and Hessians agree with those of the plain conditions."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest

import teg
from teg.ir.expr import Cond, Expr

x, y = teg.vars("x y")
t, a, b = teg.params("t a b")

SURFACES: list[tuple[Expr, Expr]] = [
    (x, a),
    (x + y, t),
    (b * x, a * y),
    (x - t, y * b),
    (x * x + y * y, t),
    ((x - a) ** 2 + (y - b) ** 2, t * t),
    (x * y, a * b),
    (y, x * x * a + b - 1),
    (x * t, a * b),
    (y - b, t * (x - a)),
    ((x - t) * (y - b), 0 * x),
    (x * x * b, y * a),
    (x * y - a * x, t * y - a * t),
]
WORDS: list[Callable[[Expr, Expr], Cond]] = [
    lambda u, v: v - u > 0,
    lambda u, v: u * a < v * a,
    lambda u, v: u / a < v / a,
    lambda u, v: -(v - u) * t < 0,
    lambda u, v: ~(u >= v),
    lambda u, v: teg.exp(u) < teg.exp(v),
    lambda u, v: teg.exp(v - u) > 1,
    lambda u, v: (v - u) ** 3 > 0,
    lambda u, v: (v - u) / (1 + x * x) > 0,
    lambda u, v: teg.maximum(u, v) > u,
    lambda u, v: teg.atan(v - u) > 0,
    lambda u, v: (v - u) * teg.exp(x) > 0,
]


def results(conditions: list[Cond], at: list[float]) -> np.ndarray:
    weight: Expr = teg.exp(x - y)
    for i, (condition, beside) in enumerate(zip(conditions, (0, y), strict=False)):
        weight = weight * teg.where(condition, 1 + i * x, beside)
    f = teg.compile(teg.integral(weight, (x, -1, 1), (y, -1, 1)) + 0 * (t + a + b), [t, a, b], backend="numpy")
    value, gradient = f.value_and_grad(*at)
    return np.array([value, *gradient.values(), *f.hessian(*at).values()])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(s, marks=pytest.mark.thorough) for s in range(4, 60))])
def test_one_region_in_other_words(seed: int) -> None:
    drawn = random.Random(seed)
    pairs = [drawn.choice(SURFACES) for _ in range(2)]
    at = [drawn.uniform(0.25, 0.95) for _ in range(3)]
    plain = results([u < v for u, v in pairs], at)
    others = results([drawn.choice(WORDS)(u, v) for u, v in pairs], at)
    np.testing.assert_allclose(others, plain, rtol=1e-7, atol=1e-8)
    hessian = plain[4:].reshape(3, 3)
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-7, atol=1e-8)
