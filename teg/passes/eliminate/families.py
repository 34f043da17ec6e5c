"""Elimination of δ: an ordered list of families, each of which reduces a δ to one variable and sifts it.

    ∫ₗʰ w(x) δ(g(x)) dx = Σ_{roots x* of g} w(x*)/|g′(x*)| · ([x* < h] - [x* < l])

The signed difference is right for reversed bounds and for bounds that cross inside an outer domain. A family is a file with a
`match_<family>(g, variables)`, which returns data or None, and a `rewrite_<family>(g, coefficient, chain, data)`, which returns the
sifted integral. The first family of the list that matches is taken. A δ that depends on outer variables is eliminated at the outermost
of the integrals that take part; outer factors are moved inside.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any, cast

from teg.analysis.births import at_births
from teg.analysis.calculus import slope
from teg.analysis.nest import Binder, Chain, nest
from teg.analysis.polynomial import Shadow
from teg.analysis.remarks import Remarks
from teg.analysis.roots import solve
from teg.analysis.sift import deltas_of, linear_part, without
from teg.analysis.surfaces import is_affine
from teg.analysis.tails import is_unbounded
from teg.errors import DeltaError, NoReparameterisationError, NotDifferentiableError
from teg.ir.expr import TRUE, ZERO, And, Call, Cond, Const, Expr, Mul, Var
from teg.ir.integral import Delta, Integral, delta, integral_over
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, conjunction, mul, nonzero_part, where
from teg.ir.traverse import fresh, rebuild, rename_apart
from teg.ir.uncovered import marks_of
from teg.maps.diffeomorphism import Diffeomorphism, checked_maps
from teg.passes.eliminate.affine import Affine, match_affine, match_partly_affine, match_turning, rewrite_affine
from teg.passes.eliminate.bilinear import match_bilinear, rewrite_bilinear
from teg.passes.eliminate.circle import match_circle, rewrite_circle
from teg.passes.eliminate.conic import match_conic, match_squares, rewrite_conic
from teg.passes.eliminate.crossings import match_curve, rewrite_curve
from teg.passes.eliminate.focal import match_focal, rewrite_focal
from teg.passes.eliminate.implicit import MAX_CHARTS, Implicit, match_implicit, rewrite_by_formulas, rewrite_implicit
from teg.passes.eliminate.mapped import user_families
from teg.passes.eliminate.pencil import Pencil, match_pencil, rewrite_pencil
from teg.passes.eliminate.steep import Graph, match_steep, rewrite_steep
from teg.passes.eliminate.univariate import match_solvable, rewrite_solvable
from teg.passes.normalise.denominators import with_cleared_deltas

Match = Callable[[Expr, Sequence[Var]], Any]
Rewrite = Callable[[Expr, Expr, tuple[Binder, ...], Any], Expr | None]

Closed = Callable[[Expr, Expr, Chain, Any], Expr | None]
"""∫∫ coefficient·δ(g) in closed form, from g, the coefficient, the chain and the data of the family; None if there is none."""
Families = tuple[tuple[Match, Rewrite], ...]

FORMULAS: Families = (
    (match_bilinear, rewrite_bilinear),
    (match_affine, rewrite_affine),
    (match_solvable, rewrite_solvable),
)
FAMILIES: Families = (
    *FORMULAS,
    (match_conic, rewrite_conic),
    (match_squares, rewrite_conic),
    (match_implicit, rewrite_implicit),
    (match_partly_affine, rewrite_affine),
)


FIRST = "the first family that matches"
STEEP = "the graph is steep somewhere"
CURVED = "in one variable only, as the bounds are curved"
CARRIED = "carried along, as it is differentiated again"


def along_edges(families: Families) -> Families:
    """Returns the families for programs in which candidates cover parts of a curve: where these are ends of arcs, charts by variable have
    no formula for them. Elsewhere the charts by variable are shorter."""
    place = next((i for i, (match, _) in enumerate(families) if match is match_implicit), len(families))
    curves: Families = (match_circle, rewrite_circle), (match_pencil, rewrite_pencil), (match_focal, rewrite_focal)
    return ((_match_hyperbola, rewrite_pencil), *families[:place], *curves, *families[place:])


def _match_hyperbola(g: Expr, variables: Sequence[Var]) -> Pencil | None:
    """Returns both variables of a hyperbola with axes along the box, if that is no product of two lines; else None."""
    return None if match_bilinear(g, variables) is None else match_pencil(g, variables)


def noted(form: Closed, name: str, remarks: Remarks) -> Closed:
    """Returns the same closed form, which tells `remarks` when it is taken."""

    def taken(g: Expr, coefficient: Expr, chain: Chain, data: Any) -> Expr | None:
        term = form(g, coefficient, chain, data)
        if term is not None:
            remarks.add("eliminate", g, name, "a boundary term in closed form, which is not differentiated again")
        return term

    return taken


def closing(families: Families, closed: Sequence[Closed]) -> Families:
    """Returns the families for boundary terms that are not differentiated again: some of their charts would be hard to differentiate.

    `closed` are closed forms that are tried before the charts of a family.
    """
    last: list[tuple[Match, Rewrite]] = []
    for match, rewrite in families:
        if match is match_implicit:
            last.append((match_turning, rewrite_affine))
        last.append((match, partial(_rewrite_closed, closed, rewrite)))
    return tuple(last)


def _rewrite_closed(closed: Sequence[Closed], rewrite: Rewrite, g: Expr, coefficient: Expr, chain: Chain, data: Any) -> Expr | None:
    """A boundary term in closed form, where there is one; else in the charts of its family."""
    for form in closed:
        term = form(g, coefficient, chain, data)
        if term is not None:
            return term
    return rewrite(g, coefficient, chain, data)


def families_with(maps: Sequence[Diffeomorphism]) -> Families:
    """Returns the families with a user's maps among them.

    A map comes first for surfaces that depend on one new variable, then where it leads to a formula and there is none without it, last
    for surfaces that no other family matches.
    """
    if not checked_maps(maps):
        return FAMILIES
    alone, formulas, others = (user_families(maps, f, a) for f, a in ((FAMILIES, True), (FORMULAS, False), (FAMILIES, False)))
    return (*alone, *FORMULAS, *formulas, *FAMILIES[len(FORMULAS) :], *others)


def eliminate_deltas(
    root: Expr,
    keep_moving: bool = False,
    families: Families = FAMILIES,
    remarks: Remarks | None = None,
    written: Collection[Delta] | None = None,
) -> Expr:
    """Returns the program without δ. Raises NoReparameterisationError for a surface that no family reduces, DeltaError for a misplaced δ.

    `keep_moving` leaves those deltas in the program that are carried along when it is differentiated again. `remarks` are told which
    family each surface has. Two level sets of one function, x·y = t and x·y = a, do not meet: where one is sifted the other is a δ of
    parameters only, which belongs to no integral and contributes nothing. A `written` one is an error (None: all of the program are
    written by the user, none by a derivative).
    """
    written = set(deltas_of(root) if written is None else written)
    while root.has_delta:  # a product of deltas loses one factor in each round
        round_ = _Elimination(cast(Expr, rename_apart(root)), keep_moving, families, Remarks() if remarks is None else remarks)
        reduced = round_.run(written)
        if reduced is root and round_.kept:
            break
        if reduced is root:
            raise DeltaError(
                "a Dirac delta is under no integral over its variables", deltas_of(root)[0], "integrate over one of the variables in it"
            )
        root = with_cleared_deltas(without(reduced, _of_parameters(reduced) - written))
    return root


def _of_parameters(e: Expr) -> set[Delta]:
    """Returns the deltas without variables."""
    return {d for d in deltas_of(e) if not d.g.free}


def is_endless(g: Expr, mine: Sequence[Var], outer: Collection[Var]) -> bool:
    """Returns whether a surface is followed however far its variables run, given innermost first: a plane, an ellipse, one with formulas
    for its roots in each variable, or the graph of a wave. Bounds depend on the variables of `outer`: only a plane may have one of these,
    if its slope along another variable is a number."""
    in_box = not any(v in outer for v in mine)
    if is_affine(g, mine):
        return in_box or any(v not in outer and isinstance(slope(g, v), Const) for v in mine)
    return in_box and (match_conic(g, mine) is not None or has_formulas(g, mine) or _is_wave(g, mine))


def _is_wave(g: Expr, mine: Sequence[Var]) -> bool:
    """Returns whether a surface is the graph of a function with waves: it has endlessly many roots in the other variables."""
    waves = any(isinstance(n, Call) and n.name in ("sin", "cos") and not n.free.isdisjoint(mine) for n in postorder([g]))
    return waves and match_affine(g, mine) is not None


def has_formulas(g: Expr, mine: Sequence[Var]) -> bool:
    """Returns whether all roots in each of two or three variables have formulas, whatever the bounds are."""
    if not 2 <= len(mine) <= MAX_CHARTS:
        return False
    somewhere = fresh("lo", g.free), fresh("hi", g.free)
    try:
        return all((roots := solve(g, v, *somewhere)) is not None and roots.certain and slope(g, v) is not ZERO for v in mine)
    except NotDifferentiableError:
        return False


def without_steep_graphs(g: Expr, data: Any, boxes: Sequence[Binder]) -> tuple[Any, Rewrite] | None:
    """Returns the family that replaces a graph where it is steep; or None.

    `boxes` are the integrals over the variables of g, outermost first.
    """
    if not isinstance(data, Affine) or len(data.variables) == len(boxes) or not any(isinstance(slope(g, v), Const) for v in data.variables):
        return None
    steep = match_steep(g, data, boxes)
    return None if steep is None else (steep, rewrite_steep if isinstance(steep, Graph) else rewrite_implicit)


def find_family(g: Expr, variables: Sequence[Var], families: Families = FAMILIES) -> tuple[Any, Rewrite] | None:
    """Returns the first family that matches a surface: its data and its rewriting."""
    for match, rewrite in families:
        data = match(g, variables)
        if data is not None:
            return data, rewrite
    return None


class _Elimination:
    """One program: its variables from the innermost outwards, and the decision for each surface."""

    def __init__(self, root: Expr, keep_moving: bool, families: Families, remarks: Remarks) -> None:
        self.root, self.remarks = root, remarks
        self.families = along_edges(families) if marks_of(root) else families
        self.keep_moving = keep_moving
        self.kept = False
        self.binders = {n.var: Binder(n.var, n.lo, n.hi) for n in postorder([root]) if isinstance(n, Integral)}
        self.variables = list(self.binders)
        self.decisions: dict[Expr, tuple[Any, Rewrite]] = {}
        self.reasons: dict[Expr, str] = {}  # of a decision that is not the first family that matches
        self.sifted: dict[tuple[Delta, Expr, Chain], Expr] = {}

    def run(self, written: set[Delta]) -> Expr:
        """Returns the program after one round. Deltas without variables that are not `written` by the user contribute nothing."""
        new: dict[Node, Node] = {}
        for node in postorder([self.root]):
            result = rebuild(node, tuple([new[c] for c in node.children]))
            if isinstance(result, Integral) and result.body.has_delta and (met := _of_parameters(result.body) - written):
                result = integral_over(without(result.body, met), result.var, result.lo, result.hi)
            if isinstance(result, Integral) and result.has_delta:
                result = self._integral(result)
            new[node] = result
        result = cast(Expr, new[self.root])
        return result

    def _decide(self, g: Expr) -> tuple[Any, Rewrite]:
        if g not in self.decisions:
            mine = [v for v in self.variables if v in g.free and v not in self.root.free]
            if not mine:
                raise DeltaError(
                    "a Dirac delta of parameters only belongs to no integral",
                    g,
                    "it needs a variable of integration",
                )
            family = self._endless(g, mine) or find_family(g, mine, self.families)
            if family is None:
                raise NoReparameterisationError(
                    f"no reparameterisation is known for the surface {_describe(g, mine)}",
                    g,
                    "its value, and derivatives that do not move it, work. Moving it needs a formula for one variable: write the condition "
                    "so that a variable stands alone, y < f(x, t), or without an integral over its own variable",
                )
            boxes = [self.binders[v] for v in reversed(mine)]
            steep = None if any(map(is_unbounded, boxes)) else without_steep_graphs(g, family[0], boxes)
            if steep is not None and not (self.keep_moving and isinstance(steep[0], Graph)):
                family = steep
                self.reasons[g] = STEEP
            self.decisions[g] = family
        return self.decisions[g]

    def _endless(self, g: Expr, mine: Sequence[Var]) -> tuple[Any, Rewrite] | None:
        """Returns the charts by formulas of a surface in several variables that run to infinity, if it is no plane and no ellipse."""
        if len(mine) < 2 or not any(is_unbounded(self.binders[v]) for v in mine) or is_affine(g, mine) or match_conic(g, mine) is not None:
            return None
        return (Implicit(tuple(reversed(mine))), rewrite_by_formulas) if has_formulas(g, mine) else None

    def _integral(self, node: Integral) -> Expr:
        x = node.var
        ready: list[tuple[Delta, Any, Rewrite]] = []
        for d in deltas_of(node.body):
            data, rewrite = self._decide(d.g)
            if x in data.variables and not any(v in node.free for v in data.variables):
                self.kept |= self.keep_moving and data.moves
                ready.append((d, data, rewrite))
        ready.sort(key=lambda r: r[1].moves)  # in a product of deltas the one with a formula goes first
        if not any(not self._is_kept(node.body, d, data) for d, data, _ in ready):
            for d, data, _ in ready:
                self.remarks.add("eliminate", d.g, data.name, CARRIED)
            return node
        terms: list[Expr] = []
        body = node.body
        for d, data, rewrite in ready:  # a product of two deltas goes with the first one
            for chain, coefficient in linear_part(body, d).items():
                whole = (Binder(x, node.lo, node.hi), *chain)
                others = deltas_of(coefficient) if data.moves else []
                for other in others:
                    for inner, k in linear_part(coefficient, other).items():
                        terms.append(self._crossing(d, other, k, (*whole, *inner)))
                coefficient = without(coefficient, set(others))
                if self.keep_moving and data.moves:
                    terms.append(nest(mul(d, coefficient), whole))
                    self.remarks.add("eliminate", d.g, data.name, CARRIED)
                elif coefficient is not ZERO:
                    factor, weight = _apart(coefficient, {b.var for b in whole})
                    if (d, weight, whole) not in self.sifted:  # the derivatives by many parameters differ in the factor only
                        self.sifted[d, weight, whole] = self._sifted(d, weight, whole, data, rewrite)
                    terms.append(mul(factor, self.sifted[d, weight, whole]))
            body = without(body, {d})
        return add(integral_over(body, x, node.lo, node.hi), *terms)

    def _is_kept(self, body: Expr, d: Delta, data: Any) -> bool:
        """Returns whether a δ is to be carried along, and is not multiplied with another one."""
        return self.keep_moving and data.moves and not any(k.has_delta for k in linear_part(body, d).values())

    def _sifted(self, d: Delta, coefficient: Expr, chain: tuple[Binder, ...], data: Any, rewrite: Rewrite) -> Expr:
        for other in deltas_of(coefficient):
            if other.g.free <= set(data.variables) and len(data.variables) == 1:
                raise DeltaError("a product of two deltas of one variable has no meaning", mul(d, other))
        result, reason = rewrite(d.g, coefficient, chain, data), self.reasons.get(d.g, FIRST)
        if result is None:
            result, reason = self._innermost(d.g, coefficient, chain), CURVED
        if result is None:
            raise NoReparameterisationError(
                f"the δ on {d.g} cannot be brought to one variable inside these bounds",
                d.g,
                "use bounds that are affine in the outer variables",
            )
        self.remarks.add("eliminate", d.g, data.name, reason)
        return result

    def _crossing(self, d: Delta, other: Delta, coefficient: Expr, chain: Chain) -> Expr:
        """Returns the term where two surfaces cross: one is solved by a formula for a variable that the other does not have, or two curves
        for either variable, so that the other has one variable only."""
        mine = [b.var for b in reversed(chain)]
        for first, second in ((d, other), (other, d)):
            for alone in (match_solvable(first.g, [v]) for v in mine if v in first.g.free and v not in second.g.free):
                result = rewrite_solvable(first.g, mul(coefficient, second), chain, alone) if alone is not None else None
                if result is not None:
                    return result
        for first, second in ((d, other), (other, d)):
            curve = match_curve(first.g, mine)
            result = rewrite_curve(first.g, mul(coefficient, second), chain, curve) if curve is not None else None
            if result is not None:
                return result
        raise NoReparameterisationError(
            f"where the surface {d.g} = 0 meets another one has no formula",
            d.g,
            "first derivatives work; for second ones write one of the two conditions so that a variable stands alone in it",
        )

    def _innermost(self, g: Expr, coefficient: Expr, chain: tuple[Binder, ...]) -> Expr | None:
        """Returns the elimination of one variable alone, the innermost possible, if these bounds do not allow the joint change of
        variables."""
        for i in range(len(chain) - 1, -1, -1):
            for match, rewrite in self.families if chain[i].var in g.free else ():
                data = match(g, [chain[i].var])
                inner = rewrite(g, coefficient, chain[i:], data) if data is not None else None
                if inner is not None and self.keep_moving and data.moves:  # sums over roots are not differentiated again
                    self.kept = True
                    return nest(mul(delta(g), coefficient), chain)
                if inner is not None:
                    return add(nest(inner, chain[:i]), at_births(g, coefficient, chain))
        return None


def _apart(coefficient: Expr, variables: set[Var]) -> tuple[Expr, Expr]:
    """Returns a factor of a coefficient that depends on none of the variables, and the other factor, which includes the conditions.

    Conditions without the variables guard the first factor too: 1/√b need not be a number where b > 0 fails.
    """
    condition, coefficient = nonzero_part(coefficient)
    factors = coefficient.children if isinstance(coefficient, Mul) else (coefficient,)
    outside = [f for f in factors if f.free.isdisjoint(variables) and not f.has_delta and not isinstance(f, Const)]
    inside = mul(*(f for f in factors if f not in outside))
    parts = cast("Sequence[Cond]", condition.children) if isinstance(condition, And) else (condition,)
    guard = conjunction(*(c for c in parts if c.free.isdisjoint(variables) and not c.has_delta)) if outside else TRUE
    return where(guard, mul(*outside), ZERO), where(condition, inside, ZERO)


def _describe(g: Expr, variables: Sequence[Var]) -> str:
    degree = Shadow(tuple(variables)).degree(g)
    names = " and ".join(v.name for v in variables)
    kind = "not a polynomial" if degree is None else f"of degree {degree}"
    return f"{g} = 0, {kind} in {names}"
