"""Gradient noise at the corners of the pixels: a linear function of the lattice's gradients.

One octave has a square lattice with a gradient g at each node. In a cell, at (u, v) in [0, 1]² from its first node,

    noise = Σ over the four nodes (i, j)  s(|1 - i - u|) · s(|1 - j - v|) · g·(u - i, v - j)

with s(w) = 3w² - 2w³, or another one of `BLENDS`
(Perlin, "An image synthesizer", SIGGRAPH 1985). Octave k has 2ᵏ times as many cells and 2⁻ᵏ of the height. A single octave is 0 at every
node, whatever its gradients. The lattices of the octaves are therefore shifted against each other by random fractions of a cell, so that
their sum can have either sign everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
class Octave:
    """Along x, what the columns of a lattice contribute to the corners of the pixels, (width + 1, columns) each; `rows` counts its rows.

    `reach` is the weight of a column, `slope` the weight times the distance from it.
    """

    reach: sparse.csr_array
    slope: sparse.csr_array
    rows: int

    @property
    def nodes(self) -> int:
        """Returns the number of the lattice's nodes."""
        return int(self.rows * self.reach.shape[1])


@dataclass(frozen=True)
class Noise:
    """Noise over a picture; `size` is its width and height in pixels.

    A weight s(|1 - i - u|)·s(|1 - j - v|) is a product, so that gradients are spread along x first, for each row of nodes, and then along
    y: `down`, (height + 1, 2·rows), has for each octave the weights times distances of its rows, by which the gradients' x components
    count, and so on. A matrix of all corners and nodes would have width times as many numbers.
    """

    size: tuple[int, int]
    octaves: tuple[Octave, ...]
    down: sparse.csr_array

    @property
    def nodes(self) -> int:
        """Returns the number of nodes of all octaves."""
        return sum(octave.nodes for octave in self.octaves)

    def corners(self, gradients: np.ndarray) -> np.ndarray:
        """Returns the values at the corners, (height + 1, width + 1), for the gradients of all nodes of all octaves, flat."""
        along, first = np.empty((self.down.shape[1], self.size[0] + 1)), 0
        for octave, (x, y) in self._by_octave(gradients):
            for weights, component in ((octave.slope, x), (octave.reach, y)):
                along[first : first + octave.rows] = (weights @ component.T).T
                first += octave.rows
        return np.asarray(self.down @ along)

    def pull_back(self, slopes: np.ndarray) -> np.ndarray:
        """Returns the derivatives by the gradients, flat, from those by the corners, (height + 1, width + 1)."""
        along, first, gradients = self.down.T @ slopes, 0, np.empty(2 * self.nodes)
        for octave, components in self._by_octave(gradients):
            for weights, component in zip((octave.slope, octave.reach), components, strict=True):
                component[...] = (weights.T @ along[first : first + octave.rows].T).T
                first += octave.rows
        return gradients

    def _by_octave(self, gradients: np.ndarray) -> Iterator[tuple[Octave, np.ndarray]]:
        """Yields each octave, and the components of its gradients, (2, rows, columns), a view."""
        first = 0
        for octave in self.octaves:
            yield octave, np.moveaxis(gradients[2 * first : 2 * (first + octave.nodes)].reshape(octave.rows, -1, 2), -1, 0)
            first += octave.nodes


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
    lattices, downs = zip(*(_octave(shape, cells * 2**k, shifts[k], BLENDS[blend]) for k in range(octaves)), strict=True)
    down = sparse.hstack([PERSISTENCE**k * part for k, part in enumerate(downs)], format="csr")
    noise = Noise(shape, lattices, down)
    angle = random.uniform(0, 2 * np.pi, noise.nodes)
    return noise, np.stack([np.cos(angle), np.sin(angle)], axis=-1).ravel()


def _octave(
    size: tuple[int, int], cells: int, shift: np.ndarray, blend: Callable[[np.ndarray], np.ndarray]
) -> tuple[Octave, sparse.csr_array]:
    """Returns one octave, and its part of `down`."""
    across, down = (-(-n * cells // max(size)) + 2 for n in size)  # nodes of each side, including the shift
    reach, slope = _one_way(np.arange(size[0] + 1) * (cells / max(size)) + shift[0], across, blend)
    height, tilt = _one_way(np.arange(size[1] + 1) * (cells / max(size)) + shift[1], down, blend)
    return Octave(reach, slope, down), sparse.hstack([height, tilt], format="csr")


def _one_way(places: np.ndarray, nodes: int, blend: Callable[[np.ndarray], np.ndarray]) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Returns the weights of the nodes 0, 1, … at places between them, and these times the distances, (places, nodes) each."""
    cell, u = np.divmod(places, 1)
    where = np.tile(np.arange(len(places)), 2), np.concatenate([cell, cell + 1]).astype(int)
    distance = np.concatenate([u, u - 1])
    weight = np.concatenate([blend(1 - u), blend(u)])
    shape = len(places), nodes
    return sparse.csr_array((weight, where), shape=shape), sparse.csr_array((weight * distance, where), shape=shape)


@dataclass(frozen=True)
class Tints:
    """Colours at the nodes of a lattice, interpolated to the centres of the pixels: bilinear, and so along x first, then along y.

    `down`, (height, rows), and `across`, (width, columns), are the shares of the nodes in each direction.
    """

    down: sparse.csr_array
    across: sparse.csr_array

    @property
    def nodes(self) -> int:
        """Returns the number of nodes."""
        return int(self.down.shape[1] * self.across.shape[1])

    def along(self, channels: np.ndarray) -> np.ndarray:
        """Returns the values at the columns of pixels, (channels, rows, width), for those at the nodes, (channels, nodes)."""
        rows = self.down.shape[1]
        return np.asarray(self.across @ channels.reshape(len(channels) * rows, -1).T).T.reshape(len(channels), rows, -1)

    def gather(self, slopes: np.ndarray) -> np.ndarray:
        """Returns the derivatives by the nodes, (channels, nodes), for those by what `along` returns."""
        columns = self.across.T @ slopes.reshape(-1, slopes.shape[-1]).T
        return np.asarray(columns).T.reshape(len(slopes), -1)


def make_tints(size: tuple[int, int], cells: int) -> Tints:
    """Returns a lattice of colours over a picture of `size`, its width and height in pixels.

    `cells` are those along the longer side; along the other one there are as many as are about as large. Without cells there is one colour.
    """
    if cells == 0:
        width, height = (sparse.csr_array(np.ones((n, 1))) for n in size)
        return Tints(height, width)
    across, down = (_along(n, max(1, round(cells * n / max(size)))) for n in size)
    return Tints(down, across)


def _along(size: int, cells: int) -> sparse.csr_array:
    """Returns the shares of the nodes of one direction, (size, cells + 1)."""
    return _one_way((np.arange(size) + 0.5) * (cells / size), cells + 1, BLENDS["linear"])[0]
