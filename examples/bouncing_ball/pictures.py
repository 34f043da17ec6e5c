"""Pictures of a run: the paths in space-time, and the distance of the contacts from the true ones after each step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teg.examples.bouncing_ball.throw import Throw

BLUE, RED, GOLD, GREY, LIFT = "#2b6cb0", "#c2412d", "#f2c14e", "#666666", "#eef1f5"
POINTS = 800
LEAST = 1e-17  # an error of 0 is drawn at this value

Path_ = tuple[np.ndarray, np.ndarray]


def draw_sheet(
    path: Path, throw: Throw, true: Path_, first: Path_, found: Mapping[str, Path_], errors: Mapping[str, Sequence[float]]
) -> None:
    """Draws a panel of space-time for each path found, and one of the errors. A path is (times of contacts, heights of arcs)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12 if len(found) > 1 else 8, 8), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(2, len(found), height_ratios=(2.6, 1))
    shared = None
    for k, ((label, arcs), colour) in enumerate(zip(found.items(), (BLUE, RED), strict=False)):
        shared = axes = figure.add_subplot(places[0, k], sharey=shared)
        _draw_lift(axes, throw)
        _draw_path(axes, throw, true, color=GOLD, linewidth=7, solid_capstyle="round", label="true path")
        _draw_path(axes, throw, first, color=GREY, linewidth=1.2, linestyle=(0, (4, 3)), label="start of the descent")
        _draw_path(axes, throw, arcs, color=colour, linewidth=2, label=label)
        times = arcs[0]
        axes.plot(times, throw.walls(times), "o", color=colour, markersize=6)
        off = errors[label][-1]
        axes.set_title(f"{label}: contacts off by {off:.0e} s" if off < 1e-3 else f"{label}: contacts off by {off:.3f} s", fontsize=11)
        axes.legend(frameon=False, fontsize=9, loc="upper left" if throw.speed >= 0 else "upper right")
    _draw_errors(figure.add_subplot(places[1, :]), errors)
    figure.savefig(path)


def _draw_lift(axes: Any, throw: Throw) -> None:
    t = np.array([0, throw.duration])
    floor = throw.speed * t
    lowest, highest = floor.min(), floor.max() + throw.room
    axes.fill_between(t, floor, floor + throw.room, color=LIFT, linewidth=0)
    for wall in (floor, floor + throw.room):
        axes.plot(t, wall, color="black", linewidth=2.5)
    span, place = highest - lowest, 0.75 * throw.duration
    turned: dict[str, Any] = {"rotation": np.degrees(np.arctan(throw.speed)), "rotation_mode": "anchor", "transform_rotates_text": True}
    for name, height in (("floor", -0.06 * span), ("ceiling", throw.room + 0.025 * span)):
        axes.text(place, throw.speed * place + height, name, color=GREY, fontsize=9, **turned)
    for t_end, height in ((0.0, throw.start), (throw.duration, throw.arrival)):
        axes.plot(t_end, height, "o", color="black", markersize=7, clip_on=False, zorder=5)
    axes.set_xlim(0, throw.duration)
    axes.set_ylim(lowest - 0.08 * span, highest + 0.12 * span + 0.25 * (throw.speed == 0))
    axes.set_xlabel("time in s", color=GREY)
    axes.set_ylabel("height in m", color=GREY)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY)


def _draw_path(axes: Any, throw: Throw, path: Path_, **style: Any) -> None:
    t = np.union1d(np.linspace(0, throw.duration, POINTS), path[0])
    axes.plot(t, throw.path(*path, t), **style)


def _draw_errors(axes: Any, errors: Mapping[str, Sequence[float]]) -> None:
    for (label, values), colour, width in zip(errors.items(), (BLUE, RED), (3, 1.5), strict=False):
        axes.semilogy(np.maximum(values, LEAST), color=colour, linewidth=width, marker="o", markersize=3, label=label)
    axes.set_title("largest error of a contact's time, in s", loc="left", fontsize=11)
    axes.set_xlabel("step", color=GREY)
    axes.legend(frameon=False, fontsize=9)
    axes.grid(axis="y", color=LIFT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY)
