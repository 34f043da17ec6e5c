"""Draw the pictures of docs/surfaces.md, from what the compiled programs do: `python docs/draw_surfaces.py [NAME …]`.

`python docs/draw_surfaces.py --table` draws nothing and prints the table of errors instead.

Left, the value: the region, the breaks of the outer integral as dashed lines, and for each of its nodes the pieces of the inner integral
with their nodes. Right, the derivative by t: the points of the boundary integrals, one colour a chart, the larger the heavier.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from PIL import Image
from recorded_run import Mark, Piece, RecordedRun
from surface_families import FAMILIES, LINES, Family, Numbers
from surface_runs import gradient_run, table, value_run

mpl.use("Agg")
from matplotlib import pyplot as plt

OUT = Path(__file__).parent / "surfaces"
REGION, EDGE, BREAK, NODE = "#d6e6f5", "#33658a", "#8a8f98", "#16324f"
CHARTS = {"": "#e4572e", "x": "#e4572e", "y": "#7b4fa3", "z": "#2a9d6f"}
DPI = 110


# -- pictures ------------------------------------------------------------------------------------------------------------


def draw(family: Family) -> None:
    """One picture of two panels."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 3.75), dpi=DPI)
    run = gradient_run(family)
    family = _in_a_slice_with_points(family, run)
    (x0, x1), (y0, y1) = family.box
    grid = np.meshgrid(np.linspace(x0, x1, 600), np.linspace(y0, y1, 600))
    levels = family.surfaces(Numbers, *grid, *family.values.values(), **family.slices)
    for axes, title in ((left, "value"), (right, "derivative by t")):
        axes.contourf(*grid, np.minimum.reduce(levels), levels=[0.0, np.inf], colors=[REGION])
        axes.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal", xticks=[], yticks=[])
        axes.set_title(title, fontsize=9, color=NODE, pad=4, loc="left")
        for spine in axes.spines.values():
            spine.set(color=BREAK, linewidth=0.8)
    left.contour(*grid, np.minimum.reduce(levels), levels=[0.0], colors=[EDGE], linewidths=1.1)
    right.contour(*grid, np.minimum.reduce(levels), levels=[0.0], colors=[EDGE], linewidths=0.7)
    depth = len(family.slices)
    _draw_value(left, family, [p for p in value_run(family).pieces if len(p.around) >= depth], depth)
    print(f"{family.name}: {len(run.pieces)} pieces, {len(run.marks)} points of the derivative")
    _draw_gradient(right, family, run)
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.02, top=0.92, wspace=0.04)
    _save(figure, family.name)


def _in_a_slice_with_points(family: Family, run: RecordedRun) -> Family:
    """The family, sliced where there are points of the derivative nearest to the slice wanted."""
    if not family.slices or any(_is_in_slice(family, m) for m in run.marks):
        return family
    (wanted,) = family.slices.values()
    nearest = min((m.around[0] for m in run.marks if m.around), key=lambda v: abs(v - wanted))
    return replace(family, slices=dict.fromkeys(family.slices, nearest))


def _draw_value(axes: Any, family: Family, pieces: Sequence[Piece], depth: int) -> None:
    if depth:  # the slice that is nearest to the one wanted
        (wanted,) = family.slices.values()
        nearest = min((p.around[0] for p in pieces), key=lambda v: abs(v - wanted))
        pieces = [p for p in pieces if p.around[0] == nearest]
    outer = [p for p in pieces if len(p.around) == depth]
    for p in outer:
        for end in (p.p, p.q):
            if end not in family.box[1]:
                axes.axhline(end, color=BREAK, linewidth=0.7, dashes=(4, 3), zorder=1)
    inner = [p for p in pieces if len(p.around) == depth + 1 and p.nodes]
    for p in inner:
        axes.plot([p.p, p.q], [p.around[-1]] * 2, color=EDGE, linewidth=0.5, alpha=0.55)
    dots = [(v, p.around[-1]) for p in inner for v in p.nodes]
    size = 14.0 if len(dots) < 40 else 4.0 if len(dots) < 200 else 1.6
    axes.scatter(*zip(*dots, strict=True), s=size, color=NODE, linewidths=0, zorder=3)


