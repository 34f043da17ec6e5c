"""`teg chart descents`: descends what is missing, draws, writes a table. A run can be interrupted, and continues from there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from teg.evaluator.options import Backend
from teg.examples.charts import tables
from teg.examples.charts.chart_run import ChartRun, Options
from teg.examples.charts.descents import METHODS, PROBLEMS, SECONDS, Descent, descend, shown, task_of, true_picture
from teg.examples.harness import require_packages

PACKAGES = {"matplotlib": "matplotlib>=3.8", "skimage": "scikit-image", "PIL": "pillow"}
QUICK_SECONDS, QUICK_METHODS = 0.05, ("exact", "edge-mc", "ignore")
NEAR = 1.1
"""The table says when a loss came within this factor of the best end of all."""


def run_descents(out: str | Path = "out/charts", page: str | Path | None = None, **options: Unpack[Options]) -> dict[str, Any]:
    """Descents with each estimator for the same time: descents.json and two pictures in `out`, a table in `page`.

    The options are those of `teg.examples.charts.run.run_integration`.
    """
    require_packages("chart of descents", PACKAGES, options.get("progress", True), extra="all")
    run = ChartRun("descents", out, page, options)
    rows: dict[str, Any] = dict(run.stored("descents"))
    problems = PROBLEMS[1:2] if run.quick else PROBLEMS
    wanted = [(p, m) for p in problems for m in (QUICK_METHODS if run.quick else METHODS) if f"{p} | {m}" not in rows]
    with run.interruptible(), run.bar(len(wanted), "descend") as bar:
        for problem, method in wanted:
            rows[f"{problem} | {method}"] = data_of(descend(problem, method, run.backend, QUICK_SECONDS if run.quick else SECONDS))
            run.save(descents=rows)
            if bar is not None:
                bar.update()
    descents = [descent_of(row) for row in rows.values()]
    pictures = draw_all(run.folder, descents, run.backend) if descents else []
    run.write_table(descent_table(descents))
    return run.save(descents=rows) | {"pictures": [str(p) for p in pictures], "summary": summary(descents)}


def data_of(descent: Descent) -> dict[str, Any]:
    """Returns a descent as it is stored; null is no number."""
    numbers = {k: [z if math.isfinite(z) else None for z in getattr(descent, k)] for k in ("seconds", "losses", "end")}
    return {"problem": descent.problem, "method": descent.method, **numbers}


def descent_of(row: Mapping[str, Any]) -> Descent:
    """Returns a stored descent."""
    numbers = {k: tuple(math.nan if z is None else float(z) for z in row[k]) for k in ("seconds", "losses", "end")}
    return Descent(row["problem"], row["method"], **numbers)


def summary(descents: Sequence[Descent]) -> str:
    """Returns a line to print after a run."""
    failed = sum(d.has_failed for d in descents)
    return f"{len(descents)} descents, {failed} of which ended above their start"


def descent_table(descents: Sequence[Descent]) -> str:
    """Returns the last loss of each method on each problem, relative to the first one, and the time to near the best end."""
    problems = [p for p in PROBLEMS if any(d.problem == p for d in descents)]
    rows = [["loss at the end / at the start", *problems, "failures"]]
    for method in METHODS:
        mine = {d.problem: d for d in descents if d.method == method}
        if mine:
            cells = [_cell(mine[p], descents) if p in mine else "–" for p in problems]
            rows.append([method, *cells, str(sum(d.has_failed for d in mine.values()))])
    return tables.markdown(rows)


def _cell(descent: Descent, descents: Sequence[Descent]) -> str:
    best = min(d.losses[-1] for d in descents if d.problem == descent.problem and math.isfinite(d.losses[-1]))
    ratio = f"{descent.losses[-1] / descent.losses[0]:.1e}"
    near = next((t for t, loss in zip(descent.seconds, descent.losses, strict=True) if loss <= NEAR * best), None)
    return ratio if near is None else f"{ratio}, near the best in {tables.duration(near)}"


def draw_all(folder: Path, descents: Sequence[Descent], backend: Backend) -> list[Path]:
    """Draws the losses against time, and all results beside each other; returns the paths."""
    drawn = [folder / "descents.png", folder / "results.png"]
    _draw_losses(drawn[0], descents)
    _draw_results(drawn[1], descents, backend)
    return drawn


def _draw_losses(path: Path, descents: Sequence[Descent]) -> None:
    from teg.examples.charts.draw import FAINT, INK, _figure
    from teg.examples.charts.draw_estimators import STYLES

    problems = [p for p in PROBLEMS if any(d.problem == p for d in descents)]
    figure = _figure((4.4 * len(problems), 5))
    panels = figure.subplots(1, len(problems), squeeze=False)[0]
    for panel, problem in zip(panels, problems, strict=True):
        for d in (d for d in descents if d.problem == problem):
            colour, _, dashes = STYLES[d.method]
            panel.semilogy(d.seconds, d.losses, color=colour, linestyle=dashes, linewidth=1.6, label=d.method)
        panel.set_title(problem, fontsize=12, color=INK, loc="left")
        panel.set_xlabel("time, s", color=INK)
        panel.grid(color=FAINT)
    panels[0].set_ylabel("loss, measured exactly", color=INK)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.suptitle("Descents by Adam with each estimator, for the same time", fontsize=14, color=INK, x=0.012, ha="left")
    figure.savefig(path)


def _draw_results(path: Path, descents: Sequence[Descent], backend: Backend) -> None:
    """Draws a row a problem: what is looked for, the start, and where each method ended."""
    from teg.examples.charts.draw import INK, _figure

    problems = [p for p in PROBLEMS if any(d.problem == p for d in descents)]
    methods = [m for m in METHODS if any(d.method == m for d in descents)]
    figure = _figure((1.6 * (len(methods) + 2), 1.85 * len(problems) + 0.4))
    panels = figure.subplots(len(problems), len(methods) + 2, squeeze=False)
    for row, problem in zip(panels, problems, strict=True):
        ends = {d.method: d.end for d in descents if d.problem == problem}
        start = shown(problem, task_of(problem, backend).start.ravel().tolist(), backend)
        pictures: list[tuple[str, Any]] = [("looked for", true_picture(problem, backend)), ("start", start)]
        pictures += [(m, shown(problem, ends[m], backend) if np.isfinite(ends.get(m, (math.nan,))).all() else None) for m in methods]
        for panel, (title, picture) in zip(row, pictures, strict=True):
            if picture is not None:
                panel.imshow(picture, cmap="gray", vmin=0, vmax=1)
            panel.set_xticks([])
            panel.set_yticks([])
            if problem == problems[0]:
                panel.set_title(title, fontsize=10, color=INK)
        row[0].set_ylabel(problem, color=INK)
    figure.savefig(path)
