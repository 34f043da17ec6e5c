"""Conditions on an increasing function and a number: the surfaces that they become, and values, gradients and Hessians."""

from __future__ import annotations

import math

import numpy as np
import pytest

import teg
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import TRUE, Call
from teg.ir.node import postorder
from teg.ir.simplify import call
from teg.passes.normalise.canonicalise import Canonical, canonicalise
from teg.passes.normalise.thresholds import between_exponentials, threshold
from tests.passes.differentiate.candidates import follows_edges

x, y = teg.vars("x y")
t, a, b = teg.params("t a b")
SQUARE = ((x, -1, 1), (y, -1, 1))
u = x * x + y * y
PI = math.pi


@pytest.mark.parametrize(
    ("g", "level", "counts", "rising"),
    [
        (t - teg.sqrt(u), t**2, t > 0, False),
        (2 * teg.sqrt(u) - t, (0.5 * t) ** 2, t > 0, True),
        (t - 3 * teg.exp(x * y), teg.log(t / 3), t > 0, False),
        (teg.log(u) + t, teg.exp(-t), None, True),
        (u**1.5 - a - t, (a + t) ** (1 / 1.5), a + t > 0, True),
        (call("magnitude", x * y - t) ** 0.5 - a, a**2, a > 0, True),
    ],
    ids=["root", "scaled", "exponential", "logarithm", "power", "root of a size"],
)
def test_levels(g: teg.Expr, level: teg.Expr, counts: teg.Cond | None, rising: bool) -> None:
    found = threshold(g)
    assert found is not None
    assert found.rising == rising
    if counts is None:
        assert found.counts is TRUE
    else:
        both = Canonical()  # which knows the surfaces of both
        assert both(teg.bracket(counts)) is both(teg.bracket(found.counts))
    f, wanted = (teg.compile(e + 0 * (t + a), [t, a]) for e in (found.level, level))
    assert f(t=0.7, a=0.4) == pytest.approx(wanted(t=0.7, a=0.4), rel=1e-14)


@pytest.mark.parametrize(
    "g",
    [
        teg.sqrt(x * y) - t,  # not defined everywhere: such a condition is neither true nor false there
        teg.log(x) - t,
        teg.sqrt(u) - x,
        teg.sqrt(u) * a - t,  # the sign of a decides
        teg.sin(x) - t,
        teg.exp(x) - t,  # has a formula as it is
        teg.sqrt(u) + teg.exp(x) - t,
        u**-0.5 - t,
    ],
)
def test_what_is_none(g: teg.Expr) -> None:
    assert threshold(g) is None


CASES: dict[str, tuple[teg.Cond, float, float, float]] = {
    "a distance": (teg.sqrt(u) < t, PI * 0.36, 2 * PI * 0.6, 2 * PI),
    "a distance above": (teg.sqrt(u) > t, 4 - PI * 0.36, -2 * PI * 0.6, -2 * PI),
    "a distance, scaled": (-2 * teg.sqrt(u) > -t, PI * 0.09, PI * 0.3, PI / 2),
    "not": (~(teg.sqrt(u) >= t), PI * 0.36, 2 * PI * 0.6, 2 * PI),
    "a negative distance": (teg.sqrt(u) < -t, 0.0, 0.0, 0.0),
    "above a negative distance": (teg.sqrt(u) > -t, 4.0, 0.0, 0.0),
    "a level of a Gaussian": (teg.exp(-u) > t, -PI * math.log(0.6), -PI / 0.6, PI / 0.36),
    "below a level": (teg.exp(-u) < t, 4 + PI * math.log(0.6), PI / 0.6, -PI / 0.36),
    "a Gaussian above a negative level": (teg.exp(-u) > -t, 4.0, 0.0, 0.0),
    "a logarithm": (teg.log(u) < -t, PI * math.exp(-0.6), -PI * math.exp(-0.6), PI * math.exp(-0.6)),
    "a power": (u**1.5 < t, PI * 0.6 ** (2 / 3), PI * 2 / 3 * 0.6 ** (-1 / 3), -PI * 2 / 9 * 0.6 ** (-4 / 3)),
    "a number": (teg.sqrt(u) * 2 < 1, PI / 4, 0.0, 0.0),
    "a ring": (teg.abs(teg.sqrt(u) - 0.5) < t / 2, PI * (0.8**2 - 0.2**2), 2 * PI * (0.8 + 0.2) / 2, 2 * PI * (1 - 1) / 4),
}
"""Areas in [-1, 1]² with their first and second derivatives by t at 0.6."""


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", CASES)
def test_areas(name: str, backend: str) -> None:
    condition, *wanted = CASES[name]
    f = teg.compile(teg.integral(teg.bracket(condition), *SQUARE), [t], backend=backend)
    value, slopes = f.value_and_grad(t=0.6)
    assert [value, slopes["t"], f.hessian(t=0.6)["t", "t"]] == pytest.approx(wanted, abs=1e-11)


