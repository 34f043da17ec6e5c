"""Where the pieces of each integral begin and end.

The integrand of ∫ dx is smooth between its *breaks*. Breaks are the roots in x of

- the atoms in x, wherever they stand in the integrand, its inner integrals and their bounds; arguments of |·| and √; cuts of angles;
- the projection of each inner integral (`projection.py`).

A function with branches contributes the breaks of each branch: too many breaks cost time, never accuracy. Functions whose roots have no
formula leave the integral *incomplete*: it is then integrated adaptively.
Source: Saye 2022, for quadrature on such pieces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

from teg.analysis.branches import branches_of, cases_of
from teg.analysis.break_functions import BreakFunctions
from teg.analysis.guards import support, weakened
from teg.analysis.isolation import MAX_ROOTS, Isolation, Location, has_pole, isolate, locate
from teg.analysis.kinks import EXTREMES, kink_of, without_extremes
from teg.analysis.polynomial import Poly, Ratio, Shadow
from teg.analysis.projection import Contribution, Origin, Projection, Turn
from teg.analysis.surfaces import atoms_of, binders_inside
from teg.ir.expr import FALSE, TRUE, Add, Call, Compare, Cond, Const, Expr, Mul, Or, Pow, Var, Where, const, has_cut
from teg.ir.integral import ClosedForm, Integral, masses_of
from teg.ir.node import Node, digest, nodes_of, postorder_to
from teg.ir.simplify import collected, conjunction, disjunction, mul, sub, where
from teg.ir.traverse import substitute
from teg.numerics.field import divided, residue

MAX_LOCATED = 12
MAX_BENDS = 8
MAX_PLACES = 8
MAX_ISOLATED = 16
"""The largest number of functions whose roots are isolated if these are all that have no formula: the integrand is smooth between them."""
SOME_ISOLATED = 12
"""How many are isolated if there are more of them: the integral is adaptive then in any case, and each search takes time."""


@dataclass(frozen=True)
class Breaks:
    """The breaks of one integral.

    `functions` are the break functions, `points` their roots in closed form, with the factor that is 0 there. `matters` maps a function
    whose roots are found at run time to a condition: evaluated at a root, it says whether the root is a break inside the inner bounds.
    `isolated` are the functions whose roots are found at run time; `located` are the pairs of them whose common zeros are found at run
    time, where no better break is known. `handled` are the surfaces g whose sign is constant on every piece. `complete` says that the
    integrand is smooth on every piece. `bends` are the points where the integrand turns into another branch, also outside of a piece.
    `rooted` says that the integrand may behave like a square root at the end of a piece for other reasons. `origins` maps functions to
    the surfaces that meet where they are 0, if the integrand is linear in the integrals that they come from.
    """

    functions: tuple[Expr, ...]
    points: Mapping[Expr, Expr]
    isolated: tuple[Isolation, ...]
    located: tuple[Location, ...]
    handled: frozenset[Expr]
    complete: bool
    rooted: bool
    bends: tuple[Turn, ...] = ()
    matters: Mapping[Expr, Cond] = field(default_factory=dict)
    origins: Mapping[Expr, Origin] = field(default_factory=dict)


class BreakAnalysis:
    """Breaks and degrees of the integrals of a program, each computed once."""

    def __init__(self, max_roots: int = MAX_ROOTS, differentiated: Sequence[Expr] = ()) -> None:
        """`differentiated` are expressions of whose derivatives the program consists: where an integral over z is smooth in the parameters
        and in what is outside, and its integrand in z, so are the integrands over z of its derivatives."""
        self.max_roots = max_roots
        self._differentiated: dict[tuple[Var, Expr, Expr], dict[Integral, None]] = {}
        for node in nodes_of(Integral, *differentiated):
            self._differentiated.setdefault((node.var, node.lo, node.hi), {})[node] = None
        self._breaks: dict[Integral, Breaks] = {}
        self._projections: dict[Integral, Contribution] = {}
        self._shadows: dict[tuple[Var, ...], Shadow] = {}
        self.functions = BreakFunctions()

    # -- breaks --------------------------------------------------------------------------------------------------------

    def of(self, node: Integral) -> Breaks:
        """Returns the breaks of an integral; the breaks of its inner integrals are computed first."""
        if node not in self._breaks:
            for inner in nodes_of(Integral, node):
                if inner not in self._breaks:
                    self._breaks[inner] = self._find(inner)
        return self._breaks[node]

    def _find(self, node: Integral) -> Breaks:
        x, body = node.var, node.body
        inner = binders_inside(body)
        masses = masses_of(body, x)
        if masses is not None:  # no breaks of its own; its roots and its conditions contribute to outer integrals
            atoms = [a.g for a in atoms_of(body, x) if not a.g.free & inner]
            formula = self.functions.solve(masses.g, x, node.lo, node.hi)
            complete = formula is not None and formula.certain
            return Breaks(tuple(dict.fromkeys((masses.g, *atoms))), {}, (), (), frozenset(), complete, False)
        projection = Contribution()
        direct = [a.g for a in atoms_of(body, x) if not a.g.free & inner]
        for g in direct:
            projection.add(g)
        self._collect(body, x, inner, projection)
        points: dict[Expr, Expr] = {}
        handled: set[Expr] = set()
        complete = projection.complete
        functions, matters = self._distinct(projection.functions)
        found = {g: self._roots(g, x, node.lo, node.hi) for g in dict.fromkeys(functions.values()) if not self.functions.is_zero(g)}
        isolated = self._isolated([g for g, roots in found.items() if roots is None], node)
        for f, representative in functions.items():
            if representative not in found:  # a surface that coincides with the surface of these point masses
                handled.add(f)
                continue
            roots = found[representative]
            if roots is not None and roots[1]:
                handled.add(f)
            elif representative in isolated:
                handled.add(f)
                continue
            else:
                complete = False
            for r, factor in roots[0] if roots is not None else ():
                kept = _kept(r, matters[representative], x)
                if not _outside(r, node.lo, node.hi) and not (isinstance(kept, Const) and math.isnan(kept.data)):
                    points[kept] = factor
        distinct = tuple(dict.fromkeys(functions.values()))
        located = [locate(f, g, z, low, high, x) for f, g, z, low, high in list(projection.meetings)[:MAX_LOCATED]]
        together = tuple(m for m in located if m is not None)
        bends = self._bends(projection, node)  # which may find that the projection is rooted
        breaks = Breaks(
            distinct,
            points,
            tuple(isolated.values()),
            together,
            frozenset(handled),
            complete,
            projection.rooted,
            bends,
            matters,
            _origins(projection, functions) if _is_linear_in_integrals(body) else {},
        )
        return breaks if complete else self._with_those_of_the_source(breaks, node, direct)

    def _isolated(self, functions: Sequence[Expr], node: Integral) -> dict[Expr, Isolation]:
        """Returns those of some functions without a formula whose roots are found at run time: of those with a pole, where the body is not
        0 to all that is known by formula."""
        x, body, inner = node.var, node.body, binders_inside(node.body)
        chosen = functions if len(functions) <= MAX_ISOLATED else functions[:SOME_ISOLATED]
        isolations = ((f, isolate(f, x, self.max_roots)) for f in chosen)
        found = {f: i for f, i in isolations if i is not None}
        if not any(has_pole(f, x) for f in found):
            return found
        terms = body.children if isinstance(body, Add) else (body,)
        region = disjunction(*(weakened(support(e), lambda g: self._is_short(g, x, inner)) for e in terms))
        return {f: i.inside(region) if has_pole(f, x) else i for f, i in found.items()} if region is not TRUE else found

    def _is_short(self, g: Expr, x: Var, inner: frozenset[Var]) -> bool:
        """Returns whether g is linear or quadratic in x, not in variables further in. So it is none of the functions without a formula."""
        return not g.has_integral and not g.free & inner and self.functions.degrees.of(g, x) in (1, 2)

    def _with_those_of_the_source(self, found: Breaks, node: Integral, direct: Sequence[Expr]) -> Breaks:
        """Returns breaks of which some are not known with those of the integrals whose derivative this is: if all of these are known, only
        the roots of atoms are searched for besides."""
        sources = self._differentiated.get((node.var, node.lo, node.hi), {})
        known = [self.of(source) for source in sources if source.free <= node.free] if node not in sources else []
        if not known:
            return found
        wanted, enough = frozenset(direct), all(b.complete for b in known)
        every = [found, *known]
        return replace(
            found,
            functions=tuple(dict.fromkeys(f for b in every for f in b.functions)),
            points={p: factor for b in every for p, factor in b.points.items()},
            isolated=tuple(dict.fromkeys(i for b in every for i in b.isolated if b is not found or not enough or i.g in wanted)),
            located=() if enough else tuple(dict.fromkeys(m for b in every for m in b.located)),
            rooted=True,
            bends=tuple(dict.fromkeys(t for b in every for t in b.bends))[:MAX_BENDS],
            matters={f: c for b in every for f, c in b.matters.items()},
        )

    def _bends(self, projection: Contribution, node: Integral) -> tuple[Turn, ...]:
        """Returns the distinct turns that are quadratic in the variable, or have two roots by formula. Other turns only set `rooted`: the
        integrand may be a root at a piece's end. A function with branches has a turn for each of them."""
        x = node.var
        bends: dict[object, Turn] = {}
        cases = {turn: _cases(turn, x) for turn in projection.turns}
        projection.rooted |= any(not split and turn.kind != "pole" for turn, split in cases.items())
        for turn in (turn for split in cases.values() for turn in split):
            if turn.kind == "flat":
                turn = self._by_roots(turn, node)
            degree = self.functions.degrees.of(turn.function, x)
            if degree == 0:
                continue
            key = turn.kind, self.functions.key(turn.function)
            known = bends.get(key)
            if known is not None:
                bends[key] = replace(known, when=disjunction(known.when, turn.when))
            elif degree in (1, 2) and len(bends) < MAX_BENDS:
                bends[key] = turn
            elif turn.kind != "pole":
                projection.rooted = True
        return tuple(bends.values())

    def _by_roots(self, turn: Turn, node: Integral) -> Turn:
        """Returns a turn at the end of a piece, by the quadratic function with the same two roots where one by formula has them."""
        quadratic = self.functions.degrees.of(turn.function, node.var) in (1, 2)
        formula = None if quadratic else self.functions.solve(turn.function, node.var, node.lo, node.hi)
        if formula is None or not formula.certain or len(formula.found) != 2:
            return replace(turn, kind="end")
        function = mul(*(sub(node.var, r.point) for r in formula.found))
        return Turn("end", function, conjunction(turn.when, *(r.exists for r in formula.found)))

    def _collect(self, body: Expr, x: Var, inner: frozenset[Var], collected: Contribution) -> None:
        """Collects functions that are not atoms: arguments of |·| and √, and the projections of inner integrals."""
        seen: set[tuple[Node, bool]] = set()
        stack: list[tuple[Node, bool]] = [(body, True)]
        while stack:
            node, counts = stack.pop()
            if (node, counts) in seen or x not in node.free:
                continue
            seen.add((node, counts))
            if isinstance(node, ClosedForm):
                stack.extend((c, counts) for c in node.terms)
                for f in (*node.kinks, *node.births) if counts and not node.free & inner else ():
                    collected.add(f)
                collected.turns.update((Turn("root", f), None) for f in node.births if counts and not node.free & inner)
                continue
            if isinstance(node, Compare):  # only the roots of its own atoms matter, not where these atoms are smooth
                stack.append((node.g, counts and bool(node.g.free & inner)))
            else:
                stack.extend((c, counts) for c in node.children)
            if isinstance(node, Call) and not counts and node.name in _PARTIAL and not node.free & inner and not _is_sum_of_squares(node):
                collected.add(node.children[0])  # the border of the set on which the condition is a number
            if has_cut(node) and not node.free & inner:  # where it jumps a condition may change its sign without a root
                collected.add(cast(Expr, node.children[0]))
            if isinstance(node, Call) and not node.free & inner:
                if node.name in EXTREMES:
                    if counts:
                        collected.add(kink_of(node))
                elif node.name in ("sqrt", "root", "pow"):
                    for factor in _factors(node.children[0], x) if counts else ():
                        collected.add(factor)
                        collected.turns[Turn("end" if node.name == "pow" else "root", factor)] = None
                elif node.name == "log":
                    for factor in _factors(node.children[0], x) if counts else ():
                        collected.turns[Turn("end", factor)] = None
                elif node.name in ("floor", "mod"):
                    collected.complete = False
            elif isinstance(node, Pow) and node.exponent < 0 and counts and not node.free & inner:
                base = _with_the_same_zeros(node.base)
                if self.functions.degrees.of(base, x) in (1, 2):
                    collected.add(base)
                    collected.turns[Turn("pole", base)] = None
            elif isinstance(node, Integral):
                projection = self._projection(node)
                collected.complete &= projection.complete
                collected.rooted |= projection.rooted
                for f, condition in projection.functions.items():
                    if x in f.free and not f.free & inner:
                        condition = TRUE if condition.free & inner else condition
                        collected.add(f, condition, projection.origins[f])
                for turn in projection.turns:
                    if x in turn.function.free and not (turn.function.free | turn.when.free) & inner:
                        collected.turns[turn] = None
                for meeting in projection.meetings:
                    first, second, z, low, high = meeting
                    free = (first.free | second.free) - {z} | low.free | high.free
                    if x in free and x not in low.free | high.free and not free & inner:
                        collected.meetings[meeting] = None

    def _distinct(self, functions: dict[Expr, Cond]) -> tuple[dict[Expr, Expr], dict[Expr, Cond]]:
        """Returns the first proportional function for each function, and for each first function the condition under which its zeros
        matter."""
        first: dict[object, Expr] = {}
        distinct = {f: first.setdefault(self.functions.key(f), f) for f in functions} if len(functions) > 1 else {f: f for f in functions}
        matters: dict[Expr, Cond] = {}
        for f, representative in distinct.items():
            condition = disjunction(matters.get(representative, FALSE), functions[f])
            matters[representative] = TRUE if isinstance(condition, Or) and len(condition.children) > MAX_PLACES else condition
        return distinct, matters

    def _roots(self, f: Expr, x: Var, lo: Expr, hi: Expr) -> tuple[list[tuple[Expr, Expr]], bool] | None:
        """Returns the roots of a function over all its branches, with the factor that is 0 there, and whether these are certainly all; else
        the rule searches for others.

        None if no formula is known.
        """
        points: list[tuple[Expr, Expr]] = []
        certain = True
        branches = branches_of(without_extremes(f, x))
        if branches is None:
            return None
        for factor in dict.fromkeys(factor for branch in branches for factor in _factors(branch, x)):
            roots = self.functions.solve(factor, x, lo, hi)
            if roots is None:
                return None
            points.extend((r.point if r.exists is TRUE else where(r.exists, r.point, const(math.nan)), factor) for r in roots.found)
            certain &= roots.certain
        return points, certain

    def _projection(self, node: Integral) -> Contribution:
        if node not in self._projections:
            self._projections[node] = Projection(self, node).run()
        return self._projections[node]

    # -- degrees -------------------------------------------------------------------------------------------------------

    def degree(self, node: Integral) -> int | None:
        """Returns the degree of the integrand in the variable on each piece; None if it is not known to be a polynomial."""
        if not self.of(node).complete:
            return None
        return self.shadow((node.var,)).degree(node.body)

    def shadow(self, variables: tuple[Var, ...]) -> Shadow:
        """Returns normal forms of integrands as polynomials in variables; integrals inside them are written out."""
        if variables not in self._shadows:
            self._shadows[variables] = Shadow(variables, integral=lambda inner: self._integral_shadow(inner, variables), kinks=True)
        return self._shadows[variables]

    def _integral_shadow(self, node: Integral, variables: tuple[Var, ...]) -> Ratio | None:
        """Returns an integral as a polynomial of outer variables: a random combination of its antiderivative at its bounds and breaks."""
        breaks = self.of(node)
        if not breaks.complete or node.var in variables or any(v in i.g.free for i in breaks.isolated for v in variables):
            return None
        inner = self.shadow((node.var, *variables)).polynomial(node.body)
        if inner is None:
            return None
        shadow = self.shadow(variables)
        ends = [shadow.of(e) for e in (node.lo, node.hi, *map(_where_it_exists, breaks.points))]
        if any(e is None for e in ends):
            return None
        total: Ratio | None = shadow.constant(0)
        for k, end in enumerate(cast("list[Ratio]", ends)):
            at_end = _antiderivative_at(shadow, inner, end)
            if at_end is None or total is None:
                return None
            total = shadow._sum([total, shadow._scale(at_end, residue("end", digest(node), k))])
        return total


