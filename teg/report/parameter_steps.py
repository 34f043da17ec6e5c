"""Floors and their kin of parameters: the values at which they step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teg.ir.expr import Call, Expr, Param
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.ir.simplify import call

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]


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