def test_a_distance_is_a_conic() -> None:
    e = canonicalise(teg.integral(teg.bracket(teg.sqrt((x - a) ** 2 + (y - b) ** 2) < t), *SQUARE))
    assert not any(isinstance(n, Call) and n.name == "sqrt" for atom in atoms_of(e) for n in postorder([atom.g]))
    f = teg.compile(e, [t, a, b])
    assert f.grad(t=0.5, a=0.1, b=-0.2) == pytest.approx({"t": PI, "a": 0.0, "b": 0.0}, abs=1e-12)


def test_functions_that_move_with_the_level() -> None:
    """√(x² + a²) < t, y free: 2·√(t² - a²), with all derivatives by both parameters."""
    f = teg.compile(teg.integral(teg.bracket(teg.sqrt(x * x + a * a) < t), (x, -1, 1), (y, 0, 1)), [t, a])
    root = math.sqrt(0.64 - 0.09)
    assert f.grad(t=0.8, a=0.3) == pytest.approx({"t": 1.6 / root, "a": -0.6 / root}, rel=1e-12)
    h = f.hessian(t=0.8, a=0.3)
    assert [h["t", "t"], h["t", "a"]] == pytest.approx([-2 * 0.09 / root**3, 2 * 0.8 * 0.3 / root**3], rel=1e-11)


def _regions() -> list[tuple[teg.Cond, teg.Cond]]:
    """Regions of candidates with other functions, and the same as polynomials."""
    D, k = teg.array("D", 2), teg.index("k")
    u, v, r = x - D[k, 0], y - D[k, 1], D[k, 2]
    square = u**2 + v**2
    distance, disk = teg.sqrt(square), square < r**2
    return [
        (distance < r, disk & (r > 0)),
        (~(distance >= r), disk & (r > 0)),
        (square**0.75 < teg.sqrt(r**3), disk & (r > 0)),
        (teg.exp(-square / r**2) > math.exp(-1.0), disk),
        (teg.log(square) < teg.log(r**2), disk),
        (teg.sqrt((u / r) ** 2 + (2 * v / r) ** 2) < 1, u**2 + 4 * v**2 < r**2),
        ((distance < r) & (distance > 0.5 * r), disk & (square > 0.25 * r**2) & (r > 0)),
        (abs(v) < r - u**2, (v < r - u**2) & (-v < r - u**2)),
        (abs(distance - r) < 0.25 * r, (square < (1.25 * r) ** 2) & (square > (0.75 * r) ** 2) & (r > 0)),
        (teg.maximum(distance - r, u) < 0, disk & (u < 0) & (r > 0)),
    ]


@pytest.mark.parametrize("number", range(10))
def test_regions_of_candidates(number: int) -> None:
    """However many: they are followed along edges, as those of polynomials are."""
    D, k = teg.array("D", 2), teg.index("k")
    rows = np.random.default_rng(number).uniform(0.05, 0.3, (12, 3))
    rows[:, :2] = np.random.default_rng(number + 1).random((12, 2))
    results = []
    for region in _regions()[number]:
        covered = teg.integral(teg.bracket(teg.any(region, (k, 0, teg.length(D)))) * (1 + x), (x, 0, 1), (y, 0, 1))
        f = teg.compile(covered, [D])
        assert follows_edges(f)
        results.append(f.value_and_grad(D=rows))
    (value, gradient), (expected, slopes) = results
    assert value == pytest.approx(expected, abs=1e-12)
    assert gradient["D"] == pytest.approx(slopes["D"], abs=1e-8)
    at = (np.arange(1000) + 0.5) / 1000
    if number == 0:
        inside = np.any([np.hypot(at[:, None] - a, at[None, :] - b) < r for a, b, r in rows], axis=0)
        assert value == pytest.approx((inside * (1 + at[:, None])).mean(), abs=1e-4)


LINE = (-math.inf, math.inf)


def density(z: teg.Expr, middle: object = 0.0, width: object = 1.0) -> teg.Expr:
    """The density of a normal number."""
    return teg.exp(-(((z - middle) / width) ** 2) / 2) / (math.sqrt(2 * math.pi) * width)


def below(z: float) -> float:
    """The probability that a normal number is less than z."""
    return 0.5 * math.erfc(-z / math.sqrt(2))


