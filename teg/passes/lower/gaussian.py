"""The mean of a polynomial times a Gaussian over a piece (p, q), in closed form.

    exponent E = c - (w·(x - μ))²,   α, β = w·(p - μ), w·(q - μ),   A = exp(E(p))·erfcx(|α|),   B = exp(E(q))·erfcx(|β|)

    I₀ = ½√π·(2·exp(c) - A - B)   if α < 0 < β,   else  ½√π·|A - B|
    J₀ = 0     J₁ = ½·(exp(E(p)) - exp(E(q)))     Jₖ = ½·((k - 1)·Jₖ₋₂ + αᵏ⁻¹·exp(E(p)) - βᵏ⁻¹·exp(E(q)))
    mean = (C·I₀ + Σₖ P⁽ᵏ⁾(μ)/(k!·wᵏ)·Jₖ)/(β - α),   C = Σⱼ P⁽²ʲ⁾(μ)/(j!·(4w²)ʲ)

With erfcx(x) = exp(x²)·erfc(x) nothing overflows that the integrand does not, and tails keep their digits. A piece on which the exponent
changes little is left to Gauss nodes: there the differences would cancel. C is simplified, and left out where it is 0: derivatives by the
place and the width of a density are 0 over all of it. Source: Abramowitz and Stegun 1964, 7.1 and 7.4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

from teg.analysis.calculus import slope, value_children
from teg.analysis.constants import with_symbols, with_values
from teg.analysis.expanded import expanded
from teg.analysis.polynomial import is_null
from teg.analysis.roots import tidy
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Call, Const, Expr, Mul, Param, Pow, Var, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, div, integer_power, mul, positive, sub, where
from teg.ir.traverse import substitute
from teg.numerics.error_function import SCALED, SCALED_TURN
from teg.numerics.quadrature import gauss_legendre

MOST_DEGREE = 16
"""The largest degree of the polynomial."""
CUBIC, HIGH = 3, 8
"""The largest degrees for which few nodes are taken on narrow pieces, and some. Of higher powers more digits of moments about the peak
cancel."""
NARROW = (0.125, 1.0, 2.75)
"""Half of the largest w·(q - p)·max(1, |α + β|/2) for which nodes are taken, for degrees up to CUBIC, up to HIGH, and above: the exponent
changes by a half at most, by 4, or by 30."""
NODES = (6, 12, 32)
"""Nodes that integrate a polynomial times a Gaussian to rounding there."""
FAR = (30.0, 4.0, 2.0)
"""The distance of a piece from the peak, times w, beyond which moments about the peak cancel, by the degree of the polynomial. There the
Gaussian falls off like an exponential, and TAIL_NODES nodes on the part where it falls by exp(-DECAY) give the mean; RISE is added to
that for each degree above CUBIC, by which a power of the distance from its end has risen there."""
TAIL_NODES = (24, 24, 32)
DECAY, RISE = 37.0, 3.0
FLAT = 1e-280
"""Replaces w² where it is 0: the formulas are then those of an exponential."""
RESOLVED = 2.0**-6
"""The least distance of such an end from the peak, relative to the place of that."""
UNDERFLOW = 746.0
"""exp(-UNDERFLOW) is 0."""
REACH = 1521.0
"""exp(-w²x²) is 0 beyond w²x² = REACH, also where exp(c) is as large as a number can be."""


class Gaussian:
    """The exponent of a Gaussian: its width and where it is largest. Its curvature is negative, or 0."""

    def __init__(self, exponent: Expr, x: Var) -> None:
        self.exponent, self.x = exponent, x
        self.slope = slope(exponent, x)
        self.least = cast(Expr, substitute(mul(const(-0.5), slope(self.slope, x)), {x: ZERO}))
        self.curvature = call("max", self.least, const(FLAT))
        self.width = call("sqrt", self.curvature)
        self.scale = div(ONE, self.width)

    def at(self, e: Expr, place: Expr) -> Expr:
        """Returns an expression at a place."""
        return cast(Expr, substitute(e, {self.x: place}))

    def peak_from(self, place: Expr) -> Expr:
        """Returns μ, computed from another place."""
        return add(place, div(mul(const(0.5), self.at(self.slope, place)), self.curvature))

    def end(self, sign: float) -> Expr:
        """Returns a place below (sign -1) or above the peak beyond which the Gaussian is 0; no number if there is none. Conditions may
        leave out a peak that is too large for a number; the place is then rounded away from it. It differs from the peak, however narrow
        that is."""
        peak = self.peak_from(ZERO)
        known = where(positive(sub(self.least, const(FLAT))), self.least, ZERO)
        reach = call("sqrt", add(const(REACH), call("max", ZERO, self.at(self.exponent, peak))))
        away = div(mul(const(1.0 + 1e-15), reach), call("sqrt", known))
        return add(peak, mul(const(sign), call("max", away, mul(const(RESOLVED), call("magnitude", peak)))))

    def mean(self, polynomial: Expr, degree: int, p: Expr, q: Expr) -> Expr:
        """Returns the mean times a polynomial over (p, q)."""
        alpha, beta = (mul(const(-0.5), self.at(self.slope, end), self.scale) for end in (p, q))
        length = mul(self.width, sub(q, p))
        integrand = mul(polynomial, call("exp", self.exponent))
        change = mul(const(0.5), length, call("max", ONE, call("magnitude", mul(const(0.5), add(alpha, beta)))))
        kind = (degree > CUBIC) + (degree > HIGH)
        narrow = mean_at_nodes(integrand, self.x, p, q, NODES[kind])
        wide = div(self._integral(polynomial, degree, (p, q), (alpha, beta)), length)
        result = where(positive(sub(change, const(NARROW[kind]))), wide, narrow)
        if degree == 0:
            return result
        near = call("min", call("magnitude", alpha), call("magnitude", beta))
        decay = const(DECAY + RISE * max(0, degree - CUBIC))
        reach = div(decay, mul(self.width, add(near, call("sqrt", add(integer_power(near, 2), decay)))))
        part = call("min", sub(q, p), reach)
        rising = positive(mul(MINUS_ONE, alpha))
        low, high = where(rising, sub(q, part), p), where(rising, q, add(p, part))
        tail = mul(div(part, sub(q, p)), mean_at_nodes(integrand, self.x, low, high, TAIL_NODES[kind]))
        outside = positive(mul(alpha, beta))
        return where(conjunction(outside, positive(sub(near, const(FAR[min(degree, len(FAR)) - 1])))), tail, result)

    def _integral(self, polynomial: Expr, degree: int, piece: tuple[Expr, Expr], ends: tuple[Expr, Expr]) -> Expr:
        """Returns Σ P⁽ᵏ⁾(μ)/(k!·wᵏ)·Iₖ, where nothing cancels that matters."""
        (p, q), (alpha, beta) = piece, ends
        at_p, at_q = (call("exp", self.at(self.exponent, end)) for end in (p, q))
        values, whole = self._at_peak(polynomial, degree, p)
        a, b = (
            where(positive(add(self.at(self.exponent, end), const(UNDERFLOW))), mul(value, scaled_erfc(call("magnitude", at))), ZERO)
            for end, value, at in ((p, at_p, alpha), (q, at_q, beta))
        )
        inside = conjunction(positive(mul(MINUS_ONE, alpha)), positive(beta))
        around = sub(sub(mul(const(2.0), call("exp", self.at(self.exponent, self.peak_from(p)))), a), b)
        first = mul(const(0.5 * math.sqrt(math.pi)), where(inside, around, call("magnitude", sub(a, b))))
        borders = [ZERO, mul(const(0.5), sub(at_p, at_q))]
        for k in range(2, degree + 1):
            ends_of = sub(mul(integer_power(alpha, k - 1), at_p), mul(integer_power(beta, k - 1), at_q))
            borders.append(mul(const(0.5), add(mul(const(k - 1), borders[k - 2]), ends_of)))
        scales = [mul(const(1.0 / math.factorial(k)), integer_power(self.width, -k)) for k in range(1, degree + 1)]
        return add(mul(whole, first), *(mul(*factors) for factors in zip(scales, values[1:], borders[1 : degree + 1], strict=True)))

    def _at_peak(self, polynomial: Expr, degree: int, p: Expr) -> tuple[list[Expr], Expr]:
        """Returns the derivatives of a polynomial at the peak, and C."""
        (polynomial, exponent), constants = with_symbols([polynomial, self.exponent])
        derivatives = [polynomial]
        for _ in range(degree):
            derivatives.append(slope(derivatives[-1], self.x))
        rising = slope(exponent, self.x)
        bend = mul(MINUS_ONE, self.at(slope(rising, self.x), ZERO))
        largest = 2 ** (degree // 2) * math.factorial(degree // 2)
        factors = [const(largest // (2**j * math.factorial(j))) for j in range(degree // 2 + 1)]  # of exact numbers: 1/48 is none
        peak = tidy(div(self.at(rising, ZERO), bend))
        values = [_simplified(self.at(e, peak), math.factorial(k)) for k, e in enumerate(derivatives)]
        whole = _simplified(_over_all(factors, values, bend), largest * math.factorial(degree))
        divisors = _divisors(exponent) | _divisors(polynomial) | {bend} | set(constants)
        if is_null(whole):
            whole = ZERO
        elif not _divisors(whole) <= divisors:
            at_peak = [self.at(e, self.peak_from(p)) for e in derivatives]
            whole = _over_all(factors, at_peak, mul(const(2.0), self.curvature))
        if not all(_divisors(v) <= divisors for v in values):
            values = [self.at(e, self.peak_from(p)) for e in derivatives]
        whole, *values = with_values([mul(const(1.0 / largest), whole), *values], constants)
        return values, whole


def _over_all(factors: Sequence[Expr], derivatives: Sequence[Expr], bend: Expr) -> Expr:
    """Returns the mean of a polynomial over all of a Gaussian, from its derivatives at the peak."""
    terms = enumerate(zip(factors, derivatives[::2], strict=True))
    return add(*(mul(c, v, integer_power(bend, -j)) for j, (c, v) in terms))


def _simplified(e: Expr, scale: float = 1.0) -> Expr:
    """Returns the shorter of two exact normal forms: in all symbols, where all terms cancel that may, or in sums such as 2m - 1, whose
    powers would cancel where these are small if they were written out."""
    plain = tidy(e, scale)
    sums = [n for n in postorder([e]) if isinstance(n, Add) and all(map(_is_linear, n.children))]
    local = None if is_null(plain) or not sums else expanded(e, whole=sums)
    return plain if local is None or (plain is not e and _terms(plain) < _terms(local)) else local


def _terms(e: Expr) -> int:
    return len(e.children) if isinstance(e, Add) else 1


def _is_linear(e: Node) -> bool:
    """Returns whether an expression is a number times a parameter, or one of them."""
    return isinstance(e, Const | Param) or (
        isinstance(e, Mul) and sum(not isinstance(c, Const) for c in e.children) == 1 and _is_linear(e.children[-1])
    )


def _divisors(e: Expr) -> set[Node]:
    """Returns what an expression is divided by, in factors."""
    divisors: set[Node] = set()
    for n in postorder([e]):
        if isinstance(n, Pow) and n.exponent < 0:
            factors = cast("Sequence[Expr]", n.base.children) if isinstance(n.base, Mul) else (n.base,)
            divisors.update(f.base if isinstance(f, Pow) else f for f in factors)
    return divisors


def mean_at_nodes(e: Expr, x: Var, p: Expr, q: Expr, nodes: int) -> Expr:
    """Returns the mean of an expression over (p, q) by Gauss nodes."""
    middle, half = mul(const(0.5), add(p, q)), mul(const(0.5), sub(q, p))
    table = zip(*gauss_legendre(nodes), strict=True)
    return add(*(mul(const(0.5 * w), cast(Expr, substitute(e, {x: add(middle, mul(const(u), half))}))) for u, w in table))


def is_gaussian(exponent: Expr, x: Var, beside: Sequence[Expr] = ()) -> bool:
    """Returns whether the curvature of a quadratic exponent is certainly not positive, unless a factor `beside` it is no number: where
    √v stands in front of exp(-x²/v), v is positive."""
    return sign_of(cast(Expr, substitute(slope(slope(exponent, x), x), {x: ZERO})), _not_negative(beside)) < 0


def sign_of(e: Expr, known: frozenset[Expr] = frozenset()) -> int:
    """Returns 1 for an expression that is certainly not negative, -1 for one that is certainly not positive, 0 if it is not known. Those in
    `known` are not negative."""
    if e in known:
        return 1
    match e:
        case Const():
            return 1 if e.data >= 0 else -1
        case Add():
            signs = {sign_of(c, known) for c in e.children}
            return signs.pop() if len(signs) == 1 else 0
        case Mul():
            return math.prod(sign_of(c, known) for c in e.children)
        case Pow():
            return 1 if e.exponent % 2 == 0 else sign_of(e.base, known)
        case Call() if e.name in ("exp", "cosh", "magnitude", "sqrt", "root"):
            return 1
        case _:
            return 0


def _not_negative(factors: Sequence[Expr]) -> frozenset[Expr]:
    """Returns what is not negative if the factors are numbers: it stands in a root or a logarithm, times what has a sign."""
    found: set[Expr] = set()
    for u in _arguments(factors):
        signs = [(c, sign_of(c)) for c in (cast("Sequence[Expr]", u.children) if isinstance(u, Mul) else (u,))]
        unknown = [c for c, sign in signs if sign == 0]
        if len(unknown) == 1 and math.prod(sign for _, sign in signs if sign) > 0:
            found.add(unknown[0].base if isinstance(unknown[0], Pow) else unknown[0])
    return frozenset(found)


def _arguments(factors: Sequence[Expr]) -> list[Expr]:
    """Returns the numbers that functions in a product are applied to which need positive ones, whatever its conditions are."""
    arguments: list[Expr] = []
    stack, seen = list(factors), set(factors)
    while stack:
        node = stack.pop()
        if isinstance(node, Call) and (node.name in ("sqrt", "log") or _is_root(node)):
            arguments.append(node.children[0])
        inner = [c for c in value_children(node) if c not in seen] if isinstance(node, Add | Mul | Pow | Call) else []
        seen.update(inner)
        stack.extend(inner)
    return arguments


def _is_root(node: Call) -> bool:
    """Returns whether a node is a power that is no whole number."""
    exponent = node.children[-1]
    return node.name == "pow" and isinstance(exponent, Const) and not exponent.data.is_integer()


def scaled_erfc(x: Expr) -> Expr:
    """Returns exp(x²)·erfc(x) for x >= 0."""
    t = sub(ONE, div(const(2.0 * SCALED_TURN), add(x, const(SCALED_TURN))))  # (x - turn)/(x + turn), with one division
    return div(_polynomial(SCALED, t), add(ONE, mul(const(2.0), x)))


def _polynomial(coefficients: Sequence[float], t: Expr) -> Expr:
    """Returns Σ cₖ·tᵏ by halves, of even and odd powers, up to t⁸, and by steps of t⁸: few of them wait for each other (Estrin 1960), and
    no power is so large that it would be written by its exponent (`scaled`)."""
    if len(coefficients) == 1:
        return const(coefficients[0])
    if len(coefficients) == 2:
        return add(const(coefficients[0]), mul(const(coefficients[1]), t))
    parts = [_polynomial(coefficients[i : i + 2], t) for i in range(0, len(coefficients), 2)]
    for power in (2, 4):
        square = integer_power(t, power)
        parts = [add(parts[i], mul(square, parts[i + 1])) if i + 1 < len(parts) else parts[i] for i in range(0, len(parts), 2)]
    total, step = parts[-1], integer_power(t, 8)
    for part in parts[-2::-1]:
        total = add(part, mul(step, total))
    return total
