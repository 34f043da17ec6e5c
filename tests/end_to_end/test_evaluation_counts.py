"""How many evaluations of the integrand a call takes, pinned: no more than the scene needs."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest

import teg
from teg import Expr
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program import Gauss, Integrate, statements

x, y, z = teg.vars("x y z")
a, b, r, t = teg.params("a b r t")
BACKENDS = ("numpy", "c")
FIRST, INNER_FIRST, OUTER_FIRST, ORDER = 8, 10, 10, 16
"""Nodes of the adaptive rule at the default tolerance: of its first look at an innermost piece and at an outer one, and after that."""


@dataclass(frozen=True)
class Scene:
    """A program, where, and how many evaluations its value takes."""

    name: str
    program: Expr
    at: dict[str, float]
    evaluations: int


def over_square(f: Expr) -> Expr:
    return teg.integral(f, (x, 0, 1), (y, 0, 1))


def disk(cx: object, cy: object, radius: object) -> Expr:
    return (x - cx) ** 2 + (y - cy) ** 2 < radius * radius


def triangle() -> tuple[Expr, dict[str, float]]:
    """A triangle whose corners are parameters, on a horizontal base: one piece in y."""
    corners = [teg.params(f"x{i} y{i}") for i in range(3)]
    inside = teg.ir.expr.TRUE
    for (px, py), (qx, qy) in zip(corners, [*corners[1:], corners[0]], strict=True):
        inside = inside & ((qx - px) * (y - py) - (qy - py) * (x - px) > 0)
    places = ((0.1, 0.2), (0.9, 0.2), (0.4, 0.8))
    at = {p.name: v for corner, place in zip(corners, places, strict=True) for p, v in zip(corner, place, strict=True)}
    return teg.bracket(inside), at


TRIANGLE, CORNERS = triangle()
EXP_COS = teg.exp(x) * teg.cos(y)
NO_FORM = teg.exp(x / 2) * teg.cos(x / 2) * teg.cos(x / 3)
"""No antiderivative of it is known."""
SCENES = (
    # the integrand is 1 on what is left of the square
    Scene("half-plane", over_square(teg.bracket(x + a * y < t)), {"a": 0.5, "t": 0.8}, 1 * 1),
    # inside of the square it is one triangle: the middle of it
    Scene("triangle, linear colour", over_square(TRIANGLE * (1 + 2 * x - y)), CORNERS, 1),
    # the middles of its sides
    Scene("triangle, quadratic colour", over_square(TRIANGLE * (1 + x * x - y * y)), CORNERS, 3),
    # covered: rows in 10 nodes, in closed form on each of them, though x stands in both factors
    Scene(
        "half-plane, exp(x)·cos(x)",
        over_square(teg.bracket(x + a * y < t) * teg.exp(x) * teg.cos(x)),
        {"a": 0.5, "t": 9.0},
        OUTER_FIRST,
    ),
    # covered, without a closed form: one look at one piece in each variable
    Scene(
        "half-plane, exp(sin)",
        over_square(teg.bracket(x + a * y < t) * teg.exp(teg.sin(x / 2 + y / 2))),
        {"a": 0.5, "t": 9.0},
        12 * INNER_FIRST,
    ),
    # moments of its chords and arcs
    Scene("disk", over_square(teg.bracket(disk(a, b, r))), {"a": 0.47, "b": 0.53, "r": 0.3}, 0),
    # y = b + r·sin u makes the chord 2r·cos u, times r·cos u: not a polynomial, 10 nodes are too few for 1e-10, 16 are enough;
    # on each row exp is integrated in closed form
    Scene("disk, exp·cos", over_square(teg.bracket(disk(a, b, r)) * EXP_COS), {"a": 0.47, "b": 0.53, "r": 0.2}, OUTER_FIRST + ORDER),
    # rows of an adaptive integral: 12 nodes for the first look, on each of them 10
    Scene(
        "disk, an exponential and two waves",
        over_square(teg.bracket(disk(a, b, r)) * NO_FORM),
        {"a": 0.47, "b": 0.53, "r": 0.05},
        (12 + ORDER) * INNER_FIRST,
    ),
    # between the two corners, where the chord ends at one arc on either side: one piece, as for the disk; beside it two pieces on which
    # both chords are there, but apart, are looked at once; their ends are neighbours, so halves are looked at
    Scene("lens", over_square(teg.bracket(disk(0.4, 0.5, r) & disk(a, 0.5, r))), {"a": 0.6, "r": 0.25}, 3 * OUTER_FIRST + 3 * ORDER),
    # in closed form: no integrand is evaluated
    Scene("hyperbola", over_square(teg.bracket(x * y > t)), {"t": 0.25}, 0),
    # no row is needed at all
    Scene("empty", over_square(teg.bracket(disk(a, b, r)) * EXP_COS), {"a": 3.0, "b": 0.5, "r": 0.6}, 0),
    # what is no polynomial for other parameters: one look at the one piece
    Scene("full cover", over_square(teg.bracket(disk(a, b, r)) * EXP_COS), {"a": 0.5, "b": 0.5, "r": 2.0}, OUTER_FIRST),
    # a clipped polyhedron: its volume
    Scene(
        "half-space",
        teg.integral(teg.bracket(x + a * y + b * z < t), (x, 0, 1), (y, 0, 1), (z, 0, 1)),
        {"a": 0.5, "b": 0.25, "t": 0.8},
        1,
    ),
)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("scene", SCENES, ids=lambda s: s.name)
def test_the_counts_of_ten_scenes(scene: Scene, backend: str) -> None:
    assert teg.compile(scene.program, backend=backend).evaluations(scene.at) == scene.evaluations


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("degree", range(4))
def test_a_polynomial_on_one_interval_is_arithmetic(degree: int, backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket((x < t) & (x > a)) * x**degree, (x, 0, 1)), [t, a], backend=backend)
    assert not any(isinstance(s, Integrate) for s in statements(f.program(1).body))
    value, slopes = f.value_and_grad(t=0.7, a=0.2)
    assert value == pytest.approx((0.7 ** (degree + 1) - 0.2 ** (degree + 1)) / (degree + 1), rel=1e-15)
    assert slopes == {"t": pytest.approx(0.7**degree, rel=1e-15), "a": pytest.approx(-(0.2**degree), rel=1e-15)}


def test_an_annulus_in_a_half_plane() -> None:
    """Three pieces of rows: beside the hole, and below and above it; 26 evaluations each would do, and two of them take the first look only
    where their bends are far. At most 8 more are spent on breaks that turn out to be none."""
    ring = disk(0.5, 0.5, r) & ~disk(0.5, 0.5, r / 2) & (x < t)
    counts = [teg.compile(over_square(teg.bracket(ring)), backend=backend).evaluations(t=0.5, r=0.3) for backend in BACKENDS]
    assert counts[0] == counts[1]
    assert 3 * OUTER_FIRST <= counts[0] <= 3 * (OUTER_FIRST + ORDER) + 8


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("degree", range(9))
def test_exact_rules_use_the_fewest_nodes(degree: int, backend: str) -> None:
    """⌈(degree + 1)/2⌉ nodes in one variable; with a slanted edge two triangles are left of the square, and of piecewise rules the outer
    degree is that of the integrand and 1 more."""
    nodes = degree // 2 + 1
    one = teg.compile(teg.integral(teg.bracket(x < t) * x**degree, (x, 0, 1)), backend=backend, intrinsics=False)
    assert one.evaluations(t=0.7) == nodes
    assert one(t=0.7) == pytest.approx(0.7 ** (degree + 1) / (degree + 1), rel=1e-14)
    two = teg.compile(over_square(teg.bracket(x + a * y < t) * x**degree), backend=backend)
    assert two.evaluations(a=0.3, t=0.7) == (2 * len(triangle_rule(degree)) if degree else 1)
    pieces = teg.compile(over_square(teg.bracket(x + a * y < t) * x**degree), backend=backend, rule="gauss")
    assert pieces.evaluations(a=0.3, t=0.7) == nodes * ((degree + 1) // 2 + 1)
    exact = (0.7 ** (degree + 2) - 0.4 ** (degree + 2)) / (0.3 * (degree + 1) * (degree + 2))
    assert two(a=0.3, t=0.7) == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize("degree", range(2, 12))
def test_one_node_fewer_is_not_exact(degree: int) -> None:
    (loop,) = [
        s
        for s in statements(teg.compile(teg.integral(teg.bracket(x < t) * x**degree, (x, -1, 1)), [t], intrinsics=False).program(0).body)
        if isinstance(s, Integrate)
    ]
    assert isinstance(loop.rule, Gauss)

    def moment(nodes: int) -> float:
        """∫₋₁¹ xᵈ dx, d even: the degree of the integrand, or the even one below that needs as many nodes."""
        at, weights = (np.array(column) for column in gauss_legendre(nodes))
        return float(weights @ at ** (degree - degree % 2))

    exact = float(Fraction(2, degree - degree % 2 + 1))
    assert moment(loop.rule.nodes) == pytest.approx(exact, rel=1e-14)
    assert abs(moment(loop.rule.nodes - 1) - exact) > 1e-4


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("twice", "once"),
    [
        (teg.bracket(x < t) * teg.bracket(2 * x < 2 * t), teg.bracket(x < t)),
        (teg.bracket(x < t) * teg.bracket(t > x) * teg.bracket(~(3 * t <= 3 * x)), teg.bracket(x < t)),
        (teg.bracket(x < t) + teg.bracket(-2 * x > -2 * t), 2 * teg.bracket(x < t)),
    ],
    ids=["product", "three", "sum"],
)
def test_identical_breaks_merge(twice: Expr, once: Expr, backend: str) -> None:
    for weight in (teg.ir.expr.ONE, NO_FORM):
        programs = [teg.integral(f * weight, (x, 0, 1)) for f in (twice, once)]
        counts = [teg.compile(e, backend=backend, intrinsics=False).evaluations(t=0.5) for e in programs]
        assert counts[0] == counts[1] == (1 if weight is teg.ir.expr.ONE else FIRST)


@pytest.mark.parametrize("backend", BACKENDS)
def test_different_breaks_of_equal_values_make_no_piece(backend: str) -> None:
    """At t = a the interval between the two breaks is empty, and costs nothing; nor do breaks outside of the bounds."""
    falling, rising = teg.exp(-x / 2) * teg.cos(x / 2) ** 2, teg.exp(0.9 * x) * teg.sin(0.9 * x) ** 2
    f = teg.compile(
        teg.integral(teg.where(x < t, NO_FORM, teg.where(x < a, falling, rising)), (x, 0, 1)),
        backend=backend,
    )
    assert f.evaluations(t=0.5, a=0.6) == 3 * FIRST
    assert f.evaluations(t=0.5, a=0.5) == 2 * FIRST
    assert f.evaluations(t=0.5, a=3.0) == 2 * FIRST
    assert f.evaluations(t=0.3, a=0.1) == 3 * FIRST  # though the break at a is none here
    assert f.evaluations(t=-1.0, a=-2.0) == 3 * FIRST  # exp·sin² over (0, 1) needs more nodes


def test_counts_of_a_batch_add_up_in_both_backends() -> None:
    scene = over_square(teg.bracket(disk(a, b, r) & (x + a * y < t)) * EXP_COS)
    rng = np.random.default_rng(3)
    at = {"a": rng.uniform(0, 1, 12), "b": rng.uniform(0, 1, 12), "r": rng.uniform(0.05, 1, 12), "t": rng.uniform(-0.2, 1.5, 12)}
    by = {name: teg.compile(scene, backend=name) for name in BACKENDS}
    for orders in (0, 1):
        one_by_one = [by["c"].evaluations({k: v[i] for k, v in at.items()}, derivatives=orders) for i in range(12)]
        assert by["c"].evaluations(at, derivatives=orders) == sum(one_by_one)
        assert by["numpy"].evaluations(at, derivatives=orders) == sum(one_by_one)


def test_more_is_asked_for_more_is_done() -> None:
    e = over_square(teg.bracket(disk(a, b, r)) * EXP_COS)
    at = {"a": 0.47, "b": 0.53, "r": 0.3}
    counts = [teg.compile(e, tol=tol, backend="c").evaluations(at) for tol in (1e-4, 1e-7, 1e-10, 1e-13)]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]
