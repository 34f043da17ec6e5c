"""Dead-code elimination: statements without a result that is used are left out, and the unused results of other statements."""

from __future__ import annotations

from dataclasses import replace

from teg.program.fields import inner_blocks, operands, selected, with_blocks
from teg.program.statements import Arg, Assign, Hyperbola, Program, Stmt
from teg.program.walk import assigned


def without_dead_code(program: Program) -> Program:
    """Returns the program without statements of which no result is used."""
    live: set[Arg] = set(program.outputs)
    return replace(program, body=_live_part(program.body, live))


def _live_part(block: tuple[Stmt, ...], live: set[Arg]) -> tuple[Stmt, ...]:
    """Returns the statements of a block that matter, given the names used after it; the names they use are added to `live`."""
    kept: list[Stmt] = []
    for stmt in reversed(block):
        if isinstance(stmt, Assign):  # most of them
            if stmt.name in live:
                live.update(stmt.args)
                kept.append(stmt)
        elif not live.isdisjoint(assigned(stmt)):
            stmt = selected(stmt, live)
            if isinstance(stmt, Hyperbola) and not any(m.kind == "border" for m in stmt.moments):
                stmt = replace(stmt, scales=(), scale=(), ties=())  # a region has no ties
            live.update(operands(stmt))
            inside = list(inner_blocks(stmt))
            kept.append(with_blocks(stmt, {name: _live_part(inner, live) for name, _, inner in reversed(inside)}))
    return tuple(reversed(kept))
