"""Integrals of a choice over a box as partitions of the unit square.

    ∫∫ f(nearest_k(v, g | c; o)) dx dy  =  W·H·∫∫ over the unit square of f(v) at the nearest of candidates, f(o) where there is none

with x = x₀ + W·u, y = y₀ + H·v. What is needed of a candidate are affine forms, (c, a, b) for c + a·u + b·v, and coefficients: the guards
of its condition, in disjunctive form; its key, of which only differences count, so a part that all candidates share is left out (|x|² of
|x - s|²); and the polynomial f(v). All are Taylor coefficients in the corner of the box: expressions of parameters, entries and the index,
which are differentiated like any others. One variable is two of which only the first occurs. Cost: a visit a node.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import distance
from teg.analysis.polynomial import Point, Shadow
from teg.errors import NotDifferentiableError
from teg.ir.arrays import Ranged, Sum, open_indices
from teg.ir.cells import Symbols, indices_apart, rename_indices, replace_integers, replaced
from teg.ir.choices import CHOICES, AnyOf, Nearest, Product, is_nothing
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, Add, And, Compare, Cond, Const, Expr, Not, Or, Var, const
from teg.ir.index import IndexConst, IndexGather, IndexParam, IndexVar, index_leaves
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.partition import Partition
from teg.ir.simplify import add, integer_power, mul, negation, where
from teg.ir.traverse import substitute
from teg.numerics.cells import MOST_DEGREE, MOST_GUARDS, Layout
from teg.passes.normalise.factors import with_single_factors
from teg.passes.normalise.piecewise import with_affine_atoms

MOST_PARTS = 16
NOTHING = 1e-140
"""What is taken from the form of an open condition: 0 everywhere is below 0 then, and other forms do not feel it. Its square is more
than 0."""
KEY_DEGREE = 4
MOST_WRITTEN: dict[type, int] = {Nearest: 24, Sum: 24, AnyOf: 256, Product: 256}
"""The longest ranges that are written out."""


class Refused(Exception):  # an answer to the caller, not an error
    """An integral of a choice is no partition, or cannot be followed along edges; `reason` says why."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class _Box(NamedTuple):
    """The variables of integration, the corner where they begin, and their lengths."""

    variables: tuple[Var, ...]
    corner: tuple[Expr, ...]
    lengths: tuple[Expr, ...]


def partitioned(node: Integral) -> Expr:
    """Returns an integral of choices as partitions. Raises Refused."""
    body, bounds = node.body, [(node.var, node.lo, node.hi)]
    if not any(isinstance(n, CHOICES) and n.free for n in postorder([node])):
        return node
    if isinstance(body, Add):
        return add(*(_term(c, bounds) for c in body.children))
    return _term(body, bounds)


def _term(body: Expr, bounds: Sequence[tuple[Var, Expr, Expr]]) -> Expr:
    """Returns the integral of one term over variables, outermost first."""
    if not any(isinstance(n, CHOICES) and n.free for n in postorder([body])):
        whole = body
        for x, lo, hi in reversed(bounds):
            whole = integral_over(whole, x, lo, hi)
        return whole
    if isinstance(body, Integral):
        if len(bounds) == 2:
            raise Refused("more than two integrals are around it")
        if body.lo.free or body.hi.free:
            raise Refused("a bound depends on another variable of integration")
        inner = [*bounds, (body.var, body.lo, body.hi)]
        return (
            add(*(_term(c, inner) for c in body.body.children))
            if isinstance(body.body, Add) and not _is_one(body.body)
            else _term(body.body, inner)
        )
    if any(isinstance(n, Integral) and n.free for n in postorder([body])):
        raise Refused("an integral stands beside it or in it")
    if isinstance(body, Add) and not _is_one(body):
        return add(*(_term(c, bounds) for c in body.children))
    for _, lo, hi in bounds:
        if any(isinstance(b, Const) and not math.isfinite(b.data) for b in (lo, hi)):
            raise Refused("a bound is infinite")
    box = _Box(tuple(x for x, _, _ in bounds), tuple(lo for _, lo, _ in bounds), tuple(distance(lo, hi) for _, lo, hi in bounds))
    return mul(*box.lengths, _partition(body, box))


class Choice(NamedTuple):
    """Candidates: their index and range as a node, key and condition, what the integrand is at one and where there is none."""

    over: Ranged
    key: Expr
    condition: Cond
    value: Expr
    otherwise: Expr


def _is_one(body: Expr) -> bool:
    try:
        one_choice(body)
    except Refused:
        return False
    return True


