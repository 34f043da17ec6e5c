"""Animations of matplotlib's figures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

FRAMES, MILLISECONDS, LAST = 72, 40, 900


def write_animation(path: Path, figure: Any, update: Callable[[float], None], duration: float) -> None:
    """Writes a figure as a GIF. Before each frame `update` is called with a time from 0 to `duration`; the layout stays."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    figure.set_layout_engine("none")
    images = []
    for now in np.linspace(0, duration, FRAMES):
        update(float(now))
        canvas.draw()
        images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]).quantize(64))
    times = [MILLISECONDS] * (FRAMES - 1) + [LAST]
    images[0].save(path, save_all=True, append_images=images[1:], duration=times, loop=0, disposal=1)
