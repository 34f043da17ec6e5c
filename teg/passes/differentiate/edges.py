"""Integrals over what no candidate covers, as integrals along the edges of the candidates: choices among smooth regions, however many.

    m(x, y) = [no candidate covers (x, y)],     ∂m/∂x = -Σ_k m_k·∂[c_k]/∂x,     m_k = [no other candidate covers]

    ∫∫ A·m dx dy        =  ∫ F(h, y)·m(h, y) dy + Σ_k ∫∫ F·m_k·∂[c_k]/∂x dx dy      ∂F/∂x = A, F = 0 at the lower bound
    ∂/∂t of ∫∫ A·m      =  ∫∫ ∂A/∂t·m - Σ_k ∫∫ A·m_k·∂[c_k]/∂t
    ∫ A(s)·m(s) ds      =  Σ over the gaps between covered intervals of ∫ A ds                                         `Gaps`

The nearest of candidates is one such integral a candidate, over where that holds and none of the others wins over it.

∂[c_k] holds δ, so what is left are integrals along edges, in one variable s, in which candidates cover intervals. The passes eliminate δ
without knowing what m is: a function of the coordinates without a body (`Slot`), in whose place the gaps come afterwards.

Beyond the upper bound A is 0, and h is a little beyond it: a disk that touches a side of the box hides a part of the line there whose
length is the root of a rounding.

Ties. Where the border of another candidate runs along an edge, candidates count as blown up a little, those of lower index more: of
equal edges the first one is seen, edges from opposite sides hide each other. Two surfaces of one candidate may be on the line.

A box of one variable is a line, whose gaps are the value; its edges are points, and whether something covers one is told by a line on
which nothing changes.

Cost: one term a program, however many candidates there are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, cast

from teg.analysis.antiderivative import integrated
from teg.analysis.calculus import slope
from teg.analysis.foci import with_common_focus
from teg.analysis.gates import are_apart, gates_of
from teg.analysis.surfaces import atoms_of
from teg.errors import NotDifferentiableError
from teg.ir.arrays import sum_over
from teg.ir.cells import Symbols, replace_integers, replaced
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, Add, Compare, Cond, Expr, Mul, Param, Var, Where, const
from teg.ir.function import Apply, Slot
from teg.ir.index import APART, IndexVar, index_const
from teg.ir.integral import Integral, PointMasses, integral_over
from teg.ir.node import Node, nodes_of, postorder
from teg.ir.operands import as_number, less
from teg.ir.simplify import add, bracket, call, conjunction, disjunction, integer_power, mul, negation, positive, sub, where
from teg.ir.still import with_still_parameters
from teg.ir.traverse import fresh, rewrite_below, substitute
from teg.ir.uncovered import ARC, ARCS, HALF, SHIFT, TURN, Uncovered, marks_of
from teg.passes.differentiate.gaps import Around, over_gaps, placed
from teg.passes.normalise.partitions import Refused

Derive = Callable[[Expr, Sequence[Param]], Sequence[Expr]]
"""The derivatives of a scalar expression by parameters, without δ."""
BEYOND = 0.0291
"""How far beyond a side of the box the line is that ends it, as a part of the length of the box: borders touch it by chance only."""
NEAR = 1e-9
"""How near to a surface, as a part of the size of the box, places are on it where borders run along each other."""


def values_along_edges(root: Expr, derive: Derive) -> dict[Node, Expr]:
    """Returns, for every integral over what is not covered, what it is along the edges of candidates. Raises Refused."""
    return {node: _value(node, derive) for node in postorder([root]) if isinstance(node, Uncovered)}


def _value(node: Uncovered, derive: Derive) -> Expr:
    if len(node.variables) == 1:
        return _over_interval(node)
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


def _over_interval(node: Uncovered) -> Expr:
    """Returns an integral over one variable, over the gaps that candidates leave. A function that ties along it is 0 everywhere."""
    (x,), ((lo, hi),) = node.variables, node.bounds
    as_written = {cast(Node, a): cast(Expr, FALSE if a.strict else TRUE) for a in atoms_of(node.condition)}
    (tie,) = replaced([bracket(node.condition)], as_written)
    over = node.index, node.lo, node.hi
    return over_gaps(Integral.make(x, (node.body, lo, hi)), Around(over, placed(node.condition, {x: x}), tie), node.body)


def _along_lines(e: Expr, derive: Derive) -> Expr:
    """Returns the derivative of an expression by the shift, where that is 0, as sums over gaps."""
    symbols = Symbols()
    (cell,) = symbols.into([e])
    (rate,) = derive(cell, [SHIFT])
    (still,) = replaced([rate], {SHIFT: ZERO})
    return symbols.out_of([with_gaps(still, derive)])[0]


def _seen(around: Around, variables: Sequence[Var]) -> Expr:
    """Returns 1 where nothing covers a place, else 0, as a function without a body."""
    n = len(variables)
    return Apply.make((Slot.make((0, n, n, None, (around, tuple(variables))), ()), (0,) * n), tuple(variables))


def _seen_beside(node: Uncovered, edge: _Surface, beyond: float) -> Expr:
    """Returns 1 where no other candidate covers an edge. Borders of distances are told from each other by the focus that they share, which
    is `chosen`: it moves with parameters once the edge has a chart, not by itself."""
    around, variables = _others(node, edge)._replace(beyond=beyond), node.variables
    if len(variables) != 2 or (shared := with_common_focus(around.condition, edge.g, (variables[0], variables[1]))) is None:
        return _seen(around, variables)
    condition, names, focus = shared
    n = len(variables) + len(names)
    callee = Slot.make((0, n, n, None, (around._replace(condition=condition), (*variables, *names))), ())
    return Apply.make((callee, (0,) * n), (*variables, *(call("chosen", e) for e in focus)))


def _before(node: Uncovered, x: Var, hi: Expr, length: Expr) -> Around:
    """Returns what covers the places just before the upper bound of the inner variable."""
    beside = _beside(node.condition, node, lambda g: mul(MINUS_ONE, length, _slope(g, x)))
    at = {x: hi}
    condition = placed(node.condition, at)
    tie = cast(Expr, substitute(bracket(beside), at))
    return Around((node.index, node.lo, node.hi), condition, tie, cast(Cond, substitute(node.within, at)))


# -- edges -------------------------------------------------------------------------------------------------------------


def edges_of(node: Uncovered, weight: Expr, moved: Param | None = None) -> Iterator[Expr]:
    """Yields, for each surface of the condition, an integral whose derivatives are those of a `weight` as the edges move that it makes;
    with `moved`, which shifts them along x, that derivative alone is meant."""
    y_x, bounds = node.variables, node.bounds

    def fixed(e: Expr) -> Expr:
        return e if moved is not None else with_still_parameters(e)

    for surface in _surfaces(node.condition, y_x):
        side = sub(*map(bracket, _sides(node.condition, surface)))
        beyond: Cond = surface.atoms[0]
        if moved is not None:
            beyond = cast(Cond, substitute(beyond, {y_x[-1]: add(y_x[-1], moved)}))
        seen = _seen_beside(node, surface, BEYOND if moved is None else 0.0)
        cell = mul(fixed(mul(weight, side)), seen, bracket(beyond))
        for v, (lo, hi) in reversed(list(zip(y_x, bounds, strict=True))):
            cell = integral_over(cell, v, fixed(lo), fixed(hi))
        counts = disjunction(*gates_of(node.condition, surface.atoms))
        yield where(counts, cell, ZERO)  # the border between a candidate and itself, which is none, has places that are no numbers


def inside_of(node: Uncovered) -> Expr:
    """Returns the integral of the body over what is not covered, a cell in which that does not move."""
    around = Around((node.index, node.lo, node.hi), node.condition, bracket(node.condition), node.within)
    cell = mul(node.body, _seen(around, node.variables))
    for v, (lo, hi) in reversed(list(zip(node.variables, node.bounds, strict=True))):
        cell = integral_over(cell, v, lo, hi)
    return cell


def _others(node: Uncovered, edge: _Surface) -> Around:
    """Returns what covers edges of candidates: the other ones."""
    k, variables = node.index, node.variables
    j = IndexVar.make(f"{k.name}{APART}other", ())
    theirs = cast(Cond, cast(Node, replace_integers(cast(Expr, node.condition), {k: j})))
    distance = sub(as_number(j), as_number(k))
    different = positive(sub(integer_power(distance, 2), const(0.25)))
    sense = _sense(node.condition, edge)

    def covering(sign: Expr) -> Cond:
        return _beside(theirs, node, lambda g: mul(sign, sense, _dot(edge.g, g, variables)))

    nothing = [_is_opposite(node, edge, own) for own in _surfaces(node.condition, variables) if own.g is not edge.g]
    wider = conjunction(covering(ONE), less(distance, ZERO, True))
    tie = bracket(conjunction(different, disjunction(covering(MINUS_ONE), wider, *nothing)))
    return Around((j, node.lo, node.hi), conjunction(different, theirs), tie, node.within)


def _is_opposite(node: Uncovered, edge: _Surface, other: _Surface) -> Cond:
    """Returns whether another surface of a candidate runs along its edge, and the candidate covers neither side there, or both: its two
    edges cancel, if both are seen or none is."""
    senses = (_sense(node.condition, surface) for surface in (edge, other))
    counts = disjunction(*gates_of(node.condition, other.atoms))
    return conjunction(counts, _on_line(other.g, node), positive(mul(MINUS_ONE, *senses, _dot(edge.g, other.g, node.variables))))


class _Surface(NamedTuple):
    """Where a function is 0, and the atoms of a condition that ask for its sign."""

    g: Expr
    atoms: tuple[Compare, ...]


def _surfaces(condition: Cond, variables: Sequence[Var]) -> list[_Surface]:
    """Returns the surfaces of a condition on which variables of integration are."""
    atoms: dict[Expr, list[Compare]] = {}
    for atom in atoms_of(condition):
        if not atom.free.isdisjoint(variables):
            atoms.setdefault(atom.g, []).append(atom)
    return [_Surface(g, tuple(of_g)) for g, of_g in atoms.items()]


def _holding(condition: Cond, surface: _Surface, holds: Cond) -> Cond:
    """Returns a condition where the atoms of a surface have a truth of their own."""
    return cast(Cond, replaced([cast(Expr, condition)], dict.fromkeys(surface.atoms, cast(Expr, holds)))[0])


def _sides(condition: Cond, surface: _Surface) -> tuple[Cond, Cond]:
    """Returns a condition where the function of a surface is above 0, and where it is below."""
    return _holding(condition, surface, TRUE), _holding(condition, surface, FALSE)


def _sense(condition: Cond, surface: _Surface) -> Expr:
    """Returns 1 if a condition holds on that side of a surface where its function is above 0, -1 if on the other one. That is how the
    condition is written: where the rest of it fails, neither side is covered. Raises Refused if it depends on more than integers."""
    with_it, against = gates_of(condition, surface.atoms)
    if FALSE in (with_it, against):
        return ONE if against is FALSE else MINUS_ONE
    if not are_apart(with_it, against):
        raise Refused("an edge of a candidate has it on either side")
    return where(with_it, ONE, MINUS_ONE)


def _beside(condition: Cond, node: Uncovered, ahead: Callable[[Expr], Expr]) -> Cond:
    """Returns a condition beside a line on which surfaces of it are: there the functions of these have the signs of `ahead`."""
    surfaces = _surfaces(condition, node.variables)
    truths: dict[Node, Expr] = {}
    for surface in surfaces:
        on_line = TRUE if len(surfaces) == 1 else _on_line(surface.g, node)
        sign = conjunction(on_line, positive(ahead(surface.g)))
        for atom in surface.atoms:
            truths[atom] = cast(Expr, disjunction(sign, conjunction(negation(on_line), atom)))
    return cast(Cond, replaced([cast(Expr, condition)], truths)[0])


def _on_line(g: Expr, node: Uncovered) -> Cond:
    """Returns whether places are on a surface, as far as can be told beside the size of the box."""
    lengths = add(*(integer_power(sub(hi, lo), 2) for lo, hi in node.bounds))
    return less(integer_power(g, 2), mul(const(NEAR**2), lengths, _dot(g, g, node.variables)), True)


def _dot(g: Expr, h: Expr, variables: Sequence[Var]) -> Expr:
    """Returns the product of the gradients of two functions."""
    return add(*(mul(_slope(g, v), _slope(h, v)) for v in variables))


def _slope(g: Expr, x: Var) -> Expr:
    try:
        return slope(g, x)
    except NotDifferentiableError as error:
        raise Refused(error.what) from None


# -- gaps --------------------------------------------------------------------------------------------------------------


def with_gaps(e: Expr, derive: Derive) -> Expr:
    """Returns an expression without δ in which sums over gaps stand for what may be covered. Raises Refused."""
    whole = _with_gaps(e, derive)
    if {TURN[0], HALF, ARC}.isdisjoint(nodes_of(Param, whole)):
        return whole
    for part, total in ((TURN, _sum_of_quarters), ((HALF,), _sum_of_halves), ((ARC,), _sum_of_arcs)):
        whole = _over_parts(whole, part, total)
    return whole


def _with_gaps(e: Expr, derive: Derive) -> Expr:
    """Returns the same for one part of each curve."""
    if not marks_of(e):
        return e

    def replacement(node: Node) -> Node | None:
        if not node.kinds & Apply.bit:
            return node
        if isinstance(node, Where) and not node.free and marks_of(node):
            return _of_branches(node, derive)
        if isinstance(node, Integral) and marks_of(node):
            inner = [n for n in postorder([node.body]) if isinstance(n, Integral) and marks_of(n)]
            return _of_nest(node, inner, derive) if inner else _of_integral(node)
        if isinstance(node, Apply) and marks_of(node)[-1:] == [node]:
            return _at_point(node)
        return None

    return cast(Expr, rewrite_below([e], replacement)[e])


def _over_parts(e: Expr, part: Sequence[Param], total: Callable[[Expr], Expr]) -> Expr:
    """Returns an expression in which the total over the parts of a curve stands for what was derived for one `part` of them."""
    turning: set[Node] = set()
    for node in postorder([e]):
        if node in part or any(c in turning for c in node.children):
            turning.add(node)

    def replacement(node: Node) -> Node | None:
        moving = sum(c in turning for c in node.children)
        above = (
            isinstance(node, Add) or (isinstance(node, Mul) and moving == 1) or (isinstance(node, Where) and node.condition not in turning)
        )
        return None if above and moving else total(cast(Expr, node)) if node in turning else node

    return cast(Expr, rewrite_below([e], replacement)[e])


def _sum_of_quarters(e: Expr) -> Expr:
    quarter = IndexVar.make(f"{APART}quarter", ())
    number = as_number(quarter)  # 0 to 3: the cosine is 1, 0, -1, 0
    cosine = sub(call("magnitude", sub(number, const(2.0))), ONE)
    sine = sub(ONE, call("magnitude", sub(number, ONE)))
    (turned,) = replaced([e], dict(zip(TURN, (cosine, sine), strict=True)))
    return sum_over(turned, quarter, index_const(0), index_const(4))


def _sum_of_halves(e: Expr) -> Expr:
    half = IndexVar.make(f"{APART}half", ())
    (there,) = replaced([e], {HALF: as_number(half)})
    return sum_over(there, half, index_const(0), index_const(2))


def _sum_of_arcs(e: Expr) -> Expr:
    arc = IndexVar.make(f"{APART}arc", ())
    (there,) = replaced([e], {ARC: as_number(arc)})
    return sum_over(there, arc, index_const(0), index_const(ARCS))


def _of_branches(node: Where, derive: Derive) -> Expr:
    """Returns a choice between charts, no number where the one that is taken cannot be followed: that of an ellipse which is a strip, or a
    million times as large as the box. Raises Refused if none can be, or if there is no other chart: what stands beside has no edge."""
    refused: list[Refused] = []
    branches: list[Expr] = []
    for branch in (node.then, node.otherwise):
        try:
            branches.append(_with_gaps(branch, derive))
        except Refused as reason:
            refused.append(reason)
            branches.append(const(math.nan))
    if refused and (len(refused) == 2 or not (marks_of(node.then) and marks_of(node.otherwise))):
        raise refused[0]
    return where(node.condition, *branches)


def _of_integral(node: Integral) -> Expr:
    marks = list(dict.fromkeys(marks_of(node.body)))
    if any(isinstance(n, PointMasses) for n in postorder([node.body])):
        raise Refused("an edge has no formula")
    (rest,) = replaced([node.body], dict.fromkeys(marks, ZERO))
    terms = [integral_over(rest, node.var, node.lo, node.hi)]
    for mark in marks:
        (with_it,) = replaced([node.body], {m: ONE if m is mark else ZERO for m in marks})
        weight = with_it if rest is ZERO else sub(with_it, rest)
        terms.append(over_gaps(node, _covering(mark), weight))
    return add(*terms)


def _at_point(mark: Apply) -> Expr:
    """Returns 1 where nothing covers a point, else 0: the length of what is not covered of a line on which nothing changes."""
    s = fresh("s", mark.free)
    return over_gaps(Integral.make(s, (ONE, ZERO, ONE)), _covering(mark), ONE)


def _covering(mark: Apply) -> Around:
    """Returns what may cover the place of a mark."""
    if any(mark.derivative):
        raise Refused("an edge has no chart")
    around, variables = cast(Slot, mark.callee).data[4]
    at = dict(zip(variables, mark.children, strict=True))
    return Around(around.over, placed(around.condition, at), cast(Expr, substitute(around.tie, at)), placed(around.within, at))


def _of_nest(node: Integral, inner: Sequence[Integral], derive: Derive) -> Expr:
    """Returns an integral over integrals of what may be covered."""
    (rest,) = replaced([node.body], dict.fromkeys(inner, ZERO))
    terms = [_with_gaps(integral_over(rest, node.var, node.lo, node.hi), derive)]  # a side of the box may stand in it
    for part in inner:
        marks = list(dict.fromkeys(marks_of(part.body)))
        (unmarked,) = replaced([part.body], dict.fromkeys(marks, ZERO))
        variables = (node.var, part.var)
        plain = unmarked is ZERO and not (part.lo.free | part.hi.free) and node.var not in node.lo.free | node.hi.free
        if not plain or len(marks) != 1 or marks[0].children[:2] != variables or any(marks[0].derivative):
            raise Refused("an integral over two variables is no longer one over a box")
        (body,) = replaced([part.body], {marks[0]: ONE})
        (whole,) = replaced([node.body], {other: body if other is part else ZERO for other in inner})
        around, names = cast(Slot, marks[0].callee).data[4]
        at = dict(zip(names, marks[0].children, strict=True))
        conditions = (cast(Cond, substitute(c, at)) for c in (around.condition, around.within))
        over = *around.over, variables
        weight = whole if rest is ZERO else sub(whole, rest)
        terms.append(_value(Uncovered.make(over, (*conditions, weight, node.lo, node.hi, part.lo, part.hi)), derive))
    return add(*terms)
