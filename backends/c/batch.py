"""The exported functions of a kernel: the loop over the points of a batch, shared by threads.

for blocks of points:  for SIDE points:  inputs -> (decision, straight line) -> the others wait, or the element at each
                       for SIDE points that wait:  inputs -> the line of points that surfaces cross -> the element at the others
                       outputs of the block
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from teg.backends.c.frame import Routine
from teg.backends.c.lanes import SIDE
from teg.backends.c.straights import Straight
from teg.backends.c.team import shared
from teg.backends.c.text import indent
from teg.program import Program, has_ties

ABI = """\
#ifndef TEG_ARRAY
#define TEG_ARRAY
/* An array: its numbers, row by row (double; int64_t for arrays of indices), how many of them lie between two elements of the
   batch (0: the batch shares one), and its shape. */
typedef struct {
    const void *data;
    long stride;
    const int64_t *shape;
} teg_array;
#endif"""
"""The type of an argument that is an array; every kernel has one interface, whether it takes arrays or not."""
TOGETHER = 64
"""Points whose outputs are written together, at most."""


def exported(name: str, real: str = "double") -> tuple[list[str], list[str]]:
    """Returns the heads of the two functions of every kernel: that which is watched, and that which is not."""
    first = f"long n, const {real} *const *p, const long *stride, const teg_array *a, {real} *const *out, long *notes, int threads"
    watched = [f"TEG_EXPORT int {name}_watched(", f"    {first},", "    long (*poll)(void *data), void *data)"]
    return watched, [f"TEG_EXPORT int {name}(", f"    {first})"]


def unwatched(name: str, real: str = "double") -> list[str]:
    """Returns the function that is not watched."""
    body = indent(f"return {name}_watched(n, p, stride, a, out, notes, threads, NULL, NULL);")
    return [*exported(name, real)[1], "{", *body, "}"]


def together(program: Program) -> int:
    """Returns the number of points whose outputs are written together: as many as the first cache holds."""
    return TOGETHER if len(program.outputs) <= TOGETHER else SIDE


def _weighed(call: str, outputs: int) -> list[str]:
    """Returns a call of the element at a point; where a tie was met once more, and, where that changes nothing, with all ties true and
    false: only ties that matter are noted."""
    return [
        "double *to = row;",
        "int differ = 0;",
        "for (;;) {",
        *indent(
            call,
            "if (!ctx.tied) break;",
            f"if (to == other) differ = teg_differ(row, other, {outputs});",
            f"if (ctx.order == -1) for (int j = 0; j < {outputs}; j++) row[j] = 0.5 * (row[j] + other[j]);",
            "if (differ || ctx.order == -2) break;",
            "ctx.order = ctx.order == -1 ? 2 : -ctx.order;",
            "to = other;",
        ),
        "}",
        "ctx.tied = differ;",
    ]


def _in_both_orders(call: str, outputs: int) -> list[str]:
    """Returns a call of the element at a point, and once more where a tie was met. It stands in one place, where the C compiler may inline
    it."""
    return [
        "double *to = row;",
        "for (;;) {",
        *indent(call, "if (!ctx.tied || ctx.order < 0) break;", "ctx.order = -1;", "to = other;"),
        "}",
        f"if (ctx.tied) for (int j = 0; j < {outputs}; j++) row[j] = 0.5 * (row[j] + other[j]);",
    ]


def _copies(inputs: int, lanes: str, place: str) -> list[str]:
    """Returns lines that make in[i] copies of input i at the `few` points whose places are known by k; the last point is repeated."""
    return [
        f"for (int i = 0; i < {inputs}; i++) {{",
        *indent(
            f"double *const column = columns + {SIDE} * i;",
            f"for (long k = 0; k < {lanes}; k++) column[k] = p[i][{place.replace('k', '(k < few ? k : few - 1)')} * stride[i]];",
            "in[i] = column;",
        ),
        "}",
    ]


def _inputs(inputs: int, real: str, straight: Straight | None) -> tuple[list[str], list[str], list[str]]:
    """Returns lines that are run once, and lines that make in[i] the values of input i at the points from `at` on, or at points that wait:
    where these are, eight copies of the one that all points share, or copies."""
    copies = _copies(inputs, f"{SIDE}" if straight else "few", "(at + k)")
    waiting = _copies(inputs, f"{SIDE}", "(first + waits[g + k])")
    if real != "double":
        return [], copies, waiting
    once = [
        "int simple = 1;",
        f"for (int i = 0; w && in && n >= {SIDE} && i < {inputs}; i++) {{",
        *indent(
            f"double *const column = columns + {SIDE} * i;",
            f"if (!stride[i]) for (int k = 0; k < {SIDE}; k++) column[k] = p[i][0];",
            "base[i] = stride[i] ? p[i] : column;",
            "simple &= stride[i] == 0 || stride[i] == 1;",
        ),
        "}",
    ]

    def where(condition: str, at: str, otherwise: list[str]) -> list[str]:
        direct = f"if ({condition}) for (int i = 0; i < {inputs}; i++) in[i] = base[i] + {at} * stride[i];"
        return [direct, f"else {otherwise[0]}", *otherwise[1:]]

    here = where(f"simple && few == {SIDE}", "at", copies)
    side_by_side = f"simple && few == {SIDE} && waits[g + {SIDE - 1}] == waits[g] + {SIDE - 1}"
    return once, here, where(side_by_side, "(first + waits[g])", waiting)


