"""The integral of motion blur: a triangle that moves and turns while the shutter is open.

A pixel is ∫∫∫ [(x, y) is in the triangle at time t]·2t dx dy dt over its square and over t from 0 to 1. The shutter opens slowly, so the
end of the motion is brighter than its beginning: an even exposure would not tell one from the other.
"""

from __future__ import annotations

from functools import reduce
from operator import and_
from typing import Any

import teg
from teg.ir.expr import Cond, Expr

CORNERS = (-0.1, -0.35), (0.8, -0.15), (0.1, 0.55)
"""Around the point that the triangle turns about; they turn to the left."""
MOTION = ("right", "up", "across", "along", "spin")
"""The point that the triangle turns about, at time 0, its velocity, and the velocity of the turn."""

x, y, t = teg.vars("x y t")
TARGET = teg.array("T", 2)
i, j = teg.index("i"), teg.index("j")


def inside(corners: Any) -> Cond:
    """Returns whether (x, y) is in a triangle whose corners turn to the left."""
    sides = zip(corners, (*corners[1:], corners[0]), strict=True)
    within: Cond = reduce(and_, ((bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0 for (ax, ay), (bx, by) in sides))
    return within


def corners_at(time: Any, motion: Any, of: Any) -> list[Any]:
    """Returns the corners at a time, by the functions of a module: `teg` or `numpy`."""
    c, s = of.cos(motion["spin"] * time), of.sin(motion["spin"] * time)
    centre = motion["right"] + motion["across"] * time, motion["up"] + motion["along"] * time
    return [(centre[0] + c * px - s * py, centre[1] + s * px + c * py) for px, py in CORNERS]


def loss() -> Expr:
    """Returns the sum of squares of the differences between pixels and those of a picture T, on the screen [-1, 1]²."""
    size = teg.length(TARGET)
    moving = inside(corners_at(t, {name: teg.param(name) for name in MOTION}, teg))
    pixel = (x, 2 * j / size - 1, 2 * (j + 1) / size - 1), (y, 2 * i / size - 1, 2 * (i + 1) / size - 1)
    mean = teg.integral(teg.bracket(moving) * 2 * t, *pixel, (t, 0, 1)) * size * size / 4
    return teg.sum((mean - TARGET[i, j]) ** 2, (j, 0, size), (i, 0, size))
