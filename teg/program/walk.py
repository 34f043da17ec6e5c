"""Walks over flat programs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from teg.program.fields import inner_blocks, operands, renamed, result_names, variables
from teg.program.names import unused_numbers
from teg.program.statements import (
    Assign,
    Hyperbola,
    Program,
    Segment,
    Stmt,
    When,
)


def blocks(stmt: Stmt) -> tuple[tuple[Stmt, ...], ...]:
    """Returns the blocks inside a statement, in the order they are run."""
    return () if isinstance(stmt, Assign) else tuple(block for _, _, block in inner_blocks(stmt))  # most of them are assignments


def assigned(stmt: Stmt) -> tuple[str, ...]:
    """Returns the names a statement gives a value."""
    return (stmt.name,) if isinstance(stmt, Assign) else result_names(stmt)


def free_names(stmt: Stmt, hints: bool = True) -> dict[str, None]:
    """Returns the names that a statement, and those inside it, read and do not give themselves, in order."""
    if isinstance(stmt, Assign):
        return {a: None for a in stmt.args if isinstance(a, str)}
    names = [a for a in operands(stmt, hints=hints) if isinstance(a, str)]
    own = set(variables(stmt))
    for block in blocks(stmt):
        names += free_in(block, hints)
        own.update(name for inner in block for name in assigned(inner))
    return {name: None for name in names if name not in own}


def free_in(block: Iterable[Stmt], hints: bool = True) -> dict[str, None]:
    """Returns the names that the statements of a block read and the block does not give, in order."""
    names: dict[str, None] = {}
    own: set[str] = set()
    for stmt in block:
        names |= free_names(stmt, hints)
        own.update(assigned(stmt))
    return {name: None for name in names if name not in own}


def captured(stmt: Stmt, *names: str) -> tuple[list[str], list[str]]:
    """Returns the names that some blocks of a statement, and the operands that are read in these blocks, take from around the statement;
    and the names that they take from its other blocks."""
    used: list[str] = []
    own: set[str] = set()
    others: set[str] = set()
    for name, _, block in inner_blocks(stmt):
        given_there = {n for inner in block for n in assigned(inner)}
        if name not in names:
            others |= given_there
            continue
        own.update(given_there, variables(stmt, name))
        used += [*free_in(block), *(a for a in operands(stmt, name) if isinstance(a, str))]
    outside = [name for name in dict.fromkeys(used) if name not in own]
    return [name for name in outside if name not in others], [name for name in outside if name in others]


def statements(block: tuple[Stmt, ...]) -> Iterator[Stmt]:
    """Yields every statement of a block and of the blocks inside it, outermost first."""
    stack = list(reversed(block))
    while stack:
        stmt = stack.pop()
        yield stmt
        if not isinstance(stmt, Assign):
            for inner in reversed(blocks(stmt)):
                stack.extend(reversed(inner))


def compound(block: tuple[Stmt, ...]) -> Iterator[Stmt]:
    """Yields the same but for assignments, which are most of them."""
    stack = [s for s in reversed(block) if not isinstance(s, Assign)]
    while stack:
        stmt = stack.pop()
        yield stmt
        for inner in reversed(blocks(stmt)):
            stack += [s for s in reversed(inner) if not isinstance(s, Assign)]


def has_ties(block: tuple[Stmt, ...]) -> bool:
    """Returns whether a run of a block can meet a tie."""
    waiting = [block]
    while waiting:
        stmts = waiting.pop()
        for s in stmts:
            if isinstance(s, Assign):
                if s.op == "tie":
                    return True
            elif (isinstance(s, Hyperbola) and s.ties) or (isinstance(s, Segment) and any(g.k is not None for g in s.half_lines)):
                return True
            else:
                waiting += blocks(s)
    return False


def size(program: Program) -> int:
    """Returns the number of statements, nested ones included."""
    return sum(1 for _ in statements(program.body))


def without_branches(program: Program) -> Program:
    """Returns the program with every `When` written out, for backends in which many points run together. Where a branch is not taken, its
    results are replaced by 0."""
    if not any(isinstance(s, When) for s in statements(program.body)):
        return program
    numbers = unused_numbers(n for s in statements(program.body) for n in assigned(s))
    return replace(program, body=_written_out(program.body, numbers))


def _written_out(block: tuple[Stmt, ...], numbers: Iterator[int]) -> tuple[Stmt, ...]:
    """Returns the block with every `When` written out. Recursion is as deep as branches are in each other; loops have none."""
    result: list[Stmt] = []
    for stmt in block:
        match stmt:
            case When():
                for inner in _written_out(stmt.body, numbers):
                    other = {name: f"v{next(numbers)}" for name in assigned(inner) if name in stmt.results}
                    result.append(renamed(inner, other))
                    result += [Assign(name, "select", (stmt.when, value, 0.0)) for name, value in other.items()]
            case _:
                result.append(stmt)
    return tuple(result)
