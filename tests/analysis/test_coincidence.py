"""Conditions that say the same in other words: their short forms, and the derivatives of programs that hold several of them."""

from __future__ import annotations

import itertools
import math
import random
import warnings
from collections.abc import Callable

import mpmath
import pytest

import teg
from teg.analysis.coincidence import ZeroSet, coincide, peeled, short_form
from teg.analysis.expanded import perfect_power
from teg.analysis.field_polynomials import common_factor, derivative, one_root, product, quotient_and_remainder
from teg.analysis.polynomial import Point
from teg.evaluator.accuracy import AccuracyWarning
from teg.ir.expr import Expr
from teg.numerics.field import P, divided, sign_of_residue

x, y = teg.vars("x y")
r, s, t = teg.params("r s t")
rho = x * x + y * y

INCREASING: dict[str, Callable[[Expr], Expr]] = {
    "square": lambda u: u * u,
    "cube": lambda u: u**3,
    "twelfth power": lambda u: u**12,
    "power 2.5": lambda u: u**2.5,
    "logarithm": teg.log,
    "root": teg.sqrt,
    "root of the logarithm's argument": lambda u: teg.log(teg.sqrt(u)),
    "exponential": teg.exp,
    "falling exponential": lambda u: -teg.exp(-u),
    "tanh": teg.tanh,
    "atan": teg.atan,
    "sinh": teg.sinh,
    "erf": teg.erf,
    "minus erfc": lambda u: -teg.erfc(u),
    "log1p": teg.log1p,
    "expm1": teg.expm1,
    "cosh": teg.cosh,
    "sin": teg.sin,
    "tan": teg.tan,
    "asin": teg.asin,
    "acos": lambda u: -teg.acos(u),
    "inverse": lambda u: -1 / u,
    "quotient": lambda u: u / (1 + u),
    "bell": lambda u: -1 / (1 + u * u),
    "u + u³": lambda u: u + u**3,
    "u·exp u": lambda u: u * teg.exp(u),
    "u·√u": lambda u: u * teg.sqrt(u),
    "u + tanh u": lambda u: u + teg.tanh(u),
}
"""Functions that increase on (0, 1)."""

PAIRS = random.Random(1).sample(list(itertools.permutations(INCREASING, 2)), 24)


def gradient(e: Expr, backend: str = "numpy", **values: float) -> float:
    (name,) = values
    return float(teg.compile(e, backend=backend).grad(**values)[name])


class TestShortForms:
    @pytest.mark.parametrize(
        ("g", "expected"),
        [
            (teg.exp(x) - teg.exp(r), x - r),
            (2 * teg.atan(x) - 2 * teg.atan(r), x - r),
            (teg.tanh(teg.sinh(x)) - teg.tanh(teg.sinh(r)), x - r),
            (teg.erf(x) - teg.erf(r), x - r),
            (teg.erfc(x) - teg.erfc(r), r - x),
            (teg.expm1(x) - teg.expm1(r), x - r),
            (x**3 - r**3, x - r),
            (x**9 - (r * s) ** 9, x - r * s),
            (teg.log(x) - teg.log(r), teg.log(x) - teg.log(r)),
            (teg.exp(x) + teg.exp(r), teg.exp(x) + teg.exp(r)),
        ],
    )
    def test_functions_that_increase_everywhere_are_taken_off(self, g: Expr, expected: Expr) -> None:
        assert peeled(g) is peeled(expected)

    def test_even_powers_and_cosh_split(self) -> None:
        assert peeled(x**4 - r**4) is peeled(teg.cosh(x * x) - teg.cosh(r * r))

    @pytest.mark.parametrize(
        ("g", "k"),
        [
            ((t * x) ** 2 - 2 * t * x + 1, 2),
            (-x * x + 2 * x * r - r * r, 2),
            (x**3 - 3 * x * x * r + 3 * x * r * r - r**3, 3),
            (9 * x * x - 6 * x + 1, 2),
            (rho * rho - 2 * rho * r + r * r, 2),
        ],
    )
    def test_powers_written_out_are_found(self, g: Expr, k: int) -> None:
        found = perfect_power(g)
        assert found is not None
        factor, base, power = found
        first, second = (divided(p.value(base**power) or 0, p.value(g) or 1) for p in (Point("1"), Point("2")))
        assert power == k
        assert first == second
        assert sign_of_residue(first) == math.copysign(1.0, factor)
        assert perfect_power(g + x) is None

    def test_applying_it_twice_changes_nothing(self) -> None:
        for g in (teg.exp(x) - teg.exp(r), x**6 - r**6, x * x - 2 * x * r + r * r, rho - s):
            assert short_form(short_form(g)) is short_form(g)


