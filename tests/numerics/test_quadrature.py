"""Gauss-Legendre, its null rules, and the errors that are estimated with them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import mpmath
import numpy as np
import numpy.typing as npt
import pytest

import teg
from teg.backends.numpy.adaptive import measure
from teg.numerics.quadrature import NULL_RULES, decay_power, gauss_legendre, null_rules, tetrahedron_rule
from teg.program import NOISE, ROUNDING

ORDERS = [6, 8, 10, 12, 16, 18, 24]
Array = npt.NDArray[np.float64]


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 33, 64, 101])
def test_nodes_and_weights_are_rounded_once(n: int) -> None:
    nodes, weights = gauss_legendre(n)
    with mpmath.workdps(40):
        for x, w in zip(nodes, weights, strict=True):
            root = mpmath.findroot(lambda u: mpmath.legendre(n, u), mpmath.mpf(x)) if x else mpmath.mpf(0)
            slope = n * mpmath.legendre(n - 1, root) / (1 - root**2)
            assert x == float(root)
            assert w == float(2 / ((1 - root**2) * slope**2))
    assert list(nodes) == sorted(nodes)


@pytest.mark.parametrize("n", [1, 2, 5, 10, 18, 24])
def test_gauss_is_exact_to_degree_2n_minus_1(n: int) -> None:
    nodes, weights = gauss_legendre(n)
    for degree in range(2 * n + 1):
        with mpmath.workdps(30):
            found = mpmath.fsum(mpmath.mpf(w) * mpmath.mpf(x) ** degree for x, w in zip(nodes, weights, strict=True))
            error = abs(found - mpmath.mpf(1 + (-1) ** degree) / (degree + 1))
            # the error for x²ⁿ: 2²ⁿ⁺¹ n!⁴/((2n + 1)(2n)!²)
            beyond = mpmath.mpf(2) ** (2 * n + 1) * mpmath.factorial(n) ** 4 / ((2 * n + 1) * mpmath.factorial(2 * n) ** 2)
        assert error == pytest.approx(float(beyond) if degree == 2 * n else 0.0, abs=1e-15)


def test_a_rule_has_a_node() -> None:
    with pytest.raises(ValueError, match="0"):
        gauss_legendre(0)


@pytest.mark.parametrize("degree", range(9))
def test_rules_on_a_tetrahedron_are_exact(degree: int) -> None:
    """The integral of rᵃsᵇtᶜ is a!b!c!/(a + b + c + 3)!, that of 1 is 1/6."""
    rule = tetrahedron_rule(degree)
    assert all(w > 0.0 for *_, w in rule)
    for a, b, c in product(range(degree + 1), repeat=3):
        if a + b + c <= degree:
            exact = 6 * math.factorial(a) * math.factorial(b) * math.factorial(c) / math.factorial(a + b + c + 3)
            assert math.fsum(w * r**a * s**b * t**c for r, s, t, w in rule) == pytest.approx(exact, rel=1e-13)


# Null rules


def orthonormal(degree: int, x: Array) -> Array:
    """The Legendre polynomial of norm 1 on (-1, 1)."""
    return np.array([math.sqrt(degree + 0.5) * float(mpmath.legendre(degree, float(v))) for v in x])


@pytest.mark.parametrize("n", [3, 6, 7, 10, 18])
def test_null_rules_are_orthonormal_coefficients(n: int) -> None:
    """Row i is 1 for the polynomial of degree n - 1 - i, and annihilates all others that the nodes can tell apart."""
    x = np.array(gauss_legendre(n)[0])
    rules = np.array(null_rules(n))
    assert rules.shape == (NULL_RULES, n)
    wanted = np.array([[float(n - 1 - i == degree >= 1) for degree in range(n)] for i in range(NULL_RULES)])
    np.testing.assert_allclose(rules @ np.array([orthonormal(d, x) for d in range(n)]).T, wanted, atol=1e-14)


@pytest.mark.parametrize("n", [7, 10, 18])
def test_null_rules_annihilate_what_is_below_their_degree(n: int) -> None:
    """Whatever the rule is exact for and has a low degree has no error at all."""
    x, rules = np.array(gauss_legendre(n)[0]), np.array(null_rules(n))
    powers = np.array([x**degree for degree in range(n)])
    for i in range(NULL_RULES):
        np.testing.assert_allclose(powers[: n - 1 - i] @ rules[i], 0.0, atol=1e-14)
        assert abs(powers[n - 1 - i] @ rules[i]) > 1e-6
    for values in powers[: n - NULL_RULES]:
        assert estimate(values, n)[2] <= 2 * ROUNDING


@pytest.mark.parametrize("n", [6, 10, 17])
def test_null_rules_are_even_or_odd(n: int) -> None:
    for i, row in enumerate(null_rules(n)):
        np.testing.assert_allclose(row, (-1.0) ** (n - 1 - i) * np.array(row[::-1]), atol=1e-16)


def test_one_node_has_no_coefficients() -> None:
    assert null_rules(1) == ((2.0,), *((0.0,),) * 5)


def test_two_nodes_have_one_coefficient() -> None:
    """It is 0 for an even function, so the rule itself is the second row."""
    odd, even, *others = null_rules(2)
    np.testing.assert_allclose(odd, [-math.sqrt(0.5), math.sqrt(0.5)], rtol=1e-15)
    assert even == (1.0, 1.0)
    assert others == [(0.0, 0.0)] * 4


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("order", [1, 2, 3, 5])
@pytest.mark.usefixtures("x64_for_jax")
def test_few_nodes_do_not_call_an_even_function_exact(order: int, backend: Any) -> None:
    """With two nodes the estimate of ∫cos 3x over (-1, 1) was 7e-16, with an error of 0.4."""
    x, t = teg.var("x"), teg.param("t")
    e = teg.integral(t * teg.cos(3 * x), (x, -1, 1))
    value, error = teg.compile(e, backend=backend, rule="gauss", order=order).value_and_error(t=1.0)
    assert abs(value - 2 / 3 * math.sin(3)) <= 10 * error


def test_the_decay_counted_on_is_less_than_an_analytic_function_allows() -> None:
    powers = [decay_power(n) for n in range(1, 65)]
    assert powers == sorted(powers)
    assert powers[0] == 0
    assert all(0 < power < (n + 1) / 2 for n, power in enumerate(powers, 1) if n >= 6)


# Errors


@dataclass(frozen=True)
class Family:
    """f(x; p) on (-1, 1) for some p, with its exact integral."""

    name: str
    f: Callable[[Array, float], Array]
    area: Callable[[float], float]
    parameters: tuple[float, ...]


def _arctangents(p: float) -> float:
    return (math.atan(0.7 / p) + math.atan(1.3 / p)) / p


def _roots(p: float) -> float:
    return 2 / 3 * ((p + 1) ** 1.5 - (p - 1) ** 1.5)


def _logarithms(p: float) -> float:
    return (p + 1) * (math.log(p + 1) - 1) - (p - 1) * (math.log(p - 1) - 1)


BEYOND = (1.001, 1.01, 1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0)
AWAY = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0, 4.0)
ANALYTIC = (
    Family("1/(x - p)", lambda x, p: 1 / (x - p), lambda p: math.log((p - 1) / (p + 1)), BEYOND),
    Family("1/(x - p)²", lambda x, p: 1 / (x - p) ** 2, lambda p: 2 / (p * p - 1), BEYOND),
    Family("1/(x² + p²)", lambda x, p: 1 / (x * x + p * p), lambda p: 2 / p * math.atan(1 / p), AWAY),
    Family("1/((x - 0.3)² + p²)", lambda x, p: 1 / ((x - 0.3) ** 2 + p * p), _arctangents, AWAY),
    Family("√(p + x)", lambda x, p: np.sqrt(p + x), _roots, (1.0, *BEYOND)),
    Family("log(p + x)", lambda x, p: np.log(p + x), _logarithms, BEYOND),
    Family("exp(p·x)", lambda x, p: np.exp(p * x), lambda p: 2 * math.sinh(p) / p, (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0)),
    Family(
        "cos(p·x + 1)",
        lambda x, p: np.cos(p * x + 1),
        lambda p: 2 * math.sin(p) / p * math.cos(1),
        (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 12.0, 15.0, 20.0),
    ),
    Family(
        "exp(-p·x²)",
        lambda x, p: np.exp(-p * x * x),
        lambda p: math.sqrt(math.pi / p) * math.erf(math.sqrt(p)),
        (1.0, 5.0, 10.0, 20.0, 50.0, 100.0),
    ),
)
ROUGH = (
    Family("(1 + x)^p", lambda x, p: (1 + x) ** p, lambda p: 2 ** (p + 1) / (p + 1), (-0.4, 0.5, 1.5, 2.5)),
    Family("|x - p|", lambda x, p: np.abs(x - p), lambda p: 1 + p * p, (0.1, 0.5, 0.9)),
    Family("[x > p]", lambda x, p: (x > p) * 1.0, lambda p: 1 - p, (0.0, 0.1, 0.5, 0.9)),
)


def estimate(values: Array, n: int) -> tuple[float, float, float]:
    """Sum, sum of sizes, and estimated error."""
    with np.errstate(divide="ignore", invalid="ignore"):
        total, size, error = (float(v[0]) for v in measure(values[:, None], n))
    return total, size, error + 0.5 * ROUNDING * size


@pytest.mark.parametrize("n", ORDERS)
@pytest.mark.parametrize("family", [*ANALYTIC, *ROUGH], ids=lambda family: family.name)
def test_the_estimate_is_at_least_the_error(family: Family, n: int) -> None:
    """Where the nodes see the function at all: what errs by a quarter of it is far from acceptance, and is known to be."""
    x = np.array(gauss_legendre(n)[0])
    for p in family.parameters:
        total, size, error = estimate(family.f(x, p), n)
        true = abs(total - family.area(p))
        if true < 0.25 * size:
            assert error >= true
        else:
            assert error > 0.01 * size


@pytest.mark.parametrize("n", [10, 18])
def test_the_estimate_is_not_idle(n: int) -> None:
    """It decays with the distance of a pole as the error does, to the exponent n + 3 of 2n, and comes down to rounding."""
    x = np.array(gauss_legendre(n)[0])
    for p in (1.5, 2.0, 3.0, 5.0):
        _, size, error = estimate(1 / (p - x), n)
        rho = p + math.sqrt(p * p - 1)
        assert error < max(100 * size * rho ** -(n + 3), ROUNDING * size)
    assert estimate(np.exp(x), n)[2] < (100 * ROUNDING if n > 10 else 1e-10)


def test_rounding_is_not_taken_for_an_error() -> None:
    """Values that are rounded, but otherwise a polynomial, have the error 0."""
    random = np.random.default_rng(3)
    x = np.array(gauss_legendre(18)[0])
    for _ in range(100):
        values = np.polyval(random.normal(size=8), x) * (1 + 2.0**-53 * random.uniform(-1, 1, 18))
        _, size, error = measure(values[:, None], 18)
        assert error[0] == 0.0
    noise = values + 100 * NOISE * size[0] * random.normal(size=18)
    assert measure(noise[:, None], 18)[2][0] > NOISE * size[0]


def test_what_is_not_a_number_has_no_error() -> None:
    assert math.isnan(estimate(np.full(10, math.nan), 10)[2])
    assert math.isnan(estimate(np.array([math.nan] + [1.0] * 9), 10)[2])
    total, size, error = estimate(np.array([math.inf] + [1.0] * 9), 10)
    assert total == size == math.inf
    assert not math.isfinite(error)
