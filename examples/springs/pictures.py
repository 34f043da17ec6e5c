"""The picture of a design: stress curves and falls before and after, the violation of the constraints and the loss on the way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from teg.examples.springs.design import WALL, Jump, Optimum, violation
from teg.examples.springs.scene import GRAVITY

COLOURS = ("#2b6cb0", "#c2412d", "#d69e2e")
GREY, LIGHT, BROWN = "#666666", "#d5dae1", "#8a6d4b"
LEAST = 1e-17  # a violation of 0 is drawn at this value


def draw_sheet(path: Path, jump: Jump, start: np.ndarray, found: dict[str, Optimum]) -> None:
    """Draws force against way, height against time, and the violation and the loss after each step."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 8), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    (stress, fall), (broken, loss) = figure.subplots(2, 2, height_ratios=(1.6, 1))
    designs = {"before": start, **{label: optimum.design for label, optimum in found.items()}}
    looks = [{"color": GREY, "linestyle": (0, (4, 3)), "linewidth": 1.6}, *({"color": c, "linewidth": 2.2} for c in COLOURS)]
    looks[-1] |= {"linestyle": (0, (1, 1.5)), "linewidth": 3}
    for (label, design), look in zip(designs.items(), looks, strict=False):
        _draw_design(stress, fall, jump, design, {**look, "label": label})
    weight = jump.mass * GRAVITY
    stress.axhline(weight, color=LIGHT, linewidth=2, zorder=0)
    stress.annotate("weight of the jumper", (0.01 * jump.apex, weight), (0, 4), textcoords="offset points", color=GREY, fontsize=9)
    stress.set(xlabel="way fallen in m", ylabel="force of the cords in N", xlim=(0, 1.12 * jump.apex), ylim=(0, None))
    stress.axvline(jump.apex, color=BROWN, linewidth=1, linestyle=":")
    fall.axhline(0, color=BROWN, linewidth=3)
    fall.annotate("ground", (0.02, 0), (0, 5), textcoords="offset points", color=BROWN, fontsize=9)
    fall.set(xlabel="time in s", ylabel="height in m", xlim=(0, None))
    for (_, optimum), look in zip(found.items(), looks[1:], strict=False):
        broken.semilogy([max(violation(v), LEAST) for v in optimum.outcomes], **look)
        loss.semilogy([v[0] if v[0] < WALL / 2 else np.nan for v in optimum.outcomes], marker="o", markersize=2.5, **look)
    broken.set_title("largest violation of a constraint, relative", loc="left", fontsize=11)
    loss.set_title("loss", loc="left", fontsize=11)
    for axes in (broken, loss):
        axes.set(xlabel="step", xscale="symlog", xlim=(0, None))
    for axes in (stress, fall, broken, loss):
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(colors=GREY)
    figure.legend(*stress.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    figure.savefig(path)


def _draw_design(stress: Any, fall: Any, jump: Jump, design: np.ndarray, look: dict[str, Any]) -> None:
    flight = jump.simulated(design)
    way = np.linspace(0, flight["way"][-1], 2000)
    force = jump.stress(design, way)
    stress.plot(way, force, **look)
    fall.plot(flight["time"], jump.apex - flight["way"], **look)
    for axes, end in ((stress, (way[-1], force[-1])), (fall, (flight["time"][-1], jump.apex - way[-1]))):
        axes.plot(*end, "o", color=look["color"], markersize=6)
