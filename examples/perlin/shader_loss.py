"""The loss of a whole picture: corner values from the lattice, the compiled kernel, and the chain rule back.

    loss = 1/size² Σ over pixels of `scene.pixel_loss`

All parameters are one vector: the lattice's gradients, the thresholds, the colours, from the highest noise to the lowest.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from teg.examples.perlin.scene import CORNERS, TARGET, CompiledScene, colour_names, threshold_names

if TYPE_CHECKING:
    from teg.examples.perlin.noise import Noise


class ShaderLoss:
    """The loss against one picture, `target` (size, size, 3), and its gradient.

    `pixels` and `seconds` count the pixels that the kernel has evaluated, and its time.
    """

    def __init__(self, scene: CompiledScene, noise: Noise, target: np.ndarray) -> None:
        self.scene, self.noise = scene, noise
        self.names = [*threshold_names(scene.levels), *colour_names(scene.levels)]  # of the parameters after the gradients
        self.target = dict(zip(TARGET, np.ascontiguousarray(np.moveaxis(target, -1, 0)), strict=True))
        self.pixels = 0
        self.seconds = 0.0

    def value_and_gradient(self, parameters: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns the loss per pixel and its derivative by every parameter."""
        n = self.noise.size
        values = self._values(parameters) | _corner_columns(self._heights(parameters)) | self.target
        begun = time.perf_counter()
        losses, slopes = self.scene.loss.value_and_grad(values)
        self.seconds += time.perf_counter() - begun
        self.pixels += n * n
        by_corner = np.zeros((n + 1, n + 1))
        for name, (i, j) in zip(CORNERS, np.ndindex(2, 2), strict=True):
            by_corner[i : n + i, j : n + j] += slopes[name]
        gradient = np.concatenate([self.noise.pull_back(by_corner), [np.sum(slopes[name]) for name in self.names]])
        return float(np.sum(losses)) / n**2, gradient / n**2

    def picture(self, parameters: np.ndarray, factor: int = 1) -> np.ndarray:
        """Returns the shader's picture, every pixel's mean colour, (factor·size, factor·size, 3).

        With a `factor` each pixel is divided into factor² smaller ones; the shader stays the same.
        """
        values = _corner_columns(refine(self._heights(parameters), factor)) | self._values(parameters)
        return np.stack(self.scene.colour(values), axis=-1)

    def _heights(self, parameters: np.ndarray) -> np.ndarray:
        """Returns the noise at the pixels' corners, (size + 1, size + 1)."""
        return np.asarray(self.noise.corners(parameters[: -len(self.names)]))

    def _values(self, parameters: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(self.names, parameters[-len(self.names) :], strict=True))


def _corner_columns(heights: np.ndarray) -> dict[str, np.ndarray]:
    """Returns the four corner values of every pixel, each (size, size)."""
    n = len(heights) - 1
    return {name: heights[i : n + i, j : n + j] for name, (i, j) in zip(CORNERS, np.ndindex(2, 2), strict=True)}


def refine(heights: np.ndarray, factor: int) -> np.ndarray:
    """Returns values at the corners of pixels `factor` times smaller, by the same bilinear interpolation."""
    for _ in range(2):
        share = np.arange(factor)[:, None, None] / factor
        between = (heights[:-1] * (1 - share) + heights[1:] * share).swapaxes(0, 1)
        heights = np.concatenate([between.reshape(-1, heights.shape[1]), heights[-1:]]).T
    return heights
