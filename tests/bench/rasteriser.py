"""Meshes beside DEODR, a differentiable rasteriser in C (de La Gorce, Fleet and Paragios 2011): one scene, one loss, runs in turn.

A pixel of DEODR is the colour at its middle; along edges that hide something it is mixed with that of the nearer triangle, up to a pixel
outside of it. Its gradient is that of this picture: no edge inside of a surface, and no line where surfaces cross, has a share in it.
The package is optional (`pip install 'teg-compiler[peers]'`). Mitsuba is not asked: it samples paths of light at random.
"""

from __future__ import annotations

import importlib.util
from typing import Any, NamedTuple

import numpy as np

import teg
from teg.examples import occlusion
from teg.examples.bins import binned
from teg.ir.expr import Expr
from tests.bench.rows import Row
from tests.bench.speed import in_turn, mesh, thread_time

Array = Any
SIZE = 512
BACKGROUND = 0.05
STEP = 1e-6


class Mesh(NamedTuple):
    """Triangles in the plane of a picture, in pixels, that turn from columns to rows.

    `places` (vertices, 2) are column and row, `depths` (vertices,) at least 0, `faces` (triangles, 3). `colours` (rows, 3): the corners of
    triangles have the rows `shades` (triangles, 3). `borders` (triangles, 3): whether the edges 0-1, 1-2 and 2-0 are antialiased.
    """

    places: Array
    depths: Array
    faces: Array
    colours: Array
    shades: Array
    borders: Array


# -- scenes ------------------------------------------------------------------------------------------------------------


def overlapping(count: int = 10_000, size: int = SIZE) -> Mesh:
    """Small triangles that overlap and cross each other, with colours of their own."""
    rng = np.random.default_rng(1)
    corners = rng.uniform(0, size, (count, 1, 2)) + rng.normal(0, 8, (count, 3, 2))
    corners[turns(corners) < 0] = corners[turns(corners) < 0][:, [0, 2, 1]]
    own = np.arange(3 * count).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 2), rng.uniform(0.2, 1, 3 * count), own, rng.random((3 * count, 3)), own, np.ones((count, 3), bool))


def torus(count: int = 10_000, size: int = SIZE) -> Mesh:
    """The mesh of the demonstration `occlusion`, with a colour at each vertex."""
    vertices, faces, _ = occlusion.scene_of(count)
    px, py, depth = occlusion.seen(tuple(vertices.T), occlusion.TRUE, np)  # type: ignore[arg-type]
    places = (np.stack([px, py], axis=1) + 1) * size / 2
    colours = 0.5 + 0.4 * np.sin(vertices @ np.random.default_rng(2).normal(0, 2, (3, 3)))
    return Mesh(places, 1 - 1 / depth, faces, colours, faces, silhouette(places, faces))


def flat(cells: int = 32) -> Mesh:
    """The triangles of the table "Picture": nothing hides anything, and colours jump from one to the next."""
    rng = np.random.default_rng(7)
    places, faces = mesh(rng)
    shades = np.arange(faces.size).reshape(-1, 3)
    return Mesh(places, np.ones(len(places)), faces, rng.random((faces.size, 3)), shades, np.ones(faces.shape, bool))


def turns(corners: Array) -> Array:
    """Returns twice the areas of triangles (n, 3, 2), above 0 where they turn from the first coordinate to the second."""
    (ux, uy), (vx, vy) = ((corners[:, k] - corners[:, 0]).T for k in (1, 2))
    return ux * vy - uy * vx


def silhouette(places: Array, faces: Array) -> Array:
    """Returns which edges 0-1, 1-2, 2-0 of a closed mesh have a triangle on their other side that turns away: (triangles, 3)."""
    fronts = turns(places[faces]) > 0
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    _, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    seen = np.bincount(number.ravel(), np.repeat(fronts, 3))
    return (seen[number.ravel()] == 1).reshape(-1, 3) & fronts[:, None]


# -- both answers ------------------------------------------------------------------------------------------------------


class Answer(NamedTuple):
    """A loss and its derivatives by places and colours."""

    loss: float
    by_place: Array
    by_colour: Array


