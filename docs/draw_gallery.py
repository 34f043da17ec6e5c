"""Draws the pictures of the gallery that no demonstration draws: the lights of `teg demo shaders`, and the stirred disk.

python docs/draw_gallery.py
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from teg.examples.shaders import HEIGHT, lights

FOLDER = Path(__file__).parent / "gallery"
TURN, WIDTH, CONTRAST, STIR, AREA = math.pi / 7, 0.7, 0.5, 0.4, 0.5


def grid(size: float, points: int = 400) -> tuple[Any, Any]:
    """Returns the coordinates of a square."""
    axis = np.linspace(-size, size, points)
    return np.meshgrid(axis, axis)


def draw_shaders() -> None:
    """Draws the window in front of each light."""
    x, y = grid(1.0)
    across, along = x * math.cos(TURN) + y * math.sin(TURN), y * math.cos(TURN) - x * math.sin(TURN)
    is_open = (abs(across) < WIDTH) & (abs(along) < HEIGHT)
    figure, axes = plt.subplots(1, 4, figsize=(9, 2.5))
    for axis, (name, light) in zip(axes, lights(np).items(), strict=True):
        axis.imshow(np.where(is_open, light(x, y, CONTRAST) + 0 * x, np.nan), origin="lower", extent=(-1, 1, -1, 1), cmap="magma")
        axis.set(title=name, xticks=[], yticks=[], facecolor="0.2")
    save(figure, "shaders")


def draw_stirred_disk() -> None:
    """Draws the region of `teg.examples.custom_map`, and the coordinates in which it is a disk."""
    x, y = grid(1.5)
    u = x + np.sin(2 * y) / 2
    v = y + STIR * u**2
    figure, axis = plt.subplots(figsize=(4, 4))
    axis.contourf(x, y, u**2 + v**2, levels=[0, AREA], colors=["#9ecae1"])
    axis.contour(x, y, np.hypot(u, v), levels=np.arange(0.1, 1.6, 0.2) * math.sqrt(AREA), colors="0.6", linewidths=0.6)
    axis.contour(x, y, u**2 + v**2, levels=[AREA], colors="#08519c")
    axis.set(aspect="equal", xlabel="x", ylabel="y")
    save(figure, "custom-map")


def save(figure: Any, name: str) -> None:
    """Writes a figure to the gallery."""
    figure.tight_layout()
    figure.savefig(FOLDER / f"{name}.png", dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    draw_shaders()
    draw_stirred_disk()
