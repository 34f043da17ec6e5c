"""Second derivatives of choices that are followed along edges: the ends of gaps move. Against differences of arcs of NumPy, closed
forms, and candidates that are written by hand."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg.evaluator.wanted import derivative_of_order
from teg.ir.node import postorder
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, t, x, y
from tests.passes.differentiate.test_layers import without_cells
from tests.references.disks import slopes_of_layers, slopes_of_union

INSIDE = (x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2 < D[k, 2] ** 2
UNION = teg.integral(teg.bracket(teg.any(INSIDE, ALL)) * teg.exp(x * y), *BOX)
GROUND = 0.1
PAINTED = teg.integral(teg.nearest(D[k, 4], D[k, 3], ALL, where=INSIDE, otherwise=GROUND), *BOX)  # rows: centre, radius, depth, colour
STEP = 1e-3


def follows_twice(f: Any) -> bool:
    """Whether products with the Hessian are computed along edges, for any number of candidates."""
    return follows_edges(f) and not f._lengths.any.plan.needs_lengths(derivative_of_order(1, f.wrt))


def some(n: int, columns: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of centres, radii, depths and colours, and a direction."""
    rng = np.random.default_rng(seed)
    rows = np.c_[rng.uniform(-0.1, 1.1, (n, 2)), rng.uniform(0.2, 1.2, n) / np.sqrt(max(n, 1)), rng.permutation(n), rng.uniform(0, 1, n)]
    along = rng.normal(size=(n, 5)) / max(n, 1)
    along[:, 3:] = 0.0
    return rows[:, :columns], along[:, :columns]


