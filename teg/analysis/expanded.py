"""Expressions as sums of monomials with exact rational coefficients: expanded, shorter, perfect powers."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from types import UnionType
from typing import cast

from teg.ir.expr import Add, Const, Expr, Mul, Param, Pow, Var, const
from teg.ir.node import nodes_of, postorder
from teg.ir.simplify import add, integer_power, mul, sub
from teg.ir.traverse import parameters

MOST_TERMS = 48
"""Longer sums of monomials are not written out."""

Powers = tuple[tuple[int, int], ...]
"""A monomial: pairs (number of the generator, exponent), sorted."""

Exact = int | Fraction
"""A rational number; most are integers, which are added and multiplied in a tenth of the time."""

Form = dict[Powers, Exact]
"""A polynomial with exact coefficients."""

Kinds = type[Param] | UnionType
"""Classes of generators."""


@lru_cache(maxsize=1024)
def shorter_form(e: Expr, variables: bool = False) -> Expr | None:
    """Returns the shorter of two normal forms of e: in parameters, or in parameters and differences of two parameters; with `variables`,
    of variables and parameters too.

    Differences of parameters do not cancel where far coordinates are squared. If both are equally long: `expanded(e)`, unless such
    parameters are multiplied in it. If e does not change when all parameters that are multiplied are moved together: a form in which
    they stand as differences.
    """
    plain = expanded(e)
    differences = [n for n in nodes_of(Add, e) if _is_difference(n)]
    local = expanded(e, whole=differences) if differences else None
    relative = None if plain is None else _relative(plain, variables)
    best = plain if local is None else local
    if local is not None and plain is not None:
        cancels = _multiplies(plain, {p for d in differences for p in parameters(d)})
        best = plain if _length(plain) + cancels <= _length(local) else local
    return relative if relative is not None and best is not None and _length(relative) <= _length(best) else best


def _relative(e: Expr, variables: bool) -> Expr | None:
    """Returns a sum of monomials in differences of the parameters (and `variables`) that are squared in e; None if there are none."""
    form, generators = _normal_form(e, MOST_TERMS)
    if not form:
        return None
    number = len(generators)
    # parameters alone first: a variable that is local already moves with none of them
    for kinds in (Param, Param | Var) if variables else (Param,):
        for origin in (i for i in range(number) if isinstance(generators[i], kinds)):
            for others in _companions(form, generators[:number], origin, kinds) if any((origin, 2) in m for m in form) else ():
                if others and _is_invariant(form, {origin, *others}):
                    form = _from_origin(form, origin, {i: len(generators) + k for k, i in enumerate(others)})
                    generators += [add(generators[i], mul(const(-1.0), generators[origin])) for i in others]
                    break
    return _from_form(form, generators) if len(generators) > number else None


def _companions(form: Form, generators: Sequence[Expr], origin: int, kinds: Kinds) -> list[list[int]]:
    """Returns what may move together with an origin: its factors in monomials, and those with their factors in turn."""
    groups: list[list[int]] = []
    group = {origin}
    while True:
        factors = {i for m in form if any(g in group for g, _ in m) for i, _ in m}
        larger = group | {i for i in factors if i < len(generators) and isinstance(generators[i], kinds)}
        if larger == group:
            return groups
        group = larger
        groups.append(sorted(group - {origin}))


def _is_invariant(form: Form, moving: Collection[int]) -> bool:
    """Returns whether a form does not change when the same number is added to all these generators: its slope along that is 0."""
    slope: Form = {}
    for m, weight in form.items():
        for at, (i, k) in enumerate(m):
            if i in moving:
                lower = m[:at] + (((i, k - 1),) if k > 1 else ()) + m[at + 1 :]
                slope[lower] = slope.get(lower, 0) + k * weight
    return not any(slope.values())


def _from_origin(form: Form, origin: int, differences: Mapping[int, int]) -> Form:
    """Returns a form that is invariant, where the origin is 0: the others are their differences to it then."""
    return {tuple(sorted((differences.get(i, i), k) for i, k in m)): weight for m, weight in form.items() if all(i != origin for i, _ in m)}


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


def expanded(e: Expr, limit: int = MOST_TERMS, whole: Collection[Expr] = ()) -> Expr | None:
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


def perfect_power(e: Expr, exact: bool = True) -> tuple[Exact, Expr, int] | None:
    """Returns (c, h, k) with e = c·hᵏ, c a number and k > 1 as large as possible; None if e is no such power, or if a number in h is not
    exact as float64. Without `exact`, the numbers in h are rounded, and e may be longer."""
    form, generators = _normal_form(e, MOST_TERMS if exact else 4 * MOST_TERMS)
    if not form:
        return None
    lead = max(form, key=lambda m: _dense(m, len(generators)))
    shared = math.gcd(*(k for _, k in lead)) if lead else 0
    for k in range(shared, 1, -1):
        base = _root(form, lead, k, len(generators)) if shared % k == 0 else None
        if base is not None:
            scale = math.lcm(*(c.denominator for c in base.values())) if exact else 1
            h = _from_form({m: c * scale for m, c in base.items()}, generators, exact)
            return None if h is None else (form[lead] / Fraction(scale) ** k, h, k)
    return None


def _root(form: Form, lead: Powers, k: int, size: int) -> Form | None:
    """Returns the monic polynomial whose k-th power is proportional to `form`; its terms are found from the highest
    missing one downwards."""
    top: Powers = tuple((i, j // k) for i, j in lead)
    root: Form = {top: 1}
    slope = {i: (k - 1) * j for i, j in top}
    while len(root) <= len(form):
        power: Form | None = {(): form[lead]}
        for _ in range(k):
            power = None if power is None else _product(power, root, 4 * len(form))
        if power is None:
            return None
        missing = {m: form.get(m, 0) - power.get(m, 0) for m in {**form, **power}}
        missing = {m: c for m, c in missing.items() if c}
        if not missing:
            return root
        highest = max(missing, key=lambda m: _dense(m, size))
        term = {i: j - slope.get(i, 0) for i, j in {**dict.fromkeys(slope, 0), **dict(highest)}.items()}
        name = tuple(sorted((i, j) for i, j in term.items() if j))
        if any(j < 0 for j in term.values()) or name in root:
            return None
        root[name] = Fraction(missing[highest]) / (k * form[lead])
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
            m = m1 or m2
            if m1 and m2:
                powers = dict(m1)
                for i, k in m2:
                    powers[i] = powers.get(i, 0) + k
                m = tuple(sorted([(i, k) for i, k in powers.items() if k]))
            out[m] = out.get(m, 0) + c1 * c2
    return {m: c for m, c in out.items() if c} if len(out) <= limit else None


def _exact(number: float) -> Exact:
    return int(number) if number.is_integer() else Fraction(number)


def _is_float(number: Exact) -> bool:
    try:
        return Fraction(float(number)) == number
    except OverflowError:
        return False


def _from_form(form: Form, generators: Sequence[Expr], exact: bool = True) -> Expr | None:
    """Returns a form as an expression; None if a number in it must be `exact` as float64, and is not."""
    terms = []
    for m, coefficient in form.items():
        if exact and not _is_float(coefficient):
            return None
        terms.append(mul(const(float(coefficient)), *(integer_power(generators[i], k) for i, k in m)))
    return add(*terms)


class _Generators:
    """The generators of a normal form, numbered as they come."""

    def __init__(self) -> None:
        self.all: list[Expr] = []
        self._number: dict[Expr, int] = {}

    def index(self, e: Expr) -> int:
        """Returns the number of a generator."""
        if e not in self._number:
            self._number[e] = len(self.all)
            self.all.append(e)
        return self._number[e]

    def inverse(self, monomial: Form, k: int) -> Form:
        """Returns the power -k of a monomial. 1/a is a generator of its own, so a root of a form has no negative powers of a."""
        ((powers, weight),) = monomial.items()
        inverse = [(i if j < 0 else self.index(self.all[i] ** -1), k * abs(j)) for i, j in powers]
        return {tuple(sorted(inverse)): Fraction(weight) ** -k}


def _normal_form(e: Expr, limit: int, kept: frozenset[Expr] = frozenset()) -> tuple[Form | None, list[Expr]]:
    """Returns an expression as a polynomial of generators, and these generators; (None, …) if it is too long.

    Generators are the nodes that are not sums, products or integer powers, and the nodes in `kept`.
    """
    forms: dict[Expr, Form | None] = {}
    generators = _Generators()
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
            form = {(): _exact(node.data)} if math.isfinite(node.data) and node.data else ({} if node.data == 0 else None)
        elif isinstance(node, Add) and node not in kept:
            form = {}
            for c in node.children:
                part = forms[c]
                if part is None or form is None:
                    form = None
                    break
                for m, weight in part.items():
                    form[m] = form.get(m, 0) + weight
            if form is not None:
                form = {m: k for m, k in form.items() if k}
        elif isinstance(node, Mul) or (isinstance(node, Pow) and 0 < node.exponent <= (8 if len(forms[node.base] or ()) > 1 else 32)):
            form = {(): 1}
            for c in node.children if isinstance(node, Mul) else (node.base,) * node.exponent:
                part = forms[c]
                form = None if form is None or part is None else _product(form, part, 4 * limit)
        elif isinstance(node, Pow) and node.exponent < 0 and len(forms[node.base] or ()) == 1:
            form = generators.inverse(forms[node.base] or {}, -node.exponent)
        else:
            base, k = (node.base, node.exponent) if isinstance(node, Pow) else (node, 1)
            form = {((generators.index(base), k),): 1}
        forms[node] = form
    result = forms[e]
    return (None if result is None or len(result) > limit else result), generators.all
