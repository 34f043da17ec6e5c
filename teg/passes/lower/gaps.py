"""The flat program of one candidate of `Gaps`: where it begins and ends to cover a line, and which pieces it covers.

    outputs   p₀, …, pₙ₋₁ ascending, +inf for places that are not there; whether each piece is covered; the same where it ties;
              whether borders nearly touch, so that rounding moves the places where they cross; how fast each place moves, if that counts

A piece is decided at one place inside of it. A condition ties there where it is 0 to rounding: it counts once as true, once as false, and
the mean is ½. Cost: n roots, and n + 1 times the condition.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.gates import gates_of
from teg.analysis.isolation import Isolation, isolate
from teg.analysis.roots import solve
from teg.analysis.settings import Integration
from teg.analysis.surfaces import atoms_of
from teg.ir.choices import NOTHING
from teg.ir.expr import ONE, ZERO, And, Compare, Cond, Expr, Or, Param, Var, Where
from teg.ir.node import Node
from teg.ir.simplify import bracket, disjunction, negation, nonzero_part, positive
from teg.ir.traverse import rewrite
from teg.passes.lower.emit import NAN, Emitter
from teg.passes.lower.levels import Level
from teg.passes.lower.roots import Roots
from teg.passes.lower.rounding import CLEAR
from teg.program import INSIDE, TIE_EPS, Arg, Called, Program, Tie
from teg.program.arrays import TOUCH
from teg.program.dce import without_dead_code

LEAST_TOUCH = 1e-11
"""The least length, as a part of that of its line, of a piece on which it matters that borders nearly touch: where they cross in the corner
of a mesh, rounding makes pieces that are shorter."""


class Candidate(NamedTuple):
    """Whether a candidate covers a place of a line, as 1 or 0, the same where it ties, and the velocities of its borders, as in `Gaps`."""

    covered: Expr
    tie: Expr
    velocities: Sequence[Expr] = ()


def schedule_places(candidate: Candidate, place: Var, parameters: Sequence[str], how: Integration) -> Program:
    """Returns the program of a candidate. The last two parameters are the ends of the line."""
    covered, tie, _ = candidate
    line = _Line(place, parameters, how)
    out, top = line.out, line.top
    pieces = line.pieces(covered, _by_border(candidate, place))
    is_known = [out.assign(top, "ok", p) for p in pieces.found]
    functions = list(dict.fromkeys(atom.g for atom in atoms_of(covered, place)))
    flags: list[Arg] = []
    ties: list[Arg] = []
    doubts: list[Arg] = []
    touch, least = (out.assign(top, "mul", part, out.assign(top, "sub", line.last, line.first)) for part in (TOUCH, LEAST_TOUCH))
    for p, q, level in pieces.levels:
        flags.append(out.number(covered, level))
        ties.append(out.number(tie, level))
        length = out.assign(top, "sub", q, p)
        short = out.assign(
            top,
            "and",
            out.assign(top, "gt0", out.assign(top, "sub", length, least)),
            out.assign(top, "gt0", out.assign(top, "sub", touch, length)),
        )
        doubts += [out.assign(top, "and", short, _is_nearly_tied(out, g, level)) for g in functions]
    if is_known:
        flags[0] = out.assign(top, "select", out.assign(top, "and", *is_known) if len(is_known) > 1 else is_known[0], flags[0], NAN)
    doubt: Arg = 0.0
    if doubts:
        doubt = out.assign(top, "select", out.assign(top, "or", *doubts) if len(doubts) > 1 else doubts[0], 1.0, 0.0)
    return line.program((*pieces.places, *flags, *ties, doubt, *pieces.velocities))


def _by_border(candidate: Candidate, place: Var) -> dict[Expr, Expr]:
    """Returns the velocity along the line of the border where a function is 0, for each function; nothing if nothing moves.

    A border whose condition is decided by now has no place. One whose condition consists of several by now has all of theirs that have no
    velocity of their own.
    """
    known: dict[Expr, Expr] = {}
    own: dict[Expr, Expr] = {}
    for w in candidate.velocities:
        if not isinstance(w, Where) or NOTHING not in (w.then, w.otherwise):
            continue
        velocity = w.otherwise if w.then is NOTHING else w.then
        known.update((atom.g, velocity) for atom in atoms_of(w.condition, place))
        if isinstance(w.condition, Compare):
            own[w.condition.g] = velocity
    return {**known, **own}


def schedule_matters(matters: Expr, place: Var, parameters: Sequence[str], how: Integration) -> Program:
    """Returns the program of whether places of a line matter: above 0 if there may be one where `matters` is 1. What is joined by `and` is
    looked at by itself: half a circle that is partly to the left of a box and for the rest above it counts. The last two parameters are the
    ends of the line."""
    line = _Line(place, parameters, how)
    condition, _ = nonzero_part(matters)
    found: Arg = 0.0
    for case in condition.children if isinstance(condition, Or) else (condition,):
        parts = cast("Sequence[Cond]", case.children if isinstance(case, And) else (case,))
        several = [line.somewhere(part) for part in sorted(parts, key=lambda part: place in part.free)]
        holds = several[-1]
        for one in reversed(several[:-1]):
            holds = line.out.assign(line.top, "select", line.out.assign(line.top, "gt0", one), holds, 0.0)
        found = line.out.assign(line.top, "max", found, holds)
    return line.program((found,))


class _Pieces(NamedTuple):
    """Places where a condition may change: as they are found, and ascending, +inf for those that are not there; the pieces between
    them, each with its ends and a level where the variable is a place inside of it; and the velocities of the places, if they are known."""

    found: list[Arg]
    places: list[Arg]
    levels: list[tuple[Arg, Arg, Level]]
    velocities: list[Arg]


class _Line:
    """The flat program of a line, whose ends are the last two parameters."""

    def __init__(self, place: Var, parameters: Sequence[str], how: Integration) -> None:
        def unexpected(*_: object) -> Arg:
            raise AssertionError("whether a place is covered is no integral")

        self.place, self.parameters = place, tuple(parameters)
        self.out = Emitter(parameters, cast("object", unexpected), unexpected)  # type: ignore[arg-type]
        self.roots = Roots(self.out, lambda level, nodes: None, how.max_roots, how.tol)
        self.top = Level(None, None, 0)
        self.ends = Param.make(parameters[-2], ()), Param.make(parameters[-1], ())
        self.first, self.last = (self.out.number(end, self.top) for end in self.ends)

    def pieces(self, truth: Expr, velocities: Mapping[Expr, Expr] = {}) -> _Pieces:
        """Returns the places where a condition, as 1 or 0, may change, given the velocities of the places where functions are 0."""
        out, top, place = self.out, self.top, self.place
        surfaces: dict[Expr, list[Compare]] = {}
        for atom in atoms_of(truth, place):
            surfaces.setdefault(atom.g, []).append(atom)
        found: list[Arg] = []
        moving: list[Arg] = []
        for g, atoms in surfaces.items():
            when = _applies(truth, atoms, out, top)
            by_formulas = _roots_of(g, place, self.ends, self.roots, top)
            if when is not None:
                by_formulas = [out.assign(top, "select", when, p, math.inf) for p in by_formulas]
            roots = by_formulas or self.roots.isolated(_isolation(g, place, self.roots), *self.ends, top, when)
            found += roots
            if velocities:
                velocity = ZERO if slope(g, place) is ZERO else velocities[g]
                moving += [out.number(velocity, Level(place, top, 1, names={place: p}, block=top.block)) for p in roots]
        between = [_is_inside(out, top, p, self.first, self.last) for p in found]
        places: list[Arg] = [out.assign(top, "select", inside, p, math.inf) for p, inside in zip(found, between, strict=True)]
        if moving:  # 0 for most borders, which do not cross the line: backends may branch there
            moving = [out.assign(top, "select", inside, v, 0.0) for v, inside in zip(moving, between, strict=True)]
            places, moving = _ascending_with(out, top, places, moving)
        else:
            places = _ascending(out, top, places)
        levels: list[tuple[Arg, Arg, Level]] = []
        for p, q in pairwise([self.first, *(out.assign(top, "min", p, self.last) for p in places), self.last]):
            inside = out.assign(top, "add", p, out.assign(top, "mul", INSIDE, out.assign(top, "sub", q, p)))
            levels.append((p, q, Level(place, top, 1, names={place: inside}, block=top.block)))
        return _Pieces(found, places, levels, moving)

    def somewhere(self, condition: Cond) -> Arg:
        """Returns 1 if a condition holds on one of the pieces or ties there, else 0."""
        found: Arg = 0.0
        for truth in (bracket(condition), bracket(_with_other_ties(condition))):
            for _, _, level in self.pieces(truth).levels:
                found = self.out.assign(self.top, "max", found, self.out.number(truth, level))
        return found

    def program(self, outputs: tuple[Arg, ...]) -> Program:
        called = tuple(Called(*f) for f in self.out.functions)
        ties = tuple(Tie(*t) for t in self.out.ties)
        return without_dead_code(Program(self.parameters, tuple(self.top.block), outputs, ties, called))


def _with_other_ties(condition: Cond) -> Cond:
    """Returns a condition that holds at a tie where the other one does not."""

    def visit(_: Node, new: Node) -> Node:
        if not isinstance(new, Compare) or new.resolution is None:
            return new
        return positive(new.g, new.strict, negation(new.resolution), new.rivals)

    return cast(Cond, rewrite([condition], visit)[condition])


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


def _applies(covered: Expr, atoms: Sequence[Compare], out: Emitter, top: Level) -> str | None:
    """Returns what must hold for the atoms of a function to matter, which may be 0 everywhere where it does not."""
    outside, rest = nonzero_part(covered)
    if rest is not ONE:
        return None
    gate = disjunction(*gates_of(outside, atoms))
    holds = out.truths(gate, top)[0]
    return holds if isinstance(holds, str) else None


def _is_inside(out: Emitter, top: Level, p: Arg, first: Arg, last: Arg) -> str:
    """Returns whether a place lies between the ends."""
    after = out.assign(top, "gt0", out.assign(top, "sub", p, first))
    before = out.assign(top, "gt0", out.assign(top, "sub", last, p))
    return out.assign(top, "and", after, before)


def _ascending(out: Emitter, top: Level, places: list[Arg]) -> list[Arg]:
    """Returns numbers in ascending order, by exchanges of neighbours (Batcher's network of odd and even ones is shorter, but these are
    few)."""
    places = list(places)
    for end in range(len(places) - 1, 0, -1):
        for i in range(end):
            low, high = (out.assign(top, op, places[i], places[i + 1]) for op in ("min", "max"))
            places[i], places[i + 1] = low, high
    return places


def _ascending_with(out: Emitter, top: Level, places: list[Arg], others: list[Arg]) -> tuple[list[Arg], list[Arg]]:
    """Returns numbers in ascending order, and others, which belong to them, in the same order."""
    places, others = list(places), list(others)
    for end in range(len(places) - 1, 0, -1):
        for i in range(end):
            (p, q), (u, v) = places[i : i + 2], others[i : i + 2]
            swapped = out.assign(top, "gt0", out.assign(top, "sub", p, q))
            places[i : i + 2] = out.assign(top, "min", p, q), out.assign(top, "max", p, q)
            others[i : i + 2] = out.assign(top, "select", swapped, v, u), out.assign(top, "select", swapped, u, v)
    return places, others
