"""The integral: squared colour difference over one pixel of a thresholded, bilinearly interpolated noise.

    noise(x, y) = (n₀₀(1 - x) + n₁₀x)(1 - y) + (n₀₁(1 - x) + n₁₁x)y          on the pixel [0, 1]²
    loss(pixel) = ∫∫ Σₖ (colourₖ(x, y) - targetₖ)² dx dy,   colour 0 where noise > threshold 0, else 1 where noise > threshold 1, else 2

The difference is squared inside the integral, as in the Perlin application of Teg (Bangaru et al., SIGGRAPH 2021): a pixel is matched
where the colours match, not where a mixture of them has the right mean. The borders of the colours are hyperbolas. The compiler makes
the derivatives by the colours, the thresholds and the four corner values, on which the noise's gradient depends only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.treatments import compiled
from teg.ir.expr import Expr, Var

CORNERS = ("top_left", "top_right", "bottom_left", "bottom_right")
CHANNELS = ("red", "green", "blue")
TARGET = tuple(f"target_{channel}" for channel in CHANNELS)


def colour_names(levels: int) -> list[str]:
    """Returns the names of the channels of all colours, that of the highest noise first."""
    return [f"{channel}_{level}" for level in range(levels) for channel in CHANNELS]


def threshold_names(levels: int) -> list[str]:
    """Returns the names of the thresholds, the highest first."""
    return [f"threshold_{level}" for level in range(levels - 1)]


def noise(x: Var, y: Var) -> Expr:
    """Returns the noise: bilinear in the pixel's coordinates, y downwards."""
    a, b, c, d = (teg.param(name) for name in CORNERS)
    return (a * (1 - x) + b * x) * (1 - y) + (c * (1 - x) + d * x) * y


def choice(x: Var, y: Var, values: Sequence[Expr]) -> Expr:
    """Returns the value of the colour at a place, as a sum over thresholds that are in order: each border is then a surface of its own."""
    height, chosen = noise(x, y), values[-1]
    for value, below, name in zip(values, values[1:], threshold_names(len(values)), strict=False):
        chosen = chosen + teg.bracket(height > teg.param(name)) * (value - below)
    return chosen


def pixel_loss(levels: int) -> Expr:
    """Returns the loss of one pixel, by its four corner values, the thresholds, the colours and the target's colour."""
    x, y = teg.vars("x y")

    def difference(level: int) -> Expr:
        red, green, blue = ((teg.param(f"{c}_{level}") - teg.param(f"target_{c}")) ** 2 for c in CHANNELS)
        return red + green + blue

    return teg.integral(choice(x, y, [difference(level) for level in range(levels)]), (x, 0, 1), (y, 0, 1))


def pixel_colour(levels: int) -> Expr:
    """Returns the mean colour of one pixel, a tuple (red, green, blue), which a picture of the shader shows."""
    x, y = teg.vars("x y")
    shades = (choice(x, y, [teg.param(f"{c}_{level}") for level in range(levels)]) for c in CHANNELS)
    return teg.tuple(*(teg.integral(shade, (x, 0, 1), (y, 0, 1)) for shade in shades))


@dataclass(frozen=True)
class CompiledScene:
    """The two compiled programs, each a function over a batch of pixels."""

    loss: Evaluator
    colour: Evaluator
    levels: int
    backend: Backend
    threads: int = 1

    @cached_property
    def colour_slopes(self) -> Evaluator:
        """Returns the colour, to be differentiated by corner values and thresholds: exactly, by integrals along the borders."""
        moving = [teg.param(name) for name in (*CORNERS, *threshold_names(self.levels))]
        return teg.compile(pixel_colour(self.levels), moving, backend=self.backend, threads=self.threads)


def compile_scene(backend: Backend, discontinuities: Discontinuities = "exact", threads: int = 1, levels: int = 2) -> CompiledScene:
    """Returns the compiled loss, to be differentiated, and the compiled colour, to be shown."""
    moving = [teg.param(name) for name in (*CORNERS, *threshold_names(levels), *colour_names(levels))]
    return CompiledScene(
        compiled(pixel_loss(levels), moving, backend, discontinuities, threads=threads),
        teg.compile(pixel_colour(levels), [], backend=backend, threads=threads),
        levels,
        backend,
        threads,
    )
