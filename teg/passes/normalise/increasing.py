"""Keys of a choice without increasing functions, which do not change which one is the least.

    f(u_k) + s              →  u_k                               f increases, and s is the same for all candidates, as f is
    w_k·√u_k,  w_k·|v_k|    →  w_k·|w_k|·u_k,  w_k·|w_k|·v_k²    the square, with its sign; a root of another degree likewise

So distances are as good as their squares, and distances with weights have circles as borders. A function counts where its argument
cannot leave its domain: a key that may be no number stays, and so do parameters in s, which may be none. Cost: a visit a node.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from teg.analysis.extents import extent
from teg.ir.arrays import open_indices
from teg.ir.expr import MINUS_ONE, Add, Call, Compare, Const, Expr, Mul, Pow, Where, const
from teg.ir.index import IndexVar
from teg.ir.simplify import add, call, integer_power, mul

INCREASING_FROM = {
    "exp": -math.inf,
    "expm1": -math.inf,
    "sinh": -math.inf,
    "tanh": -math.inf,
    "atan": -math.inf,
    "erf": -math.inf,
    "sqrt": 0.0,
    "log": 0.0,
    "cosh": 0.0,
    "log1p": -1.0,
}
"""From where on functions increase. Below they are not defined or decrease."""


class _Inside(NamedTuple):
    """What stands in an increasing function, or in a decreasing one."""

    argument: Expr
    rises: bool = True


def plain_key(key: Expr, k: IndexVar) -> Expr:
    """Returns a key by which candidates, of the index k, have the same order; the key itself if it holds no increasing function."""
    opened = open_indices(key)
    e, rises, is_plain = key, True, True
    shared: list[Expr] = []
    while True:
        if isinstance(e, Add) and len(own := [c for c in e.children if k in opened[c]]) == 1:
            shared += [c for c in e.children if not (c.free or isinstance(c, Const) or k in opened[c])]
            e = own[0]  # what all candidates share does not count
        elif isinstance(e, Mul) and len(others := [c for c in e.children if not isinstance(c, Const)]) == 1:
            (factor,) = (c for c in e.children if isinstance(c, Const))
            e, rises = others[0], rises == (factor.data > 0.0)
        elif (inside := _inside(e)) is not None:
            e, rises, is_plain = inside.argument, rises == inside.rises, False
        else:
            break
    if (root := _weighted_root(e)) is not None:
        e, is_plain = root, False
    return key if is_plain else add(e if rises else mul(MINUS_ONE, e), *shared)  # where a parameter is no number, no key is one


def _inside(e: Expr) -> _Inside | None:
    """Returns what stands in an increasing or decreasing function, if it is in its domain; None for other expressions."""
    match e:
        case Pow():
            return _Inside(e.base, e.exponent > 0) if (e.exponent > 0 and e.exponent % 2) or _least(e.base) >= 0.0 else None
        case Call() if e.name == "pow":
            base, exponent = e.children
            if not isinstance(exponent, Const) or exponent.data == 0.0 or _least(base) < 0.0:
                return None
            return _Inside(base, exponent.data > 0.0)
        case Call() if e.name == "erfc":
            return _Inside(e.children[0], rises=False)
        case Call():
            return _Inside(e.children[0]) if _least(e.children[0]) >= INCREASING_FROM.get(e.name, math.inf) else None
        case _:
            size = _size_of(e)
            return None if size is None else _Inside(integer_power(size, 2))


def _weighted_root(e: Expr) -> Expr | None:
    """Returns the power of w·u^p, with the sign of w, in which u has degree 1, for u >= 0 and p < 1; None for other expressions. w has no
    variables."""
    if not isinstance(e, Mul):
        return None
    varying = [c for c in e.children if c.free]
    if len(varying) != 1:
        return None
    (root,) = varying
    size, power = _size_of(root), 0.5
    if size is not None:
        under = integer_power(size, 2)
    elif isinstance(root, Call) and root.name in ("sqrt", "pow"):
        under, exponent = root.children[0], root.children[1] if root.name == "pow" else const(0.5)
        if not isinstance(exponent, Const) or not 0.0 < exponent.data < 1.0 or _least(under) < 0.0:
            return None
        power = exponent.data
    else:
        return None
    weight = mul(*(c for c in e.children if not c.free))
    length = call("magnitude", weight)
    return mul(weight, length if power == 0.5 else call("pow", length, const(1.0 / power - 1.0)), under)


def _size_of(e: Expr) -> Expr | None:
    """Returns u for an expression |u|."""
    if isinstance(e, Call) and e.name == "magnitude":
        return e.children[0]
    if isinstance(e, Where) and isinstance(e.condition, Compare) and e.condition.resolution is None:
        then, otherwise = e.then, e.otherwise
        if otherwise is mul(MINUS_ONE, then) and e.condition.g in (then, otherwise):
            return then
    return None


def _least(e: Expr) -> float:
    return extent(e, {})[0]
