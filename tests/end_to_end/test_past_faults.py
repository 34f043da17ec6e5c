"""Programs that were once wrong, with the right numbers and how they are known."""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest

import teg

pytestmark = pytest.mark.usefixtures("x64_for_jax")

B, INT = teg.bracket, teg.integral
x, y, z, s = teg.vars("x y z s")
t, a, b, c, d, u, lo, r, m, n = teg.params("t a b c d u l r m n")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
TINY = 1.7764603190678118e-08
CASES: dict[str, tuple[Callable[[], teg.Expr], dict[str, float], dict[str, float]]] = {
    # [x < t] + 2·[c·x < c·t] is 3·[x < t]: the sign of the ratio of the two atoms is that of c, however small
    "a small factor": (lambda: INT(B(x < t) + 2 * B(TINY * x < TINY * t), (x, 0, 1)), {"t": 0.3}, {"t": 3.0}),
    # two atoms of parameters only, made by sifting, were taken for proportional; by finite differences
    "unrelated guards": (
        lambda: INT(B((3 * y - x + b < 1) & (3 * y - 0.3 * x + a > 0)), (x, y, 1), (y, 0, t)),
        {"t": 0.6365, "a": 0.2, "b": 0.0},
        {"a": 1 / 9, "b": -0.1365},
    ),
    # the user's variable has the name that sifting takes; the same as with another name
    "a variable named s": (lambda: INT(B(x + y < t), (x, 0, s), (y, 0, s), (s, 0, 1)), {"t": 0.7}, {"t": 0.3325}),
    # e = ∫ (x + 1) dx up to I = ∫₀ᵃ (x + 1) dx = 0.345: de/da = (I + 1)·(a + 1); the inner x was taken for the outer one
    "a variable in a bound of its own integral": (
        lambda: INT(B(x < b) * (x + 1), (x, 0, INT(B(x < a) * (x + 1), (x, 0, t)))),
        {"t": 0.5, "a": 0.3, "b": 0.9},
        {"t": 0.0, "a": 1.345 * 1.3, "b": 0.0},
    ),
    # b - y - (x + a - y) has no y in it; area of {x < b - a} times that of {y < t}
    "a variable that cancels": (
        lambda: INT(B(y < t) * INT(B(x + a - y < b - y), (x, 0, 0.5)), (y, 0, 1)),
        {"t": 0.3, "a": 0.1, "b": 0.4},
        {"t": 0.3, "a": -0.3, "b": 0.3},
    ),
    # reversed outer bounds that are numbers, inner ones that depend: minus the forward integral
    "reversed and widened": (lambda: INT(B(y + x < b), (x, 0, y), (y, 1, 0.5)), {"b": 1.3}, {"b": -0.35}),
    # a line on a bound: the mean of 0 and 1, with bounds that are parameters too
    "a line on a lower bound": (
        lambda: INT(B(a * x + b * y < t), (x, lo, r), (y, m, n)),
        {"t": 0.0, "a": 1.0, "b": 0.0, "l": 0.0, "r": 1.0, "m": 0.0, "n": 1.0},
        {"t": 0.5},
    ),
    # ∫₀¹ [x < t]·∫₀¹[x < t] dx, differentiated before its outer integral was there
    "an open expression": (
        lambda: INT(teg.diff(B(x < t) * INT(B(x < t), (x, 0, 1)) * u, t), (x, 0, 1)),
        {"t": 0.3, "u": 1.0},
        {"u": 0.6},
    ),
    # max(y, t) as a bound of an integral with a step: t + (1-t)²/2 … by pieces
    "a maximum as a bound": (lambda: INT(B(x < c), (x, 0, teg.maximum(y, t)), (y, 0, 1)), {"c": 0.7, "t": 0.4}, {"t": 0.4, "c": 0.3}),
    # no real root: nothing moves
    "a quadratic without roots": (
        lambda: INT(B(x * x * a + x * t < r), (x, -1, 1)),
        {"r": 0.86, "a": -0.534, "t": 0.451},
        {"r": 0.0, "t": 0.0},
    ),
}


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", CASES)
def test_gradient(name: str, backend: str) -> None:
    build, at, expected = CASES[name]
    found = teg.compile(build(), backend=backend).grad(at)
    for k, v in expected.items():
        assert found[k] == pytest.approx(v, rel=1e-12, abs=1e-14), k


