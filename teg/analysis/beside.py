"""An expression beside a surface, where what is 0 on the surface is known to be 0.

At a root of g by formula, rounding leaves a little of g, and bounds over a box of roots know nothing of it: √g is NaN or 1e-8 there, and
whether g > 0 is not decided.
"""

from __future__ import annotations

import math
from typing import cast

from teg.analysis.evaluate import values_of
from teg.analysis.singularities import Keys
from teg.ir.expr import FALSE, TRUE, ZERO, Compare, Expr, Param, Var
from teg.ir.node import Node, postorder
from teg.ir.simplify import mul
from teg.ir.traverse import rewrite_below

PLACE = 0.7368062997280773
"""Where the sign of a constant factor is looked at: no place of anything else."""


def beside(node: Expr, x: Var, g: Expr) -> list[Expr]:
    """Returns a node beside a surface on both sides, or once where they are equal: with 0 for what is proportional to g, as rounding and
    bounds over a box do not know, and with that in conditions which holds on the side."""
    keys = Keys()
    inside = [n for n in postorder([node]) if isinstance(n, Expr) and x in n.free and not n.has_integral]
    null = {n for n in inside if keys.of(n) == keys.of(g)} if not g.has_integral else set()
    if not null or node in null:
        return [node]
    known = {n: _direction(n, g) for n in null}
    sides = [1.0, -1.0] if any(isinstance(n, Compare) and n.g in null for n in postorder([node])) else [1.0]

    def on(side: float) -> Expr:
        def visit(n: Node) -> Node | None:
            if isinstance(n, Compare) and known.get(n.g):
                return TRUE if known[n.g] * side > 0.0 else FALSE
            return ZERO if n in null else None

        return cast(Expr, rewrite_below([node], visit)[node])

    return list(dict.fromkeys(on(side) for side in sides))


def _direction(e: Expr, g: Expr) -> float:
    """Returns the sign of the constant factor between two proportional expressions; 0 if it is not known."""
    product = mul(e, g)
    symbols = [n for n in postorder([product]) if isinstance(n, Var | Param)]
    (value,) = values_of([product], {n: PLACE / (k + 1.0) for k, n in enumerate(symbols)})
    return float(value) if math.isfinite(value) else 0.0
