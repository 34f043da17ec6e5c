"""Move what only one polygon, segment or hyperbola uses into it: it is then computed where it is needed, and nowhere else.

    v = op(…);  results = ∫∫ over a polygon: body with v        →        results = ∫∫ over a polygon: setup v = op(…); body with v

What decides the domain of a polygon stays outside, as the decision does; what only the ties of a segment or a
hyperbola need goes to its `scales`. An assignment is moved once and never copied, so a program does not grow; a `tie` stays where it is.
Linear in the size of the program.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields, replace

from teg.program import (
    Arg,
    Assign,
    Hyperbola,
    Integrate,
    Polygon,
    Program,
    Sample,
    Segment,
    Stmt,
    SumOver,
    blocks,
    clipped_by,
    compound,
    statements,
)

Place = tuple[int, str]
"""A block inside a polygon or a segment: its number in the block around it, and "setup" or "scales"."""


def sink(program: Program) -> Program:
    """The program in which polygons, segments and hyperbolas compute for themselves what nothing else uses."""
    if not any(isinstance(s, Polygon | Segment | Hyperbola) for s in compound(program.body)):
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
        match stmt:
            case Assign():
                place = None if stmt.op == "tie" else _only_place(users.get(stmt.name, set()))
                note(stmt.args, place)
                if place is None:
                    kept.append((number, stmt))
                else:
                    moved.setdefault(place, []).append(stmt)
            case Polygon() | Segment():
                note((stmt.when or True, stmt.met if isinstance(stmt, Polygon) else True), None)
                note(clipped_by(stmt), None if isinstance(stmt, Polygon) else (number, "setup"))
                note((*_names(stmt.setup), *_names(stmt.body), *stmt.values, *stmt.factors), (number, "setup"))
                if isinstance(stmt, Segment):
                    note((*_names(stmt.scales), *(g.scale for g in stmt.half_lines)), (number, "scales"))
                kept.append((number, stmt))
            case Hyperbola():
                note((stmt.when or True, *stmt.corners, *(c for m in stmt.moments for _, _, c in m.terms)), None)
                note((*_names(stmt.scales), *stmt.scale), (number, "scales"))
                kept.append((number, stmt))
            case _:
                note(_names((stmt,)), None)
                kept.append((number, _inside(stmt)))
    return tuple(_filled(stmt, number, moved) for number, stmt in reversed(kept))


def _only_place(mine: set[Place | None]) -> Place | None:
    """Where all users of a value are, if that is one polygon or segment."""
    places = {place for place in mine if place is not None}
    if None in mine or len({number for number, _ in places}) != 1:
        return None
    return places.pop() if len(places) == 1 else (places.pop()[0], "setup")


def _filled(stmt: Stmt, number: int, moved: dict[Place, list[Stmt]]) -> Stmt:
    match stmt:
        case Polygon():
            return replace(stmt, setup=(*reversed(moved.get((number, "setup"), [])), *stmt.setup))
        case Segment():
            scales = (*reversed(moved.get((number, "scales"), [])), *stmt.scales)
            return replace(stmt, setup=(*reversed(moved.get((number, "setup"), [])), *stmt.setup), scales=scales)
        case Hyperbola():
            return replace(stmt, scales=(*reversed(moved.get((number, "scales"), [])), *stmt.scales))
        case _:
            return stmt


def _inside(stmt: Stmt) -> Stmt:
    """The same in the body of a loop."""
    if isinstance(stmt, Assign) or not any(isinstance(s, Polygon | Segment | Hyperbola) for b in blocks(stmt) for s in compound(b)):
        return stmt
    own = [arg for field in fields(stmt) for arg in _flat(getattr(stmt, field.name))]
    match stmt:
        case Integrate() | SumOver() | Sample():
            return replace(stmt, body=_sunk(stmt.body, own))
        case _:
            return stmt


def _names(block: Iterable[Stmt]) -> Iterator[str]:
    """Every name that statements, and those inside them, mention."""
    for stmt in statements(tuple(block)):
        for field in fields(stmt):
            yield from _flat(getattr(stmt, field.name))


def _flat(value: object) -> Iterator[str]:
    """The names in a field of a statement; statements inside it are left out."""
    stack = [value]
    while stack:
        item = stack.pop()
        if isinstance(item, str):
            yield item
        elif isinstance(item, tuple):
            stack.extend(item)
        elif hasattr(item, "__dataclass_fields__") and not isinstance(item, Stmt):
            stack.extend(getattr(item, field.name) for field in fields(item))  # type: ignore[arg-type]
