"""Interning, and the kinds of nodes that an expression holds, which are those found by looking at all of its nodes."""

from __future__ import annotations

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor

import pytest

import teg
from teg.ir.arrays import Gather, Ranged, Unit
from teg.ir.expr import FUNCTIONS, Add, And, Call, Compare, Cond, Const, Expr, Mul, Not, Or, Param, Pow, Still, Var, Where, called, calls_of
from teg.ir.function import Apply
from teg.ir.integral import Delta, Integral
from teg.ir.node import Node, nodes_of, postorder, postorder_to
from teg.ir.traverse import rewrite, rewritten
from tests.references import REFERENCES, Reference

KINDS: list[type[Node]] = [
    Add, And, Apply, Call, Compare, Cond, Const, Delta, Expr, Gather, Integral, Mul, Not, Or, Param, Pow, Ranged, Still, Unit, Var, Where,
]  # fmt: skip
x, y = teg.vars("x y")
t = teg.param("t")


def programs(reference: Reference) -> list[Expr]:
    e = reference.build()
    return [e, teg.grad(e)] if isinstance(e, Integral) else [e]


@pytest.mark.parametrize("reference", REFERENCES[::7], ids=lambda r: r.id)
def test_kinds_are_the_classes_and_functions_of_all_nodes(reference: Reference) -> None:
    for e in programs(reference):
        order = postorder([e])
        for kind in KINDS:
            assert nodes_of(kind, e) == [n for n in order if isinstance(n, kind)]
            assert bool(e.kinds & kind.bit) == any(isinstance(n, kind) for n in order)
        for name in FUNCTIONS:
            assert calls_of(called(name), e) == [n for n in order if isinstance(n, Call) and n.name == name]


def test_a_derived_class_is_a_kind_of_its_base() -> None:
    e = teg.stop_delta(teg.bracket(x < t))
    assert nodes_of(Still, e) == nodes_of(Param, e) != []
    assert nodes_of(Still, teg.sin(t)) == []


def test_what_holds_none_of_them_is_not_visited() -> None:
    condition = x < teg.exp(t)
    e = teg.sin(teg.cos(t)) + teg.bracket(condition) * teg.sqrt(y)
    order = postorder_to([e], Compare.bit)
    assert order[0] is condition
    assert order[-1] is e
    assert teg.sqrt(y) not in order
    assert t not in order
    assert postorder_to([teg.sin(t)], Compare.bit) == []


def test_several_kinds_of_several_roots() -> None:
    roots = [teg.exp(x), teg.exp(x) * teg.log(t), teg.sin(y)]
    assert calls_of(called("exp", "log"), *roots) == [teg.exp(x), teg.log(t)]
    assert nodes_of(Var, *roots) == [x, y]


def test_nodes_of_some_kinds_are_replaced() -> None:
    e = teg.integral(teg.bracket(x < t) * x, (x, 0, 1)) + teg.sin(t) ** 2

    def visit(_: Node, new: Node) -> Node:
        return Not.make(None, (new,)) if isinstance(new, Compare) else new

    assert rewritten(e, Compare.bit, visit) is rewrite([e], visit)[e]
    assert rewritten(teg.sin(t), Compare.bit, visit) is teg.sin(t)


def test_a_node_that_nothing_uses_is_freed_and_made_again() -> None:
    dead = weakref.ref(teg.sin(teg.param("only_here")))
    gc.collect()
    assert dead() is None
    again = teg.sin(teg.param("only_here"))
    assert again is teg.sin(teg.param("only_here"))


def test_nodes_that_are_made_and_freed_in_many_threads_are_one_object() -> None:
    def made(k: int) -> int:
        wrong = 0
        for i in range(60):
            e = teg.sin(teg.param(f"p{i % 7}") * (i % 5 + 1.0)) + t
            wrong += e is not teg.sin(teg.param(f"p{i % 7}") * (i % 5 + 1.0)) + t
            del e
        return wrong

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(made, range(16))) == 0
