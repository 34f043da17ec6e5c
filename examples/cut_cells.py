"""Finite elements on cells that a level set cuts, and the shape derivative of a Poisson problem.

    teg demo cut-cells                      (python -m teg.examples.cut_cells runs it without pictures)
    teg demo cut-cells --level "0.5 - x**2 - 2*y**4"

    -Δu = 1 in Ω,   u = 0 on ∂Ω,        Ω = {ω > 0},   ω = s² - x² - y² + k·(x³ - 3xy²), or any formula of x and y

The square is cut into cells that do not follow Ω. The area of Ω in a cell is one integral of a bracket. Where it is less than the cell's,
`f.nodes` gives the points and weights of its quadrature; other cells have Gauss's. With these any finite elements can be assembled; here
u = ω·v with biquadratic B-splines v, which is 0 on ∂Ω. The energy J = ∫u has the shape derivative

    ∂J/∂p = ∫ |∇u|²·V ds over ∂Ω          V = ∂ω/∂p / |∇ω|: how fast the boundary moves with the parameter p (Hadamard)

and `f.nodes(by="c")`, the nodes of the derivative by a number c added to ω, gives points on ∂Ω with the weights ds/|∇ω|. For k = 0, Ω is a
disk, with J = πs⁴/8. For a formula of the user's, p is c.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import teg
from teg.errors import InputError
from teg.evaluator.options import Backend
from teg.examples.formula import read_formula
from teg.ir.expr import Expr

Array = npt.NDArray[np.float64]
HALF = 1.2345
"""The square is (-HALF, HALF)². No side of a cell touches ∂Ω where it is parallel: nodes on ∂Ω crowd there, and miss the tolerance."""
LEVEL, BENT = "s**2 - x**2 - y**2 + k*(x**3 - 3*x*y**2)", {"s": 0.75, "k": 0.35}
FINE = 400  # points a side, at which a level set is looked at

x, y = teg.vars("x y")
left, bottom, width, c = teg.params("left bottom width c")


@dataclass(frozen=True)
class Region:
    """Where a formula of x and y, and of parameters with these `values`, is positive.

    `area` is the area in a cell, `level` the formula with its slopes by x and y, and its derivatives by all parameters, c the last.
    """

    formula: str
    values: Mapping[str, float]
    area: teg.Evaluator
    level: teg.Evaluator

    @property
    def moving(self) -> list[str]:
        """Returns the names of the parameters by which the energy is differentiated: c, which is added to ω, if there is no other."""
        return [name for name in self.values if name != "c"] or ["c"]

    def at(self, points: Array) -> Array:
        """Returns ω, its slopes by x and y, and its derivatives by the parameters in `values`, at points (n, 2): (3 + parameters, n)."""
        px, py = points.T
        return np.stack(np.broadcast_arrays(*self.level({**self.values, "x": px, "y": py}), px)[:-1])

    def by(self, name: str, points: Array) -> Array:
        """Returns the derivative of ω by a parameter, (n,)."""
        return np.asarray(self.at(points)[3 + list(self.values).index(name)])


def make_region(formula: str = LEVEL, values: Mapping[str, float] = BENT, backend: Backend = "numpy") -> Region:
    """Returns the region of a formula. Raises InputError if there is none inside of the square."""
    parameters = {name: teg.param(name) for name in values}

    def level(px: Expr, py: Expr) -> Expr:
        return read_formula(formula, {"x": px, "y": py, **parameters}, "the level set", "0.5 - x**2 - 2*y**4") + c

    cell = (x, left, left + width), (y, bottom, bottom + width)
    area = teg.compile(teg.integral(teg.bracket(level(x, y) > 0), *cell), [c], backend=backend, tol=1e-8, order=8)
    px, py = teg.params("x y")
    omega = level(px, py)
    slopes = [teg.diff(omega, p) for p in (px, py, *parameters.values(), c)]
    region = Region(formula, {**values, "c": 0.0}, area, teg.compile(teg.tuple(omega, *slopes), [], backend=backend, inaccurate="ignore"))
    ticks = np.linspace(-HALF, HALF, FINE)
    heights = np.stack([region.at(np.stack(row, axis=1))[0] for row in zip(*np.meshgrid(ticks, ticks), strict=True)])
    if not np.isfinite(heights).all():
        raise InputError(f"the level set {formula!r} is not finite everywhere", None, f"a formula that is, for |x|, |y| <= {HALF}")
    if not (heights > 0).any():
        raise InputError(f"the level set {formula!r} is positive nowhere", None, f"positive in a region within |x|, |y| < {HALF}")
    if max(heights[[0, -1]].max(), heights[:, [0, -1]].max()) >= 0:
        raise InputError(f"the region of {formula!r} reaches the border", None, f"a formula that is negative for |x| or |y| = {HALF}")
    return region


@dataclass
class Solution:
    """Coefficients of the B-splines, the energy J and its derivatives, and the nodes: inside, and on the boundary."""

    region: Region
    cells: int
    coefficients: Array
    energy: float
    slopes: dict[str, float]
    points: Array
    weights: Array
    boundary: Array

    def values(self, points: Array) -> Array:
        """Returns u at points, (n,); 0 outside."""
        splines, _ = b_splines(points, self.cells)
        return np.asarray(np.maximum(self.region.at(points)[0], 0) * (splines @ self.coefficients))


def solve(region: Region, cells: int, derivatives: bool = True) -> Solution:
    """Returns the solution on cells × cells cells."""
    cut, points, weights = quadrature(region, cells)
    omega, *slope = region.at(points)[:3]
    splines, gradients = b_splines(points, cells)
    trial, by_place = omega[:, None] * splines, np.stack(slope)[:, :, None] * splines + omega[:, None] * gradients
    stiffness = sum(part.T @ (weights[:, None] * part) for part in by_place)
    load = trial.T @ weights
    used = np.flatnonzero(np.diag(stiffness) > 1e-14 * np.diag(stiffness).max())  # the others see next to nothing of Ω
    scale = 1 / np.sqrt(np.diag(stiffness)[used])
    scaled = scale[:, None] * stiffness[np.ix_(used, used)] * scale
    coefficients = np.zeros(splines.shape[1])
    coefficients[used] = scale * np.linalg.lstsq(scaled, scale * load[used], rcond=1e-13)[0]
    solution = Solution(region, cells, coefficients, float(load @ coefficients), {}, points, weights, np.zeros((0, 2)))
    if derivatives:
        solution.boundary, rate = flat(*region.area.nodes(cut, by="c"))
        v = b_splines(solution.boundary, cells)[0] @ coefficients
        normal = v**2 * (region.at(solution.boundary)[1:3] ** 2).sum(axis=0)  # |∇u|²
        solution.slopes = {p: float(rate @ (normal * region.by(p, solution.boundary))) for p in region.moving}
    return solution


def quadrature(region: Region, cells: int) -> tuple[dict[str, Any], Array, Array]:
    """Returns the arguments of the cells that ∂Ω cuts, and the points, (n, 2), and weights of a quadrature over Ω."""
    h = 2 * HALF / cells
    ticks = -HALF + h * np.arange(cells)
    corners = np.stack([np.repeat(ticks, cells), np.tile(ticks, cells)])
    given = {**region.values, "width": h}
    covered = region.area(given | {"left": corners[0], "bottom": corners[1]}) / h**2
    is_cut, is_inside = (covered > 0) & (covered < 1 - 1e-12), covered >= 1 - 1e-12
    cut = given | {"left": corners[0, is_cut], "bottom": corners[1, is_cut]}
    gauss, rule = (h / 2 * part for part in np.polynomial.legendre.leggauss(6))
    grid = np.stack(np.meshgrid(gauss, gauss), axis=-1).reshape(-1, 2) + h / 2
    inside = (corners.T[is_inside][:, None] + grid).reshape(-1, 2)
    points, weights = flat(*region.area.nodes(cut))
    return cut, np.concatenate([points, inside]), np.concatenate([weights, np.tile(np.outer(rule, rule).ravel(), is_inside.sum())])


def flat(points: Array, weights: Array) -> tuple[Array, Array]:
    """Returns the nodes of all cells as one list. Raises InputError if there are none."""
    counted = weights != 0
    if not counted.any():
        raise InputError("no cell has nodes in the region and on its border", None, "a region, or numbers, that are not as small")
    return points[counted], weights[counted]


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


def differences(region: Region, cells: int, step: float = 1e-5) -> dict[str, float]:
    """Returns the derivatives of J by differences of whole solutions, to compare."""

    def energy(name: str, shift: float) -> float:
        moved = replace(region, values={**region.values, name: region.values[name] + shift})
        return solve(moved, cells, derivatives=False).energy

    return {name: (energy(name, step) - energy(name, -step)) / (2 * step) for name in region.moving}


def main(cells: int = 6, formula: str | None = None, backend: Backend = "numpy") -> tuple[Solution, dict[str, Any]]:
    """Prints the disk against its closed form, and a bent shape, or that of a formula, against differences; returns its solution and the
    numbers.
    """
    region = make_region(backend=backend) if formula is None else make_region(formula, {}, backend)
    s = BENT["s"]
    disk = solve(make_region(values={"s": s, "k": 0.0}, backend=backend), cells)
    error = abs(disk.energy / (math.pi * s**4 / 8) - 1), abs(disk.slopes["s"] / (math.pi * s**3 / 2) - 1)
    print(f"disk: J = {disk.energy:.15f}, off by {error[0]:.1e}; ∂J/∂s = {disk.slopes['s']:.15f}, off by {error[1]:.1e}")
    solution, numbers = solve(region, cells), differences(region, cells)
    finer = solve(region, cells + 1, derivatives=False).energy
    label = "bent" if formula is None else formula
    print(f"{label}: J = {solution.energy:.9f} on {cells} × {cells} cells, {finer:.9f} on {cells + 1} × {cells + 1}")
    for name in region.moving:
        print(f"{label}: ∂J/∂{name} = {solution.slopes[name]:.9f} by Hadamard, {numbers[name]:.9f} by differences of whole solutions")
    return solution, {
        "disk_errors": error,
        "energy": solution.energy,
        "energy_on_finer_cells": finer,
        "slopes": solution.slopes,
        "differences": numbers,
        "nodes": len(solution.weights),
        "boundary_nodes": len(solution.boundary),
    }


def run_cut_cells(out: str | Path = "out/cut-cells", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Solves, prints and draws; writes to `out`, returns the contents of run.json. It has no progress bar, and nothing is random.

    The options are those of `teg demo cut-cells` (`examples/options.py`). Raises InputError for those that cannot be used,
    AccuracyError where the nodes of a formula miss the tolerance, MissingPackageError.
    """
    from teg.examples.harness import finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("cut-cells demo", {"matplotlib": "matplotlib"}, progress=False)
    settings = resolved("cut-cells", {"out": out, **options})
    folder = result_folder(Path(out))
    solution, numbers = main(settings["cells"], settings["level"], settings["backend"])
    draw(solution, folder / "cut_cells.png")
    off = max(abs(solution.slopes[name] / numbers["differences"][name] - 1) for name in solution.slopes)
    report = {"summary": [f"shape derivatives off by {off:.1e} of those by differences"], **numbers, "pictures": ["cut_cells.png"]}
    return finish(folder, "cut-cells", settings, report)


