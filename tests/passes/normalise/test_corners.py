"""Boxes far from the origin: a common shift of all coordinates changes nothing but their rounding."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import teg
from teg.passes.normalise.corners import with_local_boxes

x, y = teg.vars("x y")
cx, cy, px, py, r, t, left, low = teg.params("cx cy px py r t left low")
PIXEL = ((x, left, left + 1), (y, low, low + 1))
ACROSS, UP = ("cx", "px", "left"), ("cy", "py", "low")


def inside(condition: object, integrand: object = 1.0) -> teg.Expr:
    return teg.integral(teg.bracket(condition) * integrand, *PIXEL)


SCENES = {
    "a disk": inside((x - cx) ** 2 + (y - cy) ** 2 < r),
    "a disk, written out": inside(x * x - 2 * x * cx + cx * cx + y * y - 2 * y * cy + cy * cy < r),
    "a shaded disk": inside((x - cx) ** 2 + (y - cy) ** 2 < r, 1 + r * (x - px)),
    "an ellipse": inside(2 * (x - cx) ** 2 + (x - cx) * (y - cy) + (y - cy) ** 2 < r),
    "a hyperbola": inside((x - cx) * (y - cy) < t),
    "a hyperbola, written out": inside(x * y - x * cy - y * cx + cx * cy < t),
    "a parabola": inside(y - cy < x * x - 2 * x * cx + cx * cx),
    "a quartic": inside((x - cx) ** 4 + (y - cy) ** 4 < r * r),
    "two disks": inside(((x - cx) ** 2 + (y - cy) ** 2 < r) & ((x - px) ** 2 + (y - py) ** 2 < 0.4)),
    "two disks in a box about the first": teg.integral(
        teg.bracket(((x - cx) ** 2 + (y - cy) ** 2 < r) & ((x - px) ** 2 + (y - py) ** 2 < 0.4)), (x, cx - 2, cx + 2), (y, cy - r, cy + r)
    ),
    "a half-plane": inside((px - cx) * (y - cy) - (py - cy) * (x - cx) > 0),
    "a half-plane, written out": inside(cx * py - px * cy + x * (cy - py) + y * (px - cx) > 0),
}
AT = {"cx": 0.375, "cy": 0.5, "px": 0.9375, "py": 0.8125, "r": 0.125, "t": 0.0625, "left": 0.0, "low": 0.0}


def moved(f: object, across: float, up: float) -> dict[str, float]:
    """The parameters of a scene, moved."""
    return {k: v + across * (k in ACROSS) + up * (k in UP) for k, v in AT.items() if k in f.parameters}  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_shift_changes_nothing(name: str, backend: str) -> None:
    f = teg.compile(SCENES[name], backend=backend)
    value, gradient = f.value_and_grad(moved(f, 0, 0))
    for across, up in ((4096, 4096), (65536, -32768.5)):
        there, slopes = f.value_and_grad(moved(f, across, up))
        assert abs(there - value) <= 1e-12
        assert max(abs(slopes[k] - gradient[k]) for k in gradient) <= 1e-12


@pytest.mark.parametrize("name", ["a disk", "two disks", "two disks in a box about the first", "a hyperbola", "a half-plane"])
def test_second_derivatives(name: str) -> None:
    wrt = [p for p in (cx, cy, r, t) if p.name in str(SCENES[name])]
    f = teg.compile(SCENES[name], wrt)
    here, there = (f.hessian(moved(f, *shift)) for shift in ((0, 0), (65536, 4096)))
    assert max(abs(there[k] - here[k]) for k in here) <= 1e-12 * max(abs(v) for v in here.values())


@pytest.mark.parametrize("shift", [0.0, 300.0, 1000.0, 65536.0, 2.0**30])
def test_where_two_disks_cross(shift: float) -> None:
    """The area of two disks at a distance D has the derivative -L by D, with the chord L = 2·√(r² - u²), u = (D² + r² - s²)/2D."""
    lens = teg.bracket(((x - cx) ** 2 + (y - cy) ** 2 < 0.3**2) & ((x - px) ** 2 + (y - py) ** 2 < 0.4**2))
    f = teg.compile(teg.integral(lens, (x, left, left + 2), (y, low, low + 2)), [cx, px])
    at = {"cx": 0.75, "cy": 0.75, "px": 1.125, "py": 1.0, "left": 0.0, "low": 0.0}
    found = f.hessian({k: v + shift for k, v in at.items()})
    d = np.hypot(0.375, 0.25)
    u = (d * d + 0.3**2 - 0.4**2) / (2 * d)
    chord = 2 * np.sqrt(0.3**2 - u * u)
    steeper = 4 * u * (1 - u / d) / chord  # of -L by D
    wanted = steeper * (0.375 / d) ** 2 - chord / d * (0.25 / d) ** 2
    assert found["cx", "cx"] == pytest.approx(wanted, rel=1e-10)
    assert found["cx", "px"] == pytest.approx(-wanted, rel=1e-10)


@pytest.mark.parametrize("shift", [1000.0, 2.0**20, -(2.0**30)])
def test_smooth_functions_move_along(shift: float) -> None:
    lens = ((x - cx) ** 2 + (y - cy) ** 2 < r) & ((x - px) ** 2 + (y - py) ** 2 < 0.4)
    f = teg.compile(inside(lens, teg.exp(x - cx) * teg.cos((y - py) * (x - left))))
    near, far = (moved(f, *by) for by in ((0.0, 0.0), (shift, -shift)))
    (value, gradient), (there, slopes) = f.value_and_grad(near), f.value_and_grad(far)
    assert abs(value - there) <= 1e-12
    assert max(abs(gradient[k] - slopes[k]) for k in gradient) <= 1e-11
    second, seconds = (f.hvp(at, {"cx": 1.0, "low": 0.5}) for at in (near, far))
    assert max(abs(second[k] - seconds[k]) for k in second) <= 1e-10


@pytest.mark.parametrize("shift", [300.0, 1000.0])
def test_disks_cross_in_absolute_coordinates(shift: float) -> None:
    """A root in the integrand keeps x where it is; y is relative to the corner."""
    lens = teg.bracket(((x - cx) ** 2 + (y - cy) ** 2 < 0.25**2) & ((x - px) ** 2 + (y - py) ** 2 < 0.3125**2))
    f = teg.compile(teg.integral(lens * teg.sqrt(1 + x - left), *PIXEL), [cx, px])
    at = {"cx": 0.3125, "cy": 0.375, "px": 0.5625, "py": 0.5, "left": 0.0, "low": 0.0}
    near, far = (f.hessian({k: v + by for k, v in at.items()}) for by in (0.0, shift))
    assert max(abs(near[k] - far[k]) for k in near) <= 1e-8


@pytest.mark.parametrize("function", [teg.sqrt, teg.log, lambda u: 1 / u])
def test_any_function_moves_to_a_corner_that_is_a_number(function: Callable[[teg.Expr], teg.Expr]) -> None:
    def second(shift: int) -> dict[tuple[str, str], float]:
        lens = ((x - cx) ** 2 + (y - cy) ** 2 < 0.36) & ((x - px) ** 2 + (y - py) ** 2 < 0.25)
        e = teg.integral(teg.bracket(lens) * function(3 + x + y - 2 * shift), (x, shift - 1, shift + 1), (y, shift - 1, shift + 1))
        at = {"cx": 0.0, "cy": 0.0, "px": 0.5, "py": 0.25}
        return teg.compile(e, [cx, py]).hessian({k: v + shift for k, v in at.items()})

    near, far = second(0), second(65536)
    assert max(abs(near[k] - far[k]) for k in near) <= 1e-11


def test_a_disk_by_its_formula() -> None:
    # wholly inside: the area πr, by r π, by the centre 0
    f = teg.compile(inside((x - cx) ** 2 + (y - cy) ** 2 < r))
    value, gradient = f.value_and_grad(cx=65536.5, cy=-4095.5, r=0.0625, left=65536.0, low=-4096.0)
    assert value == pytest.approx(np.pi * 0.0625, abs=1e-13)
    assert gradient["r"] == pytest.approx(np.pi, abs=1e-11)
    assert abs(gradient["cx"]) + abs(gradient["cy"]) <= 1e-12


def test_a_box_that_is_moved_alone() -> None:
    f = teg.compile(inside((x - cx) ** 2 + (y - cy) ** 2 < r, 1 + x))
    gradient = f.grad(moved(f, 4096, 4096))
    h = 2.0**-12
    for p in ("left", "low"):
        at = moved(f, 4096, 4096)
        sides = [f({**at, p: at[p] + s * h}) for s in (-2, -1, 1, 2)]
        assert gradient[p] == pytest.approx((sides[0] - 8 * sides[1] + 8 * sides[2] - sides[3]) / (12 * h), abs=1e-3)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_two_variables_that_move_together_have_origins_of_their_own(backend: str) -> None:
    """y - x does not change if both move, but each is measured from its own bound: an area and its derivatives, by hand."""
    for condition in ((-x + y > t) & (y < r), (-1 * x + y > t) & (y < r), (-x + y) * r > t * r):
        f = teg.compile(inside(condition), backend=backend)
        value, slopes = f.value_and_grad({"t": 2.25, "r": 10.0, "left": 3.0, "low": 5.0})
        assert value == pytest.approx(0.75**2 / 2, rel=1e-13)
        assert [slopes[k] for k in ("t", "left", "low")] == pytest.approx([-0.75, -0.75, 0.75], rel=1e-12)


def test_bounds_that_are_far_numbers() -> None:
    disk = (x - cx) ** 2 + (y - cy) ** 2 < r
    near = teg.compile(teg.integral(teg.bracket(disk), (x, 0, 1), (y, 0, 1)))
    far = teg.compile(teg.integral(teg.bracket(disk), (x, 65536, 65537), (y, -4096, -4095)))
    here = near.value_and_grad(cx=0.375, cy=0.5, r=0.25)
    there = far.value_and_grad(cx=65536.375, cy=-4095.5, r=0.25)
    assert abs(here[0] - there[0]) <= 1e-12
    assert max(abs(here[1][k] - there[1][k]) for k in here[1]) <= 1e-12


def test_sums_over_pixels() -> None:
    centres, k, i, j = teg.array("C", 2), *(teg.index(n) for n in "kij")
    first, last = teg.indices("first", 1), teg.indices("last", 1)
    disk = (x - centres[k, 0]) ** 2 + (y - centres[k, 1]) ** 2 < 0.25
    pixel = teg.integral(teg.bracket(disk), (x, i, i + 1), (y, j, j + 1))
    e = teg.sum(pixel, (i, first[0], last[0]), (j, first[1], last[1]), (k, 0, teg.length(centres, 0)))
    points = np.array([[0.75, 1.125], [1.5, 1.0]])
    for backend in ("numpy", "c"):
        f = teg.compile(e, [centres], backend=backend)
        here, there = (
            f.value_and_grad(C=points + shift, first=np.array([shift, shift]), last=np.array([shift + 3, shift + 3]))
            for shift in (0, 65536)
        )
        assert here[0] == pytest.approx(np.pi / 2, abs=1e-12)
        assert abs(here[0] - there[0]) <= 1e-12
        assert np.abs(here[1]["C"] - there[1]["C"]).max() <= 1e-12


@pytest.mark.usefixtures("x64")
def test_a_disk_far_away_in_jax() -> None:
    f = teg.compile(SCENES["a disk, written out"], [cx, cy, r], backend="jax")
    here, there = (f.value_and_grad(moved(f, *shift)) for shift in ((0, 0), (65536, 4096)))
    assert abs(here[0] - there[0]) <= 1e-12
    assert max(abs(here[1][p] - there[1][p]) for p in here[1]) <= 1e-12


def test_what_stays_as_it_is() -> None:
    near = ((x, 0, 1), (y, 0, 1))
    for e in (
        teg.integral(teg.bracket((x - cx) ** 2 + y**2 < r), *near),
        teg.integral(teg.bracket(x < t) * teg.sqrt(x - cx), (x, left, left + 1)),
        inside((x - cx) ** 2 + (y - cy) ** 2 < r, teg.exp(x + y)),
        inside((x - cx) ** 2 + (y - cy) ** 2 < r, teg.exp(teg.bracket(x < t)) * teg.sin(teg.sqrt(x - t)) * teg.cos(y / t)),
        inside((y > cy) & (x > cx) & (x + y < t)),
        inside(x * y < t),
    ):
        assert with_local_boxes(e) is e


def test_surfaces_are_shown_in_the_users_coordinates() -> None:
    assert str(with_local_boxes(SCENES["a disk"])) == (
        "∫[(y - low): 0..1] (∫[(x - left): 0..1] [r - (((x - left) - (cx - left))² + ((y - low) - (cy - low))²) > 0])"
    )
