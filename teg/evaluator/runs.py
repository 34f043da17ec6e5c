"""Kernels of sums over lists whose neighbours are alike: which lists have runs of equal entries is looked up in each call.

    results     →   the entries that change seldom   →   the starts of their runs   →   a kernel of the program by runs

In C, runs are cut into rows where one of the other entries goes up by one and the rest is constant (pixels by rows and columns): which
iterations of a row are covered is known from its ends.

A program by runs (`teg.passes.normalise.runs`) is derived and compiled when a call first has such lists. Without runs, and in batches whose
elements have lists of their own, the program as it is runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from teg.analysis.settings import Integration
from teg.errors import TegError
from teg.evaluator.kept import Kept
from teg.evaluator.plan import Plan
from teg.evaluator.wanted import Wanted
from teg.ir.expr import Param
from teg.ir.index import APART, ArrayName, Index, IndexArray, IndexConst, IndexParam, Length
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.differentiate.through_sums import outlined
from teg.passes.normalise.runs import Entry, Listed, Rows, Runs, by_runs, listed_sums
from teg.passes.normalise.sums import NeedsLengths
from teg.program.arrays import ArrayProgram

if TYPE_CHECKING:
    import numpy as np

LONG = 8
"""The mean length of runs, from which on they are worth a loop of their own."""
SAMPLES = 2048
"""Pairs of neighbours by which the entries with runs are chosen."""
SHORT = 4
"""The mean length of rows, from which on they are worth a loop of their own."""
PIECE = 4096
"""The length of a run, at most: threads share runs."""
KEPT = 8
"""Choices of entries whose programs are kept."""


class Choice(NamedTuple):
    """The entries of a list that are constant on its runs; and, if these are cut into rows, the entry that goes up by one in a row."""

    entries: tuple[Entry, ...]
    counting: Entry | None = None


Chosen = tuple[Choice | None, ...]
"""For each list, its choice; None if it has no runs."""


class ListedPlan:
    """The programs by runs of one plan."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        options = plan.options
        plain = isinstance(options.estimator, Exact) and not options.maps and plan.has_loops and options.backend in ("c", "numpy")
        self.lists: list[Listed] = listed_sums(plan.expression) if plain else []
        self.with_rows = options.backend == "c"
        self._plans: Kept[Chosen, tuple[Plan | None]] = Kept(KEPT)

    def program(self, chosen: Chosen, wanted: Wanted, how: Integration) -> ArrayProgram | None:
        """Returns the program by runs of the chosen entries; None if there is none."""
        (inner,) = self._plans.get(chosen, lambda: (self._with_runs(chosen),))
        try:
            found = inner.program(wanted, how=how) if inner is not None else None
        except (TegError, NeedsLengths):  # the program as it is reports it
            return None
        return found if isinstance(found, ArrayProgram) else None

    def _with_runs(self, chosen: Chosen) -> Plan | None:
        plan = self.plan
        names = {p.name for p in (*plan.leaves, *plan.integers)}
        runs: dict[tuple[Index, Index], Runs] = {}
        arrays: list[IndexArray] = []
        for m, (listed, choice) in enumerate(zip(self.lists, chosen, strict=True)):
            if choice is None:
                continue
            arrays.append(starts := IndexArray.make((_free(f"runs{APART}{m}", names), 1), ()))
            rows = None
            if choice.counting is not None:
                arrays.append(table := IndexArray.make((_free(f"rows{APART}{m}", names), 2), ()))
                rows = Rows(table, _constant(listed, choice), choice.counting)
            runs[listed.lo, listed.hi] = Runs(choice.entries, starts, rows)
        try:
            return Plan(outlined(by_runs(plan.expression, runs)), plan.options, plan.wrt, (*plan.leaves, *arrays), plan.integers)
        except (TegError, NeedsLengths):
            return None


