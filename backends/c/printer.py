"""The program printed as C99: loops over pieces and nodes, one C function an integral, a search for roots or places, or a sum.

    Program -> steps           an assignment or a few C lines each, with the names they define and use
    steps   -> Frame           a C function; a long block is cut into parts, functions of their own (see `c_frame`)
    Frame   -> Routine         its text; statements of equal text share one routine with different arguments
    routines + batch loop      the translation unit, with what it needs of the headers in `runtime`

Names. In a routine the variable is `x` (of a box `left`, `right`, of a rectangle `bottom`, `top` too), what it captures
`c0, c1, …`, its own values `v1, b2, …` in order: the text is canonical, so a sum of 10 000 similar integrals is 10 000 calls
of a few functions. Literals that are not simple numbers are captured as well.

Workspace. `w` is a stack of doubles, allocated once per thread and call: a routine uses w[0 … size) and calls
others with w + size. In it are values that cross the border of a part, arrays too long for the C stack, and
captured values where there are more than BY_VALUE.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import cast

from teg.backends.branches import with_branches
from teg.backends.c import ellipse as c_ellipse
from teg.backends.c.abreast import Abreast, Nodes, eight_at_once, is_abreast
from teg.backends.c.batch import ABI, batch_loop, together
from teg.backends.c.bodies import merged, used_inputs, with_inputs
from teg.backends.c.calls import called
from teg.backends.c.frame import RESULTS, Frame, Routine, Scope, Spelling, Step, assignments, captured_by
from teg.backends.c.hyperbola import along_a_branch, along_function, hyperbola
from teg.backends.c.poles import plain_table, rational_piece, weights_function
from teg.backends.c.polygon import (
    COORDINATES,
    LANES,
    polygon,
    runs_side_by_side,
    segment,
    segment_lanes,
    sums,
    triangle_table,
    unit_table,
)
from teg.backends.c.quadrature import (
    GuardText,
    Places,
    Sums,
    adaptive_piece,
    bent_piece,
    gauss_piece,
    gauss_table,
    isolation,
    location,
    middle_of_piece,
    midpoint_piece,
    node_table,
    sum_over,
)
from teg.backends.c.runtime import runtime
from teg.backends.c.samples import sample_loop, sobol_table, used_points
from teg.backends.c.straights import Waiting, side_by_side
from teg.backends.c.text import each, harmless, indent, packed, wrapped
from teg.backends.lazily import with_lazy_choices
from teg.numerics.sobol import REPLICATES
from teg.program import (
    MAX_DEPTH,
    Adaptive,
    Arg,
    Assign,
    Called,
    Ellipse,
    Gauss,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Midpoint,
    Polygon,
    Program,
    Rational,
    Sample,
    Segment,
    Stmt,
    SumOver,
    When,
    assigned,
    compound,
    has_ties,
)
from teg.program.fields import Operand, leaves

BREAKS_ON_STACK, ABREAST_ON_STACK = 256, 128
SHORT = 40  # statements of an integral that is compared with others
INLINED, WHOLE = 6, 120
"""Of so few polygons and segments each is compiled where it stands, with up to so many values passed to it."""
Together = tuple[int, ...]
"""Functions of a program that are called together, by their numbers."""
Declare = Callable[[Sequence[Together]], list[str]]
MANY = 1024
"""Points of a midpoint rule that are no matter of milliseconds, whatever the integrand."""


def print_kernel(
    program: Program, name: str = "teg_kernel", counted: bool = False, real: str = "double", declare: Declare | None = None
) -> str:
    """Returns the translation unit: constants, runtime, Gauss tables, integrals inside out, element, batch loop. A `counted` one counts the
    evaluations of integrands. `real` is the type of parameters and outputs, "double" or "float"; between them all is double. `declare`
    gives the declarations of the functions that are called; else these are in the text themselves."""
    program = with_branches(program)
    printer = Printer(counted)
    element = printer.element(program)
    every = range(len(program.parameters))
    straight = None if counted else side_by_side(printer.once, program, every, together(program), (), Waiting(program, every))
    texts = [*printer.texts, wrapped(batch_loop(program, name, element, real, straight))]
    tables = printer.tables()
    called = tuple(sorted(printer.called))
    functions = declare(called) if declare is not None else [text for ks in called for text in _static_function(program, ks)]
    first, *needed = runtime([*tables, *functions, *texts])
    return "\n\n".join([title(program), first, ABI, *needed, *tables, *functions, *texts]) + "\n"


def function_name(called: Together) -> str:
    """Returns the name of functions of a program that are called together."""
    return "_".join(["teg_function", *map(str, called)])


def _static_function(program: Program, called: Together) -> list[str]:
    return function_texts(merged([cast(Program, program.functions[k].body) for k in called]), function_name(called), "static ")


def function_texts(body: Program, name: str, storage: str = "") -> list[str]:
    """Returns a program of assignments as a C function of its parameters: it returns one output, more go to an array."""
    printer = Printer()
    inputs = [f"p{i}" for i in range(len(body.parameters))]
    used, single = used_inputs(body), len(body.outputs) == 1
    element = printer.element(with_inputs(body, used), f"{name}_body")
    space = element.workspace
    given = [*([] if element.indirect else used), "result", *["w"] * (space > 0)]
    inside = [
        *packed(f"(void){p};" for p in inputs if p not in used),
        *(["double result[1];"] if single else []),
        *([f"double w[{space}];"] if space else []),
        *(packed(f"w[{i}] = {p};" for i, p in enumerate(used)) if element.indirect else []),
        f"{element.name}({', '.join(given)});",
        *(["return result[0];"] if single else []),
    ]
    taken = [*(f"double {p}" for p in inputs), *([] if single else ["double *result"])]
    head = f"{storage}{'double' if single else 'void'} {name}({', '.join(taken) or 'void'})"
    return [*printer.texts, wrapped([head, "{", *indent(*inside), "}"])]


def title(program: Program) -> str:
    """Returns the comment at the top; of the users' names only harmless characters."""
    shown = program.parameters[:20]
    names = [f"p{i} = {harmless(name, 40)}" for i, name in enumerate(shown)]
    names += ["..."] * (len(shown) < len(program.parameters))
    lines = packed(names or ["none"], " * ", ", ")
    return "\n".join([f"/* Generated by teg. {len(program.outputs)} outputs of {len(program.parameters)} parameters:", *lines, " */"])


