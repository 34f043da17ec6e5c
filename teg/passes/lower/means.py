"""Means of integrands over a piece, in closed form: ∫ f dx = (q - p)·mean, between breaks p < q.

    P·exp(a·x + b)     E·Σₖ P⁽ᵏ⁾(e)/k!·(±L)ᵏ·Sₖ,   S₀ = (1 - exp(-z))/z,  Sₖ = (k·Sₖ₋₁ - exp(-z))/z,  z = |a|·L
    P·exp(quadratic)   `teg.passes.lower.gaussian`
    P·sin(a·x + b)     [-P·cos + P′·sin/a + P″·cos/a²]/(a·L),  and the like for cos
    P·exp(a·x)·cos(b·x)   the real part of [P - P′/λ + P″/λ²]·exp(λ·x)/(λ·L),  λ = a + i·b,  the imaginary one for sin

E is the exponential at e, the end where it is larger, L = q - p. For small z the steps upwards would cancel: there the highest Sₖ is a
series, and steps go downwards. Of a wave that changes little Gauss nodes give the mean to rounding. Conditions are constant on a piece,
sums are taken term by term, products are multiplied out. The mean is an expression of p, q and, in conditions, x, so backends need to
know nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from typing import NamedTuple, cast

from teg.analysis.calculus import slope, value_children
from teg.analysis.polynomial import Shadow
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Call, Expr, Mul, Pow, Var, Where, const, is_infinite
from teg.ir.function import Apply
from teg.ir.integral import Integral, PointMasses
from teg.ir.node import Node, postorder, postorder_through
from teg.ir.simplify import add, call, div, integer_power, mul, positive, sub, where
from teg.ir.traverse import Steps, stands_in, substitute, unrolled
from teg.passes.lower.gaussian import MOST_DEGREE, Gaussian, is_gaussian, mean_at_nodes
from teg.program import Gauss

NARROW = (1.0, 1.0, 1.5, 2.0)
"""The change of the exponent below which Sₖ comes from a series, by the degree of the polynomial; beyond it Sₖ has lost 6 bits at most."""
WAVES = 3
"""Polynomials in front of a wave have a degree below."""
WAVE_NODES = 7
"""Nodes that integrate polynomials times a wave to rounding where its argument changes by 1 at most."""
DAMPED_NODES = 8
"""Nodes that integrate polynomials times an exponential and a wave to rounding where both arguments change by 1 at most."""
MOST_TERMS = 16
MOST_NODES = 2000
"""The largest number of terms of a mean; of nodes of an integrand, and of its parts when it is multiplied out."""
KEPT = 1024
"""The integrands whose means are kept."""

P, Q = Var.make("piece's lower end", ()), Var.make("piece's upper end", ())
"""The ends of a piece."""


class NoMeanError(Exception):
    """The mean has no closed form here."""


@dataclass(frozen=True, slots=True)
class Mean(Gauss):
    """The rule of integrals whose integrand is its mean over the piece: one node."""


class Means(NamedTuple):
    """The mean of an integrand over a piece from P to Q; the Gaussians in it, None if there are other terms."""

    mean: Expr
    gaussians: tuple[Gaussian, ...] | None


@lru_cache(maxsize=KEPT)
def mean_of(body: Expr, x: Var) -> Means | None:
    """Returns the mean of an integrand over a piece; None if it has no closed form, or is a polynomial."""
    if body.has_delta or _has_nested_functions(body, x):
        return None
    order = postorder([body])
    if len(order) > MOST_NODES or any(isinstance(n, Integral | PointMasses | Apply) and x in n.free for n in order):
        return None
    means = _Means(x)
    try:
        result = means.of(body)
    except NoMeanError:
        return None
    if not 0 < means.terms <= MOST_TERMS:
        return None
    return Means(result, tuple(means.gaussians) if len(means.gaussians) == means.terms and not means.polynomials else None)


def _has_nested_functions(body: Expr, x: Var) -> bool:
    """Returns whether a function of x stands inside another one, outside of conditions: there is no closed form."""
    nested: set[Node] = set()  # the nodes with a function of x below
    for node in postorder_through(body, (x,), _values):
        below = any(c in nested for c in _values(node))
        if isinstance(node, Call):
            if below:
                return True
            nested.add(node)
        elif below:
            nested.add(node)
    return False


def without_tails(group: Sequence[Integral]) -> tuple[Expr, Expr]:
    """Returns finite bounds of integrals of Gaussians over an infinite range, beyond which these are 0."""
    lo, hi = group[0].lo, group[0].hi
    gaussians = {g.exponent: g for i in group for g in cast(Means, mean_of(i.body, i.var)).gaussians or ()}.values()
    if is_infinite(lo):
        ends = [g.end(-1.0) for g in gaussians]
        lo = reduce(lambda a, b: call("min", a, b), ends if is_infinite(hi) else [hi, *ends])
    if is_infinite(hi):
        hi = reduce(lambda a, b: call("max", a, b), [lo, *(g.end(1.0) for g in gaussians)])
    return lo, hi


class _Means:
    """Means over one piece. `terms` counts exponentials and waves, `polynomials` terms without one; `gaussians` has those of the terms.
    `_around` has the constant factors around the term that is looked at."""

    def __init__(self, x: Var) -> None:
        self.x, self.p, self.q = x, P, Q
        self.length = sub(Q, P)
        self.terms = self.polynomials = self._met = 0
        self.gaussians: list[Gaussian] = []
        self._shadow = Shadow((x,))
        self._around: list[Expr] = []
        self._moving: dict[Node, bool] = {}
        self._choosing: dict[Node, bool] = {}

    def of(self, e: Expr) -> Expr:
        """Returns the mean of an expression. Raises NoMeanError if it has no closed form, or one of too many terms."""
        return unrolled(self._mean(e))

    def _mean(self, e: Expr) -> Steps[Expr]:
        self._count()
        if self._is_constant(e):
            self.polynomials += e is not ZERO
            return e
        match e:
            case Add():
                parts = []
                for c in (yield self._joined(e.children)):
                    parts.append((yield self._mean(c)))
                return add(*parts)
            case Where():
                return where(e.condition, (yield self._mean(e.then)), (yield self._mean(e.otherwise)))
            case Mul() | Pow():
                mean: Expr = yield self._product(e.children if isinstance(e, Mul) else [e])
                return mean
            case _:
                return self._term([e])

    def _count(self) -> None:
        self._met += 1
        if self._met > MOST_NODES:
            raise NoMeanError

    def _joined(self, terms: Sequence[Expr]) -> Steps[list[Expr]]:
        """Returns terms in which polynomials times the same exponential are one: of a narrow Gaussian, their means cancel."""
        alone: list[Expr] = []
        joined: dict[Expr, list[Expr]] = {}
        for term in terms:
            parts = yield self._by_exponential(term)
            if parts is None:
                alone.append(term)
                continue
            for exponential, polynomial in parts.items():
                joined.setdefault(exponential, []).append(polynomial)
        return alone + [mul(add(*others), exponential) for exponential, others in joined.items()]

    def _by_exponential(self, term: Expr) -> Steps[dict[Expr, Expr] | None]:
        """Returns a term as a sum of polynomials times exponentials, by the exponential; None if it is none. Factors in front of a sum stay
        there: constants that are multiplied are rounded, and their terms would not cancel."""
        self._count()
        factors = cast("Sequence[Expr]", term.children) if isinstance(term, Mul) else (term,)
        moving = [f for f in factors if not self._is_polynomial(f)]
        if len(moving) != 1:
            return None
        others = mul(*(f for f in factors if f is not moving[0]))
        if isinstance(moving[0], Call):
            return {moving[0]: others} if moving[0].name == "exp" and not self._is_constant(moving[0]) else None
        if not isinstance(moving[0], Add):
            return None
        joined: dict[Expr, list[Expr]] = {}
        for c in cast("Sequence[Expr]", moving[0].children):
            parts = yield self._by_exponential(c)
            if parts is None:
                return None
            for exponential, polynomial in parts.items():
                joined.setdefault(exponential, []).append(polynomial)
        return {exponential: mul(others, add(*polynomials)) for exponential, polynomials in joined.items()}

    def _product(self, factors: Sequence[Expr]) -> Steps[Expr]:
        """Returns the mean of a product. A sum or a choice among the factors is multiplied out."""
        outside = [f for f in factors if self._is_constant(f)]
        inside = [g for f in factors if not self._is_constant(f) for g in self._written_out(f)]
        around, self._around = self._around, [*self._around, *outside]
        mean = yield self._inside(inside)
        self._around = around
        return mul(*outside, mean)

    def _inside(self, factors: Sequence[Expr]) -> Steps[Expr]:
        """Returns the mean of a product of factors that are not constant."""
        for i, f in enumerate(factors):
            others = [*factors[:i], *factors[i + 1 :]]
            if isinstance(f, Where):
                then = yield self._mean(mul(f.then, *others))
                return where(f.condition, then, (yield self._mean(mul(f.otherwise, *others))))
            if isinstance(f, Add) and not self._is_polynomial(f):
                whole, parts = mul(*others, f), []
                terms = yield self._joined([whole])
                if terms == [whole]:
                    terms = yield self._joined([mul(c, *others) for c in cast("Sequence[Expr]", f.children)])
                for c in terms:
                    parts.append((yield self._mean(c)))
                return add(*parts)
        return self._term(factors)

    def _written_out(self, e: Expr) -> Sequence[Expr]:
        """Returns the factors of a square or a cube of a sum that has other functions in it."""
        if isinstance(e, Pow) and isinstance(e.base, Add) and 2 <= e.exponent <= 3 and not self._is_polynomial(e.base):
            return [e.base] * e.exponent
        return [e]

    def _is_constant(self, e: Expr) -> bool:
        """Returns whether an expression depends on x by conditions only, which are constant on a piece."""
        return not stands_in(e, lambda n: n is self.x, self._moving, self._below)

    def _below(self, node: Node) -> Sequence[Node]:
        return [c for c in _values(node) if self.x in c.free]

    def _with_variable(self, node: Node) -> Sequence[Node]:
        return [c for c in node.children if self.x in c.free]

    def _is_polynomial(self, e: Expr) -> bool:
        return self._degree(e) is not None

    def _degree(self, e: Expr) -> int | None:
        """Returns the degree of an expression without conditions on x, None if it is no polynomial."""
        if self.x in e.free and stands_in(e, lambda n: isinstance(n, Where), self._choosing, self._with_variable):
            return None
        return self._shadow.degree(e)

    def _term(self, factors: Sequence[Expr]) -> Expr:
        """Returns the mean of a product of polynomials, exponentials and at most one wave."""
        exponent: list[Expr] = []
        waves: list[Call] = []
        rest: list[Expr] = []
        for f in factors:
            base, k = (f.base, f.exponent) if isinstance(f, Pow) else (f, 1)
            if isinstance(base, Call) and base.name == "exp":
                exponent.append(mul(const(k), base.children[0]))
            elif isinstance(base, Call) and base.name in ("sin", "cos") and k == 1:
                waves.append(base)
            else:
                rest.append(f)
        if len(waves) > 1:
            raise NoMeanError
        polynomial = mul(ONE, *rest)
        degree = self._degree(polynomial)
        if degree is None:
            raise NoMeanError
        if not exponent and not waves:
            self.polynomials += 1
            return self._at_nodes(polynomial, degree // 2 + 1)
        self.terms += 1
        if waves and exponent:
            return self._damped(waves[0], add(*exponent), polynomial, degree)
        if waves:
            return self._wave(waves[0], polynomial, degree)
        whole = add(*sorted(exponent, key=lambda e: self._degree(e) or 0))  # in an order of its own: equal Gaussians are one
        if self._degree(whole) == 2 and is_gaussian(whole, self.x, [*self._around, polynomial]) and degree <= MOST_DEGREE:
            gaussian = Gaussian(whole, self.x)
            self.gaussians.append(gaussian)
            return gaussian.mean(polynomial, degree, self.p, self.q)
        return self._exponential(whole, polynomial, degree)

    def _linear(self, argument: Expr) -> Expr:
        """Returns the slope of a linear function."""
        if self._degree(argument) != 1:
            raise NoMeanError
        rate = slope(argument, self.x)
        return cast(Expr, substitute(rate, {self.x: self.p}))

    def _at(self, e: Expr, place: Expr) -> Expr:
        return cast(Expr, substitute(e, {self.x: place}))

    def _at_nodes(self, e: Expr, nodes: int) -> Expr:
        """Returns the mean by Gauss nodes."""
        return mean_at_nodes(e, self.x, self.p, self.q, nodes)

    def _exponential(self, exponent: Expr, polynomial: Expr, degree: int) -> Expr:
        if degree >= len(NARROW):
            raise NoMeanError
        rate = self._linear(exponent)
        z = mul(call("magnitude", rate), call("magnitude", self.length))
        rising = positive(rate)
        end = where(rising, self.q, self.p)
        step = where(rising, mul(MINUS_ONE, self.length), self.length)
        less = call("expm1", mul(MINUS_ONE, z))
        rest = add(less, ONE)
        moments = _moments(z, less, rest, degree)
        terms, derivative = [], polynomial
        for k, moment in enumerate(moments):
            terms.append(mul(const(1.0 / math.factorial(k)), self._at(derivative, end), integer_power(step, k), moment))
            derivative = slope(derivative, self.x)
        return mul(call("exp", self._at(exponent, end)), add(*terms))

    def _wave(self, wave: Call, polynomial: Expr, degree: int) -> Expr:
        if degree >= WAVES:
            raise NoMeanError
        argument = wave.children[0]
        rate = self._linear(argument)
        sine, cosine = call("sin", argument), call("cos", argument)
        # antiderivatives of the wave, one after the other, times a power of the rate
        cycle = [mul(MINUS_ONE, cosine), mul(MINUS_ONE, sine), cosine, sine]
        start = 0 if wave.name == "sin" else 3
        total: Expr = ZERO
        derivative, scale = polynomial, cast(Expr, ONE)
        for k in range(degree + 1):
            total = add(total, mul(const((-1.0) ** k), derivative, cycle[(start + k) % 4], scale))
            derivative, scale = slope(derivative, self.x), div(scale, rate)
        z = mul(rate, self.length)
        wide = div(sub(self._at(total, self.q), self._at(total, self.p)), z)
        narrow = self._at_nodes(mul(polynomial, wave), WAVE_NODES)
        return where(positive(sub(call("magnitude", z), ONE)), wide, narrow)

    def _damped(self, wave: Call, exponent: Expr, polynomial: Expr, degree: int) -> Expr:
        """Returns the mean of a polynomial times an exponential times a wave, by the antiderivative of exp(λ·x) with a complex rate λ."""
        if degree >= WAVES:
            raise NoMeanError
        growth, turn = self._linear(exponent), self._linear(wave.children[0])
        square = add(integer_power(growth, 2), integer_power(turn, 2))
        inverse = div(growth, square), mul(MINUS_ONE, div(turn, square))
        antiderivative = call("cos", wave.children[0]), call("sin", wave.children[0])  # in turn, without the exponential
        total, derivative = cast(Expr, ZERO), polynomial
        for k in range(degree + 1):
            antiderivative = _complex_product(antiderivative, inverse)
            total = add(total, mul(const((-1.0) ** k), derivative, antiderivative[wave.name == "sin"]))
            derivative = slope(derivative, self.x)
        total = mul(call("exp", exponent), total)
        wide = div(sub(self._at(total, self.q), self._at(total, self.p)), self.length)
        narrow = self._at_nodes(mul(polynomial, call("exp", exponent), wave), DAMPED_NODES)
        change = mul(call("max", call("magnitude", growth), call("magnitude", turn)), call("magnitude", self.length))
        return where(positive(sub(change, ONE)), wide, narrow)


def _complex_product(a: tuple[Expr, Expr], b: tuple[Expr, Expr]) -> tuple[Expr, Expr]:
    return sub(mul(a[0], b[0]), mul(a[1], b[1])), add(mul(a[0], b[1]), mul(a[1], b[0]))


def _values(node: Node) -> Sequence[Node]:
    return value_children(cast(Expr, node))


def _moments(z: Expr, less: Expr, rest: Expr, degree: int) -> list[Expr]:
    """Returns Sₖ = ∫ uᵏ·exp(-z·u) du over (0, 1) for k = 0 … degree, z >= 0; `less` is exp(-z) - 1, and `rest` exp(-z)."""
    first = where(positive(z), div(mul(MINUS_ONE, less), z), ONE)
    if degree == 0:
        return [first]
    wide = [first]
    for k in range(1, degree + 1):
        wide.append(div(sub(mul(const(k), wide[-1]), rest), z))
    narrow = [_series(z, degree)]
    for k in range(degree, 1, -1):
        narrow.append(mul(const(1.0 / k), add(mul(z, narrow[-1]), rest)))
    far = positive(sub(z, const(NARROW[degree])))
    return [first, *(where(far, a, b) for a, b in zip(wide[1:], reversed(narrow), strict=True))]


def _series(z: Expr, degree: int) -> Expr:
    """Returns S_degree for z <= NARROW: Taylor's series about the middle of this range, to rounding."""
    middle = 0.5 * NARROW[degree]
    shifted = sub(z, const(middle))
    coefficients: list[float] = []
    while not coefficients or abs(coefficients[-1]) * middle ** (len(coefficients) - 1) > 2.0**-56:
        k = len(coefficients)
        coefficients.append((-1.0) ** k / math.factorial(k) * _moment(degree + k, middle))
    value: Expr = const(coefficients[-1])
    for c in coefficients[-2::-1]:
        value = add(const(c), mul(shifted, value))
    return value


def _moment(k: int, z: float) -> float:
    """Returns Sₖ as a number: exp(-z)·Σⱼ zʲ/((k + 1)…(k + 1 + j)), whose terms are positive."""
    term, j = 1.0 / (k + 1), 0
    terms = []
    while term > 2.0**-60:
        terms.append(term)
        j += 1
        term *= z / (k + 1 + j)
    return math.exp(-z) * math.fsum(terms)
