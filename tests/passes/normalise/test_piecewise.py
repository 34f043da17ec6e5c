"""Conditions on piecewise affine functions as conditions on affine functions, and choices over data with such conditions."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator

import numpy as np
import pytest

import teg
from teg.analysis.kinks import kinks_of
from teg.ir.expr import Compare, const
from teg.ir.node import postorder
from teg.passes.normalise.piecewise import with_affine_atoms, with_smooth_atoms

X, Y = teg.vars("x y")
T = teg.param("t")
K, P = teg.index("k"), teg.index("p")
C, R = teg.array("C", 2), teg.indices("R", 2)
OVER = (K, R[P, 0], R[P, 1])
BACKENDS = ["c", "numpy", "jax"]
DATA = {"C": np.array([[0.3, 0.3], [0.42, 0.35], [0.8, 0.2]]), "R": np.array([[0, 2], [2, 2], [1, 3]])}


@pytest.fixture(autouse=True)
def double_precision() -> Iterator[None]:
    import jax

    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def test_normal_forms() -> None:
    u = X - T
    assert with_affine_atoms(teg.abs(u) < T) is with_affine_atoms((T - u > 0) & (T + u > 0))
    assert str(with_affine_atoms(teg.maximum(X, Y) > T)) == str((X - T > 0) | (Y - T > 0))
    plain = (X < T) & ~(Y < T)
    assert with_affine_atoms(plain) is plain


def _random(rng: random.Random, depth: int) -> teg.Expr:
    if depth == 0:
        return rng.choice([X - 0.3, Y * 0.7 + X - T, 0.5 - Y, X * 2.0 - Y])
    a, b = _random(rng, depth - 1), _random(rng, depth - 1)
    return rng.choice([teg.abs(a), teg.maximum(a, b), teg.minimum(a, b), a - b, -1.5 * a, teg.where(b > 0.1, a, b), a * T])


def test_conditions_keep_their_meaning() -> None:
    whole = 0
    for seed in range(60):
        rng = random.Random(seed)
        before = _random(rng, 2) > 0.1
        after = with_affine_atoms(before)
        whole += any(isinstance(n, Compare) and n.free and kinks_of(n.g) for n in postorder([after]))
        both = teg.tuple(teg.bracket(before), teg.bracket(after))
        for _ in range(4):
            at = {X: rng.random(), Y: rng.random(), T: rng.uniform(-1, 1)}
            first, second = teg.evaluate(teg.substitute(both, at))
            assert float(first) == float(second), (seed, before, at)
    assert whole <= 3  # too long ones stay as they are


def test_extremes_in_conditions() -> None:
    """What an extreme is taken of decides; the condition of the extreme itself is no border, and a function that may be NaN stays."""
    f, g = X * X + Y * Y - T, X * Y - 0.25

    def smooth(condition: object) -> str:
        return str(with_smooth_atoms(teg.bracket(condition)))

    assert smooth(teg.minimum(f, g) < 0) == smooth((f < 0) | (g < 0))
    assert smooth(teg.maximum(f, g, X - Y) < T) == smooth((f < T) & (g < T) & (X - Y < T))
    assert smooth(teg.abs(f) < T) == smooth((f < T) & (-f < T))
    bounded = teg.log(1 + X * X), 1 / (2 + Y * Y)  # numbers everywhere
    assert smooth(teg.maximum(*bounded) < T) == smooth((bounded[0] < T) & (bounded[1] < T))
    for whole in (
        teg.maximum(teg.sqrt(X - T), Y),
        teg.maximum(teg.log(X * X), Y),
        teg.minimum(1 / (X - T), Y),
        teg.maximum(f, g) * f,
        teg.exp(teg.maximum(f, g)),
    ):
        assert smooth(whole > 0.3) == str(teg.bracket(whole > 0.3))
    assert with_smooth_atoms(teg.maximum(f, g)) is teg.maximum(f, g)


def test_extremes_that_are_always_one_of_both() -> None:
    u = X - T
    for whole, part in (
        (teg.minimum(teg.maximum(u, 0), -1), const(-1.0)),
        (teg.maximum(teg.sqrt(u), -1), teg.maximum(teg.sqrt(u), -1)),
        (teg.minimum(teg.maximum(teg.minimum(u, 1), -0.5), 1), teg.maximum(teg.minimum(u, 1), -0.5)),
        (teg.maximum(teg.sin(u), 1.5, u), teg.maximum(1.5, u)),
        (teg.maximum(teg.abs(u), -(u**2)), teg.abs(u)),
        (teg.maximum(u, 2 * u), teg.maximum(u, 2 * u)),
        (teg.minimum(teg.exp(u), T), teg.minimum(teg.exp(u), T)),
    ):
        assert str(with_smooth_atoms(whole)) == str(part)


@pytest.mark.parametrize("backend", BACKENDS)
def test_second_derivatives_of_clamps(backend: str) -> None:
    """∫ of u in [0.1, 0.6] is a clamp in a clamp: its conditions were 0 on whole regions, and second derivatives NaN."""
    u = X - T + T * T * Y
    clamped = teg.maximum(teg.minimum(teg.maximum(teg.minimum(u, 0.6), -0.2), 0.6), 0.1)
    f, g = (
        teg.compile(teg.integral(e, (X, 0, 1), (Y, 0, 1)), [T], backend=backend) for e in (clamped, teg.maximum(teg.minimum(u, 0.6), 0.1))
    )
    second = f.hessian(t=0.3)["t", "t"]
    assert second == pytest.approx(g.hessian(t=0.3)["t", "t"], rel=1e-11)
    h = 1e-5
    assert second == pytest.approx((f.grad(t=0.3 + h)["t"] - f.grad(t=0.3 - h)["t"]) / (2 * h), rel=1e-7)


def _cut_off(r: float, d: float) -> float:
    """Returns the area of the part of a disk of radius r behind a line whose distance from its centre is d."""
    return r * r * math.acos(d / r) - d * math.sqrt(r * r - d * d)


@pytest.mark.parametrize("backend", BACKENDS)
def test_shapes_by_distances(backend: str) -> None:
    """A union, an intersection, and a difference of disks, and a diamond, as functions that are below 0 inside: areas in closed form."""
    near, far = (teg.sqrt((X - c) ** 2 + (Y - 0.5) ** 2) - T for c in (0.35, 0.65))
    squared, other = ((X - c) ** 2 + (Y - 0.5) ** 2 - T * T for c in (0.35, 0.65))
    shapes = [
        teg.minimum(near, far),
        teg.minimum(squared, other),
        teg.maximum(squared, other),
        teg.maximum(squared, -other),
        teg.abs(X - 0.5) + teg.abs(Y - 0.5) - T,
    ]
    few = slice(4, 5) if backend == "jax" else slice(5)
    f = teg.compile(teg.tuple(*(teg.integral(teg.bracket(s < 0), (X, 0, 1), (Y, 0, 1)) for s in shapes[few])), [T], backend=backend)
    values, slopes = f.value_and_grad(t=0.25)
    r, d = 0.25, 0.15
    disk, lens, arc = math.pi * r * r, 2 * _cut_off(r, d), 4 * r * math.acos(d / r)
    assert list(values) == pytest.approx([*[2 * disk - lens] * 2, lens, disk - lens, 2 * r * r][few], rel=1e-11)
    around = 2 * math.pi * r
    assert list(slopes["t"]) == pytest.approx([*[2 * around - arc] * 2, arc, around - arc, 4 * r][few], rel=1e-9)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_the_median_of_three(backend: str) -> None:
    """It is below t with the probability 3t² - 2t³. Written as a maximum of minima it has three, of two each, whatever its sign is."""
    z = teg.var("z")
    median = teg.maximum(teg.minimum(X, Y), teg.minimum(teg.maximum(X, Y), z))
    for condition in (median < T, -median > -T):
        atoms = [n for n in postorder([with_smooth_atoms(teg.bracket(condition))]) if isinstance(n, Compare)]
        assert len(atoms) == 3
        assert not any(kinks_of(n.g) for n in atoms)
        f = teg.compile(teg.integral(teg.bracket(condition), (X, 0, 1), (Y, 0, 1), (z, 0, 1)), [T], backend=backend)
        value, gradient, hessian = f(t=0.3), f.grad(t=0.3)["t"], f.hessian(t=0.3)["t", "t"]
        assert (value, gradient, hessian) == pytest.approx((0.216, 1.26, 2.4), abs=1e-10)


def test_what_cancels_in_an_alternative_is_no_surface() -> None:
    """Of |x - t| + |y| + |x + y| < r one alternative is x - t + y - (x + y) < r. Differences are exact, as the area is quadratic."""
    r = teg.param("r")
    polygon = teg.abs(X - T) + teg.abs(Y) + teg.abs(X + Y) < r
    f = teg.compile(teg.integral(teg.bracket(polygon), (X, -1, 1), (Y, -1, 1)))
    second = f.hessian(t=0.1, r=0.8)
    for name, step in (("t", {"t": 0.01, "r": 0.0}), ("r", {"t": 0.0, "r": 0.01})):
        above, below = (f.grad(t=0.1 + sign * step["t"], r=0.8 + sign * step["r"]) for sign in (1, -1))
        for other in "tr":
            assert second[other, name] == pytest.approx((above[other] - below[other]) / 0.02, abs=1e-11)


def test_many_disks_by_their_distances() -> None:
    """Four overlapping disks as one minimum are what they are as alternatives."""
    rng = np.random.default_rng(1)
    disks = [(X - u) ** 2 + (Y - v) ** 2 - T * w for u, v, w in rng.uniform(0.2, 0.8, (4, 3))]
    inside = teg.minimum(*disks) < 0
    any_of = disks[0] < 0
    for disk in disks[1:]:
        any_of = any_of | (disk < 0)
    first, second = (teg.compile(teg.integral(teg.bracket(c), (X, 0, 1), (Y, 0, 1)), [T]).value_and_grad(t=0.06) for c in (inside, any_of))
    assert first[0] == pytest.approx(second[0], rel=1e-10)
    assert first[1]["t"] == pytest.approx(second[1]["t"], rel=1e-10)


def _squares(c: np.ndarray, r: float) -> float:
    """Returns the area of a union of squares in the unit square, by a grid of all their sides."""
    xs, ys = (np.unique(np.clip(np.concatenate([c[:, i] - r, c[:, i] + r, [0, 1]]), 0, 1)) for i in (0, 1))
    total = 0.0
    for a, b in itertools.pairwise(xs):
        for d, e in itertools.pairwise(ys):
            inside = (abs((a + b) / 2 - c[:, 0]) < r) & (abs((d + e) / 2 - c[:, 1]) < r)
            total += (b - a) * (e - d) * bool(inside.any())
    return total


@pytest.mark.parametrize("backend", BACKENDS)
def test_unions_of_squares_over_lists(backend: str) -> None:
    near = (teg.abs(X - C[K, 0]) < T) & (teg.abs(Y - C[K, 1]) < T)
    largest = teg.maximum(teg.abs(X - C[K, 0]), teg.abs(Y - C[K, 1])) < T
    programs = [
        teg.integral(teg.bracket(condition), (X, 0, 1), (Y, 0, 1))
        for condition in (
            teg.any(near, OVER),
            teg.any(largest, OVER),
            ~teg.all((teg.abs(X - C[K, 0]) > T) | ~(teg.abs(Y - C[K, 1]) < T), OVER),
        )
    ]
    f = teg.compile(teg.tuple(*(teg.sum(e, (P, 0, teg.length(R, 0))) for e in programs)), backend=backend)
    values, gradient = f.value_and_grad(t=0.1, **DATA)
    h = 1e-4
    lists = [DATA["C"][a:b] for a, b in DATA["R"]]
    expected = sum(_squares(c, 0.1) for c in lists)
    rate = (sum(_squares(c, 0.1 + h) for c in lists) - sum(_squares(c, 0.1 - h) for c in lists)) / (2 * h)
    for i in range(3):
        assert float(values[i]) == pytest.approx(expected, abs=1e-12)
        assert float(gradient["t"][i]) == pytest.approx(rate, abs=1e-9)  # areas are quadratic in t


@pytest.mark.parametrize("backend", BACKENDS)
def test_products_of_brackets_over_lists(backend: str) -> None:
    products = [
        teg.prod(teg.bracket(C[K, 0] < X), OVER),
        teg.prod(1 - teg.bracket(C[K, 0] < X), OVER),
        teg.prod(C[K, 1] * teg.bracket(C[K, 0] < X), OVER),
    ]
    f = teg.compile(teg.tuple(*(teg.sum(teg.integral(e, (X, 0, 1)), (P, 0, teg.length(R, 0))) for e in products)), backend=backend)
    values, gradient = f.value_and_grad(**DATA)
    c = DATA["C"]
    assert list(map(float, values)) == pytest.approx([0.58 + 1 + 0.2, 0.3 + 1 + 0.42, 0.3 * 0.35 * 0.58 + 1 + 0.35 * 0.2 * 0.2])
    np.testing.assert_allclose(gradient["C"][0], [[0, 0], [-1, 0], [-1, 0]], atol=1e-14)
    np.testing.assert_allclose(gradient["C"][1], [[1, 0], [1, 0], [0, 0]], atol=1e-14)
    moved = [[0, 0.35 * 0.58], [-c[0, 1] * c[1, 1], 0.3 * 0.58 + 0.2 * 0.2], [-c[1, 1] * c[2, 1], 0.35 * 0.2]]
    np.testing.assert_allclose(gradient["C"][2], moved, atol=1e-14)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_squares_by_their_largest_coordinate(backend: str) -> None:
    """A condition that decides a maximum of sizes has sizes itself: it is no border. One exact program serves any number of squares."""
    S, k = teg.array("S", 2), teg.index("k")
    u, v = teg.vars("u v")
    inside = teg.maximum(abs(u - S[k, 0]), abs(v - S[k, 1])) < S[k, 2]
    f = teg.compile(teg.integral(teg.bracket(teg.any(inside, (k, 0, teg.length(S)))), (u, 0, 1), (v, 0, 1)), [S], backend=backend)
    value, gradient = f.value_and_grad(S=[[0.3, 0.3, 0.1], [0.4, 0.4, 0.1]])
    assert value == pytest.approx(0.07, abs=1e-14)
    assert gradient["S"][:, 2] == pytest.approx([0.6, 0.6], abs=1e-13)  # of each border 0.2 are hidden
    assert gradient["S"][:, 0] == pytest.approx([-0.1, 0.1], abs=1e-13)
    rows = np.c_[np.random.default_rng(0).random((12, 2)), np.full(12, 0.1)]
    edges = [np.unique(np.clip(np.r_[0, 1, rows[:, axis] - 0.1, rows[:, axis] + 0.1], 0, 1)) for axis in (0, 1)]
    middles = [0.5 * (e[1:] + e[:-1]) for e in edges]
    covered = np.any([np.maximum(abs(middles[0][:, None] - a), abs(middles[1] - b)) < r for a, b, r in rows], axis=0)
    assert f(S=rows) == pytest.approx(np.diff(edges[0]) @ covered @ np.diff(edges[1]), abs=1e-13)
