"""What is known of the functions whose roots are breaks: which are proportional, where quadratic ones keep their digits, their roots."""

from __future__ import annotations

from teg.analysis.isolation import MARGIN
from teg.analysis.polynomial import Degrees, Point
from teg.analysis.roots import Roots, far_origin, quadratic_coefficients, quadratic_roots, solve, tidy
from teg.ir.expr import TRUE, ZERO, Add, Cond, Const, Expr, Mul, Param, Var, const
from teg.ir.simplify import add, conjunction, disjunction, div, mul, positive, sub
from teg.numerics.field import divided


class BreakFunctions:
    """Functions of one program; everything is computed once."""

    def __init__(self) -> None:
        self.degrees = Degrees()
        self._formulas: dict[tuple[Expr, Var, Expr, Expr], Roots | None] = {}
        self._points = (Point("first"), Point("second"))
        self._keys: dict[Expr, object] = {}
        self._turned: dict[tuple[object, object], Expr] = {}
        self._derived_from: dict[object, Expr] = {}
        self._coefficients: dict[tuple[Expr, Var, Expr], tuple[Expr, Expr, Expr]] = {}
        self._vertices: dict[tuple[Expr, Var], Expr | None] = {}

    def key(self, f: Expr) -> object:
        """Returns a key that is equal for functions that are proportional by a number."""
        if f not in self._keys:
            u, v = (p.value(f) for p in self._points)
            self._keys[f] = divided(v, u) if u and v else f
        return self._keys[f]

    def note_turned(self, resultant: Expr, border: Expr, turned: Expr) -> None:
        """Keeps a function with the same zeros as a resultant has where a border is 0."""
        self._turned[self.key(resultant), self.key(border)] = turned

    def turned(self, f: Expr, g: Expr) -> tuple[Expr, Expr] | None:
        """Returns two functions that are 0 where f and g are, without double zeros that these have, if f is a resultant of quadratics and g
        the discriminant of one of them, or the other way round; None for others."""
        for resultant, border in ((f, g), (g, f)):
            found = self._turned.get((self.key(resultant), self.key(border)))
            if found is not None:
                return found, border
        return None

    def note_derived(self, f: Expr, before: Expr) -> None:
        """Keeps the function from whose roots a function is derived: the zeros of both lie near each other."""
        self._derived_from.setdefault(self.key(f), before)

    def coefficients(self, f: Expr, x: Var, origin: Expr) -> tuple[Expr, Expr, Expr]:
        """Returns A, B, C of a quadratic f = A·w² + B·w + C, w = x - origin, cached: each pair asks for them."""
        key = f, x, origin
        if key not in self._coefficients:
            self._coefficients[key] = quadratic_coefficients(f, x, origin)
        return self._coefficients[key]

    def vertex(self, f: Expr, x: Var) -> Expr | None:
        """Returns the vertex in x of the first quadratic with a number before x², of those from which f was derived and f itself, if that
        vertex is a sum of parameters and numbers; else None."""
        if (f, x) not in self._vertices:
            before = self._derived_from.get(self.key(f))
            vertex = None if before is None else self.vertex(before, x)
            self._vertices[f, x] = self._own_vertex(f, x) if vertex is None else vertex
        return self._vertices[f, x]

    def _own_vertex(self, f: Expr, x: Var) -> Expr | None:
        if self.degrees.of(f, x) != 2:
            return None
        a, b, _ = self.coefficients(f, x, ZERO)
        middle = tidy(mul(const(-0.5), div(b, a)))
        return middle if isinstance(a, Const) and _is_shift(middle) else None

    def origin(self, f: Expr, x: Var, lo: Expr, hi: Expr) -> Expr:
        """Returns a place near the roots of a quadratic, relative to which it keeps its digits."""
        vertex = self.vertex(f, x) if self.key(f) in self._derived_from else None
        return far_origin(lo, hi) if vertex is None else vertex

    def solve(self, f: Expr, x: Var, lo: Expr, hi: Expr) -> Roots | None:
        """Returns the roots of a function by formula, cached: integrals that share surfaces and bounds ask for the same roots."""
        problem = (f, x, lo, hi)
        if problem not in self._formulas:
            derived = self.degrees.of(f, x) == 2 and self.key(f) in self._derived_from
            roots = Roots(quadratic_roots(f, x, self.origin(f, x, lo, hi))) if derived else solve(f, x, lo, hi, degrees=self.degrees)
            self._formulas[problem] = roots
        return self._formulas[problem]

    def is_zero(self, f: Expr) -> bool:
        """Returns whether a function is 0 everywhere, although it is not written as 0."""
        return all(p.value(f) == 0 for p in self._points)

    def somewhere(self, f: Expr, z: Var, lo: Expr, hi: Expr) -> Cond:
        """Returns the condition that a root of f, known by formula, lies between the bounds."""
        roots = self.solve(f, z, lo, hi)
        if roots is None:
            return TRUE
        return disjunction(*(conjunction(r.exists, within(r.point, lo, hi)) for r in roots.found))

    def nearby(self, f: Expr, z: Var, lo: Expr, hi: Expr) -> Cond:
        """Returns the condition that a root of a quadratic lies between the bounds or near them. Near a double root the root need not
        exist."""
        roots = self.solve(f, z, lo, hi)
        return TRUE if roots is None else disjunction(*(near(r.point, lo, hi) for r in roots.found))


def _is_shift(e: Expr) -> bool:
    """Returns whether an expression is a sum of parameters, multiples of them, and numbers; not a number alone."""
    terms = [t.children if isinstance(t, Mul) else (t,) for t in (e.children if isinstance(e, Add) else (e,))]
    kinds = [[type(f) for f in t] for t in terms]
    return all(k.count(Param) <= 1 and set(k) <= {Param, Const} for k in kinds) and any(Param in k for k in kinds)


def within(point: Expr, lo: Expr, hi: Expr) -> Cond:
    """Returns the condition that a point lies strictly between two bounds, in either order."""
    return positive(mul(sub(point, lo), sub(hi, point)))


def near(point: Expr, lo: Expr, hi: Expr) -> Cond:
    """Returns the condition that a point lies between two bounds, or a little outside."""
    margin = mul(const(MARGIN), sub(hi, lo))
    return positive(mul(add(sub(point, lo), margin), add(sub(hi, point), margin)))
