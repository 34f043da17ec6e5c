"""Functions without branches: both values of every `where` on variables."""

from __future__ import annotations

from functools import lru_cache
from typing import cast

from teg.ir.expr import TRUE, Add, Call, Cond, Expr, Mul, Pow, Var, Where
from teg.ir.simplify import conjunction, negation
from teg.ir.traverse import replace_node

MAX_BRANCHES = 16


@lru_cache(maxsize=1024)
def branches_of(f: Expr) -> tuple[Expr, ...] | None:
    """Returns f with every `where` on variables replaced by either branch; None if there are too many combinations.

    Kept for the next time: integrals that are alike ask for the same functions.
    """
    result = [f]
    done: list[Expr] = []
    while result:
        e = result.pop()
        outer = _variable_where(e)
        if outer is None:
            done.append(e)
        elif len(result) + len(done) >= MAX_BRANCHES:
            return None
        else:
            for branch in (outer.then, outer.otherwise):
                result.append(cast(Expr, replace_node(e, outer, branch)))
    return tuple(done)


def cases_of(f: Expr, x: Var) -> list[tuple[Expr, Cond]] | None:
    """Returns f with every `where` on x replaced by either branch, each with the condition under which it is f; None if there are too many
    combinations."""
    result: list[tuple[Expr, Cond]] = [(f, TRUE)]
    done: list[tuple[Expr, Cond]] = []
    while result:
        e, condition = result.pop()
        outer = _variable_where(e, x)
        if outer is None:
            done.append((e, condition))
        elif len(result) + len(done) >= MAX_BRANCHES:
            return None
        else:
            for branch, holds in ((outer.otherwise, negation(outer.condition)), (outer.then, outer.condition)):
                result.append((cast(Expr, replace_node(e, outer, branch)), conjunction(condition, holds)))
    return done


def _variable_where(e: Expr, x: Var | None = None) -> Where | None:
    """Returns the first `where` whose condition has variables, or has x."""
    stack: list[Expr] = [e]
    seen: set[Expr] = set()
    while stack:
        node = stack.pop()
        if node in seen or not node.free:
            continue
        seen.add(node)
        if isinstance(node, Where) and (x in node.condition.free if x is not None else node.condition.free):
            return node
        if isinstance(node, Where):
            stack += [node.then, node.otherwise]
        elif isinstance(node, Add | Mul | Pow | Call):
            stack.extend(cast("tuple[Expr, ...]", node.children))
    return None
