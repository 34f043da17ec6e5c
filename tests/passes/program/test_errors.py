"""Error estimates: they hold, they are not far too large where nothing is lost, and what happens where a tolerance is not reached."""

from __future__ import annotations

import math
import warnings
from fractions import Fraction

import numpy as np
import pytest

import teg
from teg import AccuracyError, AccuracyWarning, Expr
from tests.bench.shapes import BRACKETS, INTEGRANDS, Shape, shapes
from tests.references import Reference, untagged

x, y = teg.vars("x y")
a, b, r, t = teg.params("a b r t")
INF = math.inf
BACKENDS = ("numpy", "c")
EPS = 2.0**-52


# -- they hold ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reference", untagged("slow", "later"), ids=lambda r: r.id)
def test_estimates_hold_on_the_references(reference: Reference) -> None:
    f = teg.compile(reference.build(), [teg.param(k) for k in reference.params], inaccurate="ignore")
    value, estimate = f.value_and_error(reference.params)
    exact = float(reference.value)
    if not math.isfinite(exact):
        assert value == exact
        return
    assert abs(Fraction(reference.value) - Fraction(float(value))) <= estimate
    assert estimate <= max(1e-8 * abs(exact), 1e-12)


DRAWN = (
    ("1-D", "log·cos"),
    ("1-D", "polynomial·sin, affine, quadratic"),
    ("1-D", "1/(x² + b²), quadratic"),
    ("1-D", "√x·exp, cubic"),
    ("1-D", "cos x², quadratic"),
    ("2-D", "2 conics, polynomial"),
    ("2-D", "triangle, conic, exp·cos"),
    ("nested", "row² · y"),
    ("nested", "quotient"),
    ("gradient 2-D", "2 lines, exp·cos"),
)


@pytest.mark.parametrize("shape", [s for s in shapes() if (s.kind, s.name) in DRAWN], ids=lambda s: f"{s.kind}: {s.name}")
def test_estimates_hold_on_random_programs(shape: Shape) -> None:
    """30 draws of each; the truth is another program of the same value, computed to 1e-14."""
    values = shape.draw(np.random.default_rng(5), 30)

    def found(e: Expr, tol: float) -> tuple[np.ndarray, np.ndarray]:
        f = teg.compile(e, list(shape.wrt), tol=tol, inaccurate="ignore")
        given = {name: values[name] for name in f.parameters}
        if not shape.wrt:
            value, estimate = f.value_and_error(given)
            return value[None], estimate[None]
        gradient, estimates = f.grad_and_error(given)
        return np.array(list(gradient.values())), np.array(list(estimates.values()))

    truth, doubt = found(shape.again, 1e-14)
    value, estimate = found(shape.program, 1e-7)
    error = np.abs(value - truth)
    known = doubt <= 0.5 * estimate
    assert known.mean() > 0.25
    assert (error <= estimate + doubt).all(), np.max(error / (estimate + doubt))
    assert (error[known] <= 1e-6 * np.maximum(np.abs(truth[known]), 1e-3)).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_through_products_quotients_and_functions_of_integrals(backend: str) -> None:
    """u = ∫₀ᵗ exp and v = ∫₀ᵗ cos have closed forms; rough inner integrals, so that there is an error to carry."""
    u, v = teg.integral(teg.exp(a * x), (x, 0, t)), teg.integral(teg.cos(a * x), (x, 0, t))
    at = {"a": 9.0, "t": 1.5}
    exact_u, exact_v = math.expm1(13.5) / 9.0, math.sin(13.5) / 9.0
    for e, exact in (
        (u * v, exact_u * exact_v),
        (v / u, exact_v / exact_u),
        (teg.exp(v) * u, math.exp(exact_v) * exact_u),
        (teg.log(u) - v**3, math.log(exact_u) - exact_v**3),
        (teg.sqrt(u), math.sqrt(exact_u)),
        (teg.atan2(v, u) * 1e5, math.atan2(exact_v, exact_u) * 1e5),
        (teg.where(u > 1, u, v), exact_u),
    ):
        f = teg.compile(e, backend=backend, rule="adaptive", order=6, tol=1e-3)
        value, estimate = f.value_and_error(at)
        assert abs(value - exact) <= estimate <= 0.1 * abs(exact)


