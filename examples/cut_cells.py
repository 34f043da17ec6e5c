"""Finite elements on cells that a level set cuts, and the shape derivative of a Poisson problem.

    teg demo cut-cells                      (python -m teg.examples.cut_cells runs it without pictures)

    -Δu = 1 in Ω,   u = 0 on ∂Ω,        Ω = {ω > 0},   ω = s² - x² - y² + k·(x³ - 3xy²) + c

The square is cut into cells that do not follow Ω. The area of Ω in a cell is one integral of a bracket. Where it is less than the cell's,
`f.nodes` gives the points and weights of its quadrature; other cells have Gauss's. With these any finite elements can be assembled; here
u = ω·v with biquadratic B-splines v, which is 0 on ∂Ω. The energy J = ∫u has the shape derivative

    ∂J/∂p = ∫ |∇u|²·V ds over ∂Ω          V = ∂ω/∂p / |∇ω|: how fast the boundary moves with the parameter p (Hadamard)

and `f.nodes(by="c")` gives points on ∂Ω with the weights ds/|∇ω|. For k = 0, Ω is a disk, with J = πs⁴/8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import teg
from teg.evaluator.options import Backend

Array = npt.NDArray[np.float64]
HALF = 1.2345
"""The square is (-HALF, HALF)². No side of a cell touches ∂Ω where it is parallel: nodes on ∂Ω crowd there, and miss the tolerance."""

x, y = teg.vars("x y")
left, bottom, width, s, k, c = teg.params("left bottom width s k c")


def level(px: Any, py: Any, size: Any, bend: Any) -> Any:
    """Returns ω, positive in Ω."""
    return size**2 - px**2 - py**2 + bend * (px**3 - 3 * px * py**2)


@cache
def area_of_cell(backend: Backend) -> teg.Evaluator:
    """Returns the compiled area of Ω in a cell."""
    inside = teg.bracket(level(x, y, s, k) + c > 0)
    cell = (x, left, left + width), (y, bottom, bottom + width)
    return teg.compile(teg.integral(inside, *cell), [c], backend=backend, tol=1e-8, order=8)


@dataclass
class Solution:
    """Coefficients of the B-splines, the energy J and its derivatives by s and k, and the nodes: inside, and on the boundary."""

    cells: int
    coefficients: Array
    energy: float
    slopes: dict[str, float]
    points: Array
    weights: Array
    boundary: Array

    def values(self, points: Array, size: float, bend: float) -> Array:
        """Returns u at points, (n,); 0 outside."""
        splines, _ = b_splines(points, self.cells)
        return np.asarray(np.maximum(level(points[:, 0], points[:, 1], size, bend), 0) * (splines @ self.coefficients))


def solve(cells: int, size: float, bend: float, backend: Backend = "numpy", derivatives: bool = True) -> Solution:
    """Returns the solution on cells × cells cells."""
    cut, points, weights = quadrature(cells, size, bend, backend)
    omega, slope = level(points[:, 0], points[:, 1], size, bend), slopes_of_level(points, bend)
    splines, gradients = b_splines(points, cells)
    trial, by_place = omega[:, None] * splines, slope[:, :, None] * splines + omega[:, None] * gradients
    stiffness = sum(part.T @ (weights[:, None] * part) for part in by_place)
    load = trial.T @ weights
    used = np.flatnonzero(np.diag(stiffness) > 1e-14 * np.diag(stiffness).max())  # the others see next to nothing of Ω
    scale = 1 / np.sqrt(np.diag(stiffness)[used])
    scaled = scale[:, None] * stiffness[np.ix_(used, used)] * scale
    coefficients = np.zeros(splines.shape[1])
    coefficients[used] = scale * np.linalg.lstsq(scaled, scale * load[used], rcond=1e-13)[0]
    solution = Solution(cells, coefficients, float(load @ coefficients), {}, points, weights, np.zeros((0, 2)))
    if derivatives:
        solution.boundary, rate = flat(*area_of_cell(backend).nodes(cut, by="c"))
        v = b_splines(solution.boundary, cells)[0] @ coefficients
        normal = v**2 * (slopes_of_level(solution.boundary, bend) ** 2).sum(axis=0)  # |∇u|²
        px, py = solution.boundary.T
        solution.slopes = {"s": 2 * size * float(rate @ normal), "k": float(rate @ (normal * (px**3 - 3 * px * py**2)))}
    return solution


def quadrature(cells: int, size: float, bend: float, backend: Backend) -> tuple[dict[str, Any], Array, Array]:
    """Returns the arguments of the cells that ∂Ω cuts, and the points, (n, 2), and weights of a quadrature over Ω."""
    h = 2 * HALF / cells
    ticks = -HALF + h * np.arange(cells)
    corners = np.stack([np.repeat(ticks, cells), np.tile(ticks, cells)])
    f, given = area_of_cell(backend), {"width": h, "s": size, "k": bend, "c": 0.0}
    covered = f(given | {"left": corners[0], "bottom": corners[1]}) / h**2
    is_cut, is_inside = (covered > 0) & (covered < 1 - 1e-12), covered >= 1 - 1e-12
    cut = given | {"left": corners[0, is_cut], "bottom": corners[1, is_cut]}
    gauss, rule = (h / 2 * part for part in np.polynomial.legendre.leggauss(6))
    grid = np.stack(np.meshgrid(gauss, gauss), axis=-1).reshape(-1, 2) + h / 2
    inside = (corners.T[is_inside][:, None] + grid).reshape(-1, 2)
    points, weights = flat(*f.nodes(cut))
    return cut, np.concatenate([points, inside]), np.concatenate([weights, np.tile(np.outer(rule, rule).ravel(), is_inside.sum())])


def flat(points: Array, weights: Array) -> tuple[Array, Array]:
    """Returns the nodes of all cells as one list."""
    counted = weights != 0
    return points[counted], weights[counted]


def slopes_of_level(points: Array, bend: float) -> Array:
    """Returns ∇ω, (2, n)."""
    px, py = points.T
    return np.stack([-2 * px + 3 * bend * (px**2 - py**2), -2 * py - 6 * bend * px * py])


def b_splines(points: Array, cells: int) -> tuple[Array, Array]:
    """Returns biquadratic B-splines at points, (n, splines), and their gradients, (2, n, splines)."""
    h = 2 * HALF / cells
    at = [[_quadratic((points[:, axis] + HALF) / h - j + 2) for j in range(cells + 2)] for axis in (0, 1)]
    (a, da), (b, db) = ([np.stack(part, axis=1) for part in zip(*columns, strict=True)] for columns in at)

    def product(first: Array, second: Array) -> Array:
        return (first[:, :, None] * second[:, None, :]).reshape(len(points), -1)

    return product(a, b), np.stack([product(da / h, b), product(a, db / h)])


def _quadratic(t: Array) -> tuple[Array, Array]:
    """Returns the quadratic B-spline on (0, 3), and its derivative."""
    inner = [t**2 / 2, (-2 * t**2 + 6 * t - 3) / 2, (3 - t) ** 2 / 2]
    slope = [t, 3 - 2 * t, t - 3]
    where = [(t >= i) & (t < i + 1) for i in range(3)]
    return np.select(where, inner, 0.0), np.select(where, slope, 0.0)


def differences(cells: int, size: float, bend: float, backend: Backend, step: float = 1e-5) -> dict[str, float]:
    """Returns the derivatives of J by differences of whole solutions, to compare."""
    ends = {"s": ((size + step, bend), (size - step, bend)), "k": ((size, bend + step), (size, bend - step))}
    return {
        name: (solve(cells, *a, backend, False).energy - solve(cells, *b, backend, False).energy) / (2 * step)
        for name, (a, b) in ends.items()
    }


def main(cells: int = 6, size: float = 0.75, bend: float = 0.35, backend: Backend = "numpy") -> tuple[Solution, dict[str, Any]]:
    """Prints the disk against its closed form, and a bent shape against differences; returns the second solution and the numbers."""
    disk = solve(cells, size, 0.0, backend)
    error = abs(disk.energy / (math.pi * size**4 / 8) - 1), abs(disk.slopes["s"] / (math.pi * size**3 / 2) - 1)
    print(f"disk: J = {disk.energy:.15f}, off by {error[0]:.1e}; ∂J/∂s = {disk.slopes['s']:.15f}, off by {error[1]:.1e}")
    bent, numbers = solve(cells, size, bend, backend), differences(cells, size, bend, backend)
    for name in ("s", "k"):
        print(f"bent: ∂J/∂{name} = {bent.slopes[name]:.9f} by Hadamard's formula, {numbers[name]:.9f} by differences of whole solutions")
    return bent, {
        "disk_errors": error,
        "energy": bent.energy,
        "slopes": bent.slopes,
        "differences": numbers,
        "nodes": len(bent.weights),
        "boundary_nodes": len(bent.boundary),
    }


def run_cut_cells(out: str | Path = "out/cut-cells", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Solves, prints and draws; writes to `out`, returns the contents of run.json. It has no progress bar, and nothing is random.

    The options are those of `teg demo cut-cells` (`examples/options.py`). Raises InputError for those that cannot be used,
    MissingPackageError.
    """
    from teg.examples.harness import finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("cut-cells demo", {"matplotlib": "matplotlib"}, progress=False)
    settings = resolved("cut-cells", {"out": out, **options})
    folder = result_folder(Path(out))
    bent, numbers = main(settings["cells"], backend=settings["backend"])
    draw(bent, folder / "cut_cells.png")
    off = max(abs(bent.slopes[name] / numbers["differences"][name] - 1) for name in bent.slopes)
    report = {"summary": [f"shape derivatives off by {off:.1e} of those by differences"], **numbers, "pictures": ["cut_cells.png"]}
    return finish(folder, "cut-cells", settings, report)


