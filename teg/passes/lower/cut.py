"""A flat program cut where its statements stop depending on an index, so that each part runs in the outermost loop that it can.

    cell(u, v[k]),  u outside of the loop over k     →     t = part₀(u)  in front of the loop;   part₁(t, v[k])  in it

Values that meet ties stay together, in the innermost part: they are averaged together. Cost: a visit a statement and part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from teg.program import Assign, Program, Stmt, assigned, free_names, has_ties
from teg.program.dce import without_dead_code
from teg.program.fields import renamed
from teg.program.names import is_condition, is_parameter, parameter_number


class Part(NamedTuple):
    """Statements of one loop: how deep it is, and the names of what they compute that is needed elsewhere."""

    depth: int
    block: tuple[Stmt, ...]
    across: list[str]


def parts_of(program: Program, depths: Sequence[int], levels: Sequence[int]) -> list[Part]:
    """Returns the parts of a program whose parameters are known so deep, for loops of these depths, outermost first."""
    depth: dict[str, int] = {f"p{k}": d for k, d in enumerate(depths)}
    blocks: dict[int, list[Stmt]] = {at: [] for at in levels}
    readers: dict[str, set[int]] = {o: {-1} for o in program.outputs if isinstance(o, str)}  # an output is needed elsewhere
    for stmt in program.body:
        read = free_names(stmt)
        here = levels[-1] if has_ties((stmt,)) else max((depth[n] for n in read), default=0)
        blocks[here].append(stmt)
        depth.update(dict.fromkeys(assigned(stmt), here))
        for n in read:
            readers.setdefault(n, set()).add(here)
    return [Part(at, tuple(block), [n for s in block for n in assigned(s) if readers.get(n, {at}) - {at}]) for at, block in blocks.items()]


def program_of(part: Part, program: Program) -> tuple[Program, list[str]]:
    """Returns the program of a part, and the names of what it reads from others; a boolean is passed on as 1 or 0."""
    own = {n for s in part.block for n in assigned(s)}
    used = list(dict.fromkeys(n for s in part.block for n in free_names(s) if n not in own))
    number = {n: f"p{k}" for k, n in enumerate(used)}
    number.update((n, f"b{n}") for n in used if is_condition(n))
    before = [Assign(f"b{n}", "gt0", (f"p{k}",)) for k, n in enumerate(used) if is_condition(n)]
    after = [Assign(f"v{n}", "select", (n, 1.0, 0.0)) for n in part.across if is_condition(n)]
    results = tuple(f"v{n}" if is_condition(n) else n for n in part.across)
    titles = tuple(program.parameters[parameter_number(n)] if is_parameter(n) else n for n in used)
    body = (*before, *(renamed(s, number) for s in part.block), *after)
    ties = program.ties if has_ties(part.block) else ()
    return without_dead_code(replace(program, parameters=titles, body=body, outputs=results, ties=ties)), used
