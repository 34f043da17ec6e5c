"""Integrands that fall off far away like a power, not like an exponential, and whose power is no integer, or not known.

    x^-3/2,  (1 + x²)^-a,  log(x)/x²,  (1 + x²/n)^(-(n + 1)/2)

The rational map of a tail (`teg.program.Bend`) makes a smooth function of what falls off like an exponential, or has a series in 1/x. Of
x^-p it makes (1 - u)^(p - 2), which is singular at u = 1. Such integrands are *slow*: their tails have a reach (`Integrate`).

Every subexpression has a growth: a degree d, which parameters may decide, if it grows like xᵈ but for logarithms; whether it is xᵈ times
a series in 1/x (*regular*); and whether it may have factors that are faster than all powers. Degrees of sums are upper bounds, because
terms may cancel. Linear in the size of the integrand.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from typing import NamedTuple

from teg.analysis.endless import factor_of_logarithm
from teg.analysis.surfaces import binders_inside
from teg.analysis.tails import is_unbounded
from teg.ir.expr import ONE, ZERO, Add, Call, Compare, Cond, Const, Expr, Mul, Pow, Var, Where, const
from teg.ir.integral import Integral, masses_of
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, mul

_LOGARITHMS = frozenset(("log", "log1p"))
_BOUNDED = frozenset(("atan", "atan2", "tanh", "erf", "asin", "acos"))
"""Functions that tend to a number where their argument grows, as fast as a series in 1/x or faster."""

_ROUGH = frozenset(("pow", "sqrt", "root", "log", "log1p"))


class Growth(NamedTuple):
    """What x^degree is to an expression; `regular`: a series in 1/x is left; `fast`: exponentials may be left."""

    degree: Expr
    regular: bool = True
    fast: bool = False


_STILL, _FAST = Growth(ZERO), Growth(ZERO, False, True)


def steepest_of_slow(node: Integral) -> Expr | None:
    """Returns the largest degree of all parts of a slow integrand, 1 at least; None for an integrand that is not slow.

    Degrees in denominators count half: where these are infinite their inverses are 0.
    """
    x, body = node.var, node.body
    known = _growths(node)
    if not any(_is_slow(known[e]) for e in _terms(body)):
        return None
    inside, above = binders_inside(body), _above_denominators(body)
    degrees: dict[Expr, None] = {}
    for e in known:
        d = _size(e, known) if x in e.free else ZERO
        if d.free & inside:
            return None
        degrees[d if e in above else mul(const(0.5), d)] = None
    # discriminants of the conditions of an inner integral have squares
    squared = any(isinstance(e, Compare) and x in e.free and e.free & inside for e in known)
    return mul(const(2.0 if squared else 1.0), _largest(degrees))


def _growths(node: Integral) -> dict[Node, Growth]:
    """Returns the growth of an integrand and of all that it consists of, children first."""
    known: dict[Node, Growth] = {}
    for e in postorder([node.body]):
        known[e] = _growth(e, node.var, known) if node.var in e.free else _STILL
    return known


def _terms(e: Expr) -> Sequence[Expr]:
    return e.children if isinstance(e, Add) else (e,)


def _is_slow(growth: Growth) -> bool:
    degree = growth.degree
    return not growth.fast and not (growth.regular and isinstance(degree, Const) and degree.data.is_integer())


def _above_denominators(body: Expr) -> set[Node]:
    """Returns the nodes that stand elsewhere than in denominators."""
    seen: set[Node] = set()
    stack: list[Node] = [body]
    while stack:
        e = stack.pop()
        if e not in seen:
            seen.add(e)
            stack.extend(() if isinstance(e, Pow) and e.exponent < 0 else e.children)
    return seen


def _size(e: Node, known: Mapping[Node, Growth]) -> Expr:
    """Returns the degree of an expression, or the largest of the products that it is computed by, from the left; 0 for conditions."""
    if not isinstance(e, Mul):
        return known[e].degree
    above = [known[f].degree for f in e.children if not (isinstance(f, Pow) and f.exponent == -1)]
    numbers = list(accumulate(d.data for d in above if isinstance(d, Const)))
    return add(const(max([0.0, *numbers])), *(d for d in above if not isinstance(d, Const)))


def _largest(degrees: Iterable[Expr]) -> Expr:
    numbers = [d.data for d in degrees if isinstance(d, Const)]
    largest: Expr = const(max([1.0, *numbers]))
    for d in degrees:
        largest = largest if isinstance(d, Const) else call("max", largest, d)
    return largest


def _growth(e: Node, x: Var, known: Mapping[Node, Growth]) -> Growth:
    """Returns the growth of a node that depends on x."""
    match e:
        case Var():
            return Growth(ONE)
        case Add():
            return _of_sum([known[c] for c in e.children])
        case Where():
            return _of_sum([known[c] for c in (e.then, e.otherwise) if c is not ZERO])
        case Mul():
            factors = [known[c] for c in e.children]
            return Growth(add(*(f.degree for f in factors)), all(f.regular for f in factors), any(f.fast for f in factors))
        case Pow():
            return _to_power(known[e.base], const(e.exponent))
        case Call():
            return _of_call(e, x, known)
        case Integral():
            return _of_integral(e, x, known[e.body])
        case Cond():
            return _STILL
        case _:
            return _FAST


def _to_power(base: Growth, exponent: Expr) -> Growth:
    return Growth(mul(exponent, base.degree), base.regular, base.fast)


def _of_sum(terms: Sequence[Growth]) -> Growth:
    """Returns the growth of a sum: regular if all terms are, and their degrees differ by integers."""
    degrees = dict.fromkeys(t.degree for t in terms)
    numbers = [d.data for d in degrees if isinstance(d, Const)]
    regular = all(t.regular for t in terms) and len(numbers) == len(degrees) and all((n - numbers[0]).is_integer() for n in numbers)
    largest: Expr | None = const(max(numbers)) if numbers else None
    for d in degrees:
        if not isinstance(d, Const):
            largest = d if largest is None else call("max", largest, d)
    return Growth(ZERO if largest is None else largest, regular, any(t.fast for t in terms))


def _of_call(e: Call, x: Var, known: Mapping[Node, Growth]) -> Growth:
    given = [known[c] for c in e.children]
    first, fast = given[0], any(g.fast for g in given)
    match e.name:
        case "pow" if x not in e.children[1].free:
            return _to_power(first, e.children[1])
        case "sqrt" | "root":
            return _to_power(first, const(0.5))
        case "magnitude":
            return first
        case "min" | "max":
            return _of_sum(given)
        case "exp":
            factors = [_of_exponential(u, x, known) for u in _terms(e.children[0])]
            return Growth(add(*(f.degree for f in factors)), all(f.regular for f in factors), any(f.fast for f in factors))
        case name if name in _LOGARITHMS:
            return Growth(ZERO, False, fast)
        case name if name in _BOUNDED:
            return Growth(ZERO, all(g.regular for g in given), fast)
        case _:
            return _FAST


def _of_integral(e: Integral, x: Var, inside: Growth) -> Growth:
    """Returns the growth of an integral. Where a bound or a condition couples its variable to x, both may be far away together, or close to
    a place where a power is singular."""
    if inside.fast or masses_of(e.body, e.var) is not None:
        return _FAST
    order = postorder([e.body])
    coupled = x in e.lo.free | e.hi.free or any(isinstance(c, Compare) and x in c.free and e.var in c.free for c in order)
    if not is_unbounded(e):
        rough = coupled and any(isinstance(c, Call) and c.name in _ROUGH and e.var in c.free for c in order)
        return Growth(inside.degree, inside.regular and not rough)
    growths = _growths(e)
    own = [growths[term] for term in _terms(e.body)]
    if coupled and any(g.fast for g in own):
        return _FAST
    return Growth(inside.degree, inside.regular and not any(map(_is_slow, own)))


def _of_exponential(u: Expr, x: Var, known: Mapping[Node, Growth]) -> Growth:
    """Returns the growth of exp(u): a power if u is a multiple of a logarithm, none if u tends to a number."""
    growth, factor = known[u], factor_of_logarithm(u, x)
    logarithms = [n for n in postorder([u]) if isinstance(n, Call) and n.name in _LOGARITHMS and x in n.free]
    if factor is not None and x not in factor.free:
        return _to_power(known[logarithms[-1].children[0]], factor)
    settles = isinstance(growth.degree, Const) and growth.degree.data <= 0.0 and not growth.fast
    return Growth(ZERO, growth.regular) if settles and not logarithms else _FAST
