"""Products 0·∞ beside the border of a smooth bump: values, gradients and Hessians against scaling laws, in every backend."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import mpmath
import numpy as np
import pytest

import teg
from teg.analysis.extents import Extents
from teg.ir.expr import Mul
from teg.passes.lower.vanishing import Underflow, Vanishing

pytestmark = pytest.mark.usefixtures("x64_for_jax")

x, y = teg.vars("x y")
t, a = teg.params("t a")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
AT = {"t": 0.3, "a": 0.7}
LINE, DISK = 0.4439938161680794, 0.4665123931783310
"""∫ exp(-1/(1 - r²)) over |x| < 1, and over the unit disk: 50 digits of mpmath, rounded."""
u = (x - t) / a


def on_line(inside: teg.Cond, depth: teg.Expr) -> teg.Expr:
    return teg.integral(teg.where(inside, teg.exp(-1 / depth), 0), (x, -2, 2))


# The bump of width a around t in different words: its integral is a·LINE.
BUMPS: dict[str, teg.Expr] = {
    "by a distance": on_line(teg.abs(x - t) < a, 1 - u**2),
    "by a scaled distance": on_line(teg.abs(u) < 1, 1 - u**2),
    "by squares": on_line(u**2 < 1, 1 - u**2),
    "by two conditions": on_line((x < t + a) & (x > t - a), 1 - u**2),
    "with a factor in front": math.e * on_line(u**2 < 1, 1 - u**2) / math.e,
    "a sum in the exponent": teg.integral(teg.where(u**2 < 1, teg.exp(2 - 1 / (1 - u**2)), 0), (x, -2, 2)) * math.exp(-2),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("case", BUMPS)
def test_a_bump_on_a_line(case: str, backend: str) -> None:
    """The gradient was NaN where the border had other words than the exponent, and all Hessians were."""
    check(BUMPS[case], LINE, backend)


@pytest.mark.slow
def test_a_bump_over_an_ellipse() -> None:
    """Nodes beside the border are on it but for rounding: there the exponential is 0, and the power beside it was infinite."""
    e = teg.integral(teg.where(u**2 + y * y < 1, teg.exp(-1 / (1 - u**2 - y * y)), 0), (x, -2, 2), (y, -2, 2))
    value, gradient = teg.compile(e, [t, a], backend="c").value_and_grad(**AT)
    assert value == pytest.approx(AT["a"] * DISK, rel=1e-10)
    assert gradient == pytest.approx({"t": 0.0, "a": DISK}, rel=1e-9, abs=1e-11)


def check(e: teg.Expr, unit: float, backend: str) -> None:
    """Compares an integral with a·unit."""
    f = teg.compile(e, [t, a], backend=backend)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, gradient = f.value_and_grad(**AT)
        hessian = f.hessian(**AT)
    assert value == pytest.approx(AT["a"] * unit, rel=1e-11)
    assert gradient == pytest.approx({"t": 0.0, "a": unit}, rel=1e-10, abs=1e-12)
    assert list(hessian.values()) == pytest.approx([0.0] * 4, abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("power", [1, 2, 3])
def test_one_sided_steps(power: int, backend: str) -> None:
    """∫ exp(-1/(x - t)ᵏ) from t to 1 has the slope -f(1), and so on: what happens at t does not count."""
    f = teg.compile(teg.integral(teg.where(x > t, teg.exp(-1 / (x - t) ** power), 0), (x, 0, 1)), backend=backend)
    end = math.exp(-1 / 0.7**power)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert f.grad(t=0.3)["t"] == pytest.approx(-end, rel=1e-9)
        assert f.hessian(t=0.3)["t", "t"] == pytest.approx(end * power / 0.7 ** (power + 1), rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_step_with_a_rate(backend: str) -> None:
    """The sign of the rate is not known when the program is compiled. √π/2·… by substitution of 1/(x - t)."""

    def closed(rate: float, length: float) -> float:
        """∫₀ˡ exp(-c/u²) du = l·exp(-c/l²) - √(πc)·erfc(√c/l)."""
        return length * math.exp(-rate / length**2) - math.sqrt(math.pi * rate) * math.erfc(math.sqrt(rate) / length)

    f = teg.compile(teg.integral(teg.where(x > t, teg.exp(-a / (x - t) ** 2), 0), (x, 0, 1)), backend=backend)
    rate, length, end = 0.5, 0.7, math.exp(-0.5 / 0.49)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, gradient = f.value_and_grad(t=0.3, a=rate)
        hessian = f.hessian(t=0.3, a=rate)
    assert value == pytest.approx(closed(rate, length), rel=1e-9)
    by_rate = -0.5 * math.sqrt(math.pi / rate) * math.erfc(math.sqrt(rate) / length)
    assert gradient == pytest.approx({"t": -end, "a": by_rate}, rel=1e-9)
    assert hessian["t", "t"] == pytest.approx(2 * rate / length**3 * end, rel=1e-9)
    assert [hessian["t", "a"], hessian["a", "t"]] == pytest.approx([end / length**2] * 2, rel=1e-9)
    assert backend == "jax" or hessian["t", "a"] == hessian["a", "t"]  # in XLA each has a kernel of its own


def moment(k: int, rate: float) -> float:
    """∫ uᵏ·exp(-1/(1 - u²) + rate·u) over |u| < 1. The trapezoid rule is exact to rounding where all derivatives are 0 at both ends."""
    v = np.linspace(-1.0, 1.0, 4001)[1:-1]
    return float(np.sum(v**k * np.exp(-1.0 / (1.0 - v * v) + rate * v)) / 2000.0)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("inside", [u**2 < 1, teg.abs(x - t) < a], ids=["by squares", "by distance"])
def test_a_bump_beside_a_function(inside: teg.Cond, backend: str) -> None:
    """∫ bump((x - t)/a)·exp(x) dx = a·exp(t)·∫ bump(u)·exp(a·u) du. Its second derivatives were NaN."""
    f = teg.compile(teg.integral(teg.where(inside, teg.exp(-1 / (1 - u**2)), 0) * teg.exp(x), (x, -2, 2)), [t, a], backend=backend)
    at_t, width = math.exp(AT["t"]), AT["a"]
    m0, m1, m2 = (moment(k, width) for k in range(3))
    by_a = at_t * (m0 + width * m1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert f.grad(**AT) == pytest.approx({"t": width * at_t * m0, "a": by_a}, rel=1e-10)
        hessian = f.hessian(**AT)
    assert hessian["t", "t"] == pytest.approx(width * at_t * m0, rel=1e-9)
    assert hessian["t", "a"] == pytest.approx(by_a, rel=1e-9)
    assert hessian["a", "a"] == pytest.approx(at_t * (2 * m1 + width * m2), rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_bump_between_jumps(backend: str) -> None:
    """1, then 1 + bump, then 2: at the second border the jump is 1, and the bump beside it has no part in it. Hessians were NaN."""
    inner = 1 + teg.where(u**2 < 1, teg.exp(-1 / (1 - u**2)), 0)
    f = teg.compile(teg.integral(teg.where(x < t - a, 1, teg.where(x > t + a, 2, inner)), (x, -2, 2)), [t, a], backend=backend)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, gradient = f.value_and_grad(**AT)
        hessian = f.hessian(**AT)
    assert value == pytest.approx(6 - AT["t"] - AT["a"] + AT["a"] * LINE, rel=1e-11)
    assert gradient == pytest.approx({"t": -1.0, "a": LINE - 1}, rel=1e-10)
    assert list(hessian.values()) == pytest.approx([0.0] * 4, abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_real_power_beside_an_exponential(backend: str) -> None:
    """∫ u^(-3/2)·exp(-c/u) du over (0, l) is √(π/c)·erfc(√(c/l)), here with c = 1/(2a²): the density of first passages. It was NaN."""
    e = teg.integral(teg.where(x > t, (x - t) ** -1.5 * teg.exp(-1 / (2 * a * a * (x - t))), 0), (x, 0, 1))
    f = teg.compile(e, [t, a], backend=backend)
    length, rate = 1 - AT["t"], 0.5 / AT["a"] ** 2
    end = length**-1.5 * math.exp(-rate / length)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, gradient = f.value_and_grad(**AT)
        hessian = f.hessian(**AT)
    assert value == pytest.approx(math.sqrt(math.pi / rate) * math.erfc(math.sqrt(rate / length)), rel=1e-10)
    assert gradient["t"] == pytest.approx(-end, rel=1e-9)
    assert hessian["t", "t"] == pytest.approx(end * (rate / length**2 - 1.5 / length), rel=1e-9)
    assert [hessian["t", "a"], hessian["a", "t"]] == pytest.approx([-end / (length * AT["a"] ** 3)] * 2, rel=1e-9)


def found(e: teg.Expr) -> teg.Expr | None:
    assert isinstance(e, Mul)
    return Vanishing().of(e)


def test_only_products_that_may_be_zero_times_infinity() -> None:
    size = teg.ir.simplify.call("magnitude", x - t)
    decaying = teg.exp(-1 / size)
    assert found(decaying / size**2) is decaying
    assert found((1 + decaying) / size) is not None  # a sum that holds one
    assert found(decaying * x) is None
    assert found(teg.exp(1 / size) / size) is None
    assert found(teg.exp(-size) / size) is None
    assert found(teg.exp(-1 / a**2) / size) is None


phi = {v: teg.exp(-v * v / 2) / math.sqrt(2 * math.pi) for v in (x, y)}


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_option_to_exchange(backend: str) -> None:
    """exp(y) overflows where the normal density is 0: the gradient was NaN. Margrabe's formula: a·N(d) - t·N(d - w)."""
    s, q = 0.2, 0.3
    payoff = teg.maximum(a * teg.exp(s * x - s * s / 2) - t * teg.exp(q * y - q * q / 2), 0)
    e = teg.integral(payoff * phi[x] * phi[y], (x, -math.inf, math.inf), (y, -math.inf, math.inf))
    width = math.hypot(s, q)
    d = math.log(1.1 / 0.9) / width + width / 2
    up, down = (math.erfc(-v / math.sqrt(2)) / 2 for v in (d, d - width))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, gradient = teg.compile(e, [t, a], backend=backend).value_and_grad(t=0.9, a=1.1)
    assert value == pytest.approx(1.1 * up - 0.9 * down, rel=1e-9)
    assert gradient == pytest.approx({"t": -down, "a": up}, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_power_of_an_exponential(backend: str) -> None:
    """∫ max(exp(s·x) - t, 0)^(3/2)·φ(x) dx was NaN. The reference is Gauss-Legendre in u = √(x - log(t)/s), where the root is smooth."""
    s, strike = 0.3, 1.1
    e = teg.integral(teg.maximum(teg.exp(s * x) - t, 0) ** a * phi[x], (x, -math.inf, math.inf))
    nodes, weights = np.polynomial.legendre.leggauss(100)
    v = 2.0 + 2.0 * nodes
    at = math.log(strike) / s + v * v
    above = np.exp(s * at) - strike
    density = 4.0 * weights * v * np.exp(-at * at / 2) / math.sqrt(2 * math.pi)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, gradient = teg.compile(e, [t, a], backend=backend).value_and_grad(t=strike, a=1.5)
    assert value == pytest.approx(float(density @ above**1.5), rel=1e-9)
    by_power = float(density @ (above**1.5 * np.log(above)))
    assert gradient == pytest.approx({"t": -1.5 * float(density @ above**0.5), "a": by_power}, rel=1e-9)


def test_only_gaussians_that_fall_faster() -> None:
    """exp(-x²/2) may be taken for 0 beside exponentials of multiples of x, and not beside exp(x·y) or exp(x³)."""
    underflow = Underflow(Extents(dict))
    small = teg.ir.simplify.call("exp", (-0.5) * x**2)

    def taken(e: teg.Expr) -> teg.Expr | None:
        product = teg.ir.simplify.mul(small, e)
        assert isinstance(product, Mul)
        return underflow.of(product)

    assert taken(teg.sqrt(1 + teg.exp(a * x + y))) is small
    assert taken(1 / (1 + teg.exp(x))) is small
    assert taken(teg.exp(x) / teg.erfc(x)) is None
    assert taken(teg.exp(x) / (1 - teg.tanh(x * x))) is None
    assert taken((1 + teg.exp(y)) * (1 + x * x) ** x) is None
    assert taken(teg.exp(x) * teg.erfc(x)) is small
    assert taken(teg.exp(x * y) + 1) is None
    assert taken(teg.exp(x**3) + 1) is None
    assert taken(teg.sinh(x) * teg.exp(y)) is None
    assert taken(teg.exp(t * x) / (1 + teg.exp(-(x**4)))) is None
    assert taken(teg.integral(teg.exp(y), (y, 0, x**2))) is None
    assert taken(teg.cos(x)) is None
    assert Underflow(Extents(lambda: {x: (-1.0, 1.0)})).of(teg.ir.simplify.mul(small, teg.exp(a * x) + 1)) is None


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", ["a Fermi function", "its logarithm", "of a square"])
def test_exponentials_of_a_pole_that_are_all_of_a_product(name: str, backend: str) -> None:
    """exp(1/u)·(1 + exp(1/u))⁻² is made of factors that may vanish, and guards itself from nothing: RecursionError."""
    e, slope = {
        "a Fermi function": (1 / (1 + teg.exp(1 / (x + t))), lambda s: mpmath.exp(1 / s) / (s * (1 + mpmath.exp(1 / s))) ** 2),
        "its logarithm": (teg.log(1 + teg.exp(1 / (x + t))), lambda s: -mpmath.exp(1 / s) / (s * s * (1 + mpmath.exp(1 / s)))),
        "of a square": (
            1 / (2 + teg.exp(1 / (x + t) ** 2)),
            lambda s: 2 * mpmath.exp(1 / s**2) / (s**3 * (2 + mpmath.exp(1 / s**2)) ** 2),
        ),
    }[name]
    found = teg.compile(teg.integral(e, (x, 0, 1)), [t], backend=backend).grad(t=0.37)["t"]
    assert found == pytest.approx(float(mpmath.quad(lambda s: slope(s + mpmath.mpf("0.37")), [0, 1])), rel=1e-11)


def over_corners(second: Callable[[float], float], at: Callable[[float, float], float], box: tuple[float, float, float, float]) -> float:
    """Returns ΣΣ ±G(u) over the corners of a box (x from, to, y from, to)."""
    x0, x1, y0, y1 = box
    return second(at(x1, y1)) - second(at(x0, y1)) - second(at(x1, y0)) + second(at(x0, y0))


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_logarithm_at_its_border(backend: str) -> None:
    """u·log u where u > 0: some nodes of the inner integral are on u = 0 to rounding, and the value was NaN, with a warning."""
    u = x + 2 * y - a
    f = teg.compile(teg.integral(teg.where(u > 0, u * teg.log(u), 0), (x, 0, 2), (y, -0.5, 1)), [a], backend=backend)

    def second(v: float) -> float:
        return v**3 * (math.log(v) / 6 - 5 / 36) if v > 0 else 0.0

    for at in (1.0314, 0.3, 0.71, 1.7, 2.2):
        expected = over_corners(second, lambda px, py, at=at: px + 2 * py - at, (0, 2, -0.5, 1)) / 2  # type: ignore[misc]
        assert f(a=at) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_power_beside_a_constant(backend: str) -> None:
    """u^1.5 where u > 0, else 1: on the line u = 0, found to rounding, the power was NaN in the gradient."""
    b = teg.param("b")
    u = x + a * y - b
    f = teg.compile(teg.integral(teg.where(u > 0, u**1.5, 1), (x, 0, 1), (y, -1, 1)), [b], backend=backend)

    def first(v: float) -> float:
        return v**2.5 / 2.5 if v > 0 else v

    for a_at, b_at in ((0.4, 0.35), (1.1, 0.72), (0.73, 0.41), (0.9, 0.13)):
        slope = -over_corners(first, lambda px, py, at=(a_at, b_at): px + at[0] * py - at[1], (0, 1, -1, 1)) / a_at  # type: ignore[misc]
        assert f.grad(a=a_at, b=b_at)["b"] == pytest.approx(slope, rel=1e-9, abs=1e-9)
        height = over_corners(lambda v: v**1.5 if v > 0 else 1.0, lambda px, py, at=(a_at, b_at): px + at[0] * py - at[1], (0, 1, -1, 1))  # type: ignore[misc]
        assert f.hessian(a=a_at, b=b_at)["b", "b"] == pytest.approx(height / a_at, rel=1e-9)
