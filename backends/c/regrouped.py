"""The straight line of points that surfaces cross, written so that more of it is the same at all points of a queue.

regrouped(line, varying)  ->  the line, in which

conjunctions and disjunctions    that of the operands which are the same at all points is one condition, and so is that of the operands
                                 that are known before the same sums over nodes
a maximum that is positive       is a disjunction
bounds that a condition drops    c ? max(a, b) : a, with the same c at all points, is max(a, b + d), d = 0 or far below: no selection

alike(lines, varying)     ->  the lines, in which what is the same at all points has one name, whichever line computes it
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from itertools import count

from teg.backends.c.crossed import Crossed
from teg.backends.c.crossing import LARGEST
from teg.backends.c.items import Item, Nodes, defines, needed, reads
from teg.program import Arg, Assign
from teg.program.names import is_parameter, of_kind, parameter_number, unused_numbers

GROUPED = ("and", "or")
FAR = {"upper": -LARGEST, "lower": LARGEST}
"""What is added to a bound that is dropped."""


def regrouped(found: Crossed, varying: Container[int]) -> Crossed:
    """Returns an equivalent straight line; inputs in `varying` differ between points."""
    made = _Regrouped(found, varying)
    for item in found.items:
        made.append(item)
    return Crossed(tuple(needed(made.items, (*found.outputs, found.good))), found.outputs, found.good)


class _Regrouped:
    """The items of the new line, and which of its values differ between points."""

    def __init__(self, found: Crossed, varying: Container[int]) -> None:
        names = [n for item in found.items for n in defines(item)]
        self._numbers = unused_numbers(names)
        self.items: list[Item] = []
        self._made: dict[Arg, Assign] = {}
        inputs = {str(a) for item in found.items for a in reads(item) if is_parameter(a)}
        self._differing: set[Arg] = {a for a in inputs if parameter_number(a) in varying}
        self._uses = Counter(a for item in found.items for a in reads(item))
        self._after: dict[Arg, int] = {}  # how many sums over nodes come before a value

    def append(self, item: Item) -> None:
        """Appends what computes the values of an item."""
        if isinstance(item, Nodes):
            self._put(item)
        elif item.op in GROUPED:
            self._group(item)
        elif (sides := self._sides(item)) is not None:
            self._group(sides)
        else:
            self._put(self._clamped(item) if item.op == "select" else item)

    def _put(self, item: Item) -> None:
        self.items.append(item)
        after = max((self._after.get(a, 0) for a in reads(item)), default=0) + isinstance(item, Nodes)
        self._after.update(dict.fromkeys(defines(item), after))
        if isinstance(item, Nodes) or not self._differing.isdisjoint(reads(item)):
            self._differing.update(defines(item))
        if isinstance(item, Assign):
            self._made[item.name] = item

    def _name(self, letter: str) -> str:
        return f"{letter}{next(self._numbers)}"

    def _operands(self, args: Iterable[Arg], op: str) -> list[Arg]:
        """Returns operands; those which are used here only, and are of the same operation, are replaced by their own."""
        flat: list[Arg] = []
        for arg in args:
            inner = self._made.get(arg)
            flat += inner.args if inner is not None and inner.op == op and self._uses[arg] == 1 else (arg,)
        return flat

    def _group(self, item: Assign) -> None:
        """Appends a conjunction or disjunction."""
        operands = list(dict.fromkeys(self._operands(item.args, item.op)))
        stages: dict[int, list[Arg]] = {}
        for a in operands:
            stages.setdefault(self._after.get(a, 0) if a in self._differing else -1, []).append(a)
        groups = [stages[number] for number in sorted(stages)]
        for group in groups[:-1]:
            if len(group) > 1:
                name = self._name("b")
                self._put(Assign(name, item.op, tuple(group)))
                group[:] = [name]
        self._put(Assign(item.name, item.op, tuple(a for group in groups for a in group)))

    def _sides(self, item: Assign) -> Assign | None:
        """Returns whether a maximum is positive as a disjunction; None of another condition."""
        largest = self._made.get(item.args[0]) if item.op == "gt0" else None
        if largest is None or largest.op != "upper":
            return None
        names = [self._name("b") for _ in largest.args]
        for name, arg in zip(names, largest.args, strict=True):
            self._put(Assign(name, "gt0", (arg,)))
        return Assign(item.name, "or", tuple(names))

    def _clamped(self, item: Assign) -> Assign:
        """Returns a selection, as a bound that is far away where it is dropped."""
        condition, *cases = item.args
        for kept, other in ((0, 1), (1, 0)):
            bound = self._made.get(cases[kept])
            if condition in self._differing or bound is None or bound.op not in FAR or bound.args[0] != cases[other]:
                continue
            by, moved, dropped = self._name("v"), self._name("v"), FAR[bound.op]
            self._put(Assign(by, "select", (condition, 0.0, dropped) if kept == 0 else (condition, dropped, 0.0)))
            self._put(Assign(moved, "add", (bound.args[1], by)))
            return Assign(item.name, bound.op, (cases[other], moved))
        return item


def alike(lines: Sequence[Crossed], varying: Container[int]) -> list[Crossed]:
    """Returns equivalent straight lines: values that are the same at all points have equal names if they are computed alike, and no name
    has two values. Inputs in `varying` differ between points."""
    fresh = unused_numbers(n for line in lines for item in line.items for n in defines(item))
    known: dict[tuple[str, str], str] = {}
    return [_renamed(line, varying, known, fresh) for line in lines]


def _renamed(line: Crossed, varying: Container[int], known: dict[tuple[str, str], str], fresh: count[int]) -> Crossed:
    """Returns a line in which what is the same at all points has its known name, or a fresh one."""
    inputs = {str(a) for item in line.items for a in reads(item) if is_parameter(a)}
    differing: set[Arg] = {a for a in inputs if parameter_number(a) in varying}
    names: dict[Arg, str] = {}
    made: set[str] = set()
    items: list[Item] = []

    def of(args: Iterable[Arg]) -> tuple[Arg, ...]:
        return tuple(names.get(a, a) for a in args)

    def renamed(s: Assign) -> Assign:
        return replace(s, args=of(s.args))

    for item in line.items:
        if isinstance(item, Nodes):
            differing.update(item.sums)
            body = tuple(map(renamed, item.body))
            items.append(replace(item, weights=of(item.weights), body=body, values=of(item.values)))
        elif not differing.isdisjoint(item.args):
            differing.add(item.name)
            items.append(renamed(item))
        else:
            key = item.op, repr(of(item.args))
            if key not in known:
                known[key] = of_kind(item.name, next(fresh))
            names[item.name] = known[key]
            if known[key] not in made:
                made.add(known[key])
                items.append(Assign(known[key], item.op, of(item.args)))
    (good,) = of([line.good])
    return Crossed(tuple(items), of(line.outputs), good)
