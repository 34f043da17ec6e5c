"""Maps in a program with arrays, verified for what every call gives, in a sample of its iterations.

Each cell is a scalar program (`coverage.MapChecks`) of its symbols; their values are looked up in the arrays. Nests whose bounds or
integrands hold a sum are passed over. Cost: some 64 iterations a cell and call.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.ir.arrays import Gather, Sum
from teg.ir.cells import Symbols, cells_of
from teg.ir.expr import ZERO, Expr, Param
from teg.ir.index import OPERATIONS, Index, IndexCall, IndexConst, IndexGather, IndexParam, IndexValue, Length, index_leaves
from teg.ir.node import Node
from teg.maps.coverage import MapChecks
from teg.maps.diffeomorphism import Diffeomorphism

ITERATIONS = 64
"""Iterations of a cell that are looked at, over the elements of a batch,"""
ELEMENTS = 8
"""of which there are so many."""
Entries = npt.NDArray[Any]


class ArrayMapChecks:
    """The maps of a program, and the cells they are for."""

    def __init__(self, e: Expr, maps: Sequence[Diffeomorphism]) -> None:
        self.cells: list[tuple[tuple[Sum, ...], Symbols, MapChecks]] = []
        if not maps:
            return
        for path, body in cells_of(e):
            symbols = Symbols()
            (cell,) = symbols.into([body])
            checks = MapChecks(cell, maps)
            unknown = {symbol for leaf, symbol in symbols.of.items() if isinstance(leaf, Sum)}
            checks.cases = [case for case in checks.cases if case.nests and not unknown.intersection(case.every)]
            if checks.cases:
                self.cells.append((path, symbols, checks))
        self.cells.append(((), Symbols(), MapChecks(ZERO, maps)))  # the maps themselves

    def run(self, columns: Mapping[str, Entries], arrays: Mapping[str, Entries], dimensions: Mapping[str, int], n: int) -> None:
        """Raise DiffeomorphismError if a map is none, or does not reach a nest. Columns are (n,) or (), arrays have an axis n in front of
        their own where the batch does not share them."""
        if not n:
            return
        elements = np.unique(np.linspace(0, n - 1, min(n, ELEMENTS)).astype(int))
        given = [_Element(columns, arrays, dimensions, int(i)) for i in elements]
        for path, symbols, checks in self.cells:
            wanted = list(dict.fromkeys(p for case in checks.cases for p in case.every))
            rows = [
                [at.value(symbols.meaning.get(p, p), around) for p in wanted] for at in given for around in at.iterations(path, len(given))
            ]
            if rows:
                found = np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted))
                checks.run({p.name: found[:, k] for k, p in enumerate(wanted)})


class _Element:
    """What one element of a batch is given."""

    def __init__(self, columns: Mapping[str, Entries], arrays: Mapping[str, Entries], dimensions: Mapping[str, int], i: int) -> None:
        self.numbers = {name: float(c if c.ndim == 0 else c[i]) for name, c in columns.items()}
        self.arrays = {name: a if a.ndim == dimensions[name] else a[i] for name, a in arrays.items()}

    def iterations(self, path: Sequence[Sum], elements: int) -> Iterator[dict[Node, int]]:
        """The indices of iterations, spread over the ranges, first and last ones among them."""
        each = max(2, round((ITERATIONS / elements) ** (1 / max(len(path), 1))))
        found: list[dict[Node, int]] = [{}]
        for s in path:
            wider: list[dict[Node, int]] = []
            for around in found:
                lo, hi = self.integer(s.lo, around), self.integer(s.hi, around)
                picked = np.unique(np.linspace(lo, hi - 1, min(each, hi - lo)).astype(int)) if hi > lo else ()
                wider += [{**around, s.index: int(k)} for k in picked]
            found = wider
        yield from found

    def integer(self, root: Index, around: Mapping[Node, int]) -> int:
        """An integer expression in an iteration."""
        known: dict[Node, int] = dict(around)
        for node in index_leaves([root]):
            args = [known[c] for c in node.children]
            match node:
                case IndexConst():
                    known[node] = int(node.data)
                case IndexParam():
                    known[node] = int(self.numbers[node.param.name])
                case Length():
                    known[node] = self.arrays[node.array.name].shape[node.axis]
                case IndexGather():
                    known[node] = int(self.arrays[node.array.name][tuple(args)])
                case IndexCall():
                    known[node] = OPERATIONS[node.data](args[0], args[1])
                case _:
                    assert node in known, f"the index {node} has no sum"
        return known[root]

    def value(self, leaf: Node, around: Mapping[Node, int]) -> float:
        """A parameter, an entry, or an integer as a number, in an iteration."""
        match leaf:
            case Param():
                return self.numbers[leaf.name]
            case Gather():
                return float(self.arrays[leaf.array.name][tuple(self.integer(i, around) for i in leaf.subscripts)])
            case IndexValue():
                return float(self.integer(leaf.index, around))
            case _:
                raise AssertionError(f"{type(leaf).__name__} has no value here")
