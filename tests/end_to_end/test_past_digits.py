"""Programs that once lost digits among numbers of very different sizes, with the right numbers and how they are known."""

from __future__ import annotations

import math

import pytest

import teg
from teg.program.interpreter import interpret

pytestmark = pytest.mark.usefixtures("x64_for_jax")

B, INT = teg.bracket, teg.integral
x, y, z, s = teg.vars("x y z s")
t, a, b, c, d, u, lo, r, m, n = teg.params("t a b c d u l r m n")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]


def test_a_bilinear_surface_that_is_nearly_a_line() -> None:
    """The border between its charts was lost in rounding: its gradient was off by 1e-16/a."""
    b, c = teg.params("b c")
    f = teg.compile(INT(B(a * x * y + b * x + c * y < t), (x, 0, 1), (y, 0, 1)))
    for size in (0.0, 1e-8, 1e-11, 1e-13, 1e-15):
        gradient = f.grad(a=size, b=1.0, c=1.0, t=0.75)
        assert [gradient[k] for k in "abct"] == pytest.approx([-0.0703125, -0.28125, -0.28125, 0.75], rel=1e-8)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_disk_far_from_the_origin(backend: str) -> None:
    for o in (512.0, 1e6):
        disk = (x - 0.3) ** 2 + (y - (o + 0.5)) ** 2 < t * t
        f = teg.compile(INT(B(disk), (x, 0, 1), (y, o, o + 1)), backend=backend)
        value, gradient = f.value_and_grad(t=0.2)
        assert value == pytest.approx(math.pi * 0.04, rel=1e-9)
        assert gradient["t"] == pytest.approx(math.pi * 0.4, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("least", [1e-160, 1e-200, 1e-300])
def test_a_root_that_is_very_far_away_is_no_tie_with_a_bound(backend: str, least: float) -> None:
    """The bound of a root's rounding error overflowed, so that every bound was a tie with the root."""
    surfaces = [t - a * x**2, t - a * x**2 - b * x, t - a * x**4, t - b * x**2]
    for g in surfaces:
        f = teg.compile(INT(B(g > 0) * teg.exp(x), (x, -1, 1)), [t, a, b], backend=backend)
        value, slopes = f.value_and_grad(t=0.3, a=least, b=least)
        assert value == pytest.approx(2 * math.sinh(1), rel=1e-14)
        assert list(slopes.values()) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("intrinsics", [True, False])
@pytest.mark.parametrize("low", [2.0, 3.0])
def test_a_line_on_a_side_by_rounding_counts_half_on_both_of_its_sides(backend: str, intrinsics: bool, low: float) -> None:
    """The line y = 0.3/0.1 is the side y = 3 but for a rounding. Its boundary term was taken to be empty in the box above."""
    s, p = teg.params("s p")
    g = a * x + s * y + t
    for body, weight in ((1.0, 1.0), (1 + x * y, 2.5)):
        e = INT(B(g > 0) * body, (x, 0, 1), (y, p, p + 1))
        f = teg.compile(e, [t], backend=backend, intrinsics=intrinsics)
        assert f.grad(a=0.0, s=-0.1, t=0.3, p=low)["t"] == pytest.approx(0.5 * weight / 0.1, rel=1e-12)
        assert f.grad(a=0.0, s=-1.0, t=3.0, p=low)["t"] == pytest.approx(0.5 * weight, rel=1e-12)


@pytest.mark.parametrize("closed_forms", [True, False])
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("radius", [1e-3, 1e-6, 1e-8, 1e-12])
def test_a_line_through_a_small_disk(radius: float, backend: str, closed_forms: bool) -> None:
    """The discriminant of the chord's ends, on a line as long as the box, was lost: 2e-8 of the derivative by the line, or all of it."""
    e = INT(B((x - a) ** 2 + (y - b) ** 2 < r * r) * B(x + c * y > d + c * b), (x, -1, 1), (y, -1, 1))
    f = teg.compile(e, [d], backend=backend, intrinsics=closed_forms)
    chord = 2 * radius / math.sqrt(1.25)
    for centre in (0.0, 0.3):
        found = f.grad(r=radius, a=centre, b=0.7 * centre, c=0.5, d=centre)["d"]
        assert found == pytest.approx(-chord, abs=1e-15, rel=1e-9)


LONG = (1e3, 1e8, 1e10)
"""How far bounds lie apart from what is integrated: what users write for infinity."""


@pytest.mark.parametrize("backend", ["interpreter", *BACKENDS])
@pytest.mark.parametrize("far", LONG)
def test_lines_in_long_boxes_have_all_digits(far: float, backend: str) -> None:
    """Roots and boundary terms were relative to the lower bound: known to the rounding of that, without a warning."""
    bell = teg.exp(-x * x)
    known = [
        (INT(B(x > a) * bell, (x, -far, far)), -math.exp(-0.09)),
        (INT(B(x > a) * bell, (x, far, -far)), math.exp(-0.09)),
        (INT(B(2 * x > a) * x, (x, -far, 1)), -0.15 / 2),
        (INT(B(x + y > a) * bell * teg.exp(-y * y), (x, -far, far), (y, -far, far)), -math.sqrt(math.pi / 2) * math.exp(-0.045)),
        (INT(B(x + y > a) * teg.exp(x), (x, -far, 1), (y, 0, 1)), -math.exp(0.3) * (1 - math.exp(-1))),
    ]
    for e, slope in known:
        assert gradient_of(e, {"a": 0.3}, backend)["a"] == pytest.approx(slope, rel=1e-10)


@pytest.mark.parametrize("backend", ["interpreter", *BACKENDS])
@pytest.mark.parametrize("far", LONG)
def test_a_bound_that_is_far_leaves_digits_near_the_other_one(far: float, backend: str) -> None:
    """The bound t, a parameter, is far away, and the other one a number near the root."""
    slanting = -math.exp(0.3) * (1 - math.exp(-1))
    known = [
        (INT(B(x > a), (x, t, 1)), 0.7, -1.0),
        (INT(B(x > a) * teg.exp(x), (x, t, 1)), math.e - math.exp(0.3), -math.exp(0.3)),
        (INT(B(x > a) * teg.exp(x), (x, 1, t)), math.exp(0.3) - math.e, math.exp(0.3)),
        (INT(B(x + y > a) * teg.exp(x), (x, t, 1), (y, 0, 1)), math.e + slanting, slanting),
    ]
    for e, value, slope in known:
        at = {"a": 0.3, "t": -far}
        assert teg.evaluate(e, at, backend="numpy" if backend == "interpreter" else backend) == pytest.approx(value, rel=1e-10)
        assert gradient_of(e, at, backend)["a"] == pytest.approx(slope, rel=1e-10)


def gradient_of(e: teg.Expr, at: dict[str, float], backend: str) -> dict[str, float]:
    """The gradient, by a backend or the interpreter."""
    if backend != "interpreter":
        return teg.compile(e, backend=backend).grad(at)  # type: ignore[arg-type, no-any-return]
    program = teg.compile(e).program(1)
    outputs = interpret(program, [at[name] for name in program.parameters]).outputs
    return dict(zip(teg.compile(e).parameters, outputs[1:], strict=True))
