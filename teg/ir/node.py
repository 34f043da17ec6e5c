"""Nodes: immutable, interned, with their free variables. This file knows no mathematics.

Equal nodes are one object, so `==` and `hash` are identity and a node is a good dictionary key. The table that interns them holds weak
references only, so unused nodes are freed. Every traversal is iterative, so expressions may be 100 000 nodes deep.

Each class of nodes has a bit, and a node knows the bits of all nodes below: what does not occur in an expression is not looked for.
"""

from __future__ import annotations

import hashlib
import itertools
import threading
import weakref
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator
from typing import Any, ClassVar, TypeVar

N = TypeVar("N", bound="Node")
_NO_NAMES: frozenset[Any] = frozenset()
_DELTA, _INTEGRAL = 1, 2
_bits = itertools.count(2)


def new_bit() -> int:
    """Returns a bit for a kind of nodes."""
    return 1 << next(_bits)


class Node:
    """A class, some data (hashable, not a node unless it is a binder's variable) and children."""

    __slots__ = ("__weakref__", "_digest", "_residue", "children", "data", "free", "has_delta", "has_integral", "kinds")

    _digest: int | None
    _residue: int | None  # of an expression, in a finite field (`teg.analysis.polynomial`), once it was asked for
    children: tuple[Node, ...]
    data: Any
    free: frozenset[Any]  # the variables of integration that occur free
    has_delta: bool
    has_integral: bool
    kinds: int  # the bits of the classes of all nodes below, its own included
    is_delta = False  # overridden in a class: then set on every node that contains a node of that class
    is_integral = False
    bit: ClassVar[int] = 0  # of the class and those derived from it
    own_kinds: ClassVar[int] = 0  # the bits of the class and its bases

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.bit = new_bit()
        cls.own_kinds = cls.bit | _DELTA * cls.is_delta | _INTEGRAL * cls.is_integral
        for base in cls.__bases__:
            cls.own_kinds |= getattr(base, "own_kinds", 0)

    @classmethod
    def make(cls: type[N], data: Hashable, children: tuple[Node, ...]) -> N:
        """Returns the one node of this class with this data and these children."""
        key = (cls, data, children)
        entry = _table.get(key)
        node = None if entry is None else entry()
        return _interned(key) if node is None else node  # type: ignore[return-value]

    def _free_variables(self) -> frozenset[Any]:
        free = _NO_NAMES
        for c in self.children:
            if c.free is not free and not c.free <= free:
                free = c.free if free <= c.free else free | c.free
        return free

    def _own_kinds(self) -> int:
        """Returns the bits of this node alone."""
        return self.own_kinds

    def __copy__(self: N) -> N:
        return self

    def __deepcopy__(self: N, memo: object) -> N:
        return self

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"an expression is immutable: cannot set {name!r}")

    def __reduce__(self) -> tuple[object, ...]:
        order = postorder([self])
        number = {node: i for i, node in enumerate(order)}
        return (_rebuild, ([(type(n), n.data, tuple(number[c] for c in n.children)) for n in order],))


_new = object.__new__
_set_data, _set_children, _set_free, _set_kinds, _set_has_delta, _set_has_integral, _set_digest, _set_residue = (
    vars(Node)[name].__set__ for name in ("data", "children", "free", "kinds", "has_delta", "has_integral", "_digest", "_residue")
)
"""What sets the slots of a new node: `object.__setattr__` would look for each of them by its name."""


class _Entry(weakref.ref[Node]):
    """A weak reference that knows the key of its node."""

    __slots__ = ("key",)

    key: tuple[type[Node], Any, tuple[Node, ...]]


_table: dict[tuple[type[Node], Any, tuple[Node, ...]], _Entry] = {}
_lock = threading.RLock()


def _interned(key: tuple[type[Node], Any, tuple[Node, ...]]) -> Node:
    """Returns the one node of a key, made if there is none."""
    with _lock:
        entry = _table.get(key)
        node = None if entry is None else entry()
        if node is None:
            cls, data, children = key
            node = _new(cls)
            _set_data(node, data)
            _set_children(node, children)
            _set_digest(node, None)
            _set_free(node, node._free_variables())
            kinds = node._own_kinds()
            for c in children:
                kinds |= c.kinds
            _set_kinds(node, kinds)
            _set_has_delta(node, kinds & _DELTA != 0)
            _set_has_integral(node, kinds & _INTEGRAL != 0)
            _table[key] = entry = _Entry(node, _forget)
            entry.key = key
    return node


