"""The call of a routine: what it is given, and where its results lie. Many results or captured values go through the workspace."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from teg.backends.c import frame as c_frame
from teg.backends.c.frame import CONTEXT, WORKSPACE, Routine, Scope, Step
from teg.backends.c.text import indent, packed
from teg.program import Arg, Assign, Isolate, Locate, Stmt, assigned


def called(stmt: Stmt, routine: Routine, captured: Sequence[Arg]) -> Step:
    """Returns the call of the routine of a statement, which takes the captured values."""
    assert not isinstance(stmt, Assign), "an assignment has no routine"
    names = assigned(stmt)
    stacked = len(names) if len(names) > c_frame.ON_STACK else 0
    in_workspace = [arg for arg in captured if isinstance(arg, str)] if routine.indirect else []
    spelled = [arg for arg in captured if not (routine.indirect and isinstance(arg, str))]
    return Step(
        names,
        uses=(*spelled, *(() if stmt.when is None else (stmt.when,))),
        lines=partial(_lines, stmt, stmt.when, routine, captured, stacked),
        weight=4 + len(captured) // 4 + (len(names) if len(names) > 1 else 0),
        area=stacked + routine.workspace,
        longest=c_frame.ARGUMENT,
        stored=tuple(in_workspace),
        locals=(*([WORKSPACE] if routine.workspace or stacked else []), *([CONTEXT] if routine.context else [])),
    )


def _lines(stmt: Stmt, condition: str | None, routine: Routine, captured: Sequence[Arg], stacked: int, scope: Scope) -> list[str]:
    """Returns the lines of a call; `stacked` doubles of the workspace take the results, none if they have an array of their own."""
    names = assigned(stmt)
    count, absent = len(names), "INFINITY" if isinstance(stmt, Isolate | Locate) else "0.0"
    when = None if condition is None else scope(condition)
    values = [] if routine.indirect else [scope(arg) for arg in captured]
    below = scope.free + stacked
    array = scope.name(names[0], "r") if count > 1 else ""
    place = f"(w + {scope.free})" if stacked else array
    passed = values + [place] * (count > 1)
    passed += [f"w + {below}"] * (routine.workspace > 0) + ["ctx"] * routine.context
    call = f"{routine.name}({', '.join(passed)})"
    before = _gathered(captured, below, scope) if routine.indirect else []
    if count == 1:
        guarded = call if when is None else f"{when} ? {call} : {absent}"
        return [*before, f"const double {scope.name(names[0])} = {guarded};"]
    run = [*before, f"{call};"]
    if when is not None:  # what goes through the workspace is written only where it is read
        nothing = f"teg_fill({place}, {count}, {absent});"
        if isinstance(stmt, Locate) and stmt.lost is not None:
            nothing = f"{{ {nothing} {place}[{count - 1}] = 0.0; }}"
        run = [f"if ({when}) {{", *indent(*run), f"}} else {nothing}"]
    if stacked:
        given = [scope.name(name) for name in names]
        loads = [f"{name} = {place}[{j}]" for j, name in enumerate(given)]
        unread = [f"(void){given[-1]};"] if isinstance(stmt, Locate) and stmt.lost is not None else []  # but by estimates
        return [*run, *packed(loads, "const double ", ", ", ";"), *unread]
    scope.names.update((name, f"{array}[{j}]") for j, name in enumerate(names))
    return [f"double {array}[{count}];", *run]


def _gathered(captured: Sequence[Arg], place: int, scope: Scope) -> list[str]:
    """Returns lines that collect the captured names of a routine in the workspace, from `place` on. A table has the place of each, and
    literals are written after them."""
    slots = [scope.slots[arg] if isinstance(arg, str) else 0 for arg in captured]
    rows = packed(f"{slot}," for slot in slots)
    literals = packed(f"w[{place + i}] = {scope(arg)};" for i, arg in enumerate(captured) if not isinstance(arg, str))
    copy = f"for (int i = 0; i < {len(slots)}; i++) w[{place} + i] = w[from[i]];"
    return ["{", *indent(f"static const int from[{len(slots)}] = {{", *indent(*rows), "};", copy, *literals), "}"]
