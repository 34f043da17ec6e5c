"""Cells: the parts of a program between its sums, as scalar expressions.

    Σ_k sin(t·V[k]) · ∫…            the body is a cell of the symbols t, V[k]; the sum is a symbol of the cell around it

A leaf of a cell (an entry of an array, an integer, a whole inner sum) becomes a parameter, its *symbol*. Every pass for scalar programs
then runs on a cell unchanged. Symbols are named after their leaves, so that messages read well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import cast

from teg.errors import NameClashError, ScopeError
from teg.ir import expr as ex
from teg.ir.arrays import LEAVES, Gather, Placed, Ranged, Sum, Unit, arrays_of, integer_parameters, integers_of, open_indices
from teg.ir.expr import Expr, Param, Tuple
from teg.ir.index import APART, ArrayName, Index, IndexConst, IndexValue, IndexVar, Length, index_const, index_leaves, substitute_index
from teg.ir.node import Node, postorder
from teg.ir.show import show, show_within
from teg.ir.traverse import rebuild, rewrite_below
from teg.ir.uncovered import Gaps

SHOWN = 60
"""The largest number of characters of a sum in the name of its symbol."""


def cell_leaves(roots: Sequence[Node]) -> list[Expr]:
    """Returns the leaves of a cell, in order: entries, integers, units, and sums (which are not entered)."""
    leaves: dict[Expr, None] = {}
    seen: set[Node] = set()
    stack: list[Node] = list(reversed(roots))
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if isinstance(node, (*LEAVES, Ranged)):
            leaves[cast(Expr, node)] = None
        else:
            stack.extend(reversed(node.children))
    return list(leaves)


class Symbols:
    """The symbols of leaves, made when a leaf is first met."""

    def __init__(self, taken: Sequence[str] = ()) -> None:
        self._taken = set(taken)
        self.of: dict[Node, Param] = {}
        self.meaning: dict[Node, Expr] = {}

    def symbol(self, leaf: Expr) -> Param:
        """Returns the parameter that stands for a leaf."""
        if leaf not in self.of:
            name = _title(leaf, len(self.of))
            while name in self._taken:
                name += "′"
            self._taken.add(name)
            self.of[leaf] = Param.make(name, ())
            self.meaning[self.of[leaf]] = leaf
        return self.of[leaf]

    def into(self, roots: Sequence[Expr]) -> list[Expr]:
        """Returns cells with symbols in the place of leaves."""
        self._taken.update(n.name for n in postorder(roots) if isinstance(n, Param) and n not in self.meaning)
        for leaf in cell_leaves(roots):
            self.symbol(leaf)
        return replaced(roots, self.of)

    def out_of(self, roots: Sequence[Expr]) -> list[Expr]:
        """Returns cells with leaves in the place of symbols."""
        return replaced(roots, self.meaning)


def _title(leaf: Expr, number: int) -> str:
    """Returns the name of a leaf's symbol: the leaf as it is written, or a number for a long sum, with its term if that is an entry."""
    if not isinstance(leaf, Ranged):
        return show(leaf, SHOWN)[:SHOWN]
    text = show_within(leaf, SHOWN)
    if text is not None and len(text) <= SHOWN and "\n" not in text:
        return f"({text})"
    term = show(leaf.children[0], SHOWN // 2) if isinstance(leaf.children[0], LEAVES) else ""
    return f"{'Σ' if isinstance(leaf, Sum) else '#'}{number}[{leaf.index.name}]{term}"


def cellwise(root: Expr, step: Callable[[Expr], Expr]) -> Expr:
    """Returns the program with a scalar pass applied to every cell, inner sums first; not in sums over gaps, which are finished."""
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        children = tuple(new[c] for c in node.children)
        new[node] = rebuild(node, children)
        if isinstance(node, Ranged) and not isinstance(node, Gaps):
            new[node] = node.over(tuple(_on_cell(cast(Expr, c), step) for c in children), node.index, node.lo, node.hi)
    return _on_cell(cast(Expr, new[root]), step)


def _on_cell(cell: Expr, step: Callable[[Expr], Expr]) -> Expr:
    symbols = Symbols()
    return symbols.out_of([step(symbols.into([cell])[0])])[0]


def cells_of(e: Expr) -> list[tuple[tuple[Ranged, ...], Expr]]:
    """Returns every cell with the sums around it, outermost first. A cell comes before the cells in its sums. In sums over gaps, whether
    a place is covered is none."""
    around: dict[Expr, tuple[Ranged, ...]] = {}
    entries: list[Expr] = [e]
    while entries:
        entry = entries.pop(0)
        if isinstance(entry, Tuple):
            entries = [*entry.children, *entries]
        else:
            around[entry] = ()
    waiting = list(around)
    for body in waiting:
        for leaf in cell_leaves([body]):
            if isinstance(leaf, Ranged):
                path = (*around[body], cast(Ranged, leaf))
                inner = (leaf.term,) if isinstance(leaf, Gaps) else cast("tuple[Expr, ...]", leaf.children)
                inside = [c for c in inner if c not in around]
                around.update(dict.fromkeys(inside, path))
                waiting += dict.fromkeys(inside)
    return [(path, body) for body, path in around.items()]


def with_integers(node: Node, children: tuple[Node, ...], change: Callable[[Index], Index]) -> Node:
    """Returns a node rebuilt from other children, with its integer expressions changed."""
    match node:
        case Gather() | Unit():
            return type(node).make((node.array, tuple(change(i) for i in node.subscripts)), ())
        case IndexValue():
            i = change(node.index)
            return ex.const(float(i.data)) if isinstance(i, IndexConst) else IndexValue.make(i, ())
        case Ranged():
            return node.over(children, node.index, change(node.lo), change(node.hi))
        case Placed():
            return type(node).make((change(node.row), node.column), cast("tuple[Expr, ...]", children))
        case _:
            return rebuild(node, children)


def replace_integers(root: Expr, mapping: Mapping[Index, Index]) -> Expr:
    """Returns the expression with integers replaced. No inner sum may bind an index that is replaced or that occurs in a replacement."""
    new: dict[Node, Node] = {}
    changed: dict[Index, Index] = {}

    def change(i: Index) -> Index:
        if i not in changed:
            changed[i] = substitute_index(i, mapping.get)
        return changed[i]

    for node in postorder([root]):
        new[node] = with_integers(node, tuple(new[c] for c in node.children), change)
    return cast(Expr, new[root])


def with_lengths(root: Expr, shapes: Mapping[ArrayName, tuple[int, ...]]) -> Expr:
    """Returns the expression with numbers in the place of the lengths of arrays."""
    lengths = {n for node in postorder([root]) for n in index_leaves(integers_of(node)) if isinstance(n, Length)}
    return replace_integers(root, {n: index_const(shapes[n.array][n.axis]) for n in lengths})


def rename_indices(root: Expr) -> Expr:
    """Returns the expression with the index of every sum named by the sum's height.

    The height of a sum is one more than the greatest height in its body. Equal sums become one node, sums over the same range can share
    a loop, and nothing is captured. The name of a height is that of the first index of the program that has it.
    """
    new: dict[Node, Node] = {}
    height: dict[Node, int] = {}
    names: dict[int, str] = {}
    for node in postorder([indices_apart(root)]):
        children = tuple(new[c] for c in node.children)
        height[node] = max((height[c] for c in node.children), default=0)
        if isinstance(node, Ranged):
            height[node] += 1
            if height[node] not in names:
                name = node.index.name.split(APART)[0]
                while name in names.values():
                    name += "′"
                names[height[node]] = name
            k = IndexVar.make(names[height[node]], ())
            new[node] = node.over(tuple(replace_integers(cast(Expr, c), {node.index: k}) for c in children), k, node.lo, node.hi)
        else:
            new[node] = rebuild(node, children)
    return cast(Expr, new[node])


def indices_apart(root: Expr) -> Expr:
    """Returns the expression with a distinct index for every sum, so that taking a sum out of a product, or renaming
    it, captures nothing."""
    new: dict[Node, Node] = {}
    count = 0
    for node in postorder([root]):
        children = tuple(new[c] for c in node.children)
        if isinstance(node, Ranged):
            count += 1
            k = IndexVar.make(f"{node.index.name.split(APART)[0]}{APART}{count}", ())
            new[node] = node.over(tuple(replace_integers(cast(Expr, c), {node.index: k}) for c in children), k, node.lo, node.hi)
        else:
            new[node] = rebuild(node, children)
    return cast(Expr, new[root])


def replaced(roots: Sequence[Expr], mapping: Mapping[Node, Expr]) -> list[Expr]:
    """Returns the roots with nodes replaced by others. The inside of a replaced node is not visited."""
    new = rewrite_below(roots, mapping.get)
    return [cast(Expr, new[r]) for r in roots]


def check_indices(root: Expr) -> None:
    """Checks that every index is bound by a sum and every name stands for one thing. Raises ScopeError or NameClashError."""
    if loose := sorted(k.name for k in open_indices(root)[root]):
        raise ScopeError(f"an index stands outside its sum: {', '.join(loose)}", root, f"sum over it: teg.sum(e, ({loose[0]}, 0, n))")
    kinds: dict[str, Node] = {}
    for a in arrays_of(root):
        if kinds.setdefault(a.name, a) is not a:
            raise NameClashError(f"{a.name!r} is the name of two different arrays", root, "give them different names")
    names = {n.name for n in postorder([root]) if isinstance(n, Param)} | {p.name for p in integer_parameters(root)}
    if clash := sorted(names & kinds.keys()):
        raise NameClashError(f"{clash[0]!r} is an array and a parameter in one program", root, "rename one of them")
    for node in postorder([root]):
        if isinstance(node, Ranged):
            for i in integers_of(node):
                if node.index in postorder([i]):
                    raise ScopeError(f"the range of {node.index.name} depends on itself", node)