def _antiderivative_at(shadow: Shadow, inner: Poly, end: Ratio) -> Ratio | None:
    """∫ inner dz at z = end: monomials c·zⁱ·rest become c/(i+1)·endⁱ⁺¹·rest."""
    one = shadow.constant(1)
    powers: list[Ratio] = [one]
    total: Ratio | None = shadow.constant(0)
    for i in range(max((m[0] for m in inner), default=0) + 1):
        step = shadow._product(powers[-1], end)
        if step is None:
            return None
        powers.append(step)
        coefficient: Poly = {m[1:]: divided(c, i + 1) for m, c in inner.items() if m[0] == i}
        if coefficient:
            total = shadow._sum([total, shadow._product((coefficient, one[1]), step)])
            if total is None:
                return None
    return total


def _origins(projection: Contribution, distinct: Mapping[Expr, Expr]) -> dict[Expr, Origin]:
    """Returns the origin of the first of proportional functions; an empty one if their origins differ."""
    found: dict[Expr, Origin] = {}
    for f, first in distinct.items():
        origin = projection.origins[f]
        if found.setdefault(first, origin) != origin:
            found[first] = frozenset()
    return found


def _is_linear_in_integrals(body: Expr) -> bool:
    """Returns whether a function is a sum of integrals, each times a function without integrals."""
    degree: dict[Node, int] = {}
    for node in postorder_to([body], Integral.bit):
        degrees = [degree.get(c, 0) for c in node.children]
        if isinstance(node, Integral | ClosedForm):
            degree[node] = 1
        elif isinstance(node, Mul):
            degree[node] = sum(degrees)
        elif isinstance(node, Add) or (isinstance(node, Where) and not node.condition.has_integral):
            degree[node] = max(degrees)
        else:
            return False
        if degree[node] > 1:
            return False
    return True


