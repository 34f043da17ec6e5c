"""Products 0·∞ whose limit is 0: exp(-1/u²)/u⁴ where u is 0 or nearly so.

The exponential is 0 there long before the power is infinite, so a product is its vanishing factor wherever that is 0. Derivatives of
smooth bumps, exp(-1/(1 - x²)) on |x| < 1, are such products beside the bump's border. Linear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

from teg.analysis.limits import falls
from teg.ir.expr import Add, Call, Expr, Mul, Pow, Where
from teg.ir.node import Node
from teg.ir.simplify import mul


class Vanishing:
    """Finds the factors that vanish where others are infinite. Facts of nodes are kept."""

    def __init__(self) -> None:
        self._poles: dict[Node, bool] = {}
        self._fallen: dict[Node, bool] = {}

    def of(self, e: Mul) -> Expr | None:
        """Returns the product of the factors of e that may vanish faster than others grow; None if there are none."""
        small = [f for f in e.children if _holds(f, self._decays, self._fallen)]
        others = [f for f in e.children if f not in small or len(small) > 1]
        return mul(*small) if small and any(map(self._has_pole, others)) else None

    def _decays(self, node: Expr) -> bool:
        """Returns whether a node is an exponential of what tends to -∞ at a pole."""
        return isinstance(node, Call) and node.name == "exp" and falls(node.children[0], _is_pole, self._has_pole)

    def _has_pole(self, e: Expr) -> bool:
        return _holds(e, _is_pole, self._poles)


def _holds(root: Expr, test: Callable[[Expr], bool], known: dict[Node, bool]) -> bool:
    """Returns whether a node that passes the test stands in the sums, products and branches of an expression."""
    stack = [root]
    while stack:
        node = stack[-1]
        inside = _parts(node)
        missing = [c for c in inside if c not in known]
        if node not in known and missing:
            stack.extend(missing)
            continue
        known.setdefault(node, test(node) or any([known[c] for c in inside]))
        stack.pop()
    return known[root]


def _parts(node: Expr) -> Sequence[Expr]:
    inside = node.children[1:] if isinstance(node, Where) else node.children if isinstance(node, Add | Mul | Pow) else ()
    return cast("Sequence[Expr]", inside)


def _is_pole(node: Expr) -> bool:
    """Returns whether a node is a negative power of what depends on variables."""
    return isinstance(node, Pow) and node.exponent < 0 and bool(node.free)