class TestZeroSets:
    def test_a_surface_annuls_its_other_forms(self) -> None:
        zeros = ZeroSet(rho - s * s)
        assert zeros.annuls(rho * rho - s**4)
        assert zeros.annuls(teg.exp(rho) - teg.exp(s * s))
        assert not zeros.annuls(rho - s)

    def test_surfaces_that_share_a_factor_coincide(self) -> None:
        assert coincide((x - r) * (y - s), (x - r) * (x - s))
        assert coincide(y**12 - (r * x) ** 12, y - r * x)
        assert coincide(teg.log(y) - teg.log(r * x), teg.sqrt(y) - teg.sqrt(r * x))
        assert not coincide(rho - r * r, rho - 2 * r * x)

    def test_polynomials_over_the_field(self) -> None:
        p, q = product([3, 1], [5, 0, 1]), product([3, 1], [7, 1])
        assert common_factor(p, q) == [3, 1]
        assert derivative([1, 2, 3]) == [2, 6]
        assert quotient_and_remainder(product(p, q), q) == (p, [])
        root = one_root(product([-4 % P, 0, 1], [9, 1]))
        assert root in (2, P - 2, P - 9)
        assert one_root([1]) is None


class TestOneZeroSetInTwoForms:
    """∫ from r on, by r, is minus the integrand at r, however often the condition is said."""

    @pytest.mark.parametrize("name", INCREASING)
    def test_both_say_the_same(self, name: str) -> None:
        f = INCREASING[name]
        assert gradient(teg.integral(teg.bracket(x > r) * teg.bracket(f(x) > f(r)), (x, 0.05, 1)), r=0.3) == pytest.approx(-1, abs=1e-9)

    @pytest.mark.parametrize("name", INCREASING)
    def test_unions_differences_and_opposites(self, name: str) -> None:
        f = INCREASING[name]
        one, other = teg.bracket(x > r), teg.bracket(f(x) > f(r))
        union = teg.integral(teg.bracket((x > r) | (f(x) > f(r))), (x, 0.05, 1))
        assert gradient(union, r=0.3) == pytest.approx(-1, abs=1e-9)
        assert gradient(teg.integral((other - one) ** 2, (x, 0.05, 1)), r=0.3) == pytest.approx(0, abs=1e-9)
        assert gradient(teg.integral(one * teg.bracket(f(x) < f(r)), (x, 0.05, 1)), r=0.3) == pytest.approx(0, abs=1e-9)

    @pytest.mark.parametrize(("first", "second"), PAIRS)
    def test_two_other_forms(self, first: str, second: str) -> None:
        f, g = INCREASING[first], INCREASING[second]
        e = teg.integral(teg.exp(x) * teg.bracket(f(x) > f(r)) * teg.bracket(g(x) > g(r)), (x, 0.05, 1))
        assert gradient(e, r=0.37) == pytest.approx(-math.exp(0.37), rel=1e-9)

    @pytest.mark.parametrize("name", INCREASING)
    def test_lines_and_disks(self, name: str) -> None:
        f = INCREASING[name]
        line = teg.integral(teg.bracket(y > r * x) * teg.bracket(f(y) > f(r * x)), (x, 0.1, 0.9), (y, 0.01, 0.9))
        assert gradient(line, r=0.5) == pytest.approx(-0.4, rel=1e-9)
        disk = teg.integral(teg.bracket(rho < s * s) * teg.bracket(f(rho) < f(s * s)), (x, -0.7, 0.7), (y, -0.7, 0.7))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)  # of tan: where its poles meet themselves is given up
            assert gradient(disk, s=0.6) == pytest.approx(2 * math.pi * 0.6, rel=1e-9)

    @pytest.mark.parametrize("backend", ["c", "jax"])
    @pytest.mark.parametrize("name", ["logarithm", "inverse", "u·exp u"])
    def test_in_every_backend(self, backend: str, name: str, request: pytest.FixtureRequest) -> None:
        if backend == "jax":
            request.getfixturevalue("x64")
        f = INCREASING[name]
        e = teg.integral(teg.bracket(x > r) * teg.bracket(f(x) > f(r)) * teg.bracket(x * x > r * r), (x, 0.05, 1))
        assert gradient(e, backend, r=0.3) == pytest.approx(-1, abs=1e-9)

    def test_each_order_of_the_tie_gives_the_derivative(self) -> None:
        e = teg.integral(teg.bracket(x > r) * teg.bracket(teg.log(x) > teg.log(r)), (x, 0.05, 1))
        assert teg.compile(e).diagnose(r=0.3) == []

    def test_second_derivatives(self) -> None:
        for f in (INCREASING["cube"], INCREASING["logarithm"], INCREASING["u·exp u"]):
            e = teg.integral(teg.exp(x) * teg.bracket(x > r) * teg.bracket(f(x) > f(r)), (x, 0.05, 1))
            assert float(teg.compile(e).hessian(r=0.4)["r", "r"]) == pytest.approx(-math.exp(0.4), rel=1e-9)


