"""Variables, rows of data and boxes of programs whose candidates are followed along their edges."""

from __future__ import annotations

from typing import Any

import teg
from teg.evaluator.wanted import derivative_of_order

x, y = teg.vars("x y")
t = teg.param("t")
D = teg.array("D", 2)
k, p = teg.index("k"), teg.index("p")
BOX = ((x, 0, 1), (y, 0, 1))
ALL = (k, 0, teg.length(D, 0))
BACKENDS = ["c", "numpy"]


def follows_edges(f: Any, order: int = 1) -> bool:
    """Whether values and derivatives up to an order of an evaluator are computed along edges."""
    plan = f._lengths.any and f._lengths.any.plan
    return bool(plan) and plan.follows_edges and (order < 2 or not plan.needs_lengths(derivative_of_order(1, f.wrt)))
