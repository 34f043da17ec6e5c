"""Runs of iterations that nothing crosses, as one C function: it reads, computes and adds up eight iterations at a time.

    for each row:
        for eight iterations since … until:     read data; compute; sums += what differs between iterations
    lanes += sums + (how often) · what is the same in all iterations

The sums are variables of eight numbers, so that compilers keep them in registers. What is left of a run, fewer than eight iterations, is up
to the caller. An array whose last axis is as long as what is read of it has a text of its own: then the distance between the entries that
eight iterations read is known, and compilers read these together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import NamedTuple

from teg.backends.c.crossed import Crossed
from teg.backends.c.items import Item, defines, needed, reads
from teg.backends.c.lanes import SIDE
from teg.backends.c.stages import Point
from teg.backends.c.text import TRUTH, indent, packed, wrapped
from teg.program import Arg, Assign
from teg.program.names import is_parameter, parameter_number, unused_numbers

PIECE = 4096
"""Iterations of a row between two questions whether the call is to be stopped; a multiple of SIDE."""


def divided(found: Crossed, sums: Sequence[int], varying: Container[int]) -> Crossed:
    """Returns the straight line with other outputs: the terms of each of the `sums` that differ between points, and behind all of these
    the terms that are the same. Inputs in `varying` differ."""
    numbers = unused_numbers(n for item in found.items for n in defines(item))
    uses = Counter(a for item in found.items for a in reads(item))
    made: dict[Arg, Assign] = {item.name: item for item in found.items if isinstance(item, Assign)}
    differing = _differing(found, varying)
    items: list[Item] = list(found.items)

    def total(terms: Sequence[Arg]) -> Arg:
        if len(terms) < 2:
            return terms[0] if terms else 0.0
        items.append(whole := Assign(f"v{next(numbers)}", "add", tuple(terms)))
        return whole.name

    def terms_of(output: Arg) -> Iterator[Arg]:
        stack = [output]
        while stack:
            term = stack.pop()
            inner = made.get(term)
            if inner is not None and inner.op in ("add", "const") and (term == output or uses[term] == 1):
                stack += reversed(inner.args)
            else:
                yield term

    outputs: list[Arg] = []
    steady: list[Arg] = []
    for j in sums:
        terms = list(terms_of(found.outputs[j]))
        outputs.append(total([t for t in terms if t in differing]))
        steady.append(total([t for t in terms if t not in differing and t != 0.0]))
    both = (*outputs, *steady)
    return Crossed(tuple(needed(items, both)), both, True)


def joined(found: Crossed, parts: Crossed, sums: Sequence[int]) -> Crossed:
    """Returns the straight line `found` with outputs that are the sums of both `parts` that `divided` gives."""
    numbers = unused_numbers(n for item in parts.items for n in defines(item))
    outputs, items = list(found.outputs), list(parts.items)
    for m, j in enumerate(sums):
        items.append(both := Assign(f"v{next(numbers)}", "add", (parts.outputs[m], parts.outputs[len(sums) + m])))
        outputs[j] = both.name
    return Crossed(tuple(items), tuple(outputs), found.good)


def _differing(found: Crossed, varying: Container[int]) -> set[Arg]:
    """Returns the values that differ between points."""
    inputs = {str(a) for item in found.items for a in reads(item) if is_parameter(a)}
    differing: set[Arg] = {a for a in (*inputs, *found.outputs) if is_parameter(a) and parameter_number(str(a)) in varying}
    for item in found.items:
        if not differing.isdisjoint(reads(item)):
            differing.update(defines(item))
    return differing


class CoveredRuns(NamedTuple):
    """The iterations of rows: `iteration` is their index, counted from `lo`; `row` is the index of rows, None if there is one row.

    `outer` and `inner` are the lines of C of what is read in a row and in an iteration, `inputs` the names of what the straight line
    reads; `inside` has the names that differ between iterations, `given` what the lines read beside arrays, each declared. `arrays` says
    of each array that is read its C type, how many axes it has, and how long the last one must be to have a text of its own, if it may.
    """

    iteration: str
    lo: str
    row: str | None
    outer: Sequence[str]
    inner: Sequence[str]
    inputs: Mapping[int, str]
    inside: Container[str]
    given: Sequence[str]
    arrays: Mapping[int, tuple[str, int, int | None]]

    @property
    def arguments(self) -> list[str]:
        """Returns the arguments of the C function before those that all of them have."""
        return [
            *(name for k in self.arrays for name in (f"a{k}", f"s{k}")),
            *(name.split()[-1] for name in self.given),
            *([f"{self.row}_first", f"{self.row}_count"] if self.row else []),
        ]


def covered_runs(runs: CoveredRuns, point: Point, grouped: bool) -> str:
    """Returns the C function @: it adds up what iterations starts[row] + from … ends[row] of rows give, in groups of SIDE and at most PIECE
    of them, and returns whether a run goes on behind that. `grouped`: as in `Staged`."""
    known = {k: width for k, (_, _, width) in runs.arrays.items() if width is not None}
    rows = ["int64_t first", "int rows"] if runs.row else []
    shared = ["const double *s", *(["const double *m"] if grouped else [])]
    common = ["const double *starts", "const double *ends", "int64_t from", *shared, f"double (*restrict lanes)[{SIDE}]"]
    arrays = [d for k, (kind, _, _) in runs.arrays.items() for d in (f"const {kind} *a{k}", f"const int64_t *{_shape(k, known)}{k}")]
    widths = [f"int64_t width{k}" for k in known]
    given = [*arrays, *runs.given, *rows, *common]
    inside = [*_shapes(runs, known), *(["(void)m;"] if grouped else []), *_inside(runs, point)]
    if not known:
        return wrapped([f"TEG_EIGHT int @({', '.join(given)})", "{", *indent(*inside), "}"])
    passed = [declared.split("*")[-1].split()[-1] for declared in given[:-1]] + ["lanes"]
    test = " && ".join(f"shape{k}[{runs.arrays[k][1] - 1}] == {width}" for k, width in known.items())
    calls = [[*passed, *map(str, known.values())], [*passed, *(f"shape{k}[{runs.arrays[k][1] - 1}]" for k in known)]]
    return wrapped(
        [
            f"TEG_INLINE int @_of({', '.join([*given, *widths])})",
            "{",
            *indent(*inside),
            "}",
            "",
            f"TEG_EIGHT int @({', '.join(given)})",
            "{",
            *indent(f"if ({test}) return @_of({', '.join(calls[0])});", f"return @_of({', '.join(calls[1])});"),
            "}",
        ]
    )


def _shape(array: int, known: Container[int]) -> str:
    return "shape" if array in known else "s"


def _shapes(runs: CoveredRuns, known: Mapping[int, int]) -> list[str]:
    """Returns the declarations of the shapes whose last axes may be known."""
    lines = []
    for k in known:
        axes = [f"shape{k}[{axis}]" for axis in range(runs.arrays[k][1] - 1)]
        lines.append(f"const int64_t s{k}[] = {{{', '.join([*axes, f'width{k}'])}}};")
    return lines


def _inside(runs: CoveredRuns, point: Point) -> list[str]:
    """Returns the lines of the function."""
    read = [i for i, name in runs.inputs.items() if name in runs.inside]
    text, outputs = point.printed(read)
    count = len(outputs) // 2
    moving, steady = outputs[:count], outputs[count:]
    sums = [m for m in range(count) if moving[m] is not None]
    each = [f"const int64_t {runs.iteration} = at + k;", *runs.inner, *packed(f"b{i}[k] = {runs.inputs[i]};" for i in read)]
    eight = [
        *packed(f"const teg_lanes_8 c{i} = *(const teg_lanes_8 *)(b{i} + k);" for i in read),
        *packed(f"const double c{i} = {name};" for i, name in runs.inputs.items() if i not in read),
        "{",
        *indent(*text, *packed(_added(f"sum_{m}", moving[m]) for m in sums)),
        "}",
    ]
    row = [f"const int64_t {runs.row} = first + row;", *runs.outer] if runs.row else []
    again = [f"lanes[{m}][k] += groups * {steady[m]};" for m in range(count) if steady[m] is not None]
    return [
        *packed([f"sum_{m} = {{0.0}}" for m in sums], "teg_lanes_8 ", ", ", ";"),
        "double groups = 0.0;",
        "int more = 0;",
        f"for (int row = 0; row < {'rows' if runs.row else '1'}; row++) {{",
        *indent(
            *row,
            f"const int64_t since = {runs.lo} + (int64_t)starts[row] + from, until = {runs.lo} + (int64_t)ends[row];",
            f"const int64_t stop = until - since < {PIECE} ? until : since + {PIECE};",
            "more |= stop < until;",
            f"for (int64_t at = since; at + {SIDE} <= stop; at += {SIDE}) {{",
            *indent(
                *packed([f"b{i}[{SIDE}]" for i in read], "double ", ", ", ";"),
                "#ifdef __GNUC__",
                "#pragma GCC unroll 1",
                "#endif",
                f"for ({TRUTH} k = 0; k < {SIDE}; k++) {{",
                *indent(*each),
                "}",
                f"for (int k = 0; k < {SIDE}; k += (int)(sizeof(teg_lanes_8) / sizeof(double))) {{",
                *indent(*eight),
                "}",
                "groups += 1.0;",
            ),
            "}",
        ),
        "}",
        *packed(f"*(teg_lanes_8 *)lanes[{m}] += sum_{m};" for m in sums),
        *([f"for (int k = 0; k < {SIDE}; k++) {{", *indent(*packed(again)), "}"] if again else ["(void)groups;"]),
        "return more;",
    ]


def _added(total: str, term: str | tuple[str, str] | None) -> str:
    """Returns a line that adds a term to a sum of numbers side by side; a pair is a product."""
    return f"{total} = teg_fma_8({term[0]}, {term[1]}, {total});" if isinstance(term, tuple) else f"{total} += {term};"
