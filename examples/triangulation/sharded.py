"""The loss of a whole picture in JAX, distributed over devices: by pairs of a triangle and a pixel, or by triangles.

    by pairs      each device has equally many pairs, and the sum over devices is the derivative by all vertices and colours
    by faces      each device has some of the triangles, with their colours, and a window of pixels for each of them

The integral is that of `scene.pixel_loss` in both, vertices and picture are on every device, and partial sums are added by `psum`. Pairs
are distributed evenly and none is evaluated in vain, but the list of them changes as vertices move. Windows are as large as the largest
triangle needs, and the derivatives by the colours stay where their triangles are. This module imports JAX.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import teg
from teg.backends.jax.precision import in_double_precision
from teg.errors import InputError
from teg.evaluator.options import Discontinuities
from teg.examples.triangulation.image_loss import bounding_boxes
from teg.examples.triangulation.scene import COLOURS, FACES, VERTICES, per_pixel, pixel_loss
from teg.ir.expr import Expr

PAIRS = teg.indices("pairs", 2)  # (p, 3): a triangle, and the column and row of a pixel
CORNERS = teg.indices("corners", 2)  # (m, 2): first column and row of the window of a triangle
WIDTH, HEIGHT = teg.params("width height")  # of all windows, in pixels
P: Any = jax.sharding.PartitionSpec
WAYS = ("pairs", "faces")
AXIS = "shards"
PARTS = 8
"""Numbers of pairs are rounded up to this many parts of a power of two, because JAX compiles a program for each number."""


def loss_by_pairs() -> Expr:
    """Returns the loss per pixel, as a sum over pairs."""
    k = teg.index("k")
    return per_pixel(teg.sum(pixel_loss(PAIRS[k, 0], PAIRS[k, 1], PAIRS[k, 2]), (k, 0, teg.length(PAIRS, 0))))


def loss_by_faces() -> Expr:
    """Returns the loss per pixel, as a sum over triangles and their windows."""
    face, i, j = teg.index("face"), teg.index("i"), teg.index("j")
    pixel = pixel_loss(face, CORNERS[face, 0] + i, CORNERS[face, 1] + j)
    return per_pixel(teg.sum(pixel, (i, 0, WIDTH), (j, 0, HEIGHT), (face, 0, teg.length(FACES, 0))))


class ShardedLoss:
    """The loss of meshes of one topology against one picture, computed on several devices; the same interface as `ImageLoss`.

    `by` is "pairs" or "faces"; `target` (size, size, 3), `triangles` (m, 3), `devices` those of JAX (None: all there are). `dtype` is
    that of vertices, colours and results. `pairs` and `seconds` count the evaluated pairs of a triangle and a pixel, and their time.
    `step` returns the loss and both gradients for `operands`, all of them on the devices, for programs that continue there.

    Raises InputError for another way, or no device.
    """

    def __init__(
        self,
        by: str,
        target: np.ndarray,
        triangles: np.ndarray,
        devices: Sequence[Any] | None = None,
        dtype: str = "float64",
        discontinuities: Discontinuities = "exact",
    ) -> None:
        if by not in WAYS:
            raise InputError(f"a picture is not shared out by {by!r}", None, "by pairs or by faces")
        chosen = jax.devices() if devices is None else list(devices)
        if not chosen:
            raise InputError("no device to share a picture out to", None, "devices=None takes all that JAX has")
        self.by, self.size, self.dtype = by, len(target), dtype
        self.triangles, self.count = np.asarray(triangles), len(chosen)
        self.pairs, self.seconds = 0, 0.0
        mesh = jax.make_mesh((self.count,), (AXIS,), axis_types=(jax.sharding.AxisType.Auto,), devices=chosen)
        whole, split = jax.NamedSharding(mesh, P()), jax.NamedSharding(mesh, P(AXIS))
        # faces that are points have no area; their pairs fill up the shares of devices
        spare = self.count - len(self.triangles) % self.count
        self._faces = np.concatenate([self.triangles, np.zeros((spare, 3), self.triangles.dtype)])
        self._whole, self._places, self._of_faces = whole, split, whole if by == "pairs" else split
        with in_double_precision():
            self._target = jax.device_put(np.asarray(target, dtype), whole)
            self._indices = jax.device_put(self._faces, self._of_faces)
            program = loss_by_pairs() if by == "pairs" else loss_by_faces()
            by_vertices, by_colours, every = (
                self._spread(teg.jax_function(program, wrt, dtype=dtype, discontinuities=how), mesh)
                for wrt, how in (([VERTICES], discontinuities), ([COLOURS], "exact"), ([VERTICES, COLOURS], discontinuities))
            )
        self._gradient = _jitted(jax.grad(by_vertices))
        self.step = _jitted(jax.value_and_grad(every, (0, 1)))

        def newton(vertices: Any, colours: Any, faces: Any, places: Any, target: Any, window: tuple[int, int]) -> tuple[Any, Any]:
            """Returns the least loss by colours, and the change to them: the loss is quadratic in each, so one step is exact."""

            def of(c: Any) -> tuple[Any, Any]:
                value, slopes = jax.value_and_grad(by_colours, 1)(vertices, c, faces, places, target, window)
                return slopes, value

            slopes, curvature, value = jax.jvp(of, (colours,), (jnp.ones_like(colours),), has_aux=True)
            change = jnp.where(curvature > 0, -slopes / jnp.where(curvature > 0, curvature, 1), 0)
            return value - jnp.sum(change**2 * curvature) / 2, change

        self._newton = _jitted(newton)

    def _spread(self, loss: Any, mesh: Any) -> Any:
        """Returns the loss as a function of whole arrays, computed in parts."""
        total: Any = jax.lax.psum
        split = (P(), self._of_faces.spec, self._of_faces.spec, self._places.spec, P())

        def spread(vertices: Any, colours: Any, faces: Any, places: Any, target: Any, window: tuple[int, int]) -> Any:
            def part(vertices: Any, colours: Any, faces: Any, places: Any, target: Any) -> Any:
                how = {"pairs": places} if self.by == "pairs" else {"corners": places, "width": window[0], "height": window[1]}
                return total(loss(vertices=vertices, colours=colours, faces=faces, target=target, **how), AXIS)

            parts: Any = jax.shard_map(part, mesh=mesh, in_specs=split, out_specs=P())
            return parts(vertices, colours, faces, places, target)

        return spread

    def gradient(self, vertices: np.ndarray, colours: np.ndarray) -> np.ndarray:
        """Returns the derivative of the loss by the vertices, (n, 2)."""
        return np.asarray(self._timed(self._gradient, vertices, colours))

    def value_and_grad(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
        """Returns the loss, and its derivatives by the vertices, (n, 2), and by the colours, (m, 3)."""
        value, (by_vertices, by_colours) = self._timed(self.step, vertices, colours)
        return float(value), (np.asarray(by_vertices), np.asarray(by_colours)[: len(self.triangles)])

    def best_colours(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns the least loss that these vertices can have, and the colours that attain it."""
        loss, change = self._timed(self._newton, vertices, colours)
        return float(loss), colours + np.asarray(change)[: len(self.triangles)]

    def operands(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[tuple[Any, ...], tuple[int, int], int]:
        """Returns the arguments of `step`, on the devices: arrays, and the width and height of windows; and the number of their pairs."""
        boxes = bounding_boxes(vertices[self.triangles], self.size)
        if self.by == "pairs":
            places, window = shared_pairs(boxes, self.count), (0, 0)
            looked_at = int(np.sum((boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])))
        else:
            places, window = windows(boxes, self.size, len(self._faces))
            looked_at = len(boxes) * window[0] * window[1]
        padded = np.concatenate([colours, np.zeros((len(self._faces) - len(colours), 3))])
        with in_double_precision():
            moved = jax.device_put(vertices.astype(self.dtype), self._whole), jax.device_put(padded.astype(self.dtype), self._of_faces)
            return (*moved, self._indices, jax.device_put(places.astype(np.int32), self._places), self._target), window, looked_at

    def _timed(self, function: Any, vertices: np.ndarray, colours: np.ndarray) -> Any:
        start = time.perf_counter()
        operands, window, looked_at = self.operands(vertices, colours)
        result = function(*operands, window=window)
        self.seconds += time.perf_counter() - start
        self.pairs += looked_at
        return result


