"""Descents with each estimator of the gradient, for the same time: what its errors and its cost mean where gradients are used.

    photo        vertices and colours of a mesh on a small photograph; colours are linear between those at the corners of each triangle
    polygon      place and angle of a hexagon from the pixels of its silhouette
    noise        the gradients of a cell of noise, and its threshold, from the pixels of the part above the threshold
    from nothing the same, from a start at which nothing is above the threshold, so that the true gradient is 0

All use Adam (Kingma and Ba 2015) with the same steps, from the same start. A descent ends when its time is over; time for compiling does
not count. Losses are measured afterwards, exactly. It failed if it ends above its start, or at something that is no number.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from operator import and_
from typing import Any

import numpy as np
import numpy.typing as npt

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend
from teg.examples.charts.estimators import Knob
from teg.examples.charts.regions import LATTICE
from teg.ir.expr import Expr

Array = npt.NDArray[np.float64]
SECONDS = 2.0
"""The time of one descent."""
MEAN, SQUARE = 0.9, 0.99
"""How much Adam remembers."""
SIDE = 12
"""Pixels a side of the pictures of the polygon and of the noise."""
MOST_STEPS = 2000
"""A descent also ends after so many steps."""
SAMPLED: Mapping[str, Mapping[str, Any]] = {
    "edge-mc": {"discontinuities": "edge-mc"},
    "warp": {"discontinuities": "warp"},
    "warp-blur": {"discontinuities": "warp-blur", "sigma": 0.1},
    "smooth": {"discontinuities": "smooth"},
    "differences": {"discontinuities": "differences", "estimator": {"step": 0.02}},
    "spsa": {"discontinuities": "spsa", "estimator": {"step": 0.02}},
}


def _sampled(more: Mapping[str, Any]) -> Knob:
    return lambda n: {**more, "samples": int(n), "inaccurate": "ignore"}


METHODS: dict[str, Knob] = {
    "exact": lambda n: {"tol": 1e-8},
    **{name: _sampled(more) for name, more in SAMPLED.items()},
    "ignore": lambda n: {"discontinuities": "ignore", "tol": 1e-8},
}
"""The estimators, with a number of samples a pixel."""


@dataclass(frozen=True)
class Descent:
    """One descent: seconds and losses of its steps, the start first, and where it ended."""

    problem: str
    method: str
    seconds: tuple[float, ...]
    losses: tuple[float, ...]
    end: tuple[float, ...]

    @property
    def has_failed(self) -> bool:
        return not math.isfinite(self.losses[-1]) or self.losses[-1] > self.losses[0]


@dataclass(frozen=True)
class Task:
    """What is descended: a loss of numbers, its gradient by a method, the start, and the length of a step."""

    start: Array
    length: float | Array
    loss: Callable[[Array], float]
    gradient: Callable[[str], Callable[[Array], Array]]
    samples: int


def descend(problem: str, method: str, backend: Backend, seconds: float = SECONDS, most: int = MOST_STEPS) -> Descent:
    """Returns the descent of a problem with an estimator, of at most so many seconds and steps."""
    task = task_of(problem, backend)
    gradient = task.gradient(method)
    gradient(task.start)  # compiles
    places, times, spent = [task.start], [0.0], 0.0
    mean, square = np.zeros_like(task.start), np.zeros_like(task.start)
    while spent < seconds and len(places) <= most:
        begun = time.perf_counter()
        slopes = gradient(places[-1])
        count = len(places)
        mean, square = MEAN * mean + (1 - MEAN) * slopes, SQUARE * square + (1 - SQUARE) * slopes**2
        scale = np.sqrt(square / (1 - SQUARE**count))
        change = mean / (1 - MEAN**count) / np.where(scale > 0, scale, 1.0)
        places.append(places[-1] - task.length / math.sqrt(1 + count / 30) * change)
        spent += time.perf_counter() - begun
        times.append(spent)
        if not np.isfinite(places[-1]).all():
            break
    kept = sorted({*np.unique(np.geomspace(1, len(places), 40).astype(int) - 1).tolist(), len(places) - 1})
    losses = tuple(task.loss(places[i]) if np.isfinite(places[i]).all() else math.nan for i in kept)
    return Descent(problem, method, tuple(times[i] for i in kept), losses, tuple(float(z) for z in places[kept[-1]].ravel()))


# -- pictures of one shape ---------------------------------------------------------------------------------------------


def hexagon(x: Expr, y: Expr, dx: Expr, dy: Expr, turn: Expr) -> Expr:
    """Returns the inside of an irregular hexagon around (dx, dy)."""
    ring = [(0.34, 0.0), (0.15, 0.22), (-0.12, 0.28), (-0.3, 0.06), (-0.18, -0.24), (0.14, -0.26)]
    corners = [(dx + teg.cos(turn) * u - teg.sin(turn) * v, dy + teg.sin(turn) * u + teg.cos(turn) * v) for u, v in ring]
    pairs = zip(corners, corners[1:] + corners[:1], strict=True)
    edges = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0 for (ax, ay), (bx, by) in pairs]
    return teg.bracket(reduce(and_, edges))


def noise(x: Expr, y: Expr, *values: Expr) -> Expr:
    """Returns whether a cell of gradient noise is above a threshold: two components of gradients, then the threshold."""
    first, second, t = values
    across, along = x * x * (3 - 2 * x), y * y * (3 - 2 * y)
    (_, a1), (b0, b1), (c0, c1), (d0, _) = LATTICE
    lower = (1 - across) * (first * x + a1 * y) + across * (b0 * (x - 1) + b1 * y)
    upper = (1 - across) * (c0 * x + c1 * (y - 1)) + across * (d0 * (x - 1) + second * (y - 1))
    return teg.bracket((1 - along) * lower + along * upper > t)


@dataclass(frozen=True)
class Shape:
    """A shape with parameters: those of the picture, those of the start, the length of a step and samples a pixel."""

    inside: Callable[..., Expr]
    true: Mapping[str, float]
    start: Sequence[float]
    length: float
    samples: int


SHAPES: dict[str, Shape] = {
    "polygon": Shape(hexagon, {"dx": 0.5, "dy": 0.5, "turn": 0.4}, (0.38, 0.62, 0.0), 0.02, 64),
    "noise": Shape(noise, {"first": 0.8, "second": -0.28, "t": -0.03}, (0.4, 0.3, 0.0), 0.02, 64),
    "noise from nothing": Shape(noise, {"first": 0.8, "second": -0.28, "t": -0.03}, (0.3, 0.4, 0.1), 0.02, 64),
}
"""The problems of a picture and a shape."""
PROBLEMS = ("photo", *SHAPES)


def pixel(shape: Shape) -> tuple[Expr, list[Any]]:
    """Returns the covered part of the pixel whose lower left corner is (left, low), and its parameters."""
    x, y = teg.vars("x y")
    left, low = teg.params("left low")
    parameters = [teg.param(name) for name in shape.true]
    size = 1 / SIDE
    whole = teg.integral(shape.inside(x, y, *parameters), (x, left, left + size), (y, low, low + size)) / size**2
    return whole, parameters


@cache
def compiled_pixel(name: str, method: str, backend: Backend) -> Evaluator:
    """Returns the compiled pixel of a shape, with the derivatives of an estimator."""
    e, parameters = pixel(SHAPES[name])
    return teg.compile(e, parameters, backend=backend, **METHODS[method](SHAPES[name].samples))


def _corners() -> dict[str, Array]:
    row, column = np.divmod(np.arange(SIDE * SIDE), SIDE)
    return {"left": column / SIDE, "low": row / SIDE}


@cache
def picture_of(name: str, backend: Backend) -> Array:
    """Returns the pixels of the true shape, exactly."""
    return np.asarray(compiled_pixel(name, "exact", backend)(**SHAPES[name].true, **_corners()))


def _shape_task(name: str, backend: Backend) -> Task:
    shape, goal = SHAPES[name], picture_of(name, backend)

    def values(place: Array) -> dict[str, Any]:
        return dict(zip(shape.true, place.tolist(), strict=True)) | _corners()

    def loss(place: Array) -> float:
        return float(np.mean((compiled_pixel(name, "exact", backend)(**values(place)) - goal) ** 2))

    def gradient(method: str) -> Callable[[Array], Array]:
        f = compiled_pixel(name, method, backend)

        def of(place: Array) -> Array:
            covered, slopes = f.value_and_grad(**values(place))
            return np.array([2 * np.mean((covered - goal) * slopes[k]) for k in shape.true])

        return of

    return Task(np.array(shape.start), shape.length, loss, gradient, shape.samples)


def shown(name: str, place: Sequence[float], backend: Backend) -> Array:
    """Returns the picture of a shape, or of a mesh with its best colours, (rows, columns) or (rows, columns, 3); row 0 is the upper one."""
    if name == "photo":
        return photo(backend).shown(np.array(place))
    values = dict(zip(SHAPES[name].true, place, strict=True))
    return np.asarray(compiled_pixel(name, "exact", backend)(**values, **_corners())).reshape(SIDE, SIDE)[::-1]


def true_picture(name: str, backend: Backend) -> Array:
    """Returns the picture that is looked for."""
    if name == "photo":
        return photo(backend).target
    return picture_of(name, backend).reshape(SIDE, SIDE)[::-1]


# -- a mesh on a photograph --------------------------------------------------------------------------------------------

PIXELS, TRIANGLES, PHOTO_SAMPLES = 20, 24, 16


def corner_loss() -> Expr:
    """Returns the loss of a mesh whose colours are given at the corners of each triangle: they move with its vertices.

    So plain automatic differentiation has derivatives by the vertices, but only those of the colours between.
    """
    from teg.examples.triangulation.scene import BOXES, COLOURS, FACES, TARGET, VERTICES, per_pixel

    x, y = teg.vars("x y")
    face, column, row = teg.index("face"), teg.index("column"), teg.index("row")
    corners = [(VERTICES[FACES[face, c], 0], VERTICES[FACES[face, c], 1]) for c in range(3)]

    def across(i: int, j: int, px: Any, py: Any) -> Expr:
        (ax, ay), (bx, by) = corners[i], corners[j]
        twice: Expr = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
        return twice

    area = across(0, 1, *corners[2])
    parts = [across(1, 2, x, y), across(2, 0, x, y), across(0, 1, x, y)]
    inside = (parts[0] > 0) & (parts[1] > 0) & (parts[2] > 0)
    colours = [sum(COLOURS[face, 3 * c + k] * parts[c] for c in range(3)) / area for k in range(3)]
    difference = sum((colours[k] - TARGET[row, column, k]) ** 2 for k in range(3))
    cell = teg.integral(teg.where(inside, difference, 0), (x, column, column + 1), (y, row, row + 1))
    of_face = teg.sum(cell, (column, BOXES[face, 0], BOXES[face, 1]), (row, BOXES[face, 2], BOXES[face, 3]))
    return per_pixel(teg.sum(of_face, (face, 0, teg.length(FACES, 0))))


@dataclass(frozen=True)
class Photo:
    """A mesh on a photograph: vertices (n, 2) and colours at the corners of its triangles (m, 9), one after the other in a vector."""

    mesh: Any
    target: Array
    backend: Backend

    def parts(self, place: Array) -> tuple[Array, Array]:
        """Returns vertices and colours, the vertices not so far away that a triangle folds."""
        from teg.examples.triangulation.mesh import limit_step

        mesh = self.mesh
        count = mesh.vertices.size
        away = np.where(mesh.movable, place[:count].reshape(-1, 2) - mesh.vertices, 0.0)
        return np.asarray(limit_step(mesh, mesh.vertices, away)), place[count:].reshape(-1, 9)

    def values(self, place: Array) -> dict[str, Array]:
        """Returns the arguments of the loss."""
        from teg.examples.triangulation.image_loss import bounding_boxes

        vertices, colours = self.parts(place)
        boxes = bounding_boxes(vertices[self.mesh.triangles], PIXELS)
        return {"vertices": vertices, "colours": colours, "boxes": boxes, "faces": self.mesh.triangles, "target": self.target}

    def compiled(self, method: str) -> Evaluator:
        """Returns the loss with the derivatives of an estimator."""
        from teg.examples.triangulation.scene import COLOURS, VERTICES

        return teg.compile(corner_loss(), [VERTICES, COLOURS], backend=self.backend, **METHODS[method](PHOTO_SAMPLES))

    def gradient(self, method: str) -> Callable[[Array], Array]:
        """Returns the derivative by vertices and colours as an estimator has it."""
        f = self.compiled(method)

        def of(place: Array) -> Array:
            slopes = f.grad(self.values(place))
            return np.concatenate([np.where(self.mesh.movable, slopes["vertices"], 0.0).ravel(), slopes["colours"].ravel()])

        return of

    def shown(self, place: Array) -> Array:
        """Returns the coloured mesh as a picture."""
        from teg.examples.triangulation.colour_fit import anchors
        from teg.examples.triangulation.pictures import render

        vertices, colours = self.parts(place)
        corners = vertices[self.mesh.triangles]
        anchor = anchors(corners)
        places = (corners - anchor[:, None, :2]) * anchor[:, None, 2:]
        monomials = np.concatenate([np.ones((len(corners), 3, 1)), places], axis=2)
        coefficients = np.linalg.solve(monomials, colours.reshape(-1, 3, 3)).reshape(-1, 9)
        return np.asarray(render(vertices, self.mesh.triangles, coefficients, PIXELS, 8 * PIXELS))


@cache
def photo(backend: Backend) -> Photo:
    """Returns scikit-image's photograph, and a mesh on it."""
    from teg.examples.photo import read_target
    from teg.examples.triangulation.mesh import make_mesh

    return Photo(make_mesh(TRIANGLES, PIXELS), read_target(None, PIXELS), backend)


def _photo_task(backend: Backend) -> Task:
    scene = photo(backend)
    count, colours = scene.mesh.vertices.size, 9 * len(scene.mesh.triangles)
    exact = scene.compiled("exact")
    start = np.concatenate([scene.mesh.vertices.ravel(), np.full(colours, 0.5)])
    length = np.concatenate([np.full(count, 0.05 * scene.mesh.cell), np.full(colours, 0.05)])
    return Task(start, length, lambda place: float(exact(scene.values(place))), scene.gradient, PHOTO_SAMPLES)


@cache
def task_of(problem: str, backend: Backend) -> Task:
    """Returns a problem."""
    return _photo_task(backend) if problem == "photo" else _shape_task(problem, backend)