@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("a_value", [-0.7, 0.0, 0.7])
@pytest.mark.parametrize("b_value", [-0.3, 0.0, 0.3])
def test_signs_of_two_exponentials(a_value: float, b_value: float, strict: bool) -> None:
    p, q = teg.params("p q")
    found = between_exponentials(a * teg.exp(p) * teg.exp(2 * x) + b * teg.exp(x * y) / 3, strict)
    assert found is not None
    assert teg.exp(x) not in postorder([found])
    f = teg.compile(teg.substitute(teg.bracket(found), {x: p, y: q}))
    for at in ((0.3, 0.1), (0.3, 9.0), (-0.3, 5.0), (-2.0, -1.0)):
        g = a_value * math.exp(3 * at[0]) + b_value * math.exp(at[0] * at[1]) / 3
        assert f(a=a_value, b=b_value, p=at[0], q=at[1]) == (g > 0 or (g == 0 and not strict))


@pytest.mark.parametrize(
    "g",
    [
        teg.exp(x) - t,  # a number is a threshold
        teg.exp(x) - a * teg.exp(y) + t,
        teg.exp(x) - y * teg.exp(y),
        teg.exp(x) - teg.exp(y) + teg.exp(x * y),
        teg.exp(x) * a,
    ],
    ids=["number", "two and a number", "other factors", "three", "one"],
)
def test_no_two_exponentials(g: teg.Expr) -> None:
    assert between_exponentials(g, True) is None


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_linear_discriminant(backend: str) -> None:
    """The part of one class that is taken for the other: P(d·x > d²/2 + log((1 - k)/k)), with the distance d of the means. It had no
    estimate, and took 12 seconds."""
    m, r, k = teg.params("m r k")
    first, second = k * density(x, m) * density(y, r), (1 - k) * density(x) * density(y)
    f = teg.compile(teg.integral(teg.bracket(first > second) * density(x) * density(y), (y, *LINE), (x, *LINE)), [m, r, k], backend=backend)

    def exact(m: float, r: float, k: float) -> float:
        d = math.hypot(m, r)
        return below(-(d / 2 + math.log((1 - k) / k) / d))

    at = {"m": 1.0, "r": 0.3, "k": 0.4}
    value, slopes = f.value_and_grad(at)
    assert value == pytest.approx(exact(**at), rel=1e-11)
    assert f.value_and_error(at)[1] < 1e-10
    for p in at:
        h = 1e-5
        assert slopes[p] == pytest.approx((exact(**{**at, p: at[p] + h}) - exact(**{**at, p: at[p] - h})) / (2 * h), abs=1e-9)


def test_a_quadratic_discriminant() -> None:
    """The smaller of two densities in one variable and two: Bayes' error, by the roots of a quadratic polynomial."""
    m, s, k = teg.params("m s k")
    error = teg.minimum(k * density(x, m, s), (1 - k) * density(x))
    one = teg.compile(teg.integral(error, (x, *LINE)), [m, s, k])
    two = teg.compile(teg.integral(error * density(y), (y, *LINE), (x, *LINE)), [m, s, k])

    def exact(m: float, s: float, k: float) -> float:
        c = (1 / s**2 - 1, -2 * m / s**2, m**2 / s**2 - 2 * math.log(k / (s * (1 - k))))  # of the square of the distances
        lo, hi = sorted(np.roots(c))  # the first class is outside, for s > 1
        inside = below((hi - m) / s) - below((lo - m) / s)
        return float(k * inside + (1 - k) * (1 - below(hi) + below(lo)))

    at = {"m": 1.0, "s": 1.5, "k": 0.4}
    for f in (one, two):
        value, slopes = f.value_and_grad(at)
        assert value == pytest.approx(exact(**at), rel=1e-11)
        for p in at:
            h = 1e-5
            assert slopes[p] == pytest.approx((exact(**{**at, p: at[p] + h}) - exact(**{**at, p: at[p] - h})) / (2 * h), abs=1e-9)


def test_a_ratio_of_likelihoods() -> None:
    """The power of a test by the ratio of two densities, which is no sum."""
    m, c = teg.params("m c")
    f = teg.compile(teg.integral(teg.bracket(density(x, m) / density(x) > c) * density(x, m), (x, *LINE)), [m, c])
    value, slopes = f.value_and_grad(m=1.3, c=2.0)
    at_cut = math.log(2.0) / 1.3 + 0.65
    assert value == pytest.approx(1 - below(at_cut - 1.3), rel=1e-12)
    assert slopes["c"] == pytest.approx(-math.exp(-((at_cut - 1.3) ** 2) / 2) / math.sqrt(2 * PI) / (1.3 * 2.0), rel=1e-10)
