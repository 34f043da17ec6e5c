"""Expressions as polynomials: degrees, whether two are proportional, whether one vanishes on a surface.

Structure is decided on the exact normal form. The coefficients of the normal form in some variables are expressions of everything else,
and writing them out could take exponentially many terms. So each coefficient is represented by its value at one random point of the
prime field GF(P), P = 2⁵²¹ - 1. A polynomial identity that holds there is true but for a chance below 1e-100 (Schwartz 1980, Zippel
1979), and every operation costs one modular multiplication, whatever the coefficients look like. The random point is a hash of the
symbols, so the answers are the same in every process.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import cast

from teg.ir.expr import Add, Call, Const, Expr, Mul, Param, Pow, Var, Where, add, const, mul, sub
from teg.ir.function import Apply, Function
from teg.ir.integral import Integral
from teg.ir.node import digest, postorder
from teg.ir.traverse import parameters

P = 2**521 - 1
MAX_TERMS = 400
MAX_DEGREE = 60

Monomial = tuple[int, ...]
Poly = dict[Monomial, int]
Ratio = tuple[Poly, Poly]
"""Numerator and denominator; a denominator without variables is 1."""


@lru_cache(maxsize=4096)
def inverse(x: int) -> int:
    """Returns 1/x in the field. Cached: the same inverses are needed again and again, and each costs as much as a hundred products."""
    return pow(x, -1, P)


def divided(x: int, y: int) -> int:
    """x/y in the field."""
    return x * inverse(y) % P


def residue(*key: object) -> int:
    """A random element of the field that stands for `key`."""
    return int.from_bytes(hashlib.blake2b(repr(key).encode(), digest_size=64).digest(), "little") % P


def _residue_of_float(value: float) -> int | None:
    if not math.isfinite(value):
        return None
    numerator, denominator = value.as_integer_ratio()
    return numerator % P if denominator == 1 else divided(numerator, denominator)


class Shadow:
    """Expressions as rational functions of `variables` over GF(P); everything else is a random element.

    A `where` is its second branch plus a random multiple of the difference; with `kinks`, |u| is a random multiple of u. Both have the
    right degree on a piece where no condition changes. Without `kinks` an |u| of the variables is not rational. `integral` may return
    the shadow of an integral that depends on the variables; by default that is None, which means "not known to be rational". `leaves`
    fixes the elements of chosen parameters and variables.
    """

    def __init__(
        self,
        variables: Sequence[Var] = (),
        leaves: Mapping[Expr, int] | None = None,
        integral: Callable[[Integral], Ratio | None] | None = None,
        salt: str = "",
        kinks: bool = False,
    ) -> None:
        self._salt = salt
        self._kinks = kinks
        self.variables = tuple(variables)
        self._index = {v: i for i, v in enumerate(self.variables)}
        self._leaves = dict(leaves or {})
        self._integral = integral
        self._one: Monomial = (0,) * len(self.variables)
        self._unit: Poly = {self._one: 1}
        self._known: dict[Expr, Ratio | None] = {}

    def of(self, e: Expr) -> Ratio | None:
        """Returns the rational function, or None if e is not known to be one."""
        known = self._known
        if e not in known:
            stack: list[Expr] = [e]
            while stack:
                node = stack[-1]
                if node in known:
                    stack.pop()
                    continue
                children = self._value_children(node)
                missing = [c for c in children if c not in known]
                if missing:
                    stack.extend(missing)
                    continue
                known[node] = self._combine(node)
                stack.pop()
        return known[e]

    def polynomial(self, e: Expr) -> Poly | None:
        """Returns the polynomial; None if e is none, or has a denominator with variables in it."""
        ratio = self.of(e)
        return ratio[0] if ratio is not None and self._is_constant(ratio[1]) else None

    def degree(self, e: Expr) -> int | None:
        """Returns the total degree of a polynomial; None for anything else."""
        poly = self.polynomial(e)
        return None if poly is None else max((sum(m) for m in poly), default=0)

    def _random(self, *key: object) -> int:
        return residue(self._salt, *key)

    def constant(self, value: int) -> Ratio:
        """Returns a number of the field as a rational function."""
        value %= P
        return ({self._one: value} if value else {}, self._unit)

    def _is_constant(self, poly: Poly) -> bool:
        return len(poly) == 1 and self._one in poly

    def _value_children(self, node: Expr) -> list[Expr]:
        if isinstance(node, Where):
            return [node.then, node.otherwise]
        if isinstance(node, Add | Mul | Pow | Call):
            return cast("list[Expr]", list(node.children))
        return []

    def _combine(self, node: Expr) -> Ratio | None:
        known = self._known
        if node in self._leaves:
            return self.constant(self._leaves[node])
        match node:
            case Const():
                value = _residue_of_float(node.data)
                return None if value is None else self.constant(value)
            case Param():
                return self.constant(self._random("parameter", node.name))
            case Var():
                if node in self._index:
                    i = self._index[node]
                    return ({tuple(1 if j == i else 0 for j in range(len(self._one))): 1}, self._unit)
                return self.constant(self._random("variable", node.name))
            case Add():
                return self._sum([known[c] for c in node.children])
            case Mul():
                total = known[node.children[0]]
                for c in node.children[1:]:
                    total = self._product(total, known[c])
                return total
            case Pow():
                return self._power(known[node.base], node.exponent)
            case Where():
                a, b = known[node.then], known[node.otherwise]
                if a is None or b is None:
                    return None
                r = self._random("condition", digest(node.condition))
                return self._sum([self._scale(a, r), self._scale(b, 1 - r)])
            case Apply():
                return self._apply(node)
            case Call():
                return self._function(node)
            case Integral():
                if self._depends(node):
                    return self._integral(node) if self._integral is not None else None
                return self.constant(self._random("integral", digest(node)))
            case _:
                return None

    def _depends(self, node: Expr) -> bool:
        if any(v in node.free for v in self._index):
            return True
        return bool(self._leaves) and any(leaf in self._leaves for leaf in postorder([node]) if isinstance(leaf, Param | Var))

    def _function(self, node: Call) -> Ratio | None:
        arguments = [self._known[c] for c in node.children]
        if node.name == "magnitude" and (self._kinks or not self._depends(node)):
            return None if arguments[0] is None else self._scale(arguments[0], self._random("sign", digest(node)))
        values = []
        for ratio in arguments:
            if ratio is None or not self._is_constant(ratio[1]) or (ratio[0] and not self._is_constant(ratio[0])):
                return None
            values.append(ratio[0].get(self._one, 0))
        return self.constant(self._random(node.name, *values))

    def _apply(self, node: Apply) -> Ratio | None:
        """Returns a polynomial of the function's degree with random coefficients, Σₖ(Σᵢ sₖᵢ·uᵢ)ᵏ.

        For a function that is only known to be smooth: a random element if its arguments are numbers, else None.
        """
        callee = node.callee
        key = (node.derivative, digest(callee) if isinstance(callee, Function) else callee.number)
        arguments = [self._known[c] for c in node.children]
        numbers: list[int] = []
        for ratio in arguments[callee.formal if node.degree is not None else 0 :]:
            if ratio is None or not self._is_constant(ratio[1]) or (ratio[0] and not self._is_constant(ratio[0])):
                return None
            numbers.append(ratio[0].get(self._one, 0))
        total: Ratio | None = self.constant(self._random("function", key, *numbers))
        for k in range(1, (node.degree or 0) + 1):
            terms = [None if u is None else self._scale(u, self._random("s", k, i, key, *numbers)) for i, u in enumerate(arguments)]
            power = self._power(self._sum([self.constant(0), *terms[: callee.formal]]), k)
            total = self._sum([total, power])
        return total

    def _scale(self, ratio: Ratio, factor: int) -> Ratio:
        factor %= P
        return ({m: c * factor % P for m, c in ratio[0].items()} if factor else {}, ratio[1])

    def _sum(self, ratios: Sequence[Ratio | None]) -> Ratio | None:
        first = ratios[0]
        if first is None:
            return None
        num, den = dict(first[0]), first[1]
        for ratio in ratios[1:]:
            if ratio is None:
                return None
            n, d = ratio
            if d is not den and d != den:
                n, num, den = self._multiply(n, den), self._multiply(num, d), self._multiply(den, d)
                if n is None or num is None or den is None:
                    return None
            for m, c in n.items():
                c = (num.get(m, 0) + c) % P
                if c:
                    num[m] = c
                else:
                    num.pop(m, None)
        return self._normal(num, den)

    def _product(self, a: Ratio | None, b: Ratio | None) -> Ratio | None:
        if a is None or b is None:
            return None
        num = self._multiply(a[0], b[0])
        if a[1] is self._unit and b[1] is self._unit:
            return None if num is None else (num, self._unit)
        den = self._multiply(a[1], b[1])
        return None if num is None or den is None else self._normal(num, den)

    def _power(self, a: Ratio | None, k: int) -> Ratio | None:
        if a is None or abs(k) > MAX_DEGREE:
            return None
        if k < 0:
            if not a[0]:
                return self.constant(self._random("1/0", k))  # in a branch that is not taken, or else infinite anyway
            a, k = self._normal(a[1], a[0]), -k
        total: Ratio | None = a if k else self.constant(1)
        for _ in range(k - 1):
            total = self._product(total, a)
            if total is None:
                return None
        return total

    def _multiply(self, a: Poly, b: Poly) -> Poly:
        if len(a) * len(b) > 16 * MAX_TERMS:
            return cast(Poly, None)
        out: Poly = {}
        for m1, c1 in a.items():
            for m2, c2 in b.items():
                m = tuple(map(int.__add__, m1, m2))
                out[m] = (out.get(m, 0) + c1 * c2) % P
        if len(out) > MAX_TERMS or any(sum(m) > MAX_DEGREE for m in out):
            return cast(Poly, None)
        return {m: c for m, c in out.items() if c}

    def _normal(self, num: Poly, den: Poly) -> Ratio:
        if self._is_constant(den):
            if den[self._one] == 1:
                return (num, self._unit)
            lead = inverse(den[self._one])
            return ({m: c * lead % P for m, c in num.items()}, self._unit)
        if not num:
            return ({}, self._unit)
        lead = inverse(den[max(den)])
        if lead != 1:
            num = {m: c * lead % P for m, c in num.items()}
            den = {m: c * lead % P for m, c in den.items()}
        if len(num) == len(den) and num.keys() == den.keys():  # a multiple of the denominator is a number
            ratio = num[max(den)]
            if all(num[m] == c * ratio % P for m, c in den.items()):
                return ({self._one: ratio} if ratio else {}, self._unit)
        return (num, den)


class Degrees:
    """Degrees in one variable each. Subexpressions that several expressions share are visited once."""

    def __init__(self) -> None:
        self._shadows: dict[Var, Shadow] = {}

    def of(self, e: Expr, variable: Var) -> int | None:
        """Returns the degree of a polynomial of the variable; None for anything else."""
        if variable not in self._shadows:
            self._shadows[variable] = Shadow((variable,))
        return self._shadows[variable].degree(e)


class Point:
    """Values of expressions at one random point of the field. Two values tell whether expressions are equal or proportional."""

    def __init__(self, salt: str = "", leaves: Mapping[Expr, int] | None = None) -> None:
        self._shadow = Shadow((), leaves, salt=salt)

    def value(self, e: Expr) -> int | None:
        """Returns the value; None where it is not defined or the expression is not algebraic."""
        ratio = self._shadow.of(e)
        return None if ratio is None else ratio[0].get((), 0)


_LARGEST = 2**200


def sign_of_residue(value: int) -> int | None:
    """Returns the sign of the fraction p/q with |p|, q < 2²⁰⁰ that a residue stands for (Wang 1981); None if there is none.

    There are 2⁴⁰⁰ such fractions among 2⁵²¹ residues, so the probability of a fraction by chance is below 1e-36.
    """
    r0, r1, s0, s1 = P, value % P, 0, 1
    while r1 > _LARGEST:
        quotient = r0 // r1
        r0, r1, s0, s1 = r1, r0 - quotient * r1, s1, s0 - quotient * s1
    if r1 == 0 or s1 == 0 or abs(s1) > _LARGEST:
        return None
    return 1 if s1 > 0 else -1


Powers = tuple[tuple[int, int], ...]
"""A monomial: pairs (number of the generator, exponent), sorted."""

Form = dict[Powers, Fraction]
"""A polynomial with exact coefficients."""


def shorter_form(e: Expr) -> Expr | None:
    """Returns the shorter of two normal forms of e: in parameters, or in parameters and differences of two parameters.

    Differences of parameters do not cancel where far coordinates are squared. If both are equally long: `expanded(e)`, unless such
    parameters are multiplied in it. If e does not change when all parameters that are multiplied are moved together: a form in which
    they stand as differences.
    """
    plain = expanded(e)
    differences = [n for n in postorder([e]) if isinstance(n, Expr) and _is_difference(n)]
    local = expanded(e, whole=differences) if differences else None
    relative = None if plain is None else _relative(plain)
    best = plain if local is None else local
    if local is not None and plain is not None:
        cancels = _multiplies(plain, {p for d in differences for p in parameters(d)})
        best = plain if _length(plain) + cancels <= _length(local) else local
    return relative if relative is not None and best is not None and _length(relative) <= _length(best) else best


def _relative(e: Expr, limit: int = 48) -> Expr | None:
    """Returns a sum of monomials in differences of the parameters that are squared in e; None if e depends on more than these."""
    form, generators = _normal_form(e, limit)
    if not form:
        return None
    number = len(generators)
    for origin in range(number):
        is_coordinate = isinstance(generators[origin], Param) and any((origin, 2) in m for m in form)
        factors = {i for m in form if any(g == origin for g, _ in m) for i, _ in m} if is_coordinate else set()
        others = [i for i in sorted(factors) if i != origin and isinstance(generators[i], Param)]
        moved = form
        for k, i in enumerate(others):
            moved = _shifted(moved, i, origin, len(generators) + k)
        if others and len(moved) <= len(form) and not any(g == origin for m in moved for g, _ in m):
            form = moved
            generators += [add(generators[i], mul(const(-1.0), generators[origin])) for i in others]
    return _from_form(form, generators) if len(generators) > number else None


def _shifted(form: Form, i: int, origin: int, difference: int) -> Form:
    """Returns a form in which generator i is the sum of two others."""
    result: Form = {}
    for m, weight in form.items():
        powers = dict(m)
        k = powers.pop(i, 0)
        for s in range(k + 1):
            new = {**powers, origin: powers.get(origin, 0) + k - s, difference: powers.get(difference, 0) + s}
            key = tuple(sorted((g, n) for g, n in new.items() if n))
            result[key] = result.get(key, Fraction(0)) + weight * math.comb(k, s)
    return {m: weight for m, weight in result.items() if weight}


def _multiplies(e: Expr, factors: Collection[Expr]) -> bool:
    """Returns whether two of these factors, or one and itself, are multiplied in a sum of monomials."""
    for n in postorder([e]):
        if isinstance(n, Pow) and n.exponent > 1 and n.base in factors:
            return True
        if isinstance(n, Mul) and sum(c in factors for c in n.children) > 1:
            return True
    return False


def _length(e: Expr) -> int:
    return len(e.children) if isinstance(e, Add) else 1


def _is_difference(e: Expr) -> bool:
    """Returns whether e is p - q of two parameters."""
    if not isinstance(e, Add) or len(e.children) != 2:
        return False
    p, q = e.children
    minus = isinstance(q, Mul) and len(q.children) == 2 and isinstance(q.children[0], Const) and q.children[0].data == -1.0
    return isinstance(p, Param) and minus and isinstance(q.children[1], Param)


def expanded(e: Expr, limit: int = 48, whole: Collection[Expr] = ()) -> Expr | None:
    """Returns e as a sum of monomials, with exact cancellation.

    The generators are the nodes that are not sums, products or integer powers, and the expressions of `whole`. None if the sum is longer
    than `limit` terms, or a number in it is not exact as float64.
    """
    form, generators = _normal_form(e, limit, frozenset(whole))
    return None if form is None else _from_form(form, generators)


def distance(lo: Expr, hi: Expr) -> Expr:
    """Returns hi - lo; without what both have, if that makes it shorter: 1 for bounds p and p + 1."""
    difference = sub(hi, lo)
    short = expanded(difference, limit=8) if lo.children or hi.children else None
    return difference if short is None or _length(short) >= _length(difference) else short


def perfect_power(e: Expr, limit: int = 48) -> tuple[int, Expr, int] | None:
    """Returns (sign of c, h, k) with e = c·hᵏ, c a number and k > 1 as large as possible; None if e is no such power."""
    form, generators = _normal_form(e, limit)
    if not form:
        return None
    lead = max(form, key=lambda m: _dense(m, len(generators)))
    shared = math.gcd(*(k for _, k in lead)) if lead else 0
    for k in range(shared, 1, -1):
        base = _root(form, lead, k, len(generators)) if shared % k == 0 else None
        if base is not None:
            scale = math.lcm(*(c.denominator for c in base.values()))
            h = _from_form({m: c * scale for m, c in base.items()}, generators)
            return None if h is None else (1 if form[lead] > 0 else -1, h, k)
    return None


def _root(form: Form, lead: Powers, k: int, size: int) -> Form | None:
    """Returns the monic polynomial whose k-th power is proportional to `form`; its terms are found from the highest
    missing one downwards."""
    top: Powers = tuple((i, j // k) for i, j in lead)
    root: Form = {top: Fraction(1)}
    slope = {i: (k - 1) * j for i, j in top}
    while len(root) <= len(form):
        power: Form | None = {(): form[lead]}
        for _ in range(k):
            power = None if power is None else _product(power, root, 4 * len(form))
        if power is None:
            return None
        missing = {m: form.get(m, Fraction(0)) - power.get(m, Fraction(0)) for m in {**form, **power}}
        missing = {m: c for m, c in missing.items() if c}
        if not missing:
            return root
        highest = max(missing, key=lambda m: _dense(m, size))
        term = {i: j - slope.get(i, 0) for i, j in {**dict.fromkeys(slope, 0), **dict(highest)}.items()}
        name = tuple(sorted((i, j) for i, j in term.items() if j))
        if any(j < 0 for j in term.values()) or name in root:
            return None
        root[name] = missing[highest] / (k * form[lead])
    return None


def _dense(m: Powers, size: int) -> tuple[int, ...]:
    """Returns all exponents of a monomial. Their lexicographic order is an order of monomials."""
    powers = dict(m)
    return tuple(powers.get(i, 0) for i in range(size))


def _product(a: Form, b: Form, limit: int) -> Form | None:
    """Returns the product of two forms; None if it is longer than `limit` terms."""
    if len(a) * len(b) > 10 * limit:
        return None
    out: Form = {}
    for m1, c1 in a.items():
        for m2, c2 in b.items():
            powers = dict(m1)
            for i, k in m2:
                powers[i] = powers.get(i, 0) + k
            m = tuple(sorted((i, k) for i, k in powers.items() if k))
            out[m] = out.get(m, Fraction(0)) + c1 * c2
    return {m: c for m, c in out.items() if c} if len(out) <= limit else None


def _is_float(number: Fraction) -> bool:
    try:
        return Fraction(float(number)) == number
    except OverflowError:
        return False


def _from_form(form: Form, generators: Sequence[Expr]) -> Expr | None:
    """Returns a form as an expression; None if a number in it is not exact as float64."""
    terms = []
    for m, coefficient in form.items():
        if not _is_float(coefficient):
            return None
        terms.append(mul(const(float(coefficient)), *(generators[i] ** k for i, k in m)))
    return add(*terms)


def _normal_form(e: Expr, limit: int, kept: frozenset[Expr] = frozenset()) -> tuple[Form | None, list[Expr]]:
    """Returns an expression as a polynomial of generators, and these generators; (None, …) if it is too long.

    Generators are the nodes that are not sums, products or integer powers, and the nodes in `kept`.
    """
    forms: dict[Expr, Form | None] = {}
    atoms: list[Expr] = []
    number: dict[Expr, int] = {}
    stack: list[Expr] = [e]
    while stack:
        node = stack[-1]
        inside = cast("tuple[Expr, ...]", node.children) if isinstance(node, Add | Mul | Pow) and node not in kept else ()
        missing = [c for c in inside if c not in forms]
        if missing:
            stack.extend(missing)
            continue
        stack.pop()
        if node in forms:
            continue
        form: Form | None
        if isinstance(node, Const):
            form = {(): Fraction(node.data)} if math.isfinite(node.data) and node.data else ({} if node.data == 0 else None)
        elif isinstance(node, Add) and node not in kept:
            form = {}
            for c in node.children:
                part = forms[c]
                if part is None or form is None:
                    form = None
                    break
                for m, weight in part.items():
                    form[m] = form.get(m, Fraction(0)) + weight
            if form is not None:
                form = {m: k for m, k in form.items() if k}
        elif isinstance(node, Mul) or (isinstance(node, Pow) and 0 < node.exponent <= 8):
            form = {(): Fraction(1)}
            for c in node.children if isinstance(node, Mul) else (node.base,) * node.exponent:
                part = forms[c]
                form = None if form is None or part is None else _product(form, part, 4 * limit)
        else:
            base, k = (node.base, node.exponent) if isinstance(node, Pow) and len(forms.get(node.base) or {}) != 1 else (node, 1)
            form = {((number.setdefault(base, len(number)), k),): Fraction(1)}
            if len(number) > len(atoms):
                atoms.append(base)
        forms[node] = form
    result = forms[e]
    return (None if result is None or len(result) > limit else result), atoms
