"""Singularities that move: derivatives against closed forms, and mpmath where there is none."""

from __future__ import annotations

import math
import warnings

import pytest

import teg
from teg.analysis.singularities import Keys, order_at
from teg.evaluator.accuracy import AccuracyWarning
from teg.ir.expr import ONE
from teg.passes.differentiate.forward import tangent_of
from teg.pipeline import eliminate

mp = pytest.importorskip("mpmath")

x, y, z, u = teg.vars("x y z u")
p, q, r, t, a, b = teg.params("p q r t a b")
g = r * r - x * x - y * y


def in_disk(f: teg.Expr) -> teg.Expr:
    return teg.integral(teg.where(x * x + y * y < r * r, f, 0), (x, -2, 2), (y, -2, 2))


def quad(f: object, *ends: float) -> object:
    return mp.quad(f, list(ends))


CASES: dict[str, tuple[teg.Expr, dict[str, float], dict[str, float]]] = {
    **{f"|x-p|^-{k}": (teg.integral(abs(x - p) ** -k, (x, 0, 1)), {"p": 0.3}, {"p": 0.3**-k - 0.7**-k}) for k in (0.2, 0.5, 0.7, 0.9)},
    **{
        f"one side, {k}": (teg.integral(teg.where(x > p, (x - p) ** -k, 0), (x, 0, 1)), {"p": 0.3}, {"p": -(0.7**-k)})
        for k in (0.2, 0.5, 0.7, 0.9)
    },
    **{
        f"near a bound, {v}": (teg.integral(1 / teg.sqrt(abs(x - p)), (x, 0, 1)), {"p": v}, {"p": v**-0.5 - (1 - v) ** -0.5})
        for v in (1e-6, 1e-3, 0.999)
    },
    "outside": (teg.integral(1 / teg.sqrt(abs(x - p)), (x, 0, 1)), {"p": -0.2}, {"p": 0.2**-0.5 - 1.2**-0.5}),
    "logarithm": (teg.integral(teg.log(abs(x - p)), (x, 0, 1)), {"p": 0.3}, {"p": math.log(0.3 / 0.7)}),
    "a bound that is singular": (teg.integral(1 / teg.sqrt(x - p), (x, p, 1)), {"p": 0.3}, {"p": -(0.7**-0.5)}),
    "both bounds": (teg.integral(1 / teg.sqrt((x - p) * (q - x)), (x, p, q)), {"p": 0.3, "q": 0.8}, {"p": 0.0, "q": 0.0}),
    "hemisphere": (in_disk(teg.sqrt(g)), {"r": 1.1}, {"r": 2 * math.pi * 1.21}),
    "power 1.5 in a disk": (in_disk(g**1.5), {"r": 1.1}, {"r": 2 * math.pi * 1.1**4}),
    "hemisphere between curved bounds": (
        teg.integral(teg.integral(teg.sqrt(g), (y, -teg.sqrt(r * r - x * x), teg.sqrt(r * r - x * x))), (x, -r, r)),
        {"r": 1.1},
        {"r": 2 * math.pi * 1.21},
    ),
    "ellipsoid": (
        teg.integral(teg.where((x / a) ** 2 + (y / b) ** 2 < 1, teg.sqrt(1 - (x / a) ** 2 - (y / b) ** 2), 0), (x, -2, 2), (y, -2, 2)),
        {"a": 1.2, "b": 0.7},
        {"a": 2 * math.pi / 3 * 0.7, "b": 2 * math.pi / 3 * 1.2},
    ),
    **{
        name: (e, {"p": 0.3, "q": 0.7}, {"p": 0.4 * (0.3**-0.5 - 0.7**-0.5), "q": 0.6 * (0.7**-0.5 - 0.3**-0.5)})
        for name, e in {
            "branches": teg.integral(teg.where(y < 0.4, abs(x - p) ** -0.5, abs(x - q) ** -0.5), (x, 0, 1), (y, 0, 1)),
            "branches around integrals": teg.integral(
                teg.where(y < 0.4, *(teg.integral(abs(x - c) ** -0.5, (x, 0, 1)) for c in (p, q))), (y, 0, 1)
            ),
        }.items()
    },
    "another bracket": (
        teg.integral(abs(x - p) ** -0.5 * teg.bracket(x < q), (x, 0, 1)),
        {"p": 0.3, "q": 0.7},
        {"p": 0.3**-0.5 - 0.4**-0.5, "q": 0.4**-0.5},
    ),
    "an exponent that is a parameter": (
        teg.integral(teg.where(x > p, (x - p) ** q, 0), (x, 0, 1)),
        {"p": 0.3, "q": 0.4},
        {"p": -(0.7**0.4), "q": 0.7**1.4 * (math.log(0.7) / 1.4 - 1 / 1.96)},
    ),
    "arcsine": (teg.integral(teg.where(x < p, teg.asin(x / p), 0), (x, 0, 1)), {"p": 0.6}, {"p": math.pi / 2 - 1}),
    "two summands": (
        teg.integral(abs(x - p) ** -0.5 + abs(x - q) ** -0.3, (x, 0, 1)),
        {"p": 0.3, "q": 0.7},
        {"p": 0.3**-0.5 - 0.7**-0.5, "q": 0.7**-0.3 - 0.3**-0.3},
    ),
    "inside of a function": (
        teg.exp(teg.integral(abs(x - p) ** -0.5, (x, 0, 1))),
        {"p": 0.3},
        {"p": math.exp(2 * (0.3**0.5 + 0.7**0.5)) * (0.3**-0.5 - 0.7**-0.5)},
    ),
}


