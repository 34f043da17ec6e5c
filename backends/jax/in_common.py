"""Searches that the flags of an integral have in common with its body: `in_common` finds them, for XLA to compile them once.

    flags(m): r = roots of g(m, ·); f = φ(r)      body(x): s = roots of g(x, ·); v = ψ(s, f)
        →        common(x): r = roots of g(x, ·)      flags(m, r)      body(x, s, f)

Flags are computed in the middle of a piece, and the body at its nodes. The middle is one more node then, at which the common part is
computed together with those of the body. Only integrals whose places do not depend on flags have such parts: none with bends, a guard, or
a need that is not known.

The body may read flags in the search too. Those that need no search are computed in the middle first, and are the same at all nodes:

    flags(m): c = γ(m); r = roots of g(m, c, ·)      body(x): s = roots of g(x, c, ·)
        →        early(m): c = γ(m)      common(x, c): r = roots of g(x, c, ·)
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple

from teg.program import Adaptive, Assign, Integrate, Isolate, Locate, assigned, free_names, statements
from teg.program.fields import operands, renamed, variables
from teg.program.walk import free_in

LOOPS = (Isolate, Locate)


class Common(NamedTuple):
    """The common statements, by their names in the flags, and the other ones of the flags and of the body.

    The common values that these read are `names` in the flags, and `names_in_body` in the body, which reads those `flagged` too. The common
    statements read the flags `known`, which the statements `early` compute.
    """

    block: tuple[Any, ...]
    names: tuple[str, ...]
    flags: tuple[Any, ...]
    flagged: tuple[str, ...]
    names_in_body: tuple[str, ...]
    body: tuple[Any, ...]
    early: tuple[Any, ...] = ()
    known: tuple[str, ...] = ()


def in_common(stmt: Integrate) -> Common | None:
    """Returns the parts of an integral whose flags and body have a loop in common, or None."""
    if stmt.bends or stmt.guard is not None or stmt.need is not None:
        return None
    if not all(any(map(_has_loop, block)) for block in (stmt.flags, stmt.body)):
        return None
    numbers: dict[Any, int] = {}
    shared = _early(stmt.flags, set(free_in(stmt.body)))
    flags, body = _numbered(stmt.flags, numbers, shared), _numbered(stmt.body, numbers)
    of_body = dict(zip(body, stmt.body, strict=True))
    loops = {number for number, s in zip(flags, stmt.flags, strict=True) if number in of_body and _has_loop(s)}
    if not loops:
        return None
    needed: set[str] = set()
    common: set[int] = set()
    for number, s in reversed(list(zip(flags, stmt.flags, strict=True))):
        if number in loops or not needed.difference(shared).isdisjoint(assigned(s)):
            common.add(number)
            needed.update(free_names(s))
    block = tuple(s for number, s in zip(flags, stmt.flags, strict=True) if number in common)
    pairs = [pair for number, s in zip(flags, stmt.flags, strict=True) if number in common for pair in _pairs(s, of_body[number])]
    others = [
        tuple(s for number, s in zip(own, block, strict=True) if number not in common)
        for own, block in ((flags, stmt.flags), (body, stmt.body))
    ]
    results = {a for a in operands(stmt) if isinstance(a, str)}
    in_flags, in_body = ({*free_in(block), *results} for block in others)
    flagged = tuple(name for s in stmt.flags for name in assigned(s) if name in in_body)
    pairs = [(a, b) for a, b in pairs if a in in_flags or a in in_body or b in in_body]
    known = tuple(name for name in free_in(block) if name in shared)
    names = tuple(a for a, _ in pairs), tuple(b for _, b in pairs)
    return Common(block, names[0], others[0], flagged, names[1], others[1], _needed_for(stmt.flags, known), known)


def _early(flags: Sequence[Any], read: set[str]) -> set[str]:
    """Returns the flags that are `read` by the body and computed without a loop."""
    late: set[str] = set()
    for s in flags:
        if _has_loop(s) or not late.isdisjoint(free_names(s)):
            late.update(assigned(s))
    return {name for s in flags for name in assigned(s) if name in read and name not in late}


def _needed_for(block: Sequence[Any], names: Sequence[str]) -> tuple[Any, ...]:
    """Returns the statements of a block that compute some names."""
    needed, kept = set(names), []
    for s in reversed(block):
        if not needed.isdisjoint(assigned(s)):
            kept.append(s)
            needed.update(free_names(s))
    return tuple(kept[::-1])


def _pairs(one: Any, other: Any) -> Iterator[tuple[str, str]]:
    """Yields the names of the same values in two statements."""
    yield from zip(assigned(one), assigned(other), strict=True)


def _has_loop(stmt: Any) -> bool:
    return any(isinstance(s, LOOPS) or isinstance(getattr(s, "rule", None), Adaptive) for s in statements((stmt,)))


def _numbered(block: Sequence[Any], numbers: dict[Any, int], shared: Collection[str] = ()) -> list[int]:
    """Returns a number for each statement of a block, the same for statements that compute the same in other names than those `shared`."""
    known: dict[str, str] = {}
    own = []
    for stmt in block:
        number = numbers.setdefault(_key(stmt, known), len(numbers))
        own.append(number)
        known.update((name, f"#{number}.{i}") for i, name in enumerate(assigned(stmt)) if name not in shared)
    return own


def _key(stmt: Any, known: dict[str, str]) -> str:
    """Returns the text of a statement with names that do not depend on those inside of it; those in `known` have others."""
    if isinstance(stmt, Assign):
        return repr((stmt.op, *(known.get(a, a) if isinstance(a, str) else a for a in stmt.args)))
    inside = [n for s in statements((stmt,)) for n in (*variables(s), *assigned(s))]
    names = known | {name: f"#{i}" for i, name in enumerate(dict.fromkeys(inside))}
    return repr(renamed(stmt, names))
