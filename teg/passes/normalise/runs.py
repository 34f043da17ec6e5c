"""Lists in which neighbours are alike, as sums over runs of equal entries.

    Σ_{n < N} f(L[n], M[n])   →   Σ_r Σ_{S[r] ≤ n < S[r + 1]} f(L[S[r]], M[n])          L is constant on each run

or, where M goes up by one and all other entries are constant,

    →   Σ_r Σ_{S[r] ≤ q < S[r + 1]} Σ_{R[q] ≤ c < R[q] + length of q} f(…, c)              each row q of a table has such a range

What depends on L alone is then the same in all iterations of an inner sum: it is computed once for each run, and so is the chain rule
behind it. A list of pixels that triangles meet, sorted by triangles, is the sum over triangles and their pixels that way; if the
pixels of a triangle are sorted by rows, it is the sum over triangles, rows and columns. Which entries
have runs is data, so a program has both forms. Cost: a visit a node.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple, cast

from teg.ir.arrays import Gather, Sum, integers_of, open_indices, sum_over
from teg.ir.cells import replace_integers
from teg.ir.expr import Expr
from teg.ir.index import (
    APART,
    Index,
    IndexArray,
    IndexConst,
    IndexGather,
    IndexParam,
    IndexVar,
    Length,
    index_call,
    index_const,
    index_leaves,
)
from teg.ir.node import Node, postorder
from teg.ir.traverse import rebuild


class Entry(NamedTuple):
    """A[n, 2] as the array A and the places (None, 2)."""

    array: IndexArray
    places: tuple[int | None, ...]


class Listed(NamedTuple):
    """The range of a sum that stands in no other sum, and the entries of index arrays that its index alone chooses, as far as they alone
    choose numbers; `title` is what the index is called. `every` has all entries that the index alone chooses, if it is used in no other
    way; else it is empty."""

    lo: Index
    hi: Index
    entries: tuple[Entry, ...]
    title: str = ""
    every: tuple[Entry, ...] = ()

    @property
    def written(self) -> list[str]:
        """Returns the entries as they are written, with the index of the sum."""
        return [f"{a.name}[{', '.join(self.title if p is None else str(p) for p in places)}]" for a, places in self.entries]


class Rows(NamedTuple):
    """Rows of a list, on which the entry `counting` goes up by one, and all others are constant. Each has a row of the `table`: the
    values of the entries `constant`, and where the range of the other one begins and ends."""

    table: IndexArray
    constant: tuple[Entry, ...]
    counting: Entry


class Runs(NamedTuple):
    """The entries that are constant on each run, and the array that has the start of each run, and the end of the last one: in the list, or
    among its `rows`."""

    entries: Collection[Entry]
    starts: IndexArray
    rows: Rows | None = None


def listed_sums(root: Expr) -> list[Listed]:
    """Returns the ranges of sums over lists; both ends are numbers, lengths or parameters."""
    found: dict[tuple[Index, Index], list[Sum]] = {}
    for node in _outermost(root):
        if all(isinstance(end, IndexConst | Length | IndexParam) for end in (node.lo, node.hi)):
            found.setdefault((node.lo, node.hi), []).append(node)
    lists: list[Listed] = []
    for (lo, hi), sums in found.items():
        entries = dict.fromkeys(e for s in sums for n in postorder([s.body]) if (e := _chosen_by(n, s.index)) is not None)
        if entries:
            every = [_every_entry(s) for s in sums]
            alone = () if None in every else tuple(dict.fromkeys(e for one in every for e in one or ()))
            titles = [s.index.name.split(APART)[0] for s in sums if any(_chosen_by(n, s.index) for n in postorder([s.body]))]
            lists.append(Listed(lo, hi, tuple(entries), titles[0], alone))
    return lists


def _every_entry(node: Sum) -> tuple[Entry, ...] | None:
    """Returns all entries that the index of a sum alone chooses; None if the index is used in another way."""
    entries: dict[Entry, None] = {}
    waiting: list[Index] = list(dict.fromkeys(i for n in postorder([node.body]) for i in integers_of(n)))
    while waiting:
        i = waiting.pop()
        entry = _entry(i, node.index) if isinstance(i, IndexGather) else None
        if i is node.index:
            return None
        if entry is not None:
            entries[entry] = None
        else:
            waiting += cast("tuple[Index, ...]", i.children)
    return tuple(entries)


def _chosen_by(node: Node, index: IndexVar) -> Entry | None:
    """Returns the entry that alone chooses a number of an array, among all that `index` chooses; None if there is no such entry."""
    if not isinstance(node, Gather):
        return None
    entries: set[Entry | None] = set()
    waiting: list[Index] = list(node.subscripts)
    while waiting:
        i = waiting.pop()
        entry = _entry(i, index) if isinstance(i, IndexGather) else None
        if entry is not None or i is index:
            entries.add(entry)
        else:
            waiting += cast("tuple[Index, ...]", i.children)
    return entries.pop() if len(entries) == 1 else None


def by_runs(root: Expr, runs: Mapping[tuple[Index, Index], Runs]) -> Expr:
    """Returns the program in which sums over these ranges are sums over runs."""
    outermost = set(_outermost(root))
    taken = {n.index.name for n in postorder([root]) if isinstance(n, Sum)}
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        new[node] = rebuild(node, tuple(new[c] for c in node.children))
        if isinstance(node, Sum) and node in outermost and (run := runs.get((node.lo, node.hi))) is not None:
            new[node] = _over_runs(node, cast(Sum, new[node]).body, run, f"run{APART}{len(taken)}")
    return cast(Expr, new[root])


def _over_runs(old: Sum, body: Expr, runs: Runs, name: str) -> Expr:
    r, zero = IndexVar.make(name, ()), index_const(0)
    first, after = runs.starts[r], runs.starts[index_call("add", r, index_const(1))]
    entries = set(runs.entries)
    if runs.rows is not None:
        return _over_rows(old, body, runs, name)
    same = {
        g: cast(Index, IndexGather.make(g.array, tuple(first if c is old.index else c for c in g.children)))
        for g in _gathers(old)
        if _entry(g, old.index) in entries
    }
    inner = sum_over(replace_integers(body, cast("dict[Index, Index]", same)), old.index, first, after)
    return sum_over(inner, r, zero, _count(runs))


def _count(runs: Runs) -> Index:
    """Returns how many runs there are."""
    return index_call("sub", cast(Index, Length.make((runs.starts, 0), ())), index_const(1))


def _over_rows(old: Sum, body: Expr, runs: Runs, name: str) -> Expr:
    """Returns a sum over runs, their rows, and the range of the counting entry in each row."""
    rows = runs.rows
    assert rows is not None
    r, q = (IndexVar.make(f"{name}{part}", ()) for part in ("", f"{APART}row"))
    first, after = runs.starts[r], runs.starts[index_call("add", r, index_const(1))]
    places = {entry: column for column, entry in enumerate(rows.constant)}

    def of(gather: IndexGather) -> Index:
        entry = _entry(gather, old.index)
        assert entry is not None
        if entry == rows.counting:
            return old.index
        return rows.table[first if entry in runs.entries else q, places[entry]]

    gathers = [g for g in _gathers(old) if _entry(g, old.index) is not None]
    lo, hi = (rows.table[q, len(places) + end] for end in range(2))
    row = sum_over(replace_integers(body, {g: of(g) for g in gathers}), old.index, lo, hi)
    return sum_over(sum_over(row, q, first, after), r, index_const(0), _count(runs))


def _outermost(root: Expr) -> list[Sum]:
    opened = open_indices(root)
    inside: set[Node] = set()
    found: list[Sum] = []
    for node in reversed(postorder([root])):
        if node in inside:
            inside.update(node.children)
        elif isinstance(node, Sum):
            inside.update(node.children)
            found += [node] if not opened[node] else []
    return found


def _gathers(node: Sum) -> list[IndexGather]:
    """Returns the entries of index arrays in the body of a sum."""
    return list(dict.fromkeys(g for n in postorder([node.body]) for g in index_leaves(integers_of(n)) if isinstance(g, IndexGather)))


def _entry(gather: IndexGather, index: IndexVar) -> Entry | None:
    """Returns an entry that an index alone chooses; None if there is more to it."""
    if gather.children.count(index) != 1 or not all(c is index or isinstance(c, IndexConst) for c in gather.children):
        return None
    return Entry(gather.array, tuple(None if c is index else int(c.data) for c in gather.children))
