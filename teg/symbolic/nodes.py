"""SymPy's nodes: constructed without evaluation, visited once each. The only importer of SymPy, which is imported when first needed.

SymPy's constructors, printers and == traverse all of an expression written out. Nothing here does: both directions of the conversion
(`teg.symbolic.writer`, `teg.symbolic.reader`) cost one step a node, however often it is shared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, cast

from teg.errors import MissingPackageError


@cache
def sympy_package() -> Any:
    """Returns the module sympy. Raises MissingPackageError if it is not installed."""
    try:
        import sympy
    except ImportError as error:
        raise MissingPackageError("SymPy is not installed", None, 'pip install "teg-compiler[symbolic]"') from error
    return sympy


def as_it_is(kind: Any, *parts: Any) -> Any:
    """Returns a SymPy node with exactly these parts. Its hash is computed, and kept by SymPy: hashing a node above it is then not deep."""
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
    """Returns every node of a SymPy expression once, parts first. Each node is checked before its parts are visited.

    Nodes are compared by identity, because SymPy's == compares whole expressions.
    """
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
    """Returns the parts of a SymPy node; those of an integral are the integrand, then its bounds."""
    sympy = sympy_package()
    if type(node) is sympy.Integral:
        return [node.args[0], *(bound for limit in node.args[1:] for bound in limit.args[1:])]
    if type(node) is sympy.Piecewise:
        return [part for pair in node.args for part in pair.args]
    return cast("Sequence[Any]", node.args)


def shown(node: Any) -> object:
    """Returns the expression, or its class if printing it would be long or deep: SymPy writes shared parts out."""
    stack, count = [(node, 0)], 0
    while stack:
        n, depth = stack.pop()
        count += 1
        if count > 300 or depth > 50:
            return f"{type(node).__name__}(…)"
        stack.extend((a, depth + 1) for a in getattr(n, "args", ()))
    return node
