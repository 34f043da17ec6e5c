"""Plans in which alike terms are loops over tables, as programs without arrays.

The program that is derived and compiled has a table in the place of the parameters and numbers of alike terms
(`teg.passes.normalise.alike`): it is that of one term. Its derivatives by a table, and along one, are those by the parameters that stand
there. Programs without alike terms, and options without fast paths, are left to the plan.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

from teg.analysis.settings import Integration
from teg.errors import TegError
from teg.evaluator.plan import Plan
from teg.evaluator.wanted import Wanted
from teg.ir.arrays import Array
from teg.ir.expr import Param
from teg.ir.traverse import parameters
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.differentiate.through_sums import Parameter, outlined
from teg.passes.normalise.alike import with_tables
from teg.passes.normalise.rows import Tables
from teg.passes.normalise.sums import NeedsLengths
from teg.program.arrays import ArrayProgram, Like
from teg.program.tabled import Sent, Table, TabledProgram


class Tabled:
    """The programs with tables of one plan."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        options = plan.options
        self._plain = isinstance(options.estimator, Exact) and not options.maps and options.dtype == "float64"
        self._plain = self._plain and not plan.functions and not plan.has_loops
        self._made: tuple[Plan | None, Tables] | None = None

    def program(self, wanted: Wanted, entry: int | None, how: Integration) -> TabledProgram | None:
        """Returns the program of all values and derivatives up to the first, or of a derivative along directions; None if it has none."""
        if not self._plain or not how.closed_forms or entry is not None or wanted.orders > 1 or (wanted.values and wanted.along):
            return None
        if self._made is None:
            self._made = self._with_tables()
        inner, tables = self._made
        if inner is None:
            return None
        moving = tuple(tuple(p for p in inner.wrt if _moves(p, tables, along)) for along in wanted.along)
        try:
            program = cast(ArrayProgram, inner.program(wanted._replace(along=moving), how=how))
        except (TegError, NeedsLengths):  # the program that is written out reports it
            return None
        return self._assembled(program, inner, wanted, wanted._replace(along=moving))

    def _assembled(self, program: ArrayProgram, inner: Plan, wanted: Wanted, along: Wanted) -> TabledProgram:
        tables = cast("tuple[Plan, Tables]", self._made)[1]
        plan = self.plan
        arguments = plan.derivation.arguments(wanted)
        column: dict[object, int] = {p: i for i, p in enumerate(arguments)}
        found: list[Table] = [_table(rows, column) for rows in tables.values()]
        place = {p: p for p in plan.leaves}
        for outer, moved in zip(plan.derivation.directions(wanted), inner.derivation.directions(along), strict=True):
            number: dict[object, int] = {p: column[q] for p, q in outer.items()}
            place.update({cast(Param, q): outer[p] for p, q in moved.items() if p not in tables})
            found += [_table(tables[p], number, 0.0) for p in moved if isinstance(p, Array)]
        scalars = [a for a in inner.derivation.arguments(along) if isinstance(a, Param)]
        given = tuple(column[place[a]] for a in scalars)
        values = len(plan.entries) if wanted.values else 0
        outputs = values + wanted.orders * len(plan.entries) * len(plan.wrt)
        sent = _sent(program, tables, inner.wrt, plan.wrt, values)
        return TabledProgram(program, tuple(p.name for p in arguments), given, tuple(found), outputs, sent)

    def _with_tables(self) -> tuple[Plan | None, Tables]:
        """Returns the plan of the program with tables, and these."""
        e, tables = with_tables(self.plan.expression)
        left = set(parameters(e))
        wrt, leaves = ([p for p in some if p in left] for some in (self.plan.wrt, self.plan.leaves))
        try:
            return (Plan(outlined(e), self.plan.options, (*wrt, *tables), (*leaves, *tables)) if tables else None), tables
        except (TegError, NeedsLengths):
            return None, {}


def _moves(p: Parameter, tables: Tables, along: Sequence[Parameter]) -> bool:
    """Returns whether a parameter, or an entry of a table, moves along a direction."""
    return p in along if isinstance(p, Param) else any(e in along for row in tables[p] for e in row)


def _table(rows: Sequence[Sequence[object]], column: Mapping[object, int], still: float | None = None) -> Table:
    """Returns a table whose entries are columns and numbers; `still` stands for entries without a column, if it is given."""
    entries = (column[e] if e in column else float(cast(Param, e).data) if still is None else still for row in rows for e in row)
    return Table(len(rows), len(rows[0]), tuple(entries))


def _sent(program: ArrayProgram, tables: Tables, inner: Sequence[Parameter], wrt: Sequence[Parameter], values: int) -> tuple[Sent, ...]:
    """Returns where the outputs of a program with tables go: values first, then for each source the derivatives by `wrt`."""
    number: dict[object, int] = {p: i for i, p in enumerate(wrt)}
    sent = [Sent(i, None, i) for i in range(values)]
    for j in range(values, len(program.outputs)):
        source, k = divmod(j - values, len(inner))
        first, p = values + source * len(wrt), inner[k]
        if isinstance(p, Param):
            sent.append(Sent(j, None, first + number[p]))
        elif isinstance(program.outputs[j], Like):
            entries = [e for row in tables[p] for e in row]
            sent += [Sent(j, i, first + number[e]) for i, e in enumerate(entries) if e in number]
    return tuple(sent)
