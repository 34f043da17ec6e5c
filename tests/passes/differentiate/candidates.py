"""Variables, rows of data and boxes of programs whose candidates are followed along their edges."""

from __future__ import annotations

from typing import Any

import teg

x, y = teg.vars("x y")
t = teg.param("t")
D = teg.array("D", 2)
k, p = teg.index("k"), teg.index("p")
BOX = ((x, 0, 1), (y, 0, 1))
ALL = (k, 0, teg.length(D, 0))
BACKENDS = ["c", "numpy"]


def follows_edges(f: Any) -> bool:
    """Whether values and first derivatives of an evaluator are computed along edges."""
    return f._lengths.any is not None and f._lengths.any.plan.follows_edges
