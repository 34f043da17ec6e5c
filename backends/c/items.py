"""What a straight line consists of: assignments, and sums over nodes of a rule.

reads(item), defines(item)  ->  names
needed(items, wanted)       ->  the items that the wanted names depend on
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from teg.program import Arg, Assign


@dataclass(frozen=True, slots=True)
class Nodes:
    """sums = Σ over nodes of weight·value; `places` are the coordinates of a node by their names."""

    places: dict[str, tuple[float, ...]]
    weights: tuple[Arg, ...]
    body: tuple[Assign, ...]
    values: tuple[Arg, ...]
    sums: tuple[str, ...]

    @property
    def reads(self) -> set[Arg]:
        """Returns the names that are computed before."""
        own = {s.name for s in self.body} | set(self.places)
        return ({a for s in self.body for a in s.args} | set(self.values) | set(self.weights)) - own


Item = Assign | Nodes


def reads(item: Item) -> set[Arg]:
    """Returns the names that an item reads."""
    return set(item.args) if isinstance(item, Assign) else item.reads


def defines(item: Item) -> tuple[str, ...]:
    """Returns the names that an item gives."""
    return (item.name,) if isinstance(item, Assign) else item.sums


def needed(items: Sequence[Item], wanted: Iterable[Arg]) -> list[Item]:
    """Returns the items that the wanted names depend on."""
    live: set[Arg] = set(wanted)
    kept: list[Item] = []
    for item in reversed(items):
        if isinstance(item, Nodes):
            pairs = [(v, s) for v, s in zip(item.values, item.sums, strict=True) if s in live]
            if not pairs:
                continue
            body = [s for s in needed(item.body, [v for v, _ in pairs]) if isinstance(s, Assign)]
            values = tuple(v for v, _ in pairs)
            read = {a for s in body for a in s.args}.union(values)
            places = {x: at for x, at in item.places.items() if x in read}
            item = replace(item, places=places, body=tuple(body), values=values, sums=tuple(s for _, s in pairs))
        elif item.name not in live:
            continue
        live |= reads(item)
        kept.append(item)
    return kept[::-1]
