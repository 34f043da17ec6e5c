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
    pytest.mark.usefixtures("one_cache"),
]

BY_HAND = {"thin 1e-4": 1e-12, "thin 1e-6": 1e-10}
"""Errors, relative to max(1, |value|), where they may be more than CLOSE: a sliver's slopes are as ill-conditioned as it is thin."""
GENERATED = {"thin 1e-4": 1e-11, "thin 1e-6": 2e-9}
CLOSE = 2e-13
ORDERS = (0, 1, 2)


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


def generated(cases: list[Case]) -> np.ndarray:
    """The same of the compiled program."""
    e, wrt = triangle_pixel(cases[0].order)
    value, gradient = teg.compile(e, wrt, backend="c").value_and_grad(columns(cases))
    return np.stack([value, *(gradient[p.name] for p in wrt)], axis=1)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("computed", "allowed"), [(by_hand, BY_HAND), (generated, GENERATED)], ids=["by hand", "generated"])
def test_accuracy(order, computed, allowed):
    cases = [c for c in stored() if c.order == order]
    exact = np.array([c.expected for c in cases])
    errors = (np.abs(computed(cases) - exact) / np.maximum(1.0, np.abs(exact))).max(axis=1)
    worst = {kind: max(e for e, c in zip(errors, cases, strict=True) if c.kind == kind) for kind in KINDS}
    assert {kind: e for kind, e in worst.items() if not e <= allowed.get(kind, CLOSE)} == {}


def test_every_kind_is_there():
    assert {(c.order, c.kind) for c in stored()} == {(order, kind) for order in ORDERS for kind in KINDS}


def test_the_table_is_what_its_script_computes():
    case = next(c for c in stored() if c.kind == "coincident" and c.order == 1)
    assert expected(case) == case.expected
