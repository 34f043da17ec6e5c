"""Sums over gaps of the same text in an array program, run side by side: the lines along which half disks are followed.

    r = gaps on the line c(s);  t = gaps on the line d(s)     →     for each row of (p, q) = (…), (…): gaps on the line e(s, p, q)

`teg.backends.jax.alike` does this for statements of flat programs, and compares what is run for each line here: the flat programs before
it, that of a candidate, and that of a gap. Rows become lanes: each lane has one for each row, so that what was computed four times for
some lines is computed once, for four times as many.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Annotated, Any, NamedTuple, cast

from teg.backends.branches import Uses
from teg.backends.jax.alike import Rows, with_group_as_rows
from teg.program import Assign, Program, assigned, free_names, statements
from teg.program.arrays import Arg, ArrayProgram, Gaps, Integers, Load, Number, Run, Step
from teg.program.dce import without_dead_code
from teg.program.fields import (
    Block,
    Operand,
    Result,
    Variable,
    inner_blocks,
    operands,
    renamed,
    result_names,
    variables,
    with_blocks,
)
from teg.program.names import is_condition
from teg.program.operations import OPERATIONS
from teg.program.walk import free_in

Lookup = Integers | Load | Number


@dataclass(frozen=True, slots=True)
class SideBySide:
    """results = the `values` of the body for each of the `rows`, a column a name; the results of a row stand together."""

    names: Annotated[tuple[str, ...], Variable(("body",))]
    rows: Annotated[tuple[tuple[Arg, ...], ...], Operand()]
    body: Annotated[tuple[Any, ...], Block()]
    values: Annotated[tuple[Arg, ...], Operand(at="body")]
    results: Annotated[tuple[str, ...], Result(fixed=True)]

    @property
    def width(self) -> int:
        """Returns how many rows there are."""
        return len(self.rows[0])


@dataclass(frozen=True, slots=True)
class _Line:
    """A sum over gaps as a statement of a flat program: what is looked up for a candidate are variables of its block."""

    lookups: Annotated[tuple[str, ...], Variable(("body",))]
    ends: Annotated[tuple[str, str], Variable(("inside",))]
    before: Annotated[tuple[Any, ...], Block()]
    first: Annotated[Arg, Operand(at="before")]
    last: Annotated[Arg, Operand(at="before")]
    body: Annotated[tuple[Any, ...], Block(sees=("before",))]
    values: Annotated[tuple[Arg, ...], Operand(at="body")]
    inside: Annotated[tuple[Any, ...], Block(sees=("before",))]
    terms: Annotated[tuple[Arg, ...], Operand(at="inside", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    bounds: tuple[Arg, Arg] = (0, 0)


class _Read(NamedTuple):
    """A sum over gaps, the flat programs of a candidate and of a gap, and what the steps around these call names in the candidate's."""

    step: Gaps
    candidate: Run
    gap: Run
    names: dict[str, str]


@dataclass
class _Lookups:
    """Names of what is looked up for a candidate, whose index is INDEX in them: the same for the same lookup of any sum."""

    steps: dict[Lookup, str] = field(default_factory=dict)

    def name(self, lookup: Lookup, names: dict[str, str]) -> str:
        """Returns the name of a lookup, in which others have `names`."""
        return self.steps.setdefault(renamed(replace(lookup, name=""), names), f"l{len(self.steps)}")


INDEX, AROUND, MARK = "i", "^", "'"
"""The index of a candidate in what is looked up for it; what marks names of the array program; what marks those of a flat one."""


def side_by_side(program: ArrayProgram) -> ArrayProgram:
    """Returns the program in which sums over gaps of the same text are one, whose lines are lanes side by side."""
    needed = {a for a in program.outputs if isinstance(a, str)}
    return replace(program, body=_joined(program.body, needed, count()))


def _joined(block: tuple[Step, ...], needed: set[str], numbers: Iterator[int]) -> tuple[Any, ...]:
    """Returns a block, after which some names are `needed`, and those in it, with lines side by side."""
    steps: list[Any] = []
    for step in block:
        own = {a for a in operands(step) if isinstance(a, str)}
        blocks = {name: _joined(inner, own, numbers) for name, _, inner in inner_blocks(step)}
        steps.append(with_blocks(step, blocks) if blocks else step)
    lookups = _Lookups()
    lines = [read for step in steps if isinstance(step, Gaps) and (read := _read(step, lookups))]
    while len(lines) > 1:
        first, *others = lines
        group = [first, *(other for other in others if _may_join(steps, first, other))]
        changed = _changed(steps, group, lookups, numbers) if len(group) > 1 else None
        steps = _live(changed, needed) if changed else steps
        members = {id(line) for line in group} if changed else {id(first)}
        lines = [line for line in lines if id(line) not in members]
    return tuple(steps)


