"""Bodies of functions, programs of assignments only, put together and cut down before they are printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from teg.program import Arg, Assign, Program, statements
from teg.program.names import of_kind


def merged(bodies: Sequence[Program]) -> Program:
    """Returns programs of assignments, of the same parameters, as one with the outputs of all: what they have in common is done once."""
    body: list[Assign] = []
    known: dict[tuple[object, ...], str] = {}
    outputs: list[Arg] = []
    for program in bodies:
        new: dict[Arg, Arg] = {}
        for stmt in program.body:
            assert isinstance(stmt, Assign)
            key = (stmt.op, *((type(a), new.get(a, a)) for a in stmt.args))
            if key not in known:
                known[key] = of_kind(stmt.name, len(known))
                body.append(Assign(known[key], stmt.op, tuple(new.get(a, a) for a in stmt.args)))
            new[stmt.name] = known[key]
        outputs += [new.get(o, o) for o in program.outputs]
    return replace(bodies[0], body=tuple(body), outputs=tuple(outputs))


def used_inputs(body: Program) -> list[str]:
    """Returns the names of the parameters that matter."""
    needed = {arg for stmt in statements(body.body) if isinstance(stmt, Assign) for arg in stmt.args}.union(body.outputs)
    return [p for p in (f"p{i}" for i in range(len(body.parameters))) if p in needed]


def with_inputs(body: Program, used: Sequence[str]) -> Program:
    """Returns a program of assignments that has no other parameters than these."""
    new: dict[Arg, Arg] = {p: f"p{i}" for i, p in enumerate(used)}
    renamed = tuple(replace(s, args=tuple(new.get(a, a) for a in s.args)) for s in body.body if isinstance(s, Assign))
    return replace(body, parameters=tuple(used), body=renamed, outputs=tuple(new.get(o, o) for o in body.outputs))
