"""The NumPy backend: the reference that the other printers are held against.

    compile_numpy(program)  ->  NumpyKernel: a call with columns of the batch gives (outputs, n)

A program becomes flat Python functions, one a block, over arrays of lanes (see `lanes.py`, `integrals.py`):

    def kernel(run, p0, p1):                                     the outermost block, on the batch
        v0 = p0 * p1
        v1, = integral_0(run, (0.0, p1, v0), (), (), (v0,))          bounds and breaks, bends, values for flags, for body
        return (v1,)

    def body_0(run, x0, v0): …
    integral_0 = integrals.GaussIntegral(flags=None, body=body_0, values=1, piece_width=7, node_width=3, nodes=4)

Roots, sums over them and common zeros are called likewise (see `isolate.py`, `locate.py`):

    v1, v2 = isolation_1(run, (0.0, p1), (v0,), (v0,))           bounds, values for enclosure, for point
    v3, = sum_2(run, (v1, v2), (v0,))                            points, values for body
    v4, = location_3(run, (0.0, p1, -1.0, 1.0), (v0,))           bounds of v, of u, values for enclosure
    v5, = mean_4(run, (v0,))                                     values for body: a mean over points (see `samples.py`)

A long block is cut into parts of bounded size, which hand on the values that outlive them in a dictionary.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, assert_never, cast

import numpy as np
import numpy.typing as npt

from teg.backends.branches import with_selects
from teg.backends.numpy import adaptive, integrals, isolate, lanes, locate, poles
from teg.backends.numpy import ellipse as ellipses
from teg.backends.numpy import guard as guards
from teg.backends.numpy import hyperbola as hyperbolas
from teg.backends.numpy import polygon as polygons
from teg.backends.numpy import polyhedron as polyhedra
from teg.backends.numpy import runtime as rt
from teg.backends.numpy import samples as sampling
from teg.backends.text import Dialect, assignment, inside, strict, value
from teg.program import (
    ABSOLUTE_FLOOR,
    MAX_EVALUATIONS,
    TEXTS,
    WEIGHED,
    Adaptive,
    Arg,
    Assign,
    Ellipse,
    Gauss,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Midpoint,
    Outcome,
    Polygon,
    Polyhedron,
    Program,
    Rational,
    Sample,
    Segment,
    Stmt,
    SumOver,
    Unbound,
    When,
    assigned,
    blocks,
    captured,
    compound,
    free_in,
    without_branches,
)

DIALECT = Dialect("np", call="function_{k}(None, {arguments})[0]")
MEMORY = 256 * 2**20
CALL = 16
"""Doubles a lane that the body of a function is taken to hold: what surrounds it is printed for all bodies."""
PART = 400
"""Statements a printed function may have: longer ones keep dead arrays alive."""


def compile_numpy(program: Program, *, memory: int = MEMORY, most: int | None = None) -> NumpyKernel:
    """Returns a kernel that keeps its temporary arrays within about `memory` bytes; `most` bounds evaluations a point."""
    return NumpyKernel(program, memory, most)


class NumpyKernel:
    """A program as Python functions over NumPy arrays; `source` is their text."""

    def __init__(self, program: Program, memory: int = MEMORY, most: int | None = None) -> None:
        text, width = _kept(Unbound(program)) if program.functions else _printed(program)
        self.program = program
        self.memory, self.most = memory, MAX_EVALUATIONS if most is None else most
        functions = [_kept(Unbound(cast(Program, f.body)))[0] for f in program.functions]
        self.source = "\n".join([text, *(_titled(k, body) for k, body in enumerate(functions))])
        self._width = width
        self._room = max(1, memory // 8 // (1 + 2 * depth(without_branches(program).body)))
        scope: dict[str, Any] = {"np": np, "rt": rt, "sampling": sampling, "polygons": polygons, "polyhedra": polyhedra}
        scope |= {"integrals": integrals, "adaptive": adaptive, "isolate": isolate, "locate": locate, "lanes": lanes}
        scope |= {"poles": poles, "hyperbolas": hyperbolas, "ellipses": ellipses, "guards": guards}
        for k, body in enumerate(functions):
            scope[f"function_{k}"] = _made(body, dict(scope))
        self._function = _made(text, scope)

    def __reduce__(self) -> tuple[object, ...]:
        return (NumpyKernel, (self.program, self.memory, self.most))

    def __call__(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> npt.NDArray[np.float64]:
        """Returns the outputs of a batch of n, (outputs, n); a column is (n,), or () where the batch shares it."""
        return self._run(columns, n)[0]

    def outcome(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> Outcome:
        """Returns the outputs, whether a tolerance was missed, and how many evaluations it took."""
        out, _, run = self._run(columns, n)
        return Outcome(out, run.missed, run.evaluations, run.crowded, run.tied)

    def met_ties(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> tuple[int, ...]:
        """Returns the numbers k of the ties that a call with these arguments meets, ascending."""
        return tuple(sorted(self._run(columns, n)[1]))

    def values_and_ties(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> tuple[npt.NDArray[np.float64], tuple[int, ...], bool]:
        """Returns the outputs, the numbers k of the ties that were met, ascending, and whether evaluations ended before they were done."""
        out, met, run = self._run(columns, n)
        return out, tuple(sorted(met)), run.ended

    def in_order(self, columns: Sequence[npt.NDArray[np.float64]], n: int, order: int) -> npt.NDArray[np.float64]:
        """Returns the outputs with ties resolved in one order, +1 or -1, and no averaging; in one chunk."""
        with np.errstate(all="ignore"):
            return self._outputs(
                lanes.Run(order, self._room, most=self.most * float(n)), [np.asarray(c, dtype=np.float64)[()] for c in columns], n
            )

    def _run(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> tuple[npt.NDArray[np.float64], set[int], lanes.Run]:
        """Returns the outputs, the ties that were met, and a run that holds what all parts of the batch noted."""
        values = [np.asarray(column, dtype=np.float64) for column in columns]
        shared = all(v.ndim == 0 for v in values)
        out = np.empty((len(self.program.outputs), n))
        met: set[int] = set()
        noted = lanes.Run(+1, self._room)
        with np.errstate(all="ignore"):
            step = n if shared else lanes.Run(1, self._room).chunk(self._width)
            for start in range(0, n, max(1, step)):
                part = slice(start, start + step)
                arguments = [v[part] if v.ndim else v[()] for v in values]
                most = self.most * float(min(step, n - start))
                run = lanes.Run(+1, self._room, most=most)
                out[:, part] = self._outputs(run, arguments, min(step, n - start))
                if run.met:
                    again = lanes.Run(-1, self._room, most=most)
                    reverse = self._outputs(again, arguments, min(step, n - start))
                    noted.tied |= not self.program.weighs_ties or self._matters(out[:, part], reverse, arguments, most)
                    out[:, part] = 0.5 * out[:, part] + 0.5 * reverse
                    met |= run.met | again.met
                    noted.add(again)
                noted.add(run)
        return out, met, noted

    def _matters(self, one: npt.NDArray[np.float64], other: npt.NDArray[np.float64], arguments: Sequence[Any], most: float) -> bool:
        """Returns whether ties matter: results differ in both orders, or where all ties are true, or false."""
        if not _is_same(one, other):
            return True
        runs = (lanes.Run(order, self._room, most=most) for order in (2, -2))
        return not all(_is_same(one, self._outputs(run, arguments, one.shape[1])) for run in runs)

    def _outputs(self, run: lanes.Run, arguments: Iterable[Any], n: int) -> npt.NDArray[np.float64]:
        out = np.empty((len(self.program.outputs), n))
        for i, found in enumerate(self._function(run, *arguments)):
            out[i] = found
        return out


def _is_same(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> bool:
    """Returns whether results are the same in each lane, relative to the largest of the lane; NaN is the same as NaN."""
    most = np.abs(np.where(np.isfinite(one), one, 0.0)).max(axis=0, initial=0.0)
    return bool(((np.abs(one - other) <= WEIGHED * most) | (one == other) | (np.isnan(one) & np.isnan(other))).all())


def _printed(program: Program) -> tuple[str, int]:
    """Returns the text of a program without the bodies of its functions, and how many doubles a lane it may hold."""
    printer = _Printer(with_selects(program))
    return "\n".join(printer.lines), printer.width


@lru_cache(maxsize=TEXTS)
def _kept(unbound: Unbound) -> tuple[str, int]:
    """Returns the same of a program that calls functions, or is the body of one: printed once for all bodies, and for all calls."""
    return _printed(unbound.program)


def _made(text: str, scope: dict[str, Any]) -> Any:
    """Returns the function of a printed program."""
    exec(compile(text, "<teg numpy kernel>", "exec"), scope)
    return scope["kernel"]


def _titled(k: int, body: str) -> str:
    """Returns the text of function k, as it is shown."""
    return f"\n# function_{k}: the kernel of\n{body}"


def depth(block: tuple[Stmt, ...]) -> int:
    """Returns the depth of integrals, searches for roots and sums inside one another."""
    inner = [1 + max((depth(b) for b in blocks(s)), default=0) for s in block if not isinstance(s, Assign)]
    return max(inner, default=0)


def of_bends(stmt: Integrate) -> list[Arg]:
    """Returns the arguments that the bends and tails of an integral take from outside: its base, scale and reach, and the coefficients of
    each bend; none if it has neither."""
    if not stmt.bends and not stmt.infinite:
        return []
    return [stmt.base, stmt.scale, *[stmt.reach] * stmt.is_slow, *(c for b in stmt.bends for c in b.coefficients)]


class _Printer:
    """Prints blocks into `lines`, outermost first; the statements with blocks of their own wait in a queue."""

    def __init__(self, program: Program) -> None:
        self.lines = ['"""NumPy kernel, generated by teg."""', ""]
        self.lines += [f"# p{i}: {name!r}" for i, name in enumerate(program.parameters)]
        self.waiting: deque[
            tuple[int, Integrate | Isolate | Locate | SumOver | Sample | Polygon | Polyhedron | Segment | Hyperbola | Ellipse]
        ] = deque()
        self.printed = 0
        parameters = [f"p{i}" for i in range(len(program.parameters))]
        self.width = self.function("kernel", parameters, program.body, program.outputs)
        while self.waiting:
            self.blocks(*self.waiting.popleft())
        self.lines.append("")

    def blocks(
        self, number: int, stmt: Integrate | Isolate | Locate | SumOver | Sample | Polygon | Polyhedron | Segment | Hyperbola | Ellipse
    ) -> None:
        """The functions of a statement, and the object that runs them."""
        match stmt:
            case Integrate():
                self.integral(number, stmt)
            case Isolate():
                self.isolation(number, stmt)
            case Locate():
                self.location(number, stmt)
            case SumOver():
                self.sum(number, stmt)
            case Sample():
                self.mean(number, stmt)
            case Polygon() | Polyhedron() | Segment():
                self.domain(number, stmt)
            case Hyperbola():
                self.hyperbola(number, stmt)
            case Ellipse():
                kinds = inside(repr((m.kind, tuple((j, k) for j, k, _ in m.terms), m.axes)) for m in stmt.moments)
                self.lines += [
                    "",
                    "",
                    f"ellipse_{number} = ellipses.EllipseMoments(({kinds}), ({inside(str(g.closed) for g in stmt.half_planes)}))",
                ]
            case _:
                assert_never(stmt)

    def integral(self, number: int, stmt: Integrate) -> None:
        for_flags, (for_body, flagged) = captured(stmt, "flags")[0], captured(stmt, "body", "block")
        flags, piece_width = "None", len(for_flags) + len(for_body) + 6
        if stmt.flags or stmt.need is not None or stmt.bends:
            flags = f"flags_{number}"
            found = [True if stmt.need is None else stmt.need, *(b.when for b in stmt.bends), *flagged]
            piece_width += self.function(flags, [stmt.var, *stmt.ends, *for_flags], stmt.flags, found)
        body = f"body_{number}"
        names = [*for_body, *flagged]
        match stmt.rule:
            case Gauss(nodes):
                kind, rule = "integrals.GaussIntegral", f"nodes={nodes}"
            case Rational(nodes, power):
                kind, rule = "poles.RationalIntegral", f"nodes={nodes}, power={power}"
            case Midpoint(nodes):
                kind, rule = "integrals.MidpointIntegral", f"nodes={nodes}"
            case Adaptive(tol, first, order, cubic, closed, floor):
                kind, rule = "adaptive.AdaptiveIntegral", f"tol={_text(tol)}, first={first}, order={order}, cubic={cubic!r}"
                rule += f", closed={closed!r}" if closed else ""
                rule += f", floor={_text(floor)}" if floor != ABSOLUTE_FLOOR else ""
                rule += f", watched={len(stmt.watch)}" if stmt.watch else ""
                if stmt.guard is not None:
                    rule += f", guard=guards.Guard(guard_{number}, {len(stmt.guard.upper)})"
            case _:
                assert_never(stmt.rule)
        node_width = self.function(body, [stmt.var, *names], stmt.body, stmt.at_nodes)
        if stmt.guard is not None:
            guard, bounds = stmt.guard, stmt.guard.bounds
            node_width += len(guard.seen) + self.function(f"guard_{number}", [guard.left, guard.right, *names], guard.block, bounds)
        leaf = not any(isinstance(s, Integrate | Sample | Polygon | Polyhedron | Segment) for s in compound(stmt.body))
        counts = f"values={len(stmt.values)}, tested={stmt.tested}, estimated={bool(stmt.estimates)!r}, leaf={leaf!r}"
        fields = f"flags={flags}, body={body}, {counts}, piece_width={piece_width}, node_width={node_width}, infinite={stmt.infinite!r}"
        fields += ", slow=True" * stmt.is_slow + ", ends=True" * bool(stmt.ends)
        bends = f"bends=({inside(repr(b.kind) for b in stmt.bends)})"
        self.lines += ["", "", f"integral_{number} = {kind}(", f"    {fields},", f"    {bends}, {rule}", ")"]

    def isolation(self, number: int, stmt: Isolate) -> None:
        for_enclosure, for_point = captured(stmt, "enclosure")[0], captured(stmt, "point")[0]
        enclosure, point = f"enclosure_{number}", f"point_{number}"
        enclosed = (*stmt.bounds, *stmt.curving, stmt.noise)
        enclosure_width = self.function(enclosure, [stmt.left, stmt.right, *for_enclosure], stmt.enclosure, enclosed)
        at = stmt.value, stmt.slope, stmt.curvature
        point_width = self.function(point, [stmt.var, *for_point], stmt.point, at)
        blocks = f"enclosure={_sized(enclosure, enclosed, enclosure_width)}, point={_sized(point, at, point_width)}"
        fields = f"count={len(stmt.results)}, estimated={bool(stmt.errors)!r}, tol={_text(stmt.tol)}, width={stmt.width}"
        self.lines += ["", "", f"isolation_{number} = isolate.Isolation(", f"    {blocks},", f"    {fields}", ")"]

    def location(self, number: int, stmt: Locate) -> None:
        enclosure = f"enclosure_{number}"
        sides = [stmt.left, stmt.right, stmt.bottom, stmt.top]
        width = self.function(enclosure, [*sides, *captured(stmt, "enclosure")[0]], stmt.enclosure, stmt.bounds)
        fields = f"enclosure={_sized(enclosure, stmt.bounds, width)}, results={len(stmt.results)}, counts={stmt.lost is not None}"
        self.lines += ["", "", f"location_{number} = locate.Location({fields})"]

    def sum(self, number: int, stmt: SumOver) -> None:
        body = f"body_{number}"
        width = self.function(body, [stmt.var, *captured(stmt, "body")[0]], stmt.body, stmt.values)
        self.lines += ["", "", f"sum_{number} = isolate.PointSum(body={_sized(body, stmt.values, width)})"]

    def mean(self, number: int, stmt: Sample) -> None:
        body, tested = f"body_{number}", len(stmt.estimates)
        width = self.function(body, [*stmt.points, *captured(stmt, "body")[0]], stmt.body, stmt.values) + len(stmt.values)
        rule = f"kind={stmt.kind!r}, seed={stmt.seed}, dimensions={len(stmt.points)}, count={stmt.count}"
        leaf = not any(isinstance(s, Integrate | Sample | Polygon | Polyhedron | Segment) for s in compound(stmt.body))
        counts = f"values={len(stmt.values)}, tested={tested}, estimated={tested > 0!r}, width={width}, leaf={leaf!r}"
        self.lines += ["", "", f"mean_{number} = sampling.Mean(", f"    body={body}, {rule},", f"    {counts}", ")"]

    def domain(self, number: int, stmt: Polygon | Polyhedron | Segment) -> None:
        for_setup = captured(stmt, "setup")[0]
        (for_scales, to_scales), (for_body, to_body) = captured(stmt, "scales"), captured(stmt, "body")
        setup, body = f"setup_{number}", f"body_{number}"
        variables = [stmt.var] if isinstance(stmt, Segment) else list(stmt.variables)
        lines = [arg for g in stmt.half_lines for arg in (g.first, g.last, g.resolution, g.size)] if isinstance(stmt, Segment) else []
        self.function(setup, for_setup, stmt.setup, [*to_scales, *to_body, *lines, *stmt.factors])
        width = self.function(body, [*variables, *for_body, *to_body], stmt.body, stmt.values)
        fields = f"setup={setup}, body={body}, values={len(stmt.values)}, width={width}"
        if isinstance(stmt, Polygon):
            closed = inside(repr(g.closed) for g in stmt.half_planes)
            self.lines += ["", "", f"polygon_{number} = polygons.PolygonIntegral(", f"    {fields},"]
            self.lines += [f"    closed=({closed}), degree={stmt.degree}, triangle={bool(stmt.corners)}", ")"]
            return
        if isinstance(stmt, Polyhedron):
            closed = inside(repr(g.closed) for g in stmt.half_spaces)
            self.lines += ["", "", f"polyhedron_{number} = polyhedra.PolyhedronIntegral(", f"    {fields},"]
            self.lines += [f"    closed=({closed}), degree={stmt.degree}", ")"]
            return
        scales = "None"
        tying = [g for g in stmt.half_lines if g.k is not None]
        if tying:
            scales = f"scales_{number}"
            self.function(scales, [*for_scales, *to_scales], stmt.scales, [g.scale for g in tying])
        kinds = inside(repr((g.closed, g.k)) for g in stmt.half_lines)
        self.lines += ["", "", f"segment_{number} = polygons.SegmentIntegral(", f"    {fields},"]
        self.lines += [f"    scales={scales}, lines=({kinds}), nodes={stmt.nodes}, passed={len(to_scales)}", ")"]

    def hyperbola(self, number: int, stmt: Hyperbola) -> None:
        scales, for_scales = f"scales_{number}", captured(stmt, "scales")[0]
        self.function(scales, for_scales, stmt.scales, stmt.scale)
        kinds = [repr((m.kind, tuple((j, k) for j, k, _ in m.terms))) for m in stmt.moments]
        self.lines += ["", "", f"hyperbola_{number} = hyperbolas.HyperbolaMoments("]
        self.lines += [f"    scales={scales}, ties={stmt.ties!r},", f"    kinds=({inside(kinds)})", ")"]

    def function(self, name: str, parameters: Sequence[str], block: tuple[Stmt, ...], results: Sequence[Arg]) -> int:
        """Prints a block as a function; returns how many doubles a lane it may hold."""
        signature = ", ".join(["run", *parameters])
        if len(block) > PART:
            return self.parts(name, signature, parameters, block, results)
        self.lines += ["", "", f"def {name}({signature}):"]
        width = self.statements(block) + len(parameters)
        self.lines.append(f"    return ({inside(_text(r) for r in results)})")
        return width

    def parts(
        self,
        name: str,
        signature: str,
        parameters: Sequence[str],
        block: tuple[Stmt, ...],
        results: Sequence[Arg],
    ) -> int:
        """Prints a long block as functions of PART statements, which share a dictionary `s`."""
        parts = [block[i : i + PART] for i in range(0, len(block), PART)]
        uses = [list(free_in(part)) for part in parts]
        last = {n: i for i, part in enumerate(uses) for n in part}
        last |= dict.fromkeys((r for r in results if isinstance(r, str)), len(parts))
        shared = [[n for s in part for n in assigned(s) if last.get(n, i) > i] for i, part in enumerate(parts)]
        self.lines += ["", "", f"def {name}({signature}):"]
        self.lines.append("    s = {" + ", ".join(f"{p!r}: {p}" for p in parameters if p in last) + "}")
        self.lines += [f"    {name}_{i}(run, s)" for i in range(len(parts))]
        ends = (f"s[{r!r}]" if isinstance(r, str) else _text(r) for r in results)
        self.lines.append(f"    return ({inside(ends)})")
        alive = len(parameters)
        width = 0
        for i, part in enumerate(parts):
            self.lines += ["", "", f"def {name}_{i}(run, s):"]
            ended = {n for n in uses[i] if last[n] == i}
            self.lines += [f"    {n} = s.pop({n!r})" if n in ended else f"    {n} = s[{n!r}]" for n in uses[i]]
            width = max(width, alive + self.statements(part))
            self.lines += [f"    s[{n!r}] = {n}" for n in shared[i]]
            alive += len(shared[i]) - len(ended)
        return width

    def statements(self, block: tuple[Stmt, ...]) -> int:
        """Prints the statements of a function; returns how many doubles a lane they may hold."""
        width = copied = 0
        for stmt in block:
            width += CALL if isinstance(stmt, Assign) and stmt.op == "call" else len(assigned(stmt))
            if isinstance(stmt, Assign):
                lines = [_tie(stmt)] if stmt.op == "tie" else assignment(stmt, DIALECT)
                self.lines += [f"    {line}" for line in lines]
            else:
                copied = max(copied, self.call(stmt))
        return width + copied

    def call(
        self, stmt: Integrate | Isolate | Locate | SumOver | Sample | Polygon | Polyhedron | Segment | Hyperbola | Ellipse | When
    ) -> int:
        """Prints the call of a statement, queues its blocks; returns how many values it may have to copy."""
        groups: list[Iterable[str]]
        match stmt:
            case Integrate():
                for_flags, for_body = captured(stmt, "flags")[0], captured(stmt, "body", "block")[0]
                ends = map(_text, (stmt.lo, stmt.hi, *stmt.breaks))
                name, groups = "integral", [ends, map(_text, of_bends(stmt)), for_flags, for_body]
            case Isolate():
                outside = (captured(stmt, block)[0] for block in ("enclosure", "point"))
                name, groups = "isolation", [map(_text, (stmt.lo, stmt.hi)), *outside]
            case Locate():
                limits = map(_text, (stmt.lo, stmt.hi, stmt.low, stmt.high))
                name, groups = "location", [limits, captured(stmt, "enclosure")[0]]
            case SumOver():
                name, groups = "sum", [map(_text, stmt.points), captured(stmt, "body")[0]]
            case Sample():
                name, groups = "mean", [captured(stmt, "body")[0]]
            case Polygon():
                planes = [_text(arg) for g in stmt.half_planes for arg in (g.a, g.b, g.c)]
                planes += [_text(arg) for arg in (*(arg for p in stmt.corners for arg in p), stmt.across)] if stmt.corners else []
                box = [_text(stmt.width), _text(stmt.height), *planes]
                name, groups = "polygon", [box, *(captured(stmt, block)[0] for block in ("setup", "body"))]
            case Polyhedron():
                spaces = [_text(arg) for g in stmt.half_spaces for arg in (*g.slopes, g.offset)]
                box = [*map(_text, stmt.extents), *spaces]
                name, groups = "polyhedron", [box, *(captured(stmt, block)[0] for block in ("setup", "body"))]
            case Segment():
                name, groups = "segment", [captured(stmt, block)[0] for block in ("setup", "scales", "body")]
            case Hyperbola():
                corners, coefficients = map(_text, (*stmt.corners, stmt.turn)), [_text(c) for m in stmt.moments for _, _, c in m.terms]
                name, groups = "hyperbola", [corners, coefficients, captured(stmt, "scales")[0]]
            case Ellipse():
                coefficients = [_text(c) for m in stmt.moments for _, _, c in m.terms]
                planes = [_text(arg) for g in stmt.half_planes for arg in (g.a, g.b, g.c)]
                name, groups = "ellipse", [map(_text, stmt.matrix), map(_text, stmt.place), coefficients, planes]
            case When():
                raise AssertionError("branches are written out")
            case _:
                assert_never(stmt)
        listed = [list(group) for group in groups]
        arguments = ["run", *(f"({inside(group)})" for group in listed), *(() if stmt.when is None else (stmt.when,))]
        self.lines.append(f"    {inside(assigned(stmt))} = {name}_{self.printed}({', '.join(arguments)})")
        self.waiting.append((self.printed, stmt))
        self.printed += 1
        return sum(map(len, listed))


def _tie(stmt: Assign) -> str:
    g, scale, r, k = stmt.args
    return f"{stmt.name} = rt.tie(run, {strict(g, 'np')}, {_text(scale)}, {_text(r)}, {_text(k)})"


def _sized(name: str, results: Sequence[Arg], width: int) -> str:
    return f"lanes.Sized({name}, {len(results)}, {width})"


def _text(arg: Arg) -> str:
    return value(arg, "np")
