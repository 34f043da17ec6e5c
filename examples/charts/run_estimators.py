"""`teg chart estimators`: measures what is missing, draws, writes the tables. A run can be interrupted, and continues from there."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from teg.evaluator.options import Backend
from teg.examples.charts import estimators, tables
from teg.examples.charts.estimators import SWEEPS, Point
from teg.examples.charts.run import _in_parallel, _stored
from teg.examples.charts.scenes import SCENES, gradient_of
from teg.examples.harness import machine, progress_bar, require_packages, result_folder, versions, write_report
from teg.examples.options import default_backend

PACKAGES = {"matplotlib": "matplotlib>=3.8", "mpmath": "mpmath>=1.3"}
GOALS = (1e-1, 1e-2, 1e-3)


def run_estimators(
    out: str | Path = "out/charts",
    page: str | Path | None = None,
    quick: bool = False,
    fresh: bool = False,
    backend: Backend | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Error of the gradient against time and evaluations for all estimators: estimators.json and two pictures in `out`, tables in `page`.

    The options are those of `teg.examples.charts.run.run_integration`.
    """
    require_packages("chart", PACKAGES, progress, extra="chart")
    from teg.examples.charts import draw_estimators

    folder, chosen = result_folder(Path(out)), backend or default_backend()
    tables.read_page(page)  # an error before the work, not after it
    store = folder / "estimators.json"
    settings = {"quick": quick, "backend": chosen}
    rows: list[dict[str, Any]] = [] if fresh else list(_stored(store, "points", settings))
    done = {f"{p['scene']} | {p['method']}" for p in rows}
    missing = [t for t in estimators.tasks(quick) if t.key not in done]
    interrupted = False

    def report() -> dict[str, Any]:
        return {"settings": settings, "interrupted": interrupted, "points": rows, "versions": versions(), "machine": machine()}

    try:
        if chosen == "c":
            _in_parallel(partial(estimators.prepare, backend=chosen), missing, progress, "compile")
        exact = {name: gradient_of(name) for name in dict.fromkeys(t.scene for t in missing)}
        with progress_bar(progress, len(missing), 0, "measure") as bar:
            for task in missing:
                rows += [p.data() for p in estimators.measure(task, exact[task.scene], chosen)]
                write_report(store, report())
                if bar is not None:
                    bar.update()
    except KeyboardInterrupt:
        interrupted = True
    points = [point_of(row) for row in rows]
    pictures = draw_estimators.draw_all(folder, points) if points else []
    if page is not None:
        tables.write_page(page, tables.read_page(page), "estimators", estimator_tables(points))
    write_report(store, report())
    return report() | {"pictures": [str(p) for p in pictures], "summary": summary(points)}


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
