"""Flat programs as text, for people: a statement a line, blocks indented."""

from __future__ import annotations

from dataclasses import fields

from teg.program import Assign, Program, Stmt, assigned, blocks


def listing(program: Program) -> str:
    """Returns the text of a program."""
    lines = [f"p{i} = {name!r}" for i, name in enumerate(program.parameters)]
    waiting = [(stmt, 0) for stmt in reversed(program.body)]
    while waiting:
        stmt, depth = waiting.pop()
        lines.append("    " * depth + _line(stmt))
        inner = [s for block in blocks(stmt) for s in block]
        waiting += [(s, depth + 1) for s in reversed(inner)]
    return "\n".join([*lines, f"outputs {' '.join(map(str, program.outputs))}"])


def _line(stmt: Stmt) -> str:
    """Returns a statement without the blocks inside it."""
    results = ", ".join(assigned(stmt))
    if isinstance(stmt, Assign):
        return f"{results} = {stmt.op}({', '.join(map(str, stmt.args))})"
    inside = [id(block) for block in blocks(stmt)]
    values = [(f.name, getattr(stmt, f.name)) for f in fields(stmt) if f.name not in ("results", "estimates", "guard")]
    shown = [f"{name}={value}" for name, value in values if id(value) not in inside and value not in (None, (), "")]
    return f"{results} = {type(stmt).__name__}({', '.join(shown)})"
