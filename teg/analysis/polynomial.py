"""Expressions as polynomials: degrees, whether two are proportional, whether one vanishes on a surface.

Structure is decided on the exact normal form. The coefficients of the normal form in some variables are expressions of everything else,
and writing them out could take exponentially many terms. So each coefficient is represented by its value at one random point of the
prime field GF(P), P = 2⁵²¹ - 1. A polynomial identity that holds there is true but for a chance below 1e-100 (Schwartz 1980, Zippel
1979), and every operation costs one modular multiplication, whatever the coefficients look like. The random point is a hash of the
symbols, so the answers are the same in every process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import cast

from teg.ir.expr import Add, Call, Const, Expr, Mul, Param, Pow, Still, Var, Where
from teg.ir.function import Apply, Function
from teg.ir.integral import Integral
from teg.ir.node import digest, kept_residue, postorder
from teg.numerics.field import P, inverse, residue, residue_of_float

_OPERATIONS = (Add, Mul, Pow, Call)
_HALF = inverse(2)
MAX_TERMS = 400
MAX_DEGREE = 60

Monomial = tuple[int, ...]
Poly = dict[Monomial, int]
Ratio = tuple[Poly, Poly]
"""Numerator and denominator; a denominator without variables is 1."""


class Point:
    """Values of expressions at one random point of the field. Two values tell whether expressions are equal or proportional.

    |u| is one element for u and -u, and max(u, v) is (u + v + |u - v|)/2; so -min(-u, -v) is that, too. A `where` is its second branch
    plus a random multiple of the difference. `leaves` fixes the elements of chosen parameters and variables.
    """

    def __init__(self, salt: str = "", leaves: Mapping[Expr, int] | None = None) -> None:
        self._salt = salt
        self._leaves = dict(leaves or {})
        self._known: dict[Expr, int | None] = {}

    def value(self, e: Expr) -> int | None:
        """Returns the value; None where it is not defined or the expression is not algebraic."""
        known = self._known
        if e not in known:
            stack: list[Expr] = [e]
            while stack:
                node = stack[-1]
                if node not in known:
                    if missing := [c for c in value_children(node) if c not in known]:
                        stack.extend(missing)
                        continue
                    known[node] = self._combine(node)
                stack.pop()
        return known[e]

    def random(self, *key: object) -> int:
        """Returns the random element that stands for a key."""
        return residue(self._salt, *key)

    def _combine(self, node: Expr) -> int | None:
        known = self._known
        if node in self._leaves:
            return self._leaves[node] % P
        match node:
            case Const():
                return residue_of_float(node.data)
            case Add():
                return _sum_of([known[c] for c in node.children])
            case Mul():
                product = known[node.children[0]]
                for c in node.children[1:]:
                    factor = known[c]
                    if product is None or factor is None:
                        return None
                    product = product * factor % P
                return product
            case Pow():
                return self._power(known[node.base], node.exponent)
            case Param():
                return self.random("still parameter" if isinstance(node, Still) else "parameter", node.name)
            case Var():
                return self.random("variable", node.name)
            case Where():
                then, otherwise = known[node.then], known[node.otherwise]
                if then is None or otherwise is None:
                    return None
                return (otherwise + (then - otherwise) * self.random("condition", digest(node.condition))) % P
            case Apply():
                return self._apply(node)
            case Call():
                values = [known[c] for c in node.children]
                return None if None in values else self.function(node.name, cast("list[int]", values))
            case Integral() if not _holds(node, self._leaves):
                return self.random("integral", digest(node))
            case _:
                return None

    def _power(self, base: int | None, k: int) -> int | None:
        if base is None or abs(k) > MAX_DEGREE:
            return None
        if k < 0 and not base:
            return self.random("1/0", k)  # in a branch that is not taken, or else infinite anyway
        return pow(base if k >= 0 else inverse(base), abs(k), P)

    def function(self, name: str, values: Sequence[int]) -> int:
        """Returns the value of a function of the language at some values."""
        match name:
            case "magnitude":
                return self._size(values[0])
            case "max":
                return (values[0] + values[1] + self._size(values[0] - values[1])) * _HALF % P
            case "min":
                return (values[0] + values[1] - self._size(values[0] - values[1])) * _HALF % P
            case _:
                return self.random(name, *values)

    def _size(self, value: int) -> int:
        """Returns an element for |u|, the same for u and -u; 0 for 0."""
        least = min(value % P, -value % P)
        return least * self.random("size", least) % P

    def _apply(self, node: Apply) -> int | None:
        """Returns the value of the polynomial that `Shadow` takes for a function."""
        callee, key = node.callee, key_of(node)
        arguments = [self._known[c] for c in node.children]
        numbers = arguments[callee.formal if node.degree is not None else 0 :]
        if None in numbers:
            return None
        total = self.random("function", key, *numbers)
        for k in range(1, (node.degree or 0) + 1):
            factors = [self.random("s", k, i, key, *numbers) for i in range(callee.formal)]
            terms = [None if u is None else u * s for u, s in zip(arguments, factors, strict=False)]
            power = self._power(_sum_of([0, *terms]), k)
            if power is None:
                return None
            total = (total + power) % P
        return total


def _sum_of(values: Sequence[int | None]) -> int | None:
    return None if None in values else sum(cast("Sequence[int]", values)) % P


def value_children(node: Expr) -> tuple[Expr, ...]:
    """Returns the children of an operation, a function or a branch in value position."""
    if isinstance(node, _OPERATIONS):
        return node.children  # type: ignore[return-value]
    return (node.then, node.otherwise) if isinstance(node, Where) else ()


def key_of(node: Apply) -> tuple[object, ...]:
    """Returns what tells an application from those of other functions and derivatives."""
    callee = node.callee
    return (node.derivative, digest(callee) if isinstance(callee, Function) else callee.number)


def _holds(node: Integral, leaves: Mapping[Expr, int]) -> bool:
    return bool(leaves) and any(leaf in leaves for leaf in postorder([node]) if isinstance(leaf, Param | Var))


class Shadow:
    """Expressions as rational functions of `variables` over GF(P); everything else is its value at a `Point`.

    A `where` is as there; with `kinks`, |u| is a random multiple of u, and max and min are like a `where`. All have the right degree on a
    piece where no condition changes. Without `kinks` those of the variables are not rational. `integral` may return the shadow of an
    integral that depends on the variables; by default that is None, which means "not known to be rational".
    """

    def __init__(
        self,
        variables: Sequence[Var] = (),
        integral: Callable[[Integral], Ratio | None] | None = None,
        salt: str = "",
        kinks: bool = False,
    ) -> None:
        self._kinks = kinks
        self._point = Point(salt)
        self._is_usual = not salt
        self.variables = tuple(variables)
        self._index = {v: i for i, v in enumerate(self.variables)}
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
                if node not in known:
                    if node.free.isdisjoint(self._index):
                        value = kept_residue(node, self._point.value) if self._is_usual else self._point.value(node)
                        known[node] = None if value is None else ({self._one: value} if value else {}, self._unit)
                    elif missing := [c for c in value_children(node) if c not in known]:
                        stack.extend(missing)
                        continue
                    else:
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

    def constant(self, value: int) -> Ratio:
        """Returns a number of the field as a rational function."""
        value %= P
        return ({self._one: value} if value else {}, self._unit)

    def _is_constant(self, poly: Poly) -> bool:
        return len(poly) == 1 and self._one in poly

    def _combine(self, node: Expr) -> Ratio | None:
        """Returns a node that depends on the variables."""
        known = self._known
        match node:
            case Var():
                i = self._index[node]
                return ({tuple([1 if j == i else 0 for j in range(len(self._one))]): 1}, self._unit)
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
                return self._either(known[node.then], known[node.otherwise], self._point.random("condition", digest(node.condition)))
            case Apply():
                return self._apply(node)
            case Call():
                return self._function(node)
            case Integral():
                return self._integral(node) if self._integral is not None else None
            case _:
                return None

    def _either(self, a: Ratio | None, b: Ratio | None, r: int) -> Ratio | None:
        return None if a is None or b is None else self._sum([self._scale(a, r), self._scale(b, 1 - r)])

    def _function(self, node: Call) -> Ratio | None:
        arguments = [self._known[c] for c in node.children]
        if self._kinks and node.name in ("magnitude", "min", "max"):
            if node.name == "magnitude":
                return None if arguments[0] is None else self._scale(arguments[0], self._point.random("sign", digest(node)))
            return self._either(arguments[0], arguments[1], self._point.random("side", digest(node)))
        values = []
        for ratio in arguments:
            if ratio is None or not self._is_constant(ratio[1]) or (ratio[0] and not self._is_constant(ratio[0])):
                return None
            values.append(ratio[0].get(self._one, 0))
        return self.constant(self._point.function(node.name, values))

    def _apply(self, node: Apply) -> Ratio | None:
        """Returns a polynomial of the function's degree with random coefficients, Σₖ(Σᵢ sₖᵢ·uᵢ)ᵏ.

        For a function that is only known to be smooth: a random element if its arguments are numbers, else None.
        """
        callee, key = node.callee, key_of(node)
        arguments = [self._known[c] for c in node.children]
        numbers: list[int] = []
        for ratio in arguments[callee.formal if node.degree is not None else 0 :]:
            if ratio is None or not self._is_constant(ratio[1]) or (ratio[0] and not self._is_constant(ratio[0])):
                return None
            numbers.append(ratio[0].get(self._one, 0))
        total: Ratio | None = self.constant(self._point.random("function", key, *numbers))
        for k in range(1, (node.degree or 0) + 1):
            terms = [None if u is None else self._scale(u, self._point.random("s", k, i, key, *numbers)) for i, u in enumerate(arguments)]
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
                return self.constant(self._point.random("1/0", k))  # in a branch that is not taken, or else infinite anyway
            a, k = self._normal(a[1], a[0]), -k
        total: Ratio | None = a if k else self.constant(1)
        for _ in range(k - 1):
            total = self._product(total, a)
            if total is None:
                return None
        return total

    def _multiply(self, a: Poly, b: Poly) -> Poly:
        if self._is_constant(b):
            a, b = b, a
        if self._is_constant(a) and len(b) <= MAX_TERMS:
            factor = a[self._one]
            return dict(b) if factor == 1 else {m: c * factor % P for m, c in b.items()}
        if len(a) * len(b) > 16 * MAX_TERMS:
            return cast(Poly, None)
        out: dict[int, int] = {}
        right = _packed(b).items()
        for m1, c1 in _packed(a).items():
            for m2, c2 in right:
                m = m1 + m2
                out[m] = out.get(m, 0) + c1 * c2
        if len(out) > MAX_TERMS:
            return cast(Poly, None)
        product = {tuple(m.to_bytes(len(self._one), "little")): c % P for m, c in out.items()}
        return cast(Poly, None) if any(sum(m) > MAX_DEGREE for m in product) else {m: c for m, c in product.items() if c}

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


def _packed(poly: Poly) -> dict[int, int]:
    """Returns a polynomial by the exponents as the bytes of a number: such numbers add without a carry, up to twice MAX_DEGREE."""
    return {int.from_bytes(bytes(m), "little"): c for m, c in poly.items()}


class Degrees:
    """Degrees in one variable each. Subexpressions that several expressions share are visited once."""

    def __init__(self) -> None:
        self._shadows: dict[Var, Shadow] = {}

    def of(self, e: Expr, variable: Var) -> int | None:
        """Returns the degree of a polynomial of the variable; None for anything else."""
        if variable not in self._shadows:
            self._shadows[variable] = Shadow((variable,))
        return self._shadows[variable].degree(e)


def is_null(e: Expr) -> bool:
    """Returns whether an expression is 0 whatever its variables and parameters are, however it is written."""
    return Point().value(e) == 0
