"""`teg chart`: makes the missing measurements, draws, writes tables. A run can be interrupted, and continues from there.

points or verdicts of the folder's JSON → the missing ones, saved one by one → pictures → tables in a page
"""

from __future__ import annotations

import json
import math
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from teg.errors import InputError
from teg.evaluator.options import Backend
from teg.examples.charts import measure, tables, verdicts
from teg.examples.charts.case import Case
from teg.examples.charts.peers import PACKAGES
from teg.examples.charts.references import read
from teg.examples.charts.stability import CASES
from teg.examples.harness import machine, progress_bar, require_packages, result_folder, versions, write_report
from teg.examples.options import default_backend

QUICK_REGIONS = ("half-plane", "disk")
QUICK_CASES = 3


def run_integration(
    out: str | Path = "out/charts",
    page: str | Path | None = None,
    quick: bool = False,
    fresh: bool = False,
    backend: Backend | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Error against time and evaluations for ten regions: integration.json and five pictures in `out`, tables in `page`.

    `quick` measures little, of two regions; `fresh` measures again even if the folder has results. `backend` None is "c" if there is a C
    compiler, else "numpy". Ctrl-C ends it: the report says "interrupted", and a second run continues. Raises MissingPackageError, and
    InputError for a folder or page that cannot be used.
    """
    require_packages("chart", PACKAGES, progress, extra="chart")
    from teg.examples.charts import draw

    folder, chosen = result_folder(Path(out)), backend or default_backend()
    tables.read_page(page)  # an error before the work, not after it
    references = read("regions")
    store = folder / "integration.json"
    settings = {"quick": quick, "backend": chosen}
    points = {} if fresh else _stored(store, "points", settings)
    done = [] if fresh else list(_stored(store, "done", settings))
    missing = [t for t in measure.tasks(quick) if t.key not in done and (not quick or t.region in QUICK_REGIONS)]

    def report(interrupted: bool) -> dict[str, Any]:
        found = {"points": points, "done": done, "versions": versions(), "machine": machine()}
        return {"settings": settings, "interrupted": interrupted} | found

    def known(key: str) -> int | None:
        return int(points[key]["evaluations"] or 0) if key in points else None

    interrupted = False
    try:
        if chosen == "c":
            _in_parallel(
                partial(measure.prepare, backend=chosen), [t for t in missing if measure.SERIES[t.method].rule], progress, "compile"
            )
        with progress_bar(progress, len(missing), 0, "measure") as bar:
            for task in missing:
                for point in measure.measure(task, references[task.region], chosen, known):
                    points[point.key] = point.data()
                if any(p["method"] == task.method for p in points.values()):  # otherwise a rule that this version does not have
                    done.append(task.key)
                write_report(store, report(interrupted=True))
                if bar is not None:
                    bar.update()
    except KeyboardInterrupt:
        interrupted = True
    found = [_point(p) for p in points.values()]
    pictures = draw.draw_all(folder, found) if found else []
    if page is not None:
        tables.write_page(page, tables.read_page(page), "integration", tables.integration_table(found))
    whole = report(interrupted) | {"pictures": [str(p) for p in pictures]}
    write_report(store, whole)
    return whole


def run_stability(
    out: str | Path = "out/charts",
    page: str | Path | None = None,
    quick: bool = False,
    fresh: bool = False,
    backend: Backend | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Every difficult case by every method: stability.json in `out`, tables in `page`. The options are those of `run_integration`."""
    require_packages("stability table", PACKAGES, progress, extra="chart")
    folder, chosen = result_folder(Path(out)), backend or default_backend()
    tables.read_page(page)  # an error before the work, not after it
    store = folder / "stability.json"
    settings = {"quick": quick, "backend": chosen}
    answers = {} if fresh else _stored(store, "answers", settings)
    cases = CASES[:QUICK_CASES] if quick else CASES
    missing = [c.name for c in cases if c.name not in answers]

    def report(interrupted: bool) -> dict[str, Any]:
        return {"settings": settings, "interrupted": interrupted, "answers": answers, "versions": versions(), "machine": machine()}

    interrupted = False
    try:
        for name, answer in _results(partial(_judge, backend=chosen), missing, progress, "cases"):
            answers[name] = answer
            write_report(store, report(interrupted=True))
    except KeyboardInterrupt:
        interrupted = True
    if page is not None:
        tables.write_page(page, tables.read_page(page), "stability", tables.stability_tables(answers))
    whole = report(interrupted) | {"counts": tables.counts(answers)}
    write_report(store, whole)
    return whole


def _judge(name: str, backend: Backend) -> dict[str, dict[str, verdicts.Answer]]:
    case: Case = next(c for c in CASES if c.name == name)
    exact = read("stability")[name]
    return {method: verdicts.judge(case, exact, method, backend) for method in verdicts.COLUMNS}


def _stored(path: Path, part: str, settings: dict[str, Any]) -> Any:
    """Returns the results of an earlier run with the same settings. Raises InputError for a file of another kind."""
    if not path.exists():
        return {}
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        return stored[part] if stored["settings"] == settings else {}
    except (ValueError, KeyError, TypeError, OSError):
        raise InputError(f"{str(path)!r} is not a report of this command", None, "--fresh writes it anew, or name another folder") from None


def _point(data: dict[str, Any]) -> measure.Point:
    return measure.Point(**data | {"error": float(data["error"])})


# -- two processes -----------------------------------------------------------------------------------------------------


def _in_parallel(job: Callable[[Any], None], items: list[Any], progress: bool, label: str) -> None:
    for _ in _results(job, items, progress, label):
        pass


def _results(job: Callable[[Any], Any], items: list[Any], progress: bool, label: str) -> Iterator[tuple[Any, Any]]:
    """Yields (item, job(item)) in the order of completion, with as many processes as there are processors."""
    workers = min(os.cpu_count() or 1, len(items) // 4)
    with progress_bar(progress, len(items), 0, label) as bar:
        for item, result in _pooled(job, items, workers) if workers > 1 else ((i, job(i)) for i in items):
            if bar is not None:
                bar.update()
            yield item, result


def _pooled(job: Callable[[Any], Any], items: list[Any], workers: int) -> Iterator[tuple[Any, Any]]:
    with _pool(workers) as pool:
        jobs = {pool.submit(job, item): item for item in items}
        for done in as_completed(jobs):
            yield jobs[done], done.result()


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Yields processes that leave Ctrl-C to their parent, and start nothing new after it."""
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_ignore_interrupts)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


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
