"""Pictures of a run: those of the shader, and all of them with the loss on one sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

SMALLEST = 512  # pixels per side of the pictures written
BLUE, RED, GREY = "#2b6cb0", "#c2412d", "#666666"


def enlargement(size: int) -> int:
    """Returns the factor by which a picture of the shader is enlarged per side."""
    return max(1, SMALLEST // size)


def draw(path: Path, picture: np.ndarray) -> None:
    """Draws a picture, (n, n, 3), one constant colour a pixel, at least SMALLEST pixels a side."""
    side = max(SMALLEST, len(picture))
    Image.fromarray(_bytes(picture)).resize((side, side), Image.Resampling.NEAREST).save(path)


def draw_sheet(path: Path, shown: Mapping[str, np.ndarray], losses: Mapping[str, Sequence[float]], marks: Mapping[str, float]) -> None:
    """Draws titled pictures side by side, and below them the losses after each step; `marks` are losses to compare with."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3 * len(shown), 5.2), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(2, len(shown), height_ratios=(3, 1.7))
    for k, (title, picture) in enumerate(shown.items()):
        axes = figure.add_subplot(places[0, k])
        axes.imshow(np.clip(picture, 0, 1), interpolation="antialiased")
        axes.set_title(title, fontsize=10)
        axes.set_axis_off()
    _draw_losses(figure.add_subplot(places[1, :]), losses, marks)
    figure.savefig(path)


def _draw_losses(axes: Any, losses: Mapping[str, Sequence[float]], marks: Mapping[str, float]) -> None:
    longest = max(1, *(len(values) - 1 for values in losses.values()))
    for (label, values), colour in zip(losses.items(), (BLUE, RED), strict=False):
        axes.plot(values, color=colour, linewidth=2.2, label=f"{label}: {values[-1]:.4f}")
    for label, value in marks.items():
        axes.axhline(value, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
        axes.annotate(f"{label}: {value:.4f}", (longest, value), (-2, -11), textcoords="offset points", color=GREY, fontsize=9, ha="right")
    axes.set_ylim(0, 1.05 * max(map(max, losses.values())) or 1)
    axes.set_xlim(0, longest)
    axes.set_xlabel("step", fontsize=10, color=GREY)
    axes.set_title("squared colour difference per pixel", loc="left", fontsize=11)
    axes.legend(frameon=False, fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY, labelsize=9)


def _bytes(colours: np.ndarray) -> np.ndarray:
    return np.asarray(np.rint(np.clip(colours, 0, 1) * 255), dtype=np.uint8)
