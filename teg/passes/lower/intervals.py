"""Integrals of closed form over one interval: all conditions hold between two places, and nowhere else.

    ∫ₗʰ [g₁ > 0]·…·[gₙ > 0]·f dx  =  (q - p)·mean of f over (p, q)

A gᵢ that changes its sign once, at its root, moves one end of the interval. Which one is known where the slope of gᵢ is a number;
elsewhere one value of gᵢ tells, on the longer side of its root. A polynomial that is concave, of even degree with a number as its leading
coefficient, is positive between its two roots, if it has any, and moves both ends. The number of operations is linear in that of the
conditions, and there is no loop. Integrands with conditions that hold on several pieces are computed piece by piece
(`teg.passes.lower.integrals`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

from teg.analysis.breaks import Breaks
from teg.analysis.calculus import slope
from teg.analysis.intervals import enclose
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import Root, solve
from teg.analysis.tails import is_unbounded
from teg.ir.cells import replaced
from teg.ir.expr import FALSE, TRUE, ZERO, Add, Call, Compare, Cond, Const, Expr, Mul, Var, const
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import mul
from teg.passes.lower.emit import NAN, Emitter
from teg.passes.lower.gaussian import mean_at_nodes
from teg.passes.lower.levels import Level
from teg.passes.lower.means import P, Q, mean_of, without_tails
from teg.program import INSIDE, Arg

MOST_CONDITIONS, MOST_DEGREE = 4, 8


class Side(NamedTuple):
    """A condition that holds on one side of its root, or, unless `holds`, whose negation is asked for; `rising` says whether its function
    grows, None if that is known at run time only. Where the number `rate` is 0 the function is constant and has no root."""

    atom: Compare
    root: Expr
    holds: bool
    rising: bool | None
    rate: Expr | None


class Between(NamedTuple):
    """A condition that holds between two roots, or whose negation does unless `holds`; nowhere if one of them does not exist."""

    atom: Compare
    roots: tuple[Root, ...]
    holds: bool


class Interval(NamedTuple):
    """The conditions of integrands, and the means of these where the conditions hold."""

    sides: tuple[Side | Between, ...]
    means: tuple[Expr, ...]


def interval_of(group: Sequence[Integral], breaks: Breaks, nodes: int | None = None) -> Interval | None:
    """Returns the conditions and means of integrals that share their bounds and breaks; None if they live on several pieces. Means are in
    closed form, or those of so many `nodes` of Gauss."""
    x, bodies = group[0].var, [i.body for i in group]
    if breaks.isolated or breaks.located or any(b.has_integral for b in bodies):
        return None
    atoms = [n for n in postorder(bodies) if isinstance(n, Compare) and x in n.free]
    if len(atoms) > MOST_CONDITIONS or not _one_each(atoms, breaks):
        return None
    sides: list[Side | Between] = []
    for atom in atoms:
        side = _side(atom, group[0], bodies)
        if side is None:
            return None
        sides.append(side)
    truth: dict[Node, Expr] = {s.atom: cast(Expr, cast(Node, TRUE if s.holds else FALSE)) for s in sides}
    smooth = replaced(bodies, truth)
    if nodes is not None:
        return Interval(tuple(sides), tuple(mean_at_nodes(b, x, P, Q, nodes) for b in smooth))
    means = [mean_of(b, x) for b in smooth]
    if any(m is None for m in means):
        return None
    return Interval(tuple(sides), tuple(m.mean for m in means if m is not None))


def _one_each(atoms: Sequence[Compare], breaks: Breaks) -> bool:
    """Returns whether the conditions, each on a function of its own, are all that breaks the integrand."""
    return len({a.g for a in atoms}) == len(atoms) and len(breaks.functions) <= len(atoms)


def _side(atom: Compare, node: Integral, bodies: Sequence[Expr]) -> Side | Between | None:
    """Returns the condition with its roots, if no integrand lives both where it holds and where it fails."""
    truths: list[Cond] = [FALSE, TRUE]
    dead = [t for t in truths if all(b is ZERO for b in replaced(bodies, {atom: cast(Expr, cast(Node, t))}))]
    if not dead:
        return None
    monotone = _is_monotone(atom.g, node.var)
    if not monotone and not _is_positive_between(atom.g if dead[0] is FALSE else mul(const(-1.0), atom.g), node.var):
        return None
    roots = solve(atom.g, node.var, node.lo, node.hi)
    if roots is None or len(roots.found) != (1 if monotone else 2) or not roots.certain:
        return None
    if not monotone:
        simple = all(root.exists is TRUE or isinstance(root.exists, Compare) for root in roots.found)
        return Between(atom, roots.found, dead[0] is FALSE) if simple else None
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


def _is_positive_between(g: Expr, x: Var) -> bool:
    """Returns whether g is a concave polynomial with a leading coefficient that is a number: it is positive between its roots only."""
    degree = Shadow((x,)).degree(g)
    if degree is None or degree % 2 or not 0 < degree <= MOST_DEGREE:
        return False
    curvature = lead = slope(slope(g, x), x)
    for _ in range(degree - 2):
        lead = slope(lead, x)
    most = enclose(curvature, {x: (const(-math.inf), const(math.inf))})[1]
    return isinstance(lead, Const) and isinstance(most, Const) and most.data <= 0.0


def integrals_over_interval(out: Emitter, group: Sequence[Integral], interval: Interval, home: Level, when: str | None) -> Sequence[Arg]:
    """Returns the results of integrals over the interval where their conditions hold."""
    at = _Places(out, home)
    node = group[0]
    lo, hi = without_tails(group) if is_unbounded(node) else (node.lo, node.hi)
    p, q, sign = at.ordered(out.number(lo, home), out.number(hi, home))
    known: list[Arg] = []
    for side in interval.sides:
        p, q = at.between(side, p, q, known) if isinstance(side, Between) else at.cut(side, node.var, p, q, known)
    length = out.assign(home, "sub", q, p)
    between = home.inside(P, p).inside(Q, q)
    for level in (between, cast(Level, between.outer)):
        level.block = home.block
    dead = out.assign(home, "le0", length)
    results: list[Arg] = []
    for mean in interval.means:
        value: Arg = out.assign(home, "mul", *([] if sign == 1.0 else [sign]), length, out.number(mean, between))
        value = out.assign(home, "select", dead, 0.0, value)
        for condition in known:
            value = out.assign(home, "select", condition, value, NAN)
        results.append(value if when is None else out.assign(home, "select", when, value, 0.0))
    return results


class _Places:
    """Numbers of an interval, as statements of one level."""

    def __init__(self, out: Emitter, home: Level) -> None:
        self.out, self.home = out, home

    def put(self, op: str, *args: Arg) -> Arg:
        return self.out.assign(self.home, op, *args)

    def ordered(self, lo: Arg, hi: Arg) -> tuple[Arg, Arg, Arg]:
        """Returns the smaller bound, the larger one, and the sign of the integral."""
        if not isinstance(lo, str) and not isinstance(hi, str):
            return (lo, hi, 1.0) if lo <= hi else (hi, lo, -1.0)
        upwards = self.put("gt0", self.put("sub", hi, lo))
        return self.put("min", lo, hi), self.put("max", lo, hi), self.put("select", upwards, 1.0, -1.0)

    def between(self, side: Between, p: Arg, q: Arg, known: list[Arg]) -> tuple[Arg, Arg]:
        """Returns the part of (p, q) between two roots; what has to be true for it to be a number is added to `known`.

        Whether roots exist is decided in the middle of a piece of the integral around this one. No break is where it changes without a root
        between the bounds, so it is looked at here again.
        """
        there: list[Arg] = []
        for exists in dict.fromkeys(root.exists for root in side.roots):
            if isinstance(exists, Compare):
                holds, fails = self.out.truths(exists, self.home)
                known.append(self.put("or", holds, fails))
                there += [holds, self.put("ge0", self.out.number(exists.g, self.home))]
        first, last = (self.out.number(root.point, self.home) for root in side.roots)
        left, right = self.put("max", p, self.put("min", first, last)), self.put("min", q, self.put("max", first, last))
        if not there:
            return left, right
        alive = self.put("and", *there)
        return self.put("select", alive, left, p), self.put("select", alive, right, p)

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
