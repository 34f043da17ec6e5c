"""Optimal transport from a density to points, by Newton's method on exact cell masses.

    teg demo voronoi                        (python -m teg.examples.voronoi runs it without pictures)

Each site s_k of the unit square is to receive the mass m_k of a density ρ, at the least total of squared distances. The receivers are the
cells of a power diagram: a point x belongs to the site with the least |x - s_k|² - w_k (Aurenhammer, Hoffmann and Aronov 1998). The weights
maximise the concave dual

    Φ(w) = ∫∫ min_k (|x - s_k|² - w_k)·ρ(x) dx + Σ_k w_k·m_k,        ∂Φ/∂w_k = m_k - mass of cell k

which is one `teg.minimum_of`. Its gradient and the products of its Hessian are exact, so damped Newton steps (Kitagawa, Mérigot and Thibert
2019) end at rounding. The square is cut into tiles; the candidates of a tile are found by NumPy, and the program reads them as ranges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import teg
from teg.evaluator.options import Backend
from teg.examples.checkpoint import load_arrays, save_arrays
from teg.ir.expr import Expr

Array = npt.NDArray[np.float64]
TILES = 16
TOLERANCE = 1e-12
"""The largest error of a mass, relative to the mean of the masses."""
MOST = 40  # steps

x, y = teg.vars("x y")
S, W, M = teg.array("S", 2), teg.array("W"), teg.array("M")
RANGES, LIST = teg.indices("R", 2), teg.indices("L")
p, k, n = teg.index("p"), teg.index("k"), teg.index("n")


def density(px: Any, py: Any) -> Any:
    """Returns the density, whose integral over the unit square is 1."""
    return 0.4 + 1.2 * px * py + 0.6 * (1 - px) ** 2 + 0.3 * py**2


def over_tiles(value: Expr, key: Expr) -> Expr:
    """Returns ∫∫ value·ρ over the square, with the value at the nearest candidate of each tile."""
    row, column = p // TILES, p % TILES
    nearest = teg.nearest(value, key, (k, RANGES[p, 0], RANGES[p, 1]))
    density_here: Expr = density(x, y)
    tile = (x, column / TILES, (column + 1) / TILES), (y, row / TILES, (row + 1) / TILES)
    return teg.sum(teg.integral(nearest * density_here, *tile), (p, 0, TILES * TILES))


def programs() -> tuple[Expr, Expr]:
    """Returns the dual, and the cost of the transport that the weights describe."""
    site = LIST[k]
    distance = (x - S[site, 0]) ** 2 + (y - S[site, 1]) ** 2
    dual = over_tiles(distance - W[site], distance - W[site]) + teg.sum(W[n] * M[n], (n, 0, teg.length(W)))
    return dual, over_tiles(distance, distance - W[site])


def candidates(sites: Array, weights: Array) -> dict[str, Any]:
    """Returns the sites that may own a part of a tile: those that are not farther than one of the others at all of its corners."""
    ticks = np.arange(TILES + 1) / TILES
    corners = np.stack(np.meshgrid(ticks, ticks), axis=-1)
    keys = ((corners[:, :, None] - sites) ** 2).sum(axis=-1) - weights
    four = np.stack([keys[i : TILES + i, j : TILES + j] for i in (0, 1) for j in (0, 1)]).reshape(4, TILES * TILES, -1)
    best = np.argmin(four.max(axis=0), axis=1)
    ahead = four - np.take_along_axis(four, best[None, :, None], axis=2)
    kept = (ahead <= 1e-9).any(axis=0)
    ends = np.cumsum(kept.sum(axis=1))
    return {"R": np.stack([np.concatenate([[0], ends[:-1]]), ends], axis=1), "L": np.nonzero(kept)[1]}


@dataclass
class Transport:
    """The weights, the largest relative error of a mass after each step, the dual, and the cost. No step may leave a mass below `least`."""

    sites: Array
    weights: Array
    errors: list[float] = field(default_factory=list)
    dual: float = 0.0
    cost: float = 0.0
    least: float = 0.0


def solve(
    sites: Array, masses: Array, backend: Backend = "c", start: Transport | None = None, save: Callable[[Transport], None] | None = None
) -> Transport:
    """Returns the optimal transport from the density to sites with these masses. `save` gets what is found after each step, and `start`
    continues from it."""
    dual, cost = programs()
    f = teg.compile(dual, [W], backend=backend)
    found = start or Transport(sites, np.zeros(len(sites)))

    def given(weights: Array) -> dict[str, Any]:
        return {"S": sites, "W": weights, "M": masses, **candidates(sites, weights)}

    here = given(found.weights)
    value, gradient = f.value_and_grad(here)
    slope = gradient["W"]
    found.least = found.least or 0.5 * min(float((masses - slope).min()), float(masses.min()))
    while len(found.errors) < MOST:
        found.errors.append(float(np.abs(slope).max() / masses.mean()))
        if found.errors[-1] < TOLERANCE:
            break
        step = conjugate_gradients(partial(_curvature, f, here), slope, min(1e-2, 0.1 * found.errors[-1]))
        size = 1.0
        while size > 1e-6:
            there = given(found.weights + size * step)
            value, gradient = f.value_and_grad(there)
            ahead = gradient["W"]
            if (masses - ahead).min() > found.least and np.linalg.norm(ahead) <= (1 - size / 2) * np.linalg.norm(slope) + 1e-15:
                break
            size /= 2
        found.weights, here, slope = there["W"], there, ahead
        if save is not None:
            save(found)
    found.dual = float(value)
    found.cost = float(teg.compile(cost, backend=backend)({name: v for name, v in here.items() if name != "M"}))
    return found


def _curvature(f: teg.Evaluator, given: dict[str, Any], direction: Array) -> Array:
    """Returns the product of minus the Hessian of the dual and a direction."""
    return np.asarray(-f.hvp(given, {"W": direction})["W"])


def conjugate_gradients(product: Callable[[Array], Array], right: Array, tolerance: float) -> Array:
    """Returns the solution of H·d = right, of mean 0, to a relative tolerance: H vanishes on constants only."""
    d, r = np.zeros_like(right), right - right.mean()
    direction, size = r.copy(), float(r @ r)
    start = size
    for _ in range(4 * len(right)):
        if size <= tolerance**2 * start:
            break
        image = product(direction)
        image -= image.mean()
        step = size / float(direction @ image)
        d, r = d + step * direction, r - step * image
        before, size = size, float(r @ r)
        direction = r + size / before * direction
    result: Array = d - d.mean()
    return result


def scene(count: int, seed: int) -> tuple[Array, Array]:
    """Returns sites and masses."""
    rng = np.random.default_rng(seed)
    masses = rng.uniform(0.5, 1.5, count)
    return rng.uniform(0.02, 0.98, (count, 2)), masses / masses.sum()


def draw(found: Transport, masses: Array, path: Path) -> None:
    """Writes the picture: cells coloured by their masses, with their sites."""
    from matplotlib.figure import Figure

    ticks = (np.arange(600) + 0.5) / 600
    points = np.stack(np.meshgrid(ticks, ticks), axis=-1)
    owner = np.empty((600, 600), dtype=int)
    for i in range(600):
        owner[i] = np.argmin(((points[i, :, None] - found.sites) ** 2).sum(axis=-1) - found.weights, axis=1)
    border = np.zeros((600, 600), dtype=bool)
    border[1:] |= owner[1:] != owner[:-1]
    border[:, 1:] |= owner[:, 1:] != owner[:, :-1]
    figure = Figure(figsize=(7, 6), layout="constrained")
    axes = figure.add_subplot()
    shades = axes.imshow(np.where(border, np.nan, masses[owner]), origin="lower", extent=(0, 1, 0, 1), cmap="YlGnBu")
    axes.plot(*found.sites.T, "o", color="black", markeredgecolor="white", markeredgewidth=0.6, markersize=4)
    axes.set(xlim=(0, 1), ylim=(0, 1), title=f"{len(masses)} sites, and the cells that send their mass to them")
    axes.axis("off")
    figure.colorbar(shades, ax=axes, label="mass of the cell", shrink=0.85)
    figure.savefig(path, dpi=100)


def main(count: int = 200, seed: int = 0, backend: Backend = "c", out: Path | None = None, resume: bool = False) -> Transport:
    """Solves and prints; writes the picture to a folder, and a checkpoint after each step."""
    sites, masses = scene(count, seed)
    start, save = None, None
    if out is not None:
        checkpoint, identity = out / "checkpoint.npz", {"sites": count, "seed": seed, "backend": backend}
        stored = load_arrays(checkpoint, identity) if resume else {}
        if stored:
            start = Transport(sites, stored["weights"], stored["errors"].tolist(), least=float(stored["least"]))

        def save(found: Transport) -> None:
            save_arrays(checkpoint, identity, {"weights": found.weights, "errors": found.errors, "least": found.least})

    found = solve(sites, masses, backend, start, save)
    print(f"{count} sites, backend {backend}")
    for i, error in enumerate(found.errors):
        print(f"step {i:>2}   largest relative error of a mass {error:.1e}")
    print(f"cost {found.cost:.15f}, dual {found.dual:.15f}, difference {abs(found.cost - found.dual):.1e}")
    if out is not None:
        draw(found, masses, out / "cells.png")
    return found


def run_voronoi(out: str | Path = "out/voronoi", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Solves, prints the steps and draws the cells; writes to `out`, returns the contents of run.json. It has no progress bar.

    The options are those of `teg demo voronoi` (`examples/options.py`). A checkpoint is written after each step. Raises InputError for
    options and checkpoints that cannot be used, MissingPackageError.
    """
    from teg.examples.harness import finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("voronoi demo", {"matplotlib": "matplotlib"}, progress=False)
    settings = resolved("voronoi", {"out": out, **options})
    folder = result_folder(Path(out))
    found = main(settings["sites"], settings["seed"], settings["backend"], folder, settings["resume"])
    end = found.errors[-1]
    report = {
        "summary": [
            f"{len(found.errors) - 1} steps of Newton's method, largest relative error of a mass {end:.1e}, cost {found.cost:.12f}"
        ],
        "errors": found.errors,
        "cost": found.cost,
        "dual": found.dual,
        "failure": "" if end < TOLERANCE else f"a mass is wrong by {end:.1e} of the mean one",
        "pictures": ["cells.png"],
    }
    return finish(folder, "voronoi", settings, report)


if __name__ == "__main__":
    main()
