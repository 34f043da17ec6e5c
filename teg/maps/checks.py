"""Checks of the maps of a program in every call: each map is one-to-one, and covers the integrals it is used for.

Each cell of a program is a scalar program of its symbols. A program without sums is one cell, whose parameters are given. In other cells
the values of symbols are looked up in the arrays, in a sample of the iterations. Nests whose bounds or integrands hold a sum are not
checked. Cost: some 64 iterations a cell and call.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from teg.analysis.nest import Binder, Chain
from teg.ir.arrays import Gather, Ranged, has_arrays
from teg.ir.cells import Symbols, cells_of
from teg.ir.expr import ZERO, Expr, Param, Var
from teg.ir.index import OPERATIONS, ArrayName, Index, IndexCall, IndexConst, IndexGather, IndexParam, IndexValue, Length, index_leaves
from teg.ir.integral import Integral
from teg.ir.node import Node
from teg.ir.traverse import parameters
from teg.maps.coverage import ROUNDS, SAMPLES_LATER, SAMPLES_ONCE, verify_covered
from teg.maps.diffeomorphism import Diffeomorphism
from teg.maps.verification import BATCH_SAMPLES, SAMPLES_A_CALL

if TYPE_CHECKING:
    import numpy as np

    Entries = np.ndarray

ITERATIONS = 64
"""The number of iterations of a cell that are checked, over the elements of a batch."""
ELEMENTS = 8
"""The number of elements of a batch among which these iterations are spread."""


class MapChecks:
    """The maps of a program, and the cells they apply to."""

    def __init__(self, e: Expr, maps: Sequence[Diffeomorphism]) -> None:
        self.cells: list[tuple[tuple[Ranged, ...], Symbols, _CellChecks]] = []
        always: list[Diffeomorphism] = []  # maps that are verified in every call, whatever its iterations
        for path, body in (cells_of(e) if has_arrays(e) else [((), e)]) if maps else ():
            symbols = Symbols()
            (cell,) = symbols.into([body])
            checks = _CellChecks(cell, maps)
            unknown = {symbol for leaf, symbol in symbols.of.items() if isinstance(leaf, Ranged)}
            checks.cases = [case for case in checks.cases if case.nests and not unknown.intersection(case.every)]
            if checks.cases:
                self.cells.append((path, symbols, checks))
                always += [] if path else [case.map for case in checks.cases]
        if alone := [m for m in maps if m not in always]:
            self.cells.append(((), Symbols(), _CellChecks(ZERO, alone)))

    def run(self, columns: Mapping[str, Entries], arrays: Mapping[ArrayName, Entries], n: int) -> None:
        """Checks the maps for the values of a call. Raises DiffeomorphismError.

        Columns are (n,) or (), arrays have an axis n in front of their own if the batch does not share them.
        """
        import numpy as np

        elements = np.unique(np.linspace(0, n - 1, min(n, ELEMENTS)).astype(int)) if n else ()
        sampled = [_Element(columns, arrays, int(i)) for i in elements]
        for path, symbols, checks in self.cells:
            if not path and not symbols.of:
                checks.run(columns)
                continue
            wanted = list(dict.fromkeys(p for case in checks.cases for p in case.every))
            rows = [
                [at.value(symbols.meaning.get(p, p), around) for p in wanted]
                for at in sampled
                for around in at.iterations(path, len(sampled))
            ]
            if rows:
                table = np.array(rows, dtype=np.float64).reshape(len(rows), len(wanted))
                checks.run({p.name: table[:, k] for k, p in enumerate(wanted)})


class _Case(NamedTuple):
    """A map with the nests that it, or its inverse, applies to; its parameters and those of the bounds; and these with the integrand's."""

    map: Diffeomorphism
    nests: list[tuple[Diffeomorphism, Chain, Expr]]
    deciding: list[Param]
    every: list[Param]


