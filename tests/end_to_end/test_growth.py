"""How programs, and the compiler's work on them, grow, by counting: linear where it must be linear.

Counted are distinct nodes of value and gradient, statements of the flat program, lines of C, and the work: every call of a function, also
of those written in C, on the way from the expression to the flat program.
"""

from __future__ import annotations

import math
import re
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest

import teg
from teg.analysis.settings import Integration
from teg.backends.c.unit import print_kernel
from teg.errors import NotDifferentiableError
from teg.evaluator.accuracy import AccuracyWarning
from teg.ir.traverse import parameters
from teg.passes.differentiate.estimators.exact import Exact
from teg.pipeline import compiled_outputs, flatten, program_for
from teg.program import size as statements

x, y = teg.vars("x y")


def heavisides(n: int) -> teg.Expr:
    """Σ [x < tᵢ], n parameters."""
    total: teg.Expr = teg.ir.expr.ZERO
    for i in range(n):
        total = total + teg.bracket(x < teg.param(f"t{i}"))
    return teg.integral(total, (x, 0, 1))


def half_planes(n: int) -> teg.Expr:
    """Π [aᵢ·x + bᵢ·y < cᵢ], 3n parameters."""
    product: teg.Expr = teg.ir.expr.ONE
    for i in range(n):
        a, b, c = teg.params(f"a{i} b{i} c{i}")
        product = product * teg.bracket(a * x + b * y < c)
    return teg.integral(product, (x, 0, 1), (y, 0, 1))


def parameters_of_one_surface(n: int) -> teg.Expr:
    """[x + y < Σ pᵢ·qᵢ], 2n parameters."""
    total: teg.Expr = teg.ir.expr.ZERO
    for i in range(n):
        p, q = teg.params(f"p{i} q{i}")
        total = total + p * q
    return teg.integral(teg.bracket(x + y < total), (x, 0, 1), (y, 0, 1))


def parameters_of_the_integrand(n: int) -> teg.Expr:
    """[x < t]·Σ pᵢ·sin(ix), n + 1 parameters."""
    total: teg.Expr = teg.ir.expr.ZERO
    for i in range(n):
        total = total + teg.param(f"p{i}") * teg.sin((i + 1) * x)
    return teg.integral(teg.bracket(x < teg.param("t")) * total, (x, 0, 1))


def separate_integrals(n: int) -> teg.Expr:
    """Σ sin(∫∫ x·[x + aᵢ·y < bᵢ])."""
    total: teg.Expr = teg.ir.expr.ZERO
    for i in range(n):
        a, b = teg.params(f"a{i} b{i}")
        total = total + teg.sin(teg.integral(teg.bracket(x + a * y < b) * x, (x, 0, 1), (y, 0, 1)))
    return total


def integrals_in_bounds(n: int) -> teg.Expr:
    """Each integral's upper bound is the one before: ∫₀ᵉ [x < tᵢ]·(x + 1) dx, n deep."""
    e: teg.Expr = teg.param("t")
    for i in range(n):
        e = teg.integral(teg.bracket(x < teg.param(f"t{i}")) * (x + 1), (x, 0, e))
    return e


def functions_of_functions(n: int) -> teg.Expr:
    """sin(sin(… + p₀) + p₁) …, n deep, in one integral."""
    t = teg.param("t")
    e: teg.Expr = x * t
    for i in range(n):
        e = teg.sin(e) + teg.param(f"p{i}")
    return teg.integral(teg.bracket(x < t) * e, (x, 0, 1))


def nodes(e: teg.Expr) -> int:
    """Distinct nodes of value and gradient without deltas."""
    return teg.size(*compiled_outputs(e, parameters(e), 1, Exact()))


