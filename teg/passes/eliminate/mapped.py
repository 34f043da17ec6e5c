"""Changes of variables by maps that the user gives: of whole integrals, and of the deltas that a map makes simpler.

    ∫…∫ F(x) dx  =  ∫…∫ F(x(u))·|J| du      over the image of the bounds (`teg.maps.images`)

and with F = w·δ(g) the surface is g∘x. If that depends on one new variable alone, or can be solved for one, another family sifts it
there. A map is tried in both directions: the surfaces of a program that is written in the new variables are mapped back to the old ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import expanded
from teg.analysis.nest import Binder, Chain, nest
from teg.analysis.polynomial import Shadow
from teg.analysis.surfaces import ordered, signed_between
from teg.errors import BoundError, OperandError, ScopeError
from teg.ir.expr import FALSE, MINUS_ONE, TRUE, ZERO, Add, Call, Const, Expr, Mul, Tuple, Var, Where, const
from teg.ir.integral import Integral, PointMasses
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number
from teg.ir.simplify import add, conjunction, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import fresh, parameters, rebuild, rename_apart, replace_node, size, substitute
from teg.maps.coverage import verify_exact, verify_reached
from teg.maps.diffeomorphism import INFINITY, MINUS_INFINITY, Diffeomorphism
from teg.maps.identities import simplified, taken_out
from teg.maps.images import Image, Side, image_of

Family = tuple[Callable[[Expr, Sequence[Var]], Any], Callable[[Expr, Expr, Chain, Any], Expr | None]]


# -- deltas --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Mapped:
    """g has a family in the new variables of a map."""

    variables: tuple[Var, ...]  # the old ones, outermost first
    map: Diffeomorphism
    families: tuple[Family, ...]
    inner: Any  # the data of that family's match

    @property
    def name(self) -> str:
        new = ", ".join(v.name for v in self.map.new)
        kept = ", ".join(v.name for v in self.inner.variables)
        return f"mapped to {new}: {self.inner.name}, eliminated over {kept}"

    @property
    def moves(self) -> bool:
        return bool(self.inner.moves)


def user_families(maps: Sequence[Diffeomorphism], families: Sequence[Family], alone: bool) -> tuple[Family, ...]:
    """Returns one family for each map and direction.

    `alone`: for surfaces that depend on one new variable; others need a family among `families`.
    """
    both = [way for m in maps for way in (m, m.inverse_map())]
    return tuple((partial(match_user, m=m, families=tuple(families), alone=alone), rewrite_user) for m in both)


def match_user(g: Expr, variables: Sequence[Var], m: Diffeomorphism, families: tuple[Family, ...], alone: bool) -> Mapped | None:
    """Returns a match for a surface of all old variables that is simpler, or that one of the families matches, in the new variables."""
    if not set(m.old) <= g.free & set(variables):
        return None
    renamed = m.renamed(_names_in([g], variables))
    _, surface = _pulled_back(g, renamed)
    mine = [v for v in renamed.new if v in surface.free]
    if not mine or (alone and len(mine) > 1):
        return None
    family = _first(surface, mine, families)
    if family is None:
        return None
    return Mapped(tuple(v for v in reversed(variables) if v in m.forward), m, families, family[0])


def rewrite_user(g: Expr, coefficient: Expr, chain: Chain, data: Mapped) -> Expr | None:
    """Returns ∫ over the chain of coefficient·δ(g) in the new variables, without δ; None if the family there does not apply."""
    m = data.map.renamed(_names_in([g, coefficient], [b.var for b in chain], chain))
    value, image = _carried(coefficient, chain, m)
    factor, surface = _pulled_back(g, m)
    family = _first(surface, [v for v in m.new if v in surface.free], data.families)
    if family is None:
        return None
    value = simplified(mul(value, integer_power(factor, -1)), m.domain)
    return family[1](surface, value, image.chain, family[0])


def _first(surface: Expr, variables: Sequence[Var], families: Sequence[Family]) -> tuple[Any, Callable[..., Expr | None]] | None:
    for match, rewrite in families:
        data = match(surface, variables)
        if data is not None:
            return data, rewrite
    return None


def _pulled_back(g: Expr, m: Diffeomorphism) -> tuple[Expr, Expr]:
    """Returns a positive factor, and a surface: δ(g) is δ(surface)/factor."""
    at = dict(m.forward)
    known = {substitute(m.inverse[u], at): cast(Expr, u) for u in m.new}
    surface = simplified(cast(Expr, substitute(g, at)), m.domain, {e: u for e, u in known.items() if not isinstance(e, Var)})
    normal = expanded(surface)
    other = surface if normal is None else simplified(normal, m.domain)
    return taken_out(other if size(other) < size(surface) else surface, m.domain)


def _names_in(expressions: Sequence[Expr], variables: Sequence[Var], chain: Chain = ()) -> set[str]:
    """Returns the names of variables and parameters that new variables must not take."""
    ends = [e for b in chain for e in (b.lo, b.hi)]
    everything = [*expressions, *ends]
    bound = {n.var.name for n in postorder(everything) if isinstance(n, Integral)}
    return {v.name for e in everything for v in e.free} | {v.name for v in variables} | {p.name for p in parameters(*everything)} | bound


# -- integrands ----------------------------------------------------------------------------------------------------------


def _carried(integrand: Expr, chain: Chain, m: Diffeomorphism, exact: bool = False) -> tuple[Expr, Image]:
    """Returns the integrand over the image of a nest: the old integrand there times |J|, inside of the bounds that have become brackets."""
    image = image_of(chain, m, exact)
    value = mul(image.weight, cast(Expr, substitute(integrand, image.at)))
    for side in image.sides:
        disk = _between_roots(side)
        value = _inside(side, value) if disk is None else where(positive(disk), value, ZERO)
    conditions = [positive(sub(c.value, c.lo)) for c in image.constraints if c.lo is not MINUS_INFINITY]
    conditions += [positive(sub(c.hi, c.value)) for c in image.constraints if c.hi is not INFINITY]
    return simplified(where(conjunction(*conditions), value, ZERO), m.domain, image.known), image


def _inside(side: Side, value: Expr) -> Expr:
    """Returns value·([point < hi] - [point < lo])."""
    under_hi = TRUE if side.hi is None else positive(sub(side.hi, side.point))
    under_lo = FALSE if side.lo is None else positive(sub(side.lo, side.point))
    return signed_between(under_hi, under_lo, ordered(side.binder.lo, side.binder.hi), value)


def _between_roots(side: Side) -> Expr | None:
    """Returns D - (point - m)² for the bounds m ± √D, so that a disk remains one surface; None for others."""
    lo, hi = side.lo, side.hi
    if lo is None or hi is None:
        return None
    for root in (n for n in postorder([hi]) if isinstance(n, Call) and n.name == "sqrt" and n.free):
        z = fresh("z", hi.free | lo.free)
        above = cast(Expr, replace_node(hi, root, z))
        if above is replace_node(lo, root, mul(MINUS_ONE, z)) and Shadow((z,)).degree(above) == 1:
            rate, middle = slope(above, z), cast(Expr, substitute(above, {z: ZERO}))
            if isinstance(rate, Const) and rate.data > 0.0:
                scaled = mul(const(rate.data**2), root.children[0])
                return sub(scaled, integer_power(sub(side.point, middle), 2))
    return None


# -- whole integrals -----------------------------------------------------------------------------------------------------


def change_variables(
    e: object, m: Diffeomorphism, *, bounds: Mapping[Var, tuple[object, object]] | None = None, exact: bool = False
) -> Expr:
    """Returns e with every nest of integrals over all old variables of a map written in the new ones. Value and derivatives are the same.

        disk = teg.integral(teg.bracket(x**2 + y**2 < t), (x, -1, 1), (y, -1, 1))
        teg.evaluate(teg.change_variables(disk, teg.polar(x, y, r, p)), t=0.5)  # 1.5707963267948966

    Old bounds become new bounds if the map carries boxes to boxes or to nests. Otherwise they become brackets in a box that contains
    their image. `bounds` (dict new variable -> (lower, upper), default: those of the map) is that box. With `exact` it is the image
    itself, as far as the integrand does not vanish there, and there are no brackets; this is verified at sample points and parameter
    values. A new variable whose name is taken gets a prime. Bounds that have become curved surfaces are best moved in the old variables
    again: by `teg.compile(…, maps=[m])`.

    Raises ScopeError if no nest binds all old variables, BoundError if a finite box cannot be derived, DiffeomorphismError if bounds
    given as exact are not.
    """
    if not isinstance(m, Diffeomorphism):
        raise OperandError(f"variables are changed by a map, not by {type(m).__name__}", None, "make one with teg.Diffeomorphism")
    if bounds is not None:
        m = m.with_bounds(bounds)
    if exact and set(m.bounds) != set(m.new):
        raise BoundError("exact=True needs bounds for every new variable", m, "bounds={r: (0, 1), p: (-math.pi, math.pi)}")
    root = rename_apart(e if isinstance(e, Tuple) else as_number(e))
    taken = {p.name for p in parameters(root)}
    new: dict[Node, Node] = {}
    changed = False
    for node in postorder([root]):
        result = rebuild(node, tuple([new[c] for c in node.children]))
        if isinstance(result, PointMasses):
            raise OperandError("a delta has already been eliminated here", root, "change variables first")
        if isinstance(result, Integral) and result.var in m.forward:
            replaced = _changed(result, m, exact, taken)
            changed |= replaced is not result
            result = replaced
        new[node] = result
    if not changed:
        names = ", ".join(v.name for v in m.old)
        raise ScopeError(f"no integral over {names} to change", root, "the integrals over all old variables must stand inside each other")
    return cast(Expr, new[root])


def _changed(outermost: Integral, m: Diffeomorphism, exact: bool, taken: set[str]) -> Expr:
    first = Binder(outermost.var, outermost.lo, outermost.hi)
    terms = []
    complete = False
    for inner, coefficient in _linear_terms(outermost.body, set(m.old) - {outermost.var}).items():
        chain = (first, *inner)
        whole = {b.var for b in chain} >= set(m.old)
        complete |= whole
        terms.append(_in_new_variables(coefficient, chain, m, exact, taken) if whole else nest(coefficient, chain))
    return add(*terms) if complete else outermost


def _in_new_variables(integrand: Expr, chain: Chain, m: Diffeomorphism, exact: bool, taken: set[str]) -> Expr:
    m = m.renamed(taken | _names_in([integrand], [b.var for b in chain if b.var not in m.forward], chain))
    value, image = _carried(integrand, chain, m, exact)
    if exact:
        verify_exact(chain, image.chain, m, integrand)
    else:
        verify_reached(chain, m, integrand)
    return nest(value, image.chain)


def _linear_terms(e: Expr, wanted: set[Var]) -> dict[Chain, Expr]:
    """Returns e as a sum of nests of integrals over the wanted variables, each with its coefficient; the empty nest
    holds the other terms."""
    parts: dict[Node, dict[Chain, Expr]] = {}
    for node in postorder([e]):
        parts[node] = _terms_of(node, parts, wanted) if isinstance(node, Expr) else {}
    return parts[e]


def _terms_of(node: Expr, parts: dict[Node, dict[Chain, Expr]], wanted: set[Var]) -> dict[Chain, Expr]:
    plain: dict[Chain, Expr] = {(): node}
    if not node.has_integral:
        return plain
    carriers = [c for c in dict.fromkeys(node.children) if any(parts[c])]
    if isinstance(node, Integral) and (node.var in wanted or carriers == [node.body]):
        return {(Binder(node.var, node.lo, node.hi), *chain): k for chain, k in parts[node.body].items()}
    if not carriers:
        return plain
    if isinstance(node, Add):
        sums: dict[Chain, list[Expr]] = {}
        for c in node.children:
            for chain, k in parts[c].items():
                sums.setdefault(chain, []).append(k)
        return {chain: add(*ks) for chain, ks in sums.items()}
    if isinstance(node, Mul) and len(carriers) == 1:
        others = [c for c in node.children if c is not carriers[0]]
        return {chain: mul(k, *others) for chain, k in parts[carriers[0]].items()}
    if isinstance(node, Where):
        terms: dict[Chain, Expr] = {}
        for condition, branch in ((node.condition, node.then), (negation(node.condition), node.otherwise)):
            for chain, k in parts[branch].items():
                terms[chain] = add(terms.get(chain, ZERO), where(condition, k, ZERO))
        return terms
    return plain