def _kept(root: Expr, matters: Cond, x: Var) -> Expr:
    """Returns the root where it matters, NaN elsewhere."""
    if matters is TRUE:
        return root
    return where(cast(Cond, substitute(matters, {x: root})), root, const(math.nan))


def _where_it_exists(root: Expr) -> Expr:
    """Returns the root where it is a break. Elsewhere it is NaN and contributes nothing to the integral."""
    while isinstance(root, Where) and isinstance(root.otherwise, Const) and math.isnan(root.otherwise.data):
        root = root.then
    return root


_PARTIAL = frozenset(("sqrt", "log", "pow"))


def _is_sum_of_squares(node: Call) -> bool:
    """Returns whether the argument of a function is a sum of even powers with non-negative coefficients."""
    terms = node.children[0].children if isinstance(node.children[0], Add) else node.children[:1]
    for term in terms:
        for factor in term.children if isinstance(term, Mul) else (term,):
            even = isinstance(factor, Pow) and factor.exponent % 2 == 0
            if not even and not (isinstance(factor, Const) and factor.data >= 0):
                return False
    return True


def _with_the_same_zeros(f: Expr) -> Expr:
    """Returns a function with the same zeros, without enclosing powers and |·|."""
    while isinstance(f, Pow) or (isinstance(f, Call) and f.name == "magnitude"):
        f = f.base if isinstance(f, Pow) else f.children[0]
    return f


