"""Gradient noise at the corners of the pixels: a linear function of the lattice's gradients.

One octave has a square lattice with a gradient g at each node. In a cell, at (u, v) in [0, 1]² from its first node,

    noise = Σ over the four nodes (i, j)  s(|1 - i - u|) · s(|1 - j - v|) · g·(u - i, v - j),    s(w) = 3w² - 2w³

(Perlin, "An image synthesizer", SIGGRAPH 1985). Octave k has 2ᵏ times as many cells and 2⁻ᵏ of the height. A single octave is 0 at every
node, whatever its gradients. The lattices of the octaves are therefore shifted against each other by random fractions of a cell, so that
their sum can have either sign everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from teg.errors import InputError

PERSISTENCE = 0.5  # height of an octave relative to the previous one


@dataclass(frozen=True)
class Noise:
    """Noise over a square of size² pixels.

    `matrix`, ((size + 1)², 2·nodes), maps the gradients of all nodes of all octaves, flat, to the values at the pixels' corners, row by
    row. Its transpose maps derivatives by these values to derivatives by the gradients.
    """

    size: int
    matrix: sparse.csr_array

    def corners(self, gradients: np.ndarray) -> np.ndarray:
        """Returns the values at the corners, (size + 1, size + 1)."""
        return np.asarray(self.matrix @ gradients).reshape(self.size + 1, self.size + 1)

    def pull_back(self, slopes: np.ndarray) -> np.ndarray:
        """Returns the derivatives by the gradients, from those by the corners, (size + 1, size + 1)."""
        return np.asarray(self.matrix.T @ slopes.ravel())


def make_noise(size: int, cells: int, octaves: int, seed: int = 0) -> tuple[Noise, np.ndarray]:
    """Returns the noise, with `cells` lattice cells a side in its coarsest octave, and its first gradients: random unit vectors."""
    if cells < 1 or octaves < 1:
        raise InputError(f"noise of {octaves} octaves, the first of {cells} cells a side", None, "at least 1 of each")
    if cells * 2 ** (octaves - 1) > size:
        what = f"{octaves} octaves that begin with {cells} cells a side end with {cells * 2 ** (octaves - 1)}"
        raise InputError(what, None, f"fewer than {size}, the pixels a side; take fewer octaves or cells")
    random = np.random.default_rng(seed)
    shifts = random.uniform(0, 1, (octaves, 2))
    matrix = sparse.hstack([PERSISTENCE**k * _octave(size, cells * 2**k, shifts[k]) for k in range(octaves)], format="csr")
    angle = random.uniform(0, 2 * np.pi, matrix.shape[1] // 2)
    return Noise(size, matrix), np.stack([np.cos(angle), np.sin(angle)], axis=-1).ravel()


def _octave(size: int, cells: int, shift: np.ndarray) -> sparse.csr_array:
    """Returns the matrix of one octave."""
    (column, u), (row, v) = (np.divmod(np.arange(size + 1) * (cells / size) + s, 1) for s in shift)
    nodes = cells + 2  # per side, including the shift
    y, x = np.divmod(np.arange((size + 1) ** 2), size + 1)
    rows, columns, values = [], [], []
    for i, j in np.ndindex(2, 2):
        weight = _smoothstep(np.abs(1 - i - u))[x] * _smoothstep(np.abs(1 - j - v))[y]
        node = (row[y].astype(int) + j) * nodes + column[x].astype(int) + i
        for component, distance in enumerate((u[x] - i, v[y] - j)):
            rows.append(np.arange(len(x)))
            columns.append(2 * node + component)
            values.append(weight * distance)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.coo_array(entries, shape=(len(x), 2 * nodes**2)).tocsr()


def tints(size: int, cells: int) -> sparse.csr_array:
    """Returns the matrix, (size², (cells + 1)²), from colours at the nodes of a square lattice to those at the pixels' centres, bilinear.

    Without cells there is one colour for all pixels.
    """
    if cells == 0:
        return sparse.csr_array(np.ones((size**2, 1)))
    place = (np.arange(size) + 0.5) * (cells / size)
    column, share = np.divmod(place, 1)
    along = sparse.coo_array(
        (np.concatenate([1 - share, share]), (np.tile(np.arange(size), 2), np.concatenate([column, column + 1]).astype(int))),
        shape=(size, cells + 1),
    )
    return sparse.kron(along, along, format="csr")


def _smoothstep(w: np.ndarray) -> np.ndarray:
    return np.asarray(w * w * (3 - 2 * w))
