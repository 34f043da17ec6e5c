"""The JAX backend: a pure function of scalars, to be jitted, mapped and differentiated like any other.

    compile_jax(program)  ->  JaxKernel: a call with columns of the batch gives (outputs, n)

The blocks of a program become nested Python functions, traced once (see `jax_runtime`, and `jax_roots` for what
finds roots, sums over them and locates common zeros):

    def kernel(order, zero, p0, p1):
        v0 = p0 * p1 + zero
        def body_0(x0, _):
            v1 = x0 * v0 + zero
            return (v1,), 0                                  values, and a note: was a tie met, a tolerance missed?
        (v2,), _ = rt.gauss(rt.Pieces(1, 1), 4, (0.0, p1, v0), (), (None, body_0))
        return (v2,), 0

JAX is imported when a kernel is compiled, not with this module.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, assert_never, cast

import numpy as np
import numpy.typing as npt

from teg.backends.branches import with_selects
from teg.backends.jax.alike import Rows, with_rows
from teg.backends.jax.straight import straight
from teg.backends.text import Dialect, assignment, inside, strict, value
from teg.errors import BackendError, MissingPackageError
from teg.numerics.polyhedra import SIDES
from teg.numerics.quadrature import tetrahedron_rule, triangle_rule
from teg.numerics.sobol import replicated
from teg.program import (
    ISOLATE_DEPTH,
    LOCATE_WIDTH,
    TEXTS,
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
    statements,
)

RUN = "(order, zero)"
DIALECT = Dialect("jnp", guard=" + zero", call="function_{k}(order, zero, {arguments})[0][0]")
SAMPLES = 1024
"""Points of a sample that one element has at a time."""
LANES = 2**22
"""The batch is cut so that its elements, times the nodes of each, are about this many."""
ODD, TINY = 1.8275645e-301, 2.0**-1022
"""A number that no parameter happens to be, and one so small that it would not matter if one were."""


def compile_jax(program: Program) -> JaxKernel:
    """A kernel for JAX's default device; float64, so x64 must be on."""
    return JaxKernel(program)


