"""Pictures of a run: those of the shader, and all of them with the loss on one sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from teg.examples.loss_chart import draw_losses

SMALLEST = 512  # pixels per side of the pictures written
ROUNDING = 1e-9  # of a derivative, beside colours between 0 and 1
COLOURED = 0.9  # of the pixels with a derivative are within the range of its colours
FILM_MILLISECONDS, FILM_LAST = 120, 2000


def enlargement(size: int) -> int:
    """Returns the factor by which a picture of the shader is enlarged per side."""
    return max(1, SMALLEST // size)


def draw(path: Path, picture: np.ndarray) -> None:
    """Draws a picture, (rows, columns, 3), one constant colour a pixel, at least SMALLEST pixels on its longer side."""
    longest = max(picture.shape[:2])
    height, width = (round(n * max(SMALLEST, longest) / longest) for n in picture.shape[:2])
    Image.fromarray(to_bytes(picture)).resize((width, height), Image.Resampling.NEAREST).save(path)


def draw_slopes(path: Path, picture: np.ndarray, slopes: Mapping[str, np.ndarray]) -> None:
    """Draws a picture, and beside it derivatives of it, the means of their channels: red where it becomes brighter, blue where darker."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height, width = picture.shape[:2]
    figure = Figure(figsize=(4.2 * (1 + len(slopes)), 4.2 * height / width + 0.9), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    first, *others = figure.subplots(1, 1 + len(slopes))
    first.imshow(np.clip(picture, 0, 1), interpolation="antialiased")
    first.set_title("the picture I", fontsize=10)
    for axes, (title, slope) in zip(others, slopes.items(), strict=True):
        grey = slope.mean(axis=2)
        seen = np.abs(grey[np.abs(grey) > ROUNDING])
        most = float(np.quantile(seen, COLOURED)) if seen.size else 1.0
        title += "" if seen.size else "\n0 to rounding: one colour is on both sides of its borders"
        shown = axes.imshow(grey, cmap="RdBu_r", vmin=-most, vmax=most, interpolation="antialiased")
        axes.set_title(title, fontsize=10)
        figure.colorbar(shown, ax=axes, location="bottom", fraction=0.05, pad=0.03, extend="both")
    for axes in (first, *others):
        axes.set_axis_off()
        axes.set_anchor("N")
    figure.savefig(path)


def draw_sheet(path: Path, shown: Mapping[str, np.ndarray], losses: Mapping[str, Sequence[float]], marks: Mapping[str, float]) -> None:
    """Draws titled pictures side by side, and below them the losses after each step; `marks` are losses to compare with."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    height, width = next(iter(shown.values())).shape[:2]
    figure = Figure(figsize=(3 * len(shown), 2.9 * height / width + 2.4), dpi=100, layout=ConstrainedLayoutEngine(h_pad=0.08))
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(2, len(shown), height_ratios=(3 * height / width, 1.7))
    for k, (title, picture) in enumerate(shown.items()):
        axes = figure.add_subplot(places[0, k])
        axes.imshow(np.clip(picture, 0, 1), interpolation="antialiased")
        axes.set_title(title.replace(", step", "\nstep"), fontsize=10)
        axes.set_axis_off()
    chart = places[1, :].subgridspec(1, 2, width_ratios=(2, 1))[0, 0]  # at the right is room for labels
    draw_losses(figure.add_subplot(chart), losses, marks)
    figure.savefig(path)


def to_bytes(colours: np.ndarray) -> np.ndarray:
    """Returns colours as bytes."""
    return np.asarray(np.rint(np.clip(colours, 0, 1) * 255), dtype=np.uint8)
