"""The scheduled program: flat, closed, each value once at the outermost level where its inputs exist."""

from __future__ import annotations

import pytest

import teg
from teg.analysis.settings import Integration
from teg.pipeline import flat_program, flatten, normal_form
from teg.program import (
    Assign,
    Integrate,
    Program,
    size,
    statements,
)
from teg.program.verify import verify_program
from tests.references import Reference, untagged

x, y = teg.vars("x y")
t, a = teg.params("t a")


def program(e: teg.Expr, *names: str) -> Program:
    return flat_program(flatten(normal_form(e)), names, Integration())


def test_the_smallest_program() -> None:
    p = program(teg.integral(teg.bracket(x < t), (x, 0, 1)), "t")
    assert p.parameters == ("t",)
    assert len(p.outputs) == 1
    (loop,) = [s for s in statements(p.body) if isinstance(s, Integrate)]
    assert loop.breaks == ("p0",)
    assert (loop.lo, loop.hi) == (0.0, 1.0)
    assert loop.need is not None
    assert len(loop.values) == len(loop.results) == 1


def test_a_number_needs_no_statement() -> None:
    p = program(teg.integral(1, (x, 0, 3)) + 0 * t)
    assert p.body == ()
    assert p.outputs == (3.0,)


def test_values_go_to_the_outermost_level() -> None:
    p = program(teg.integral(teg.sin(t) * teg.atan(x + y) * teg.cos(y), (x, 0, 1), (y, 0, 1)), "t")
    depth: dict[str, int] = {}

    def walk(block: tuple[object, ...], level: int) -> None:
        for s in block:
            if isinstance(s, Assign):
                depth[s.op] = level
            elif isinstance(s, Integrate):
                walk(s.flags, level + 1)
                walk(s.body, level + 1)

    walk(p.body, 0)
    assert (depth["sin"], depth["cos"], depth["atan"]) == (0, 1, 2)


def test_integrals_of_one_shape_share_a_loop() -> None:
    pairs = [teg.integral(teg.bracket(x < t) * f, (x, 0, 1)) for f in (1, x, x**2, teg.sin(t) * x)]
    p = program(teg.tuple(*pairs), "t")
    (loop,) = [s for s in statements(p.body) if isinstance(s, Integrate)]
    assert len(loop.results) >= 3


def test_value_and_gradient_share_the_value_loop() -> None:
    f = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(a * x**3), (x, 0, 1)), [t, a])
    loops = [s for s in statements(f.program(1).body) if isinstance(s, Integrate)]
    assert len(loops) == 1


@pytest.mark.parametrize("reference", untagged("slow"), ids=lambda r: r.id)
def test_every_name_is_assigned_once_and_used_in_its_scope(reference: Reference) -> None:
    f = teg.compile(reference.build(), [teg.param(k) for k in reference.params])
    for orders in (0, 1):
        verify_program(f.program(orders))
        assert size(f.program(orders)) == sum(1 for _ in statements(f.program(orders).body))


def test_scheduling_is_deterministic() -> None:
    def build() -> Program:
        return program(teg.integral(teg.bracket(a * x + y < t) * teg.exp(x), (x, 0, 1), (y, 0, 1)), "t", "a")

    assert build() == build()


def test_the_adaptive_rule_is_everywhere_if_asked_for() -> None:
    e = normal_form(teg.integral(teg.bracket(x < t), (x, 0, 1)))
    p = flat_program([e], ["t"], Integration(1e-6, "adaptive"))
    rules = [s.rule for s in statements(p.body) if isinstance(s, Integrate)]
    assert [getattr(r, "tol", None) for r in rules] == [1e-6]