def test_a_choice_that_may_be_wrong_is_part_of_the_estimate() -> None:
    """[u > c] with c within the error of u: the estimate covers the other side of the jump."""
    u = teg.integral(teg.exp(9 * x), (x, 0, t))
    f = teg.compile(teg.bracket(u > a), order=4, tol=1e-2)
    rough, error = teg.compile(u, order=4, tol=1e-2).value_and_error(t=1.5)
    assert error > 0
    for c, doubtful in ((rough + 0.1 * error, True), (rough - 0.1 * error, True), (rough + 3 * error, False)):
        assert (f.value_and_error(t=1.5, a=c)[1] >= 1.0) == doubtful


def test_what_another_condition_decides_is_not_in_doubt() -> None:
    u = teg.integral(teg.exp(9 * x), (x, 0, t))
    near, rough = u > a, float(teg.compile(u, order=4, tol=1e-2)(t=1.5))
    for c, decides in ((near | (b > 0), 1.0), (near & (b > 0), -1.0), (~near & (b > 0) & (u > 0), -1.0)):
        f = teg.compile(teg.bracket(c), order=4, tol=1e-2)
        assert f.value_and_error(t=1.5, a=rough, b=decides)[1] < 1e-12
        assert f.value_and_error(t=1.5, a=rough, b=-decides)[1] >= 1.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_estimates_of_derivatives_of_distances_to_the_nearest_site(backend: str) -> None:
    k, sites = teg.index("k"), teg.array("S")
    f = teg.compile(teg.integral(teg.minimum_of((x - sites[k]) ** 2, (k, 0, teg.length(sites))), (x, 0, 1)), backend=backend)
    gradient, estimate = f.grad_and_error(S=[0.25, 0.5])  # ½(2s - 2x) over each cell
    np.testing.assert_allclose(gradient["S"], [2 * (0.25 * 0.375 - 0.375**2 / 2), 2 * (0.5 * 0.625 - (1 - 0.375**2) / 2)], atol=1e-14)
    assert (estimate["S"] < 1e-9).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("degree", [0, 1, 3, 8])
def test_estimates_of_exact_polynomials_are_a_few_roundings(degree: int, backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(x + y < t) * x**degree, (x, 0, 1), (y, 0, 1)), backend=backend)
    value, estimate = f.value_and_error(t=0.7)
    assert abs(value - 0.7 ** (degree + 2) / ((degree + 1) * (degree + 2))) <= estimate <= 200 * EPS * value
    gradient, estimates = f.grad_and_error(t=0.7)
    assert abs(gradient["t"] - 0.7 ** (degree + 1) / (degree + 1)) <= estimates["t"] <= 200 * EPS * gradient["t"]


def test_estimates_have_the_shape_of_the_values() -> None:
    f = teg.compile(teg.tuple(teg.integral(teg.exp(a * x), (x, 0, t)), a), [t])
    (first, second), (of_first, of_second) = f.value_and_error(a=np.array([[1.0], [2.0]]), t=np.array([0.5, 1.0, 2.0]))
    assert first.shape == of_first.shape == second.shape == of_second.shape == (2, 3)
    gradient, errors = f.grad_and_error(a=1.0, t=0.5)
    assert gradient.keys() == errors.keys() == {"t"}
    assert len(gradient["t"]) == len(errors["t"]) == 2


def test_standard_errors_of_samples() -> None:
    """The rules \"montecarlo\" and \"qmc\" give a standard error: the true one is rarely more than 4 of them."""
    e = teg.integral(teg.bracket(x * x + y * y < t * t), (x, 0, 1), (y, 0, 1))
    for rule, most in (("montecarlo", 0.02), ("qmc", 0.002)):
        value, error = teg.compile(e, rule=rule, order=4096).value_and_error(t=0.9)
        assert abs(value - math.pi * 0.81 / 4) <= 5 * error
        assert error <= most


# -- a tolerance that is not reached -----------------------------------------------------------------------------------

ENDLESS_WAVES = teg.integral(teg.sin(t / x), (x, 0, 1))
"""0.5040670619069284 at t = 1 (= sin 1 - Ci 1), with infinitely many waves near 0."""


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_missed_tolerance_is_a_warning_with_the_estimate(backend: str) -> None:
    f = teg.compile(ENDLESS_WAVES, backend=backend)
    with pytest.warns(AccuracyWarning, match=r"misses the tolerance 1e-10 at t = 1.*error estimate"):
        value = f(t=1.0)
    _, estimate = f.value_and_error(t=1.0)
    assert estimate > 1e-10
    assert abs(value - 0.5040670619069284) <= estimate


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_missed_tolerance_is_an_error_if_asked(backend: str) -> None:
    with pytest.raises(AccuracyError, match="misses the tolerance"):
        teg.compile(ENDLESS_WAVES, backend=backend, inaccurate="raise")(t=1.0)