def _read(step: Gaps, lookups: _Lookups) -> _Read | None:
    """Returns the parts of a sum over gaps; None if it is not one flat program a candidate, and one a gap."""
    *before, candidate = step.body
    if any(isinstance(s, Run) and (s.program.functions or s.program.weighs_ties) for s in (candidate, *step.inside)):
        return None
    if step.doubtful or len(step.inside) != 1 or not isinstance(gap := step.inside[0], Run) or not isinstance(candidate, Run):
        return None
    names = {step.index: INDEX}
    for lookup in before:
        if not isinstance(lookup, Integers | Load | Number):
            return None
        names[lookup.name] = lookups.name(lookup, names)
    return _Read(step, candidate, gap, names)


def _may_join(block: Sequence[Any], one: _Read, other: _Read) -> bool:
    """Whether two sums may be run side by side: over the same candidates, and neither needs the other one."""
    a, b = one.step, other.step
    if (a.lo, a.hi, len(a.values), len(a.terms)) != (b.lo, b.hi, len(b.values), len(b.terms)):
        return False
    given = set(a.results)
    for step in block:
        if not given.isdisjoint(free_names(step)):
            if step is b:
                return False
            given.update(result_names(step))
    return True


def _live(steps: Sequence[Any], needed: set[str]) -> list[Any]:
    """Returns the steps without flat programs that nothing needs any more."""
    used, kept = set(needed), []
    for step in reversed(steps):
        if not isinstance(step, Run) or not used.isdisjoint(step.results):
            kept.append(step)
            used.update(free_names(step))
    return kept[::-1]


def _changed(steps: Sequence[Any], group: Sequence[_Read], lookups: _Lookups, numbers: Iterator[int]) -> list[Any] | None:
    """Returns the block with one step for a group, or for those of it that are like the first one; None if that is not much shorter."""
    before, places = _before(steps)
    lines = [_line(read, lookups, before, places) for read in group]
    uses, needed = (Uses(), Uses(hints=True)), {name for line in lines for name in line.results}

    def rows_of(members: Sequence[_Line]) -> Rows | None:
        block = with_group_as_rows(members, members, needed, uses, numbers)
        return next((s for s in block if isinstance(s, Rows)), None) if block else None

    alike = [lines[0], *(line for line in lines[1:] if rows_of([lines[0], line]))]
    rows = rows_of(alike) if len(alike) > 1 else None
    if rows is None:
        return None
    members = [read for read, line in zip(group, lines, strict=True) if line in alike]
    return _with(steps, members, _step(rows, members, lookups, numbers))


def _with(steps: Sequence[Any], group: Sequence[_Read], new: SideBySide) -> list[Any]:
    """Returns the block with another step instead of a group: what needs them comes after them, all else before."""
    members = {id(read.step) for read in group}
    given = {name for read in group for name in read.step.results}
    before, after = [], []
    for step in steps:
        if id(step) in members:
            continue
        if given.isdisjoint(free_names(step)):
            before.append(step)
        else:
            after.append(step)
            given.update(result_names(step))
    return [*before, new, *after]


# -- sums over gaps as statements --------------------------------------------------------------------------------------


def _before(steps: Sequence[Any]) -> tuple[list[Assign], dict[str, Arg]]:
    """Returns the flat programs of a block as one block of statements, and the names there of what they give: those without loops and
    ties."""
    statements_of: list[Assign] = []
    places: dict[str, Arg] = {}
    for number, step in enumerate(steps):
        if isinstance(step, Run) and _is_plain(step.program) and all(isinstance(s, Assign) for s in step.program.body):
            body, outputs = _renamed(step, f"{MARK}{number}", places)
            statements_of += body
            places |= zip(step.results, outputs, strict=True)
    return statements_of, places


def _is_plain(program: Program) -> bool:
    return not program.functions and not program.ties


def _renamed(run: Run, mark: str, places: Mapping[str, Arg]) -> tuple[list[Any], list[Arg]]:
    """Returns the statements of a flat program, whose names get a mark, and its outputs; its parameters are what is at `places`, or around
    it."""
    names: dict[str, Any] = {f"p{i}": _at(a, places) for i, a in enumerate(run.inputs)}
    for s in statements(run.program.body):
        names |= {name: f"{name}{mark}" for name in (*assigned(s), *variables(s))}
    return [renamed(s, names) for s in run.program.body], [names.get(o, o) if isinstance(o, str) else o for o in run.program.outputs]


def _at(arg: Arg, places: Mapping[str, Arg]) -> Arg:
    return places.get(arg, f"{AROUND}{arg}") if isinstance(arg, str) else arg


def _line(read: _Read, lookups: _Lookups, before: Sequence[Assign], places: Mapping[str, Arg]) -> _Line:
    """Returns a sum over gaps as a statement."""
    step, ends = read.step, (f"{read.step.left}{MARK}", f"{read.step.right}{MARK}")
    body, values = _renamed(read.candidate, f"{MARK}c", {**places, **read.names})
    inside, terms = _renamed(read.gap, f"{MARK}g", {**places, step.left: ends[0], step.right: ends[1]})
    first = _at(step.first, places)
    value, term = (dict(zip(run.results, given, strict=True)) for run, given in ((read.candidate, values), (read.gap, terms)))
    last, found = _at(step.last, places), tuple(_at(a, {**places, **read.names, **value}) for a in step.values)
    needed = (*free_in(body), *free_in(inside), first, last, *found)
    return _Line(
        tuple(lookups.steps.values()),
        ends,
        without_dead_code(Program((), tuple(before), needed)).body,
        first,
        last,
        tuple(body),
        found,
        tuple(inside),
        tuple(_at(a, {**places, **term}) for a in step.terms),
        step.results,
    )