def test_second_derivatives_where_a_quadratic_has_no_roots() -> None:
    f = teg.compile(INT(B(x * x * a + x * t < r), (x, -1, 1)))
    for at in ({"r": 0.86, "a": -0.534, "t": 0.451}, {"r": -0.86, "a": 0.534, "t": 0.451}):
        assert all(v == 0.0 for v in f.hessian(at).values())


def test_a_parameter_only_pivot_ends() -> None:
    """Taking a common factor out of a sum did not end where the factor was a selection among pivots."""
    inside = B((-(0.5 * x + b * x) >= 0.28) & (-0.39 * y + 2 * x + 2 * a + t + 0.16 >= 0))
    f = teg.compile(INT(teg.exp(INT(teg.sin(inside), (x, 0, 1))), (y, 0, a)))
    assert all(math.isfinite(v) for v in f.hessian(a=0.4, b=-0.9, t=-0.3).values())


@pytest.mark.parametrize("sides", [12, 30, 40])
def test_many_half_planes(sides: int) -> None:
    """The area of a regular polygon: no break may be dropped, however many there are."""
    angle = 2 * np.pi * np.arange(sides) / sides
    body: teg.Expr = teg.ir.expr.const(1.0)
    for k in angle:
        body = body * B(float(np.cos(k)) * (x - 0.5) + float(np.sin(k)) * (y - 0.5) < t)
    f = teg.compile(INT(body, (x, 0, 1), (y, 0, 1)), backend="c")
    assert f(t=0.3) == pytest.approx(sides * 0.09 * math.tan(math.pi / sides), rel=1e-12)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_jumps_without_a_formula_are_found(backend: str) -> None:
    e = INT(B(x * teg.exp(-x) < t), (x, 0, 1))
    f = teg.compile(e, backend=backend)
    for w in (0.1, 0.25, 0.5, 0.9973, 0.0021):
        assert f(t=w * math.exp(-w)) == pytest.approx(w, abs=2e-13)
    steps = teg.compile(INT(teg.floor(x / t), (x, 0, 1)), backend=backend)
    assert steps(t=0.20808) == pytest.approx(sum(1 - k * 0.20808 for k in range(1, 5)), abs=1e-12)


def test_the_steps_of_floor_move() -> None:
    """Σₖ (1 - kt) over the steps k·t < 1; plain differentiation gives 0."""
    found = [teg.evaluate(teg.diff(INT(e, (x, 0, 1)), t), {t: 0.3}) for e in (teg.floor(x / t), teg.mod(x, t))]
    assert found == pytest.approx([-6.0, -1.2 + 1.8], rel=1e-13)


def test_bounds_that_are_no_number_are_refused() -> None:
    with pytest.raises(teg.errors.BoundError):
        INT(teg.exp(-x * x), (x, math.nan, 1))


def test_deltas_of_different_variables_multiply() -> None:
    e = INT(teg.delta(x - t) * teg.delta(y - x) * (x + y), (x, 0, 1), (y, 0, 1))
    assert teg.evaluate(e, {t: 0.3}) == pytest.approx(0.6, rel=1e-14)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("at", [0.00086, 0.1, 0.5, 0.9, 0.99])
