"""SymPy's nodes: made as they are, walked once each. The only importer of SymPy, which is imported when first needed.

SymPy's constructors look at all of an expression written out, and so do its printers and its ==. Nothing here does: both directions of the
conversion (`sympy_writer`, `sympy_reader`) cost one step a node, however often it is shared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, cast

from teg.errors import MissingPackageError


@cache
def sympy_package() -> Any:
    """SymPy; raises MissingPackageError where it is not installed."""
    try:
        import sympy
    except ImportError as error:
        raise MissingPackageError("SymPy is not installed", None, 'pip install "teg[symbolic]"') from error
    return sympy


def as_it_is(kind: Any, *parts: Any) -> Any:
    """A SymPy node with these parts and no others. It is hashed, and SymPy remembers that: hashing what holds it is not deep then."""
    sympy = sympy_package()
    node = sympy.Basic.__new__(kind, *parts)
    if issubclass(kind, sympy.Add | sympy.Mul | sympy.Pow | sympy.Integral):
        node.is_commutative = True
    elif issubclass(kind, sympy.And | sympy.Or | sympy.Min | sympy.Max):
        node._argset = frozenset(parts)
    elif isinstance(node, sympy.Expr):
        _ = node.is_commutative  # SymPy remembers this as well
    hash(node)
    return node


def in_postorder(root: Any, check: Callable[[Any], None]) -> list[Any]:
    """Every node of a SymPy expression once (by identity, for SymPy's == compares all of both), parts first. Each is
    checked before its parts are looked at."""
    order: list[Any] = []
    done: set[int] = set()
    opened: set[int] = set()
    stack = [root]
    while stack:
        node = stack[-1]
        if id(node) in done:
            stack.pop()
        elif id(node) in opened:
            done.add(id(node))
            order.append(node)
            stack.pop()
        else:
            opened.add(id(node))
            check(node)
            stack.extend([part for part in reversed(parts_of(node)) if id(part) not in done])
    return order


def parts_of(node: Any) -> Sequence[Any]:
    """What a SymPy node is made of; of an integral the integrand, then its bounds."""
    sympy = sympy_package()
    if type(node) is sympy.Integral:
        return [node.args[0], *(bound for limit in node.args[1:] for bound in limit.args[1:])]
    if type(node) is sympy.Piecewise:
        return [part for pair in node.args for part in pair.args]
    return cast("Sequence[Any]", node.args)


def shown(node: Any) -> object:
    """The expression, or its class where printing it would be long or deep: SymPy writes out what is shared."""
    stack, count = [(node, 0)], 0
    while stack:
        n, depth = stack.pop()
        count += 1
        if count > 300 or depth > 50:
            return f"{type(node).__name__}(…)"
        stack.extend((a, depth + 1) for a in getattr(n, "args", ()))
    return node
