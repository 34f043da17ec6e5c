"""Canonical atoms: one surface, one expression."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

import teg
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import ONE, ZERO
from teg.passes.normalise.canonicalise import canonicalise
from tests.references import REFERENCES, Reference

x, y = teg.vars("x y")
t, a, c = teg.params("t a c")


def over(e: teg.Expr, hi: object = 1) -> teg.Expr:
    return teg.integral(e, (x, 0, hi))


def surfaces(e: teg.Expr) -> list[str]:
    return sorted({str(atom.g) for atom in atoms_of(e)})


@pytest.mark.parametrize(
    ("e", "normal"),
    [
        (over(teg.bracket(x < t)), over(teg.bracket(x < t))),
        (over(teg.bracket((x < t) & (2 * x < 2 * t))), over(teg.bracket(x < t))),
        (over(teg.bracket((x < t) & (-3 * t < -3 * x))), over(teg.bracket(x < t))),
        (over(teg.bracket((x < t) & (t <= x))), ZERO),
        (over(teg.bracket((x < t) | (t <= x))), ONE),
        (over(teg.bracket((x < t) & (x * teg.exp(a) < t * teg.exp(a)))), over(teg.bracket(x < t))),
        (over(a * x * t), a * t * over(x)),
        (over(teg.bracket(x < t) + x * teg.bracket(x < a)), over(teg.bracket(x < t)) + over(x * teg.bracket(x < a))),
        (over(teg.bracket(x < t), t), t * teg.bracket(t > 0)),
        (over(teg.bracket(t < a)), teg.bracket(t < a)),
    ],
    ids=lambda e: str(e),
)
def test_normal_form(e: teg.Expr, normal: teg.Expr) -> None:
    found = canonicalise(e)
    assert found is normal or str(found) == str(normal)


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (over(teg.bracket(x < t) * teg.bracket(2 * x < 2 * t) * teg.bracket(3 * x - 1 < 3 * t - 1)), 1),
        (over(teg.bracket(a * x < a * t)), 2),  # a and x - t
        (teg.integral(teg.bracket((y - c) * (x - t) > 0), (x, 0, 1), (y, 0, 1)), 2),
        (over(teg.bracket(teg.bracket(x < t) * x < 0.2)), 2),
        (over(teg.bracket((x - 0.5) ** 3 * (x - t) > 0)), 2),
        (over(teg.bracket((x - 0.5) ** 2 * teg.exp(x) * (x - t) > 0)), 1),
        (over(teg.bracket((x < t) & (t < x))), 1),
        (over(teg.bracket(x**3 * (x - t) > 0)), 1),  # a bound decides x
        (over(teg.bracket((x < t) & (x < t + 1))), 2),
        (over(teg.bracket(teg.abs(x - t) < a)), 3),
    ],
    ids=lambda v: str(v),
)
def test_how_many_surfaces(e: teg.Expr, expected: int) -> None:
    assert len(surfaces(canonicalise(e))) == expected


def test_one_surface_is_one_expression_across_integrals() -> None:
    e = over(teg.bracket(x < t) * x) + over(teg.bracket(2 * t - 2 * x > 0) * teg.exp(x))
    assert len(surfaces(canonicalise(e))) == 1


def test_strictness_is_kept() -> None:
    for strict, closed in ((x < t, x <= t), (2 * x < 2 * t, -x >= -t)):
        e = over(teg.bracket((x < t) & closed)) - over(teg.bracket((x < t) & strict))
        assert teg.evaluate(e, {t: 0.5}) == 0.0
    kept = canonicalise(over(teg.bracket(x < t) * teg.bracket(t <= x)))
    assert kept is ZERO


def test_terms_that_may_diverge_alone_stay_together() -> None:
    e = over((1 - teg.cos(x)) / x**2 + teg.bracket(x < t))
    assert teg.evaluate(e, {t: 0.5}) == pytest.approx(teg.evaluate(over((1 - teg.cos(x)) / x**2)) + 0.5, rel=1e-10)
    assert teg.evaluate(over(1 / x - teg.exp(-x) / x)) == pytest.approx(0.7965995992970531343, rel=1e-9)


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda r: r.id)
def test_the_value_is_preserved(reference: Reference) -> None:
    e = reference.build()
    expected = float(reference.value)
    found = teg.evaluate(canonicalise(canonicalise(e)), reference.params)
    assert abs(found - expected) <= reference.tolerance * (abs(expected) or 1)


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda r: r.id)
def test_twice_is_once(reference: Reference) -> None:
    once = canonicalise(reference.build())
    assert canonicalise(once) is once


@pytest.mark.parametrize(("s", "at"), list(itertools.product((-2.0, -1e-9, 0.0, 1e-9, 3.0), (0.3, 0.8))))
def test_a_factor_of_either_sign(s: float, at: float) -> None:
    for strict in (True, False):
        condition = a * x < a * t if strict else a * x <= a * t
        expected = at if s > 0 else 1 - at if s < 0 else 0.0 if strict else 1.0
        assert teg.evaluate(over(teg.bracket(condition)), {a: s, t: at}) == pytest.approx(expected, abs=1e-15)


def test_the_sign_of_a_product_of_three_factors() -> None:
    """Positive between the first two places and beyond the third."""
    p, q = teg.params("p q")
    f = teg.compile(over(teg.bracket((x - p) * (x - q) * (x - t) > 0)), backend="numpy")
    value, gradient = f.value_and_grad(p=0.2, q=0.5, t=0.7)
    assert value == pytest.approx(0.3 + 0.3, rel=1e-14)
    assert gradient == {"p": -1.0, "q": 1.0, "t": -1.0}


@pytest.mark.parametrize("width", [0.4, -0.4])
def test_surfaces_that_differ_by_a_denominator_are_one(width: float) -> None:
    """1 - x/a > 0 is x < a for positive a, and x > a for negative a: a jump of both together is counted once."""
    e = over(teg.bracket(x < a) * teg.bracket(1 - x / a > 0) * x**2)
    assert surfaces(canonicalise(e)) == ["a", "a - x"]
    value, gradient = teg.compile(e, backend="numpy").value_and_grad(a=width)
    assert value == pytest.approx(width**3 / 3 if width > 0 else 0.0, rel=1e-14)
    assert gradient["a"] == pytest.approx(width**2 if width > 0 else 0.0, rel=1e-14)


def test_factors_that_cancel_but_for_a_denominator() -> None:
    """(1 - x/a)(a - x) is a square divided by a: the product has the sign of (x - t)/a."""
    e = over(teg.bracket((1 - x / a) * (a - x) * (x - t) > 0) * x**2)
    for width, whole in ((0.6, (1 - 0.3**3) / 3), (-0.6, 0.3**3 / 3)):
        value, gradient = teg.compile(e, backend="numpy").value_and_grad(a=width, t=0.3)
        assert value == pytest.approx(whole, rel=1e-14)
        assert gradient == pytest.approx({"a": 0.0, "t": -0.09 if width > 0 else 0.09}, rel=1e-14)


def test_a_difference_of_squares_has_the_surfaces_of_a_distance() -> None:
    assert surfaces(canonicalise(over(teg.bracket((x - t < a) & (a + x - t > 0)) * teg.bracket(((x - t) / a) ** 2 < 1)))) == [
        "a + x - t",
        "a - (x - t)",
    ]


U, V = x - t, y - a
CROSSED = {
    "a product": (U * V, U * V > 0),
    "expanded": (U * V, x * y - a * x - t * y + t * a > 0),
    "an arc tangent": (U * V, teg.atan(U * V) > 0),
    "a hyperbolic tangent": (U * V, teg.tanh(U * V) > 0),
    "an exponential": (U * V, teg.exp(U * V) > 1),
    "a cubic": (U * V, (U * V) ** 3 + U * V > 0),
    "beside a sum of squares": (U * V, teg.minimum(U * V, 1 + (U * V) ** 2) > 0),
    "two lines": ((U - V) * (U - 2 * V), U**2 - 3 * U * V + 2 * V**2 > 0),
    "two lines of irrational slope": ((U - math.sqrt(2) * V) * (U + math.sqrt(2) * V), U**2 - 2 * V**2 > 0),
    "lines of parameters": ((U - c * V) * (U - V), U**2 - U * V - c * U * V + c * V**2 > 0),
    "a point": (1 + 0 * U, U**2 + V**2 > 0),
}


@pytest.mark.parametrize("case", CROSSED)
def test_surfaces_that_cross_themselves_are_factors(case: str) -> None:
    """In one piece they gave second derivatives without the places where they cross: off by 1.7, or infinite, without a warning."""
    at = {"t": 0.31, "a": 0.26, "c": 0.4}
    product, condition = CROSSED[case]
    weight = (1 + x) * teg.exp(x - y)
    f, g = (
        teg.compile(teg.integral(teg.bracket(b) * weight, (x, -1, 1), (y, -1, 1)) + 0 * (t + a + c), [t, a, c], backend="numpy")
        for b in (product > 0, condition)
    )
    (value, gradient), (expected, slopes) = g.value_and_grad(at), f.value_and_grad(at)
    assert value == pytest.approx(expected, rel=1e-9)
    assert gradient == pytest.approx(slopes, rel=1e-9, abs=1e-10)
    assert list(g.hessian(at).values()) == pytest.approx(list(f.hessian(at).values()), rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("name", ["U·V", "(U - V)(U - 2V)"])
def test_the_second_derivatives_of_crossed_lines(name: str) -> None:
    """Against differences of gradients."""
    product = U * V if name == "U·V" else (U - V) * (U - 2 * V)
    f = teg.compile(teg.integral(teg.bracket(product > 0) * (1 + x) * teg.exp(x - y), (x, -1, 1), (y, -1, 1)), [t, a], backend="numpy")
    h, step = f.hessian(t=0.31, a=0.26), 1e-5
    for name in ("t", "a"):
        up, down = (f.grad({"t": 0.31, "a": 0.26, name: {"t": 0.31, "a": 0.26}[name] + s}) for s in (step, -step))
        for other in ("t", "a"):
            assert h[other, name] == pytest.approx((up[other] - down[other]) / (2 * step), rel=1e-7, abs=1e-8)


def test_sums_of_squares_have_no_surface() -> None:
    assert surfaces(canonicalise(over(teg.bracket(1 + (x - t) ** 2 > 0)))) == []
    assert surfaces(canonicalise(over(teg.bracket(1 + teg.sqrt(x - t) > 0)))) != []  # it may be undefined


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_lines_of_extreme_numbers(scale: float) -> None:
    """The number in front of a discriminant may be no float64: the condition stays as it is."""
    condition = (scale * U) ** 2 - 3 * (scale * U) * (scale * V) + 2 * (scale * V) ** 2 > 0
    assert canonicalise(teg.integral(teg.bracket(condition), (x, -1, 1), (y, -1, 1))).has_integral


def test_a_surface_keeps_its_sign_where_a_denominator_of_another_one_is_0() -> None:
    """x < a at a = 0, beside a program divided by a that is not used there."""
    e = teg.where(a > 0, over(teg.bracket(1 - x / a > 0)), 0) + teg.integral(teg.bracket(a - x > 0), (x, -1, 1))
    f = teg.compile(e, [a], backend="numpy")
    assert f(a=0.0) == pytest.approx(1.0, rel=1e-14)
    assert f(a=0.5) == pytest.approx(2.0, rel=1e-14)


@pytest.mark.parametrize("slope", [0.0, 1e-9, -0.4, 0.4])
def test_two_lines_of_which_one_may_be_upright(slope: float) -> None:
    """(c·U - V)(U - V) expanded, with a number or 0 in front of U² and V²: at c = 0 its curvature in x is 0."""
    expanded = c * U**2 - (c + 1) * U * V + V**2 > 0
    areas = [
        teg.evaluate(teg.integral(teg.bracket(condition), (x, -1, 1), (y, -1, 1)), {t: 0.3, a: 0.2, c: slope})
        for condition in (expanded, (c * U - V) * (U - V) > 0)
    ]
    assert areas[0] == pytest.approx(areas[1], rel=1e-9)


@pytest.mark.parametrize(("s", "expected"), [(0.0, 0.0), (2.0, 0.3), (-2.0, 0.3)])
def test_a_parameter_that_is_a_factor_twice_may_be_0(s: float, expected: float) -> None:
    assert teg.evaluate(over(teg.bracket(a * (a * t - a * x) > 0)), {a: s, t: 0.3}) == pytest.approx(expected, abs=1e-15)


def test_a_root_of_a_sum_of_squares_is_positive() -> None:
    """As a denominator it has no sign of its own: the Hessian had point masses of two surfaces in one product, an AssertionError."""
    as_quotient, as_product = (
        teg.integral(teg.bracket(condition), (x, 0, 1), (y, 0, 1))
        for condition in (teg.sin(x) / teg.sqrt(1 + y * y) < a, teg.sin(x) < a * teg.sqrt(1 + y * y))
    )
    assert surfaces(canonicalise(as_quotient)) == surfaces(canonicalise(as_product)) == ["a·√(y² + 1) - sin(x)"]
    found, wanted = (teg.compile(e, [a], backend="numpy").hessian(a=0.56)["a", "a"] for e in (as_quotient, as_product))
    assert found == pytest.approx(wanted, rel=1e-12)


def test_one_and_the_square_of_a_tangent_are_one_over_the_square_of_a_cosine() -> None:
    """A sum sin² + cos² stayed in the surface."""
    assert surfaces(canonicalise(over(teg.bracket(a * (1 + teg.tan(x) ** 2) > t)))) == ["a - t·cos(x)²"]


def smooth_union(first: teg.Expr, second: teg.Expr, width: float) -> teg.Expr:
    h = teg.minimum(teg.maximum(0.5 + 0.5 * (second - first) / width, 0), 1)
    return second * (1 - h) + first * h - width * h * (1 - h)


DISKS = teg.sqrt((x - a) ** 2 + y**2) - 0.3, teg.sqrt((x + 0.3) ** 2 + (y - c) ** 2) - 0.35
WAIST = teg.integral(teg.bracket(smooth_union(*DISKS, 0.2) < t), (x, -1, 1), (y, -1, 1))


def test_a_kink_without_formula_is_no_surface() -> None:
    """The mix ends where the distances of the disks differ by its width: five surfaces, if it is split there."""
    assert len(surfaces(canonicalise(WAIST))) == 1


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
def test_two_disks_with_a_rounded_waist(backend: str, x64_for_jax: None) -> None:
    """Beside a trapezoid rule along rays from between them. The gradient took 26 s and missed the tolerance."""
    f = teg.compile(WAIST, [a, c, t], backend=backend)
    value, gradient = f.value_and_grad(a=0.3, c=0.1, t=0.02)

    phi = (np.arange(20_000) + 0.5) * (2 * math.pi / 20_000)
    cosine, sine = np.cos(phi), np.sin(phi)

    def sides(r: Any) -> tuple[Any, ...]:
        """The function and its derivatives by r, a, c."""
        x1, y1, x2, y2 = r * cosine - 0.3, r * sine + 0.05, r * cosine + 0.3, r * sine + 0.05 - 0.1
        d1, d2 = np.hypot(x1, y1) - 0.3, np.hypot(x2, y2) - 0.35
        h = np.clip(0.5 + 2.5 * (d2 - d1), 0, 1)
        n1, n2 = (np.stack([u, v]) / np.hypot(u, v) for u, v in ((x1, y1), (x2, y2)))
        outward = h * (n1[0] * cosine + n1[1] * sine) + (1 - h) * (n2[0] * cosine + n2[1] * sine)
        return d2 * (1 - h) + d1 * h - 0.2 * h * (1 - h), outward, -h * n1[0], -(1 - h) * n2[1]

    r = np.full_like(phi, 0.5)
    for _ in range(40):
        g, outward, _, _ = sides(r)
        r = r - (g - 0.02) / outward
    _, outward, by_a, by_c = sides(r)
    per_ray = math.pi / len(phi) * 2
    assert value == pytest.approx(0.5 * np.sum(r * r) * per_ray, rel=1e-8)
    for name, rate in {"a": -by_a, "c": -by_c, "t": np.ones_like(phi)}.items():
        assert gradient[name] == pytest.approx(np.sum(r * rate / outward) * per_ray, rel=1e-7), name


EQUAL = {
    "a product": ((a + x) * (a - x), a * a - x * x),
    "a square": ((x + y) ** 2, x * x + 2 * x * y + y * y),
    "terms in another order": ((a + a) - (x + a), a - x),
    "a quotient": (1 / (x + 1) + 1 / (x + 2), (2 * x + 3) / ((x + 1) * (x + 2))),
    "of branches": (teg.maximum(x, a) + teg.minimum(x, a), x + a),
    "beside a surface": ((x - t) * (x + t) + t * t, x * x),
}
"""Two ways to write a function."""


@pytest.mark.parametrize("name", EQUAL)
def test_a_function_is_not_less_than_itself(name: str) -> None:
    """Rounding makes their difference positive here and negative there."""
    first, second = EQUAL[name]
    for less, orders in (ZERO, (first < second, second < first)), (ONE, (first <= second, second <= first)):
        for condition in orders:
            assert canonicalise(over(teg.bracket(condition))) is less
        bound = teg.compile(teg.integral(teg.bracket(orders[0]), (x, 0, t), (y, 0, 1)), [t, a])
        value, slopes = bound.value_and_grad(t=0.944, a=0.627)
        assert value == pytest.approx(0.944 if less is ONE else 0, rel=1e-15)
        assert slopes == {"t": 1.0 if less is ONE else 0.0, "a": 0.0}
