"""Integrals of choices over a box of one or two variables as those over what no candidate covers.

    ∫∫ f(any_k c_k)               =   ∫∫ f(true) - ∫∫ (f(true) - f(false))·[no k has c_k]
    ∫∫ f(nearest_k(v, g | c; o))  =   Σ_k ∫∫ f(v_k)·[c_k and no j has c_j and g_j < g_k] + ∫∫ f(o)·[no k has c_k]

The brackets say that no candidate covers a place. In the sum, k covers what is outside of c_k, and j covers where it wins over k. Such an
integral is `Uncovered`, which is followed along the edges of candidates (`teg.passes.differentiate.edges`), however many there are. Cost:
a visit a node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.analysis.tails import is_unbounded
from teg.ir.arrays import Sum, sum_over
from teg.ir.cells import Symbols, indices_apart, replace_integers, replaced
from teg.ir.choices import CHOICES, NOTHING, AnyOf, is_nothing
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, Compare, Cond, Expr, Var, const
from teg.ir.index import APART, Index, IndexVar
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number, less
from teg.ir.simplify import add, call, conjunction, disjunction, integer_power, mul, negation, positive, sub, where
from teg.ir.still import has_still, with_still_parameters
from teg.ir.traverse import rewrite, substitute
from teg.ir.uncovered import Uncovered
from teg.passes.normalise.canonicalise import Canonical
from teg.passes.normalise.factors import with_single_factors
from teg.passes.normalise.partitions import NOTHING as NO_FORM
from teg.passes.normalise.partitions import Choice, Refused, one_choice
from teg.passes.normalise.piecewise import with_affine_atoms

PLACES = (0.2137, 0.3719), (0.5773, 0.8419), (0.8081, 0.1253)
"""Where in a box it is looked at whether two keys are the same function, as parts of its lengths."""
SAME, LEAST, NOISE = 2.0**-36, 1e-290, 2.0**-9
"""Of two keys that are the same function, one is made less by this part of their sizes, but by LEAST at least. They are the same if they
differ by less than the part NOISE of that."""
NO_AREA = 1e-13
"""What part of a box may be free, by rounding, where candidates cover all of it."""
Over = tuple[IndexVar, Index, Index]
Bounds = Sequence[tuple[Var, Expr, Expr]]


def over_uncovered(node: Integral) -> Expr:
    """Returns an integral of choices as one over what no candidate covers. Raises Refused."""
    bounds: list[tuple[Var, Expr, Expr]] = []
    body: Expr = node
    while isinstance(body, Integral) and _has_choice(body):
        if is_unbounded(body):
            raise Refused("a bound is infinite")
        if body.lo.free or body.hi.free:
            raise Refused("a bound depends on another variable of integration")
        bounds.append((body.var, body.lo, body.hi))
        body = body.body
    if len(bounds) > 2:
        raise Refused("it is over more than two variables")
    whole = add(*(_term(e, bounds) for e in (body.children if isinstance(body, Add) else (body,))))
    return _of_still_conditions(whole) if has_still(node) else whole


def _of_still_conditions(e: Expr) -> Expr:
    """Returns the expression in which each integral over what is not covered has a note that conditions of the user's do not move."""
    found = [n for n in postorder([e]) if isinstance(n, Uncovered)]
    return replaced([e], {n: cast(Expr, Uncovered.make((*n.data, True), n.children)) for n in found})[0]


def _has_choice(e: Expr) -> bool:
    return any(isinstance(n, CHOICES) and n.free for n in postorder([e]))


def _term(body: Expr, bounds: Bounds) -> Expr:
    if not _has_choice(body):
        return _nest(body, bounds)
    if any(isinstance(n, Integral | Sum) and n.free for n in postorder([body])):
        raise Refused("an integral or a sum stands beside it")
    choice = one_choice(indices_apart(body))
    variables = [x for x, _, _ in bounds]
    condition = _with_polynomials(with_affine_atoms(with_single_factors(choice.condition)), variables)
    choice = choice._replace(condition=_without_zeros(condition, variables))
    if isinstance(choice.over, AnyOf):
        free = _uncovered(_range_of(choice), choice.condition, sub(choice.value, choice.otherwise), bounds)
        return add(_nest(choice.value, bounds), mul(MINUS_ONE, free))
    return _of_nearest(choice, bounds)


def _uncovered(over: Over, condition: Cond, body: Expr, bounds: Bounds, within: Cond = TRUE) -> Expr:
    children = condition, within, body, *(end for _, lo, hi in bounds for end in (lo, hi))
    return cast(Expr, Uncovered.make((*over, tuple(x for x, _, _ in bounds)), children))


