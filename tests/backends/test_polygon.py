"""Clipped polygons and segments in the backends: against pieces, at degenerate places, and what is not a number."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import teg
from teg import Expr
from teg.ir.expr import Param
from tests.bench.scenes import triangle_pixel

x, y = teg.vars("x y")
BACKENDS = ("numpy", "c")
KINDS = json.loads((Path(__file__).parent / "triangle_kinds.json").read_text(encoding="utf-8"))
COLOUR = (lambda: 1 + 0 * x, lambda: 2 + x - 3 * y, lambda: x * x - x * y + 1, lambda: (x + 2 * y) ** 5)
WITHIN = 1e-10


def n_gon(n: int, colour: Expr) -> tuple[Expr, list[Param]]:
    """∫∫ over a box of the inside of a counterclockwise n-gon times a colour, and its corners."""
    px, py = [teg.param(f"x{i}") for i in range(n)], [teg.param(f"y{i}") for i in range(n)]
    inside = teg.ir.expr.TRUE
    for i in range(n):
        j = (i + 1) % n
        inside = inside & ((px[j] - px[i]) * (y - py[i]) - (py[j] - py[i]) * (x - px[i]) > 0)
    left, right, bottom, top = teg.params("left right bottom top")
    return teg.integral(teg.bracket(inside) * colour, (x, left, right), (y, bottom, top)), [*px, *py]


def places(n: int, count: int, seed: int = 3) -> dict[str, np.ndarray]:
    """Convex n-gons around the unit box or through it, and the box."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, (count, n)), axis=1)
    centre, radius = rng.uniform(0, 1, (count, 2)), rng.uniform(0.2, 1.2, (count, 1))
    at = {f"x{i}": centre[:, 0] + radius[:, 0] * np.cos(angle[:, i]) for i in range(n)}
    at |= {f"y{i}": centre[:, 1] + radius[:, 0] * np.sin(angle[:, i]) for i in range(n)}
    return at | {"left": np.zeros(count), "right": np.ones(count), "bottom": np.zeros(count), "top": np.ones(count)}


def same(one: Any, other: Any, tol: float = 1e-11) -> None:
    """Equal up to rounding, relative to the largest of a kind."""
    for key in one:
        np.testing.assert_allclose(one[key], other[key], rtol=tol, atol=tol * max(1.0, float(np.abs(other[key]).max())))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("n", [3, 6])
def test_values_and_gradients_are_those_of_pieces(n: int, degree: int, backend: str) -> None:
    e, wrt = n_gon(n, COLOUR[degree]())
    at = places(n, 60)
    value, gradient = teg.compile(e, wrt, backend=backend).value_and_grad(at)
    expected, slopes = teg.compile(e, wrt, backend="c", rule="gauss", order=8).value_and_grad(at)
    np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-13)
    same(gradient, slopes)


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_hessians_are_those_of_pieces(backend: str) -> None:
    e, wrt = n_gon(3, COLOUR[1]())
    at = places(3, 20)
    same(teg.compile(e, wrt, backend=backend).hessian(at), teg.compile(e, wrt, backend="numpy", rule="gauss", order=6).hessian(at), 1e-9)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("backend", BACKENDS)
