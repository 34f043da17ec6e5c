"""Sums that compare every thing with every thing, itself included: as if it were left out, in value and gradient.

The reference is a painter of its own: it cuts the line at all ends and crossings, asks in the middle of every piece which things lie in
front, and differentiates by central differences.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest

import teg
from teg import Expr, bracket, integral
from teg.ir.arrays import Sum
from teg.ir.expr import Compare
from teg.ir.node import postorder
from teg.passes.normalise.self_comparison import without_self_comparisons

pytestmark = pytest.mark.usefixtures("x64_for_jax")

x, y = teg.vars("x y")
L, H, Z, S, C = (teg.array(name, 1) for name in "LHZSC")
V = teg.array("V", 2)
F, N = teg.indices("F", 1), teg.indices("N", 1)
j, k = teg.index("j"), teg.index("k")
COUNT = teg.length(L, 0)
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
Values = dict[str, np.ndarray]


def inside(i: Any) -> teg.Cond:
    return (x > L[i]) & (x < H[i])


def depth(i: Any) -> Expr:
    return Z[i] + S[i] * x


def scene(seed: int, count: int = 3) -> Values:
    rng = np.random.default_rng(seed)
    return {
        "L": rng.uniform(0.0, 0.4, count),
        "H": rng.uniform(0.6, 1.0, count),
        "Z": rng.uniform(0.0, 1.0, count),
        "S": rng.uniform(-2.0, 2.0, count),
        "C": rng.uniform(0.5, 1.5, count),
    }


def painted(at: Values, chosen: Callable[[list[int], np.ndarray], list[int]]) -> float:
    """∫ Σ C·(1 + x) over the things that `chosen` takes of those at x, given the depths."""
    left, right, front, slope = at["L"], at["H"], at["Z"], at["S"]
    cuts = [0.0, 1.0, *left, *right]
    for a, b in combinations(range(len(left)), 2):
        if slope[a] != slope[b]:
            cuts.append((front[b] - front[a]) / (slope[a] - slope[b]))
    ends = np.unique(np.clip(cuts, 0.0, 1.0))
    total = 0.0
    for p, q in pairwise(ends):
        middle = 0.5 * (p + q)
        there = [i for i in range(len(left)) if left[i] < middle < right[i]]
        for i in chosen(there, front + slope * middle):
            total += at["C"][i] * (q - p) * (1.0 + middle)
    return total


def slopes(at: Values, value: Callable[[Values], float], step: float = 1e-5) -> Values:
    """Central differences."""
    found = {}
    for name, entries in at.items():
        found[name] = np.zeros_like(entries)
        for i in np.ndindex(entries.shape):
            sides = []
            for sign in (1.0, -1.0):
                moved = {key: v.copy() for key, v in at.items()}
                moved[name][i] += sign * step
                sides.append(value(moved))
            found[name][i] = (sides[0] - sides[1]) / (2.0 * step)
    return found


def behind(i: int, there: list[int], depths: np.ndarray) -> int:
    """How many things lie in front of one."""
    return sum(depths[other] < depths[i] for other in there)


def count_in_front(closed: bool = False) -> Expr:
    nearer = depth(j) <= depth(k) if closed else depth(j) < depth(k)
    return teg.sum(bracket(inside(j) & nearer), (j, 0, COUNT))


def shown(condition: teg.Cond) -> Expr:
    return teg.sum(integral(bracket(inside(k) & condition) * C[k] * (1 + x), (x, 0, 1)), (k, 0, COUNT))


def first(there: list[int], depths: np.ndarray) -> list[int]:
    return [i for i in there if behind(i, there, depths) == 0]


def second(there: list[int], depths: np.ndarray) -> list[int]:
    return [i for i in there if behind(i, there, depths) == 1]


PROGRAMS: dict[str, tuple[Callable[[], Expr], Callable[[list[int], np.ndarray], list[int]]]] = {
    "nothing in front": (lambda: shown(count_in_front() < 0.5), first),
    "one with itself": (lambda: shown(count_in_front(closed=True) < 1.5), first),
    "one in front": (lambda: shown((count_in_front() > 0.5) & (count_in_front() < 1.5)), second),
    "not beyond": (lambda: shown(teg.sum(bracket(inside(j) & ~(depth(j) >= depth(k))), (j, 0, COUNT)) < 0.5), first),
    "a product": (
        lambda: shown(teg.sum(bracket(inside(j) & ((depth(k) - depth(j)) * (1 + x * x) > 0)), (j, 0, COUNT)) < 0.5),
        first,
    ),
    "a quotient": (
        lambda: shown(teg.sum(bracket(inside(j) & ((depth(k) + 5) / (depth(j) + 5) > 1)), (j, 0, COUNT)) < 0.5),
        first,
    ),
    "pairs outside": (
        lambda: teg.sum(
            integral(bracket(inside(k) & inside(j) & (depth(j) < depth(k))) * C[k] * (1 + x), (x, 0, 1)), (j, 0, COUNT), (k, 0, COUNT)
        ),
        lambda there, depths: [i for i in there for _ in range(behind(i, there, depths))],
    ),
    "against the first": (
        lambda: shown(~(inside(0) & (depth(0) < depth(k)))),
        lambda there, depths: [i for i in there if not (0 in there and depths[0] < depths[i])],
    ),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", PROGRAMS)
def test_a_thing_does_not_hide_itself(name: str, backend: str) -> None:
    build, chosen = PROGRAMS[name]
    f = teg.compile(build(), backend=backend)
    for seed in range(3):
        at = scene(seed)
        value, gradient = f.value_and_grad(at)
        assert value == pytest.approx(painted(at, chosen), rel=1e-12)
        for array, exact in slopes(at, lambda moved: painted(moved, chosen)).items():
            np.testing.assert_allclose(gradient[array], exact, rtol=1e-8, atol=1e-9, err_msg=f"{array}, {seed}")


@pytest.mark.parametrize("backend", BACKENDS)
def test_things_chosen_by_an_index_array(backend: str) -> None:
    """Thing F[k]: one that is listed twice is there twice, and neither hides the other; what is moved is both."""
    ends = lambda i: (x > L[F[i]]) & (x < H[F[i]])  # noqa: E731
    front = lambda i: Z[F[i]] + S[F[i]] * x  # noqa: E731
    many = teg.length(F, 0)
    nearer = teg.sum(bracket(ends(j) & (front(j) < front(k))), (j, 0, many))
    f = teg.compile(teg.sum(integral(bracket(ends(k) & (nearer < 0.5)) * C[F[k]] * (1 + x), (x, 0, 1)), (k, 0, many)), backend=backend)
    at, listed = scene(4), np.array([1, 0, 2, 0])

    def value(moved: Values) -> float:
        return painted({key: v[listed] for key, v in moved.items()}, first)

    found, gradient = f.value_and_grad({**at, "F": listed})
    assert found == pytest.approx(value(at), rel=1e-12)
    for array, exact in slopes(at, value).items():
        np.testing.assert_allclose(gradient[array], exact, rtol=1e-8, atol=1e-9, err_msg=array)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_thing_that_may_be_its_own_neighbour(backend: str) -> None:
    f = teg.compile(shown(~(inside(N[k]) & (depth(N[k]) < depth(k)))), backend=backend)
    at, neighbour = scene(5), np.array([0, 2, 1])

    def value(moved: Values) -> float:
        def chosen(there: list[int], depths: np.ndarray) -> list[int]:
            return [i for i in there if not (neighbour[i] in there and depths[neighbour[i]] < depths[i])]

        return painted(moved, chosen)

    found, gradient = f.value_and_grad({**at, "N": neighbour})
    assert found == pytest.approx(value(at), rel=1e-12)
    for array, exact in slopes(at, value).items():
        np.testing.assert_allclose(gradient[array], exact, rtol=1e-8, atol=1e-9, err_msg=array)


@pytest.mark.parametrize("backend", BACKENDS)
def test_planes_over_a_box(backend: str) -> None:
    """Which of three planes is lowest, over a box that moves: by the midpoint rule along y, exactly along x."""

    def plane(i: Any) -> Expr:
        return V[i, 0] + V[i, 1] * x + V[i, 2] * y

    nearer = teg.sum(bracket(plane(j) < plane(k)), (j, 0, 3))
    t = teg.param("t")
    f = teg.compile(teg.sum(integral(bracket(nearer < 0.5) * bracket(x < t) * V[k, 3], (x, 0, 1), (y, 0, 1)), (k, 0, 3)), backend=backend)
    at = {"V": np.array([[0.3, 0.5, -0.4, 1.0], [0.6, -0.7, 0.2, 2.0], [0.2, 0.4, 0.6, 3.0]]), "t": np.array(0.7)}

    def value(moved: Values) -> float:
        rows, lines, right = moved["V"], 20_000, float(moved["t"])
        base = rows[:, 0] + rows[:, 2] * ((np.arange(lines) + 0.5) / lines)[:, None]
        cuts = [(base[:, b] - base[:, a]) / (rows[a, 1] - rows[b, 1]) for a, b in combinations(range(3), 2)]
        ends = np.sort(np.clip(np.stack([np.zeros(lines), np.full(lines, right), *cuts], axis=1), 0.0, right), axis=1)
        middles = 0.5 * (ends[:, 1:] + ends[:, :-1])
        lowest = np.argmin(base[:, None, :] + rows[:, 1] * middles[:, :, None], axis=2)
        return float(np.sum(np.diff(ends, axis=1) * rows[lowest, 3]) / lines)

    found, gradient = f.value_and_grad(at)
    assert found == pytest.approx(value(at), abs=1e-7)
    exact = slopes(at, value, 1e-3)
    for name in ("V", "t"):
        np.testing.assert_allclose(gradient[name], exact[name], rtol=1e-3, atol=2e-4, err_msg=name)


# The pass


def atoms(e: Expr) -> int:
    return sum(isinstance(n, Compare) and bool(n.free) for n in postorder([e]))


def test_ranges_that_never_meet_are_left_alone() -> None:
    later = teg.sum(bracket(depth(j) < depth(k)), (j, k + 1, COUNT))
    earlier = teg.sum(bracket(depth(j) < depth(k)), (j, 0, k))
    fan = teg.sum(bracket(depth(0) < depth(k)), (k, 1, COUNT))
    for e in (teg.sum(later, (k, 0, COUNT)), teg.sum(earlier, (k, 0, COUNT)), fan):
        whole = integral(e, (x, 0, 1))
        found = without_self_comparisons(whole)
        conditions = [n for n in postorder([found]) if isinstance(n, Compare)]
        assert len(conditions) == atoms(found) == 1


def test_edges_of_faces_are_left_alone() -> None:
    """Two corners of one face are chosen by two columns: that is no comparison of a thing with itself, and costs nothing."""
    faces = teg.indices("T", 2)
    a, b = (lambda axis, c=c: V[faces[k, c], axis] for c in (0, 1))
    edge = bracket((b(0) - a(0)) * (y - a(1)) - (b(1) - a(1)) * (x - a(0)) > 0)
    e = teg.sum(integral(edge, (x, 0, 1), (y, 0, 1)), (k, 0, teg.length(faces, 0)))
    assert without_self_comparisons(e) is e


def test_different_arrays_are_left_alone() -> None:
    e = teg.sum(integral(bracket(Z[j] + x < C[k]), (x, 0, 1)), (j, 0, COUNT), (k, 0, COUNT))
    found = without_self_comparisons(e)
    assert sum(isinstance(n, Compare) for n in postorder([found])) == 1
    assert sum(isinstance(n, Sum) for n in postorder([found])) == 2


def test_twice_is_once() -> None:
    once = without_self_comparisons(shown(count_in_front() < 0.5))
    twice = without_self_comparisons(once)
    count = [sum(isinstance(n, Compare) for n in postorder([e])) for e in (once, twice)]
    assert count[0] == count[1]
