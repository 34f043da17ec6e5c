"""Polynomials times half-planes or half-spaces over a box, and times half-lines over an interval: what is left is clipped.

    ∫∫∫ P(x, y, z)·Π[gᵢ(x, y, z) > 0]     gᵢ affine      → `Polyhedron`: the box is clipped by each half-space, a rule on tetrahedra
    ∫∫ P(x, y)·Π[gᵢ(x, y) > 0] dx dy      gᵢ affine      → `Polygon`: the box is clipped by each half-plane, a rule on a fan of triangles
    ∫ P(x)·Π[gᵢ(x) > 0] dx                gᵢ affine      → `Segment`: the interval is clipped, one piece and no search for others

Without them the outer integral has a break wherever two lines meet or one crosses a side, O(n²) of them, and the inner one n in each
piece; with three variables wherever three planes meet, O(n³). A boundary term along an edge becomes a `Segment`: its half-lines are the
sides of the box and the other edges, and may tie.

Hidden constants, and hidden functions of degree 1, are found in the normal form of `teg.analysis.polynomial`; `lowering.py` makes the
statements.
Source: Sutherland and Hodgman 1974 (clipping); Cyrus and Beck 1978 (of an interval).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import is_unbounded
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, And, Compare, Cond, Expr, Mul, Not, Or, Var
from teg.ir.integral import Integral, masses_of
from teg.ir.node import Node
from teg.ir.simplify import add, conjunction, disjunction, mul, negation, nonzero_part, positive, sub, where
from teg.ir.traverse import replace_node, substitute
from teg.program import MAX_HALF_PLANES, MAX_HALF_SPACES

MAX_DEGREE = 24
MAX_SOLID_DEGREE = 8
"""The largest degree on a polyhedron."""
MAX_TERMS = 256
"""The largest number of terms of a sum of integrals over one box."""


@dataclass(frozen=True)
class Half:
    """[g > 0], or its negation [g <= 0]."""

    atom: Compare
    negated: bool = False

    @property
    def g(self) -> Expr:
        return mul(MINUS_ONE, self.atom.g) if self.negated else self.atom.g

    @property
    def closed(self) -> bool:
        return self.negated == self.atom.strict


@dataclass(frozen=True)
class Clipped:
    """A polynomial of a degree, in variables (innermost first), on the part of a box, or an interval, inside its halves."""

    boxes: tuple[Integral, ...]
    halves: tuple[Half, ...]
    integrand: Expr
    degree: int
    inside: tuple[Integral, ...] = ()  # the inner integrals, all over the same interval

    @property
    def key(self) -> object:
        """Returns a key that is equal for integrals that share a loop."""
        return (len(self.boxes), *((b.var, b.lo, b.hi) for b in self.boxes), frozenset(self.halves))


def match_box(node: Integral) -> Clipped | None:
    """Returns a polynomial on a box in two or three variables in the intersection of half-planes or half-spaces, or None."""
    for nest in (_with_inner(_with_inner(_alone(node))), _with_inner(_alone(node))):
        if nest is not None and (found := _match(nest)) is not None:
            return found
    return None


@dataclass(frozen=True)
class _Nest:
    """Integrals over a box, innermost first: the integrand where the condition holds, and the inner integrals. The innermost one of the
    boxes stands for all of one variable."""

    boxes: tuple[Integral, ...]
    condition: Cond
    integrand: Expr
    inside: tuple[Integral, ...] = ()


def _alone(node: Integral) -> _Nest:
    """Returns a nest of one integral."""
    return _Nest((node,), *nonzero_part(node.body))


def _with_inner(nest: _Nest | None) -> _Nest | None:
    """Returns the nest with the integrals of its integrand, which is a sum of them times factors; None if it is none."""
    terms = [] if nest is None else _terms(nest.integrand)
    if nest is None or not terms or any(i.has_delta or masses_of(i.body, i.var) is not None for _, i in terms):
        return None
    (_, first), condition = terms[0], nonzero_part(terms[0][1].body)[0]
    box = (first.var, first.lo, first.hi)
    if any((i.var, i.lo, i.hi) != box or nonzero_part(i.body)[0] is not condition or first.var in factor.free for factor, i in terms):
        return None
    outer = [b.var for b in nest.boxes]
    if first.var in outer or any(v in first.lo.free | first.hi.free for v in outer):
        return None
    integrand = add(*(mul(factor, nonzero_part(i.body)[1]) for factor, i in terms))
    return _Nest((first, *nest.boxes), conjunction(condition, nest.condition), integrand, (*(i for _, i in terms), *nest.inside))


def _terms(e: Expr) -> list[tuple[Expr, Integral]]:
    """Returns an integrand as a sum of factors times integrals, with sums inside of products written out; [] if it is not one."""
    found: list[tuple[Expr, Integral]] = []
    stack: list[tuple[Expr, Expr]] = [(ONE, e)]
    while stack:
        factor, term = stack.pop()
        if isinstance(term, Integral):
            found.append((factor, term))
        elif isinstance(term, Add):
            stack.extend((factor, c) for c in reversed(cast("Sequence[Expr]", term.children)))
        elif isinstance(term, Mul):
            inner: list[Expr] = [f for f in term.children if isinstance(f, Integral)] or [
                f for f in term.children if isinstance(f, Add) and f.has_integral
            ]
            if len(inner) != 1 or len(found) + len(stack) > MAX_TERMS:
                return []
            stack.append((mul(factor, *(f for f in cast("Sequence[Expr]", term.children) if f is not inner[0])), inner[0]))
        else:
            return []
    return found


def match_segment(node: Integral) -> Clipped | None:
    """Returns a polynomial on an interval in the intersection of half-lines, one of which may tie, or None."""
    ties = any(a.resolution is not None for a in atoms_of(node.body, node.var))
    found = _match(_alone(node)) if ties else None
    return found if found is not None and any(h.atom.resolution is not None for h in found.halves) else None


def match_clipped(node: Integral) -> Clipped | None:
    """Returns the integral as a polyhedron, a polygon or a segment, or None."""
    return match_box(node) or match_segment(node)


def _match(nest: _Nest) -> Clipped | None:
    """Returns the integrand on boxes where a condition holds, if it is a polynomial there and the condition an intersection of halves; else
    None."""
    boxes, condition, integrand = nest.boxes, nest.condition, nest.integrand
    variables = tuple(b.var for b in boxes)
    if any(is_unbounded(b) or masses_of(b.body, b.var) is not None for b in boxes) or integrand.has_delta or condition is TRUE:
        return None
    found = _halves(condition, variables, integrand)
    if found is None:
        return None
    halves, integrand = found
    shadow = Shadow(variables)
    solid = len(boxes) > 2
    if not 0 < len(halves) <= (MAX_HALF_SPACES if solid else MAX_HALF_PLANES):
        return None
    if any(atoms_of(e, v) for v in variables for e in (integrand, *(h.atom.g for h in halves))):
        return None
    if solid and any(all(v not in h.atom.g.free for h in halves) for v in variables):
        return None  # a prism is an integral over a polygon
    if any(shadow.degree(h.atom.g) not in (0, 1) for h in halves):
        return None
    resolutions = [h.atom.resolution for h in halves if h.atom.resolution is not None]
    if resolutions and (solid or any(v in r.free for r in resolutions for v in variables)):
        return None  # the side of a tie must be known before the domain is cut
    degree = shadow.degree(integrand)
    if degree is None or degree > (MAX_SOLID_DEGREE if solid else MAX_DEGREE):
        return None
    try:
        for h in halves:
            for v in variables:
                slope(h.atom.g, v)
    except NotDifferentiableError:
        return None
    return Clipped(boxes, halves, integrand, degree, nest.inside)


def _halves(condition: Cond, variables: Sequence[Var], integrand: Expr) -> tuple[tuple[Half, ...], Expr] | None:
    """Returns the halves whose intersection a condition is, and the integrand there; None for other conditions, or other conditions in the
    integrand."""
    halves: dict[Half, None] = {}
    for part in _conjuncts(condition):
        pair = _between(part, variables) if len(variables) <= 2 else None
        if pair is not None:
            upper, lower, forward = pair
            integrand = cast(Expr, replace_node(integrand, upper, forward))
            integrand = cast(Expr, replace_node(integrand, lower, negation(forward)))
            halves[Half(_turned(upper, forward))] = None
            halves[Half(_turned(lower, negation(forward)))] = None
            continue
        half = Half(part.operand, True) if isinstance(part, Not) and isinstance(part.operand, Compare) else Half(cast(Compare, part))
        if not isinstance(half.atom, Compare) or not any(v in half.atom.g.free for v in variables):
            return None
        halves[half] = None
    return tuple(halves), integrand


def _conjuncts(condition: Cond) -> list[Cond]:
    """Returns the conditions that all must hold; a long conjunction is one of shorter ones."""
    found: dict[Cond, None] = {}
    stack = [condition]
    while stack:
        c = stack.pop()
        if isinstance(c, And):
            stack.extend(reversed(c.children))
        else:
            found[c] = None
    return list(found)


def _between(part: Cond, variables: Sequence[Var]) -> tuple[Compare, Compare, Cond] | None:
    """Returns a, b, and whether a holds there, of (a ∧ ¬b) ∨ (¬a ∧ b): between two bounds in unknown order. Their slopes are the same."""
    if not isinstance(part, Or) or len(part.children) != 2:
        return None
    one, other = part.children
    if not isinstance(one, And) or not isinstance(other, And) or len(one.children) != 2:
        return None
    a, b = (c for c in (one.children[0], _denied(one.children[1])))
    if not isinstance(a, Compare) or not isinstance(b, Compare) or set(other.children) != {negation(a), b}:
        return None
    apart = sub(a.g, b.g)
    if Shadow(tuple(variables)).degree(apart) != 0 or (a.resolution is None) != (b.resolution is None):
        return None
    return a, b, positive(cast(Expr, substitute(apart, dict.fromkeys(variables, ZERO))))


def _denied(c: Node) -> Node:
    return c.children[0] if isinstance(c, Not) else c


def _turned(atom: Compare, forward: Cond) -> Compare:
    """Returns the atom where `forward` holds, its negation elsewhere."""
    g = where(forward, atom.g, mul(MINUS_ONE, atom.g))
    r = atom.resolution
    truth = None if r is None else disjunction(conjunction(forward, r), conjunction(negation(forward), negation(r)))
    return cast(Compare, positive(g, True, truth, atom.rivals))
