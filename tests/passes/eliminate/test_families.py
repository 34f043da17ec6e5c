"""Elimination of δ: which family takes a surface, what comes out, and what is refused."""

from __future__ import annotations

import math

import mpmath
import pytest

import teg
from teg import errors
from teg.passes.eliminate.affine import Affine, match_affine, match_partly_affine, match_turning
from teg.passes.eliminate.families import eliminate_deltas, find_family
from teg.program import SumOver, statements

x, y, z = teg.vars("x y z")
t, a, b, c = teg.params("t a b c")


def delta_integral(g: teg.Expr, w: teg.Expr | float = 1.0, *domain: tuple[teg.Expr, object, object]) -> teg.Expr:
    return teg.integral(teg.delta(g) * w, *(domain or ((x, 0, 1),)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("g", "variables"),
    [
        (t - x, (x,)),
        (a * x + b * y - c, (y, x)),
        (x + y + z - t, (z, y, x)),
        (x + y**2 - t, (x,)),
        (teg.sin(t) * x + teg.exp(a) * y, (y, x)),
        (x / a - y / b, (y, x)),
    ],
    ids=lambda v: str(v),
)
def test_affine_surfaces(g: teg.Expr, variables: tuple[teg.Expr, ...]) -> None:
    assert match_affine(g, [v for v in (x, y, z) if v in g.free]) == Affine(variables)  # type: ignore[arg-type]


@pytest.mark.parametrize("g", [teg.sin(x) - t, x**2 - t, 1 / x - t, t - a], ids=str)
def test_no_affine_surface(g: teg.Expr) -> None:
    assert match_affine(g, [x]) is None


def test_a_coefficient_that_may_vanish_is_left_to_other_families() -> None:
    assert match_affine(x * y - t, [x, y]) is None
    assert match_partly_affine(x * y - t, [x, y]) == Affine((x,))
    assert match_affine(a * x + y**2 - t, [x, y]) is None


@pytest.mark.parametrize("offset", [0.0, 1.0, -1.0])
def test_a_line_without_a_direction_is_nowhere(offset: float) -> None:
    f = teg.compile(teg.integral(teg.bracket(a * x + b * y < t) * teg.exp(x * y), (x, 0, 1), (y, 0, 1)), [t, a, b], backend="numpy")
    assert set(f.grad(a=0.0, b=0.0, t=offset).values()) == {0.0}


@pytest.mark.parametrize(
    ("e", "at", "expected"),
    [
        (delta_integral(t - x), {"t": 0.4}, 1.0),
        (delta_integral(t - x), {"t": 1.4}, 0.0),
        (delta_integral(2 * x - t, teg.exp(x)), {"t": 0.5}, math.exp(0.25) / 2),
        (delta_integral(t - x, 1.0, (x, 1, 0)), {"t": 0.4}, -1.0),
        (delta_integral(x**2 - t, x + 2, (x, -1, 1)), {"t": 0.25}, 4.0),
        (delta_integral(x**2 - t, 1.0, (x, -1, 1)), {"t": -0.25}, 0.0),
        (delta_integral(x + y - t, 1.0, (x, 0, 1), (y, 0, 1)), {"t": 0.6}, 0.6),
        (delta_integral(x + y - t, 1.0, (x, 0, 1), (y, 0, 1)), {"t": 1.5}, 0.5),
        (delta_integral(a * x + b * y - t, 1.0, (x, 0, 1), (y, 0, 1)), {"a": 0.0, "b": 2.0, "t": 0.6}, 0.5),
        (delta_integral(a * x + b * y - t, 1.0, (x, 0, 1), (y, 0, 1)), {"a": 0.0, "b": 0.0, "t": 0.6}, 0.0),
        (delta_integral(x + y + z - t, 1.0, (x, 0, 1), (y, 0, 1), (z, 0, 1)), {"t": 0.6}, 0.18),
        (delta_integral(x - t, y, (y, 0, x), (x, 0, 1)), {"t": 0.6}, 0.18),
        (delta_integral(y - t, x, (x, 0, y), (y, 0, 1)), {"t": 0.6}, 0.18),
        (delta_integral(x + y - t, 1.0, (x, 0, y), (y, 0, 1)), {"t": 0.6}, 0.3),
        (teg.integral(teg.delta(x - t) * teg.delta(y - a) * x * y, (x, 0, 1), (y, 0, 1)), {"t": 0.5, "a": 0.25}, 0.125),
        (teg.integral(teg.delta(x - t) * x * teg.integral(teg.delta(y - a) * y, (y, 0, 1)), (x, 0, 1)), {"t": 0.5, "a": 0.25}, 0.125),
    ],
)  # fmt: skip
def test_values(e: teg.Expr, at: dict[str, float], expected: float) -> None:
    eliminated = teg.eliminate(e)
    assert not eliminated.has_delta
    assert teg.evaluate(eliminated, at) == pytest.approx(expected, rel=1e-13, abs=1e-15)
    assert teg.evaluate(e, at) == pytest.approx(expected, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("e", [delta_integral(t - x, teg.exp(x)), delta_integral(a * x + b * y - t, x, (x, 0, 1), (y, 0, 1))], ids=str)
def test_twice_is_once(e: teg.Expr) -> None:
    once = eliminate_deltas(e)
    assert eliminate_deltas(once) is once


def test_the_weight_is_not_looked_at_outside() -> None:
    e = delta_integral(t - x, 1 / (x - 2))
    assert teg.evaluate(e, {"t": 2.0}) == 0.0


@pytest.mark.parametrize(
    "g",
    [
        teg.sin(3 * x) - t,
        x**3 - t * x - a,
        teg.exp(x) - t,
        x**2 + y**2 - t,
        teg.sin(x) + teg.cos(y) - t,
        x**5 + x * y - t,
        teg.sin(x * y) - t,
    ],
    ids=str,
)
def test_every_smooth_surface_has_a_family(g: teg.Expr) -> None:
    e = teg.integral(teg.bracket(g < 0) * teg.exp(x), (x, -1, 1), (y, -1, 1))
    f = teg.compile(e)
    at = dict.fromkeys(f.parameters, 0.6)
    assert f(at) != 0.0
    assert find_family(g, [v for v in (x, y) if v in g.free]) is not None
    assert teg.check_gradient(f, at)


def test_a_surface_that_holds_an_integral_over_its_variable_is_refused() -> None:
    z = teg.var("z")
    e = teg.integral(teg.bracket(teg.integral(teg.exp(-x * z * z), (z, 0, 1)) < t), (x, 0, 1))
    with pytest.raises(errors.NoReparameterisationError) as caught:
        teg.eliminate(teg.diff(e, t))
    assert isinstance(caught.value.where, teg.Expr)
    assert caught.value.hint


def test_deltas_out_of_place() -> None:
    for e in (
        teg.delta(t - a),
        teg.integral(teg.delta(t - a) * x, (x, 0, 1)),
        teg.integral(teg.delta(x - t) * teg.delta(x - t), (x, 0, 1)),
        teg.integral(teg.delta(x - t) * teg.delta(2 * x - a), (x, 0, 1)),
    ):
        with pytest.raises(errors.DeltaError):
            eliminate_deltas(e)


def test_products_of_numbers_far_apart() -> None:
    for coefficients in ((1e12, 1.0), (1.0, 1e-12), (1e-8, 1e8), (0.0, 1.0), (1.0, 0.0)):
        e = teg.integral(teg.bracket(a * x + b * y < t), (x, 0, 1), (y, 0, 1))
        f = teg.compile(e, [a, b, t])
        p, q = coefficients
        at = {"a": p, "b": q, "t": 0.4 * max(p, q)}
        small, large = min(coefficients), max(coefficients)
        assert f(at) == pytest.approx(0.4 - small / (2 * large), rel=1e-14)
        assert f.grad(at)["t"] == pytest.approx(1 / large, rel=1e-13)


def _square_below_a_line(distance: mpmath.mpf, angle: mpmath.mpf) -> mpmath.mpf:
    """The area of the part of (-½, ½)² in which x·cos + y·sin < distance, by inclusion and exclusion of its corners."""
    a, b = abs(mpmath.cos(angle)), abs(mpmath.sin(angle))
    signed = ((0, 0, 1), (1, 0, -1), (0, 1, -1), (1, 1, 1))
    return sum(s * max(distance + (a + b) / 2 - i * a - j * b, 0) ** 2 for i, j, s in signed) / (2 * a * b)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_line_that_turns_with_time(backend: str) -> None:
    """Its gradient has the same length at any time: it is eliminated in closed form at each, and time is integrated outside."""
    tm = teg.var("tm")
    t, w = teg.params("t w")
    e = teg.integral(teg.bracket((x - 0.5) * teg.cos(w * tm) + (y - 0.5) * teg.sin(w * tm) < t), (x, 0, 1), (y, 0, 1), (tm, 0, 1))
    f = teg.compile(e, [t, w], backend=backend)
    value, slopes = f.value_and_grad(t=0.1, w=1.0)
    # the closed form, and its derivatives, integrated over time with mpmath in 20 digits
    assert value == pytest.approx(0.61486889079326526492, rel=1e-12)
    assert slopes["t"] == pytest.approx(1.12964060879610, rel=1e-11)
    with mpmath.workdps(25):
        ends = [mpmath.mpf(10) ** -16, 1]  # at 0 the closed form is 0/0
        passed = [mpmath.findroot(lambda u, s=s: s * (mpmath.cos(u) - mpmath.sin(u)) / 2 - 0.1, 0.8 - s * 0.2) for s in (1, -1)]
        total = mpmath.quad(lambda u: _square_below_a_line(mpmath.mpf(0.1), u), [ends[0], *passed, ends[1]])
        # w ∂/∂w ∫₀¹ A(w·u) du at w = 1 is A(1) - ∫₀¹ A
        by_w = _square_below_a_line(mpmath.mpf(0.1), mpmath.mpf(1)) - total
    assert value == pytest.approx(float(total), rel=1e-12)
    assert slopes["w"] == pytest.approx(float(by_w), rel=1e-9)
    assert f.evaluations(t=0.1, w=1.0, derivatives=1) < 4000
    assert not any(isinstance(s, SumOver) for s in statements(f.program(1).body))


def test_only_lines_whose_gradient_keeps_its_length_are_eliminated_at_each_time() -> None:
    tm = teg.var("tm")
    t, w = teg.params("t w")
    order = [x, y, tm]
    turning = x * teg.cos(w * tm) + (y - t) * teg.sin(w * tm) - t
    assert match_turning(turning, order) == Affine((y, x))
    edge = (x - tm) * (t * teg.sin(tm) + w * teg.cos(tm)) + y * (t * teg.cos(tm) - w * teg.sin(tm))
    assert match_turning(edge, order) == Affine((y, x))
    for g in (x * tm + y * tm * tm - t, x * teg.cos(tm) + 2 * y * teg.sin(tm) - t, x * x + y * teg.sin(tm), x * teg.sin(tm) + tm):
        assert match_turning(g, order) is None
    assert match_turning(turning, [x, tm, y]) is None


@pytest.mark.parametrize(("order", "rate"), [((x, y, z), 0.3), ((y, x, z), 3.0)], ids=str)
def test_a_pivot_that_changes_with_another_variable_beside_a_bound_that_moves(order: tuple[teg.Expr, ...], rate: float) -> None:
    """The volume of {a·x·y < z} over (b, 1) × (0, 1)²: over y and z it is h(a·x), with h(c) = 1 - c/2 up to c = 1 and 1/(2·c) beyond."""
    domains = {x: (x, b, 1), y: (y, 0, 1), z: (z, 0, 1)}
    f = teg.compile(teg.integral(teg.bracket(a * (x * y) < z), *[domains[v] for v in order]), [a, b])
    value, slopes = f.value_and_grad(a=rate, b=0.2)

    def volume(c: mpmath.mpf) -> mpmath.mpf:
        return mpmath.quad(lambda u: 1 - c * u / 2 if c * u < 1 else 1 / (2 * c * u), [0.2, max(0.2, min(1, 1 / c)), 1])

    assert value == pytest.approx(float(volume(mpmath.mpf(rate))), rel=1e-13)
    assert slopes["a"] == pytest.approx(float(mpmath.diff(volume, rate)), rel=1e-9)
    assert slopes["b"] == pytest.approx(-(1 - rate * 0.1), rel=1e-13)


@pytest.mark.parametrize("intrinsics", [True, False])
@pytest.mark.parametrize("level", [0.6, 0.0])
def test_a_factor_that_is_no_number_where_its_condition_fails(level: float, intrinsics: bool) -> None:
    """1/√b stands in front of the boundary integral, which for level 0 is that of the two axes and diverges."""
    inside = x * y < teg.sqrt(teg.maximum(b, 0)) + c
    f = teg.compile(teg.integral(teg.bracket(inside), (x, -1, 1), (y, -1, 2)), [b], intrinsics=intrinsics)
    assert f.grad(b=-0.4, c=level)["b"] == 0
    if level:  # the derivative by the level 1.1, which is 1 times that by b, is ∫ dx/x from 0.55 to 1
        assert f.grad(b=0.25, c=level)["b"] == pytest.approx(-math.log(0.55), rel=1e-12)
