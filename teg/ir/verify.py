"""Well-formedness of expressions, checked between passes in tests (TEG_VERIFY=1)."""

from __future__ import annotations

from teg.ir.arrays import LEAVES, Placed, Ranged
from teg.ir.expr import (
    Add,
    And,
    Call,
    Compare,
    Cond,
    Const,
    Expr,
    Mul,
    Not,
    Or,
    Param,
    Pow,
    Truth,
    Tuple,
    Var,
    Where,
)
from teg.ir.function import Apply
from teg.ir.integral import Delta, Integral, PointMasses
from teg.ir.node import Node, postorder


def verify(root: Node, stage: str = "") -> None:
    """Checks that each node has children of the right kinds. Raises AssertionError: a violation is a fault of the compiler."""
    for node in postorder([root]):
        kinds: tuple[type[Node], ...]
        match node:
            case Add() | Mul() | And() | Or():
                kinds = (Cond if isinstance(node, (And, Or)) else Expr,) * len(node.children)
                assert len(node.children) >= 2, f"{stage}: a {type(node).__name__} of fewer than two"
            case Const() | Param() | Var() | Truth():
                kinds = ()
            case Pow():
                kinds = (Expr,)
                assert node.exponent not in (0, 1), f"{stage}: a trivial power"
            case Apply():
                assert len(node.derivative) == node.callee.arity, f"{stage}: a derivative by other inputs than {node.callee.title} has"
                kinds = (Expr,) * node.callee.arity
            case Call() | Tuple():
                kinds = (Expr,) * len(node.children)
            case Where():
                kinds = (Cond, Expr, Expr)
            case Integral():
                kinds = (Expr, Expr, Expr)
                assert isinstance(node.var, Var), f"{stage}: an integral over no variable"
            case Delta() | PointMasses():
                kinds = (Expr,)
            case Compare():
                kinds = (Expr, Cond)[: len(node.children)]
                assert not node.g.has_delta, f"{stage}: a delta in a condition"
            case Not():
                kinds = (Cond,)
            case Ranged():
                kinds = tuple(Cond if isinstance(c, Cond) else Expr for c in node.children)
            case Placed():
                kinds = (Expr,)
            case _ if isinstance(node, LEAVES):
                kinds = ()
            case _:
                raise AssertionError(f"{stage}: unknown node {type(node).__name__}")
        assert len(kinds) == len(node.children), f"{stage}: {type(node).__name__} with {len(node.children)} children"
        for child, kind in zip(node.children, kinds, strict=True):
            assert isinstance(child, kind), f"{stage}: {type(child).__name__} inside {type(node).__name__}"
            assert not isinstance(child, Tuple) or isinstance(node, Tuple), f"{stage}: a tuple inside {type(node).__name__}"
