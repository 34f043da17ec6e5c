"""Descent of the vertices with the best colours, by five methods.

With the colours eliminated, the gradient of the loss by the vertices is the one at the best colours (envelope theorem). Every method cuts
its step where a triangle would fold, so that no mesh on the way has a fold.

    resilient   a vertex goes down its own gradient by a length of its own, which grows while successive gradients agree and shrinks when
                they turn back (resilient propagation, Riedmiller and Braun 1993, here by vertex and not by sign)
    gradient    steepest descent; the length grows by a third after each step, and is halved until the loss falls
    adam        Kingma and Ba 2015, with a length that falls like 1/√step; the loss need not fall
    lbfgs       SciPy's L-BFGS-B, ten iterations a step, in a box around each vertex in which no triangle can fold
    newton      Newton-Krylov: a step of SciPy's truncated conjugate gradients (Steihaug 1983) in a trust region, with products of the
                exact Hessian, which negative curvature ends; the region grows and shrinks as the loss falls as promised or does not
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from teg.errors import InputError
from teg.examples.triangulation.image_loss import ImageLoss, PictureLoss
from teg.examples.triangulation.mesh import Mesh, limit_step, signed_areas

FIRST, LONGEST, SHORTEST = 0.02, 0.08, 1e-6  # lengths of a vertex's step, in cells of the mesh
GROW, SHRINK = 1.3, 0.5
HALVINGS = 30
ADAM, MEAN, SQUARE = 0.05, 0.9, 0.99
ITERATIONS = 10
SLOPE = 0.01  # norm of the scaled gradient in a Newton step: conjugate gradients end at a tenth of their first residual
POOR, GOOD = 0.25, 0.75  # shares of the promised gain at which a trust region shrinks, and grows
BOX = 0.25  # of the least height of the triangles around: two vertices that move by √2·BOX cannot meet


@dataclass(frozen=True)
class State:
    """The state of a descent: all data that its next step depends on.

    Vertices and their last gradients (n, 2), `triangles` (m, 3) and `movable` (n, 2) as in `Mesh`, what a method remembers of each
    vertex (n, 5), colours (m, 3·terms), loss per pixel, the number of steps.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    movable: np.ndarray
    colours: np.ndarray
    gradient: np.ndarray
    memory: np.ndarray
    loss: float
    step: int = 0
    stuck: bool = False

    def mesh(self, size: tuple[int, int]) -> Mesh:
        """Returns its mesh."""
        return Mesh(self.vertices, self.triangles, self.movable, size)


def first_state(mesh: Mesh, image: PictureLoss, terms: int = 1) -> State:
    """Returns the undeformed mesh with its best colours, the best that colours alone can do; a mesh with colours starts from these."""
    image.triangles = mesh.triangles
    first = np.full((len(mesh.triangles), 3 * terms), 0.5 / terms)
    if mesh.colours is not None:
        shared = min(3 * terms, mesh.colours.shape[1])
        first[:, :shared], first[:, shared:] = mesh.colours[:, :shared], 0
    loss, colours = image.best_colours(mesh.vertices, first)
    memory = fresh_memory(len(mesh.vertices), mesh.cell)
    return State(mesh.vertices, mesh.triangles, mesh.movable, colours, np.zeros(mesh.vertices.shape), memory, loss)


def fresh_memory(count: int, cell: float) -> np.ndarray:
    """Returns what a method remembers of vertices before the first step: the length of a step, and Adam's two means."""
    return np.column_stack([np.full(count, FIRST * cell), np.zeros((count, 4))])


def next_state(image: PictureLoss, state: State, size: tuple[int, int], optimiser: str = "resilient") -> State:
    """Returns the state after one step. `stuck` is set if the gradient is zero, or no step lowers the loss."""
    image.triangles = state.triangles
    gradient = np.where(state.movable, image.gradient(state.vertices, state.colours), 0.0)
    if not gradient.any():
        return replace(state, gradient=gradient, stuck=True)
    return OPTIMISERS[optimiser](image, state, gradient, state.mesh(size))


def _resilient(image: PictureLoss, state: State, gradient: np.ndarray, mesh: Mesh) -> State:
    agreement = np.sum(gradient * state.gradient, axis=1, keepdims=True)
    lengths = state.memory[:, :1] * np.select([agreement > 0, agreement < 0], [GROW, SHRINK], 1.0)
    lengths = np.clip(lengths, SHORTEST * mesh.cell, LONGEST * mesh.cell)
    norm = np.linalg.norm(gradient, axis=1, keepdims=True)
    return _falling(image, state, mesh, gradient, (-gradient / np.where(norm > 0, norm, 1.0), lengths))


def _gradient(image: PictureLoss, state: State, gradient: np.ndarray, mesh: Mesh) -> State:
    norm = np.linalg.norm(gradient, axis=1).max()
    return _falling(image, state, mesh, gradient, (-gradient / norm, state.memory[:, :1] * (4 / 3 if state.step else 4)))


def _falling(image: PictureLoss, state: State, mesh: Mesh, gradient: np.ndarray, step: tuple[np.ndarray, np.ndarray]) -> State:
    """Returns the state after a step downhill, of these directions and lengths, halved until the loss falls."""
    downhill, lengths = step
    for _ in range(HALVINGS):
        vertices = limit_step(mesh, state.vertices, lengths * downhill)
        loss, colours = image.best_colours(vertices, state.colours)
        if loss < state.loss:
            memory = np.column_stack([lengths, state.memory[:, 1:]])
            return replace(
                state, vertices=vertices, colours=colours, gradient=gradient, memory=memory, loss=loss, step=state.step + 1, stuck=False
            )
        lengths = lengths / 2
    return replace(state, gradient=gradient, stuck=True)


