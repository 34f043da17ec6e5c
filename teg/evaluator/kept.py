"""Tables with a bounded number of entries: what was made for the latest keys."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from typing import Generic, TypeVar

KEPT = 64
"""The largest number of entries, unless another one is given: of the programs that a derivation keeps, for instance. The oldest is dropped,
and made again when it is needed."""
K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Kept(Generic[K, V]):
    """A table of the latest entries, at most `most` of them. Safe to share between threads."""

    def __init__(self, most: int = KEPT) -> None:
        self._most = most
        self._table: dict[K, V] = {}
        self._lock = threading.RLock()

    def get(self, key: K, make: Callable[[], V]) -> V:
        """Returns the entry of a key, made if it is missing; the oldest entries are dropped."""
        found = self._table.get(key)
        if found is not None:
            return found
        with self._lock:
            if key not in self._table:
                self._table[key] = make()
                while len(self._table) > self._most:
                    del self._table[next(iter(self._table))]
            return self._table[key]

    def peek(self, key: K, default: V) -> V:
        """Returns the entry of a key, or the default."""
        return self._table.get(key, default)

    def put(self, key: K, value: V) -> None:
        """Replaces an entry."""
        with self._lock:
            self._table.pop(key, None)
            self.get(key, lambda: value)

    def __contains__(self, key: K) -> bool:
        return key in self._table

    def first(self) -> V | None:
        """Returns the oldest entry, or None."""
        return next(iter(self._table.values()), None)

    def __iter__(self) -> Iterator[K]:
        return iter(list(self._table))

    def drop(self, key: K) -> None:
        """Drops an entry, if there is one."""
        with self._lock:
            self._table.pop(key, None)
