"""Light, height and occlusion of spheres over a plane: conditions on square roots that end at a circle. Closed forms by the spheres."""

from __future__ import annotations

import math

import numpy as np
import pytest

import teg

pytestmark = pytest.mark.usefixtures("x64_for_jax")

BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
B, W = teg.bracket, teg.where
x, y = teg.vars("x y")
a, b, c, t, u = teg.params("a b c t u")
SQUARE = (x, -1, 1), (y, -1, 1)
R2 = x * x + y * y
HEIGHT = teg.sqrt(a - R2)
LIGHT = (0.4, 0.3, 0.5)
STRENGTH = math.sqrt(sum(v * v for v in LIGHT))
SHADE = LIGHT[0] * x + LIGHT[1] * y + LIGHT[2] * HEIGHT
SECOND = 0.3 - (x - b) ** 2 - y * y


def over_square(e: teg.Expr) -> teg.Expr:
    return teg.integral(e, *SQUARE)


def lambert(strength: float, radius: float, angle: float) -> float:
    """∫ max(0, p·l) over the disk under a sphere, by the angle between light and eye: Lambert's phase law."""
    return strength * radius**3 * 2.0 / 3.0 * (math.sin(angle) + (math.pi - angle) * math.cos(angle))


def cap_rate(level: float, angle: float) -> float:
    """The rate at which the visible part of the cap {p·l > level} of the unit sphere, seen from above, grows with its level: by
    Archimedes' theorem a strip between two levels has the area dφ·dlevel on the sphere, times its height z in the picture."""
    up, along = level * math.cos(angle), math.sqrt(1.0 - level * level) * math.sin(angle)
    end = math.acos(max(-1.0, min(1.0, -up / along)))
    return -2.0 * (end * up + along * math.sin(end))


@pytest.mark.parametrize("backend", BACKENDS)
def test_shaded_sphere(backend: str) -> None:
    shaded = W(a > R2, teg.maximum(0, SHADE), 0)
    value, gradient = teg.compile(over_square(shaded), [a], backend=backend).value_and_grad(a=0.5)
    expected = lambert(STRENGTH, math.sqrt(0.5), math.acos(LIGHT[2] / STRENGTH))
    assert value == pytest.approx(expected, abs=1e-11)
    assert gradient["a"] == pytest.approx(1.5 * expected / 0.5, abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("body", "slope", "most"), [(HEIGHT, math.pi * 0.5**0.5, 15_000), (HEIGHT**3 * x**2, 0.2 * math.pi * 0.5**2.5, 0)])
