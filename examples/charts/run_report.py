"""`teg report stability`: judges what is missing, draws the heat map, writes the tables. It can be interrupted, and continues.

teg report stability -o docs/estimators --page docs/estimators.md
teg report stability --case "a cusp"              one case again, with errors and notes
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from teg.errors import InputError
from teg.evaluator.options import Backend
from teg.examples.charts import stability_report, tables
from teg.examples.charts.chart_run import ChartRun, Options
from teg.examples.charts.processes import results
from teg.examples.charts.stability_report import COLUMNS, SCORES, Answer, can_be_asked, columns, counts, shares
from teg.examples.harness import require_packages
from teg.examples.options import default_backend

PACKAGES = {"matplotlib": "matplotlib>=3.8", "mpmath": "mpmath>=1.3"}
COLOURS = {
    "right": "#0072B2", "imprecise": "#8FC3E8", "said in the call": "#E6E8EB", "said by diagnose": "#F0E442", "silently wrong": "#D55E00",
    "crash": "#000000", "too slow": "#A8A8A8",
}  # fmt: skip


def run_report(out: str | Path = "out/report", page: str | Path | None = None, **options: Unpack[Options]) -> dict[str, Any]:
    """Every difficult case by every estimator: report.json and heat-map.png in `out`, tables in `page`.

    `quick` judges one case of each class. The other options are those of `teg.examples.charts.run.run_integration`.
    """
    require_packages("stability report", PACKAGES, options.get("progress", True), extra="chart")
    run = ChartRun("report", out, page, options)
    answers: dict[str, dict[str, Answer]] = dict(run.stored("answers"))
    names = [group[0].name for group in stability_report.CLASSES.values()] if run.quick else list(stability_report.cases())
    missing = [(n, m) for n in names if (m := _missing(n, answers.get(n, {})))]
    with run.interruptible():
        for (name, _), answer in results(partial(_judge, backend=run.backend), missing, run.progress, "cases"):
            answers[name] = answers.get(name, {}) | answer
            run.save(answers=answers, counts=counts(answers))
    if answers:
        draw_heat_map(run.folder / "heat-map.png", answers)
    run.write_table(report_tables(answers), "teg report stability")
    return run.save(answers=answers, counts=counts(answers)) | {"summary": summary(answers)}


def run_case(name: str, backend: Backend | None = None) -> str:
    """Returns the answers of all estimators to one case, as text. Raises InputError for a case that is not there."""
    known = stability_report.cases()
    if name not in known:
        near = [n for n in known if name.lower() in n.lower()]
        raise InputError(f"there is no case {name!r}", None, "cases: " + "; ".join(near or known))
    group, case = known[name]
    lines = [f"{name} ({group}), at {dict(case.problem.parameters)}"]
    for method, found in stability_report.judge(case, backend or default_backend()).items():
        lines.append(f"  {method:<12} {found['score']:<17} {float(found['error']):.1e}  {found['note']}")
    return "\n".join(lines)


def _missing(name: str, answered: Mapping[str, Answer]) -> tuple[str, ...]:
    """Returns the methods that can be asked about a case and were not."""
    case = stability_report.cases()[name][1]
    return tuple(m for m in COLUMNS if m not in answered and can_be_asked(m, case))


def _judge(asked: tuple[str, tuple[str, ...]], backend: Backend) -> dict[str, Answer]:
    name, methods = asked
    return stability_report.judge(stability_report.cases()[name][1], backend, methods)


def summary(answers: Mapping[str, Mapping[str, Answer]]) -> str:
    """Returns a line to print after a run."""
    return f"{len(answers)} cases; exact: " + ", ".join(f"{n} {s}" for s, n in counts(answers)["exact"].items() if n)


def report_tables(answers: Mapping[str, Mapping[str, Answer]]) -> str:
    """Returns the number of cases of each score for each method, then right and silently wrong ones by class."""
    numbers = counts(answers)
    rows = [[f"{len(answers)} cases", *SCORES]] + [[m, *map(str, numbers[m].values())] for m in numbers]
    parts = [tables.markdown(rows)]
    rows = [["class: within 1 % / silently wrong", *numbers]]
    for name, row in shares(answers).items():
        rows.append([name, *(f"{row[m]['right'] + row[m]['imprecise']} / {row[m]['silently wrong']}" for m in numbers)])
    return "\n".join([*parts, tables.markdown(rows)])


def draw_heat_map(path: Path, answers: Mapping[str, Mapping[str, Answer]]) -> None:
    """Draws a bar for each class and method, divided by the scores of its cases."""
    from matplotlib.patches import Patch, Rectangle

    from teg.examples.charts.draw import INK, _figure

    rows, methods = shares(answers), columns(answers)
    figure = _figure((2.0 + 1.35 * len(methods), 1.8 + 0.34 * len(rows)))
    panel = figure.subplots()
    for j, row in enumerate(rows.values()):
        for i, method in enumerate(methods):
            start, total = i + 0.05, sum(row[method].values())
            for score in SCORES:
                width = 0.9 * row[method][score] / max(total, 1)
                panel.add_patch(Rectangle((start, j + 0.08), width, 0.84, facecolor=COLOURS[score], linewidth=0))
                start += width
    panel.set_xlim(0, len(methods))
    panel.set_ylim(len(rows), 0)
    panel.set_xticks([i + 0.5 for i in range(len(methods))], methods, color=INK)
    panel.set_yticks([j + 0.5 for j in range(len(rows))], [f"{n} ({sum(r['exact'].values())})" for n, r in rows.items()], color=INK)
    panel.xaxis.tick_top()
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)
    figure.legend([Patch(color=COLOURS[s]) for s in SCORES], SCORES, loc="outside lower center", ncols=len(SCORES), frameon=False)
    figure.suptitle("Gradients of difficult cases, by class and estimator or package", fontsize=14, color=INK, x=0.012, ha="left")
    figure.savefig(path)
