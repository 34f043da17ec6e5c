"""The loss of a whole picture: corner values from the lattice, the compiled kernel, and the chain rule back.

    loss = 1/pixels Σ over pixels of `scene.pixel_loss`

All parameters are one vector: the lattice's gradients, the thresholds, the colours, from the highest noise to the lowest. A channel of a
colour is one number, or one for each node of a lattice of colours, between which the colour of a pixel is interpolated.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from teg.examples.perlin.noise import tints
from teg.examples.perlin.scene import CORNERS, TARGET, CompiledScene, colour_names, threshold_names

if TYPE_CHECKING:
    from teg.examples.perlin.noise import Noise


class ShaderLoss:
    """The loss against one picture, `target` (height, width, 3), and its gradient.

    `pixels` and `seconds` count the pixels that the kernel has evaluated, and its time.
    """

    def __init__(self, scene: CompiledScene, noise: Noise, target: np.ndarray, colour_cells: int = 0) -> None:
        self.scene, self.noise, self.colour_cells = scene, noise, colour_cells
        self.thresholds, self.channels = threshold_names(scene.levels), colour_names(scene.levels)
        self.tints = tints(noise.size, colour_cells)
        self.nodes = self.tints.shape[1]
        self.target = dict(zip(TARGET, np.ascontiguousarray(np.moveaxis(target, -1, 0)), strict=True))
        self.pixels = 0
        self.seconds = 0.0

    def value_and_gradient(self, parameters: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns the loss per pixel and its derivative by every parameter."""
        width, height = self.noise.size
        values = self._values(parameters) | _corner_columns(self._heights(parameters)) | self.target
        begun = time.perf_counter()
        losses, slopes = self.scene.loss.value_and_grad(values)
        self.seconds += time.perf_counter() - begun
        self.pixels += width * height
        by_corner = np.zeros((height + 1, width + 1))
        for name, (i, j) in zip(CORNERS, np.ndindex(2, 2), strict=True):
            by_corner[i : height + i, j : width + j] += slopes[name]
        by_threshold = [np.sum(slopes[name]) for name in self.thresholds]
        by_colour = [self.tints.T @ slopes[name].ravel() for name in self.channels]
        gradient = np.concatenate([self.noise.pull_back(by_corner), by_threshold, *by_colour])
        return float(np.sum(losses)) / (width * height), gradient / (width * height)

    def picture(self, parameters: np.ndarray, factor: int = 1) -> np.ndarray:
        """Returns the shader's picture, every pixel's mean colour, (factor·height, factor·width, 3).

        With a `factor` each pixel is divided into factor² smaller ones; the shader stays the same.
        """
        values = _corner_columns(refine(self._heights(parameters), factor)) | self._values(parameters, factor)
        return np.stack(self.scene.colour(values), axis=-1)

    def slope_picture(self, parameters: np.ndarray, direction: np.ndarray, factor: int = 1) -> np.ndarray:
        """Returns the exact derivative of `picture` along a direction of gradients and thresholds, a vector like the parameters."""
        values = _corner_columns(refine(self._heights(parameters), factor)) | self._values(parameters, factor)
        _, thresholds, _ = self.split(direction)
        moving = _corner_columns(refine(self._heights(direction), factor)) | dict(zip(self.thresholds, thresholds, strict=True))
        slopes = self.scene.colour_slopes.grad(values)
        return np.asarray(sum(np.stack(slopes[name], axis=-1) * np.asarray(moved)[..., None] for name, moved in moving.items()))

    def _heights(self, parameters: np.ndarray) -> np.ndarray:
        """Returns the noise at the pixels' corners, (height + 1, width + 1)."""
        return np.asarray(self.noise.corners(self.split(parameters)[0]))

    def split(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns gradients, flat, thresholds (levels - 1,), and colours (levels, 3, nodes)."""
        colours = len(self.channels) * self.nodes
        gradients, thresholds, channels = np.split(parameters, [-colours - len(self.thresholds), -colours])
        return gradients, thresholds, channels.reshape(-1, 3, self.nodes)

    def _values(self, parameters: np.ndarray, factor: int = 1) -> dict[str, np.ndarray]:
        _, thresholds, colours = self.split(parameters)
        width, height = (factor * n for n in self.noise.size)
        spread = self.tints if factor == 1 else tints((width, height), self.colour_cells)
        channels = colours.reshape(-1, self.nodes)
        shades = channels[:, 0] if self.nodes == 1 else [(spread @ channel).reshape(height, width) for channel in channels]
        return dict(zip([*self.thresholds, *self.channels], [*thresholds, *shades], strict=True))


def _corner_columns(heights: np.ndarray) -> dict[str, np.ndarray]:
    """Returns the four corner values of every pixel, each (height, width)."""
    height, width = heights.shape[0] - 1, heights.shape[1] - 1
    return {name: heights[i : height + i, j : width + j] for name, (i, j) in zip(CORNERS, np.ndindex(2, 2), strict=True)}


def refine(heights: np.ndarray, factor: int) -> np.ndarray:
    """Returns values at the corners of pixels `factor` times smaller, by the same bilinear interpolation."""
    for _ in range(2):
        share = np.arange(factor)[:, None, None] / factor
        between = (heights[:-1] * (1 - share) + heights[1:] * share).swapaxes(0, 1)
        heights = np.concatenate([between.reshape(-1, heights.shape[1]), heights[-1:]]).T
    return heights