def change(slopes: Callable[[np.ndarray], np.ndarray], rows: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The derivative of slopes along a direction, by differences of order 6."""
    weights = (1, 45), (2, -9), (3, 1)
    return sum(w * (slopes(rows + s * STEP * along) - slopes(rows - s * STEP * along)) for s, w in weights) / (60 * STEP)  # type: ignore[return-value]


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_union_of_any_number(backend: str) -> None:
    f = teg.compile(UNION, [D], backend=backend)
    assert follows_twice(f)
    for n in (0, 1, 2, 7, 25):
        rows, along = some(n, 3, n)
        expected = change(lambda disks: slopes_of_union(disks, lambda u, v: np.exp(u * v)), rows, along)
        assert f.hvp({"D": rows}, {"D": along})["D"] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_painted_disks(backend: str) -> None:
    f = teg.compile(PAINTED, [D], backend=backend)
    assert follows_twice(f)
    for n in (1, 2, 7):
        rows, along = some(n, 5, n)
        expected = change(lambda disks, rows=rows: slopes_of_layers(disks, rows[:, 3], rows[:, 4], GROUND), rows[:, :3], along[:, :3])
        assert f.hvp({"D": rows}, {"D": along})["D"][:, :3] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_borders_that_nearly_touch_are_said(backend: str) -> None:
    """A disk hides another one but for a sliver, whose ends move by the root of its width: rounding decides how fast."""
    f = teg.compile(PAINTED, [D], backend=backend)
    apart = 0.05 + 1e-12
    rows = np.array([[0.5, 0.5, 0.3, 2.0, 1.0], [0.5 + 0.6 * apart, 0.5 + 0.8 * apart, 0.35, 1.0, 0.2]])
    with pytest.warns(teg.AccuracyWarning):
        f.hvp({"D": rows}, {"D": np.ones((2, 5))})


def test_two_disks_in_closed_form() -> None:
    """A second derivative of the area, with 15 digits."""
    f = teg.compile(teg.integral(teg.bracket(teg.any(INSIDE, ALL)), *BOX), [D])
    rows, along = np.array([[0.4, 0.5, 0.25], [0.6, 0.55, 0.2]]), np.array([[0.1, -0.3, 0.2], [0.4, 0.2, -0.1]])

    def area(s: Any) -> Any:
        moved = (
            [mpmath.mpf(float(v)) + s * mpmath.mpf(float(w)) for v, w in zip(*pair, strict=True)] for pair in zip(rows, along, strict=True)
        )
        (a, b, r), (c, d, q) = moved
        apart = mpmath.hypot(a - c, b - d)
        halves = [mpmath.acos((apart**2 + u * u - v * v) / (2 * apart * u)) for u, v in ((r, q), (q, r))]
        return mpmath.pi * (r * r + q * q) - sum(u * u * (h - mpmath.sin(2 * h) / 2) for u, h in zip((r, q), halves, strict=True))

    with mpmath.workdps(40):
        expected = float(mpmath.diff(area, 0, 2))
    assert np.vdot(f.hvp({"D": rows}, {"D": along})["D"], along) == pytest.approx(expected, rel=1e-13)


LINE = (x - D[k, 0]) * D[k, 2] + (y - D[k, 1]) * 0.3 > 0
SHAPES: dict[str, Callable[[Any], teg.Expr]] = {
    "half disks": lambda some_: teg.integral(teg.bracket(some_(INSIDE & LINE)) * (1 + x * x * y), *BOX),
    "half planes": lambda some_: teg.integral(teg.bracket(some_(LINE)) * teg.exp(x * y), *BOX),
    "bounds and a body that move": lambda some_: teg.integral(teg.bracket(some_(INSIDE)) * (1 + t * x), (x, 0.1 * t, 1), (y, 0, 0.8 * t)),
    "a square": lambda some_: teg.integral(teg.bracket(some_(INSIDE)) * y, *BOX) ** 2 * t,
    "intervals": lambda some_: teg.integral(teg.bracket(some_((x - D[k, 0]) ** 2 < 0.1 * D[k, 2] ** 2 * t)) * teg.exp(x * t), (x, 0, 1)),
}


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_line_of_which_the_ends_move(backend: str) -> None:
    """What the intervals (0.2·t, 0.4) and (0.3·t, 0.5) leave of 0 < x < t."""
    within = (x > D[k, 0] * t) & (x < D[k, 1])
    f = teg.compile(teg.integral(teg.bracket(teg.all(~within, ALL)) * teg.exp(x * t), (x, 0, t)), [D, t], backend=backend)
    assert follows_twice(f)

    def left_over(a: Any, b: Any, t: Any) -> Any:
        return (mpmath.exp(a * t * t) - 1 + mpmath.exp(t * t) - mpmath.exp(b * t)) / t

    found = f.hvp({"D": [[0.2, 0.4], [0.3, 0.5]], "t": 0.8}, {"D": [[2.0, 3.0], [5.0, 7.0]], "t": 11.0})
    orders, along = np.eye(3, dtype=int), (2.0, 7.0, 11.0)
    with mpmath.workdps(30):
        seconds = [[float(mpmath.diff(left_over, (0.2, 0.5, 0.8), tuple(map(int, p + q)))) for q in orders] for p in orders]
    by_a, by_b, by_t = np.array(seconds) @ along
    assert found["D"] == pytest.approx(np.array([[by_a, 0.0], [0.0, by_b]]), abs=1e-12)
    assert found["t"] == pytest.approx(by_t, abs=1e-12)


@pytest.mark.parametrize("name", SHAPES)
def test_as_written_by_hand(name: str) -> None:
    def by_hand(condition: teg.Cond) -> teg.Cond:
        first, second = (_at(condition, j) for j in (0, 1))
        return first | second

    f = teg.compile(SHAPES[name](lambda c: teg.any(c, ALL)), [D, t])
    g = teg.compile(SHAPES[name](by_hand), [D, t])
    assert follows_twice(f)
    values, along = {"D": [[0.45, 0.5, 0.3], [0.6, 0.4, 0.25]], "t": 0.9}, {"D": [[0.3, -0.2, 0.5], [0.1, 0.4, -0.3]], "t": 0.7}
    one, other = (h.hvp(values, along) for h in (f, g))
    assert one["D"] == pytest.approx(other["D"], abs=1e-11)
    assert one["t"] == pytest.approx(other["t"], abs=1e-11)


def _at(condition: teg.Cond, row: int) -> teg.Cond:
    from teg.ir.cells import replace_integers
    from teg.ir.index import index_const

    return replace_integers(condition, {k: index_const(row)})  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize("key", [D[k, 0] * x**2 + D[k, 2], D[k, 0] * x**2 + D[k, 1] * x + D[k, 2]], ids=["even", "any"])
@pytest.mark.parametrize("rows", [[[1.0, 0.0, 0.1]], [[1.0, -0.6, 0.2], [2.0, -2.1, 0.6], [1.5, 0.5, 0.15]]], ids=["one", "three"])
def test_the_lowest_of_parabolas(key: teg.Expr, rows: list[list[float]]) -> None:
    """A candidate is never compared with itself, where the difference of keys has no slope."""
    f = teg.compile(teg.integral(teg.minimum_of(key, ALL), (x, 0, 1)), [D])
    numbers, along = np.array(rows), np.random.default_rng(1).normal(size=(len(rows), 3))
    if D[k, 1] not in _nodes(key):
        numbers[:, 1] = along[:, 1] = 0.0
    assert follows_twice(f)
    expected = change(_moments_of_lowest, numbers, along)
    found = f.hvp({"D": numbers}, {"D": along})["D"]
    assert found[:, [0, 2]] == pytest.approx(expected[:, [0, 2]], abs=1e-8)
    if D[k, 1] in _nodes(key):
        assert found[:, 1] == pytest.approx(expected[:, 1], abs=1e-8)


def _nodes(e: teg.Expr) -> list[Any]:
    return list(postorder([e]))


def _moments_of_lowest(rows: np.ndarray) -> np.ndarray:
    """The derivatives of ∫ min: x², x and 1 over where a parabola is the lowest one."""
    crossings = [r.real for i, a in enumerate(rows) for b in rows[:i] for r in np.roots(a - b) if abs(r.imag) < 1e-12 and 0 < r.real < 1]
    found = np.zeros_like(rows)
    for p, q in pairwise([0.0, *sorted(crossings), 1.0]):
        lowest = np.argmin(rows @ [(0.5 * (p + q)) ** 2, 0.5 * (p + q), 1.0])
        found[lowest] += [(q**3 - p**3) / 3, (q**2 - p**2) / 2, q - p]
    return found


@pytest.mark.parametrize("depths", [[0.0] * 5, [2.0, 0.0, 4.0, 1.0, 3.0]], ids=["equal", "other"])
def test_a_mesh_with_common_vertices(depths: list[float]) -> None:
    """Triangles around a vertex; several borders end at each of its corners, and move together. Against areas and means of triangles."""
    V, C, Z, F = teg.array("V", 2), teg.array("C"), teg.array("Z"), teg.indices("F", 2)
    corner = [(V[F[k, i], 0], V[F[k, i], 1]) for i in range(3)]
    sides = [(b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) for a, b in zip(corner, [*corner[1:], corner[0]], strict=True)]
    inside = (sides[0] > 0) & (sides[1] > 0) & (sides[2] > 0)
    with without_cells():
        f = teg.compile(teg.integral(teg.nearest(C[k] + y, Z[k], (k, 0, teg.length(F, 0)), where=inside, otherwise=GROUND), *BOX), [V])
        assert follows_twice(f)
    angles = 2 * np.pi * np.arange(5) / 5
    vertices = np.r_[[[0.5, 0.47]], np.c_[0.5 + 0.35 * np.cos(angles), 0.48 + 0.3 * np.sin(angles + 0.1)]]
    faces, colours = np.array([[0, 1 + i, 1 + (i + 1) % 5] for i in range(5)]), np.array([0.3, 0.9, 0.5, 0.2, 0.7])
    along = np.random.default_rng(1).normal(size=vertices.shape)

    def total(places: np.ndarray) -> float:
        a, b, c = (places[faces[:, i]] for i in range(3))
        areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        return float(GROUND + areas @ (colours - GROUND + (a + b + c)[:, 1] / 3))

    product = f.hvp({"V": vertices, "F": faces, "C": colours, "Z": depths}, {"V": along})["V"]
    step = 0.1  # a cubic function: the second difference is exact
    second = (total(vertices + step * along) - 2 * total(vertices) + total(vertices - step * along)) / step**2
    assert np.vdot(product, along) == pytest.approx(second, abs=1e-12)


def test_in_jax(x64_for_jax: Any) -> None:
    import jax

    f, g = teg.jax_function(UNION, [D], kernel="c"), teg.compile(UNION, [D])
    rows, along = some(3, 3, 3)
    whole = jax.hessian(lambda d: f(D=d))(rows)
    assert np.einsum("ijkl,kl", whole, along) == pytest.approx(g.hvp({"D": rows}, {"D": along})["D"], abs=1e-13)


def test_conditions_that_do_not_move() -> None:
    """They are written out: a gradient that ignores edges is no gradient, and its derivative ignores them too."""
    e = teg.integral(teg.stop_delta(teg.bracket(teg.any(INSIDE, ALL))) * D[0, 0] ** 2 * x, *BOX)
    f = teg.compile(e, [D])
    rows = np.array([[0.45, 0.5, 0.3], [0.6, 0.4, 0.25]])
    value, along = f(D=rows), np.ones((2, 3))
    assert f.hvp({"D": rows}, {"D": along})["D"][0, 0] == pytest.approx(2 * value / rows[0, 0] ** 2, rel=1e-12)
    many = np.full((300, 3), 0.4)
    with pytest.raises(teg.errors.ArrayIndexError):  # so many cannot be written out
        f.hvp({"D": many}, {"D": many})


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_square_of_an_integral_of_nearest_sites(backend: str) -> None:
    """Two sites with weights p and q on a line: the border between them is at (√p·a + √q·b)/(√p + √q), the other one left of 0."""
    f = teg.compile(teg.integral(teg.nearest(D[k, 2], D[k, 1] * (x - D[k, 0]) ** 2, ALL), (x, 0, 1)) ** 2, [D], backend=backend)
    assert follows_twice(f)
    rows, moved = np.array([[0.2, 4.0, 2.0], [0.6, 1.0, 5.0]]), np.array([[1.0, 0.0, 0.0], [-0.5, 0.0, 0.0]])
    parts = np.array([2.0, 1.0]) / 3.0
    by_places = (2.0 - 5.0) * parts
    assert f.hvp({"D": rows}, {"D": moved})["D"][:, 0] == pytest.approx(2 * by_places * (by_places @ moved[:, 0]))
