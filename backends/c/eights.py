"""Iterations with cells of few candidates, eight side by side (`runtime/eights.h`, `runtime/fans.h`).

    for each iteration:  with one or two candidates: it waits, with others of as many
                         with more, of which three to six are seen side by side, perhaps: it waits when these are found
    where eight wait:    integers and entries one by one; flat programs, cells and their derivatives in lanes; what is added, one by one

Squares that are not covered by one candidate, cut in two by one line or shared as around a vertex of a mesh are given back, and are
iterations as others are. Where that happens to most, no more wait: `FEW` that wait at the end are not worth it either.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from teg.backends.c.cells import Later
from teg.backends.c.frame import Routine
from teg.backends.c.lanes import SIDE
from teg.backends.c.text import indent, packed, spelled
from teg.program import has_ties
from teg.program.arrays import AddTo, Arg, Cells, Combined, Integers, Load, Loop, Number, Run, Scatter, SeenLoop, Step, Take
from teg.program.fields import operands, result_names
from teg.program.vanishing import FLAT, with_zeros

SLOTS = 6
"""The number of candidates of a square up to which it may be known that they are side by side; `TEG_SLOTS` in C."""
FEW = 3
"""Iterations that are not worth to be computed side by side, if fewer than these wait at the end."""
TRIED = 16
"""Iterations of a chunk after which it is asked whether most of those that waited were good."""
READ = Integers | Number | Load | Take
ADDED = AddTo | Scatter


class Squares(NamedTuple):
    """A loop with cells: its steps before and behind them without loops, those `before` them, the cells, the weighted sum of their tables,
    and what adds its derivatives."""

    loop: Loop
    flat: tuple[Step, ...]
    before: tuple[Step, ...]
    cells: Cells
    combined: Combined | None
    seen: tuple[SeenLoop, ...]


def match_squares(loop: Loop, routines: Mapping[int, Routine]) -> Squares | None:
    """Returns the parts of a loop with kept cells if its iterations may be computed side by side."""
    cells = [s for s in loop.body if isinstance(s, Cells)]
    combined = [s for s in loop.body if isinstance(s, Combined)]
    seen = tuple(s for s in loop.body if isinstance(s, SeenLoop))
    flat = tuple(s for s in loop.body if isinstance(s, FLAT))
    if len(cells) != 1 or len(combined) > 1 or 1 + len(combined) + len(seen) + len(flat) < len(loop.body):
        return None
    (own,), tables = cells, {*cells[0].tables, *(c.table for c in combined)}
    if own.shape.parts > 1 or own.shape.order or any(not isinstance(s, READ | Run) for s in own.body):
        return None
    for s in seen:
        taken = [t for t in s.body if isinstance(t, Take) and t.table in tables]
        plain = not s.results and (s.lo, s.hi) == (own.lo, own.hi) and all(isinstance(t, FLAT) for t in s.body)
        if not plain or not combined or any((t.table, t.row) != (combined[0].table, s.index) for t in taken):
            return None
    if any(isinstance(s, Take) and s.table in tables for s in flat):
        return None
    runs = [s for block in (flat, own.body, *(s.body for s in seen)) for s in block if isinstance(s, Run)]
    simple = all(id(s) in routines and _is_simple(routines[id(s)]) and not has_ties(s.program.body) for s in runs)
    before = tuple(s for s in loop.body[: loop.body.index(own)] if isinstance(s, FLAT))
    return Squares(loop, flat, before, own, combined[0] if combined else None, seen) if simple else None


def _is_simple(routine: Routine) -> bool:
    return not (routine.indirect or routine.workspace or routine.context)


class Kind(NamedTuple):
    """What waits: its iterations are `waits`, of which so many are `waiting`; the `last` of its candidates in lanes, of which there is room
    for `most`. `picked`: whether its candidates are those that were found to be seen (`runtime/fans.h`)."""

    last: str
    most: int
    waits: str
    waiting: str
    picked: bool


class SideBySide:
    """Prints the iterations of a loop with cells; `block` prints steps, `shape` is the name of the shape of its cells."""

    def __init__(self, squares: Squares, shape: str, block: Callable[[Sequence[Step]], list[str]]) -> None:
        self.squares, self.shape, self.block = squares, shape, block
        index = squares.loop.index
        self.next, self.waits, self.waiting, self.again = (f"{index}_{part}" for part in ("next", "waits", "waiting", "again"))
        self.left, self.good, self.tried, self.fan = (f"{index}_{part}" for part in ("left", "good", "tried", "fan"))
        self.few = Kind("which", 2, f"{self.waits}[which]", f"{self.waiting}[which]", False)
        self.picked = Kind("last", SLOTS, f"{self.waits}[which]", f"{self.waiting}[which]", True)
        self.kind = self.few
        self.each = {index, *squares.cells.results, *(name for s in squares.flat for name in result_names(s))}
        candidates = [squares.cells, *squares.seen]
        self.own = {name for loop in candidates for name in (loop.index, *(n for s in loop.body for n in result_names(s)))}
        self.declared: dict[str, str] = {}  # the lanes of names

    def lines(self, lo: str, hi: str, inside: Sequence[str]) -> list[str]:
        """Returns all iterations; `inside` does one of them, with `wait` in its place."""
        index = self.squares.loop.index
        waiting, fans = (f"{self.waiting}[{one}] + {self.waiting}[{two}]" for one, two in ((0, 1), (2, 3)))
        return [
            f"int64_t {self.next} = {lo}, {self.waits}[4][{SIDE}], {self.again}[{SIDE}];",
            f"int {self.waiting}[4] = {{0, 0, 0, 0}}, {self.left} = 0, {self.fan}_left = 0;",
            f"teg_fans {self.fan}[2];",
            "for (;;) {",
            *indent(
                f"const int alone = {self.left} > 0;",
                f"int64_t {index};",
                f"if (alone) {index} = {self.again}[--{self.left}];",
                f"else if ({self.waiting}[0] == {SIDE} || {self.waiting}[1] == {SIDE} || ({self.next} >= {hi} && {waiting})) {{",
                *indent(
                    f"const int which = {self.waiting}[1] == {SIDE} || ({self.waiting}[0] < {SIDE} && {self.waiting}[1]);",
                    *self._flushed(self.few),
                ),
                f"}} else if ({self.waiting}[2] == {SIDE} || {self.waiting}[3] == {SIDE} || ({self.next} >= {hi} && {fans})) {{",
                *indent(
                    f"const int which = {self.waiting}[3] == {SIDE} || ({self.waiting}[2] < {SIDE} && {self.waiting}[3]) ? 3 : 2;",
                    f"const int last = teg_last_in_fan({self.fan} + which - 2, {self.waiting}[which]);",
                    *self._flushed(self.picked),
                ),
                f"}} else if ({self.next} < {hi}) {index} = {self.next}++;",
                "else break;",
                *inside,
            ),
            "}",
        ]

    def tried_so_far(self) -> str:
        """Returns the declaration of what is counted in a chunk: how many iterations have waited, and how many of these were good."""
        return f"int64_t {self.tried}[4] = {{0, 0, 0, 0}}, {self.good}[4] = {{0, 0, 0, 0}};"

    def wait(self) -> list[str]:
        """Returns lines by which an iteration with one or two candidates waits."""
        index, cells = self.squares.loop.index, self.squares.cells
        count = f"{spelled(cells.hi)} - {spelled(cells.lo)}"
        which = f"{index}_which"
        return [
            f"const int64_t {which} = {count} - 1;",
            f"if (!alone && {which} >= 0 && {which} < 2 && {self._trusted(which)}) {{",
            *indent(f"{self.waits}[{which}][{self.waiting}[{which}]++] = {index};", "continue;"),
            "}",
        ]

    def _trusted(self, which: str) -> str:
        """Returns the condition that most of those that waited were good, as far as is known."""
        return f"({self.tried}[{which}] < {TRIED} || 2 * {self.good}[{which}] > {self.tried}[{which}])"

    def later(self) -> Later:
        """Returns how an iteration waits when it is known what may be seen in its square; not twice."""
        index = self.squares.loop.index
        room = " | ".join(f"({self.waiting}[{which}] < {SIDE} && {self._trusted(str(which))}) << {which}" for which in (2, 3))
        how = f"{self.squares.cells.results[0]}_how"
        lines = [f"{self.waits}[{how}][{self.waiting}[{how}]++] = {index};", "continue;"]
        return Later(f"alone && {self.fan}_left ? 0 : {room}, {self.fan}, {self.waiting}", lines)

    def with_empty_ones(self, lines: Sequence[str], hi: str) -> list[str]:
        """Returns the lines of an iteration without candidates, which also do the next ones as long as eight of them have none: these are
        done without all that is asked for each iteration."""
        if any(isinstance(s, Run) for s in self.squares.before):
            return [*lines]
        first, *inside, last, end = lines
        index, cells = self.squares.loop.index, self.squares.cells
        steps = [s for s in self.squares.before if isinstance(s, READ)]
        unread = packed(f"(void){name};" for s in steps for name in result_names(s))
        read = [f"const int64_t {index} = {self.next} + k;", *self.block(steps), *unread]
        each = f"for (int k = 0; k < {SIDE}; k++) {{"
        ahead = [
            "int some = 0;",
            *[each, *indent(*read, f"some |= {spelled(cells.hi)} > {spelled(cells.lo)};"), "}"],
            "if (some) break;",
            *[each, *indent(*read), *inside, "}"],
            f"{self.next} += {SIDE};",
        ]
        return [first, *inside, *indent(f"while ({self.next} + {SIDE} <= {hi}) {{", *indent(*ahead), "}"), last, end]

    def _flushed(self, kind: Kind) -> list[str]:
        """Returns lines that compute what waits; what is not good is left. They are made from the last to the first: of what there is in
        lanes only that is kept which is read later."""
        cells, combined, shape = self.squares.cells, self.squares.combined, self.squares.cells.shape
        wide, bodies, columns = len(cells.values) - kind.picked * shape.forms, len(cells.results), shape.columns
        self.declared, self.kind = {}, kind
        kept = f"{self.fan} + which - 2" if kind.picked else "&eight"
        added = self._added()
        computed = [line for loop in reversed(self.squares.seen) for line in self._derivatives(loop)]
        if combined:
            computed[:0] = [f"{self._routine('pull')} rows, {kept}, weights, table);"]
        computed[:0] = [f"{self._routine('keep')} rows, {kept}, values);", *self._flat_programs()]
        computed[:0] = self._rows()
        computed[:0] = self._programs_before()
        computed[:0] = self._gathered()
        kinds = {kind: [place for place in self.declared.values() if place.startswith(kind[0])] for kind in ("int64_t", "v")}
        tables = f"double rows[{kind.most * wide}][{SIDE}], values[{bodies}][{SIDE}]"
        tables += f", weights[{bodies}][{SIDE}], table[{kind.most * columns}][{SIDE}];" if combined else ";"
        good = f"{self.fan}[which - 2].good" if kind.picked else "eight.good"
        return [
            f"const int there = {kind.waiting};",
            tables,
            *packed(kinds["int64_t"], "int64_t ", ", ", ";"),
            *packed(kinds["v"], "double ", ", ", ";"),
            *([] if kind.picked else ["teg_eight eight;"]),
            f"if (there < {FEW}) memset({good}, 0, sizeof {good});",
            "else {",
            *indent(*computed, f"{self.tried}[which] += there;", *added),
            "}",
            "for (int k = 0; k < there; k++)",
            f"    if (!{good}[k]) {self.again}[{self.left}++] = {kind.waits}[k];",
            f"{kind.waiting} = 0, {self.fan}_left = {int(kind.picked)};",
            "continue;",
        ]

    def _routine(self, verb: str) -> str:
        """Returns the beginning of the call of a routine for eight squares."""
        return f"teg_{verb}_{'fan' if self.kind.picked else 'eight'}(&{self.shape}, {self.kind.last} + 1,"

    def _programs_before(self) -> list[str]:
        """Returns lines that run the flat programs of eight iterations on which their cells depend."""
        runs = [s for s in self.squares.before if isinstance(s, Run)]
        made = {name for s in runs for name in result_names(s)}
        body = [
            *self._named([a for s in runs for a in operands(s)], made),
            *self.block(runs),
            *packed(f"{self._lane(name)} = {name};" if name in self.declared else f"(void){name};" for name in sorted(made)),
        ]
        return [f"for (int k = 0; k < {SIDE}; k++) {{", *indent(*body), "}"] if runs else []

    def _flat_programs(self) -> list[str]:
        """Returns lines that run the other flat programs of eight iterations, when their cells are known."""
        cells, combined = self.squares.cells, self.squares.combined
        runs = [s for s in self.squares.flat[len(self.squares.before) :] if isinstance(s, Run)]
        weights: list[Arg] = []
        if combined:
            by_table = dict(zip(combined.of, combined.weights, strict=True))
            weights = [by_table[t] for t in cells.tables]
        made = {*cells.results, *(name for s in runs for name in result_names(s))}
        kept = [name for name in made if name in self.declared]
        body = [
            *self._named([*(a for s in runs for a in operands(s)), *weights], made),
            *(f"const double {r} = values[{j}][k];" for j, r in enumerate(cells.results)),
            *self.block(runs),
            *packed(f"{self._lane(name)} = {name};" for name in sorted(kept)),
            *packed(f"weights[{j}][k] = {spelled(w)};" for j, w in enumerate(weights)),
            *packed(f"(void){name};" for name in sorted(made)),
        ]
        return [f"for (int k = 0; k < {SIDE}; k++) {{", *indent(*body), "}"]

    def _lane(self, name: str) -> str:
        """Returns the place of a name in its lanes: of iterations or, for numbers of candidates, of these."""
        self.declared.setdefault(name, f"{name}_8[{self.kind.most}][{SIDE}]" if name in self.own else f"{name}_8[{SIDE}]")
        return f"{name}_8[c][k]" if name in self.own else f"{name}_8[k]"

    def _named(self, read: Sequence[Arg], made: set[str]) -> list[str]:
        """Returns lines that give names of an iteration or a candidate their values in a lane, but for those that are made there."""
        names = [a for a in dict.fromkeys(read) if isinstance(a, str) and a in self.each | self.own and a not in made]
        return [f"const {'int64_t' if name.startswith('i') else 'double'} {name} = {self._lane(name)};" for name in names]

    def _gathered(self) -> list[str]:
        """Returns lines that read integers and entries, one iteration after the other; the last one is repeated."""
        index, kind = self.squares.loop.index, self.kind
        own: list[str] = []
        candidate = f"({self.fan}[which - 2].pick[c][at] < 0 ? 0 : {self.fan}[which - 2].pick[c][at])" if kind.picked else "c"
        for loop in (self.squares.cells, *self.squares.seen):
            taken = self._taken(loop)
            steps: list[Step] = [s for s in loop.body if isinstance(s, READ) and s not in taken]
            own += [f"const int64_t {loop.index} = {spelled(loop.lo)} + {candidate};", *self.block(steps), *self._stored(steps)]
        steps = [s for s in self.squares.flat if isinstance(s, READ)]
        return [
            f"for (int k = 0; k < {SIDE}; k++) {{",
            *indent(
                "const int at = k < there ? k : there - 1;",
                f"const int64_t {index} = {kind.waits}[at];",
                *self.block(steps),
                *self._stored(steps),
                *([f"{self._lane(index)} = {index};"] if index in self.declared else []),
                f"for (int c = 0; c <= {kind.last}; c++) {{",
                *indent(*own),
                "}",
            ),
            "}",
        ]

    def _stored(self, steps: Sequence[Step]) -> list[str]:
        """Returns lines that keep what is read later."""
        names = [name for s in steps for name in result_names(s)]
        return packed(f"{self._lane(name)} = {name};" if name in self.declared else f"(void){name};" for name in names)

    def _taken(self, loop: Loop) -> list[Take]:
        """Returns the derivatives that an iteration over candidates takes."""
        combined = self.squares.combined
        return [s for s in loop.body if isinstance(s, Take) and combined is not None and s.table == combined.table]

    def _rows(self) -> list[str]:
        """Returns lines that compute the numbers of all candidates."""
        cells = self.squares.cells
        kept = cells.values[cells.shape.forms if self.kind.picked else 0 :]
        runs = [s for s in cells.body if isinstance(s, Run)]
        made = {name for s in runs for name in result_names(s)}
        unread = packed(f"(void){name};" for name in made if name not in kept)
        values = [a for a in kept if isinstance(a, str) and a not in made]
        stored = packed([f"rows[c * {len(kept)} + {j}][k] = {spelled(v)};" for j, v in enumerate(kept)])
        named = self._named([*(a for s in runs for a in operands(s)), *values], made)
        return [
            f"for (int c = 0; c <= {self.kind.last}; c++)",
            f"    for (int k = 0; k < {SIDE}; k++) {{",
            *indent(*indent(*named, *self.block(runs), *stored, *unread)),
            "    }",
        ]

    def _derivatives(self, loop: SeenLoop) -> list[str]:
        """Returns lines that compute what an iteration over candidates adds."""
        cells = self.squares.cells
        taken = self._taken(loop)
        columns = cells.shape.columns
        runs = [s for s in loop.body if isinstance(s, Run)]
        made = {name for s in (*runs, *taken) for name in result_names(s)}
        given = [f"const double {s.name} = table[c * {columns} + {s.column}][k];" for s in taken]
        results = [name for s in (*taken, *runs) for name in result_names(s)]
        return [
            f"for (int c = 0; c <= {self.kind.last}; c++)",
            f"    for (int k = 0; k < {SIDE}; k++) {{",
            *indent(
                *indent(
                    *self._named([a for s in runs for a in operands(s)], made),
                    *given,
                    *self.block(runs),
                    *packed(f"{self._lane(r)} = {r};" if r in self.declared else f"(void){r};" for r in results),
                )
            ),
            "    }",
        ]

    def _added(self) -> list[str]:
        """Returns lines that add what eight iterations give, one after the other."""
        loop, after = self.squares.loop, [s for s in self.squares.flat if isinstance(s, ADDED)]
        sums = [f"{r} += {spelled(v)};" for r, v in zip(loop.results, loop.values, strict=True)]
        made = set[str]()
        kept = f"{self.fan}[which - 2]" if self.kind.picked else "eight"
        lines = [f"if (!{kept}.good[k]) continue;", f"{self.good}[which]++;"]
        unseen, edged = "eight.near[k] != c && eight.owner[k] != c", "eight.near[k] == c"
        if self.kind.picked:
            unseen, edged = f"!{kept}.seen[c][k]", f"{kept}.seen[c][k] > 1"
        lines += self._named([*loop.values, *(a for s in after for a in operands(s))], made)
        lines += [*self.block(after), *sums]
        for seen in self.squares.seen:
            added = [s for s in seen.body if isinstance(s, ADDED)]
            forms = {s.name for s in self._taken(seen) if s.column < self.squares.cells.shape.forms}
            plain = [s for s in with_zeros(seen.body, forms) if isinstance(s, ADDED)]
            lines += [
                f"for (int c = 0; c <= {self.kind.last}; c++) {{",
                *indent(
                    f"if ({unseen}) continue;",
                    f"if (!({edged})) {{",
                    *indent(*self._named([a for s in plain for a in operands(s)], made), *self.block(plain), "continue;"),
                    "}",
                    *self._named([a for s in added for a in operands(s)], made),
                    *self.block(added),
                ),
                "}",
            ]
        return ["for (int k = 0; k < there; k++) {", *indent(*lines), "}"]
