"""Interval enclosures as expressions: bounds of a value over a box of variables, evaluated at run time.

    enclose(e, {x: (p, q)})  =  (e₋, e₊)   with   e₋ <= e(x) <= e₊   for every p <= x <= q

Natural interval extension, node by node: monotone functions are evaluated at the ends, |·| and even powers by the least and largest
size, sin and cos by whether a crest lies inside. A `where` whose condition is open on the box gives the hull of both values. Where a
function is defined on a part of the box only, the bounds hold on that part; where it is nowhere defined both bounds are NaN. Roundings
are not directed: the bounds may be off by a few of them. Linear in the number of nodes.
Source: Moore, Kearfott, Cloud 2009, chapters 2 and 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import cast

from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, And, Call, Compare, Cond, Const, Expr, Mul, Not, Or, Pow, Var, Where, const
from teg.ir.function import Apply
from teg.ir.integral import ClosedForm
from teg.ir.node import Node, postorder_through
from teg.ir.simplify import add, call, conjunction, disjunction, div, integer_power, mul, negation, positive, sub, where

Interval = tuple[Expr, Expr]
Decision = tuple[Cond, Cond]
"""Two conditions about a condition on a box: it holds everywhere; it fails everywhere."""

_INFINITY = const(math.inf)
_NO_NUMBER = const(math.nan)
_EVERYTHING: Interval = (const(-math.inf), _INFINITY)


def enclose(e: Expr, box: Mapping[Var, Interval]) -> Interval:
    """Returns bounds of e over a box. Raises NotDifferentiableError for an integral that depends on a variable of the box."""
    return Enclosure(box).of(e)


class Enclosure:
    """Enclosures over one box. Nodes that several expressions share are enclosed once."""

    def __init__(self, box: Mapping[Var, Interval]) -> None:
        self.box = dict(box)
        self.enclosed: dict[Node, Interval | Decision] = {}

    def of(self, e: Expr) -> Interval:
        """Returns bounds of e."""
        self._find(e)
        return self._bounds(e)

    def decision(self, c: Cond) -> Decision:
        """Returns two conditions: c holds everywhere on the box; c fails everywhere on it."""
        self._find(c)
        return self._truth(c)

    def _find(self, root: Node) -> None:
        """Encloses the nodes that depend on the box. Every other node is its own bound; it may hold a variable of the same name, bound
        elsewhere."""
        enclosed = self.enclosed
        for node in postorder_through(root, self.box, lambda node: () if node in enclosed else node.children):
            if node not in enclosed:
                enclosed[node] = self._decision(node) if isinstance(node, Cond) else self._interval(cast(Expr, node))

    def _bounds(self, e: Expr) -> Interval:
        return cast(Interval, self.enclosed.get(e, (e, e)))

    def _truth(self, c: Cond) -> Decision:
        return cast(Decision, self.enclosed[c]) if c in self.enclosed else (c, negation(c))

    def _interval(self, e: Expr) -> Interval:
        parts = [self._bounds(cast(Expr, c)) for c in e.children if not isinstance(c, Cond)]
        match e:
            case Var():
                return self.box[e]
            case Add():
                return add(*(p[0] for p in parts)), add(*(p[1] for p in parts))
            case Mul():
                return reduce(self._product, self._factors(e))
            case Pow():
                return _power(parts[0], e.exponent)
            case Apply() | ClosedForm():
                raise NotDifferentiableError("the values of a function over an interval are not known", e)
            case Call():
                return _function(e.name, parts)
            case Where():
                return _hull(self._truth(e.condition), parts[0], parts[1])
            case _:
                raise NotDifferentiableError("the values of this expression over an interval are not known", e)

    def _product(self, a: Interval, b: Interval) -> Interval:
        """Returns the bounds of a product."""
        return _product(a, b)

    def _factors(self, e: Mul) -> list[Interval]:
        """Returns bounds of factors; of log u and a power of u together: where u is small, one is large and the product is not."""
        factors = list(e.children)
        together: list[Interval] = []
        for c in e.children:
            if isinstance(c, Call) and c.name == "log":
                (u,) = cast(tuple[Expr], c.children)
                power = next((p for p in factors if _is_power_of(p, u) and self._bounds(k := _exponent(p))[0] is k), None)
                if power is not None:
                    factors = [p for p in factors if p is not c and p is not power]
                    apart = _product(self._bounds(power), self._bounds(c))
                    together.append(_power_by_logarithm(self._bounds(u), _exponent(power), apart))
        return [*(self._bounds(p) for p in factors), *together]

    def _decision(self, c: Cond) -> Decision:
        match c:
            case Compare():
                lo, hi = self._bounds(c.g)
                return positive(lo, c.strict), negation(positive(hi, c.strict))
            case Not():
                holds, fails = self._truth(c.operand)
                return fails, holds
            case And() | Or():
                parts = [self._truth(child) for child in c.children]
                both, either = (conjunction, disjunction) if isinstance(c, And) else (disjunction, conjunction)
                return both(*(p[0] for p in parts)), either(*(p[1] for p in parts))
            case _:
                raise AssertionError(f"unknown condition {type(c).__name__}")


def _least(*values: Expr) -> Expr:
    result = values[0]
    for v in values[1:]:
        result = result if v is result else call("min", result, v)
    return result


def _most(*values: Expr) -> Expr:
    result = values[0]
    for v in values[1:]:
        result = result if v is result else call("max", result, v)
    return result


def _negative(u: Expr) -> Expr:
    return mul(MINUS_ONE, u)


def _sizes(u: Interval) -> Interval:
    """Returns the least and the largest |u|."""
    lo, hi = u
    return _most(ZERO, lo, _negative(hi)), _most(hi, _negative(lo))


def _product(a: Interval, b: Interval, times: Callable[[Expr, Expr], Expr] = mul) -> Interval:
    """Returns the bounds of a product; `times` multiplies ends."""
    if a[0] is not a[1] and b[0] is b[1]:
        a, b = b, a
    if a[0] is a[1]:  # a number
        c = a[0]
        if isinstance(c, Const):
            ends = mul(c, b[0]), mul(c, b[1])
            return ends if c.data >= 0 else (ends[1], ends[0])
        ends = times(c, b[0]), times(c, b[1])
        return _least(*ends), _most(*ends)
    corners = [times(u, v) for u in a for v in b]
    return _least(*corners), _most(*corners)


def product_of_endless(a: Interval, b: Interval) -> Interval:
    """Returns the bounds of a product of factors that may have infinite bounds: 0·∞ is 0, because no factor is infinite."""
    return _product(a, b, lambda u, v: where(disjunction(_is_null(u), _is_null(v)), ZERO, mul(u, v)))


def _is_null(u: Expr) -> Cond:
    return conjunction(positive(u, strict=False), positive(_negative(u), strict=False))


def _power(u: Interval, k: int) -> Interval:
    if k < 0:
        lo, hi = _power(u, -k) if k != -1 else u
        below, above = positive(_negative(hi)), positive(lo)
        from_0 = disjunction(conjunction(positive(lo, strict=False), positive(hi)), below)  # 0 may be an end
        to_0 = disjunction(conjunction(positive(_negative(hi), strict=False), positive(_negative(lo))), above)
        return where(from_0, integer_power(hi, -1), _EVERYTHING[0]), where(to_0, integer_power(lo, -1), _EVERYTHING[1])
    if k % 2:
        return integer_power(u[0], k), integer_power(u[1], k)
    least, most = _sizes(u)
    return integer_power(least, k), integer_power(most, k)


def _hull(c: Decision, a: Interval, b: Interval) -> Interval:
    holds, fails = c
    if negation(holds) is fails:  # the box does not matter
        return where(holds, a[0], b[0]), where(holds, a[1], b[1])
    return (
        where(holds, a[0], where(fails, b[0], _least(a[0], b[0]))),
        where(holds, a[1], where(fails, b[1], _most(a[1], b[1]))),
    )


def _wave(lo: Expr, hi: Expr) -> Interval:
    """Returns bounds of cos over [lo, hi]: 1 if a multiple of 2π lies inside, -1 if an odd multiple of π does."""
    turn = const(0.5 / math.pi)
    a, b = mul(turn, lo), mul(turn, hi)
    ends = call("cos", lo), call("cos", hi)
    crest = positive(sub(call("floor", b), a), strict=False)
    half = const(0.5)
    trough = positive(sub(call("floor", sub(b, half)), sub(a, half)), strict=False)
    return where(trough, MINUS_ONE, _least(*ends)), where(crest, ONE, _most(*ends))


def _clipped(name: str, u: Interval, least: float | None, most: float | None) -> Interval:
    """Returns bounds of an increasing function that is defined between `least` and `most` only."""
    lo, hi = u
    inside = conjunction(
        positive(sub(hi, const(least)), strict=False) if least is not None else TRUE,
        positive(sub(const(most), lo), strict=False) if most is not None else TRUE,
    )
    if least is not None:
        lo, hi = _most(lo, const(least)), _most(hi, const(least))
    if most is not None:
        lo, hi = _least(lo, const(most)), _least(hi, const(most))
    return where(inside, call(name, lo), _NO_NUMBER), where(inside, call(name, hi), _NO_NUMBER)


def _function(name: str, parts: list[Interval]) -> Interval:
    u = parts[0]
    if name in _RISING:
        return call(name, u[0]), call(name, u[1])
    if name in _BY_NAME:
        return _BY_NAME[name](u)
    match name:
        case "exact" | "chosen":
            return u
        case "min" | "max":
            return call(name, u[0], parts[1][0]), call(name, u[1], parts[1][1])
        case "pow":
            return _real_power(u, parts[1])
        case "atan2":
            return _angle(*parts)
        case "mod":
            return _remainder(u, parts[1])
        case _:
            raise AssertionError(f"no enclosure is known for {name}")


def _angle(y: Interval, x: Interval) -> Interval:
    """Returns bounds of atan2 in the half-planes x > 0, y > 0 and y < 0; (-π, π) for a box that lies in none of them."""
    flat, steep = (_function("atan", [_product(u, _power(v, -1))]) for u, v in ((y, x), (x, y)))
    quarter = const(math.pi / 2)
    lo: Expr = const(-math.pi)
    hi: Expr = const(math.pi)
    for inside, bounds in (
        (positive(_negative(y[1])), (sub(_negative(quarter), steep[1]), sub(_negative(quarter), steep[0]))),
        (positive(y[0]), (sub(quarter, steep[1]), sub(quarter, steep[0]))),
        (positive(x[0]), flat),
    ):
        lo, hi = where(inside, bounds[0], lo), where(inside, bounds[1], hi)
    return lo, hi


def _tangent(u: Interval) -> Interval:
    """Returns bounds of tan, which increases between its poles."""
    one_branch = [call("floor", sub(div(v, const(math.pi)), const(0.5))) for v in u]
    same = positive(sub(*one_branch), strict=False)
    return where(same, call("tan", u[0]), _EVERYTHING[0]), where(same, call("tan", u[1]), _EVERYTHING[1])


def _logarithm(name: str, u: Interval, least: Expr) -> Interval:
    """Returns bounds of a logarithm that is defined above `least`."""
    lo, hi = u
    somewhere, everywhere = positive(sub(hi, least)), positive(sub(lo, least))
    return (
        where(somewhere, where(everywhere, call(name, lo), _EVERYTHING[0]), _NO_NUMBER),
        where(somewhere, call(name, hi), _NO_NUMBER),
    )


def _real_power(u: Interval, k: Interval) -> Interval:
    """Returns bounds of u^k. For u > 0 it is monotone in both, so its bounds are at corners; u < 0 has powers too where k is an integer."""
    exponents = (k[0],) if k[0] is k[1] else k
    lo, hi = _at_corners((_most(ZERO, u[0]), u[1]), exponents)
    defined = positive(u[1], strict=False)
    positive_part = where(defined, lo, _NO_NUMBER), where(defined, hi, _NO_NUMBER)
    if all(isinstance(e, Const) for e in k):  # no integer, else it were an integer power
        return positive_part
    size = _at_corners(_sizes(u), exponents)[1]
    whole = TRUE if k[0] is not k[1] else positive(sub(call("floor", k[0]), k[0]), strict=False)
    reaches = conjunction(positive(mul(MINUS_ONE, u[0])), whole)
    return where(reaches, mul(MINUS_ONE, size), positive_part[0]), where(reaches, size, positive_part[1])


def _is_power_of(e: Expr, u: Expr) -> bool:
    """Returns whether e is a power of u with an exponent that may be positive."""
    return e.children[:1] == (u,) and (e.exponent > 0 if isinstance(e, Pow) else isinstance(e, Call) and e.name == "pow")


def _exponent(power: Expr) -> Expr:
    return const(float(power.exponent)) if isinstance(power, Pow) else cast(Expr, power.children[1])


def _power_by_logarithm(u: Interval, k: Expr, apart: Interval) -> Interval:
    """Returns bounds of uᵏ·log u: for k > 0 it falls from 0 at u = 0 to -1/(e·k) at u = e^(-1/k), and rises from there on. Other bounds
    are those of both factors `apart`."""
    lo, hi = (_most(ZERO, v) for v in u)
    ends = [where(positive(v), mul(call("pow", v, k), call("log", v)), ZERO) for v in (lo, hi)]
    lowest = call("exp", div(MINUS_ONE, k))
    turns = conjunction(positive(sub(lowest, lo)), positive(sub(hi, lowest)))
    bounds = where(turns, div(const(-1.0 / math.e), k), _least(*ends)), _most(*ends)
    known = conjunction(positive(k), positive(u[1]))
    return where(known, bounds[0], apart[0]), where(known, bounds[1], apart[1])


def _at_corners(base: Interval, exponents: Sequence[Expr]) -> Interval:
    """Returns the least and the largest power of a base that is not negative."""
    corners = [where(positive(b), call("pow", b, e), where(positive(e), ZERO, _INFINITY)) for b in base for e in exponents]
    return _least(*corners), _most(*corners)


def _remainder(u: Interval, m: Interval) -> Interval:
    """Returns bounds of u mod m: exact within one period, else everything between 0 and m."""
    if m[0] is m[1]:
        steps = [call("floor", div(v, m[0])) for v in u]
        same = conjunction(positive(sub(steps[0], steps[1]), strict=False), positive(sub(steps[1], steps[0]), strict=False))
        ends = [call("mod", v, m[0]) for v in u]
        return where(same, ends[0], _least(ZERO, m[0])), where(same, ends[1], _most(ZERO, m[0]))
    return _least(ZERO, m[0]), _most(ZERO, m[1])


def _falling(values: Interval) -> Interval:
    """Returns bounds of a decreasing function from its values at both ends."""
    return values[1], values[0]


def _falling_arc(u: Interval) -> Interval:
    rising = _clipped("asin", u, -1.0, 1.0)
    quarter = const(math.pi / 2)
    return sub(quarter, rising[1]), sub(quarter, rising[0])


def _root_of_size(u: Interval) -> Interval:
    least, most = _sizes(u)
    return call("sqrt", least), call("sqrt", most)


_RISING = frozenset(("exp", "expm1", "erf", "atan", "sinh", "tanh", "floor"))
_BY_NAME: dict[str, Callable[[Interval], Interval]] = {
    "cos": lambda u: _wave(*u),
    "sin": lambda u: _wave(sub(u[0], const(math.pi / 2)), sub(u[1], const(math.pi / 2))),
    "tan": _tangent,
    "log": lambda u: _logarithm("log", u, ZERO),
    "log1p": lambda u: _logarithm("log1p", u, MINUS_ONE),
    "erfc": lambda u: _falling((call("erfc", u[0]), call("erfc", u[1]))),
    "erfinv": lambda u: _clipped("erfinv", u, -1.0, 1.0),
    "erfcinv": lambda u: _falling(_clipped("erfcinv", u, 0.0, 2.0)),
    "sqrt": lambda u: _clipped("sqrt", u, 0.0, None),
    "asin": lambda u: _clipped("asin", u, -1.0, 1.0),
    "acos": _falling_arc,
    "cosh": lambda u: cast(Interval, tuple(call("cosh", v) for v in _sizes(u))),
    "magnitude": _sizes,
    "root": _root_of_size,
}
