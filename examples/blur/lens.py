"""The integral of depth of field: a slanted triangle seen through a lens of a finite size.

From the place (a, b) of a lens a point (X, Y, Z) is seen at X/Z + a·(1/focus - 1/Z), and likewise Y: only the plane Z = focus is sharp. A
pixel is ∫∫∫ [(x, y) is in the triangle seen from (r·u, r·v)] dx dy du over its square and over a slit of the lens, the chord |u| < w at one
height v, summed over the slits of a round lens of radius r. Each slit is exact; the slits are the nodes of a Gauss-Chebyshev rule.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

import teg
from teg.examples.blur.motion import TARGET, i, inside, j, x, y
from teg.ir.expr import Expr

CORNERS = np.array([[-1.6, -1.4, 2.0], [2.4, -1.3, 3.0], [0.4, 3.2, 5.0]])
LENS = ("focus", "radius")

u = teg.var("u")
SLITS = teg.array("S", 2)
k = teg.index("k")


def slits(count: int) -> npt.NDArray[np.float64]:
    """Returns height v, half width w and weight of each slit of the unit disk; the sum of 2·w·weight is 1."""
    angles = np.pi * np.arange(1, count + 1) / (count + 1)
    return np.stack([np.cos(angles), np.sin(angles), np.sin(angles) / (count + 1)], axis=1)


def corners_from(place: Any, lens: Any) -> list[Any]:
    """Returns the corners on the screen, seen from a place of the unit disk."""
    seen = []
    for px, py, depth in CORNERS.tolist():
        blur = lens["radius"] * (1 / lens["focus"] - 1 / depth)
        seen.append((px / depth + blur * place[0], py / depth + blur * place[1]))
    return seen


def loss() -> Expr:
    """Returns the sum of squares of the differences between pixels and those of a picture T, on the screen [-1, 1]²."""
    size = teg.length(TARGET)
    visible = inside(corners_from((u, SLITS[k, 0]), {name: teg.param(name) for name in LENS}))
    pixel = (x, 2 * j / size - 1, 2 * (j + 1) / size - 1), (y, 2 * i / size - 1, 2 * (i + 1) / size - 1)
    slit = teg.integral(teg.bracket(visible), *pixel, (u, -SLITS[k, 1], SLITS[k, 1])) * size * size / 4
    mean = teg.sum(SLITS[k, 2] * slit, (k, 0, teg.length(SLITS)))
    return teg.sum((mean - TARGET[i, j]) ** 2, (j, 0, size), (i, 0, size))