def test_a_missed_tolerance_is_ignored_if_asked() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert teg.compile(ENDLESS_WAVES, inaccurate="ignore")(t=1.0) == pytest.approx(0.504, rel=1e-2)


def test_only_the_element_that_misses_is_named() -> None:
    e = teg.integral(teg.where(t > 0, teg.sin(t / x), 1), (x, 0, 1))
    f = teg.compile(e, inaccurate="raise")
    assert np.all(f(t=np.array([-1.0, -2.0])) == pytest.approx(1.0, rel=1e-14))
    with pytest.raises(AccuracyError, match=r"at t = 0\.75"):
        f(t=np.array([-1.0, 0.75, -2.0]))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("e", "at", "value"),
    [
        (teg.integral(a / x, (x, 0, 1)), {"a": 2.0}, INF),
        (teg.integral(a / x, (x, 0, 1)), {"a": -2.0}, -INF),
        (teg.integral(1 / (x - t) ** 2, (x, 0, 1)), {"t": 0.4}, INF),
        (teg.integral(1 / (x - t), (x, 0, 1)), {"t": 0.4}, math.nan),
    ],
    ids=["1/x", "-1/x", "double pole", "pole"],
)
def test_divergence_is_said(e: Expr, at: dict[str, float], value: float, backend: str) -> None:
    """Infinite with its sign, and not a number where +∞ and -∞ meet."""
    f = teg.compile(e, backend=backend)
    with pytest.warns(AccuracyWarning, match="seems to diverge"):
        found = f(at)
    assert found == value or (math.isnan(found) and math.isnan(value))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        assert not f.value_and_error(at)[1] < math.inf
    if math.isnan(value):
        with pytest.warns(AccuracyWarning, match="is not a number"):
            f.value_and_error(at)


# -- infinite bounds and singular ends ---------------------------------------------------------------------------------

