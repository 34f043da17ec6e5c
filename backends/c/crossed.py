"""Points that surfaces cross, side by side: a program of polygons and segments without branches.

    crossed(program)  ->  Crossed      the outputs, and `good`: whether they are right (printed by `stages`)

Polygons are weights of fixed nodes of their boxes (`crossing`), segments intervals that are cut by selects, or the chords of the polygon
whose sides they are (`sides`); everything else is arithmetic in the program already. A point with a tie, a thin triangle, a line along a
side or a number that is not finite is not good, and is computed by the program as it is. So are estimates of errors, whose integrands are
no polynomials.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from math import isnan

from teg.backends.c.crossing import MOST_DEGREE, MOST_LINES, STOUT, Crossing, Writer, crossing, nodes_of, weights
from teg.backends.c.expanded import integrals
from teg.backends.c.items import Item, Nodes, needed
from teg.backends.c.polygon import SIDE_BY_SIDE
from teg.backends.c.sides import Side, side_of
from teg.numerics.quadrature import gauss_legendre
from teg.program import NEARLY, TIE_EPS, Arg, Assign, Polygon, Program, Segment, Stmt, When, assigned, statements
from teg.program.fields import absent
from teg.program.names import unused_numbers
from teg.program.residues import Residues, random_residue

SIDE = 8
"""Points side by side."""
TOGETHER = 160
"""Statements of the nodes that are computed in one iteration of their loop, about."""
LONGEST = 5000
"""Statements of a straight line with each loop over nodes counted once."""
MOST = 1600
"""Statements of a program that is looked at."""
MOST_APART = 4
"""Half-planes up to which each one has a line of its own, for boxes that no other one crosses."""
POINTS = 2
"""Random points at which equations must hold."""
ARITHMETIC = SIDE_BY_SIDE | {"abs", "gt0", "ge0", "lt0", "le0", "and", "or", "not", "ok", "select", "min", "max", "lower", "upper"}
OPPOSITES = {("gt0", "le0"), ("le0", "gt0"), ("ge0", "lt0"), ("lt0", "ge0")}
BRANCHLESS = {"and": "all", "or": "any"}


@dataclass(frozen=True, slots=True)
class Crossed:
    """The straight line of a program where surfaces cross a point's boxes: the outputs are right where `good` holds."""

    items: tuple[Item, ...]
    outputs: tuple[Arg, ...]
    good: Arg


def crossed(
    program: Program,
    inputs: Sequence[Mapping[str, int | None]] | None = None,
    alone: int | None = None,
    everywhere: bool = False,
) -> Crossed | None:
    """Returns the straight line; None if there is none, or no surface. `inputs` has the residues of the parameters at several random
    points; by default, nothing connects them. If a half-plane of the polygons stands `alone`, the others hold on all of the box: it is not
    good elsewhere. `everywhere`: it is good too where the branch that gives all outputs is not taken."""
    if len(program.body) > MOST or not any(isinstance(s, Polygon | Segment) for s in statements(program.body)):
        return None
    line = _Line(program, inputs or unconnected(program), alone)
    if not line.through(program.body, True):
        return None
    w = line.writer
    outputs = tuple(map(line.value, program.outputs))
    numbers = [o for o in dict.fromkeys((*outputs, *sorted(name for name in line.defined if isinstance(name, str)))) if isinstance(o, str)]
    good: Arg = True
    for condition in (*dict.fromkeys(line.conditions), w.finite(*numbers)):
        good = condition if good is True else w.put("b", "and", good, condition)
    if everywhere and (branch := line.decisive) is not None:
        taken = line.value(branch.when)
        outputs = tuple(w.select(taken, o, 0.0) if isinstance(o, str) else o for o in outputs)
        good = w.any(w.put("b", "not", taken), good)
    line.keep()
    items = needed(line.items, (*outputs, good))
    short = sum(len(i.body) if isinstance(i, Nodes) else 1 for i in items) <= LONGEST
    return Crossed(tuple(items), outputs, good) if short and _is_arithmetic(items) else None


