"""Where the pieces begin and end, and the degrees that give the number of nodes."""

from __future__ import annotations

from typing import Any

import mpmath
import pytest

import teg
from teg.analysis.breaks import BreakAnalysis
from teg.ir.integral import Integral
from teg.pipeline import normal_form
from teg.program import Adaptive, Gauss, Integrate, statements

x, y = teg.vars("x y")
t, a, b, c = teg.params("t a b c")


def breaks(e: teg.Expr) -> list[str]:
    assert isinstance(e, Integral)
    return [str(p) for p in BreakAnalysis().of(e).points]


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (teg.integral(teg.bracket(x < t), (x, 0, 1)), 1),
        (teg.integral(teg.bracket((x < t) & (x < a)), (x, 0, 1)), 2),
        (teg.integral(teg.bracket(x < t) * teg.bracket(2 * x < 2 * t), (x, 0, 1)), 1),
        (teg.integral(teg.abs(x - t), (x, 0, 1)), 1),
        (teg.integral(teg.bracket(x**2 < t), (x, -1, 1)), 2),
        (teg.integral(teg.exp(x), (x, 0, 1)), 0),
        (teg.integral(teg.bracket(t < a) * x, (x, 0, 1)), 0),
        (teg.integral(teg.bracket(x < 2), (x, 0, 1)), 0),
    ],
    ids=lambda v: str(v),
)
def test_the_inner_variable(e: teg.Expr, expected: int) -> None:
    assert len(breaks(e)) == expected


def rules(e: teg.Expr) -> list[object]:
    program = teg.compile(e).program(0)
    return [s.rule for s in statements(program.body) if isinstance(s, Integrate)]


def test_the_outer_variable_breaks_where_the_inner_picture_changes() -> None:
    inner = teg.integral(teg.bracket(a * x + b * y < c), (x, 0, 1))
    outer = teg.integral(inner, (y, 0, 1))
    assert isinstance(outer, Integral)
    found = BreakAnalysis().of(outer)
    assert found.complete
    assert len(found.points) == 2  # the line leaves the box at x = 0 and at x = 1
    at = {"a": 0.7, "b": 1.1, "c": 0.9}
    assert {round(float(teg.evaluate(p, at)), 12) for p in found.points} == {round(0.9 / 1.1, 12), round(0.2 / 1.1, 12)}


def test_two_lines_meet() -> None:
    inner = teg.integral(teg.bracket(x + y < t) * teg.bracket(x - y < a), (x, 0, 1))
    outer = teg.integral(inner, (y, 0, 1))
    assert isinstance(outer, Integral)
    points = {round(float(teg.evaluate(p, {"t": 0.8, "a": 0.3})), 12) for p in BreakAnalysis().of(outer).points}
    assert 0.25 in points  # y = (t - a)/2


def test_conditions_on_the_outer_variable_alone() -> None:
    e = teg.integral(teg.bracket(x < t) * teg.bracket(y < t), (x, 0, 1), (y, 0, 1))
    assert teg.evaluate(e, {t: 0.3}) == pytest.approx(0.09, rel=1e-15)


@pytest.mark.parametrize(
    ("e", "nodes"),
    [
        (teg.integral(teg.bracket(x < t), (x, 0, 1)), []),  # short polynomials have no rule: they are straight lines
        (teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), []),
        (teg.integral(teg.bracket(x < t) * x**2, (x, 0, 1)), []),
        (teg.integral(teg.bracket(x < t) * x**4, (x, 0, 1)), [3]),
        (teg.integral(teg.bracket(x < t) * x**5, (x, 0, 1)), [3]),
        (teg.integral(teg.bracket(x < t) * x**6, (x, 0, 1)), [4]),
        (teg.integral(teg.bracket(x + y < t) + teg.bracket(x > y), (x, 0, 1), (y, 0, 1)), []),  # clipped polygons
        (teg.integral(teg.sin(teg.bracket(x + y < t)), (x, 0, 1), (y, 0, 1)), [1]),  # the inner one has no rule: it is a straight line
        (teg.integral(teg.sin(teg.bracket(x + y < t)) * x, (x, 0, 1), (y, 0, 1)), [2]),
        (teg.integral(teg.sin(teg.bracket(x + y < t)) * x * y, (x, 0, 1), (y, 0, 1)), [2]),
        (teg.integral(teg.sin(teg.bracket(x + y < t)) * (x + 2 * y) ** 4, (x, 0, 1), (y, 0, 1)), [3, 3]),
    ],
    ids=lambda v: str(v),
)
def test_polynomials_get_the_nodes_they_need_and_no_more(e: teg.Expr, nodes: list[int]) -> None:
    found = rules(e)
    assert all(isinstance(r, Gauss) for r in found)
    assert [r.nodes for r in found if isinstance(r, Gauss)] == nodes


