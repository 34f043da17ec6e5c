"""Statements of the same text, run side by side: the quarters of an ellipse, the sides of a polygon, the ends of a box.

    r = ∫ f(x, 2, a) dx;  s = ∫ f(x, 3, -b) dx        →        (r, s) = for each row of (p, q, g) = (2, a, 1), (3, b, -1): ∫ f(x, p, g·q) dx

XLA compiles each copy of a text again, and each loop of it, in time that is longer than what the text computes. `with_rows` looks in every
block for statements with blocks that differ in numbers, in names from around them, and in signs, and makes one statement of them, `Rows`,
which JAX maps over the rows. What only they use is moved into it where it is alike too.

Two texts are compared from their results on, so the order of their statements does not matter. A product may have a factor more, and a
value may be negated in one of them. The operands of a sum or a product of two may stand in another order. Statements of a row must not need
results of another one.

Of two integrals the one with fewer breaks gets some that are NaN, which are none.

Where two texts have different operations, or read different variables, every row computes what any row needs there, and selects its own:

    ∫ f(sin x, x) dx, ∫ f(y, cos y) dy        →        for each row of (c) = (false), (true): ∫ f(c ? x : sin x, c ? cos x : x) dx

So the charts of a curve over x and over y, which have their coordinates in exchanged roles, are rows of one integral. A selected value is
what its own row computes: the other ones are not used, whatever they are. Rows with selects are made where they are much shorter than the
statements that they stand for (`SPARED`). A tie that is computed for other rows too is met by its own one only.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Annotated, Any

from teg.backends.branches import Uses
from teg.backends.jax.matching import Matching, Unlike, settings_of
from teg.program import Adaptive, Arg, Assign, Integrate, Isolate, Locate, Program, assigned, statements
from teg.program.dce import without_dead_code
from teg.program.fields import Block, Operand, Result, Variable, inner_blocks, operands, with_blocks
from teg.program.walk import free_in

MOST = 48
"""Statements with blocks in one block that are compared with each other, at most."""
LOOP = 40
"""What a search or an adaptive integral costs XLA beside its blocks, in statements."""
SPARED = 0.15
"""Rows with selects are made if they spare XLA this part of what the statements cost that they stand for."""


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
    uses = Uses(), Uses(hints=True)
    for first in compound:
        if id(first) in tried:
            continue
        group = [first]
        for other in compound:
            if id(other) in tried or other is first or not _looks_like(first, other):
                continue
            if _independent(stmts, [*group, other], uses[0]):
                group.append(other)
        group = [first, *(s for s in group[1:] if _with_group_as_rows(stmts, [first, s], outside, uses, numbers))]
        if len(group) > 1 and (changed := _with_group_as_rows(stmts, group, outside, uses, numbers)):
            tried.update(map(id, group))
            stmts = changed
    return tuple(stmts)


def _with_group_as_rows(
    stmts: Sequence[Any], group: Sequence[Any], needed: set[str], uses: tuple[Uses, Uses], numbers: Iterator[int]
) -> list[Any] | None:
    """Returns the block with rows instead of a group, or None if their texts differ too much; `uses` are without hints and with them."""
    found = _rows(stmts, group, needed, uses[1], numbers)
    if found is None:
        return None
    rows, selects = found
    changed = _live(_with(stmts, group, rows, uses[0]), needed, uses[1])
    return None if selects and _cost(stmts) - _cost(changed) < SPARED * _cost(group) else changed


def _inside(stmt: Any, numbers: Iterator[int]) -> Any:
    """A statement with rows in its blocks."""
    blocks = list(inner_blocks(stmt))
    seen = {a for name, _, _ in blocks for a in operands(stmt, name) if isinstance(a, str)}
    for _, _, inner in blocks:  # a block may read what another one gives
        seen |= set(free_in(inner))
    return with_blocks(stmt, {name: _grouped(inner, seen, numbers) for name, _, inner in blocks})


def _looks_like(one: Any, other: Any) -> bool:
    """Whether two statements may have much text in common: their settings are the same, and neither is much longer."""
    if type(one) is not type(other) or settings_of(one) != settings_of(other):
        return False
    costs = [_cost((s,)) for s in (one, other)]
    return max(costs) <= 2 * min(costs)


def _cost(block: Iterable[Any]) -> int:
    """Returns what a block costs XLA, in statements."""
    loops = (Isolate, Locate)
    return sum(LOOP if isinstance(s, loops) or isinstance(getattr(s, "rule", None), Adaptive) else 1 for s in statements(tuple(block)))


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


def _live(stmts: Sequence[Any], needed: set[str], uses: Uses) -> list[Any]:
    """The statements that something needed depends on."""
    used, kept = set(needed), []
    for stmt in reversed(stmts):
        if not isinstance(stmt, Assign) or stmt.name in used:
            kept.append(stmt)
            used.update(uses.of(stmt))
    return kept[::-1]


def _rows(stmts: Sequence[Any], group: Sequence[Any], needed: set[str], uses: Uses, numbers: Iterator[int]) -> tuple[Rows, int] | None:
    """The rows of a group, and how many values are selected in them; or None if their texts differ in more than that."""
    members = {id(s) for s in stmts if type(s) is type(group[0])}  # what statements of other rows use too may be computed again there
    others = {n.name for n in _live([s for s in stmts if id(s) not in members], needed, uses) if isinstance(n, Assign)}
    own = {s.name: s for s in stmts if isinstance(s, Assign) and s.name not in others}
    matching = Matching(len(group), own, numbers)
    try:
        body = matching.statement(_with_as_many_breaks(group))
    except (Unlike, RecursionError):  # texts that are nested too deeply are left as they are
        return None
    results = tuple(name for s in group for name in assigned(s))
    values = tuple(assigned(body))
    inside = without_dead_code(Program((), (*matching.blocks[0], body), values)).body
    read = free_in(inside)
    varying = {name: column for name, column in matching.columns.items() if name in read}
    if not varying:
        return None
    return Rows(tuple(varying), tuple(varying.values()), inside, values, results), matching.selects


def _with_as_many_breaks(group: Sequence[Any]) -> Sequence[Any]:
    """The statements; integrals have as many breaks as the one with the most. A break that is NaN is none."""
    if not all(isinstance(s, Integrate) for s in group):
        return group
    most = max(len(s.breaks) for s in group)
    return [replace(s, breaks=(*s.breaks, *(math.nan,) * (most - len(s.breaks)))) for s in group]