@dataclass(frozen=True)
class _Batch:
    """The loop over a batch: every point runs the routine `element`, but for those that the functions `straight` compute."""

    program: Program
    element: Routine
    real: str
    straight: Straight | None

    @property
    def inputs(self) -> int:
        return len(self.program.parameters)

    @property
    def outputs(self) -> int:
        return len(self.program.outputs)

    @property
    def apart(self) -> int:
        """How far apart the outputs of a point are: as many points are written together."""
        return together(self.program)

    @property
    def ties(self) -> bool:
        return has_ties(self.program.body)

    @property
    def crossed(self) -> str | None:
        """The function of points that surfaces cross."""
        return self.straight.crossed.lines[0].name if self.straight and self.straight.crossed else None

    @property
    def has_base(self) -> bool:
        """Whether inputs may be read where the caller has them."""
        return self.real == "double"

    def room(self) -> list[str]:
        """Returns lines that allocate a thread's memory: the workspace of the element, copies of inputs, and outputs."""
        space, outputs = self.element.workspace, self.outputs
        rows = self.apart + 1 + self.ties + (SIDE if self.crossed else 0)
        base = f", **const base = in + {self.inputs}" if self.has_base else ""
        return [
            f"double *const w = malloc({space + SIDE * self.inputs + rows * outputs + 1} * sizeof *w);",
            f"double *const columns = w + {space}, *const results = columns + {SIDE * self.inputs};",
            f"double *const row = results + {self.apart * outputs}{f', *const other = row + {outputs}' if self.ties else ''};",
            *([f"double *const across = row + {(1 + self.ties) * outputs};"] if self.crossed else []),
            f"const double **const in = malloc({2 * self.inputs + 1} * sizeof *in){base};",
        ]

    def decided(self) -> list[str]:
        """Returns lines that decide which of SIDE points are `live` or `fast`, and write the outputs of the fast ones to `f`."""
        straight = self.straight
        if not straight:
            return []
        given = ", ".join([*(f"in[{i}]" for i in straight.decided_by), "live", "fast"])
        zero = f"if (!some) for (int j = 0; j < {self.outputs}; j++) teg_fill(f + {self.apart} * j, {SIDE}, 0.0);"
        used = ", ".join([*(f"in[{i}]" for i in straight.used), "f"])
        return [
            "if ((stopped = teg_stopped(&pace))) break;",
            "if (notes) for (long k = 0; k < few; k++) notes[at + k] = 0;",
            f"int64_t live[{SIDE}], fast[{SIDE}];",
            f"const int some = {straight.decision}({given});",
            *([f"if (some & 2) {straight.line}({used});", f"else {zero}"] if straight.line else [zero]),
        ]

    def alone(self) -> list[str]:
        """Returns lines that compute the outputs of point k by the element, and write them to `row`."""
        element, ties = self.element, self.ties
        values = [] if element.indirect else [f"in[{i}][k]" for i in range(self.inputs)]
        given = [*values, "to" if ties else "row", *["w"] * (element.workspace > 0), *["&ctx"] * element.context]
        call = f"element({', '.join(given)});"
        return [
            "if ((stopped = teg_stopped(&pace))) break;",
            *([f"for (int j = 0; j < {self.inputs}; j++) w[j] = in[j][k];"] if element.indirect else []),
            *(["teg_context ctx = {+1, 0, 0, 0, 0, 0, &pace};"] if element.context else []),
            *((_weighed if self.program.weighs_ties else _in_both_orders)(call, self.outputs) if ties else [call]),
        ]

    @property
    def note(self) -> str:
        """What is told of a point that the element computed."""
        return "8 * ctx.evaluations + 4 * ctx.crowded + 2 * ctx.missed + ctx.tied" if self.element.context else "0"

    def each(self) -> list[str]:
        """Returns lines for each of SIDE points: its outputs, or its place in the queue of those that surfaces cross."""
        passed = [
            "if (fast[k]) continue;",
            "if (!live[k]) {",
            *indent(f"for (int j = 0; j < {self.outputs}; j++) f[{self.apart} * j + k] = 0.0;", "continue;"),
            "}",
        ]
        if self.crossed:
            return [*passed, "waits[waiting++] = (int)(g + k);"]
        return [
            *(passed if self.straight else []),
            *self.alone(),
            f"for (int j = 0; j < {self.outputs}; j++) f[{self.apart} * j + k] = row[j];",
            f"if (notes) notes[at + k] = {self.note};",
        ]

    def queue(self, gathered: list[str]) -> list[str]:
        """Returns lines for the points of a block that wait: SIDE at a time where surfaces cross them, the others one by one."""
        straight = self.straight
        if not straight or not straight.crossed:
            return []
        line = straight.crossed.lines[0]
        given = ", ".join([*(f"in[{i}]" for i in line.inputs), "steady", "across", "good"])
        to = f"for (int j = 0; j < {self.outputs}; j++) f[{self.apart} * j]"
        return [
            f"double steady[{straight.crossed.kept}];",
            f"if (waiting) {straight.crossed.steady.name}(steady);",
            f"for (int g = 0; g < waiting && !stopped; g += {SIDE}) {{",
            *indent(
                f"const int few = waiting - g < {SIDE} ? waiting - g : {SIDE};",
                f"double good[{SIDE}];",
                *gathered,
                f"{line.name}({given});",
                "for (int k = 0; k < few; k++) {",
                *indent(
                    "double *const f = results + waits[g + k];",
                    "if (good[k] != 0.0) {",
                    *indent(f"{to} = across[{SIDE} * j + k];", "continue;"),
                    "}",
                    *self.alone(),
                    f"{to} = row[j];",
                    f"if (notes) notes[first + waits[g + k]] = {self.note};",
                ),
                "}",
            ),
            "}",
        ]

    def blocks(self, here: list[str], gathered: list[str]) -> list[str]:
        """Returns the loop over the blocks of a thread; `here` and `gathered` are lines that make the inputs of SIDE points."""
        cast = "" if self.real == "double" else f"({self.real})"
        written = f"out[j][first + k] = {cast}results[{self.apart} * j + k];"
        return [
            "for (long first = 0; first < n; first += together) {",
            *indent(
                "const long count = n - first < together ? n - first : together;",
                f"int stopped = 0{f', waiting = 0, waits[{self.apart}]' if self.crossed else ''};",
                "if (!w || !in) {",
                *indent("failed = 1;", "continue;"),
                "}",
                f"for (long g = 0; g < count && !stopped; g += {SIDE}) {{",
                *indent(
                    f"const long at = first + g, few = count - g < {SIDE} ? count - g : {SIDE};",
                    "double *const f = results + g;",
                    *here,
                    *self.decided(),
                    f"for (long k = 0; {'some && ' if self.straight else ''}k < few; k++) {{",
                    *indent(*self.each()),
                    "}",
                ),
                "}",
                *self.queue(gathered),
                "if (stopped) continue;",
                f"for (int j = 0; j < {self.outputs}; j++) for (long k = 0; k < count; k++) {written}",
            ),
            "}",
        ]


