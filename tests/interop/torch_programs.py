"""Programs for the tests of `teg.torch_function`, and the comparison of their results."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import teg

torch = pytest.importorskip("torch")
QUIET = [
    pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning"),  # of PyTorch's own modules, as they are first imported
    pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor:UserWarning"),  # its compiler looks at it
    pytest.mark.filterwarnings("ignore:Attempted to insert a get_attr Node:UserWarning"),  # torch.func.linearize
]
f64 = torch.float64

EXACT = "c" if any(map(shutil.which, ("cc", "gcc", "clang"))) else "numpy"
x, y = teg.vars("x y")
t, a = teg.params("t a")
unit = (x, 0, 1), (y, 0, 1)
STEP = teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1))
HALF_PLANE = teg.integral(teg.bracket(x + a * y < t), *unit)  # t²/2a where t < 1, a
HYPERBOLA = teg.integral(teg.bracket(x * y < t) * (a + x), *unit)
CORNERS = teg.params("x0 y0 x1 y1 x2 y2")


def inside(corners: Any) -> Any:
    """The points of a triangle, counterclockwise."""
    pairs = [corners[0:2], corners[2:4], corners[4:6]]
    product = 1
    for (px, py), (qx, qy) in zip(pairs, pairs[1:] + pairs[:1], strict=True):
        product = product * teg.bracket((qx - px) * (y - py) - (qy - py) * (x - px) > 0)
    return product


TRIANGLE = teg.integral(inside(CORNERS) * (1 + a * x), *unit)
OF_TRIANGLE = dict(zip(["x0", "y0", "x1", "y1", "x2", "y2", "a"], (-0.2, 0.15, 0.9, 0.3, 0.4, 1.3, 0.6), strict=True))

k, j, n = teg.index("k"), teg.index("j"), teg.param("n")
V, C = teg.array("V", 2), teg.array("C", 1)
F, S = teg.indices("F", 2), teg.indices("S", 1)
EDGE = teg.integral(teg.bracket(x * V[F[k, 0], 0] < V[F[k, 1], 1] + t * x) * (x + t), (x, 0, 1))
GATHERED = teg.sum(C[k] * EDGE, (k, 0, teg.length(F, 0))) ** 2
PART = teg.sum(V[j, 1] * teg.integral(teg.bracket(x * V[j, 0] < C[k] * t), (x, 0, 1)), (j, S[k], S[k + 1]))
RAGGED = teg.sum(PART * PART * C[k], (k, 0, teg.length(C, 0)))
rng = np.random.default_rng(0)
OF_GATHERED = {"t": 0.7, "V": rng.uniform(0.2, 1.5, (4, 2)), "C": rng.normal(size=3), "F": rng.integers(0, 4, (3, 2))}
OF_RAGGED = {"t": 0.6, "V": rng.uniform(0.5, 1.5, (6, 2)), "C": rng.uniform(0.2, 1, 3), "S": np.array([0, 2, 2, 6])}


@dataclass(frozen=True)
class Case:
    """A program, and a point where it has second derivatives."""

    name: str
    e: Any
    at: dict[str, Any]
    backend: str = EXACT


CASES = (
    Case("a step", STEP, {"t": 0.5, "a": 1.1}, "numpy"),
    Case("a half-plane", HALF_PLANE, {"t": 0.5, "a": 1.2}),
    Case("a hyperbola", HYPERBOLA, {"t": 0.3, "a": 0.7}),
    Case("a triangle on a pixel", TRIANGLE, OF_TRIANGLE),
    Case("gathered", GATHERED, OF_GATHERED),
    Case("ragged", RAGGED, OF_RAGGED, "numpy"),
    Case("a tuple", teg.tuple(STEP, teg.tuple(t * a, STEP * HALF_PLANE)), {"t": 0.5, "a": 1.1}),
    Case("a batch", HALF_PLANE * a, {"t": np.array([[0.3], [0.6]]), "a": np.array([0.8, 1.2, 1.4])}),
)
EVERY = pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)


def close(found: Any, wanted: Any, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(np.asarray(found), np.asarray(wanted), rtol=tolerance, atol=tolerance)


def leaves_of(at: dict[str, Any]) -> dict[str, Any]:
    """The real values as tensors that require gradients."""
    return {name: torch.tensor(v, dtype=f64, requires_grad=True) for name, v in at.items() if name not in "FSn"}


def flat(value: Any) -> list[Any]:
    return [v for entry in value for v in flat(entry)] if isinstance(value, tuple) else [value]


def positional(f: Any, at: dict[str, Any]) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """A function of the real values in order, with the integers held fixed."""
    leaves = leaves_of(at)
    fixed = {name: v for name, v in at.items() if name not in leaves}

    def call(*values: Any) -> Any:
        found = flat(f({**fixed, **dict(zip(leaves, values, strict=True))}))
        return found[0] if len(found) == 1 else tuple(found)

    return call, tuple(leaves.values())
