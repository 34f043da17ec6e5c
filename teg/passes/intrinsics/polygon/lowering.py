"""Clipped polyhedra, polygons and segments as statements: the numbers that decide the domain, the integrands, and their constant factors.

Everything is relative to a corner of the box (x = l + u): differences of large coordinates are taken once, outside, and slivers keep
their digits. Hidden constants (a triangle's area as the sum of its barycentric coordinates) are found in the normal form of
`teg.analysis.polynomial` and evaluated at the corner; an atom that is also a factor of the integrand is c + a·u + b·v. In a triangle
whose vertices are known (`teg.passes.eliminate.vertices`) barycentric coordinates are variables of their own: of a sliver c + a·u + b·v
would lose them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import product
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import distance
from teg.analysis.guards import middle_and_reach
from teg.analysis.polynomial import Shadow
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Const, Expr, Mul, Param, Var, Where
from teg.ir.integral import Integral
from teg.ir.node import Node
from teg.ir.simplify import add, conjunction, mul, negation, positive, sub
from teg.ir.traverse import fresh, rebuild, rewrite, substitute
from teg.passes.eliminate.barycentric import Inside
from teg.passes.eliminate.vertices import match_triangle
from teg.passes.intrinsics.polygon.match import Clipped, Half, match_clipped
from teg.passes.lower.emit import Emitter
from teg.passes.lower.intrinsic import Lowering
from teg.passes.lower.levels import Level
from teg.program import NEARLY, TIE_EPS, Arg, HalfLine, HalfPlane, HalfSpace, Polygon, Polyhedron, Segment, Stmt


class PolygonLowering(Lowering):
    """Polyhedra, polygons and segments of one program. Statements go to `out`."""

    name = "polygon"

    def __init__(self, out: Emitter) -> None:
        self.out = out
        self._clipped: dict[Integral, Clipped] = {}
        self._keys: dict[Integral, object | None] = {}

    def key(self, node: Integral, level: Level) -> object | None:
        """Returns a key that is equal for integrals over the same polyhedron, polygon or segment."""
        if level.coordinates is not None:
            return None
        if node not in self._keys:
            clipped = match_clipped(node)
            if clipped is not None:
                self._clipped[node] = clipped
            self._keys[node] = None if clipped is None else clipped.key
        return self._keys[node]

    def emit(self, group: Sequence[Integral], home: Level, when: str | None) -> tuple[str, ...]:
        """Returns the results of integrals over the same polyhedron, polygon or segment."""
        clipped = [self._clipped[node] for node in group]
        return (self._segment, self._polygon, self._polyhedron)[len(clipped[0].boxes) - 1](clipped, home, when)

    def _polygon(self, group: Sequence[Clipped], home: Level, when: str | None) -> tuple[str, ...]:
        inner, outer = group[0].boxes
        x, y = inner.var, outer.var
        placed = self._placed(group[0], home)
        planes = [
            self._half_plane(half, numbers, group[0], (home, when)) for half, numbers in zip(group[0].halves, placed.numbers, strict=True)
        ]
        triangle = match_triangle([(h.atom.g, h.negated) for h in group[0].halves], (x, y))
        variables = list(placed.offsets)
        corners: tuple[tuple[Arg, Arg], ...] = ()
        across: Arg = 0.0
        if triangle is not None:
            coordinates = fresh("λ₁", placed.taken), fresh("λ₂", placed.taken)
            inside = Inside(triangle, (x, y), coordinates)
            simpler = [replace(c, integrand=inside.simplified(c.integrand)) for c in group]
            if any(w in c.integrand.free for c in simpler for w in coordinates):
                group = simpler
                variables += coordinates
                corners = tuple(
                    (self.out.number(sub(p, inner.lo), home), self.out.number(sub(q, outer.lo), home)) for p, q in triangle.points
                )
                across = self.out.number(triangle.across, home)
                planes = [planes[k] for k in triangle.lines] + [g for k, g in enumerate(planes) if k not in triangle.lines]
        names, body, values, factors = self._inside(group, placed.local, variables, home)
        width, height = (self.out.number(distance(b.lo, b.hi), home) for b in (inner, outer))
        results = tuple(self.out.fresh("v") for _ in group)
        degree = max(c.degree for c in group)
        met = self._met(group[0], home)
        home.block.append(
            Polygon(names, width, height, tuple(planes), (), body, values, factors, results, degree, when, met, corners, across)
        )
        return results

    def _half_plane(self, half: Half, numbers: Sequence[Arg], clipped: Clipped, place: tuple[Level, str | None]) -> HalfPlane:
        """Returns a half-plane; if it may tie, that is decided before: one that ties contains everything, or nothing. The place is its
        level, and the condition without which it is not needed."""
        (a, b, c), atom, out, (home, when) = numbers, half.atom, self.out, place
        if atom.resolution is None:
            return HalfPlane(a, b, c, half.closed)

        def only(condition: str | None, value: Arg, otherwise: float) -> Arg:
            return value if condition is None else out.assign(home, "select", condition, value, otherwise)

        (u, v), bounds = [b.var for b in clipped.boxes], [(b.lo, b.hi) for b in clipped.boxes]
        across, up = (out.assign(home, "mul", n, out.number(distance(*ends), home)) for n, ends in zip((a, b), bounds, strict=True))
        values = [c, *(out.assign(home, "add", c, *steps) for steps in ((across,), (up,), (across, up)))]
        most = self._largest([out.size_of(value, home) for value in values], home)
        ends = [cast(Expr, substitute(atom.g, {u: x, v: y})) for x, y in product(*bounds)]
        terms = self._largest([out.rounding.terms_size(end, home) for end in ends], home)
        close = out.assign(home, "sub", out.assign(home, "mul", NEARLY, terms), most)
        near = out.assign(home, "ge0", only(when, close, -1.0))
        scale = self._largest([out.rounding.tie_scale(end, home) for end in ends], home)
        g, scale = (only(when, only(near, n, otherwise), otherwise) for n, otherwise in ((most, 1.0), (scale, 0.0)))
        first = out.truths(negation(atom.resolution) if half.negated else atom.resolution, home)[0]
        k = out.number_of_tie(cast("tuple[str, str]", atom.rivals))
        holds = out.assign(home, "tie", g, scale, first, k)
        ties = out.assign(home, "ge0", out.assign(home, "sub", out.assign(home, "mul", TIE_EPS, scale), g))
        side = out.assign(home, "select", holds, 1.0, -1.0)
        a, b, c = (out.assign(home, "select", ties, known, n) for known, n in ((0.0, a), (0.0, b), (side, c)))
        return HalfPlane(a, b, c, half.closed)

    def _polyhedron(self, group: Sequence[Clipped], home: Level, when: str | None) -> tuple[str, ...]:
        placed = self._placed(group[0], home)
        halves = zip(placed.numbers, group[0].halves, strict=True)
        spaces = tuple(HalfSpace(tuple(slopes), offset, half.closed) for (*slopes, offset), half in halves)
        names, body, values, factors = self._inside(group, placed.local, placed.offsets, home)
        extents = tuple(self.out.number(distance(b.lo, b.hi), home) for b in group[0].boxes)
        results = tuple(self.out.fresh("v") for _ in group)
        degree = max(c.degree for c in group)
        home.block.append(Polyhedron(names, extents, spaces, (), body, values, factors, results, degree, when))
        return results

    def _placed(self, clipped: Clipped, home: Level) -> _Placed:
        """Returns the halves of a box by offsets from its corner."""
        variables = tuple(b.var for b in clipped.boxes)
        corner = {b.var: b.lo for b in clipped.boxes}
        taken = {v for b in clipped.boxes for v in b.body.free | b.lo.free | b.hi.free} | set(variables)
        offsets = [fresh(letter, taken) for letter, _ in zip("uvw", variables, strict=False)]
        places = {b.var: add(b.lo, u) for b, u in zip(clipped.boxes, offsets, strict=True)}
        steady = _Local(variables, corner, places, {})
        numbers: list[list[Arg]] = []
        affine: dict[Expr, Expr] = {}
        for half in clipped.halves:
            g = steady.constants(half.g)
            *slopes, offset = [cast(Expr, substitute(e, corner)) for e in (*(slope(g, v) for v in variables), g)]
            numbers.append([self.out.number(e, home) for e in (*slopes, offset)])
            if not half.negated:
                affine[half.atom.g] = add(*(mul(a, u) for a, u in zip(slopes, offsets, strict=True)), offset)
        return _Placed(offsets, numbers, _Local(variables, corner, places, affine), taken)

    def _inside(
        self, group: Sequence[Clipped], local: _Local, variables: Sequence[Var], home: Level
    ) -> tuple[tuple[str, ...], tuple[Stmt, ...], tuple[Arg, ...], tuple[Arg, ...]]:
        """Returns the names of the variables, and the integrands at a place: their block, the values, and the constant factors."""
        levels = [home]
        names = tuple(self.out.fresh("x") for _ in variables)
        for var, name in zip(variables, names, strict=True):
            levels.append(levels[-1].inside(var, name))
        values, factors = self._integrands(group, local, variables, levels[1:], home)
        return names, tuple(stmt for level in levels[1:] for stmt in level.block), values, factors

    def _met(self, clipped: Clipped, home: Level) -> Arg:
        """Returns the predicate `met`, which is False only if some half-plane contains no point of the box.

        It reuses the values computed for the edge predicates.
        """
        inner, outer = clipped.boxes
        corner = {outer.var: outer.lo, inner.var: inner.lo}
        extents = [distance(b.lo, b.hi) for b in (outer, inner)]
        parts = []
        for half in clipped.halves:
            middle, reach = middle_and_reach(half.atom.g, corner, extents)
            parts.append(positive(add(mul(MINUS_ONE, middle) if half.negated else middle, reach), strict=False))
        fails = self.out.truths(conjunction(*parts), home)[1]
        return self.out.assign(home, "not", fails) if isinstance(fails, str) else True

    def _segment(self, group: Sequence[Clipped], home: Level, when: str | None) -> tuple[str, ...]:
        (node,) = group[0].boxes
        x, lo, hi = node.var, node.lo, node.hi
        length = distance(lo, hi)
        taken = set(node.body.free | lo.free | hi.free) | {x}
        t = fresh("t", taken)
        steady = _Local((x,), {x: lo}, {x: add(lo, mul(length, t))}, {})
        lines: list[HalfLine] = []
        affine: dict[Expr, Expr] = {}
        for half in group[0].halves:
            g = steady.constants(half.g)
            first, last = (_regrouped(cast(Expr, substitute(g, {x: end}))) for end in (lo, hi))
            ends = [self.out.number(e, home) for e in (first, last)]
            lines.append(self._half_line(half, ends, node, home))
            if not half.negated:
                affine[half.atom.g] = add(mul(sub(last, first), t), first)
        local = _Local((x,), {x: lo}, steady.places, affine)
        name = self.out.fresh("x")
        inside = home.inside(t, name)
        values, factors = self._integrands(group, local, (t,), (inside,), home, length)
        results = tuple(self.out.fresh("v") for _ in group)
        nodes = max(c.degree for c in group) // 2 + 1
        home.block.append(Segment(name, tuple(lines), (), (), tuple(inside.block), values, factors, results, nodes, when))
        return results

    def _half_line(self, half: Half, ends: Sequence[Arg], node: Integral, home: Level) -> HalfLine:
        """Returns a half-line by its ends; if it may tie, with the scale and the resolution of the tie."""
        atom, (first, last), x, bounds = half.atom, ends, node.var, (node.lo, node.hi)
        if atom.resolution is None:
            return HalfLine(first, last, half.closed)
        holds = self.out.truths(negation(atom.resolution) if half.negated else atom.resolution, home)[0]
        k = self.out.number_of_tie(cast("tuple[str, str]", atom.rivals))
        scales = [self.out.rounding.tie_scale(cast(Expr, substitute(atom.g, {x: end})), home) for end in bounds]
        return HalfLine(first, last, half.closed, k, holds, self._size_of_terms(atom.g, x, bounds, home), self._larger(scales, home))

    def _larger(self, sizes: Sequence[Arg], home: Level) -> Arg:
        a, b = sizes
        if isinstance(a, float) and isinstance(b, float):
            return max(a, b)
        return a if a == b else self.out.assign(home, "max", a, b)

    def _largest(self, sizes: Sequence[Arg], home: Level) -> Arg:
        return reduce(lambda a, b: self._larger((a, b), home), sizes)

    def _size_of_terms(self, g: Expr, x: Var, bounds: tuple[Expr, Expr], home: Level) -> Arg:
        """Returns a bound of the terms of an affine function between the bounds, before anything cancels."""
        known: dict[Expr, Arg] = {}
        most = self._larger([self.out.size(end, home) for end in bounds], home)
        stack = [g]
        while stack:
            e = stack[-1]
            if e in known:
                stack.pop()
                continue
            parts: Sequence[Expr] = ()
            if isinstance(e, Add):
                parts = cast("Sequence[Expr]", e.children)
            elif x in e.free and isinstance(e, Mul):
                parts = [c for c in cast("Sequence[Expr]", e.children) if x in c.free]
            elif x in e.free and isinstance(e, Where):
                parts = (e.then, e.otherwise)
            missing = [p for p in parts if p not in known]
            if missing:
                stack.extend(missing)
                continue
            stack.pop()
            sizes = [known[p] for p in parts]
            if isinstance(e, Add):
                known[e] = self.out.assign(home, "add", *sizes)
            elif e is x:
                known[e] = most
            elif x not in e.free:
                known[e] = self.out.size(e, home)
            elif isinstance(e, Mul):
                sizes += [self.out.size(c, home) for c in cast("Sequence[Expr]", e.children) if x not in c.free]
                sizes = [s for s in sizes if s != 1.0] or [1.0]
                known[e] = sizes[0] if len(sizes) == 1 else self.out.assign(home, "mul", *sizes)
            elif isinstance(e, Where):
                known[e] = self.out.assign(home, "select", self.out.truths(e.condition, home)[0], *sizes)
            else:
                known[e] = self.out.assign(home, "add", *(self.out.size(cast(Expr, substitute(e, {x: b})), home) for b in bounds))
        return known[g]

    # -- integrands ----------------------------------------------------------------------------------------------------

    def _integrands(
        self, group: Sequence[Clipped], local: _Local, variables: Sequence[Var], levels: Sequence[Level], home: Level, factor: Expr = ONE
    ) -> tuple[tuple[Arg, ...], tuple[Arg, ...]]:
        """Returns the integrands, and the constant factor of each."""
        values: list[Arg] = []
        factors: list[Arg] = []
        for level in levels:
            level.constants = home
        for clipped in group:
            e = local.of(clipped.integrand)
            parts = e.children if isinstance(e, Mul) else (e,)
            outside = [p for p in parts if not any(v in p.free for v in variables)]
            rest = mul(*(p for p in parts if any(v in p.free for v in variables)))
            values.append(self.out.number(rest, levels[-1]))
            factors.append(self.out.constant((factor, *outside), home))
        return tuple(values), tuple(factors)


class _Placed(NamedTuple):
    """Halves of a box by `offsets` from its corner: the slopes and the offset of each are `numbers`. `taken` are the variables in use."""

    offsets: list[Var]
    numbers: list[list[Arg]]
    local: _Local
    taken: set[Var]


def _has_leaf(e: Add) -> bool:
    return any(isinstance(t, Param | Const) for t in e.children)


def _regrouped(e: Expr) -> Expr:
    """Returns e with (l + u) - x₁ as (l - x₁) + u: terms that cancel are subtracted first, and exactly."""

    def visit(old: Node, node: Node) -> Node:
        if not isinstance(node, Add) or not any(isinstance(t, Add) and _has_leaf(t) for t in node.children):
            return node
        terms = [t for c in node.children for t in (c.children if isinstance(c, Add) and _has_leaf(c) else (c,))]
        given = [
            t
            for t in terms
            if isinstance(t, Param | Const) or (isinstance(t, Mul) and all(isinstance(f, Param | Const) for f in t.children))
        ]
        return add(add(*given), *(t for t in terms if t not in given))

    return cast(Expr, rewrite([e], visit)[e])


class _Local:
    """Expressions of variables as expressions of offsets from a corner."""

    def __init__(
        self, variables: tuple[Var, ...], corner: Mapping[Var, Expr], places: Mapping[Var, Expr], affine: Mapping[Expr, Expr]
    ) -> None:
        self.variables, self.corner, self.places, self.affine = variables, corner, places, affine
        self._shadow = Shadow(variables)
        self._constants: dict[Node, Node] = {}
        self._moved: dict[Node, Node] = {}

    def constants(self, e: Expr) -> Expr:
        """Returns e with its subexpressions of degree 0 evaluated at the corner."""
        return self._rewritten(e, self._constants, lambda node: None)

    def of(self, e: Expr) -> Expr:
        """Returns e at the corner plus the offsets."""
        return self._rewritten(e, self._moved, lambda node: self.places.get(cast(Var, node), self.affine.get(node)))

    def _rewritten(self, root: Expr, new: dict[Node, Node], replace: Callable[[Expr], Expr | None]) -> Expr:
        stack: list[Node] = [root]
        while stack:
            node = stack[-1]
            if node in new:
                stack.pop()
                continue
            if not isinstance(node, Expr) or not any(v in node.free for v in self.variables):
                new[node] = node
                continue
            simple = replace(node)
            simple = self._steady(node) if simple is None else simple
            if simple is not None:
                new[node] = simple
                continue
            missing = [c for c in node.children if c not in new]
            if missing:
                stack.extend(missing)
                continue
            children = [new[c] for c in node.children]
            if isinstance(node, Add):  # l + u - x₁ becomes (l - x₁) + u
                terms: list[Node] = []
                for old, c in zip(node.children, children, strict=True):
                    terms.extend(c.children if isinstance(c, Add) and (isinstance(old, Var) or _has_leaf(c)) else (c,))
                new[node] = add(*cast("list[Expr]", terms))
            else:
                new[node] = rebuild(node, tuple(children))
        return cast(Expr, new[root])

    def _steady(self, node: Expr) -> Expr | None:
        """Returns the value of a hidden constant; None for other nodes."""
        if isinstance(node, Var) or self._shadow.degree(node) != 0:
            return None
        return cast(Expr, substitute(node, self.corner)) if self._shadow.polynomial(node) else ZERO