class _CellChecks:
    """Maps in one cell. The last verified values are not verified again."""

    def __init__(self, e: Expr, maps: Sequence[Diffeomorphism]) -> None:
        self.cases: list[_Case] = []
        for m in maps:
            nests = [(way, *found) for way in (m, m.inverse_map()) for found in nests_over(e, way.old)]
            ends = parameters(*(end for _, chain, _ in nests for b in chain for end in (b.lo, b.hi)))
            deciding = list(dict.fromkeys([*m.parameters, *ends]))
            every = list(dict.fromkeys([*deciding, *parameters(*(body for _, _, body in nests))]))
            self.cases.append(_Case(m, nests, deciding, every))
        self.verified: dict[int, object] = {}
        self.looked_at: set[int] = set()  # maps that had their first, closer check

    def run(self, values: Mapping[str, Any]) -> None:
        """Checks the maps at parameter values: arrays of shape () or (n,). Raises DiffeomorphismError."""
        import numpy as np

        for i, case in enumerate(self.cases):
            n = max((len(values[p.name]) for p in case.every if values[p.name].ndim), default=1)
            chosen = np.unique(np.linspace(0, n - 1, min(n, BATCH_SAMPLES)).astype(int)) if n else np.zeros(0, dtype=int)
            columns = {p: np.broadcast_to(values[p.name], (n,))[chosen] for p in case.every}
            key = tuple(columns[p].tobytes() for p in case.deciding)
            if self.verified.get(i) == key:
                continue
            numbers = np.ones(len(chosen), dtype=bool)  # NaN in gives NaN out, and no error
            for column in columns.values():
                numbers &= np.isfinite(column)
            if not numbers.any():
                continue
            at = {p: column[numbers] for p, column in columns.items()}
            case.map.verify({p: at[p] for p in case.map.parameters}, SAMPLES_A_CALL)
            samples, rounds = (SAMPLES_LATER, 0) if i in self.looked_at else (SAMPLES_ONCE, ROUNDS)
            reached = [verify_covered(chain, way, at, samples, body, rounds) for way, chain, body in case.nests]
            self.looked_at.add(i)
            if all(reached) and numbers.all():
                self.verified[i] = key


def nests_over(e: Expr, variables: Sequence[Var]) -> list[tuple[Chain, Expr]]:
    """Returns the nests of integrals that bind all these variables, from the outermost of the program inwards, and their integrands."""
    wanted = set(variables)
    nests: dict[tuple[Chain, Expr], None] = {}
    seen: set[tuple[Node, frozenset[Var]]] = set()
    stack: list[tuple[Node, Chain]] = [(e, ())]
    while stack:
        node, chain = stack.pop()
        key = (node, frozenset(b.var for b in chain) & wanted)
        if not node.has_integral or key in seen:
            continue
        seen.add(key)
        if isinstance(node, Integral):
            stack += [(node.lo, chain), (node.hi, chain)]
            inner = (*chain, Binder(node.var, node.lo, node.hi))
            if wanted <= {b.var for b in inner}:
                nests[inner, node.body] = None
            else:
                stack.append((node.body, inner))
        else:
            stack.extend((c, chain) for c in node.children)
    return list(nests)


class _Element:
    """The values of one element of a batch."""

    def __init__(self, columns: Mapping[str, Entries], arrays: Mapping[ArrayName, Entries], i: int) -> None:
        self.numbers = {name: float(c if c.ndim == 0 else c[i]) for name, c in columns.items()}
        self.arrays = {a: v if v.ndim == a.dimensions else v[i] for a, v in arrays.items()}

    def iterations(self, path: Sequence[Ranged], elements: int) -> Iterator[dict[Node, int]]:
        """Yields the indices of iterations, spread over the ranges, first and last ones among them."""
        import numpy as np

        each = max(2, round((ITERATIONS / elements) ** (1 / max(len(path), 1))))
        reached: list[dict[Node, int]] = [{}]
        for s in path:
            wider: list[dict[Node, int]] = []
            for around in reached:
                lo, hi = self.integer(s.lo, around), self.integer(s.hi, around)
                picked = np.unique(np.linspace(lo, hi - 1, min(each, hi - lo)).astype(int)) if hi > lo else ()
                wider += [{**around, s.index: int(k)} for k in picked]
            reached = wider
        yield from reached

    def integer(self, root: Index, around: Mapping[Node, int]) -> int:
        """Returns the value of an integer expression in an iteration."""
        known: dict[Node, int] = dict(around)
        for node in index_leaves([root]):
            args = [known[c] for c in node.children]
            match node:
                case IndexConst():
                    known[node] = int(node.data)
                case IndexParam():
                    known[node] = int(self.numbers[node.param.name])
                case Length():
                    known[node] = self.arrays[node.array].shape[node.axis]
                case IndexGather():
                    known[node] = int(self.arrays[node.array][tuple(args)])
                case IndexCall():
                    known[node] = OPERATIONS[node.data](args[0], args[1])
                case _:
                    assert node in known, f"the index {node} has no sum"
        return known[root]

    def value(self, leaf: Node, around: Mapping[Node, int]) -> float:
        """Returns the value of a parameter, an entry, or an integer in an iteration."""
        match leaf:
            case Param():
                return self.numbers[leaf.name]
            case Gather():
                return float(self.arrays[leaf.array][tuple(self.integer(i, around) for i in leaf.subscripts)])
            case IndexValue():
                return float(self.integer(leaf.index, around))
            case _:
                raise AssertionError(f"{type(leaf).__name__} has no value here")
