"""Sums of alike terms, and maxima of many functions: loops over tables, against closed forms and the written-out program."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg.numerics.cells import SHIFT
from teg.program import size
from teg.program.arrays import array_size
from teg.program.tabled import TabledProgram

BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
x, y = teg.vars("x y")
a = teg.param("a")
ROWS = 16
T = [teg.param(f"t{k}") for k in range(ROWS)]
C = [teg.param(f"c{k}") for k in range(ROWS)]
PLACES = [-0.3, 0.0, 1.0, 1.4, 0.25, 0.25, 0.5, 1e-9, 1 - 1e-12, 0.75, 0.1, 0.9, 0.33, 0.66, 0.4, 0.6]
WEIGHTS = [math.cos(3 * k) for k in range(ROWS)]


@pytest.fixture(autouse=True)
def in_double_precision(request: pytest.FixtureRequest) -> None:
    if "jax" in request.node.name:
        request.getfixturevalue("x64")


def values(rate: float) -> dict[str, float]:
    return {**{t.name: v for t, v in zip(T, PLACES, strict=True)}, **{c.name: v for c, v in zip(C, WEIGHTS, strict=True)}, "a": rate}


def brackets(n: int = ROWS) -> teg.Expr:
    return teg.integral(teg.exp(a * x) * sum(c * teg.bracket(x < t) for c, t in zip(C[:n], T[:n], strict=True)), (x, 0, 1))


def tables_of(f: Any) -> TabledProgram | None:
    """Returns the program with tables that an evaluator has compiled for its gradient."""
    kernel = f.kernel(1)
    tabled: TabledProgram | None = getattr(kernel, "tabled", None)
    return tabled


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("rate", [0.7, -3.0, 0.0, 1e-9, 40.0])
def test_brackets_times_an_exponential(backend: str, rate: float) -> None:
    f = teg.compile(brackets(), [*T, *C, a], backend=backend)
    value, slopes = f.value_and_grad(values(rate))
    with mpmath.workdps(40):
        r = mpmath.mpf(rate)
        ends = [min(max(mpmath.mpf(t), 0), 1) for t in PLACES]
        whole = [mpmath.expm1(r * q) / r if r else q for q in ends]
        moment = [(q * mpmath.exp(r * q) - m) / r if abs(r) > 1e-6 else q**2 / 2 + r * q**3 / 3 for q, m in zip(ends, whole, strict=True)]
        size_of = mpmath.exp(max(rate, 0))
        assert abs(value - mpmath.fdot(WEIGHTS, whole)) < 4e-15 * size_of
        assert abs(slopes["a"] - mpmath.fdot(WEIGHTS, moment)) < 4e-15 * size_of
        for k, t in enumerate(PLACES):
            inside = 0.5 if t in (0.0, 1.0) else float(0 < t < 1)
            assert abs(slopes[f"t{k}"] - WEIGHTS[k] * inside * mpmath.exp(r * t)) < 4e-15 * size_of, t
            assert abs(slopes[f"c{k}"] - whole[k]) < 2e-15 * size_of
    assert tables_of(f) is not None


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_products_with_the_hessian_are_those_of_the_written_out_program(backend: str) -> None:
    point, direction = values(0.7), {p.name: math.sin(1 + k) for k, p in enumerate([*T, *C, a])}
    found, plain = (teg.compile(brackets(), [*T, *C, a], backend=backend, intrinsics=on).hvp(point, direction) for on in (True, False))
    for name, value in plain.items():
        assert abs(found[name] - value) < 1e-12, name


def test_a_batch_has_the_results_of_its_points() -> None:
    f = teg.compile(brackets(), [*T, *C, a], backend="c")
    rates = np.linspace(-1.0, 1.0, 11)
    value, slopes = f.value_and_grad({**values(0.0), "a": rates, "t4": rates})
    for k, rate in enumerate(rates):
        one, gradient = f.value_and_grad({**values(rate), "t4": rate})
        assert one == value[k]
        assert all(gradient[name] == slopes[name][k] for name in gradient)


def test_shared_parameters_collect_the_derivatives_of_their_places() -> None:
    t, c = teg.params("t c")
    terms = [c * (k + 0.5) * teg.bracket(x + 0.01 * k < t) * teg.exp(a * x) for k in range(ROWS)]
    f, plain = (teg.compile(teg.integral(sum(terms), (x, 0, 1)), [t, c, a], backend="c", intrinsics=on) for on in (True, False))
    assert tables_of(f) is not None
    assert tables_of(plain) is None
    for name, slope in f.grad(t=0.5, c=1.5, a=0.3).items():
        assert abs(slope - plain.grad(t=0.5, c=1.5, a=0.3)[name]) < 1e-12


def test_the_program_does_not_grow_with_the_number_of_terms() -> None:
    def statements_of(n: int) -> int:
        ts = [teg.param(f"t{k}") for k in range(n)]
        body = sum(teg.bracket(p * x + y < 0.1 * k) * (x + y) for k, p in enumerate(ts))
        f = teg.compile(teg.integral(body, (x, 0, 1), (y, 0, 1)), ts, backend="c")
        tabled = tables_of(f)
        assert tabled is not None
        return array_size(tabled.program)

    assert statements_of(40) == statements_of(400)


def test_statements_of_different_terms_grow_linearly() -> None:
    def statements_of(n: int) -> int:
        f = teg.compile(brackets(n), [*T[:n], *C[:n], a])
        return size(f.program(1))

    assert statements_of(8) - statements_of(6) == statements_of(6) - statements_of(4)


# -- maxima ------------------------------------------------------------------------------------------------------------


def lines(n: int) -> tuple[list[teg.Param], list[teg.Param]]:
    return [teg.param(f"a{k}") for k in range(n)], [teg.param(f"b{k}") for k in range(n)]


def nested(terms: list[teg.Expr]) -> teg.Expr:
    """Returns a maximum of maxima of pairs."""
    while len(terms) > 1:
        terms = [teg.maximum(*terms[i : i + 2]) if i + 1 < len(terms) else terms[i] for i in range(0, len(terms), 2)]
    return terms[0]


def hull(slopes: np.ndarray, heights: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Returns the integral of the largest of lines over (0, 1), and its derivatives, by the crossings of all pairs."""
    crossings = [
        (heights[j] - heights[i]) / (slopes[i] - slopes[j]) for i in range(len(slopes)) for j in range(i) if slopes[i] != slopes[j]
    ]
    ends = np.array(sorted({0.0, 1.0, *(c for c in crossings if 0 < c < 1)}))
    middles, lengths = (ends[1:] + ends[:-1]) / 2, np.diff(ends)
    first = np.argmax(slopes[:, None] * middles + heights[:, None], axis=0)
    by_slope, by_height = np.zeros(len(slopes)), np.zeros(len(slopes))
    np.add.at(by_slope, first, middles * lengths)
    np.add.at(by_height, first, lengths)
    return float(slopes @ by_slope + heights @ by_height), by_slope, by_height


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("shape", ["flat", "nested", "least"])
def test_the_largest_of_many_lines(backend: str, shape: str) -> None:
    n = 12
    rates, heights = lines(n)
    terms = [p * x + q for p, q in zip(rates, heights, strict=True)]
    e = {"flat": teg.maximum(*terms), "nested": nested(terms), "least": teg.minimum(*terms)}[shape]
    f = teg.compile(teg.integral(e, (x, 0, 1)), [*rates, *heights], backend=backend)
    random = np.random.default_rng(3)
    s, h = random.normal(size=(2, n))
    s[3] = s[4]  # parallel
    sign = -1.0 if shape == "least" else 1.0
    expected, by_slope, by_height = hull(sign * s, sign * h)
    given = {**{p.name: float(v) for p, v in zip(rates, s, strict=True)}, **{p.name: float(v) for p, v in zip(heights, h, strict=True)}}
    value, gradient = f.value_and_grad(given)
    assert abs(value - sign * expected) < 2e-15
    assert max(abs(gradient[p.name] - v) for p, v in zip(rates, by_slope, strict=True)) < 2e-14
    assert max(abs(gradient[p.name] - v) for p, v in zip(heights, by_height, strict=True)) < 2e-14
    assert tables_of(f) is not None


