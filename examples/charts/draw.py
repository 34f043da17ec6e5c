"""The chart's pictures: a panel a region, and one of the medians over the regions; a method has the same colour and mark everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from teg.examples.charts.measure import QUANTITIES, SERIES, Point
from teg.examples.charts.regions import INSIDE, REGIONS

STYLES: dict[str, tuple[str, str]] = {  # the colours of Okabe and Ito, distinguishable by the colour-blind; marks
    "auto": ("#0072B2", "o"),
    "gauss": ("#56B4E9", "s"),
    "midpoint": ("#5A5A5A", "x"),
    "montecarlo": ("#A8A8A8", "+"),
    "qmc": ("#009E73", "D"),
    "midpoint-differences": ("#5A5A5A", "x"),
    "montecarlo-differences": ("#A8A8A8", "+"),
    "qmc-differences": ("#009E73", "D"),
    "dblquad": ("#D55E00", "^"),
    "split": ("#000000", "*"),
    "cubature": ("#E69F00", "v"),
    "vegas": ("#CC79A7", "P"),
}
INK, FAINT, REGION = "#333333", "#E6E8EB", "#B9C6D3"
LEAST, MOST = 1e-17, 3.0
"""The range of errors on the axis. Smaller ones, and 0, are drawn at its foot."""
THUMBNAIL = 160
AXES: dict[str, tuple[str, tuple[float, float], Callable[[Point], float | None]]] = {
    "time": ("time of one call from Python, s", (4e-7, 4.0), lambda p: p.seconds),
    "evaluations": ("evaluations of the integrand", (3.0, 1e8), lambda p: p.evaluations),
}
BATCH = "Teg, to a tolerance, one of a batch"
NEAR = 1e-9
"""Curves that end below this have their names at their ends."""
ROOM = 40
"""The axis is longer by this factor where names stand beside the curves."""


def draw_all(folder: Path, points: Sequence[Point]) -> list[Path]:
    """Draws all pictures for which there are points, and returns their paths."""
    drawn = [folder / "summary.png"]
    draw_summary(drawn[0], points)
    for quantity in QUANTITIES:
        for axis in AXES:
            path = folder / f"{quantity}-{axis}.png"
            draw_regions(path, [p for p in points if p.quantity == quantity], quantity, axis)
            drawn.append(path)
    return drawn


def draw_regions(path: Path, points: Sequence[Point], quantity: str, axis: str) -> None:
    """Draws two rows of five panels."""
    figure = _figure((17, 8))
    panels = figure.subplots(2, 5, sharex=True, sharey=True)
    handles: dict[str, Any] = {}
    for i, (region, panel) in enumerate(zip(REGIONS, panels.flat, strict=True)):
        _axes(panel, axis)
        panel.set_title(region, fontsize=12, color=INK, loc="left")
        for method in SERIES:
            line = _curve(panel, [p for p in points if (p.region, p.method) == (region, method)], method, axis)
            if line is not None:
                handles[method] = line
                if method == "auto" and axis == "time":
                    handles[BATCH] = _batch_curve(panel, [p for p in points if (p.region, p.method) == (region, method)])
        _thumbnail(panel, region)
        if i >= 5:
            panel.set_xlabel(AXES[axis][0], color=INK)
        if i % 5 == 0:
            panel.set_ylabel("relative error", color=INK)
    shown = [m for m in [BATCH, *SERIES] if handles.get(m)]
    names = [SERIES[m].name(quantity) if m in SERIES else m for m in shown]
    figure.legend([handles[m] for m in shown], names, loc="outside lower center", ncols=7, frameon=False)
    what = "value of ∫∫ exp(x)·cos(y) over the region" if quantity == "value" else "gradient by the region's parameters"
    others = "" if quantity == "value" else "; other packages, and dashed curves, by central differences with their best step"
    figure.suptitle(f"{what}: error against {axis}{others}", fontsize=14, color=INK, x=0.012, ha="left")
    figure.savefig(path)


def draw_summary(path: Path, points: Sequence[Point]) -> None:
    """Draws the medians over the regions of error and cost at each setting: value and gradient, against time and evaluations."""
    figure = _figure((15, 9.5))
    panels = figure.subplots(2, 2, sharey=True)
    for row, quantity in zip(panels, QUANTITIES, strict=True):
        for panel, axis in zip(row, AXES, strict=True):
            _axes(panel, axis)
            panel.set_xlim(AXES[axis][1][0], ROOM * AXES[axis][1][1])
            ends = []
            for method in SERIES:
                middle = _medians([p for p in points if (p.quantity, p.method) == (quantity, method)], axis)
                line = _curve(panel, middle, method, axis)
                if line is not None:
                    x, error = (float(v) for v in line.get_xydata()[-1])
                    ends.append((SERIES[method].name(quantity), STYLES[method][0], x, error))
                if method == "auto" and axis == "time" and (batch := _batch_curve(panel, middle)) is not None:
                    panel.annotate("in a\nbatch ", batch.get_xydata()[0], ha="right", va="center", **_bold(STYLES[method][0]))
            _direct_labels(panel, ends)
            panel.set_title(f"{quantity}, against {axis}", fontsize=12, color=INK, loc="left")
    for panel, axis in zip(panels[-1], AXES, strict=True):
        panel.set_xlabel(AXES[axis][0], color=INK)
    for panel in panels[:, 0]:
        panel.set_ylabel("relative error", color=INK)
    title = "∫∫ exp(x)·cos(y) over ten regions, and its gradient: error against cost, medians over the regions"
    figure.suptitle(title, fontsize=14, color=INK, x=0.012, ha="left")
    figure.savefig(path)


def _medians(points: Sequence[Point], axis: str) -> list[Point]:
    """Returns one point for each setting that most of the regions have."""
    medians = []
    settings = sorted({p.setting for p in points})
    regions = len({p.region for p in points})
    for setting in settings:
        at_setting = [p for p in points if p.setting == setting]
        if 2 * len(at_setting) < regions or any(AXES[axis][2](p) is None for p in at_setting):
            continue
        counted = [p.evaluations for p in at_setting if p.evaluations is not None]
        error, seconds = (float(np.median([f(p) for p in at_setting])) for f in (lambda p: p.error, lambda p: p.seconds))  # type: ignore[no-untyped-call]
        evaluations = round(float(np.median(counted))) if counted else None
        batches = [p.batch_seconds for p in at_setting if p.batch_seconds is not None]
        batch = float(np.median(batches)) if batches else None
        medians.append(Point("", at_setting[0].quantity, at_setting[0].method, setting, error, seconds, evaluations, batch))
    return medians


def _figure(size: tuple[float, float]) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _axes(panel: Any, axis: str) -> None:
    from matplotlib.ticker import LogLocator, NullLocator

    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlim(*AXES[axis][1])
    panel.set_ylim(LEAST / 3, MOST)
    for ruler, ticks in ((panel.xaxis, 8), (panel.yaxis, 7)):
        ruler.set_major_locator(LogLocator(numticks=ticks))
        ruler.set_minor_locator(NullLocator())
    panel.grid(color=FAINT, linewidth=0.8)
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    panel.spines[["left", "bottom"]].set_color(INK)
    panel.tick_params(colors=INK, labelsize=9)


def _curve(panel: Any, points: Sequence[Point], method: str, axis: str) -> Any:
    """Draws a method's points, joined in the order of effort, and returns the line; None if there are none."""
    colour, mark = STYLES[method]
    width = {"auto": 1.8, "gauss": 4.0}.get(method, 1.4)
    style = {"color": colour, "marker": mark, "markersize": 8 if method in ("gauss", "split") else 5, "linewidth": width}
    style["linestyle"] = "--" if SERIES[method].differenced else "-"
    return _line(panel, points, AXES[axis][2], axis, zorder={"auto": 5, "gauss": 4}.get(method, 3), **style)


