"""The JAX backend: a pure function of scalars, to be jitted, mapped and differentiated like any other.

    compile_jax(program)  ->  JaxKernel: a call with columns of the batch gives (outputs, n)

The blocks of a program become nested Python functions, traced once (see `jax_runtime`, and `jax_roots` for what
finds roots, sums over them and locates common zeros):

    def kernel(order, zero, p0, p1):
        v0 = p0 * p1 + zero
        def body_0(x0, _):
            v1 = x0 * v0 + zero
            return (v1,), False                              values, and whether a tie was met
        (v2,), _ = rt.gauss(4, 0.0, p1, (v0,), None, body_0, 1)
        return (v2,), False

JAX is imported when a kernel is compiled, not with this module.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, assert_never

import numpy as np
import numpy.typing as npt

from teg.backends.python_text import Dialect, assignment, inside, strict, value
from teg.errors import BackendError, MissingPackageError
from teg.program import (
    ISOLATE_DEPTH,
    LOCATE_WIDTH,
    Adaptive,
    Arg,
    Assign,
    Gauss,
    Integrate,
    Isolate,
    Locate,
    Program,
    Stmt,
    SumOver,
    statements,
)

DIALECT = Dialect("jnp", guard=" + zero")
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
        from teg.backends import jax_roots, jax_runtime

        self.program = program
        self.source = "\n".join(_kernel(program))
        scope: dict[str, Any] = {"jnp": jax.numpy, "rt": jax_runtime, "roots": jax_roots}
        exec(compile(self.source, "<teg jax kernel>", "exec"), scope)
        self._kernel = scope["kernel"]
        self._step = 1 << max(0, (LANES // _nodes(program.body)).bit_length() - 1)
        self._batched: dict[tuple[bool, ...], Callable[..., Any]] = {}

    def __reduce__(self) -> tuple[object, ...]:
        return (JaxKernel, (self.program,))

    def function(self, arguments: Sequence[Any]) -> Any:
        """The outputs, a JAX array (outputs,), from one scalar a parameter: pure, for jit and vmap."""
        return self._resolve(self._once, arguments)

    def __call__(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> npt.NDArray[np.float64]:
        """The outputs of a batch of n, (outputs, n); a column is (n,), or () where the batch shares it."""
        _import_jax()
        values = [np.asarray(column, dtype=np.float64) for column in columns]
        mapped = tuple(v.ndim > 0 for v in values)
        if mapped not in self._batched:
            self._batched[mapped] = self._batch(mapped)
        call = self._batched[mapped]
        out = np.empty((len(self.program.outputs), n))
        if not any(mapped):
            out[:] = np.asarray(call(*values))[:, None]
            return out
        for start in range(0, n, self._step):
            count = min(self._step, n - start)
            padding = (0, (1 << (count - 1).bit_length()) - count)  # few lengths: few compilations
            part = slice(start, start + count)
            given = [np.pad(v[part], padding, mode="edge") if v.ndim else v for v in values]
            out[:, part] = np.asarray(call(*given))[:, :count]
        return out

    def _batch(self, mapped: tuple[bool, ...]) -> Callable[..., Any]:
        """The jitted function of columns, those `mapped` with a batch axis: (outputs, n), or (outputs,)."""
        jax = _import_jax()
        axes = tuple(0 if m else None for m in mapped)

        def once(order: Any, arguments: Sequence[Any]) -> tuple[Any, Any]:
            if not any(mapped):
                return self._once(order, arguments)
            run = jax.vmap(lambda *scalars: self._once(order, scalars), in_axes=axes, out_axes=(1, 0))
            out, tied = run(*arguments)
            return out, jax.numpy.any(tied)

        batched: Callable[..., Any] = jax.jit(lambda *arguments: self._resolve(once, arguments))
        return batched

    def _once(self, order: Any, arguments: Sequence[Any]) -> tuple[Any, Any]:
        """The outputs with ties resolved by `order`, (outputs,), and whether there were ties."""
        jnp = _import_jax().numpy
        scalars = [jnp.asarray(argument, jnp.float64) for argument in arguments]
        # always -0.0, which the compiler cannot know (see python_text)
        zero = jnp.where(scalars[0] == ODD, TINY, -0.0) if scalars else jnp.float64(-0.0)
        outputs, tied = self._kernel(order, zero, *scalars)
        return jnp.array([jnp.asarray(o, jnp.float64) for o in outputs]), jnp.asarray(tied)

    def _resolve(self, once: Callable[..., tuple[Any, Any]], arguments: Sequence[Any]) -> Any:
        """Both orders averaged if a tie was met, the first if none was."""
        out, tied = once(+1, arguments)
        if not self.program.ties:
            return out
        cond = _import_jax().lax.cond
        return cond(tied, lambda: 0.5 * out + 0.5 * once(-1, arguments)[0], lambda: out)


def _import_jax() -> Any:
    try:
        import jax
    except ImportError as error:
        raise MissingPackageError("the package jax is not installed", hint='pip install "teg[jax]"') from error
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
                nodes = stmt.rule.nodes if isinstance(stmt.rule, Gauss) else 21
                most = max(most, (len(stmt.breaks) + 1) * nodes * _nodes(stmt.body))
            case Isolate():
                most = max(most, ISOLATE_DEPTH, _nodes(stmt.enclosure), (len(stmt.results) + 1) * _nodes(stmt.point))
            case Locate():
                most = max(most, LOCATE_WIDTH, _nodes(stmt.enclosure))
            case SumOver():
                most = max(most, len(stmt.points) * _nodes(stmt.body))
            case Assign():
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
    """The inside of a function: the statements, then the results and whether a tie was met."""
    lines: list[str] = []
    ties: list[str] = []
    for stmt in block:
        if _has_ties(stmt):
            ties.append(f"tied_{_names((stmt,))[0]}")
        tied = ties[-1] if _has_ties(stmt) else "_"
        match stmt:
            case Integrate():
                lines += _integral(stmt, tied)
            case Isolate():
                lines += _isolation(stmt, tied)
            case Locate():
                lines += _location(stmt, tied)
            case SumOver():
                lines += _sum(stmt, tied)
            case Assign(name, "tie", (g, scale, r, _)):
                lines.append(f"{name}, {tied} = rt.tie(order, {strict(g, 'jnp')}, {_text(scale)}, {_text(r)})")
            case Assign():
                lines += assignment(stmt, DIALECT)
            case _:
                assert_never(stmt)
    lines.append(f"return {results}, {' | '.join(ties) or 'False'}")
    return [f"    {line}" for line in lines]


def _integral(stmt: Integrate, tied: str) -> list[str]:
    """The functions of an integral, and its call."""
    flagged = f"({inside(_names(stmt.flags))})"
    has_flags = bool(stmt.flags) or stmt.need is not None
    flags, body = f"flags_{stmt.var}" if has_flags else "None", f"body_{stmt.var}"
    extra, values = "", stmt.values
    match stmt.rule:
        case Gauss(nodes):
            call = f"rt.gauss({nodes}"
        case Adaptive(tol, smooth):
            call = f"rt.adaptive({tol!r}, {smooth!r}"
            if stmt.watch:
                values += stmt.watch
                extra = f"watched={len(stmt.watch)}"
        case _:
            assert_never(stmt.rule)
    arguments = [call, _text(stmt.lo), _text(stmt.hi), f"({inside(map(_text, stmt.breaks))})", flags, body]
    arguments += [str(len(stmt.results))] + ([f"when={stmt.when}"] if stmt.when else []) + ([extra] if extra else [])
    lines: list[str] = []
    if has_flags:
        lines += [f"def {flags}({stmt.var}):"]
        lines += _block(stmt.flags, f"{stmt.need or True}, {flagged}")
    lines += [f"def {body}({stmt.var}, flagged):"]
    lines += [f"    {flagged} = flagged"] if _names(stmt.flags) else []
    lines += _block(stmt.body, f"({inside(map(_text, values))})")
    return [*lines, f"({inside(stmt.results)}), {tied} = {', '.join(arguments)})"]


def _isolation(stmt: Isolate, tied: str) -> list[str]:
    """The functions of an isolation, and its call."""
    enclosure, point = f"enclosure_{stmt.var}", f"point_{stmt.var}"
    arguments = [_text(stmt.lo), _text(stmt.hi), enclosure, point, str(len(stmt.results))]
    arguments += [f"when={stmt.when}"] if stmt.when else []
    return [
        f"def {enclosure}({stmt.left}, {stmt.right}):",
        *_block(stmt.enclosure, f"({inside(map(_text, stmt.bounds))})"),
        f"def {point}({stmt.var}):",
        *_block(stmt.point, f"({inside(map(_text, (stmt.value, stmt.slope)))})"),
        f"({inside(stmt.results)}), {tied} = roots.isolate({', '.join(arguments)})",
    ]


def _location(stmt: Locate, tied: str) -> list[str]:
    """The function that encloses two functions, and the call that locates their common zeros."""
    enclosure = f"enclosure_{stmt.left}"
    arguments = [*map(_text, (stmt.lo, stmt.hi, stmt.low, stmt.high)), enclosure, str(len(stmt.results))]
    arguments += [f"when={stmt.when}"] if stmt.when else []
    return [
        f"def {enclosure}({stmt.left}, {stmt.right}, {stmt.bottom}, {stmt.top}):",
        *_block(stmt.enclosure, f"({inside(map(_text, stmt.bounds))})"),
        f"({inside(stmt.results)}), {tied} = roots.locate({', '.join(arguments)})",
    ]


def _sum(stmt: SumOver, tied: str) -> list[str]:
    """The function of a sum, and its call."""
    body = f"body_{stmt.var}"
    arguments = [f"({inside(map(_text, stmt.points))})", body, str(len(stmt.results))]
    arguments += [f"when={stmt.when}"] if stmt.when else []
    return [
        f"def {body}({stmt.var}):",
        *_block(stmt.body, f"({inside(map(_text, stmt.values))})"),
        f"({inside(stmt.results)}), {tied} = roots.sum_over({', '.join(arguments)})",
    ]


def _names(block: tuple[Stmt, ...]) -> list[str]:
    """The names that a block gives a value."""
    return [name for s in block for name in ((s.name,) if isinstance(s, Assign) else s.results)]


def _has_ties(stmt: Stmt) -> bool:
    return any(isinstance(s, Assign) and s.op == "tie" for s in statements((stmt,)))


def _text(arg: Arg) -> str:
    return value(arg, "jnp")
