"""Conditions on the least or the largest of many: unions of disks, polygons by the lines of their sides."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import teg
from teg.ir.choices import AnyOf, Nearest
from teg.ir.node import postorder
from teg.passes.normalise.bounded_choices import with_bounds_of_all

x, y = teg.vars("x y")
t = teg.param("t")
k = teg.index("k")
S, L, V = teg.array("S", 2), teg.array("L", 2), teg.array("V")
BACKENDS = ["c", "numpy", pytest.param("jax", marks=pytest.mark.slow)]
SQUARE = (x, -1, 1), (y, -1, 1)
line = L[k, 0] * x + L[k, 1] * y
LINES = (k, 0, teg.length(L))


def hexagon(radius: float) -> np.ndarray:
    angle = np.arange(6) * math.pi / 3
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) / radius


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "inside",
    [
        teg.maximum_of(line, LINES) < 1,
        2 * teg.maximum_of(line, LINES) <= 2,
        teg.minimum_of(-line, LINES) > -1,
        -teg.minimum_of(-line, LINES) < 1,
    ],
    ids=["max", "twice max", "min", "-min"],
)
def test_a_polygon_by_the_lines_of_its_sides(inside: teg.Cond, backend: Any, x64_for_jax: None) -> None:
    """A regular hexagon has the area 2√3·r² for the distance r of its sides, each of the length 2r/√3."""
    f = teg.compile(teg.integral(teg.bracket(inside), *SQUARE), [L], backend=backend)
    value, gradient = f.value_and_grad(L=hexagon(0.6))
    assert value == pytest.approx(2 * math.sqrt(3) * 0.36, rel=1e-13)
    moved = (gradient["L"] * hexagon(0.6)).sum(axis=1)  # a side at |n| = 1/r: ∂area/∂|n|·|n| = -length·r
    np.testing.assert_allclose(moved, np.full(6, -2 * 0.36 / math.sqrt(3)), rtol=1e-12)


def test_a_union_of_disks_is_the_union_of_any() -> None:
    """Its first gradient took two minutes."""
    distance = (x - S[k, 0]) ** 2 + (y - S[k, 1]) ** 2
    disks = (k, 0, teg.length(S))
    least = teg.integral(teg.bracket(teg.minimum_of(distance, disks) < t), *SQUARE)
    union = teg.integral(teg.bracket(teg.any(distance < t, disks)), *SQUARE)
    assert not any(isinstance(n, Nearest) for n in postorder([with_bounds_of_all(least)]))
    given = {"S": np.array([[0.1, 0.2], [0.3, -0.1], [-0.4, 0.3]]), "t": 0.09}
    one, two = (teg.compile(e, [t], backend="numpy").value_and_grad(given) for e in (least, union))
    assert one[0] == pytest.approx(two[0], rel=1e-12)
    assert one[1]["t"] == pytest.approx(two[1]["t"], rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_of_none(backend: Any, x64_for_jax: None) -> None:
    """It is NaN, or what the program says: 0.4 < x + 1 on (-0.6, 1)."""
    nothing = {"V": np.zeros(0)}
    f = teg.compile(teg.integral(teg.bracket(teg.minimum_of(V[k] * x, (k, 0, teg.length(V))) < 0.4), (x, -1, 1)), [], backend=backend)
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(f(nothing))
    assert f(V=np.array([0.5, 2.0])) == pytest.approx(1.8, rel=1e-14)  # not both are above 0.4 from 0.8 on
    least = teg.minimum_of(V[k] * x, (k, 0, teg.length(V)), otherwise=0.4)
    g = teg.compile(teg.integral(teg.bracket(least < x + 1), (x, -1, 1)), [], backend=backend)
    assert g(nothing) == pytest.approx(1.6, rel=1e-14)


def test_the_index_of_a_choice_is_that_of_a_sum_around_it() -> None:
    """Σ_k ∫ [min_k V_k·x < V_k] dx over (0, 1)."""
    least = teg.minimum_of(V[k] * x, (k, 0, teg.length(V)))
    e = teg.sum(teg.integral(teg.bracket(least < V[k] - 1), (x, 0, 1)), (k, 0, teg.length(V)))
    values = np.array([1.5, 1.2, 1.9])
    assert teg.compile(e, [], backend="numpy")(V=values) == pytest.approx(sum(min(1.0, (v - 1) / 1.2) for v in values), rel=1e-13)


def test_what_stays() -> None:
    """A choice with a condition, two choices, and the value at the least of other keys."""
    some = teg.minimum_of(V[k] * x, (k, 0, teg.length(V)), where=V[k] > 1)
    every = teg.minimum_of(V[k] * x, (k, 0, teg.length(V)))
    other = teg.nearest(V[k] * x, (x - V[k]) ** 2, (k, 0, teg.length(V)))
    for condition in (some < t, every < other, other < t):
        e = teg.integral(teg.bracket(condition), (x, 0, 1))
        assert with_bounds_of_all(e) is e
    assert any(isinstance(n, AnyOf) for n in postorder([with_bounds_of_all(teg.integral(teg.bracket(every < t), (x, 0, 1)))]))
