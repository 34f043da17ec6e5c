"""Where the pieces of each integral begin and end.

The integrand of ∫ dx is smooth between its *breaks*: the roots in x of

- the atoms in x, wherever they stand in the integrand, its inner integrals and their bounds; arguments of |·| and √;
- what an inner integral ∫ₗʰ dz contributes (its projection, one step of cylindrical decomposition): for its own break functions f, f₁, f₂
      f|z:=l, f|z:=h                         a root of the inner integral crosses a bound
      a₂·f₁|z:=l - a₁·f₂|z:=l                two roots meet (f = f|z:=l + a·(z - l); a quadratic f₂ is taken at the root of f₁)
      a                                      a root runs away to infinity
      B² - 4AC                               two roots of a quadratic f meet and vanish: √-like from then on
      the border of the condition under which a root of another formula exists, likewise
      h - l                                  the bounds cross

A function with branches contributes the breaks of each branch: too many breaks cost time, never accuracy. Functions whose roots have no
formula leave the integral *incomplete*: it is then integrated adaptively.
Source: Collins 1975 (projection); Saye 2022, for quadrature on such pieces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from teg.calculus import slope
from teg.expr import Add, Call, Compare, Const, Expr, Mul, Pow, Var, Where, mul, sub
from teg.integral import Integral
from teg.node import Node, digest, postorder
from teg.polynomial import P, Point, Poly, Ratio, Shadow, residue
from teg.roots import discriminant, quadratic_coefficients, solve
from teg.surfaces import atoms_of, binders_inside
from teg.traverse import replace_node, substitute

MAX_BRANCHES = 16
MAX_FUNCTIONS = 4000


@dataclass(frozen=True)
class Breaks:
    """The breaks of one integral.

    `functions` have them as roots; `points` are the roots; `handled` are the surfaces g whose sign is constant on every piece; `complete`
    says that the integrand is smooth on every piece; `rooted` that it may behave like a square root at a piece's end.
    """

    functions: tuple[Expr, ...]
    points: tuple[Expr, ...]
    handled: frozenset[Expr]
    complete: bool
    rooted: bool


@dataclass
class _Found:
    functions: dict[Expr, None]
    rooted: bool = False
    complete: bool = True


class BreakAnalysis:
    """Breaks and degrees of the integrals of a program, each computed once."""

    def __init__(self) -> None:
        self._breaks: dict[Integral, Breaks] = {}
        self._projections: dict[Integral, _Found] = {}
        self._shadows: dict[tuple[Var, ...], Shadow] = {}
        self._points = (Point("first"), Point("second"))

    # -- breaks --------------------------------------------------------------------------------------------------------

    def of(self, node: Integral) -> Breaks:
        """The breaks of an integral; those of the integrals inside it are found first."""
        if node not in self._breaks:
            for inner in postorder([node]):
                if isinstance(inner, Integral) and inner not in self._breaks:
                    self._breaks[inner] = self._find(inner)
        return self._breaks[node]

    def _find(self, node: Integral) -> Breaks:
        x, body = node.var, node.body
        inner = binders_inside(body)
        found = _Found({})
        direct = [a.g for a in atoms_of(body, x) if not a.g.free & inner]
        for g in direct:
            found.functions[g] = None
        self._collect(body, x, inner, found)
        points: dict[Expr, None] = {}
        handled: set[Expr] = set()
        complete = found.complete
        functions = self._distinct(found.functions)
        for f, representative in functions.items():
            roots = self._roots(representative, x, node.lo, node.hi)
            if roots is None:
                complete = False
                continue
            if roots[1]:
                handled.add(f)
            else:
                complete = False
            for r in roots[0]:
                if not _outside(r, node.lo, node.hi):
                    points[r] = None
        kept = tuple(dict.fromkeys(functions.values()))
        return Breaks(kept, tuple(points), frozenset(handled), complete, found.rooted)

    def _collect(self, body: Expr, x: Var, inner: frozenset[Var], found: _Found) -> None:
        """Functions that are not atoms: arguments of |·| and √, and what inner integrals contribute."""
        seen: set[Node] = set()
        stack: list[Node] = [body]
        while stack:
            node = stack.pop()
            if node in seen or x not in node.free:
                continue
            seen.add(node)
            stack.extend(node.children[:1] if isinstance(node, Compare) else node.children)
            if isinstance(node, Call) and not node.free & inner:
                if node.name == "magnitude":
                    found.functions[node.children[0]] = None
                elif node.name in ("sqrt", "root", "pow"):
                    found.functions[node.children[0]] = None
                    found.rooted = True
                elif node.name in ("floor", "mod"):
                    found.complete = False
            elif isinstance(node, Integral):
                projection = self._projection(node)
                found.complete &= projection.complete
                found.rooted |= projection.rooted
                for f in projection.functions:
                    if x in f.free and not f.free & inner:
                        found.functions[f] = None

    def _distinct(self, functions: dict[Expr, None]) -> dict[Expr, Expr]:
        """Each function with the first one proportional to it."""
        first: dict[object, Expr] = {}
        result: dict[Expr, Expr] = {}
        for f in functions:
            u, v = (p.value(f) for p in self._points)
            key: object = v * pow(u, -1, P) % P if u and v else f
            result[f] = first.setdefault(key, f)
        return result

    def _roots(self, f: Expr, x: Var, lo: Expr, hi: Expr) -> tuple[list[Expr], bool] | None:
        """The roots of a function with all its branches, and whether these are certainly all; None if no formula is known."""
        points: list[Expr] = []
        certain = True
        branches = _branches(f)
        if branches is None:
            return None
        for branch in branches:
            roots = solve(branch, x, lo, hi)
            if roots is None:
                return None
            points.extend(r.point for r in roots.found)
            certain &= roots.certain and roots.reliable
        return points, certain

    def _projection(self, node: Integral) -> _Found:
        if node not in self._projections:
            self._projections[node] = self._project(node)
        return self._projections[node]

    def _project(self, node: Integral) -> _Found:
        z, lo, hi = node.var, node.lo, node.hi
        breaks = self.of(node)
        out = _Found({}, breaks.rooted and not breaks.complete, breaks.complete)

        def put(f: Expr) -> None:
            if len(out.functions) >= MAX_FUNCTIONS:
                out.complete = False
            elif f.free:
                out.functions[f] = None

        put(sub(hi, lo))
        affine: list[tuple[Expr, Expr, Expr]] = []
        quadratic: list[Expr] = []
        others = 0
        for function in breaks.functions:
            for f in _branches(function) or ():
                degree = Shadow((z,)).degree(f)
                for bound in (lo, hi):
                    put(cast(Expr, substitute(f, {z: bound})))
                if degree == 1:
                    at_lo, rate = (
                        cast(Expr, substitute(f, {z: lo})),
                        cast(Expr, substitute(slope(f, z), {z: lo})),
                    )
                    put(rate)
                    affine.append((f, rate, at_lo))
                elif degree == 2:
                    a, b, c = quadratic_coefficients(f, z)
                    put(a)
                    put(discriminant(a, b, c))
                    out.rooted = True
                    quadratic.append(f)
                elif degree != 0:
                    out.rooted = True
                    others += 1
                    for g in _borders_of_existence(f, z, lo, hi):
                        put(g)
        for i, (_, rate1, at1) in enumerate(affine):
            for _, rate2, at2 in affine[:i]:
                put(sub(mul(rate2, at1), mul(rate1, at2)))
            for q in quadratic:
                put(cast(Expr, substitute(q, {z: sub(lo, at1 / rate1)})))
        if len(quadratic) + others > 1 or (others and affine):
            out.complete = False  # where their roots meet is not known
        return out

    # -- degrees -------------------------------------------------------------------------------------------------------

    def degree(self, node: Integral) -> int | None:
        """Degree of the integrand in the variable on each piece; None if it is not known to be a polynomial."""
        if not self.of(node).complete:
            return None
        return self._shadow((node.var,)).degree(node.body)

    def _shadow(self, variables: tuple[Var, ...]) -> Shadow:
        if variables not in self._shadows:
            self._shadows[variables] = Shadow(variables, integral=lambda inner: self._integral_shadow(inner, variables))
        return self._shadows[variables]

    def _integral_shadow(self, node: Integral, variables: tuple[Var, ...]) -> Ratio | None:
        """An integral as a polynomial of outer variables: a random combination of its antiderivative at its bounds and breaks."""
        breaks = self.of(node)
        if not breaks.complete or node.var in variables:
            return None
        inner = self._shadow((node.var, *variables)).polynomial(node.body)
        if inner is None:
            return None
        shadow = self._shadow(variables)
        ends = [shadow.polynomial(e) for e in (node.lo, node.hi, *breaks.points)]
        if any(e is None for e in ends):
            return None
        total: Ratio | None = shadow.constant(0)
        for k, end in enumerate(cast("list[Poly]", ends)):
            at_end = _antiderivative_at(shadow, inner, end)
            if at_end is None or total is None:
                return None
            total = shadow._sum([total, shadow._scale(at_end, residue("end", digest(node), k))])
        return total


def _antiderivative_at(shadow: Shadow, inner: Poly, end: Poly) -> Ratio | None:
    """∫ inner dz at z = end: monomials c·zⁱ·rest become c/(i+1)·endⁱ⁺¹·rest."""
    one = shadow.constant(1)
    powers: list[Ratio] = [one]
    total: Ratio | None = shadow.constant(0)
    for i in range(max((m[0] for m in inner), default=0) + 1):
        step = shadow._product(powers[-1], (end, one[1]))
        if step is None:
            return None
        powers.append(step)
        rest: Poly = {m[1:]: c * pow(i + 1, -1, P) % P for m, c in inner.items() if m[0] == i}
        if rest:
            total = shadow._sum([total, shadow._product((rest, one[1]), step)])
            if total is None:
                return None
    return total


def _borders_of_existence(f: Expr, z: Var, lo: Expr, hi: Expr) -> list[Expr]:
    """Where roots of a function with a formula appear and vanish."""
    roots = solve(f, z, lo, hi)
    if roots is None:
        return []
    return [a.g for r in roots.found for a in atoms_of(r.exists) if z not in a.g.free]


def _outside(r: Expr, lo: Expr, hi: Expr) -> bool:
    """A root known by its number to lie outside of (lo, hi), or on its border."""
    if not (isinstance(r, Const) and isinstance(lo, Const) and isinstance(hi, Const)):
        return False
    return not min(lo.data, hi.data) < r.data < max(lo.data, hi.data)


def _branches(f: Expr) -> list[Expr] | None:
    """f with every `where` whose condition holds variables taken either way; None if they are too many."""
    result = [f]
    done: list[Expr] = []
    while result:
        e = result.pop()
        outer = _variable_where(e)
        if outer is None:
            done.append(e)
        elif len(result) + len(done) >= MAX_BRANCHES:
            return None
        else:
            for branch in (outer.then, outer.otherwise):
                result.append(cast(Expr, replace_node(e, outer, branch)))
    return done


def _variable_where(e: Expr) -> Where | None:
    stack: list[Expr] = [e]
    seen: set[Expr] = set()
    while stack:
        node = stack.pop()
        if node in seen or not node.free:
            continue
        seen.add(node)
        if isinstance(node, Where) and node.condition.free:
            return node
        if isinstance(node, Where):
            stack += [node.then, node.otherwise]
        elif isinstance(node, Add | Mul | Pow | Call):
            stack.extend(cast("tuple[Expr, ...]", node.children))
    return None
