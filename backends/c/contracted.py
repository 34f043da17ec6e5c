"""Products in sums as one operation, x·y + z rounded once, where no decision depends on the last bit.

    contracted(block, kept, decisive)  ->  the block, in which a sum of products is a chain of such operations

Conditions compare numbers whose rounding errors are known, some of them with 0 exactly; what they are computed from is left as it is
(`decisive`). So are differences, of which the one of equal products must be 0. Where a machine has no such operation, `teg_fma` is a
product and a sum.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Sequence

from teg.backends.c.crossing import LARGEST
from teg.backends.c.items import Item, Nodes, defines, reads
from teg.program import Arg, Assign

COMPARISONS = {"gt0", "ge0", "lt0", "le0", "ok"}


def decisive(items: Sequence[Item]) -> set[Arg]:
    """Returns the values that conditions depend on, but for the condition that numbers are finite."""
    made = {name: item for item in items for name in defines(item)}
    found: set[Arg] = set()
    for item in items:
        body = item.body if isinstance(item, Nodes) else (item,)
        waiting = [a for s in body if s.op in COMPARISONS and not _is_finiteness(s, made) for a in s.args]
        if isinstance(item, Nodes) and waiting:
            waiting.append(item.sums[0])  # what is compared at nodes
        while waiting:
            name = waiting.pop()
            if name in found or not isinstance(name, str):
                continue
            found.add(name)
            if (maker := made.get(name)) is not None:
                found.update(defines(maker))
                waiting += reads(maker)
                if isinstance(maker, Nodes):
                    found.update(s.name for s in maker.body)
    return found


def _is_finiteness(s: Assign, made: dict[str, Item]) -> bool:
    """Returns whether a comparison asks whether the size of a number is at most the largest one."""
    size = made.get(str(s.args[0]))
    return s.op == "le0" and isinstance(size, Assign) and size.op == "sub" and size.args[1] == LARGEST


def contracted(block: Sequence[Assign], kept: Container[Arg], exact: Container[Arg]) -> list[Assign]:
    """Returns a block with the same values but for their rounding; names in `kept` are read elsewhere, those in `exact` are left alone."""
    uses = Counter(a for s in block for a in s.args)
    made: dict[Arg, Assign] = {s.name: s for s in block}

    def product(arg: Arg) -> Assign | None:
        """Returns a product that only one sum reads."""
        s = made.get(arg)
        alone = s is not None and uses[arg] == 1 and arg not in kept and arg not in exact
        return s if s is not None and alone and s.op == "mul" and len(s.args) > 1 else None

    def is_negated(arg: Arg) -> bool:
        s = made.get(arg)
        return s is not None and s.op == "neg"

    gone: set[Arg] = set()
    lines: dict[str, list[Assign]] = {}
    for s in block:
        if s.op != "add" or s.name in exact or any(map(is_negated, s.args)):
            continue
        products = [p for arg in s.args if (p := product(arg)) is not None]
        if products and len(products) + any(product(a) is None for a in s.args) > 1:
            lines[s.name] = list(_chain(s, products))
            gone.update(p.name for p in products)
    return [line for s in block if s.name not in gone for line in lines.get(s.name, [s])]


def _chain(s: Assign, products: Sequence[Assign]) -> Iterable[Assign]:
    """Yields the operations of a sum of these products and other terms."""
    names: dict[Arg, Assign] = {p.name: p for p in products}
    plain = [arg for arg in s.args if arg not in names]
    factors = [names[arg] for arg in s.args if arg in names]
    made: list[Assign] = []

    def put(op: str, *args: Arg) -> Arg:
        made.append(Assign(f"{s.name}s{len(made)}", op, args))
        return made[-1].name

    def pair(p: Assign) -> tuple[Arg, Arg]:
        return (p.args[0] if len(p.args) == 2 else put("mul", *p.args[:-1])), p.args[-1]

    if plain:
        total = plain[0] if len(plain) == 1 else put("add", *plain)
    else:
        first, *factors = factors
        total = put("mul", *first.args)
    for p in factors:
        total = put("fma", *pair(p), total)
    *before, last = made
    yield from before
    yield Assign(s.name, last.op, last.args)
