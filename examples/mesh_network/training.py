"""Training the network: stochastic descent on crops, by the gradient that comes through the integrals.

One epoch is CROPS fresh crops in batches of BATCH, one step of Adam each (optax), all of it one `lax.scan` under `jit`. A batch's loss
is that of its meshes divided by that of the undeformed grid, both in their best colours, each crop weighted by one over the root of the
latter: otherwise the few crops with much contrast would dominate. The network in use is a running mean of the weights (Polyak and
Juditsky 1992), which is insensitive to the noise of small batches. Crops and the lengths of steps depend only on the seed and the number
of the step: a resumed run continues as if it had not been interrupted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import lax
from jax.flatten_util import ravel_pytree

from teg.examples.mesh_network.coverage import Cover
from teg.examples.mesh_network.crops import cut_crops
from teg.examples.mesh_network.mesh import GridMesh, make_mesh
from teg.examples.mesh_network.mesh_loss import best_colours, mesh_loss
from teg.examples.mesh_network.network import first_weights, predict_vertices

CROPS, BATCH = 160, 8
CELLS = 4  # per side of a crop
RATE, HORIZON = 3e-3, 300  # the first step's length, and the number of steps after which it is 1/√2 of that
MEAN = 0.01  # the weight of the newest weights in the running mean
FLAT = 1e-4  # a crop with a smaller loss is one of a wall or the sky, and its weight grows no further


@dataclass(frozen=True)
class State:
    """The state of training: all data that the next epoch depends on.

    `numbers` are the weights, their running mean and the means that Adam keeps, in one vector; `training` the mean ratio of losses in
    each epoch, (epochs,); `loss` that of the held-out photo.
    """

    numbers: np.ndarray
    training: np.ndarray
    loss: float
    stuck: bool = False


@dataclass
class Trainer:
    """The network, its training data, and the held-out photo, (size, size, 3).

    `crops` and `batch` are the numbers of crops of an epoch and of a step. Values are float32.
    """

    cover: Cover
    photos: Sequence[np.ndarray]
    held_out: np.ndarray
    mesh: GridMesh
    seed: int = 0
    crops: int = CROPS
    batch: int = BATCH
    crop_mesh: GridMesh = field(default_factory=lambda: make_mesh(CELLS))

    def __post_init__(self) -> None:
        self._optimiser: Any = optax.adam(lambda step: RATE / jnp.sqrt(1 + step / HORIZON))
        weights = first_weights(self.seed)
        packed: tuple[Any, Any] = ravel_pytree((weights, weights, self._optimiser.init(weights)))
        numbers, self._unpacked = packed
        self._numbers = np.asarray(numbers)
        self._epoch = jax.jit(lambda numbers, crops: lax.scan(self._step, numbers, crops))
        self._held_out = jax.jit(self._loss_of_photo)
        self._colours = jax.jit(lambda vertices, photo: best_colours(self.cover, self.mesh, vertices, photo))

    def first_state(self) -> State:
        """Returns the state before training: the undeformed grid, in its best colours."""
        return State(self._numbers, np.zeros(0), float(self._held_out(self._numbers, self.held_out)))

    def next_state(self, state: State) -> State:
        """Returns the state after one epoch. `stuck` is set if the gradient by the weights was exactly 0 in every step."""
        crops = self._crops(len(state.training))
        numbers, (ratios, largest) = self._epoch(state.numbers, crops.reshape(-1, self.batch, *crops.shape[1:]))
        training = np.append(state.training, float(ratios.mean()))
        loss = float(self._held_out(numbers, self.held_out))
        return State(np.asarray(numbers), training, loss, bool(np.all(np.asarray(largest) == 0)))

    def vertices(self, state: State) -> np.ndarray:
        """Returns the mesh of the held-out photo, (n, 2)."""
        _, weights, _ = self._unpacked(jnp.asarray(state.numbers))
        return np.asarray(predict_vertices(weights, self.mesh, self.held_out[None])[0])

    def colours(self, vertices: np.ndarray) -> np.ndarray:
        """Returns the best colours of a mesh of the held-out photo, (m, 3)."""
        return np.asarray(self._colours(vertices, self.held_out))

    def largest_slope(self, state: State, cover: Cover) -> float:
        """Returns the largest entry of the gradient by the weights, of the first batch, with areas by another `cover`."""
        weights, _, _ = self._unpacked(jnp.asarray(state.numbers))
        slopes = jax.jit(jax.grad(lambda w, crops: self._batch_loss(w, crops, cover)))(weights, self._crops(0)[: self.batch])
        return max(float(jnp.abs(s).max()) for s in jax.tree.leaves(slopes))

    # -- inside --------------------------------------------------------------------------------------------------------

    def _crops(self, epoch: int) -> np.ndarray:
        return cut_crops(self.photos, self.crop_mesh.size, self.crops, (self.seed, epoch))

    def _step(self, numbers: Any, crops: Any) -> tuple[Any, tuple[Any, Any]]:
        weights, mean, memory = self._unpacked(numbers)
        loss, slopes = jax.value_and_grad(self._batch_loss)(weights, crops, self.cover)
        change, memory = self._optimiser.update(slopes, memory)
        largest = jnp.max(jnp.stack([jnp.abs(s).max() for s in jax.tree.leaves(slopes)]))
        weights = optax.apply_updates(weights, change)
        return ravel_pytree((weights, optax.incremental_update(weights, mean, MEAN), memory))[0], (loss, largest)

    def _batch_loss(self, weights: Any, crops: Any, cover: Cover) -> Any:
        losses: Any = jax.vmap(lambda vertices, crop: mesh_loss(cover, self.crop_mesh, vertices, crop))
        predicted = losses(predict_vertices(weights, self.crop_mesh, crops), crops)
        grid = losses(jnp.broadcast_to(self.crop_mesh.vertices, (len(crops), *self.crop_mesh.vertices.shape)), crops)
        weight = 1 / jnp.sqrt(grid + FLAT)
        return jnp.sum(predicted * weight) / jnp.sum(grid * weight)

    def _loss_of_photo(self, numbers: Any, photo: Any) -> Any:
        _, weights, _ = self._unpacked(numbers)
        return mesh_loss(self.cover, self.mesh, predict_vertices(weights, self.mesh, photo[None])[0], photo)
