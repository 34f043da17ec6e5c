"""The flat program of one candidate of `Gaps`: where it begins and ends to cover a line, and which pieces it covers.

    outputs   p₀, …, pₙ₋₁ ascending, +inf for places that are not there; whether each piece is covered; the same where it ties;
              whether borders nearly touch, so that rounding moves the places where they cross

A piece is decided at one place inside of it. A condition ties there where it is 0 to rounding: it counts once as true, once as false, and
the mean is ½. Cost: n roots, and n + 1 times the condition.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import cast

from teg.analysis.isolation import Isolation, isolate
from teg.analysis.roots import solve
from teg.analysis.settings import Integration
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import And, Compare, Cond, Expr, Param, Var
from teg.ir.node import postorder
from teg.ir.simplify import conjunction, nonzero_part
from teg.passes.lower.emit import NAN, Emitter
from teg.passes.lower.levels import Level
from teg.passes.lower.roots import Roots
from teg.passes.lower.rounding import CLEAR
from teg.program import INSIDE, TIE_EPS, Arg, Called, Program, Tie
from teg.program.arrays import TOUCH
from teg.program.dce import without_dead_code


def schedule_places(covered: Expr, tie: Expr, place: Var, parameters: Sequence[str], how: Integration) -> Program:
    """Returns the program of a candidate that covers a `place` where `covered` is 1. The last two parameters are the ends of the line."""
    ends = Param.make(parameters[-2], ()), Param.make(parameters[-1], ())

    def unexpected(*_: object) -> Arg:
        raise AssertionError("whether a place is covered is no integral")

    out = Emitter(parameters, cast("object", unexpected), unexpected)  # type: ignore[arg-type]
    roots = Roots(out, lambda level, nodes: None, how.max_roots, how.tol)
    top = Level(None, None, 0)
    first, last = (out.number(end, top) for end in ends)
    found: list[Arg] = []
    functions = list(dict.fromkeys(atom.g for atom in atoms_of(covered, place)))
    when = _applies(covered, place, out, top)
    for g in functions:
        found += _roots_of(g, place, ends, roots, top) or roots.isolated(_isolation(g, place, roots), *ends, top, when)
    is_known = [out.assign(top, "ok", p) for p in found]
    places = _ascending(out, top, [_inside(out, top, p, first, last) for p in found])
    flags: list[Arg] = []
    ties: list[Arg] = []
    doubts: list[Arg] = []
    touch = out.assign(top, "mul", TOUCH, out.assign(top, "sub", last, first))
    bounds = [first, *(out.assign(top, "min", p, last) for p in places), last]
    for p, q in pairwise(bounds):
        inside = out.assign(top, "add", p, out.assign(top, "mul", INSIDE, out.assign(top, "sub", q, p)))
        level = Level(place, top, 1, names={place: inside}, block=top.block)
        flags.append(out.number(covered, level))
        ties.append(out.number(tie, level))
        length = out.assign(top, "sub", q, p)
        short = out.assign(top, "and", out.assign(top, "gt0", length), out.assign(top, "gt0", out.assign(top, "sub", touch, length)))
        doubts += [out.assign(top, "and", short, _is_nearly_tied(out, g, level)) for g in functions]
    if is_known:
        flags[0] = out.assign(top, "select", out.assign(top, "and", *is_known) if len(is_known) > 1 else is_known[0], flags[0], NAN)
    doubt: Arg = 0.0
    if doubts:
        doubt = out.assign(top, "select", out.assign(top, "or", *doubts) if len(doubts) > 1 else doubts[0], 1.0, 0.0)
    called = tuple(Called(*f) for f in out.functions)
    outputs = (*places, *flags, *ties, doubt)
    return without_dead_code(Program(tuple(parameters), tuple(top.block), outputs, tuple(Tie(*t) for t in out.ties), called))


def _is_nearly_tied(out: Emitter, g: Expr, level: Level) -> Arg:
    """Returns whether a function is nearly 0 to rounding at a place, but is not."""
    size, scale = out.size(g, level), out.rounding.tie_scale(g, level)
    above, below = (out.assign(level, "sub", size, out.assign(level, "mul", factor, scale)) for factor in (TIE_EPS, CLEAR))
    return out.assign(level, "and", out.assign(level, "gt0", above), out.assign(level, "lt0", below))


def _roots_of(g: Expr, place: Var, ends: tuple[Param, Param], roots: Roots, top: Level) -> list[Arg]:
    """Returns the roots of a function by formulas; none if there are no formulas."""
    formulas = solve(g, place, *ends)
    if formulas is not None and formulas.certain:
        return [roots.point(root, top) for root in formulas.found]
    return []


def _isolation(g: Expr, place: Var, roots: Roots) -> Isolation:
    found = isolate(g, place, roots.max_roots)
    assert found is not None, "whoever makes gaps has seen to it"
    return found


def _may_tie(condition: Cond) -> bool:
    return any(isinstance(n, Compare) and n.resolution is not None for n in postorder([condition]))


def _applies(covered: Expr, place: Var, out: Emitter, top: Level) -> str | None:
    """Returns a condition without which no place is covered: along its own edge a candidate is 0."""
    condition, _ = nonzero_part(covered)
    parts = condition.children if isinstance(condition, And) else (condition,)
    outside = conjunction(*(c for c in cast("Sequence[Cond]", parts) if place not in c.free and not _may_tie(c)))
    holds = out.truths(outside, top)[0]
    return holds if isinstance(holds, str) else None


def _inside(out: Emitter, top: Level, p: Arg, first: Arg, last: Arg) -> Arg:
    """Returns a place, +inf if it does not lie between the ends."""
    after = out.assign(top, "gt0", out.assign(top, "sub", p, first))
    before = out.assign(top, "gt0", out.assign(top, "sub", last, p))
    return out.assign(top, "select", out.assign(top, "and", after, before), p, math.inf)


def _ascending(out: Emitter, top: Level, places: list[Arg]) -> list[Arg]:
    """Returns numbers in ascending order, by exchanges of neighbours (Batcher's network of odd and even ones is shorter, but these are
    few)."""
    places = list(places)
    for end in range(len(places) - 1, 0, -1):
        for i in range(end):
            low, high = (out.assign(top, op, places[i], places[i + 1]) for op in ("min", "max"))
            places[i], places[i + 1] = low, high
    return places
