"""Visiting and rebuilding expressions, without recursion and without losing sharing."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from typing import Any, TypeVar, cast

from teg.ir import simplify
from teg.ir.arrays import LEAVES, Placed, Ranged
from teg.ir.expr import (
    Add,
    And,
    Call,
    Compare,
    Cond,
    Const,
    Expr,
    HalfAngle,
    Mul,
    Not,
    Or,
    Param,
    Pow,
    Still,
    Truth,
    Tuple,
    UncountedFloor,
    Var,
    Where,
)
from teg.ir.function import Apply
from teg.ir.integral import ClosedForm, Delta, Integral, PointMasses, delta, integral_over
from teg.ir.node import Node, postorder, postorder_through, postorder_to, union
from teg.ir.operands import as_program

Result = TypeVar("Result")
CompareHook = Callable[[Compare, Expr, "Cond | None"], Cond]


def size(*roots: Node) -> int:
    """Returns the number of distinct nodes of one or several expressions.

    teg.size(teg.sin(t) + teg.sin(t) ** 2)              # 4: t, sin(t), its square and the sum
    """
    return len(postorder([as_program(root) for root in roots]))


def parameters(*roots: Node) -> list[Param]:
    """Returns every parameter, in order of first appearance."""
    every = (n for n in postorder(roots) if isinstance(n, Param))
    return list(dict.fromkeys(Param.make(n.data, ()) if isinstance(n, Still) else n for n in every))


_MAKERS: dict[type[Node], Callable[..., Node]] = {
    Add: simplify.add,
    Mul: simplify.mul,
    Where: simplify.where,
    Tuple: simplify.tuple_of,
    Not: simplify.negation,
    And: simplify.conjunction,
    Or: simplify.disjunction,
    HalfAngle: simplify.half_angle,
    UncountedFloor: simplify.uncounted_floor,
}
"""The simplifying constructors of nodes whose data say nothing."""


def rebuild(node: Node, children: tuple[Node, ...]) -> Node:
    """Returns the node with other children, through the simplifying constructors."""
    return node if children == node.children else remake(node, children)


def remake(node: Node, children: tuple[Node, ...]) -> Node:
    """Returns the node with these children, through the simplifying constructors even if they are its own. Operators
    do not simplify fully."""
    c = cast(Any, children)
    make = _MAKERS.get(type(node))
    if make is not None:
        return make(*c)
    match node:
        case Const() | Param() | Var() | Truth():
            return node
        case Pow():
            return simplify.integer_power(c[0], node.exponent)
        case Apply():
            return Apply.make(node.data, c)
        case ClosedForm():
            return type(node).make(node.data, c)
        case Call():
            return simplify.call(node.name, *c)
        case Integral():
            return integral_over(c[0], node.var, c[1], c[2])
        case Delta():
            return delta(c[0])
        case PointMasses():
            return PointMasses.make(None, c)
        case Compare():
            return simplify.positive(c[0], node.strict, c[1] if len(c) == 2 else None, node.rivals)
        case Ranged():
            return node.over(children, node.index, node.lo, node.hi)
        case Placed():
            return type(node).make(node.data, c)
        case _ if isinstance(node, LEAVES):
            return node
        case _:
            raise AssertionError(f"unknown node {type(node).__name__}")


def rewrite(roots: Iterable[Node], visit: Callable[[Node, Node], Node]) -> dict[Node, Node]:
    """Returns the map from old nodes to new ones: each node is rebuilt from its rewritten children, then replaced by
    `visit(old, rebuilt)`."""
    new: dict[Node, Node] = {}
    for node in postorder(roots):
        new[node] = visit(node, rebuild(node, tuple([new[c] for c in node.children])))
    return new


def rewritten(root: Expr, kinds: int, visit: Callable[[Node, Node], Node]) -> Expr:
    """Returns an expression as `rewrite` does, where `visit` replaces nodes of some kinds only. What holds none of these is not visited."""
    new: dict[Node, Node] = {}
    for node in postorder_to([root], kinds):
        new[node] = visit(node, rebuild(node, tuple([new.get(c, c) for c in node.children])))
    return cast(Expr, new.get(root, root))


def rewrite_below(roots: Iterable[Node], replacement: Callable[[Node], Node | None]) -> dict[Node, Node]:
    """Returns the map from old nodes to new ones: a node with a replacement becomes that, and its inside is not visited; others are
    rebuilt."""
    new: dict[Node, Node] = {}
    path: list[Node] = []  # from a root to the current node
    unvisited: list[Iterator[Node]] = []  # the nodes still to visit, for each node on the path and for the roots
    waiting = iter(roots)
    while True:
        for node in waiting:
            if node in new:
                continue
            other = replacement(node)
            if other is None and node.children:
                path.append(node)
                unvisited.append(waiting)
                waiting = iter(node.children)
                break
            new[node] = node if other is None else other
        else:
            if not unvisited:
                return new
            node = path.pop()
            new[node] = rebuild(node, tuple([new[c] for c in node.children]))
            waiting = unvisited.pop()


def replace_node(root: Node, old: Node, new: Node) -> Node:
    """Returns the expression with one node replaced wherever it stands."""
    changed: dict[Node, Node] = {}
    for node in postorder([root]):
        changed[node] = new if node is old else rebuild(node, tuple([changed[c] for c in node.children]))
    return changed[root]


def fresh(name: str, taken: Iterable[Var]) -> Var:
    """Returns the variable `name`, or name′, name″, …, that is not taken."""
    names = {v.name for v in taken}
    while name in names:
        name += "′"
    return Var.make(name, ())


def substitute(root: Node, mapping: Mapping[Var, Expr], on_compare: CompareHook | None = None) -> Node:
    """Returns the node with free variables replaced. An inner integral that binds a variable of a replacement is renamed: nothing is
    captured.

    `on_compare(old, new_g, new_resolution)`, if given, builds each changed atom.
    """
    if not root.has_integral:
        return _substitute_freely(root, mapping, on_compare)
    jobs: dict[tuple[tuple[Var, Expr], ...], dict[Node, Node]] = {}
    start = tuple(mapping.items())
    stack: list[tuple[Node, tuple[tuple[Var, Expr], ...]]] = [(root, start)]
    while stack:
        node, env = stack[-1]
        done = jobs.setdefault(env, {})
        if node in done:
            stack.pop()
            continue
        if not any(v in node.free for v, _ in env):
            done[node] = node
            stack.pop()
            continue
        if isinstance(node, Var):
            done[node] = dict(env)[node]
            stack.pop()
            continue
        var, inner = (node.var, env) if isinstance(node, Integral) else (None, env)
        if isinstance(node, Integral):
            kept = [(v, u) for v, u in env if v is not node.var and v in node.body.free]
            if any(node.var in u.free for _, u in kept):
                var = fresh(
                    node.var.name,
                    {w for _, u in kept for w in u.free} | node.body.free | {v for v, _ in kept},
                )
                kept.append((node.var, var))
            inner = tuple(kept)
        envs = [inner if isinstance(node, Integral) and i == 0 else env for i in range(len(node.children))]
        missing = [(c, e) for c, e in zip(node.children, envs, strict=True) if c not in jobs.setdefault(e, {})]
        if missing:
            stack.extend(missing)
            continue
        children = tuple(jobs[e][c] for c, e in zip(node.children, envs, strict=True))
        if isinstance(node, Integral):
            done[node] = integral_over(cast(Expr, children[0]), cast(Var, var), cast(Expr, children[1]), cast(Expr, children[2]))
        elif isinstance(node, Compare) and on_compare is not None:
            done[node] = on_compare(node, cast(Expr, children[0]), cast(Cond, children[1]) if len(children) == 2 else None)
        else:
            done[node] = rebuild(node, children)
        stack.pop()
    return jobs[start][root]


def _substitute_freely(root: Node, mapping: Mapping[Var, Expr], on_compare: CompareHook | None) -> Node:
    """Returns the same for a node without binders."""
    new: dict[Node, Node] = dict(mapping.items())
    for node in postorder_through(root, mapping):
        if node in new:
            continue
        children = tuple([new.get(c, c) for c in node.children])
        if isinstance(node, Compare) and on_compare is not None:
            new[node] = on_compare(node, cast(Expr, children[0]), cast(Cond, children[1]) if len(children) == 2 else None)
        else:
            new[node] = rebuild(node, children)
    return new.get(root, root)


def rename_apart(root: Node, taken: Iterable[Var] = ()) -> Node:
    """Returns the expression with a distinct variable for every integral.

    An integral is renamed if it stands inside another one of the same variable, or if its variable is free in the whole or `taken`.
    """
    outside = root.free.union(taken)
    if not outside and not any(isinstance(n, Integral) and n.body.has_integral for n in postorder([root])):
        return root
    binders: dict[Node, frozenset[Var]] = {}  # the variables bound inside a node
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        children = tuple([new[c] for c in node.children])
        inner = union([binders[c] for c in children])
        result: Node
        if isinstance(node, Integral):
            body, var = cast(Expr, children[0]), node.var
            if var in binders[body] or var in outside:
                other = fresh(var.name, binders[body] | body.free | outside)
                body = cast(Expr, substitute(body, {var: other}))
                var = other
            result = integral_over(body, var, cast(Expr, children[1]), cast(Expr, children[2]))
            inner = inner | {var}
        else:
            result = rebuild(node, children)
        new[node] = result
        binders[result] = union([binders.get(result, frozenset()), inner])
    return new[root]


def formed_of(node: Node) -> tuple[Node, ...]:
    """Returns the operands of a sum, a product or a power, and the branches of a choice; of other nodes none."""
    return node.children[1:] if isinstance(node, Where) else node.children if isinstance(node, Add | Mul | Pow) else ()


def stands_in(root: Node, test: Callable[[Any], bool], known: dict[Node, bool], below: Callable[[Any], Iterable[Node]]) -> bool:
    """Returns whether a node that passes a test stands in an expression: `below` gives the nodes to look at below one. What is found out
    about all of them is kept in `known`."""
    stack: list[Node] = [root]
    while stack:
        node = stack[-1]
        if node not in known:
            inside = below(node)
            if missing := [c for c in inside if c not in known]:
                stack.extend(missing)
                continue
            known[node] = any([known[c] for c in inside]) or test(node)
        stack.pop()
    return known[root]


Steps = Generator[Any, Any, Result]
"""A function that is written as a recursion: it yields its calls, and gets their results."""


def unrolled(call: Steps[Result]) -> Result:
    """Returns the result of a recursion, with calls on a list instead of Python's stack, which is short.

    >>> def depth(n): return 0 if n == 0 else 1 + (yield depth(n - 1))
    >>> unrolled(depth(100_000))
    100000
    """
    calls: list[Steps[Any]] = [call]
    result: Any = None
    while calls:
        try:
            calls.append(calls[-1].send(result))
            result = None
        except StopIteration as end:
            calls.pop()
            result = end.value
    return cast(Result, result)
