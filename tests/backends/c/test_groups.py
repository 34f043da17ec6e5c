"""Loops of which eight iterations are begun and ended side by side: the same bits as one after the other, and which loops these are."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest

import teg
from teg.backends.c import loops
from teg.backends.c.groups import around_carrier
from teg.backends.c.loops import print_arrays
from teg.program.arrays import ArrayProgram, Loop
from tests.backends.c_checks import in_c
from tests.bench.scenes import picture

pytestmark = [*in_c, pytest.mark.filterwarnings("error")]

x, y = teg.vars("x y")
i, j = teg.index("i"), teg.index("j")
lines, scale = teg.array("L", 2), teg.array("S", 1)


def row() -> teg.Expr:
    """A polynomial on the half-plane of line j, in pixels of row j."""
    inside = teg.bracket(lines[j, 0] * x + lines[j, 1] * y < lines[j, 2])
    return teg.sum(teg.integral(inside * (x + scale[j] * y * y), (x, i, i + 1), (y, j, j + 1)), (i, 0, 11))


ROWS = {"squared": row() ** 2, "through exp": teg.exp(-row() / 50) * scale[j], "through sin": teg.sin(row())}


def over_rows(name: str) -> teg.Expr:
    return teg.sum(ROWS[name], (j, 0, teg.length(lines, 0)))


def given(n: int) -> dict[str, Any]:
    rng = np.random.default_rng(n)
    return {"L": rng.standard_normal((n, 3)) * (1.0, 1.0, 5.0), "S": rng.standard_normal(n)}


def source_of(e: teg.Expr, wrt: list[Any]) -> str:
    program = teg.compile(e, wrt, backend="numpy").program(1)
    assert isinstance(program, ArrayProgram)
    return print_arrays(program)


def mesh(n: int) -> dict[str, Any]:
    """Triangles of a few pixels in a picture of 12² pixels, counterclockwise, the last one as large as the picture."""
    rng = np.random.default_rng(n)
    corners = rng.uniform(1.0, 11.0, (n, 1, 2)) + rng.uniform(-2.5, 2.5, (n, 3, 2))
    corners[-1] = [[0.2, 0.3], [11.7, 0.9], [5.5, 11.6]]
    corners = np.clip(corners, 0.05, 11.95)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = first[:, 0] * second[:, 1] < first[:, 1] * second[:, 0]
    corners[clockwise] = corners[clockwise][:, ::-1]
    low, high = np.floor(corners.min(axis=1)).astype(int), np.ceil(corners.max(axis=1)).astype(int)
    boxes = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)
    faces = np.arange(3 * n).reshape(n, 3)
    return {"V": corners.reshape(-1, 2), "F": faces, "B": boxes, "C": rng.random((n, 9)), "T": rng.random((12, 12, 3))}


def bits(f: Any, at: dict[str, Any]) -> list[bytes]:
    value, slopes = f.value_and_grad(at)
    return [np.asarray(value).tobytes(), *(slopes[name].tobytes() for name in sorted(slopes))]


@pytest.mark.parametrize("n", [1, 7, 8, 9, 20])
@pytest.mark.parametrize("name", ["picture", "squared"])
def test_the_same_bits_as_one_after_the_other(name: str, n: int) -> None:
    e, wrt = picture() if name == "picture" else (over_rows(name), [lines, scale])
    at = mesh(n) if name == "picture" else given(n)
    together = bits(teg.compile(e, wrt, backend="c"), at)
    assert bits(teg.compile(e, wrt, backend="c", threads=2), at) == together
    with mock.patch.object(loops, "around_carrier", return_value=None):
        assert "_eight" not in source_of(e, wrt)
        assert bits(teg.compile(e, wrt, backend="c"), at) == together


@pytest.mark.parametrize("name", ROWS)
def test_as_numpy(name: str) -> None:
    at = given(19)
    (value, found), (same, expected) = (teg.compile(over_rows(name), [lines, scale], backend=b).value_and_grad(at) for b in ("c", "numpy"))
    assert value == pytest.approx(same, rel=1e-12)
    for array, slopes in found.items():
        np.testing.assert_allclose(slopes, expected[array], rtol=1e-11, atol=1e-11 * np.abs(expected[array]).max())


def test_what_a_picture_computes_eight_at_once() -> None:
    """Edges before the pixels, derivatives behind them, and what all pixels of a triangle share."""
    source = source_of(*picture())
    assert len(set(re.findall(r"\b(eight_\d+)\(", source))) == 2
    assert len(set(re.findall(r"\b(steady_\d+)\(\w+_eight", source))) == 2


def test_what_a_row_computes_with_a_function_of_the_library_stays_one_after_the_other() -> None:
    assert "_eight" in source_of(over_rows("through exp"), [lines])
    assert "_eight" not in source_of(over_rows("through sin"), [lines])


def test_steps_that_are_not_alike_for_eight() -> None:
    """A loop that reads behind its carrier, or scatters before it, is left as it is."""
    program = teg.compile(*picture(), backend="numpy").program(1)
    assert isinstance(program, ArrayProgram)
    (loop,) = [s for s in program.body if isinstance(s, Loop)]
    (carrier,) = [s for s in loop.body if isinstance(s, Loop)]
    found = around_carrier(loop, carrier)
    assert found is not None
    assert (*found.before, carrier, *found.after) == loop.body
    assert around_carrier(replace(loop, body=(carrier, *found.before)), carrier) is None
    assert around_carrier(replace(loop, body=(*found.after, carrier)), carrier) is None
    assert around_carrier(replace(loop, listed=0), carrier) is None
    assert around_carrier(None, carrier) is None
