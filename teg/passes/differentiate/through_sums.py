"""Passes for programs with arrays and sums: those of `teg.pipeline`, on every cell.

    value        self-comparisons → sums out of integrals → indices renamed → each cell's normal form
    derivative   … → each cell by its symbols (`pipeline.compiled_outputs`), then the chain rule through the sums

    d/dV of  f(Σ_k g(V[F[k]]))   =   f′(s) · Σ_k g′(V[F[k]]) · 1[V; F[k]],    s = Σ_k g(V[F[k]])

The derivative of a cell by its symbols is taken once, whatever they stand for. The derivative by a symbol of an entry is scattered into
the array; the symbol of a sum is differentiated in its turn. Cost: one gradient a sum, like that of a scalar program of the same size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import cast

from teg.errors import ParameterError
from teg.ir import expr as ex
from teg.ir.arrays import Array, Gather, Sum, Unit, has_arrays, open_indices, sum_over
from teg.ir.cells import Symbols, cellwise, rename_indices
from teg.ir.expr import ZERO, Expr, Param, add, mul
from teg.ir.index import ArrayName, IndexVar
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.passes.normalise.self_comparison import without_self_comparisons
from teg.passes.normalise.sums import sums_outside

Derive = Callable[[Expr, Sequence[Param]], Sequence[Expr]]
"""The derivatives of a scalar expression by parameters."""
Along = Callable[[Expr, Mapping[Param, Expr]], Expr]
"""The derivative of a scalar expression along changes of its parameters."""
Parameter = Param | Array


def outlined(e: Expr) -> Expr:
    """Returns the program with its sums outside of integrals, and canonical indices. Raises NeedsLengths."""
    if not has_arrays(e):
        return e
    return rename_indices(sums_outside(without_self_comparisons(e)))


def on_cells(e: Expr, step: Callable[[Expr], Expr]) -> Expr:
    """Returns a scalar pass applied to a scalar program, or to each cell of a program with sums."""
    return cellwise(e, step) if has_arrays(e) else step(e)


def gradient(e: Expr, wrt: Sequence[Parameter], derive: Derive) -> list[Expr]:
    """Returns the derivatives of an outlined expression by parameters and arrays. The derivative by an array holds `Unit`s."""
    derivatives = _Gradient(e, frozenset(wrt), derive).of(e, None)
    return [derivatives.get(p, ZERO) for p in wrt]


class _Gradient:
    """One gradient. The order of the nodes, and the parameters and indices that each depends on, are determined once."""

    def __init__(self, root: Expr, wrt: frozenset[Parameter], derive: Derive) -> None:
        self.derive = derive
        self.wrt = wrt
        self.order = {node: i for i, node in enumerate(postorder([root]))}
        self.open = open_indices(root)
        self.active: set[Node] = set()
        for node in self.order:
            mine = node in wrt or (isinstance(node, Gather) and node.array in wrt)
            if mine or any(c in self.active for c in node.children):
                self.active.add(node)
        self.done: dict[tuple[Expr, IndexVar | None], dict[Node, Expr]] = {}

    def of(self, e: Expr, bound: IndexVar | None) -> dict[Node, Expr]:
        """Returns the derivatives of the body of a sum over `bound` by each parameter and array.

        Entries and sums that do not depend on `bound` get derivatives of their own, because they belong to the cell around. The
        recursion is as deep as sums are nested.
        """
        if (e, bound) in self.done:
            return self.done[e, bound]
        parts = self._of_cell(e)
        result: dict[Node, Expr] = {}
        waiting = [(-self.order[leaf], leaf) for leaf in parts if isinstance(leaf, Sum)]
        heapify(waiting)  # a sum comes before the sums in its body: its weight is then complete
        while waiting:
            _, node = heappop(waiting)
            weight = add(*parts.pop(node))
            if bound is not None and bound not in self.open[node]:
                result[node] = weight
                continue
            for leaf, slope in self.of(node.body, node.index).items():
                if isinstance(leaf, Sum) and leaf not in parts:
                    heappush(waiting, (-self.order[leaf], leaf))
                parts.setdefault(leaf, []).append(mul(weight, sum_over(slope, node.index, node.lo, node.hi)))
        at_arrays: dict[Node, list[Expr]] = {}
        for leaf, terms in parts.items():
            if isinstance(leaf, Gather) and (bound is None or bound in self.open[leaf]):
                at_arrays.setdefault(leaf.array, []).append(mul(add(*terms), Unit.make((leaf.array, leaf.subscripts), ())))
            else:
                at_arrays.setdefault(leaf, []).extend(terms)
        result.update((leaf, add(*terms)) for leaf, terms in at_arrays.items())
        self.done[e, bound] = result
        return result

    def _of_cell(self, e: Expr) -> dict[Node, list[Expr]]:
        """Returns the derivatives of a cell by its leaves."""
        symbols = Symbols()
        (cell,) = symbols.into([e])
        wanted = [s for leaf, s in symbols.of.items() if leaf in self.active]
        wanted += [n for n in postorder([cell]) if isinstance(n, Param) and n in self.wrt]
        slopes = symbols.out_of(list(self.derive(cell, wanted))) if wanted else []
        by_leaf = {symbols.meaning.get(s, s): [slope] for s, slope in zip(wanted, slopes, strict=True) if slope is not ZERO}
        return cast("dict[Node, list[Expr]]", by_leaf)


def tangent(e: Expr, direction: Mapping[Parameter, object], along: Along) -> Expr:
    """Returns the derivative of an outlined expression along a direction, numbers for parameters and arrays for arrays; deltas visible."""
    changes = {p: ex.as_number(d) for p, d in direction.items() if isinstance(p, Param)}
    moved = {p: _direction_of(p, d) for p, d in direction.items() if isinstance(p, Array)}
    new: dict[Node, Expr] = {}  # of sums
    for node in postorder([e]):
        if isinstance(node, Sum):
            new[node] = sum_over(_tangent_of_cell(node.body, changes, moved, new, along), node.index, node.lo, node.hi)
    return _tangent_of_cell(e, changes, moved, new, along)


def _tangent_of_cell(
    e: Expr, changes: Mapping[Param, Expr], moved: Mapping[Array, Array], sums: Mapping[Node, Expr], derive: Along
) -> Expr:
    symbols = Symbols([p.name for c in changes.values() for p in postorder([c]) if isinstance(p, Param)])
    (cell,) = symbols.into([e])
    along: dict[Param, Expr] = dict(changes)
    outside: dict[Param, Expr] = {}
    for leaf, symbol in list(symbols.of.items()):
        change: Expr = ZERO
        if isinstance(leaf, Gather) and leaf.array in moved:
            change = Gather.make((moved[leaf.array], leaf.subscripts), ())
        elif isinstance(leaf, Sum):
            change = sums[leaf]
        if change is not ZERO:
            along[symbol] = Param.make(f"∂{symbol.name}", ())
            outside[along[symbol]] = change  # type: ignore[index]
    result = derive(cell, along)
    symbols.meaning.update(cast("dict[Node, Expr]", outside))
    return symbols.out_of([result])[0]


def _direction_of(p: Array, direction: object) -> Array:
    if isinstance(direction, Array) and direction.dimensions == p.dimensions:
        return direction
    hint = f'write teg.array("d{p.name}", {p.dimensions})'
    raise ParameterError(f"a direction along the array {p.name} is an array of {p.dimensions} dimensions", None, hint)


def parameters_and_arrays(wrt: object) -> list[Parameter]:
    """Returns a user's list of parameters and arrays, one or several, each once. Raises ParameterError."""
    chosen: dict[Parameter, None] = {}
    for p in [wrt] if isinstance(wrt, Expr | ArrayName) or not isinstance(wrt, Iterable) else wrt:
        if isinstance(p, ArrayName) and not isinstance(p, Array):
            raise ParameterError(f"{p.name} is an array of indices: nothing is differentiable by it", None, "arrays of numbers: teg.array")
        if not isinstance(p, Param | Array):
            shown = show(p, 80) if isinstance(p, Expr) else repr(p)[:80]
            raise ParameterError(
                f"derivatives are taken by parameters and arrays, not by {shown}", None, 'teg.param("t"), teg.array("V", 2)'
            )
        if p in chosen:
            raise ParameterError(f"the parameter {p.name!r} is listed twice")
        chosen[p] = None
    return list(chosen)
