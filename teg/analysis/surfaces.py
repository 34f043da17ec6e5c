"""Atoms as surfaces: which integral owns them, and how an expression is evaluated at a point that lies on one.

Ties. Where two surfaces, a bound among them, run through one point at the given parameter values, neither value of the other bracket is
right for the derivative, nor is ½. The rule: order the surfaces by an index, move surface number i by ε·i along the first variable, take
the boundary terms of that arrangement; take those of the reversed order; average. An atom g evaluated on surface i therefore carries a
*resolution*: its truth value in the first arrangement, which is the sign of ∂g with i > j, and its opposite with i < j. The index is the
structural digest, which is the same in every process.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.coincidence import ZeroSet, peeled
from teg.analysis.expanded import distance
from teg.analysis.nest import Binder, Chain
from teg.analysis.polynomial import Shadow
from teg.analysis.singularities import Keys
from teg.analysis.twins import as_twin
from teg.errors import NotDifferentiableError
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.expr import FALSE, TRUE, ZERO, Compare, Cond, Const, Expr, Var
from teg.ir.integral import Integral
from teg.ir.node import Node, digest, postorder, union
from teg.ir.show import show
from teg.ir.simplify import conjunction, disjunction, negation, positive, sub, where
from teg.ir.traverse import fresh, rename_apart, substitute


def atoms_of(root: Node, var: Var | None = None) -> list[Compare]:
    """Returns the atoms below a node (those with `var` in them), in order; atoms inside resolutions are left out."""
    atoms: dict[Compare, None] = {}
    seen: set[Node] = set()
    stack: list[Node] = [root]
    while stack:
        node = stack.pop()
        if node in seen or (var is not None and var not in node.free):
            continue
        seen.add(node)
        if isinstance(node, Compare):
            atoms[node] = None
            stack.append(node.g)
        else:
            stack.extend(reversed(node.children))
    return list(atoms)


def binders_inside(root: Node) -> frozenset[Var]:
    """Returns the variables bound by the integrals below a node."""
    bound: set[Var] = set()
    seen: set[Node] = set()
    stack: list[Node] = [root]
    while stack:
        node = stack.pop()
        if node in seen or not (node.has_integral or isinstance(node, Compare) or not isinstance(node, Expr)):
            continue
        seen.add(node)
        if isinstance(node, Integral):
            bound.add(node.var)
        stack.extend(node.children)
    return frozenset(bound)


def _binders_outwards(root: Node) -> list[Var]:
    """Returns the variables bound by the integrals below a node, those of inner integrals first."""
    bound = binders_inside(root)
    return list(dict.fromkeys(n.var for n in postorder([root]) if isinstance(n, Integral))) if bound else []


def renamed_apart(chain: Chain, *parts: Expr) -> tuple[Chain, tuple[Expr, ...]]:
    """Returns a nest whose variables are not bound by integrals inside of it, as `chain` and the parts of its body.

    In ∫ dx exp(∫ f dy)·∫ δ dy both inner integrals may be over y. Where the points of the second one move, those of the first one do not.
    """
    taken = union([binders_inside(e) for e in (*parts, *(bound for b in chain for bound in (b.lo, b.hi)))])
    names = taken.union(*(e.free for e in parts), (b.var for b in chain))
    new: dict[Var, Expr] = {}
    renamed: list[Binder] = []
    for b in chain:
        var = fresh(b.var.name, names) if b.var in taken else b.var
        lo, hi = (cast(Expr, substitute(bound, new)) for bound in (b.lo, b.hi)) if new else (b.lo, b.hi)
        renamed.append(Binder(var, lo, hi))
        if var is not b.var:
            new[b.var] = var
            names |= {var}
    return tuple(renamed), tuple(cast(Expr, substitute(e, new)) if new else e for e in parts)


def owned_surfaces(body: Expr, var: Var) -> list[Expr]:
    """Returns the surfaces that the integral of `body` over `var` owns.

    An integral owns a surface g if it is the innermost one whose variable occurs in g.
    """
    atoms = atoms_of(body, var)
    if not atoms:
        return []
    inner = binders_inside(body)
    return list(dict.fromkeys(a.g for a in atoms if not (a.g.free & inner)))


def open_surfaces(e: Expr) -> list[Expr]:
    """Returns the surfaces of an expression with free variables that no integral in it owns."""
    if not e.free:
        return []
    inner = binders_inside(e)
    return list(dict.fromkeys(a.g for a in atoms_of(e) if a.g.free and not (a.g.free & inner)))


def bound_surface(var: Var, bound: Expr) -> Expr:
    """Returns a bound as a surface."""
    return sub(bound, var)


def comes_first(a: Expr, b: Expr) -> bool:
    """Returns whether `a` precedes `b` in the order in which tied surfaces are moved apart."""
    return digest(a) < digest(b)


def _tie_name(g: Expr) -> str:
    return show(g, 300) + " = 0"


def _leading_sign(g: Expr, directions: Sequence[Var], at: Mapping[Var, Expr]) -> Cond | None:
    """Returns the condition that the first non-zero slope of g along the directions is positive at a point."""
    slopes: list[Expr] = []
    for v in directions:
        if v not in g.free:
            continue
        try:
            s = slope(g, v)
        except NotDifferentiableError:
            return None
        if isinstance(s, Const):
            if s is ZERO:
                continue
            slopes.append(s)
            break
        slopes.append(substitute(s, at))  # type: ignore[arg-type]
    result: Cond = FALSE
    for s in reversed(slopes):
        result = disjunction(positive(s), conjunction(positive(s, strict=False), result)) if result is not FALSE else positive(s)
    return result


def restrict(e: Expr, at: Mapping[Var, Expr], surface: Expr, directions: Sequence[Var]) -> Expr:
    """Returns e at a point of `surface`: variables are replaced, and atoms of other surfaces get the resolution of a tie. A root that is
    0 there is written so, because its derivative would be infinite.

    `directions` are the variables along which tied surfaces are moved apart, innermost first.
    """
    e, inner = _apart_from_twins(e, at, surface)
    zeros: list[ZeroSet] = []
    named = cache(_tie_name)  # for this call

    def is_annulled(other: Expr) -> bool:
        if not zeros:
            zeros.append(ZeroSet(surface))
        return zeros[0].annuls(peeled(other, partial=True))

    def mark(old: Compare, g: Expr, resolution: Cond | None) -> Cond:
        if resolution is not None or old.g is surface:
            return positive(g, old.strict, resolution, old.rivals)
        twin = as_twin(old.g, surface, inner, (named(surface), named(old.g)))
        if twin is not None:
            return cast(Cond, substitute(twin, at))
        if not _may_coincide(old.g, inner):
            return positive(g, old.strict)
        rising = _leading_sign(old.g, (*inner, *directions), at)
        if rising is None:
            return positive(g, old.strict)
        truth = negation(rising) if comes_first(surface, old.g) else rising
        if not (surface.has_integral or old.g.has_integral or _are_planes(old.g, surface)) and is_annulled(old.g):
            g = ZERO  # one surface in two forms: a tie everywhere, so its rounded value must not decide
        return positive(g, old.strict, truth, (named(surface), named(old.g)))

    return Keys().without_null_roots(cast(Expr, substitute(e, at, mark)))


def _apart_from_twins(e: Expr, at: Mapping[Var, Expr], surface: Expr) -> tuple[Expr, list[Var]]:
    """Returns e and the variables of its integrals, innermost first, which are other ones than the surface's if it stands in them too."""
    inner = _binders_outwards(e)
    common = surface.free.union(*(place.free for place in at.values())).intersection(inner)
    if any(a.g is surface for a in atoms_of(e) if common):
        e = cast(Expr, rename_apart(e, common))
        inner = _binders_outwards(e)
    return e, inner