def test_second_derivatives_and_equal_lines_are_those_of_the_written_out_maximum() -> None:
    rates, heights = lines(5)
    e = teg.integral(teg.maximum(*(p * x + q for p, q in zip(rates, heights, strict=True))), (x, 0, 1))
    found, plain = (teg.compile(e, [*rates, *heights], backend="c", intrinsics=on) for on in (True, False))
    assert tables_of(found) is not None
    assert tables_of(plain) is None
    point = dict(zip(found.parameters, [-1.0, 0.2, 0.9, 0.1, 0.4, 0.6, 0.3, -0.1, 0.2, 0.1], strict=True))
    direction = {name: math.sin(2 + k) for k, name in enumerate(point)}
    second = plain.hvp(point, direction)
    assert all(abs(v - second[name]) < 1e-12 for name, v in found.hvp(point, direction).items())
    equal = {**point, "a2": -1.0, "b2": 0.6}  # lines 0 and 2
    first = plain.grad(equal)
    assert all(abs(v - first[name]) < 1e-13 for name, v in found.grad(equal).items())


def test_lines_of_different_forms_are_rows_of_one_table() -> None:
    s, t = teg.params("s t")
    e = teg.integral(teg.maximum(0.0, x, s * x + t, t, 2 * x - 1, s), (x, 0, 1))
    f, plain = (teg.compile(e, [s, t], intrinsics=on) for on in (True, False))
    assert tables_of(f) is not None
    for values_at in ({"s": 0.5, "t": 0.25}, {"s": -2.0, "t": 1.5}, {"s": 0.0, "t": -1.0}):
        value, gradient = f.value_and_grad(values_at)
        expected, slopes = plain.value_and_grad(values_at)
        assert abs(value - expected) < 1e-12
        assert all(abs(gradient[name] - slopes[name]) < SHIFT * 1.000001 for name in slopes)  # as three lines in one point move


def test_a_thousand_lines_compile_as_quickly_as_forty() -> None:
    def statements_of(n: int) -> int:
        rates, heights = lines(n)
        f = teg.compile(teg.integral(teg.maximum(*(p * x + q for p, q in zip(rates, heights, strict=True))), (x, 0, 1)), heights)
        tabled = tables_of(f)
        assert tabled is not None
        return array_size(tabled.program)

    assert statements_of(1000) == statements_of(40)


def test_a_maximum_that_is_no_partition_is_written_out() -> None:
    ts = [teg.param(f"t{k}") for k in range(5)]
    f = teg.compile(teg.integral(teg.maximum(*(teg.sin(t * x) for t in ts)), (x, 0, 1)), [])
    assert tables_of(f) is None
    at = {t.name: 1.0 + k for k, t in enumerate(ts)}
    places = np.linspace(0, 1, 200_001)
    values_there = np.max([np.sin(v * places) for v in at.values()], axis=0)
    assert abs(f(at) - np.mean((values_there[1:] + values_there[:-1]) / 2)) < 1e-9
