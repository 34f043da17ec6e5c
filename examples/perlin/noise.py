"""Gradient noise at the corners of the pixels: a linear function of the lattice's gradients.

One octave has a square lattice with a gradient g at each node. In a cell, at (u, v) in [0, 1]² from its first node,

    noise = Σ over the four nodes (i, j)  s(|1 - i - u|) · s(|1 - j - v|) · g·(u - i, v - j)

with s(w) = 3w² - 2w³, or another one of `BLENDS`
(Perlin, "An image synthesizer", SIGGRAPH 1985). Octave k has 2ᵏ times as many cells and 2⁻ᵏ of the height. A single octave is 0 at every
node, whatever its gradients. The lattices of the octaves are therefore shifted against each other by random fractions of a cell, so that
their sum can have either sign everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from teg.errors import InputError
from teg.examples.triangulation.mesh import extent

BLENDS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "smoothstep": lambda w: w * w * (3 - 2 * w),
    "quintic": lambda w: w**3 * (10 + w * (6 * w - 15)),
    "linear": lambda w: w,
}
"""How far a point has gone from one node to the next: of continuous slope, of continuous curvature (Perlin 2002), and neither."""

PERSISTENCE = 0.5  # height of an octave relative to the previous one


@dataclass(frozen=True)
class Noise:
    """Noise over a picture; `size` is its width and height in pixels.

    `matrix`, ((width + 1)·(height + 1), 2·nodes), maps the gradients of all nodes of all octaves, flat, to the values at
    the pixels' corners, row by row. Its transpose maps derivatives by these values to derivatives by the gradients.
    """

    size: tuple[int, int]
    matrix: sparse.csr_array

    def corners(self, gradients: np.ndarray) -> np.ndarray:
        """Returns the values at the corners, (height + 1, width + 1)."""
        return np.asarray(self.matrix @ gradients).reshape(self.size[1] + 1, self.size[0] + 1)

    def pull_back(self, slopes: np.ndarray) -> np.ndarray:
        """Returns the derivatives by the gradients, from those by the corners, (height + 1, width + 1)."""
        return np.asarray(self.matrix.T @ slopes.ravel())


def make_noise(size: int | tuple[int, int], cells: int, octaves: int, seed: int = 0, blend: str = "smoothstep") -> tuple[Noise, np.ndarray]:
    """Returns the noise, and its first gradients: random unit vectors.

    Its coarsest octave has `cells` lattice cells along the longer side; cells are squares. One `size` is width and height.
    """
    shape = extent(size)
    if cells < 1 or octaves < 1:
        raise InputError(f"noise of {octaves} octaves, the first of {cells} cells a side", None, "at least 1 of each")
    if cells * 2 ** (octaves - 1) > max(shape):
        what = f"{octaves} octaves that begin with {cells} cells a side end with {cells * 2 ** (octaves - 1)}"
        raise InputError(what, None, f"fewer than {max(shape)}, the pixels a side; take fewer octaves or cells")
    random = np.random.default_rng(seed)
    shifts = random.uniform(0, 1, (octaves, 2))
    parts = [PERSISTENCE**k * _octave(shape, cells * 2**k, shifts[k], BLENDS[blend]) for k in range(octaves)]
    matrix = sparse.hstack(parts, format="csr")
    angle = random.uniform(0, 2 * np.pi, matrix.shape[1] // 2)
    return Noise(shape, matrix), np.stack([np.cos(angle), np.sin(angle)], axis=-1).ravel()


def _octave(size: tuple[int, int], cells: int, shift: np.ndarray, blend: Callable[[np.ndarray], np.ndarray]) -> sparse.csr_array:
    """Returns the matrix of one octave."""
    scale = cells / max(size)
    (column, u), (row, v) = (np.divmod(np.arange(n + 1) * scale + s, 1) for n, s in zip(size, shift, strict=True))
    across, down = (-(-n * cells // max(size)) + 2 for n in size)  # nodes of each side, including the shift
    y, x = np.divmod(np.arange((size[0] + 1) * (size[1] + 1)), size[0] + 1)
    rows, columns, values = [], [], []
    for i, j in np.ndindex(2, 2):
        weight = blend(np.abs(1 - i - u))[x] * blend(np.abs(1 - j - v))[y]
        node = (row[y].astype(int) + j) * across + column[x].astype(int) + i
        for component, distance in enumerate((u[x] - i, v[y] - j)):
            rows.append(np.arange(len(x)))
            columns.append(2 * node + component)
            values.append(weight * distance)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.coo_array(entries, shape=(len(x), 2 * across * down)).tocsr()


def tints(size: tuple[int, int], cells: int) -> sparse.csr_array:
    """Returns the matrix, (pixels, nodes), from colours at the nodes of a lattice to those at the pixels' centres, bilinear.

    `cells` are those along the longer side; along the other one there are as many as are about as large. Without cells there is one colour.
    """
    if cells == 0:
        return sparse.csr_array(np.ones((size[0] * size[1], 1)))
    across, down = (_along(n, max(1, round(cells * n / max(size)))) for n in size)
    return sparse.kron(down, across, format="csr")


def _along(size: int, cells: int) -> sparse.coo_array:
    """Returns the matrix of one direction, (size, cells + 1)."""
    column, share = np.divmod((np.arange(size) + 0.5) * (cells / size), 1)
    return sparse.coo_array(
        (np.concatenate([1 - share, share]), (np.tile(np.arange(size), 2), np.concatenate([column, column + 1]).astype(int))),
        shape=(size, cells + 1),
    )
