"""The C functions of points side by side, and of points that wait in a queue: which of them a program has.

side_by_side(once, program, …)  ->  Straight        the names and inputs of the functions, which `once` has printed
"""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Protocol

from teg.backends.c.covered import divided, joined
from teg.backends.c.crossed import Crossed, crossed, lines_apart
from teg.backends.c.frame import Routine
from teg.backends.c.lane_functions import decision, signature, straight, used_inputs
from teg.backends.c.lanes import SIDE, Packed, packed
from teg.backends.c.ranges import Narrowing, function, narrowing
from teg.backends.c.stages import Point, functions, results, totals
from teg.backends.c.text import TRUTH, indent, wrapped
from teg.program import Assign, Program

SHARED = "const double *s"
"""The declaration of the numbers that all points of a queue share."""


class Eight(NamedTuple):
    """A C function of eight points, and its inputs."""

    name: str
    inputs: Sequence[int]


class Staged(NamedTuple):
    """C functions of eight points in a queue: one for all of them, and for each half-plane one for points that it alone crosses, or none.
    `steady` is the function of the `kept` numbers which all points share; `point` is a straight line for loops over points (`covered`). If
    `steady` is for eight groups of points (`grouped`), the last `conditions` of these numbers are repeated elsewhere for each point."""

    lines: Sequence[Eight]
    steady: Eight
    kept: int
    point: Point | None = None
    conditions: int = 0
    grouped: bool = False

    @property
    def apart(self) -> int:
        """Returns how many half-planes have a function of their own."""
        return len(self.lines) - 1


class Narrow(NamedTuple):
    """The C function of one point's heights, which are not negative where the outputs are not 0, and of covers, which are positive where
    `line` gives them."""

    name: str
    inputs: Sequence[int]
    known: Narrowing

    @property
    def heights(self) -> int:
        """Returns how many numbers are not negative in iterations that are live."""
        return len(self.known.heights)

    @property
    def covers(self) -> int:
        """Returns how many numbers are positive in iterations that are covered."""
        return len(self.known.covers)


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
    `sums` are only added up. If queues are filled one after the other, inputs in `groups` differ between these, and other ones that points
    have in common do not."""

    program: Program
    differing: Container[int]
    residues: Sequence[Mapping[str, int | None]] | None = None
    sums: Sequence[int] | None = None
    groups: Container[int] | None = None


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
    planes = known.planes if spanned and known else found.planes
    alone = lines_apart(waiting.program, waiting.residues) if waiting and across and waiting.sums is not None and planes else []
    made = Straight(None, [], None, [], narrow=narrow, spanned=True)
    if not spanned:
        made = _decided(once, found, varying, apart, whole is None, bool(alone))
    if waiting and across:
        made = replace(made, narrow=narrow, crossed=_staged(once, "crossed", [across, *alone], waiting))
    return replace(made, narrow=narrow, covered=_staged(once, "covered", [whole], waiting) if waiting and whole else None)


def _decided(once: Once, found: Packed, varying: Collection[int], apart: int, with_line: bool, with_planes: bool) -> Straight:
    """Returns the decision, which tells half-planes apart if that is wanted, and the straight line if there is one and it is wanted."""
    decided_by, used = used_inputs(found)
    given = signature(decided_by, varying, "int64_t *live", "int64_t *fast", *(["int64_t *held"] if with_planes else []))
    decided = _printed(once, "decision", f"TEG_INLINE int @({given})", decision(found, varying, with_planes))
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


def _staged(once: Once, kind: str, found: Sequence[Crossed], waiting: Waiting) -> Staged:
    """Returns the functions of points that wait in queues."""
    sums, differing = waiting.sums, waiting.differing
    apart = divided(found[0], sums, differing) if sums is not None and kind == "covered" else None
    if sums is not None and apart is not None:
        found = [joined(found[0], apart, sums)]
    groups = waiting.groups
    made = functions(found, differing, results if sums is None else partial(totals, sums=sums), apart, groups)
    shared = [SHARED] if groups is None else [SHARED, "const double *m"]
    unused = "(void)s;" if groups is None else "(void)s, (void)m;"
    written = "double *restrict f" if sums is None else f"double (*restrict lanes)[{SIDE}], int count"
    lines: list[Eight] = []
    for line, inside in zip(found, made.lines, strict=True):
        good = [] if line.good is True else ["double *restrict good"]
        given = signature(inside.inputs, differing, *shared, written, *good)
        name = _printed(once, kind if not lines else "alone", f"TEG_EIGHT void @({given})", [unused, *inside.text])
        lines.append(Eight(name, inside.inputs))
    text, inputs = made.steady
    head = f"static void @({signature(inputs, (), 'double *s')})"
    head = head if groups is None else f"TEG_EIGHT void @({signature(inputs, groups, 'double *restrict s')})"
    steady = _printed(once, "steady", head, ["(void)s;", *text])
    return Staged(lines, Eight(steady, inputs), max(1, made.kept), made.point, made.conditions, groups is not None)


def _narrow(once: Once, known: Narrowing) -> Narrow:
    """Returns the function by which a range of points is narrowed."""
    head = f"TEG_INLINE {TRUTH} @({signature(known.inputs, (), 'double *height')})"
    return Narrow(_printed(once, "narrow", head, function(known)), known.inputs, known)


def _printed(once: Once, kind: str, head: str, inside: Sequence[str]) -> str:
    """Returns the name of a function."""
    return once(kind, wrapped([head, "{", *indent(*inside), "}"])).name
