"""Do maps reach what is integrated over? Small holes are found before anything is computed, and those where nothing is do not matter."""

from __future__ import annotations

import math

import numpy as np
import pytest

import teg
from teg import Diffeomorphism, bracket, integral
from teg.errors import BoundError, DiffeomorphismError

x, y, r, p, u = teg.vars("x y r p u")
t, a = teg.params("t a")


def squares(end: float) -> Diffeomorphism:
    """x = u² on (0, end²)."""
    return Diffeomorphism({x: u * u}, inverse={u: teg.sqrt(x)}, domain={u: (0, end)})


def disk(radius: float) -> Diffeomorphism:
    return Diffeomorphism(
        {x: r * teg.cos(p), y: r * teg.sin(p)},
        inverse={r: teg.sqrt(x * x + y * y), p: teg.atan2(y, x)},
        domain={r: (0, radius), p: (-math.pi, math.pi)},
    )


@pytest.mark.parametrize("end", [0.9, 0.985, 0.9995])
def test_a_hole_at_an_end(end: float) -> None:
    with pytest.raises(DiffeomorphismError, match="beyond its domain") as caught:
        teg.change_variables(integral(1 + x, (x, 0, 1)), squares(end))
    assert caught.value.point is not None
    assert caught.value.point["x"] > end**2


@pytest.mark.parametrize("radius", [1.2, 1.4, 1.414])
def test_a_hole_in_a_corner(radius: float) -> None:
    """The disk of radius 1.414 leaves 2e-8 of the square out."""
    with pytest.raises(DiffeomorphismError, match="beyond its domain"):
        teg.change_variables(integral(1 + x, (x, 0, 1), (y, 0, 1)), disk(radius))


def test_a_hole_inside_of_a_box() -> None:
    """A map whose inverse fails on 0.5 % of an interval, near no end of it."""
    gap = teg.where((x > 0.61) & (x < 0.615), x + 3, x)
    m = Diffeomorphism({x: u}, inverse={u: gap}, domain={u: (-2, 0.6)})
    with pytest.raises(DiffeomorphismError):
        teg.change_variables(integral(1 + x, (x, -1, 1)), m)


def test_a_map_that_reaches_everything_is_accepted() -> None:
    whole = integral(1 + x, (x, 0, 1))
    assert teg.compile(teg.change_variables(whole, squares(1.0)))() == pytest.approx(1.5, rel=1e-12)
    square = integral(1 + x, (x, 0, 1), (y, 0, 1))
    assert teg.compile(teg.change_variables(square, disk(1.5)))() == pytest.approx(1.5, rel=1e-9)


def test_where_nothing_is_integrated_nothing_has_to_be_reached() -> None:
    inside = integral(bracket(x * x + y * y < 1) * (1 + x), (x, 0, 1), (y, 0, 1))
    assert teg.compile(teg.change_variables(inside, disk(1.0)))() == pytest.approx(math.pi / 4 + 1 / 3, rel=1e-9)


def test_the_first_call_finds_a_hole_of_three_percent() -> None:
    f = teg.compile(integral(bracket(x < t) * (1 + x), (x, 0, a)), maps=[squares(0.985)])
    with pytest.raises(DiffeomorphismError, match="beyond its domain"):
        f(t=2.0, a=1.0)
    assert f(t=2.0, a=0.9) == pytest.approx(0.9 + 0.405, rel=1e-12)
    with pytest.raises(DiffeomorphismError, match="beyond its domain"):
        f(t=2.0, a=np.array([0.9, 1.0]))


PLANE = [((x, lo, math.inf), (y, below, math.inf), share) for lo, below, share in ((-math.inf, -math.inf, 1), (0, -math.inf, 2), (0, 0, 4))]


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize(("over_x", "over_y", "share"), PLANE, ids=["plane", "half", "quarter"])
def test_a_map_of_an_integral_to_infinity(over_x: tuple[object, ...], over_y: tuple[object, ...], share: int, backend: str) -> None:
    """∫∫ [x² + y² < t]·exp(-x² - y²) = π(1 - e⁻ᵗ), in a box of the map that holds the disk."""
    e = integral(bracket(x * x + y * y < t) * teg.exp(-x * x - y * y), over_x, over_y)
    f = teg.compile(e, [t], maps=[teg.polar(x, y, r, p).with_bounds({r: (0, 2)})], backend=backend)
    value, gradient = f.value_and_grad(t=0.7)
    assert value == pytest.approx(math.pi / share * -math.expm1(-0.7), rel=1e-9)
    assert gradient["t"] == pytest.approx(math.pi / share * math.exp(-0.7), rel=1e-9)


def test_a_box_that_cuts_an_integral_to_infinity() -> None:
    e = integral(bracket(x * x + y * y > t) * teg.exp(-x * x - y * y), (x, -math.inf, math.inf), (y, -math.inf, math.inf))
    f = teg.compile(e, [t], maps=[teg.polar(x, y, r, p).with_bounds({r: (0, 2)})])
    with pytest.raises(DiffeomorphismError, match="beyond its bounds"):
        f.grad(t=0.7)


def test_infinite_bounds_need_a_box() -> None:
    e = integral(bracket(x * x + y * y < t), (x, -math.inf, math.inf), (y, -math.inf, math.inf))
    with pytest.raises(BoundError, match=r"cannot be derived") as caught:
        teg.compile(e, [t], maps=[teg.polar(x, y, r, p)], backend="numpy").grad(t=0.7)
    assert "with_bounds" in str(caught.value)