def test_what_is_no_polynomial_is_adaptive() -> None:
    for e in (
        teg.integral(teg.exp(x * x), (x, 0, 1)),
        teg.integral(teg.bracket(x * teg.sin(x) < t) * teg.sqrt(x + 2), (x, 0, 1)),
        teg.integral(1 / (x * x + 2), (x, 0, 1)),
    ):
        (rule,) = rules(e)
        assert isinstance(rule, Adaptive)


def test_a_square_root_end_is_smoothed() -> None:
    f = teg.compile(teg.integral(teg.sqrt(x), (x, 0, 1)))
    (loop,) = [s for s in statements(f.program(0).body) if isinstance(s, Integrate)]
    assert [b.kind for b in loop.bends] == ["root"]
    assert f() == pytest.approx(2 / 3, rel=1e-15)
    assert f.evaluations() == 8


def test_the_analysis_is_done_once() -> None:
    e = normal_form(teg.integral(teg.bracket(x + y < t), (x, 0, 1), (y, 0, 1)))
    assert isinstance(e, Integral)
    analysis = BreakAnalysis()
    assert analysis.of(e) is analysis.of(e)


@pytest.mark.parametrize("shift", [0.0, 512.0, 2.0**20])
def test_far_from_the_origin(shift: float) -> None:
    """A triangle of area 1e-3 at a distance keeps its digits: coefficients are taken at a local origin."""
    corners = [(0.25, 0.25), (0.3125, 0.25), (0.25, 0.28125)]
    ps = [teg.params(f"x{i} y{i}") for i in range(3)]
    inside: teg.Expr = teg.ir.expr.ONE
    for (px, py), (qx, qy) in zip(ps, [*ps[1:], ps[0]], strict=True):
        inside = inside * teg.bracket((qx - px) * (y - py) - (qy - py) * (x - px) > 0)
    e = teg.integral(inside, (x, shift, shift + 1), (y, shift, shift + 1))
    f = teg.compile(e, [p for pair in ps for p in pair])
    at = {p.name: v + shift for pair, corner in zip(ps, corners, strict=True) for p, v in zip(pair, corner, strict=True)}
    area, gradient = f.value_and_grad(at)
    assert area == pytest.approx(0.0625 * 0.03125 / 2, rel=1e-12)
    assert gradient["x1"] == pytest.approx(0.03125 / 2, rel=1e-9 if shift > 1e5 else 1e-12)
    assert gradient["y2"] == pytest.approx(0.0625 / 2, rel=1e-9 if shift > 1e5 else 1e-12)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize(
    "level",
    [
        lambda c, d, e: c * x + d * y,
        lambda c, d, e: c * x + d * y**2,
        lambda c, d, e: c * x + d * teg.exp(y),
        lambda c, d, e: c * x + d * y + (e - 1) * y**2,
        lambda c, d, e: c * x + d * (y * y + y) + d * teg.abs(y - 0.3),
    ],
)
@pytest.mark.parametrize("zero", [0.0, 1e-200])
def test_a_line_that_does_not_depend_on_the_inner_variable(backend: str, level: Any, zero: float) -> None:
    """d = 0 makes it a border of the outer variable: the curve is followed from x = 0 to s/c only."""
    c, d, e, s, r = teg.params("c d e s r")
    curve = teg.bracket(x**3 + y**2 < r) * teg.bracket(level(c, d, e) < s)
    f = teg.compile(teg.integral(curve, (x, 0, 1), (y, 0, 1)), [r], backend=backend)
    given = {name: v for name, v in {"c": 0.75, "d": zero, "e": 1.0, "s": 0.26, "r": 0.6}.items() if name in f.parameters}
    exact = float(mpmath.quad(lambda at: 1 / (2 * mpmath.sqrt(mpmath.mpf("0.6") - at**3)), [0, 0.26 / 0.75]))
    assert f.grad(given)["r"] == pytest.approx(exact, rel=1e-9)