def _may_coincide(g: Expr, inner: Sequence[Var]) -> bool:
    """Returns whether a surface may run along one without the variables of inner integrals, wherever these are.

    One that rises in an inner variable at a known rate crosses at one of its places. At an unknown rate, as c·x + y in x, it may be 0.
    """
    own = [v for v in inner if v in g.free]
    if not own:
        return True
    try:
        rates = [slope(g, v) for v in own]
    except NotDifferentiableError:
        return False
    return not any(isinstance(rate, Const) and rate is not ZERO for rate in rates)


def _are_planes(g: Expr, h: Expr) -> bool:
    """Returns whether both are affine in all their variables. Coinciding planes have one form."""
    return all(Shadow(tuple(e.free)).degree(e) == 1 for e in (g, h))


def below(point: Expr, bound: Expr, surface: Expr, var: Var, original: Expr, name: str | None = None) -> Cond:
    """Returns [point < bound] for a point of `surface`.

    `original` is the bound as it stood in the integral over `var`; `name` is the bound's surface, if it is known.
    """
    other = bound_surface(var, original)
    truth = TRUE if comes_first(surface, other) else FALSE
    if isinstance(bound, Const) and math.isinf(bound.data):
        return TRUE if bound.data > 0 else FALSE
    return positive(sub(bound, point), True, truth, (name or _tie_name(surface), f"the bound {var.name} = {show(original, 300)}"))


def signed_inside(point: Expr, lo: Expr, hi: Expr, surface: Expr, b: Binder, weight: Expr) -> Expr:
    """Returns weight·([point < hi] - [point < lo]), which is right for reversed bounds too. The weight is not evaluated where this is 0.

    `lo` and `hi` are the bounds of `b` at the point of the surface.
    """
    name = _tie_name(surface)
    under_hi = below(point, hi, surface, b.var, b.hi, name)
    under_lo = below(point, lo, surface, b.var, b.lo, name)
    return signed_between(under_hi, under_lo, ordered(lo, hi), weight)


def ordered(lo: Expr, hi: Expr) -> int:
    """Returns +1 if lo <= hi is known, -1 if lo > hi is known, else 0."""
    if isinstance(lo, Const) and isinstance(hi, Const):
        return 1 if lo.data <= hi.data else -1
    size = distance(lo, hi)
    return 0 if not isinstance(size, Const) or math.isnan(size.data) else 1 if size.data >= 0.0 else -1


def signed_between(under_hi: Cond, under_lo: Cond, order: int, weight: Expr) -> Expr:
    """Returns weight·([under_hi] - [under_lo]) behind one condition; `order` is the result of `ordered`."""
    if order > 0:
        return where(conjunction(under_hi, negation(under_lo)), weight, ZERO)
    if order < 0:
        return where(conjunction(under_lo, negation(under_hi)), simplify.mul(ex.MINUS_ONE, weight), ZERO)
    differ = disjunction(conjunction(under_hi, negation(under_lo)), conjunction(negation(under_hi), under_lo))
    return where(differ, simplify.mul(where(under_hi, ex.ONE, ex.MINUS_ONE), weight), ZERO)


def free_of(e: Node, variables: Iterable[Var]) -> bool:
    """Returns whether none of these variables occurs free in e."""
    return not any(v in e.free for v in variables)


def is_affine(g: Expr, variables: Sequence[Var]) -> bool:
    """Returns whether g is affine in some variables together, and depends on each of them."""
    if Shadow(tuple(variables)).degree(g) != 1:
        return False
    try:
        return all(slope(g, v) is not ZERO for v in variables)
    except NotDifferentiableError:
        return False
