"""The straight line of a program (`teg.backends.c.crossed`), for boxes that surfaces cross, as text of JAX.

    straight(program, dialect)  ->  the text of a function of the parameters: the outputs, and whether they are right

Sums over nodes are calls, few and short ones:

    def straight(zero, p0, p1):
        v0 = p0 * p1 + zero
        def nodes_1(v1):
            v2 = v0 * v1
            return (v2,)
        (v3,) = rt.weighted(nodes_1, ((0.25, 0.75),), (0.5, 0.5))
        return (v3,), b4
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from teg.backends.branches import with_branches
from teg.backends.c.crossed import Crossed, Item, Nodes, crossed
from teg.backends.text import Dialect, assignment, inside, strict, value
from teg.program import Arg, Assign, Program

LONGEST = 2500
"""Operations of a straight line that is not too long for XLA to compile."""


def straight(program: Program, dialect: Dialect) -> str | None:
    """Returns the text; None if a program has no straight line, or a long one."""
    line = crossed(with_branches(program), everywhere=True) if not program.functions else None
    return None if line is None or sum(map(_length, line.items)) > LONGEST else "\n".join(_text(program, line, dialect))


def _length(item: Item) -> int:
    return (len(item.body) + 2 * len(item.values)) * len(item.weights) if isinstance(item, Nodes) else 1


def _text(program: Program, line: Crossed, dialect: Dialect) -> list[str]:
    lines = [f"def straight({', '.join(['zero', *(f'p{i}' for i in range(len(program.parameters)))])}):"]
    exactly, free = _decisive(line.items), replace(dialect, guard="")
    for number, item in enumerate(line.items):
        if isinstance(item, Nodes):
            text = _nodes(number, item, free)
        else:
            text = assignment(item, dialect if item.name in exactly else free)
        lines += [f"    {t}" for t in text]
    outputs = inside(value(o, dialect.module) for o in line.outputs)
    return [*lines, f"    return ({outputs}), {strict(line.good, dialect.module)}", ""]


def _decisive(items: Sequence[Item]) -> set[Arg]:
    """Returns the names that quotients, what is multiplied by them, and the conditions of choices depend on. Each kernel of XLA has a copy
    of what it needs, and all copies must have the same bits: where two lines cross at a flat angle, a rounding is a long way."""
    quotients: set[Arg] = {item.name for item in items if isinstance(item, Assign) and item.op == "div"}
    found: set[Arg] = set()
    for item in reversed(items):
        if isinstance(item, Nodes):
            continue
        if item.name in found or item.op == "div" or (item.op == "mul" and not quotients.isdisjoint(item.args)):
            found.update(item.args)
        elif item.op == "select":
            found.add(item.args[0])
    return found


def _nodes(number: int, item: Nodes, dialect: Dialect) -> list[str]:
    """The function of a node, and the sums over all of them."""
    places = inside(f"({inside(map(repr, at))})" for at in item.places.values())
    weights = inside(value(w, dialect.module) for w in item.weights)
    values = inside(value(v, dialect.module) for v in item.values)
    return [
        f"def nodes_{number}({', '.join(item.places)}):",
        *(f"    {text}" for s in item.body for text in assignment(s, dialect)),
        f"    return ({values})",
        f"({inside(item.sums)}) = rt.weighted(nodes_{number}, ({places}), ({weights}))",
    ]
