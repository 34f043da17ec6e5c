"""Passes for programs with arrays and sums: those of `teg.pipeline`, on every cell.

    value        self-comparisons → sums out of integrals → indices renamed → each cell's normal form
    derivative   … → each cell by its symbols (`pipeline.compiled_outputs`), then the chain rule through the sums

    d/dV of  f(Σ_k g(V[F[k]]))   =   f′(s) · Σ_k g′(V[F[k]]) · 1[V; F[k]],    s = Σ_k g(V[F[k]])

The derivative of a cell by its symbols is taken once, whatever they stand for. The derivative by a symbol of an entry is scattered into
the array; the symbol of a sum is differentiated in its turn. Cost: one gradient a sum, like that of a scalar program of the same size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import Any, cast

from teg.analysis import calculus
from teg.errors import NotDifferentiableError, ParameterError
from teg.ir import expr as ex
from teg.ir import operands, simplify
from teg.ir.arrays import Array, Gather, Placed, Ranged, Slope, StillGather, Sum, Unit, has_arrays, integers_of, open_indices, sum_over
from teg.ir.cells import Symbols, cellwise, rename_indices, replace_integers, replaced
from teg.ir.choices import Product, Winner
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Expr, Param, Var
from teg.ir.index import APART, ArrayName, IndexVar, index_leaves
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.partition import Partition, Pullback, SeenSum
from teg.ir.show import show
from teg.ir.simplify import add, mul, positive, sub, where
from teg.ir.tables import Collected, RowSum, Table, TableEntry, TableUnit
from teg.ir.uncovered import Gaps, Uncovered
from teg.passes.differentiate.edges import edges_of, inside_of, with_gaps
from teg.passes.differentiate.gaps import moved_gaps
from teg.passes.normalise.choices import without_choices
from teg.passes.normalise.partitions import Refused
from teg.passes.normalise.self_comparison import without_self_comparisons
from teg.passes.normalise.sums import sums_outside

Derive = Callable[[Expr, Sequence[Param]], Sequence[Expr]]
"""The derivatives of a scalar expression by parameters."""
Along = Callable[[Expr, Mapping[Param | Var, Expr]], Expr]
"""The derivative of a scalar expression along changes of its parameters and free variables."""
Parameter = Param | Array


def outlined(e: Expr, edges: bool = False) -> Expr:
    """Returns the program with its sums outside of integrals, and canonical indices; with `edges`, with integrals over what no candidate
    covers. Raises NeedsLengths."""
    if not has_arrays(e):
        return e
    return without_choices(rename_indices(sums_outside(without_self_comparisons(e))), edges)


def on_cells(e: Expr, step: Callable[[Expr], Expr]) -> Expr:
    """Returns a scalar pass applied to a scalar program, or to each cell of a program with sums."""
    return cellwise(e, step) if has_arrays(e) else step(e)


def gradient(e: Expr, wrt: Sequence[Parameter], derive: Derive, boundaries: bool = True, last: bool = False) -> list[Expr]:
    """Returns the derivatives of an outlined expression by parameters and arrays. The derivative by an array holds `Unit`s.

    Without `boundaries` the regions of partitions do not move, which is plain automatic differentiation. The `last` derivative, which is
    not differentiated again, has `Pullback`s.
    """
    derivatives = _Gradient(e, frozenset(wrt), derive, boundaries, last).of(e, None)
    return [derivatives.get(p, ZERO) for p in wrt]


class _Gradient:
    """One gradient. The order of the nodes, and the parameters and indices that each depends on, are determined once."""

    def __init__(self, root: Expr, wrt: frozenset[Parameter], derive: Derive, boundaries: bool, last: bool) -> None:
        self.derive, self.boundaries, self.last = derive, boundaries, last
        self.wrt = wrt
        self.order = {node: i for i, node in enumerate(postorder([root]))}
        self.open = open_indices(root)
        self.active: set[Node] = set()
        for node in self.order:
            mine = node in wrt or (isinstance(node, Gather) and not isinstance(node, StillGather) and node.array in wrt)
            below = (node.table.children[node.column],) if isinstance(node, TableEntry) else node.children
            if mine or (not isinstance(node, Winner) and any(c in self.active for c in below)):
                if isinstance(node, Slope | Collected):
                    raise not_again(node)
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
        waiting: list[tuple[int, Ranged]] = [(-self.order[leaf], leaf) for leaf in parts if isinstance(leaf, Ranged)]
        heapify(waiting)  # a sum comes before the sums in its body: its weight is then complete
        while waiting:
            _, node = heappop(waiting)
            weight = add(*parts.pop(node))
            if bound is not None and bound not in self.open[node]:
                result[node] = weight
                continue
            if isinstance(node, Partition):
                weights = {node: weight}
                while waiting and _is_beside(waiting[0][1], node, self.last) and (bound is None or bound in self.open[waiting[0][1]]):
                    other = cast(Partition, heappop(waiting)[1])
                    weights[other] = add(*parts.pop(other))
                found = self._inside_partitions(weights, bound)
            elif isinstance(node, Table):
                found = self._inside_table(node, weight)
            elif isinstance(node, Uncovered):
                found = {leaf: mul(weight, slope) for leaf, slope in self._inside_uncovered(node, bound).items()}
            else:
                found = {leaf: mul(weight, slope) for leaf, slope in self._inside(node).items()}
            for leaf, term in found.items():
                if isinstance(leaf, Ranged) and leaf not in parts:
                    heappush(waiting, (-self.order[leaf], leaf))
                parts.setdefault(leaf, []).append(term)
        at_arrays: dict[Node, list[Expr]] = {}
        for leaf, terms in parts.items():
            if isinstance(leaf, Gather) and (bound is None or bound in self.open[leaf]):
                at_arrays.setdefault(leaf.array, []).append(mul(add(*terms), Unit.make((leaf.array, leaf.subscripts), ())))
            elif isinstance(leaf, TableEntry) and (bound is None or bound in self.open[leaf]):
                at_arrays.setdefault(leaf.table, []).append(mul(add(*terms), TableUnit.make(leaf.data, leaf.children)))
            else:
                at_arrays.setdefault(leaf, []).extend(terms)
        result.update((leaf, add(*terms)) for leaf, terms in at_arrays.items())
        self.done[e, bound] = result
        return result

    def _inside(self, node: Ranged) -> dict[Node, Expr]:
        """Returns the derivatives of a sum or a product by the leaves in it."""
        inside: dict[Node, list[Expr]] = {}
        for child, factor in flows_of(node):
            if child in self.active:
                for leaf, slope in self.of(child, node.index).items():
                    inside.setdefault(leaf, []).append(mul(factor, slope))
        return {leaf: sum_over(add(*terms), node.index, node.lo, node.hi) for leaf, terms in inside.items()}

    def _inside_partitions(self, weights: Mapping[Partition, Expr], bound: IndexVar | None) -> dict[Node, Expr]:
        """Returns the derivatives of partitions with the same forms, times their weights, by the leaves in them.

        The weights of all of them come together at the numbers of a candidate, and one sweep goes on from there.
        """
        node = next(iter(weights))
        whole: Partition | Pullback = node
        if self.last and not node.layout.order:
            layout = max((p.layout for p in weights), key=lambda layout: layout.degree)
            whole = Pullback.make((node.index, node.lo, node.hi, layout), (*weights, *weights.values()))
        terms = _together(whole, self.boundaries) if isinstance(whole, Pullback) else _apart(weights, self.boundaries)
        slopes: list[Expr] = []
        candidate: dict[Expr, list[Expr]] = {}  # a number to its adjoints
        otherwise: dict[Expr, list[Expr]] = {}
        for number, weight, slope, repeated in terms:
            if number in self.active:
                slopes += [slope] if repeated else []
                (candidate if repeated else otherwise).setdefault(number, []).append(mul(weight, slope))
        around: dict[Node, list[Expr]] = {}
        for leaf, slope in self._swept(candidate, node.index).items():
            seen = where(_is_seen(whole, slopes), slope, ZERO)
            total = sum_over(seen, node.index, node.lo, node.hi)
            if isinstance(whole, Pullback) and total is not ZERO:
                total = SeenSum.make((node.index, node.lo, node.hi), (seen, whole))
            around.setdefault(leaf, []).append(total)
        for leaf, slope in self._swept(otherwise, bound).items():
            around.setdefault(leaf, []).append(slope)
        return {leaf: add(*terms) for leaf, terms in around.items()}

    def _inside_uncovered(self, node: Uncovered, bound: IndexVar | None) -> dict[Node, Expr]:
        """Returns the derivatives of an integral over what no candidate covers: of the body, and as the edges of candidates move."""
        found: dict[Node, list[Expr]] = {}
        for leaf, slope in self.of(inside_of(node), bound).items():
            found.setdefault(leaf, []).append(slope)
        for edge in edges_of(node, node.body):
            for leaf, slope in self.of(edge, node.index).items():
                found.setdefault(leaf, []).append(mul(MINUS_ONE, sum_over(slope, node.index, node.lo, node.hi)))
        return {leaf: add(*terms) for leaf, terms in found.items()}

    def _inside_table(self, table: Table, derivative: Expr) -> dict[Node, Expr]:
        """Returns the derivatives by the leaves of a table, given the derivative by the table, which is a table itself."""
        adjoints = {
            number: [cast(Expr, Collected.make((table.index, column), (derivative,)))]
            for column, number in enumerate(table.numbers)
            if number in self.active
        }
        matters = _some(terms[0] for terms in adjoints.values())
        return {
            leaf: cast(Expr, RowSum.make((table.index, table.lo, table.hi, table.listed), (where(matters, slope, ZERO),)))
            for leaf, slope in self._swept(adjoints, table.index).items()
        }

    def _swept(self, adjoints: Mapping[Expr, Sequence[Expr]], bound: IndexVar | None) -> dict[Node, Expr]:
        """Returns Σ adjoint·(derivative of the number) by the leaves of numbers, as the derivatives of Σ seed·number."""
        seeds = {Param.make(f"{APART}adjoint {k}", ()): number for k, number in enumerate(adjoints)}
        if not seeds:
            return {}
        slopes = self.of(add(*(mul(seed, number) for seed, number in seeds.items())), bound)
        meanings: dict[Node, Expr] = {seed: add(*adjoints[number]) for seed, number in seeds.items()}
        return dict(zip(slopes, replaced(list(slopes.values()), meanings), strict=True))

    def _of_cell(self, e: Expr) -> dict[Node, list[Expr]]:
        """Returns the derivatives of a cell by its leaves."""
        symbols = Symbols()
        (cell,) = symbols.into([e])
        wanted = [s for leaf, s in symbols.of.items() if leaf in self.active]
        wanted += [n for n in postorder([cell]) if isinstance(n, Param) and n in self.wrt]
        slopes = symbols.out_of([with_gaps(slope, self.derive) for slope in self.derive(cell, wanted)]) if wanted else []
        by_leaf = {symbols.meaning.get(s, s): [slope] for s, slope in zip(wanted, slopes, strict=True) if slope is not ZERO}
        return cast("dict[Node, list[Expr]]", by_leaf)


def tangent(e: Expr, direction: Mapping[Any, object], along: Along, boundaries: bool = True) -> Expr:
    """Returns the derivative of an outlined expression along a direction, numbers for parameters and arrays for arrays; deltas visible.

    Without `boundaries` the regions of partitions do not move.
    """
    changes = {p: operands.as_number(d) for p, d in direction.items() if isinstance(p, Param | Var)}
    moved = {p: _direction_of(p, d) for p, d in direction.items() if isinstance(p, Array)}
    new: dict[Node, Expr] = {}  # of sums, products, partitions and slopes

    def moves(cell: Expr, more: Mapping[Param | Var, Expr] = {}) -> Expr:
        return _tangent_of_cell(cell, {**changes, **more}, moved, new, along)

    for node in postorder([e]):
        match node:
            case Sum():
                new[node] = sum_over(moves(node.body), node.index, node.lo, node.hi)
            case Product():
                ((_, others),) = flows_of(node)
                new[node] = sum_over(mul(others, moves(node.body)), node.index, node.lo, node.hi)
            case Partition():
                new[node] = _moved_partition(node, moves, boundaries)
            case Slope():
                new[node] = _moved_slope(node, new[node.table])
            case Table():
                new[node] = Table.make(node.data, tuple(map(moves, node.numbers)))
            case TableEntry():
                moved_table = cast(Table, new[node.table])
                new[node] = TableEntry.make(node.data, (moved_table,)) if moved_table.numbers[node.column] is not ZERO else ZERO
            case Collected():
                raise not_again(node)
            case Uncovered():
                edges = [sum_over(moves(edge), node.index, node.lo, node.hi) for edge in edges_of(node, node.body)]
                new[node] = add(moves(inside_of(node)), mul(MINUS_ONE, add(*edges)))
            case Gaps():
                new[node] = moved_gaps(node, moves)
            case _:
                pass
    return moves(e)


def rates_along_edges(derive: Derive) -> Along:
    """Returns the function that differentiates a cell along a direction: without δ, and with sums over gaps for what may be covered. The
    function raises Refused.

    Where a term does not count, because it compares a candidate with itself, its derivative does not either, even if it is no number.
    """

    def rate(cell: Expr, changes: Mapping[Param | Var, Expr]) -> Expr:
        moving = [p for p in changes if isinstance(p, Param)]
        if not cell.free:
            slopes = derive(cell, moving)
        elif any(isinstance(n, Integral) for n in postorder([cell])):
            raise Refused("the border of a candidate depends on an integral")
        else:
            slopes = [calculus.slope(cell, p) for p in moving]
        return with_gaps(add(*(mul(s, changes[p]) for p, s in zip(moving, slopes, strict=True))), derive)

    def along(cell: Expr, changes: Mapping[Param | Var, Expr]) -> Expr:
        parts: dict[ex.Cond, list[Expr]] = {}
        for term in cell.children if isinstance(cell, ex.Add) else (cell,):
            condition, rest = simplify.nonzero_part(term)
            whole = bool(condition.free)
            parts.setdefault(ex.TRUE if whole else condition, []).append(term if whole else rest)
        return add(*(where(condition, rate(add(*terms), changes), ZERO) for condition, terms in parts.items()))

    return along


def flows_of(node: Ranged) -> Iterator[tuple[Expr, Expr]]:
    """Yields the parts of the derivative of a sum or a product: a child, and the factor of its derivative."""
    match node:
        case Sum():
            yield node.body, ONE
        case Product():
            used = {n.name for n in postorder([node]) for n in index_leaves(integers_of(n)) if isinstance(n, IndexVar)}
            other = node.index.name
            while other in used | {node.index.name}:
                other += "′"
            j = IndexVar.make(other, ())
            body = replace_integers(node.body, {node.index: j})
            distance = sub(operands.as_number(j), operands.as_number(node.index))
            itself = positive(sub(ex.const(0.25), simplify.integer_power(distance, 2)))
            yield node.body, Product.make((j, node.lo, node.hi), (where(itself, ONE, body),))
        case _:
            assert isinstance(node, Winner)


def numbers_of(node: Partition, boundaries: bool) -> Iterator[tuple[Expr, Expr, bool]]:
    """Yields the numbers of a partition, the derivatives by them, and whether these belong to a candidate, and are summed over the index.

    Without `boundaries` forms are left out.
    """
    forms, columns = node.layout.forms, node.layout.columns
    for k, number in enumerate(node.candidate):
        if boundaries or k % columns >= forms:
            yield number, Slope.make((node.index, k), (node,)), True
    count = node.layout.coefficients
    for k, number in enumerate(node.otherwise):
        yield number, Slope.make((node.hi, columns * (k // count) + forms + k % count), (node,)), False


def _apart(weights: Mapping[Partition, Expr], boundaries: bool) -> Iterator[tuple[Expr, Expr, Expr, bool]]:
    """Yields what `numbers_of` does for partitions, with the weight of the partition behind each number."""
    for partition, weight in weights.items():
        for number, slope, repeated in numbers_of(partition, boundaries):
            yield number, weight, slope, repeated


def _together(whole: Pullback, boundaries: bool) -> Iterator[tuple[Expr, Expr, Expr, bool]]:
    """Yields the same for a pullback: forms, which all partitions share, come once, and their weights are in the slopes."""
    forms = whole.layout.forms
    for k, (partition, weight) in enumerate(zip(whole.partitions, whole.weights, strict=True)):
        for number, slope, repeated in numbers_of(partition, boundaries):
            assert isinstance(slope, Slope)
            is_form = slope.column < forms
            if not is_form or k == 0:
                yield number, ONE if is_form else weight, Slope.make(slope.data, (whole,)), repeated


def _is_beside(other: Ranged, node: Partition, last: bool) -> bool:
    """Returns whether a node is a partition with the same candidates and forms, and not inside of the first one. Degrees may differ in
    the last derivative of values."""
    if not isinstance(other, Partition) or (other.index, other.lo, other.hi) != (node.index, node.lo, node.hi):
        return False
    degree = node.layout.degree if last and not node.layout.order else other.layout.degree
    if other.layout._replace(degree=degree) != node.layout:
        return False
    columns, forms = node.layout.columns, node.layout.forms
    ranges = [(k * columns, k * columns + forms) for k in range(1 + node.layout.order)]
    return all(other.candidate[a:b] == node.candidate[a:b] for a, b in ranges) and other not in postorder([node])


def _moved_partition(node: Partition, moves: Callable[[Expr], Expr], boundaries: bool) -> Expr:
    """Returns the derivative of a partition along a direction, a partition of order 1; of one of order 1 by its `Slope`s."""
    if node.layout.order:
        along = [(moves(number), slope, repeated) for number, slope, repeated in numbers_of(node, boundaries)]
        changes, once = (add(*(mul(slope, change) for change, slope, at in along if at is repeated)) for repeated in (True, False))
        seen = _is_seen(node, (slope for _, slope, repeated in along if repeated))
        return add(sum_over(where(seen, changes, ZERO), node.index, node.lo, node.hi), once)
    forms = node.layout.forms
    candidate = tuple(moves(c) if boundaries or k >= forms else ZERO for k, c in enumerate(node.candidate))
    otherwise = tuple(map(moves, node.otherwise))
    if all(m is ZERO for m in (*candidate, *otherwise)):
        return ZERO
    layout = node.layout._replace(order=1)
    return Partition.make((node.index, node.lo, node.hi, layout), (*node.candidate, *candidate, *node.otherwise, *otherwise))


def _moved_slope(node: Slope, along: Expr) -> Expr:
    """Returns the derivative of a slope along a direction: the same slope of the derivative of its partition."""
    if along is ZERO:
        return ZERO
    if not isinstance(along, Partition):
        raise not_again(node)
    return Slope.make(node.data, (along,))


def _is_seen(node: Partition | Pullback, slopes: Iterable[Expr]) -> ex.Cond:
    """Returns whether a candidate has an area, or an edge, by the slopes of its forms: else nothing of it matters, even if infinite.

    One without area has edges where another one in front of it ends on the same lines.
    """
    layout = node.layout
    area = Slope.make((node.index, layout.order * layout.columns + layout.forms), (node,))
    edges = [s for s in slopes if isinstance(s, Slope) and s.column % layout.columns < layout.forms]
    return simplify.disjunction(positive(area), _some(edges))


def _some(numbers: Iterable[Expr]) -> ex.Cond:
    """Returns whether any of some numbers is not 0; they may be so small that their squares are."""
    return positive(add(*(simplify.call("magnitude", v) for v in numbers)))


def not_again(node: Placed) -> NotDifferentiableError:
    """Returns the error for a derivative of a choice that there is not: the third one, or the gradient of a gradient."""
    partition = node.table
    if isinstance(partition, Partition) and partition.layout.order:
        hint = (
            "a difference of f.hvp or f.hessian at two points, which are exact; jumps written out (teg.where) have derivatives of any order"
        )
        return NotDifferentiableError("an integral of a choice among candidates has first and second derivatives only", partition, hint)
    hint = "teg.jvp(teg.grad(e, …), …), which is one along a direction; f.hvp and f.hessian of the compiled program"
    return NotDifferentiableError("the gradient of an integral of a choice among candidates has no gradient in symbols", partition, hint)


def _tangent_of_cell(
    e: Expr, changes: Mapping[Param | Var, Expr], moved: Mapping[Array, Array], sums: Mapping[Node, Expr], derive: Along
) -> Expr:
    symbols = Symbols([p.name for c in changes.values() for p in postorder([c]) if isinstance(p, Param)])
    (cell,) = symbols.into([e])
    along: dict[Param | Var, Expr] = dict(changes)
    outside: dict[Param, Expr] = {}
    for leaf, symbol in list(symbols.of.items()):
        change: Expr = ZERO
        if isinstance(leaf, Gather) and not isinstance(leaf, StillGather) and leaf.array in moved:
            change = Gather.make((moved[leaf.array], leaf.subscripts), ())
        elif isinstance(leaf, Ranged | Placed):
            change = sums.get(leaf, ZERO)
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
