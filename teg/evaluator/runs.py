"""Kernels of sums over lists whose neighbours are alike: which lists have runs of equal entries is looked up in each call.

    results     →   the entries that change seldom   →   the starts of their runs   →   a kernel of the program by runs

A program by runs (`teg.passes.normalise.runs`) is derived and compiled when a call first has such lists. Without runs, and in batches whose
elements have lists of their own, the program as it is runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

from teg.analysis.settings import Integration
from teg.errors import TegError
from teg.evaluator.plan import Kept, Plan, Wanted
from teg.ir.cells import APART
from teg.ir.expr import Param
from teg.ir.index import ArrayName, Index, IndexArray, IndexConst, IndexParam, Length
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.differentiate.through_sums import outlined
from teg.passes.normalise.runs import Entry, Listed, Runs, by_runs, listed_sums
from teg.passes.normalise.sums import NeedsLengths
from teg.program.arrays import ArrayProgram

if TYPE_CHECKING:
    import numpy as np

LONG = 8
"""The mean length of runs, from which on they are worth a loop of their own."""
SAMPLES = 2048
"""Pairs of neighbours by which the entries with runs are chosen."""
PIECE = 4096
"""The length of a run, at most: threads share runs."""
KEPT = 8
"""Choices of entries whose programs are kept."""
Chosen = tuple[tuple[Entry, ...], ...]
"""For each list, the entries that are constant on its runs; none if it has no runs."""


class ListedPlan:
    """The programs by runs of one plan."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        options = plan.options
        plain = isinstance(options.estimator, Exact) and not options.maps and plan.has_loops and options.backend in ("c", "numpy")
        self.lists: list[Listed] = listed_sums(plan.expression) if plain else []
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
        starts = [IndexArray.make((_free(f"runs{APART}{m}", names), 1), ()) for m, entries in enumerate(chosen) if entries]
        kept = [(listed, entries) for listed, entries in zip(self.lists, chosen, strict=True) if entries]
        runs = {(listed.lo, listed.hi): Runs(entries, at) for (listed, entries), at in zip(kept, starts, strict=True)}
        try:
            return Plan(outlined(by_runs(plan.expression, runs)), plan.options, plan.wrt, (*plan.leaves, *starts), plan.integers)
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
        kernel = self._kernel(tuple(entries for entries, _ in found))
        starts = [at for entries, at in found if entries]
        if len(kernel.program.arrays) == len(arrays):
            starts = []  # there is no program by runs
        return kernel.results(columns, [*arrays[: self._behind], *starts, *arrays[self._behind :]], n)

    def _starts(self, listed: Listed, columns: Sequence[np.ndarray], arrays: Sequence[np.ndarray]) -> tuple[tuple[Entry, ...], np.ndarray]:
        """Returns the entries of a list that are constant on long runs, none if there are no long runs; and the starts of runs, and the
        end of the last one."""
        import numpy as np

        none: tuple[tuple[Entry, ...], np.ndarray] = (), np.empty(0, dtype=np.int64)
        lo, hi = (self._end(end, columns, arrays) for end in (listed.lo, listed.hi))
        if lo is None or hi is None or hi - lo < 2 * LONG:
            return none
        lists: dict[Entry, np.ndarray] = {}
        for entry in listed.entries:
            array = arrays[self._array[entry.array]]
            if array.ndim == entry.array.dimensions:
                lists[entry] = array[tuple(slice(lo, hi) if place is None else place for place in entry.places)]
        at = np.linspace(0, hi - lo - 2, min(SAMPLES, hi - lo - 1)).astype(np.int64)
        sampled = {entry: values[at] != values[at + 1] for entry, values in lists.items()}
        changes: np.ndarray = np.zeros(len(at), dtype=bool)
        chosen: list[Entry] = []
        for entry in sorted(sampled, key=lambda e: int(sampled[e].sum())):
            if LONG * int((changes | sampled[entry]).sum()) <= len(at):
                changes = changes | sampled[entry]
                chosen.append(entry)
        if not chosen:
            return none
        borders = lists[chosen[0]][1:] != lists[chosen[0]][:-1]
        for entry in chosen[1:]:
            borders |= lists[entry][1:] != lists[entry][:-1]
        borders[PIECE - 1 :: PIECE] = True
        return tuple(e for e in listed.entries if e in chosen), np.concatenate([[lo], np.flatnonzero(borders) + (lo + 1), [hi]])

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


def _free(name: str, names: set[str]) -> str:
    """Returns a name that is not taken."""
    while name in names:
        name += "′"
    return name
