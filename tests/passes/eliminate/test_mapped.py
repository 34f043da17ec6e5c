"""Changes of variables: of whole integrals, and of the deltas of a derivative."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import teg
from teg import Expr, maps
from teg.errors import BoundError, DiffeomorphismError, OperandError, ScopeError
from teg.examples.custom_map import compare
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.eliminate.families import FAMILIES, families_with, find_family
from teg.passes.eliminate.mapped import Mapped

x, y, z, r, p, q, u, v, w = teg.vars("x y z r p q u v w")
a, b, c, h, k, t = teg.params("a b c h k t")
TURN = (-math.pi, math.pi)
SQUARE = ((x, -1, 1), (y, -1, 1))


def polar(**options: object) -> Diffeomorphism:
    return Diffeomorphism(
        {x: r * teg.cos(p), y: r * teg.sin(p)},
        inverse={r: teg.sqrt(x**2 + y**2), p: teg.atan2(y, x)},
        domain={r: (0, None), p: TURN},
        **options,  # type: ignore[arg-type]
    )


def same(
    e: Expr, changed: Expr, at: dict[str, float], backend: str = "numpy", orders: int = 1, tolerance: float = 1e-10, **options: object
) -> None:
    """Value and derivatives are the same; parameters of the map alone have derivative 0."""
    f = teg.compile(e, backend=backend)
    g = teg.compile(changed, backend=backend, **options)  # type: ignore[arg-type]
    mine, theirs = ({name: at[name] for name in each.parameters} for each in (f, g))
    value, gradient = f.value_and_grad(mine)
    other, other_gradient = g.value_and_grad(theirs)
    assert other == pytest.approx(value, rel=tolerance, abs=tolerance)
    for name, derivative in other_gradient.items():
        assert derivative == pytest.approx(gradient.get(name, 0.0), rel=tolerance, abs=tolerance), name
    if orders == 2:
        first, second = f.hessian(mine), g.hessian(theirs)
        for pair, derivative in second.items():
            assert derivative == pytest.approx(first.get(pair, 0.0), rel=100 * tolerance, abs=100 * tolerance), pair


# -- images of bounds ----------------------------------------------------------------------------------------------------


def test_boxes_that_go_to_boxes_and_nests() -> None:
    unit = ((x, 0, 1), (y, 0, 1))
    assert teg.change_variables(teg.integral(teg.bracket(x < t), (x, 0, 1)), maps.scaling(x, u, 2)) is teg.integral(
        teg.bracket(2 * u < t) * 2, (u, 0, 0.5)
    )
    backwards = teg.change_variables(teg.integral(teg.exp(x), (x, 0, 1)), maps.scaling(x, u, -2))
    assert backwards is teg.integral(teg.exp(-2 * u) * 2, (u, -0.5, 0))
    sheared = teg.change_variables(teg.integral(x * y, *unit), maps.shear(x, y, u, v, 3))
    assert str(sheared) == "∫[v: 0..1] (∫[u: -3·v..-3·v + 1] (u + 3·v)·v)"
    assert "[" not in str(sheared).replace("∫[", "")  # no brackets
    other_order = teg.change_variables(teg.integral(x * y, *unit[::-1]), maps.shear(x, y, u, v, 3))
    assert other_order is sheared


def test_the_sign_of_a_parameter_is_left_open() -> None:
    e = teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, h))
    changed = teg.change_variables(e, maps.scaling(x, u, k))
    assert str(changed) == "∫[u: 0..h/k] [k·u < t]·k·exp(k·u)"
    for value in (0.4, -0.4):
        same(e, changed, {"t": 0.3, "h": 0.9, "k": value}, orders=2)


def test_other_boxes_become_brackets_in_an_enclosure() -> None:
    changed = teg.change_variables(teg.integral(1, *SQUARE), polar())
    assert isinstance(changed, teg.integral(x, (x, 0, 1)).__class__)
    assert "r·cos(p) < 1" in str(changed)
    assert teg.evaluate(changed) == pytest.approx(4.0, rel=1e-13)
    quarter = teg.change_variables(teg.integral(1, (x, 0.1, 1), (y, 0.1, 1)), polar())
    assert 0.0 < float(quarter.lo) < 0.1  # type: ignore[attr-defined]  # the angles of the box alone
    assert teg.evaluate(quarter) == pytest.approx(0.81, rel=1e-13)


def test_a_disk_by_its_bounds_remains_one_surface() -> None:
    side = teg.sqrt(t - y**2)
    disk = teg.integral(1, (x, -side, side), (y, -teg.sqrt(t), teg.sqrt(t)))
    changed = teg.change_variables(disk, polar(bounds={r: (0, 2)}))
    assert "r² < t" in str(changed) or "t - r² > 0" in str(changed)
    value, gradient = teg.compile(changed, maps=[polar()]).value_and_grad(t=0.5)
    assert value == pytest.approx(math.pi / 2, rel=1e-12)
    assert gradient["t"] == pytest.approx(math.pi, rel=1e-12)


def test_given_bounds_may_be_the_image_itself() -> None:
    side = teg.sqrt(1 - y**2)
    disk = teg.integral(1, (x, -side, side), (y, -1, 1))
    changed = teg.change_variables(disk, polar(), bounds={r: (0, 1), p: TURN}, exact=True)
    assert changed is teg.integral(r, (r, 0, 1), (p, *TURN))
    for wrong in ({r: (0, 1.1), p: TURN}, {r: (0, 0.9), p: TURN}, {r: (0, 1), p: (-3, 3)}):
        with pytest.raises(DiffeomorphismError) as caught:
            teg.change_variables(disk, polar(), bounds=wrong, exact=True)
        assert caught.value.point is not None
    with pytest.raises(BoundError):
        teg.change_variables(disk, polar(), bounds={r: (0, 1)}, exact=True)


def test_bounds_that_cannot_be_derived_are_asked_for() -> None:
    away = polar() @ maps.exponential(r, u)  # the logarithm of the radius: -∞ at the centre
    e = teg.integral(teg.bracket(x * x + y * y < t), *SQUARE)
    with pytest.raises(BoundError) as caught:
        teg.change_variables(e, away)
    assert "bounds=" in caught.value.hint
    changed = teg.change_variables(e, away, bounds={u: (-20, 1), p: TURN})
    assert teg.evaluate(changed, {t: 0.5}) == pytest.approx(math.pi / 2, rel=1e-9)
    with pytest.raises(BoundError):
        teg.change_variables(teg.integral(x, (x, 0, 1)), maps.exponential(x, u))
    assert teg.evaluate(teg.change_variables(teg.integral(x, (x, 0, 1)), maps.exponential(x, u), bounds={u: (-40, 0.5)})) == pytest.approx(
        0.5, rel=1e-12
    )


def test_nests_are_found_in_sums_products_and_conditions() -> None:
    inner = teg.integral(teg.bracket(x < y * t) * x, (x, 0, 1))
    m = maps.rotation(x, y, u, v, 0.3)
    e = teg.integral(teg.where(y < 0.7, 3 * y * inner + y**2, inner), (y, 0, 1)) + teg.integral(z, (z, 0, 1)) * 2
    same(e, teg.change_variables(e, m), {"t": 0.8})
    between = teg.integral(teg.bracket(x + y * z < t) * x, (x, 0, 1), (z, 0, y), (y, 0, 1))
    same(between, teg.change_variables(between, m), {"t": 0.8}, tolerance=1e-9)
    both = teg.tuple(between, teg.integral(1, (x, 0, 1), (y, 0, 1)))
    assert teg.evaluate(teg.change_variables(both, m), {t: 0.8})[1] == pytest.approx(1.0, rel=1e-13)


def test_names_that_are_taken_get_a_prime() -> None:
    e = teg.integral(teg.integral(teg.bracket(x < t * r) * r, (x, 0, 1)) * teg.param("u"), (r, 0, 1))
    changed = teg.change_variables(e, maps.scaling(x, r, 2) @ maps.scaling(r, u, 3))
    assert "u′" in str(changed)
    assert teg.evaluate(changed, {"t": 0.5, "u": 3.0}) == pytest.approx(teg.evaluate(e, {"t": 0.5, "u": 3.0}), rel=1e-13)
    same(e, teg.change_variables(e, maps.translation(x, r, 2)), {"t": 0.5, "u": 3.0})


def test_what_cannot_be_changed() -> None:
    with pytest.raises(ScopeError):
        teg.change_variables(teg.integral(x, (x, 0, 1)), polar())
    with pytest.raises(ScopeError):
        teg.change_variables(teg.integral(teg.exp(teg.integral(x, (x, 0, y))), (y, 0, 1)), polar())
    with pytest.raises(OperandError):
        teg.change_variables(teg.integral(x, (x, 0, 1)), 3)  # type: ignore[arg-type]


# -- values and derivatives are the same -----------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("radius", [0.5, 1.3])
def test_a_disk_in_polar_coordinates(backend: str, radius: float) -> None:
    """Inside the square, and cut by it."""
    e = teg.integral(teg.bracket(x * x + y * y < t) * teg.exp(x), *SQUARE)
    same(e, teg.change_variables(e, polar()), {"t": radius}, backend, orders=2)


@pytest.mark.slow
def test_a_moving_centre() -> None:
    """The centre of the coordinates is a parameter: its derivative is what it is without the map."""
    m = teg.polar(x, y, r, p, centre=(a, b))
    e = teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 < t) * teg.exp(x), (x, -1, 1), (y, -1, h))
    changed = teg.change_variables(e, m)
    at = {"a": 0.7, "b": 0.5, "t": 0.6, "h": 0.9}
    same(e, changed, at, orders=2, maps=[m])
    same(e, e, at, orders=2, maps=[m])


def test_the_centre_alone_has_no_derivative() -> None:
    m = teg.polar(x, y, r, p, centre=(a, 0.1))
    e = teg.integral(teg.bracket(x + k * y < t) * teg.exp(x * y), (x, 0, 1), (y, -1, 1))
    same(e, teg.change_variables(e, m), {"a": 0.2, "k": 0.5, "t": 0.4}, maps=[m])


@pytest.mark.parametrize("angle", [0.3, 0.0, math.atan(0.7)])
def test_an_angle_of_rotation(angle: float) -> None:
    """Also where the box lies along the axes, and where the line does."""
    e = teg.integral(teg.bracket(x + k * y < t) * teg.exp(x * y), (x, 0.2, h), (y, -0.3, 1))
    changed = teg.change_variables(e, maps.rotation(x, y, u, v, a))
    same(e, changed, {"a": angle, "k": 0.7, "t": 0.5, "h": 0.9})


@pytest.mark.slow
def test_second_derivatives_under_rotation() -> None:
    m = maps.rotation(x, y, u, v, a) @ maps.scaling((u, v), (r, p), (2, b))
    e = teg.integral(teg.bracket(x + k * y < t) * teg.exp(x), (x, 0.2, 0.9), (y, -0.3, 1))
    same(e, teg.change_variables(e, m), {"a": 0.3, "b": 1.5, "k": 0.7, "t": 0.5}, orders=2, maps=[m])


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_smoothstep(backend: str) -> None:
    e = teg.integral(teg.bracket(x * x < t) * teg.sqrt(x) * teg.sqrt(h - x), (x, 0, h))
    at = {"t": 0.3, "h": 0.9}
    same(e, teg.change_variables(e, maps.smoothstep(x, u, (0, h))), at, backend, tolerance=1e-7)
    smooth = teg.integral(teg.bracket(x * x < t) * teg.exp(x), (x, 0.1, h))
    same(smooth, teg.change_variables(smooth, maps.smoothstep(x, u)), at, backend, orders=2)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_ball_in_spherical_coordinates(backend: str) -> None:
    m = maps.spherical(x, y, z, r, q, p)
    e = teg.integral(teg.bracket(x * x + y * y + z * z < t) * (1 + x), (x, -1, 1), (y, -1, 1), (z, -1, 1))
    whole = {r: (0, 1), q: (0, math.pi), p: TURN}
    changed = teg.change_variables(
        e, Diffeomorphism(m.forward, m.inverse, {r: (0, None), q: (0, math.pi), p: TURN}, check_at={t: 0.6}), bounds=whole, exact=True
    )
    f = teg.compile(changed, backend=backend)
    value, gradient = f.value_and_grad(t=0.49)
    assert value == pytest.approx(4 / 3 * math.pi * 0.343, rel=1e-12)
    assert gradient["t"] == pytest.approx(2 * math.pi * 0.7, rel=1e-12)
    assert f.hessian(t=0.49)["t", "t"] == pytest.approx(math.pi / 0.7, rel=1e-12)
    sifted = teg.compile(e, backend=backend, maps=[m], tol=1e-8)
    assert sifted.grad(t=0.49)["t"] == pytest.approx(2 * math.pi * 0.7, rel=1e-8)


# -- deltas --------------------------------------------------------------------------------------------------------------


def test_the_family_of_a_map() -> None:
    m = polar()
    data, _ = find_family(t - x**2 - y**2, [x, y], families_with([m]))  # type: ignore[misc]
    assert isinstance(data, Mapped)
    assert data.variables == (y, x)
    assert data.inner.variables == (r,)
    assert not data.moves
    line, _ = find_family(t - x - y, [x, y], families_with([m]))  # type: ignore[misc]
    assert not isinstance(line, Mapped)
    back, _ = find_family(t - r * teg.cos(p), [r, p], families_with([m]))  # type: ignore[misc]
    assert isinstance(back, Mapped)
    assert back.inner.variables == (x,)
    assert find_family(t - x**2, [x], families_with([m]))[0].variables == (x,)  # type: ignore[index]
    assert families_with([]) is FAMILIES


def test_a_delta_on_a_circle() -> None:
    e = teg.integral(teg.delta(t - x**2 - y**2), *SQUARE)
    sifted = teg.eliminate(e, maps=[polar()])
    assert not sifted.has_delta
    assert "∫[p: " in str(sifted)
    assert teg.evaluate(sifted, {t: 0.5}) == pytest.approx(math.pi, rel=1e-13)
    assert teg.evaluate(e, {t: 0.5}, maps=[polar()]) == pytest.approx(math.pi, rel=1e-13)
    derivative = teg.diff(teg.integral(teg.bracket(x**2 + y**2 < t), *SQUARE), t)
    assert teg.evaluate(teg.change_variables(derivative, polar()), {t: 0.5}) == pytest.approx(math.pi, rel=1e-13)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_surface_that_has_a_formula_in_the_map_only(backend: str) -> None:
    """A flower with five petals: its area is πt²(1 + a²/2)."""
    radius = t * (1 + a * teg.cos(5 * teg.atan2(y, x)))
    e = teg.integral(teg.bracket(teg.sqrt(x**2 + y**2) < radius), *SQUARE)
    f = teg.compile(teg.change_variables(e, polar(check_at={t: 0.5, a: 0.3}), bounds={r: (0, 0.9), p: TURN}, exact=True), backend=backend)
    value, gradient = f.value_and_grad(t=0.5, a=0.3)
    assert value == pytest.approx(math.pi * 0.25 * 1.045, rel=1e-11)
    assert gradient["t"] == pytest.approx(math.pi * 1.045, rel=1e-11)
    assert gradient["a"] == pytest.approx(math.pi * 0.25 * 0.3, rel=1e-10)
    sifted = teg.compile(teg.grad(e, [t, a], maps=[polar()]), maps=[polar()], backend=backend)
    assert sifted(t=0.5, a=0.3) == pytest.approx((math.pi * 1.045, math.pi * 0.25 * 0.3), rel=1e-10)


def test_explain_tells_of_the_map() -> None:
    e = teg.integral(teg.bracket(x**2 + y**2 < t), *SQUARE)
    f = teg.compile(e, maps=[polar()])
    for report in (f.explain(), teg.explain(e, maps=[polar()])):
        (surface,) = report.data["surfaces"]
        assert "mapped to r, p" in surface["treatment"]


def test_moved_bounds_are_moved_in_the_old_variables() -> None:
    """The bound x = h is the curve r·cos p = h in polar coordinates; the map brings it back."""
    e = teg.integral(teg.exp(x * y), (x, 0.1, h), (y, -0.5, 0.8))
    m = polar()
    changed = teg.change_variables(e, m)
    same(e, changed, {"h": 0.9}, orders=2, maps=[m])
    assert "mapped to x, y" in str(teg.explain(changed, maps=[m]))


def test_ties_under_a_map() -> None:
    """Two circles that coincide, and one that touches the bounds: the mean of the two one-sided derivatives."""
    e = teg.integral(teg.bracket(x**2 + y**2 < t) * teg.bracket(x**2 + y**2 < a), *SQUARE)
    gradient = teg.compile(e, [t, a], maps=[polar()]).grad(t=0.5, a=0.5)
    assert gradient == pytest.approx({"t": math.pi / 2, "a": math.pi / 2}, rel=1e-12)
    line = teg.integral(teg.bracket(x < t), (x, 0, a), (y, 0, 1))
    m = maps.scaling((x, y), (u, v), (2, 3))
    tied = teg.compile(teg.change_variables(line, m), [t, a]).grad(t=0.5, a=0.5)
    assert tied == pytest.approx({"t": 0.5, "a": 0.5}, rel=1e-12)


# -- at run time ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_maps_are_verified_for_the_values_of_a_call(backend: str) -> None:
    e = teg.integral(teg.bracket(x**2 + y**2 < t), *SQUARE)
    m = polar() @ maps.scaling(r, q, k)
    f = teg.compile(e, maps=[m], backend=backend)
    assert sorted(f.parameters) == ["k", "t"]
    assert f.grad(t=0.5, k=3.0)["t"] == pytest.approx(math.pi, rel=1e-12)
    for call in (f, f.grad, f.hessian):
        with pytest.raises(DiffeomorphismError) as caught:
            call(t=0.5, k=0.0)
        assert caught.value.point is not None
        assert caught.value.point["k"] == 0.0
    with pytest.raises(DiffeomorphismError):
        f(t=0.5, k=np.array([1.0, 0.0]))
    unchecked = teg.compile(e, maps=[m], check_maps=False, backend=backend)
    assert unchecked(t=0.5, k=0.0) == pytest.approx(math.pi / 2, rel=1e-12)


def test_not_a_number_goes_in_and_out() -> None:
    m = polar() @ maps.scaling(r, q, k)
    f = teg.compile(teg.integral(teg.bracket(x**2 + y**2 < t), *SQUARE), maps=[m])
    assert np.isnan(f.grad(t=0.5, k=float("nan"))["t"])
    assert np.isnan(f(t=np.array([0.5, np.nan]), k=1.0)).tolist() == [False, True]


def test_a_box_that_the_map_does_not_reach() -> None:
    m = maps.exponential(x, u)
    f = teg.compile(teg.integral(teg.bracket(x * x < t), (x, h, 1)), maps=[m])
    assert f.grad(t=0.25, h=0.1)["t"] == pytest.approx(1.0, rel=1e-12)
    with pytest.raises(DiffeomorphismError) as caught:
        f(t=0.25, h=-1.0)
    assert caught.value.point is not None
    assert caught.value.point["x"] < 0
    positive_part = teg.compile(teg.integral(teg.bracket((x * x < t) & (x > 0.01)), (x, h, 1)), maps=[m])
    assert positive_part(t=0.25, h=-1.0) == pytest.approx(0.49, rel=1e-12)  # what is not reached does not count


def test_coordinates_beyond_the_domain() -> None:
    """Two turns in a program that is written in the new variables."""
    f = teg.compile(teg.integral(teg.bracket(r * teg.cos(p) < t) * r, (r, 0, 1), (p, 0, 4 * math.pi)), maps=[polar()])
    with pytest.raises(DiffeomorphismError) as caught:
        f(t=0.3)
    assert caught.value.point is not None
    assert caught.value.point["p"] > math.pi


def test_evaluators_with_maps_pickle() -> None:
    f = teg.compile(teg.integral(teg.bracket(x**2 + y**2 < t), *SQUARE), maps=[polar()])
    again = pickle.loads(pickle.dumps(f))
    assert again.grad(t=0.5)["t"] == f.grad(t=0.5)["t"]


def test_the_example() -> None:
    """A stirred disk: the map agrees with an independent quadrature, and with the compiler on its own."""
    (_, exact, _), *rows = compare(0.5, 0.4)
    for name, numbers, _ in rows:
        assert numbers == pytest.approx(exact, rel=1e-8), name
    mapped = {name: numbers for name, numbers, _ in rows}
    assert mapped["change_variables"] == pytest.approx(exact, rel=1e-13)
    assert mapped["compile(maps=[m])"][1:] == pytest.approx(exact[1:], rel=1e-13)