def test_a_region_that_grazes_the_nodes(at: float, backend: str) -> None:
    """Two jumps between neighbouring nodes, in the inner integral and in the outer one."""
    sine = teg.compile(INT(B(y < teg.sin(3 * x) * t), (x, 0, 1), (y, 0, 1)), backend=backend, tol=1e-12)
    assert sine(t=at) == pytest.approx(at * (1 - math.cos(3)) / 3, abs=1e-13)
    cubic = teg.compile(INT(B(y < t * x * (1 - x) * (1 + x)), (x, 0, 1), (y, 0, 1)), backend=backend)
    assert cubic(t=at) == pytest.approx(at / 4, abs=1e-12)


@pytest.mark.parametrize("near", [1e-3, 1e-6, 1e-9])
def test_a_condition_that_holds_but_for_a_moment(near: float) -> None:
    """x·exp(-x) < t fails between two roots close to its maximum at 1: the turning point is watched."""
    f = teg.compile(INT(B(x * teg.exp(-x) < t), (x, 0, 3)), backend="c")
    width = 2 * math.sqrt(2 * near)  # of the gap, to first order: 1 ± √(2δ)
    assert 3 - f(t=math.exp(-1) * (1 - near)) == pytest.approx(width, rel=5 * math.sqrt(near) + 1e-5)


U = x - t


@pytest.mark.parametrize(
    ("condition", "body", "value"),
    [
        (1 - teg.cos(U) > 0, 1.0, 1.0),
        (teg.cosh(U) - 1 > 0, 1.0, 1.0),
        (teg.log(1 + U * U) > 0, 1.0, 1.0),
        (teg.exp(U) - 1 - U > 0, teg.exp(x), math.e - 1),
        (U - teg.sin(U) > 0, 1.0, 0.7),
    ],
)
@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
def test_a_condition_that_rounding_hides_where_it_touches_0(condition: teg.Cond, body: teg.Expr, value: float, backend: str) -> None:
    """1 - cos(x - t) is computed as 0 for |x - t| < 1e-8, which is not to be followed by bisection and integrated as if it were true."""
    found, estimate = teg.compile(INT(B(condition) * body, (x, 0, 1)), backend=backend).value_and_error(t=0.3)
    assert abs(found - value) <= max(1e-14, 2 * estimate)


def test_what_one_integral_needs_says_nothing_about_another() -> None:
    """A condition on parameters that skips the pieces of one loop was taken as known in the next one."""
    outside = teg.bracket(~(t - (0 * x + t * y) >= 0))
    f = teg.compile(teg.integral(teg.bracket(t - (x + y) >= 0) * (t * x + 1) * outside, (x, 0, 1), (y, 0, 1)))
    value, gradient = f.value_and_grad(t=0.0014)
    assert (value, gradient["t"]) == (0.0, 0.0)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_roots_keep_their_names_where_a_coefficient_changes_its_sign(backend: str) -> None:
    """The two roots of a conic in x swapped names at B(y) = 0, and conditions there were decided for the other one."""
    conic = a * x * x + 1.56 * x * y + 1.585 * y * y - 0.95 * x - 1.3 * y + t
    f = teg.compile(INT(B(conic > 0), (x, 0, 1), (y, 0, 1)), backend=backend)
    assert f.grad(a=0.93, t=0.09)["t"] == pytest.approx(1.1306242244601965, rel=1e-12)


def test_powers_of_negative_numbers_are_surfaces_too() -> None:
    f = teg.compile(INT(B(x**a > 0.5), (x, -2, 1)))
    assert f(a=2.0) == pytest.approx(3 - 2 * math.sqrt(0.5), rel=1e-9)


def test_conditions_that_only_decide_ties_are_not_watched() -> None:
    lens = (t * t > (x - 0.35) ** 2 + (y - 0.5) ** 2) & (t * t > (x - 0.65) ** 2 + (y - 0.5) ** 2)
    f = teg.compile(INT(B(lens) * teg.exp(x), (x, 0, 1), (y, 0, 1)), [t])
    assert f.evaluations(t=0.35, derivatives=1) < 1500