def _jitted(function: Any) -> Any:
    """Returns a function that is jitted in double precision, and blocks until its results are ready."""
    compiled: Any = jax.jit(function, static_argnames="window")

    def call(*operands: Any, window: tuple[int, int]) -> Any:
        with in_double_precision():
            result = compiled(*operands, window=window)
            for leaf in jax.tree.leaves(result):
                leaf.block_until_ready()
        return result

    return call


def pairs_of(boxes: np.ndarray) -> np.ndarray:
    """Returns all pairs of a triangle and a pixel of its box, (p, 3): triangle, column, row; `boxes` is the result of `bounding_boxes`."""
    wide, high = boxes[:, 1] - boxes[:, 0], boxes[:, 3] - boxes[:, 2]
    counts = wide * high
    face = np.repeat(np.arange(len(boxes)), counts)
    place = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    row, column = np.divmod(place, wide[face])
    return np.stack([face, boxes[face, 0] + column, boxes[face, 2] + row], axis=1)


def shared_pairs(boxes: np.ndarray, devices: int) -> np.ndarray:
    """Returns evenly distributed pairs, (p, 3).

    After the last pair come pairs without a common part: the first pixel, and a triangle that is elsewhere, or the one behind the last.
    """
    pairs = pairs_of(boxes)
    room = devices * _rounded(-(-len(pairs) // devices))
    elsewhere = np.append(np.any(boxes[:, ::2] > 0, axis=1), True)
    return np.concatenate([pairs, np.broadcast_to([np.argmax(elsewhere), 0, 0], (room - len(pairs), 3))])


def windows(boxes: np.ndarray, size: int, faces: int) -> tuple[np.ndarray, tuple[int, int]]:
    """Returns windows of one size that contain the boxes, inside of the picture: their first column and row, (faces, 2), and width and
    height."""
    width, height = (min(_rounded(int(n)), size) for n in (boxes[:, 1::2] - boxes[:, ::2]).max(axis=0))
    corners = np.minimum(boxes[:, ::2], [size - width, size - height])
    return np.concatenate([corners, np.zeros((faces - len(corners), 2), corners.dtype)]), (width, height)


def _rounded(number: int) -> int:
    """Returns the next number of few digits: not far above, and seldom another one when `number` changes a little."""
    step = max((1 << max(number - 1, 0).bit_length()) // PARTS, 1)
    return -(-number // step) * step
