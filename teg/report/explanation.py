"""A report as data, as text of at most 100 columns, and as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from textwrap import wrap
from typing import Any

from teg.passes.lower.intrinsic import CLOSED_FORM

WIDTH = 100
GAP = "  "
MAX_ROWS = 16
"""The largest number of printed rows of one table; `data` has all of them."""
NARROWEST = 12
SHOWN = 120
"""The largest number of characters of an expression in the text of an object that holds it."""


@dataclass(frozen=True)
class Column:
    """One column: of numbers, aligned on the right; of expressions, which are shortened; of prose, which is wrapped."""

    title: str
    kind: str = "prose"  # "number", "expression", "prose"


@dataclass(frozen=True)
class Table:
    """A titled table; `note` stands under it."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass
class Explanation:
    """The compiler's findings. `str()` is a report to read, `data` the same, unshortened, as dicts, lists, strings and numbers.

        [*f.explain().data["cost"]]                         # ['value', 'value and gradient']

    data["functions"] are the applied functions (not in a program with arrays, where all are written out). data["surfaces"] are the
    surfaces on which integrands change, data["dropped"] the other surfaces of the program. data["integrals"], data["boundary"] and
    data["interior"] are the integrals of the value and the two kinds of the gradient. data["remarks"] are the decisions of the passes:
    the pass, the surface or integral, the choice and the reason. data["cost"] has for the value, and for value and gradient, the
    "evaluations" with all breaks inside, and the "least" that the same rules can do with: no break inside, so one piece of each integral,
    one triangle of each polygon, one tetrahedron of each polyhedron, and first looks that are accepted. Where an integrand is 0 a call
    does with fewer.
    """

    data: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        blocks = [shortened(self.data["expression"], WIDTH), *(_text(table) for table in self._tables())]
        return "\n\n".join([*blocks, *("\n".join(wrap(line, WIDTH, subsequent_indent=GAP)) for line in self._remarks())])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        parts = [f"<p><code>{escape(shortened(self.data['expression'], 4 * WIDTH))}</code></p>", *(_html(t) for t in self._tables())]
        return "".join([*parts, *(f"<p>{escape(line)}</p>" for line in self._remarks())])

    def _tables(self) -> list[Table]:
        data = self.data
        moving = [s for s in data["surfaces"] if s["status"] in ("eliminated", "stuck")]
        still = [s for s in data["surfaces"] if s not in moving]
        tables = [
            _applied(data.get("functions", ())),
            _surfaces("surfaces that move", moving, "how δ is eliminated"),
            _surfaces("no δ", [*still, *data["dropped"]], "why"),
            _integrals("integrals of the value", data["integrals"]),
            _integrals("boundary integrals of the gradient", data["boundary"]),
            _integrals("interior integrals of the gradient", data["interior"] or ()),
        ]
        costs = (
            Column(""), Column("statements", "number"), Column("integrals", "number"), Column("integrand evaluations a call", "number"),
            Column("least possible", "number"),
        )  # fmt: skip
        rows = tuple(
            (name, _grouped(c["statements"]), _grouped(c["integrals"]), _evaluations(c), _grouped(c["least"]))
            for name, c in data["cost"].items()
        )
        return [t for t in tables if t.rows] + (
            [Table(f"cost of the expression of {_grouped(data['nodes'])} nodes", costs, rows)] if rows else []
        )

    def _remarks(self) -> list[str]:
        data = self.data
        lines = [f"No {name}: {data[key]}" for name, key in (("value", "value_error"), ("gradient", "gradient_error")) if data[key]]
        if not data["options"]["intrinsics"]:
            lines.append("Fast paths of single shapes of programs are off: intrinsics=False.")
        if not data["integrals"] and not data["value_error"]:
            lines.append("There is no integral in the value.")
        elif not data["surfaces"] and not data["value_error"]:
            lines.append("There is no surface: no integrand jumps.")
        if data["gradient_statements"] and not data["boundary"] and any(s["status"] == "eliminated" for s in data["surfaces"]):
            closed = any(i["rule"].endswith(CLOSED_FORM) for i in data["integrals"])
            terms = "moments in closed form" if closed else "values at points"
            lines.append(f"The boundary terms of the gradient are {terms}: they need no integral.")
        return lines


