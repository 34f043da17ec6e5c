"""Pictures of a run: the held-out photo, the grid and the network's mesh in their best colours, a part of each, the losses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teg.examples.harness import ratio

BLUE, RED, GREY = "#2b6cb0", "#c2412d", "#666666"
PART, PLACES = 0.5, 12  # width of the enlarged part, of a picture of width 1, and where it may begin

Drawing = tuple[np.ndarray, np.ndarray]  # vertices (n, 2), colours of triangles (m, 3)


def draw_sheet(
    path: Path,
    photo: np.ndarray,
    triangles: np.ndarray,
    drawings: Mapping[str, Drawing],
    losses: Mapping[str, Sequence[float]],
    training: Sequence[float],
) -> None:
    """The photo, (size, size, 3), and each mesh beside it; below, a part of each with edges; last, the losses after each epoch.

    `losses` are those of the photo, `training` the ratios of the crops' losses.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns, size = 1 + len(drawings), len(photo)
    figure = Figure(figsize=(3.2 * columns, 9.4), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(3, columns, height_ratios=(3.2, 3.2, 2))
    width = PART * size
    (grid, _), (mesh, _) = drawings.values()
    left, top = _liveliest(grid, mesh, width, size)
    for row in range(2):
        for column in range(columns):
            axes = figure.add_subplot(places[row, column])
            if column == 0:
                axes.imshow(np.clip(photo, 0, 1), extent=(0, size, size, 0), interpolation="nearest")
            else:
                vertices, colours = list(drawings.values())[column - 1]
                _draw_mesh(axes, vertices, triangles, colours, edges=row == 1)
            axes.set_xlim(*((left, left + width) if row else (0, size)))
            axes.set_ylim(*((top + width, top) if row else (size, 0)))
            axes.set_aspect("equal")
            axes.set_axis_off()
            if row == 0:
                axes.set_title(["the photo, not seen in training", *drawings][column], fontsize=10)
    _draw_losses(figure.add_subplot(places[2, :]), losses, training)
    figure.savefig(path)


def _liveliest(grid: np.ndarray, mesh: np.ndarray, width: float, size: float) -> tuple[float, float]:
    """Returns left and upper end of the square of this width in which the vertices of a mesh have moved most from those of the grid."""
    moved = np.linalg.norm(mesh - grid, axis=1)
    ends = np.linspace(0, size - width, PLACES)
    inside = [[((mesh >= (left, top)) & (mesh <= (left + width, top + width))).all(axis=1) for left in ends] for top in ends]
    row, column = np.unravel_index(int(np.argmax(inside @ moved)), (PLACES, PLACES))
    return float(ends[column]), float(ends[row])


def _draw_mesh(axes: Any, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, edges: bool) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    shown = np.clip(colours, 0, 1)  # edges in the same colour close the seams of antialiasing
    axes.add_collection(PolyCollection(list(vertices[triangles]), facecolors=shown, edgecolors=shown, linewidths=1.0))
    if edges:
        pairs = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)
        axes.add_collection(LineCollection(list(vertices[pairs]), colors=(1, 1, 1, 0.6), linewidths=0.6))


def _draw_losses(axes: Any, losses: Mapping[str, Sequence[float]], training: Sequence[float]) -> None:
    longest = max(1, len(training))
    axes.plot(np.arange(1, len(training) + 1), training, color=GREY, linewidth=1, alpha=0.6, label="training crops")
    for (label, values), colour in zip(losses.items(), (BLUE, RED), strict=False):
        ratios = [ratio(v, values[0]) for v in values]
        ratios += [ratios[-1]] * (longest + 1 - len(ratios))  # without progress it stays there
        axes.plot(ratios, color=colour, linewidth=2.2, label=f"{label}: {ratios[-1]:.3f}")
    axes.set_xlim(0, longest)
    axes.set_ylim(0, 1.1)
    axes.set_xlabel("epoch", fontsize=10, color=GREY)
    axes.set_title("loss, of that of the grid in its best colours", loc="left", fontsize=11)
    axes.legend(frameon=False, fontsize=10, loc="lower left", ncols=3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY, labelsize=9)
