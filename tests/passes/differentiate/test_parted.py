"""Candidates whose alternatives end on one line from opposite sides: against sums over cells between lines, and differences of these."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import teg
from teg.analysis.gates import are_apart
from teg.ir.expr import TRUE
from teg.ir.simplify import disjunction, negation
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, x, y

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
U, V = x - D[k, 0], y - D[k, 1]
CONDITIONS = {
    "quadrants": (U * V > 0, lambda u, v, w: u * v > 0),
    "sectors": (U * V * (x - y) > 0, lambda u, v, w: u * v * w > 0),
    "one side or the other": (((U > 0) & (x > y)) | ((V > 0) & (x < y)), lambda u, v, w: np.where(w > 0, u > 0, v > 0)),
    "three": (
        ((U > 0) & (V > 0) & (x > y)) | ((U < 0) & (x < y)) | ((V < 0) & (x > y)),
        lambda u, v, w: np.where(w > 0, ((u > 0) & (v > 0)) | (v < 0), u < 0),
    ),
}
ROWS = {
    "one": [[0.3, 0.4]],
    "shared": [[0.3, 0.4], [0.3, 0.7], [0.6, 0.4]],
    "equal": [[0.3, 0.4], [0.3, 0.4]],
    "apart": [[0.3, 0.4], [0.55, 0.72], [0.8, 0.2]],
}


def between_lines(holds: Any, rows: np.ndarray, chosen: Any) -> float:
    """Returns ∫∫ chosen·e^(xy) over the unit square, in which x = a, y = b and x = y are the lines where `holds` may change."""
    ends = np.unique([0.0, 1.0, *rows.ravel()])
    total = 0.0
    for low, high in pairwise(ends):
        for node, weight in zip((low + high) / 2 + (high - low) / 2 * NODES, (high - low) / 2 * WEIGHTS, strict=True):
            cuts = np.unique([*ends, node])
            middle, half = (cuts[1:] + cuts[:-1]) / 2, (cuts[1:] - cuts[:-1]) / 2
            at = middle[:, None] + half[:, None] * NODES
            there = np.array([holds(middle - a, node - b, middle - node) for a, b in rows])
            total += weight * float((chosen(there)[:, None] * np.exp(at * node) * half[:, None] * WEIGHTS).sum())
    return total


def covered(there: np.ndarray) -> np.ndarray:
    return there.any(axis=0).astype(float)


def first(there: np.ndarray) -> np.ndarray:
    """The number of the first candidate from 1 on, a half where there is none."""
    return np.where(there.any(axis=0), 1.0 + there.argmax(axis=0), 0.5)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", CONDITIONS)
def test_unions_and_the_first_of_them(name: str, backend: str) -> None:
    condition, holds = CONDITIONS[name]
    number = teg.nearest(k + 1.0, k, ALL, where=condition, otherwise=0.5)
    for body, chosen in ((teg.bracket(teg.any(condition, ALL)), covered), (number, first)):
        f = teg.compile(teg.integral(body * teg.exp(x * y), *BOX), [D], backend=backend)
        assert follows_edges(f) or name in ("sectors", "three")
        for rows in map(np.array, ROWS.values()):
            assert f(D=rows) == pytest.approx(between_lines(holds, rows, chosen), abs=1e-11)
        rows = np.array(ROWS["apart"])
        moved = np.random.default_rng(1).normal(size=rows.shape)
        slope = (f.grad(D=rows)["D"] * moved).sum()
        ahead, back = (between_lines(holds, rows + h * moved, chosen) for h in (1e-5, -1e-5))
        assert slope == pytest.approx((ahead - back) / 2e-5, abs=1e-7)


@pytest.mark.parametrize("name", ["sectors", "three"])
def test_polynomials_of_many_alternatives(name: str) -> None:
    """Four alternatives of three conditions are a partition: only what is asked for is written as alternatives."""
    condition, holds = CONDITIONS[name]
    f = teg.compile(teg.integral(teg.bracket(teg.any(condition, ALL)), *BOX), [D])
    assert not follows_edges(f)
    u = (np.arange(400) + 0.5) / 400
    for rows in map(np.array, ROWS.values()):
        at = np.array([holds(u[:, None] - a, u[None, :] - b, u[:, None] - u[None, :] + 1e-9) for a, b in rows])
        assert f(D=rows) == pytest.approx(at.any(axis=0).mean(), abs=3e-3)


def test_products_with_the_hessian() -> None:
    f = teg.compile(teg.integral(teg.bracket(teg.any(CONDITIONS["quadrants"][0], ALL)) * teg.exp(x * y), *BOX), [D])
    rows, direction = np.array(ROWS["apart"]), np.random.default_rng(2).normal(size=(3, 2))
    ahead, back = (f.grad(D=rows + h * direction)["D"] for h in (1e-5, -1e-5))
    assert f.hvp({"D": rows}, {"D": direction})["D"] == pytest.approx((ahead - back) / 2e-5, abs=1e-8)


def test_lists_of_them() -> None:
    """Lists of two, none and one, whose lengths are data; a condition with disks, which is written out, too."""
    p, starts = teg.index("p"), teg.indices("F", 1)
    disks = ((U * U + V * V < 0.1) & (x > y)) | ((U * U + V * V < 0.03) & (x < y))
    rows, lists = np.array(ROWS["apart"]), [0, 2, 2, 3]
    for condition in (CONDITIONS["quadrants"][0], disks):
        body = teg.bracket(teg.any(condition, (k, starts[p], starts[p + 1]))) * teg.exp(x * y)
        f = teg.compile(teg.sum(teg.integral(body, *BOX), (p, 0, 3)), [D])
        one = teg.compile(teg.integral(teg.bracket(teg.any(condition, ALL)) * teg.exp(x * y), *BOX), [D])
        value, gradient = f.value_and_grad(D=rows, F=lists)
        assert value == pytest.approx(one(D=rows[:2]) + one(D=rows[2:]), abs=1e-10)
        assert gradient["D"] == pytest.approx(np.vstack([one.grad(D=rows[:2])["D"], one.grad(D=rows[2:])["D"]]), abs=1e-9)


def test_conditions_that_exclude_each_other() -> None:
    a, b, c = (p > 0 for p in teg.params("a b c"))
    assert are_apart(disjunction(a & b, a & c), negation(a))
    assert not are_apart(disjunction(a & b, c), negation(a))
    assert not are_apart(TRUE, a)
