"""The network: from a picture to the movements of its mesh's vertices. Convolutions only, so it takes pictures of any size.

picture, local contrast normalised → 5×5 → patch of 2×2 cells around each vertex → residual 3×3 over the vertices, LAYERS times →
REACH·tanh

The last layer starts at zero, so the first mesh is the undeformed grid.
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from teg.examples.mesh_network.mesh import CELL, REACH, GridMesh

FEATURES, HIDDEN = 16, 64  # per pixel, per vertex
LAYERS = 2  # over the vertices
CONTRAST = 1e-3  # contrast is not raised below this variance

Weights = dict[str, tuple[Any, Any]]


def first_weights(seed: int) -> Weights:
    """Returns kernels and biases of all layers, normally distributed (He et al. 2015)."""
    shapes = {
        "pixels": (5, 5, 3, FEATURES),
        "patches": (2 * CELL, 2 * CELL, FEATURES, HIDDEN),
        **{f"vertices {k}": (3, 3, HIDDEN, HIDDEN) for k in range(LAYERS)},
    }
    keys = jax.random.split(jax.random.key(seed), len(shapes))
    weights = {
        name: (jax.random.normal(key, shape, jnp.float32) * math.sqrt(2 / math.prod(shape[:-1])), jnp.zeros(shape[-1], jnp.float32))
        for key, (name, shape) in zip(keys, shapes.items(), strict=True)
    }
    return weights | {"movement": (jnp.zeros((1, 1, HIDDEN, 2), jnp.float32), jnp.zeros(2, jnp.float32))}


def predict_vertices(weights: Weights, mesh: GridMesh, pictures: Any) -> Any:
    """Returns vertices (b, n, 2) for pictures (b, size, size, 3)."""
    pixels = jax.nn.gelu(_convolve(_normalised(pictures), weights["pixels"], 2))
    vertices = jax.nn.gelu(_convolve(pixels, weights["patches"], CELL, stride=CELL))
    for k in range(LAYERS):
        vertices = vertices + jax.nn.gelu(_convolve(vertices, weights[f"vertices {k}"], 1))
    movement = REACH * jnp.tanh(_convolve(vertices, weights["movement"], 0))
    return mesh.vertices + mesh.movable * movement.reshape(len(pictures), -1, 2)


def _normalised(pictures: Any) -> Any:
    """Returns colours without their local mean, divided by their local deviation: the place of an edge matters, not its strength."""
    width = 2 * CELL + 1
    box = jnp.full((width, width, 1, 1), 1 / width**2, jnp.float32)

    def blurred(grey: Any) -> Any:
        return _convolve(grey, (box, 0.0), CELL)

    centred = pictures - blurred(pictures.mean(axis=-1, keepdims=True))
    return centred / jnp.sqrt(blurred((centred**2).mean(axis=-1, keepdims=True)) + CONTRAST)


def _convolve(values: Any, layer: tuple[Any, Any], margin: int, stride: int = 1) -> Any:
    """Returns one layer applied to (b, rows, columns, channels), with the border repeated `margin` times outwards."""
    kernel, bias = layer
    padded = jnp.pad(values, ((0, 0), (margin, margin), (margin, margin), (0, 0)), mode="edge")
    return lax.conv_general_dilated(padded, kernel, (stride, stride), "VALID", dimension_numbers=("NHWC", "HWIO", "NHWC")) + bias
