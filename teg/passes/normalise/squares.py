"""Roots of sums that are squares on some of their branches, or lines on all of them.

    √(where(c, u, 0)² + where(d, v, 0)²)   →   where(c, where(d, √(u² + v²), |u|), where(d, |v|, 0))

Where the argument of a root, a logarithm or a power is a square, its derivative jumps at a zero: √(u²) is |u|. Jumps are looked for where
the factors of arguments vanish (`teg.analysis.singularities`), and a sum shows its factors on each branch only. The distance from a box,
√(max(|x| - a, 0)² + max(|y| - b, 0)²), is such a sum. log(t - |x - a|) is written apart on both sides of a: beside the zero of a line its
distance is exact (`centre.py`). Sums with more than `MOST_CONDITIONS` conditions stay as they are.
Cost: 2ⁿ roots for n conditions.
"""

from __future__ import annotations

from typing import cast

from teg.analysis.polynomial import Shadow
from teg.analysis.singularities import is_singular
from teg.ir.expr import MINUS_ONE, Add, Call, Compare, Cond, Expr, Mul, Pow, Where, called, calls_of
from teg.ir.node import Node, nodes_of
from teg.ir.simplify import call, integer_power, mul, positive, where
from teg.ir.traverse import rewrite
from teg.passes.normalise.canonicalise import decided, inner_condition

MOST_CONDITIONS = 4
_ROOT = called("sqrt")


def with_squares_apart(root: Expr) -> Expr:
    """Returns the program with such roots as branches. Its value is the same."""
    if not any(map(is_singular, nodes_of(Call, root))) or not any(n.condition.free for n in nodes_of(Where, root)):
        return root
    return cast(Expr, rewrite([root], _visited)[root])


def _visited(_: Node, new: Node) -> Node:
    if not isinstance(new, Call) or not is_singular(new) or not isinstance(new.children[0], Add | Mul):
        return new
    argument = new.children[0]
    branches = _branches(argument)
    if not isinstance(branches, tuple):
        return new
    leaves = _leaves(branches)
    if any(_has_square(leaf) for leaf in leaves) and not _has_square(argument):
        return _root_of(new, branches)
    lines = isinstance(argument, Add) and len(argument.free) == 1 and all(Shadow(tuple(leaf.free)).degree(leaf) == 1 for leaf in leaves)
    return _root_of(new, branches) if lines else new  # of more variables, the lines of one would cross those of the other


def with_sizes(root: Node) -> Node:
    """Returns an expression with roots of even powers as sizes: √(u²) is |u|."""
    if not any(map(_is_size, calls_of(_ROOT, root))):
        return root
    return rewrite([root], lambda _, new: _size(cast(Call, new)) if _is_size(new) else new)[root]


def with_sizes_in_conditions(root: Expr) -> Expr:
    """Returns the program with such roots as sizes in its conditions: |u| has a kink at a surface, where √(u²) has none to be seen."""
    atoms = [n for n in nodes_of(Compare, root) if n.free]
    roots = {n for n in calls_of(_ROOT, *atoms) if _is_size(n)}
    if not roots:
        return root
    return cast(Expr, rewrite([root], lambda old, new: _size(cast(Call, new)) if old in roots and _is_size(new) else new)[root])


def _is_size(n: Node) -> bool:
    return isinstance(n, Call) and n.name == "sqrt" and bool(n.free) and _has_square(n.children[0])


def _size(root: Call) -> Expr:
    return _root_of(root, root.children[0])


Branches = Expr | tuple[Cond, "Branches", "Branches"]
"""An expression without branches, or a condition and what stands on both sides of it."""


def _branches(e: Expr, most: int = MOST_CONDITIONS) -> Branches | None:
    """Returns the branches of an expression; None if it has more conditions than `most`."""
    condition = inner_condition(e)
    if condition is None:
        return e
    if most == 0:
        return None
    then, otherwise = (_branches(decided(e, condition, side), most - 1) for side in (True, False))
    return None if then is None or otherwise is None else (condition, then, otherwise)


def _leaves(branches: Branches) -> list[Expr]:
    if isinstance(branches, tuple):
        return [leaf for side in branches[1:] for leaf in _leaves(side)]
    return [branches]


def _has_square(e: Expr) -> bool:
    """Returns whether an expression is written with a factor that is a power and vanishes somewhere, perhaps."""
    factors = e.children if isinstance(e, Mul) else (e,)
    return any(isinstance(f, Pow) and f.exponent > 1 and bool(f.base.free) for f in factors)


def _root_of(root: Call, branches: Branches) -> Expr:
    if isinstance(branches, tuple):
        condition, then, otherwise = branches
        return where(condition, _root_of(root, then), _root_of(root, otherwise))
    if root.name != "sqrt":
        return call(root.name, branches, *root.children[1:])
    factors = branches.children if isinstance(branches, Mul) else (branches,)
    even = [f for f in factors if isinstance(f, Pow) and f.exponent % 2 == 0 and f.exponent > 0 and f.base.free]
    sizes = (integer_power(where(positive(f.base), f.base, mul(MINUS_ONE, f.base)), f.exponent // 2) for f in even)
    return mul(*sizes, call("sqrt", mul(*(f for f in factors if f not in even))))
