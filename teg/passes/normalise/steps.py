"""The steps of floor, written out: one bracket, or one cell, for each.

Inside the integrals that bind the variables of u, with k₀ < k₁ < … the integers that u passes over their ranges
(`teg.analysis.staircase`),

    linear       A + B·floor(u)  =  A + B·(k₀ - [u < k₀] + Σ_{j≥1} [u ≥ kⱼ])
    otherwise    F(floor(u))     =  Σⱼ [kⱼ ≤ u < kⱼ₊₁]·F(kⱼ)                F the whole summand: a condition, a product, an inner integral
                                 =  F(k₀) + Σⱼ [u ≥ kⱼ]·(F(kⱼ) - F(kⱼ₋₁))      where F has no variables but in its floors

mod(u, m) is u - m·floor(u/m), ceil(u) is -floor(-u), round(u) is floor(u + ½) but for the halves themselves. The brackets are ordinary
atoms, so breaks, jumps and sifting need to know nothing of steps. Several floors in one summand make a grid of cells.

The derivative of k₀ = floor(least u) by parameters is 0: the jumps of k₀ cancel against the step that enters or leaves. If the number of
steps depends on parameters, and may exceed the number that have code, the nest becomes

    where(u has no more steps, the nest with steps, the nest with floor)      the value exact, or to the tolerance; no derivative beyond

Linear in the number of cells times the size of the summand.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.intervals import enclose
from teg.analysis.jumps import jump
from teg.analysis.places import holding, linear_places, reached
from teg.analysis.staircase import Box, Range, Steps, between_integers, count_steps, is_step, with_floors
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, Call, Compare, Cond, Const, Expr, Var, called, calls_of
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, disjunction, mul, negation, positive, uncounted_floor, where
from teg.ir.traverse import fresh, rebuild, rename_apart, replace_node, size

MAX_CELLS = 1024
"""The largest number of cells of one summand."""
TOLD = 2
"""Cells are not written out if there would be this many times MAX_CELLS, assuming that all parts have as many as the first."""
MAX_WRITTEN = 20_000
"""The largest number of nodes of all cells if parameters decide how many there are: then most of them are empty."""
MAX_DEPTH = 32
"""The largest number of floors whose cells are nested."""

Env = tuple[tuple[Var, Range], ...]
Term = tuple[tuple[Cond, ...], Expr]
"""Conditions, and the value that is added where all of them hold."""
Known = tuple[Expr, Env]
"""A floor and the ranges of its variables."""


class _TooManyError(Exception):
    """There are more cells than MAX_CELLS."""


def enumerate_steps(root: Expr) -> Expr:
    """Returns the program without floor, mod, round and ceil of variables, wherever their steps can be counted. Its value is the same."""
    root = with_floors(root)
    if not any(map(is_step, calls_of(called("floor"), root))):
        return root
    return _Walk(cast(Expr, rename_apart(root))).run()


# -- the walk ------------------------------------------------------------------------------------------------------------


class _Walk:
    """The traversal: the ranges of the variables from the root downwards, the steps from the leaves upwards.

    A job is a node, the ranges of its free variables, and whether floors whose steps cannot be counted now are to stay floors.
    """

    def __init__(self, root: Expr) -> None:
        self.root = root
        self.holding: set[Node] = set()
        for node in postorder([root]):
            if is_step(node) or any([c in self.holding for c in node.children]):
                self.holding.add(node)
        self.given_up: set[Known] = set()

    def run(self) -> Expr:
        start = (self.root, (), False)
        done: dict[tuple[Node, Env, bool], tuple[Node, tuple[Cond, ...]]] = {}
        stack: list[tuple[Node, Env, bool]] = [start]
        while stack:
            job = stack[-1]
            node, env, plain = job
            if job in done:
                stack.pop()
                continue
            if node not in self.holding:
                done[job] = (node, ())
                stack.pop()
                continue
            inner = self._inside(node, env) if isinstance(node, Integral) else env
            jobs = [_job(c, inner if i == 0 else env, plain) for i, c in enumerate(node.children)]
            missing = [j for j in jobs if j not in done]
            if missing:
                stack.extend(missing)
                continue
            new = rebuild(node, tuple([done[j][0] for j in jobs]))
            guards = dict.fromkeys(g for j in jobs for g in done[j][1])
            if isinstance(new, Integral):
                summands = _Summands(new.var, Box(dict(inner)), plain, self.given_up)
                new = rebuild(new, (summands.of(new.body), new.lo, new.hi))
                guards.update(summands.guards)
                if guards and not env:
                    alternative = (node, env, True)
                    if alternative not in done:
                        stack.append(alternative)
                        continue
                    new = where(conjunction(*guards), cast(Expr, new), cast(Expr, done[alternative][0]))
                    guards = {}
            done[job] = (new, tuple(guards))
            stack.pop()
        return cast(Expr, done[start][0])

    def _inside(self, node: Integral, env: Env) -> Env:
        """Returns the ranges inside an integral; its variable has none if its bounds have no enclosure."""
        outer = tuple((v, r) for v, r in env if v is not node.var)
        if not node.lo.free and not node.hi.free:
            return (*outer, (node.var, Range(node.lo, node.hi)))
        box = {v: r.interval for v, r in env}
        try:
            ends = [enclose(b, box) for b in (node.lo, node.hi)]
        except NotDifferentiableError:
            return outer
        if any(e.free for pair in ends for e in pair):
            return outer
        hull = Range(call("min", ends[0][0], ends[1][0]), call("max", ends[0][1], ends[1][1]))
        return (*outer, (node.var, hull))


def _job(node: Node, env: Env, plain: bool) -> tuple[Node, Env, bool]:
    """Returns a job with only the data it depends on. An integral with nothing around it decides for itself which floors stay."""
    mine = tuple((v, r) for v, r in env if v in node.free)
    return node, mine, plain and not (isinstance(node, Integral) and not mine)


# -- summands ------------------------------------------------------------------------------------------------------------


class _Summands:
    """The summands of the integrand over one variable."""

    def __init__(self, var: Var, box: Box, plain: bool, given_up: set[Known]) -> None:
        self.var = var
        self.box = box
        self.plain = plain
        self.given_up = given_up
        self.guards: dict[Cond, None] = {}
        self._pending: dict[Cond, None] = {}
        self._cells = 0
        self._alike = 1  # the number of parts like the current one

    def of(self, body: Expr) -> Expr:
        """Returns the integrand with its steps written out."""
        parts: list[Expr] = []
        stack = [body]
        while stack:
            e = stack.pop()
            if isinstance(e, Add):
                stack.extend(reversed(e.children))
            else:
                parts.append(e)
        new = [self._summand(p) for p in parts]
        return body if new == parts else add(*new)

    def _summand(self, e: Expr) -> Expr:
        self._pending, self._cells, self._alike = {}, 0, 1
        if self._next(e, self.box) is None:
            return e
        try:
            terms = self._terms(e, self.box, False)
        except _TooManyError:
            return self._in_place(e)
        self.guards.update(self._pending)
        return add(*(where(conjunction(*conditions), value, ZERO) for conditions, value in terms))

    def _in_place(self, e: Expr) -> Expr:
        """Returns a summand with too many cells, kept whole: floors outside of conditions become sums of brackets; the others stay."""
        floors = [n for n in postorder([e]) if isinstance(n, Call) and is_step(n) and n.free <= self.box.ranges.keys()]
        counted = {n: count_steps(n.children[0], self.box) for n in floors}
        if None in counted.values() or any(_is_asked(e, n) for n in floors):
            self.given_up.update(_known(n, self.box) for n in floors)
            return e
        for n, steps in cast("dict[Call, Steps]", counted).items():
            if steps.guard is not TRUE and self.plain:
                e = cast(Expr, replace_node(e, n, uncounted_floor(n.children[0])))
                continue
            if steps.guard is not TRUE:
                self.guards[steps.guard] = None
            e = cast(Expr, replace_node(e, n, _sum_of_brackets(steps)))
        return e

    def _next(self, e: Expr, box: Box) -> tuple[Expr, bool] | None:
        """Returns the floor that is written out first, and whether its place is linear.

        It is the innermost floor in a non-linear place, of this variable or, inside a cell, of any; else the first one of this variable.
        """
        linear = None
        for floor, is_linear in linear_places(e, is_step).items():
            if not floor.free <= box.ranges.keys() or _known(floor, box) in self.given_up:
                continue
            if not is_linear and (self.var in floor.free or box.cells):
                return floor, False
            if linear is None and self.var in floor.free:
                linear = floor, True
        return linear

    def _terms(self, e: Expr, box: Box, nested: bool) -> list[Term]:
        """Returns e as a sum of terms. Only the first floor in a linear place makes terms of its own."""
        while (following := self._next(e, box)) is not None:
            floor, is_linear = following
            steps = count_steps(_argument(floor), box)
            if steps is None:
                self.given_up.add(_known(floor, box))
            elif steps.guard is not TRUE and self.plain:
                e = cast(Expr, replace_node(e, floor, uncounted_floor(_argument(floor))))
            elif not steps.over:
                e = cast(Expr, replace_node(e, floor, steps.level(0)))
            else:
                if steps.guard is not TRUE:
                    self._pending[disjunction(negation(reached(e, floor)), steps.guard)] = None
                if not is_linear:
                    return self._grid(e, floor, steps, box)
                if not nested:
                    return self._brackets(e, floor, steps, box)
                e = cast(Expr, replace_node(e, floor, _sum_of_brackets(steps)))
        self._cells += 1
        if self._cells > MAX_CELLS:
            raise _TooManyError
        return [((), e)]

    def _brackets(self, e: Expr, floor: Expr, steps: Steps, box: Box) -> list[Term]:
        """Returns the terms of e = A + B·floor: from the step nearest to 0 (or from the base) brackets upwards and downwards."""
        mark = fresh("⌊⌋", e.free)
        rate = jump(cast(Expr, replace_node(e, floor, where(positive(mark), ONE, ZERO))), mark)
        constant = cast(Expr, replace_node(e, floor, ZERO))
        origin = _nearest_to_zero(steps)
        terms = self._terms(add(constant, mul(steps.level(origin), rate)), box, True)
        inner = self._terms(rate, box, True)
        self._cells += len(inner) * (len(steps.over) - 1)
        for i, over in enumerate(steps.over):
            if i >= origin:
                terms += [((over, *c), value) for c, value in inner]
            else:
                terms += [((negation(over), *c), mul(MINUS_ONE, value)) for c, value in inner]
        return terms

    def _grid(self, e: Expr, floor: Expr, steps: Steps, box: Box) -> list[Term]:
        """Returns one cell a step; if all cells are free of variables, their differences at the steps, unless these are longer."""
        if len(box.cells) >= MAX_DEPTH:
            raise _TooManyError
        order = holding(e, floor)
        levels = [steps.level(i) for i in range(len(steps.over) + 1)]
        outside, self._alike = self._alike, self._alike * len(levels)
        inner: list[list[Term]] = []
        for k in levels:
            inner.append(self._terms(_with_value(order, floor, k), box.cell(_argument(floor), k), True))
            cells = len(inner[0]) * self._alike
            written = self._alike * sum(size(value) for _, value in inner[0]) if steps.guard is not TRUE else 0
            if cells > TOLD * MAX_CELLS or written > MAX_WRITTEN:
                raise _TooManyError
        self._alike = outside
        every = _cells(inner, steps.over)
        if any(value.free for _, value in every):
            return every
        differences = _differences(inner, steps.over, 0 if isinstance(steps.base, Const) else 1)
        return min(differences, every, key=lambda terms: sum(len(conditions) for conditions, _ in terms))


def _nearest_to_zero(steps: Steps) -> int:
    """Returns the level with the smallest number; that of the base if it is not a number."""
    if not isinstance(steps.base, Const):
        return 1
    return max(0, min(len(steps.over), 1 - int(steps.base.data)))


def _sum_of_brackets(steps: Steps) -> Expr:
    origin = _nearest_to_zero(steps)
    downwards = (where(over, ZERO, MINUS_ONE) for over in steps.over[:origin])
    return add(steps.level(origin), *downwards, *(where(over, ONE, ZERO) for over in steps.over[origin:]))


def _cells(inner: Sequence[list[Term]], over: Sequence[Cond]) -> list[Term]:
    """Returns Σᵢ [over i - 1, not over i]·innerᵢ. Equal neighbours are one cell."""
    terms: list[Term] = []
    first = 0
    for i, mine in enumerate(inner):
        if i + 1 < len(inner) and inner[i + 1] == mine:
            continue
        above = (over[first - 1],) if first > 0 else ()
        below = (negation(over[i]),) if i < len(over) else ()
        terms += [((*above, *below, *c), value) for c, value in mine]
        first = i + 1
    return terms


def _differences(inner: Sequence[list[Term]], over: Sequence[Cond], origin: int) -> list[Term]:
    """Returns the same with one bracket a step: the changes, upwards and downwards from a cell that is certainly met."""
    terms = list(inner[origin])
    for i, step in enumerate(over):
        near, far, side = (inner[i], inner[i + 1], step) if i >= origin else (inner[i + 1], inner[i], negation(step))
        change: dict[tuple[Cond, ...], Expr] = {}
        for sign, part in ((ONE, far), (MINUS_ONE, near)):
            for c, value in part:
                change[c] = add(change.get(c, ZERO), mul(sign, value))
        terms += [((side, *c), value) for c, value in change.items() if value is not ZERO]
    return terms


def _argument(floor: Expr) -> Expr:
    return cast(Expr, floor.children[0])


def _known(floor: Expr, box: Box) -> Known:
    return floor, tuple((v, r) for v, r in box.ranges.items() if v in floor.free)


def _is_asked(root: Node, floor: Node) -> bool:
    """Returns whether a condition, or the argument of another floor, contains the floor."""
    return any(isinstance(n, Compare) or is_step(n) for n in holding(root, floor))


def _with_value(order: Sequence[Node], floor: Expr, value: Expr) -> Expr:
    """Returns the last node of `order` with a value in place of the floor."""
    new: dict[Node, Node] = {floor: value}
    for node in order:
        result = rebuild(node, tuple([new.get(c, c) for c in node.children]))
        new[node] = between_integers(result) if isinstance(result, Compare) and result is not node else result
    return cast(Expr, new[order[-1]])
