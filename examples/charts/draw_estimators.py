"""The pictures of the chart of estimators; an estimator has the same colour and mark everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from teg.examples.charts.draw import FAINT, INK, _figure
from teg.examples.charts.estimators import SWEEPS, Point, middle_and_worst
from teg.examples.charts.scenes import SCENES

STYLES: dict[str, tuple[str, str, str]] = {  # the colours of Okabe and Ito; marks; dashes for a variant of an estimator
    "exact": ("#0072B2", "o", "-"),
    "edge-mc": ("#009E73", "D", "-"),
    "edge-qmc": ("#009E73", "D", "--"),
    "edge-tree": ("#009E73", "D", ":"),
    "warp": ("#D55E00", "^", "-"),
    "warp-4": ("#D55E00", "^", "--"),
    "warp-blur": ("#E69F00", "v", "-"),
    "smooth": ("#CC79A7", "s", "-"),
    "smooth-grid": ("#CC79A7", "s", "--"),
    "differences": ("#5A5A5A", "x", "-"),
    "spsa": ("#A8A8A8", "+", "-"),
    "ignore": ("#000000", "*", "-"),
}
LEAST, MOST = 1e-17, 30.0
MACHINE = 2.0**-52 * 10
"""The band at the foot of the charts: within some rounding errors of the exact gradient."""
AXES: dict[str, tuple[str, Callable[[Point], float]]] = {
    "time": ("time of one call, s", lambda p: p.seconds),
    "evaluations": ("evaluations of the integrand", lambda p: float(p.evaluations)),
}


def draw_all(folder: Path, points: Sequence[Point]) -> list[Path]:
    """Draws the scenes and the summary, and returns their paths."""
    drawn = [folder / "summary.png", folder / "scenes.png"]
    _draw_summary(drawn[0], points)
    _draw_scenes(drawn[1], points)
    return drawn


def _draw_scenes(path: Path, points: Sequence[Point]) -> None:
    """Draws two rows for each axis, a panel for each scene."""
    scenes = [s for s in SCENES if any(p.scene == s for p in points)]
    columns = -(-len(scenes) // 2)
    figure = _figure((4.2 * columns, 15))
    panels = figure.subplots(4, columns, sharey=True, squeeze=False)
    for i, axis in enumerate(AXES):
        for panel, scene in zip(panels[2 * i : 2 * i + 2].flat, scenes, strict=False):
            _axes(panel, axis)
            panel.set_title(scene, fontsize=12, color=INK, loc="left")
            for method in SWEEPS:
                _curve(panel, [p for p in points if (p.scene, p.method) == (scene, method)], method, axis)
    for panel in panels.flat:
        panel.set_visible(bool(panel.lines))
    for row in panels:
        row[0].set_ylabel("error of the gradient, relative", color=INK)
    _finish(figure, panels[0][0], path, "Estimators of derivatives across jumps: error against cost, scene by scene")


def _draw_summary(path: Path, points: Sequence[Point]) -> None:
    """Draws the medians over the scenes, and the worst scene."""
    figure = _figure((13, 9.5))
    panels = figure.subplots(2, 2, sharey=True)
    for row, (i, what) in zip(panels, ((0, "median of the scenes"), (1, "worst scene")), strict=True):
        for panel, axis in zip(row, AXES, strict=True):
            _axes(panel, axis)
            panel.set_title(f"{what}, against {axis}", fontsize=12, color=INK, loc="left")
            for method in SWEEPS:
                _curve(panel, [pair[i] for pair in middle_and_worst(points, method)], method, axis)
        row[0].set_ylabel("error of the gradient, relative", color=INK)
    _finish(figure, panels[0][0], path, "Estimators of derivatives across jumps: error against cost")


def _axes(panel: Any, axis: str) -> None:
    from matplotlib.ticker import LogLocator, NullLocator

    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_ylim(LEAST / 3, MOST)
    panel.axhspan(LEAST / 3, MACHINE, color=FAINT, zorder=0)
    panel.yaxis.set_major_locator(LogLocator(numticks=7))
    panel.xaxis.set_minor_locator(NullLocator())
    panel.yaxis.set_minor_locator(NullLocator())
    panel.grid(color=FAINT, linewidth=0.8)
    panel.spines[["top", "right"]].set_visible(False)
    panel.set_xlabel(AXES[axis][0], color=INK)
    panel.tick_params(colors=INK, labelsize=9)


def _curve(panel: Any, points: Sequence[Point], method: str, axis: str) -> None:
    """Draws the points of an estimator, joined in the order of effort."""
    drawn = [(AXES[axis][1](p), min(max(p.error, LEAST), MOST)) for p in points if not math.isnan(p.error)]
    if not drawn:
        return
    colour, mark, dashes = STYLES[method]
    style = {"color": colour, "marker": mark, "linestyle": dashes, "markersize": 6, "linewidth": 1.5, "clip_on": False}
    panel.plot(*zip(*drawn, strict=True), label=SWEEPS[method].label, zorder=5 if method == "exact" else 3, **style)


def _finish(figure: Any, panel: Any, path: Path, title: str) -> None:
    handles, labels = panel.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(6, int(figure.get_figwidth() / 3)), frameon=False)
    figure.suptitle(title, fontsize=14, color=INK, x=0.012, ha="left")
    figure.savefig(path)