def draw(solution: Solution, path: Path, size: float = 0.75, bend: float = 0.35) -> None:
    """Draws the nodes in the cells and on the boundary, and u."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 6), layout="constrained")
    nodes, field = figure.subplots(1, 2)
    ticks = np.linspace(-HALF, HALF, solution.cells + 1)
    for axes in (nodes, field):
        for tick in ticks:
            axes.plot([tick, tick], [-HALF, HALF], color="#c8ccd2", linewidth=0.7, zorder=0)
            axes.plot([-HALF, HALF], [tick, tick], color="#c8ccd2", linewidth=0.7, zorder=0)
        axes.set(aspect="equal", xlim=(-1, HALF), ylim=(-1.1, 1.1))
        axes.set_axis_off()
    nodes.scatter(*solution.points.T, s=2500 * solution.weights, color="#2b6cb0", linewidth=0)
    nodes.scatter(*solution.boundary.T, s=5, color="#c2412d", linewidth=0)
    nodes.set_title(
        f"{len(solution.weights)} nodes inside, their area the weight, and {len(solution.boundary)} on the boundary", fontsize=11
    )
    px, py = np.meshgrid(np.linspace(-HALF, HALF, 500), np.linspace(-HALF, HALF, 500))
    u = np.stack([solution.values(np.stack(row, axis=1), size, bend) for row in zip(px, py, strict=True)])  # all at once are a gigabyte
    u[level(px, py, size, bend) <= 0] = np.nan
    drawn = field.contourf(px, py, u, levels=16, cmap="viridis")
    field.contour(px, py, level(px, py, size, bend), levels=[0], colors="#c2412d", linewidths=1.5)
    figure.colorbar(drawn, ax=field, shrink=0.7)
    field.set_title("u, with -Δu = 1 inside and u = 0 on the boundary", fontsize=11)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
