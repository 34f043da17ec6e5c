"""Pictures of a run: the mesh, the target, the error, the loss, and the run as an animation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from teg.examples.loss_chart import draw_losses
from teg.examples.triangulation.baselines import psnr
from teg.examples.triangulation.colour_fit import colours_at
from teg.examples.triangulation.mesh import extent

SMALLEST = 512  # pixels of the longer side of the pictures written
FINE = 1024  # pixels of the longer side before averaging, if that is two to four times those after it
FILM_SIDE, FILM_MILLISECONDS, FILM_LAST = 480, 120, 2000
SHEET_SIDE = 800  # pixels of the longer side of a picture on the sheet
GREY = "#666666"
STRIP = 64  # rows that are coloured at once


def render(vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, size: int | tuple[int, int], side: int) -> np.ndarray:
    """Returns the coloured triangles as a picture, (rows, columns, 3), its longer side `side` pixels, antialiased.

    It is drawn two to four times larger, and averaged.
    """
    width, height = extent(size)
    scale = side / max(width, height)
    columns, rows = max(1, round(width * scale)), max(1, round(height * scale))
    factor = min(4, max(2, -(-FINE // side)))
    numbers = Image.new("I", (columns * factor, rows * factor))
    draw = ImageDraw.Draw(numbers)
    stretch = np.array([columns / width, rows / height]) * factor
    for number, corners in enumerate((vertices * stretch - 0.5)[triangles]):
        draw.polygon([(x, y) for x, y in corners], fill=number)
    faces = np.asarray(numbers)
    x = (np.arange(columns * factor) + 0.5) / stretch[0]
    picture = np.empty((rows, columns, 3), dtype=np.float32)
    for top in range(0, rows, STRIP):
        strip = faces[top * factor : (top + STRIP) * factor]
        y = (top * factor + np.arange(len(strip)) + 0.5) / stretch[1]
        fine = colours_at(np.stack(np.meshgrid(x, y), axis=-1), strip, vertices[triangles], colours)
        fine = np.clip(fine, 0, 1).reshape(len(strip) // factor, factor, columns, factor, 3)
        picture[top : top + STRIP] = fine.mean(axis=(1, 3))
    return picture


def shown_side(size: tuple[int, int]) -> int:
    """Returns the longer side of the pictures of a run."""
    return max(SMALLEST, *size)


def draw_mesh(path: Path, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, size: int | tuple[int, int]) -> None:
    """Draws the coloured triangles as a PNG."""
    draw_picture(path, render(vertices, triangles, colours, size, shown_side(extent(size))))


def draw_picture(path: Path, picture: np.ndarray) -> None:
    """Draws a picture as a PNG."""
    Image.fromarray(to_bytes(picture)).save(path)


def draw_target(path: Path, target: np.ndarray) -> None:
    """Draws the target picture, one constant colour a pixel."""
    scale = shown_side((target.shape[1], target.shape[0])) / max(target.shape[:2])
    shape = round(target.shape[1] * scale), round(target.shape[0] * scale)
    Image.fromarray(to_bytes(target)).resize(shape, Image.Resampling.NEAREST).save(path)


def draw_error(path: Path, picture: np.ndarray, target: np.ndarray) -> None:
    """Draws the colour difference of each pixel, grey, white at its 99.5 % quantile."""
    error = np.sqrt(np.mean((picture - target) ** 2, axis=2, dtype=np.float32))
    draw_target(path, np.repeat((error / max(float(np.quantile(error, 0.995)), 1e-9))[..., None], 3, axis=2))


def draw_sheet(path: Path, target: np.ndarray, meshes: Mapping[str, np.ndarray], losses: Mapping[str, float]) -> None:
    """Draws the target, pictures of meshes at its size, and the error of the last one, side by side; `losses` are those of the meshes.

    Large pictures are made as small as they are shown: Matplotlib would need hundreds of bytes a pixel.
    """
    figure = _figure((3.1 * (len(meshes) + 2), 3.1 * target.shape[0] / target.shape[1] + 0.7))
    places = figure.subplots(1, len(meshes) + 2)
    error = _smaller(np.sqrt(np.mean((list(meshes.values())[-1] - target) ** 2, axis=2, dtype=np.float32)))
    titles = ["target", *(f"{label}\n{psnr(losses[label]):.2f} dB" for label in meshes), "error of the last one"]
    for axes, title, picture in zip(places, titles, [*map(_smaller, [target, *meshes.values()]), error], strict=True):
        if picture.ndim == 3:
            axes.imshow(picture, interpolation="antialiased")
        else:
            shades = axes.imshow(picture, cmap="magma", vmin=0, vmax=max(float(np.quantile(picture, 0.995)), 1e-3))
            bar = figure.colorbar(shades, cax=axes.inset_axes((1.03, 0, 0.05, 1)))  # as high as the picture, of any shape
            bar.ax.tick_params(labelsize=8, colors=GREY)
        axes.set_title(title, fontsize=10)
        axes.set_axis_off()
    figure.savefig(path, bbox_inches="tight", pad_inches=0.05)


def draw_loss(path: Path, losses: Mapping[str, Sequence[float]], marks: Mapping[str, float]) -> None:
    """Draws the losses after each step, from the undeformed mesh in its best colours on; `marks` are losses to compare with."""
    figure = _figure((7.5, 4))
    chart = figure.add_gridspec(1, 2, width_ratios=(1.8, 1))[0, 0]  # at the right is room for labels
    draw_losses(figure.add_subplot(chart), losses, marks)
    figure.savefig(path)


def _smaller(picture: np.ndarray) -> np.ndarray:
    """Returns a picture of at most `SHEET_SIDE` pixels on its longer side: colours as bytes, numbers as such."""
    height, width = picture.shape[:2]
    scale = min(1.0, SHEET_SIDE / max(height, width))
    image = Image.fromarray(to_bytes(picture) if picture.ndim == 3 else picture)
    return np.asarray(image.resize((max(1, round(width * scale)), max(1, round(height * scale))), Image.Resampling.BOX))


def _figure(size: tuple[float, float]) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def to_bytes(colours: np.ndarray) -> np.ndarray:
    """Returns colours as bytes."""
    return np.asarray(np.rint(np.clip(colours, 0, 1) * 255), dtype=np.uint8)
