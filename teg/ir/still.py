"""Parameters that do not move: their value is that of the parameter, and their derivative is 0.

    e ::= … | stop(t) | stop(V[i, …])

They stand in the conditions of `teg.stop_delta`. The passes see parameters of their own, so a surface of such parameters does not move;
`released` puts the parameters back when there is nothing more to differentiate.
"""

from __future__ import annotations

from typing import TypeVar, cast

from teg.ir.arrays import Gather, StillGather
from teg.ir.choices import Nearest
from teg.ir.expr import Call, Cond, Expr, Param, Still, Where
from teg.ir.integral import Delta
from teg.ir.node import Node, postorder
from teg.ir.simplify import call, div, mul, sub
from teg.ir.traverse import rebuild, rewrite

N = TypeVar("N", bound=Node)
_STEPS = ("floor", "ceil", "round")


def has_still(root: Node) -> bool:
    """Returns whether an expression has parameters or entries that do not move."""
    return root.kinds & (Still.bit | StillGather.bit) != 0


def with_still_parameters(root: N) -> N:
    """Returns the expression with parameters and entries that do not move."""
    return _with_leaves(root, to_still=True)


def released(root: N) -> N:
    """Returns the expression with the parameters themselves."""
    return _with_leaves(root, to_still=False) if has_still(root) else root


def _with_leaves(root: N, to_still: bool) -> N:
    leaf, entry = (Still, StillGather) if to_still else (Param, Gather)

    def visit(old: Node, new: Node) -> Node:
        if isinstance(old, Param):
            return leaf.make(old.data, ())
        return entry.make(old.data, ()) if isinstance(old, Gather) else new

    return cast(N, rewrite([root], visit)[root])


def with_still_conditions(root: N) -> N:
    """Returns an expression whose conditions, steps and deltas do not move with parameters. Functions must be written out."""
    if isinstance(root, Cond):
        return with_still_parameters(root)
    order = postorder([root])
    leaf: dict[Node, Node] = {n: Still.make(n.data, ()) for n in order if isinstance(n, Param)}
    leaf.update((n, StillGather.make(n.data, ())) for n in order if isinstance(n, Gather))
    deciding = [node.children[i] for node in order for i in _deciding(node)]
    still = rewrite(deciding, lambda old, new: leaf.get(old, new))
    new: dict[Node, Node] = {}
    for node in order:
        if isinstance(node, Cond):
            new[node] = node  # part of a condition: `still` has it
        elif isinstance(node, Call) and node.name == "mod":
            u, period = (cast(Expr, new[c]) for c in node.children)
            steps = call("floor", div(*(cast(Expr, still[c]) for c in node.children)))
            new[node] = sub(u, mul(period, steps))
        else:
            fixed = _deciding(node)
            new[node] = rebuild(node, tuple(still[c] if i in fixed else new[c] for i, c in enumerate(node.children)))
    return cast(N, new[root])


def _deciding(node: Node) -> range:
    """Returns the places of the children that decide where a node jumps."""
    match node:
        case Where() | Delta():
            return range(1)
        case Nearest():
            return range(1, 3)  # key and condition
        case Call() if node.name in (*_STEPS, "mod"):
            return range(len(node.children))
        case _:
            return range(0)
