"""Integrals of closed form over one interval: all conditions hold between two places, and nowhere else.

    ∫ₗʰ [g₁ > 0]·…·[gₙ > 0]·f dx  =  (q - p)·mean of f over (p, q)

Each gᵢ changes its sign once, at its root, so it moves one end of the interval. Which one is known where the slope of gᵢ is a number;
elsewhere one value of gᵢ tells, on the longer side of its root. The number of operations is linear in that of the conditions, and
there is no loop. Integrands with conditions that hold on several pieces are computed piece by piece (`teg.passes.lower.integrals`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

from teg.analysis.breaks import Breaks
from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import solve
from teg.analysis.tails import is_unbounded
from teg.ir.cells import replaced
from teg.ir.expr import FALSE, TRUE, ZERO, Add, Call, Compare, Cond, Const, Expr, Mul, Var
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.passes.lower.emit import NAN, Emitter, Level
from teg.passes.lower.means import P, Q, mean_of, without_tails
from teg.program import INSIDE, Arg

MOST_CONDITIONS = 4


class Side(NamedTuple):
    """A condition that holds on one side of its root, or, unless `holds`, whose negation is asked for; `rising` says whether its function
    grows, None if that is known at run time only. Where the number `rate` is 0 the function is constant and has no root."""

    atom: Compare
    root: Expr
    holds: bool
    rising: bool | None
    rate: Expr | None


class Interval(NamedTuple):
    """The conditions of integrands, and the means of these where the conditions hold."""

    sides: tuple[Side, ...]
    means: tuple[Expr, ...]


def interval_of(group: Sequence[Integral], breaks: Breaks) -> Interval | None:
    """Returns the conditions and means of integrals that share their bounds and breaks; None if they live on several pieces."""
    x, bodies = group[0].var, [i.body for i in group]
    if breaks.isolated or breaks.located or any(b.has_integral for b in bodies):
        return None
    atoms = [n for n in postorder(bodies) if isinstance(n, Compare) and x in n.free]
    if len(atoms) > MOST_CONDITIONS or not _one_each(atoms, breaks):
        return None
    sides: list[Side] = []
    for atom in atoms:
        side = _side(atom, group[0], bodies)
        if side is None:
            return None
        sides.append(side)
    truth: dict[Node, Expr] = {s.atom: cast(Expr, cast(Node, TRUE if s.holds else FALSE)) for s in sides}
    means = [mean_of(b, x) for b in replaced(bodies, truth)]
    if any(m is None for m in means):
        return None
    return Interval(tuple(sides), tuple(m.mean for m in means if m is not None))


def _one_each(atoms: Sequence[Compare], breaks: Breaks) -> bool:
    """Returns whether the conditions, each on a function of its own, are all that breaks the integrand."""
    return len({a.g for a in atoms}) == len(atoms) and len(breaks.functions) <= len(atoms)


def _side(atom: Compare, node: Integral, bodies: Sequence[Expr]) -> Side | None:
    """Returns the condition with its root, if no integrand lives on both sides of it."""
    truths: list[Cond] = [FALSE, TRUE]
    dead = [t for t in truths if all(b is ZERO for b in replaced(bodies, {atom: cast(Expr, cast(Node, t))}))]
    if not dead or not _is_monotone(atom.g, node.var):
        return None
    roots = solve(atom.g, node.var, node.lo, node.hi)
    if roots is None or len(roots.found) != 1 or not roots.certain:
        return None
    rate = slope(atom.g, node.var)
    rising = rate.data > 0 if isinstance(rate, Const) and rate.data and math.isfinite(rate.data) else None
    if rising is None and atom.resolution is not None and Shadow((node.var,)).degree(atom.g) != 1:
        return None  # a tie is then looked at in several places
    return Side(atom, roots.found[0].point, dead[0] is FALSE, rising, None if node.var in rate.free else rate)


def _is_monotone(g: Expr, x: Var) -> bool:
    """Returns whether g is an affine function, or one exponential of an affine function and what does not depend on x."""
    if Shadow((x,)).degree(g) == 1:
        return True
    terms = [t for t in (g.children if isinstance(g, Add) else (g,)) if x in t.free]
    if len(terms) != 1:
        return False
    factors = [f for f in (terms[0].children if isinstance(terms[0], Mul) else (terms[0],)) if x in f.free]
    only = factors[0]
    return len(factors) == 1 and isinstance(only, Call) and only.name == "exp" and Shadow((x,)).degree(only.children[0]) == 1


def integrals_over_interval(out: Emitter, group: Sequence[Integral], interval: Interval, home: Level, when: str | None) -> Sequence[Arg]:
    """Returns the results of integrals over the interval where their conditions hold."""
    at = _Places(out, home)
    node = group[0]
    lo, hi = without_tails(group) if is_unbounded(node) else (node.lo, node.hi)
    p, q, sign = at.ordered(out.number(lo, home), out.number(hi, home))
    known: list[Arg] = []
    for side in interval.sides:
        p, q = at.cut(side, node.var, p, q, known)
    length = out.assign(home, "v", "sub", q, p)
    between = home.inside(P, p).inside(Q, q)
    for level in (between, cast(Level, between.outer)):
        level.block = home.block
    dead = out.assign(home, "b", "le0", length)
    results: list[Arg] = []
    for mean in interval.means:
        value: Arg = out.assign(home, "v", "mul", *([] if sign == 1.0 else [sign]), length, out.number(mean, between))
        value = out.assign(home, "v", "select", dead, 0.0, value)
        for condition in known:
            value = out.assign(home, "v", "select", condition, value, NAN)
        results.append(value if when is None else out.assign(home, "v", "select", when, value, 0.0))
    return results


class _Places:
    """Numbers of an interval, as statements of one level."""

    def __init__(self, out: Emitter, home: Level) -> None:
        self.out, self.home = out, home

    def put(self, op: str, *args: Arg) -> Arg:
        return self.out.assign(self.home, "b" if op in ("gt0", "le0", "lt0", "ok", "and", "or", "not") else "v", op, *args)

    def ordered(self, lo: Arg, hi: Arg) -> tuple[Arg, Arg, Arg]:
        """Returns the smaller bound, the larger one, and the sign of the integral."""
        if not isinstance(lo, str) and not isinstance(hi, str):
            return (lo, hi, 1.0) if lo <= hi else (hi, lo, -1.0)
        upwards = self.put("gt0", self.put("sub", hi, lo))
        return self.put("min", lo, hi), self.put("max", lo, hi), self.put("select", upwards, 1.0, -1.0)

    def cut(self, side: Side, x: Var, p: Arg, q: Arg, known: list[Arg]) -> tuple[Arg, Arg]:
        """Returns the part of (p, q) where a condition holds; what has to be true for it to be a number is added to `known`."""
        root = self.out.number(side.root, self.home)
        if side.rising is not None:
            return (self.put("max", p, root), q) if side.rising == side.holds else (p, self.put("min", q, root))
        before = self.put("gt0", self.put("sub", root, p))
        if side.rate is not None:  # all of (p, q) is then right of the root
            before = self.put("and", before, self.put("gt0", self.put("abs", self.out.number(side.rate, self.home))))
        place = self.put("select", before, self.put("min", root, q), p)
        left, right = self.put("sub", place, p), self.put("sub", q, place)
        looks_left = self.put("gt0", self.put("sub", left, right))
        spot = self.put(
            "select",
            looks_left,
            self.put("add", p, self.put("mul", INSIDE, left)),
            self.put("add", place, self.put("mul", INSIDE, right)),
        )
        level = self.home.inside(x, spot)
        level.block = self.home.block
        holds, fails = self.out.truths(side.atom, level)
        known.append(self.put("or", holds, fails))
        if not side.holds:
            holds, fails = fails, holds
        on_left = self.put("or", self.put("and", holds, looks_left), self.put("not", self.put("or", holds, looks_left)))
        return self.put("select", on_left, p, place), self.put("select", on_left, place, q)