def _adam(image: PictureLoss, state: State, gradient: np.ndarray, mesh: Mesh) -> State:
    count = state.step + 1
    mean = MEAN * state.memory[:, 1:3] + (1 - MEAN) * gradient
    square = SQUARE * state.memory[:, 3:] + (1 - SQUARE) * gradient**2
    scale = np.sqrt(square / (1 - SQUARE**count))
    change = mean / (1 - MEAN**count) / np.where(scale > 0, scale, 1.0)
    vertices = limit_step(mesh, state.vertices, -ADAM * mesh.cell / np.sqrt(1 + count / 10) * change)
    loss, colours = image.best_colours(vertices, state.colours)
    memory = np.column_stack([state.memory[:, :1], mean, square])
    return replace(state, vertices=vertices, colours=colours, gradient=gradient, memory=memory, loss=loss, step=count)


def _lbfgs(image: PictureLoss, state: State, gradient: np.ndarray, mesh: Mesh) -> State:
    from scipy.optimize import Bounds, minimize

    free = mesh.movable
    best = state.loss, state.vertices, state.colours

    def objective(places: np.ndarray) -> tuple[float, np.ndarray]:
        nonlocal best
        vertices = state.vertices.copy()
        vertices[free] = places * mesh.cell
        loss, colours = image.best_colours(vertices, state.colours)
        if loss < best[0]:
            best = loss, vertices, colours
        return loss / state.loss, image.gradient(vertices, colours)[free] * (mesh.cell / state.loss)

    start, room = state.vertices[free], np.repeat(_boxes(mesh)[:, None], 2, axis=1)[free]
    bounds = Bounds((start - room) / mesh.cell, (start + room) / mesh.cell)
    options = {"maxiter": ITERATIONS, "ftol": 0.0, "gtol": 0.0}
    minimize(objective, start / mesh.cell, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    loss, vertices, colours = best
    stuck = loss >= state.loss
    return replace(state, vertices=vertices, colours=colours, gradient=gradient, loss=loss, step=state.step + (not stuck), stuck=stuck)


def _newton(image: PictureLoss, state: State, gradient: np.ndarray, mesh: Mesh) -> State:
    if not isinstance(image, ImageLoss):
        raise InputError("a picture that JAX's devices share has no products of its Hessian", None, "--optimiser resilient")
    from scipy.optimize import minimize

    free, unit = mesh.movable, mesh.cell
    slope = gradient[free] * unit
    scale = SLOPE / np.linalg.norm(slope)  # SciPy stops conjugate gradients at √(norm of the slope) of their first residual
    known: dict[bytes, np.ndarray] = {}  # a smaller region begins with the same directions

    def curved(_: np.ndarray, direction: np.ndarray) -> np.ndarray:
        key = direction.tobytes()
        if key not in known:
            along = np.zeros(gradient.shape)
            along[free] = direction * unit
            known[key] = image.hessian_product(state.vertices, state.colours, along)[free] * (unit * scale)
        return known[key]

    def model(step: np.ndarray) -> tuple[float, np.ndarray]:
        turned = curved(step, step) if step.any() else 0.0 * step
        return float(scale * slope @ step + step @ turned / 2), scale * slope + turned

    radius = float(np.median(state.memory[:, 0])) / unit
    while radius > SHORTEST:
        whole = radius * np.sqrt(len(slope))
        region = {"maxiter": 1, "initial_trust_radius": whole, "max_trust_radius": 2 * whole, "gtol": 0.0}
        best = minimize(model, np.zeros(len(slope)), jac=True, hessp=curved, method="trust-ncg", options=region)
        step = np.zeros(gradient.shape)
        step[free] = best.x * unit
        vertices = limit_step(mesh, state.vertices, step)
        loss, colours = image.best_colours(vertices, state.colours)
        kept = (state.loss - loss) * scale / max(-best.fun, 1e-300)  # of what the model promised
        if kept < POOR:
            radius /= 4
        elif kept > GOOD and np.linalg.norm(best.x) > 0.9 * whole:
            radius *= 2
        if loss < state.loss:
            memory = np.column_stack([np.full(len(vertices), radius * unit), state.memory[:, 1:]])
            return replace(
                state, vertices=vertices, colours=colours, gradient=gradient, memory=memory, loss=loss, step=state.step + 1, stuck=False
            )
    return replace(state, gradient=gradient, stuck=True)


def _boxes(mesh: Mesh) -> np.ndarray:
    """Returns how far each coordinate of a vertex may move, (n,), so that no triangle folds; 0 where one is at the least area."""
    corners, areas = mesh.vertices[mesh.triangles], signed_areas(mesh.vertices, mesh.triangles)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    room = BOX * 2 * areas / longest * np.clip(1 - mesh.floor / areas, 0, None)
    least = np.full(len(mesh.vertices), np.inf)
    np.minimum.at(least, mesh.triangles.ravel(), np.repeat(room, 3))
    return least


OPTIMISERS: dict[str, Callable[[PictureLoss, State, np.ndarray, Mesh], State]] = {
    "resilient": _resilient,
    "gradient": _gradient,
    "adam": _adam,
    "lbfgs": _lbfgs,
    "newton": _newton,
}
"""The methods by name."""
