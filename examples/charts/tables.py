"""The tables of the page: the chart's measurements, and the verdicts; written between marks in a Markdown file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from teg.errors import InputError
from teg.examples.charts.measure import QUANTITIES, SERIES, Point
from teg.examples.charts.regions import REGIONS
from teg.examples.charts.stability import GROUPS
from teg.examples.charts.verdicts import COLUMNS, VERDICTS

SYMBOLS = dict(zip(VERDICTS, ("✓", "≈", "–", "✗", "†"), strict=True))
HEADINGS = {"ours, differenced": "ours, differenced", "plain automatic differentiation": "plain AD"}
GOAL = 1e-10
"""The table shows the first point of a method with this error, or its most accurate one."""


def read_page(page: str | Path | None) -> str:
    """Returns the text of the page, "" for none. Raises InputError if it cannot be read."""
    if page is None:
        return ""
    try:
        return Path(page).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise InputError(f"cannot read the page {str(page)!r}", None, str(problem)) from None


def write_page(page: str | Path, text: str, name: str, table: str, command: str = "") -> None:
    """Puts a table between the marks of its name, which the command `teg chart name`, or another one, writes. Raises InputError if the
    page has none."""
    begin, end = f"<!-- begin {name}: written by `{command or f'teg chart {name}'}` -->", f"<!-- end {name} -->"
    if begin not in text or end not in text or text.index(begin) > text.index(end):
        raise InputError(f"the page {str(page)!r} has no place for the table", None, f"it goes between the lines\n{begin}\n{end}")
    whole = text[: text.index(begin)] + begin + "\n\n" + table + "\n" + text[text.index(end) :]
    Path(page).write_text(whole, encoding="utf-8")


# -- the chart ---------------------------------------------------------------------------------------------------------


def integration_table(points: Sequence[Point]) -> str:
    """Returns the cost of reaching GOAL, a row a region and a column a method, for values and for gradients; then ours in numbers."""
    parts = []
    for quantity in QUANTITIES:
        methods = [m for m in SERIES if any(p.method == m and p.quantity == quantity for p in points)]
        rows = [["", *(SERIES[m].name(quantity) for m in methods)]]
        for region in _regions(points):
            cells = [_cell(_of(points, region, quantity, m)) for m in methods]
            rows.append([region, *cells])
        parts.append(f"**{quantity.capitalize()}**: error, time, evaluations.\n\n" + markdown(rows))
    parts.append("**Evaluations and time of one element of a batch of 256, C, one thread**\n\n" + markdown(_batch_rows(points)))
    return "\n".join(parts)


def _cell(points: Sequence[Point]) -> str:
    """Returns the first point that is good enough, else the most accurate one."""
    if not points:
        return ""
    ordered = sorted(points, key=lambda p: p.seconds)
    chosen = next((p for p in ordered if p.error <= GOAL), min(points, key=lambda p: p.error))
    count = "" if chosen.evaluations is None else f", {short(chosen.evaluations)}"
    return f"{error_text(chosen.error)}, {duration(chosen.seconds)}{count}"


def _batch_rows(points: Sequence[Point]) -> list[list[str]]:
    rows = [["", "value: rule", "error", "evaluations", "time", "gradient: rule", "error", "evaluations", "time"]]
    for region in _regions(points):
        row = [region]
        for quantity in QUANTITIES:
            known = [p for m in ("auto", "gauss") for p in _of(points, region, quantity, m) if p.batch_seconds is not None]
            good = [p for p in known if p.error <= 1e-12] or sorted(known, key=lambda p: p.error)[:1]
            best = min(good, key=lambda p: p.batch_seconds or math.inf, default=None)
            row += ["", "", "", ""] if best is None else _batch_cells(best)
        rows.append(row)
    return rows


def _batch_cells(p: Point) -> list[str]:
    rule = f"Gauss, order {p.setting:g}" if p.method == "gauss" else f"tolerance {p.setting:.0e}"
    return [rule, error_text(p.error), "" if p.evaluations is None else str(p.evaluations), duration(p.batch_seconds or math.nan)]


def _regions(points: Sequence[Point]) -> list[str]:
    return [r for r in REGIONS if any(p.region == r for p in points)]


def _of(points: Sequence[Point], region: str, quantity: str, method: str) -> list[Point]:
    return [p for p in points if (p.region, p.quantity, p.method) == (region, quantity, method)]


# -- the verdicts ------------------------------------------------------------------------------------------------------


def counts(answers: Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]) -> dict[str, dict[str, dict[str, int]]]:
    """Returns method, quantity, verdict -> number of cases."""
    return {
        method: {q: {v: sum(a[method][q]["verdict"] == v for a in answers.values()) for v in VERDICTS} for q in quantities}
        for method, quantities in COLUMNS.items()
    }


def stability_tables(answers: Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]) -> str:
    """Returns the number of cases of each verdict for each method, and the cases one by one."""
    numbers = counts(answers)
    rows = [["", "", *(f"{SYMBOLS[v]} {v}" for v in VERDICTS)]]
    rows += [[method, q, *map(str, numbers[method][q].values())] for method, quantities in COLUMNS.items() for q in quantities]
    parts = [f"{len(answers)} cases.\n\n" + markdown(rows)]
    heads = [HEADINGS.get(m, m) + (f", {q}" if len(COLUMNS[m]) > 1 else "") for m, q in _columns()]
    for group, cases in GROUPS.items():
        table = [[f"{group}", *heads]]
        for c in cases:
            if c.name in answers:
                table.append([c.name, *(SYMBOLS[answers[c.name][m][q]["verdict"]] for m, q in _columns())])
        if len(table) > 1:
            parts.append(markdown(table))
    return "\n".join(parts)


def _columns() -> list[tuple[str, str]]:
    return [(m, q) for m, quantities in COLUMNS.items() for q in quantities]


# -- text --------------------------------------------------------------------------------------------------------------


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Returns a table whose first row is its head."""
    head, *body = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    lines = [head, ["---"] * len(head), *body]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def error_text(error: float) -> str:
    return "exact" if error == 0 else f"{error:.0e}".replace("e-0", "e-") if math.isfinite(error) else "none"


def duration(seconds: float) -> str:
    unit, size = next(((u, z) for u, z in (("s", 1.0), ("ms", 1e-3)) if seconds >= z), ("µs", 1e-6))
    amount = seconds / size
    return f"{amount:.0f} {unit}" if amount >= 100 else f"{amount:.2g} {unit}"


def short(n: float) -> str:
    for unit, size in (("M", 1e6), ("k", 1e3)):
        if n >= size:
            return f"{n / size:.3g}{unit}"
    return f"{n:g}"
