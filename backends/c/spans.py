"""Spans of rows: which iterations of a loop have a result other than 0, and which nothing crosses, for eight runs of the loop at once.

    for j in …:                     rows
        for i in lo(j) … hi(j):     a span of iterations is live, a part of it covered (`ranges`)

What decides that is the same arithmetic in each row, so eight rows take little longer than one. The bounds of a row are numbers of
iterations from its first one on, and are rounded outwards for what is live, inwards for what is covered.
"""

from __future__ import annotations

from collections.abc import Container
from typing import NamedTuple

from teg.backends.c.lane_functions import signature
from teg.backends.c.lanes import SIDE
from teg.backends.c.ranges import Narrowing
from teg.backends.c.steps import place_of
from teg.backends.c.text import TRUTH, indent, wrapped
from teg.program.arrays import Integers, Load, Loop, Number, Run, Step
from teg.program.fields import result_names

PLACES = ("start", "stop", "since", "until")
"""The ends of the live iterations of a row, and of the covered ones among these."""
LINES = ("before", "behind")
"""The lines of live iterations on both sides of the covered ones, if all of them cross one half-plane's border: its number from 1 on."""
HELD = ("holds", "fails")
"""The ends of the iterations of a row in which a half-plane holds."""


class Rows(NamedTuple):
    """A loop over rows: the steps before the loop over the iterations of a row, and that loop."""

    before: tuple[Step, ...]
    row: Loop

    @property
    def inside(self) -> set[str]:
        """Returns the names that differ between rows."""
        return {name for s in self.before for name in result_names(s)}


def rows_of(loop: Loop, idle: Container[int]) -> Rows | None:
    """Returns the rows of a loop that does nothing beside them, but for flat programs that are `idle`; None if there are none."""
    body = [s for s in loop.body if not (isinstance(s, Run) and id(s) in idle)]
    if loop.listed >= 0 or not body or type(row := body[-1]) is not Loop:
        return None
    simple = all(isinstance(s, Integers | Number | Load) for s in body[:-1])
    return Rows(tuple(body[:-1]), row) if simple else None