def _batch_curve(panel: Any, points: Sequence[Point]) -> Any:
    """Draws our method without the cost of a call from Python."""
    colour, mark = STYLES["auto"]
    style = {"color": colour, "marker": mark, "markersize": 5, "markerfacecolor": "white", "linewidth": 1.2, "linestyle": (0, (2, 2))}
    return _line(panel, points, lambda p: p.batch_seconds, "time", zorder=4, **style)


def _line(panel: Any, points: Sequence[Point], cost: Callable[[Point], float | None], axis: str, **style: Any) -> Any:
    drawn = [(c, p.error) for p in sorted(points, key=_effort) if (c := cost(p)) is not None and math.isfinite(p.error)]
    if not drawn:
        return None
    xs, errors = zip(*drawn, strict=True)
    return panel.plot(np.maximum(xs, AXES[axis][1][0]), np.clip(errors, LEAST, None), clip_on=False, **style)[0]


def _effort(p: Point) -> float:
    """Returns the effort of a point: settings below 1 are tolerances, the others numbers of points."""
    return 1 / p.setting if p.setting < 1 else p.setting


def _direct_labels(panel: Any, ends: Sequence[tuple[str, str, float, float]]) -> None:
    """Writes names beside the ends of curves. Names close to each other in a column are moved apart, with lines to the ends."""
    if not ends:
        return
    rise = math.log10(MOST) - math.log10(LEAST / 3)
    column = 2.2 * max(x for _, _, x, _ in ends)
    height = np.array([math.log10(max(error, LEAST)) for _, _, _, error in ends])
    order = np.argsort(height, kind="stable")
    for _ in range(200):
        for i, j in pairwise(order):
            overlap = rise / 22 - (height[j] - height[i])
            if overlap > 1e-9:
                height[i] -= overlap / 2
                height[j] += overlap / 2
    for (label, colour, x, error), level in zip(ends, height, strict=True):
        near = error < NEAR
        place = (1.9 * x if near else column, 10**level)
        if not near:
            panel.plot([x * 1.15, column * 0.9], [error, 10**level], color=colour, linewidth=0.6, alpha=0.7, zorder=2)
        panel.annotate(label, place, ha="left", va="center", **_bold(colour))


def _bold(colour: str) -> dict[str, Any]:
    return {"color": colour, "fontsize": 10, "fontweight": "bold", "zorder": 6}


def _thumbnail(panel: Any, region: str) -> None:
    """Draws the region, small, in the corner without curves."""
    centres = (np.arange(THUMBNAIL) + 0.5) / THUMBNAIL
    x, y = np.meshgrid(centres, centres)
    inside = INSIDE[region](x, y, **REGIONS[region].parameters)
    small = panel.inset_axes((0.72, 0.04, 0.26, 0.28))
    small.contourf(x, y, np.asarray(inside, dtype=float), levels=[0.5, 2], colors=[REGION])
    small.set_xticks([])
    small.set_yticks([])
    small.set_aspect("equal")
    small.set_xlim(0, 1)
    small.set_ylim(0, 1)
    for spine in small.spines.values():
        spine.set_color(INK)
        spine.set_linewidth(0.6)
