"""`teg chart lean`: measures the scenes that are missing, draws, writes the table. A run can be interrupted, and continues from there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Unpack

from teg.examples.charts import lean, tables
from teg.examples.charts.chart_run import ChartRun, Options
from teg.examples.charts.lean import Row
from teg.examples.charts.lean_scenes import SCENES
from teg.examples.harness import require_packages

PACKAGES = {"matplotlib": "matplotlib>=3.8"}
QUICK = ("half-plane across", "50 brackets × exp", "disk × exp·cos")


def run_lean(out: str | Path = "out/charts", page: str | Path | None = None, **options: Unpack[Options]) -> dict[str, Any]:
    """Evaluations, decisions, statements and nanoseconds of each scene beside the least known: lean.json and a picture in `out`, a table in
    `page`.

    The options are those of `teg.examples.charts.run.run_integration`.
    """
    require_packages("chart", PACKAGES, options.get("progress", True), extra="chart")
    from teg.examples.charts import draw_lean

    run = ChartRun("lean", out, page, options)
    rows: dict[str, Any] = dict(run.stored("rows"))
    missing = [s for s in SCENES if s.name not in rows and (not run.quick or s.name in QUICK)]
    with run.interruptible(), run.bar(len(missing), "measure") as bar:
        for scene in missing:
            rows[scene.name] = lean.measure(scene, run.backend, run.quick).data()
            run.save(rows=rows)
            if bar is not None:
                bar.update()
    measured = [Row(**rows[s.name]) for s in SCENES if s.name in rows]
    pictures = [draw_lean.draw(run.folder / "lean.png", measured)] if measured else []
    run.write_table(lean_table(measured))
    return run.save(rows=rows) | {"pictures": [str(p) for p in pictures], "summary": summary(measured)}


def summary(rows: Sequence[Row]) -> str:
    """Returns a line to print after a run."""
    ratios = sorted(r.ratio for r in rows if r.ratio is not None)
    if not ratios:
        return f"{len(rows)} scenes"
    return f"{len(rows)} scenes; {ratios[len(ratios) // 2]:.1f} times the least known in the middle, {ratios[-1]:.0f} times at most"


def lean_table(rows: Sequence[Row]) -> str:
    """Returns the table, a row a scene, and the sources of the figures that were not measured in the run."""
    sources = list(dict.fromkeys(r.source for r in rows if r.least is not None and not r.measured))
    table = [["", "evaluations", "least", "decisions", "statements", "ns", "least, ns", "ratio"]]
    for r in rows:
        mark = "" if r.measured or r.least is None else f" [{sources.index(r.source) + 1}]"
        least = "–" if r.least is None else f"{shown(r.least)}{mark}"
        times = "–" if r.ratio is None else shown(r.ratio)
        counts = [shown(r.evaluations), str(r.least_evaluations), shown(r.decisions), str(r.statements)]
        table.append([r.scene, *counts, shown(r.nanoseconds), least, times])
    worst = max((r.difference for r in rows if r.difference is not None), default=math.nan)
    notes = [f"Without a number: by hand in C, in the same run. The results of both differ by at most {worst:.0e}."]
    notes += [f"[{i}] {source}." for i, source in enumerate(sources, 1)]
    return tables.markdown(table) + "\n" + "\n".join(f"- {note}" for note in notes) + "\n"


def shown(number: float) -> str:
    """Returns three digits, and no decimals from 100 on."""
    return f"{number:.0f}" if number >= 100 or number == round(number) else f"{number:.3g}"