class TestSurfacesWithoutASlope:
    @pytest.mark.parametrize(
        ("condition", "expected"),
        [
            ((r * x) ** 2 - 2 * r * x + 1 > 0, 0.0),
            (x**3 - 3 * x * x * r + 3 * x * r * r - r**3 > 0, -1.0),
            (x * x - 2 * x * r + r * r <= 0, 0.0),
            (teg.sqrt(abs(x - r)) > 0, 0.0),
            ((x - r) ** 5 > 0, -1.0),
        ],
    )
    def test_powers_written_out(self, condition: object, expected: float) -> None:
        assert gradient(teg.integral(teg.bracket(condition), (x, 0, 1)), r=0.3) == pytest.approx(expected, abs=1e-9)

    @pytest.mark.parametrize("power", [0.3, 0.5, 1.5])
    def test_a_power_of_a_number_that_begins_to_be_positive(self, power: float) -> None:
        e = teg.integral(teg.where(x > r, teg.bracket((x - r) ** power > 0), 0), (x, 0, 1))
        assert gradient(e, r=0.3) == pytest.approx(-1, abs=1e-9)

    def test_a_condition_that_is_no_number_on_a_part_of_the_domain(self) -> None:
        f = teg.compile(teg.integral(teg.bracket(teg.sqrt(x - r) > -1), (x, 0, 1)))
        with pytest.warns(AccuracyWarning, match="not a number"):
            assert math.isnan(f(r=0.3))

    def test_a_slope_that_rounding_made_gives_no_number(self) -> None:
        e = teg.integral(teg.bracket(teg.log(1 + (x - r) ** 3) > 0), (x, 0, 1))
        with pytest.warns(AccuracyWarning, match="not a number"):
            assert math.isnan(gradient(e, r=0.3))


class TestScales:
    """|x|ⁿ + |y|ⁿ < tⁿ has the area 4·Γ(1 + 1/n)²/Γ(1 + 2/n)·t²."""

    @pytest.mark.parametrize("n", [4, 6, 8, 12, 20])
    @pytest.mark.parametrize("scale", [1e-5, 1.0, 20.0, 2e5])
    def test_superellipses(self, n: int, scale: float) -> None:
        area = 4 * math.gamma(1 + 1 / n) ** 2 / math.gamma(1 + 2 / n)
        e = teg.integral(teg.bracket(x**n + y**n < t**n), (x, -scale, scale), (y, -scale, scale))
        assert gradient(e, t=0.7 * scale) == pytest.approx(2 * area * 0.7 * scale, rel=1e-9)

    def test_a_small_integral_behind_a_large_factor(self) -> None:
        wave = teg.integral(1e-25 * teg.sin(60 * x) ** 2 / (1 + x), (x, 0, 1))
        plain = teg.integral(teg.sin(60 * x) ** 2 / (1 + x), (x, 0, 1))
        assert teg.compile(1e25 * wave)() == pytest.approx(teg.compile(plain)(), rel=1e-10)
        assert teg.compile(s * wave)(s=1e25) == pytest.approx(teg.compile(plain)(), rel=1e-10)


