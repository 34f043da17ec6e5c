"""Points side by side: the straight line that most of them take, and which of them take it.

Most points of a scene are where nothing is to be done, or where no surface passes: what decides that, and what is then to be computed,
is arithmetic without branches, and eight points at once take little longer than one.

    packed(program)  ->  Packed      without `live` every output is 0, and where `fast` holds they are those of `straight`

The C functions of eight points are in `lane_functions`.

On the straight line the branch that gives every output is taken, if there is one, and no other; a polygon is its whole box, over which a
product of Gauss-Legendre rules is exact. A point where a tie is met, a surface passes, or a number is not finite is not fast. Whether one
is depends on that point alone, and a batch of one is computed as eight points: results do not depend on the neighbours.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isnan
from typing import Any

from teg.backends.c.crossing import Writer
from teg.backends.c.expanded import Poly, box_moments, integrals
from teg.backends.c.frame import assignments
from teg.backends.c.polygon import SIDE_BY_SIDE
from teg.program import (
    NEAR_SIDE,
    TIE_EPS,
    Arg,
    Assign,
    Hyperbola,
    Polygon,
    Program,
    Stmt,
    When,
    assigned,
    statements,
)
from teg.program.dce import without_dead_code
from teg.program.fields import absent
from teg.program.names import unused_numbers

SIDE = 8
"""Points side by side."""
LONGEST, WIDEST, MOST = 400, 1200, 1600
"""Statements of a straight line or of a decision, each one C function that is not cut; and of a program that is looked at."""
DECIDING = SIDE_BY_SIDE | {"abs", "gt0", "ge0", "lt0", "le0", "and", "or", "not", "ok", "select"}
STRAIGHT = SIDE_BY_SIDE | {"choose"}
WIDE = DECIDING | {"min", "max", "exp", "expm1", "sqrt"}
"""Operations of straight lines with functions, which are loops over eight points."""
FUNCTIONS = {"exp", "expm1"}
LARGEST = 1.7976931348623157e308


@dataclass(frozen=True, slots=True)
class Packed:
    """Branch-free approximation of a program. `settling` computes `live`; where it is False all outputs are 0. `deciding` computes `fast`;
    where it is True `straight` gives the `outputs`. A constant `live` of True, or `fast` of False, means that nothing is known. A
    straight line that is `wide` has functions and choices. Each of `planes` is positive where a half-plane holds on all of its box."""

    live: Arg
    fast: Arg
    settling: tuple[Assign, ...]
    deciding: tuple[Assign, ...]
    straight: tuple[Stmt, ...]
    outputs: tuple[Arg, ...]
    wide: bool = False
    planes: tuple[Arg, ...] = ()


def decisive_branch(program: Program) -> When | None:
    """Returns the branch without which every output of a program is 0, if one gives them all."""
    return next((s for s in program.body if isinstance(s, When) and set(program.outputs) <= set(s.results)), None)


def packed(program: Program) -> Packed | None:
    """Returns the straight line of a program; None if it would decide nothing."""
    branch = decisive_branch(program)
    if len(program.body) > MOST or (branch is None and any(map(_is_hard, program.body))):
        return None
    line = _Line(program, settles=not _has_functions(program))
    live, settling = _settled(program, branch, line)
    fast = line.through([s for s in program.body if s is not branch])
    if branch is not None:
        fast = fast and line.through(branch.body)
        line.conditions.append(branch.when)
    outputs: tuple[Arg, ...] = tuple(line.value(o) for o in program.outputs)
    straight = _sliced(line.steps, outputs) if fast else []
    wide = branch is None and fast and _is_wide(straight)
    if branch is None and not line.conditions and not wide:
        return None
    fast = fast and (wide or _is_short_arithmetic(straight))
    both: Arg = line.assign("b", "and", *line.conditions) if fast else False
    needed = _sliced(line.steps, (both,))
    deciding = [s for s in needed if isinstance(s, Assign)]
    if len(deciding) < len(needed) or not _is_short_decision(deciding, WIDEST if wide else LONGEST):
        fast, both, deciding = False, False, []
    if live is True and not fast:
        return None
    planes = line.planes[0] if fast and line.planes else ()
    return Packed(live, both, tuple(settling), tuple(deciding), tuple(straight) if fast else (), outputs, wide, planes)


def _settled(program: Program, branch: When | None, line: _Line) -> tuple[Arg, list[Assign]]:
    """Returns the boolean without which every output is 0, and what it is computed from; True if that is more than short arithmetic."""
    if branch is not None:
        live: Arg = branch.when
        wanted: list[Arg] = [live]
    else:
        vanishing = _vanishing(program)
        if not vanishing:
            return True, []
        wanted = [name for name, _ in vanishing]
    settling: list[Assign] = []
    near: list[Arg] = []
    for s in _sliced(program.body, wanted):
        if not isinstance(s, Assign):
            return True, []
        if s.op == "tie" and branch is None:
            near.append(line.near(s, settling))
            s = Assign(s.name, "gt0", s.args[:1])
        settling += line.plain(s)
    if branch is None:
        parts = [name if not holds else line.new(settling, "not", name, letter="b") for name, holds in vanishing]
        live = line.new(settling, "or", *parts, *near, letter="b")
    return (live, settling) if _is_short_decision(settling, LONGEST) else (True, [])


def _vanishing(program: Program) -> list[tuple[str, bool]]:
    """Returns conditions, and whether they hold, under which every output is 0; none if that is not known. What a statement gives that is
    not run is 0, and so are sums of zeros."""
    zero: dict[Arg, dict[tuple[str, bool], None] | None] = {}

    def of(arg: Arg) -> dict[tuple[str, bool], None] | None:
        return ({} if arg == 0.0 else None) if not isinstance(arg, str) else zero.get(arg)

    def together(args: Iterable[Arg]) -> dict[tuple[str, bool], None] | None:
        parts = [of(a) for a in args]
        return None if any(p is None for p in parts) else {c: None for p in parts for c in p or ()}

    for s in program.body:
        match s:
            case Assign(op="add" | "sub" | "neg" | "const"):
                zero[s.name] = together(s.args)
            case Assign(op="select"):
                condition, then, otherwise = s.args
                for value, holds in ((otherwise, False), (then, True)):
                    if isinstance(condition, str) and (parts := of(value)) is not None:
                        zero[s.name] = {(condition, holds): None, **parts}
                        break
            case Assign():
                pass
            case _ if isinstance(s.when, str):
                zero.update({r: {(s.when, False): None} for r, value in absent(s).items() if value == 0.0})
    found = together(program.outputs)
    return list(found or ())


def _is_hard(stmt: Stmt) -> bool:
    """Returns whether no straight line can pass it by."""
    return not isinstance(stmt, Assign | Polygon | Hyperbola | When) and stmt.when is None


def _has_functions(program: Program) -> bool:
    """Returns whether a program is operations of scalars only, with functions among them."""
    return all(isinstance(s, Assign) for s in program.body) and any(s.op in FUNCTIONS for s in program.body if isinstance(s, Assign))


class _Line:
    """The statements of the straight line, and the conditions under which it is the program. It `settles` what is chosen where it can; else
    choices are made at each of the points, which a value that is undefined on one side needs if others choose the other side."""

    def __init__(self, program: Program, settles: bool) -> None:
        self.settles = settles
        self.steps: list[Stmt] = []
        self.conditions: list[Arg] = []
        self.planes: list[tuple[Arg, ...]] = []  # of each polygon, the least values of its half-planes
        self.known: dict[Arg, Arg] = {}  # results of what is not run, and of choices that are settled
        self.unmet: set[Arg] = set()  # conditions of what is not run
        self._numbers = unused_numbers(n for s in statements(program.body) for n in assigned(s))

    def assign(self, letter: str, op: str, *args: Arg) -> str:
        name = f"{letter}{next(self._numbers)}"
        self.steps.append(Assign(name, op, args))
        return name

    def value(self, arg: Arg) -> Arg:
        return self.known.get(arg, arg)

    def near(self, tie: Assign, block: list[Assign]) -> str:
        """Returns whether a tie may be met."""
        g, scale = map(self.value, tie.args[:2])
        beyond = self.new(block, "sub", self.new(block, "abs", g), self.new(block, "mul", TIE_EPS, scale))
        return self.new(block, "le0", beyond, letter="b")

    def through(self, block: Iterable[Stmt]) -> bool:
        """Go through a block; whether there is a straight line."""
        for stmt in block:
            match stmt:
                case Assign(op="tie"):
                    self._tie(stmt)
                case Assign(op="select") if self.settles and self._settles(stmt):
                    pass
                case Assign():
                    self.steps += self.plain(stmt)
                case Polygon(when=None) if all(isinstance(s, Assign) for s in (*stmt.setup, *stmt.body)):
                    self._box(self._known(stmt))
                case Hyperbola(when=None):
                    self._square(stmt)
                case _:
                    if stmt.when is None:
                        return False
                    self.conditions.append(self.assign("b", "not", stmt.when))
                    self.unmet.add(stmt.when)
                    self.known.update(absent(stmt))
        return True

    def _settles(self, choice: Assign) -> bool:
        """Returns whether it is known what is chosen: the other value where something is run, or what is defined."""
        condition, then, otherwise = choice.args
        if isinstance(condition, str) and isinstance(otherwise, float) and isnan(otherwise):
            self.conditions.append(condition)
        elif condition not in self.unmet:
            return False
        self.known[choice.name] = self.value(otherwise if condition in self.unmet else then)
        return True

    def plain(self, stmt: Assign) -> list[Assign]:
        """Returns an assignment without results that are not run, and with an integral power written out as products."""
        stmt = Assign(stmt.name, stmt.op, tuple(map(self.value, stmt.args)))
        return list(as_products(stmt, (f"v{n}" for n in self._numbers))) if stmt.op == "powi" else [stmt]

    def _tie(self, stmt: Assign) -> None:
        g, scale = map(self.value, stmt.args[:2])
        allowed = self.assign("v", "mul", TIE_EPS, scale)
        beyond = self.assign("v", "sub", self.assign("v", "abs", g), allowed)
        self.conditions.append(self.assign("b", "not", self.assign("b", "le0", beyond)))
        self.steps.append(Assign(stmt.name, "gt0", (g,)))

    def _known(self, stmt: Polygon) -> Polygon:
        """Returns a polygon without results that are not run."""
        value = self.value

        def block(statements: Iterable[Stmt]) -> tuple[Assign, ...]:
            return tuple(line for s in statements if isinstance(s, Assign) for line in self.plain(s))

        return replace(
            stmt,
            width=value(stmt.width),
            height=value(stmt.height),
            half_planes=tuple(replace(g, a=value(g.a), b=value(g.b), c=value(g.c)) for g in stmt.half_planes),
            setup=block(stmt.setup),
            body=block(stmt.body),
            values=tuple(map(value, stmt.values)),
            factors=tuple(map(value, stmt.factors)),
            corners=tuple((value(u), value(v)) for u, v in stmt.corners),
            across=value(stmt.across),
        )

    def _box(self, stmt: Polygon) -> None:
        """The whole box, inside of every half-plane. (A triangle around it is not thin: no half-plane changes by more than `across`.) A
        node's barycentric coordinates are values like others there."""
        sizes: list[Arg] = [self.assign("v", "abs", stmt.width), self.assign("v", "abs", stmt.height)]
        planes: list[Arg] = []
        for g in stmt.half_planes:
            steps = [self.assign("v", "mul", g.a, stmt.width), self.assign("v", "mul", g.b, stmt.height)]
            changes: list[Arg] = [self.assign("v", "abs", step) for step in steps]
            most_below = self.assign("v", "sub", self.assign("v", "add", *steps), self.assign("v", "add", *changes))
            least = self.assign("v", "add", g.c, self.assign("v", "mul", 0.5, most_below))
            self.conditions.append(self.assign("b", "gt0", least))
            sizes += [least, *changes]
            planes.append(least)
        self.planes.append(tuple(planes))
        if stmt.corners:
            self.conditions.append(self.assign("b", "gt0", stmt.across))
            sizes.append(stmt.across)
        excess = self.assign("v", "sub", self.assign("v", "add", *sizes), LARGEST)
        self.conditions.append(self.assign("b", "le0", excess))  # all are finite
        if self._expanded(stmt):
            return
        (x, y), coordinates, setup, body = stmt.variables[:2], stmt.variables[2:], list(stmt.setup), list(stmt.body)
        if coordinates:
            inverse = self.new(setup, "div", 1.0, stmt.across)
            lines: list[Stmt] = []
            for g, name in zip(stmt.half_planes[1:3], coordinates, strict=True):
                at = self.new(lines, "add", g.c, self.new(lines, "mul", g.a, x), self.new(lines, "mul", g.b, y))
                lines.append(Assign(name, "mul", (at, inverse)))
            body = [*lines, *body]
        whole = replace(stmt, variables=(x, y), half_planes=(), corners=(), across=0.0, met=True)
        self.steps.append(replace(whole, setup=tuple(setup), body=tuple(body)))

    def _expanded(self, stmt: Polygon) -> bool:
        """Appends the integrals over a whole box without nodes, if that is shorter; returns whether it is."""
        w = Writer(self._numbers)
        half_width, half_height = w.mul(0.5, stmt.width), w.mul(0.5, stmt.height)
        variables: dict[str, Poly] = {
            stmt.variables[0]: {(0, 0): half_width, (1, 0): half_width},
            stmt.variables[1]: {(0, 0): half_height, (0, 1): half_height},
        }
        inverse = w.div(1.0, stmt.across) if stmt.corners else 1.0
        for g, name in zip(stmt.half_planes[1:3], stmt.variables[2:], strict=False):
            by_x, by_y = w.mul(g.a, half_width, inverse), w.mul(g.b, half_height, inverse)
            variables[name] = {(0, 0): w.add(w.mul(g.c, inverse), by_x, by_y), (1, 0): by_x, (0, 1): by_y}
        w.lines += [s for s in stmt.setup if isinstance(s, Assign)]
        body = [s for s in stmt.body if isinstance(s, Assign)]
        values = list(dict.fromkeys(stmt.values))
        found = integrals(w, body, values, variables, box_moments(stmt.degree))
        area = w.mul(stmt.width, stmt.height)
        if found is None or len(w.lines) > min(LONGEST / 2, 0.7 * nodes_across(stmt) ** 2 * (len(body) + 2 * len(values))):
            return False
        for result, value, factor in zip(stmt.results, stmt.values, stmt.factors, strict=True):
            w.lines.append(Assign(result, "const", (w.mul(area, factor, found[value]),)))
        self.steps += w.lines
        return True

    def new(self, block: list[Any], op: str, *args: Arg, letter: str = "v") -> str:
        """Returns the name of a value that is computed in a block."""
        name = f"{letter}{next(self._numbers)}"
        block.append(Assign(name, op, args))
        return name

    def _square(self, stmt: Hyperbola) -> None:
        """The whole square, the curve nowhere near it."""
        corners = [self.value(g) for g in stmt.corners]
        sizes = [self.assign("v", "abs", g) for g in corners]
        total = self.assign("v", "add", *sizes)
        self.conditions.append(self.assign("b", "le0", self.assign("v", "sub", total, LARGEST)))
        above, below = (self.assign("b", "and", *(self.assign("b", op, g) for g in corners)) for op in ("gt0", "lt0"))
        self.conditions.append(self.assign("b", "or", above, below))
        near = self.assign("v", "mul", NEAR_SIDE, total)
        for i, size in enumerate(sizes):
            side = self.assign("v", "add", size, sizes[(i + 1) % 4])
            self.conditions.append(self.assign("b", "gt0", self.assign("v", "sub", side, near)))
        for result, moments in zip(stmt.results, stmt.moments, strict=True):
            if moments.kind == "border":
                self.known[result] = 0.0
                continue
            terms = [self.assign("v", "mul", self.value(c), 1.0 / ((j + 1) * (k + 1))) for j, k, c in moments.terms]
            whole = self.assign("v", "add", *terms)
            parts = (whole, 0.0) if moments.kind == "above" else (0.0, whole)
            self.steps.append(Assign(result, "choose", (corners[0], *parts)))


