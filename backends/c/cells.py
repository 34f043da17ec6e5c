"""Cells, the tables of their derivatives, and what is read from these, as C.

    plain    a table of derivatives for each result, by `teg_cells`
             (intervals of straight lines by `teg_envelope`, which leaves what is nearly a tie to that)
    kept     the cells themselves, by `teg_keep_cells`, from which `teg_pull_back` makes one table when the weights of the results are known

Cells are kept if `Combined` steps are all that read their tables, and read all of these, or if there are none.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

from teg.backends.c.text import indent, literal, packed, spelled
from teg.numerics.cells import monomials
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program.arrays import ArrayProgram, Cells, Combined, Integers, Step, Take, steps

NO_MEMORY = 16
"""The bit of a note that says that there was no memory for cells."""
CELLS_ON_STACK = 1024
"""Numbers of candidates and tables that are on the C stack."""
AHEAD = 8
"""How many candidates on is the one whose row of a table is asked for."""


class Source(NamedTuple):
    """A table of derivatives: the Cells that it belongs to, its columns; whether only those of forms are its own, and moments elsewhere."""

    cells: Cells
    columns: int
    kept: bool


class Later(NamedTuple):
    """How a square waits: what `teg_keep_or_wait` is given, and lines behind it where it waits."""

    place: str
    lines: list[str]


class CellPrinter(ABC):
    """Prints what has to do with cells."""

    def __init__(self, program: ArrayProgram) -> None:
        self.sources: dict[str, Source] = {}  # by the names of tables
        self.widths: dict[str, int] = {}  # the columns of tables of rows
        self.lists: dict[tuple[int, str], str] = {}  # which rows are listed, by the list and their number
        self.shapes: dict[str, str] = {}  # the rules of the shapes of cells, by name
        body = list(steps(program.body))
        self._read = {s.table for s in body if isinstance(s, Take)}
        self._combined = [s for s in body if isinstance(s, Combined)]
        self.later: dict[int, Later] = {}  # by the identities of Cells

    @abstractmethod
    def _block(self, block: Sequence[Step], depth: int) -> list[str]:
        """Returns the lines of a block."""

    def _readers(self, step: Cells) -> list[Combined]:
        """Returns the steps that combine tables of cells, of which the first one is theirs."""
        return [c for c in self._combined if c.of[0] in step.tables]

    def _is_kept(self, step: Cells) -> bool:
        """Returns whether cells are kept in the place of their tables."""
        readers = [c.of for c in self._combined if not set(c.of).isdisjoint(step.tables)]
        alone = self._read.isdisjoint(step.tables) and all(sorted(of) == sorted(step.tables) for of in readers)
        return not step.sizes and not step.shape.order and alone and not is_straight(step)

    def _cells(self, step: Cells, depth: int) -> list[str]:
        """Returns the numbers of all candidates, and the cells that are made of them."""
        wide, kept = len(step.values), self._is_kept(step)
        at, count = step.results[0], len(step.results)
        lo, hi = spelled(step.lo), spelled(step.hi)
        stored = [f"{at}_rows[({step.index} - {lo}) * {wide} + {j}] = {spelled(v)};" for j, v in enumerate(step.values)]
        inside = ["if (teg_stopped(pace)) break;", *self._ahead(step), *self._block(step.body, depth + 1), *packed(stored)]
        given = ", ".join(spelled(v) if isinstance(v, str) else literal(float(v)) for v in step.otherwise)
        lines = [
            f"const int64_t {at}_n = {hi} - {lo};",
            f"const size_t {at}_wide = (size_t){at}_n * {wide};",
            f"const size_t {at}_size = {self._places(step, kept)};",
            f"const size_t {at}_bytes = ({at}_wide + {at}_size) * sizeof(double);",
            f"double {at}_here[{CELLS_ON_STACK}], {at}_values[{count}]{f', {at}_sizes[{count}]' if step.sizes else ''};",
            f"double *const {at}_rows = {at}_bytes <= sizeof {at}_here ? {at}_here : malloc({at}_bytes);",
            *([f"double *const {at}_tables = {at}_rows + {at}_wide;"] if step.tables or kept else []),
            *([f"unsigned char *const {at}_seen = (unsigned char *)({at}_tables + {at}_size) - {at}_n - 1;"] if kept else []),
            *([f"teg_kept {at}_kept;", f"{at}_kept.state = TEG_NO_CELLS;"] if kept else []),
            f"const double {at}_otherwise[{len(step.otherwise)}] = {{{given}}};",
            f"for (int64_t {step.index} = {lo}; {at}_rows && {step.index} < {hi}; {step.index}++) {{",
            *indent(*inside),
            "}",
        ]
        numbers = f"&{self._shape(step)}, {at}_n, {at}_rows, {at}_otherwise, {at}_values"
        plain = f"teg_cells({numbers}, {f'{at}_sizes' if step.sizes else 'NULL'}, {f'{at}_tables' if step.tables else 'NULL'})"
        if is_straight(step):
            tables = f"{f'{at}_sizes' if step.sizes else 'NULL'}, {f'{at}_tables' if step.tables else 'NULL'}"
            plain = f"(!teg_envelope(&{self._shape(step)}, {at}_n, {at}_rows, {at}_values, {tables}) && {plain})"
        call = f"teg_keep_cells(&{at}_kept, {numbers}, {at}_tables, {at}_seen)" if kept else plain
        if kept and (later := self.later.get(id(step))):
            call = f"{at}_how == 1"
            asked = f"teg_keep_or_wait(&{at}_kept, {numbers}, {at}_tables, {at}_seen, {later.place})"
            lines += [f"const int {at}_how = {at}_rows ? {asked} : 1;", f"if ({at}_how > 1) {{"]
            lines += [*indent(f"if ({at}_rows != {at}_here) free({at}_rows);", *later.lines), "}"]
        lines += [f"if (!{at}_rows || {call}) {{", *indent(f"note |= {NO_MEMORY};", f"teg_fill({at}_values, {count}, NAN);"), "}"]
        lines += packed([f"{r} = {at}_values[{j}]" for j, r in enumerate(step.results)], "const double ", ", ", ";")
        lines += packed([f"{r} = {at}_sizes[{j}]" for j, r in enumerate(step.sizes)], "const double ", ", ", ";") if step.sizes else []
        columns = step.shape.columns * (1 + step.shape.order)
        for j, name in enumerate(() if kept else step.tables):
            self.sources[name] = Source(step, columns, False)
            lines.append(f"const double *const {name} = {at}_rows ? {at}_tables + {j} * ({at}_n + 1) * {columns} : NULL;")
        before = step.shape.coefficients if kept else count * columns
        for reader in self._readers(step):
            own = step.shape.forms if kept else reader.shape.columns
            self.sources[reader.table] = Source(step, own, kept)
            lines.append(f"double *const {reader.table} = {at}_rows ? {at}_tables + {before} * ({at}_n + 1) : NULL;")
            before += own
        return lines

    def _ahead(self, step: Cells) -> list[str]:
        """Returns lines that ask for rows of tables which candidates further on in a list name: in its order they are read."""
        lists = {s.name: s.array for s in step.body if isinstance(s, Integers) and s.op == "gather" and s.args == (step.index,)}
        rows = dict.fromkeys((lists[s.row], s.table) for s in step.body if isinstance(s, Take) and s.row in lists)
        return [
            f"teg_ahead(a{a}, s{a}[0], {step.index} + {AHEAD}, {table}, {self.widths[table]});" for a, table in rows if table in self.widths
        ]

    def _places(self, step: Cells, kept: bool) -> str:
        """Returns how many numbers the tables of cells have, those of their readers included; behind them which candidates are seen."""
        readers = self._readers(step)
        columns = len(step.results) * step.shape.columns * (1 + step.shape.order) + sum(r.shape.columns for r in readers)
        if kept:
            columns = step.shape.coefficients + len(readers) * step.shape.forms
            return f"{columns} * (size_t)({step.results[0]}_n + 1) + (size_t)({step.results[0]}_n + 8) / 8"
        return f"{columns} * (size_t)({step.results[0]}_n + 1)" if step.tables else "0"

    def _outside(self, step: Cells) -> list[tuple[str, str]]:
        """Returns the results of cells without candidates, and their values: those of `teg_whole`."""
        moments = [literal(1.0 / ((u + 1) * (v + 1))) for u, v in monomials(step.shape.degree)]
        each = [step.otherwise[j : j + len(moments)] for j in range(0, len(step.otherwise), len(moments))]
        sums = [
            " + ".join(f"{spelled(f) if isinstance(f, str) else literal(float(f))} * {m}" for f, m in zip(o, moments, strict=True))
            for o in each
        ]
        return list(zip(step.results, sums, strict=True))

    def _held(self, block: Sequence[Step]) -> list[str]:
        """Returns lines that give back what cells of a block hold."""
        lines: list[str] = []
        for step in block:
            if isinstance(step, Cells):
                at = step.results[0]
                lines += [f"teg_let_go(&{at}_kept);"] if self._is_kept(step) else []
                lines.append(f"if ({at}_rows != {at}_here) free({at}_rows);")
        return lines

    def _combine(self, step: Combined) -> list[str]:
        """Returns lines that make the table of a weighted sum."""
        source = self.sources[step.table]
        at, name, count = source.cells.results[0], step.table, len(step.of)
        weights = dict(zip(step.of, map(spelled, step.weights), strict=True))
        ordered = source.cells.tables if source.kept else step.of
        lines = [f"const double {name}_weights[{count}] = {{{', '.join(weights[t] for t in ordered)}}};"]
        if source.kept:
            call = f"teg_pull_back(&{at}_kept, {at}_otherwise, {name}_weights, {name}, {at}_seen)"
            return [*lines, f"if ({at}_rows && {call}) note |= {NO_MEMORY};"]
        columns = [self.sources[t].columns for t in step.of]
        return [
            *lines,
            f"const double *const {name}_of[{count}] = {{{', '.join(step.of)}}};",
            f"const int {name}_columns[{count}] = {{{', '.join(map(str, columns))}}};",
            f"if ({' && '.join((name, *step.of))})",
            *indent(
                f"teg_combined({at}_n + 1, {count}, {name}_of, {name}_columns, {name}_weights, {step.shape.forms}, "
                f"{step.shape.columns}, {name});"
            ),
        ]

    def _unseen(self, table: str, row: str) -> list[str]:
        """Returns a line that leaves out candidates by which a table has no derivatives."""
        cells, _, kept = self.sources[table]
        at = cells.results[0]
        return [f"if ({at}_rows && !{at}_seen[{row} - {spelled(cells.lo)}]) continue;"] if kept else []

    def _has_no_edges(self, table: str, row: str) -> str:
        """Returns the condition that a candidate that is seen has no edges, in a table of derivatives of cells that are kept."""
        cells = self.sources[table].cells
        at = cells.results[0]
        return f"{at}_rows && {at}_seen[{row} - {spelled(cells.lo)}] == 1"

    def _derivative(self, step: Take) -> str:
        """Returns a number of a table of derivatives."""
        cells, columns, kept = self.sources[step.table]
        name, column = step.table, step.column
        if kept and column >= columns:
            at = cells.results[0]
            name, column, columns = f"{at}_tables", column - columns, cells.shape.coefficients
        return f"{step.table} ? {name}[({spelled(step.row)} - {spelled(cells.lo)}) * {columns} + {column}] : NAN"

    def _shape(self, step: Cells) -> str:
        """Returns the name of a shape, of which a table is printed."""
        shape = step.shape
        name = f"cells_{shape.parts}_{shape.guards}_{shape.degree}_{shape.order}_{len(step.results)}"
        if name not in self.shapes:
            rule = [literal(v) for node in triangle_rule(shape.degree) for v in node]
            nodes, weights = gauss_legendre((shape.degree + 1) // 2 + 1)
            gauss = [literal(v) for x, w in zip(nodes, weights, strict=True) for v in (0.5 + 0.5 * x, 0.5 * w)]
            numbers = (
                f"{shape.parts}, {shape.guards}, {shape.degree}, {shape.order}, {len(step.results)}, {len(rule) // 3}, {len(gauss) // 2}"
            )
            self.shapes[name] = "\n".join(
                [
                    f"static const double {name}_rule[] = {{{', '.join(rule)}}};",
                    f"static const double {name}_gauss[] = {{{', '.join(gauss)}}};",
                    f"static const teg_shape {name} = {{{numbers}, {name}_rule, {name}_gauss}};",
                ]
            )
        return name


def is_straight(step: Cells) -> bool:
    """Returns whether no number of a candidate belongs to the second variable of a square: its cells are intervals."""
    shape = step.shape
    exponents = monomials(shape.degree) * len(step.results)
    of_second = [*range(2, shape.forms, 3), *(shape.forms + j for j, (_, v) in enumerate(exponents) if v)]
    return shape.parts == 1 and not shape.order and all(step.values[j] == 0.0 for j in of_second)
