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

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from teg.backends.branches import with_branches
from teg.backends.c.crossed import Crossed, crossed
from teg.backends.c.items import Item, Nodes
from teg.backends.jax.selects import chosen_once
from teg.backends.text import PLAIN, Dialect, assignment, inside, strict, value
from teg.program import Arg, Assign, Program

MULTIPLIED = frozenset(("mul", "div", "abs", "gt0", "ge0", "lt0", "le0", "ok", "lower", "upper", "min", "max"))
"""Operations that are never one with a product that they need."""
LONGEST = 2500
"""Operations of a straight line that is not too long for XLA to compile."""


def straight(program: Program, dialect: Dialect) -> str | None:
    """Returns the text; None if a program has no straight line, or a long one."""
    line = crossed(with_branches(program), everywhere=True) if not program.functions else None
    if line is None or sum(map(_length, line.items)) > LONGEST:
        return None
    return "\n".join(_text(program, chosen_once(line), dialect))


def _length(item: Item) -> int:
    return (len(item.body) + 2 * len(item.values)) * len(item.weights) if isinstance(item, Nodes) else 1


def _text(program: Program, line: Crossed, dialect: Dialect) -> list[str]:
    dialect = replace(dialect, quotient=PLAIN)  # all kernels have the same quotients, which `together` computes once
    lines = [f"def straight({', '.join(['zero', *(f'p{i}' for i in range(len(program.parameters)))])}):"]
    exactly, free = _decisive(line.items) & _added(line.items), replace(dialect, guard="")
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


def _added(items: Sequence[Item]) -> set[Arg]:
    """Returns the names that something else than products, quotients and comparisons reads: a product may become one operation with a sum
    that reads it, without a rounding between. Products with a power of two are exact."""
    statements = list(_statements(items))
    exact = {s.name for s in statements if s.op == "mul" and len(s.args) == 2 and any(map(_is_power_of_two, s.args))}
    return {a for s in statements if s.op not in MULTIPLIED or -1.0 in s.args for a in s.args} - exact


def _statements(items: Sequence[Item]) -> Iterator[Assign]:
    for item in items:
        yield from (item,) if isinstance(item, Assign) else item.body


def _is_power_of_two(arg: Arg) -> bool:
    return isinstance(arg, float) and math.frexp(abs(arg))[0] == 0.5


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