def work(action: Callable[[], object]) -> int:
    """How many functions are called."""
    calls = 0

    def count(_frame: object, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        action()
    finally:
        sys.setprofile(before)
    return calls


def slope(counts: dict[int, int]) -> float:
    (n1, c1), (n2, c2) = min(counts.items()), max(counts.items())
    return math.log(c2 / c1) / math.log(n2 / n1)


def test_a_sum_of_heavisides_is_linear() -> None:
    counts = {n: nodes(heavisides(n)) for n in (50, 500)}
    assert slope(counts) <= 1.1
    assert all(count <= 60 * n for n, count in counts.items())


def test_the_program_of_a_sum_of_heavisides_is_linear() -> None:
    counts = {n: statements(teg.compile(heavisides(n)).program(1)) for n in (30, 300)}
    assert slope(counts) <= 1.1


@pytest.mark.parametrize(
    ("family", "sizes"),
    [
        (heavisides, (25, 100)),
        (parameters_of_one_surface, (10, 40)),
        (parameters_of_the_integrand, (10, 40)),
        (separate_integrals, (4, 12)),
        (integrals_in_bounds, (5, 20)),
        (functions_of_functions, (10, 40)),
    ],
)
def test_everything_is_linear(family: Callable[[int], teg.Expr], sizes: tuple[int, int]) -> None:
    """Of n brackets, n parameters, n integrals, and of n of them inside each other where what is computed is linear in n."""
    counts: dict[str, dict[int, int]] = {"nodes": {}, "statements": {}, "lines of C": {}, "work": {}}
    for n in sizes:
        e = family(n)
        f = teg.compile(e)
        counts["work"][n] = work(lambda f=f: f.program(1))
        counts["nodes"][n] = teg.size(*f.outputs(1))
        counts["statements"][n] = statements(f.program(1))
        counts["lines of C"][n] = print_kernel(f.program(1)).count("\n")
    slopes = {what: slope(count) for what, count in counts.items()}
    assert max(slopes["nodes"], slopes["statements"], slopes["lines of C"]) <= 1.1, (slopes, counts)
    assert slopes["work"] <= 1.3, (slopes, counts)


@pytest.mark.slow
def test_a_thousand_heavisides_are_right() -> None:
    n = 1000
    f = teg.compile(heavisides(n))
    at = {f"t{i}": (i + 0.5) / n for i in range(n)}
    start = time.perf_counter()
    value, gradient = f.value_and_grad(at)
    assert time.perf_counter() - start < 30  # seconds, against a blow-up only
    assert value == pytest.approx(n / 2, rel=1e-13)
    assert set(gradient.values()) == {1.0}


@pytest.mark.slow
def test_a_product_of_half_planes_is_at_most_quadratic() -> None:
    """Each of n edges is clipped by n - 1 others, each with a condition of its own for ties."""
    counts = {n: nodes(half_planes(n)) for n in (6, 24)}
    assert slope(counts) <= 2.1


@pytest.mark.slow
def test_the_code_of_a_product_of_half_planes_is_linear() -> None:
    """The edges share one routine, which a table of n entries tells where the coefficients of its own line and of the others are."""
    lines, lengths = {}, {}
    for n in (8, 32):
        e = half_planes(n)
        outputs = [leaf for output in compiled_outputs(e, parameters(e), 1, Exact()) for leaf in flatten(output)]
        text = print_kernel(program_for(outputs, [p.name for p in parameters(e)], Integration()))
        lines[n], lengths[n] = text.count("\n"), len(text)
        assert len(re.findall(r"^static void segment_\d+\(", text, re.MULTILINE)) <= 4
    assert slope(lines) <= 1.1
    assert slope(lengths) <= 1.1


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_polygon_of_many_sides(backend: str) -> None:
    """A regular polygon around a circle of radius r: n·r²·tan(π/n); moving all sides outwards changes it by its circumference."""
    n, r = 34, 0.4
    f = teg.compile(half_planes(n), backend=backend)
    at = {}
    for i in range(n):
        a, b = math.cos(2 * math.pi * (i + 0.3) / n), math.sin(2 * math.pi * (i + 0.3) / n)
        at |= {f"a{i}": a, f"b{i}": b, f"c{i}": 0.5 * (a + b) + r}
    value, gradient = f.value_and_grad(at)
    assert value == pytest.approx(n * r * r * math.tan(math.pi / n), rel=1e-13)
    assert sum(gradient[f"c{i}"] for i in range(n)) == pytest.approx(2 * n * r * math.tan(math.pi / n), rel=1e-13)


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
    loss: teg.Expr = teg.ir.expr.ZERO
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
    assert source.count("\n") <= 2200  # a third of them for pixels side by side
    assert len(source) <= 150_000


def test_gradients_cost_a_small_multiple_of_the_value() -> None:
    for e, most in ((heavisides(50), 12), (triangle(), 24)):  # a triangle's value is one clipped polygon, its gradient three sides more
        f = teg.compile(e)
        assert statements(f.program(1)) <= most * statements(f.program(0))
        assert len(flatten(teg.grad(e))) == len(f.parameters)


@pytest.mark.slow
@pytest.mark.parametrize(("backend", "n"), [("numpy", 2000), ("c", 2000)])
def test_thousands_of_brackets(backend: str, n: int) -> None:
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
def test_an_expression_20_000_deep(backend: str) -> None:
    t = teg.param("t")
    e: teg.Expr = t
    for i in range(10_000):
        e = 0.5 * e + (0.25 if i % 2 else 0.5)
    start = time.perf_counter()
    f = teg.compile(e, [t], backend=backend)
    value, gradient = f.value_and_grad(t=0.5)
    assert time.perf_counter() - start < 300  # seconds, against a blow-up only; `make bench` measures
    assert 0 < value < 1
    assert 0 <= gradient["t"] < 1e-300


# -- what is deep, and what is used twice at each level ----------------------------------------------------------------

CHAINS: dict[str, tuple[Callable[[teg.Expr, int], teg.Expr], Callable[[float, int], float]]] = {
    "a polynomial by Horner": (lambda q, k: q * (0.5 * x) + 0.25, lambda q, k: 0.5 * q * T + 0.25),
    "sums of a pole": (lambda q, k: 0.5 * q + 1 / (3 + x), lambda q, k: 0.5 * q + 1 / (3 + T)),
    "a continued fraction": (lambda q, k: 1 / (1 + 0.5 * q), lambda q, k: 1 / (1 + 0.5 * q)),
    "quotients of squares": (lambda q, k: q / (1 + q * q) + 0.1, lambda q, k: q / (1 + q * q) + 0.1),
    "Gaussians": (lambda q, k: teg.exp(-q * q) * q + 0.3, lambda q, k: math.exp(-q * q) * q + 0.3),
    "exponentials and poles": (lambda q, k: teg.exp(-q * q) + 1 / (1 + q), lambda q, k: math.exp(-q * q) + 1 / (1 + q)),
    "logistics": (lambda q, k: teg.exp(q) / (1 + teg.exp(q)) + 0.1 * q, lambda q, k: math.exp(q) / (1 + math.exp(q)) + 0.1 * q),
    "choices by a parameter": (
        lambda q, k: teg.where(teg.param("a") < k % 2 + 0.5, 0.5 * q + 0.1 * x, 0.3 * q + 0.2),
        lambda q, k: 0.5 * q + 0.1 * T if k % 2 else 0.3 * q + 0.2,
    ),
}
"""A level of an expression by the one below, and its number at T, where a is 1."""
DEEP = ("Gaussians", "exponentials and poles", "logistics")
"""Chains whose levels are four or five nodes deep, where those of a polynomial are two: half as many are as deep. They take longest."""
T = 0.4


def chain(name: str, levels: int) -> teg.Expr:
    e: teg.Expr = x
    for k in range(levels):
        e = CHAINS[name][0](e, k)
    return teg.integral(teg.bracket(x < teg.param("t")) * e, (x, 0, 1))


@pytest.mark.parametrize("name", CHAINS)
def test_integrands_of_hundreds_of_levels(name: str) -> None:
    """The derivative by t is the integrand at t. No level is a call of Python's, and what two levels share is looked at once."""
    at = {"t": T, "a": 1.0} if "parameter" in name else {"t": T}
    levels = 200 if name in DEEP else 400
    f = teg.compile(chain(name, levels), [teg.param("t")])
    wanted = T
    for k in range(levels):
        wanted = CHAINS[name][1](wanted, k)
    assert f.grad(at)["t"] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("name", CHAINS)
def test_the_work_of_levels_is_linear(name: str) -> None:
    sizes = (15, 60) if name in DEEP else (20, 80)
    counts = {n: work(lambda n=n: teg.compile(chain(name, n), [teg.param("t")]).program(1)) for n in sizes}
    assert slope(counts) <= 1.35, counts


def test_a_polynomial_of_a_degree_that_nobody_writes_out() -> None:
    """Degree 2²⁰, by squares: integrated numerically."""
    e: teg.Expr = x
    wanted = T
    for _ in range(20):
        e, wanted = 0.3 * e * e + 0.1 * e + 0.2, 0.3 * wanted**2 + 0.1 * wanted + 0.2
    f = teg.compile(teg.integral(teg.bracket(x < teg.param("t")) * e, (x, 0, 1)))
    assert f.grad(t=T)["t"] == pytest.approx(wanted, rel=1e-12)


# -- what is bounded ---------------------------------------------------------------------------------------------------


def disks(n: int) -> teg.Expr:
    """The area of a union of n disks that do not meet, on a grid."""
    u, v, r = *teg.vars("u v"), teg.param("r")
    inside = [(u - 0.25 * (i % 4) - 0.125) ** 2 + (v - 0.25 * (i // 4) - 0.125) ** 2 < r * r for i in range(n)]
    union = inside[0]
    for c in inside[1:]:
        union = union | c
    return teg.integral(teg.bracket(union), (u, 0, 1), (v, 0, 1))


def test_the_boundary_of_a_union_meets_each_disk_once() -> None:
    """n boundary terms with breaks for n other disks each: quadratic, not a break for every pair in every term."""
    few, many = (statements(teg.compile(disks(n)).program(1)) for n in (3, 6))
    assert many < 5 * few
    assert teg.compile(disks(3)).grad(r=0.1)["r"] == pytest.approx(3 * 2 * math.pi * 0.1, rel=1e-12)


def test_too_many_cells_are_given_up_early() -> None:
    """Two floors with as many steps as parameters say, and one of their product: the value is adaptive, and there is no derivative."""
    u, p, q = teg.var("u"), *teg.params("p q")
    e = teg.integral(teg.floor(teg.mod(p * u, 1) * teg.mod(q * u, 1) * 4), (u, 0, 1))
    f = teg.compile(e)
    assert statements(f.program(0)) < 1000
    grid = (np.arange(2_000_000) + 0.5) / 2_000_000
    assert f(p=5.0, q=3.3) == pytest.approx(np.floor((5 * grid % 1) * (3.3 * grid % 1) * 4).mean(), abs=1e-5)
    with pytest.raises(NotDifferentiableError):
        f.grad(p=5.0, q=3.3)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_evaluations_are_bounded(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the limit what has been found is given, with its estimate, and a warning."""
    from teg.backends.c import runtime as c_runtime
    from teg.backends.numpy import kernel as numpy_backend

    monkeypatch.setattr(numpy_backend, "MAX_EVALUATIONS", 20_000)
    monkeypatch.setitem(c_runtime.LIMITS, "TEG_MAX_EVALUATIONS", 20_000)
    u, v, p = *teg.vars("u v"), teg.param("p")
    f = teg.compile(teg.integral(teg.floor(teg.sin(40 * u * v) * 3 + p), (u, 0, 1), (v, 0, 1)), [], backend=backend)
    with pytest.warns(AccuracyWarning, match="misses the tolerance"):
        value = f(p=0.3)
    assert f.evaluations(p=0.3) < 4_000_000
    _, error = f.value_and_error(p=0.3)
    grid = (np.arange(1000) + 0.5) / 1000
    expected = np.floor(np.sin(40 * grid[:, None] * grid) * 3 + 0.3).mean()
    assert abs(value - expected) <= error + 1e-2
