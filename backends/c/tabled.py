"""The entry of programs with tables: it fills the tables from the columns of a call, SIDE points at a time, and adds up what is sent.

One point's tables and derivatives lie together, a column's points do: eight points are a line of the cache of every column.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import accumulate

from teg.backends.c.batch import exported, unwatched
from teg.backends.c.lanes import SIDE
from teg.backends.c.team import shared
from teg.backends.c.text import indent, literal, packed
from teg.program.arrays import Like
from teg.program.tabled import TabledProgram


def tabled_entry(tabled: TabledProgram, name: str, no_memory: int) -> Iterator[str]:
    """Yields the exported functions, around `element`."""
    program, tables = tabled.program, tabled.tables
    widths = [len(t.entries) for t in tables]
    sizes = [widths[o.array] if isinstance(o, Like) else 1 for o in program.outputs]
    starts = [0, *accumulate(SIDE * s for s in (*widths, *sizes))]  # where tables and then outputs begin in a workspace
    places = starts[len(tables) :]
    entries = [(e if isinstance(e, int) else -1, 0.0 if isinstance(e, int) else e) for t in tables for e in t.entries]
    sums = [[s for s in tabled.sent if s.to == o] for o in range(tabled.outputs)]
    flat = [s for group in sums for s in group]
    yield from _table("int", "given", tabled.given)
    yield from _table("int", "entry_from", (e for e, _ in entries))
    yield from _table("double", "entry_is", (literal(x) for _, x in entries))
    yield from _table("int", "sent_first", [0, *accumulate(map(len, sums))])
    yield from _table("int", "sent_at", (places[s.number] + (s.entry or 0) for s in flat))
    yield from _table("int", "sent_step", (sizes[s.number] for s in flat))
    filled = [f"const teg_array tables[{max(1, len(tables))}] = {{"]
    for j, t in enumerate(tables):
        yield f"static const int64_t shape_{j}[2] = {{{t.rows}, {t.columns}}};"
        filled.append(f"    {{work + {starts[j]}, {widths[j]}, shape_{j}}},")
    filled += ["};", f"double *const to[{max(1, len(places) - 1)}] = {{"]
    filled += [*indent(*packed([f"work + {p}" for p in places[:-1]], "", ", ", ",")), "};"]
    yield ""
    yield from (*exported(name)[0], "{", *indent(*_blocks(tabled, widths, starts, filled, no_memory)), "}", "", *unwatched(name))


def _table(kind: str, name: str, values: Iterable[object]) -> list[str]:
    texts = [str(v) for v in values] or ["0"]
    return [f"static const {kind} {name}[{len(texts)}] = {{", *indent(*packed(texts, "", ", ", ",")), "};"]


def _blocks(tabled: TabledProgram, widths: list[int], starts: list[int], filled: list[str], no_memory: int) -> list[str]:
    """Returns the loop over blocks of points."""
    block = [
        f"const long few = n - first < {SIDE} ? n - first : {SIDE};",
        "if (!work || teg_stopped(&pace)) {",
        *indent("failed |= !work;", "continue;"),
        "}",
        *_filling(widths, starts),
        *_elements(len(tabled.given), no_memory),
        *_sending(tabled.outputs),
    ]
    return [
        f"const int team = threads > 1 && n > {SIDE} ? threads : 1, inner = n > 1 ? 1 : threads;",
        "teg_watch watch = {poll, data, 0};",
        "int failed = 0, working = 0;",
        "(void)a, (void)working, (void)given, (void)entry_is;",
        *shared(
            [f"double *const work = calloc({starts[-1] + 1}, sizeof *work);", *filled, "teg_pace pace = {&watch, 0, 16};"],
            [f"for (long first = 0; first < n; first += {SIDE}) {{", *indent(*block), "}"],
            ["free(work);"],
        ),
        "return failed ? 1 : watch.stopped ? 2 : 0;",
    ]


def _filling(widths: list[int], starts: list[int]) -> Iterator[str]:
    """Yields the lines that fill the tables of `few` points."""
    first = 0
    for width, start in zip(widths, starts, strict=False):
        inside = [
            f"const int from = entry_from[{first} + j];",
            f"double *const at = work + {start} + j;",
            f"if (from < 0) for (long k = 0; k < few; k++) at[{width} * k] = entry_is[{first} + j];",
            f"else for (long k = 0; k < few; k++) at[{width} * k] = p[from][(first + k) * stride[from]];",
        ]
        yield from (f"for (int j = 0; j < {width}; j++) {{", *indent(*inside), "}")
        first += width


def _elements(given: int, no_memory: int) -> list[str]:
    """Returns the lines that compute `few` points, one after the other."""
    return [
        f"const double *q[{max(1, given)}];",
        f"long by[{max(1, given)}];",
        f"for (int i = 0; i < {given}; i++) {{",
        *indent("by[i] = stride[given[i]];", "q[i] = p[given[i]] + first * by[i];"),
        "}",
        "for (long k = 0; k < few; k++) {",
        *indent(
            "const long note = element(k, q, by, tables, to, &pace, inner);",
            f"if (note < 0 || note & {no_memory}) failed = 1;",
            "if (notes) notes[first + k] = note;",
        ),
        "}",
    ]


def _sending(outputs: int) -> list[str]:
    """Returns the lines that add up what is sent to every output."""
    return [
        f"for (int o = 0; o < {outputs}; o++) {{",
        *indent(
            f"double sum[{SIDE}] = {{0.0}};",
            "for (int m = sent_first[o]; m < sent_first[o + 1]; m++)",
            *indent(f"for (int k = 0; k < {SIDE}; k++) sum[k] += work[sent_at[m] + k * sent_step[m]];"),
            "for (long k = 0; k < few; k++) out[o][first + k] = sum[k];",
        ),
        "}",
    ]
