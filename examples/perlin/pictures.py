"""Pictures of a run: those of the shader, and all of them with the loss on one sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

SMALLEST = 512  # pixels per side of the pictures written
GIF_MILLISECONDS, GIF_LAST = 120, 2000
BLUE, RED, GREY = "#2b6cb0", "#c2412d", "#666666"


def enlargement(size: int) -> int:
    """Returns the factor by which a picture of the shader is enlarged per side."""
    return max(1, SMALLEST // size)


def draw(path: Path, picture: np.ndarray) -> None:
    """Draws a picture, (n, n, 3), one constant colour a pixel, at least SMALLEST pixels a side."""
    side = max(SMALLEST, len(picture))
    Image.fromarray(_bytes(picture)).resize((side, side), Image.Resampling.NEAREST).save(path)


def write_gif(path: Path, frames: Sequence[np.ndarray]) -> None:
    """Writes pictures as an animation, which repeats and waits at its last picture."""
    images = [Image.fromarray(_bytes(frame)).quantize(64, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE) for frame in frames]
    times = [GIF_MILLISECONDS] * (len(images) - 1) + [GIF_LAST]
    images[0].save(path, save_all=True, append_images=images[1:], duration=times, loop=0)


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
        axes.set_title(title.replace(", step", "\nstep"), fontsize=10)
        axes.set_axis_off()
    chart = places[1, :].subgridspec(1, 2, width_ratios=(2, 1))[0, 0]  # at the right is room for labels
    _draw_losses(figure.add_subplot(chart), losses, marks)
    figure.savefig(path)


def _draw_losses(axes: Any, losses: Mapping[str, Sequence[float]], marks: Mapping[str, float]) -> None:
    from matplotlib.ticker import LogLocator

    longest = max(1, *(len(values) - 1 for values in losses.values()))
    lines = [(label, values[-1], colour) for (label, values), colour in zip(losses.items(), (BLUE, RED), strict=False)]
    for values, (_, _, colour) in zip(losses.values(), lines, strict=True):
        axes.plot(values, color=colour, linewidth=2.2)
    for value in marks.values():
        axes.axhline(value, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)), zorder=0)
    every = [value for values in (*losses.values(), [*marks.values()]) for value in values]
    low, high = np.log(max(min(every), 1e-9)), np.log(max(max(every), 1e-9))
    axes.set_yscale("log")
    axes.set_ylim(np.exp(low - 0.06 * (high - low) - 0.02), np.exp(high + 0.06 * (high - low) + 0.02))
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:.3g}")
    axes.yaxis.set_minor_formatter("")
    place = -np.inf
    for label, value, colour in sorted(lines + [(label, value, GREY) for label, value in marks.items()], key=lambda line: line[1]):
        place = max((np.log(max(value, 1e-9)) - low) / max(high - low, 1e-9), place + 0.14)  # labels do not overlap
        at = (0.06 * (high - low) + 0.02 + place * (high - low)) / (1.12 * (high - low) + 0.04)
        text = axes.annotate(f"{label}: {value:.4f}", (1.015, at), xycoords="axes fraction", color=colour, fontsize=9, va="center")
        text.set_in_layout(False)
    axes.set_xlim(0, longest)
    axes.set_xlabel("step", fontsize=10, color=GREY)
    axes.set_title("squared colour difference per pixel", loc="left", fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(which="both", colors=GREY, labelsize=9)


def _bytes(colours: np.ndarray) -> np.ndarray:
    return np.asarray(np.rint(np.clip(colours, 0, 1) * 255), dtype=np.uint8)
