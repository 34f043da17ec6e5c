"""Pictures of a run: those of the shader, and all of them with the loss on one sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from teg.examples.loss_chart import draw_losses

SMALLEST = 512  # pixels per side of the pictures written
GIF_MILLISECONDS, GIF_LAST = 120, 2000


def enlargement(size: int) -> int:
    """Returns the factor by which a picture of the shader is enlarged per side."""
    return max(1, SMALLEST // size)


def draw(path: Path, picture: np.ndarray) -> None:
    """Draws a picture, (n, n, 3), one constant colour a pixel, at least SMALLEST pixels a side."""
    side = max(SMALLEST, len(picture))
    Image.fromarray(_bytes(picture)).resize((side, side), Image.Resampling.NEAREST).save(path)


def write_gif(path: Path, frames: Sequence[np.ndarray]) -> None:
    """Writes pictures as an animation, which repeats and waits at its last picture."""
    images = [Image.fromarray(_bytes(frame)).quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE) for frame in frames]
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
    draw_losses(figure.add_subplot(chart), losses, marks)
    figure.savefig(path)


def _bytes(colours: np.ndarray) -> np.ndarray:
    return np.asarray(np.rint(np.clip(colours, 0, 1) * 255), dtype=np.uint8)
