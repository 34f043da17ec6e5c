"""Integrals in the distance from their singularities: digits that the variable itself does not have."""

from __future__ import annotations

import math

import numpy as np
import pytest

import teg
from teg.passes.normalise.centre import centred

x, y, v = teg.vars("x y v")
p, q, r = teg.params("p q r")
g = r * r - x * x - y * y
in_disk = ((x, -2, 2), (y, -2, 2))
inside = x * x + y * y < r * r

TWO_ENDS = {"p": 4.984252948620799, "q": 0.9}
BELOW, ABOVE = ((2 * end + 0.9 - 4.984252948620799) / 5.884252948620799 for end in (2, 5))
"""∫ dx/√((p - x)(x + q)) is the arcsine, and beyond p the inverse hyperbolic cosine, of (2x + q - p)/(p + q)."""
TWO_VALUES = (
    math.pi / 2 - math.asin(BELOW) + math.acosh(ABOVE),
    {"p": (5.8 / math.sqrt(1 - BELOW**2) - 11.8 / math.sqrt(ABOVE**2 - 1)) / 5.884252948620799**2},
)

CASES: dict[str, tuple[teg.Expr, dict[str, float], float, dict[str, float]]] = {
    "two factors": (teg.integral(1 / teg.sqrt(abs((p - x) * (x + q))), (x, 2, 5)), TWO_ENDS, *TWO_VALUES),
    "a product multiplied out": (teg.integral(1 / teg.sqrt(abs(p * x + p * q - x * x - x * q)), (x, 2, 5)), TWO_ENDS, *TWO_VALUES),
    **{
        f"|x-p|^-{k}": (
            teg.integral(abs(x - p) ** -k, (x, 0, 1)), {"p": 0.3}, (0.3 ** (1 - k) + 0.7 ** (1 - k)) / (1 - k), {"p": 0.3**-k - 0.7**-k},
        )
        for k in (0.7, 0.9)
    },
    "at a bound that is not 0": (teg.integral((1 - x) ** -0.7 * p, (x, 0, 1)), {"p": 2.0}, 2 / 0.3, {"p": 1 / 0.3}),
    "reversed bounds": (teg.integral((x - p) ** -0.9, (x, 1, p)), {"p": 0.3}, -(0.7**0.1) / 0.1, {"p": 0.7**-0.9}),
    "arcsine law": (teg.integral(1 / teg.sqrt((x - p) * (1 - x)), (x, p, 1)), {"p": 0.3}, math.pi, {"p": 0.0}),
    "a root that is a bound": (teg.integral(1 / teg.sqrt(1 - (x / p) ** 2), (x, 0, p)), {"p": 0.6}, 0.3 * math.pi, {"p": math.pi / 2}),
    "a root that is an edge": (
        teg.integral(teg.where(x < p, 1 / teg.sqrt(1 - (x / p) ** 2), 0), (x, 0, 1)), {"p": 0.6}, 0.3 * math.pi, {"p": math.pi / 2},
    ),
    "arcsine up to an edge": (
        teg.integral(teg.where(x < p, teg.asin(x / p), 0), (x, 0, 1)), {"p": 0.7}, 0.7 * (math.pi / 2 - 1), {"p": math.pi / 2 - 1},
    ),
    "1/√ in a disk, by a multiple of its surface": (
        teg.integral(teg.where(inside, 1 / teg.sqrt(1 - (x * x + y * y) / r**2), 0), *in_disk),
        {"r": 1.1}, 2.42 * math.pi, {"r": 4.4 * math.pi},
    ),
    "1/√ in a disk": (teg.integral(teg.where(inside, 1 / teg.sqrt(g), 0), *in_disk), {"r": 1.1}, 2.2 * math.pi, {"r": 2 * math.pi}),
    "a power in a disk": (
        teg.integral(teg.where(inside, g**-0.3, 0), *in_disk), {"r": 1.1}, math.pi / 0.7 * 1.1**1.4, {"r": 2 * math.pi * 1.1**0.4},
    ),
    "a line": (
        teg.integral(abs(y - p) ** -0.5 * teg.exp(x), (x, 0, 1), (y, 0, 1)),
        {"p": 0.4},
        2 * (0.4**0.5 + 0.6**0.5) * (math.e - 1),
        {"p": (0.4**-0.5 - 0.6**-0.5) * (math.e - 1)},
    ),
    "a logarithm on a slope": (
        teg.integral(teg.log(abs(y - p * x)), (y, 0, 1), (x, 0, 1)),
        {"p": 1.0},
        -1.5,
        {"p": 0.5},  # ∫ x·log(x/(1 - x)) dx
    ),
    "two points": (
        teg.integral(abs(x - p) ** -0.9 + abs(x - q) ** -0.8, (x, 0, 1)),
        {"p": 0.3, "q": 0.4},
        (0.3**0.1 + 0.7**0.1) / 0.1 + (0.4**0.2 + 0.6**0.2) / 0.2,
        {"p": 0.3**-0.9 - 0.7**-0.9, "q": 0.4**-0.8 - 0.6**-0.8},
    ),
}  # fmt: skip


