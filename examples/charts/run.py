"""`teg chart`: makes the missing measurements, draws, writes tables. A run can be interrupted, and continues from there.

points or verdicts of the folder's JSON → the missing ones, saved one by one → pictures → tables in a page
"""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from teg.evaluator.options import Backend
from teg.examples.charts import measure, tables, verdicts
from teg.examples.charts.case import Case
from teg.examples.charts.chart_run import ChartRun, Options
from teg.examples.charts.peers import PACKAGES
from teg.examples.charts.processes import in_parallel, results
from teg.examples.charts.references import read
from teg.examples.charts.stability import CASES
from teg.examples.harness import require_packages

QUICK_REGIONS = ("half-plane", "disk")
QUICK_CASES = 3


def run_integration(out: str | Path = "out/charts", page: str | Path | None = None, **options: Unpack[Options]) -> dict[str, Any]:
    """Error against time and evaluations for ten regions: integration.json and five pictures in `out`, tables in `page`.

    `options` are `quick` (measures little, of two regions), `fresh` (measures again even if the folder has results), `backend` (default:
    "c" if there is a C compiler, else "numpy") and `progress` (a bar). Ctrl-C ends it: the report says "interrupted", and a second run
    continues. Raises MissingPackageError, and InputError for a folder or page that cannot be used.
    """
    require_packages("chart", PACKAGES, options.get("progress", True), extra="chart")
    from teg.examples.charts import draw

    run = ChartRun("integration", out, page, options)
    references = read("regions")
    points, done = dict(run.stored("points")), list(run.stored("done"))
    missing = [t for t in measure.tasks(run.quick) if t.key not in done and (not run.quick or t.region in QUICK_REGIONS)]

    def known(key: str) -> int | None:
        return int(points[key]["evaluations"] or 0) if key in points else None

    with run.interruptible():
        if run.backend == "c":
            compiled = [t for t in missing if measure.SERIES[t.method].rule]
            in_parallel(partial(measure.prepare, backend=run.backend), compiled, run.progress, "compile")
        with run.bar(len(missing), "measure") as bar:
            for task in missing:
                for point in measure.measure(task, references[task.region], run.backend, known):
                    points[point.key] = point.data()
                if any(p["method"] == task.method for p in points.values()):  # otherwise a rule that this version does not have
                    done.append(task.key)
                run.save(points=points, done=done)
                if bar is not None:
                    bar.update()
    found = [_point(p) for p in points.values()]
    pictures = draw.draw_all(run.folder, found) if found else []
    run.write_table(tables.integration_table(found))
    return run.save(points=points, done=done, pictures=[str(p) for p in pictures])


def run_stability(out: str | Path = "out/charts", page: str | Path | None = None, **options: Unpack[Options]) -> dict[str, Any]:
    """Every difficult case by every method: stability.json in `out`, tables in `page`. The options are those of `run_integration`."""
    require_packages("stability table", PACKAGES, options.get("progress", True), extra="chart")
    run = ChartRun("stability", out, page, options)
    answers = dict(run.stored("answers"))
    cases = CASES[:QUICK_CASES] if run.quick else CASES
    missing = [c.name for c in cases if c.name not in answers]
    with run.interruptible():
        for name, answer in results(partial(_judge, backend=run.backend), missing, run.progress, "cases"):
            answers[name] = answer
            run.save(answers=answers)
    run.write_table(tables.stability_tables(answers))
    return run.save(answers=answers, counts=tables.counts(answers))


def _judge(name: str, backend: Backend) -> dict[str, dict[str, verdicts.Answer]]:
    case: Case = next(c for c in CASES if c.name == name)
    exact = read("stability")[name]
    return {method: verdicts.judge(case, exact, method, backend) for method in verdicts.COLUMNS}


def _point(data: dict[str, Any]) -> measure.Point:
    return measure.Point(**data | {"error": float(data["error"])})


def summary(report: dict[str, Any]) -> str:
    """Returns a line to print after a run."""
    if "counts" in report:
        ours = report["counts"]["ours"]
        return "; ".join(f"ours, {q}: " + ", ".join(f"{n} {v}" for v, n in ours[q].items() if n) for q in ("value", "gradient"))
    best: dict[tuple[str, str], float] = {}
    for p in report["points"].values():
        if p["method"] == "auto":
            key = (p["region"], p["quantity"])
            best[key] = min(best.get(key, math.inf), float(p["error"]))
    regions = len({r for r, _ in best})
    worst = max(best.values(), default=math.nan)
    return f"{len(report['points'])} points of {regions} regions; ours at its most accurate is off by {worst:.1e} at most"
