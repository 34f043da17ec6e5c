"""Ranges of iterations that are narrowed: never an iteration with a result is left out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.c.lanes import Packed
from teg.backends.c.loops import print_arrays
from teg.backends.c.ranges import narrowing
from teg.program import Assign
from tests.backends.c_checks import in_c

pytestmark = [*in_c, pytest.mark.filterwarnings("error")]

x, y = teg.vars("x y")
i, j = teg.index("i"), teg.index("j")
lines = teg.array("L", 2)


def known(live: str, *settling: Assign) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """What is known of a decision in which p0 is the index and p9 changes otherwise."""
    found = narrowing(Packed(live, False, settling, (), (), ()), ["p0"], ["p0", "p9"])
    return None if found is None else (found.heights, found.unless)


AFFINE = (Assign("v1", "mul", ("p1", "p0")), Assign("v2", "add", ("v1", "p2")))
OTHER = (Assign("v3", "sub", ("p3", "p0")),)


def test_what_two_conditions_require() -> None:
    both = (Assign("b1", "gt0", ("v2",)), Assign("b2", "lt0", ("v3",)), Assign("b3", "not", ("b2",)), Assign("b4", "and", ("b1", "b3")))
    assert known("b4", *AFFINE, *OTHER, *both) == (("v2", "v3"), ())


def test_what_one_of_two_requires_is_what_both_do() -> None:
    atoms = (Assign("b1", "gt0", ("v2",)), Assign("b2", "ge0", ("v3",)), Assign("b3", "ge0", ("v2",)))
    either = (Assign("b4", "and", ("b1", "b2")), Assign("b5", "or", ("b4", "b3")))
    assert known("b5", *AFFINE, *OTHER, *atoms, *either) == (("v2",), ())
    apart = Assign("b5", "or", ("b1", "b2"))
    assert known("b5", *AFFINE, *OTHER, *atoms, apart) is None


def test_a_condition_that_is_the_same_everywhere() -> None:
    steady = Assign("b2", "gt0", ("p5",))
    assert known("b3", *AFFINE, Assign("b1", "gt0", ("v2",)), steady, Assign("b3", "or", ("b1", "b2"))) == (("v2",), ("b2",))
    assert known("b3", *AFFINE, Assign("b1", "gt0", ("v2",)), steady, Assign("b3", "and", ("b1", "b2"))) == (("v2",), ())


@pytest.mark.parametrize(
    ("bent", "convex"),
    [
        (Assign("v4", "abs", ("v2",)), True),
        (Assign("v4", "neg", ("v2",)), True),
        (Assign("v4", "mul", ("v2", "v3")), False),
        (Assign("v4", "mul", ("v2", "p9")), False),
        (Assign("v4", "add", ("v2", "p9")), False),
        (Assign("v4", "div", ("v2", "v3")), False),
    ],
)
def test_only_convex_numbers_count(bent: Assign, convex: bool) -> None:
    assert (known("b1", *AFFINE, *OTHER, bent, Assign("b1", "gt0", ("v4",))) is not None) is convex
    assert known("b2", *AFFINE, *OTHER, bent, Assign("b1", "gt0", ("v4",)), Assign("b2", "not", ("b1",))) is None
    away = (Assign("v5", "neg", ("v4",)), Assign("v6", "mul", (-2.0, "v4")))
    for name in ("v5", "v6"):
        concave = known("b1", *AFFINE, *OTHER, bent, *away, Assign("b1", "gt0", (name,)))
        assert (concave is not None) is (bent.op == "neg")


def covering(fast: str, *deciding: Assign) -> tuple[tuple[str, ...], tuple[str, ...], list[Assign]]:
    """What covers iterations that are live where p0 of AFFINE is positive enough, and what computes it."""
    live = (*AFFINE, Assign("b9", "ge0", ("v2",)))
    found = narrowing(Packed("b9", fast, live, (*live, *deciding), (), ()), ["p0"], ["p0", "p9"])
    assert found is not None
    return found.covers, found.provided, list(found.body)


def test_what_covers_is_positive() -> None:
    covers, provided, _ = covering(
        "b4", *OTHER, Assign("b1", "gt0", ("v3",)), Assign("b2", "gt0", ("p5",)), Assign("b4", "and", ("b1", "b2"))
    )
    assert (covers, provided) == (("v3", "v2"), ("b2",))


def test_a_number_that_must_be_negative_covers_with_its_opposite() -> None:
    covers, _, body = covering("b3", *OTHER, Assign("b1", "ge0", ("v3",)), Assign("b3", "not", ("b1",)))
    opposite, _ = covers
    assert Assign(opposite, "neg", ("v3",)) in body


def test_a_number_that_bends_the_wrong_way_covers_without_its_bend() -> None:
    """|g| ≥ 0, so that what is positive without it is positive."""
    bent = (*OTHER, Assign("v4", "abs", ("v3",)), Assign("v5", "mul", (0.5, "v4")), Assign("v6", "add", ("v2", "v5")))
    (least, _), _, body = covering("b1", *bent, Assign("b1", "gt0", ("v6",)))
    made = {s.name: s for s in body}
    assert least != "v6"
    assert [made[str(a)].op for a in made[least].args] == ["add", "mul"]
    assert made[str(made[str(made[least].args[1])].args[1])].args == (0.0,)
    (concave, _), _, _ = covering("b1", *bent[:-1], Assign("v6", "sub", ("v2", "v5")), Assign("b1", "gt0", ("v6",)))
    assert concave == "v6"


def test_nothing_covers_where_that_is_not_known() -> None:
    product = (*OTHER, Assign("v4", "mul", ("v2", "v3")))
    assert covering("b1", *product, Assign("b1", "gt0", ("v4",)))[0] == ()
    assert covering("b1", *OTHER, Assign("v4", "add", ("v3", "p9")), Assign("b1", "gt0", ("v4",)))[0] == ()
    either = (Assign("b1", "gt0", ("v4",)), Assign("b2", "gt0", ("v3",)), Assign("b3", "or", ("b1", "b2")))
    assert covering("b3", *product, *either)[0] == ("v3", "v2")


def picture() -> teg.Expr:
    """Two half-planes on pixels of rows of 70, the lines of row j being the rows of L."""
    inside = (lines[j, 0] * x + lines[j, 1] * y < lines[j, 2]) & (lines[j, 3] * x + lines[j, 4] * y < lines[j, 5])
    pixel = teg.integral(teg.where(inside, x + y * y, 0), (x, i, i + 1), (y, j, j + 1))
    return teg.sum(pixel, (i, 0, 70), (j, 0, teg.length(lines, 0)))


def placed(seed: int) -> dict[str, Any]:
    """Lines of all slopes; some stand on borders of pixels, some are level, some miss the row, some have no direction."""
    rng = np.random.default_rng(seed)
    n = 40
    found = np.empty((n, 6))
    for k in (0, 3):
        angle = rng.uniform(0, 2 * np.pi, n)
        angle[::5] = np.round(angle[::5] / (np.pi / 2)) * (np.pi / 2)
        found[:, k], found[:, k + 1] = np.cos(angle), np.sin(angle)
        at = rng.uniform(-10, 80, n)
        at[1::4] = np.round(at[1::4])
        found[:, k + 2] = found[:, k] * at + found[:, k + 1] * (np.arange(n) + rng.uniform(-1, 2, n))
    found[7, :2] = 0.0
    found[8] *= 1e-200
    found[9] *= 1e150
    return {"L": found}


@pytest.mark.parametrize("seed", range(3))
def test_as_numpy(seed: int) -> None:
    given = placed(seed)
    c, numpy = (teg.compile(picture(), [lines], backend=b) for b in ("c", "numpy"))
    value, slopes = c.value_and_grad(given)
    expected, wanted = numpy.value_and_grad(given)
    assert value == pytest.approx(expected, rel=1e-13)
    scale = np.abs(wanted["L"]).max(axis=1, keepdims=True)
    np.testing.assert_allclose(slopes["L"] / np.where(scale > 0, scale, 1), wanted["L"] / np.where(scale > 0, scale, 1), rtol=0, atol=1e-11)
    np.testing.assert_allclose(c.grad(given)["L"], slopes["L"], rtol=1e-10, atol=1e-10 * float(scale.min()))


def test_rows_are_narrowed() -> None:
    program = teg.compile(picture(), [lines], backend="numpy").program(1)
    assert "teg_narrow(" in print_arrays(program)  # type: ignore[arg-type]


def test_a_line_through_a_corner_of_the_last_pixel() -> None:
    """The least height of x + y > 69 + j is 0 in the last pixel of row j, and negative before: nothing is covered. By hand."""
    row = np.arange(4.0)
    given = np.stack([-1 + 0 * row, -1 + 0 * row, -69 - row, 0 * row, 0 * row, 1 + 0 * row], axis=1)
    exact = (4900 - (69**3 - 68**3) / 3) / 2 + 1.5 * row**2 + 5 / 3 * row + 7 / 12
    f = teg.compile(picture(), [lines], backend="c")
    assert f(L=given) == pytest.approx(exact.sum(), rel=1e-13)


def test_iterations_that_nothing_crosses_are_not_looked_at() -> None:
    source = teg.compile(picture(), [lines], backend="c").source
    assert "teg_cover(" in source
    assert "decision_" not in source


@pytest.mark.parametrize("columns", [0, 1, 2, 7, 9, 64])
@pytest.mark.parametrize("at", [0, 65536])
def test_rows_of_any_width(columns: int, at: int) -> None:
    """Rows that are empty, shorter than the places side by side, or far from the origin, with bounds from data."""
    ends = teg.indices("ends", 2)
    inside = (lines[j, 0] * (x - at) + lines[j, 1] * y < lines[j, 2]) & (lines[j, 3] * (x - at) + lines[j, 4] * y < lines[j, 5])
    pixel = teg.integral(teg.where(inside, (x - at) + y * y, 0), (x, i, i + 1), (y, j, j + 1))
    total = teg.sum(pixel, (i, ends[j, 0], ends[j, 1]), (j, 0, teg.length(lines, 0)))
    given = placed(5)
    given["L"][:, (2, 5)] -= given["L"][:, (0, 3)] * (35 - columns / 2)
    spans = np.stack([np.full(40, at), at + columns + np.arange(40) % 3 - 1], axis=1)
    spans[:, 1] = np.maximum(spans[:, 1], at)
    given["ends"] = spans
    (value, slopes), (expected, wanted) = (teg.compile(total, [lines], backend=b).value_and_grad(given) for b in ("c", "numpy"))
    scale = np.maximum(np.abs(wanted["L"]).max(axis=1, keepdims=True), 1e-300)
    assert value == pytest.approx(expected, rel=1e-12, abs=1e-12)
    np.testing.assert_allclose(slopes["L"] / scale, wanted["L"] / scale, rtol=0, atol=2e-11)


def test_a_condition_on_data_is_decided_for_each_iteration() -> None:
    """Masked pixels do not wait for surfaces."""
    mask = teg.array("M", 2)
    inside = lines[j, 0] * x + lines[j, 1] * y < lines[j, 2]
    pixel = teg.integral(teg.where(inside & (mask[j, i] > 0.5), x + y * y, 0), (x, i, i + 1), (y, j, j + 1))
    total = teg.sum(pixel, (i, 0, 70), (j, 0, teg.length(lines, 0)))
    given = {**placed(6), "M": np.random.default_rng(2).integers(0, 2, (40, 70)).astype(float)}
    c, numpy = (teg.compile(total, [lines], backend=b) for b in ("c", "numpy"))
    value, slopes = c.value_and_grad(given)
    expected, wanted = numpy.value_and_grad(given)
    assert value == pytest.approx(expected, rel=1e-13)
    scale = np.maximum(np.abs(wanted["L"]).max(axis=1, keepdims=True), 1e-300)
    np.testing.assert_allclose(slopes["L"] / scale, wanted["L"] / scale, rtol=0, atol=1e-11)
    assert "decision_" in c.source


def test_an_index_that_is_not_a_place_narrows_nothing() -> None:
    """The pixel of an iteration is looked up."""
    columns = teg.indices("columns", 1)
    at = columns[i]
    inside = lines[j, 0] * x + lines[j, 1] * y < lines[j, 2]
    pixel = teg.integral(teg.where(inside, x, 0), (x, at, at + 1), (y, j, j + 1))
    total = teg.sum(pixel, (i, 0, teg.length(columns, 0)), (j, 0, teg.length(lines, 0)))
    given = {**placed(4), "columns": np.random.default_rng(0).permutation(70)}
    found = [teg.compile(total, [lines], backend=b).value_and_grad(given)[0] for b in ("c", "numpy")]
    assert found[0] == pytest.approx(found[1], rel=1e-13)
    ordered = {**given, "columns": np.arange(70)}
    assert teg.compile(total, [lines], backend="c")(ordered) == pytest.approx(found[0], rel=1e-13)


FACES, COLUMN, ROW = teg.indices("F", 2), teg.index("c"), teg.index("r")
corners, tones, target, rows_of_columns = teg.array("V", 2), teg.array("C", 2), teg.array("T", 2), teg.indices("ends", 3)


def faces(bounds: str) -> teg.Expr:
    """Triangles over pixels: a linear tone beside a picture, squared. `bounds` says what the columns of a row depend on."""
    k = teg.index("k")
    at = [(corners[FACES[k, m], 0], corners[FACES[k, m], 1]) for m in range(3)]
    edges = [(at[n][0] - at[m][0]) * (y - at[m][1]) - (at[n][1] - at[m][1]) * (x - at[m][0]) for m, n in ((1, 2), (2, 0), (0, 1))]
    area = edges[0] + edges[1] + edges[2]
    shade = sum((e / area * tones[k, m] for m, e in enumerate(edges)), start=0 * x)
    inside = (edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0)
    pixel = teg.integral(teg.bracket(inside) * (shade - target[ROW, COLUMN]) ** 2, (x, COLUMN, COLUMN + 1), (y, ROW, ROW + 1))
    columns = {
        "the face": (COLUMN, FACES[k, 3], FACES[k, 4]),
        "the row": (COLUMN, ROW // 3, ROW + 1),
        "both": (COLUMN, rows_of_columns[k, ROW, 0], rows_of_columns[k, ROW, 1]),
    }[bounds]
    return teg.sum(pixel, columns, (ROW, FACES[k, 5], FACES[k, 6]), (k, 0, teg.length(FACES, 0)))


def placed_faces(seed: int, size: int = 24) -> dict[str, Any]:
    """Triangles of all sizes, clockwise ones, slivers, corners on corners of pixels, rows in any number from none to all."""
    rng = np.random.default_rng(seed)
    n = 30
    middle, reach = rng.uniform(0, size, (n, 1, 2)), 10 ** rng.uniform(-1, 1.3, (n, 1, 1))
    places = np.clip(middle + reach * rng.normal(size=(n, 3, 2)), 0, size)
    places[::4] = np.round(places[::4])
    places[1, 2] = 0.5 * (places[1, 0] + places[1, 1]) + 1e-9
    boxes = np.sort(rng.integers(0, size + 1, (n, 2, 2)), axis=2)
    boxes[:10] = [0, size]
    indices = np.concatenate([np.arange(3 * n).reshape(n, 3), boxes.reshape(n, 4)], axis=1)
    return {
        "V": places.reshape(-1, 2),
        "F": indices,
        "C": rng.random((n, 3)),
        "T": rng.random((size, size)),
        "ends": np.sort(rng.integers(0, size + 1, (n, size, 2)), axis=2),
    }


@pytest.mark.parametrize("bounds", ["the face", "the row", "both"])
@pytest.mark.parametrize("seed", range(2))
def test_rows_side_by_side(bounds: str, seed: int) -> None:
    given = placed_faces(seed)
    if bounds != "both":
        del given["ends"]
    e = faces(bounds)
    c, numpy = (teg.compile(e, [corners, tones], backend=b) for b in ("c", "numpy"))
    assert "spans_" in c.source
    value, slopes = c.value_and_grad(given)
    expected, wanted = numpy.value_and_grad(given)
    assert value == pytest.approx(expected, rel=1e-12)
    for name in ("V", "C"):
        of_face = np.abs(wanted[name]).reshape(30, -1).max(axis=1).repeat(wanted[name].size // 30).reshape(wanted[name].shape)
        np.testing.assert_allclose(
            slopes[name] / np.maximum(of_face, 1e-300), wanted[name] / np.maximum(of_face, 1e-300), rtol=0, atol=3e-11
        )
    assert c.value_and_grad(given)[0] == value
