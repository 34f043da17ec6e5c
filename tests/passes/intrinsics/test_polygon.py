"""Which integrals are clipped polygons and segments, and what becomes of them in a program."""

from __future__ import annotations

import pytest

import teg
from teg import Expr
from teg.analysis.settings import Integration
from teg.ir.integral import Integral
from teg.numerics.quadrature import triangle_rule
from teg.passes.intrinsics.polygon.match import match_box, match_clipped, match_segment
from teg.passes.program.sink import sink
from teg.pipeline import normal_form, program_for
from teg.program import Assign, Integrate, Polygon, Polyhedron, Segment, blocks, size, statements
from tests.bench.scenes import half_planes, triangle_pixel

x, y = teg.vars("x y")
a, b, t = teg.params("a b t")
HALF = a * x + b * y < t


def nest_of(e: Expr, *bounds: tuple[object, ...]) -> Integral:
    found = normal_form(teg.integral(e, *(bounds or ((x, 0, 1), (y, 0, 1)))))
    assert isinstance(found, Integral)
    return found


def kinds_of(e: Expr, orders: int = 0, **options: object) -> list[type]:
    f = teg.compile(e, backend="numpy", **options)
    return [type(s) for s in statements(f.program(orders).body) if not isinstance(s, Assign)]


@pytest.mark.parametrize(
    ("integrand", "degree", "halves"),
    [
        (teg.bracket(HALF), 0, 1),
        (teg.bracket(HALF & (x < y)) * x * y**2, 3, 2),
        (teg.bracket(HALF) * (x / (x + y + 1 - (x + y)) + teg.sin(t)), 1, 1),
        (teg.where(HALF, 0, x), 1, 1),
        (teg.bracket(~(x + y < t) & (x < a) & (y <= b)) * teg.where(t > 0, x, y), 1, 3),
    ],
    ids=["area", "two", "normalised", "negated", "closed"],
)
def test_polynomials_times_half_planes_match(integrand: Expr, degree: int, halves: int) -> None:
    found = match_box(nest_of(integrand))
    assert found is not None
    assert (found.degree, len(found.halves)) == (degree, halves)


@pytest.mark.parametrize(
    ("integrand", "bounds"),
    [
        (teg.bracket(HALF) * teg.exp(x), ()),
        (teg.bracket(x * y < t), ()),
        (teg.bracket(HALF) * teg.abs(x - y), ()),
        (teg.bracket(HALF), ((x, 0, y), (y, 0, 1))),
        (teg.bracket(HALF), ((x, 0, teg.ir.expr.const(float("inf"))), (y, 0, 1))),
        (teg.where(HALF, 1, x), ()),
        (teg.bracket((x < t) | (y < t)), ()),
        (x * y, ()),
    ],
    ids=["exp", "bilinear", "kink", "bound", "infinite", "two branches", "or", "no condition"],
)
def test_what_is_none(integrand: Expr, bounds: tuple[tuple[object, ...], ...]) -> None:
    e = normal_form(teg.integral(integrand, *(bounds or ((x, 0, 1), (y, 0, 1)))))
    assert not isinstance(e, Integral) or match_box(e) is None


@pytest.mark.parametrize(
    "how",
    [Integration(rule="adaptive"), Integration(rule="gauss"), Integration(order=8), Integration(intrinsics=False)],
    ids=["adaptive", "gauss", "order", "off"],
)
def test_a_rule_that_is_asked_for_is_taken(how: Integration) -> None:
    e = nest_of(teg.bracket(HALF))
    assert match_clipped(e) is not None
    assert [type(s) for s in program_for([e], ["a", "b", "t"], Integration()).body if not isinstance(s, Assign)] == [Polygon]
    assert not any(isinstance(s, Polygon | Segment) for s in statements(program_for([e], ["a", "b", "t"], how).body))


def test_an_ordinary_interval_is_no_segment() -> None:
    assert match_segment(nest_of(teg.bracket(x < t) * x, (x, 0, 1))) is None