class Printer:
    """Prints routines, each text once, inner integrals before outer ones."""

    def __init__(self, counted: bool = False) -> None:
        self.counted = counted
        self.orders: set[int] = set()
        self.measured: set[int] = set()  # orders whose null rules are used
        self.poles: set[tuple[int, int]] = set()  # nodes and powers
        self.inlined = False  # whether polygons and segments are written where they are called
        self.triangles: set[int] = set()  # degrees of rules on triangles
        self.units: set[tuple[int, int]] = set()  # nodes of segments, and how many of them are taken side by side
        self.branches: set[tuple[tuple[int, int], ...]] = set()  # sets of moments of hyperbolas
        self.ellipses: set[c_ellipse.Wanted] = set()  # sets of moments of ellipses
        self.dimensions = 0  # of Sobol' points
        self.called: set[Together] = set()
        self.functions: Sequence[Called] = ()
        self.texts: list[str] = []
        self._known: dict[str, Routine] = {}
        self._patterns: dict[object, tuple[Routine, list[tuple[int, Arg]]]] = {}

    def tables(self) -> list[str]:
        """Returns the tables that the routines use, and functions made of tables."""
        found = [*map(gauss_table, sorted(self.orders)), *map(node_table, sorted(self.measured))]
        found += [*map(triangle_table, sorted(self.triangles)), *(unit_table(*key) for key in sorted(self.units))]
        found += [*map(plain_table, sorted({n for n, _ in self.poles})), *(weights_function(*pole) for pole in sorted(self.poles))]
        found += map(along_function, sorted(self.branches))
        found += map(c_ellipse.moments_function, sorted(self.ellipses))
        return found + ([sobol_table(self.dimensions)] if self.dimensions else [])

    @property
    def _by_value(self) -> int | None:
        """Returns how many values a clipped integral is given by value: all if it is written where it is called."""
        return WHOLE if self.inlined else None

    def element(self, program: Program, kind: str = "element", by_value: int | None = None, told: str | None = None) -> Routine:
        """Returns the routine of the whole program at one point: from the parameters it writes the outputs to `f`. There is one "element",
        "run"s are numbered. It returns the boolean `told`, if there is one."""
        if told is None and not any(isinstance(s, Polygon | Segment | Hyperbola | Ellipse | When) for s in compound(program.body)):
            program = with_lazy_choices(program)
        self.inlined = sum(isinstance(s, Polygon | Segment | Hyperbola | Ellipse) for s in compound(program.body)) <= INLINED
        self.functions = program.functions
        steps = [*self._steps(program.body), *_yields(program.outputs)]
        parameters, context = [f"p{i}" for i in range(len(program.parameters))], needs_context(program.body, self.counted)
        frame = Frame(parameters, [steps], () if told is None else (told,), context, spelling=Spelling("p", by_value))
        inside = [*frame.opening(), *frame.block(0)]
        if told is not None:
            inside.append(f"return {frame.scope()(told)};")
        storage = "TEG_INLINE" if kind == "run" and self.inlined and not frame.indirect else "static"
        return self._routine(kind, frame, f"{storage} {'void' if told is None else 'int'} {frame.signature('f')}", inside)

    def _steps(self, block: Sequence[Stmt]) -> Iterator[Step]:
        together: dict[object, list[Assign]] = {}  # a function and its derivatives at the same inputs
        for stmt in block:
            if isinstance(stmt, Assign) and stmt.op == "call":
                together.setdefault(self._application(stmt), []).append(stmt)
        for stmt in block:
            if isinstance(stmt, Assign) and stmt.op == "call":
                if calls := together.pop(self._application(stmt), None):
                    yield from self._applied(calls)
            elif isinstance(stmt, Assign):
                yield from assignments(stmt)
            elif stmt.results:
                yield self._call(stmt)

    def _application(self, stmt: Assign) -> tuple[object, ...]:
        """Returns the same for calls that one C function can answer."""
        return self.functions[int(stmt.args[0])].callee, *stmt.args[1:]

    def _applied(self, calls: Sequence[Assign]) -> Iterator[Step]:
        """Returns the call that computes a function together with its derivatives at the same inputs."""
        ks = tuple(sorted({int(stmt.args[0]) for stmt in calls}))
        self.called.add(ks)
        if len(calls) == 1:
            yield from assignments(calls[0])
            return
        inputs = calls[0].args[1:]

        def lines(scope: Scope) -> list[str]:
            given = [scope(arg) for arg in inputs]
            array = scope.name(calls[0].name, "r")
            scope.names.update((stmt.name, f"{array}[{ks.index(int(stmt.args[0]))}]" if len(ks) > 1 else array) for stmt in calls)
            if len(ks) == 1:
                return [f"const double {array} = {function_name(ks)}({', '.join(given)});"]
            return [f"double {array}[{len(ks)}];", f"{function_name(ks)}({', '.join([*given, array])});"]

        yield Step(tuple(stmt.name for stmt in calls), inputs, None, lines, 4 + len(inputs) // 8)

    def _call(self, stmt: Integrate | Isolate | Locate | SumOver | Sample | Polygon | Segment | Hyperbola | Ellipse | When) -> Step:
        """Returns the call of a statement's routine."""
        match stmt:
            case Integrate():
                routine, captured = self._known_integral(stmt) or self._integral(stmt)
            case Isolate():
                routine, captured = self._isolation(stmt)
            case Locate():
                routine, captured = self._location(stmt)
            case SumOver():
                routine, captured = self._sum(stmt)
            case Sample():
                routine, captured = self._sample(stmt)
            case Polygon() | Segment():
                routine, captured = self._clipped(stmt)
            case Hyperbola():
                routine, captured = self._hyperbola(stmt)
            case Ellipse():
                routine, captured = self._ellipse(stmt)
            case When():
                routine, captured = self._branch(stmt)
        return called(stmt, routine, captured)

    def _known_integral(self, stmt: Integrate) -> tuple[Routine, tuple[Arg, ...]] | None:
        """Returns the routine of a short integral, and the arguments of its call. Integrals that differ in names only share a routine,
        because a sum may have thousands of them."""
        pattern = _pattern(stmt)
        if pattern is None:
            return None
        key, names = pattern
        if key not in self._patterns:
            routine, captured = self._integral(stmt)
            number = {name: i for i, name in enumerate(names)}
            self._patterns[key] = routine, [(number[a], 0.0) if isinstance(a, str) else (-1, a) for a in captured]
        routine, places = self._patterns[key]
        return routine, tuple(literal if i < 0 else names[i] for i, literal in places)

    def _integral(self, stmt: Integrate) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of an integral, and what this occurrence passes to it."""
        at_nodes = stmt.at_nodes
        flags, body = list(self._steps(stmt.flags)), [*self._steps(stmt.body), *_yields(at_nodes)]
        abreast = eight_at_once(stmt) if is_abreast(stmt) else None
        blocks, variables = [flags, body if abreast is None or abreast.has_exceptions else abreast.steps], {stmt.var: "x"}
        bounds: tuple[Arg, ...] = ()
        if stmt.guard is not None:
            bounds = (*stmt.guard.sizes, *stmt.guard.upper, *stmt.guard.lower)
            blocks.append([*self._steps(stmt.guard.block), *_yields(bounds)])
            variables |= {stmt.guard.left: "left", stmt.guard.right: "right"}
        if abreast is not None:
            variables |= abreast.variables
            if abreast.has_exceptions:
                blocks.append(abreast.steps)
        own = _spelled(stmt, "flags")
        variables |= dict(zip(stmt.ends, "pq", strict=False))
        captured = captured_by(own, [step for block in blocks for step in block], variables)
        values, count, pieces = len(stmt.values), len(assigned(stmt)), len(stmt.breaks) + 1
        whole = () if abreast is None else (1, len(blocks) - 1)
        frame = Frame(captured, blocks, own, needs_context((stmt,), self.counted), variables, Spelling(whole=whole))
        arrays = _arrays_of(stmt, frame, abreast, max(len(at_nodes), len(bounds)))
        arrays += frame.array("ends", pieces + 1, BREAKS_ON_STACK)
        spell = frame.scope()
        ends = [f"ends[{i}] = teg_clamp({spell(arg)}, a, b);" for i, arg in enumerate(stmt.breaks, 1)]
        nothing = _not_a_number("sum", count)
        inside = [
            *arrays,
            *frame.opening(),
            f"const double lo = {spell(stmt.lo)}, hi = {spell(stmt.hi)};",
            ("if (lo != lo || hi != hi) " if stmt.infinite else "if (!isfinite(lo) || !isfinite(hi)) ") + nothing,
            *([_stop("sum", count)] if isinstance(stmt.rule, Adaptive) else []),
            "const double a = lo <= hi ? lo : hi, b = lo <= hi ? hi : lo, sign = lo <= hi ? 1.0 : -1.0;",
            *packed(["ends[0] = a;", *ends, f"ends[{pieces}] = b;"]),
            *([f"teg_sort(ends + 1, {pieces - 1});"] if pieces > 2 else []),
            "double sum[1] = {0.0};" if count == 1 else f"teg_fill(sum, {count}, 0.0);",
            f"for (int i = 0; i < {pieces}; i++) {{",
            *indent(
                "const double p = ends[i], q = ends[i + 1];",
                "if (!teg_is_piece(p, q)) continue;",
                middle_of_piece(stmt.infinite, spell(stmt.scale) if stmt.infinite else ""),
                *([] if any(stmt.var in (*step.uses, *step.stored) for step in (*flags, *body)) else ["(void)x;"]),
                *frame.block(0),
                *([] if stmt.need is None else [f"if (!{spell(stmt.need)}) continue;"]),
                *self._piece(stmt, frame, spell, abreast),
            ),
            "}",
            "return sign * sum[0];" if count == 1 else each(values, "sum[j] *= sign;"),
        ]
        return self._routine("integral", frame, _head(frame, "sum", count), inside), tuple(captured)

    def _piece(self, stmt: Integrate, frame: Frame, spell: Scope, abreast: Abreast | None) -> list[str]:
        """Add the integrals over the piece (p, q) to `sum`."""
        count, tested, estimated = len(stmt.values), stmt.tested, bool(stmt.estimates)
        block = [*([_stop("sum", len(assigned(stmt)))] if _is_long(stmt) else []), *frame.block(1)]
        nodes = None if abreast is None else Nodes(abreast, block, frame.block(len(frame.blocks) - 1) if abreast.has_exceptions else block)
        counted = self._is_counted(stmt)
        match stmt.rule:
            case Midpoint(points):
                return midpoint_piece(block, points, count, tested if estimated else 0, counted)
            case Gauss(n):
                self.orders.add(n)
                return gauss_piece(nodes or block, n, count, len(stmt.estimates), counted)
            case Rational() as rule:
                self.poles.add((rule.nodes, rule.power))
                (bend,) = stmt.bends
                spelled = spell(bend.when), [spell(c) for c in bend.coefficients]
                return rational_piece(block, rule, spelled, spell(stmt.base), Sums(count, len(stmt.estimates), 0, estimated, counted))
            case Adaptive() as rule:
                self.measured |= {rule.order} if stmt.watch else {rule.first, rule.order}
                bent = bool(stmt.bends) or stmt.infinite
                way: list[str] = []
                if bent:
                    bends = [(b, spell(b.when), [spell(c) for c in b.coefficients]) for b in stmt.bends]
                    scale = spell(stmt.scale) if stmt.infinite else ""
                    way = bent_piece(bends, spell(stmt.base), rule.cubic, stmt.infinite, scale)
                total = Sums(count, tested, len(stmt.watch), estimated, counted)
                places = Places(bent, any(b.kind == "end" for b in stmt.bends), needs_context(stmt.body, False))
                guard = None if stmt.guard is None else GuardText(frame.block(2), len(stmt.guard.seen))
                return [*way, *adaptive_piece(nodes or block, rule, total, places, guard)]

    def _is_counted(self, stmt: Integrate | Sample) -> bool:
        return self.counted and not any(isinstance(s, Integrate | Sample | Polygon | Segment) for s in compound(stmt.body))

    def _clipped(self, stmt: Polygon | Segment) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of a polygon or a segment."""
        given: dict[Arg, Arg] = {}
        if isinstance(stmt, Segment):
            stmt, given = _with_resolutions_passed(stmt)
        side_by_side = runs_side_by_side(stmt.body) and not (isinstance(stmt, Polygon) and not stmt.degree)
        distinct, adding = sums(stmt.values)
        body = [*self._steps(stmt.body), *adding]
        own = _spelled(stmt, "setup", "scales")
        context = needs_context((stmt,), self.counted)
        if isinstance(stmt, Polygon):
            blocks, variables = [list(self._steps(stmt.setup)), body], dict(zip(stmt.variables, COORDINATES, strict=False))
        else:
            blocks, variables = [list(self._steps(stmt.setup)), list(self._steps(stmt.scales)), body], {stmt.var: "x"}
        captured = captured_by(own, [step for block in blocks for step in block], variables)
        lanes = 1 if not side_by_side else LANES if isinstance(stmt, Polygon) else segment_lanes(stmt.nodes)
        whole = (len(blocks) - 1,) if lanes > 1 else ()  # values in lanes are not what parts take and keep
        frame = Frame(captured, blocks, own, context, variables, Spelling(by_value=self._by_value, whole=whole))
        if isinstance(stmt, Polygon):
            if stmt.degree not in (0, 2):
                self.triangles.add(stmt.degree)
            lines = polygon(stmt, frame, distinct, lanes, self.counted)
        else:
            self.units.add((stmt.nodes, segment_lanes(stmt.nodes)))
            lines = segment(stmt, frame, distinct, lanes, self.counted)
        inside = [*frame.opening(), *lines]
        kind = "polygon" if isinstance(stmt, Polygon) else "segment"
        head = _head(frame, "sum", len(stmt.results))
        routine = self._routine(kind, frame, head.replace("static", "TEG_INLINE", 1) if self.inlined else head, inside)
        return routine, tuple(given.get(arg, arg) for arg in captured)

    def _hyperbola(self, stmt: Hyperbola) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of the moments of a hyperbola."""
        self.branches.add(along_a_branch(stmt))
        scales = list(self._steps(stmt.scales))
        own = _spelled(stmt, "scales")
        captured = captured_by(own, scales, ())
        frame = Frame(captured, [scales], own, bool(stmt.ties), spelling=Spelling(by_value=self._by_value))
        inside = [*frame.opening(), *hyperbola(stmt, frame)]
        head = _head(frame, "sum", len(stmt.results))
        routine = self._routine("hyperbola", frame, head.replace("static", "TEG_INLINE", 1) if self.inlined else head, inside)
        return routine, tuple(captured)

    def _ellipse(self, stmt: Ellipse) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of the moments of an ellipse."""
        self.ellipses.add(c_ellipse.wanted(stmt))
        own = _spelled(stmt)
        captured = captured_by(own, [], ())
        frame = Frame(captured, [], own, False, spelling=Spelling(by_value=self._by_value))
        inside = [*frame.opening(), *c_ellipse.ellipse(stmt, frame)]
        routine = self._routine("ellipse", frame, _head(frame, "sum", len(stmt.results)), inside)
        return routine, tuple(captured)

    def _branch(self, stmt: When) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine for the body of a branch."""
        body = [*self._steps(stmt.body), *_yields(stmt.results)]
        captured = captured_by((), body, ())
        count = len(stmt.results)
        frame = Frame(captured, [body], (), needs_context((stmt,), self.counted), spelling=Spelling(by_value=self._by_value))
        single = count == 1
        inside = [*(["double f[1];"] if single else []), *frame.opening(), *frame.block(0), *(["return f[0];"] if single else [])]
        head = _head(frame, "f", count)
        routine = self._routine("branch", frame, head.replace("static", "TEG_INLINE", 1) if self.inlined else head, inside)
        return routine, tuple(captured)

    def _isolation(self, stmt: Isolate) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of an isolation: `f` holds g, g', g", then the six bounds and the noise."""
        enclosure = [*self._steps(stmt.enclosure), *_yields((*stmt.bounds, *stmt.curving, stmt.noise), 3)]
        point = [*self._steps(stmt.point), *_yields((stmt.value, stmt.slope, stmt.curvature))]
        own, variables = _spelled(stmt), {stmt.var: "x", stmt.left: "left", stmt.right: "right"}
        captured = captured_by(own, [*enclosure, *point], variables)
        frame = Frame(captured, [enclosure, point], own, needs_context((stmt,), self.counted), variables)
        spell = frame.scope()
        inside = [
            *frame.opening(),
            "double f[10] = {0.0};",
            *isolation(frame.block(0), frame.block(1), (spell(stmt.lo), spell(stmt.hi)), stmt),
        ]
        return self._routine("roots", frame, _head(frame, "root", len(assigned(stmt))), inside), tuple(captured)

    def _location(self, stmt: Locate) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of a location: `f` holds the bounds."""
        enclosure = [*self._steps(stmt.enclosure), *_yields(stmt.bounds)]
        own = _spelled(stmt)
        variables = {stmt.left: "left", stmt.right: "right", stmt.bottom: "bottom", stmt.top: "top"}
        captured = captured_by(own, enclosure, variables)
        frame = Frame(captured, [enclosure], own, needs_context((stmt,), self.counted), variables)
        count, spell = len(stmt.results), frame.scope()
        v, u = (spell(stmt.lo), spell(stmt.hi)), (spell(stmt.low), spell(stmt.high))
        slopes, counted = len(stmt.bounds) > 4, stmt.lost is not None
        inside = [*frame.opening(), "double f[12] = {0.0};", *location(frame.block(0), v, u, count, slopes, counted)]
        return self._routine("places", frame, _head(frame, "place", count + counted), inside), tuple(captured)

    def _sum(self, stmt: SumOver) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of a sum over points."""
        body = [*self._steps(stmt.body), *_yields(stmt.values)]
        captured = captured_by(_spelled(stmt), body, (stmt.var,))
        frame = Frame(captured, [body], _spelled(stmt), needs_context((stmt,), self.counted), {stmt.var: "x"})
        count = len(stmt.values)
        arrays = [*frame.array("f", count), *frame.array("points", max(1, len(stmt.points)), BREAKS_ON_STACK)]
        spell = frame.scope()
        points = [f"points[{i}] = {spell(arg)};" for i, arg in enumerate(stmt.points)]
        inside = [*arrays, *frame.opening(), *packed(points), *sum_over(frame.block(0), len(points), count)]
        return self._routine("sum", frame, _head(frame, "sum", count), inside), tuple(captured)

    def _sample(self, stmt: Sample) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of a mean over points."""
        body = [*self._steps(stmt.body), *_yields(stmt.values)]
        captured = captured_by((), body, stmt.points)
        names = [f"x{d}" for d in range(1, len(stmt.points) + 1)]
        frame = Frame(captured, [body], (), needs_context((stmt,), self.counted), dict(zip(stmt.points, names, strict=True)))
        values, tested = len(stmt.values), len(stmt.estimates)
        arrays = [*frame.array("f", values), *frame.array("part", values)]
        arrays += frame.array("all", tested * (REPLICATES if stmt.kind == "qmc" else 2)) if tested else []
        opening, block = frame.opening(), frame.block(0)
        if stmt.kind == "qmc":
            self.dimensions = max([self.dimensions, *(d + 1 for d in used_points(block, names))])
        inside = [*arrays, *opening, *sample_loop(stmt, block, names, self._is_counted(stmt), _stop("mean", values + tested))]
        return self._routine("mean", frame, _head(frame, "mean", values + tested), inside), tuple(captured)

    def _routine(self, kind: str, frame: Frame, signature: str, inside: list[str]) -> Routine:
        """Returns the routine of this text, in which '@' stands for its name."""
        text = "\n\n".join([*frame.parts, wrapped([signature, "{", *indent(*inside), "}"])])
        return self.once(kind, text, frame.indirect, frame.workspace, frame.context)

    def once(self, kind: str, text: str, indirect: bool = False, workspace: int = 0, context: bool = False) -> Routine:
        """Returns the routine of this text, which is printed unless it is known."""
        if text not in self._known:
            name = kind if kind == "element" else f"{kind}_{len(self._known) + 1}"
            self._known[text] = Routine(name, indirect, workspace, context)
            self.texts.append(text.replace("@", name))
        return self._known[text]


def _spelled(stmt: Stmt, *blocks: str) -> tuple[Arg, ...]:
    """Returns the arguments that a routine spells between its blocks: the numbers that a statement reads around it, and what it reads in
    some blocks. Its condition is spelled where the routine is called."""
    roles = ((role, arg) for role, arg in leaves(stmt) if isinstance(role, Operand))
    return tuple(arg for role, arg in roles if role.at in blocks or (not role.at and role.kind == "number"))


def _with_resolutions_passed(stmt: Segment) -> tuple[Segment, dict[Arg, Arg]]:
    """Returns a segment whose ties are resolved by arguments of its routine, and what these are: segments that differ in nothing else, as
    those along the sides of a polygon, are then one routine."""
    inside = {name for s in (*stmt.setup, *stmt.scales) for name in assigned(s)}
    given: dict[Arg, Arg] = {}
    half_lines = list(stmt.half_lines)
    for i, g in enumerate(stmt.half_lines):
        if g.k is not None and g.resolution not in inside:
            given[f"b+{i}"] = g.resolution
            half_lines[i] = replace(g, resolution=f"b+{i}")
    return replace(stmt, half_lines=tuple(half_lines)), given


def _pattern(stmt: Integrate) -> tuple[object, list[str]] | None:
    """Returns the shape of a short integral without its names, and the names in the order in which they are met; None for other
    integrals."""
    lines = (*stmt.flags, *stmt.body)
    plain = isinstance(stmt.rule, Gauss) and not (stmt.bends or stmt.watch or stmt.infinite or stmt.estimates or stmt.ends)
    if not plain or len(lines) > SHORT or not all(isinstance(s, Assign) and s.op != "call" for s in lines):
        return None
    number: dict[str, int] = {stmt.var: 0}
    parts: list[object] = [stmt.rule, len(stmt.flags), len(stmt.results), len(stmt.breaks), len(stmt.values)]

    def note(args: Sequence[Arg | None]) -> None:
        for arg in args:
            parts.append(f"{arg[0]}{number.setdefault(arg, len(number))}" if isinstance(arg, str) else repr(arg))

    note((stmt.lo, stmt.hi, *stmt.breaks, stmt.need, *stmt.values))
    for line in lines:
        assert isinstance(line, Assign)
        parts += [line.op, len(line.args)]
        note((line.name, *line.args))
    return tuple(parts), list(number)


def needs_context(block: tuple[Stmt, ...], counted: bool) -> bool:
    """Returns whether a run can meet a tie, miss a tolerance, have too little room, take long, or count."""
    return has_ties(block) or any(
        isinstance(s, Sample | Isolate | Locate)
        or (isinstance(s, Polygon | Segment) and counted)
        or (isinstance(s, Integrate) and (counted or isinstance(s.rule, Adaptive | Rational) or _is_long(s)))
        for s in compound(block)
    )


def _is_long(stmt: Integrate) -> bool:
    """Returns whether at a node so much is done that a call may have to be stopped before it, or there are very many."""
    inside = (s for s in compound(stmt.body) if isinstance(s, Integrate | Sample))
    deep = any(isinstance(s, Sample) or any(isinstance(other, Integrate) for other in compound(s.body)) for s in inside)
    return deep or (isinstance(stmt.rule, Midpoint) and stmt.rule.nodes > MANY)


def _stop(results: str, count: int) -> str:
    """Leave a routine if the call was stopped."""
    return f"if (teg_stopped(ctx->pace)) {_not_a_number(results, count)}"


def _not_a_number(results: str, count: int) -> str:
    return "return NAN;" if count == 1 else f"{{ teg_fill({results}, {count}, NAN); return; }}"


def _head(frame: Frame, results: str, count: int) -> str:
    """Returns the head of a routine: one result is returned, more are written to an array."""
    return f"static double {frame.signature()}" if count == 1 else f"static void {frame.signature(results)}"


def _arrays_of(stmt: Integrate, frame: Frame, abreast: Abreast | None, most: int) -> list[str]:
    """Returns the declarations of what the nodes of an integral need; a block has so many values at most."""
    arrays = frame.array("f", most)
    if abreast is not None:
        arrays += [*frame.array("values", abreast.capacity * abreast.count, ABREAST_ON_STACK), *abreast.arrays()]
    if isinstance(stmt.rule, Midpoint) and stmt.estimates:
        arrays += frame.array("last", stmt.tested)
    if isinstance(stmt.rule, Rational):
        arrays += frame.array("sizes", 3 * len(stmt.values))
    if isinstance(stmt.rule, Adaptive):
        arrays += frame.array("measured", 8 * stmt.tested)
        arrays += frame.array("plain", len(stmt.values) - stmt.tested) if len(stmt.values) > stmt.tested else []
        arrays += frame.array("whole", stmt.tested)
        arrays += frame.array("spent", stmt.tested)
    if stmt.guard is not None and isinstance(stmt.rule, Adaptive):
        arrays += frame.array("above", (MAX_DEPTH + 1) * stmt.tested)
        arrays += frame.array("seen_at", len(stmt.guard.seen) * max(stmt.rule.first, stmt.rule.order))
    return arrays


def _yields(values: Sequence[Arg], place: int = 0) -> Iterator[Step]:
    """Yields the values of a block, written to `f` from there on, a few a step."""
    for first in range(0, len(values), 8):
        some = values[first : first + 8]
        yield Step((), tuple(some), lines=partial(_yielded, place + first, some), weight=len(some), locals=(RESULTS,))


def _yielded(first: int, values: Sequence[Arg], scope: Scope) -> list[str]:
    return packed(f"f[{j}] = {scope(value)};" for j, value in enumerate(values, first))
