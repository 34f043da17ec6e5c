"""The order of the operations of a straight line, for processors that begin several of them at once.

    ordered(block, wanted)  ->  the assignments that the wanted names depend on, in another order, and the last value of each expression

List scheduling (Gibbons and Muchnick, 1986): of the expressions whose operands are there, the one first behind which the longest chain
follows; where as many values are alive as there are registers, one that ends the life of some. Results do not depend on the order.
"""

from __future__ import annotations

from bisect import insort
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

from teg.program import Assign

REGISTERS = 28
"""Values that are alive at once, about: four of the 32 registers of eight numbers are left for literals and what is shared."""
LATENCY, OF_A_QUOTIENT = 4, 14
"""Cycles after which the result of an operation is there."""
AT_ONCE = 2
"""Operations that begin in a cycle."""
LOOKED_AT = 32
"""Expressions that may be next, those with the longest chains behind them, among which one is chosen."""
LONGEST = 3
"""Operations of an expression. A value that is read once is computed where that is."""


@dataclass(slots=True, eq=False)
class _Expression:
    """Assignments that are printed as one expression. `behind` is the length of the longest chain from here to the end, in cycles; `there`
    is when its operands are, `missing` and `unread` count those that are not, and the readers that are left."""

    number: int
    lines: list[Assign]
    steps: int
    latency: int
    operands: dict[_Expression, None] = field(default_factory=dict)
    readers: list[_Expression] = field(default_factory=list)
    behind: int = 0
    there: float = 0.0
    missing: int = 0
    unread: int = 0

    def rank(self, now: float, full: bool) -> tuple[float, float, int, int]:
        """Returns what is least for the expression that is next at a time; if all registers are `full`, one that needs no more of them."""
        more = (self.unread > 0) - sum(operand.unread == 1 for operand in self.operands)
        wait = max(0.0, self.there - now)
        return (more, wait, -self.behind, self.number) if full else (wait, -self.behind, more, self.number)


def ordered(block: Sequence[Assign], wanted: Collection[str]) -> tuple[list[Assign], list[str]]:
    """Returns the assignments that the wanted names depend on, an operand before what reads it, and the last value of each expression."""
    expressions = _expressions(_needed(block, wanted), wanted)
    ready = sorted((-e.behind, e.number, e) for e in expressions if not e.missing)
    lines: list[Assign] = []
    names: list[str] = []
    alive, now = 0, 0.0
    while ready:
        ranks = [entry[2].rank(now, alive >= REGISTERS) for entry in ready[:LOOKED_AT]]
        _, _, e = ready.pop(ranks.index(min(ranks)))
        lines += e.lines
        names.append(e.lines[-1].name)
        now = max(now, e.there) + e.steps / AT_ONCE
        for operand in e.operands:
            operand.unread -= 1
            alive -= not operand.unread
        alive += bool(e.readers)
        for reader in e.readers:
            reader.missing -= 1
            reader.there = max(reader.there, now + e.latency)
            if not reader.missing:
                insort(ready, (-reader.behind, reader.number, reader))
    return lines, names


def _expressions(block: Sequence[Assign], wanted: Collection[str]) -> list[_Expression]:
    """Returns the assignments as expressions, each behind its operands."""
    uses = Counter(a for s in block for a in s.args)
    made: dict[object, _Expression] = {}
    found: dict[int, _Expression] = {}
    for number, s in enumerate(block):
        steps = max(1, len(s.args) - 1)
        e = made[s.name] = found[number] = _Expression(number, [], steps, (OF_A_QUOTIENT if s.op == "div" else LATENCY) * steps)
        for a in dict.fromkeys(s.args):
            part = made.get(a)
            if part is not None and uses[a] == 1 and a not in wanted and e.steps + part.steps <= LONGEST:
                e.lines += part.lines
                e.steps += part.steps
                e.latency += part.latency
                e.operands |= part.operands
                del found[part.number]
            elif part is not None:
                e.operands[part] = None
        e.lines.append(s)
    expressions = list(found.values())
    for e in expressions:
        for operand in e.operands:
            operand.readers.append(e)
    for e in reversed(expressions):
        e.behind = e.latency + max((reader.behind for reader in e.readers), default=0)
        e.missing, e.unread = len(e.operands), len(e.readers)
    return expressions


def _needed(block: Sequence[Assign], wanted: Iterable[str]) -> list[Assign]:
    """Returns the assignments that the wanted names depend on, in their order."""
    live: set[object] = set(wanted)
    kept: list[Assign] = []
    for s in reversed(block):
        if s.name in live:
            live.update(s.args)
            kept.append(s)
    return kept[::-1]