def one_choice(body: Expr) -> Choice:
    """Returns the one choice that an integrand depends on."""
    chosen = [n for n in postorder([body]) if isinstance(n, CHOICES) and n.free]
    inner = {c for n in chosen for c in postorder(n.children) if isinstance(c, CHOICES) and c.free}
    outermost = [n for n in chosen if n not in inner]
    if inner:
        raise Refused("a choice stands in another one")
    first = outermost[0]
    k = first.index
    at: dict[Node, Node] = {}
    none: dict[Node, Node] = {}
    kinds: dict[tuple[Expr, Expr], tuple[Expr, Expr]] = {}
    for n in outermost:
        same = {n.index: k}
        if (n.lo, n.hi) != (first.lo, first.hi):
            raise Refused("two choices have different ranges")
        match n:
            case Nearest():
                value, key, condition = (replace_integers(cast(Expr, c), same) for c in n.children[:3])  # type: ignore[arg-type]
                at[n], none[n] = value, n.otherwise
                kinds[rename_indices(key), rename_indices(condition)] = key, condition
            case AnyOf():
                at[n], none[n] = TRUE, FALSE
                condition = replace_integers(cast(Expr, n.condition), same)  # type: ignore[arg-type]
                kinds[ZERO, rename_indices(condition)] = ZERO, condition
            case _:
                raise Refused("it is a product of other factors than brackets and numbers")
    if len(kinds) > 1:
        raise Refused("two choices have different keys or conditions")
    ((key, condition),) = kinds.values()
    (value,) = replaced([body], cast("dict[Node, Expr]", at))
    (otherwise,) = replaced([body], cast("dict[Node, Expr]", none))
    return Choice(first, key, cast(Cond, cast(Node, condition)), value, otherwise)


def _partition(body: Expr, box: _Box) -> Expr:
    choice = one_choice(indices_apart(body))  # so that candidates of one choice can be written with the index of another
    k = choice.over.index
    factored = with_single_factors(choice.condition)
    condition, touching = with_affine_atoms(factored), factored is not choice.condition
    parts = disjunctive(condition)
    if len(parts) > 1 and ((condition is not factored and can_be_written_out(choice.over)) or (touching and _is_counted(choice.over))):
        raise Refused("alternatives that share borders or corners have no second derivatives")
    guards = max(1, *(len(p) for p in parts))
    numbers: list[Expr] = []
    for part in parts:
        for atom in part:
            numbers += _guard(atom, box)
        numbers += [ONE, ZERO, ZERO] * (guards - len(part))
    numbers += _key(choice.key, k, box)
    nothing = _has_nothing(choice.otherwise)
    degrees = [_degree(choice.value, box), 0 if nothing else _degree(choice.otherwise, box)]
    layout = Layout(len(parts), guards, max(degrees), touching=touching)
    numbers += _coefficients(choice.value, box, layout.degree)
    if nothing:
        others: list[Expr] = [const(math.nan), *[ZERO] * (layout.coefficients - 1)]
    else:
        others = _coefficients(choice.otherwise, box, layout.degree)
    over = choice.over
    return Partition.make((k, over.lo, over.hi, layout), (*numbers, *others))


def _has_nothing(e: Expr) -> bool:
    return any(isinstance(n, Expr) and is_nothing(n) for n in postorder([e]))


def can_be_written_out(over: Ranged) -> bool:
    """Returns whether the number of candidates is known, when a program is compiled or when it is called, and small."""
    if any(isinstance(i, IndexGather | IndexParam | IndexVar) for i in index_leaves([over.lo, over.hi])):
        return False
    return _is_counted(over) or not (isinstance(over.lo, IndexConst) and isinstance(over.hi, IndexConst))


def _is_counted(over: Ranged) -> bool:
    """Returns whether the number of candidates is known by now, and small."""
    counted = isinstance(over.lo, IndexConst) and isinstance(over.hi, IndexConst)
    return counted and over.hi.data - over.lo.data <= MOST_WRITTEN[type(over)]


# -- conditions --------------------------------------------------------------------------------------------------------


def disjunctive(condition: Cond) -> list[list[Cond]]:
    """Returns a condition as alternatives, each a list of atoms and negated atoms that hold together. Raises Refused if there are many."""
    order = [node for node in postorder([condition]) if isinstance(node, Cond)]
    asked: set[tuple[Node, bool]] = {(condition, True)}
    for node in reversed(order):
        for holds in (True, False):
            if (node, holds) in asked and isinstance(node, Not | And | Or) and node.free:
                asked.update((c, holds != isinstance(node, Not)) for c in node.children)
    done: dict[tuple[Node, bool], list[list[Cond]]] = {}
    for node in order:
        for holds in (True, False):
            if (node, holds) in asked:
                done[node, holds] = _alternatives(node, holds, done)
    parts = [list(dict.fromkeys(part)) for part in done[condition, True]]
    if not parts:
        return [[FALSE]]
    if len(parts) > MOST_PARTS or max(map(len, parts)) > MOST_GUARDS:
        raise Refused(f"its condition has more than {MOST_PARTS} alternatives or {MOST_GUARDS} atoms")
    return parts


