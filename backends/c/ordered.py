"""The order of the operations of a straight line, for processors that begin several of them at once.

    ordered(block, wanted)  ->  the assignments that the wanted names depend on, in another order, and the values that have names in it

List scheduling (Gibbons and Muchnick, 1986): of the expressions whose operands are there, the one first behind which the longest chain
follows; where as many values are alive as there are registers, one that ends the life of some. Results do not depend on the order.
"""

from __future__ import annotations

from bisect import insort
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from teg.program import Assign

REGISTERS = 28
"""Values that are alive at once, about."""
LATENCY, OF_A_QUOTIENT = 4, 14
"""Cycles after which the result of an operation is there."""
AT_ONCE = 2
"""Operations that begin in a cycle."""
LOOKED_AT = 32
"""Expressions that may be next, those with the longest chains behind them, among which one is chosen."""
TOGETHER = 6
"""Operations of an expression: values that are read once are computed where that is."""


@dataclass(slots=True, eq=False)
class _Expression:
    """Assignments that are printed as one expression. `behind` is the length of the longest chain from here to the end, in cycles, `there`
    the cycle in which its operands are."""

    lines: list[Assign]
    steps: int
    latency: int
    operands: list[_Expression] = field(default_factory=list)
    readers: list[_Expression] = field(default_factory=list)
    behind: int = 0
    there: float = 0.0
    missing: int = 0
    unread: int = 0

    def more_alive(self) -> int:
        """Returns how many more values are alive behind it."""
        return (self.unread > 0) - sum(operand.unread == 1 for operand in self.operands)


def ordered(block: Sequence[Assign], wanted: Iterable[str]) -> tuple[list[Assign], list[str]]:
    """Returns the assignments that the wanted names depend on, an operand before what reads it, and the last value of each expression."""
    expressions = _expressions(_needed(block, wanted), set(wanted))
    for e in reversed(expressions):
        e.behind = e.latency + max((r.behind for r in e.readers), default=0)
        e.missing, e.unread = len(e.operands), len(e.readers)
    ready = sorted((-e.behind, i, e) for i, e in enumerate(expressions) if not e.missing)
    order = {id(e): i for i, e in enumerate(expressions)}
    lines: list[Assign] = []
    names: list[str] = []
    alive, now = 0, 0.0
    while ready:
        full = alive >= REGISTERS

        def rank(entry: tuple[int, int, _Expression]) -> tuple[float, float, int, int]:
            height, i, e = entry
            wait = max(0.0, e.there - now)
            return (e.more_alive(), wait, height, i) if full else (wait, height, e.more_alive(), i)

        entry = min(ready[:LOOKED_AT], key=rank)
        ready.remove(entry)
        e = entry[2]
        lines += e.lines
        names.append(e.lines[-1].name)
        now = max(now, e.there) + e.steps / AT_ONCE
        for operand in e.operands:
            operand.unread -= 1
            alive -= not operand.unread
        alive += bool(e.readers)
        for r in e.readers:
            r.missing -= 1
            r.there = max(r.there, now + e.latency)
            if not r.missing:
                insort(ready, (-r.behind, order[id(r)], r))
    return lines, names


def _expressions(block: Sequence[Assign], wanted: set[str]) -> list[_Expression]:
    """Returns the assignments as expressions, each behind its operands."""
    uses = Counter(a for s in block for a in s.args if isinstance(a, str))
    made: dict[str, _Expression] = {}
    found: dict[int, _Expression] = {}
    for s in block:
        steps = max(1, len(s.args) - 1)
        e = _Expression([], steps, (OF_A_QUOTIENT if s.op == "div" else LATENCY) * steps)
        for a in dict.fromkeys(a for a in s.args if isinstance(a, str)):
            part = made.get(a)
            if part is None:
                continue
            if uses[a] == 1 and a not in wanted and e.steps + part.steps <= TOGETHER:
                e.lines += part.lines
                e.steps += part.steps
                e.latency += part.latency
                e.operands += [o for o in part.operands if o not in e.operands]
                del found[id(part)]
            elif part not in e.operands:
                e.operands.append(part)
        e.lines.append(s)
        made[s.name] = found[id(e)] = e
    for e in found.values():
        for operand in e.operands:
            operand.readers.append(e)
    return list(found.values())


def _needed(block: Sequence[Assign], wanted: Iterable[str]) -> list[Assign]:
    """Returns the assignments that the wanted names depend on, in their order."""
    live = set(wanted)
    kept: list[Assign] = []
    for s in reversed(block):
        if s.name in live:
            live.update(a for a in s.args if isinstance(a, str))
            kept.append(s)
    return kept[::-1]
