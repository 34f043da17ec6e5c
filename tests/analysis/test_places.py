"""Places of subexpressions: the nodes around one, whether the whole is affine in it, and when its value is used."""

from __future__ import annotations

import teg
from teg.analysis.places import holding, linear_places, reached
from teg.ir.expr import TRUE, Call

x = teg.var("x")
a, t = teg.params("a t")
SINE = teg.sin(t)


def test_the_nodes_around_a_node() -> None:
    e = teg.exp(SINE + a) * a
    nodes = holding(e, SINE)
    assert nodes[0] is SINE + a
    assert nodes[-1] is e
    assert SINE not in nodes
    assert a not in nodes
    assert holding(a * a, SINE) == []


def test_affine_places() -> None:
    def is_sine(node: object) -> bool:
        return isinstance(node, Call) and node.name == "sin"

    assert linear_places(a * SINE + 1, is_sine) == {SINE: True}
    assert linear_places(teg.exp(SINE), is_sine) == {SINE: False}
    assert linear_places(SINE * SINE, is_sine) == {SINE: False}
    assert linear_places(teg.integral(x * SINE, (x, 0, 1)), is_sine) == {SINE: True}
    assert linear_places(teg.where(a > 0, SINE, 1), is_sine) == {SINE: True}
    assert linear_places(teg.bracket(a < SINE), is_sine) == {SINE: False}


def test_when_a_value_is_used() -> None:
    assert reached(SINE + a, SINE) is TRUE
    assert reached(teg.where(a > 0, SINE, 1), SINE) is (a > 0)
    assert reached(teg.where(a > 0, 1, SINE), SINE) is ~(a > 0)