def _forget(entry: _Entry, table: dict[Any, _Entry] = _table, lock: threading.RLock = _lock) -> None:
    """Removes a dead node from the table, unless its key has another one by now. Works while Python shuts down, without globals."""
    with lock:
        found = table.pop(entry.key, entry)
        if found is not entry:
            table[entry.key] = found


def union(sets: list[frozenset[Any]]) -> frozenset[Any]:
    """Returns the union; one of the given sets if it is equal to the union (chains of nodes then share one set)."""
    largest = _NO_NAMES
    for names in sets:
        if len(names) > len(largest):
            largest = names
    for names in sets:
        if names is not largest and not names <= largest:
            largest = largest | names
    return largest


def postorder(roots: Iterable[Node]) -> list[Node]:
    """Returns every node below the roots once, children before parents (a binder's variable is data, not a child)."""
    order: list[Node] = []
    seen: set[Node] = set()
    path: list[Node] = []  # from a root to the current node
    unvisited: list[Iterator[Node]] = []  # the nodes still to visit, for each node on the path and for the roots
    waiting = iter(roots)
    while True:
        for node in waiting:
            if node not in seen:
                seen.add(node)
                if node.children:
                    path.append(node)
                    unvisited.append(waiting)
                    waiting = iter(node.children)
                    break
                order.append(node)
        else:
            if not unvisited:
                return order
            order.append(path.pop())
            waiting = unvisited.pop()


def postorder_to(roots: Iterable[Node], kinds: int) -> list[Node]:
    """Returns the nodes below the roots that hold a node of these kinds, children before parents. No other part of a program is visited."""
    order: list[Node] = []
    seen: set[Node] = set()
    path: list[Node] = []
    unvisited: list[Iterator[Node]] = []
    waiting = iter(roots)
    while True:
        for node in waiting:
            if node.kinds & kinds and node not in seen:
                seen.add(node)
                path.append(node)
                unvisited.append(waiting)
                waiting = iter(node.children)
                break
        else:
            if not unvisited:
                return order
            order.append(path.pop())
            waiting = unvisited.pop()


def nodes_of(cls: type[N], *roots: Node) -> list[N]:
    """Returns the nodes of a class below the roots, once, children before parents. What holds none of them is not visited."""
    return [n for n in postorder_to(roots, cls.bit) if isinstance(n, cls)]


def postorder_through(
    root: Node, variables: Collection[Node], below: Callable[[Node], Iterable[Node]] = lambda node: node.children
) -> list[Node]:
    """Returns the nodes below the root in which one of these variables occurs free, children before parents.

    No other part of a program is visited. `below` returns the children of a node to look at.
    """
    order: list[Node] = []
    seen: set[Node] = set()
    path: list[Node] = []
    unvisited: list[Iterator[Node]] = []
    waiting = iter((root,))
    while True:
        for node in waiting:
            if node not in seen and not node.free.isdisjoint(variables):
                seen.add(node)
                path.append(node)
                unvisited.append(waiting)
                waiting = iter(below(node))
                break
        else:
            if not unvisited:
                return order
            order.append(path.pop())
            waiting = unvisited.pop()


def digest(node: Node) -> int:
    """Returns a 64-bit number that depends on the structure only: the same in every process."""
    if node._digest is None:
        for n in postorder([node]):
            if n._digest is None:
                data = n.data
                text = f"{type(n).__name__}|{_stable(data)}|"
                h = hashlib.blake2b(text.encode(), digest_size=8)
                for c in n.children:
                    h.update((c._digest or 0).to_bytes(8, "little"))
                _set_digest(n, int.from_bytes(h.digest(), "little"))
    return node._digest or 0


def kept_residue(node: N, compute: Callable[[N], int | None]) -> int | None:
    """Returns the residue of a node, which depends on its structure only; it is computed once."""
    try:
        return node._residue
    except AttributeError:
        found = compute(node)
        _set_residue(node, found)
        return found


def _stable(data: Any) -> str:
    """Returns a text of a node's data that is the same in every process."""
    if isinstance(data, Node):
        return str(digest(data))
    if isinstance(data, tuple) and any(isinstance(d, Node | tuple) for d in data):
        return f"({','.join(map(_stable, data))})"
    return repr(data)


def _rebuild(rows: list[tuple[type[Node], Any, tuple[int, ...]]]) -> Node:
    nodes: list[Node] = []
    for cls, data, children in rows:
        nodes.append(cls.make(data, tuple(nodes[i] for i in children)))
    return nodes[-1]
