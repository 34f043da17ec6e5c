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

from collections.abc import Iterator, Sequence
from dataclasses import replace

from teg.backends.c import ellipse as c_ellipse
from teg.backends.c.calls import called
from teg.backends.c.frame import Frame, Routine, Scope, Spelling, Step, assignments, captured_by
from teg.backends.c.hyperbola import along_a_branch, hyperbola
from teg.backends.c.integrals import Integrals
from teg.backends.c.polygon import (
    COORDINATES,
    LANES,
    polygon,
    runs_side_by_side,
    segment,
    segment_lanes,
    sums,
)
from teg.backends.c.polyhedron import polyhedron, polyhedron_lanes
from teg.backends.c.quadrature import (
    isolation,
    location,
    sum_over,
)
from teg.backends.c.routines import Routines, array_of_places, heading, needs_context, spelled, stop, yields
from teg.backends.c.samples import sample_loop, used_points
from teg.backends.c.text import packed
from teg.backends.lazily import with_lazy_choices
from teg.numerics.sobol import REPLICATES
from teg.program import (
    Arg,
    Assign,
    Called,
    Ellipse,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Polygon,
    Polyhedron,
    Program,
    Sample,
    Segment,
    Stmt,
    SumOver,
    When,
    assigned,
    compound,
)

INLINED = 6
"""Polyhedra, polygons and segments up to which each is compiled where it stands."""
Together = tuple[int, ...]
"""Functions of a program that are called together, by their numbers."""


def function_name(called: Together) -> str:
    """Returns the name of functions of a program that are called together."""
    return "_".join(["teg_function", *map(str, called)])