@dataclass
class ArrayExplanation(Explanation):
    """The same for a program with arrays: the tables of each cell, and the loops around the cells.

    Surfaces and integrals have a "cell", the number of an entry of data["cells"], which names its sums. data["loops"] has the loops of
    the value, and those of value and gradient: the contents of an iteration, without inner loops; the first row is done once a call.
    data["choices"] has, for the index of each integral of a choice, how many candidates of a box programs of XLA take; data["lists"], for
    the index of each sum over a list, the entries that may have runs.
    """

    def _tables(self) -> list[Table]:
        data = self.data
        tables = []
        for number, cell in enumerate(data["cells"]):
            place = f" in Σ {', '.join(cell['sums'])}" if cell["sums"] else ""
            surfaces, dropped, *integrals = (
                [row for row in data[key] if row["cell"] == number] for key in ("surfaces", "dropped", "integrals", "boundary", "interior")
            )
            moving = [s for s in surfaces if s["status"] in ("eliminated", "stuck")]
            tables += [
                _surfaces(f"surfaces that move{place}", moving, "how δ is eliminated"),
                _surfaces(f"no δ{place}", [*(s for s in surfaces if s not in moving), *dropped], "why"),
                _integrals(f"integrals of the value{place}", integrals[0]),
                _integrals(f"boundary integrals of the gradient{place}", integrals[1]),
                _integrals(f"interior integrals of the gradient{place}", integrals[2]),
            ]
        tables += [_loops(f"loops of the program of {name}", rows) for name, rows in data["loops"].items()]
        return [t for t in tables if t.rows]

    def _remarks(self) -> list[str]:
        data = self.data
        lines = [f"No {name}: {data[key]}" for name, key in (("value", "value_error"), ("gradient", "gradient_error")) if data[key]]
        if not data["options"]["intrinsics"]:
            lines.append("Fast paths of single shapes of programs are off: intrinsics=False.")
        if data["assumed_length"] is not None:
            lines.append(
                f"A sum inside an integral is written out when the lengths of arrays are known; this is for lengths of "
                f"{data['assumed_length']}."
            )
        if not data["integrals"] and not data["value_error"]:
            lines.append("There is no integral in the value.")
        elif not data["surfaces"] and not data["value_error"]:
            lines.append("There is no surface: no integrand jumps.")
        if any(row["depth"] == 1 for rows in data["loops"].values() for row in rows):
            lines.append("Iterations of outermost loops are cut into chunks, which threads share; results do not depend on how many do.")
        for index, entries in data["lists"].items():
            lines.append(
                f"Lists of {index}: where neighbours have equal {' or '.join(entries)}, C and NumPy compute what depends on "
                "these alone once for each run."
            )
        for index, most in data["choices"].items():
            lines.append(
                f"Cells of {index}: teg.jax_function(…, kernel='xla') computes boxes of at most {most} candidates by operations of XLA, "
                "others on the host."
            )
        return lines


def _loops(title: str, found: Sequence[dict[str, Any]]) -> Table:
    columns = (
        Column("loop"), Column("from .. to"), Column("an iteration"), Column("statements", "number"),
        Column("integrand evaluations"), Column("chunks"),
    )  # fmt: skip
    rows = []
    for r in found[:MAX_ROWS]:
        into = {name: r["scatters"].count(name) for name in dict.fromkeys(r["scatters"])}
        parts = [f"reads {_counted(r['loads'], 'entry', 'entries')}"] if r["loads"] else []
        parts += [_counted(r["integrals"], "integral", "integrals")] if r["integrals"] else []
        parts += [_counted(r["results"], "sum", "sums")] if r["results"] else []
        parts += [f"keeps {_counted(r['kept'], 'number', 'numbers')} in a table"] if r["kept"] else []
        parts += [f"{n} added into the gradient by {name}" for name, n in into.items()]
        sign = "each" if r["kept"] else "Σ"
        loop = "· " * (r["depth"] - 1) + f"{sign} {r['index']}" if r["index"] else "once a call"
        domain = f"{r['lower']} .. {r['upper']}" + (f", if in {r['listed']}" if r["listed"] else "") if r["index"] else "-"
        chunked = r["iterations_a_chunk"] and not r["kept"]
        chunks = f"≤ {r['chunks']}, ≥ {_grouped(r['iterations_a_chunk'])} iterations each" if chunked else "-"
        evaluations = f"{_evaluations(r)}; least {_grouped(r['least'])}" if r["evaluations"] else "-"
        rows.append((loop, domain, ", ".join(parts) or "-", _grouped(r["statements"]), evaluations, chunks))
    left = len(found) - MAX_ROWS
    return Table(title, columns, tuple(rows), f"… and {left} more" if left > 0 else "")


def _counted(n: int, one: str, several: str) -> str:
    return f"{n} {one if n == 1 else several}"


def _applied(functions: Sequence[dict[str, Any]]) -> Table:
    """Returns the table of functions, and whether they are compiled by themselves."""
    columns = Column("function", "expression"), Column("applications", "number"), Column("how")
    rows = []
    for f in functions:
        how = "compiled by itself"
        if f["written out"]:
            times = "" if f["written out"] == f["applications"] else f"{f['written out']} of them "
            how = f"{times}written out: {f['why']}"
        rows.append((f["function"], str(f["applications"]), how))
    return Table("functions", columns, tuple(rows))


