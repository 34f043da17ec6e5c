"""Conditions that are decided on a surface, because the surface and the condition differ by a square.

    on u - v² = 0:   u > 0 holds, for u is v² there
    on u = 0:        u - v² > 0 does not hold
    on v = 0:        u - v² > 0 is u > 0
    on c·u - v² = 0: w > 0 holds, where w - u = v + c/4: for c·u - v² is c·w - (v + c/2)² then, as with the roots of √u and √w

So it is where a cone, a sphere or an ellipse touches what it was made of. To rounding, such a condition holds on one side of the place
where both touch and not on the other; decided by its form it has no rounding. Cost: linear in the conditions of an expression.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple, cast

from teg.analysis.polynomial import Point
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, Add, Call, Compare, Cond, Const, Expr, Mul, Pow, called, calls_of, const
from teg.ir.node import Node, nodes_of
from teg.ir.simplify import add, call, div, mul, negation
from teg.ir.traverse import rewrite
from teg.numerics.field import divided, sign_of_residue


class Square(NamedTuple):
    """A sum as sign·scale·v² + rest, with a positive scale."""

    sign: int
    scale: Expr
    v: Expr
    rest: Expr


def decided_on(e: Expr, surface: Expr) -> Expr:
    """Returns an expression that is equal on a surface, almost everywhere, without the conditions that are decided there by their form."""
    atoms = [n for n in nodes_of(Compare, e) if n.resolution is None and n.g is not surface and n.g.free & surface.free]
    decisions = _Decisions(surface, atoms)
    new: dict[Node, Node] = {a: c for a in atoms if (c := decisions.of(a)) is not None}
    if new:
        roots = [n for n in calls_of(called("sqrt"), e) if n.free]
        new |= {r: known for r in roots if (known := decisions.root(r)) is not None}
    return cast(Expr, rewrite([e], lambda old, node: new.get(old, node))[e]) if new else e


def factors_beside_squares(g: Expr) -> list[Expr]:
    """Returns the even powers c of parameters in sums c·u - v². Where c is 0 the two arcs of such a surface are one line, v = 0."""
    found = []
    for square in _squares(g):
        c, u = _apart(square.rest)
        if u.free and square.sign < 0 and not isinstance(c, Const) and _sign([c]) > 0:
            found.append(c)
    return found


def _squares(g: Expr) -> Iterator[Square]:
    """Returns the ways in which a sum is a square and a rest."""
    if not isinstance(g, Add):
        return
    for i, term in enumerate(g.children):
        *numbers, last = term.children if isinstance(term, Mul) else (term,)
        if isinstance(last, Pow) and last.exponent == 2 and last.base.free and (sign := _sign(numbers)):
            yield Square(sign, mul(const(float(sign)), *numbers), last.base, add(*g.children[:i], *g.children[i + 1 :]))


def _sign(factors: Iterable[Node]) -> int:
    """Returns the sign of a product of numbers and even powers of parameters; 0 if it has other factors."""
    sign = 1
    for f in factors:
        if isinstance(f, Const) and f.data != 0.0:
            sign = sign if f.data > 0.0 else -sign
        elif isinstance(f, Mul):
            sign *= _sign(f.children)
        elif not (isinstance(f, Pow) and f.exponent % 2 == 0 and not f.free):
            return 0
    return sign


def _apart(e: Expr) -> tuple[Expr, Expr]:
    """Returns the factors of e without variables, and the others."""
    factors = e.children if isinstance(e, Mul) else (e,)
    return mul(*(f for f in factors if not f.free)), mul(*(f for f in factors if f.free))


class _Decisions:
    """The conditions of an expression on a surface."""

    def __init__(self, surface: Expr, atoms: Sequence[Compare]) -> None:
        self._surface = surface
        self._atoms = atoms
        self._points = (Point("first"), Point("second"))
        functions = [surface, *(a.g for a in atoms)]
        self._with_values = {values: g for g in functions if (values := self._values(g)) is not None}
        self._own = list(self._squares(surface))

    def of(self, atom: Compare) -> Cond | None:
        """Returns what an atom is on the surface; None if its form does not tell."""
        for square in self._own:
            if sign := self._ratio(square.rest, atom.g):
                return FALSE if sign == square.sign else TRUE
        for square in self._squares(atom.g):
            if self._ratio(square.rest, self._surface):
                return TRUE if square.sign > 0 else FALSE
            if self._ratio(square.v, self._surface):
                for other in self._atoms:
                    if sign := self._ratio(square.rest, other.g):
                        return other if sign > 0 else negation(other)
        return None

    def root(self, e: Call) -> Expr | None:
        """Returns what a square root is on the surface, by its form: |v|/√c on c·u - v² = 0. To rounding, u may be negative there."""
        own = self._values(e.children[0])
        for square in self._own if own is not None else ():
            c, u = _apart(square.rest)
            if square.sign < 0 and _sign([c]) > 0 and own == self._values(u):
                return mul(call("magnitude", square.v), call("sqrt", div(square.scale, c)))
        return None

    def _squares(self, g: Expr) -> Iterator[Square]:
        """Returns the ways in which a function is a square and a rest: as it is written, and by the other one of two roots."""
        for square in _squares(g):
            yield square
            c, u = _apart(square.rest)
            if square.sign < 0 and _sign([c]) > 0:
                for v in (square.v, mul(MINUS_ONE, square.v)) if square.scale is ONE else ():
                    values = self._values(add(u, v, mul(const(0.25), c)))
                    if values is not None and (known := self._with_values.get(values)) is not None:
                        yield Square(-1, ONE, add(v, mul(const(0.5), c)), mul(c, known))

    def _values(self, e: Expr) -> tuple[int, ...] | None:
        """Returns values by which equal functions are known; None for a function that is not algebraic, as an integral may be."""
        values = [p.value(e) for p in self._points]
        return None if None in values else tuple(cast("list[int]", values))

    def _ratio(self, a: Expr, b: Expr) -> int:
        """Returns the sign of a/b if that is a number times even powers of parameters; 0 otherwise."""
        factors = a.children if isinstance(a, Mul) else (a,)
        varying = [f for f in factors if f.free]
        sign = _sign(f for f in factors if not f.free)
        if len(varying) != 1 or not sign or varying[0].free != b.free:
            return 0
        (first, other), (second, third) = ([p.value(e) for p in self._points] for e in (varying[0], b))
        if not (first and other and second and third) or divided(first, second) != divided(other, third):
            return 0
        return sign * (sign_of_residue(divided(first, second)) or 0)