def test_twelve_kinds_of_configuration(order: int, backend: str) -> None:
    """Slivers, coincident edges, vertices on corners, large coordinates: the values of 60 digits, relative to the larger of them and 1."""
    e, wrt = triangle_pixel(order)
    f = teg.compile(e, wrt, backend=backend)
    for case in (c for c in KINDS if c["order"] == order):
        v, colours = case["vertices"], case["colours"]
        at = {f"x{i}": v[2 * i] for i in range(3)} | {f"y{i}": v[2 * i + 1] for i in range(3)}
        at |= dict(zip(("left", "right", "bottom", "top"), case["box"], strict=True)) | {f"t{k}": case["target"][k] for k in range(3)}
        at |= {f"c{i}" if order == 0 else f"c{i // 3}{i % 3}": c for i, c in enumerate(colours)}
        value, gradient = f.value_and_grad(at)
        expected = np.array(case["expected"])
        found = np.array([value, *(gradient[p.name] for p in wrt)])
        tol = 1e-10 if case["kind"] == "thin 1e-6" else 1e-12
        assert abs(found[0] - expected[0]) <= 1e-13 * max(1.0, abs(expected[0])), case["kind"]
        assert np.abs(found - expected).max() <= tol * max(1.0, np.abs(expected).max()), case["kind"]


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_reversed_box_has_the_opposite_sign(backend: str) -> None:
    e, wrt = n_gon(3, COLOUR[2]())
    f, at = teg.compile(e, wrt, backend=backend), places(3, 30)
    value, gradient = f.value_and_grad(at)
    for swapped, sign in (({"left": at["right"], "right": at["left"]}, -1), ({"bottom": at["top"], "top": at["bottom"]}, -1)):
        other, slopes = f.value_and_grad(at | swapped)
        np.testing.assert_allclose(other, sign * value, rtol=1e-12, atol=1e-14)
        same({k: sign * v for k, v in slopes.items()}, gradient)


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_inside_is_exactly_nothing(backend: str) -> None:
    e, wrt = triangle_pixel(1)
    f = teg.compile(e, wrt, backend=backend)
    away = {p.name: 0.5 for p in wrt} | {"t0": 0.1, "t1": 0.2, "t2": 0.3, "left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0}
    for corners in (((2, 2), (3, 2), (2, 3)), ((0.2, 0.2), (0.6, 0.6), (0.4, 0.4)), ((0.5, 0.5),) * 3):  # beside, a line, a point
        at = away | {f"x{i}": float(c[0]) for i, c in enumerate(corners)} | {f"y{i}": float(c[1]) for i, c in enumerate(corners)}
        value, gradient = f.value_and_grad(at)
        assert value == 0.0
        if corners[0] == (2, 2):
            assert all(g == 0.0 for g in gradient.values())


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ["x0", "left", "top"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_a_number_stays_so(name: str, bad: float, backend: str) -> None:
    e, wrt = n_gon(3, COLOUR[1]())
    f = teg.compile(e, wrt, backend=backend)
    at = {k: float(v[0]) for k, v in places(3, 1).items()} | {name: bad}
    if math.isnan(bad):
        assert math.isnan(f(at))
    else:  # a NaN that was not in the input is said in the call
        with pytest.warns(teg.AccuracyWarning, match="not a number"):
            assert math.isnan(f(at))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_condition_that_fails_on_the_whole_box_hides_what_is_not_a_number(backend: str) -> None:
    t, a = teg.params("t a")
    f = teg.compile(teg.integral(teg.bracket((x + y < t) & (x < a)) * y, (x, 0, 1), (y, 0, 1)), backend=backend)
    assert f(t=-1.0, a=math.nan) == 0.0
    assert math.isnan(f(t=1.0, a=math.nan))


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_edge_on_a_side_has_the_mean_of_both_sides(backend: str) -> None:
    """The edge x = t on a side of the unit box: pushed out it changes nothing, pulled in it takes area away."""
    t = teg.param("t")
    f = teg.compile(teg.integral(teg.bracket((x < t) & (y < 2 * x + 5)) * (1 + y), (x, 0, 1), (y, 0, 1)), [t], backend=backend)
    assert f.grad(t=1.0)["t"] == pytest.approx(0.5 * 1.5, rel=1e-15)
    assert f.grad(t=0.0)["t"] == pytest.approx(0.5 * 1.5, rel=1e-15)
    assert f.grad(t=0.5)["t"] == pytest.approx(1.5, rel=1e-15)
    kinds = {d.kind for d in f.diagnose(t=1.0)}
    assert "tie" in kinds


@pytest.mark.parametrize("backend", BACKENDS)
def test_two_coincident_edges(backend: str) -> None:
    """Of two half-planes with the same border one moves in, or the other does not: each has half of the boundary."""
    t, a = teg.params("t a")
    f = teg.compile(teg.integral(teg.bracket((x + y < t) & (2 * x + 2 * y < a)), (x, 0, 1), (y, 0, 1)), [t, a], backend=backend)
    slopes = f.grad(t=0.5, a=1.0)
    assert slopes["t"] == pytest.approx(0.25, rel=1e-14)
    assert slopes["a"] == pytest.approx(0.125, rel=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_slivers_at_large_coordinates_keep_their_digits(backend: str) -> None:
    """At coordinate 512 a triangle of height 2⁻²⁰ has the area that exact arithmetic gives it."""
    e, wrt = n_gon(3, COLOUR[0]())
    f = teg.compile(e, wrt, backend=backend)
    at = {"x0": 512.0, "y0": 512.25, "x1": 513.0, "y1": 512.25, "x2": 512.5, "y2": 512.25 + 2.0**-20}
    box = {"left": 512.0, "right": 513.0, "bottom": 512.0, "top": 513.0}
    value, gradient = f.value_and_grad(at | box)
    assert value == pytest.approx(2.0**-21, rel=1e-12)
    assert gradient["y2"] == pytest.approx(0.5, rel=1e-15)


def test_estimates_hold() -> None:
    e, wrt = n_gon(4, COLOUR[3]())
    at = places(4, 50)
    for backend in BACKENDS:
        value, error = teg.compile(e, wrt, backend=backend).value_and_error(at)
        exact = teg.compile(e, wrt, backend="c", rule="gauss", order=12)(at)
        assert (np.abs(value - exact) <= error + 1e-15).all()
        assert (error <= 1e-10).all()


@pytest.mark.slow
def test_counts_are_those_of_both_backends() -> None:
    for degree in range(4):
        e, wrt = n_gon(5, COLOUR[degree]())
        at = places(5, 20)
        counts = {backend: teg.compile(e, wrt, backend=backend).evaluations(at, derivatives=1) for backend in BACKENDS}
        assert counts["c"] == counts["numpy"] > 0


@pytest.mark.slow
@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("degree", [3])
def test_jax_agrees(degree: int) -> None:
    e, wrt = n_gon(4, COLOUR[degree]())
    at = places(4, 40)
    value, gradient = teg.compile(e, wrt, backend="jax").value_and_grad(at)
    expected, slopes = teg.compile(e, wrt, backend="numpy").value_and_grad(at)
    np.testing.assert_allclose(value, expected, rtol=1e-13, atol=1e-14)
    same(gradient, slopes, 1e-12)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_half_plane_of_numbers_only(backend: str) -> None:
    """[2 < y/2] holds nowhere, whatever the bounds are: NumPy failed on ends of a half-line that are literals."""
    x, y = teg.vars("x y")
    a, c, d = teg.params("a c d")
    inside = teg.bracket((0.5 * y > 2) & ((a + 1) * x + (a + 1) * y <= d + 1))
    f = teg.compile(teg.integral(inside * c * x, (x, 0, d), (y, 0, 1)), [a, c, d], backend=backend)
    values = np.array([0.0, 1.0, -1.0, 0.5])
    value, gradient = f.value_and_grad(a=values, c=values[::-1], d=np.roll(values, 1))
    assert not np.any(value)
    assert not any(np.any(slope) for slope in gradient.values())