def function(narrow: str, known: Narrowing, indices: Container[int], varying: Container[int], apart: bool) -> str:
    """Returns the C function @ of eight rows, which calls the function `narrow` of one iteration: inputs in `indices` are the number of the
    iteration, those in `varying` differ between rows. If half-planes are told `apart`, it writes LINES and HELD of each one, too. It
    returns whether SIDE iterations of some row are covered."""

    def call(iteration: str, array: str) -> str:
        values = [iteration if i in indices else f"q{i}[k]" if i in varying else f"p{i}" for i in known.inputs]
        return f"{narrow}({', '.join([*values, array])})"

    heights, count = len(known.heights), len(known.heights) + len(known.covers)
    planes = {heights + m: h for h, m in enumerate(known.planes)} if apart else {}
    inside = [
        f"double first[{count}], last[{count}];",
        "const double steps = length[k] - 1.0;",
        f"const {TRUTH} told = {call('lo[k]', 'first')} | {call('lo[k] + steps', 'last')};",
        "const double near = 1e-6 + 1e-14 * steps;",
        "double start = 0.0, stop = steps, since = -1.0, until = (told & 2) ? -1.0 : steps + 1.0;",
        "double fall, place, end, larger, least = 1.0, sound = 0.0;",
        f"{TRUTH} known;",
    ]
    for m in range(count):
        g, h = f"first[{m}]", f"last[{m}]"
        inside += [f"fall = {g} - {h}, place = steps * ({g} / fall);"]
        if m < heights:
            inside += [
                "end = fall < 0.0 ? place - near : 0.0, start = end > start ? end : start;",
                "end = (fall > 0.0) & (fall - fall == 0.0) ? place + near : steps, stop = end < stop ? end : stop;",
                f"stop = ({g} < 0.0) & ({h} < 0.0) ? -1.0 : stop;",
            ]
        else:
            inside += [
                "end = fall < 0.0 ? place + near : -1.0, since = end > since ? end : since;",
                "end = fall > 0.0 ? place - near : steps + 1.0, until = end < until ? end : until;",
                f"larger = {g} > {h} ? {g} : {h}, least = larger < least ? larger : least, sound += fall - fall;",
            ]
        if m in planes:
            holds, fails = (f"{end}_{planes[m]}" for end in HELD)
            inside += [
                f"const double {holds} = {g} > 0.0 ? 0.0 : {h} > 0.0 ? floor(place) + 1.0 : steps + 1.0;",
                f"const double {fails} = {h} > 0.0 ? steps + 1.0 : {g} > 0.0 ? ceil(place) : 0.0;",
            ]
    inside += [
        "until = (least > 0.0) & (sound == 0.0) ? until : -1.0;",
        "start = ceil(start), stop = floor(stop) + 1.0, since = floor(since) + 1.0, until = ceil(until);",
        "stop = stop > 0.0 ? stop : 0.0;",
        "since = since > start ? since : start, until = until < stop ? until : stop;",
        "start = start < stop ? start : stop;",
        "spans[0][k] = start, spans[1][k] = stop;",
        "known = since < until;",
        "since = known ? since : stop, until = known ? until : stop;",
        "spans[2][k] = since, spans[3][k] = until;",
        f"some |= until - since >= {SIDE}.0;",
        *_told_apart(len(planes)),
    ]
    inputs = [i for i in known.inputs if i not in indices]
    given = signature(inputs, varying, "const double *lo", "const double *length", f"double (*restrict spans)[{SIDE}]")
    each = [f"for ({TRUTH} k = 0; k < {SIDE}; k++) {{", *indent(*inside), "}"]
    return wrapped([f"TEG_EIGHT {TRUTH} @({given})", "{", *indent(f"{TRUTH} some = 0;", *each, "return some;"), "}"])


def _told_apart(count: int) -> list[str]:
    """Returns lines that write the lines of iterations beside the covered ones, and the ends of those in which each half-plane holds."""
    lines: list[str] = ["double alone, crossing;"] if count else []
    for place, (first, last) in enumerate([("start", "since"), ("until", "stop")] if count else []):
        lines.append("alone = 0.0, crossing = 0.0;")
        for h in range(count):
            held = f"(holds_{h} <= {first}) & (fails_{h} >= {last})"
            lines.append(f"alone = {held} ? alone : {h + 1}.0, crossing += {held} ? 0.0 : 1.0;")
        lines.append(f"spans[{len(PLACES) + place}][k] = crossing == 1.0 ? alone : 0.0;")
    ends = [f"{end}_{h}" for h in range(count) for end in HELD]
    return [*lines, *(f"spans[{len(PLACES) + len(LINES) + m}][k] = {end};" for m, end in enumerate(ends))]


def prefetched(row: Loop, run: Run) -> list[str]:
    """Returns lines that ask for the entries of arrays which iterations {index}_start … {index}_stop of a row read."""
    lines: list[str] = []
    inside = {name for s in row.body for name in result_names(s)} | {row.index}
    start, stop = (f"{row.index}_{end}" for end in PLACES[:2])
    asked: set[int] = set()
    for load in row.body[: row.body.index(run)]:
        if not isinstance(load, Load) or load.array in asked or row.index not in load.subscripts:
            continue
        if any(isinstance(a, str) and a in inside and a != row.index for a in load.subscripts):
            continue
        asked.add(load.array)
        first, last = (
            f"a{load.array} + {place_of(load.array, [at if a == row.index else a for a in load.subscripts])}"
            for at in (start, f"({stop} - 1)")
        )
        lines.append(f"if ({start} < {stop}) teg_prefetch({first}, {last}, {stop} - {start});")
    return lines