def test_endless_stairs() -> None:
    f = teg.compile(INT(B(teg.mod(x, 1.0) < 0.5) * teg.exp(-x * x), (x, -math.inf, math.inf)), backend="c", inaccurate="ignore")
    assert f() == pytest.approx(0.5 * math.sqrt(math.pi), rel=1e-13)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_bound_along_which_a_tie_would_belong_to_either_side(backend: str) -> None:
    """The side depends on y along x = t, which a segment cannot know before it is cut: the compiler failed."""
    inner = INT(B(a * x + y + x * y > 0.5), (x, t, 1), (y, 0, 1))
    for e, outer in ((inner, lambda v: 1.0), (teg.exp(inner), math.exp)):
        value, gradient = teg.compile(e, [t], backend=backend).value_and_grad(a=0.25, t=0.2)
        area = value if e is inner else math.log(value)
        assert gradient["t"] == pytest.approx(-(1 - (0.5 - 0.25 * 0.2) / 1.2) * outer(area), rel=1e-13)


def test_a_tie_names_every_bound_that_it_may_be() -> None:
    """Which variable is eliminated is decided at run time, so the bound is one of two: the other was named alone."""
    f = teg.compile(INT(B(a * x + t * y > 0.0), (x, 0, 1), (y, 0, 1)), [a, t])
    (found,) = f.diagnose(a=0.0, t=1.0)
    assert found.surfaces[1] == "the bound y = 0 or the bound x = 0"


def _second_derivatives(c: float, d: float) -> dict[tuple[str, str], float]:
    """Of ∫ min(X(d + y), c + 0.3y) - 0.25 dy over (0, 1), e^1.5X - X = d + y: beyond the y* where both are equal the bound is the smaller
    one, so the derivatives are 1 - y* and X(d + y*) - X(d)."""

    def reach(right: mpmath.mpf) -> mpmath.mpf:
        return mpmath.findroot(lambda u: mpmath.exp(1.5 * u) - u - right, 0.5)

    def rate(right: mpmath.mpf) -> mpmath.mpf:
        return 1 / (1.5 * mpmath.exp(1.5 * reach(right)) - 1)

    meeting = mpmath.findroot(lambda v: reach(d + v) - c - 0.3 * v, 0.5)
    steep, apart = rate(d + meeting), rate(d + meeting) - 0.3
    mixed = float(steep / apart)
    return {
        ("c", "c"): float(-1 / apart),
        ("c", "d"): mixed,
        ("d", "c"): mixed,
        ("d", "d"): float(steep * (1 - steep / apart) - rate(mpmath.mpf(d))),
    }


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_the_hessian_over_a_moving_bound_of_a_surface_that_only_isolation_knows(backend: str) -> None:
    """The surface is affine in y, but the bounds of x run through y: its δ is that of one variable, and moves again."""
    f = teg.compile(INT(B(teg.exp(1.5 * x) - x - y < d), (x, 0.25, c + 0.3 * y), (y, 0, 1)), [c, d], backend=backend)
    at = {"c": 0.405, "d": 1.25}
    found = f.hessian(at)
    for pair, value in _second_derivatives(**at).items():
        assert found[pair] == pytest.approx(value, rel=1e-10), pair