# -- and back ----------------------------------------------------------------------------------------------------------


def _step(rows: Rows, group: Sequence[_Read], lookups: _Lookups, numbers: Iterator[int]) -> SideBySide:
    """Returns the step of rows, whose lines are sums over gaps."""
    *own, line = rows.body
    assert isinstance(line, _Line)
    first, looked_up = group[0].step, {name: of for read in group for of, name in read.names.items()}
    names = _Names(numbers)
    names.at |= dict(zip(line.lookups, (looked_up[name] for name in lookups.steps.values()), strict=True))
    names.at |= dict(zip(line.ends, (first.left, first.right), strict=True))
    columns = tuple(map(names.new, rows.names))
    names.booleans |= {n for n, column in zip(rows.names, rows.rows, strict=True) if any(isinstance(a, bool) for a in column)}
    before = (*own, *line.before)
    made = {name for s in before for name in assigned(s)}
    outer = names.run(before, [a for a in (*free_names(cast(Any, replace(line, before=()))), line.first, line.last) if a in made])
    found = [replace(renamed(s, {**looked_up, INDEX: first.index}), name=looked_up[n]) for s, n in lookups.steps.items()]
    candidate = names.run(line.body, line.values, group[0].candidate.program)
    gap = names.run(line.inside, line.terms, group[0].gap.program)
    gaps = replace(
        first,
        body=(*found, *candidate),
        values=tuple(map(names.of, line.values)),
        inside=tuple(gap),
        terms=tuple(map(names.of, line.terms)),
        first=names.of(line.first),
        last=names.of(line.last),
        results=tuple(map(names.new, line.results)),
    )
    entries = tuple(tuple(map(names.of, column)) for column in rows.rows)
    return SideBySide(columns, entries, (*outer, gaps), tuple(map(names.of, rows.values)), rows.results)


class _Names:
    """The names in an array program of what rows call otherwise; what rows call `booleans` are numbers there."""

    def __init__(self, numbers: Iterator[int]) -> None:
        self.numbers = numbers
        self.at: dict[str, Arg] = {}
        self.booleans: set[str] = set()

    def of(self, arg: Arg) -> Arg:
        """Returns the name in the array program."""
        if not isinstance(arg, str):
            return float(arg)
        return arg.removeprefix(AROUND) if arg.startswith(AROUND) else self.at[arg]

    def new(self, name: str) -> str:
        """Returns a new name for one of the rows."""
        new = f"s{next(self.numbers)}"
        self.at[name] = new
        return new

    def run(self, block: Sequence[Any], outputs: Sequence[Arg], like: Program | None = None) -> list[Run]:
        """Returns the step that runs statements and gives some of their names; none if there are none to give."""
        given = [a for a in dict.fromkeys(outputs) if isinstance(a, str) and a not in self.at and not a.startswith(AROUND)]
        if not given:
            return []
        program = without_dead_code(Program((), tuple(block), tuple(given), like.ties if like else ()))
        inputs = list(free_in(program.body))
        spelled: dict[str, Any] = {}
        numbers = count()
        body: list[Any] = []
        for i, name in enumerate(inputs):
            spelled[name] = f"p{i}"
            if name in self.booleans:
                spelled[name] = f"b{next(numbers)}"
                body.append(Assign(spelled[name], "gt0", (f"p{i}",)))
        for s in statements(program.body):
            spelled |= {name: f"x{next(numbers)}" for name in variables(s)}
            kind = "b" if _is_condition(s, spelled) else "v"
            spelled |= {name: f"{kind}{next(numbers)}" for name in assigned(s)}
        body += [renamed(s, spelled) for s in program.body]
        for name in given:
            if is_condition(spelled[name]):
                self.booleans.add(name)
                body.append(Assign(f"v{next(numbers)}", "select", (spelled[name], 1.0, 0.0)))
                spelled[name] = body[-1].name
        made = replace(program, parameters=tuple(map(str, inputs)), body=tuple(body), outputs=tuple(spelled[a] for a in given))
        return [Run(made, tuple(map(self.of, inputs)), tuple(self.new(a) for a in given))]


def _is_condition(stmt: Any, names: Mapping[str, str]) -> bool:
    if not isinstance(stmt, Assign):
        return False
    if stmt.op == "select":  # rows select conditions too
        return any(isinstance(a, bool) or is_condition(names.get(str(a))) for a in stmt.args[1:])
    return OPERATIONS[stmt.op].result == "condition"
