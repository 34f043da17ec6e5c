"""Triangle and pixel in twelve kinds of position against 60 digits, as generated C and as written by hand: `tests/bench/kinds.py`."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import teg
from tests.bench.handwritten import Triangles
from tests.bench.kinds import FUNCTIONS, KINDS, Case, expected, stored
from tests.bench.scenes import triangle_pixel

pytestmark = [
    pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler"),
    pytest.mark.usefixtures("as_users_compile"),
]

ALLOWED = {"thin 1e-6": 1e-10}
"""Errors, relative to max(1, |value|), where they may be more than CLOSE: a sliver's slopes are as ill-conditioned as it is thin."""
CLOSE = 2e-13
CONSTANT = 1e-13
"""Of a constant colour: its area depends on lengths only."""
ORDERS = (0, 1, 2)
TIMES, SMALL = 12.0, dict(zip(ORDERS, (1e-15, 2e-15, 2e-14), strict=True))
"""How much larger errors may be than those of the handwritten kernel, or of rounding where that has none. (Pixels side by side are
integrated with nodes of the whole pixel, where the colours of a triangle in it are larger than in the triangle.)"""


def columns(cases: list[Case]) -> dict[str, np.ndarray]:
    """The parameters of `triangle_pixel`, one row a case."""
    order = cases[0].order
    vertices, boxes, colours, targets = (np.array([getattr(c, part) for c in cases]).T for part in ("vertices", "box", "colours", "target"))
    names = [f"c{k}" for k in range(3)] if order == 0 else [f"c{i}{k}" for i in range(FUNCTIONS[order]) for k in range(3)]
    values = {f"{'xy'[j]}{i}": vertices[2 * i + j] for i in range(3) for j in range(2)}
    values |= dict(zip(("left", "right", "bottom", "top"), boxes, strict=True))
    return values | {f"t{k}": targets[k] for k in range(3)} | dict(zip(names, colours, strict=True))


def by_hand(cases: list[Case]) -> np.ndarray:
    """Loss and gradient of the handwritten kernel, (cases, outputs)."""
    parts = (np.array([getattr(c, part) for c in cases]) for part in ("vertices", "colours", "box", "target"))
    run = Triangles(cases[0].order, *parts)
    run()
    return run.results


def generated(cases: list[Case], backend: str) -> np.ndarray:
    """The same of the compiled program."""
    e, wrt = triangle_pixel(cases[0].order)
    value, gradient = teg.compile(e, wrt, backend=backend).value_and_grad(columns(cases))
    return np.stack([value, *(gradient[p.name] for p in wrt)], axis=1)


def errors(cases: list[Case], computed: np.ndarray) -> dict[str, float]:
    """The largest error of each kind."""
    exact = np.array([c.expected for c in cases])
    each = (np.abs(computed - exact) / np.maximum(1.0, np.abs(exact))).max(axis=1)
    return {kind: float(max(e for e, c in zip(each, cases, strict=True) if c.kind == kind)) for kind in KINDS}


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("how", ["by hand", "c", "numpy"])
def test_accuracy(order, how):
    cases = [c for c in stored() if c.order == order]
    worst = errors(cases, by_hand(cases) if how == "by hand" else generated(cases, how))
    allowed = {kind: ALLOWED.get(kind, CLOSE) if order else CONSTANT for kind in KINDS}
    assert {kind: e for kind, e in worst.items() if not e <= allowed[kind]} == {}


@pytest.mark.parametrize("order", ORDERS)
def test_it_is_the_accuracy_of_what_is_written_by_hand(order):
    cases = [c for c in stored() if c.order == order]
    ours, theirs = errors(cases, generated(cases, "c")), errors(cases, by_hand(cases))
    assert {kind: (ours[kind], theirs[kind]) for kind in KINDS if not ours[kind] <= max(TIMES * theirs[kind], SMALL[order])} == {}


def test_every_kind_is_there():
    assert {(c.order, c.kind) for c in stored()} == {(order, kind) for order in ORDERS for kind in KINDS}


def test_the_table_is_what_its_script_computes():
    case = next(c for c in stored() if c.kind == "coincident" and c.order == 1)
    assert expected(case) == case.expected