@pytest.mark.parametrize("names", ["x y t", "u v r", "p q s", "x1 x2 c", "a b d", "xx yy w", "h k m", "left up z"])
def test_circles_of_any_names_are_found_on_other_surfaces(names: str) -> None:
    """Half of all quadratics have no root in the field; whether the first few have is a matter of names."""
    first, second, parameter = names.split()
    u, v = teg.var(first) ** 2 + teg.var(second) ** 2, teg.param(parameter) ** 2
    assert ZeroSet(v - u).annuls(u**3 + u - v**3 - v)
    assert not ZeroSet(v - u).annuls(u**3 + u - v**3 - 2 * v)


def test_a_second_derivative_where_one_curve_stands_in_two_forms() -> None:
    """w < t and w + sin(w)/2 < t + sin(t)/2 are one curve, and move as one; with w = x + x³ + y + y³ the second derivative is an integral
    over u = y + y³, by the inverse s(u) of x + x³."""
    u, v = teg.vars("u v")
    level = teg.param("level")
    w = u**3 + u + v**3 + v
    inside = w + teg.sin(w) / 2 < level + teg.sin(level) / 2
    f = teg.compile(teg.integral(teg.bracket(inside) * teg.where(w < level, 1 + u, 2 * u * u), (u, 0, 2), (v, 0, 2)), tol=1e-8)

    def inverse(c: mpmath.mpf) -> tuple[mpmath.mpf, mpmath.mpf]:
        root = mpmath.findroot(lambda q: q + q**3 - c, 0.5)
        return root, 1 / (1 + 3 * root**2)

    def integrand(c: mpmath.mpf) -> mpmath.mpf:
        (p, slope), (_, other) = inverse(1.1 - c), inverse(c)
        return (slope**2 - 6 * (1 + p) * p * slope**3) * other

    exact = inverse(1.1)[1] + mpmath.quad(integrand, [0, 1.1])
    assert f.hessian(level=1.1)["level", "level"] == pytest.approx(float(exact), rel=1e-7)


def test_a_factor_without_variables_is_no_surface() -> None:
    """s·(y - t) is 0 at s = 0 too, but that is no place in the plane."""
    for surface in (s * y - t * s, s * y - s * t + s * x, (s + t) * y - (s + t) * r):
        assert not ZeroSet(surface).annuls(s)
        assert not ZeroSet(surface).annuls(s + t)
    assert ZeroSet(s * y - t * s).annuls(y * y - t * t)
    assert ZeroSet(s - t).annuls(s * s - t * t)


@pytest.mark.usefixtures("x64_for_jax")
@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
def test_second_derivatives_where_a_surface_has_a_factor_without_variables(backend: str) -> None:
    """On x = s the line t·x = s·y is s·(y - t) = 0. Its jump has the factor s, and was taken for 0 on it: 1.80 for -0.019.

    ∂∂/∂s∂t of ∫ eʸ·(min(s, s·y/t) + 1) dy over (-1, 1) is -((t - 1)·eᵗ + 2/e)/t².
    """
    e = teg.integral(teg.bracket(t * x < s * y) * teg.bracket(1 - x / s > 0) * teg.exp(y), (x, -1, 1), (y, -1, 1))
    h = teg.compile(e, [s, t], backend=backend).hessian(s=0.5, t=0.6)
    exact = -((0.6 - 1) * math.exp(0.6) + 2 / math.e) / 0.36
    assert h["s", "t"] == pytest.approx(exact, rel=1e-9)
    assert h["t", "s"] == pytest.approx(exact, rel=1e-9)
