"""How programs grow, by counting: linear where it must be linear."""

from __future__ import annotations

import math
import time

import pytest

import teg
from teg.pipeline import compiled_outputs, flatten
from teg.program import size as statements
from teg.traverse import parameters

x, y = teg.vars("x y")


def heavisides(n: int) -> teg.Expr:
    """Σ [x < tᵢ], n parameters."""
    total: teg.Expr = teg.expr.ZERO
    for i in range(n):
        total = total + teg.bracket(x < teg.param(f"t{i}"))
    return teg.integral(total, (x, 0, 1))


def half_planes(n: int) -> teg.Expr:
    """Π [aᵢ·x + bᵢ·y < cᵢ], 3n parameters."""
    product: teg.Expr = teg.expr.ONE
    for i in range(n):
        a, b, c = teg.params(f"a{i} b{i} c{i}")
        product = product * teg.bracket(a * x + b * y < c)
    return teg.integral(product, (x, 0, 1), (y, 0, 1))


def nodes(e: teg.Expr) -> int:
    """Distinct nodes of value and gradient without deltas."""
    return teg.size(*compiled_outputs(e, parameters(e), 1, "sift"))


def slope(counts: dict[int, int]) -> float:
    (n1, c1), (n2, c2) = min(counts.items()), max(counts.items())
    return math.log(c2 / c1) / math.log(n2 / n1)


def test_a_sum_of_heavisides_is_linear() -> None:
    counts = {n: nodes(heavisides(n)) for n in (100, 1000)}
    assert slope(counts) <= 1.1
    assert all(count <= 60 * n for n, count in counts.items())


def test_the_program_of_a_sum_of_heavisides_is_linear() -> None:
    counts = {n: statements(teg.compile(heavisides(n)).program(1)) for n in (50, 500)}
    assert slope(counts) <= 1.1


def test_a_thousand_heavisides_are_right() -> None:
    n = 1000
    f = teg.compile(heavisides(n))
    at = {f"t{i}": (i + 0.5) / n for i in range(n)}
    start = time.perf_counter()
    value, gradient = f.value_and_grad(at)
    assert time.perf_counter() - start < 30  # seconds, against a blow-up only
    assert value == pytest.approx(n / 2, rel=1e-13)
    assert set(gradient.values()) == {1.0}


def test_a_product_of_half_planes_is_at_most_quadratic() -> None:
    counts = {n: nodes(half_planes(n)) for n in (6, 24)}
    assert slope(counts) <= 2.1


def test_a_shared_condition_is_not_copied() -> None:
    """A chain of 200 uses of one bracket has one surface, and one boundary term."""
    t = teg.param("t")
    e: teg.Expr = teg.bracket(x < t)
    for i in range(200):
        e = teg.sin(e + i) * teg.bracket(x < t) + e
    counts = nodes(teg.integral(e, (x, 0, 1)))
    assert counts < 20 * 200


def triangle() -> teg.Expr:
    """The squared difference of a linear colour and a target over a pixel, three channels."""
    ps = [teg.params(f"x{i} y{i}") for i in range(3)]
    cs = [teg.params(f"r{i} g{i} b{i}") for i in range(3)]
    edges = []
    for (px, py), (qx, qy) in zip([*ps[1:], ps[0]], [ps[2], *ps[:2]], strict=True):
        edges.append((qx - px) * (y - py) - (qy - py) * (x - px))
    inside = teg.bracket((edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0))
    total = edges[0] + edges[1] + edges[2]
    loss: teg.Expr = teg.expr.ZERO
    for k, target in enumerate((0.25, 0.5, 0.75)):
        colour = sum((edges[i] * cs[i][k] for i in range(1, 3)), edges[0] * cs[0][k]) / total
        loss = loss + (colour - target) ** 2
    return teg.integral(inside * loss, (x, 0, 1), (y, 0, 1))


def test_the_triangle_stays_small() -> None:
    e = triangle()
    start = time.perf_counter()
    count = nodes(e)
    took = time.perf_counter() - start
    assert count <= 600
    assert took < 30  # seconds, against a blow-up only; `make bench` measures
    source = teg.compile(e, backend="c").kernel(1).source
    assert source.count("\n") <= 1500
    assert len(source) <= 150_000


def test_gradients_cost_a_small_multiple_of_the_value() -> None:
    for e in (heavisides(50), triangle()):
        f = teg.compile(e)
        assert statements(f.program(1)) <= 12 * statements(f.program(0))
        assert len(flatten(teg.grad(e))) == len(f.parameters)


@pytest.mark.slow
@pytest.mark.parametrize(("backend", "n"), [("numpy", 10_000), ("c", 3000)])
def test_ten_thousand_brackets(backend: str, n: int) -> None:
    e = heavisides(n)
    start = time.perf_counter()
    f = teg.compile(e, backend=backend)
    at = {f"t{i}": (i + 0.5) / n for i in range(n)}
    value, gradient = f.value_and_grad(at)
    assert time.perf_counter() - start < 300  # seconds, against a blow-up only; `make bench` measures
    assert value == pytest.approx(n / 2, rel=1e-12)
    assert set(gradient.values()) == {1.0}


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_an_expression_100_000_deep(backend: str) -> None:
    t = teg.param("t")
    e: teg.Expr = t
    for i in range(50_000):
        e = 0.5 * e + (0.25 if i % 2 else 0.5)
    start = time.perf_counter()
    f = teg.compile(e, [t], backend=backend)
    value, gradient = f.value_and_grad(t=0.5)
    assert time.perf_counter() - start < 300  # seconds, against a blow-up only; `make bench` measures
    assert 0 < value < 1
    assert 0 <= gradient["t"] < 1e-300
