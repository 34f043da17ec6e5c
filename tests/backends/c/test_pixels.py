"""Pictures whose pixels have a size that is known, in C and in NumPy: pixels of all kinds, triangles in every position to them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import teg
from tests.backends.c_checks import in_c

pytestmark = in_c

x, y = teg.vars("x y")
k, i, j = teg.index("k"), teg.index("i"), teg.index("j")
VERTICES, FACES, COLOURS, BOXES = teg.array("V", 2), teg.indices("F", 2), teg.array("C", 2), teg.indices("B", 2)
side = teg.param("s")
PIXELS: dict[str, tuple[Callable[[Any], Any], float]] = {
    "of side 1": (lambda n: n, 1.0),
    "of side 1/8": (lambda n: n / 8, 0.125),
    "of any side": (lambda n: side * n, 0.3),
    "from right to left": (lambda n: -1 * n, -1.0),
    "between": (lambda n: n + 0.25, 1.0),
}
"""Where the border of a number lies, and the size of a pixel."""


def picture(border: Callable[[Any], Any], linear: bool) -> teg.Expr:
    """Σ over faces and pixels of the area inside, or of the square of a linear colour."""
    corners = [(VERTICES[FACES[k, c], 0], VERTICES[FACES[k, c], 1]) for c in range(3)]

    def left_of(a: Any, b: Any) -> teg.Expr:
        return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0

    inside = left_of(corners[0], corners[1]) & left_of(corners[1], corners[2]) & left_of(corners[2], corners[0])
    body = (COLOURS[k, 0] + COLOURS[k, 1] * x + COLOURS[k, 2] * y) ** 2 if linear else 1
    pixel = teg.integral(teg.where(inside, body, 0), (x, border(i), border(i + 1)), (y, border(j), border(j + 1)))
    return teg.sum(pixel, (i, BOXES[k, 0], BOXES[k, 1]), (j, BOXES[k, 2], BOXES[k, 3]), (k, 0, teg.length(FACES, 0)))


def placed(trial: int, size: float) -> dict[str, Any]:
    """Seven triangles: anywhere; with corners on those of pixels; with level edges on their borders; some without area."""
    rng = np.random.default_rng(trial)
    vertices = rng.uniform(-2, 22, (12, 2))
    if trial == 1:
        vertices = np.round(vertices)
    if trial == 2:
        vertices[:, 1] = np.round(vertices[:, 1])
    faces = np.array([rng.permutation(12)[:3] for _ in range(7)])
    if trial == 3:
        faces[:2] = [[0, 0, 1], [2, 3, 2]]
    boxes = np.tile([-1, 21, 0, 20], (7, 1))
    boxes[2:4] = [[5, 5, 3, 9], [0, 3, 0, 2]]
    return {"V": vertices * size, "F": faces, "B": boxes, "C": rng.normal(size=(7, 3)), "s": size}


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("kind", PIXELS)
def test_as_numpy(kind: str, linear: bool) -> None:
    border, size = PIXELS[kind]
    wrt = [VERTICES, *([COLOURS] if linear else []), *([side] if kind == "of any side" else [])]
    numpy, c = (teg.compile(picture(border, linear), wrt, backend=b) for b in ("numpy", "c"))
    for trial in range(4):
        given = {name: v for name, v in placed(trial, size).items() if name in "VFB" or any(p.name == name for p in wrt)}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of ties
            found, expected = (np.concatenate([np.ravel(a) for a in everything(f, given)]) for f in (c, numpy))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * (1 + np.abs(expected).max()))


def everything(f: Any, given: dict[str, Any]) -> list[Any]:
    """Value and gradient, and the gradient alone."""
    value, slopes = f.value_and_grad(given)
    return [value, *slopes.values(), *f.grad(given).values()]
