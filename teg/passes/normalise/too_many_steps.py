"""Steps that are not written out, when the program is differentiated.

`teg.passes.normalise.steps` makes where(no more steps, nest with steps, nest with floor) if parameters decide on the number of steps,
and leaves floors if the number is too large or not known. The `where` has a derivative as long as its condition holds, and is NaN
beyond; a floor has one only if its steps do not move.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

from teg.analysis.calculus import steps_error
from teg.analysis.staircase import is_step
from teg.ir.expr import Call, Compare, Expr, Param, UncountedFloor, Var, Where, called, const
from teg.ir.integral import Integral
from teg.ir.node import Node, nodes_of, postorder, union
from teg.ir.simplify import add, call, mul
from teg.ir.traverse import parameters, rebuild


def without_uncounted(e: Expr, wrt: Sequence[Param | Var]) -> Expr:
    """Returns the expression to be differentiated: NaN in each alternative whose steps move and were too many to be written out.

    Its derivatives of any order are then NaN too.
    """
    if not any(node.free for node in nodes_of(UncountedFloor, e)):
        return e
    order = postorder([e])
    moving = frozenset(wrt)
    new: dict[Node, Node] = {}
    loose: dict[Node, frozenset[Var]] = {}  # for a node that holds such floors: their variables that are not bound below it
    for node in order:
        children = [new[c] for c in node.children]
        if isinstance(node, Where) and not node.condition.free and (children[1] in loose) != (children[2] in loose):
            i = 1 if children[1] in loose else 2
            if not loose[children[i]] and _moves(cast(Expr, children[i]), moving):
                children[i] = _no_number(cast(Expr, children[i]), moving)
        result = rebuild(node, tuple(children))
        new[node] = result
        held = [loose[c] for c in result.children if c in loose]
        if result.free and isinstance(result, UncountedFloor):
            loose[result] = result.free
        elif held:
            bound = {result.var} if isinstance(result, Integral) else set()
            loose[result] = union(held) - bound
    return cast(Expr, new[e])


def _moves(e: Expr, wrt: frozenset[Param | Var]) -> bool:
    """Returns whether a floor that was not written out, or a condition on one, depends on these parameters."""
    marked: set[Node] = set()
    active: set[Node] = set()
    for node in postorder([e]):
        if node in wrt or any([c in active for c in node.children]):
            active.add(node)
        if (isinstance(node, UncountedFloor) and node.free) or any([c in marked for c in node.children]):
            marked.add(node)
        if node in active and node in marked and isinstance(node, UncountedFloor | Compare):
            return True
    return False


def _no_number(e: Expr, wrt: frozenset[Param | Var]) -> Expr:
    return mul(const(math.nan), call("exp", add(*(p for p in parameters(e) if p in wrt))))


def check_steps(e: Expr, wrt: Sequence[Param | Var]) -> None:
    """Raises NotDifferentiableError for a condition that moves and holds a floor of each of its variables: no variable can be sifted."""
    if not e.kinds & called("floor"):
        return
    moving = frozenset(wrt)
    active: set[Node] = set()
    for node in postorder([e]):
        if node in moving or any([c in active for c in node.children]):
            active.add(node)
        if isinstance(node, Compare) and node.g.free and node.g in active:
            floors = [n for n in postorder([node.g]) if is_step(n)]
            if floors and node.g.free <= frozenset().union(*(f.free for f in floors)):
                raise steps_error(cast(Call, floors[0]), node)
