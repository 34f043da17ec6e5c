"""Pictures of a search: the paths in the plane, the energy over time, the Newton steps; and an animation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as File
from typing import Any

import numpy as np

from teg.examples.animation import write_animation
from teg.examples.billiards.newton import Search
from teg.examples.billiards.paths import Path, energies, paths
from teg.examples.billiards.table import Flight, Scene

COLOURS = ("#2b6cb0", "#c2412d", "#d69e2e", "#3f8f5f", "#7b4fa3", "#666666")
FELT, GREY = "#eef3ee", "#666666"
LEAST = 1e-17  # a step of 0 is drawn at this value


def draw_sheet(file: File, scene: Scene, flight: Flight, found: Mapping[str, Search]) -> None:
    """Draws the paths of each search, their energies over time, and the sizes of the Newton steps."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6.5 * len(found), 9.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    places = figure.add_gridspec(3, len(found), height_ratios=(2.2, 1, 1))
    panels, top, tall = [], 0.0, 0.0
    for k, (label, search) in enumerate(found.items()):
        axes, energy = figure.add_subplot(places[0, k]), figure.add_subplot(places[1, k])
        own = paths(scene, flight, search.z)
        _draw_table(axes, scene, [*own, *paths(scene, flight, flight.unknowns)])
        for i, path in enumerate(own):
            _draw_path(axes, scene, i, path)
        off = float(np.abs(search.z - flight.unknowns).max())
        axes.set_title(f"{label}: contacts off by {off:.0e}" if off < 1e-3 else f"{label}: contacts off by {off:.2f}", fontsize=11)
        tall = max(tall, float(np.clip(5.8 * _shape(axes), 1.2, 5)))
        panels.append(energy)
        top = max(top, _draw_energies(energy, scene, own))
    for panel in panels:
        panel.set_ylim(0, 1.08 * top)
    places.set_height_ratios((tall + 1.2, 2.2, 2.2))
    figure.set_size_inches(6.5 * len(found), tall + 6.8)
    axes = figure.add_subplot(places[2, :])
    for (label, search), colour, style in zip(found.items(), COLOURS, ("solid", (0, (3, 1.5))), strict=False):
        steps = np.maximum(search.steps, LEAST)
        look: Any = {"color": colour, "linewidth": 2, "linestyle": style, "marker": "o", "markersize": 4}
        axes.semilogy(np.arange(1, len(steps) + 1), steps, label=label, **look)
    axes.set_title("largest entry of a Newton step, in s, m and radians", loc="left", fontsize=11)
    axes.set_xlabel("step", color=GREY)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(file)


def draw_animation(file: File, scene: Scene, found: list[Path]) -> None:
    """Draws the balls on their paths as a GIF, with the way they have come."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    figure = Figure(figsize=(5, 3.4), dpi=100, layout="constrained")
    axes = figure.add_subplot()
    _draw_table(axes, scene, found)
    axes.set(xlabel="", ylabel="", xticks=[], yticks=[])
    figure.set_size_inches(5, float(np.clip(5 * _shape(axes), 1.5, 6)) + 0.1)
    disks = [Circle((0, 0), ball.radius, color=c, zorder=3) for ball, c in zip(scene.balls, COLOURS, strict=False)]
    for disk in disks:
        axes.add_patch(disk)
    trails = [axes.plot([], [], color=c, linewidth=1.5, alpha=0.6)[0] for c in COLOURS[: len(disks)]]

    def update(now: float) -> None:
        for disk, trail, path in zip(disks, trails, found, strict=True):
            before = np.union1d(np.linspace(0, now, 100), path.knots[path.knots[:, 0] < now, 0])
            way = path.place(before)
            disk.set_center(tuple(way[-1]))
            trail.set_data(*way.T)

    write_animation(file, figure, update, scene.duration)


def _shape(axes: Any) -> float:
    """Returns height over width of what axes show."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    return float((high - low) / (right - left))


def _draw_table(axes: Any, scene: Scene, found: list[Path]) -> None:
    """Draws the walls; sets limits that contain all paths."""
    t = np.linspace(0, scene.duration, 400)
    reach = max(ball.radius for ball in scene.balls)
    places = np.concatenate([path.place(t) for path in found])
    limits = []
    for axis, (low, high) in enumerate(scene.walls):
        least, most = places[:, axis].min() - 1.6 * reach, places[:, axis].max() + 1.6 * reach
        limits.append((least if low is None else low - 0.4 * reach, most if high is None else high + 0.4 * reach))
    for axis, walls in enumerate(scene.walls):
        ends = [limit if wall is None else wall for wall, limit in zip(scene.walls[1 - axis], limits[1 - axis], strict=True)]
        for wall in walls:
            if wall is not None:
                line = ([wall, wall], ends) if axis == 0 else (ends, [wall, wall])
                axes.plot(*line, color="black", linewidth=2.5, solid_capstyle="projecting")
    axes.set(aspect="equal", xlim=limits[0], ylim=limits[1], facecolor=FELT)
    axes.set_xlabel("x in m", color=GREY)
    axes.set_ylabel("y in m", color=GREY)
    axes.spines[:].set_visible(False)
    axes.tick_params(colors=GREY)


def _draw_path(axes: Any, scene: Scene, i: int, path: Path) -> None:
    """Draws a path, and the ball at its start (pale), its contacts (a ring) and its end."""
    from matplotlib.patches import Circle

    ball, colour = scene.balls[i], COLOURS[i % len(COLOURS)]
    axes.plot(*path.place(np.union1d(np.linspace(0, scene.duration, 600), path.knots[:, 0])).T, color=colour, linewidth=1.8)
    for k, (_, x, y) in enumerate(path.knots):
        inside = {"facecolor": colour, "alpha": 0.25} if k == 0 else {"facecolor": colour} if k == len(path.knots) - 1 else {"fill": False}
        axes.add_patch(Circle((x, y), ball.radius, edgecolor=colour, linewidth=1.2, **inside))


def _draw_energies(axes: Any, scene: Scene, found: list[Path]) -> float:
    """Draws the energies on each other; returns the largest sum."""
    t = np.linspace(0, scene.duration, 1200)
    rows = energies(scene, found, t)
    axes.stackplot(t, rows, colors=COLOURS[: len(rows)], alpha=0.75, linewidth=0)
    axes.plot(t, rows.sum(axis=0), color="black", linewidth=1.5)
    axes.set_title("energy of each ball, and of all, in J", loc="left", fontsize=10)
    axes.set(xlim=(0, scene.duration))
    axes.set_xlabel("time in s", color=GREY)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY)
    return float(rows.sum(axis=0).max())
