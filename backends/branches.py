"""Puts statements whose results vanish together behind one branch: a pixel that a triangle does not meet then costs its classification and
nothing else.

    b = …;  v = …;  results = ∫∫ …, r = …, w = r·v; …        →        b = …;  when b: v = …;  results = ∫∫ …, r = …, w = r·v

A polygon names a boolean, `met`, that is false only where one of its half-planes fails on all of the box. The values of its block that
are then known to be 0, in every such case, are computed in a `When`, with what only they use. Inside of it the same is done once more for
the segments: where the box is covered no edge is met, and what they contribute to is 0.

A product with a factor 0 counts as 0: over an empty domain c·∫∫f is ∫∫c·f, and that c is not a number (the slope of a degenerate triangle)
does not matter. This is part of what a program means, so every backend starts from here: C prints the branches (`with_branches`); NumPy and
JAX, in which many points run together, replace the results that are not wanted by 0 (`with_selects`).

Only the outermost block is looked at. Each statement is moved once and none is copied. A polygon takes time linear in the size of the block
times the number of its half-planes; where that is much for all of them, no branches are made.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from teg.program import (
    Arg,
    Assign,
    Polygon,
    Program,
    Segment,
    Stmt,
    When,
    assigned,
    compound,
    free_names,
    statements,
    without_branches,
)
from teg.program.arrays import ArrayProgram, Loop, Run, Step
from teg.program.dce import without_dead_code
from teg.program.fields import absent, inner_blocks, with_blocks
from teg.program.names import is_condition, unused_numbers

OPPOSITE = {"gt0": "le0", "le0": "gt0", "ge0": "lt0", "lt0": "ge0", "and": "or", "or": "and"}
IMPLIED = {"lt0": ("le0",), "gt0": ("ge0",)}
FEW = 3
"""So few statements are not worth a branch."""
MOST = 30_000
"""Statements that are looked at, at most: half-planes of all polygons times statements of the block."""


def with_selects(program: Program) -> Program:
    """Returns the program without `met` in its polygons; results that a branch would not compute are replaced by 0."""
    return without_branches(with_branches(program))


def with_branches_in_loops(program: ArrayProgram) -> ArrayProgram:
    """Returns the program whose flat programs have branches. A program without loops stays without loops."""
    made: dict[int, Program] = {}

    def inside(block: tuple[Step, ...]) -> tuple[Step, ...]:
        steps: list[Step] = []
        for step in block:
            match step:
                case Run():
                    if id(step.program) not in made:
                        made[id(step.program)] = with_branches(step.program)
                    steps.append(replace(step, program=made[id(step.program)]))
                case Loop():
                    steps.append(replace(step, body=inside(step.body)))
                case _:
                    steps.append(step)
        return tuple(steps)

    return replace(program, body=inside(program.body))


def with_branches(program: Program) -> Program:
    """Returns the program with statements that vanish together behind branches, and without `met` in its polygons."""
    if not any(isinstance(s, Polygon) and s.met is not True for s in compound(program.body)):
        return program
    body, uses = program.body, Uses()
    flags = {s.met: _failures(body, s.met) for s in body if isinstance(s, Polygon) and isinstance(s.met, str)}
    if sum(map(len, flags.values())) * len(body) <= MOST:
        numbers = unused_numbers(n for s in statements(body) for n in assigned(s))
        for flag, cases in flags.items():
            body = _behind(body, (*program.outputs, *flags), flag, cases, numbers, uses)  # other flags are needed later
    return without_dead_code(replace(program, body=_without_hints(body)))


def _failures(block: Sequence[Stmt], flag: str) -> list[dict[str, bool]]:
    """Returns the cases in which a flag is false, each with the truth values that are known in it."""
    made = {s.name: s for s in block if isinstance(s, Assign)}
    cases: list[dict[str, bool]] = []
    stack: list[Arg] = [made[flag].args[0]] if flag in made and made[flag].op == "not" else []
    while stack:
        name = stack.pop()
        if isinstance(name, str):
            if name in made and made[name].op == "or":
                stack.extend(made[name].args)
            else:
                cases.append({name: True})
    return [{flag: False, **case} for case in cases]


def _behind(
    block: tuple[Stmt, ...], outputs: Sequence[Arg], flag: str, cases: Sequence[Mapping[str, bool]], numbers: Iterator[int], names: Uses
) -> tuple[Stmt, ...]:
    """Returns the block with a branch: the values that are 0 in all cases in which the flag is false are computed only where it is true."""
    before, body, results, after = _divided(block, outputs, flag, cases, names)
    if not any(isinstance(s, Polygon) or (isinstance(s, Segment) and len(body) > FEW) for s in body):
        return block
    fails = _refusals(block, body, {name for case in cases for name in case})
    if fails:
        none, some = f"b{next(numbers)}", f"b{next(numbers)}"
        decided = Assign(none, "and", tuple(fails)), Assign(some, "not", (none,))
        last = max((i for i, s in enumerate(body) if not fails.keys().isdisjoint(assigned(s))), default=-1) + 1
        whole = (*before, *body[:last], *decided, *body[last:])
        kept, moved, given, rest = _divided(
            whole, (*outputs, *results), some, [{some: False, **dict.fromkeys(fails, True)}], names, len(before)
        )
        if len(moved) > FEW:
            body = (*kept[len(before) :], When(some, moved, given), *rest)
    return (*before, When(flag, body, results), *after)


def _refusals(block: Sequence[Stmt], body: Sequence[Stmt], known: set[str]) -> dict[str, None]:
    """Returns, for each segment of a branch, the cheapest boolean that says that the segment is empty; nothing if one segment has none.
    Booleans that are `known` in the branch decide nothing more there."""
    opposites = _opposites(block)
    made = {s.name: s for s in block if isinstance(s, Assign)}
    inside = {s.name: s for s in body if isinstance(s, Assign)}
    found: dict[str, None] = {}
    for stmt in body:
        if not isinstance(stmt, Segment):
            continue
        denial = made.get(opposites.get(stmt.when or "", ""))
        args = denial.args if denial is not None and denial.op == "or" else ()
        costs = {a: _cost(a, inside) for a in args if isinstance(a, str) and a not in known}
        if not costs:
            return {}
        found[min(costs, key=costs.__getitem__)] = None
    return found


def _cost(name: str, inside: Mapping[str, Assign]) -> int:
    """Returns the number of statements of a branch that a value needs."""
    seen: set[Arg] = set()
    stack: list[Arg] = [name]
    while stack:
        arg = stack.pop()
        if arg in inside and arg not in seen:
            seen.add(arg)
            stack.extend(inside[str(arg)].args)
    return len(seen)


def _divided(
    block: tuple[Stmt, ...], outputs: Sequence[Arg], flag: str, cases: Sequence[Mapping[str, bool]], names: Uses, first: int = 0
) -> tuple[tuple[Stmt, ...], tuple[Stmt, ...], tuple[str, ...], tuple[Stmt, ...]]:
    """Returns the statements before a branch, those in it, its results, and the statements after it. Statements before number
    `first` stay."""
    if not cases:
        return block, (), (), ()
    opposites = _opposites(block)
    vanishing = set.intersection(*(_zeros(block, case, opposites) for case in cases)) - _zeros(block, {}, opposites)
    uses = [names.of(s) for s in block]
    decisive = {flag}
    for stmt, used in zip(reversed(block), reversed(uses), strict=True):
        if not decisive.isdisjoint(assigned(stmt)):
            decisive |= used
    vanishing -= decisive
    inside: set[int] = set()
    given: set[str] = set()  # by what goes into the branch
    late: set[str] = set()  # what depends on it, but does not go there
    for i, stmt in enumerate(block):
        results = assigned(stmt)
        if i >= first and results and vanishing.issuperset(results) and uses[i].isdisjoint(late):
            inside.add(i)
            given.update(results)
        elif not (uses[i].isdisjoint(late) and uses[i].isdisjoint(given)):
            late.update(results)
    outside = {a for a in (*outputs, flag) if isinstance(a, str)}
    for i in range(len(block) - 1, -1, -1):
        stmt = block[i]
        if i in inside:
            continue
        movable = i >= first and isinstance(stmt, Assign) and stmt.name not in late and stmt.name not in outside
        if movable:
            inside.add(i)
        else:
            outside |= uses[i]
    before = tuple(s for i, s in enumerate(block) if i not in inside and not late.intersection(assigned(s)))
    body = tuple(s for i, s in enumerate(block) if i in inside)
    after = tuple(s for i, s in enumerate(block) if i not in inside and late.intersection(assigned(s)))
    return before, body, tuple(n for s in body for n in assigned(s) if n in outside), after


def _opposites(block: Sequence[Stmt]) -> dict[str, str]:
    """Returns pairs of booleans of a block of which one fails where the other holds, as a dict in both directions. They are atoms, and what
    is made of atoms."""
    known: dict[object, str] = {}
    found: dict[str, str] = {}
    made = {s.name: s for s in block if isinstance(s, Assign)}
    for stmt in block:
        if not isinstance(stmt, Assign) or stmt.op not in OPPOSITE:
            continue
        first = made.get(str(stmt.args[0]))
        if stmt.op == "and" and len(stmt.args) == 2 and first is not None and first.op == "not":  # a tie that is not, and is a number
            found[stmt.name], found[str(first.args[0])] = str(first.args[0]), stmt.name
            continue
        compound = stmt.op in ("and", "or")
        args = [found.get(a) if isinstance(a, str) else None for a in stmt.args] if compound else list(stmt.args)
        other = known.get((OPPOSITE[stmt.op], frozenset(args))) if None not in args else None
        known[stmt.op, frozenset(stmt.args)] = stmt.name
        if other is not None:
            found[stmt.name], found[other] = other, stmt.name
    return found


def _zeros(block: Sequence[Stmt], facts: Mapping[str, bool], opposites: Mapping[str, str]) -> set[str]:
    """Returns the numbers of a block that are 0 where some booleans are known."""
    truth = dict(facts)
    atoms = {(s.op, s.args): s.name for s in block if isinstance(s, Assign)}
    made = {s.name: s for s in block if isinstance(s, Assign)}
    stack = list(facts)
    while stack:  # what follows downwards
        name = stack.pop()
        found: dict[str, bool] = {}
        if truth[name] and name in opposites:
            found[opposites[name]] = False
        source = made.get(name)
        if source is not None:
            if source.op == "not" and isinstance(source.args[0], str):
                found[source.args[0]] = not truth[name]
            elif (source.op, truth[name]) in (("and", True), ("or", False)):
                found.update((a, truth[name]) for a in source.args if isinstance(a, str))
            elif truth[name]:
                for op in IMPLIED.get(source.op, ()):
                    if (op, source.args) in atoms:
                        found[atoms[op, source.args]] = True
        for other, value in found.items():
            if other not in truth:
                truth[other] = value
                stack.append(other)
    zeros: set[str] = set()
    for stmt in block:  # and upwards
        if isinstance(stmt, Assign):
            _follow(stmt, truth, zeros, opposites)
        elif not any(absent(stmt).values()) and (
            (stmt.when is not None and truth.get(stmt.when) is False)
            or (isinstance(stmt, Polygon) and isinstance(stmt.met, str) and truth.get(stmt.met) is False)
        ):
            zeros.update(assigned(stmt))
    return zeros


def _follow(stmt: Assign, truth: dict[str, bool], zeros: set[str], opposites: Mapping[str, str]) -> None:
    """Note what an assignment gives, if that is known."""
    if is_condition(stmt.name):
        known = [a if isinstance(a, bool) else truth.get(str(a)) for a in stmt.args]
        value: bool | None = None
        match stmt.op:
            case "and":
                value = False if False in known else None if None in known else True
            case "or":
                value = True if True in known else None if None in known else False
            case "not":
                value = None if known[0] is None else not known[0]
        if value is not None and stmt.name not in truth:
            truth[stmt.name] = value
            if value and stmt.name in opposites:
                truth.setdefault(opposites[stmt.name], False)
        return
    zero = [a in zeros if isinstance(a, str) else not isinstance(a, bool) and a == 0 for a in stmt.args]
    match stmt.op:
        case "mul":
            vanishes = any(zero)
        case "add" | "sub" | "neg" | "abs" | "min" | "max":
            vanishes = all(zero)
        case "div":
            vanishes = zero[0]
        case "powi":
            vanishes = zero[0] and isinstance(stmt.args[1], int) and stmt.args[1] > 0
        case "select":
            chosen = truth.get(str(stmt.args[0]))
            vanishes = all(zero[1:]) if chosen is None else zero[1 if chosen else 2]
        case _:
            vanishes = False
    if vanishes:
        zeros.add(stmt.name)


class Uses:
    """The names that statements, and those inside them, read, with those that are `hints` only or without."""

    def __init__(self, hints: bool = False) -> None:
        self.hints = hints
        self._known: dict[int, tuple[Stmt, set[str]]] = {}  # by id, with the statement, which keeps it alive

    def of(self, stmt: Stmt) -> set[str]:
        if id(stmt) not in self._known:
            self._known[id(stmt)] = stmt, set(free_names(stmt, self.hints))
        return self._known[id(stmt)][1]


def _without_hints(block: Iterable[Stmt]) -> tuple[Stmt, ...]:
    result: list[Stmt] = []
    for stmt in block:
        if isinstance(stmt, Polygon):
            stmt = replace(stmt, met=True)
        if not isinstance(stmt, Assign):
            stmt = with_blocks(stmt, {name: _without_hints(inner) for name, _, inner in inner_blocks(stmt)})
        result.append(stmt)
    return tuple(result)
