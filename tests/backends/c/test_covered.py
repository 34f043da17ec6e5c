"""Runs of covered iterations against sums over pixels by Gauss-Legendre rules between kinks, in plain NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.c.covered import PIECE, divided, joined
from teg.backends.c.crossed import Crossed
from teg.backends.c.loops import print_arrays
from teg.program import Assign, Program
from teg.program.arrays import ArrayProgram
from teg.program.interpreter import interpret
from tests.backends.c_checks import in_c

pytestmark = [*in_c, pytest.mark.filterwarnings("error")]

x, y = teg.vars("x y")
i, j = teg.index("i"), teg.index("j")
ends, slopes, flat, deep = teg.array("E", 1), teg.array("A", 1), teg.array("T", 2), teg.array("D", 3)


def pixel(channels: int) -> teg.Expr:
    """∫ [x + y/2 < E[j]]·Σ (A·(x, y) - data)² over pixel (i, j); the data are one number, or several."""
    data = [deep[j, i, k] for k in range(channels)] if channels else [flat[j, i]]
    residuals = [slopes[0] * x + slopes[1] * y - t for t in data]
    inside = teg.bracket(x + 0.5 * y < ends[j])
    return teg.integral(inside * sum((r * r for r in residuals), start=0 * x), (x, i, i + 1), (y, j, j + 1))


def rows(at: dict[str, Any], data: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The sum of each row, its derivative by E, and those by A; `data` is (rows, columns, channels). Between the places where the line
    leaves a pixel through its sides, all is polynomial in y."""
    left, below = np.arange(data.shape[1])[None, :], np.arange(data.shape[0])[:, None]
    ends, (a, b) = at["E"][:, None], at["A"]
    kinks = np.clip([2 * (ends - left - 1), 2 * (ends - left)], below, below + 1)
    borders = [below + 0.0 * left, *kinks, below + 1.0 + 0.0 * left]
    nodes, weights = np.polynomial.legendre.leggauss(3)
    value, by_a, by_b, by_end = (np.zeros(left.shape[1] * below.shape[0]).reshape(len(below), -1) for _ in range(4))
    for piece in range(3):
        width = borders[piece + 1] - borders[piece]
        for u, v in zip(nodes, weights, strict=True):
            height = borders[piece] + 0.5 * (1 + u) * width
            reach = np.clip(ends - 0.5 * height - left, 0.0, 1.0)
            for w, z in zip(nodes, weights, strict=True):
                place = left + 0.5 * (1 + w) * reach
                residual = (a * place + b * height)[:, :, None] - data
                weight = 0.25 * v * z * width * reach
                value += weight * (residual**2).sum(axis=2)
                by_a += weight * 2 * (residual.sum(axis=2) * place)
                by_b += weight * 2 * (residual.sum(axis=2) * height)
            if piece == 1:
                residual = (a * (left + reach) + b * height)[:, :, None] - data
                by_end += 0.5 * v * width * (residual**2).sum(axis=2)
    return value.sum(axis=1), by_end.sum(axis=1), np.stack([by_a.sum(axis=1), by_b.sum(axis=1)])


@pytest.mark.parametrize("squared", [False, True], ids=["rows at once", "one row"])
@pytest.mark.parametrize(("channels", "entries"), [(0, 1), (3, 3), (3, 4), (1, 1)], ids=["flat", "all", "some", "one"])
@pytest.mark.parametrize("width", [5, 40, 2 * PIECE + 77])
def test_sums_of_rows(width: int, channels: int, entries: int, squared: bool) -> None:
    """Runs of all lengths, none and one longer than a piece among them; arrays of which all or some entries are read."""
    row = teg.sum(pixel(channels), (i, 0, width))
    e = teg.sum(row**2 if squared else row, (j, 0, teg.length(ends, 0)))
    f = teg.compile(e, [ends, slopes], backend="c")
    program = f.program(0 if squared else 1)
    assert isinstance(program, ArrayProgram)
    source = print_arrays(program)
    assert "runs_" in source
    assert ("[2] == 3" in source) == (channels == 3)
    rng = np.random.default_rng(width)
    height = 11
    data = rng.standard_normal((height, width, entries))
    at: dict[str, Any] = {"E": rng.uniform(0.0, width, height), "A": np.array([2.0 / width, -0.3])}
    at["E"][:3] = -2.0, width + 3.5, min(width - 0.5, 17.25)
    at |= {"D": data} if channels else {"T": data[:, :, 0]}
    value, found = f.value_and_grad(at)
    sums, by_end, by_slope = rows(at, data[:, :, : channels or 1])
    weights = 2 * sums if squared else np.ones(height)
    for result in (value, f(at)):  # two programs
        assert result == pytest.approx((sums**2 if squared else sums).sum(), rel=1e-12)
    np.testing.assert_allclose(found["E"], weights * by_end, rtol=1e-11, atol=1e-11 * np.abs(weights * by_end).max())
    np.testing.assert_allclose(found["A"], by_slope @ weights, rtol=1e-11, atol=1e-13 * np.abs(by_slope * weights).sum())


LINE = Crossed(
    (
        Assign("v0", "mul", ("p0", 3.0)),
        Assign("v1", "mul", ("p1", "p1")),
        Assign("v2", "add", ("v0", "v1", "p0")),
        Assign("v3", "const", ("v2",)),
        Assign("v4", "add", ("v1", "v0")),
        Assign("v5", "mul", ("v4", 2.0)),
    ),
    ("v3", "v4", "v0", "v5", 0.0),
    True,
)
"""The input p0 is the same at all points, p1 differs."""


@pytest.mark.parametrize("of", [divided, joined])
def test_both_parts_are_the_outputs(of: Any) -> None:
    sums = [3, 0, 1, 2, 4]
    made = divided(LINE, sums, {1})
    names, numbers = ("p0", "p1"), [0.75, -2.0]

    def outputs(line: Crossed) -> list[float]:
        body = tuple(item for item in line.items if isinstance(item, Assign))
        return list(interpret(Program(names, body, line.outputs), numbers).outputs)

    expected = outputs(LINE)
    if of is joined:
        assert outputs(joined(LINE, made, sums)) == expected
        return
    parts = outputs(made)
    assert [parts[m] + parts[5 + m] for m in range(5)] == [expected[j] for j in sums]
    assert parts == [12.5, 4.0, 4.0, 0.0, 0.0, 0.0, 3.0, 2.25, 2.25, 0.0]
