"""The functions that build nodes: numbers, conditions, branches.

They apply the simplifications that cost nothing to detect: constants, neutral elements, equal terms, a bracket as a factor. They neither
reorder nor re-associate sums, so a program is evaluated as the user wrote it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import cast

from teg.errors import DeltaError
from teg.ir.expr import (
    FALSE,
    FUNCTIONS,
    MINUS_ONE,
    ONE,
    TRUE,
    ZERO,
    Add,
    And,
    Call,
    Compare,
    Cond,
    Const,
    Expr,
    HalfAngle,
    Mul,
    Not,
    Or,
    Pow,
    Truth,
    Tuple,
    UncountedFloor,
    Where,
    const,
)

_DEPTH = 6  # of sums, products and branches in which exp(c/0) is looked for
_FLATTEN = 8  # a product inside a product is merged while it is this short: longer ones would make chains quadratic


_GUARDS = 4  # the largest number of different branches that are kept together as one

_SINGULAR = frozenset(("sqrt", "log", "log1p", "pow", "asin", "acos"))


def _split(term: Mul) -> tuple[float, Expr]:
    """Returns the numerical factor of a product, and the product of the other factors."""
    number = term.children[0]
    if not isinstance(number, Const):
        return 1.0, term
    others = term.children[1:]
    return number.data, others[0] if len(others) == 1 else Mul.make(None, others)


def add(*terms: Expr) -> Expr:
    """Returns the sum, in the order given. Constants, equal terms, and branches on one condition are collected."""
    constant = 0.0
    parts: dict[Expr, float] = {}
    branches: dict[Cond, list[Where]] = {}
    for term in terms:
        kind = type(term)
        if kind is Const:
            constant += term.data
        elif kind is Mul and type(term.children[0]) is Const:
            coefficient, product = _split(cast(Mul, term))
            parts[product] = parts.get(product, 0.0) + coefficient
        else:
            parts[term] = parts.get(term, 0.0) + 1.0
            if isinstance(term, Where):
                branches.setdefault(term.condition, []).append(term)
    for condition, same in branches.items():
        if len(same) > 1:
            times = [(const(c), w) for w in dict.fromkeys(same) if (c := parts.pop(w)) != 0.0]  # a multiple may stand in the sum too
            merged = where(condition, add(*(mul(c, w.then) for c, w in times)), add(*(mul(c, w.otherwise) for c, w in times)))
            if merged is not ZERO:
                parts[merged] = parts.get(merged, 0.0) + 1.0
    kept = [_multiple(c, product) if c != 1.0 else product for product, c in parts.items() if c != 0.0]
    if constant != 0.0:
        kept.append(const(constant))
    if not kept:
        return ZERO
    return kept[0] if len(kept) == 1 else Add.make(None, tuple(kept))


def _multiple(c: float, e: Expr) -> Expr:
    """Returns a number, neither 0 nor 1, times an expression."""
    is_factor = type(e) not in (Mul, Where, Const)  # of which nothing is simplified
    return Mul.make(None, (const(c), e)) if is_factor else mul(const(c), e)


def collected(e: Expr) -> Expr:
    """Returns a sum with the terms of sums in it, and of numbers times sums, as its own: equal ones are collected, or cancel."""
    terms: list[Expr] = []
    stack = [(e, 1.0)]
    while stack:
        term, factor = stack.pop()
        number, product = _split(term) if isinstance(term, Mul) else (1.0, term)
        if isinstance(product, Add):
            stack.extend((c, factor * number) for c in reversed(product.children))
        else:
            terms.append(mul(const(factor), term))
    return add(*terms)


def guarded_sum(terms: Iterable[Expr]) -> Expr:
    """Returns the sum of cotangents.

    If all terms are branches, so is the sum: its factors cannot leak a NaN where no branch is taken.
    """
    kept = [t for t in terms if t is not ZERO]
    guarded = [_guarded(t) for t in kept]
    conditions = list(dict.fromkeys(c for c, _ in guarded))
    if not kept or len(conditions) > _GUARDS or TRUE in conditions:
        return add(*kept)
    if len(conditions) == 1:
        return where(conditions[0], add(*(u for _, u in guarded)), ZERO)
    sets = [dict.fromkeys(c.children if isinstance(c, And) else (c,)) for c in conditions]
    common = [c for c in sets[0] if all(c in s for s in sets[1:])]
    rests = {c: conjunction(*(p for p in s if p not in common)) for c, s in zip(conditions, sets, strict=True)}
    total = add(*(where(rests[c], u, ZERO) for c, u in guarded))
    return where(conjunction(*common, disjunction(*rests.values())), total, ZERO)


def _guarded(term: Expr) -> tuple[Cond, Expr]:
    """Returns a term as where(c, u, 0), given that, where(~c, 0, u), or one of these inside another. c is TRUE if the term is no branch."""
    conditions: list[Cond] = []
    while isinstance(term, Where) and (term.otherwise is ZERO or term.then is ZERO):
        if term.otherwise is ZERO:
            conditions.append(term.condition)
            term = term.then
        else:
            conditions.append(negation(term.condition))
            term = term.otherwise
    return conjunction(*conditions), term


def sub(a: Expr, b: Expr) -> Expr:
    """Returns a - b."""
    return add(a, mul(MINUS_ONE, b))


def div(a: Expr, b: Expr) -> Expr:
    """Returns a / b."""
    return mul(a, power(b, MINUS_ONE))


def mul(*factors: Expr) -> Expr:
    """Returns the product. A factor where(b, u, 0) takes the whole product into its branch."""
    coefficient = 1.0
    powers: dict[Expr, int] = {}
    conditions: list[Cond] = []
    has_product = may_settle = False
    stack: list[Expr] = [*reversed(factors)]
    while stack:
        factor = stack.pop()
        kind = type(factor)
        if kind is Const:
            coefficient *= factor.data
            continue
        if kind is Mul:
            if len(factor.children) <= _FLATTEN:
                stack.extend(reversed(cast(Mul, factor).children))
                continue
            has_product = True
        elif kind is Pow:
            base = cast(Pow, factor).base
            has_product = has_product or type(base) is Mul
            may_settle = may_settle or base is ZERO or isinstance(base, Call)
            powers[base] = powers.get(base, 0) + factor.data
            continue
        elif isinstance(factor, Where):
            if factor.otherwise is ZERO:
                conditions.append(factor.condition)
                stack.append(factor.then)
                continue
            if factor.then is ZERO:
                conditions.append(negation(factor.condition))
                stack.append(factor.otherwise)
                continue
        elif isinstance(factor, Call):
            may_settle = True
        powers[factor] = powers.get(factor, 0) + 1
    if has_product and len(powers) > 1:
        coefficient *= _cancel_in_products(powers)
    if (has_product or may_settle) and any([_is_power_of_zero(factor) for factor in powers]):
        _settle_zeros(powers)
    if coefficient == 0.0:
        return const(math.nan) if powers.get(ZERO, 0) < 0 else ZERO  # 0/0, which a limit would decide
    kept: list[Expr] = [base if k == 1 else Pow.make(k, (base,)) for base, k in powers.items() if k != 0]
    if coefficient != 1.0 or not kept:
        kept.insert(0, const(coefficient))
    product = kept[0] if len(kept) == 1 else Mul.make(None, tuple(kept))
    return where(conjunction(*conditions), product, ZERO) if conditions else product


def _cancel_in_products(powers: dict[Expr, int]) -> float:
    """Multiplies powers of products out, in place, whose factors cancel with others: (t/x)²·x² is t², also at x = 0. Others stay as they
    are written, as they may overflow. Returns their numbers."""
    number = 1.0
    for product in [base for base in powers if isinstance(base, Mul) and base.free]:
        parts = [(f.base, f.exponent) if isinstance(f, Pow) else (f, 1) for f in product.children]
        if any([k * powers[product] * powers.get(base, 0) < 0 for base, k in parts]):
            times = powers.pop(product)
            for base, k in parts:
                power = integer_power(base, k * times) if isinstance(base, Const) else None
                if isinstance(power, Const):
                    number *= power.data
                else:
                    powers[base] = powers.get(base, 0) + k * times
    return number


def _settle_zeros(powers: dict[Expr, int]) -> None:
    """Gives a product with a power of 0 its limit, in place, where another factor decides it: exp(c/0) is stronger than any power of 0, and
    pow(0, k)·0ⁿ is pow(0, k + n)."""
    zeros = [factor for factor in powers if _is_power_of_zero(factor)]
    if any([_is_exponential_of_pole(factor) for factor in powers]):
        for factor in zeros:
            del powers[factor]
    elif len(zeros) == 2 and ZERO in powers:
        real = zeros[0] if zeros[1] is ZERO else zeros[1]
        if powers[real] == 1:
            del powers[real]
            powers[call("pow", ZERO, add(cast(Expr, real.children[1]), const(powers.pop(ZERO))))] = 1


def _is_power_of_zero(factor: Expr) -> bool:
    return factor is ZERO or (isinstance(factor, Call) and factor.name == "pow" and factor.children[0] is ZERO)


def _is_exponential_of_pole(e: Expr, depth: int = 0) -> bool:
    """Returns whether all terms and branches of a factor have the factor exp(c/0), down to a fixed depth."""
    if depth == _DEPTH:
        return False
    match e:
        case Where():
            return _is_exponential_of_pole(e.then, depth + 1) and _is_exponential_of_pole(e.otherwise, depth + 1)
        case Add():
            return all([_is_exponential_of_pole(c, depth + 1) for c in e.children])
        case Mul():
            return any([_is_exponential_of_pole(c, depth + 1) for c in e.children])
        case Call(name="exp"):
            return _has_pole_at_zero(e.children[0])
        case _:
            return False


def _has_pole_at_zero(e: Expr) -> bool:
    factors = e.children if isinstance(e, Mul) else (e,)
    return any(isinstance(f, Pow) and f.base is ZERO and f.exponent < 0 for f in factors)


def power(base: Expr, exponent: Expr) -> Expr:
    """Returns base^exponent: an integer power, a square root, or the real power of a positive base."""
    if isinstance(exponent, Const):
        k = exponent.data
        if k == 0.0:
            return ONE
        if k == 1.0:
            return base
        if float(k).is_integer() and abs(k) < 2**31:
            return integer_power(base, int(k))
        if k == 0.5:
            return call("sqrt", base)
        if k == -0.5:
            return integer_power(call("sqrt", base), -1)
    return call("pow", base, exponent)


def integer_power(base: Expr, k: int) -> Expr:
    """Returns base^k."""
    if k == 0:
        return ONE
    if k == 1:
        return base
    if isinstance(base, Const):
        if base.data != 0.0 and (k > 0 or abs(math.frexp(base.data)[0]) == 0.5):  # 1/3 is not a binary number: it is divided, as written
            try:
                return const(base.data**k)
            except OverflowError:
                pass
        elif base.data == 0.0 and k > 0:
            return ZERO
    if isinstance(base, Call) and base.name in ("sqrt", "root") and k % 2 == 0:
        return integer_power(base.children[0], k // 2)
    if isinstance(base, Pow) and (base.exponent == -1 or k > 0):
        return integer_power(base.base, base.exponent * k)
    if isinstance(base, Mul) and base.children[0] is MINUS_ONE and (k < 0 or k % 2 == 0):
        positive_base = integer_power(mul(*base.children[1:]), k)
        return mul(MINUS_ONE, positive_base) if k % 2 else positive_base
    if isinstance(base, Where):
        if k > 0 and base.otherwise is ZERO:
            return where(base.condition, integer_power(base.then, k), ZERO)
        if k < 0:
            return _into_branches(base, lambda u: integer_power(u, k))
    return Pow.make(k, (base,))


def call(name: str, *arguments: Expr) -> Expr:
    """Returns a function of the language applied. A function that is singular somewhere is moved into the branches of a `where`."""
    if all(isinstance(a, Const) for a in arguments):
        try:
            value = FUNCTIONS[name](*[a.data for a in arguments])
            if math.isfinite(value):
                return const(value)
        except (ValueError, OverflowError, ZeroDivisionError):
            pass
    if name == "exp" and isinstance(arguments[0], Call) and arguments[0].name == "log":
        return arguments[0].children[0]
    if name in _SINGULAR and isinstance(arguments[0], Where):
        others = arguments[1:]
        return _into_branches(arguments[0], lambda u: call(name, u, *others))
    if any(a.has_delta for a in arguments):
        raise DeltaError(
            f"a Dirac delta inside {name} has no meaning",
            Call.make(name, arguments),
            "a delta may only be added and multiplied",
        )
    return Call.make(name, arguments)


def uncounted_floor(u: Expr) -> Expr:
    """floor(u) whose steps are not written out; of a number a number."""
    e = call("floor", u)
    return UncountedFloor.make("floor", (u,)) if isinstance(e, Call) else e


def half_angle(y: Expr, x: Expr) -> Expr:
    """Returns atan2(y, x) where x is not negative; of numbers a number."""
    return call("atan2", y, x) if isinstance(y, Const) and isinstance(x, Const) else HalfAngle.make("atan2", (y, x))


def _into_branches(outer: Where, f: Callable[[Expr], Expr]) -> Expr:
    """Returns f of a `where`, applied branch by branch. Iterative; each shared branch is visited once."""
    done: dict[Expr, Expr] = {}
    stack: list[Expr] = [outer]
    while stack:
        e = stack[-1]
        if not isinstance(e, Where):
            done.setdefault(e, f(e))
        elif missing := [u for u in (e.then, e.otherwise) if u not in done]:
            stack.extend(missing)
            continue
        else:
            done[e] = where(e.condition, done[e.then], done[e.otherwise])
        stack.pop()
    return done[outer]


def where(condition: Cond, then: Expr, otherwise: Expr) -> Expr:
    """Returns `then` where the condition holds, else `otherwise`."""
    if condition is TRUE or then is otherwise:
        return then
    if condition is FALSE:
        return otherwise
    if isinstance(condition, Not):
        condition, then, otherwise = condition.operand, otherwise, then
    if isinstance(then, Where) and holds_with(then.condition, condition):
        then = then.then
    if isinstance(otherwise, Where) and otherwise.condition is condition:
        otherwise = otherwise.otherwise
    if otherwise is ZERO and isinstance(then, Where) and ZERO in (then.then, then.otherwise):
        inner, value = nonzero_part(then)
        return where(conjunction(condition, inner), value, ZERO)
    if then is ZERO and isinstance(otherwise, Where) and ZERO in (otherwise.then, otherwise.otherwise):
        inner, value = nonzero_part(otherwise)
        return where(conjunction(negation(condition), inner), value, ZERO)
    return then if then is otherwise else Where.make(None, (condition, then, otherwise))


def nonzero_part(e: Expr) -> tuple[Cond, Expr]:
    """Returns a condition outside of which an expression is 0, and the expression where the condition holds."""
    if isinstance(e, Where) and e.otherwise is ZERO:
        return e.condition, e.then
    if isinstance(e, Where) and e.then is ZERO:
        return negation(e.condition), e.otherwise
    return TRUE, e


def holds_with(c: Cond, known: Cond) -> bool:
    """Returns whether a condition holds where another one does, by their form: it is the same, or has it for an alternative."""
    return c is known or (isinstance(c, Or) and known in c.children)


def bracket(condition: Cond) -> Expr:
    """Returns 1 where the condition holds, else 0 (Iverson)."""
    return where(condition, ONE, ZERO)


def absolute(u: Expr) -> Expr:
    """Returns |u| = where(u > 0, u, -u)."""
    return where(positive(u), u, mul(MINUS_ONE, u))


def positive(g: Expr, strict: bool = True, resolution: Cond | None = None, rivals: tuple[str, str] | None = None) -> Cond:
    """Returns the atom g > 0, or g >= 0.

    A constant `g` decides the atom, except a 0 with a `resolution`: two surfaces coincide there, and only the order of a tie tells them
    apart.
    """
    if isinstance(g, Const) and (resolution is None or g.data != 0):
        return TRUE if g.data > 0 or (not strict and g.data == 0) else FALSE
    if g.has_delta:
        raise DeltaError("a Dirac delta inside a condition has no meaning", g)
    if resolution is None:
        return Compare.make((strict, None), (g,))
    return Compare.make((strict, rivals), (g, resolution))


def negation(c: Cond) -> Cond:
    """Returns ~c."""
    if isinstance(c, Truth):
        return FALSE if c.data else TRUE
    return c.operand if isinstance(c, Not) else Not.make(None, (c,))


def conjunction(*conditions: Cond) -> Cond:
    """Returns a & b & …"""
    return _junction(And, conditions, FALSE, TRUE)


def disjunction(*conditions: Cond) -> Cond:
    """Returns a | b | …; a & b | ~a & b is b."""
    result = _junction(Or, conditions, TRUE, FALSE)
    if isinstance(result, Or) and len(result.children) == 2:
        first, second = (dict.fromkeys(c.children if isinstance(c, And) else (c,)) for c in result.children)
        others = [c for c in (*first, *second) if not (c in first and c in second)]
        if len(others) == 2 and len(first) == len(second) and negation(others[0]) is others[1]:
            return conjunction(*(c for c in first if c in second))
    return result


def _junction(cls: type[And] | type[Or], conditions: Iterable[Cond], absorbing: Truth, neutral: Truth) -> Cond:
    kept: dict[Cond, None] = {}
    for c in conditions:
        if c is absorbing:
            return absorbing
        if isinstance(c, cls) and len(c.children) <= _FLATTEN:
            kept.update(dict.fromkeys(c.children))
        elif c is not neutral:
            kept[c] = None
    for c in kept:
        if isinstance(c, Not) and c.operand in kept:
            return absorbing
    if not kept:
        return neutral
    return next(iter(kept)) if len(kept) == 1 else cls.make(None, tuple(kept))


def tuple_of(*entries: Expr) -> Tuple:
    """Returns several expressions to be evaluated together."""
    return Tuple.make(None, entries)
