"""The loss of a whole picture: corner values from the lattice, the compiled kernel, and the chain rule back.

    loss = 1/pixels Σ over pixels of `scene.pixel_loss`

All parameters are one vector: the lattice's gradients, the thresholds, the colours, from the highest noise to the lowest. A channel of a
colour is one number, or one for each node of a lattice of colours, between which the colour of a pixel is interpolated.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from teg.examples.perlin.noise import make_tints
from teg.examples.perlin.scene import CORNERS, TARGET, CompiledScene, colour_names, threshold_names

if TYPE_CHECKING:
    from scipy import sparse

    from teg.examples.perlin.noise import Noise

BAND = 2**15  # pixels of one call of the kernel, whole rows: what goes in and out of it stays in the processor's cache


class ShaderLoss:
    """The loss against one picture, `target` (height, width, 3), and its gradient.

    `pixels` and `seconds` count the pixels that the kernel has evaluated, and its time.
    """

    def __init__(self, scene: CompiledScene, noise: Noise, target: np.ndarray, colour_cells: int = 0) -> None:
        self.scene, self.noise, self.colour_cells = scene, noise, colour_cells
        self.thresholds, self.channels = threshold_names(scene.levels), colour_names(scene.levels)
        self.tints = make_tints(noise.size, colour_cells)
        self.nodes = self.tints.nodes
        width, height = noise.size
        bands = [slice(top, min(top + high, height)) for high in [max(1, BAND // width)] for top in range(0, height, high)]
        self.bands = [(rows, *_shares(self.tints.down[rows])) for rows in bands]
        self.target = dict(zip(TARGET, np.ascontiguousarray(np.moveaxis(target, -1, 0)), strict=True))
        self.pixels = 0
        self.seconds = 0.0

    def value_and_gradient(self, parameters: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns the loss per pixel and its derivative by every parameter."""
        width, height = self.noise.size
        heights, (_, thresholds, colours) = self._heights(parameters), self.split(parameters)
        constant = dict(zip(self.thresholds, thresholds, strict=True))
        loss, by_corner, by_threshold = 0.0, np.zeros_like(heights), np.zeros(len(self.thresholds))
        shades = self.tints.along(colours.reshape(-1, self.nodes))
        by_shade = np.zeros_like(shades)
        for rows, nodes, shares in self.bands:
            spread = shades[:, 0, 0] if self.nodes == 1 else np.matmul(shares, shades[:, nodes])
            values = constant | dict(zip(self.channels, spread, strict=True)) | _corner_columns(heights[rows.start : rows.stop + 1])
            begun = time.perf_counter()
            losses, slopes = self.scene.loss.value_and_grad(values | {name: target[rows] for name, target in self.target.items()})
            self.seconds += time.perf_counter() - begun
            loss += float(np.sum(losses))
            for name, (i, j) in zip(CORNERS, np.ndindex(2, 2), strict=True):
                by_corner[rows.start + i : rows.stop + i, j : width + j] += slopes[name]
            by_threshold += [np.sum(slopes[name]) for name in self.thresholds]
            for total, name in zip(by_shade, self.channels, strict=True):
                total[nodes] += shares.T @ slopes[name]
        self.pixels += width * height
        gradient = np.concatenate([self.noise.pull_back(by_corner), by_threshold, self.tints.gather(by_shade).ravel()])
        return loss / (width * height), gradient / (width * height)

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
        """Returns views of the gradients, flat, thresholds (levels - 1,), and colours (levels, 3, nodes)."""
        colours = len(self.channels) * self.nodes
        gradients, thresholds, channels = np.split(parameters, [-colours - len(self.thresholds), -colours])
        return gradients, thresholds, channels.reshape(-1, 3, self.nodes)

    def _values(self, parameters: np.ndarray, factor: int) -> dict[str, Any]:
        """Returns thresholds and colours, by name, for pixels `factor` times smaller."""
        _, thresholds, colours = self.split(parameters)
        tints = make_tints((factor * self.noise.size[0], factor * self.noise.size[1]), self.colour_cells)
        shades = tints.along(colours.reshape(-1, self.nodes))
        spread = shades[:, 0, 0] if self.nodes == 1 else [tints.down @ shade for shade in shades]
        return dict(zip(self.thresholds, thresholds, strict=True)) | dict(zip(self.channels, spread, strict=True))


def _shares(down: sparse.csr_array) -> tuple[slice, np.ndarray]:
    """Returns the rows of nodes around some rows of pixels, and their shares, (rows, nodes): dense, for there are few."""
    shares = down.toarray()
    first, *_, last = np.repeat(np.flatnonzero(shares.any(axis=0)), 2).tolist()
    nodes = slice(first, last + 1)
    return nodes, np.ascontiguousarray(shares[:, nodes])


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
