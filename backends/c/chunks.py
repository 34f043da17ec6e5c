"""An outermost loop of a program with arrays in chunks, which threads share.

Each chunk adds to copies of the outputs and tables that iterations add to in the same places, and marks what it touches. Copies are added
to the originals in the order of the chunks, so that results have the same bits for any number of threads; one that was added is cleared
where it is marked and used again, so that there are about as many copies as threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from teg.backends.c.team import shared
from teg.backends.c.text import indent, packed

MARKED = 6
"""The binary logarithm of the numbers that one mark stands for."""


class Target(NamedTuple):
    """What iterations add to: the name of the array in C, and that of the number of its entries."""

    name: str
    size: str

    @property
    def copy(self) -> str:
        """Returns the name of a chunk's copy."""
        return f"{self.name}_"

    def added(self, place: str, value: str, copied: bool) -> str:
        """Returns a line that adds to a place, of a chunk's copy if it is `copied`."""
        return f"{self.copy if copied else self.name}[{place}] += {value};"

    def marked(self, place: str, columns: int = 1) -> list[str]:
        """Returns lines that mark so many places from one on in a chunk's copy."""
        offsets = dict.fromkeys([*range(0, columns, 1 << MARKED), columns - 1])
        return [f"{self.copy}marks[({place}{f' + {k}' if k else ''}) >> {MARKED}] = 1;" for k in offsets]


class Chunked(NamedTuple):
    """The text of a loop: its bounds, operations of an iteration, results, what a chunk declares, and its iterations."""

    lo: str
    hi: str
    work: int
    results: Sequence[str]
    targets: Sequence[Target]
    workspace: Sequence[str]
    inside: Sequence[str]
    on_heap: bool

    def lines(self) -> list[str]:
        """Returns the loop, and the sums of its results."""
        results, count = self.results, len(self.results)
        sums = packed([f"{r} = 0.0" for r in results], "double ", ", ", ";") if results else []
        return [
            *sums,
            "{",
            *indent(
                f"const int64_t lo = {self.lo}, hi = {self.hi}, size = {' + '.join([t.size for t in self.targets] or ['0'])};",
                f"const long chunks = teg_chunks(hi - lo, {self.work}, size);",
                f"double only[{count + 1}];",
                f"double *const partial = chunks > 1 ? calloc((size_t)chunks * {count + 1}, sizeof *partial) : only;",
                *self._copies(),
                f"int failed = !partial{' || teg_open(&copies)' if self.targets else ''}, working = 0;",
                "(void)size, (void)working;",
                "if (!failed) {",
                *indent(*self._team()),
                *indent(
                    "for (long c = 0; c < chunks; c++) {",
                    *indent(
                        *[f"{r} += partial[c * {count + 1} + {k}];" for k, r in enumerate(results)],
                        f"note |= (long)partial[c * {count + 1} + {count}];",
                    ),
                    "}",
                ),
                "}",
                "if (partial != only) free(partial);",
                *(["teg_close(&copies);"] if self.targets else []),
                "if (failed) return -1;",
            ),
            "}",
        ]

    def _copies(self) -> list[str]:
        """Returns the declaration of the copies."""
        if not self.targets:
            return []
        return [
            f"double *const originals[] = {{{', '.join(t.name for t in self.targets)}}};",
            f"const int64_t sizes[] = {{{', '.join(t.size for t in self.targets)}}};",
            f"teg_copies copies = {{{len(self.targets)}, chunks, originals, sizes, 0, 0, 0, 0, NULL, NULL, NULL}};",
        ]

    def _team(self) -> list[str]:
        """Returns the chunks, which threads share."""
        opening = ["teg_pace own = {pace->watch, 0, 16}, *const outer = pace, *pace = &own;", "(void)outer;"]
        loop = ["for (long c = 0; c < chunks; c++) {", *indent(*self._chunk()), "}"]
        return shared(opening, loop, nested=True, worth="team > 1 && chunks > 1")

    def _chunk(self) -> list[str]:
        """Returns one chunk."""
        count = len(self.results)
        failing = ["failed = 1;", "continue;"]
        taken: list[str] = []
        finished: list[str] = []
        if self.targets:
            critical = ["#ifdef _OPENMP", "#pragma omp critical(teg_copies)", "#endif"]
            taken = ["double *copy;", *critical, "copy = teg_take(&copies);", "if (!copy) {", *indent(*failing), "}"]
            finished = [*critical, "teg_finish(&copies, c, copy);"]
            offset, marked = "0", "0"
            taken.append("unsigned char *const marks = (unsigned char *)(copy + copies.numbers);")
            for t in self.targets:
                taken.append(f"double *const {t.copy} = chunks > 1 ? copy + {offset} : {t.name};")
                taken.append(f"unsigned char *const {t.copy}marks = marks + {marked};")
                offset += f" + {t.size}"
                marked += f" + ({t.size} >> {MARKED}) + 1"
        return [
            "const int64_t first = lo + (hi - lo) / chunks * c + (c < (hi - lo) % chunks ? c : (hi - lo) % chunks);",
            "const int64_t last = first + (hi - lo) / chunks + (c < (hi - lo) % chunks);",
            *self.workspace,
            *(["if (!w) {", *indent(*failing), "}"] if self.on_heap else []),
            *taken,
            "teg_context ctx = {+1, 0, 0, 0, 0, 0, pace};",
            "long note = 0;",
            *(packed([f"{r} = 0.0" for r in self.results], "double ", ", ", ";") if self.results else []),
            *self.inside,
            *[f"partial[c * {count + 1} + {k}] = {r};" for k, r in enumerate(self.results)],
            f"partial[c * {count + 1} + {count}] = (double)(note | 2 * (ctx.missed != 0) | 4 * ctx.crowded);",
            *finished,
            *(["free(w);"] if self.on_heap else []),
        ]