def lines_apart(program: Program, inputs: Sequence[Mapping[str, int | None]] | None) -> list[Crossed]:
    """Returns a straight line for each half-plane that may stand alone; none if polygons have others than each other, one or many."""
    planes = {s.half_planes for s in statements(program.body) if isinstance(s, Polygon)}
    number = len(planes.pop()) if len(planes) == 1 else 0
    lines = [crossed(program, inputs, alone) for alone in range(number)] if 1 < number <= MOST_APART else []
    return [] if any(line is None for line in lines) else [line for line in lines if line is not None]


def unconnected(program: Program) -> list[Mapping[str, int | None]]:
    """Returns residues of the parameters of a program, at several points, which nothing connects."""
    return [{f"p{i}": random_residue(point, i) for i in range(len(program.parameters))} for point in range(POINTS)]


class _Line:
    """The items of the straight line, and the conditions under which it is the program."""

    def __init__(self, program: Program, inputs: Sequence[Mapping[str, int | None]], alone: int | None) -> None:
        self._numbers = unused_numbers(n for s in statements(program.body) for n in assigned(s))
        self.writer = Writer(self._numbers)
        self.items: list[Item] = []
        self.conditions: list[Arg] = []
        self._residues = [_residues(program, known) for known in inputs]
        self._alone = alone
        self._inside: list[Arg] = []  # conditions of the branches around
        self._cases: set[tuple[Arg, Arg]] = set()  # one of which must hold
        self._polygons: list[tuple[Polygon, Crossing]] = []
        self.defined: dict[Arg, None] = {}
        """Numbers that must not be NaN."""
        self._made: dict[Arg, Assign] = {}
        self._known: dict[Arg, Arg] = {}
        self.decisive = next((s for s in program.body if isinstance(s, When) and set(program.outputs) <= set(s.results)), None)

    def keep(self) -> None:
        """Moves what was written to the items."""
        self.items += self.writer.lines
        self.writer.lines = []

    def value(self, arg: Arg) -> Arg:
        """Returns the value that a name has on the straight line."""
        return self._known.get(arg, arg)

    def through(self, block: Iterable[Stmt], held: bool = False) -> bool:
        """Returns whether a block has a straight line, and appends it. `held`: it is run at every point."""
        for stmt in block:
            match stmt:
                case Assign(op="tie"):
                    self._tie(stmt)
                case Assign():
                    self._plain(stmt)
                case When():
                    is_decisive = held and stmt is self.decisive
                    self._inside += [] if is_decisive else [self.value(stmt.when)]
                    if not self.through(stmt.body, is_decisive):
                        return False
                    if not is_decisive:
                        self._inside.pop()
                    if stmt is not self.decisive:
                        self._where(stmt.when, stmt.results)
                case Polygon() if _is_crossable(stmt):
                    self._on_condition(stmt, self._polygon(stmt))
                case Segment() if all(isinstance(s, Assign) for s in (*stmt.setup, *stmt.body)):
                    of = self._side(stmt)
                    if of is not None and self._alone not in (None, of[2].line):
                        if not self._not_run(stmt):
                            return False
                    else:
                        self._on_condition(stmt, self._segment(stmt, of))
                case _:
                    if not self._not_run(stmt):
                        return False
        return True

    def _not_run(self, stmt: Stmt) -> bool:
        """Returns whether a statement has a condition, which must not hold: its results are those of what is not run."""
        if isinstance(stmt, Assign) or stmt.when is None:
            return False
        self.conditions.append(self.writer.put("b", "not", self.value(stmt.when)))
        self._known.update(absent(stmt))
        return True

    def _on_condition(self, stmt: Polygon | Segment, conditions: Sequence[Arg]) -> None:
        """Notes the conditions of a statement, which matter where it is run, and selects its results there."""
        w = self.writer
        if stmt.when is None:
            self.conditions += conditions
            return
        both = w.put("b", "and", *conditions)
        self.conditions.append(w.any(w.put("b", "not", self.value(stmt.when)), both))
        self._where(stmt.when, stmt.results)

    def _where(self, when: str, results: Iterable[str]) -> None:
        condition = self.value(when)
        for result in results:
            value = self.value(result)
            self._known[result] = 0.0 if value == 0.0 else self.writer.select(condition, value, 0.0)

    def _tie(self, stmt: Assign) -> None:
        g, scale = map(self.value, stmt.args[:2])
        w = self.writer
        self.conditions.append(w.positive(w.sub(w.abs(g), w.mul(TIE_EPS, scale))))
        self._plain(Assign(stmt.name, "gt0", (g,)))

    def _plain(self, stmt: Assign) -> None:
        """Appends an assignment; a value that is one of two equal ones is that. Where one of three is NaN, the others are a condition."""
        made, w = self._block([stmt]), self.writer
        last = made[-1]
        if last.op == "select" and isinstance(other := self._made.get(last.args[2]), Assign) and _is_nan_else(other):
            cases = (last.args[0], other.args[0])
            if cases not in self._cases:
                self._cases.add(cases)
                self.conditions.append(w.any(*(w.put("b", "not", when) for when in self._inside), *cases))
            last = self._made[last.name] = Assign(last.name, "select", (*last.args[:2], other.args[1]))
        if last.op == "select" and last.args[1] == last.args[2]:
            self._known[last.name] = last.args[1]
            return
        w.lines += [*made[:-1], last]

    def _block(self, block: Iterable[Stmt]) -> list[Assign]:
        """Returns the assignments of a block: an integral power as products, and of three cases the first two where the last is NaN."""
        lines: list[Assign] = []
        for s in block:
            assert isinstance(s, Assign)
            s = replace(s, args=tuple(map(self.value, s.args)))
            if s.op == "select" and (holds := self._known_truth(s.args[0])) is not None:
                s = Assign(s.name, "const", (s.args[1 if holds else 2],))
            elif s.op == "select" and isinstance(other := self._made.get(s.args[2]), Assign) and _is_nan_else(other):
                undefined = self._apart(s.args[0], other.args[0])
                if undefined is not None:
                    self.defined |= dict.fromkeys(undefined)
                    s = replace(s, args=(*s.args[:2], other.args[1]))
            self._made[s.name] = s
            lines += _products(s, self._numbers)
        return lines

    def _known_truth(self, condition: Arg) -> bool | None:
        """Returns whether a condition holds in every box of positive extent, if that is known."""
        truths = {residues.truth(condition) for residues in self._residues}
        return truths.pop() if len(truths) == 1 else None

    def _apart(self, first: Arg, second: Arg) -> set[Arg] | None:
        """Returns the numbers which are NaN wherever neither of two conditions holds; None if they are no opposites."""
        a, b = self._made.get(first), self._made.get(second)
        if a is None or b is None:
            return None
        if (a.op, b.op) in OPPOSITES and a.args == b.args:
            return set(a.args)
        if b.op == "and" and len(b.args) == 2:
            negated, known = (self._made.get(c) for c in b.args)
            if negated is not None and known is not None and (negated.op, negated.args, known.op) == ("not", (first,), "ok"):
                return set(known.args)
        if (a.op, b.op) != ("and", "or") or len(a.args) != len(b.args):
            return None
        undefined: set[Arg] = set()
        left = list(b.args)
        for arg in a.args:
            partner = next((c for c in left if self._apart(arg, c) is not None), None)
            if partner is None:
                return None
            left.remove(partner)
            undefined |= self._apart(arg, partner) or set()
        return undefined

    def _polygon(self, stmt: Polygon) -> list[Arg]:
        """Appends a polygon; returns the conditions under which it is right."""
        w = self.writer
        w.lines += self._block(stmt.setup)
        planes = [replace(g, a=self.value(g.a), b=self.value(g.b), c=self.value(g.c)) for g in stmt.half_planes]
        width, height = self.value(stmt.width), self.value(stmt.height)
        cut = crossing(w, planes, (width, height), stmt.degree, 3 if stmt.corners else 0, self._alone)
        self._polygons.append((stmt, cut))
        self.conditions += [w.positive(extent) for extent in (width, height) if isinstance(extent, str)]  # whether it is run or not
        half_width, half_height = w.mul(0.5, width), w.mul(0.5, height)
        area = w.mul(half_width, half_height)
        coordinates = self._barycentric(stmt, cut) if stmt.corners else []
        known = {stmt.variables[0]: (half_width, half_width, 0.0), stmt.variables[1]: (half_height, 0.0, half_height)}
        known |= dict(zip(stmt.variables[2:], coordinates, strict=True))
        nodes = nodes_of(stmt.degree)
        x, y = (f"v{next(self._numbers)}" for _ in range(2))
        inside = Writer(self._numbers)
        for variable, (constant, by_x, by_y) in known.items():
            inside.lines.append(Assign(variable, "add", (constant, inside.mul(by_x, x), inside.mul(by_y, y))))
        body = self._block(stmt.body)
        values = list(dict.fromkeys(map(self.value, stmt.values)))
        short = (len(inside.lines) + len(body) + 2 * len(values)) * len(nodes)
        if (found := self._expanded(body, values, known, cut, short)) is not None:
            self._results(stmt, found, area)
            return cut.conditions
        places = {x: tuple(p for p, _ in nodes), y: tuple(q for _, q in nodes)}
        at_nodes = tuple(weights(w, cut.moments, stmt.degree))
        self._sums(stmt, Nodes(places, at_nodes, (*inside.lines, *body), (), ()), area)
        return cut.conditions

    def _expanded(
        self, body: Sequence[Assign], values: Sequence[Arg], known: Mapping[str, tuple[Arg, Arg, Arg]], cut: Crossing, most: int
    ) -> dict[Arg, Arg] | None:
        """Returns the integrals of values from the moments, if that takes no more than `most` statements."""
        variables = {name: {(0, 0): c, (1, 0): a, (0, 1): b} for name, (c, a, b) in known.items()}
        w = Writer(self._numbers)
        found = integrals(w, body, values, variables, cut.moments)
        if found is None or len(w.lines) > most:
            return None
        self.writer.lines += w.lines
        return found

    def _barycentric(self, stmt: Polygon, cut: Crossing) -> list[tuple[Arg, Arg, Arg]]:
        """Returns the barycentric coordinates of a box, which has a stout triangle: constants, and slopes in X and Y."""
        w, across = self.writer, self.value(stmt.across)
        inverse = w.div(1.0, across)
        change: Arg = 0.0
        for a, b, _ in cut.scaled[:3]:
            both = w.add(w.abs(a), w.abs(b))
            change = both if change == 0.0 else w.upper(change, both)
        cut.conditions.extend([w.positive(w.sub(across, w.mul(2.0 * STOUT[stmt.degree], change))), w.positive(across)])
        return [(w.mul(c, inverse), w.mul(a, inverse), w.mul(b, inverse)) for a, b, c in cut.scaled[1:3]]

    def _side(self, stmt: Segment) -> tuple[Polygon, Crossing, Side] | None:
        """Returns the polygon that a segment is a side of, and that side."""
        return next(((p, c, side) for p, c in self._polygons if (side := side_of(p, stmt, self._residues))), None)

    def _segment(self, stmt: Segment, of: tuple[Polygon, Crossing, Side] | None) -> list[Arg]:
        """Appends a segment, which is a side `of` a polygon; returns the conditions under which it is right."""
        w = self.writer
        w.lines += self._block(stmt.setup)
        start, length, extent, conditions = self._chord(stmt, *of) if of else self._cut(stmt)
        nodes, weights = gauss_legendre(stmt.nodes)
        at = f"v{next(self._numbers)}"
        places = {at: tuple(0.5 + 0.5 * float(u) for u in nodes)}
        inside = Writer(self._numbers)
        inside.lines.append(Assign(stmt.var, "add", (start, inside.mul(length, at))))
        body = (*inside.lines, *self._block(stmt.body))
        self._sums(stmt, Nodes(places, tuple(0.5 * float(v) for v in weights), body, (), ()), extent)
        return conditions

    def _cut(self, stmt: Segment) -> tuple[Arg, Arg, Arg, list[Arg]]:
        """Returns where the part of a segment begins that is in all half-lines, its length, how much of it counts, and conditions."""
        w = self.writer
        start: Arg = 0.0
        stop: Arg = 1.0
        changes: list[Arg] = []
        conditions: list[Arg] = []
        for g in stmt.half_lines:
            first, last = self.value(g.first), self.value(g.last)
            falls = w.sub(first, last)
            root = w.div(first, falls)  # beyond 1 or below 0 where none or all of it is inside
            rises = w.put("b", "lt0", falls)
            start = w.select(rises, w.upper(start, root), start)
            stop = w.select(rises, stop, w.lower(root, stop))
            changes.append(falls)
            larger = w.upper(w.abs(first), w.abs(last))
            size = 0.0 if g.k is None else w.mul(NEARLY, self.value(g.size))
            conditions.append(w.positive(w.sub(larger, size)))
        conditions.append(w.finite(*changes))
        length = w.upper(w.sub(stop, start), 0.0)
        return start, length, length, conditions

    def _chord(self, stmt: Segment, polygon: Polygon, cut: Crossing, side: Side) -> tuple[Arg, Arg, Arg, list[Arg]]:
        """Returns the same of a segment that is a side of a polygon: its chord there. Half of it counts on a side of the box: it is in one
        of the two orders of that tie."""
        w = self.writer
        half_width, half_height = (w.mul(0.5, self.value(extent)) for extent in (polygon.width, polygon.height))
        line, chord = cut.lines[side.line], cut.chords[side.line]
        planes = [[self.value(g.a), self.value(g.b), self.value(g.c)] for g in polygon.half_planes]
        ends = [[self.value(at[end]) for at in (side.u, side.v)] for end in (0, 1)]
        across, up = self._along(side, *planes[side.line][:2])
        per_square = w.div(1.0, w.add(w.mul(across, across), w.mul(up, up)))
        x, y = cut.middle_of(w, side.line)
        right = w.sub(w.add(half_width, w.mul(half_width, x)), ends[0][0])
        above = w.sub(w.add(half_height, w.mul(half_height, y)), ends[0][1])
        middle = w.mul(per_square, w.add(w.mul(right, across), w.mul(above, up)))
        each = w.mul(per_square, w.sub(w.mul(half_width, line.b, across), w.mul(half_height, line.a, up)))
        half = w.mul(w.abs(each), chord.half)
        conditions = [w.positive(per_square), *cut.runs_along_no_side(w, side.line)]
        conditions += cut.conditions if polygon.when not in (None, stmt.when) else []
        for number, end in side.ahead:
            a, b, c = planes[number]
            at = polygon.across if polygon.corners and number < 3 else w.add(w.mul(a, ends[end][0]), w.mul(b, ends[end][1]), c)
            conditions.append(w.positive(self.value(at)))
        length: Arg = w.mul(2.0, half)
        if line.tied is not False and not all(g.k is not None for g in stmt.half_lines):
            conditions.append(w.put("b", "not", line.tied))
        extent = length if line.tied is False else w.select(line.tied, half, length)
        return w.sub(middle, half), length, extent, conditions

    def _along(self, side: Side, a: Arg, b: Arg) -> tuple[Arg, Arg]:
        """Returns the difference of the ends of a side in u and in v; of the half-plane's slopes where it can be, which may be steady."""
        w = self.writer
        if side.sign:
            return w.mul(float(side.sign), b), w.mul(float(-side.sign), a)
        first, second = ([self.value(end) for end in ends] for ends in (side.u, side.v))
        return w.sub(first[1], first[0]), w.sub(second[1], second[0])

    def _sums(self, stmt: Polygon | Segment, nodes: Nodes, extent: Arg) -> None:
        """Appends the sums over nodes, and the results that they give."""
        distinct = list(dict.fromkeys(map(self.value, stmt.values)))
        sums = {value: f"v{next(self._numbers)}" for value in distinct}
        self.keep()
        self.items.append(replace(nodes, values=tuple(distinct), sums=tuple(sums.values())))
        self._results(stmt, sums, extent)

    def _results(self, stmt: Polygon | Segment, sums: Mapping[Arg, Arg], extent: Arg) -> None:
        """Appends the results, from the integrals of values relative to `extent`."""
        w = self.writer
        scaled: dict[Arg, Arg] = {}
        for result, value, factor in zip(stmt.results, stmt.values, stmt.factors, strict=True):
            factor = self.value(factor)
            if factor not in scaled:
                scaled[factor] = w.mul(extent, factor)
            w.lines.append(Assign(result, "mul", (scaled[factor], sums[self.value(value)])))


