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
from teg.backends.jax.alike import with_rows
from teg.backends.jax.printer import DIALECT, SAMPLES, kernel_lines
from teg.backends.jax.straight import straight
from teg.errors import BackendError, MissingPackageError
from teg.numerics.polyhedra import SIDES
from teg.numerics.quadrature import tetrahedron_rule, triangle_rule
from teg.numerics.sobol import replicated
from teg.program import (
    ISOLATE_DEPTH,
    LOCATE_WIDTH,
    TEXTS,
    Adaptive,
    Assign,
    Ellipse,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Outcome,
    Polygon,
    Polyhedron,
    Program,
    Sample,
    Segment,
    Stmt,
    SumOver,
    Unbound,
    When,
)

LANES = 2**22
"""The batch is cut so that its elements, times the nodes of each, are about this many."""
FEW = 12
"""Parameters that a loop over the orders of ties keeps one by one; more are an array, since XLA computes each in a kernel of its own."""
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
        from teg.backends.jax.together import together

        scalars = [jnp.asarray(argument, jnp.float64) for argument in arguments]
        line = self._straight

        def straightly(*given: Any) -> list[Any]:
            outputs, good = line(_zero(given), *given)
            return [*(jnp.asarray(o, jnp.float64) for o in outputs), jnp.asarray(good, jnp.bool_)]

        *outputs, good = together(straightly, *scalars)
        found = [*outputs, jnp.int32(0)]

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
        given = [jnp.stack(given)] if len(given) > FEW else given

        def turn(at: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
            number, outputs, note = at
            _, *held = barrier(number, *given)
            held = list(held[0]) if len(arguments) > FEW else held
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
            return Outcome(out, bool(note & 2), 0, bool(note & 4), bool(note & 1))
        noted = 0
        for start in range(0, n, self._step):
            count = min(self._step, n - start)
            padding = (0, (1 << (count - 1).bit_length()) - count)  # few lengths: few compilations
            part = slice(start, start + count)
            given = [np.pad(v[part], padding, mode="edge") if v.ndim else v for v in values]
            found, note = call(*given)
            out[:, part] = np.asarray(found)[:, :count]
            noted |= int(note)
        return Outcome(out, bool(noted & 2), 0, bool(noted & 4), bool(noted & 1))

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
    return jnp.where(scalars[0] == ODD, jnp.float64(TINY), jnp.float64(-0.0)) if scalars else jnp.float64(-0.0)


def _printed(program: Program) -> str:
    """The text of a program without the bodies of its functions."""
    return "\n".join(kernel_lines(with_rows(with_selects(program))))


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
