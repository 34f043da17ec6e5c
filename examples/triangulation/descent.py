"""Gradient descent on the vertices with the best colours: the loss falls in every step.

With the colours eliminated, the gradient of the loss by the vertices is the one at the best colours (envelope theorem). Each vertex goes
down its own gradient by a length of its own, which grows while successive gradients agree and shrinks when they turn back (resilient
propagation, Riedmiller and Braun 1993, here by vertex and not by sign), so that vertices on strong and on faint edges move alike. The
step is cut where a triangle would fold (`mesh.limit_step`), and halved until the loss falls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from teg.examples.triangulation.image_loss import PictureLoss
from teg.examples.triangulation.mesh import Mesh, limit_step

FIRST, LONGEST, SHORTEST = 0.02, 0.08, 1e-6  # lengths of a vertex's step, in cells of the mesh
GROW, SHRINK = 1.3, 0.5
HALVINGS = 30


@dataclass(frozen=True)
class State:
    """The state of a descent: all data that its next step depends on.

    Vertices and their last gradients (n, 2), lengths of their steps (n, 1), colours (m, 3), loss per pixel.
    """

    vertices: np.ndarray
    colours: np.ndarray
    gradient: np.ndarray
    lengths: np.ndarray
    loss: float
    stuck: bool = False


def first_state(mesh: Mesh, image: PictureLoss) -> State:
    """Returns the undeformed mesh with its best colours: the best that colours alone can do."""
    loss, colours = image.best_colours(mesh.vertices, np.full((len(mesh.triangles), 3), 0.5))
    lengths = np.full((len(mesh.vertices), 1), FIRST * mesh.cell)
    return State(mesh.vertices, colours, np.zeros(mesh.vertices.shape), lengths, loss)


def next_state(mesh: Mesh, image: PictureLoss, state: State) -> State:
    """Returns the state after one step down. `stuck` is set if the gradient is zero, or no step along it lowers the loss."""
    gradient = np.where(mesh.movable, image.gradient(state.vertices, state.colours), 0.0)
    agreement = np.sum(gradient * state.gradient, axis=1, keepdims=True)
    lengths = state.lengths * np.select([agreement > 0, agreement < 0], [GROW, SHRINK], 1.0)
    lengths = np.clip(lengths, SHORTEST * mesh.cell, LONGEST * mesh.cell)
    norm = np.linalg.norm(gradient, axis=1, keepdims=True)
    downhill = -gradient / np.where(norm > 0, norm, 1.0)
    for _ in range(HALVINGS if gradient.any() else 0):
        vertices = limit_step(mesh, state.vertices, lengths * downhill)
        loss, colours = image.best_colours(vertices, state.colours)
        if loss < state.loss:
            return State(vertices, colours, gradient, lengths, loss)
        lengths = lengths / 2
    return replace(state, gradient=gradient, stuck=True)