def _residues(program: Program, inputs: Mapping[str, int | None]) -> Residues:
    """Returns the residues of a program, in which boxes are taken to have positive extents."""
    residues = Residues(inputs)
    block = list(statements(program.body))
    residues.follow(block)
    for extent in (e for s in block if isinstance(s, Polygon) for e in (s.width, s.height)):
        if (residue := residues.of(extent)) and (isinstance(extent, str) or extent > 0.0):
            residues.assume_positive(residue)
    residues.follow(block)
    return residues


def _is_nan_else(stmt: Assign) -> bool:
    return stmt.op == "select" and isinstance(stmt.args[2], float) and isnan(stmt.args[2])


def _products(stmt: Assign, numbers: count[int]) -> list[Assign]:
    """Returns an assignment, an integral power as products."""
    if stmt.op != "powi" or stmt.args[1] == 2:
        return [stmt]
    w = Writer(numbers)
    square, left = stmt.args[0], abs(int(stmt.args[1]))
    power: Arg = 1.0
    while left:
        power = w.mul(power, square) if left % 2 else power
        left //= 2
        square = w.mul(square, square) if left else square
    return [*w.lines, Assign(stmt.name, "div", (1.0, power)) if int(stmt.args[1]) < 0 else Assign(stmt.name, "const", (power,))]


def _is_crossable(stmt: Polygon) -> bool:
    """Returns whether a polygon is small, and its integrand is written as a polynomial of the coordinates."""
    if stmt.degree > MOST_DEGREE or len(stmt.half_planes) > MOST_LINES:
        return False
    if not all(isinstance(s, Assign) for s in (*stmt.setup, *stmt.body)):
        return False
    inside: set[Arg] = set(stmt.variables)
    for s in stmt.body:
        assert isinstance(s, Assign)
        if inside.isdisjoint(s.args):
            continue
        inside.add(s.name)
        match s.op:
            case "add" | "sub" | "mul" | "neg" | "const":
                pass
            case "powi" if int(s.args[1]) >= 0:
                pass
            case "div" if s.args[1] not in inside:
                pass
            case "select" if s.args[0] not in inside:
                pass
            case _:
                return False
    return True


def _is_arithmetic(items: Iterable[Item]) -> bool:
    flat = [s for item in items for s in (item.body if isinstance(item, Nodes) else (item,))]
    return all(s.op in ARITHMETIC or (s.op == "powi" and s.args[1] == 2) for s in flat)
