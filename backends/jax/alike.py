"""Statements of the same text, run side by side: the quarters of an ellipse, the sides of a polygon, the ends of a box.

    r = ∫ f(x, 2, a) dx;  s = ∫ f(x, 3, -b) dx        →        (r, s) = for each row of (p, q, g) = (2, a, 1), (3, b, -1): ∫ f(x, p, g·q) dx

XLA compiles each copy of a text again, and each loop of it, in time that is longer than what the text computes. `with_rows` looks in every
block for statements with blocks that differ in numbers, in names from around them, and in signs, and makes one statement of them, `Rows`,
which JAX maps over the rows. What only they use is moved into it where it is alike too.

Two texts are compared from their results on, so the order of their statements does not matter. A product may have a factor more, and a
value may be negated in one of them. Statements of a row must not need results of another one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import count
from typing import Annotated, Any

from teg.backends.branches import Uses
from teg.program import Arg, Assign, Program, assigned, free_names, statements
from teg.program.fields import Block, Operand, Part, Result, Variable, declared, inner_blocks, operands, with_blocks
from teg.program.walk import free_in

MOST = 48
"""Statements with blocks in one block that are compared with each other, at most."""


@dataclass(frozen=True, slots=True)
class Rows:
    """results = values of `body`, for each row of the `rows`, a column a name; the results of a row stand together."""

    names: Annotated[tuple[str, ...], Variable(("body",))]
    rows: Annotated[tuple[tuple[Arg, ...], ...], Operand("any")]
    body: Annotated[tuple[Any, ...], Block()]
    values: Annotated[tuple[Arg, ...], Operand(at="body")]
    results: Annotated[tuple[str, ...], Result(fixed=True)]
    when: str | None = None


def with_rows(program: Program) -> Program:
    """The program in which statements of the same text are one."""
    return replace(program, body=_grouped(program.body, program.outputs, count()))


def _grouped(block: Sequence[Any], needed: Iterable[Arg], numbers: Iterator[int]) -> tuple[Any, ...]:
    """A block, after which some names are `needed`, with rows, in the blocks in it first."""
    stmts: list[Any] = [s if isinstance(s, Assign) else _inside(s, numbers) for s in block]
    compound = [s for s in stmts if not isinstance(s, Assign | Rows)]
    if not 1 < len(compound) <= MOST:
        return tuple(stmts)
    outside = {a for a in needed if isinstance(a, str)}
    tried: set[int] = set()
    uses = Uses()
    for first in compound:
        if id(first) in tried:
            continue
        group = [first]
        for other in compound:
            if id(other) not in tried and other is not first and _looks_like(first, other) and _independent(stmts, [*group, other], uses):
                group.append(other)
        group = [first, *(s for s in group[1:] if _rows(stmts, [first, s], outside, numbers))] if len(group) > 1 else group
        if len(group) > 1 and (found := _rows(stmts, group, outside, numbers)):
            tried.update(map(id, group))
            stmts = _with(stmts, group, found, uses)
    return _live(stmts, outside) if tried else tuple(stmts)


def _inside(stmt: Any, numbers: Iterator[int]) -> Any:
    """A statement with rows in its blocks."""
    blocks = list(inner_blocks(stmt))
    seen = {a for name, _, _ in blocks for a in operands(stmt, name) if isinstance(a, str)}
    for _, _, inner in blocks:  # a block may read what another one gives
        seen |= set(free_in(inner))
    return with_blocks(stmt, {name: _grouped(inner, seen, numbers) for name, _, inner in blocks})


def _looks_like(one: Any, other: Any) -> bool:
    """Whether two statements may have the same text: their settings and their size are nearly the same."""
    if type(one) is not type(other):
        return False
    sizes = [sum(1 for _ in statements((s,))) for s in (one, other)]
    return _settings(one) == _settings(other) and max(sizes) <= 1.25 * min(sizes) + 4


def _settings(node: Any) -> list[Any]:
    known = {f.name for f in declared(type(node))}
    return [getattr(node, f.name) for f in fields(node) if f.name not in known]


def _independent(stmts: Sequence[Any], group: Sequence[Any], uses: Uses) -> bool:
    """Whether no statement of a group needs the results of another one."""
    given: set[str] = set()
    members = {id(s) for s in group}
    for stmt in stmts:
        needs = not given.isdisjoint(uses.of(stmt))
        if needs and id(stmt) in members:
            return False
        if needs or id(stmt) in members:
            given.update(assigned(stmt))
    return True


def _with(stmts: Sequence[Any], group: Sequence[Any], rows: Rows, uses: Uses) -> list[Any]:
    """The block with rows instead of a group: what needs them comes after them, all else before."""
    members, given = {id(s) for s in group}, set(rows.results)
    before, after = [], []
    for stmt in stmts:
        if id(stmt) in members:
            continue
        if given.isdisjoint(uses.of(stmt)):
            before.append(stmt)
        else:
            after.append(stmt)
            given.update(assigned(stmt))
    return [*before, rows, *after]


def _live(stmts: Sequence[Any], needed: set[str]) -> tuple[Any, ...]:
    """The statements that something needed depends on."""
    used, kept = set(needed), []
    for stmt in reversed(stmts):
        if not isinstance(stmt, Assign) or stmt.name in used:
            kept.append(stmt)
            used.update(free_names(stmt))
    return tuple(reversed(kept))


def _rows(stmts: Sequence[Any], group: Sequence[Any], needed: set[str], numbers: Iterator[int]) -> Rows | None:
    """The rows of a group, or None if their texts differ."""
    members = {id(s) for s in stmts if type(s) is type(group[0])}  # what statements of other rows use too may be computed again there
    others = {n.name for n in _live([s for s in stmts if id(s) not in members], needed) if isinstance(n, Assign)}
    own = {s.name: s for s in stmts if isinstance(s, Assign) and s.name not in others}
    matching = _Matching(len(group), own, numbers)
    try:
        body = matching.statement(group)
    except (Unlike, RecursionError):  # texts that are nested too deeply are left as they are
        return None
    varying = matching.columns
    if not varying:
        return None
    results = tuple(name for s in group for name in assigned(s))
    prelude = tuple(matching.blocks[0])
    return Rows(tuple(varying.values()), tuple(varying), (*prelude, body), tuple(assigned(body)), results)


class Unlike(Exception):
    """Two texts differ."""


class _Matching:
    """The comparison of some statements, row by row, and the one that stands for all of them.

    `known` has the name for values of the rows; `made` where, and by which statement, each row gives a name; `blocks` the new blocks.
    Block 0 is the one around the statements, of which those in `own`, which nothing else uses, may be moved into the rows.
    """

    def __init__(self, rows: int, own: dict[str, Assign], numbers: Iterator[int]) -> None:
        self.made: list[dict[str, tuple[int, Any]]] = [{n: (0, s) for n, s in own.items()} for _ in range(rows)]
        self.inner: list[set[str]] = [set() for _ in range(rows)]
        self.known: dict[tuple[Any, ...], Any] = {}
        self.columns: dict[tuple[Arg, ...], str] = {}
        self.blocks: list[list[Any]] = [[]]
        self.numbers = numbers

    def statement(self, stmts: Sequence[Any]) -> Any:
        """One statement for all rows; its blocks hold what its operands need."""
        if len({type(s) for s in stmts}) > 1 or any(_settings(s) != _settings(stmts[0]) for s in stmts):
            raise Unlike
        numbers: dict[int, int] = {}
        self._open(stmts, numbers)
        return self._node(stmts, numbers)

    def _open(self, nodes: Sequence[Any], numbers: dict[int, int]) -> None:
        """Notes the names that the blocks and variables of statements, or of their parts, give."""
        for field in declared(type(nodes[0])):
            values = [getattr(n, field.name) for n in nodes]
            match field.role:
                case Part():
                    for parts in self._entries(values):
                        if parts[0] is not None:
                            self._alike_parts(parts)
                            self._open(parts, numbers)
                case Variable() | Result():
                    for names in self._entries(values):
                        if names[0] is not None:
                            self.known[names] = self._name()
                            for row, name in enumerate(names):
                                self._new(row, name)
                case Block():
                    number = len(self.blocks)
                    self.blocks.append([])
                    numbers[id(values[0])] = number
                    self._note(values, number)
                case Operand():
                    pass

    def _note(self, blocks: Sequence[Sequence[Any]], number: int) -> None:
        for row, block in enumerate(blocks):
            for stmt in block:
                for name in assigned(stmt):
                    self._new(row, name)
                    self.made[row][name] = number, stmt

    def _new(self, row: int, name: str) -> None:
        if name in self.inner[row]:
            raise Unlike  # one name for two values
        self.inner[row].add(name)

    @staticmethod
    def _alike_parts(parts: Sequence[Any]) -> None:
        if len({type(p) for p in parts}) > 1 or any(_settings(p) != _settings(parts[0]) for p in parts):
            raise Unlike

    def _entries(self, values: Sequence[Any]) -> Iterator[tuple[Any, ...]]:
        """The entries of fields, side by side; fields of different lengths are unlike."""
        if any(isinstance(v, tuple) for v in values):
            if not all(isinstance(v, tuple) and len(v) == len(values[0]) for v in values):
                raise Unlike
            for entries in zip(*values, strict=True):
                yield from self._entries(entries)
        elif any(v is None for v in values):
            if any(v is not None for v in values):
                raise Unlike
            yield (None,) * len(values)
        else:
            yield tuple(values)

    def _node(self, nodes: Sequence[Any], numbers: dict[int, int]) -> Any:
        """The node that stands for all: operands and parts first, since the blocks hold what these need."""
        new = {}
        own = declared(type(nodes[0]))
        for field in own:
            values = [getattr(n, field.name) for n in nodes]
            if isinstance(field.role, Part):
                new[field.name] = self._parts(values, numbers)
            elif not isinstance(field.role, Block):
                new[field.name] = self._args(values)
        new |= {f.name: tuple(self.blocks[numbers[id(getattr(nodes[0], f.name))]]) for f in own if isinstance(f.role, Block)}
        return replace(nodes[0], **new)

    def _parts(self, values: Sequence[Any], numbers: dict[int, int]) -> Any:
        if isinstance(values[0], tuple):
            return tuple(self._parts(entries, numbers) for entries in zip(*values, strict=True))
        return None if values[0] is None else self._node(values, numbers)

    def _args(self, values: Sequence[Any]) -> Any:
        if isinstance(values[0], tuple):
            if any(len(v) != len(values[0]) for v in values):
                raise Unlike
            return tuple(self._args(entries) for entries in zip(*values, strict=True))
        return None if values[0] is None else self.arg(tuple(values))

    # -- values --------------------------------------------------------------------------------------------------------

    def arg(self, args: tuple[Arg, ...]) -> Arg:
        """The name or the literal for these, one a row."""
        key = tuple(map(_key, args))
        if key in self.known:
            return self.known[key]  # type: ignore[no-any-return]
        inner = [isinstance(a, str) and a in self.inner[row] for row, a in enumerate(args)]
        if len(set(key)) == 1 and not any(inner):
            return args[0]
        made = [self.made[row].get(a) if isinstance(a, str) else None for row, a in enumerate(args)]
        if all(m is not None for m in made) or any(inner):
            try:
                return self._made(args, made)
            except Unlike:
                if any(inner):
                    raise
        return self._column(args)

    def _column(self, args: tuple[Arg, ...]) -> str:
        if any(isinstance(a, int) and not isinstance(a, bool) for a in args):
            raise Unlike  # a power, or the number of a function
        key = tuple(map(_key, args))
        if key not in self.known:
            self.columns[args] = self.known[key] = self._name()
        return self.known[key]  # type: ignore[no-any-return]

    def _made(self, args: tuple[Arg, ...], made: Sequence[Any]) -> Arg:
        """A new statement for those that give the names of the rows."""
        numbers = {m[0] for m in made if m is not None}
        if len(numbers) != 1:
            raise Unlike
        negated = [m is not None and isinstance(m[1], Assign) and m[1].op == "neg" for m in made]
        if any(negated) and not all(negated):
            plain = tuple(m[1].args[0] if n else a for a, m, n in zip(args, made, negated, strict=True))
            signs = self._column(tuple(-1.0 if n else 1.0 for n in negated))
            return self._assign(args, "mul", (signs, self.arg(plain)), numbers.pop())
        if any(m is None for m in made):
            raise Unlike
        stmts = [m[1] for m in made]
        if not all(isinstance(s, Assign) for s in stmts):
            return self._of_results(args, stmts, numbers.pop())
        ops = {s.op for s in stmts}
        if len(ops) > 1:
            raise Unlike
        op, most = ops.pop(), max(len(s.args) for s in stmts)
        lists = [(*(1.0,) * (most - len(s.args)), *s.args) if op == "mul" else s.args for s in stmts]
        if any(len(entries) != most for entries in lists):
            raise Unlike
        if op == "tie":  # the number of a tie is for reports
            operands = (*(self.arg(entries) for entries in list(zip(*lists, strict=True))[:3]), lists[0][3])
        else:
            operands = tuple(self.arg(entries) for entries in zip(*lists, strict=True))
        return self._assign(args, op, operands, numbers.pop())

    def _of_results(self, args: tuple[Arg, ...], stmts: Sequence[Any], number: int) -> Arg:
        """A result of a statement with blocks."""
        places = {assigned(s).index(str(a)) if not isinstance(s, Assign) else -1 for s, a in zip(stmts, args, strict=True)}
        if len(places) != 1 or -1 in places or number == 0:
            raise Unlike
        for row, stmt in enumerate(stmts):  # its own names are noted as it is opened
            self.inner[row].difference_update(assigned(stmt))
        new = self.statement(stmts)
        self.blocks[number].append(new)
        return self.known[args]  # type: ignore[no-any-return]

    def _assign(self, args: tuple[Arg, ...], op: str, operands: tuple[Arg, ...], number: int) -> str:
        name = self._name()
        self.blocks[number].append(Assign(name, op, operands))
        self.known[tuple(map(_key, args))] = name
        return name

    def _name(self) -> str:
        return f"w{next(self.numbers)}"


def _key(arg: Arg) -> Any:
    """A key by which literals are compared: 0.0 and -0.0, True and 1.0 differ, and NaN is NaN."""
    return arg if isinstance(arg, str) else (type(arg), repr(arg))