def _draw_gradient(axes: Any, family: Family, run: RecordedRun) -> None:
    marks = [m for m in run.marks if m.around]  # not those of terms that are no integral
    if family.slices:
        marks = [m for m in marks if _is_in_slice(family, m)]
    heaviest = max(m.weight for m in marks)
    marks = [m for m in marks if m.weight > 1e-4 * heaviest]
    by_angle = 4 * len({m.around for m in marks}) <= len(marks)  # all points of a node of an angle, none of which is a coordinate
    charts: dict[str, list[Mark]] = {}
    for m in marks:
        charts.setdefault("" if by_angle else _eliminated(family, m), []).append(m)
    for name, mine in sorted(charts.items()):
        size = [(30.0 if len(marks) < 100 else 12.0) * max(0.2, m.weight / heaviest) for m in mine]
        label = name
        axes.scatter([m.x for m in mine], [m.y for m in mine], s=size, color=CHARTS[name], linewidths=0, zorder=3, label=label)
    if any(charts):
        axes.set_title("derivative by t, eliminating", fontsize=9, color=NODE, pad=4, loc="left")
        legend = axes.legend(
            loc="lower left", bbox_to_anchor=(0.52, 0.99), ncols=3, frameon=False, fontsize=9, handletextpad=0.0, columnspacing=0.6,
            borderpad=0.0, labelcolor=NODE, scatterpoints=1, scatteryoffsets=[0.45],
        )  # fmt: skip
        for handle in legend.legend_handles:
            handle.set_sizes([28.0])


def _eliminated(family: Family, m: Mark) -> str:
    """The variable that is none of those integrated over; "" if all are points of a line."""
    gone = [name for name, v in (("x", m.x), ("y", m.y)) if not any(abs(v - u) < 1e-9 for u in m.around)]
    return gone[0] if len(gone) == 1 else "" if gone else "z"


def _is_in_slice(family: Family, m: Mark) -> bool:
    """Is a point of the surface as high as the slice that is drawn?"""
    return all(abs(g) < 0.01 for g in family.surfaces(Numbers, m.x, m.y, *family.values.values(), **family.slices))


def draw_lines(families: Sequence[Family], name: str) -> None:
    """Surfaces in one variable: g, the pieces and nodes of the integral, and where g = 0."""
    figure, panels = plt.subplots(1, len(families), figsize=(7.4, 2.9), dpi=DPI)
    for axes, family in zip(panels, families, strict=True):
        lo, hi = family.box[0]
        xs = np.linspace(lo, hi, 800)
        g = family.surfaces(Numbers, xs, 0.0, *family.values.values())[0]
        top = 1.15 * np.abs(g).max()
        axes.fill_between(xs, -top, top, where=g > 0, color=REGION, linewidth=0)
        axes.axhline(0.0, color=BREAK, linewidth=0.8)
        axes.plot(xs, g, color=EDGE, linewidth=1.2)
        run = value_run(family)
        for p in run.pieces:
            for end in (p.p, p.q):
                if end not in (lo, hi):
                    axes.axvline(end, color=BREAK, linewidth=0.7, dashes=(4, 3))
            axes.scatter(p.nodes, [0.0] * len(p.nodes), s=14, color=NODE, linewidths=0, zorder=3)
        found = [m for m in gradient_run(family).marks if m.weight > 0]
        axes.scatter([m.x for m in found], [0.0] * len(found), s=34, color=CHARTS[""], linewidths=0, zorder=4)
        axes.set(xlim=(lo, hi), ylim=(-top, top), xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set(color=BREAK, linewidth=0.8)
    figure.tight_layout(pad=0.4, w_pad=1.2)
    _save(figure, name)


def _save(figure: Any, name: str) -> None:
    OUT.mkdir(exist_ok=True)
    path = OUT / f"{name}.png"
    figure.savefig(path)
    plt.close(figure)
    with Image.open(path) as image:
        image.convert("RGB").save(path, optimize=True)


def main() -> None:
    """Draw the pictures with these names, all if there are none; or print the table."""
    arguments = argparse.ArgumentParser(description="the pictures and the table of docs/surfaces.md")
    arguments.add_argument("names", nargs="*", metavar="NAME", help="pictures to draw; all if there are none")
    arguments.add_argument("--table", action="store_true", help="print the errors of values and derivatives instead")
    chosen = arguments.parse_args()
    if chosen.table:
        print(table())
        return
    for family in FAMILIES:
        if not chosen.names or family.name in chosen.names:
            draw(family)
    if not chosen.names or "one-variable" in chosen.names:
        draw_lines(LINES, "one-variable")


if __name__ == "__main__":
    main()