def _of_nearest(choice: Choice, bounds: Bounds) -> Expr:
    """Returns the integral as a sum over candidates k, each where it holds and no other one, j, wins over it."""
    over = choice.over
    name = over.index.name.split(APART)[0]
    j, k = (IndexVar.make(f"{name}{APART}{role}", ()) for role in ("rival", "winner"))
    value, key, condition = (replace_integers(e, {over.index: k}) for e in (choice.value, choice.key, cast(Expr, choice.condition)))
    rival_key, rival_condition = (replace_integers(e, {k: j}) for e in (key, condition))
    distance = sub(as_number(j), as_number(k))
    other, before = positive(sub(integer_power(distance, 2), const(0.25))), less(distance, ZERO, True)
    wins = _wins(rival_key, key, before, bounds)
    there = cast(Cond, cast(Node, rival_condition))
    covers = disjunction(conjunction(other, there, wins), conjunction(negation(other), negation(there)))
    whole = _uncovered((j, over.lo, over.hi), covers, value, bounds, cast(Cond, cast(Node, condition)))
    total = sum_over(whole, k, over.lo, over.hi)
    return add(total, _otherwise(choice, bounds))


def _with_polynomials(condition: Cond, variables: Sequence[Var]) -> Cond:
    """Returns a condition with polynomials where other functions of variables can be written so: a distance below a radius is a disk."""
    shadow, symbols, canonical = Shadow(tuple(variables)), Symbols(), Canonical()
    (cell,) = symbols.into([cast(Expr, condition)])

    def visit(old: Node, new: Node) -> Node:
        if not isinstance(old, Compare) or old.free.isdisjoint(variables) or shadow.degree(old.g) is not None:
            return new
        return canonical.atom(old.g, old.strict)

    return cast(Cond, symbols.out_of([cast(Expr, rewrite([cell], visit)[cell])])[0])


def _without_zeros(condition: Cond, variables: Sequence[Var]) -> Cond:
    """Returns a condition whose affine functions are not 0 everywhere, as those of rows of zeros are: g > 0 does not hold there."""
    shadow = Shadow(tuple(variables))

    def visit(_: Node, new: Node) -> Node:
        if not isinstance(new, Compare) or new.free.isdisjoint(variables) or shadow.degree(Symbols().into([new.g])[0]) != 1:
            return new
        is_line = positive(add(*(integer_power(slope(new.g, x), 2) for x in variables)))
        little = where(is_line, ZERO, const(-NO_FORM if new.strict else NO_FORM))
        return positive(add(new.g, with_still_parameters(little)), new.strict, new.resolution, new.rivals)

    return cast(Cond, rewrite([condition], visit)[condition])


def _wins(rival: Expr, key: Expr, before: Cond, bounds: Bounds) -> Cond:
    """Returns whether a rival wins over a candidate; `before` says whether its index is lower. Of keys that are the same function of the
    variables, that of the lower index is made a little less, so that their difference is nowhere 0."""
    variables = [x for x, _, _ in bounds]
    if rival.free.isdisjoint(variables):
        return disjunction(less(rival, key, True), conjunction(before, less(rival, key, False)))
    difference = sub(rival, key)
    steepness, distances, sizes = cast("tuple[list[Expr], ...]", ([], [], [const(LEAST)]))
    for part in PLACES:
        at = {x: add(lo, mul(const(part), sub(hi, lo))) for part, (x, lo, hi) in zip(part, bounds, strict=False)}
        steepness += [integer_power(cast(Expr, substitute(slope(difference, x), at)), 2) for x in variables]
        distances.append(call("magnitude", cast(Expr, substitute(difference, at))))
        sizes += [mul(const(SAME), call("magnitude", cast(Expr, substitute(e, at)))) for e in (rival, key)]
    near = less(add(*distances), mul(const(NOISE), add(*sizes)), True)
    same = conjunction(negation(positive(add(*steepness))), near)
    favour = where(same, mul(where(before, ONE, MINUS_ONE), add(*sizes)), ZERO)
    return less(rival, add(key, with_still_parameters(favour)), True)


def _range_of(choice: Choice) -> Over:
    return choice.over.index, choice.over.lo, choice.over.hi


def _otherwise(choice: Choice, bounds: Bounds) -> Expr:
    """Returns the integral over what no candidate covers; NaN if that is some place, and the program does not say what is chosen there."""
    if choice.condition is TRUE:
        length = sub(*(as_number(end) for end in (choice.over.hi, choice.over.lo)))
        return where(positive(length), ZERO, _nest(choice.otherwise, bounds))
    if not any(is_nothing(cast(Expr, n)) for n in postorder([choice.otherwise])):
        return _uncovered(_range_of(choice), choice.condition, choice.otherwise, bounds)
    box = mul(*(call("magnitude", sub(hi, lo)) for _, lo, hi in bounds))
    free = call("magnitude", _uncovered(_range_of(choice), choice.condition, ONE, bounds))
    return where(positive(sub(free, mul(const(NO_AREA), box))), NOTHING, ZERO)


def written(node: Uncovered) -> Expr:
    """Returns the integral with the choice in it."""
    covered = AnyOf.make((node.index, node.lo, node.hi), (node.condition,))
    bounds = [(x, lo, hi) for x, (lo, hi) in zip(node.variables, node.bounds, strict=True)]
    return _nest(mul(node.body, where(covered, ZERO, ONE)), bounds)


def _nest(body: Expr, bounds: Bounds) -> Expr:
    for x, lo, hi in reversed(bounds):
        body = integral_over(body, x, lo, hi)
    return body