def test_the_gradient_by_the_radius_costs_little_more(backend: str, body: teg.Expr, slope: float, most: int) -> None:
    """1/√(a - x² - y²) is integrable: the surface is not carried along."""
    f = teg.compile(over_square(W(a > R2, body, 0)), [a], backend=backend)
    assert f.grad(a=0.5)["a"] == pytest.approx(slope, rel=1e-10)
    assert not most or f.evaluations(derivatives=1, a=0.5) < most


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("level", [0.3, 0.0, -0.4, 0.9])
def test_light_above_a_level(backend: str, level: float) -> None:
    f = teg.compile(over_square(W(a > R2, B(t < SHADE), 0)), [a, t], backend=backend)
    radius = math.sqrt(0.5)
    value, gradient = f.value_and_grad(a=0.5, t=level * STRENGTH * radius)
    rate = 0.5 * cap_rate(level, math.acos(LIGHT[2] / STRENGTH)) / (STRENGTH * radius)
    assert gradient["t"] == pytest.approx(rate, abs=1e-10)
    # the area is a·A(t/√a): its derivative by a is A - ½·t·A′/√a
    assert gradient["a"] == pytest.approx(value / 0.5 - 0.5 * level * STRENGTH * radius * rate / 0.5, abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("up", [0.7, -0.7])
def test_light_with_a_factor_of_unknown_sign(backend: str, up: float) -> None:
    f = teg.compile(over_square(W(a > R2, B(t < 0.6 * x + 0.8 * y + u * HEIGHT), 0)), [a, t, u], backend=backend)
    strength, radius = math.hypot(1.0, up), math.sqrt(0.5)
    value, gradient = f.value_and_grad(a=0.5, t=0.2, u=up)
    rate = 0.5 * cap_rate(0.2 / (strength * radius), math.acos(up / strength)) / (strength * radius)
    assert gradient["t"] == pytest.approx(rate, abs=1e-10)
    assert gradient["a"] == pytest.approx(value / 0.5 - 0.5 * 0.2 * rate / 0.5, abs=1e-10)


def test_a_curve_that_has_become_a_line_is_said() -> None:
    f = teg.compile(over_square(W(a > R2, B(t < 0.6 * x + 0.8 * y + u * HEIGHT), 0)), [a, t, u], backend="numpy")
    assert f(a=0.5, t=0.2, u=0.0) == pytest.approx(0.5 * math.acos(0.2 / math.sqrt(0.5)) - 0.2 * math.sqrt(0.46), abs=1e-12)
    with pytest.warns(teg.AccuracyWarning):
        gradient = f.grad(a=0.5, t=0.2, u=0.0)
    assert all(math.isnan(v) for v in gradient.values())


def test_the_area_between_two_arcs_that_become_a_line_has_no_derivative() -> None:
    """It grows with |u|. Without a guard both derivatives would be 0."""
    f = teg.compile(over_square(B((u * u * (x + y + 3) > (x + y - t) ** 2) & (y > x))), [t, u], backend="numpy")
    assert f(t=0.1, u=1e-3) == f(t=0.1, u=-1e-3) > 1e-3
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        gradient = f.grad(t=0.1, u=0.0)
    assert math.isnan(gradient["u"])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_root_without_weight_is_no_second_line(backend: str) -> None:
    """[u·√(x² + y² + 0.1) > x - t]: its square has the line x = t twice where u is 0. The gradient there was twice as large."""
    root = teg.sqrt(x**2 + y**2 + 0.1)
    at = {"t": 0.1, "u": 0.0}
    f = teg.compile(over_square(B(u * root > x - t)), [t, u], backend=backend)
    on_the_line = math.sqrt(1.11) + 0.11 * math.asinh(1.0 / math.sqrt(0.11))  # the integral of the root over y at x = t
    assert f.grad(**at) == pytest.approx({"t": 2.0, "u": on_the_line}, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("lift", [0.1, -0.1])
def test_one_sphere_before_the_other(backend: str, lift: float) -> None:
    """Each pixel of the lens under both spheres shows one of them, so their areas add up to that of the lens."""
    lens = (a > R2) & (SECOND > 0)
    root = teg.sqrt(SECOND)
    first, second, both = (
        teg.compile(over_square(B(lens & condition)), [a, b, c], backend=backend)
        for condition in (c + HEIGHT < root, c + HEIGHT >= root, a > R2)
    )
    point = {"a": 0.4, "b": 0.3, "c": lift}
    (v1, g1), (v2, g2), (v, g) = (f.value_and_grad(**point) for f in (first, second, both))
    assert v1 + v2 == pytest.approx(v, abs=1e-12)
    for name in point:
        assert g1[name] + g2[name] == pytest.approx(g[name], abs=1e-10)
        sides = [first(**{**point, name: point[name] + h}) for h in (-2e-3, -1e-3, 1e-3, 2e-3)]
        assert g1[name] == pytest.approx((sides[0] - 8 * sides[1] + 8 * sides[2] - sides[3]) / 12e-3, abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_spheres_whose_squares_cancel(backend: str) -> None:
    """The difference of both heights' squares is linear as it is written, x² - (x - 0.3)² + ... The curve of equal heights has
    √u + c = √w: on its ellipse 4c²u = v², with v = u - w + c² <= 0. By Leibniz's rule along it, over x."""
    first, second, up = 0.5, 0.4, 0.1
    higher = (a > R2) & ((x - 0.3) ** 2 + y * y < b) & (c + HEIGHT > teg.sqrt(b - (x - 0.3) ** 2 - y * y))
    gradient = teg.compile(over_square(B(higher)), [c], backend=backend).grad(a=first, b=second, c=up)
    end, start = 0.5, (first - second + 0.09 + up * up) / 0.6  # where the ellipse ends (at a = 0.5, b = 0.4, c = 0.1), and v = 0

    def rate(s: float) -> float:
        place = end - s * s
        v = 0.6 * (start - place)
        u = v * v / (4.0 * up * up)
        return 2.0 * s * (8.0 * u * up - 4.0 * v * up) / (8.0 * up * up * math.sqrt(first - place * place - u))

    nodes, weights = np.polynomial.legendre.leggauss(60)
    reach = math.sqrt(end - start)
    exact = sum(w * reach * rate(0.5 * reach * (1.0 + v)) for v, w in zip(nodes, weights, strict=True))
    assert gradient["c"] == pytest.approx(exact, abs=1e-9)


def test_spheres_at_one_height_by_their_height_is_said() -> None:
    """The ellipse between them is a line there, which is taken for two: 2.10 and 0.22 for ∂/∂a = 3.56 and ∂/∂b = 0.17 without a guard."""
    nearer = W(a > R2, W((SECOND > 0) & (c + HEIGHT < teg.sqrt(teg.maximum(0, SECOND))), 0.2, 1), W(SECOND > 0, 0.2, 0))
    f = teg.compile(over_square(nearer), [a, b, c], backend="numpy")
    with pytest.warns(teg.AccuracyWarning):
        gradient = f.grad(a=0.4, b=0.3, c=0.0)
    assert all(math.isnan(v) for v in gradient.values())
    near, exact = f(a=0.4, b=0.3, c=1e-7), f(a=0.4, b=0.3, c=0.0)
    assert exact == pytest.approx(near, abs=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_height_beside_a_circle_written_in_another_way(backend: str) -> None:
    """½ of a ball cut at x = b: what is lost with b is half of a disk. The root is written otherwise than the condition around it."""
    half = W((a > R2) & (x > b), teg.sqrt(a - x * x - y * y), 0)
    gradient = teg.compile(over_square(half), [a, b], backend=backend).grad(a=0.5, b=0.2)
    assert gradient["b"] == pytest.approx(-0.5 * math.pi * (0.5 - 0.04), abs=1e-11)
    depth = math.sqrt(0.5) - 0.2
    # the ball's cap has the volume π·h²·(3r - h)/3; of the half above the plane, by r² = a
    assert gradient["a"] == pytest.approx(0.5 * math.pi * depth * 2.0 * math.sqrt(0.5) / (2.0 * math.sqrt(0.5)), abs=1e-10)
    beside = W((x - b) ** 2 + y * y < 0.1, 1, W(a > R2, teg.sqrt(a - x * x - y * y), 0))
    f = teg.compile(over_square(beside), [a, b], backend=backend)
    gradient = f.grad(a=0.5, b=0.5)
    for name, h in (("a", 1e-3), ("b", 1e-3)):
        sides = [f(**{"a": 0.5, "b": 0.5, name: 0.5 + k * h}) for k in (-2, -1, 1, 2)]
        assert gradient[name] == pytest.approx((sides[0] - 8 * sides[1] + 8 * sides[2] - sides[3]) / (12 * h), abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_pyramid_with_a_power(backend: str) -> None:
    """∫ max(0, 1 - |x|/a - |y|/b)ᵗ = 4ab/((t + 1)(t + 2)): on its border the base is 0 to rounding."""
    pyramid = teg.maximum(0, 1 - abs(x) / a - abs(y) / b) ** t
    value, gradient = teg.compile(over_square(pyramid), [a, b, t], backend=backend).value_and_grad(a=0.5, b=0.7, t=1.5)
    assert value == pytest.approx(0.16, abs=1e-10)
    expected = {"a": 0.32, "b": 0.16 / 0.7, "t": -0.16 * (1.0 / 2.5 + 1.0 / 3.5)}
    assert gradient == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_field_of_view(backend: str) -> None:
    """|atan2(y - b, x - a) - t| < c within a disk around (a, b) is a sector of the area c·u."""
    seen = B(abs(teg.atan2(y - b, x - a) - t) < c) * B((x - a) ** 2 + (y - b) ** 2 < u)
    value, gradient = teg.compile(over_square(seen), [a, b, c, t, u], backend=backend).value_and_grad(a=0.1, b=0.2, c=0.3, t=0.5, u=0.3)
    assert value == pytest.approx(0.09, abs=1e-12)
    assert gradient == pytest.approx({"a": 0.0, "b": 0.0, "c": 0.3, "t": 0.0, "u": 0.3}, abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_logarithm_of_a_line_with_a_kink(backend: str) -> None:
    """∫ log(t - |x - a|) where it is a number = 2t·(log t - 1)."""
    barrier = W(abs(x - a) < t, teg.log(t - abs(x - a)), 0)
    value, gradient = teg.compile(teg.integral(barrier, (x, -1, 1)), [a, t], backend=backend).value_and_grad(a=0.1, t=0.5)
    assert value == pytest.approx(math.log(0.5) - 1.0, abs=1e-11)
    assert gradient == pytest.approx({"a": 0.0, "t": 2.0 * math.log(0.5)}, abs=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_latitude(backend: str) -> None:
    """asin(y/√a) < t on a disk: beyond the disk asin is no number, and the condition does not count there."""
    south = W(a > R2, B(teg.asin(y / teg.sqrt(a)) < t), 0)
    value, gradient = teg.compile(over_square(south), [a, t], backend=backend).value_and_grad(a=0.5, t=0.3)
    area = 0.5 * math.pi + 0.3 + math.sin(0.3) * math.cos(0.3)
    assert value == pytest.approx(0.5 * area, abs=1e-11)
    assert gradient == pytest.approx({"a": area, "t": 2.0 * 0.5 * math.cos(0.3) ** 2}, abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_height_between_circles(backend: str) -> None:
    """Two parts of half a ball, inside and outside of another circle: together they are all of it. Where the circles cross, pieces are as
    short as rounding makes them, and roots of their middles of either sign."""
    inside, outside = (
        teg.compile(over_square(W((a > R2) & condition, HEIGHT, 0)), [a, b], backend=backend) for condition in (SECOND > 0, SECOND < 0)
    )
    point = {"a": 0.4, "b": 0.3}
    first, second = inside.grad(**point), outside.grad(**point)
    assert first["b"] == pytest.approx(-second["b"], abs=1e-10)
    assert first["a"] + second["a"] == pytest.approx(math.pi * math.sqrt(0.4), abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("level", [-0.2, 0.2])
def test_height_times_a_place(backend: str, level: float) -> None:
    """The area with x·√(a - x² - y²) > t falls by π·dt at any level. The places where its roots in y are born are those of a - x² - t²/x²,
    on both sides of a pole."""
    f = teg.compile(over_square(B((R2 < 0.5) & (teg.sqrt(0.5 - R2) * x > t))), [t], backend=backend)
    assert f.grad(t=level)["t"] == pytest.approx(-math.pi, abs=1e-9)
