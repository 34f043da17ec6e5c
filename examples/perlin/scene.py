"""The integral: squared colour difference over one pixel of a thresholded, bilinearly interpolated noise.

    noise(x, y) = (n₀₀(1 - x) + n₁₀x)(1 - y) + (n₀₁(1 - x) + n₁₁x)y          on the pixel [0, 1]², threshold subtracted
    loss(pixel) = ∫∫ Σₖ (colourₖ(x, y) - targetₖ)² dx dy,   colour = above where noise > 0, below elsewhere

The difference is squared inside the integral, as in the Perlin application of Teg (Bangaru et al., SIGGRAPH 2021): a pixel is matched
where the colours match, not where a mixture of them has the right mean. The border of the two colours is a hyperbola. The compiler makes
the derivatives by the colours, and by the four corner values, on which the noise's gradient depends only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import teg
from teg.evaluator.evaluator import Evaluator
from teg.ir.expr import Cond, Expr, Param, Var

CORNERS = ("top_left", "top_right", "bottom_left", "bottom_right")
ABOVE = ("above_red", "above_green", "above_blue")
BELOW = ("below_red", "below_green", "below_blue")
TARGET = ("target_red", "target_green", "target_blue")


def is_above(x: Var, y: Var) -> Cond:
    """Returns whether the noise is above the threshold: bilinear in the pixel's coordinates, y downwards."""
    a, b, c, d = (teg.param(name) for name in CORNERS)
    return (a * (1 - x) + b * x) * (1 - y) + (c * (1 - x) + d * x) * y > 0


def pixel_loss() -> Expr:
    """Returns the loss of one pixel, by its four corner values, the two colours and the target's colour."""
    x, y = teg.vars("x y")

    def difference(colour: Sequence[str]) -> Expr:
        red, green, blue = ((teg.param(c) - teg.param(t)) ** 2 for c, t in zip(colour, TARGET, strict=True))
        return red + green + blue

    return teg.integral(teg.where(is_above(x, y), difference(ABOVE), difference(BELOW)), (x, 0, 1), (y, 0, 1))


def pixel_colour() -> Expr:
    """Returns the mean colour of one pixel, a tuple (red, green, blue), which a picture of the shader shows."""
    x, y = teg.vars("x y")
    above = is_above(x, y)
    channels = (teg.where(above, teg.param(a), teg.param(b)) for a, b in zip(ABOVE, BELOW, strict=True))
    return teg.tuple(*(teg.integral(c, (x, 0, 1), (y, 0, 1)) for c in channels))


def moving() -> list[Param]:
    """Returns the parameters of the derivatives."""
    return [teg.param(name) for name in CORNERS + ABOVE + BELOW]


@dataclass(frozen=True)
class CompiledScene:
    """The two compiled programs, each a function over a batch of pixels."""

    loss: Evaluator
    colour: Evaluator


def compile_scene(backend: str, discontinuities: str = "exact", threads: int = 1) -> CompiledScene:
    """Returns the compiled loss, to be differentiated, and the compiled colour, to be shown."""
    return CompiledScene(
        teg.compile(pixel_loss(), moving(), backend=backend, discontinuities=discontinuities, threads=threads),
        teg.compile(pixel_colour(), [], backend=backend, threads=threads),
    )