class JaxKernel:
    """A program as a JAX function; `source` is its text."""

    def __init__(self, program: Program) -> None:
        jax = _import_jax()
        from teg.backends.jax import adaptive as jax_adaptive
        from teg.backends.jax import ellipse as jax_ellipse
        from teg.backends.jax import guard as jax_guard
        from teg.backends.jax import hyperbola as jax_hyperbola
        from teg.backends.jax import poles as jax_poles
        from teg.backends.jax import polygon as jax_polygon
        from teg.backends.jax import polyhedron as jax_polyhedron
        from teg.backends.jax import roots as jax_roots
        from teg.backends.jax import runtime as jax_runtime
        from teg.backends.jax import samples as jax_sampling

        self.program = program
        text = _kept(Unbound(program)) if program.functions else _printed(program)
        functions = [_kept(Unbound(cast(Program, f.body))) for f in program.functions]
        self.source = "\n".join([text, *(f"\n# function_{k}: the kernel of\n{body}" for k, body in enumerate(functions))])
        scope: dict[str, Any] = {"jnp": jax.numpy, "rt": jax_runtime, "roots": jax_roots, "sampling": jax_sampling}
        scope |= {
            "polygons": jax_polygon,
            "polyhedra": jax_polyhedron,
            "poles": jax_poles,
            "hyperbolas": jax_hyperbola,
            "ellipses": jax_ellipse,
        }
        scope |= {"adaptive": jax_adaptive, "guards": jax_guard}
        for k, body in enumerate(functions):
            scope[f"function_{k}"] = _made(body, dict(scope))
        self._kernel = _made(text, scope)
        line = straight(program, DIALECT)
        self.source += f"\n\n{line}" if line else ""
        self._straight = _made(line, dict(scope), "straight") if line else None
        self._step = 1 << max(0, (LANES // _nodes(program.body)).bit_length() - 1)
        self._batched: dict[tuple[bool, ...], Callable[..., Any]] = {}

    def __reduce__(self) -> tuple[object, ...]:
        return (JaxKernel, (self.program,))

    def function(self, arguments: Sequence[Any]) -> Any:
        """The outputs, a JAX array (outputs,), from one scalar a parameter: pure, for jit and vmap."""
        return _import_jax().numpy.stack(self.run(*arguments)[0])

    def run(self, *arguments: Any) -> tuple[tuple[Any, ...], Any]:
        """The outputs and the note: were there ties, was a tolerance missed. Where the straight line of the program is right, these are
        its outputs.

        Outputs are numbers, not an array: XLA would compute the array in one kernel, each entry of it in a branch of its own.

        The two orders of a tie are turns of a loop, so that the program stands once in what XLA compiles. The second turn is made if the
        first one met a tie; of a batch (a mapped loop goes on while one of its lanes does) if it was met anywhere. Parameters depend on
        the turn, as far as XLA knows: else it takes all but the ties out of the loop, in many passes.
        """
        if self._straight is None:
            return self._exactly(arguments)
        jnp = _import_jax().numpy
        from teg.backends.jax.rarely import rarely

        scalars = [jnp.asarray(argument, jnp.float64) for argument in arguments]
        outputs, good = self._straight(_zero(scalars), *scalars)
        found = [*(jnp.asarray(o, jnp.float64) for o in outputs), jnp.int32(0)]

        def exact(*given: Any) -> list[Any]:
            values, note = self._exactly(given)
            return [*values, note]

        *values, note = rarely(good, found, exact, *scalars)
        return tuple(values), note

    def _exactly(self, arguments: Sequence[Any]) -> tuple[tuple[Any, ...], Any]:
        """The outputs in both orders of ties, and the note."""
        if not self.program.ties:
            return self._once(1, arguments)
        jax = _import_jax()
        from teg.backends.jax.runtime import barrier
        from teg.backends.jax.while_loops import while_loop

        jnp = jax.numpy
        given = [jnp.asarray(a, jnp.float64) for a in arguments]

        def turn(at: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
            number, outputs, note = at
            _, *held = barrier(number, *given)
            found, noted = self._once(1 - 2 * number, held)
            both = tuple(jnp.where(number == 0, new, 0.5 * old + 0.5 * new) for old, new in zip(outputs, found, strict=True))
            return number + 1, both, note | noted

        beginning = jnp.int32(0), (jnp.float64(0.0),) * len(self.program.outputs), jnp.int32(0)
        _, outputs, note = while_loop(lambda at: (at[0] == 0) | ((at[0] == 1) & (at[2] % 2 == 1)), turn, beginning)
        return outputs, note

    def __call__(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> npt.NDArray[np.float64]:
        """The outputs of a batch of n, (outputs, n); a column is (n,), or () where the batch shares it."""
        return self.outcome(columns, n).values

    def outcome(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> Outcome:
        """The outputs, whether a tolerance was missed, and whether a search had too little room; evaluations are not counted."""
        _import_jax()
        values = [np.asarray(column, dtype=np.float64) for column in columns]
        mapped = tuple(v.ndim > 0 for v in values)
        if mapped not in self._batched:
            self._batched[mapped] = self._batch(mapped)
        call = self._batched[mapped]
        out = np.empty((len(self.program.outputs), n))
        if not any(mapped):
            found, note = call(*values)
            out[:] = np.asarray(found)[:, None]
            return Outcome(out, bool(note & 2), 0, bool(note & 4))
        noted = 0
        for start in range(0, n, self._step):
            count = min(self._step, n - start)
            padding = (0, (1 << (count - 1).bit_length()) - count)  # few lengths: few compilations
            part = slice(start, start + count)
            given = [np.pad(v[part], padding, mode="edge") if v.ndim else v for v in values]
            found, note = call(*given)
            out[:, part] = np.asarray(found)[:, :count]
            noted |= int(note)
        return Outcome(out, bool(noted & 2), 0, bool(noted & 4))

    def _batch(self, mapped: tuple[bool, ...]) -> Callable[..., Any]:
        """The jitted function of columns, those `mapped` with a batch axis: (outputs, n), or (outputs,); and the note of all."""
        jax = _import_jax()
        from teg.backends.jax.apart import once
        from teg.backends.jax.options import compiler_options
        from teg.backends.jax.runtime import union

        axes = tuple(0 if m else None for m in mapped)

        def batched(*arguments: Any) -> tuple[Any, Any]:
            out, notes = (jax.vmap(self.run, in_axes=axes) if any(mapped) else self.run)(*arguments)
            return jax.numpy.stack(out), union(notes)

        jitted: Callable[..., Any] = jax.jit(once(batched), compiler_options=compiler_options())
        return jitted

    def _once(self, order: Any, arguments: Sequence[Any]) -> tuple[tuple[Any, ...], Any]:
        """The outputs with ties resolved by `order`, and the note."""
        jnp = _import_jax().numpy
        from teg.backends.jax.entries import remembered

        scalars = [jnp.asarray(argument, jnp.float64) for argument in arguments]
        with remembered():
            outputs, note = self._kernel(order, _zero(scalars), *scalars)
        return tuple(jnp.asarray(o, jnp.float64) for o in outputs), jnp.asarray(note, jnp.int32)


def _zero(scalars: Sequence[Any]) -> Any:
    """-0.0, which the compiler cannot know (see `teg.backends.text`)."""
    jnp = _import_jax().numpy
    return jnp.where(scalars[0] == ODD, TINY, -0.0) if scalars else jnp.float64(-0.0)


def _printed(program: Program) -> str:
    """The text of a program without the bodies of its functions."""
    return "\n".join(_kernel(with_rows(with_selects(program))))


@lru_cache(maxsize=TEXTS)
def _kept(unbound: Unbound) -> str:
    """The same of a program that calls functions, or is the body of one: printed once for all bodies, and for all calls."""
    return _printed(unbound.program)


def _made(text: str, scope: dict[str, Any], name: str = "kernel") -> Any:
    """The function of a printed program."""
    exec(compile(text, "<teg jax kernel>", "exec"), scope)
    return scope[name]


def _import_jax() -> Any:
    try:
        import jax
    except ImportError as error:
        raise MissingPackageError("the package jax is not installed", hint='pip install "teg-compiler[jax]"') from error
    config: Any = jax.config
    if not config.jax_enable_x64:
        raise BackendError(
            "teg computes in float64, and JAX's 64-bit mode is off",
            hint='jax.config.update("jax_enable_x64", True), before any JAX array is made',
        )
    return jax


def _nodes(block: tuple[Stmt, ...]) -> int:
    """The most nodes of integrals, nested ones multiplied, that one element of the batch has at a time; or points, or boxes."""
    most = 1
    for stmt in block:
        match stmt:
            case Integrate():
                nodes = stmt.rule.order if isinstance(stmt.rule, Adaptive) else min(stmt.rule.nodes, SAMPLES)
                most = max(most, (len(stmt.breaks) + 1) * nodes * _nodes(stmt.body))
            case Isolate():
                most = max(most, ISOLATE_DEPTH, _nodes(stmt.enclosure), (len(stmt.results) + 1) * _nodes(stmt.point))
            case Locate():
                most = max(most, LOCATE_WIDTH, _nodes(stmt.enclosure))
            case SumOver():
                most = max(most, len(stmt.points) * _nodes(stmt.body))
            case Sample():
                most = max(most, min(SAMPLES, replicated(stmt.kind, stmt.count)[1]) * _nodes(stmt.body))
            case Polygon():
                triangles = 2 + len(stmt.half_planes)
                most = max(most, triangles * len(triangle_rule(stmt.degree)) * _nodes(stmt.body))
            case Polyhedron():
                faces = len(stmt.half_spaces) + SIDES
                most = max(most, faces * max(faces, len(tetrahedron_rule(stmt.degree)) * _nodes(stmt.body)))
            case Segment():
                most = max(most, stmt.nodes * _nodes(stmt.body))
            case When():
                most = max(most, _nodes(stmt.body))
            case Assign() | Hyperbola() | Ellipse():
                pass
            case _:
                assert_never(stmt)
    return most


def _kernel(program: Program) -> list[str]:
    """The text of a program, line by line."""
    parameters = [f"p{i}" for i in range(len(program.parameters))]
    return [
        '"""JAX kernel, generated by teg."""',
        "",
        *(f"# p{i}: {name!r}" for i, name in enumerate(program.parameters)),
        "",
        f"def kernel({', '.join(['order', 'zero', *parameters])}):",
        *_block(program.body, f"({inside(map(_text, program.outputs))})"),
        "",
    ]


def _block(block: tuple[Stmt, ...], results: str) -> list[str]:
    """The inside of a function: the statements, then the results and the note."""
    lines: list[str] = []
    notes: list[str] = []
    for stmt in block:
        if _has_note(stmt):
            notes.append(f"note_{_names((stmt,))[0]}")
        note = notes[-1] if _has_note(stmt) else "_"
        match stmt:
            case Integrate():
                lines += _integral(stmt, note)
            case Isolate():
                lines += _isolation(stmt, note)
            case Locate():
                lines += _location(stmt, note)
            case SumOver():
                lines += _sum(stmt, note)
            case Sample():
                lines += _mean(stmt, note)
            case Polyhedron() | Polygon() | Segment():
                lines += _clipped(stmt, note)
            case Hyperbola():
                lines += _moments(stmt, note)
            case Ellipse():
                lines.append(_ellipse(stmt))
            case Assign(name, "tie", (g, scale, r, _)):
                lines.append(f"{name}, {note} = rt.tie(order, {strict(g, 'jnp')}, {_text(scale)}, {_text(r)})")
            case Assign():
                lines += assignment(stmt, DIALECT)
            case Rows():
                lines += _rows(stmt, note)
            case When():
                raise AssertionError("branches are written out")
            case _:
                assert_never(stmt)
    lines.append(f"return {results}, {' | '.join(notes) or '0'}")
    return [f"    {line}" for line in lines]


def _integral(stmt: Integrate, note: str) -> list[str]:
    """The functions of an integral, and its call."""
    flagged = f"({inside(_names(stmt.flags))})"
    has_flags = bool(stmt.flags) or stmt.need is not None or bool(stmt.bends)
    flags, body = f"flags_{stmt.var}" if has_flags else "None", f"body_{stmt.var}"
    cubic = False
    match stmt.rule:
        case Gauss(nodes):
            name, options = "rt.gauss", [str(nodes)]
        case Rational(nodes, power):
            name, options = "poles.rational", [str(nodes), str(power)]
        case Midpoint(nodes):
            name, options = "rt.midpoint", [str(nodes), "zero"]
        case Adaptive(tol, first, order, cubic):
            name, options = "adaptive.integral", [_text(tol), f"({first}, {order})", str(len(stmt.watch))]
        case _:
            assert_never(stmt.rule)
    kinds = f"({inside(repr(b.kind) for b in stmt.bends)})"
    pieces = f"rt.Pieces({len(stmt.values)}, {stmt.tested}, {bool(stmt.estimates)}, {kinds}, {cubic}, {stmt.infinite})"
    of_bends = [stmt.base, stmt.scale, *(c for b in stmt.bends for c in b.coefficients)] if stmt.bends or stmt.infinite else []
    arguments = [pieces, *options, f"({inside(map(_text, (stmt.lo, stmt.hi, *stmt.breaks)))})"]
    arguments += [f"({inside(map(_text, of_bends))})", f"({flags}, {body})"] + ([f"when={stmt.when}"] if stmt.when else [])
    lines: list[str] = []
    if has_flags:
        lines += [f"def {flags}({inside((stmt.var, *(stmt.ends or ('_p', '_q'))))}):"]
        lines += _block(stmt.flags, f"{stmt.need or True}, ({inside(_text(b.when) for b in stmt.bends)}), {flagged}")
    lines += [f"def {body}({stmt.var}, flagged):"]
    lines += [f"    {flagged} = flagged"] if _names(stmt.flags) else []
    lines += _block(stmt.body, f"({inside(map(_text, stmt.at_nodes))})")
    if stmt.guard is not None:
        bounds = (*stmt.guard.sizes, *stmt.guard.upper, *stmt.guard.lower)
        lines += [f"def guard_{stmt.var}({stmt.guard.left}, {stmt.guard.right}, flagged):"]
        lines += [f"    {flagged} = flagged"] if _names(stmt.flags) else []
        lines += _block(stmt.guard.block, f"({inside(map(_text, bounds))})")
        arguments.append(f"guard=guards.Guard(guard_{stmt.var}, {len(stmt.guard.upper)})")
    return [*lines, f"({inside(assigned(stmt))}), {note} = {name}({', '.join(arguments)})"]


def _isolation(stmt: Isolate, note: str) -> list[str]:
    """The functions of an isolation, and its call."""
    enclosure, point = f"enclosure_{stmt.var}", f"point_{stmt.var}"
    bounds, room = f"({_text(stmt.lo)}, {_text(stmt.hi)})", f"({len(stmt.results)}, {stmt.width})"
    arguments = [bounds, enclosure, point, room, f"({_text(stmt.tol)}, {bool(stmt.errors)})"]
    arguments += [f"when={stmt.when}"] if stmt.when else []
    return [
        f"def {enclosure}({stmt.left}, {stmt.right}):",
        *_block(stmt.enclosure, f"({inside(map(_text, (*stmt.bounds, *stmt.curving, stmt.noise)))})"),
        f"def {point}({stmt.var}):",
        *_block(stmt.point, f"({inside(map(_text, (stmt.value, stmt.slope, stmt.curvature)))})"),
        f"({inside(assigned(stmt))}), {note} = roots.isolate({', '.join(arguments)})",
    ]


def _location(stmt: Locate, note: str) -> list[str]:
    """The function that encloses two functions, and the call that locates their common zeros."""
    enclosure = f"enclosure_{stmt.left}"
    limits = f"({inside(map(_text, (stmt.lo, stmt.hi, stmt.low, stmt.high)))})"
    arguments = [limits, enclosure, f"({len(stmt.results)}, {len(stmt.bounds)})"]
    arguments += [f"when={stmt.when}"] if stmt.when else []
    return [
        f"def {enclosure}({stmt.left}, {stmt.right}, {stmt.bottom}, {stmt.top}):",
        *_block(stmt.enclosure, f"({inside(map(_text, stmt.bounds))})"),
        f"({inside((*stmt.results, stmt.lost or '_'))}), {note} = roots.locate({', '.join(arguments)})",
    ]


def _sum(stmt: SumOver, note: str) -> list[str]:
    """The function of a sum, and its call."""
    body = f"body_{stmt.var}"
    arguments = [f"({inside(map(_text, stmt.points))})", body, str(len(stmt.results))]
    arguments += [f"when={stmt.when}"] if stmt.when else []
    return [
        f"def {body}({stmt.var}):",
        *_block(stmt.body, f"({inside(map(_text, stmt.values))})"),
        f"({inside(stmt.results)}), {note} = roots.sum_over({', '.join(arguments)})",
    ]


def _mean(stmt: Sample, note: str) -> list[str]:
    """The function of a mean over points, and its call."""
    body = f"body_{stmt.points[0]}"
    rule = f"({stmt.kind!r}, {stmt.seed}, {len(stmt.points)}, {stmt.count})"
    arguments = [rule, body, str(len(stmt.results)), f"chunk={SAMPLES}"]
    arguments += [f"when={stmt.when}"] if stmt.when else []
    arguments += [f"estimates={len(stmt.estimates)}"] if stmt.estimates else []
    return [
        f"def {body}({', '.join(stmt.points)}):",
        *_block(stmt.body, f"({inside(map(_text, stmt.values))})"),
        f"({inside(assigned(stmt))}), {note} = sampling.mean({', '.join(arguments)})",
    ]


def _clipped(stmt: Polyhedron | Polygon | Segment, note: str) -> list[str]:
    """What a polyhedron, a polygon or a segment is set up with, the function of its body, and its call."""
    blocks = (stmt.setup, stmt.scales) if isinstance(stmt, Segment) else (stmt.setup,)
    lines = [line for block in blocks for s in block if isinstance(s, Assign) for line in assignment(s, DIALECT)]
    factors = f"({inside(map(_text, stmt.factors))})"
    if isinstance(stmt, Polyhedron):
        name, variables = "polyhedra.polyhedron", ", ".join(stmt.variables)
        spaces = [f"({', '.join(map(_text, (*g.slopes, g.offset)))}, {g.closed})" for g in stmt.half_spaces]
        rule = [f"(({inside(strict(e, 'jnp') for e in stmt.extents)}), ({inside(spaces)}))", str(stmt.degree)]
    elif isinstance(stmt, Polygon):
        name, variables = "polygons.polygon", ", ".join(stmt.variables)
        planes = [f"({_text(g.a)}, {_text(g.b)}, {_text(g.c)}, {g.closed})" for g in stmt.half_planes]
        places = [f"({_text(u)}, {_text(v)})" for u, v in stmt.corners]
        triangle = [f"({inside(places)})", _text(stmt.across)] if stmt.corners else []
        region = ", ".join([strict(stmt.width, "jnp"), strict(stmt.height, "jnp"), f"({inside(planes)})", *triangle])
        rule = [f"polygons.Region({region})", str(stmt.degree)]
    else:
        name, variables = "polygons.segment", stmt.var
        ends = [
            f"({_text(g.first)}, {_text(g.last)}, {g.closed}, {g.k is not None}, {_text(g.resolution)}, {_text(g.size)}, {_text(g.scale)})"
            for g in stmt.half_lines
        ]
        rule = [f"({inside(ends)})", str(stmt.nodes)]
    body = f"body_{stmt.results[0]}"
    arguments = [RUN, *rule, factors, body, *([f"when={stmt.when}"] if stmt.when else [])]
    return [
        *lines,
        f"def {body}({variables}):",
        *_block(stmt.body, f"({inside(map(_text, stmt.values))})"),
        f"({inside(stmt.results)}), {note} = {name}({', '.join(arguments)})",
    ]


def _moments(stmt: Hyperbola, note: str) -> list[str]:
    """The scales of a hyperbola's corners, and its call."""
    lines = [line for s in stmt.scales if isinstance(s, Assign) for line in assignment(s, DIALECT)]
    kinds = inside(repr((m.kind, tuple((j, k) for j, k, _ in m.terms))) for m in stmt.moments)
    coefficients = inside(f"({inside(_text(c) for _, _, c in m.terms)})" for m in stmt.moments)
    arguments = [
        RUN,
        f"({inside(map(_text, (*stmt.corners, stmt.turn)))})",
        f"({inside(map(_text, stmt.scale))})",
        f"({kinds})",
        f"({coefficients})",
    ]
    arguments += [f"when={stmt.when}"] if stmt.when else []
    return [*lines, f"({inside(stmt.results)}), {note} = hyperbolas.moments({', '.join(arguments)})"]


def _ellipse(stmt: Ellipse) -> str:
    """The call of the moments of an ellipse."""
    kinds = inside(repr((m.kind, tuple((j, k) for j, k, _ in m.terms))) for m in stmt.moments)
    coefficients = inside(f"({inside(_text(c) for _, _, c in m.terms)})" for m in stmt.moments)
    numbers = (f"({inside(map(_text, part))})" for part in (stmt.matrix, stmt.place))
    arguments = [*numbers, f"({kinds})", f"({coefficients})"]
    if stmt.half_planes:
        planes = (f"({_text(g.a)}, {_text(g.b)}, {_text(g.c)}, {g.closed})" for g in stmt.half_planes)
        arguments.append(f"clip=ellipses.polygon({_text(stmt.place[3])}, {_text(stmt.place[4])}, ({inside(planes)}), zero)")
    arguments += [f"when={stmt.when}"] if stmt.when else []
    return f"({inside(stmt.results)}) = ellipses.moments({', '.join(arguments)})"


def _rows(stmt: Rows, note: str) -> list[str]:
    """The function of a row, and its call."""
    name = f"row_{stmt.results[0]}"
    columns = inside(f"({inside(map(_text, column))})" for column in stmt.rows)
    return [
        f"def {name}({', '.join(stmt.names)}):",
        *_block(stmt.body, f"({inside(map(_text, stmt.values))})"),
        f"({inside(stmt.results)}), {note} = rt.rows({name}, ({columns}))",
    ]


def _names(block: tuple[Stmt, ...]) -> list[str]:
    """The names that a block gives a value."""
    return [name for s in block for name in assigned(s)]


def _has_note(stmt: Stmt) -> bool:
    """Whether a tie may be met there, or a tolerance missed."""
    return any(
        (isinstance(s, Assign) and s.op == "tie")
        or isinstance(s, Isolate)
        or (isinstance(s, Integrate) and isinstance(s.rule, Adaptive | Rational))
        or isinstance(s, Locate)
        or (isinstance(s, Hyperbola) and bool(s.ties))
        or (isinstance(s, Segment) and any(g.k is not None for g in s.half_lines))
        for s in statements((stmt,))
    )


def _text(arg: Arg) -> str:
    return value(arg, "jnp")
