"""Floors and their kin of parameters: the values at which they step."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, cast

from teg.analysis.calculus import slope
from teg.errors import NotDifferentiableError
from teg.ir.expr import ZERO, Call, Const, Expr, Param, Var, const
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.ir.simplify import add, call
from teg.ir.traverse import substitute

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]


PLACES = (0.3719281, 0.6180339, 0.1415926, 0.8662514, 0.5257311)
"""Coordinates of places on which a surface does not lie unless it is everything."""
STEPS = ("floor", "ceil", "round", "mod")


def steps_of_parameters(e: Expr) -> list[tuple[str, Expr]]:
    """Returns floors and their kin of parameters alone, as users write them: a text for their steps, and a function that is 0 there."""
    found: list[tuple[str, Expr]] = []
    for node in postorder([e]):
        if isinstance(node, Call) and node.name in STEPS and not node.free and parameters_in(node):
            u = node.children[0] if node.name != "mod" else node.children[0] / node.children[1]
            if node.name == "round":
                u = u + 0.5
            if only_in_steps(u):  # it changes where the inner steps do
                continue
            found.append((f"a step of {show(node, 300)}", u - call("floor", u + 0.5)))
    return found


def vanishing(g: Expr) -> Expr | None:
    """Returns an expression of parameters that is 0 where a surface is all of the integrals over its variables, as a·x + b = 0 is at
    a = b = 0: a sum of sizes at places without an order. None if it never is."""
    variables = sorted((v for v in g.free if isinstance(v, Var)), key=lambda v: v.name)
    if not variables or g.has_integral or g.has_delta or any(isinstance(s, Const) and s is not ZERO for s in _slopes(g, variables)):
        return None
    at = [{v: const(PLACES[(k + 2 * i) % len(PLACES)]) for i, v in enumerate(variables)} for k in range(3)]
    return add(*(call("magnitude", cast(Expr, substitute(g, place))) for place in at))


def _slopes(g: Expr, variables: Sequence[Var]) -> list[Expr]:
    """Returns the slopes of a surface; those of functions without any are left out."""
    found = []
    for v in variables:
        with suppress(NotDifferentiableError):
            found.append(slope(g, v))
    return found


def only_in_steps(g: Expr) -> bool:
    """Returns whether parameters occur in g only inside of floors and their kin, so that g is constant between their
    steps; mod is not one."""
    stack: list[Node] = [g]
    seen: set[Node] = set()
    while stack:
        node = stack.pop()
        if node in seen or (isinstance(node, Call) and node.name in ("floor", "ceil", "round")):
            continue
        seen.add(node)
        if isinstance(node, Param):
            return False
        stack.extend(node.children)
    return True


def parameters_in(e: Expr) -> bool:
    return any(isinstance(n, Param) for n in postorder([e]))
