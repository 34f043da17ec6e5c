"""Comparisons in sums that compare an entry with itself: they have no surface.

    [z_j < z_k]   →   [z_j < z_k] ∧ j ≠ k            where both sides are the same expression of j and of k

For j = k the difference is the constant 0, whatever the arrays hold. The comparison is false as written and stays so when anything
moves, but its value 0 on another surface looks like a tie. So the pass tests whether the difference g of an atom vanishes identically
when one index is replaced by another integer expression: by an index, by a number (`z_k < z_0`), or an entry by an index (`z_N[k] <
z_k`). If it does, the atom is true only if these integers differ. If all that the indices choose are entries of arrays, the places of
these must differ (`F[j]`, `F[k]`): a face that is listed twice does not hide itself either. An atom g >= 0 is true where they do not
differ.

Atoms without variables have no ties and are left alone, and so are integers whose ranges exclude that they are equal. Cost: for each
atom with two integers at the same place of an array one pass over it for each such pair, at most MOST of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import cast

from teg.analysis.polynomial import is_null
from teg.ir.arrays import Gather, Sum
from teg.ir.cells import Symbols, cell_leaves, indices_apart, replace_integers
from teg.ir.expr import Compare, Cond, Expr
from teg.ir.index import Index, IndexCall, IndexConst, IndexGather, IndexVar, free_indices
from teg.ir.node import Node, postorder
from teg.ir.operands import less
from teg.ir.simplify import conjunction, disjunction, negation
from teg.ir.traverse import rebuild

MOST = 32
PLACES = 4
"""If more places have to differ, the indices are compared instead."""
Ranges = Mapping[Index, tuple[Index, Index]]


def without_self_comparisons(root: Expr) -> Expr:
    """Returns the program in which an atom that compares an entry with itself has its written value, and meets no tie."""
    if not any(isinstance(n, Compare) and n.free and _candidates(n.g, {}) for n in postorder([root])):
        return root
    root = indices_apart(root)
    order = postorder([root])
    ranges: dict[Index, tuple[Index, Index]] = {n.index: (n.lo, n.hi) for n in order if isinstance(n, Sum)}
    new: dict[Node, Node] = {}
    for node in order:
        result = rebuild(node, tuple([new[c] for c in node.children]))
        new[node] = _apart(result, ranges) if isinstance(result, Compare) and result.free else result
    return cast(Expr, new[root])


def _apart(atom: Compare, ranges: Ranges) -> Cond:
    """Returns the atom where it compares two entries, and its written value where it compares one with itself."""
    different: list[Cond] = []
    for a, b in _candidates(atom.g, ranges):
        there = replace_integers(atom.g, {a: b})
        (cell,) = Symbols().into([there])
        if is_null(cell):
            different.append(_different(atom.g, a, b))
    together = conjunction(*different)
    return conjunction(atom, together) if atom.strict else disjunction(atom, negation(together))


def _candidates(g: Expr, ranges: Ranges) -> list[tuple[Index, Index]]:
    """Returns pairs (a, b) of integers that index the same array at the same place, and may be equal; a is to be replaced by b."""
    at: dict[object, dict[Index, None]] = {}
    for leaf in cell_leaves([g]):
        if isinstance(leaf, Gather):
            for axis, i in enumerate(leaf.subscripts):
                _note(at, (leaf.array, axis), i)
    pairs: dict[tuple[Index, Index], None] = {}
    for places in at.values():
        for a, b in combinations(places, 2):
            for pair in _meeting(a, b):
                if not _are_apart(*pair, ranges):
                    pairs[pair] = None
            if len(pairs) >= MOST:
                return list(pairs)
    return list(pairs)


def _note(at: dict[object, dict[Index, None]], place: object, i: Index) -> None:
    """Records the integer at a place of an array, and the integers at the places of index arrays that choose it."""
    waiting = [(place, i)]
    while waiting:
        place, i = waiting.pop()
        at.setdefault(place, {})[i] = None
        if isinstance(i, IndexGather):
            waiting += [((i.array, axis), child) for axis, child in enumerate(i.children)]


def _meeting(a: Index, b: Index) -> Iterator[tuple[Index, Index]]:
    """Yields the replacements that make two integers equal: of an index, or of an entry of an index array by the index that chooses it."""
    for first, second in ((a, b), (b, a)):
        if isinstance(first, IndexVar) and first not in free_indices(second):
            yield first, second
            return
    for first, second in ((a, b), (b, a)):
        if isinstance(first, IndexGather) and isinstance(second, IndexVar):
            yield first, second
            return


def _are_apart(a: Index, b: Index, ranges: Ranges) -> bool:
    """Returns whether the ranges of the sums exclude that both are equal."""
    for first, second in ((a, b), (b, a)):
        lo, hi = ranges.get(first, (None, None))
        if lo is not None and (_is_beyond(lo, second) or hi is second or (hi is not None and _is_beyond(second, hi))):
            return True
        if isinstance(hi, IndexConst) and isinstance(second, IndexConst) and second.data >= hi.data:
            return True
    return False


def _is_beyond(lo: Index, other: Index) -> bool:
    """Returns whether an integer is larger than another one by the form in which it is written."""
    if isinstance(lo, IndexConst) and isinstance(other, IndexConst):
        return bool(lo.data > other.data)
    more = lo.children if isinstance(lo, IndexCall) and lo.data == "add" else ()
    return other in more and any(isinstance(c, IndexConst) and c.data > 0 for c in more)


def _different(g: Expr, a: Index, b: Index) -> Cond:
    """Returns the condition that the compared entries are not the same."""
    places: dict[tuple[Index, Index], None] = {}
    for leaf in cell_leaves([g]):
        there = replace_integers(leaf, {a: b})
        if leaf is there:
            continue
        if not isinstance(leaf, Gather) or not isinstance(there, Gather):
            return _unequal(a, b)
        places.update(((i, j), None) for i, j in zip(leaf.subscripts, there.subscripts, strict=True) if i is not j)
    return disjunction(*(_unequal(i, j) for i, j in places)) if len(places) <= PLACES else _unequal(a, b)


def _unequal(a: Index, b: Index) -> Cond:
    return disjunction(less(a, b, strict=True), less(b, a, strict=True))
