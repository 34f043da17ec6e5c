"""The order in which users made parameters and arrays: that of positional arguments where no list says another.

A name stands for one object (`teg.param("t")` twice is one parameter), so the order is that of the first time, as long as a later time does
not say another order. Where two orders were used, or where an object was not made by a user (it was read from a file), there is none.
"""

from __future__ import annotations

import itertools
import threading
import weakref
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeVar

from teg.ir.node import Node

N = TypeVar("N", bound=Node)


class Times(NamedTuple):
    """The numbers of the first and of the latest call that made a node."""

    first: int
    latest: int


_times: weakref.WeakKeyDictionary[Node, Times] = weakref.WeakKeyDictionary()
_numbers = itertools.count()
_lock = threading.Lock()


def created(node: N) -> N:
    """Returns the node, after noting that a user has made it."""
    with _lock:
        now = next(_numbers)
        known = _times.get(node)
        _times[node] = Times(known.first if known else now, now)
    return node


def in_order_of_creation(nodes: Iterable[N]) -> list[N]:
    """Returns the nodes in the order in which they were first made; those not made by a user follow, in the given order."""
    listed = list(dict.fromkeys(nodes))
    return sorted(listed, key=lambda node: (node not in _times, _times[node].first if node in _times else 0))


def is_order_certain(nodes: Sequence[Node]) -> bool:
    """Returns whether users have made the nodes in this order, and never in another one."""
    if len(nodes) < 2:
        return True
    times = [_times.get(node) for node in nodes]
    return all(a is not None and b is not None and a.first < b.first and a.latest < b.latest for a, b in itertools.pairwise(times))


def is_created(name: str) -> bool:
    """Returns whether a user has made a parameter or an array of this name, and still has it."""
    return any(getattr(node, "name", None) == name for node in list(_times))