def test_a_triangle_is_one_polygon_and_its_gradient_three_segments_more() -> None:
    for order in (0, 1, 2):
        e, wrt = triangle_pixel(order)
        f = teg.compile(e, wrt, backend="numpy")
        kinds = [type(s) for s in statements(f.program(1).body) if not isinstance(s, Assign)]
        assert kinds == [Polygon, Segment, Segment, Segment]
        (polygon, *segments) = [s for s in statements(f.program(1).body) if isinstance(s, Polygon | Segment)]
        assert isinstance(polygon, Polygon)
        assert polygon.degree == 2 * order
        assert len(polygon.results) == 1 + (len(wrt) - 6) + (6 if order else 0) if order else len(polygon.results) == 2
        assert all(isinstance(s, Segment) and len(s.half_lines) == 4 and len(s.results) == 4 for s in segments)


def test_no_division_at_the_nodes() -> None:
    """The area, a sum of barycentric coordinates, is known to be a constant, and divided by once."""
    e, wrt = triangle_pixel(2)
    for s in statements(teg.compile(e, wrt, backend="numpy").program(1).body):
        if isinstance(s, Polygon | Segment):
            assert {inner.op for inner in s.body if isinstance(inner, Assign)} <= {"add", "sub", "mul", "neg", "powi"}


def test_what_one_polygon_uses_is_computed_inside() -> None:
    e, wrt = triangle_pixel(1)
    program = teg.compile(e, wrt, backend="numpy").program(1)
    assert sink(program) == program
    clipped = [s for s in statements(program.body) if isinstance(s, Polygon | Segment)]
    within = {id(inner) for s in clipped for block in blocks(s) for inner in statements(block)}
    outside = {s.name for s in statements(program.body) if isinstance(s, Assign) and id(s) not in within}
    assert len(clipped) == 4
    for s in clipped:
        if isinstance(s, Polygon | Segment):
            assert s.setup
            assert not outside & {inner.name for inner in s.setup if isinstance(inner, Assign)}
        if isinstance(s, Segment):
            assert s.scales


def test_a_product_of_half_planes_is_linear() -> None:
    counts = [size(teg.compile(half_planes(n)[0], backend="numpy").program(0)) for n in (8, 16, 32)]
    assert counts[2] - counts[1] <= 2.05 * (counts[1] - counts[0])


def test_too_many_half_planes_are_integrated_piece_by_piece() -> None:
    many = teg.bracket(x + y < t)
    for i in range(70):
        many = many * teg.bracket(x < a + i)
    assert match_box(nest_of(many)) is None


def test_mixed_programs_keep_their_other_integrals() -> None:
    z = teg.var("z")
    kinds = kinds_of(teg.integral(teg.bracket(x + y + z < t), (x, 0, 1), (y, 0, 1), (z, 0, 1)))
    assert kinds == [Polyhedron]
    prism = teg.integral(teg.bracket(x + y < t) * z, (x, 0, 1), (y, 0, 1), (z, 0, 1))
    assert Polyhedron not in kinds_of(prism)
    assert kinds_of(teg.integral(teg.bracket(x + y + z < t) * teg.exp(z), (x, 0, 1), (y, 0, 1), (z, 0, 1))) == [Integrate, Polygon]
    assert kinds_of(teg.integral(teg.bracket(HALF) * teg.exp(x * x), (x, 0, 1), (y, 0, 1))) == [Integrate, Integrate]


def test_the_explanation_says_so() -> None:
    e, wrt = triangle_pixel(1)
    data = teg.explain(e, wrt).data
    (value,) = data["integrals"]
    assert (value["rule"], value["nodes"], value["degree"], value["pieces"]) == ("clipped polygon", 3, 2, 5)
    assert {i["rule"] for i in data["boundary"]} == {"clipped interval"}


@pytest.mark.parametrize("degree", range(15))
def test_triangle_rules_are_exact(degree: int) -> None:
    """∫ rⁱsʲ over the triangle is i!j!/(i + j + 2)!; weights add up to 1 and none is negative."""
    from math import factorial

    rule = triangle_rule(degree)
    assert min(w for _, _, w in rule) > 0
    for i in range(degree + 1):
        for j in range(degree + 1 - i):
            exact = 2 * factorial(i) * factorial(j) / factorial(i + j + 2)
            assert sum(w * r**i * s**j for r, s, w in rule) == pytest.approx(exact, rel=1e-14, abs=1e-15)
