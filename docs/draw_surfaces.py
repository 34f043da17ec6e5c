"""Draw the pictures of docs/surfaces.md, from what the compiled programs do: `python docs/draw_surfaces.py [NAME …]`.

Left, the value: the region, the breaks of the outer integral as dashed lines, and for each of its nodes the pieces of the inner integral
with their nodes. Right, the derivative by t: the points of the boundary integrals, one colour a chart, the larger the heavier.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from PIL import Image
from recorded_run import SHIFT, Mark, Piece, RecordedRun, integrals_of

import teg
from teg.expr import Expr
from teg.pipeline import compiled_outputs, flatten, program_for
from teg.program import Program, Stmt, blocks

mpl.use("Agg")
from matplotlib import pyplot as plt

OUT = Path(__file__).parent / "surfaces"
TOL = 1e-4
REGION, EDGE, BREAK, NODE = "#d6e6f5", "#33658a", "#8a8f98", "#16324f"
CHARTS = {"": "#e4572e", "x": "#e4572e", "y": "#7b4fa3", "z": "#2a9d6f"}
DPI = 110

x, y, z = teg.vars("x y z")
Surfaces = Callable[..., Sequence[Any]]


@dataclass(frozen=True)
class Family:
    """A region {all surfaces > 0} in a box; `surfaces(m, x, y, …)` computes with the functions of m, those of teg or of numbers."""

    name: str
    surfaces: Surfaces
    values: dict[str, float]
    box: tuple[tuple[float, float], tuple[float, float]] = ((-1.0, 1.0), (-1.0, 1.0))
    slices: dict[str, float] = field(default_factory=dict)  # a third variable, integrated over (-1, 1): the slice that is drawn


class Numbers:
    """The functions of the language for arrays."""

    abs, sin, cos, exp, mod = np.abs, np.sin, np.cos, np.exp, np.mod


def _triangle(m: Any, x: Any, y: Any, t: Any) -> list[Any]:
    corners = [(-0.8, -0.7), (0.75, -0.45), (t, 0.8)]
    edges = zip(corners, [*corners[1:], corners[0]], strict=True)
    return [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for (ax, ay), (bx, by) in edges]


def _bilinear(m: Any, x: Any, y: Any, t: Any) -> list[Any]:
    return [(0.9 * (1 - x) + -0.7 * x) * (1 - y) + (-0.8 * (1 - x) + 0.6 * x) * y - t]


def _polygon(m: Any, x: Any, y: Any, t: Any) -> list[Any]:
    centres = ((-0.5, -0.2), (0.3, -0.4), (0.2, 0.5))
    return [t - sum(m.abs(x - a) + m.abs(y - b) for a, b in centres)]


UNIT = ((0.0, 1.0), (0.0, 1.0))
FAMILIES = (
    Family("half-plane", lambda m, x, y, t, a: [t - (x + a * y)], {"t": 0.9, "a": 0.6}, UNIT),
    Family("triangle", _triangle, {"t": -0.2}),
    Family("graph", lambda m, x, y, t: [y - (0.6 * m.sin(3 * x) + t)], {"t": 0.1}),
    Family("parabola", lambda m, x, y, t: [t + 1.2 * x - 2 * y * y], {"t": 0.3}),
    Family("bilinear", _bilinear, {"t": 0.02}, UNIT),
    Family("disk", lambda m, x, y, t: [t - ((x - 0.1) ** 2 + (y + 0.05) ** 2)], {"t": 0.6}),
    Family("ellipse", lambda m, x, y, t: [t - (x * x + 1.2 * x * y + 1.4 * y * y)], {"t": 0.45}),
    Family("hyperbola", lambda m, x, y, t: [t - (x * x + 0.6 * x * y - y * y)], {"t": 0.15}),
    Family("lines", lambda m, x, y, t: [(x - t) ** 2 - 0.5 * y * y], {"t": 0.15}),
    Family("stripes", lambda m, x, y, t: [0.5 - m.mod(3 * x + y + t, 1)], {"t": 0.2}, UNIT),
    Family("superellipse", lambda m, x, y, t: [t - (x**4 + y**4)], {"t": 0.5}),
    Family("heart", lambda m, x, y, t: [t * x * x * y**3 - (x * x + y * y - t * t) ** 3], {"t": 1.0}, ((-1.4, 1.4), (-1.25, 1.55))),
    Family("polygon", _polygon, {"t": 3.0}),
    Family("sphere", lambda m, x, y, t, z: [t - (x * x + y * y + z * z)], {"t": 0.8}, slices={"z": 0.45}),
)
LINES = (
    Family("cubic", lambda m, x, y, t: [t - (x**3 - 0.6 * x)], {"t": 0.06}),
    Family("wave", lambda m, x, y, t: [t - m.sin(7 * x)], {"t": 0.45}),
)


# -- what the programs do ------------------------------------------------------------------------------------------------


def _integral(family: Family, integrand: Any, variables: Sequence[Expr]) -> tuple[Expr, list[Expr]]:
    """The integral over the region, and the parameters."""
    parameters = [teg.param(k) for k in family.values]
    others = {k: {"z": z}[k] for k in family.slices}
    inside = [g > 0 for g in family.surfaces(teg, x, y, *parameters, **others)]
    for c in inside:
        integrand = teg.bracket(c) * integrand
    ranges = [(v, *b) for v, b in zip(variables, family.box, strict=False)]
    return teg.integral(integrand, *ranges, *((v, -1, 1) for v in others.values())), parameters


def value_run(family: Family, variables: Sequence[Expr]) -> RecordedRun:
    """The program of the area, run."""
    e, parameters = _integral(family, 1, variables)
    f = teg.compile(e, parameters, tol=TOL)
    run = RecordedRun(f.program(0), family.values)
    if not math.isclose(run.outputs[0], f(family.values), rel_tol=1e-9):
        raise AssertionError(f"{family.name}: {run.outputs[0]} is not {f(family.values)}")
    return run


def gradient_run(family: Family, variables: Sequence[Expr]) -> RecordedRun:
    """The program of the area's derivative by t, run, with a mark at the points it looks at. The mark is no polynomial; the rules are those
    of the derivative without it."""
    mark = teg.atan2(y + SHIFT, x + SHIFT) if len(variables) == 2 else teg.atan2(SHIFT, x + SHIFT)
    programs = []
    for integrand in (1, mark):
        e, parameters = _integral(family, integrand, variables)
        gradient = compiled_outputs(e, [parameters[0]], 1, "sift")[1]
        programs.append(program_for(flatten(gradient), list(family.values), TOL))
    plain, marked = programs
    rules = [s.rule for s in integrals_of(plain)]
    if len(rules) != len(list(integrals_of(marked))):
        raise AssertionError(f"{family.name}: the mark changes the program")
    left = iter(rules)
    run = RecordedRun(Program(marked.parameters, _with_rules(marked.body, left), marked.outputs), family.values)
    exact = teg.evaluate(teg.grad(_integral(family, 1, variables)[0], parameters[0])[0], family.values)
    print(f"{family.name}: {len(run.pieces)} pieces, {len(run.marks)} points, derivative {exact:.6f}")
    return run


def _with_rules(block: tuple[Stmt, ...], rules: Any) -> tuple[Stmt, ...]:
    """The statements, their integrals (in the order of `integrals_of`) with other rules."""
    changed: list[Any] = []
    for stmt in block:
        if hasattr(stmt, "rule"):
            stmt = replace(stmt, rule=next(rules))
        inner = [_with_rules(b, rules) for b in blocks(stmt)]
        changed.append(replace(stmt, **dict(zip(_BLOCKS.get(type(stmt).__name__, ()), inner, strict=True))))
    return tuple(changed)


_BLOCKS = {"Integrate": ("flags", "body"), "Isolate": ("enclosure", "point"), "Locate": ("enclosure",), "SumOver": ("body",)}


# -- pictures ------------------------------------------------------------------------------------------------------------


def draw(family: Family) -> None:
    """One picture of two panels."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.4, 3.75), dpi=DPI)
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
    _draw_value(left, family, [p for p in value_run(family, (x, y)).pieces if len(p.around) >= depth], depth)
    _draw_gradient(right, family, gradient_run(family, (x, y)))
    figure.subplots_adjust(left=0.01, right=0.99, bottom=0.02, top=0.92, wspace=0.04)
    _save(figure, family.name)


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
    charts: dict[str, list[Mark]] = {}
    for m in marks:
        charts.setdefault(_eliminated(family, m), []).append(m)
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
        run = value_run(family, (x,))
        for p in run.pieces:
            for end in (p.p, p.q):
                if end not in (lo, hi):
                    axes.axvline(end, color=BREAK, linewidth=0.7, dashes=(4, 3))
            axes.scatter(p.nodes, [0.0] * len(p.nodes), s=14, color=NODE, linewidths=0, zorder=3)
        found = [m for m in gradient_run(family, (x,)).marks if m.weight > 0]
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


def main(names: Sequence[str]) -> None:
    """Draw the pictures with these names; all if there are none."""
    for family in FAMILIES:
        if not names or family.name in names:
            draw(family)
    if not names or "one-variable" in names:
        draw_lines(LINES, "one-variable")


if __name__ == "__main__":
    main(sys.argv[1:])
