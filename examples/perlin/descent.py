"""Gradient descent on all parameters at once, with the steps of Adam (Kingma and Ba 2015).

The length of a step falls like 1/√(1 + step/100), and so depends on its number only: a resumed run continues as if it had not been
interrupted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from teg.examples.perlin.shader_loss import ShaderLoss

GRADIENTS, THRESHOLD, COLOUR = 0.1, 0.01, 0.01  # the first lengths of steps: of a lattice gradient, the threshold, a colour
HORIZON = 100
MEAN, SQUARE, TINY = 0.9, 0.99, 1e-12
ROUNDING = 1e-14  # a gradient of this size consists of rounding errors, which Adam would follow like any other


@dataclass(frozen=True)
class State:
    """The state of a descent: all data that its next step depends on.

    Parameters, the gradient there, and the running means of the gradient and its square, (n,) each.
    """

    parameters: np.ndarray
    gradient: np.ndarray
    mean: np.ndarray
    square: np.ndarray
    step: int
    loss: float
    stuck: bool = False


def first_state(shader: ShaderLoss, gradients: np.ndarray, target: np.ndarray) -> State:
    """Returns the first noise, cut so that all colours have the same area; the colours are means over the brightest pixels and so on."""
    levels = shader.scene.levels
    pixels = target.reshape(-1, 3)
    ordered = np.array_split(pixels[np.argsort(-pixels.sum(axis=1), kind="stable")], levels)
    heights = np.sort(shader.noise.corners(gradients), axis=None)[::-1]
    thresholds = [heights[len(heights) * level // levels] for level in range(1, levels)]
    colours = np.repeat([part.mean(axis=0) for part in ordered], shader.nodes)
    parameters = np.concatenate([gradients, thresholds, colours])
    loss, gradient = shader.value_and_gradient(parameters)
    still = np.zeros(len(parameters))
    return State(parameters, gradient, still, still, 0, loss, _is_zero(gradient))


def shown_state(state: State) -> State:
    """Returns what a picture of a state needs: its parameters, in single precision, without means and gradient."""
    none = np.zeros(0)
    return replace(state, parameters=state.parameters.astype(np.float32), gradient=none, mean=none, square=none)


def next_state(shader: ShaderLoss, state: State) -> State:
    """Returns the state after one step down. `stuck` is set if the gradient is zero to rounding.

    There are as many gradients as pixels, so that arithmetic is done in place: a new array costs more than its contents.
    """
    step = state.step + 1
    mean, square = MEAN * state.mean, SQUARE * state.square
    mean += (1 - MEAN) * state.gradient
    change = state.gradient**2
    change *= 1 - SQUARE
    square += change
    np.sqrt(square, out=change)
    change += TINY
    np.divide(mean, change, out=change)
    decay = np.sqrt((1 - SQUARE**step) / (1 + state.step / HORIZON)) / (1 - MEAN**step)
    for part, length in zip(shader.split(change), (GRADIENTS, THRESHOLD, COLOUR), strict=True):
        part *= -length * decay
    parameters = np.add(state.parameters, change, out=change)
    thresholds = shader.split(parameters)[1]
    thresholds[:] = np.sort(thresholds)[::-1]
    loss, gradient = shader.value_and_gradient(parameters)
    return State(parameters, gradient, mean, square, step, loss, _is_zero(gradient))


def _is_zero(gradient: np.ndarray) -> bool:
    return bool(max(gradient.max(), -gradient.min()) <= ROUNDING)
