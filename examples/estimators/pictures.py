"""The picture of the estimators of this folder beside the exact derivatives.

python -m teg.examples.estimators.pictures [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.examples.charts.draw import FAINT, INK, _figure
from teg.examples.estimators import nmr, opendr, psdr
from teg.examples.estimators.raster import Array, drawn, exact_slopes
from teg.examples.harness import require_packages, result_folder

CORNERS = np.array([[0.2, 0.15], [0.85, 0.35], [0.4, 0.8]])
COLOURS, BACKGROUND = np.array([1.0, 0.4, 0.7]), 0.1
SIDE, FINE = 32, 128
GOAL = CORNERS + np.array([0.06, 0.03])
"""Where the triangle of the loss's picture stands."""
ENOUGH = tuple(4**k for k in range(2, 10))


def draw(folder: Path) -> Path:
    """Draws estimators.png in the folder, and returns its path."""
    figure = _figure((15, 8.2))
    panels = figure.subplots(2, 3)
    picture = drawn(CORNERS, COLOURS, BACKGROUND, SIDE)
    true, filtered = exact_slopes(CORNERS, COLOURS, BACKGROUND, SIDE)[:, :, 1, 0], opendr.image_slopes(picture)[:, :, 1, 0]
    most = float(np.abs(true).max())
    for panel, image, title in zip(
        panels.flat,
        (true, filtered, filtered - true),
        ("exact: the right corner to the right", "OpenDR: differences of pixels", "OpenDR less exact"),
        strict=False,
    ):
        panel.imshow(image, origin="lower", cmap="RdBu_r", vmin=-most, vmax=most, extent=(0, 1, 0, 1))
        _titled(panel, title)
    _arrows(panels[1, 0], SIDE)
    _arrows(panels[1, 1], FINE)
    _convergence(panels[1, 2])
    figure.suptitle("Derivatives of rasterisers, and of paths with one bounce", fontsize=14, color=INK, x=0.012, ha="left")
    path = folder / "literature.png"
    figure.savefig(path)
    return path


def loss_gradients(n: int) -> dict[str, Array]:
    """Returns the gradient by the corners of the mean square difference from the picture of the moved triangle, by three methods."""
    picture, goal = drawn(CORNERS, COLOURS, BACKGROUND, n), drawn(GOAL, COLOURS, BACKGROUND, n)
    residual = 2 * (picture.image - goal.image) / n**2
    images = {"exact": exact_slopes(CORNERS, COLOURS, BACKGROUND, n), "OpenDR": opendr.image_slopes(picture)}
    found = {name: (residual[..., None, None] * slopes).sum(axis=(0, 1)) for name, slopes in images.items()}
    return found | {"NMR": nmr.loss_slopes(picture, residual)}


def _arrows(panel: Any, n: int) -> None:
    """Draws the steps down the gradients at the corners, each method's longest one with the same length."""
    goal = drawn(GOAL, COLOURS, BACKGROUND, n)
    panel.imshow(drawn(CORNERS, COLOURS, BACKGROUND, n).image - goal.image, origin="lower", cmap="Greys", extent=(0, 1, 0, 1), alpha=0.5)
    for (name, slopes), colour in zip(loss_gradients(n).items(), ("#0072B2", "#E69F00", "#D55E00"), strict=True):
        size = float(np.abs(slopes).max())
        panel.quiver(*CORNERS.T, *(-slopes / size).T, color=colour, angles="xy", scale_units="xy", scale=5, width=0.008)
        panel.plot([], [], color=colour, label=f"{name}, longest {size:.2g}")
    panel.legend(loc="upper right", frameon=False, fontsize=8)
    _titled(panel, f"down the loss, {n}² pixels")


def _convergence(panel: Any) -> None:
    """Draws the error of the boundary term against the number of samples."""
    truth = teg.compile(psdr.radiance()).grad(**psdr.AT)["p"]
    found = [[psdr.boundary_term(n, seed)[0] for seed in range(8)] for n in ENOUGH]
    errors = [float(np.sqrt(np.mean((np.array(row) - truth) ** 2))) for row in found]
    panel.loglog(ENOUGH, errors, color="#009E73", marker="o", label="error of 8 seeds, root mean square")
    panel.loglog(ENOUGH, errors[0] * (np.array(ENOUGH) / ENOUGH[0]) ** -0.5, color=INK, linestyle=":", label="N^(-1/2)")
    panel.grid(color=FAINT)
    panel.set_xlabel("samples", color=INK)
    panel.legend(frameon=False, fontsize=8)
    panel.set_title("PSDR's boundary term: a shadow with one bounce", fontsize=11, color=INK, loc="left")


def _titled(panel: Any, title: str) -> None:
    panel.set_title(title, fontsize=11, color=INK, loc="left")
    panel.set_xticks([])
    panel.set_yticks([])


if __name__ == "__main__":
    require_packages("picture", {"matplotlib": "matplotlib>=3.8"}, progress=False, extra="chart")
    print(draw(result_folder(Path(sys.argv[1] if len(sys.argv) > 1 else "out/estimators"))))
