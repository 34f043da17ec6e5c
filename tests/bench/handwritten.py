"""The yardsticks of `handwritten/`: C files compiled by the C compiler and called with arrays."""

from __future__ import annotations

import ctypes
import shlex
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from teg.backends.c.build import find_compiler
from teg.errors import CompilerError

FOLDER = Path(__file__).with_name("handwritten")
FLAGS = ("-std=c99", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-shared", "-fPIC")
FUNCTIONS = (1, 3, 6)
"""How many functions have a colour for coefficient, by the order of the colours."""


@cache
def library(name: str) -> ctypes.CDLL:
    """The compiled file `name`.c; CompilerError with the compiler's own words if it cannot be compiled."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, f"{name}.so")
        command = [*find_compiler(), *FLAGS, str(FOLDER / f"{name}.c"), "-o", str(target), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise CompilerError(f"{name}.c could not be compiled", shlex.join(command), done.stderr)
        return ctypes.CDLL(str(target))


def address(array: np.ndarray) -> ctypes.c_void_p:
    """Where an array begins, for C: it must be contiguous, and of the type that C expects."""
    if not array.flags.c_contiguous:
        raise ValueError("C is given contiguous arrays only")
    return array.ctypes.data_as(ctypes.c_void_p)


class Triangles:
    """Loss and gradient of n triangle-pixel pairs whose colours are of one order: a call fills `results`, (n, outputs), and `kinds`, (n,).

    vertices (n, 6), colours (n, 3·functions), boxes (n, 4) as left, right, bottom, top, targets (n, 3).
    """

    def __init__(self, order: int, vertices: np.ndarray, colours: np.ndarray, boxes: np.ndarray, targets: np.ndarray) -> None:
        self.arrays = [np.ascontiguousarray(a, dtype=np.float64) for a in (vertices, colours, boxes, targets)]
        n = len(self.arrays[0])
        shapes = [a.shape for a in self.arrays]
        if shapes != [(n, 6), (n, 3 * FUNCTIONS[order]), (n, 4), (n, 3)]:
            raise ValueError(f"arrays of wrong shapes: {shapes}")
        self.results, self.kinds = np.zeros((n, 7 + 3 * FUNCTIONS[order])), np.zeros(n, np.int32)
        self._function = getattr(library("triangle"), f"triangle_pixels_{order}")
        self._arguments = [ctypes.c_long(n), *map(address, (*self.arrays, self.results, self.kinds))]

    def __call__(self) -> None:
        self._function(*self._arguments)


class BilinearPixels:
    """Loss and gradient of n thresholded bilinear pixels: a call fills `results`, (n, 12).

    corners (n, 5): values at (0, 0), (1, 0), (0, 1), (1, 1) and the threshold; above, below, targets (n, 3).
    """

    def __init__(self, corners: np.ndarray, above: np.ndarray, below: np.ndarray, targets: np.ndarray) -> None:
        self.arrays = [np.ascontiguousarray(a, dtype=np.float64) for a in (corners, above, below, targets)]
        n = len(self.arrays[0])
        shapes = [a.shape for a in self.arrays]
        if shapes != [(n, 5), (n, 3), (n, 3), (n, 3)]:
            raise ValueError(f"arrays of wrong shapes: {shapes}")
        self.results = np.zeros((n, 12))
        self._function = library("bilinear").bilinear_pixels
        self._arguments = [ctypes.c_long(n), *map(address, (*self.arrays, self.results))]

    def __call__(self) -> None:
        self._function(*self._arguments)


class Picture:
    """Loss and gradient of a mesh against a picture: a call returns the loss and fills `by_vertex`, (nv, 2), and `by_colour`, (m, 9).

    vertices (nv, 2) in pixels, faces (m, 3), colours (m, 9), picture (size, size, 3); `pairs` is how many pairs a call looked at.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray, picture: np.ndarray) -> None:
        self.arrays: list[np.ndarray] = [
            np.ascontiguousarray(vertices, dtype=np.float64),
            np.ascontiguousarray(faces, dtype=np.int32),
            np.ascontiguousarray(colours, dtype=np.float64),
            np.ascontiguousarray(picture, dtype=np.float64),
        ]
        if faces.min() < 0 or faces.max() >= len(vertices) or colours.shape != (len(faces), 9):
            raise ValueError("faces of other vertices, or colours of other faces")
        self.by_vertex, self.by_colour = np.zeros(vertices.shape), np.zeros(colours.shape)
        self._pairs = ctypes.c_long()
        self._function: Any = library("image").image_loss
        self._function.restype = ctypes.c_double
        sizes = [ctypes.c_int(len(picture)), ctypes.c_long(len(faces))]
        self._arguments = [*sizes, *map(address, (*self.arrays, self.by_vertex, self.by_colour)), ctypes.byref(self._pairs)]

    def __call__(self) -> float:
        self.by_vertex[:] = 0.0
        self.by_colour[:] = 0.0
        return float(self._function(*self._arguments))

    @property
    def pairs(self) -> int:
        """Bounding-box pairs of the last call."""
        return self._pairs.value
