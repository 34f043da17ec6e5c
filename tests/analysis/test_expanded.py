"""Sums of monomials with exact coefficients: expansion, its limit, perfect powers, distances."""

from __future__ import annotations

import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.analysis.expanded import distance, expanded, perfect_power, shorter_form
from teg.analysis.polynomial import Point
from teg.ir.expr import ONE, ZERO, Const

x, y = teg.vars("x y")
a, b, c = teg.params("a b c")


def test_what_cancels_is_gone() -> None:
    assert expanded((x + a) * (x - a) - x * x + a * a) is ZERO
    assert expanded((a + 1) ** 2 - a**2 - 2 * a) is ONE
    assert expanded(0.1 * a + 0.2 * a - 0.3 * a) is not ZERO  # 0.1 + 0.2 is not 0.3 in binary numbers


def test_the_value_is_preserved() -> None:
    product = expanded((x + 1) * (y - a))
    assert product is not None
    assert Point("q").value(product) == Point("q").value((x + 1) * (y - a))


def test_long_sums_are_left_alone() -> None:
    assert expanded((a + b + c + 1) ** 2, limit=4) is None
    assert expanded((a + b + c + 1) ** 2) is not None


def test_whole_expressions_are_generators() -> None:
    e = (a - b) * x + (a - b) * y
    kept, plain = expanded(e, whole=[a - b]), expanded(e)
    assert kept is not None
    assert plain is not None
    assert (len(kept.children), len(plain.children)) == (2, 4)


@pytest.mark.parametrize(
    ("e", "k"), [((x + a) ** 2, 2), (-((x - 2 * a) ** 3), 3), (x**2 + 2 * x + 1, 2), (4 * x**4, 4), (-((x + 1) ** 2), 2)]
)
def test_perfect_powers(e: teg.Expr, k: int) -> None:
    found = perfect_power(e)
    assert found is not None
    factor, base, exponent = found
    assert exponent == k
    ratios = [whole / power for u in (3.0, 1.7) for whole, power in [values_of([e, base**k], {x: u, a: 0.25})]]
    assert ratios == pytest.approx([factor, factor], rel=1e-14)


def test_powers_of_quotients() -> None:
    """1/a² is the square of 1/a, and 1/a⁴ that of 1/a²."""
    root = x**2 - (a * y - 1) ** 2 / a**2
    found = perfect_power(x**4 - 2 * x**2 * ((a * y - 1) / a) ** 2 + (a * y - 1) ** 4 / a**4)
    assert found is not None
    assert found[2] == 2
    at = {x: 0.7, y: 0.3, a: 0.25}
    assert abs(values_of([found[1]], at)[0]) == pytest.approx(abs(values_of([root], at)[0]), rel=1e-14)


def test_numbers_of_a_root_that_must_be_rounded() -> None:
    root = (x - 0.1) ** 2 - y
    square = (x - 0.1) ** 4 - 2 * (x - 0.1) ** 2 * y + y**2
    assert perfect_power(square) is None
    found = perfect_power(square, exact=False)
    assert found is not None
    at = {x: 0.7, y: 0.3}
    assert abs(values_of([found[1]], at)[0]) == pytest.approx(abs(values_of([root], at)[0]), rel=1e-14)


@pytest.mark.parametrize("e", [x**2 + a, x * y, x + 1])
def test_other_expressions_are_no_powers(e: teg.Expr) -> None:
    assert perfect_power(e) is None


def test_the_distance_of_bounds() -> None:
    assert distance(a, a + 1) is ONE
    assert isinstance(distance(ZERO, ONE), Const)
    assert values_of([distance(a, 3 * b)], {a: 0.25, b: 2.0}) == [5.75]


@pytest.mark.parametrize("e", [(a - b) ** 2 + (a - c) ** 2, a * a - 2 * a * b + b * b])
def test_squares_of_far_coordinates_become_differences(e: teg.Expr) -> None:
    """a² alone would cancel where coordinates are far from 0."""
    form = shorter_form(e, variables=True)
    assert form is not None
    far = {a: 1e9 + 0.25, b: 1e9, c: 1e9 - 0.5}
    assert values_of([form], far)[0] == pytest.approx(0.625 if c in teg.ir.traverse.parameters(e) else 0.0625, rel=1e-12)


@pytest.mark.parametrize(
    ("e", "together"),
    [
        (a * a - 2 * a * b - c * c + 2 * b * c, (a, b, c)),  # a and c move together because b moves with either
        (4 * c * c - 4 * x * x + 8 * a * x - 4 * a * a, (x, a)),
        (x * x - 2 * a * x - b * b + 2 * a * b, (x, a, b)),
    ],
    ids=str,
)
def test_what_moves_together_becomes_differences(e: teg.Expr, together: tuple[teg.Expr, ...]) -> None:
    form = shorter_form(e, variables=True)
    assert form is not None
    assert len(form.children) == 2
    place = teg.param("x")
    near, far = ({place: 0.75 + by, a: 0.25 + by, b: by - 1.5, c: 0.375 + by * (c in together)} for by in (0.0, 2.0**30))
    assert values_of([teg.substitute(form, {x: place})], far) == values_of([teg.substitute(form, {x: place})], near)
