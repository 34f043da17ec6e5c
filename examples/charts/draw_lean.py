"""The picture of `teg chart lean`: each scene beside the least known, in nanoseconds and in evaluations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from teg.examples.charts.draw import FAINT, INK, _figure
from teg.examples.charts.lean import Row

OURS, LEAST = "#0072B2", "#D55E00"


def draw(path: Path, rows: Sequence[Row]) -> Path:
    """Draws two panels with a line a scene, from the least known to ours, and returns the path."""
    figure = _figure((15, 1.6 + 0.36 * len(rows)))
    times, counts = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    places = range(len(rows), 0, -1)
    for place, row in zip(places, rows, strict=True):
        _pair(times, place, row.nanoseconds, row.least, row.measured)
        if row.ratio is not None:
            text = f"  {row.ratio:.1f} ×" if row.ratio < 10 else f"  {row.ratio:.0f} ×"
            times.annotate(text, (max(row.nanoseconds, row.least or 0.0), place), va="center", color=INK, fontsize=9)
        _pair(counts, place, row.evaluations, float(row.least_evaluations), True)
    times.set_yticks(list(places), [row.scene for row in rows])
    times.set_xscale("log")
    times.set_xlim(right=8 * max(max(r.nanoseconds, r.least or 0.0) for r in rows))
    counts.set_xscale("symlog", linthresh=1.0)
    counts.set_xlim(-0.3, 3 * max(max(r.evaluations, r.least_evaluations) for r in rows))
    times.set_xlabel("nanoseconds an element, value and gradient", color=INK)
    counts.set_xlabel("evaluations of the integrand", color=INK)
    for panel in (times, counts):
        panel.grid(axis="x", color=FAINT, linewidth=0.8)
        panel.set_axisbelow(True)
        panel.spines[["top", "right"]].set_visible(False)
        panel.tick_params(colors=INK, labelsize=9)
    marks = [_mark(times, OURS, "o", OURS), _mark(times, LEAST, "D", LEAST), _mark(times, LEAST, "D", "white")]
    names = ["this compiler, C, one thread", "by hand in C, same run", "least known, a figure"]
    figure.legend(marks, names, loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(
        "No more than a scene needs: what value and gradient take, and the least known", fontsize=14, color=INK, x=0.012, ha="left"
    )
    figure.savefig(path)
    return path


def _pair(panel: Any, place: int, ours: float, least: float | None, measured: bool) -> None:
    if least is not None:
        panel.plot([least, ours], [place, place], color="#B0B0B0", linewidth=1.4, zorder=1)
        panel.plot([least], [place], marker="D", color=LEAST, markerfacecolor=LEAST if measured else "white", markersize=6, zorder=2)
    panel.plot([ours], [place], marker="o", color=OURS, markersize=7, zorder=3)


def _mark(panel: Any, colour: str, shape: str, face: str) -> Any:
    return panel.plot([], [], marker=shape, color=colour, markerfacecolor=face, linestyle="none", markersize=7)[0]
