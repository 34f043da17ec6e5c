"""The scheduled program: flat, closed, each value once at the outermost level where its inputs exist."""

from __future__ import annotations

import pytest

import teg
from teg.analysis.settings import Integration
from teg.pipeline import flat_program, flatten, normal_form
from teg.program import (
    Assign,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Polygon,
    Program,
    Sample,
    Segment,
    SumOver,
    When,
    clipped_by,
    size,
    statements,
)
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


def names_of(p: Program) -> None:
    """Every name is assigned once, before it is used, and used inside of its block only."""
    assigned: set[str] = set()
    seen: list[str] = []

    def check(arg: object, known: set[str]) -> None:
        if isinstance(arg, str):
            assert arg in known, arg

    def walk(block: tuple[object, ...], known: set[str]) -> set[str]:
        known = set(known)
        for s in block:
            if isinstance(s, Assign):
                for arg in s.args:
                    check(arg, known)
                seen.append(s.name)
                known.add(s.name)
            elif isinstance(s, Integrate):
                for arg in (s.lo, s.hi, s.when, *s.breaks):
                    check(arg, known)
                flags = walk(s.flags, known | {s.var, *s.ends})
                check(s.need, flags)
                flags -= {*s.ends}
                inside = walk(s.body, flags)
                for arg in s.values:
                    check(arg, inside)
                seen.extend(s.results)
                seen.extend((s.var, *s.ends))
                known |= set(s.results)
            elif isinstance(s, When):
                check(s.when, known)
                inside = walk(s.body, known)
                assert set(s.results) <= inside - known
                known |= set(s.results)
            elif isinstance(s, Isolate):
                for arg in (s.lo, s.hi, s.when):
                    check(arg, known)
                enclosure = walk(s.enclosure, known | {s.left, s.right})
                point = walk(s.point, known | {s.var})
                for arg in s.bounds:
                    check(arg, enclosure)
                for arg in (s.value, s.slope):
                    check(arg, point)
                seen.extend((s.left, s.right, s.var, *s.results))
                known |= set(s.results)
            elif isinstance(s, Locate):
                for arg in (s.lo, s.hi, s.low, s.high, s.when):
                    check(arg, known)
                enclosure = walk(s.enclosure, known | {s.left, s.right, s.bottom, s.top})
                for arg in s.bounds:
                    check(arg, enclosure)
                given = (*s.results, *(() if s.lost is None else (s.lost,)))
                seen.extend((s.left, s.right, s.bottom, s.top, *given))
                known |= set(given)
            elif isinstance(s, SumOver):
                for arg in (*s.points, s.when):
                    check(arg, known)
                inside = walk(s.body, known | {s.var})
                for arg in s.values:
                    check(arg, inside)
                seen.extend((s.var, *s.results))
                known |= set(s.results)
            elif isinstance(s, Polygon | Segment):
                if isinstance(s, Polygon):
                    for arg in clipped_by(s):
                        check(arg, known)
                check(s.when, known)
                inside = walk(s.setup, known)
                for arg in (*s.factors, *clipped_by(s)):
                    check(arg, inside)
                if isinstance(s, Segment):
                    scaled = walk(s.scales, inside)
                    for g in s.half_lines:
                        check(g.scale, scaled)
                variables = set(s.variables) if isinstance(s, Polygon) else {s.var}
                body = walk(s.body, inside | variables)
                for arg in s.values:
                    check(arg, body)
                seen.extend((*variables, *s.results))
                known |= set(s.results)
            elif isinstance(s, Hyperbola):
                for arg in (s.when, *s.corners, *(c for m in s.moments for _, _, c in m.terms)):
                    check(arg, known)
                inside = walk(s.scales, known)
                for arg in s.scale:
                    check(arg, inside)
                seen.extend(s.results)
                known |= set(s.results)
            elif isinstance(s, Sample):
                check(s.when, known)
                inside = walk(s.body, known | set(s.points))
                for arg in s.values:
                    check(arg, inside)
                seen.extend((*s.points, *s.results, *s.estimates))
                known |= {*s.results, *s.estimates}
        return known

    top = walk(p.body, {f"p{i}" for i in range(len(p.parameters))})
    for output in p.outputs:
        check(output, top)
    assigned.update(seen)
    assert len(assigned) == len(seen)


@pytest.mark.parametrize("reference", untagged("slow"), ids=lambda r: r.id)
def test_every_name_is_assigned_once_and_used_in_its_scope(reference: Reference) -> None:
    f = teg.compile(reference.build(), [teg.param(k) for k in reference.params])
    for orders in (0, 1):
        names_of(f.program(orders))
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