def check(e: teg.Expr, at: dict[str, float], expected: dict[str, float], backend: str) -> None:
    f = teg.compile(e, backend=backend, inaccurate="ignore")  # the estimate of the value may exceed the tolerance
    found, errors = f.grad_and_error(**at)
    scale = max(1.0, *map(abs, expected.values()))
    for name, truth in expected.items():
        assert found[name] == pytest.approx(truth, abs=2e-11 * scale), name
        assert abs(found[name] - truth) <= 10 * errors[name], name


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_the_gradient(case: str, backend: str) -> None:
    check(*CASES[case], backend)


@pytest.mark.parametrize("case", ["|x-p|^-0.5", "logarithm", "both bounds"])
@pytest.mark.usefixtures("x64")
def test_the_gradient_in_jax(case: str) -> None:
    check(*CASES[case], "jax")


def test_two_surfaces_in_one_product() -> None:
    mp.mp.dps = 25
    e = teg.integral(abs(x - t) ** -0.5 * abs(x - t * t - 0.5) ** -0.25, (x, 0, 1))

    def value(s: object) -> object:
        c = s * s + mp.mpf(1) / 2
        return quad(lambda v: abs(v - s) ** mp.mpf(-0.5) * abs(v - c) ** mp.mpf(-0.25), 0, s, c, 1)

    h = mp.mpf(10) ** -6
    at = mp.mpf(0.3)
    truth = float((8 * (value(at + h) - value(at - h)) - (value(at + 2 * h) - value(at - 2 * h))) / (12 * h))
    assert teg.compile(e).grad(t=0.3)["t"] == pytest.approx(truth, abs=1e-9)


def test_a_curve_that_meets_a_side() -> None:
    """A cap of a cylinder, half of it outside of the box: ∫∫√(0.36 - (x - p)²) over 0 < x < 1 and 0 < y < 1, p = 0.25."""
    e = teg.integral(teg.where((x - p) ** 2 < 0.36, teg.sqrt(0.36 - (x - p) ** 2), 0) * (1 + y), (y, 0, 1), (x, 0, 1))
    assert teg.compile(e).grad(p=0.25)["p"] == pytest.approx(1.5 * math.sqrt(0.36 - 0.25**2), abs=1e-10)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_second_derivatives(backend: str) -> None:
    e = teg.integral(1 / teg.sqrt(abs(x - p)), (x, 0, 1))
    assert teg.compile(e, backend=backend).hessian(p=0.3)["p", "p"] == pytest.approx(-0.5 * (0.3**-1.5 + 0.7**-1.5), abs=1e-9)
    assert teg.compile(in_disk(g**1.5), backend=backend).hessian(r=1.1)["r", "r"] == pytest.approx(8 * math.pi * 1.1**3, rel=1e-10)


