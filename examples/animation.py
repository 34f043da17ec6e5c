"""Animations: as GIF, and as MP4 where PyAV is installed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np

FRAMES, MILLISECONDS, LAST = 72, 40, 900
FEW = 64  # colours of a drawing
NO_VIDEO = 'animations are GIFs; with PyAV they are MP4 files too: pip install "teg-compiler[video]"'
QUALITY = "18"  # of H.264, where 0 is lossless, and 23 the usual one


def write_animation(path: Path, figure: Any, update: Callable[[float], None], duration: float) -> None:
    """Writes one of matplotlib's figures as a film. Before each frame `update` is called with a time from 0 to `duration`; the layout
    stays.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    figure.set_layout_engine("none")
    frames = []
    for now in np.linspace(0, duration, FRAMES):
        update(float(now))
        canvas.draw()
        frames.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
    write_film(path, frames, MILLISECONDS, LAST, FEW)


def write_film(path: Path, frames: Sequence[np.ndarray], milliseconds: int, last: int, colours: int = 256) -> None:
    """Writes pictures, (rows, columns, 3) of bytes, as a GIF that repeats, and as an MP4 beside it if PyAV is installed.

    Each is shown for so many milliseconds, the last one for `last`; the GIF has so many `colours`.
    """
    from PIL import Image

    images = [Image.fromarray(frame).quantize(colours) for frame in frames]
    times = [milliseconds] * (len(images) - 1) + [last]
    images[0].save(path, save_all=True, append_images=images[1:], duration=times, loop=0, disposal=1)
    if can_write_video():
        _write_video(path.with_suffix(".mp4"), [*frames[:-1], *[frames[-1]] * max(1, last // milliseconds)], milliseconds)


def can_write_video() -> bool:
    """Returns whether PyAV is installed."""
    return util.find_spec("av") is not None


def _write_video(path: Path, frames: Sequence[np.ndarray], milliseconds: int) -> None:
    """Writes an MP4 that browsers and telephones play: H.264 in halves of the colours' resolution, and so with even sides."""
    import av

    height, width = (side + side % 2 for side in frames[0].shape[:2])
    with av.open(str(path), "w", options={"movflags": "faststart"}) as film:
        stream: Any = film.add_stream("libx264", rate=Fraction(1000, milliseconds), options={"crf": QUALITY})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for frame in frames:
            room = [(0, side - size) for side, size in zip((height, width), frame.shape[:2], strict=True)]
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(np.pad(frame, [*room, (0, 0)], mode="edge")), format="rgb24")
            film.mux(stream.encode(picture))
        film.mux(stream.encode())