def as_products(stmt: Assign, names: Iterator[str]) -> Iterator[Assign]:
    """Yields an integral power as products, by squaring, which have new names."""
    square, left = stmt.args[0], abs(int(stmt.args[1]))
    power: Arg = 1.0
    while left:
        if left % 2 and power == 1.0:
            power = square
        elif left % 2:
            yield (made := Assign(next(names), "mul", (power, square)))
            power = made.name
        left //= 2
        if left:
            yield (made := Assign(next(names), "mul", (square, square)))
            square = made.name
    yield Assign(stmt.name, "div", (1.0, power)) if int(stmt.args[1]) < 0 else Assign(stmt.name, "const", (power,))


def _sliced(steps: Iterable[Stmt], wanted: Iterable[Arg]) -> list[Stmt]:
    """Returns the statements that the wanted names depend on."""
    return list(without_dead_code(Program((), tuple(steps), tuple(wanted))).body)


def _weight(steps: Iterable[Assign]) -> int:
    return sum(step.weight for stmt in steps for step in assignments(stmt))


def _is_short_decision(steps: Sequence[Assign], longest: int) -> bool:
    """Returns whether the statements are comparisons and arithmetic only, few enough for one C function."""
    return all(s.op in DECIDING for s in steps) and _weight(steps) <= longest


def _is_short_arithmetic(straight: Sequence[Stmt]) -> bool:
    """Returns whether eight numbers at once can do all operations, and whether these are few enough for one C function."""
    flat = [s for stmt in straight for s in ((*stmt.setup, *stmt.body) if isinstance(stmt, Polygon) else (stmt,))]
    simple = [s for s in flat if isinstance(s, Assign) and s.op in STRAIGHT]
    results = sum(len(s.results) for s in straight if isinstance(s, Polygon))
    return len(simple) == len(flat) and _weight(simple) + results <= LONGEST


def _is_wide(straight: Sequence[Stmt]) -> bool:
    """Returns whether the statements are short, and operations of scalars with a function among them that eight points share."""
    simple = [s for s in straight if isinstance(s, Assign) and s.op in WIDE]
    return len(simple) == len(straight) and any(s.op in FUNCTIONS for s in simple) and _weight(simple) <= WIDEST


def nodes_across(stmt: Polygon) -> int:
    """Returns nodes of the rule on a box in one variable."""
    return stmt.degree // 2 + 1
