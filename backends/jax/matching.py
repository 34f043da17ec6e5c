"""The comparison of statements, row by row, of which `alike` makes rows: numbers, names and signs are columns, other operations selects."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from typing import Any

from teg.program import Arg, Assign, assigned
from teg.program.fields import Block, Operand, Part, Result, Variable, declared

UNREAD = "soft"
"""A setting of roots that backends do not read: only estimates of errors do, which are statements by now."""
SWAPPED = frozenset(("add", "mul", "max", "min", "and", "or"))
"""Operations whose first two operands may change places."""


class Unlike(Exception):
    """Two texts differ."""


class Hopeless(Unlike):
    """Two texts differ in more than operations."""


class Matching:
    """The comparison of some statements, row by row, and the one that stands for all of them.

    `known` has the name for values of the rows; `made` where, and by which statement, each row gives a name; `blocks` the new blocks, and
    `above` those that each of them sees. Block 0 is the one around the statements, of which those in `own`, which nothing else uses, may be
    moved into the rows. What is compared is needed in the block `place`.

    For each row, `stands` has a name that stands for its own one, and `shapes` what names are computed by, without the numbers in it; names
    of one shape are `shaped` for each block, with how many names were known then. `selects` counts the values that rows select, and those
    `wanted` have been begun.
    """

    def __init__(self, rows: int, own: dict[str, Assign], numbers: Iterator[int]) -> None:
        self.made: list[dict[str, tuple[int, Any]]] = [{n: (0, s) for n, s in own.items()} for _ in range(rows)]
        self.inner: list[set[str]] = [set() for _ in range(rows)]
        self.known: dict[tuple[Any, ...], Any] = {}
        self.columns: dict[str, tuple[Arg, ...]] = {}
        self.blocks: list[list[Any]] = [[]]
        self.numbers = numbers
        self.place = 0
        self.above: list[set[int]] = [set()]
        self.stands: list[dict[str, Arg]] = [{} for _ in range(rows)]
        self.shapes: list[dict[str, Any]] = [{} for _ in range(rows)]
        self.shaped: list[dict[int, tuple[int, dict[Any, list[str]]]]] = [{} for _ in range(rows)]
        self.selects = 0
        self.wanted: set[tuple[Any, ...]] = set()

    def statement(self, stmts: Sequence[Any]) -> Any:
        """One statement for all rows; its blocks hold what its operands need."""
        if len({type(s) for s in stmts}) > 1 or any(settings_of(s) != settings_of(stmts[0]) for s in stmts):
            raise Hopeless
        numbers = {"": self.place}
        self._open(stmts, numbers)
        return self._node(stmts, numbers)

    def _open(self, nodes: Sequence[Any], numbers: dict[str, int]) -> None:
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
                            self._know(names, self._name())
                            for row, name in enumerate(names):
                                self._new(row, name)
                case Block():
                    number = len(self.blocks)
                    self.blocks.append([])
                    seen = {numbers[""], *(numbers[name] for name in field.role.sees)}
                    self.above.append(seen.union(*(self.above[k] for k in seen)))
                    numbers[field.name] = number
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
            raise Hopeless  # one name for two values
        self.inner[row].add(name)

    @staticmethod
    def _alike_parts(parts: Sequence[Any]) -> None:
        if len({type(p) for p in parts}) > 1 or any(settings_of(p) != settings_of(parts[0]) for p in parts):
            raise Hopeless

    def _entries(self, values: Sequence[Any]) -> Iterator[tuple[Any, ...]]:
        """The entries of fields, side by side; fields of different lengths are unlike."""
        if any(isinstance(v, tuple) for v in values):
            if not all(isinstance(v, tuple) and len(v) == len(values[0]) for v in values):
                raise Hopeless
            for entries in zip(*values, strict=True):
                yield from self._entries(entries)
        elif any(v is None for v in values):
            if any(v is not None for v in values):
                raise Unlike
            yield (None,) * len(values)
        else:
            yield tuple(values)

    def _node(self, nodes: Sequence[Any], numbers: dict[str, int]) -> Any:
        """The node that stands for all: operands and parts first, since the blocks hold what these need."""
        new = {}
        own = declared(type(nodes[0]))
        for field in own:
            values = [getattr(n, field.name) for n in nodes]
            if isinstance(field.role, Part):
                new[field.name] = self._parts(values, numbers)
            elif not isinstance(field.role, Block):
                new[field.name] = self._at(numbers[getattr(field.role, "at", "")], self._args, values)
        new |= {f.name: tuple(self.blocks[numbers[f.name]]) for f in own if isinstance(f.role, Block)}
        return replace(nodes[0], **new)

    def _parts(self, values: Sequence[Any], numbers: dict[str, int]) -> Any:
        if isinstance(values[0], tuple):
            return tuple(self._parts(entries, numbers) for entries in zip(*values, strict=True))
        return None if values[0] is None else self._node(values, numbers)

    def _args(self, values: Sequence[Any]) -> Any:
        if isinstance(values[0], tuple):
            if any(len(v) != len(values[0]) for v in values):
                raise Hopeless
            return tuple(self._args(entries) for entries in zip(*values, strict=True))
        if any(v is None for v in values):
            if any(v is not None for v in values):
                raise Hopeless  # of an operand that only some of them have
            return None
        return self.arg(tuple(values))

    def _at(self, place: int, function: Callable[..., Any], *arguments: Any) -> Any:
        """The result of a function that may make statements in the block `place`."""
        before, self.place = self.place, place
        try:
            return function(*arguments)
        finally:
            self.place = before

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
            except Unlike as unlike:
                if any(inner):
                    if isinstance(unlike, Hopeless):
                        raise
                    return self._selected(args, made)
        return self._column(args)

    def _column(self, args: tuple[Arg, ...]) -> str:
        if any(isinstance(a, int) and not isinstance(a, bool) for a in args):
            raise Unlike  # a power, or the number of a function
        key = tuple(map(_key, args))
        if key not in self.known:
            self.columns[self._know(args, self._name())] = args
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
            number = numbers.pop()
            return self._assign(args, "mul", (signs, self._at(number, self.arg, plain)), number)
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
        number = numbers.pop()
        columns = list(zip(*self._in_order(op, lists), strict=True))
        if op == "tie":  # the number of a tie is for reports
            operands = (*(self._at(number, self.arg, entries) for entries in columns[:3]), lists[0][3])
        else:
            operands = tuple(self._at(number, self.arg, entries) for entries in columns)
        return self._assign(args, op, operands, number)

    def _of_results(self, args: tuple[Arg, ...], stmts: Sequence[Any], number: int) -> Arg:
        """A result of a statement with blocks."""
        places = {assigned(s).index(str(a)) if not isinstance(s, Assign) else -1 for s, a in zip(stmts, args, strict=True)}
        if len(places) != 1 or -1 in places or number == 0:
            raise Unlike
        for row, stmt in enumerate(stmts):  # its own names are noted as it is opened
            self.inner[row].difference_update(assigned(stmt))
        new = self._at(number, self.statement, stmts)
        self.blocks[number].append(new)
        return self.known[args]  # type: ignore[no-any-return]

    def _assign(self, args: tuple[Arg, ...], op: str, operands: tuple[Arg, ...], number: int) -> str:
        name = self._name()
        self.blocks[number].append(Assign(name, op, operands))
        return self._know(args, name)

    def _know(self, args: tuple[Arg, ...], name: str) -> str:
        """Notes the name for these, one a row."""
        self.known[tuple(map(_key, args))] = name
        for stands, a in zip(self.stands, args, strict=True):
            if isinstance(a, str) and a not in stands:
                stands[a] = name
        return name

    # -- values that are computed differently --------------------------------------------------------------------------

    def _selected(self, args: tuple[Arg, ...], made: Sequence[Any]) -> Arg:
        """A name for values that the rows compute differently: all rows compute all of them, and each selects its own."""
        numbers = {m[0] for m in made if m is not None and m[0]}
        variables = any(
            m is None and isinstance(a, str) and a in self.inner[row] for row, (a, m) in enumerate(zip(args, made, strict=True))
        )
        number = self.place if variables else max(numbers, default=self.place)
        key: tuple[Any, ...] = (*map(_key, args), number)
        if key in self.known:
            return self.known[key]  # type: ignore[no-any-return]
        if not numbers - {number} <= self.above[number] or any(isinstance(a, int) and not isinstance(a, bool) for a in args):
            raise Hopeless
        if key in self.wanted:
            raise Hopeless  # it would be needed for itself
        self.wanted.add(key)
        values = [self._at(number, self._of_row, row, a) for row, a in enumerate(args)]
        found: Arg = values[0]
        for value in dict.fromkeys(values[1:]):
            if value != values[0]:
                name = self._name()
                mine = self._column(tuple(v == value for v in values))
                self.blocks[number].append(Assign(name, "select", (mine, value, found)))
                found = name
        self.selects += 1
        self.known[key] = found
        return found

    def _of_row(self, row: int, a: Arg) -> Arg:
        """The name or the literal that has the value of one row, in this row."""
        if not isinstance(a, str) or a not in self.inner[row]:
            return a
        if a in self.stands[row]:
            return self.stands[row][a]
        number, stmt = self.made[row][a]
        if not isinstance(stmt, Assign):
            raise Hopeless
        place = number, self._shape(row, a)
        same = [self._of_shape(r, place) for r in range(len(self.made))]
        if all(same):
            ordinal = same[row].index(a)
            return self.arg(tuple(a if r == row else names[min(ordinal, len(names) - 1)] for r, names in enumerate(same)))
        args = tuple(self._at(number, self._of_row, row, v) for v in stmt.args)
        if stmt.op == "tie":
            args = (args[0], self._only_of(row, args[1], number), *args[2:])
        name = self._name()
        self.blocks[number].append(Assign(name, stmt.op, args))
        self.stands[row][a] = name
        return name

    def _only_of(self, row: int, scale: Arg, number: int) -> Arg:
        """The scale of a tie that only one row may meet: that of others is negative, and nothing is as near to 0 as that."""
        if not isinstance(scale, str):
            return self._column(tuple(scale if r == row else -1.0 for r in range(len(self.made))))
        name = self._name()
        mine = self._column(tuple(r == row for r in range(len(self.made))))
        self.blocks[number].append(Assign(name, "select", (mine, scale, -1.0)))
        return name

    def _shape(self, row: int, a: Arg) -> Any:
        """What is the same for values that are computed alike."""
        if not isinstance(a, str) or a not in self.inner[row]:
            return "outside" if isinstance(a, str | float | bool) else a
        if a not in self.shapes[row]:
            stmt = self.made[row].get(a, (0, None))[1]
            if isinstance(stmt, Assign):
                shape: Any = hash((stmt.op, *(self._shape(row, v) for v in stmt.args)))
            else:
                shape = ("variable", self.stands[row].get(a)) if stmt is None else (type(stmt), assigned(stmt).index(a))
            self.shapes[row][a] = shape
        return self.shapes[row][a]

    def _of_shape(self, row: int, place: tuple[int, Any]) -> list[str]:
        """The values in a block of one row that have a shape."""
        number, shape = place
        made, shaped = self.shaped[row].get(number, (0, {}))
        if made != len(self.made[row]):
            shaped = {}
            for name, (own, s) in self.made[row].items():
                if own == number and isinstance(s, Assign):
                    shaped.setdefault(self._shape(row, name), []).append(name)
            self.shaped[row][number] = len(self.made[row]), shaped
        return shaped.get(shape, [])

    def _in_order(self, op: str, lists: Sequence[tuple[Arg, ...]]) -> list[tuple[Arg, ...]]:
        """The operands of the rows, the first two in the order that makes them most alike."""
        if op not in SWAPPED or len(lists[0]) < 2:
            return list(lists)
        first = [self._shape(0, a) for a in lists[0][:2]]
        swaps = []
        for row, (a, b, *_) in enumerate(lists):
            shapes = [self._shape(row, v) for v in (a, b)]
            kept, changed = (sum(s == t for s, t in zip(first, order, strict=True)) for order in (shapes, shapes[::-1]))
            swaps.append(changed > kept)
        return [(b, a, *more) if swap else (a, b, *more) for swap, (a, b, *more) in zip(swaps, lists, strict=True)]

    def _name(self) -> str:
        return f"w{next(self.numbers)}"


def _key(arg: Arg) -> Any:
    """A key by which literals are compared: 0.0 and -0.0, True and 1.0 differ, and NaN is NaN."""
    return arg if isinstance(arg, str) else (type(arg), repr(arg))


def settings_of(node: Any) -> list[Any]:
    """Returns the settings of a statement that backends read."""
    known = {f.name for f in declared(type(node))}
    return [getattr(node, f.name) for f in fields(node) if f.name not in known and f.name != UNREAD]
