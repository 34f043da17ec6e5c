"""Makes a failing program smaller: a part in place of a node, simpler numbers, no law; as long as it still fails in the same way."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from tests.fuzz.syntax import CONDITIONS, Program, Term, size, term, walk

Fails = Callable[[Program], bool]


def minimised(program: Program, fails: Fails, seconds: float = 120.0) -> Program:
    """The smallest program that was met on the way down and `fails`."""
    deadline = time.monotonic() + seconds
    best = program
    shrunk = True
    while shrunk and time.monotonic() < deadline:
        shrunk = False
        for candidate in candidates(best):
            if time.monotonic() > deadline:
                break
            if _weight(candidate) < _weight(best) and _is_whole(candidate.tree) and fails(candidate):
                best, shrunk = candidate, True
                break
    return best


def _weight(program: Program) -> tuple[int, int, int]:
    """What is to become small: nodes, parameters, digits."""
    digits = sum(len(f"{n.data:g}") for n in walk(program.tree) if n.op == "number")
    digits += sum(len(str(v)) for v in program.values.values())
    return size(program.tree) + 3 * bool(program.law), len(program.values), digits


def _is_whole(tree: Term, bound: frozenset[str] = frozenset()) -> bool:
    """Whether every variable stands in its integral, and one integral at least is left."""
    return _closed(tree, bound) and any(n.op == "integral" for n in walk(tree))


def _closed(node: Term, bound: frozenset[str]) -> bool:
    if node.op == "variable":
        return node.data in bound
    if node.op == "entry":
        return not isinstance(node.data[1], str) or "#" + node.data[1] in bound
    if node.op == "integral":
        return _closed(node.parts[0], bound | {node.data}) and all(_closed(p, bound) for p in node.parts[1:])
    if node.op == "sum":
        return _closed(node.parts[0], bound | {"#" + node.data[0]})
    return all(_closed(p, bound) for p in node.parts)


def candidates(program: Program) -> Iterator[Program]:
    """Smaller programs, the boldest first."""
    if program.law:
        yield replace(program, law="")
    places = sorted(_places(program.tree), key=lambda path: len(path))
    for path in places:
        node = _at(program.tree, path)
        for other in _simpler(node):
            yield program.with_tree(_with(program.tree, path, other))
    for name, value in program.values.items():
        if isinstance(value, float):
            for digits in (1, 2):
                yield replace(program, values={**program.values, name: float(f"{value:.{digits}g}")})


def _simpler(node: Term) -> Iterator[Term]:
    """What may stand in place of a node: parts of it of its kind, and simple numbers."""
    is_condition = node.op in CONDITIONS
    for part in node.parts:
        if (part.op in CONDITIONS) == is_condition:
            yield part
    if is_condition or node.op in ("integral",):
        return
    if node.op == "number":
        for digits in (1, 2):
            yield term(float(f"{node.data:.{digits}g}"))
    for value in (0.0, 1.0, 2.0, 0.5):
        if node != term(value):
            yield term(value)


def _places(tree: Term) -> list[tuple[int, ...]]:
    found: list[tuple[int, ...]] = []
    stack: list[tuple[tuple[int, ...], Term]] = [((), tree)]
    while stack:
        path, node = stack.pop()
        found.append(path)
        stack.extend(((*path, k), part) for k, part in enumerate(node.parts))
    return found


def _at(tree: Term, path: tuple[int, ...]) -> Term:
    for k in path:
        tree = tree.parts[k]
    return tree


def _with(tree: Term, path: tuple[int, ...], new: Term) -> Term:
    if not path:
        return new
    k, *others = path
    parts = list(tree.parts)
    parts[k] = _with(parts[k], tuple(others), new)
    return replace(tree, parts=tuple(parts))
