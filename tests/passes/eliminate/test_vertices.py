"""Sides of polygons and triangles by their vertices: what is found, what it is written as, and what becomes of boundary terms."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.ir.expr import And, Compare, Cond, Const, Expr, Not
from teg.ir.integral import Integral
from teg.ir.simplify import conjunction
from teg.ir.traverse import fresh
from teg.passes.eliminate.barycentric import Along, Inside
from teg.passes.eliminate.vertices import match_side, match_triangle
from teg.program import Polygon, Segment, statements
from tests.bench.scenes import half_planes, triangle_pixel

x, y = teg.vars("x y")
PX, PY = teg.params("x0 x1 x2 x3"), teg.params("y0 y1 y2 y3")
K, M = teg.params("k m")


def edge(i: int, j: int) -> Expr:
    """Positive to the left of the way from vertex i to vertex j."""
    return (PX[j] - PX[i]) * (y - PY[i]) - (PY[j] - PY[i]) * (x - PX[i])


def polygon(n: int) -> Cond:
    """Inside of a counterclockwise n-gon."""
    return conjunction(*(edge(i, (i + 1) % n) > 0 for i in range(n)))


def halves(condition: Cond) -> list[tuple[Expr, bool]]:
    parts = condition.children if isinstance(condition, And) else (condition,)
    atoms = [(c.operand, True) if isinstance(c, Not) else (c, False) for c in parts]
    return [(a.g, negated) for a, negated in atoms if isinstance(a, Compare)]


def test_a_side_of_a_triangle_runs_from_vertex_to_vertex() -> None:
    side = match_side(edge(0, 1), polygon(3), (x, y))
    assert side is not None
    assert side.whole
    assert {side.start, side.end} == {(PX[0], PY[0]), (PX[1], PY[1])}
    assert isinstance(side.weight, Const)
    assert side.weight.data == 1.0


def test_a_side_that_is_scaled_has_a_weight() -> None:
    side = match_side(4 * edge(0, 1), conjunction(4 * edge(0, 1) > 0, edge(1, 2) > 0, edge(2, 0) > 0), (x, y))
    assert side is not None
    assert isinstance(side.weight, Const)
    assert side.weight.data == 0.25


def test_boundary_terms_along_sides_that_are_scaled() -> None:
    """Sides y < y₀ + (y₁ - y₀)/(x₁ - x₀)·(x - x₀); by a vertex the area has half of the opposite side, turned, as its derivative."""

    def above(i: int, j: int) -> Expr:
        return y - PY[i] - (PY[j] - PY[i]) / (PX[j] - PX[i]) * (x - PX[i])

    inside = (above(0, 1) > 0) & (above(1, 2) < 0) & (above(2, 0) < 0)
    f = teg.compile(teg.integral(teg.bracket(inside), (x, 0, 1), (y, 0, 1)), [PX[2], PY[2]], backend="numpy", intrinsics=False)
    gradient = f.grad(x0=0.1, y0=0.2, x1=0.9, y1=0.3, x2=0.4, y2=0.8)
    assert gradient["x2"] == pytest.approx((0.2 - 0.3) / 2, rel=1e-12)
    assert gradient["y2"] == pytest.approx((0.9 - 0.1) / 2, rel=1e-12)


def test_of_more_sides_the_reach_is_decided_at_run_time() -> None:
    side = match_side(edge(0, 1), polygon(4), (x, y))
    assert side is not None
    assert not side.whole
    assert side.beyond
    assert side.before


def test_the_other_end_is_found_by_the_direction() -> None:
    """Both sides through vertex 0 are written from it: vertices 1 and 2 are compared with nothing, but for the third side."""
    one, two, third = edge(0, 1), edge(0, 2), edge(1, 2)
    side = match_side(one, conjunction(one > 0, ~(two > 0), third > 0), (x, y))
    assert side is not None
    assert side.whole
    assert match_triangle(halves(conjunction(one > 0, ~(two > 0), third > 0)), (x, y)) is not None


@pytest.mark.parametrize(
    "condition",
    [edge(0, 1) > 0, (edge(0, 1) > 0) & (K * x + M * y > 1), (edge(0, 1) > 0) & (x * y > K)],
    ids=["alone", "another line", "a curve"],
)
def test_what_is_no_side(condition: Cond) -> None:
    assert match_side(edge(0, 1), condition, (x, y)) is None


def test_what_is_no_triangle() -> None:
    assert match_triangle(halves(polygon(4)), (x, y)) is None
    assert match_triangle(halves(conjunction(edge(0, 1) > 0, edge(1, 2) > 0, ~(edge(2, 0) > 0))), (x, y)) is None
    e, _ = half_planes(3)
    assert isinstance(e, Integral)


def test_barycentric_coordinates_on_a_side() -> None:
    side = match_side(edge(0, 1), polygon(3), (x, y))
    assert side is not None
    s = fresh("s", (x, y))
    at = dict(zip((x, y), side.at(s), strict=True))
    along, area = Along(side, s), edge(0, 1) + edge(1, 2) + edge(2, 0)
    shown = {along.simplified(teg.ir.traverse.substitute(e / area, at)) for e in (edge(0, 1), edge(1, 2), edge(2, 0))}  # type: ignore[arg-type]
    assert shown == {teg.ir.expr.ZERO, s, 1 - s}


def test_barycentric_coordinates_in_a_triangle() -> None:
    triangle = match_triangle(halves(polygon(3)), (x, y))
    assert triangle is not None
    one, two = fresh("a", (x, y)), fresh("b", (x, y))
    inside, area = Inside(triangle, (x, y), (one, two)), edge(0, 1) + edge(1, 2) + edge(2, 0)
    shown = {inside.simplified(e / area) for e in (edge(0, 1), edge(1, 2), edge(2, 0))}
    assert shown == {1 - one - two, one, two}


def test_segments_of_a_triangle_have_only_the_sides_of_the_box_to_be_cut_by() -> None:
    for order in (0, 1, 2):
        e, wrt = triangle_pixel(order)
        program = teg.compile(e, wrt, backend="numpy").program(1)
        assert [len(s.half_lines) for s in statements(program.body) if isinstance(s, Segment)] == [4, 4, 4]
        (area,) = [s for s in statements(program.body) if isinstance(s, Polygon)]
        assert len(area.corners) == (3 if order else 0)


def colour() -> Expr:
    return 2 + x - 3 * y


def compiled(condition: Cond, integrand: Expr, backend: str) -> teg.Evaluator:
    e = teg.integral(teg.bracket(condition) * integrand, (x, 0, 1), (y, 0, 1))
    return teg.compile(e, [*PX[:3], *PY[:3]], backend=backend)


def at(points: np.ndarray) -> dict[str, np.ndarray]:
    """The parameters for vertices (n, 3, 2)."""
    return {f"{'xy'[j]}{i}": points[:, i, j].copy() for i in range(points.shape[1]) for j in range(2)}


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_triangle_without_an_area_has_the_mean_of_both_sides(backend: str) -> None:
    """Moved one way its area is nothing, moved the other way it grows: half of the derivative there."""
    f, rng = compiled(polygon(3), colour(), backend), np.random.default_rng(3)
    ends = rng.uniform(-0.5, 1.5, (40, 2, 2)).round(2)
    points = np.stack([ends[:, 0], ends[:, 1], 0.5 * (ends[:, 0] + ends[:, 1])], axis=1)[:, rng.permutation(3)]
    turned = np.stack([points[:, (i + 1) % 3] - points[:, (i + 2) % 3] for i in range(3)], axis=1)[..., ::-1] * np.array([1.0, -1.0])
    here, beside = f.grad(at(points)), f.grad(at(points + 1e-8 * turned))
    for name, slope in here.items():
        np.testing.assert_allclose(slope, 0.5 * beside[name], atol=1e-6)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_polygons_that_are_not_convex_are_intersections_still(backend: str) -> None:
    """Where neighbouring sides turn the other way the support goes on beyond the vertices."""
    e = teg.integral(teg.bracket(polygon(4)) * colour(), (x, 0, 1), (y, 0, 1))
    f, rng = teg.compile(e, [*PX, *PY], backend=backend), np.random.default_rng(4)
    places, ways = at(rng.uniform(-0.5, 1.5, (400, 4, 2))), at(rng.standard_normal((400, 4, 2)))
    slopes = f.grad(places)
    ahead, behind = (f({k: v + h * ways[k] for k, v in places.items()}) for h in (1e-6, -1e-6))
    assert np.count_nonzero(ahead) > 50
    np.testing.assert_allclose(sum(slopes[k] * way for k, way in ways.items()), (ahead - behind) / 2e-6, atol=1e-7)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize(
    ("condition", "integrand"),
    [
        (~(edge(0, 1) <= 0) & ~(edge(1, 2) < 0) & (edge(2, 0) > 0), colour()),
        ((edge(0, 1) < 0) & (edge(1, 2) < 0) & (edge(2, 0) < 0), colour() ** 2),
        ((edge(0, 1) > 0) & (edge(0, 2) < 0) & (edge(2, 1) <= 0), edge(0, 1) / (edge(0, 1) + edge(1, 2) + edge(2, 0))),
        (polygon(3) & (x + 2 * y < 1.5), (edge(0, 1) / (edge(0, 1) + edge(1, 2) + edge(2, 0))) ** 2 * x),
        (polygon(3), teg.exp(x * y)),
    ],
    ids=["negated", "clockwise", "written backwards", "cut once more", "no polynomial"],
)
def test_values_and_gradients_are_those_of_another_rule(condition: Cond, integrand: Expr, backend: str) -> None:
    rng = np.random.default_rng(5)
    corners = rng.uniform(-0.5, 1.5, (120, 3, 2))
    share = rng.uniform(0, 1, (60, 1))
    corners[::2, 2] = share * corners[::2, 0] + (1 - share) * corners[::2, 1] + 1e-4 * rng.standard_normal((60, 2))  # thin ones
    e = teg.integral(teg.bracket(condition) * integrand, (x, 0, 1), (y, 0, 1))
    places, wrt = at(corners), [*PX[:3], *PY[:3]]
    value, slopes = teg.compile(e, wrt, backend=backend).value_and_grad(places)
    expected, others = teg.compile(e, wrt, backend="c", rule="gauss", order=12).value_and_grad(places)
    assert np.count_nonzero(expected) > 20
    np.testing.assert_allclose(value, expected, atol=1e-12)
    for name, slope in others.items():
        np.testing.assert_allclose(slopes[name], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max())
