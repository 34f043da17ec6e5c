"""Walks over flat programs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

from teg.program.statements import (
    Arg,
    Assign,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Polygon,
    Program,
    Sample,
    Segment,
    Stmt,
    SumOver,
    When,
)


def blocks(stmt: Stmt) -> tuple[tuple[Stmt, ...], ...]:
    """The blocks inside a statement, in the order they are run."""
    match stmt:
        case Assign():  # most of them
            return ()
        case Integrate():
            return (stmt.flags, stmt.body) if stmt.guard is None else (stmt.flags, stmt.body, stmt.guard.block)
        case Isolate():
            return (stmt.enclosure, stmt.point)
        case Locate():
            return (stmt.enclosure,)
        case SumOver() | Sample() | When():
            return (stmt.body,)
        case Polygon():
            return (stmt.setup, stmt.body)
        case Segment():
            return (stmt.setup, stmt.scales, stmt.body)
        case Hyperbola():
            return (stmt.scales,)


def assigned(stmt: Stmt) -> tuple[str, ...]:
    """The names a statement gives a value."""
    match stmt:
        case Assign():
            return (stmt.name,)
        case Integrate() | Sample():
            return (*stmt.results, *stmt.estimates)
        case Isolate():
            return (*stmt.results, *stmt.errors)
        case Locate() if stmt.lost is not None:
            return (*stmt.results, stmt.lost)
        case _:
            return stmt.results


def statements(block: tuple[Stmt, ...]) -> Iterator[Stmt]:
    """Every statement of a block and of the blocks inside it, outermost first."""
    stack = list(reversed(block))
    while stack:
        stmt = stack.pop()
        yield stmt
        if not isinstance(stmt, Assign):
            for inner in reversed(blocks(stmt)):
                stack.extend(reversed(inner))


def compound(block: tuple[Stmt, ...]) -> Iterator[Stmt]:
    """The same but for assignments, which are most of them."""
    stack = [s for s in reversed(block) if not isinstance(s, Assign)]
    while stack:
        stmt = stack.pop()
        yield stmt
        for inner in reversed(blocks(stmt)):
            stack += [s for s in reversed(inner) if not isinstance(s, Assign)]


def has_ties(block: tuple[Stmt, ...]) -> bool:
    """Whether a run of a block can meet a tie."""
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
    """Number of statements, nested ones included."""
    return sum(1 for _ in statements(program.body))


def without_branches(program: Program) -> Program:
    """The program with every `When` written out, for backends in which many points run together: what is not wanted is replaced by 0."""
    if not any(isinstance(s, When) for s in statements(program.body)):
        return program
    numbers = count(1 + max(int(n[1:]) for s in statements(program.body) for n in assigned(s) if n[1:].isdigit()))
    return replace(program, body=_written_out(program.body, numbers))


def _written_out(block: tuple[Stmt, ...], numbers: Iterator[int]) -> tuple[Stmt, ...]:
    """Recursion is as deep as branches are in each other; there are none in loops."""
    result: list[Stmt] = []
    for stmt in block:
        match stmt:
            case When():
                for inner in _written_out(stmt.body, numbers):
                    other = {name: f"v{next(numbers)}" for name in assigned(inner) if name in stmt.results}
                    result.append(_giving(inner, other))
                    result += [Assign(name, "select", (stmt.when, value, 0.0)) for name, value in other.items()]
            case _:
                result.append(stmt)
    return tuple(result)


def _giving(stmt: Stmt, names: dict[str, str]) -> Stmt:
    """The same statement with other names for what it gives a value."""
    if not names:
        return stmt
    if isinstance(stmt, Assign):
        return replace(stmt, name=names[stmt.name])
    return replace(stmt, results=tuple(names.get(r, r) for r in stmt.results))


def clipped_by(stmt: Polygon | Segment) -> tuple[Arg, ...]:
    """What decides the domain of a polygon or a segment; but for the scales of ties, which are known in the block for them only."""
    if isinstance(stmt, Polygon):
        known = (stmt.across, *(arg for p in stmt.corners for arg in p)) if stmt.corners else ()
        return (stmt.width, stmt.height, *(arg for g in stmt.half_planes for arg in (g.a, g.b, g.c)), *known)
    return tuple(arg for g in stmt.half_lines for arg in (g.first, g.last, *((g.resolution, g.size) if g.k is not None else ())))
