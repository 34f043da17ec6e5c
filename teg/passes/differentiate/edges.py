"""Integrals over what no candidate covers, as integrals along the edges of the candidates: `teg.any` of smooth regions, however many.

    m(x, y) = [no candidate covers (x, y)],     ∂m/∂x = -Σ_k m_k·∂[c_k]/∂x,     m_k = [no other candidate covers]

    ∫∫ A·m dx dy        =  ∫ F(h, y)·m(h, y) dy + Σ_k ∫∫ F·m_k·∂[c_k]/∂x dx dy      ∂F/∂x = A, F = 0 at the lower bound
    ∂/∂t of ∫∫ A·m      =  ∫∫ ∂A/∂t·m - Σ_k ∫∫ A·m_k·∂[c_k]/∂t
    ∫ A(s)·m(s) ds      =  Σ over the gaps between covered intervals of ∫ A ds                                         `Gaps`

∂[c_k] holds δ, so what is left are integrals along edges, in one variable s, in which candidates cover intervals. The passes eliminate δ
without knowing what m is: a function of the coordinates without a body (`Slot`), in whose place the gaps come afterwards.

Beyond the upper bound A is 0, and h is a little beyond it: a disk that touches a side of the box hides a part of the line there whose
length is the root of a rounding.

Ties. Where the border of another candidate runs along an edge, candidates count as blown up a little, those of lower index more: of
equal edges the first one is seen, edges from opposite sides hide each other.

Cost: one term a program, however many candidates there are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple, cast

from teg.analysis.antiderivative import integrated
from teg.analysis.calculus import slope
from teg.analysis.half_angle import in_half_angle
from teg.analysis.isolation import isolate
from teg.analysis.roots import solve
from teg.analysis.surfaces import atoms_of, ordered
from teg.analysis.tails import is_unbounded
from teg.errors import NotDifferentiableError
from teg.ir.arrays import sum_over
from teg.ir.cells import APART, Symbols, replace_integers, replaced
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, And, Compare, Cond, Const, Expr, Not, Or, Param, Var, Where, const
from teg.ir.function import Apply, Slot
from teg.ir.index import Index, IndexVar
from teg.ir.integral import Integral, PointMasses, integral_over
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number, less
from teg.ir.show import show
from teg.ir.simplify import add, bracket, call, conjunction, disjunction, integer_power, mul, negation, positive, sub, where
from teg.ir.still import with_still_parameters
from teg.ir.traverse import fresh, rewrite, rewrite_below, substitute
from teg.ir.uncovered import Gaps, Uncovered
from teg.passes.normalise.partitions import Refused

Derive = Callable[[Expr, Sequence[Param]], Sequence[Expr]]
"""The derivatives of a scalar expression by parameters, without δ."""
SHIFT = Param.make(f"{APART}shift", ())
BEYOND = 0.0291
"""How far beyond a side of the box the line is that ends it, as a part of the length of the box: borders touch it by chance only."""
SHOWN = 60
MOST_PLACES = 8
"""The largest number of places where the border of one candidate may cross an edge of another one."""
LEFT, RIGHT = Param.make(f"{APART}left", ()), Param.make(f"{APART}right", ())


class _Around(NamedTuple):
    """What covers places: an index and its range, the condition, and the same where it ties, as a number."""

    over: tuple[IndexVar, Index, Index]
    condition: Cond
    tie: Expr


def along_edges(root: Expr, derive: Derive) -> dict[Node, Expr]:
    """Returns, for every integral over what is not covered, what it is along the edges of candidates. Raises Refused."""
    return {node: _value(node, derive) for node in postorder([root]) if isinstance(node, Uncovered)}


def _value(node: Uncovered, derive: Derive) -> Expr:
    (y, x), ((low, high), (lo, hi)) = node.variables, node.bounds
    length = sub(hi, lo)
    far = add(hi, mul(const(BEYOND), length))
    u = fresh(x.name, [x, y, *node.body.free])
    inner = Integral.make(u, (cast(Expr, substitute(node.body, {x: u})), lo, x))
    known = integrated(inner)
    reached = inner if known is None else known
    whole, wider = cast(Expr, substitute(reached, {x: hi})), Uncovered.make(node.data, (*node.children[:-1], far))
    inside = where(positive(mul(sub(hi, x), length)), x, hi)
    within = reached if known is not None else cast(Expr, substitute(reached, {x: inside}))
    after = sub(whole, reached) if known is not None else ZERO  # 0 at the bound: which side of it an edge along it is on does not matter
    parts = (wider, within), (Uncovered.make(node.data, (*node.children[:-2], hi, far)), after)
    line = integral_over(mul(whole, _seen(_before(node, x, far, length), (y,))), y, low, high)
    terms = [_along_lines(mul(SHIFT, line), derive)]
    for edges in zip(*(edges_of(part, weight, SHIFT) for part, weight in parts), strict=True):
        terms.append(sum_over(_along_lines(add(*edges), derive), node.index, node.lo, node.hi))
    return add(*terms)


def _along_lines(e: Expr, derive: Derive) -> Expr:
    """Returns the derivative of an expression by the shift, where that is 0, as sums over gaps."""
    symbols = Symbols()
    (cell,) = symbols.into([e])
    (rate,) = derive(cell, [SHIFT])
    (still,) = replaced([rate], {SHIFT: ZERO})
    return symbols.out_of([with_gaps(still, derive)])[0]


def _seen(around: _Around, variables: Sequence[Var]) -> Expr:
    """Returns 1 where nothing covers a place, else 0, as a function without a body."""
    n = len(variables)
    return Apply.make((Slot.make((0, n, n, None, (around, tuple(variables))), ()), (0,) * n), tuple(variables))


def _before(node: Uncovered, x: Var, hi: Expr, length: Expr) -> _Around:
    """Returns what covers the places just before the upper bound of the inner variable."""

    def truth(atom: Compare) -> Cond:
        return positive(mul(MINUS_ONE, length, _slope(atom.g, x)))

    at = {x: hi}
    condition = _placed(node.condition, at)
    return _Around((node.index, node.lo, node.hi), condition, cast(Expr, substitute(_at_tie(node.condition, truth, node.variables), at)))


def _placed(condition: Cond, at: Mapping[Var, Expr]) -> Cond:
    """Returns a condition at places, where each of its surfaces may tie."""

    def tying(old: Compare, g: Expr, _: Cond | None) -> Cond:
        return positive(g, old.strict, TRUE, old.rivals or (show(old.g, SHOWN), "the edge of another candidate"))

    return cast(Cond, substitute(condition, at, tying))


# -- edges -------------------------------------------------------------------------------------------------------------


def edges_of(node: Uncovered, weight: Expr, moved: Param | None = None) -> Iterator[Expr]:
    """Yields, for each atom of the condition, an integral whose derivatives are those of a `weight` as the edges move that the atom makes;
    with `moved`, which shifts them along x, that derivative alone is meant."""
    y_x, bounds = node.variables, node.bounds

    def fixed(e: Expr) -> Expr:
        return e if moved is not None else with_still_parameters(e)

    for atom in atoms_of(node.condition):
        if atom.free.isdisjoint(y_x):
            continue
        side = sub(*map(bracket, _sides(node.condition, atom)))
        surface: Cond = atom
        if moved is not None:
            surface = cast(Cond, substitute(atom, {y_x[-1]: add(y_x[-1], moved)}))
        cell = mul(fixed(mul(weight, side)), _seen(_others(node, atom), y_x), bracket(surface))
        for v, (lo, hi) in reversed(list(zip(y_x, bounds, strict=True))):
            cell = integral_over(cell, v, fixed(lo), fixed(hi))
        yield cell


def inside_of(node: Uncovered) -> Expr:
    """Returns the integral of the body over what is not covered, a cell in which that does not move."""
    around = _Around((node.index, node.lo, node.hi), node.condition, bracket(node.condition))
    cell = mul(node.body, _seen(around, node.variables))
    for v, (lo, hi) in reversed(list(zip(node.variables, node.bounds, strict=True))):
        cell = integral_over(cell, v, lo, hi)
    return cell


def _others(node: Uncovered, atom: Compare) -> _Around:
    """Returns what covers edges of candidates: the other ones."""
    k, variables = node.index, node.variables
    j = IndexVar.make(f"{k.name}{APART}other", ())
    theirs = cast(Cond, cast(Node, replace_integers(cast(Expr, node.condition), {k: j})))
    distance = sub(as_number(j), as_number(k))
    different = positive(sub(integer_power(distance, 2), const(0.25)))

    def truth(other: Compare) -> Cond:
        either, both = _either_and_both(theirs, other)
        dot = add(*(mul(_slope(atom.g, v), _slope(other.g, v)) for v in variables))
        same = positive(mul(dot, _sense(node.condition, atom), _sense(theirs, other)))
        wider = disjunction(negation(same), less(distance, ZERO, True))
        return disjunction(both, conjunction(either, wider))

    tie = where(different, _at_tie(theirs, truth, variables, whole=True), ZERO)
    return _Around((j, node.lo, node.hi), conjunction(different, theirs), tie)


def _sense(condition: Cond, atom: Compare) -> Expr:
    """Returns 1 if a condition holds on that side of an atom where the atom does, -1 if on the other one: as it is written, for where the
    rest of the condition fails neither side has anything to cover. Raises Refused if it depends on the rest."""
    senses: dict[Node, set[float]] = {condition: {1.0}}
    for node in reversed(postorder([condition])):
        for child in node.children if isinstance(node, And | Or | Not) else ():
            senses.setdefault(child, set()).update(-s if isinstance(node, Not) else s for s in senses[node])
    if len(senses.get(atom, ())) != 1:
        raise Refused("an edge of a candidate has it on either side")
    return const(next(iter(senses[atom])))


def _either_and_both(condition: Cond, atom: Compare) -> tuple[Cond, Cond]:
    """Returns whether a condition holds on either side of an atom, and whether on both."""
    sides = _sides(condition, atom)
    return disjunction(*sides), conjunction(*sides)


def _sides(condition: Cond, atom: Compare) -> tuple[Cond, Cond]:
    """Returns a condition where an atom of it holds, and where it does not."""
    holds, fails = (cast(Cond, replaced([cast(Expr, condition)], {atom: cast(Expr, t)})[0]) for t in (TRUE, FALSE))
    return holds, fails


def _at_tie(condition: Cond, truth: Callable[[Compare], Cond], variables: Sequence[Var], whole: bool = False) -> Expr:
    """Returns a condition, as 1 or 0, where one of its atoms is 0 all along a line: the nearest one has a truth of its own.

    With `whole`, that is the truth of the condition.
    """
    atoms = [a for a in atoms_of(condition) if not a.free.isdisjoint(variables)]
    value: Expr = bracket(condition)
    nearest: Expr | None = None
    for atom in atoms:
        settled = truth(atom)
        if not whole:
            settled = cast(Cond, replaced([cast(Expr, condition)], {atom: cast(Expr, settled)})[0])
        steepness = add(*(integer_power(_slope(atom.g, v), 2) for v in variables))
        distance = mul(integer_power(atom.g, 2), integer_power(steepness, -1)) if len(atoms) > 1 else ZERO
        closer = TRUE if nearest is None else positive(sub(nearest, distance))
        value = where(closer, bracket(settled), value)
        nearest = distance if nearest is None else where(closer, distance, nearest)
    return value


def _slope(g: Expr, x: Var) -> Expr:
    try:
        return slope(g, x)
    except NotDifferentiableError as error:
        raise Refused(error.what) from None


# -- gaps --------------------------------------------------------------------------------------------------------------


def _marked(root: Node) -> list[Apply]:
    """Returns the places in an expression that candidates may cover."""
    return [n for n in postorder([root]) if isinstance(n, Apply) and isinstance(n.callee, Slot) and len(n.callee.data) > 4]


def with_gaps(e: Expr, derive: Derive) -> Expr:
    """Returns an expression without δ in which sums over gaps stand for what may be covered. Raises Refused."""
    if not _marked(e):
        return e

    def replacement(node: Node) -> Node | None:
        if isinstance(node, Where) and not node.free and _marked(node):
            return _of_branches(node, derive)
        if isinstance(node, Integral) and _marked(node):
            inner = [n for n in postorder([node.body]) if isinstance(n, Integral) and _marked(n)]
            return _of_nest(node, inner, derive) if inner else _of_integral(node)
        if isinstance(node, Apply) and _marked(node)[-1:] == [node]:
            raise Refused("a corner of the box moves over candidates")
        return None

    return cast(Expr, rewrite_below([e], replacement)[e])


def _of_branches(node: Where, derive: Derive) -> Expr:
    """Returns a choice between charts, no number where the one that is taken cannot be followed: that of an ellipse which is a strip, or a
    million times as large as the box."""
    refused: list[Refused] = []
    branches: list[Expr] = []
    for branch in (node.then, node.otherwise):
        try:
            branches.append(with_gaps(branch, derive))
        except Refused as reason:
            refused.append(reason)
            branches.append(const(math.nan))
    if len(refused) == 2:
        raise refused[0]
    return where(node.condition, *branches)


def _of_integral(node: Integral) -> Expr:
    marks = list(dict.fromkeys(_marked(node.body)))
    if any(isinstance(n, PointMasses) for n in postorder([node.body])):
        raise Refused("an edge has no formula")
    (rest,) = replaced([node.body], dict.fromkeys(marks, ZERO))
    terms = [integral_over(rest, node.var, node.lo, node.hi)]
    for mark in marks:
        (with_it,) = replaced([node.body], {m: ONE if m is mark else ZERO for m in marks})
        weight = with_it if rest is ZERO else sub(with_it, rest)
        around, variables = cast(Slot, mark.callee).data[4]
        if any(mark.derivative):
            raise Refused("an edge has no chart")
        at = dict(zip(variables, mark.children, strict=True))
        placed = around._replace(condition=_placed(around.condition, at), tie=cast(Expr, substitute(around.tie, at)))
        terms.append(_over_gaps(node, placed, weight))
    return add(*terms)


def _of_nest(node: Integral, inner: Sequence[Integral], derive: Derive) -> Expr:
    """Returns an integral over integrals of what may be covered."""
    (rest,) = replaced([node.body], dict.fromkeys(inner, ZERO))
    terms = [integral_over(rest, node.var, node.lo, node.hi)]
    for part in inner:
        marks = list(dict.fromkeys(_marked(part.body)))
        (unmarked,) = replaced([part.body], dict.fromkeys(marks, ZERO))
        variables = (node.var, part.var)
        plain = unmarked is ZERO and not (part.lo.free | part.hi.free) and node.var not in node.lo.free | node.hi.free
        if not plain or len(marks) != 1 or marks[0].children != variables or any(marks[0].derivative):
            raise Refused("an integral over two variables is no longer one over a box")
        (body,) = replaced([part.body], {marks[0]: ONE})
        (whole,) = replaced([node.body], {other: body if other is part else ZERO for other in inner})
        around, names = cast(Slot, marks[0].callee).data[4]
        condition = cast(Cond, substitute(around.condition, dict(zip(names, variables, strict=True))))
        over = *around.over, variables
        weight = whole if rest is ZERO else sub(whole, rest)
        terms.append(_value(Uncovered.make(over, (condition, weight, node.lo, node.hi, part.lo, part.hi)), derive))
    return add(*terms)


def _over_gaps(node: Integral, around: _Around, weight: Expr) -> Expr:
    """Returns the integral of a weight over what is not covered of the range of an integral."""
    s, lo, hi = node.var, node.lo, node.hi
    if weight is ZERO:
        return ZERO
    if is_unbounded(node):
        raise Refused("a bound is infinite")
    symbols = Symbols()
    (cell, tie) = symbols.into([cast(Expr, around.condition), around.tie])
    by_half_angle = _by_half_angle(_OnLine(cast(Cond, cell), tie, weight), s) if _turns_less_than_once(lo, hi) else None
    condition, tie, weight = by_half_angle or _OnLine(cast(Cond, cell), tie, weight)
    _check_roots([atom.g for atom in atoms_of(condition, s)], s)
    order = ordered(lo, hi)
    first, last = (lo, hi) if order > 0 else (hi, lo) if order < 0 else (call("min", lo, hi), call("max", lo, hi))
    sign = const(float(order)) if order else where(less(hi, lo, True), MINUS_ONE, ONE)
    if by_half_angle is not None:
        first, last = (call("tan", mul(const(0.5), end)) for end in (first, last))
    covered, tie = symbols.out_of([bracket(condition), tie])
    over = *around.over, s, LEFT, RIGHT
    return mul(sign, cast(Expr, Gaps.make(over, (first, last, covered, tie, integral_over(weight, s, LEFT, RIGHT)))))


def _check_roots(functions: Sequence[Expr], s: Var) -> None:
    """Raises Refused if the roots of functions cannot be found along a line, or may be many."""
    count = 0
    for g in functions:
        isolation = None if any(isinstance(n, Integral) for n in postorder([g])) else isolate(g, s)
        if isolation is None:
            raise Refused("a condition has no roots that can be found along an edge")
        known = solve(g, s, LEFT, RIGHT)
        count += len(known.found) if known is not None and known.certain else isolation.count
    if count > MOST_PLACES:
        raise Refused(f"its border may cross an edge in more than {MOST_PLACES} places")


def _turns_less_than_once(lo: Expr, hi: Expr) -> bool:
    return all(isinstance(end, Const) and abs(end.data) < 0.99 * math.pi for end in (lo, hi))


class _OnLine(NamedTuple):
    """What covers places of a line, the same where it ties, and the weight of places."""

    condition: Cond
    tie: Expr
    weight: Expr


def _by_half_angle(on_arc: _OnLine, angle: Var) -> _OnLine | None:
    """Returns the same by the tangent of half the angle, in which conditions are polynomials; None if the angle occurs elsewhere than in
    its cosine and sine, or in other functions of these than polynomials in a condition."""
    c, s = (fresh(name, frozenset().union(*(e.free for e in on_arc))) for name in ("cos", "sin"))
    circular: dict[Node, Node] = {call("cos", angle): c, call("sin", angle): s}
    on_circle = rewrite(on_arc, lambda _, new: circular.get(new, new))
    condition = cast(Cond, on_circle[on_arc.condition])
    tie, weight = (cast(Expr, on_circle[e]) for e in on_arc[1:])
    half, mark = mul(const(0.5), angle), fresh("half", [c, s, angle])
    short = call("sqrt", integer_power(add(ONE, integer_power(mark, 2)), -1))
    halves: dict[Node, Node] = {call("tan", half): mark, call("sin", half): mul(mark, short), call("cos", half): short}
    weight = cast(Expr, rewrite([weight], lambda _, new: halves.get(new, new))[weight])
    if condition.free.isdisjoint((c, s)) or any(angle in e.free for e in (condition, tie, weight)):
        return None
    known = True

    def visit(_: Node, new: Node) -> Node:
        nonlocal known
        if not isinstance(new, Compare) or new.free.isdisjoint((c, s)):
            return new
        polynomial = in_half_angle(new.g, c, s, angle)
        known &= polynomial is not None
        return new if polynomial is None else positive(polynomial, new.strict, new.resolution, new.rivals)

    condition = cast(Cond, rewrite([condition], visit)[condition])
    z = integer_power(add(ONE, integer_power(angle, 2)), -1)
    at: dict[Var, Expr] = {c: sub(mul(const(2.0), z), ONE), s: mul(const(2.0), angle, z), mark: angle}
    tie, weight = (cast(Expr, substitute(e, at)) for e in (tie, weight))
    return _OnLine(condition, tie, mul(const(2.0), z, weight)) if known else None
