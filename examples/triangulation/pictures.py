"""Pictures of a run: the mesh, the target, the loss."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

SMALLEST = 512  # pixels per side of the pictures written
LARGEST_CANVAS = 8192
BLUE, GREY = "#2b6cb0", "#666666"


def draw_mesh(path: Path, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, size: int) -> None:
    """Draws the coloured triangles as a PNG, antialiased: drawn larger, then averaged."""
    side = max(SMALLEST, size)
    factor = max(1, min(4, LARGEST_CANVAS // side))
    canvas = Image.new("RGB", (side * factor, side * factor))
    draw = ImageDraw.Draw(canvas)
    points = vertices * (side * factor / size) - 0.5
    for corners, colour in zip(points[triangles], _bytes(colours), strict=True):
        draw.polygon([(x, y) for x, y in corners], fill=(int(colour[0]), int(colour[1]), int(colour[2])))
    canvas.resize((side, side), Image.Resampling.BOX).save(path)


def draw_target(path: Path, target: np.ndarray) -> None:
    """Draws the target picture, one constant colour a pixel."""
    side = max(SMALLEST, len(target))
    Image.fromarray(_bytes(target)).resize((side, side), Image.Resampling.NEAREST).save(path)


def write_svg(path: Path, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, size: int) -> None:
    """Writes the triangles with their colours, and their edges as thin lines, as an SVG."""
    faces = []
    for (a, b, c), (red, green, blue) in zip(vertices[triangles], _bytes(colours), strict=True):
        colour = f"#{red:02x}{green:02x}{blue:02x}"  # the stroke closes the seams of antialiasing
        faces.append(f'<path d="M{_point(a)}L{_point(b)}L{_point(c)}z" fill="{colour}" stroke="{colour}"/>')
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]))
    edges = "".join(f"M{_point(vertices[a])}L{_point(vertices[b])}" for a, b in np.unique(pairs, axis=0))
    width = size / 1000
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size} {size}" width="1024" height="1024">',
        f'<g id="faces" stroke-width="{width:g}" stroke-linejoin="round">',
        *faces,
        "</g>",
        f'<path id="edges" d="{edges}" fill="none" stroke="#fff" stroke-opacity="0.4" stroke-width="{width:g}"/>',
        "</svg>",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def draw_loss(path: Path, losses: Sequence[float]) -> None:
    """Draws the loss after each step, from the undeformed mesh in its best colours on."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot(losses, color=BLUE, linewidth=2)
    axes.fill_between(range(len(losses)), losses, color=BLUE, alpha=0.08, linewidth=0)
    axes.set_ylim(0, 1.08 * max(losses) or 1)
    axes.set_xlim(0, max(len(losses) - 1, 1))
    axes.set_xlabel("step")
    axes.set_title("squared colour difference per pixel", loc="left", fontsize=11)
    for place, loss in ((0, losses[0]), (len(losses) - 1, losses[-1])):
        side, align = (-8, "right") if place else (8, "left")
        axes.annotate(f"{loss:.4f}", (place, loss), (side, 8), textcoords="offset points", color=GREY, ha=align)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY)
    figure.savefig(path)


def _bytes(colours: np.ndarray) -> np.ndarray:
    return np.asarray(np.rint(np.clip(colours, 0, 1) * 255), dtype=np.uint8)


def _point(p: np.ndarray) -> str:
    return f"{p[0]:.2f} {p[1]:.2f}"
