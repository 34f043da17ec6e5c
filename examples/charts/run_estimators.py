"""`teg chart estimators`: measures what is missing, draws, writes the tables. A run can be interrupted, and continues from there."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from teg.examples.charts import estimators, tables
from teg.examples.charts.chart_run import ChartRun, Options
from teg.examples.charts.estimators import SWEEPS, Point
from teg.examples.charts.processes import in_parallel
from teg.examples.charts.scenes import SCENES, gradient_of
from teg.examples.harness import require_packages

PACKAGES = {"matplotlib": "matplotlib>=3.8", "mpmath": "mpmath>=1.3"}
GOALS = (1e-1, 1e-2, 1e-3)


def run_estimators(out: str | Path = "out/charts", page: str | Path | None = None, **options: Unpack[Options]) -> dict[str, Any]:
    """Error of the gradient against time and evaluations for all estimators: estimators.json and two pictures in `out`, tables in `page`.

    The options are those of `teg.examples.charts.run.run_integration`.
    """
    require_packages("chart", PACKAGES, options.get("progress", True), extra="chart")
    from teg.examples.charts import draw_estimators

    run = ChartRun("estimators", out, page, options)
    rows: list[dict[str, Any]] = list(run.stored("points"))
    done = {f"{p['scene']} | {p['method']}" for p in rows}
    missing = [t for t in estimators.tasks(run.quick) if t.key not in done]
    with run.interruptible():
        if run.backend == "c":
            in_parallel(partial(estimators.prepare, backend=run.backend), missing, run.progress, "compile")
        exact = {name: gradient_of(name) for name in dict.fromkeys(t.scene for t in missing)}
        with run.bar(len(missing), "measure") as bar:
            for task in missing:
                rows += [p.data() for p in estimators.measure(task, exact[task.scene], run.backend)]
                run.save(points=rows)
                if bar is not None:
                    bar.update()
    points = [point_of(row) for row in rows]
    pictures = draw_estimators.draw_all(run.folder, points) if points else []
    run.write_table(estimator_tables(points))
    return run.save(points=rows) | {"pictures": [str(p) for p in pictures], "summary": summary(points)}


def point_of(row: dict[str, Any]) -> Point:
    """Returns a stored point."""
    return Point(**row | {"error": float(row["error"])})


def summary(points: Sequence[Point]) -> str:
    """Returns a line to print after a run."""
    best = max((min(p.error for p in points if (p.scene, p.method) == (s, "exact")) for s in {p.scene for p in points}), default=0.0)
    return f"{len(points)} points; exact at its most accurate is off by {best:.1e} at most"


def estimator_tables(points: Sequence[Point]) -> str:
    """Returns the time to reach each goal, a row an estimator and a column a scene; then the best error of each."""
    scenes = [s for s in SCENES if any(p.scene == s for p in points)]
    parts = []
    for goal in GOALS:
        rows = [[f"error below {goal:g}", *scenes]]
        for method, sweep in SWEEPS.items():
            rows.append([sweep.label, *(_reached(points, s, method, goal) for s in scenes)])
        parts.append(tables.markdown(rows))
    rows = [["smallest error", *scenes]]
    for method, sweep in SWEEPS.items():
        rows.append([sweep.label, *(_best(points, s, method) for s in scenes)])
    return "\n".join([*parts, tables.markdown(rows)])


def _reached(points: Sequence[Point], scene: str, method: str, goal: float) -> str:
    """Returns time and evaluations of the quickest point below the goal."""
    good = [p for p in points if (p.scene, p.method) == (scene, method) and p.error <= goal]
    if not good:
        return "–"
    best = min(good, key=lambda p: p.seconds)
    return f"{tables.duration(best.seconds)}, {tables.short(best.evaluations)}"


def _best(points: Sequence[Point], scene: str, method: str) -> str:
    mine = [p for p in points if (p.scene, p.method) == (scene, method)]
    if not mine:
        return "–"
    best = min(mine, key=lambda p: p.error)
    return f"{tables.error_text(best.error)} in {tables.duration(best.seconds)}"