def test_a_floor_in_a_condition_has_no_slope() -> None:
    """By pieces: with u = d - x the condition holds for u in (0, c) and (1, 1 + c)."""
    f = teg.compile(INT(teg.exp(B(teg.mod(d - x, 1) < c) + x * B(x < a)), (x, -1, d)))
    e = math.exp
    exact = (e(-0.7) - e(-1)) + e(1) * (e(-0.3) - e(-0.7)) + (e(0.3) - e(-0.3)) + e(1) * 0.4
    assert f(a=0.3, c=0.4, d=0.7) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_bounds_from_infinity(backend: str) -> None:
    """∫ from ∞ to 0 is minus that from 0 to ∞, and so are its derivatives where a surface moves."""
    f = teg.compile(INT(B(x < t) * teg.exp(-x), (x, math.inf, 0)), backend=backend)
    assert f(0.5) == pytest.approx(-(1 - math.exp(-0.5)), rel=1e-12)
    assert f.grad(0.5)["t"] == pytest.approx(-math.exp(-0.5), rel=1e-12)
    g = teg.compile(INT(B(x > t) * teg.exp(-x * x), (x, 0, -math.inf)), backend=backend)
    assert g.grad(-0.5)["t"] == pytest.approx(math.exp(-0.25), rel=1e-12)
    h = teg.compile(INT(B(x * x < t) * teg.exp(-x * x / 2), (x, math.inf, -math.inf)), backend=backend)
    assert h(1.0) == pytest.approx(-math.sqrt(2 * math.pi) * math.erf(math.sqrt(0.5)), rel=1e-11)
    assert h.grad(1.0)["t"] == pytest.approx(-math.exp(-0.5), rel=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
def test_either_branch_of_a_where_around_sums(backend: str) -> None:
    """Σ V_i·[x < V_i] and a number, and its square, on either side of x = t; V = 0.2, 0.5, 0.9, t = 0.4, by hand."""
    array, k = teg.array("V", 1), teg.index("k")
    total = teg.sum(array[k] * B(x < array[k]), (k, 0, teg.length(array, 0)))
    squares = teg.sum(array[k] ** 2, (k, 0, teg.length(array, 0)))
    at = {"t": 0.4, "V": np.array([0.2, 0.5, 0.9])}
    exact = {
        "then": (INT(teg.where(x < t, total, x), (x, 0, 1)), 1.02, 1.0, [0.4, 0.4, 0.4]),
        "otherwise": (INT(teg.where(x < t, x, total), (x, 0, 1)), 0.58, -1.0, [0.0, 0.6, 1.4]),
        "both": (INT(teg.where(x < t, squares * x, total * total), (x, 0, 1)), 0.608, -1.52, [0.032, 1.51, 1.954]),
    }
    for name, (e, value, by_t, by_array) in exact.items():
        f = teg.compile(e, backend=backend)
        slopes = f.grad(at)
        assert f(at) == pytest.approx(value, rel=1e-12), name
        assert slopes["t"] == pytest.approx(by_t, rel=1e-12), name
        np.testing.assert_allclose(slopes["V"], by_array, rtol=1e-12, atol=1e-14, err_msg=name)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_root_beyond_those_that_have_a_formula(backend: str) -> None:
    """Of the 17 roots of sin(4.661·x) = t the last is 2e-3 from the end of the range: no node of a first look sees what is behind it."""
    count, rest = divmod(46.61, 2 * math.pi)
    gap = math.pi - 2 * math.asin(0.5)
    above = count * gap + min(max(rest - math.asin(0.5), 0.0), gap)
    f = teg.compile(INT(B(teg.sin(t * x) < a), (x, 0, 10)), backend=backend)
    assert f(t=4.661, a=0.5) == pytest.approx(10 - above / 4.661, rel=1e-11)


@pytest.mark.parametrize(("name", "backend"), [("sqrt", "numpy"), ("sqrt", "c"), ("power", "numpy"), ("log", "numpy")])
def test_a_root_beside_the_border_of_its_condition_is_no_nan(name: str, backend: str) -> None:
    """Between its breaks the argument is positive, but beside them rounding makes it negative, the more the farther away."""
    far, q = 64.0, 0.519
    square = r**2 - (x - far) ** 2 - (y - far) ** 2
    inside = (x - far) ** 2 + (y - far) ** 2 < r * r
    f, value, slope = {
        "sqrt": (teg.sqrt(square), 2 * math.pi * q**3 / 3, 2 * math.pi * q**2),
        "power": (square**1.5, 2 * math.pi * q**5 / 5, 2 * math.pi * q**4),
        "log": (teg.log(square), math.pi * q**2 * (2 * math.log(q) - 1), 4 * math.pi * q * math.log(q)),
    }[name]
    e = INT(teg.where(inside, f, 0), (x, far - 1, far + 1), (y, far - 1, far + 1))
    got, gradient = teg.compile(e, [r], backend=backend).value_and_grad(r=q)
    assert got == pytest.approx(value, rel=1e-9)
    assert gradient["r"] == pytest.approx(slope, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_region_that_is_born_at_a_bound(backend: str) -> None:
    """The root of an exact 0 is exact: the scale of its tie with a bound was 0/0, and the derivative 0 at upper bounds."""
    for low, high in ((-1, 0), (0, 1), (0, -1), (1, 0)):
        f = teg.compile(INT(B(b - x**2 > 0), (x, low, high)), backend=backend)
        assert f.grad(b=0.0)["b"] == (math.inf if low < high else -math.inf)
    for low, high in ((-1, a), (a, 1)):
        f = teg.compile(INT(B(b - (x - a) ** 2 > 0), (x, low, high)), [a, b], backend=backend)
        with pytest.warns(teg.AccuracyWarning):
            slopes = f.grad(a=0.3, b=0.0)
        assert slopes["b"] == math.inf
        assert math.isnan(slopes["a"])


@pytest.mark.parametrize("closed_forms", [True, False])
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("place", "part"), [((0.3, 0.1), 1 / 4), ((-0.7, 1.3), 1 / 4), ((-0.2, 0.1), 1 / 2), ((0.1, 0.6), 1.0)])
def test_a_disk_that_is_born_on_the_border_of_its_box(place: tuple[float, float], part: float, backend: str, closed_forms: bool) -> None:
    """A circle of radius 0 had no directions: of one around a corner all was taken, or nothing."""
    e = INT(B((x - a) ** 2 + (y - b) ** 2 < t) * (1 + x), (x, -0.7, 0.3), (y, 0.1, 1.3))
    f = teg.compile(e, [t], backend=backend, intrinsics=closed_forms)
    mean = 0.5 * math.pi * part * (1 + place[0])
    assert f.grad(t=0.0, a=place[0], b=place[1])["t"] == pytest.approx(mean, rel=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_broken_power_at_its_branch_point(backend: str) -> None:
    """The area below t is t^(2/3), without a derivative at 0 from above: this was 0, as it is from below."""
    assert teg.compile(INT(B(x**1.5 < t), (x, 0, 1)), backend=backend).grad(t=0.0)["t"] == math.inf
    assert teg.compile(INT(B((x - 0.5) ** 2.25 < t), (x, 0.5, 1)), backend=backend).grad(t=0.0)["t"] == math.inf
    assert teg.compile(INT(B(x**0.75 < t), (x, 0, 1)), backend=backend).grad(t=0.0)["t"] == 0.0
    f = teg.compile(INT(B(x**1.5 < t), (x, 0, 1)), backend=backend)
    assert f.grad(t=-1.0)["t"] == 0.0
    assert f.grad(t=0.5)["t"] == pytest.approx(2 / 3 * 0.5 ** (-1 / 3), rel=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("g", "low", "expected"),
    [
        # the roots are those of x² + 0.1·x - 0.4, where the slope is 1 + 0.4/x²
        (x - 0.4 / x + 0.1, 0, 1 / (1 + 0.4 / 0.5844288770224759**2)),
        (x - 0.4 / x + 0.1, -1, 1.0),
        (x**-2 - 4, -1, 2 / 16),
        (teg.tan(2 * x) - 1, -1, 1 / 4),
    ],
)
def test_poles_are_no_roots_and_hide_none(g: teg.Expr, low: float, expected: float, backend: str) -> None:
    """Between the ends of a range with a pole g was taken for monotone, or convex: its roots were lost."""
    assert teg.evaluate(INT(teg.delta(g), (x, low, 1)), backend=backend) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_corner_of_a_minimum(backend: str) -> None:
    """[min(p, q) < 0] is [p < 0 or q < 0]; on q = 0 the border of the minimum is p = t/x - 2·x + a = 0, with a pole at 0."""
    p, q = x - 2 * y + a, x * y - t
    at = {"t": 0.2, "a": 0.1}
    box = ((x, -1, 1), (y, -1, 1))
    minimum, either = (teg.compile(INT(B(c), *box), [t, a], backend=backend) for c in (teg.minimum(p, q) < 0, (p < 0) | (q < 0)))
    found, expected = minimum.hessian(at), either.hessian(at)
    for key in expected:
        assert found[key] == pytest.approx(expected[key], rel=1e-9), key
    h = 1e-4
    slope = (either.grad(t=0.2, a=0.1 + h)["t"] - either.grad(t=0.2, a=0.1 - h)["t"]) / (2 * h)
    assert [found["t", "a"], found["a", "t"]] == pytest.approx([slope, slope], rel=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_band_between_level_sets_of_one_function(backend: str) -> None:
    """{a < x·y < t} has the area F(t) - F(a) with F(u) = u - u·log u. The two curves do not meet: this was a DeltaError."""
    for u in (x * y, teg.sqrt(x) * teg.sqrt(y)):
        f = teg.compile(INT(B((u < t) & (u > a)), (x, 0, 1), (y, 0, 1)), [t, a], backend=backend)
        second = f.hessian(t=0.5, a=0.3)
        assert second["t", "a"] == second["a", "t"] == 0.0
        if u is x * y:
            assert [second["t", "t"], second["a", "a"]] == pytest.approx([-1 / 0.5, 1 / 0.3], rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("condition", "density", "at", "slopes"),
    [
        # a slice at z is a disk of area π·(t² - z²)
        (x * x + y * y + z * z < t * t, teg.exp(a * z), {"t": 0.6, "a": 1.5}, {"t": 4 * math.pi * 0.6 * math.sinh(0.9) / 1.5}),
        (x * x + y * y + z * z < t * t, teg.exp(a * z), {"t": 0.6, "a": 40.0}, {"t": 4 * math.pi * 0.6 * math.sinh(24.0) / 40.0}),
        # one of area π·t·(1.5 + z), and ∫ (1.5 + z)·tanh(a·z) dz over (-1, 1)
        (
            x * x + y * y < t * (1.5 + z),
            teg.tanh(a * z),
            {"t": 0.3, "a": 20.0},
            {"t": math.pi * (1.0 - math.pi**2 / (12 * 400.0))},
        ),
        # one of area 4·t²·z·(1 - log(t²·z)) under a hyperbola in each quarter, z in (0.5, 1)
        (
            teg.abs(x * y) < t * t * z,
            teg.exp(a * z) * B(z > 0.5),
            {"t": 0.6, "a": 1.5},
            {"t": float(mpmath.quad(lambda v: -8 * 0.6 * v * mpmath.log(0.36 * v) * mpmath.exp(1.5 * v), [0.5, 1]))},
        ),
    ],
    ids=["ball", "ball, narrow", "cone", "hyperbola"],
)
def test_slices_with_closed_forms_and_a_density_that_may_be_sharp(
    condition: teg.Cond, density: teg.Expr, at: dict[str, float], slopes: dict[str, float], backend: str
) -> None:
    """The guard of the outer integral met a closed form, of which no enclosure is known: an AssertionError."""
    f = teg.compile(INT(B(condition) * density, (x, -1, 1), (y, -1, 1), (z, -1, 1)), [t, a], backend=backend)
    found = f.grad(at)
    for name, slope in slopes.items():
        assert found[name] == pytest.approx(slope, rel=1e-9)
