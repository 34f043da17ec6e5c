"""Values that only one branch of a choice needs, computed only where it is taken.

    u = exp(x);  v = …u…;  r = b ? v : w        →        when b: u = exp(x);  v = …u…   r = b ? v : w

A value is needed under the conditions of all choices, and of all statements with conditions, through which its every use goes. The
condition that covers the most work becomes a `When` around what needs it, and the rest of the block and the inside of the branch are looked
at again. Each statement is moved at most once at every depth and none is copied; ties stay where they are, unless they are known to be none
elsewhere. For backends that compute one point at a time. Cost: a visit a statement for each branch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from teg.program import Arg, Assign, Program, Stmt, When, assigned, free_names, statements
from teg.program.fields import absent
from teg.program.names import is_condition, unused_numbers

COSTS = {
    **dict.fromkeys(("exp", "expm1", "log", "log1p", "sin", "cos", "tan", "sinh", "cosh", "tanh", "asin", "acos", "atan"), 12),
    **dict.fromkeys(("erf", "erfc", "pow", "atan2", "call"), 20),
    **dict.fromkeys(("div", "sqrt", "mod", "floor"), 4),
}
"""About how many additions an operation costs; 1 where it is not said."""
LEAST = 24
"""A branch that is not taken saves so much, or is not made."""
DEEPEST, MOST_BRANCHES = 4, 24
MOST = 10_000
"""Statements of a block that is looked at."""

Literal = tuple[str, bool]
"""A boolean and its value."""


def with_lazy_choices(program: Program) -> Program:
    """Returns the program in which long computations for one branch of a choice, or for a statement with a condition, are made only where
    it is taken, or run."""
    if len(program.body) > MOST or not any(s.op == "select" if isinstance(s, Assign) else s.when is not None for s in program.body):
        return program
    numbers = unused_numbers(n for s in statements(program.body) for n in assigned(s))
    body = _lazy(list(program.body), program.outputs, numbers, ())
    return replace(program, body=tuple(body))


def _lazy(block: list[Stmt], outputs: Iterable[Arg], numbers: Iterator[int], known: tuple[Literal, ...]) -> list[Stmt]:
    """Returns a block with branches, inside of those of the conditions that are known."""
    wanted = set(outputs)
    tried = set(known)
    while len(known) < DEEPEST:
        needs = _needs(block, wanted)
        work: dict[Literal, int] = {}
        for stmt in block:
            if isinstance(stmt, Assign):
                for literal in needs.get(stmt.name, ()):
                    work[literal] = work.get(literal, 0) + COSTS.get(stmt.op, 1)
        chosen = max((x for x in work if x not in tried), key=work.__getitem__, default=None)
        if chosen is None or work[chosen] < LEAST or len(tried) >= MOST_BRANCHES + len(known):
            break
        tried.add(chosen)
        block = _behind(block, wanted, chosen, {n for n, conditions in needs.items() if chosen in conditions}, numbers, known)
    return block


def _needs(block: Sequence[Stmt], wanted: set[Arg]) -> dict[str, frozenset[Literal]]:
    """Returns, for the assignments of a block that can be moved, the conditions under which they are needed."""
    needed: dict[Arg, frozenset[Literal]] = dict.fromkeys(wanted, frozenset())
    made: dict[Arg, Assign] = {s.name: s for s in block if isinstance(s, Assign)}
    found: dict[str, frozenset[Literal]] = {}

    def note(arg: Arg, conditions: frozenset[Literal]) -> None:
        if isinstance(arg, str):
            needed[arg] = needed[arg] & conditions if arg in needed else conditions

    for stmt in reversed(block):
        if not isinstance(stmt, Assign):
            when = stmt.when if isinstance(stmt.when, str) else ""
            for name in free_names(stmt):
                note(name, frozenset({(when, True)} if when not in ("", name) else ()))
            continue
        own = needed.get(stmt.name, frozenset())
        if stmt.op == "tie":  # stays, unless it can be none where a condition fails
            own = own & _without_which_none(*(made.get(a) for a in stmt.args[:2]))
        found[stmt.name] = own
        if stmt.op == "select" and isinstance(stmt.args[0], str):
            b, x, y = stmt.args
            note(b, own)
            note(x, own | {(str(b), True)})
            note(y, own | {(str(b), False)})
        else:
            for arg in stmt.args:
                note(arg, own)
    return {name: conditions for name, conditions in found.items() if conditions}


def _without_which_none(g: Assign | None, scale: Assign | None) -> frozenset[Literal]:
    """Returns the condition without which the value of a tie is a number other than 0 and its scale is 0: it is none then."""
    if g is None or scale is None or (g.op, scale.op) != ("select", "select") or g.args[0] != scale.args[0]:
        return frozenset()
    apart = isinstance(g.args[2], float) and g.args[2] != 0.0 and scale.args[2] == 0.0
    return frozenset({(str(g.args[0]), True)} if apart else ())


def _without_condition(stmt: Stmt, condition: str) -> Stmt | None:
    """Returns a statement as it stands in the branch of its own condition; None if it has another one, or none, or results other than 0
    where that fails: those of a branch are 0."""
    if isinstance(stmt, Assign | When) or stmt.when != condition or any(absent(stmt).values()):
        return None
    return replace(stmt, when=None)


def _behind(
    block: list[Stmt], wanted: set[Arg], literal: Literal, members: set[str], numbers: Iterator[int], around: tuple[Literal, ...]
) -> list[Stmt]:
    """Returns the block with some assignments, which are needed under a condition only, and the statements with this condition, in a
    branch; `around` are the conditions of the branches around it."""
    name, value = literal
    made = {n for s in block for n in assigned(s)}
    late: set[str] = set()  # what depends on users of the branch, or on the condition, which come after it
    before: list[Stmt] = []
    body: list[Stmt] = []
    after: list[Stmt] = []
    known = name not in made
    inside: set[str] = set()
    for stmt in block:
        used, results = set(free_names(stmt)), assigned(stmt)
        if isinstance(stmt, Assign) and stmt.name in members and used.isdisjoint(late):
            body.append(stmt)
            inside.add(stmt.name)
        elif value and used.isdisjoint(late) and (conditioned := _without_condition(stmt, name)) is not None:
            body.append(conditioned)
            inside.update(results)
        elif not used.isdisjoint(inside) or not used.isdisjoint(late):
            after.append(stmt)
            late.update(results)
        else:
            before.append(stmt)
            known = known or name in results
    if not known or sum(COSTS.get(s.op, 1) for s in body if isinstance(s, Assign)) < LEAST:
        return block
    if not value:
        name = f"b{next(numbers)}"
        before.append(Assign(name, "not", (literal[0],)))
    used_after = {n for s in after for n in free_names(s)} | wanted
    results = tuple(n for s in body for n in assigned(s) if n in used_after and not is_condition(n))
    if any(n in used_after for s in body for n in assigned(s) if is_condition(n)):  # a branch has numbers as results
        return block
    return [*before, When(name, tuple(_lazy(body, results, numbers, (*around, literal))), results), *after]