def _factors(e: Expr, x: Var) -> list[Expr]:
    """Returns the factors of a product that depend on x, each of which keeps its own zeros: multiplied out they would be rounded.

    So are those of a sum of which one term is left: a + x + c·(x - ½)³ meets a + x at a root of three, which has a third of the digits.
    """
    if isinstance(e, Add) and (rest := collected(e)) is not e and isinstance(rest, Mul | Pow):
        e = rest
    if isinstance(e, Pow) and e.exponent > 0:
        return [e.base]
    if isinstance(e, Mul):
        return [c.base if isinstance(c, Pow) and c.exponent > 0 else c for c in e.children if x in c.free]
    return [e]


def _cases(turn: Turn, x: Var) -> list[Turn]:
    """Returns a turn for each branch of the function, whose coefficients are numbers from outside of the integral; none if there are too
    many branches."""
    cases = cases_of(turn.function, x) or ()
    return [replace(turn, function=function, when=conjunction(turn.when, condition)) for function, condition in cases]


def _outside(r: Expr, lo: Expr, hi: Expr) -> bool:
    """Returns whether a root is known by its number to lie outside of (lo, hi), or on its border."""
    if not (isinstance(r, Const) and isinstance(lo, Const) and isinstance(hi, Const)):
        return False
    return not min(lo.data, hi.data) < r.data < max(lo.data, hi.data)