GAUSS = teg.exp(-x * x / 2)
PLANE = teg.exp(-(x * x + y * y) / 2)
INFINITE: tuple[tuple[str, Expr, dict[str, float], float, dict[str, float]], ...] = (
    (
        "a Gaussian above a threshold",
        teg.integral(teg.bracket(x > t) * GAUSS, (x, -INF, INF)),
        {"t": 0.7},
        math.sqrt(math.pi / 2) * math.erfc(0.7 / math.sqrt(2)),
        {"t": -math.exp(-0.245)},
    ),
    ("exp(-ax)", teg.integral(teg.exp(-a * x), (x, 0, INF)), {"a": 2.5}, 0.4, {"a": -0.16}),
    ("exp(ax) to the left", teg.integral(teg.exp(a * x), (x, -INF, t)), {"a": 2.5, "t": 0.4}, math.e / 2.5, {"t": math.e, "a": 0.0}),
    (
        "Cauchy below a threshold",
        teg.integral(teg.bracket(x < t) / (1 + x * x), (x, -INF, INF)),
        {"t": 0.7},
        math.pi / 2 + math.atan(0.7),
        {"t": 1 / 1.49},
    ),
    (
        "a narrow Gaussian far away",
        teg.integral(teg.exp(-(((x - a) / b) ** 2)), (x, -INF, INF)),
        {"a": 1000.0, "b": 0.01},
        0.01 * math.sqrt(math.pi),
        {"a": 0.0, "b": math.sqrt(math.pi)},
    ),
    (
        "a half-plane under a Gaussian",
        teg.integral(teg.bracket(a * x + b * y < t) * PLANE, (x, -INF, INF), (y, -INF, INF)),
        {"a": 0.6, "b": 0.8, "t": 0.5},
        math.pi * math.erfc(-0.5 / math.sqrt(2)),
        {
            "t": math.sqrt(2 * math.pi) * math.exp(-0.125),
            "a": -0.3 * math.sqrt(2 * math.pi) * math.exp(-0.125),
            "b": -0.4 * math.sqrt(2 * math.pi) * math.exp(-0.125),
        },
    ),
    (
        "a disk under a Gaussian",
        teg.integral(teg.bracket(x * x + y * y < r * r) * PLANE, (x, -INF, INF), (y, -INF, INF)),
        {"r": 1.5},
        -2 * math.pi * math.expm1(-1.125),
        {"r": 3 * math.pi * math.exp(-1.125)},
    ),
)
SINGULAR: tuple[tuple[str, Expr, dict[str, float], float, dict[str, float]], ...] = (
    ("1/√x", teg.integral(1 / teg.sqrt(x), (x, 0, t)), {"t": 2.0}, 2 * math.sqrt(2), {"t": 1 / math.sqrt(2)}),
    ("log x", teg.integral(teg.log(x), (x, 0, t)), {"t": 2.0}, 2 * math.log(2) - 2, {"t": math.log(2)}),
    ("x^-0.9", teg.integral(x**-0.9, (x, 0, t)), {"t": 2.0}, 10 * 2**0.1, {"t": 2**-0.9}),
    ("√(x(t - x))", teg.integral(teg.sqrt(x * (t - x)), (x, 0, t)), {"t": 2.0}, math.pi / 2, {"t": math.pi / 2}),
    ("1/√(x(t - x))", teg.integral(1 / teg.sqrt(x * (t - x)), (x, 0, t)), {"t": 2.0}, math.pi, {}),
    ("1/√(t - x), cut", teg.integral(teg.bracket(x > a) / teg.sqrt(t - x), (x, 0, t)), {"t": 2.0, "a": 1.0}, 2.0, {"a": -1.0}),
)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("name", "e", "at", "value", "gradient"), [*INFINITE, *SINGULAR], ids=lambda v: v if isinstance(v, str) else "")
def test_infinite_bounds_and_singular_ends(
    name: str, e: Expr, at: dict[str, float], value: float, gradient: dict[str, float], backend: str
) -> None:
    f = teg.compile(e, [teg.param(p) for p in gradient], backend=backend)
    found, estimate = f.value_and_error(at)
    assert abs(found - value) <= estimate + 4 * EPS * abs(value), name
    assert estimate <= 1e-9 * abs(value)
    assert f(at) == pytest.approx(value, rel=1e-10)
    if gradient:
        derivative, estimates = f.grad_and_error(at)
        size = max(abs(g) for g in gradient.values())
        for p, exact in gradient.items():
            assert abs(derivative[p] - exact) <= estimates[p] + 4 * EPS * size, p
            assert estimates[p] <= 1e-9 * size


def test_every_integrand_and_bracket_is_drawn_somewhere() -> None:
    """The table of shapes covers what it is made of."""
    names = " ".join(s.name for s in shapes())
    assert all(name in names for name in (*INTEGRANDS, *BRACKETS))


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_root_of_nothing(backend: str) -> None:
    """√ of an inner integral that is exactly 0 on a part of the domain: its slope is infinite there, its error 0."""
    inner = teg.integral(teg.bracket(x * x + y * y < t), (x, -1, 1))
    f = teg.compile(teg.integral(teg.sqrt(inner), (y, -1, 1)), [t], backend=backend)
    value, error = f.value_and_error(t=0.5)
    exact = math.sqrt(2) * 0.5**0.75 * math.gamma(0.5) * math.gamma(1.25) / math.gamma(1.75)
    assert abs(value - exact) <= error < 1e-8


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_singularity_that_is_not_at_zero_is_known_to_the_rounding_of_its_place(backend: str) -> None:
    # ∫|x - c|^-s = (c^(1-s) + (1-c)^(1-s))/(1-s)
    x, c = teg.var("x"), teg.param("c")
    for power in (0.6, 0.7, 0.8, 0.9):
        f = teg.compile(teg.integral(teg.abs(x - c) ** -power, (x, 0, 1)), backend=backend)
        for at in (0.5, 0.3, 0.123):
            value, estimate = f.value_and_error(c=at)
            error = abs(value - (at ** (1 - power) + (1 - at) ** (1 - power)) / (1 - power))
            assert error <= 2 * estimate
            assert estimate <= 1e-8 * value
        value, estimate = teg.compile(teg.integral((1 - x) ** -power, (x, 0, 1)), backend=backend).value_and_error()
        assert abs(value - 1 / (1 - power)) <= 2 * estimate
        value, estimate = teg.compile(teg.integral(x**-power, (x, 0, 1)), backend=backend).value_and_error()
        assert abs(value - 1 / (1 - power)) <= estimate <= 1e-8
