"""Choices and sums inside integrals over lists whose lengths are data: by closed forms of disks, and by NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import teg
from teg.evaluator.lengths import Lengths
from teg.passes.normalise.padded import most_of

x, y = teg.vars("x y")
t = teg.param("t")
disks, values = teg.array("disks", 2), teg.array("values", 1)
first, listed = teg.indices("first", 1), teg.indices("listed", 1)
p, k = teg.index("p"), teg.index("k")
LIST = (k, first[p], first[p + 1])
SIDE = 4
BACKENDS = ["c", "numpy"]


def pixels(integrand: object) -> teg.Expr:
    """The sum of an integral over all pixels."""
    across, up = p % SIDE, p // SIDE
    return teg.sum(teg.integral(integrand, (x, across, across + 1), (y, up, up + 1)), (p, 0, SIDE * SIDE))


def in_disk(i: Any) -> teg.Cond:
    return (x - disks[i, 0]) ** 2 + (y - disks[i, 1]) ** 2 < disks[i, 2] ** 2


def in_squircle(i: Any) -> teg.Cond:
    """A condition whose edge has no formula, so that candidates are written out."""
    return (x - disks[i, 0]) ** 4 + (y - disks[i, 1]) ** 4 < disks[i, 2] ** 4


def lists_of(at: np.ndarray) -> dict[str, np.ndarray]:
    """Those disks that reach into each pixel."""
    rows = []
    for q in range(SIDE * SIDE):
        corner = np.array([q % SIDE, q // SIDE])
        away = np.maximum(np.maximum(corner - at[:, :2], at[:, :2] - corner - 1), 0)
        rows.append(np.flatnonzero((away**2).sum(1) < at[:, 2] ** 2))
    return {"first": np.cumsum([0, *map(len, rows)]), "listed": np.concatenate(rows)}


AT = np.array([[1.1, 1.2, 0.7], [1.9, 1.7, 0.6], [2.9, 3.0, 0.5]])  # two that overlap, and one apart


def lens(at: np.ndarray) -> tuple[float, np.ndarray]:
    """The area that the first two disks have in common, and their half-angles in it."""
    (r, s), d = at[:2, 2], np.hypot(*(at[0, :2] - at[1, :2]))
    half = np.arccos([(d * d + r * r - s * s) / (2 * d * r), (d * d + s * s - r * r) / (2 * d * s)])
    return float(np.sum(at[:2, 2] ** 2 * (half - np.sin(2 * half) / 2))), half


@pytest.mark.parametrize("backend", BACKENDS)
def test_area_of_a_union_of_disks(backend: str) -> None:
    f = teg.compile(pixels(teg.bracket(teg.any(in_disk(listed[k]), LIST))), [disks], backend=backend)
    area, slopes = f.value_and_grad(disks=AT, **lists_of(AT))
    common, half = lens(AT)
    assert area == pytest.approx(np.pi * (AT[:, 2] ** 2).sum() - common, abs=1e-10)
    open_arcs = 2 * np.pi - np.array([*(2 * half), 0.0])
    assert slopes["disks"][:, 2] == pytest.approx(AT[:, 2] * open_arcs, abs=1e-9)  # a radius moves the arc that is seen


@pytest.mark.parametrize("backend", BACKENDS)
def test_entries_at_places_are_exact(backend: str) -> None:
    """Two disks with their tops at one height: the estimate is that of a program without lists."""
    at = np.array([[0.4, 0.5, 0.3], [0.75, 0.5, 0.3]])
    box = ((x, 0, 2), (y, 0, 1))
    union, plain = (
        teg.compile(teg.integral(teg.bracket(teg.any(in_disk(k), (k, 0, n))), *box), [disks], backend=backend)
        for n in (first[0], teg.length(disks, 0))
    )
    value, error = union.value_and_error(disks=at, first=np.array([2]))
    assert value == pytest.approx(np.pi * 0.18 - lens(at)[0], abs=1e-13)
    assert error == pytest.approx(plain.value_and_error(disks=at)[1], rel=1e-6)


def test_second_derivatives_of_a_union() -> None:
    f = teg.compile(pixels(teg.bracket(teg.any(in_disk(listed[k]), LIST))), [disks])
    along = np.zeros_like(AT)
    along[2, 2] = 1.0
    assert f.hvp({"disks": AT, **lists_of(AT)}, {"disks": along})["disks"][2] == pytest.approx([0, 0, 2 * np.pi], abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_all_and_products_of_a_list(backend: str) -> None:
    """In one box, the area of what two disks have in common; nothing is in all of no disks but everything."""
    box = ((x, 0, 4), (y, 0, 4))
    common = teg.integral(teg.bracket(teg.all(in_disk(listed[k]), (k, first[0], first[1]))), *box)
    product = teg.integral(teg.prod(teg.bracket(in_disk(listed[k])), (k, first[0], first[1])), *box)
    f = teg.compile(teg.tuple(common, product), [disks], backend=backend)
    at = {"disks": AT, "listed": np.array([1, 0, 2])}
    assert f(first=np.array([0, 2]), **at) == pytest.approx([lens(AT)[0]] * 2, abs=1e-10)
    assert f(first=np.array([0, 1]), **at) == pytest.approx([np.pi * 0.36] * 2, abs=1e-10)
    assert f(first=np.array([2, 2]), **at) == pytest.approx([16.0] * 2, abs=1e-12)


def lowest(at: Mapping[str, np.ndarray], chosen: np.ndarray, n: int = 400_000) -> float:
    """∫ over [0, 1] of the value whose parabola is lowest, by midpoints."""
    place = (np.arange(n) + 0.5) / n
    heights = at["disks"][chosen, 1, None] + at["disks"][chosen, 2, None] * (place - at["disks"][chosen, 0, None]) ** 2
    return float(at["values"][chosen][heights.argmin(0)].mean())


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_lowest_of_parabolas(backend: str) -> None:
    key = disks[listed[k], 1] + disks[listed[k], 2] * (x - disks[listed[k], 0]) ** 2
    nearest = teg.nearest(values[listed[k]], key, LIST, otherwise=t)
    f = teg.compile(teg.sum(teg.integral(nearest, (x, 0, 1)), (p, 0, teg.length(first, 0) - 1)), [values, t], backend=backend)
    at = {
        "disks": np.array([[0.1, 0.0, 1.0], [0.4, 0.1, 3.0], [0.8, -0.05, 0.5], [0.6, 0.02, 7.0]]),
        "values": np.array([1.0, 5.0, -2.0, 11.0]),
    }
    rows = [np.array([0, 2]), np.array([], int), np.array([3, 1, 2]), np.array([1])]
    lists = {"first": np.cumsum([0, *map(len, rows)]), "listed": np.concatenate(rows)}
    value, slopes = f.value_and_grad(t=0.25, **at, **lists)
    assert value == pytest.approx(0.25 + sum(lowest(at, row) for row in rows if len(row)), abs=1e-4)
    assert slopes["t"] == pytest.approx(1.0, abs=1e-12)  # of the row without candidates
    assert slopes["values"].sum() == pytest.approx(3.0, abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sum_in_a_function(backend: str) -> None:
    """∫ √(Σ_k V_k·x) dx = ⅔ √ΣV: the terms of an empty list are none."""
    inner = teg.sum(values[listed[k]] * x, LIST)
    f = teg.compile(teg.sum(teg.integral(teg.sqrt(1 + inner) * teg.bracket(x < t), (x, 0, 1)), (p, 0, 3)), [values, t], backend=backend)
    lists = {"first": np.array([0, 2, 2, 3]), "listed": np.array([0, 2, 1])}
    found, slopes = f.value_and_grad(t=0.5, values=np.array([1.0, 2.0, 3.0]), **lists)
    totals = np.array([4.0, 2.0])
    assert found == pytest.approx(0.5 + ((2 / 3) * ((1 + totals * 0.5) ** 1.5 - 1) / totals).sum(), rel=1e-11)
    assert slopes["t"] == pytest.approx(1 + np.sqrt(1 + totals * 0.5).sum(), rel=1e-11)


def test_a_number_of_candidates_is_a_parameter() -> None:
    n = teg.param("n")
    e = teg.integral(teg.bracket(teg.any((x - values[k]) ** 2 < t, (k, 0, n))), (x, 0, 10))
    f = teg.compile(e, [values, t])
    at = np.array([1.0, 2.0, 7.0])
    assert [f(values=at, t=0.25, n=m) for m in (0, 1, 2, 3)] == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=1e-12)
    assert f(values=at, t=0.25, n=[3, 1]) == pytest.approx([3.0, 1.0], abs=1e-12)
    assert f(values=at, t=1.0, n=2) == pytest.approx(3.0, abs=1e-12)  # they overlap
    assert f(values=at, t=[], n=np.zeros(0, int)).shape == (0,)


def test_lists_in_lists() -> None:
    """Intervals in common, of lists in a list: (0.15, 0.5) of the first two, and (0.7, 0.9)."""
    j, inner = teg.index("j"), teg.indices("inner", 1)
    near = teg.all((x - disks[j, 0]) ** 2 < disks[j, 2] ** 2, (j, inner[k], inner[k + 1]))
    f = teg.compile(teg.integral(teg.bracket(teg.any(near, (k, first[0], first[1]))), (x, 0, 1)), [disks])
    at = {"disks": np.array([[0.3, 0, 0.2], [0.35, 0, 0.2], [0.8, 0, 0.1]])}
    assert f(first=[0, 2], inner=[0, 2, 3], **at) == pytest.approx(0.55, abs=1e-13)
    assert f(first=[1, 2], inner=[0, 2, 3], **at) == pytest.approx(0.2, abs=1e-13)
    assert f(first=[0, 2], inner=[0, 0, 3], **at) == pytest.approx(1.0, abs=1e-13)  # all of none


def test_a_program_is_made_for_each_number_of_places(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[teg.Expr] = []
    monkeypatch.setattr(Lengths, "_compiled", lambda self, e, make=Lengths._compiled: (made.append(e), make(self, e))[1])
    f = teg.compile(pixels(teg.bracket(teg.any(in_squircle(listed[k]), LIST))), [disks])
    lists = lists_of(AT)
    f(disks=AT, **lists)
    assert "any[k: first[p]..first[(p + 1)]]" in f.explain().data["expression"]
    before = len(made)
    fewer = {"first": np.minimum(lists["first"], lists["first"][-1] - 1), "listed": lists["listed"]}
    f(disks=AT, **fewer)  # as many in the longest list
    assert len(made) == before
    assert f(disks=AT, first=np.zeros(SIDE * SIDE + 1, int), listed=np.array([0])) == 0.0
    assert len(made) == before + 1


@pytest.mark.parametrize(
    ("lists", "message"),
    [
        ({"first": np.array([3, 2]), "listed": np.array([0, 1, 2])}, "negative length"),
        ({"first": np.array([0, 2]), "listed": np.array([0, 9])}, "the index 9 is out of range"),
        ({"first": np.array([0, 300]), "listed": np.zeros(300, int)}, "300 candidates; 256 at most"),
    ],
)
def test_lists_that_cannot_be(lists: dict[str, np.ndarray], message: str) -> None:
    one = (k, first[0], first[1])
    f = teg.compile(teg.integral(teg.bracket(teg.any(in_squircle(listed[k]), one)), (x, 0, 1), (y, 0, 1)), [disks])
    with pytest.raises(teg.errors.ArrayIndexError, match=message):
        f(disks=AT, **lists)


def test_ranges_that_are_bounded() -> None:
    def choice(lo: Any, hi: Any) -> Any:
        condition = teg.any(x < values[k], (k, lo, hi))
        return condition

    n = first[0]
    assert most_of(choice(2, 5)) == 3
    assert most_of(choice(0, n % 4)) == 3
    assert most_of(choice(n, n + n % 4)) == 3
    assert most_of(choice(n, first[1])) is None
    assert most_of(choice(1, n % 4)) is None


@pytest.mark.usefixtures("x64")
def test_in_jax() -> None:
    import jax

    lists = lists_of(AT)
    f = teg.jax_function(pixels(teg.bracket(teg.any(in_disk(listed[k]), LIST))), indices=lists)
    area, slopes = jax.value_and_grad(lambda at: f(disks=at))(AT)
    common, half = lens(AT)
    assert float(area) == pytest.approx(np.pi * (AT[:, 2] ** 2).sum() - common, abs=1e-10)
    assert np.asarray(slopes)[0, 2] == pytest.approx(AT[0, 2] * (2 * np.pi - 2 * half[0]), abs=1e-9)
    open_ = teg.jax_function(pixels(teg.bracket(teg.any(in_squircle(listed[k]), LIST))))
    with pytest.raises(teg.errors.ArrayIndexError, match="how many candidates an integral has depends on first, which JAX traces"):
        jax.jit(lambda lists: open_(disks=AT, **lists))(lists)