def check(name: str, backend: str) -> None:
    e, at, value, gradient = CASES[name]
    f = teg.compile(e, backend=backend)
    found, error = f.value_and_error(**at)
    assert found == pytest.approx(value, rel=1e-10)
    assert abs(found - value) <= 10 * error + 1e-14 * abs(value)
    for parameter, truth in gradient.items():
        assert f.grad(**at)[parameter] == pytest.approx(truth, abs=1e-9)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_value_and_gradient(name: str, backend: str) -> None:
    check(name, backend)


@pytest.mark.parametrize("name", ["arcsine law"])
@pytest.mark.usefixtures("x64")
def test_value_and_gradient_in_jax(name: str) -> None:
    check(name, "jax")


@pytest.mark.parametrize("e", [teg.sqrt(x), x**-0.5, teg.sqrt(p - x), (1 + x) ** 1.5, teg.log(2 + x), 1 / (x - p)], ids=str)
def test_other_integrals_stay_as_they_are(e: teg.Expr) -> None:
    whole = teg.integral(e, (x, 0, 1))
    assert centred(whole) is whole


def test_a_root_outside_of_the_bounds_is_moved_to_the_nearest_one() -> None:
    f = teg.compile(teg.integral(abs(x - p) ** -0.5, (x, 0, 1)))
    for c in (-1e9, -1.0, 0.0, 1.0, 1e9):
        assert f(p=c) == pytest.approx(2 * abs(math.sqrt(abs(1 - c)) - math.sqrt(abs(c))), rel=1e-6 if abs(c) > 1e8 else 1e-10)


def test_the_distance_from_a_corner_to_which_a_singular_line_runs_is_not_rounded() -> None:
    """1 - y near the corner (1, 1) is (1 - p·x) - w, not 1 - (p·x + w): else nodes look for what rounding makes, 57 million of them."""
    e, at, _, gradient = CASES["a logarithm on a slope"]
    f = teg.compile(e)
    assert f.grad(**at)["p"] == pytest.approx(gradient["p"], abs=1e-10)
    assert f.evaluations(derivatives=1, **at) < 2_000_000


@pytest.mark.parametrize("name", ["c", "w", "g", "P", "L", "c′"])
def test_the_names_of_inner_variables_do_not_matter(name: str) -> None:
    """What is written in the distance w from a centre c has names of its own, also inside an inner integral over a variable w."""
    z = teg.var(name)
    inner = teg.exp(z * (x + z)) + teg.exp(z * (x - p))
    f = teg.compile(teg.integral(abs(x - p) ** -0.5 * teg.integral(inner, (z, 0, 1)), (x, 0, 1)), [p])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    expected = 0.0
    for side, length in ((-1.0, 0.3), (1.0, 0.7)):  # x = p ± u², so that dx/|x - p|^½ is 2·du
        place = 0.3 + side * length * nodes[:, None] ** 2
        below = np.exp(nodes * (place + nodes)) + np.exp(nodes * (place - 0.3))
        expected += 2.0 * math.sqrt(length) * float(weights @ below @ weights)
    assert f(p=0.3) == pytest.approx(expected, rel=1e-10)


def test_a_condition_of_an_inner_integral_is_no_edge() -> None:
    """v·(x² - p²) > 0 has the roots of x² - p², but v is not known outside."""
    inner = teg.integral(teg.where(v * (x * x - p * p) < 0.1 * v, 1, 2), (v, 1, 2))
    f = teg.compile(teg.integral(abs(x * x - p * p) ** -0.5 * inner, (x, 0, 1)), [p])
    expected = math.pi / 2 + math.acosh(math.sqrt(0.35) / 0.5) + 2 * (math.acosh(1 / 0.5) - math.acosh(math.sqrt(0.35) / 0.5))
    assert f(p=0.5) == pytest.approx(expected, rel=1e-9)


def test_roots_in_a_known_order_are_not_compared() -> None:
    """m ± s are in ascending order; the roots of a quadratic whose sign is not known have to be compared."""
    known = teg.integral(teg.where(inside, g**-0.3, 0), (x, -2, 2))
    unknown = teg.integral(teg.where(q * x * x < r * r, (r * r - q * x * x) ** -0.3, 0), (x, -2, 2))
    assert "min(-" not in str(centred(known))
    assert "min(-" in str(centred(unknown))