class RunsKernel:
    """A kernel of a program with lists. `program` is the program as it is, `build` compiles a program."""

    def __init__(self, lists: ListedPlan, wanted: Wanted, how: Integration, build: Callable[[ArrayProgram], Any]) -> None:
        self.lists, self.wanted, self.how, self.build = lists, wanted, how, build
        self.program = cast(ArrayProgram, lists.plan.program(wanted, how=how))
        self._kernels: Kept[Chosen, Any] = Kept(KEPT)
        arguments = lists.plan.derivation.arguments(wanted)
        self._column = {p: k for k, p in enumerate(a for a in arguments if isinstance(a, Param))}
        self._array = {p: k for k, p in enumerate(a for a in arguments if isinstance(a, ArrayName))}
        self._behind = sum(isinstance(p, ArrayName) for p in lists.plan.leaves)  # where the arrays of starts stand

    @property
    def source(self) -> str:
        """Returns the text of the kernel that was compiled first; by default that of the program as it is."""
        kernel = self._kernels.first() or self._kernel(())
        return str(kernel.source)

    def _kernel(self, chosen: Chosen) -> Any:
        by_runs = chosen if any(chosen) else ()

        def made() -> Any:
            program = self.lists.program(by_runs, self.wanted, self.how) if by_runs else self.program
            return self.build(program or self.program)

        return self._kernels.get(by_runs, made)

    def results(self, columns: Sequence[np.ndarray], arrays: Sequence[np.ndarray], n: int) -> Any:
        """Returns the outputs of a batch of n, as the kernel of the program does."""
        found = [self._starts(listed, columns, arrays) for listed in self.lists.lists]
        kernel = self._kernel(tuple(choice for choice, _ in found))
        starts = [array for _, of in found for array in of]
        if len(kernel.program.arrays) == len(arrays):
            starts = []  # there is no program by runs
        return kernel.results(columns, [*arrays[: self._behind], *starts, *arrays[self._behind :]], n)

    def _starts(
        self, listed: Listed, columns: Sequence[np.ndarray], arrays: Sequence[np.ndarray]
    ) -> tuple[Choice | None, list[np.ndarray]]:
        """Returns which entries of a list are constant on long runs, None if there are no long runs; and the arrays of the program by runs:
        the starts of runs, and the end of the last one, and the table of rows if there are rows."""
        import numpy as np

        lo, hi = (self._end(end, columns, arrays) for end in (listed.lo, listed.hi))
        if lo is None or hi is None or hi - lo < 2 * LONG:
            return None, []
        lists: dict[Entry, np.ndarray] = {}
        for entry in dict.fromkeys((*listed.entries, *(listed.every if self.lists.with_rows else ()))):
            place = self._array.get(entry.array)
            if place is not None and (array := arrays[place]).ndim == entry.array.dimensions:
                lists[entry] = array[tuple(slice(lo, hi) if p is None else p for p in entry.places)]
        choice = _chosen(listed, lists)
        if choice is None:
            return None, []
        if choice.counting is not None:
            from teg.backends.c.listed_rows import listed_rows

            kept = [lists[entry] for entry in (*_constant(listed, choice), choice.counting)]
            rows = listed_rows(kept, len(choice.entries), PIECE)
            if rows is not None:
                return choice, rows
            choice = Choice(choice.entries)
        borders = lists[choice.entries[0]][1:] != lists[choice.entries[0]][:-1]
        for entry in choice.entries[1:]:
            borders |= lists[entry][1:] != lists[entry][:-1]
        borders[PIECE - 1 :: PIECE] = True
        return choice, [np.concatenate([[lo], np.flatnonzero(borders) + (lo + 1), [hi]])]

    def _end(self, end: Index, columns: Sequence[np.ndarray], arrays: Sequence[np.ndarray]) -> int | None:
        """Returns an end of a range; None if it differs between elements of the batch."""
        match end:
            case IndexConst():
                return int(end.data)
            case Length():
                array = arrays[self._array[end.array]]
                return int(array.shape[array.ndim - end.array.dimensions + end.axis])
            case IndexParam():
                column = columns[self._column[end.param]]
                return int(column) if column.ndim == 0 else None
            case _:
                raise AssertionError(f"the end {end} of a list")


def _constant(listed: Listed, choice: Choice) -> tuple[Entry, ...]:
    """Returns the entries that are constant in each row of a list."""
    return tuple(e for e in dict.fromkeys((*choice.entries, *listed.every)) if e != choice.counting)


def _chosen(listed: Listed, lists: Mapping[Entry, np.ndarray]) -> Choice | None:
    """Returns which entries are constant on long runs, and which one goes up by one in rows, by a sample of neighbours."""
    import numpy as np

    size = min((len(values) for values in lists.values()), default=0)
    at = np.linspace(0, size - 2, min(SAMPLES, size - 1)).astype(np.int64) if size > 1 else np.empty(0, dtype=np.int64)
    sampled = {entry: values[at] != values[at + 1] for entry, values in lists.items()}
    changes: np.ndarray = np.zeros(len(at), dtype=bool)
    chosen: list[Entry] = []
    for entry in sorted((e for e in listed.entries if e in sampled), key=lambda e: int(sampled[e].sum())):
        if LONG * int((changes | sampled[entry]).sum()) <= len(at):
            changes = changes | sampled[entry]
            chosen.append(entry)
    if not chosen:
        return None
    entries = tuple(e for e in listed.entries if e in chosen)
    others = [e for e in listed.every if e not in chosen]
    if others and all(e in lists for e in listed.every):
        counts = {e: lists[e][at + 1] - lists[e][at] == 1 for e in others}
        counting = max(others, key=lambda e: int(counts[e].sum()))
        for e in others:
            changes = changes | (~counts[e] if e == counting else sampled[e])
        if SHORT * int(changes.sum()) <= len(at):
            return Choice(entries, counting)
    return Choice(entries)


def _free(name: str, names: set[str]) -> str:
    """Returns a name that is not taken."""
    while name in names:
        name += "′"
    return name
