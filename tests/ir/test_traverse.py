"""Traversal: sizes, parameters, rewriting without losing what is shared, substitution without capture."""

from __future__ import annotations

import pytest

import teg
from teg.ir.expr import Var
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.traverse import fresh, parameters, remake, rename_apart, replace_node, rewrite, rewrite_below, size, substitute

x, y = teg.vars("x y")
a, t = teg.params("a t")


def test_sizes_count_shared_nodes_once() -> None:
    assert size(teg.sin(t) + teg.sin(t) ** 2) == 4
    assert size(t, t, a) == 2


def test_parameters_in_order_of_appearance() -> None:
    assert parameters(t * a + t) == [t, a]
    assert parameters(teg.exp(a), t) == [a, t]


def test_rewriting_visits_children_first_and_keeps_sharing() -> None:
    visited: list[Node] = []

    def visit(old: Node, new: Node) -> Node:
        visited.append(old)
        return a if old is t else new

    e = teg.sin(t) + teg.exp(teg.sin(t))
    assert rewrite([e], visit)[e] is teg.sin(a) + teg.exp(teg.sin(a))
    assert len(visited) == size(e)
    assert visited.index(t) < visited.index(teg.sin(t)) < visited.index(e)


def test_the_inside_of_a_replaced_node_is_not_visited() -> None:
    asked: list[Node] = []

    def replacement(node: Node) -> Node | None:
        asked.append(node)
        return a if node is teg.sin(t) else None

    e = teg.sin(t) * 2 + x
    assert rewrite_below([e], replacement)[e] is 2 * a + x
    assert t not in asked


def test_one_node_is_replaced_everywhere() -> None:
    assert replace_node(t * t + teg.sin(t), t, a) is a * a + teg.sin(a)
    assert replace_node(a, t, x) is a


def test_remaking_simplifies_what_operators_do_not() -> None:
    e = t - t
    assert remake(e, e.children) is teg.ir.expr.ZERO


def test_a_fresh_name_is_not_taken() -> None:
    assert fresh("x", []) is x
    assert fresh("x", [x]).name == "x′"
    assert fresh("x", [x, teg.var("x′")]).name == "x″".replace("″", "′′")


def test_nothing_is_captured() -> None:
    e = teg.integral(x * y, (x, 0, 1))
    found = substitute(e, {y: x})
    assert isinstance(found, Integral)
    assert found.free == {x}
    assert found.var is not x
    assert teg.evaluate(teg.integral(found, (x, 0, 1))) == pytest.approx(0.25)


def test_bound_variables_are_not_substituted() -> None:
    e = teg.integral(x * t, (x, 0, 1))
    assert substitute(e, {x: a}) is e


def test_every_integral_gets_a_variable_of_its_own() -> None:
    e = teg.integral(x * teg.integral(x, (x, 0, t)), (x, 0, 1)) + x
    apart = rename_apart(e)
    bound = [n.var for n in postorder([apart]) if isinstance(n, Integral)]
    assert len(set(bound)) == 2
    assert x not in bound
    assert apart.free == {x}
    assert all(isinstance(v, Var) for v in bound)


def test_deep_expressions_are_no_recursion() -> None:
    e: teg.Expr = t
    for _ in range(20_000):
        e = teg.sin(e) + a
    assert parameters(e) == [t, a]
    assert size(replace_node(e, t, a)) == size(e) - 1