def draw(solution: Solution, path: Path) -> None:
    """Draws the nodes in the cells and on the boundary, and u."""
    from matplotlib.figure import Figure

    low, high = (np.clip(end, -HALF, HALF) for end in (solution.points.min(axis=0) - 0.2, solution.points.max(axis=0) + 0.2))
    side = (high - low).max() / 2
    figure = Figure(figsize=(12, 1 + 2.5 * (high - low)[1] / side), layout="constrained")
    nodes, field = figure.subplots(1, 2)
    ticks = np.linspace(-HALF, HALF, solution.cells + 1)
    for axes in (nodes, field):
        for tick in ticks:
            axes.plot([tick, tick], [-HALF, HALF], color="#c8ccd2", linewidth=0.7, zorder=0)
            axes.plot([-HALF, HALF], [tick, tick], color="#c8ccd2", linewidth=0.7, zorder=0)
        axes.set(aspect="equal", xlim=((low + high)[0] / 2 - side, (low + high)[0] / 2 + side), ylim=(low[1], high[1]))
        axes.set_axis_off()
    nodes.scatter(*solution.points.T, s=2500 * solution.weights / side**2, color="#2b6cb0", linewidth=0)
    nodes.scatter(*solution.boundary.T, s=5, color="#c2412d", linewidth=0)
    nodes.set_title(
        f"{len(solution.weights)} nodes inside, their area the weight, and {len(solution.boundary)} on the boundary", fontsize=11
    )
    px, py = np.meshgrid(np.linspace(-HALF, HALF, 500), np.linspace(-HALF, HALF, 500))
    rows = [np.stack(row, axis=1) for row in zip(px, py, strict=True)]  # all at once are a gigabyte
    omega, u = (np.stack([of(row) for row in rows]) for of in (lambda row: solution.region.at(row)[0], solution.values))
    drawn = field.contourf(px, py, np.where(omega > 0, u, np.nan), levels=16, cmap="viridis")
    field.contour(px, py, omega, levels=[0], colors="#c2412d", linewidths=1.5)
    figure.colorbar(drawn, ax=field, shrink=0.7)
    field.set_title("u, with -Δu = 1 inside and u = 0 on the boundary", fontsize=11)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