class Printer(Routines):
    """Prints a program as routines."""

    def __init__(self, counted: bool = False) -> None:
        super().__init__(counted)
        self.called: set[Together] = set()
        self.functions: Sequence[Called] = ()
        self.integrals = Integrals(self, self.steps)

    def element(
        self, program: Program, kind: str = "element", by_value: int | None = None, told: str | None = None, lazy: bool = True
    ) -> Routine:
        """Returns the routine of the whole program at one point: from the parameters it writes the outputs to `f`. There is one "element",
        "run"s are numbered. It returns the boolean `told`, if there is one. `lazy`: what one branch of a choice needs is computed there."""
        kinds = {type(s) for s in compound(program.body)}
        if lazy and told is None and (Polyhedron in kinds or kinds.isdisjoint((Polygon, Segment, Hyperbola, Ellipse, When))):
            program = with_lazy_choices(program)
        self.inlined = sum(isinstance(s, Polyhedron | Polygon | Segment | Hyperbola | Ellipse) for s in compound(program.body)) <= INLINED
        self.functions = program.functions
        steps = [*self.steps(program.body), *yields(program.outputs)]
        parameters, context = [f"p{i}" for i in range(len(program.parameters))], needs_context(program.body, self.counted)
        frame = Frame(parameters, [steps], () if told is None else (told,), context, spelling=Spelling("p", by_value))
        inside = [*frame.opening(), *frame.block(0)]
        if told is not None:
            inside.append(f"return {frame.scope()(told)};")
        storage = "TEG_INLINE" if kind == "run" and self.inlined and not frame.indirect else "static"
        return self.routine(kind, frame, f"{storage} {'void' if told is None else 'int'} {frame.signature('f')}", inside)

    def steps(self, block: Sequence[Stmt]) -> Iterator[Step]:
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

    def _call(
        self, stmt: Integrate | Isolate | Locate | SumOver | Sample | Polygon | Polyhedron | Segment | Hyperbola | Ellipse | When
    ) -> Step:
        """Returns the call of a statement's routine."""
        match stmt:
            case Integrate():
                routine, captured = self.integrals.routine(stmt)
            case Isolate():
                routine, captured = self._isolation(stmt)
            case Locate():
                routine, captured = self._location(stmt)
            case SumOver():
                routine, captured = self._sum(stmt)
            case Sample():
                routine, captured = self._sample(stmt)
            case Polyhedron() | Polygon() | Segment():
                routine, captured = self._clipped(stmt)
            case Hyperbola():
                routine, captured = self._hyperbola(stmt)
            case Ellipse():
                routine, captured = self._ellipse(stmt)
            case When():
                routine, captured = self._branch(stmt)
        return called(stmt, routine, captured)

    def _clipped(self, stmt: Polyhedron | Polygon | Segment) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of a polyhedron, a polygon or a segment."""
        given: dict[Arg, Arg] = {}
        if isinstance(stmt, Segment):
            stmt, given = _with_resolutions_passed(stmt)
        distinct, adding = sums(stmt.values)
        blocks = [list(self.steps(stmt.setup)), [*self.steps(stmt.body), *adding]]
        match stmt:
            case Polyhedron():
                kind, variables, lanes = "polyhedron", dict(zip(stmt.variables, "xyz", strict=True)), polyhedron_lanes(stmt.degree)
            case Polygon():
                kind, variables, lanes = "polygon", dict(zip(stmt.variables, COORDINATES, strict=False)), LANES if stmt.degree else 1
            case Segment():
                kind, variables, lanes = "segment", {stmt.var: "x"}, segment_lanes(stmt.nodes)
                blocks.insert(1, list(self.steps(stmt.scales)))
        lanes = lanes if runs_side_by_side(stmt.body) else 1
        own = spelled(stmt, "setup", "scales")
        captured = captured_by(own, [step for block in blocks for step in block], variables)
        whole = (len(blocks) - 1,) if lanes > 1 else ()  # values in lanes are not what parts take and keep
        frame = Frame(captured, blocks, own, needs_context((stmt,), self.counted), variables, Spelling(by_value=self.by_value, whole=whole))
        inside = [*frame.opening(), *self._inside_of_clipped(stmt, frame, distinct, lanes)]
        head = heading(frame, "sum", len(stmt.results))
        routine = self.routine(kind, frame, head.replace("static", "TEG_INLINE", 1) if self.inlined else head, inside)
        return routine, tuple(given.get(arg, arg) for arg in captured)

    def _inside_of_clipped(self, stmt: Polyhedron | Polygon | Segment, frame: Frame, distinct: Sequence[Arg], lanes: int) -> list[str]:
        match stmt:
            case Polyhedron():
                self.tetrahedra |= {stmt.degree} if stmt.degree > 1 else set()
                return polyhedron(stmt, frame, distinct, lanes, self.counted)
            case Polygon():
                self.triangles |= set() if stmt.degree in (0, 2) else {stmt.degree}
                return polygon(stmt, frame, distinct, lanes, self.counted)
            case Segment():
                self.units.add((stmt.nodes, segment_lanes(stmt.nodes)))
                return segment(stmt, frame, distinct, lanes, self.counted)

    def _hyperbola(self, stmt: Hyperbola) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of the moments of a hyperbola."""
        self.branches.add(along_a_branch(stmt))
        scales = list(self.steps(stmt.scales))
        own = spelled(stmt, "scales")
        captured = captured_by(own, scales, ())
        frame = Frame(captured, [scales], own, bool(stmt.ties), spelling=Spelling(by_value=self.by_value))
        inside = [*frame.opening(), *hyperbola(stmt, frame)]
        head = heading(frame, "sum", len(stmt.results))
        routine = self.routine("hyperbola", frame, head.replace("static", "TEG_INLINE", 1) if self.inlined else head, inside)
        return routine, tuple(captured)

    def _ellipse(self, stmt: Ellipse) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of the moments of an ellipse."""
        self.ellipses.add(c_ellipse.wanted(stmt))
        own = spelled(stmt)
        captured = captured_by(own, [], ())
        frame = Frame(captured, [], own, False, spelling=Spelling(by_value=self.by_value))
        inside = [*frame.opening(), *c_ellipse.ellipse(stmt, frame)]
        routine = self.routine("ellipse", frame, heading(frame, "sum", len(stmt.results)), inside)
        return routine, tuple(captured)

    def _branch(self, stmt: When) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine for the body of a branch."""
        body = [*self.steps(stmt.body), *yields(stmt.results)]
        captured = captured_by((), body, ())
        count = len(stmt.results)
        frame = Frame(captured, [body], (), needs_context((stmt,), self.counted), spelling=Spelling(by_value=self.by_value))
        single = count == 1
        inside = [*(["double f[1];"] if single else []), *frame.opening(), *frame.block(0), *(["return f[0];"] if single else [])]
        head = heading(frame, "f", count)
        routine = self.routine("branch", frame, head.replace("static", "TEG_INLINE", 1) if self.inlined else head, inside)
        return routine, tuple(captured)

    def _isolation(self, stmt: Isolate) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of an isolation: `f` holds g, g', g", then the six bounds and the noise."""
        enclosure = [*self.steps(stmt.enclosure), *yields((*stmt.bounds, *stmt.curving, stmt.noise), 3)]
        point = [*self.steps(stmt.point), *yields((stmt.value, stmt.slope, stmt.curvature))]
        own, variables = spelled(stmt), {stmt.var: "x", stmt.left: "left", stmt.right: "right"}
        captured = captured_by(own, [*enclosure, *point], variables)
        frame = Frame(captured, [enclosure, point], own, needs_context((stmt,), self.counted), variables)
        spell = frame.scope()
        inside = [
            *frame.opening(),
            "double f[10] = {0.0};",
            *isolation(frame.block(0), frame.block(1), (spell(stmt.lo), spell(stmt.hi), spell(stmt.tol)), stmt),
        ]
        return self.routine("roots", frame, heading(frame, "root", len(assigned(stmt))), inside), tuple(captured)

    def _location(self, stmt: Locate) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of a location: `f` holds the bounds."""
        enclosure = [*self.steps(stmt.enclosure), *yields(stmt.bounds)]
        own = spelled(stmt)
        variables = {stmt.left: "left", stmt.right: "right", stmt.bottom: "bottom", stmt.top: "top"}
        captured = captured_by(own, enclosure, variables)
        frame = Frame(captured, [enclosure], own, needs_context((stmt,), self.counted), variables)
        count, spell = len(stmt.results), frame.scope()
        v, u = (spell(stmt.lo), spell(stmt.hi)), (spell(stmt.low), spell(stmt.high))
        slopes, counted = len(stmt.bounds) > 4, stmt.lost is not None
        inside = [*frame.opening(), "double f[12] = {0.0};", *location(frame.block(0), v, u, count, slopes, counted)]
        return self.routine("places", frame, heading(frame, "place", count + counted), inside), tuple(captured)

    def _sum(self, stmt: SumOver) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of a sum over points."""
        body = [*self.steps(stmt.body), *yields(stmt.values)]
        captured = captured_by(spelled(stmt), body, (stmt.var,))
        frame = Frame(captured, [body], spelled(stmt), needs_context((stmt,), self.counted), {stmt.var: "x"})
        count = len(stmt.values)
        arrays = [*frame.array("f", count), *array_of_places(frame, "points", max(1, len(stmt.points)))]
        spell = frame.scope()
        points = [f"points[{i}] = {spell(arg)};" for i, arg in enumerate(stmt.points)]
        inside = [*arrays, *frame.opening(), *packed(points), *sum_over(frame.block(0), len(points), count)]
        return self.routine("sum", frame, heading(frame, "sum", count), inside), tuple(captured)

    def _sample(self, stmt: Sample) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of a mean over points."""
        body = [*self.steps(stmt.body), *yields(stmt.values)]
        captured = captured_by((), body, stmt.points)
        names = [f"x{d}" for d in range(1, len(stmt.points) + 1)]
        frame = Frame(captured, [body], (), needs_context((stmt,), self.counted), dict(zip(stmt.points, names, strict=True)))
        values, tested = len(stmt.values), len(stmt.estimates)
        arrays = [*frame.array("f", values), *frame.array("part", values)]
        arrays += frame.array("all", 3 * tested * (REPLICATES if stmt.kind == "qmc" else 1)) if tested else []
        opening, block = frame.opening(), frame.block(0)
        if stmt.kind == "qmc":
            self.dimensions = max([self.dimensions, *(d + 1 for d in used_points(block, names))])
        inside = [*arrays, *opening, *sample_loop(stmt, block, names, self.is_counted(stmt), stop("mean", values + tested))]
        return self.routine("mean", frame, heading(frame, "mean", values + tested), inside), tuple(captured)


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
