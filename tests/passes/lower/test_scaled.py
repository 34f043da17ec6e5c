"""Quotients and logarithms of exponentials that overflow: right numbers, and no other ones where nothing overflows."""

from __future__ import annotations

import math
import warnings

import pytest

import teg
from teg.analysis.extents import Extents
from teg.ir.expr import Expr
from teg.passes.lower.scaled import ByExponents

x, y = teg.vars("x y")
a, t = teg.params("a t")
exp, log, cosh, sinh = teg.exp, teg.log, teg.cosh, teg.sinh
BUMP = exp(-4000 * (x - t) ** 2)
OTHER = exp(-4000 * (x - a) ** 2)
HILL, ODD, REAL = (math.pi / k / math.sin(math.pi / k) for k in (400, 401, 400.5))
PEAK = math.exp(250.0) * math.sqrt(math.pi / 1000)

# integrand, range, arguments, value, gradient
CASES: dict[str, tuple[Expr, tuple[float, float], dict[str, float], float, list[float]]] = {
    "logistic": (1 / (1 + exp((x - t) / 1e-4)), (0, 1), {"t": 0.5}, 0.5, [1.0]),
    "numerator and denominator": (exp((x - t) / 1e-4) / (1 + exp((x - t) / 1e-4)), (0, 1), {"t": 0.5}, 0.5, [-1.0]),
    "tanh by exponentials": (
        (exp(1e3 * (x - t)) - exp(-1e3 * (x - t))) / (exp(1e3 * (x - t)) + exp(-1e3 * (x - t))),
        (0, 1),
        {"t": 0.3},
        0.4,
        [-2.0],
    ),
    "softplus": (log(1 + exp(1e4 * (x - t))), (0, 1), {"t": 0.3}, 2450 + math.pi**2 / 6e4, [-7000.0]),
    "log cosh": (log(cosh((x - t) / 1e-3)), (0, 1), {"t": 0.4}, 260 - math.log(2) + math.pi**2 / 12e3, [-200.0]),
    "two bumps": (BUMP / (BUMP + OTHER), (0, 1), {"t": 0.3, "a": 0.6}, 0.45, [0.5, 0.5]),
    "sech": (1 / cosh(a * (x - 0.3)) ** 2, (0, 1), {"a": 3000.0}, 2 / 3000, [-2 / 3000**2]),
    "sinh over cosh": (sinh(a * (x - 0.3)) / cosh(a * (x - 0.3)), (0, 1), {"a": 3000.0}, 0.4, [0.0]),
    "power": ((x / t) ** 400 / (1 + (x / t) ** 400), (0, 10), {"t": 2.0}, 10 - 2 * HILL, [-HILL]),
    "odd power": (1 / (1 + (x / t) ** 401), (0, 10), {"t": 2.0}, 2 * ODD, [ODD]),
    "real power": (x**400.5 / (t**400.5 + x**400.5), (0, 10), {"t": 2.0}, 10 - 2 * REAL, [-REAL]),
    "product": (exp(t * x) * exp(-t * x**2), (0, 10), {"t": 1000.0}, PEAK, [PEAK * (0.25 - 1 / 2000)]),
}


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("case", CASES)
def test_what_overflows_is_an_ordinary_number(case: str, backend: str) -> None:
    e, (lo, hi), arguments, value, gradient = CASES[case]
    f = teg.compile(teg.integral(e, (x, lo, hi)), [teg.param(name) for name in arguments], backend=backend)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        got, slopes = f.value_and_grad(**arguments)
    assert got == pytest.approx(value, rel=1e-9)
    assert list(slopes.values()) == pytest.approx(gradient, rel=1e-9, abs=1e-10)


def test_in_jax() -> None:
    pytest.importorskip("jax").config.update("jax_enable_x64", True)
    f = teg.compile(teg.integral(CASES["logistic"][0], (x, 0, 1)), [t], backend="jax")
    assert f.grad(t=0.5)["t"] == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("u", [-30.0, -1.0, -1e-9, 0.0, 1e-9, 2.0, 30.0, 1e4, -1e4, 1e299])
def test_as_written_where_nothing_overflows(u: float) -> None:
    """Tails, zeros and infinite arguments keep their digits."""
    fermi = 1 / (1 + math.exp(u)) if u < 700 else 0.0
    assert teg.evaluate(exp(t) / (1 + exp(t)) ** 2, t=u) == pytest.approx(fermi * (1 - fermi), rel=1e-12)
    assert teg.evaluate(log(1 + exp(t)), t=u) == pytest.approx(math.log1p(math.exp(u)) if u < 700 else u, rel=1e-14)
    assert teg.evaluate(1 / (1 + exp(t * t)), t=u) == pytest.approx(1 / (1 + math.exp(u * u)) if abs(u) < 26 else 0.0, rel=1e-12)
    if 0 < abs(u) < 700:
        assert teg.evaluate(exp(t) / (exp(t) - 1) ** 2, t=u) == pytest.approx(0.25 / math.sinh(u / 2) ** 2, rel=1e-14)


def test_products_that_cannot_overflow_stay() -> None:
    known = ByExponents(Extents(lambda: {x: (0.0, 1.0), y: (-5.0, 5.0)}))
    here = lambda factor: None  # noqa: E731
    for e in (exp(x) / (1 + exp(y)) ** 2, x * exp(t) * y, x**400 / (1 + y), exp(-(x**2)) * exp(-(y**2)) / cosh(y)):
        assert known.product(e, here) is None
    assert known.product(exp(t) / (1 + exp(t)) ** 2, here) is not None
    assert known.product(exp(t * x) * exp(a * y), lambda factor: factor.free) is None  # computed at different levels


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_constant_integral_in_an_exponent(backend: str) -> None:
    """∫ sech(x - ½t) is π. The derivative was inf/inf, and the value beside it 0."""
    e = teg.integral(1 / cosh(x - teg.integral(y * t, (y, 0, 1))), (x, -1e6, 1e6))
    value, gradient = teg.compile(e, backend=backend).value_and_grad(t=1234.0)
    assert value == pytest.approx(math.pi, rel=1e-10)
    assert gradient["t"] == pytest.approx(0.0, abs=1e-9)