def _surfaces(title: str, found: Sequence[dict[str, Any]], last: str) -> Table:
    rows = []
    for s in found[:MAX_ROWS]:
        others = f"{s['count']} parallel surfaces of {s['of']}: " if s["count"] > 1 else ""
        rows.append((s["surface"], s["owner"] or "-", others + s["treatment"]))
    rest: dict[str, int] = {}
    for s in found[MAX_ROWS:]:
        kind = s["family"] or s["status"]
        rest[kind] = rest.get(kind, 0) + s["count"]
    note = "… and " + ", ".join(f"{k} more: {name}" for name, k in rest.items()) if rest else ""
    return Table(title, (Column("surface", "expression"), Column("owner"), Column(last)), tuple(rows), note)


def _integrals(title: str, found: Sequence[dict[str, Any]]) -> Table:
    columns = (
        Column("over", "expression"), Column("from .. to", "expression"), Column("breaks"), Column("degree", "number"), Column("rule"),
        Column("nodes a piece", "number"),
    )  # fmt: skip
    rows = []
    for i in found[:MAX_ROWS]:
        over = i["variable"] + (f" ×{i['count']}" if i["count"] > 1 else "")
        degree = "-" if i["degree"] is None else str(i["degree"])
        nodes = "-" if i["nodes"] is None else ("≥ " if i["rule"].startswith("adaptive") else "") + str(i["nodes"])
        domain = "-" if i["kind"] == "sum over roots" else f"{i['lower']} .. {i['upper']}"
        rows.append((over, domain, _breaks(i), degree, i["rule"], nodes))
    left = sum(i["count"] for i in found[MAX_ROWS:])
    return Table(title, columns, tuple(rows), f"… and {left} more" if left else "")


def _breaks(i: dict[str, Any]) -> str:
    if i["kind"] == "sum over roots":
        return f"{i['formula']} roots by formula" if i["formula"] else f"≤ {i['isolated']} roots isolated"
    parts = [f"{i['formula']} by formula"] if i["formula"] else []
    parts += [f"≤ {i['isolated']} isolated"] if i["isolated"] else []
    parts += [f"≤ {i['located']} where curves meet"] if i["located"] else []
    parts += ["others searched for" if parts else "searched for"] if i["searched"] else []
    return ", ".join(parts) or "none"


def _evaluations(cost: dict[str, Any]) -> str:
    return f"about {_grouped(cost['evaluations'])}" + (", more where adaptive" if cost["adaptive"] else "")


def _grouped(n: int) -> str:
    return f"{n:,}".replace(",", " ")


# -- text ----------------------------------------------------------------------------------------------------------------


def shortened(text: str, width: int) -> str:
    """Returns one line of at most `width` characters: a longer text loses its middle."""
    text = " ".join(text.split())
    if len(text) <= width:
        return text
    tail = (width - 3) // 3
    return f"{text[: width - 3 - tail].rstrip()} … {text[len(text) - tail :].lstrip()}"


def _widths(table: Table, room: int) -> list[int]:
    """Returns the widths of the columns: their natural widths, with the widest ones reduced if there is no room."""
    cells = [tuple(c.title for c in table.columns), *table.rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(table.columns))]
    least = [w if c.kind == "number" else min(w, NARROWEST) for w, c in zip(widths, table.columns, strict=True)]
    excess = sum(widths) - room
    while excess > 0:
        i = max(range(len(widths)), key=lambda k: widths[k] - least[k])
        if widths[i] == least[i]:
            break
        widths[i] -= 1
        excess -= 1
    return widths


def _text(table: Table) -> str:
    widths = _widths(table, WIDTH - len(GAP) * len(table.columns))
    lines = [table.title] if table.title else []
    head = [tuple(c.title for c in table.columns)]
    for row in [*head, *table.rows]:
        cells = []
        for text, column, width in zip(row, table.columns, widths, strict=True):
            cells.append([shortened(text, width)] if column.kind == "expression" else wrap(text, width) or [""])
        for k in range(max(len(c) for c in cells)):
            parts = [c[k] if k < len(c) else "" for c in cells]
            aligned = [
                p.rjust(w) if column.kind == "number" else p.ljust(w) for p, w, column in zip(parts, widths, table.columns, strict=True)
            ]
            lines.append((GAP + GAP.join(aligned)).rstrip())
    return "\n".join([*lines, *([GAP + table.note] if table.note else [])])


def _html(table: Table) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag} style='text-align:left'>{escape(c)}</{tag}>" for c in cells) + "</tr>"

    body = row([c.title for c in table.columns], "th") + "".join(row(r, "td") for r in table.rows)
    note = f"<p>{escape(table.note)}</p>" if table.note else ""
    return f"<table><caption style='text-align:left'><b>{escape(table.title)}</b></caption>{body}</table>{note}"
