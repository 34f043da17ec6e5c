"""Pictures of a run: the paths in space-time, and the distance of the contacts from the true ones after each step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teg.examples.animation import write_animation
from teg.examples.bouncing_ball.throw import Throw

BLUE, RED, GOLD, GREY, LIFT = "#2b6cb0", "#c2412d", "#f2c14e", "#666666", "#eef1f5"
DASHED = (0, (3, 1.5))  # what it lies on is seen between
POINTS = 800
LEAST = 1e-17  # an error of 0 is drawn at this value

Path_ = tuple[np.ndarray, np.ndarray]


def draw_sheet(
    path: Path, throw: Throw, true: Path_, first: Path_, found: Mapping[str, Path_], errors: Mapping[str, Sequence[float]]
) -> None:
    """Draws a panel of space-time for each path found, and one of the errors. A path is (times of contacts, heights of arcs)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12 if len(found) > 1 else 8, 9.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(3, len(found), height_ratios=(2.6, 0.8, 1))
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
    _draw_energies(figure.add_subplot(places[1, :]), throw, {"true path": true, **found})
    _draw_errors(figure.add_subplot(places[2, :]), errors)
    keys = {label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(keys.values(), keys.keys(), loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    figure.savefig(path)


def draw_animation(path: Path, throw: Throw, found: Mapping[str, Path_]) -> None:
    """Draws a lift for each path, and the ball in it, as a GIF."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    figure = Figure(figsize=(1 + 1.5 * len(found), 4.2), dpi=100, layout="constrained")
    axes = figure.add_subplot()
    lowest, highest = sorted((0.0, throw.speed * throw.duration))
    margin = 0.08 * (highest - lowest + throw.room)
    axes.set(xlim=(-0.5, len(found) - 0.5), ylim=(lowest - margin, highest + throw.room + margin), xticks=range(len(found)))
    axes.set_xticklabels([label.replace("automatic ", "automatic\n") for label in found], fontsize=8)
    axes.set_ylabel("height in m", color=GREY)
    axes.spines[["top", "right", "bottom"]].set_visible(False)
    lifts = [Rectangle((k - 0.35, 0), 0.7, throw.room, facecolor=LIFT, edgecolor="black", linewidth=2) for k in range(len(found))]
    for lift in lifts:
        axes.add_patch(lift)
    balls = [axes.plot([k], [0], "o", color=c, markersize=11)[0] for k, c in zip(range(len(found)), (GOLD, BLUE, RED), strict=False)]

    def update(now: float) -> None:
        for lift, ball, arcs in zip(lifts, balls, found.values(), strict=True):
            lift.set_y(throw.speed * now)
            ball.set_ydata(throw.path(*arcs, np.array([now])))

    write_animation(path, figure, update, throw.duration)


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
    axes.set_ylim(lowest - 0.08 * span, highest + 0.08 * span)
    axes.set_xlabel("time in s", color=GREY)
    axes.set_ylabel("height in m", color=GREY)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY)


def _draw_path(axes: Any, throw: Throw, path: Path_, **style: Any) -> None:
    t = np.union1d(np.linspace(0, throw.duration, POINTS), path[0])
    axes.plot(t, throw.path(*path, t), **style)


def _draw_energies(axes: Any, throw: Throw, found: Mapping[str, Path_]) -> None:
    t = np.linspace(0, throw.duration, POINTS)
    looks: list[dict[str, Any]] = [
        {"color": GOLD, "linewidth": 7},
        {"color": BLUE, "linewidth": 2},
        {"color": RED, "linewidth": 2, "linestyle": DASHED},
    ]
    rows = [throw.energy(*arcs, t) for arcs in found.values()]
    for row, look in zip(rows, looks, strict=False):
        axes.plot(t, row, **look)
    axes.set_title("energy of the ball, seen from inside the lift, in J", loc="left", fontsize=11)
    axes.set(xlim=(0, throw.duration), ylim=(min(0.0, *(row.min() for row in rows)), 1.15 * max(row.max() for row in rows)))
    axes.set_xlabel("time in s", color=GREY)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY)


def _draw_errors(axes: Any, errors: Mapping[str, Sequence[float]]) -> None:
    for (label, values), colour, style in zip(errors.items(), (BLUE, RED), ("solid", DASHED), strict=False):
        axes.semilogy(np.maximum(values, LEAST), color=colour, linewidth=2, linestyle=style, marker="o", markersize=3, label=label)
    axes.set_title("largest error of a contact's time, in s", loc="left", fontsize=11)
    axes.set_xlabel("step", color=GREY)
    axes.grid(axis="y", color=LIFT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY)
