"""Choices of a straight line that are made already: `chosen_once` leaves them out.

    x = select(c, y, 0);  z = x + select(c, w, 0);  select(d, z, 0)        →        z, if c holds only where d does

Branches in branches become such choices, and sums of their results too. What follows is known of signs: v ≥ 0 only where not v < 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from teg.backends.c.crossed import Crossed
from teg.backends.c.items import Item, needed
from teg.program import Arg, Assign

SIGNS = {"gt0": "+", "ge0": "0+", "lt0": "-", "le0": "-0"}
"""The signs for which a comparison holds; it does not for a number that is NaN."""
ANY = "-0+?"
Facts = set[tuple[Arg, str]]
"""Numbers with the signs that they may have; conditions with "T" or "F"."""


def chosen_once(line: Crossed) -> Crossed:
    """Returns a straight line without choices between a value and 0 where the value is 0 without them."""
    made: dict[Arg, Assign] = {}
    known: dict[Arg, Arg] = {}
    items: list[Item] = []
    for item in line.items:
        if isinstance(item, Assign):
            item = replace(item, args=tuple(known.get(a, a) for a in item.args))
            made[item.name] = item
            if item.op == "select" and item.args[2] == 0.0 and _vanishes(item.args[1], item.args[0], made):
                known[item.name] = item.args[1]
                continue
        else:
            item = replace(item, values=tuple(known.get(a, a) for a in item.values), weights=tuple(known.get(a, a) for a in item.weights))
            item = replace(item, body=tuple(replace(s, args=tuple(known.get(a, a) for a in s.args)) for s in item.body))
        items.append(item)
    outputs = tuple(known.get(o, o) for o in line.outputs)
    return Crossed(tuple(needed(items, (*outputs, line.good))), outputs, line.good)


def _vanishes(value: Arg, condition: Arg, made: dict[Arg, Assign]) -> bool:
    """Returns whether a value is known to be 0 where a condition does not hold."""
    stmt = made.get(value)
    if stmt is None:
        return value == 0.0 and not isinstance(value, str)
    if stmt.op in ("add", "sub"):
        return all(_vanishes(a, condition, made) for a in stmt.args)
    if stmt.op != "select" or stmt.args[2] != 0.0:
        return False
    return _follows(condition, True, _facts(stmt.args[0], True, made), made) or _vanishes(stmt.args[1], condition, made)


def _facts(condition: Arg, holds: bool, made: dict[Arg, Assign]) -> Facts:
    """Returns what is true where a condition holds, or does not."""
    stmt = made.get(condition)
    facts: Facts = {(condition, "T" if holds else "F")}
    if stmt is None:
        return facts
    if stmt.op in SIGNS:
        signs = SIGNS[stmt.op]
        facts.add((stmt.args[0], signs if holds else "".join(s for s in ANY if s not in signs)))
    if stmt.op == "not":
        facts |= _facts(stmt.args[0], not holds, made)
    if stmt.op == ("and" if holds else "or"):
        facts = facts.union(*(_facts(a, holds, made) for a in stmt.args))
    return facts


def _follows(condition: Arg, holds: bool, facts: Facts, made: dict[Arg, Assign]) -> bool:
    """Returns whether it follows from facts that a condition holds, or does not."""
    if (condition, "T" if holds else "F") in facts:
        return True
    stmt = made.get(condition)
    if stmt is None:
        return False
    if stmt.op in SIGNS:
        wanted = {s for s in ANY if (s in SIGNS[stmt.op]) == holds}
        return any(v == stmt.args[0] and set(signs) <= wanted for v, signs in facts if signs not in ("T", "F"))
    if stmt.op == "not":
        return _follows(stmt.args[0], not holds, facts, made)
    if stmt.op in ("and", "or"):
        parts: Sequence[bool] = [_follows(a, holds, facts, made) for a in stmt.args]
        return all(parts) if (stmt.op == "and") == holds else any(parts)
    return False
