"""What an expression is as a polynomial."""

from __future__ import annotations

import pytest

import teg
from teg.analysis.polynomial import Point, Shadow, is_null
from teg.ir.expr import ONE, Add
from teg.ir.simplify import call
from teg.numerics.field import P

x, y, z = teg.vars("x y z")
t, a, b = teg.params("t a b")

e01 = (a - 1) * (y - t) - (b - t) * (x - 1)
e12 = (2 - a) * (y - b) - (3 - b) * (x - a)
e20 = (1 - 2) * (y - 3) - (t - 3) * (x - 2)


@pytest.mark.parametrize(
    ("e", "degree"),
    [
        (t * a, 0),
        (x, 1),
        (x * y, 2),
        (x**3 + y, 3),
        ((x + t) ** 5, 5),
        (x - x * t, 1),
        ((x + y) ** 2 - x**2 - 2 * x * y - y**2 + x, 1),
        ((x + 1) * (x - 1) - x * x, 0),
        (teg.sin(t) * x, 1),
        (x / t, 1),
        (x**2 / (1 + t), 2),
        (teg.sin(x), None),
        (1 / x, None),
        (teg.sqrt(x), None),
        (x ** teg.param("k"), None),
        (teg.where(t < a, x, x**2), 2),
        (teg.abs(x) * y, 2),
        (e01 + e12 + e20, 0),  # the denominator of barycentric coordinates: free of x and y after cancellation only
        (e01 / (e01 + e12 + e20), 1),
    ],
    ids=lambda v: str(v),
)
def test_degree(e: teg.Expr, degree: int | None) -> None:
    assert Shadow((x, y)).degree(e) == degree


def test_degree_in_some_variables() -> None:
    e = x**2 * y**3 * z
    assert Shadow((x,)).degree(e) == 2
    assert Shadow((y, z)).degree(e) == 4
    assert Shadow(()).degree(e) == 0


def test_points_tell_equal_from_different() -> None:
    p = Point("one")
    assert p.value((x + t) ** 2) == p.value(x**2 + 2 * x * t + t**2)
    assert p.value((x + t) ** 2) != p.value(x**2 + x * t + t**2)
    assert p.value(x * 3.5 + 0.1) != Point("two").value(x * 3.5 + 0.1)
    assert p.value(teg.sin(x + t)) == p.value(teg.sin(t + x))
    assert p.value(x / x - 1) == 0


def test_extremes_are_sizes_of_differences() -> None:
    """max(u, v) = (u + v + |u - v|)/2, however it is written."""
    u, v, point = x * t, y - a, Point()
    high, low = call("max", u, v), call("min", u, v)
    for e in (
        call("magnitude", u) - call("magnitude", -u),
        high - call("max", v, u),
        high + call("min", -u, -v),
        high + low - u - v,
        high - low - call("magnitude", v - u),
        call("max", u, 0 * t) - u + call("min", u, 0 * t),
    ):
        assert is_null(e), e
    assert point.value(call("magnitude", u)) not in (point.value(u), point.value(-u), 0)
    assert not is_null(call("magnitude", u) + call("magnitude", v) - call("magnitude", u + v))


@pytest.mark.parametrize(
    "e",
    [
        x * t + a / t - 2.5,
        (x - t) ** 3 * teg.sin(a) - x / (a * a + t),
        teg.where(t < a, x * t, x**2 - a),
        teg.where(x < a, x, t) * teg.exp(-t),
        teg.function("plane", [x, y], 3 * x + y * t)(x, a) + teg.function("wave", [x], teg.sin(x))(t),
        x * call("max", t, a) - call("min", t * a, b) + call("magnitude", a),
        x * (t - t) ** -2,
        teg.integral(teg.bracket(y < t) * y, (y, 0, a)) * x + t,
    ],
    ids=str,
)
def test_a_polynomial_at_the_point_is_the_value_there(e: teg.Expr) -> None:
    """Horner's rule in the field, at the random element that stands for the variable."""
    point, polynomial = Point(), Shadow((x,)).polynomial(e)
    assert polynomial is not None
    value, place = 0, point.value(x)
    assert place is not None
    for k in range(max(m[0] for m in polynomial), -1, -1):
        value = (value * place + polynomial.get((k,), 0)) % P
    assert value == point.value(e)
    assert {m: c for m, c in polynomial.items() if not 0 < c < P} == {}


def test_a_denominator_of_1_is_shared_without_harm() -> None:
    """A sum does not change the terms of its parts."""
    shadow = Shadow((x,))
    part = 1 / (x + t)
    before = shadow.of(part)
    assert before is not None
    kept = dict(before[0]), dict(before[1])
    shadow.of(Add.make(None, (ONE, part, x)))
    shadow.of(part + part * x + 1 / (x - a))
    assert shadow.of(part) == kept