def _alternatives(node: Cond, holds: bool, done: dict[tuple[Node, bool], list[list[Cond]]]) -> list[list[Cond]]:
    if not node.free:
        known = node if holds else negation(node)
        return [] if known is FALSE else [[]] if known is TRUE else [[known]]
    match node:
        case Not():
            return done[node.operand, not holds]
        case And() | Or():
            below = [done[c, holds] for c in node.children]
            if isinstance(node, Or) == holds:
                return [part for parts in below for part in parts]
            if math.prod(map(len, below)) > 4 * MOST_PARTS:
                raise Refused(f"its condition has more than {MOST_PARTS} alternatives")
            return [[c for part in choice for c in part] for choice in product(*below)]
        case Compare():
            return [[node if holds else Not.make(None, (node,))]]
        case _:
            raise Refused("its condition holds another choice")


def _guard(atom: Cond, box: _Box) -> list[Expr]:
    """Returns the affine form that is >= 0 where an atom holds. That of g > 0 is below 0 if g is 0 everywhere, as for a row of zeros."""
    if not atom.free:
        return [where(atom, ONE, MINUS_ONE), ZERO, ZERO]
    negated = isinstance(atom, Not)
    compare = cast(Compare, atom.operand if isinstance(atom, Not) else atom)
    g = mul(MINUS_ONE, compare.g) if negated else compare.g
    if _degree(g, box) > 1:
        raise Refused("a condition is not affine in the variables of integration")
    c, a, b = _form(g, box)
    if compare.strict == negated:
        return [c, a, b]
    return [add(c, const(-NOTHING)), a, b]


def _key(key: Expr, k: object, box: _Box) -> list[Expr]:
    """Returns the affine form whose differences between candidates are those of the key."""
    degree = _degree(key, box)
    if degree > KEY_DEGREE:
        raise Refused("a key is not affine in the variables of integration")
    if degree > 1:
        for exponents, c in zip(_monomials(degree), _coefficients(key, box, degree), strict=True):
            if sum(exponents) > 1 and not _is_shared(c, k):
                raise Refused("the difference of two keys is not affine in the variables of integration")
    return _form(key, box)


def _is_shared(e: Expr, k: object) -> bool:
    """Returns whether an expression has the same value for all candidates."""
    opened = open_indices(e)
    if k not in opened[e]:
        return True
    symbols = Symbols()
    (cell,) = symbols.into([e])
    leaves = [(s, k in open_indices(leaf)[leaf]) for leaf, s in symbols.of.items()]
    values = [
        Point(leaves={s: 1 + 7919 * i + salt * (31 + i) for i, (s, moves) in enumerate(leaves) if moves}).value(cell) for salt in (1, 2, 3)
    ]
    return values[0] is not None and values[0] == values[1] == values[2]


# -- Taylor coefficients -----------------------------------------------------------------------------------------------


def _degree(e: Expr, box: _Box) -> int:
    """Returns the degree of a polynomial in the variables of the box. Raises Refused for another expression."""
    if not e.free:
        return 0
    if any((isinstance(n, Compare) and n.free) or (isinstance(n, Sum | Integral) and n.free) for n in postorder([e])):
        raise Refused("a key, a condition or a value holds a condition, a sum or an integral over variables of integration")
    (cell,) = Symbols().into([e])
    degree = Shadow(box.variables).degree(cell)
    if degree is None:
        raise Refused("a key, a condition or a value is no polynomial in the variables of integration")
    if degree > MOST_DEGREE:
        raise Refused(f"a polynomial has a degree above {MOST_DEGREE}")
    return degree


def _form(e: Expr, box: _Box) -> list[Expr]:
    """Returns c, a, b of an affine function c + a·u + b·v."""
    c, *slopes = _coefficients(e, box, 1)
    return [c, *slopes]


def _monomials(degree: int) -> list[tuple[int, int]]:
    return [(total - j, j) for total in range(degree + 1) for j in range(total + 1)]


def _coefficients(e: Expr, box: _Box, degree: int) -> list[Expr]:
    """Returns the coefficients of a polynomial in u and v, Wⁱ·Hʲ/(i!·j!)·∂ⁱ⁺ʲe/∂xⁱ∂yʲ in the corner."""
    symbols = Symbols()
    (cell,) = symbols.into([e])
    corner = dict(zip(box.variables, symbols.into(list(box.corner)), strict=True))
    derivatives: dict[tuple[int, int], Expr] = {(0, 0): cell}
    found: list[Expr] = []
    for i, j in _monomials(degree):
        if (i, j) not in derivatives:
            if j and len(box.variables) == 1:
                derivatives[i, j] = ZERO
            else:
                before, by = ((i, j - 1), 1) if j else ((i - 1, j), 0)
                try:
                    derivatives[i, j] = slope(derivatives[before], box.variables[by])
                except NotDifferentiableError as error:  # a floor of constants of the box
                    raise Refused(error.what) from None
        at = cast(Expr, substitute(derivatives[i, j], corner))
        lengths = [integer_power(length, n) if n else ONE for length, n in zip(symbols.into(list(box.lengths)), (i, j), strict=False)]
        factor = const(1.0 / (math.factorial(i) * math.factorial(j)))
        found.append(mul(factor, *lengths, at))
    return symbols.out_of(found)