def loss() -> tuple[Expr, list[Any]]:
    """Returns Σ (pixel - T)² over all pixels and channels of the nearest triangles, and by what to differentiate."""
    x, y = teg.vars("x y")
    P, D, C, T = teg.array("P", 2), teg.array("D"), teg.array("C", 2), teg.array("T", 3)
    F, G, R, L = teg.indices("F", 2), teg.indices("G", 2), teg.indices("R", 2), teg.indices("L")
    i, j, k = teg.index("i"), teg.index("j"), teg.index("k")
    face, size = L[k], teg.length(T)
    p, q, r = ((P[F[face, n], 0], P[F[face, n], 1]) for n in range(3))

    def across(a: Any, b: Any, at: Any) -> Any:
        return (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0])

    area = across(p, q, r)
    weights = [across(q, r, (x, y)) / area, across(r, p, (x, y)) / area, across(p, q, (x, y)) / area]
    depth = sum((w * D[F[face, n]] for n, w in enumerate(weights)), start=0 * x)
    colour = [sum((w * C[G[face, n], c] for n, w in enumerate(weights)), start=0 * x) for c in range(3)]
    inside = (area > 0) & (weights[0] > 0) & (weights[1] > 0) & (weights[2] > 0)
    row = i * size + j
    seen = teg.nearest(tuple(colour), depth, (k, R[row, 0], R[row, 1]), where=inside, otherwise=(BACKGROUND,) * 3)
    means = [teg.integral(channel, (x, j, j + 1), (y, i, i + 1)) for channel in seen]
    error = sum(((mean - T[i, j, c]) ** 2 for c, mean in enumerate(means)), start=0 * T[i, j, 0])
    return teg.sum(error, (j, 0, size), (i, 0, size)), [P, C]


class Ours:
    """The exact loss."""

    def __init__(self, scene: Mesh, target: Array, evaluator: Any = None) -> None:
        self.evaluator = evaluator or teg.compile(*loss(), backend="c")
        self.given = {"P": scene.places, "D": scene.depths, "C": scene.colours, "F": scene.faces, "G": scene.shades, "T": target}
        self.given |= candidates(scene, len(target))

    def __call__(self) -> Answer:
        value, slopes = self.evaluator.value_and_grad(self.given)
        return Answer(float(value), slopes["P"], slopes["C"])

    def picture(self) -> Array:
        """Returns the pixels, as the derivative of the loss by those that it is compared with."""
        evaluator = teg.compile(loss()[0], [teg.array("T", 3)], backend="c")
        return self.given["T"] - 0.5 * evaluator.grad(self.given)["T"]

    def difference(self, way: Array) -> float:
        """Returns the derivative of the loss as the places go along `way`, from values alone."""
        values = [float(self.evaluator({**self.given, "P": self.given["P"] + s * STEP * way})) for s in (1, -1, 2, -2)]
        return (8 * (values[0] - values[1]) - (values[2] - values[3])) / (12 * STEP)


def candidates(scene: Mesh, size: int) -> dict[str, Array]:
    """Returns the lists of all pixels: triangles that do not turn away and have no edge with all of the pixel outside."""
    corners = scene.places[scene.faces]
    first, last = np.floor(corners.min(axis=1)), np.ceil(corners.max(axis=1))
    front = np.flatnonzero(turns(corners) > 0)
    first, last = (ends.clip(0, size).astype(np.int64)[front] for ends in (first, last))
    ranges, owners = binned(front, first, last, (1, size))
    pixel = np.repeat(np.arange(size * size), np.diff(ranges, axis=1).ravel())
    row, column = np.divmod(pixel, size)
    meet = np.ones(len(pixel), dtype=bool)
    for n in range(3):
        start, (dx, dy) = corners[:, n], (corners[:, (n + 1) % 3] - corners[:, n]).T
        most = dy * start[:, 0] - dx * start[:, 1] + np.maximum(dx, 0) + np.maximum(-dy, 0)
        meet &= dx[owners] * row - dy[owners] * column + most[owners] >= -1e-9 * size
    ends = np.cumsum(np.bincount(pixel[meet], minlength=size * size))
    return {"R": np.stack([np.concatenate([[0], ends[:-1]]), ends], axis=1), "L": owners[meet]}


def as_deodr(scene: Mesh, size: int) -> dict[str, Any]:
    """Returns the arguments of `deodr.differentiable_renderer.Scene2D`.

    Its colours are of vertices, so each triangle has its own three. From columns to rows is clockwise in its words; triangles that turn
    away are culled. Its edges are 1-0, 0-2 and 2-1, of which it antialiases those that `borders` names.
    """
    count = scene.faces.size
    own = np.arange(count, dtype=np.uint32).reshape(-1, 3)
    triangles = len(own)
    return {
        "faces": own,
        "faces_uv": np.zeros((triangles, 3), np.uint32),
        "ij": np.ascontiguousarray(scene.places[scene.faces].reshape(-1, 2)),
        "depths": np.ascontiguousarray(scene.depths[scene.faces].ravel()),
        "colors": np.ascontiguousarray(scene.colours[scene.shades].reshape(-1, 3)),
        "edgeflags": np.ascontiguousarray(scene.borders[:, [0, 2, 1]]),
        "textured": np.zeros(triangles, bool),
        "shaded": np.zeros(triangles, bool),
        "uv": np.zeros((1, 2)),
        "shade": np.zeros(count),
        "texture": np.zeros((0, 0, 3)),
        "height": size,
        "width": size,
        "nb_colors": 3,
        "background_color": np.full(3, BACKGROUND),
        "clockwise": True,
        "backface_culling": True,
        "integer_pixel_centers": False,
    }


