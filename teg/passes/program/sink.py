"""Moves values that only one polygon, segment or hyperbola uses into it: they are then computed only where they are needed.

    v = op(…);  results = ∫∫ over a polygon: body with v        →        results = ∫∫ over a polygon: setup v = op(…); body with v

Values that decide the domain of a polygon stay outside, as the decision does; values that only the ties of a segment or a hyperbola need
go to its `scales`. An assignment is moved once and never copied, so a program does not grow; a `tie` stays where it is. Linear in the
size of the program.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from teg.program import Arg, Assign, Program, Stmt, assigned, blocks, compound, free_names
from teg.program.fields import inner_blocks, operands, with_blocks

Place = tuple[int, int]
"""A block that receives statements: the number of its statement in the block around it, and its own among the receiving blocks."""


def sink(program: Program) -> Program:
    """Returns the program in which polygons, segments and hyperbolas compute the values that nothing else uses."""
    if not any(_receiving(s) for s in compound(program.body)):
        return program
    return replace(program, body=_sunk(program.body, program.outputs))


def _sunk(block: tuple[Stmt, ...], outputs: Iterable[Arg]) -> tuple[Stmt, ...]:
    users: dict[Arg, set[Place | None]] = {arg: {None} for arg in outputs}
    moved: dict[Place, list[Stmt]] = {}
    kept: list[tuple[int, Stmt]] = []

    def note(args: Iterable[Arg], user: Place | None) -> None:
        for arg in args:
            users.setdefault(arg, set()).add(user)

    for number in range(len(block) - 1, -1, -1):
        stmt = block[number]
        if isinstance(stmt, Assign):
            place = None if stmt.op == "tie" else _only_place(users.get(stmt.name, set()))
            note(stmt.args, place)
            if place is None:
                kept.append((number, stmt))
            else:
                moved.setdefault(place, []).append(stmt)
        elif receiving := _receiving(stmt):
            note(operands(stmt, at=""), None)
            for name, role, inside in inner_blocks(stmt):
                place = next(((number, receiving.index(r)) for r in (name, *role.sees) if r in receiving), None)
                note((*operands(stmt, at=name), *(arg for s in inside for arg in free_names(s))), place)
            kept.append((number, stmt))
        else:
            note(free_names(stmt), None)
            kept.append((number, _inside(stmt)))
    return tuple(_filled(stmt, number, moved) for number, stmt in reversed(kept))


def _receiving(stmt: Stmt) -> list[str]:
    """Returns the blocks of a statement that statements may be moved into, in the order in which they are run."""
    return [] if isinstance(stmt, Assign) else [name for name, role, _ in inner_blocks(stmt) if role.receives]


def _only_place(users: set[Place | None]) -> Place | None:
    """Returns the place of all users of a value, if they are in one statement: the first of its blocks if several use it."""
    places = {place for place in users if place is not None}
    return min(places) if None not in users and len({number for number, _ in places}) == 1 else None


def _filled(stmt: Stmt, number: int, moved: dict[Place, list[Stmt]]) -> Stmt:
    """Returns the statement with statements moved to the beginning of its blocks."""
    if not (receiving := _receiving(stmt)):
        return stmt
    inside = {name: block for name, _, block in inner_blocks(stmt)}
    return with_blocks(stmt, {r: (*reversed(moved.get((number, i), [])), *inside[r]) for i, r in enumerate(receiving)})


def _inside(stmt: Stmt) -> Stmt:
    """Returns the same inside the blocks of a statement that receives nothing itself."""
    if not any(_receiving(s) for block in blocks(stmt) for s in compound(block)):
        return stmt
    inside = list(inner_blocks(stmt))
    used = {name: [arg for s in block for arg in free_names(s)] for name, _, block in inside}
    own = [*operands(stmt), *assigned(stmt)]
    return with_blocks(
        stmt, {name: _sunk(block, [*own, *(a for other, args in used.items() if other != name for a in args)]) for name, _, block in inside}
    )
