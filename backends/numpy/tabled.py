"""Programs with tables: any kernel of a program with arrays as one of a program without."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from teg.program import Outcome
from teg.program.tabled import Table, TabledProgram

Column = npt.NDArray[Any]


class TabledKernel:
    """A kernel of a program with tables, run by one of the program with arrays in it."""

    def __init__(self, tabled: TabledProgram, kernel: Any) -> None:
        self.tabled, self.kernel = tabled, kernel
        self.program = tabled.program
        self._sent: dict[int, tuple[list[int], list[int]]] = {}  # by output: entries, and where they go
        for s in tabled.sent:
            entries, targets = self._sent.setdefault(s.number, ([], []))
            entries.append(s.entry or 0)
            targets.append(s.to)

    def __reduce__(self) -> tuple[object, ...]:
        return (TabledKernel, (self.tabled, self.kernel))

    @property
    def source(self) -> str:
        """Returns the text of the loops."""
        return cast(str, self.kernel.source)

    def outcome(self, columns: Sequence[Column], n: int) -> Outcome:
        """Returns the outputs on a batch of n, shape (outputs, n). A column is float64, (n,) or ()."""
        columns = [np.asarray(c, dtype=np.float64) for c in columns]
        found = self.kernel.results([columns[i] for i in self.tabled.given], [_filled(t, columns, n) for t in self.tabled.tables], n)
        out = np.zeros((self.tabled.outputs, n))
        for number, (entries, targets) in self._sent.items():
            np.add.at(out, targets, found.values[number].reshape(n, -1).T[entries])
        return Outcome(out, found.missed, found.evaluations, found.crowded, found.tied)


def _filled(table: Table, columns: Sequence[Column], n: int) -> Column:
    """Returns a table, of its own shape if the batch shares all of its entries, else with an axis n in front."""
    shape = table.rows, table.columns
    if all(columns[e].ndim == 0 for e in table.entries if isinstance(e, int)):
        return np.array([columns[e] if isinstance(e, int) else e for e in table.entries], dtype=np.float64).reshape(shape)
    filled = np.empty((n, len(table.entries)))
    for j, e in enumerate(table.entries):
        filled[:, j] = columns[e] if isinstance(e, int) else e
    return filled.reshape(n, *shape)