def batch_loop(program: Program, name: str, element: Routine, real: str, straight: Straight | None) -> Iterator[str]:
    """Yields the exported functions: every point by itself; where ties were met, the mean of the two orders. A call that is `watched` is
    stopped between points, and in integrals that may take long. The thread that called keeps asking while it waits for the others.

    Outputs are kept for a block of points and written together, some lines of the cache for each: those of one point may all lie in places
    that the cache cannot hold at once. In a block SIDE points at a time are looked at by the functions `straight`."""
    batch = _Batch(program, element, real, straight)
    apart = batch.apart
    once, here, gathered = _inputs(batch.inputs, real, straight)
    yield from (
        *exported(name, real)[0],
        "{",
        *indent(
            "const int team = threads > 1 ? threads : 1;",
            f"const long each = n / team, together = team == 1 || each >= {32 * apart} ? {apart} : each >= {8 * SIDE} ? {SIDE} : 1;",
            "const long share = each / (32 * together) + 1;",
            "teg_watch watch = {poll, data, 0};",
            "int failed = 0, working = 0;",
            "(void)p, (void)stride, (void)a, (void)share, (void)working;",
        ),
        *indent(
            *shared(
                [*batch.room(), *once, "teg_pace pace = {&watch, 0, 16};"],
                batch.blocks(here, gathered),
                ["free(w);", "free(in);"],
                share="share",
            ),
            "return failed ? 1 : watch.stopped ? 2 : 0;",
        ),
        "}",
        "",
        *unwatched(name, real),
    )
