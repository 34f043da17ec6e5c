"""Queues of iterations: to which loop they belong, and that sums do not depend on when they are computed."""

from __future__ import annotations

import re
from typing import Any, cast

import numpy as np
import pytest

import teg
from teg.backends.c.loops import print_arrays
from teg.backends.c.queues import Queue, queue_of
from teg.ir.arrays import arrays_of
from teg.program.arrays import ArrayProgram, Run
from teg.program.summed import summed, with_enclosing
from tests.backends.c_checks import in_c
from tests.bench.scenes import picture

pytestmark = [*in_c, pytest.mark.filterwarnings("error")]

x, y = teg.vars("x y")
i, j = teg.index("i"), teg.index("j")
lines, scale = teg.array("L", 2), teg.array("S", 1)


def pixel() -> teg.Expr:
    """A polynomial on a half-plane of pixel (i, j), its line the row j of L."""
    inside = teg.bracket(lines[j, 0] * x + lines[j, 1] * y < lines[j, 2])
    return teg.integral(inside * (x + y * y), (x, i, i + 1), (y, j, j + 1))


def rows(n: int = 9) -> dict[str, Any]:
    rng = np.random.default_rng(n)
    return {"L": rng.standard_normal((n, 3)) * (1.0, 1.0, 5.0), "S": rng.standard_normal(n)}


def total() -> teg.Expr:
    return teg.sum(pixel(), (i, 0, 11), (j, 0, teg.length(lines, 0)))


def squares() -> teg.Expr:
    """A function of each row's sum: rows must be complete before the next one."""
    return teg.sum(teg.sum(pixel(), (i, 0, 11)) ** 2 * scale[j], (j, 0, teg.length(lines, 0)))


def queues(program: ArrayProgram) -> list[Queue]:
    found = []
    for loop, around in with_enclosing(program.body):
        runs = [s for s in loop.body if isinstance(s, Run)]
        if len(runs) == 1 and loop.results and not any(s is not runs[0] and isinstance(s, Run) for s in loop.body):
            sums = summed(loop, runs[0], around)
            queue = queue_of(sums) if sums else None
            found += [queue] if queue else []
    return found


def test_a_sum_of_sums_has_one_queue() -> None:
    """The queue lives as long as the outermost loop through which results are only added up."""
    program = teg.compile(total(), [], backend="numpy").program(0)
    deepest = max(queues(program), key=lambda q: len(q.chain))
    assert len(deepest.chain) == 2
    assert deepest.carrier.results == tuple(name for name, _ in deepest.sums)
    assert not deepest.after
    assert deepest.indices == ()


def test_a_function_of_a_sum_ends_the_queue() -> None:
    program = teg.compile(squares(), [], backend="numpy").program(0)
    assert all(len(q.chain) == 1 for q in queues(program) if any("Polygon" in type(s).__name__ for s in q.run.program.body))


@pytest.mark.parametrize("e", [total(), squares(), teg.sum(pixel() * scale[i], (i, 0, 9), (j, 0, 9))], ids=["sums", "squares", "scatter"])
def test_as_numpy(e: teg.Expr) -> None:
    """Values and gradients, also where iterations scatter, with any number of threads to the last bit."""
    wrt = [array for array in (lines, scale) if array.name in {name.name for name in arrays_of(e)}]
    at = {name: values for name, values in rows().items() if name in {array.name for array in arrays_of(e)}}
    results = [teg.compile(e, wrt, backend=k).value_and_grad(at) for k in ("c", "numpy")]
    (value, slopes), (expected, others) = results
    assert value == pytest.approx(expected, rel=1e-12)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, others[name], rtol=1e-11, atol=1e-12)
    again, others = teg.compile(e, wrt, backend="c", threads=2).value_and_grad(at)
    assert again == value
    for name, slope in slopes.items():
        np.testing.assert_array_equal(slope, others[name])


@pytest.mark.parametrize("squared", [False, True])
def test_rows_by_themselves_have_queues_for_half_planes(squared: bool) -> None:
    """Where half-planes hold is found for one row at a time if lines differ between rows."""
    inside = (lines[j, 0] * x + lines[j, 1] * y < lines[j, 2]) & (x - lines[j, 1] * y > lines[j, 0])
    row = teg.sum(teg.integral(teg.where(inside, x + y * y, 0), (x, i, i + 1), (y, j, j + 1)), (i, 0, 40))
    e = teg.sum(row**2 if squared else row, (j, 0, teg.length(lines, 0)))
    rng = np.random.default_rng(5)
    at = {"L": rng.standard_normal((30, 3)) * (1.0, 1.0, 9.0)}
    at["L"][::4, 1] = 0.0
    at["L"][::8, 2] = np.round(at["L"][::8, 2]) * at["L"][::8, 0]
    (value, slopes), (expected, others) = (teg.compile(e, [lines], backend=k).value_and_grad(at) for k in ("c", "numpy"))
    assert value == pytest.approx(expected, rel=1e-12)
    assert teg.compile(e, [], backend="c")(at) == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(slopes["L"], others["L"], rtol=1e-10, atol=1e-11 * np.abs(others["L"]).max())
    source = print_arrays(cast(ArrayProgram, teg.compile(e, [lines], backend="numpy").program(0 if squared else 1)))
    assert "_holds_1" in source
    assert "alone_" in source


def test_a_picture_has_a_queue_for_each_face() -> None:
    program = teg.compile(*picture(), backend="numpy").program(1)
    deepest = max(queues(program), key=lambda q: len(q.chain))
    assert len(deepest.chain) == 2
    assert len(deepest.sums) == 16
    text = print_arrays(program)
    assert "queue_" in text
    assert text.count("crossed_") == 3  # the function, and its calls where the queue is full and where the face ends
    names = set(re.findall(r"\balone_\d+", text))
    assert [text.count(f"{name}(") for name in names] == [3, 3, 3]  # one for each edge of a triangle


def test_outputs_that_chunks_write_apart_have_no_copies() -> None:
    """Each iteration of the outermost loop adds to its own row of S, and all of them to all rows of L."""
    apart = teg.sum(scale[j] * teg.sum(pixel(), (i, 0, 11)), (j, 0, teg.length(scale, 0)))
    for wrt, number in (([scale], 0), ([scale, lines], 0), ([lines], 0)):
        source = print_arrays(cast(ArrayProgram, teg.compile(apart, wrt, backend="numpy").program(1)))
        assert source.count("= chunks > 1 ? copy") == number
    k = teg.index("k")
    shared = teg.sum(lines[k, 0] * scale[j], (k, 0, teg.length(lines, 0)), (j, 0, teg.length(scale, 0)))
    source = print_arrays(cast(ArrayProgram, teg.compile(shared, [lines, scale], backend="numpy").program(1)))
    assert source.count("= chunks > 1 ? copy") == 1
    given = rows()
    once, twice = (teg.compile(shared, [lines, scale], backend="c", threads=n).value_and_grad(given)[1] for n in (1, 2))
    for name in ("L", "S"):
        np.testing.assert_array_equal(once[name], twice[name])
    np.testing.assert_allclose(once["S"], np.full(9, given["L"][:, 0].sum()), rtol=1e-14)
    np.testing.assert_allclose(once["L"][:, 0], np.full(9, given["S"].sum()), rtol=1e-14)
