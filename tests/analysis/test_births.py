"""Births of level sets that are no quadrics: the mean of the one-sided derivatives, infinity, or a warning."""

from __future__ import annotations

import math
import warnings

import mpmath
import pytest

import teg
from teg.analysis.births import critical_points
from teg.analysis.calculus import slope
from teg.analysis.nest import Binder
from teg.ir.expr import Expr, const

x, y, z = teg.vars("x y z")
t, a, b, p = teg.params("t a b p")
BOX = ((x, -1.0, 1.0), (y, -1.0, 1.0))
CORNER = ((x, 0.0, 1.0), (y, 0.0, 1.0))
BACKENDS = ("c", "numpy")


def gradient(e: Expr, backend: str, /, **at: float) -> dict[str, float]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return teg.compile(e, [t], backend=backend).value_and_grad(**at)[1]


def area(g: Expr, *ranges: object, density: Expr | float = 1.0) -> Expr:
    return teg.integral(teg.bracket(g < t) * density, *(ranges or BOX))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("g", "points"),
    [
        (x**4 + y**4, [(0.0, 0.0)]),
        ((x - 0.3) ** 2 + (y - 0.7) ** 4, [(0.3, 0.7)]),
        (x**4 - 2 * x**2 + y**2, [(-1.0, 0.0), (0.0, 0.0), (1.0, 0.0)]),
        (teg.cosh(x) * teg.cosh(y), [(0.0, 0.0)]),
        (teg.sin(x) ** 2 + teg.sin(y) ** 2, [(0.0, 0.0)]),
        (x**4 + x**3 + x * y + y**4 + x, None),
    ],
)
def test_critical_points_have_formulas(g: Expr, points: list[tuple[float, float]] | None) -> None:
    chain = tuple(Binder(v, const(-1.0), const(1.0)) for v in (y, x))
    known = critical_points([slope(g, b.var) for b in chain], chain)
    if points is None:
        assert known is None
        return
    assert known is not None
    found = set()
    for at, exists in known:
        at_both = teg.compile(teg.where(exists, 1.0, 0.0), [], backend="numpy")()
        if at_both:
            found.add(tuple(round(float(teg.compile(at[v], [], backend="numpy")()), 12) + 0.0 for v in (x, y)))
    assert sorted(found) == points


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("program", "expected"),
    [
        (area(x**4 + y**4), math.inf),
        (area(x**2 + y**4), math.inf),
        (area((x**2 + y**2) ** 2), math.inf),
        (area(x**4 + y**4, (y, -1.0, 1.0 + 0.1 * x**2), (x, -1.0, 1.0)), math.inf),
        (area(x**4 + y**4, (x, -math.inf, math.inf), (y, -math.inf, math.inf)), math.inf),
        (-area(x**4 + y**4), -math.inf),
        (area(x**2 + y**2 + x**4), math.pi / 2),
        (area(teg.sin(x) ** 2 + teg.sin(y) ** 2), math.pi / 2),
        (area(2 * x**2 + 2 * x * y + 3 * y**2 + y**4), math.pi / math.sqrt(20.0)),
        (area(x**2 + y**2 + x**4, *BOX, (z, 0.0, 1.0), density=teg.exp(z + x)), math.pi / 2 * (math.e - 1.0)),
        (area(x**2 + y**2 + z**4, *BOX, (z, -1.0, 1.0)), 0.0),
        (area(abs(x) + abs(y)), 0.0),
    ],
)
def test_a_birth_is_the_mean_of_both_sides(program: Expr, expected: float, backend: str) -> None:
    assert gradient(program, backend, t=0.0)["t"] == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "program",
    [
        area(x**4 + y**4, *CORNER),
        area(x**2 + y**2 + x**4, density=teg.bracket(x > 0) * teg.bracket(y > 0)),
        area(x**4 + y**4 + z**4, *BOX, (z, -1.0, 1.0)),
        area((x + y) ** 4, *CORNER),
    ],
)
def test_a_birth_without_a_rule_is_told(program: Expr, backend: str) -> None:
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(teg.compile(program, [t], backend=backend).value_and_grad(t=0.0)[1]["t"])


@pytest.mark.parametrize("backend", BACKENDS)
def test_powers_that_are_born_in_a_corner(backend: str) -> None:
    f = teg.compile(area((x + y) ** p, *CORNER), [t], backend=backend)
    assert f.value_and_grad(t=0.0, p=1.5)[1]["t"] == 0.0  # the area is t^(2/p)/2
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(f.value_and_grad(t=0.0, p=4.0)[1]["t"])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("level", [1e-40, 1e-16, 1e-6])
def test_beside_a_birth_derivatives_are_those_of_the_areas(level: float, backend: str) -> None:
    area_of = {m: 4 * mpmath.gamma(1 + mpmath.mpf(1) / m) * mpmath.gamma(1.25) / mpmath.gamma(1.25 + mpmath.mpf(1) / m) for m in (2, 4)}
    for m, c in area_of.items():
        power = mpmath.mpf(1) / m + mpmath.mpf(1) / 4
        expected = float(c * power * mpmath.mpf(level) ** (power - 1))
        assert gradient(area(x**m + y**4), backend, t=level)["t"] == pytest.approx(expected, rel=1e-8)
        assert gradient(area(x**m + y**4), backend, t=-level)["t"] == 0.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_moving_a_birth_changes_nothing(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket((x - a) ** 4 + (y - b) ** 4 < t), *BOX), [a, b], backend=backend)
    assert f.value_and_grad(t=0.0, a=0.3, b=0.7) == (0.0, {"a": 0.0, "b": 0.0})


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_point_that_stays_singular_is_no_birth(backend: str) -> None:
    """The two loops of a lemniscate, whose area is a², meet in one point for every a."""
    q = x**2 + y**2
    e = teg.integral(teg.bracket(q**2 < a**2 * (x**2 - y**2)), (x, -2, 2), (y, -2, 2))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert teg.compile(e, [a], backend=backend).grad(a=1.1)["a"] == pytest.approx(2.2, rel=1e-8)


def test_critical_points_at_infinity_are_none() -> None:
    """x = 2/(3k) is a critical point of a cubic, and none of a disk, k = 0."""
    g = 1 - x**2 - y**2 + b * (x**3 - 3 * x * y**2) + t
    f = teg.compile(teg.integral(teg.bracket(g > 0), (x, -2, 2), (y, -2, 2)), [t], backend="numpy")
    assert f.grad(t=0.0, b=0.0)["t"] == pytest.approx(math.pi, rel=1e-9)


@pytest.mark.parametrize("size", [1e-30, 1e-10, 1e20])
def test_the_size_of_a_surface_is_no_reason_to_take_it_for_0(size: float) -> None:
    e = teg.integral(teg.bracket(size * (x**2 + y**2 + x**4) < size * t), *BOX)
    assert gradient(e, "numpy", t=0.0)["t"] == pytest.approx(math.pi / 2, rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_products_of_one_product(backend: str) -> None:
    """Where the slopes of a surface share factors that are choices. Reference: an area by its distribution function, with 40 digits."""
    k, factors = teg.index("k"), teg.array("a", 1)
    inside = teg.prod(1 - factors[k] * x * y, (k, 0, teg.length(factors, 0))) < 0.9
    f = teg.compile(teg.integral(teg.bracket(inside), *CORNER), [factors], backend=backend)
    value, slopes = f.value_and_grad(a=[0.3, 0.5, -0.2])
    assert value == pytest.approx(0.5351210985929940, rel=1e-14)
    assert slopes["a"] == pytest.approx([0.4705366844736256, 0.4876212237478039, 0.4326411124718597], rel=1e-12)