def test_forward_and_reverse_mode_agree() -> None:
    e = teg.integral(teg.log(abs(x - p * q)) * teg.exp(q * x), (x, 0, 1))
    forward = [teg.evaluate(teg.diff(e, v), {p: 0.6, q: 0.7}) for v in (p, q)]
    reverse = teg.compile(e).grad(p=0.6, q=0.7)
    assert forward == pytest.approx([reverse["p"], reverse["q"]], rel=1e-12)
    along = teg.evaluate(teg.jvp(e, {p: 2, q: -1}), {p: 0.6, q: 0.7})
    assert along == pytest.approx(2 * forward[0] - forward[1], rel=1e-11)


def test_on_a_bound_the_derivative_is_infinite_and_a_warning_says_so() -> None:
    f = teg.compile(teg.integral(1 / teg.sqrt(abs(x - p)), (x, 0, 1)))
    with pytest.warns(AccuracyWarning, match="singular"):
        assert math.isnan(f.grad(p=0.0)["p"])


def test_a_jump_that_fades_has_no_delta() -> None:
    e = teg.integral(teg.where(x < t, (t - x) ** 1.5, 0), (x, 0, 1))
    assert not tangent_of(eliminate(e), {t: ONE}).has_delta


@pytest.mark.parametrize(
    ("e", "order"),
    [
        (1 + teg.sqrt(x), (0, 0.5)),
        (1 / teg.sqrt(x), (-0.5, -0.5)),
        (x**2 * teg.sqrt(x), (2.5, 2.5)),
        (teg.log(x) * x, (1, 1)),
        (teg.exp(teg.sqrt(x)), (0, 0.5)),
        (teg.exp(x) / (1 + x), (0, math.inf)),
        (1 / x, (-1, -1)),
    ],
    ids=str,
)
def test_order_and_roughness(e: teg.Expr, order: tuple[float, float]) -> None:
    assert order_at(e, lambda v: v is x) == order


def test_surfaces_are_the_same_up_to_a_number() -> None:
    keys = Keys()
    assert keys.of(x - p) == keys.of(2 * p - 2 * x) != keys.of(x - 2 * p)


@pytest.mark.parametrize("e", [teg.sqrt(1 + x * x * p * p), teg.log(teg.exp(x * p)), teg.sqrt((x - p) ** 2 + (y - q) ** 2)], ids=str)
def test_what_is_never_singular_is_differentiated_as_it_stands(e: teg.Expr) -> None:
    inside = teg.integral(e, (x, 0, 1), (y, 0, 1))
    assert tangent_of(inside, {p: ONE}) is teg.integral(tangent_of(e, {p: ONE}), (x, 0, 1), (y, 0, 1))


# -- kinks of integrals --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["numpy", "c", "jax"])
def test_a_kink_of_an_integral(backend: str, request: pytest.FixtureRequest) -> None:
    """∫|x - x²/(2p)| over (0, 1) is 4p²/3 - ½ + 1/(6p), for p < ½."""
    if backend == "jax":
        request.getfixturevalue("x64")
    e = teg.integral(abs(teg.integral(1 - u / p, (u, 0, x))), (x, 0, 1))
    f = teg.compile(e, backend=backend)
    value, gradient = f.value_and_grad(p=0.3)
    assert value == pytest.approx(4 * 0.09 / 3 - 0.5 + 1 / 1.8, abs=1e-13)
    assert gradient["p"] == pytest.approx(8 * 0.3 / 3 - 1 / 0.54, abs=1e-12)
    assert f.hessian(p=0.3)["p", "p"] == pytest.approx(8 / 3 + 1 / 0.081, abs=1e-10)


def test_a_kink_of_an_integral_that_is_no_polynomial() -> None:
    """|p - sin(x + p) + sin p| over (0, 1) turns at x = asin(p + sin p) - p."""
    mp.mp.dps = 20
    e = teg.integral(abs(p - teg.integral(teg.cos(u + p), (u, 0, x))), (x, 0, 1))
    s, c = mp.mpf(0.3), mp.asin(mp.mpf(0.3) + mp.sin(mp.mpf(0.3))) - mp.mpf(0.3)
    rate = lambda v: 1 - mp.cos(v + s) + mp.cos(s)  # noqa: E731
    truth = quad(rate, 0, c) - quad(rate, c, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert teg.compile(e).grad(p=0.3)["p"] == pytest.approx(float(truth), abs=1e-9)
