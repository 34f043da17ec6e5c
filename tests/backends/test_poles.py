"""Rational integrands with one pole, in every backend: exact values however near the pole is, and what is said where it is met."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg.backends.c.kernel import compile_c
from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from teg.evaluator.accuracy import AccuracyWarning
from teg.program import Bend, Integrate, Program, Rational, statements
from tests.backends.c_checks import behaviour_is_defined, lines_are_short, text_compiles_without_warnings
from tests.backends.programs import Case, integrate, let, program
from tests.bench.scenes import bilinear_pixel

needs_c = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
BACKENDS = [pytest.param(compile_numpy, id="numpy"), pytest.param(compile_c, id="c", marks=needs_c)]
RULES = [(nodes, power) for nodes in range(1, 8) for power in (1, 2, 3)]
# lo, hi, c0, c1, base: the pole is at base - c0/c1
PLACES = [
    (0.0, 1.0, 1.0, 0.0, 0.0),
    (0.0, 1.0, 1.0, 1e-12, 0.0),
    (0.0, 1.0, 2.0, 0.3, 0.25),
    (0.0, 1.0, -1.0, -1.0, 0.5),
    (0.0, 1.0, 0.1, 1.0, 0.0),
    (2.0, -1.0, 1.0, 0.9, 0.0),
    (0.0, 1.0, 1e-3, 1.0, 0.0),
    (0.0, 1.0, 1.0, -1.0, 1e-6),
    (100.0, 101.0, 1e-4, 3.0, 100.0),
    (0.0, 1e-9, 1e-9, 1.0, 0.0),
]


def of_powers(nodes: int, power: int, rule: Rational, estimates: int = 0) -> Program:
    """∫ wʲ/D^power for all j < nodes, from p0 to p1, D = p2 + p3·w, w = x - p4; the bend counts if p5 > 0."""
    body = [let("vw", "sub", "x0", "p4"), let("vq", "mul", "p3", "vw"), let("vd", "add", "p2", "vq"), let("v0", "powi", "vd", -power)]
    body += [let(f"v{j}", "mul", f"v{j - 1}", "vw") for j in range(1, nodes)]
    results, errors = " ".join(f"vr{j}" for j in range(nodes)), " ".join(f"ve{j}" for j in range(estimates))
    integral = integrate(
        results,
        "x0",
        "p0",
        "p1",
        tuple(body),
        *(f"v{j}" for j in range(nodes)),
        rule=rule,
        flags=(let("b0", "gt0", "p5"),),
        bends=(Bend("pole", ("p2", "p3", 0.0), "b0"),),
        base="p4",
        estimates=errors,
    )
    return program(6, (integral,), *results.split(), *errors.split())


def exact(nodes: int, power: int, lo: float, hi: float, c0: float, c1: float, base: float) -> list[float]:
    """The same in closed form: with s = D it is a sum of powers of s."""
    with mpmath.workdps(60 + 20 * nodes):
        low, high, c, d = mpmath.mpf(lo) - mpmath.mpf(base), mpmath.mpf(hi) - mpmath.mpf(base), mpmath.mpf(c0), mpmath.mpf(c1)
        found = []
        for j in range(nodes):
            if d == 0:
                found.append((high ** (j + 1) - low ** (j + 1)) / (j + 1) / c**power)
                continue
            total = mpmath.mpf(0)
            for i in range(j + 1):
                k = i - power + 1
                part = mpmath.log((c + d * high) / (c + d * low)) if k == 0 else ((c + d * high) ** k - (c + d * low) ** k) / k
                total += math.comb(j, i) * (-c) ** (j - i) * part
            found.append(total / d ** (j + 1))
        return [float(v) for v in found]


def columns(places: list[tuple[float, ...]], when: float = 1.0) -> list[np.ndarray]:
    return list(np.array([(*place, when) for place in places]).T.copy())


@pytest.mark.parametrize("compiled", BACKENDS)
@pytest.mark.parametrize(("nodes", "power"), RULES)
def test_exact_however_near(compiled: Any, nodes: int, power: int) -> None:
    found = compiled(of_powers(nodes, power, Rational(nodes, power), nodes)).outcome(columns(PLACES), len(PLACES))
    values, errors = found.values[:nodes], found.values[nodes:]
    reference = np.array([exact(nodes, power, *place) for place in PLACES]).T
    agree(values, errors, reference, power)
    assert not found.missed


def agree(values: np.ndarray, errors: np.ndarray, reference: np.ndarray, power: int) -> None:
    """To as many digits as D has at the end where it is smaller; the estimates hold."""
    lo, hi, c0, c1, base = np.array(PLACES).T
    size, least = np.abs(reference).max(axis=0), np.minimum(np.abs(c0 + c1 * (lo - base)), np.abs(c0 + c1 * (hi - base)))
    known = 2.0**-52 * (np.abs(c0) + np.abs(c1) * np.maximum(np.abs(lo), np.abs(hi))) / least
    assert (np.abs(values - reference) <= (1e-13 + power * known) * size).all()
    assert (np.abs(values - reference) <= errors + 1e-14 * size).all()


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(("nodes", "power"), [(1, 1), (3, 2), *(pytest.param(*rule, marks=pytest.mark.slow) for rule in RULES)])
def test_exact_in_jax(nodes: int, power: int) -> None:
    found = compile_jax(of_powers(nodes, power, Rational(nodes, power), nodes)).outcome(columns(PLACES), len(PLACES))
    reference = np.array([exact(nodes, power, *place) for place in PLACES]).T
    values, errors = found.values[:nodes], found.values[nodes:]
    agree(values, errors, reference, power)
    assert not found.missed


@pytest.mark.usefixtures("x64")
@needs_c
def test_a_pole_that_is_met() -> None:
    """1/(x - c) at an end of the piece is infinite and a missed tolerance; a factor that is 0 there takes the pole away."""
    ends = [(0.0, 1.0, 0.0, 1.0, 0.0), (0.0, 1.0, 1.0, -1.0, 0.0), (0.0, 1.0, 0.0, -2.0, 0.0), (0.0, 1.0, -0.3, 1.0, 0.0)]
    for nodes, signs in ((1, [1, 1, -1]), (2, [1, 1, -1])):
        for compiled in (compile_numpy, compile_c, compile_jax):
            run: Any = compiled(of_powers(nodes, 1, Rational(nodes, 1)))
            found = run.outcome(columns(ends), len(ends))
            assert found.values[0, :3].tolist() == [s * math.inf for s in signs]
            assert not np.isfinite(found.values[0, 3])
            assert found.missed
            if nodes == 2:  # w/D, D = w or D = -2w
                np.testing.assert_allclose(found.values[1, [0, 2]], [1.0, -0.5], rtol=1e-14)


@needs_c
def test_the_text_is_strict_c_and_its_behaviour_defined(tmp_path: Path) -> None:
    """With tables and functions of weights of several sizes, and with estimates."""
    rows = tuple(tuple(column) for column in np.array([(*place, 1.0) for place in PLACES]).T.tolist())
    cases = [Case(f"{n}, {m}", of_powers(n, m, Rational(n, m), n), rows, (), len(PLACES)) for n, m in RULES[1::4]]
    lines_are_short(cases)
    text_compiles_without_warnings(tmp_path, cases)
    behaviour_is_defined(tmp_path, cases[::2])


@pytest.mark.parametrize("compiled", BACKENDS)
def test_a_bend_that_does_not_count(compiled: Any) -> None:
    """The integrand is then a polynomial, whatever D is."""
    body = (let("v0", "mul", "x0", "x0"),)
    for power in (1, 2):
        integral = integrate("v1", "x0", 0.0, 1.0, body, "v0", rule=Rational(3, power), bends=(Bend("pole", (0.5, "p0", 0.0), False),))
        found = compiled(program(1, (integral,), "v1")).outcome([np.array([-1.0, 1.0, math.nan])], 3)
        np.testing.assert_allclose(found.values[0], 1 / 3, rtol=1e-15)
        assert not found.missed


# -- programs ----------------------------------------------------------------------------------------------------------

x, y = teg.vars("x y")
a, b, c, d, t = teg.params("a b c d t")


def rules(e: teg.Expr) -> list[object]:
    return [s.rule for s in statements(teg.compile(e).program(0).body) if isinstance(s, Integrate)]


@pytest.mark.parametrize(
    ("integrand", "rule"),
    [
        (1 / (x + a), Rational(1, 1)),
        ((1 + x) ** 2 / (x + a), Rational(3, 1)),
        (x / (b * x + a) ** 3, Rational(2, 3)),
        (teg.bracket(x < t) / teg.abs(x + a), Rational(1, 1)),
        ((x + a) * (1 + x) / (x + a) ** 2, Rational(2, 1)),
    ],
)
def test_rational_integrands_are_recognised(integrand: teg.Expr, rule: Rational) -> None:
    assert rules(teg.integral(integrand, (x, 0, 1))) == [rule]


@pytest.mark.parametrize(
    "integrand", [1 / (x * x + a), 1 / ((x + a) * (x + b)), teg.exp(x) / (x + a), teg.sqrt(x + b) / (x + a), 1 / (x + a) ** 4]
)
def test_others_are_not(integrand: teg.Expr) -> None:
    assert not any(isinstance(rule, Rational) for rule in rules(teg.integral(integrand, (x, 0, 1))))


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=needs_c)])
def test_a_power_in_the_denominator(backend: str) -> None:
    f = teg.compile(teg.integral((1 + x) ** 2 / (b * x + a), (x, 0, 1)), [a, b], backend=backend)
    at = {"a": 0.5, "b": 1.5}
    assert f.evaluations(at) == 3
    exactly = mpmath.quad(lambda u: (1 + u) ** 2 / (1.5 * u + 0.5), mpmath.linspace(0, 1, 9))
    assert f(at) == pytest.approx(float(exactly), rel=1e-14)
    value, error = f.value_and_error(at)
    assert abs(value - exactly) <= error <= 1e-12 * value
    assert teg.check_gradient(f, at)


BRANCHES: dict[str, tuple[teg.Expr, Callable[[float, float], float]]] = {
    "distance": (1 / (1 + teg.abs(x - a)), lambda t, _: math.log((1 + t) * (2 - t))),
    "its square": (1 / (1 + teg.abs(x - a)) ** 2, lambda t, _: 2 - 1 / (1 + t) - 1 / (2 - t)),
    "its cube": (x / (1 + teg.abs(x - a)) ** 3, lambda t, _: (t**4 - 3 * t**3 + t**2 + t + 0.5) / (t**3 - 3 * t**2 + 4)),
    "maximum": (1 / (1 + teg.maximum(x, a)), lambda t, _: t / (1 + t) + math.log(2 / (1 + t))),
    "two poles": (1 / (1 + teg.where(x < a, x, b * x)), lambda t, s: math.log(1 + t) + math.log((1 + s) / (1 + s * t)) / s),
    "pole and number": (1 / (1 + teg.where(x < a, x, b)), lambda t, s: math.log(1 + t) + (1 - t) / (1 + s)),
    "factors": (teg.where(x < a, x, 2) / (1 + teg.where(x < a, x, b)), lambda t, s: t - math.log(1 + t) + 2 * (1 - t) / (1 + s)),
}
"""Functions of x, and their integrals over (0, 1) by a and b in closed form."""


@pytest.mark.parametrize("name", BRANCHES)
@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=needs_c), pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.usefixtures("x64_for_jax")
def test_branches_have_a_pole_each(name: str, backend: str) -> None:
    """The coefficients of a branch were taken for those of all pieces."""
    integrand, exactly = BRANCHES[name]
    f = teg.compile(teg.integral(integrand, (x, 0, 1)), [a, b], backend=backend)
    value, gradient = f.value_and_grad(a=0.3, b=0.7)
    assert value == pytest.approx(exactly(0.3, 0.7), rel=1e-12)
    h = 1e-3
    for p, (da, db) in {"a": (h, 0.0), "b": (0.0, h)}.items():
        far, near = (exactly(0.3 + k * da, 0.7 + k * db) - exactly(0.3 - k * da, 0.7 - k * db) for k in (2, 1))
        assert gradient[p] == pytest.approx((8 * near - far) / (12 * h), rel=1e-9, abs=1e-9)


def bilinear_area(corners: list[Any]) -> Any:
    """The area of bilerp > t in closed form, 80 digits: c00, c10, c01, c11, t."""
    c00, c10, c01, c11, level = corners
    p, q, r, s = c00 - level, c10 - c00, c01 - c00, c00 - c10 - c01 + c11
    cuts = [mpmath.mpf(0), mpmath.mpf(1)]
    cuts += [-n / k for n, k in ((p, q), (p + r, q + s), (r, s)) if k != 0 and 0 < -n / k < 1]
    cuts.sort()
    area = mpmath.mpf(0)
    for left, right in pairwise(cuts):
        middle = (left + right) / 2
        below, above = p + q * middle > 0, p + r + (q + s) * middle > 0
        if below and above:
            area += right - left
        elif below or above:
            if abs(s) > mpmath.mpf(10) ** -50:
                under = -(q / s) * (right - left) - (p - q * r / s) / s * mpmath.log((r + s * right) / (r + s * left))
            else:
                under = -(p * (right - left) + q * (right**2 - left**2) / 2) / r
            area += under if below else right - left - under
    return area


def hard_corners() -> dict[str, list[float]]:
    """Corner values and thresholds: two branches, near the saddle, nearly affine, along an axis, near a corner."""
    cross = [0.83, 0.21, 0.34, 0.92]
    saddle = (cross[0] * cross[3] - cross[1] * cross[2]) / (cross[0] - cross[1] - cross[2] + cross[3])
    rows = {"one branch": [0.1, 0.9, 0.4, 0.7, 0.5], "two branches": [*cross, 0.5], "corner": [0.1, 0.9, 0.4, 0.7, 0.1 + 1e-9]}
    rows |= {f"saddle {e:g}": [*cross, saddle + e] for e in (1e-2, -1e-4, 1e-6, -1e-8, 1e-10)}
    rows |= {f"nearly affine {e:g}": [0.1, 0.9, 0.4, 1.2 + e, 0.55] for e in (0.0, 1e-14, 1e-9, -1e-5, 1e-2)}
    return rows | {"axis": [0.2, 0.9, 0.2, 0.9, 0.5], "steep": [0.2, 0.2, 0.9, 0.9 + 1e-7, 0.5]}


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=needs_c)])
def test_bilinear_pixels(backend: str) -> None:
    """Area and gradient to 1e-12 of max(1, |value|), but for derivatives near the saddle, which are as well-conditioned as it is far."""
    e, wrt = bilinear_pixel()
    f = teg.compile(e, wrt[:5], backend=backend)
    rows = hard_corners()
    names = [p.name for p in wrt[:5]]
    values = dict(zip(names, np.array(list(rows.values())).T, strict=True))
    colours = {f"{part}{k}": float(part == "above" and k == 0) for part in ("above", "below", "target") for k in range(3)}
    value, gradient = f.value_and_grad(values | colours)
    with mpmath.workdps(80):
        step = mpmath.mpf(10) ** -24
        for i, (kind, row) in enumerate(rows.items()):
            at = [mpmath.mpf(v) for v in row]
            assert value[i] == pytest.approx(float(bilinear_area(at)), abs=2e-13), kind
            for j, p in enumerate(names):
                ends = [bilinear_area([*at[:j], at[j] + s, *at[j + 1 :]]) for s in (step, -step)]
                slope = float((ends[0] - ends[1]) / (2 * step))
                loose = 1e-15 / abs(float(kind.split()[1])) if kind.startswith("saddle") else 0.0
                assert gradient[p][i] == pytest.approx(slope, rel=1e-12 + loose, abs=1e-12 + loose), (kind, p)


def test_a_batch_that_shares_a_parameter_is_told_of_the_pole_it_meets() -> None:
    f = teg.compile(teg.integral(b / (x + a), (x, 0, 1)), [a, b])
    with pytest.warns(AccuracyWarning, match="does not converge at a = 0"):
        found = f(a=np.array([1.0, 0.0]), b=2.0)
    np.testing.assert_allclose(found, [2 * math.log(2), math.inf])


SHIFTED = x * (y + a)
WORDS = {
    "a root": teg.sqrt(SHIFTED) < teg.sqrt(t),
    "a logarithm": teg.log(SHIFTED) < teg.log(t),
    "a power": t**1.5 > SHIFTED**1.5,
    "a fourth root": t**0.25 > SHIFTED**0.25,
    "an inverse root": 1 / teg.sqrt(SHIFTED) > 1 / teg.sqrt(t),
    "a root of more": teg.sqrt(SHIFTED + 1) < teg.sqrt(t + 1),
    "an exponential of a root": teg.exp(teg.sqrt(SHIFTED)) < teg.exp(teg.sqrt(t)),
    "log1p": teg.log1p(SHIFTED) < teg.log1p(t),
    "not": ~(teg.sqrt(SHIFTED) >= teg.sqrt(t)),
}
"""x·(y + a) < t, where a function hides that the root in x, t/(y + a), has a pole."""


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", WORDS)
def test_a_pole_of_a_root_that_a_function_hides(name: str, backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(WORDS[name]) * (1 + b * x), (x, 0, 1), (y, 0, 1)), [t, a, b], backend=backend)
    at = {"t": 0.4, "a": 0.7, "b": 0.0}
    area, square = 0.4 * math.log(1.7 / 0.7), 0.4 * 0.4 * (1 / 0.7 - 1 / 1.7)
    value, slopes = f.value_and_grad(at)
    assert value == pytest.approx(area, rel=1e-12)
    assert slopes["t"] == pytest.approx(area / 0.4, rel=1e-11)
    assert slopes["a"] == pytest.approx(-square / 0.4, rel=1e-11)
    assert slopes["b"] == pytest.approx(square / 2, rel=1e-12)


def test_a_pole_at_the_end_of_the_range() -> None:
    f = teg.compile(teg.integral(teg.bracket(teg.sqrt(x * y) < t), (x, 0, 1), (y, 0, 1)))
    assert f(t=0.5) == pytest.approx(0.25 * (1 - 2 * math.log(0.5)), rel=1e-12)
