"""Sums over lists in which neighbours are alike: the same results as without runs, whatever the lists are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg.evaluator.runs import LONG, PIECE
from tests.backends.c_checks import in_c

pytestmark = pytest.mark.filterwarnings("error")

x, y = teg.vars("x y")
lines, shades, picture = teg.array("L", 2), teg.array("C"), teg.array("T", 2)
pairs, n, m = teg.indices("P", 2), teg.index("n"), teg.param("m")
BACKENDS = ["numpy", pytest.param("c", marks=in_c)]


def pixels(hi: Any = None) -> teg.Expr:
    """Half-planes over pixels: a pair has a half-plane, a column and a row."""
    face, column, row = pairs[n, 0], pairs[n, 1], pairs[n, 2]
    inside = lines[face, 0] * x + lines[face, 1] * y < lines[face, 2]
    difference = shades[face] * (1 + x) - picture[row, column]
    pixel = teg.integral(teg.bracket(inside) * difference**2, (x, column, column + 1), (y, row, row + 1))
    return teg.sum(pixel, (n, 0, teg.length(pairs) if hi is None else hi))


def given(order: str, faces: int = 12, size: int = 9, seed: int = 0) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, faces)
    found = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-4, 9, faces)], axis=1)
    data = {"L": found, "C": rng.random(faces), "T": rng.random((size, size))}
    face, row, column = np.meshgrid(np.arange(faces), np.arange(size), np.arange(size), indexing="ij")
    listed = np.stack([face.ravel(), column.ravel(), row.ravel()], axis=1)
    if order == "by row":
        listed = listed[np.lexsort((listed[:, 0], listed[:, 2]))]
    elif order == "mixed":
        listed = rng.permutation(listed)
    elif order == "half":
        listed[len(listed) // 2 :] = rng.permutation(listed[len(listed) // 2 :])
    elif order == "one":
        listed = listed[listed[:, 0] == 3]
    elif order == "few":
        listed = listed[:LONG]
    elif order == "none":
        listed = listed[:0]
    return {**data, "P": listed}


def by_runs(f: teg.Evaluator) -> bool:
    """Whether a program by runs was made."""
    kernel: Any = f.kernel(1)
    return any(any(chosen) for chosen in kernel._kernels)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("order", ["by face", "by row", "mixed", "half", "one", "few", "none"])
def test_same_results_as_without_runs(order: str, backend: str) -> None:
    e, data = pixels(), given(order)
    f = teg.compile(e, [lines, shades], backend=backend)
    value, slopes = f.value_and_grad(data)
    expected, wanted = teg.compile(e, [lines, shades], backend="numpy", intrinsics=False).value_and_grad(data)
    assert value == pytest.approx(expected, rel=1e-12, abs=1e-14)
    for name in ("L", "C"):
        np.testing.assert_allclose(slopes[name], wanted[name], rtol=1e-11, atol=1e-12)
    assert by_runs(f) is (order in ("by face", "by row", "one"))
    assert f(data) == pytest.approx(expected, rel=1e-12, abs=1e-14)
    assert f.source


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_evaluator_for_lists_of_both_kinds(backend: str) -> None:
    f = teg.compile(pixels(), [lines, shades], backend=backend)
    for order in ("mixed", "by face", "mixed"):
        assert f(given(order)) == pytest.approx(f(given("by face")), rel=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_derivatives_along_a_direction(backend: str) -> None:
    data, rng = given("by face"), np.random.default_rng(1)
    along = {"L": rng.normal(size=data["L"].shape), "C": rng.normal(size=12)}
    f = teg.compile(pixels(), [lines, shades], backend=backend)
    plain = teg.compile(pixels(), [lines, shades], backend="numpy", intrinsics=False)
    for found, wanted in zip(f.hvp(data, along).values(), plain.hvp(data, along).values(), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_batch_shares_lists(backend: str) -> None:
    data = given("by face")
    batch = {**data, "C": np.stack([data["C"], 2 * data["C"]])}
    f = teg.compile(pixels(), [lines, shades], backend=backend)
    value, slopes = f.value_and_grad(batch)
    for i in range(2):
        one, its = f.value_and_grad({**data, "C": batch["C"][i]})
        assert value[i] == one
        np.testing.assert_array_equal(slopes["L"][i], its["L"])
    own = {**data, "P": np.stack([data["P"], given("mixed")["P"]])}
    np.testing.assert_allclose(f(own), [f(data)] * 2, rtol=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_end_that_is_a_parameter(backend: str) -> None:
    data = given("by face")
    f = teg.compile(pixels(m), [lines, shades], backend=backend)
    for end in (0, 5, 500, 972):
        assert f({**data, "m": end}) == pytest.approx(teg.evaluate(pixels(), {**data, "P": data["P"][:end]}), rel=1e-12)
    several = f({**data, "m": [5, 500]})
    np.testing.assert_allclose(several, [f({**data, "m": end}) for end in (5, 500)], rtol=1e-13)


@in_c[0]
def test_threads_change_no_bit() -> None:
    data = given("by face", faces=400)
    one, two = (teg.compile(pixels(), [lines, shades], backend="c", threads=t).value_and_grad(data) for t in (1, 2))
    assert one[0] == two[0]
    np.testing.assert_array_equal(one[1]["L"], two[1]["L"])


def test_long_runs_are_cut() -> None:
    """One half-plane on 100² pixels: several runs, so that threads can share it."""
    data = given("one", faces=4, size=100)
    f = teg.compile(pixels(), [lines, shades], backend="numpy")
    assert f(data) == pytest.approx(teg.compile(pixels(), [lines, shades], backend="numpy", intrinsics=False)(data), rel=1e-13)
    kernel: Any = f.kernel(0)
    (listed,) = kernel.lists.lists
    _, (starts,) = kernel._starts(listed, [], [data[name] for name in f.parameters])
    assert starts.tolist() == [0, PIECE, 2 * PIECE, 10000]


def choices(f: teg.Evaluator) -> list[Any]:
    """The choices of the programs that were made, list by list."""
    kernel: Any = f.kernel(1)
    return [choice for chosen in kernel._kernels for choice in chosen]


@in_c[0]
@pytest.mark.parametrize("size", [9, 70])
def test_rows_of_runs(size: int) -> None:
    """In C, pixels by rows and columns: a row is one range, at whose ends gaps are. A weight of each pair leaves only runs."""
    data = given("by face", faces=5, size=size)
    keep = np.random.default_rng(2).random(len(data["P"])) > 0.05
    data["P"] = data["P"][keep]
    data["W"] = np.random.default_rng(3).random(len(data["P"]))
    weight = teg.array("W")[n]
    weighted = teg.sum(weight * shades[pairs[n, 0]] * (1 + pairs[n, 1]), (n, 0, teg.length(pairs)))
    for e, counting in ((pixels(), 1), (pixels() + weighted, None)):
        f = teg.compile(e, [lines, shades], backend="c")
        at = {name: data[name] for name in f.parameters}
        value, slopes = f.value_and_grad(at)
        expected, wanted = teg.compile(e, [lines, shades], backend="numpy", intrinsics=False).value_and_grad(at)
        assert value == pytest.approx(expected, rel=1e-12)
        for name in ("L", "C"):
            np.testing.assert_allclose(slopes[name], wanted[name], rtol=1e-11, atol=1e-10)
        (choice,) = choices(f)
        assert (choice.counting.places[1] if choice.counting else None) == counting


@in_c[0]
def test_lists_of_columns_apart() -> None:
    """Each entry is an array of its own, some of them with strides."""
    face, column, row = (teg.indices(name) for name in ("F", "X", "Y"))
    inside = lines[face[n], 0] * x + lines[face[n], 1] * y < lines[face[n], 2]
    pixel = teg.integral(teg.bracket(inside), (x, column[n], column[n] + 1), (y, row[n], row[n] + 1))
    e = teg.sum(pixel, (n, 0, teg.length(face)))
    data = given("by face")
    apart = {"L": data["L"], "F": data["P"][:, 0].copy(), "X": data["P"][:, 1], "Y": data["P"][:, 2].astype(np.int32)}
    f = teg.compile(e, [lines], backend="c")
    value, slopes = f.value_and_grad(apart)
    expected, wanted = teg.compile(e, [lines], backend="numpy", intrinsics=False).value_and_grad(apart)
    assert value == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(slopes["L"], wanted["L"], rtol=1e-11, atol=1e-10)
    assert [choice.counting.array.name for choice in choices(f)] == ["X"]


@in_c[0]
def test_integers_behind_which_there_is_none() -> None:
    """Numbers up to the largest integer: lists with them have runs, but no rows."""
    e = teg.sum(shades[pairs[n, 0]] * pairs[n, 1], (n, 0, teg.length(pairs)))
    top = 2**63 - 20
    data = {"C": np.array([1.0, 3.0]), "P": np.array([[a, top + b] for a in range(2) for b in range(20)])}
    f = teg.compile(e, [shades], backend="c")
    for last in (20, 40):
        part = {**data, "P": data["P"][:last]}
        expected = sum(data["C"][a] * float(b) for a, b in part["P"].tolist())
        assert f(part) == pytest.approx(expected, rel=1e-14)


def test_two_lists_and_a_function_of_a_sum() -> None:
    others = teg.indices("Q", 1)
    e = teg.sqrt(pixels()) + teg.sum(shades[others[n]] ** 2, (n, 0, teg.length(others)))
    data = {**given("by face"), "Q": np.repeat(np.arange(12), 20)}
    f = teg.compile(e, [shades], backend="numpy")
    value, slopes = f.value_and_grad(data)
    expected, wanted = teg.compile(e, [shades], backend="numpy", intrinsics=False).value_and_grad(data)
    assert value == pytest.approx(expected, rel=1e-13)
    np.testing.assert_allclose(slopes["C"], wanted["C"], rtol=1e-12)
    assert sum(map(bool, next(iter(f.kernel(1)._kernels)))) == 2


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_index_that_is_out_of_range_is_named(backend: str) -> None:
    data = given("by face")
    data["P"][700, 0] = 12
    with pytest.raises(teg.errors.ArrayIndexError, match="12"):
        teg.compile(pixels(), [lines, shades], backend=backend).value_and_grad(data)


def test_explain_names_lists() -> None:
    found = teg.compile(pixels(), [lines, shades]).explain()
    assert found.data["lists"] == {"n": ["P[n, 0]"]}
    assert "Lists of n: where neighbours have equal P[n, 0]" in str(found)
    assert teg.compile(pixels(), [lines, shades], intrinsics=False).explain().data["lists"] == {}


def test_names_of_the_users_are_not_taken() -> None:
    f = teg.compile(pixels(), [lines, shades], backend="numpy")
    f.value_and_grad(given("by face"))
    assert sorted(f.parameters) == ["C", "L", "P", "T"]