class Rasterised:
    """The loss of DEODR's picture; an edge is mixed in up to one pixel from it, as it does unless told otherwise."""

    def __init__(self, scene: Mesh, target: Array) -> None:
        from deodr.differentiable_renderer import Scene2D

        self.mesh, self.target = scene, target
        self.scene = Scene2D(**as_deodr(scene, len(target)))
        self.picture, self.loss = np.zeros_like(target), 0.0

    def __call__(self) -> None:
        self.scene.clear_gradients()
        self.picture, _ = self.scene.render(1.0)
        error = self.picture - self.target
        self.loss = float((error * error).sum())
        self.scene.render_backward(2.0 * error)

    def answer(self) -> Answer:
        """Returns what the last call found."""
        by_place = gathered(self.mesh.faces, self.scene.ij_b, len(self.mesh.places))
        return Answer(self.loss, by_place, gathered(self.mesh.shades, self.scene.colors_b, len(self.mesh.colours)))


def gathered(rows: Array, numbers: Array, count: int) -> Array:
    """Returns the sums of the numbers of each row."""
    return np.stack([np.bincount(rows.ravel(), column, count) for column in numbers.T], axis=1)


# -- the table ---------------------------------------------------------------------------------------------------------


def rasteriser_rows() -> list[Row]:
    """A row for each scene; none where DEODR is not installed."""
    if not is_installed():
        return []
    inside = flat()
    scenes = {
        "mesh, 10028 triangles, outlines antialiased": torus(),
        "10000 triangles that overlap": overlapping(),
        "2048 triangles side by side": inside,
        "the same, no edge antialiased": inside._replace(borders=np.zeros_like(inside.borders)),
    }
    evaluator = teg.compile(*loss(), backend="c")
    return [row(name, scene, evaluator) for name, scene in scenes.items()]


def is_installed() -> bool:
    """Returns whether DEODR can be asked."""
    return all(importlib.util.find_spec(name) for name in ("deodr", "trimesh", "imageio", "typing_extensions"))


def waves(size: int) -> Array:
    """Returns the picture (size, size, 3) that all are compared with: smooth, so that no answer has luck."""
    y, x = np.mgrid[0:size, 0:size] / size
    return np.stack([0.5 + 0.4 * np.sin(a * x + b * y) for a, b in ((7, 3), (1, 5), (-4, 9))], axis=2)


def row(name: str, scene: Mesh, evaluator: Any) -> Row:
    """Both in turn; errors of DEODR are relative to the exact answer, by the root of the mean square, and that of the exact one is along a
    smooth motion of all places, relative to differences."""
    target = waves(SIZE)
    ours, theirs = Ours(scene, target, evaluator), Rasterised(scene, target)
    exact = ours()
    one, two = in_turn(ours, theirs, 3, 5)
    found = theirs.answer()
    way = np.stack([np.sin(scene.places[:, 1] / 50), np.cos(scene.places[:, 0] / 70)], axis=1)
    truth = ours.difference(way)
    return {
        "scene": name,
        "candidates": len(ours.given["L"]),
        "lists, ms": 1e-6 * thread_time(lambda: candidates(scene, SIZE), 3),
        "exact, ms": 1e-6 * one,
        "DEODR, ms": 1e-6 * two,
        "ratio": one / two,
        "DEODR: picture off": off(theirs.picture, ours.picture()),
        "by places off": off(found.by_place, exact.by_place),
        "by colours off": off(found.by_colour, exact.by_colour),
        "along a motion off": abs((found.by_place * way).sum() / truth - 1),
        "exact: along a motion off": abs((exact.by_place * way).sum() / truth - 1),
    }


def off(one: Array, exact: Array) -> float:
    """Returns the size of a difference, relative to that of the exact numbers."""
    return float(np.linalg.norm(one - exact) / np.linalg.norm(exact))
