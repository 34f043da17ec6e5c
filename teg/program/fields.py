"""How statements are declared: the role of every field, and the walks that follow from the roles alone.

A statement is a frozen dataclass. An annotation gives each field that holds names or statements its role; a field without a role is a
setting, plain data.

    @dataclass(frozen=True, slots=True)
    class SumOver:
        var: Annotated[str, Variable(("body",))]                            known in the block `body` only
        points: Annotated[tuple[Arg, ...], NUMBER]                          read before the statement is run
        body: Annotated[tuple[Stmt, ...], Block()]
        values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]   read at the end of `body`, one for each result
        results: Annotated[tuple[str, ...], Result()]                       known after the statement
        when: Annotated[str | None, CONDITION] = None

The functions below walk statements of flat programs and steps of array programs alike; those that go through whole blocks are in
`teg.program.walk` and `teg.program.arrays`. None knows a class of statements: a new one is walked as soon as it is declared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_type_hints

Kind = Literal["number", "condition", "integer", "any"]
"""What a name or a literal stands for; "any" where the operation of the statement says it."""


@dataclass(frozen=True, slots=True)
class Operand:
    """Names and literals that are read: in the block `at`, after it was run; if it is empty, around the statement, before it is run.

    `each`: one entry for each result, or for the first ones; it is left out with its result. `hint`: for passes, no backend reads it.
    """

    kind: Kind = "number"
    at: str = ""
    each: bool = False
    hint: bool = False


@dataclass(frozen=True, slots=True)
class Variable:
    """Names that the statement gives values in some of its blocks, again and again."""

    blocks: tuple[str, ...]
    kind: Kind = "number"


@dataclass(frozen=True, slots=True)
class Result:
    """Names that the statement gives values, known after it. Those of a statement with blocks are in a field called `results`.

    Results that are not used are left out, unless they are `fixed`: then their number is part of the meaning. `each`: a field of names that
    belong to the results, or to the first ones, entry by entry; it is empty if none of them is used. With `made_in`, the name of a
    block, the names are those of results of statements in that block. Where the condition `when` of the statement fails nothing is run,
    and the results are `absent`.
    """

    kind: Kind = "number"
    fixed: bool = False
    each: bool = False
    made_in: str = ""
    absent: float = 0.0


@dataclass(frozen=True, slots=True)
class Block:
    """Statements that are run inside of the statement. They know names around it, and those of the blocks in `sees`, which run before.

    `receives`: statements around it that nothing else uses may be moved into the block.
    """

    sees: tuple[str, ...] = ()
    receives: bool = False


@dataclass(frozen=True, slots=True)
class Part:
    """A dataclass with roles of its own, or a tuple of them, or None; `each`: one for each result. Blocks that its roles name are those
    of the statement."""

    each: bool = False


Role = Operand | Variable | Result | Block | Part
NUMBER = Operand()
CONDITION = Operand("condition")
INTEGER = Operand("integer")


class Declared(NamedTuple):
    """A field and its role."""

    name: str
    role: Role


_DECLARED: dict[type, tuple[Declared, ...]] = {}
_NESTING: dict[type, tuple[Declared, ...]] = {}


def declared(cls: type) -> tuple[Declared, ...]:
    """Returns the fields of a dataclass that have a role, in order."""
    if cls not in _DECLARED:
        hints = get_type_hints(cls, include_extras=True)
        roles = ((f.name, role) for f in fields(cls) for role in get_args(hints[f.name])[1:] if isinstance(role, Role))
        _DECLARED[cls] = tuple(Declared(*pair) for pair in roles)
    return _DECLARED[cls]


def _nesting(cls: type) -> tuple[Declared, ...]:
    """Returns the fields of a dataclass that may hold blocks."""
    if cls not in _NESTING:
        _NESTING[cls] = tuple(field for field in declared(cls) if isinstance(field.role, Block | Part))
    return _NESTING[cls]


def flat(value: object) -> Iterator[Any]:
    """Yields the entries of a tuple, of the tuples in it, and so on; None has no entries."""
    for entry in value if isinstance(value, tuple) else (value,):
        if isinstance(entry, tuple):
            yield from flat(entry)
        elif entry is not None:
            yield entry


def leaves(node: object) -> Iterator[tuple[Operand | Variable | Result, Any]]:
    """Yields every name and literal of a statement itself with its role, in the order of the fields; those of statements in it are left
    out."""
    for field in declared(type(node)):
        value, role = getattr(node, field.name), field.role
        if isinstance(role, Part):
            for part in flat(value):
                yield from leaves(part)
        elif not isinstance(role, Block):
            for arg in flat(value):
                yield role, arg


def operands(node: object, at: str | None = None, hints: bool = True) -> list[Any]:
    """Returns the names and literals that a statement reads itself: all, or those that are read in the block `at`, or around it ("")."""
    return [a for r, a in leaves(node) if isinstance(r, Operand) and (at is None or r.at == at) and (hints or not r.hint)]


def variables(node: object, block: str | None = None) -> list[str]:
    """Returns the variables of a statement: all, or those that are known in a block."""
    return [name for role, name in leaves(node) if isinstance(role, Variable) and (block is None or block in role.blocks)]


def result_names(node: object) -> tuple[str, ...]:
    """Returns the names that a statement gives values, known after it."""
    return tuple(name for role, name in leaves(node) if isinstance(role, Result))


def absent(node: object) -> dict[str, float]:
    """Returns the results of a statement where its condition fails."""
    return {name: role.absent for role, name in leaves(node) if isinstance(role, Result)}


def inner_blocks(node: object) -> Iterator[tuple[str, Block, tuple[Any, ...]]]:
    """Yields the blocks of a statement with their names and roles, in the order in which they are run."""
    for field in _nesting(type(node)):
        if isinstance(field.role, Block):
            yield field.name, field.role, getattr(node, field.name)
        else:
            for part in flat(getattr(node, field.name)):
                yield from inner_blocks(part)


T = TypeVar("T")


def rebuilt(node: T, change: Callable[[Declared, Any], Any]) -> T:
    """Returns the statement with other values of its fields that have a role; those of its parts are changed one by one."""
    new = {}
    for field in declared(type(node)):
        old = getattr(node, field.name)
        value = _in_parts(old, change) if isinstance(field.role, Part) else change(field, old)
        if value is not old:
            new[field.name] = value
    return replace(node, **new) if new else node  # type: ignore[type-var]


def _in_parts(value: Any, change: Callable[[Declared, Any], Any]) -> Any:
    if isinstance(value, tuple):
        return tuple(_in_parts(part, change) for part in value)
    return value if value is None else rebuilt(value, change)


def with_blocks(node: T, blocks: Mapping[str, tuple[Any, ...]]) -> T:
    """Returns the statement with other statements in some of its blocks, by their names."""
    return rebuilt(node, lambda field, old: blocks.get(field.name, old) if isinstance(field.role, Block) else old)


def renamed(node: T, names: Mapping[str, Any]) -> T:
    """Returns the statement, and those inside it, with other names."""

    def new(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(new(entry) for entry in value)
        return names.get(value, value) if isinstance(value, str) else value

    def change(field: Declared, old: Any) -> Any:
        return tuple(renamed(s, names) for s in old) if isinstance(field.role, Block) else new(old)

    return rebuilt(node, change)


def selected(node: T, live: Set[Any]) -> T:
    """Returns the statement without those results that are not among the live names, as far as they can be left out, and what belongs to
    them."""
    own = declared(type(node))
    fixed = any(isinstance(f.role, Result) and f.role.fixed for f in own)
    beside = [getattr(node, f.name) for f in own if isinstance(f.role, Result) and f.role.each]
    also = {i for names in beside for i, name in enumerate(names) if name in live}
    results: tuple[str, ...] = node.results  # type: ignore[attr-defined]
    kept = [i for i, name in enumerate(results) if fixed or name in live or i in also]

    def change(field: Declared, old: Any) -> Any:
        match field.role:
            case Result(each=True) if live.isdisjoint(old):
                return ()
            case Result(each=True) | Operand(each=True):
                return _entries(old, kept)
            case Result() if field.name == "results":
                return _entries(old, kept)
            case _:
                return old

    parts = {f.name: _entries(getattr(node, f.name), kept) for f in own if isinstance(f.role, Part) and f.role.each}
    return rebuilt(replace(node, **parts) if parts else node, change)  # type: ignore[type-var]


def _entries(values: tuple[Any, ...], kept: list[int]) -> tuple[Any, ...]:
    """Returns the entries that are kept; the tuple itself if these are all."""
    entries = tuple(values[i] for i in kept if i < len(values))
    return values if len(entries) == len(values) else entries
