"""The C functions of points side by side, and of points that wait in a queue: which of them a program has.

side_by_side(once, program, …)  ->  Straight        the names and inputs of the functions, which `once` has printed
"""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from teg.backends.c.crossed import Crossed, crossed
from teg.backends.c.frame import Routine
from teg.backends.c.lanes import SIDE, Packed, decision, packed, signature, straight, used_inputs
from teg.backends.c.ranges import Narrowing, function, narrowing
from teg.backends.c.stages import functions, results, totals
from teg.backends.c.text import TRUTH, indent, wrapped
from teg.program import Assign, Program


class Staged(NamedTuple):
    """The C function of eight points in a queue, and that of the `kept` numbers which all points in it share, each with its inputs."""

    name: str
    inputs: Sequence[int]
    steady: str
    steady_inputs: Sequence[int]
    kept: int


class Narrow(NamedTuple):
    """The C function of one point's `heights`, which are not negative where the outputs are not 0, and of `covers`, which are positive
    where `line` gives them. `decides` if nothing else is needed to know which of both a point is."""

    name: str
    inputs: Sequence[int]
    heights: int
    covers: int
    decides: bool
    known: Narrowing


@dataclass(frozen=True, slots=True)
class Straight:
    """C functions of eight points. `decision` says where the outputs are 0 or have a simple value, `line` computes that value;
    `decided_by` and `used` are their inputs. Of points that wait in a queue, `crossed` computes those whose boxes are crossed by surfaces,
    `covered` those with a simple value. If `spanned`, `narrow` alone decides which are which, in rows."""

    decision: str | None
    decided_by: list[int]
    line: str | None
    used: list[int]
    crossed: Staged | None = None
    covered: Staged | None = None
    narrow: Narrow | None = None
    spanned: bool = False


class Waiting(NamedTuple):
    """The `program` of points in a queue, with the inputs that differ between them, and residues of all of them (`crossed`). The outputs
    `sums` are only added up."""

    program: Program
    differing: Container[int]
    residues: Sequence[Mapping[str, int | None]] | None = None
    sums: Sequence[int] | None = None


class Once(Protocol):
    """Prints a text in which @ is the function's name, unless it was printed before."""

    def __call__(self, kind: str, text: str) -> Routine: ...


def side_by_side(
    once: Once, program: Program, varying: Collection[int], apart: int, indices: Collection[int], waiting: Waiting | None
) -> Straight | None:
    """Returns the functions that take eight points at once, if there are any; inputs not in `varying` are the same for all, those in
    `indices` are the number of the point, the outputs of a point lie `apart`."""
    found = packed(program)
    across = crossed(waiting.program, waiting.residues) if found and waiting else None
    if found is None or (found.fast is False and not across and sum(i in varying for i in used_inputs(found)[0]) > SIDE):
        return None  # to gather what tells which points are live costs more than to ask them one by one
    known = narrowing(found, [f"p{i}" for i in indices], [f"p{i}" for i in varying]) if indices else None
    whole = _whole(waiting) if waiting and across else None
    narrow = _narrow(once, known) if known else None
    spanned = whole is not None and known is not None and known.decides and bool(known.covers)
    made = Straight(None, [], None, [], narrow=narrow, spanned=True) if spanned else _decided(once, found, varying, apart, whole is None)
    if waiting and across:
        made = replace(made, narrow=narrow, crossed=_staged(once, "crossed", across, waiting))
    return replace(made, narrow=narrow, covered=_staged(once, "covered", whole, waiting) if waiting and whole else None)


def _decided(once: Once, found: Packed, varying: Collection[int], apart: int, with_line: bool) -> Straight:
    """Returns the decision, and the straight line if there is one and it is wanted."""
    decided_by, used = used_inputs(found)
    given = signature(decided_by, varying, "int64_t *live", "int64_t *fast")
    decided = _printed(once, "decision", f"TEG_INLINE int @({given})", decision(found, varying))
    if found.fast is False or not with_line:
        return Straight(decided, decided_by, None, used)
    storage = "TEG_APART" if found.wide else "TEG_INLINE"  # inlined, the loop of a wide one would be unrolled before it is vectorised
    head = f"{storage} void @({signature(used, varying, 'double *restrict f')})"
    return Straight(decided, decided_by, _printed(once, "straight", head, straight(found, varying, apart)), used)


def _whole(waiting: Waiting) -> Crossed | None:
    """Returns the straight line of points in a queue that nothing crosses; None if it is more than arithmetic, or adds nothing up."""
    found = packed(waiting.program) if waiting.sums is not None else None
    if found is None or found.fast is False or found.wide:
        return None
    simple = [s for s in found.straight if isinstance(s, Assign) and s.op != "choose"]
    return Crossed(tuple(simple), found.outputs, True) if len(simple) == len(found.straight) else None


def _staged(once: Once, kind: str, found: Crossed, waiting: Waiting) -> Staged:
    """Returns the functions of points that wait in a queue."""
    sums, differing = waiting.sums, waiting.differing
    made = functions(found, differing, results(found) if sums is None else totals(found, sums))
    written = "double *restrict f" if sums is None else f"double (*restrict lanes)[{SIDE}], int count"
    good = [] if found.good is True else ["double *restrict good"]
    given = signature(made.line_by, differing, "const double *s", written, *good)
    line = _printed(once, kind, f"TEG_EIGHT void @({given})", ["(void)s;", *made.line])
    steady = _printed(once, "steady", f"static void @({signature(made.steady_by, (), 'double *s')})", ["(void)s;", *made.steady])
    return Staged(line, made.line_by, steady, made.steady_by, max(1, made.kept))


def _narrow(once: Once, known: Narrowing) -> Narrow:
    """Returns the function by which a range of points is narrowed."""
    head = f"TEG_INLINE {TRUTH} @({signature(known.inputs, (), 'double *height')})"
    return Narrow(
        _printed(once, "narrow", head, function(known)), known.inputs, len(known.heights), len(known.covers), known.decides, known
    )


def _printed(once: Once, kind: str, head: str, inside: Sequence[str]) -> str:
    """Returns the name of a function."""
    return once(kind, wrapped([head, "{", *indent(*inside), "}"])).name
