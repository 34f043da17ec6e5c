"""The program printed as C99: loops over pieces and nodes, one C function an integral.

    Program -> steps           a few C lines each, with the names they define and use
    steps   -> Frame           a C function; a long block is cut into parts, functions of their own
    Frame   -> Routine         its text; integrals of equal text share one routine with different arguments
    routines + batch loop      the translation unit, see `print_kernel`

Names. In a routine the variable is `x`, what it captures `c0, c1, …`, its own values `v1, b2, …` in order:
the text is canonical, so a sum of 10 000 similar integrals is 10 000 calls of a few functions. Literals that
are not simple numbers are captured as well.

Workspace. `w` is a stack of doubles, allocated once per thread and call: a routine uses w[0 … size) and calls
others with w + size. In it are values that cross the border of a part, arrays too long for the C stack, and
captured values where there are more than BY_VALUE.
"""

from __future__ import annotations

import ctypes
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache, partial
from math import cos, isinf, isnan, pi
from pathlib import Path

import numpy as np

from teg.backends.c_build import load_library
from teg.errors import BackendError, OptionError, ParameterError
from teg.program import (
    ABSOLUTE_FLOOR,
    MAX_DEPTH,
    MAX_INTERVALS,
    PIECE_EPS,
    ROUNDING,
    TIE_EPS,
    Adaptive,
    Arg,
    Assign,
    Gauss,
    Integrate,
    Program,
    Rule,
    Stmt,
    statements,
)

PART = 800  # statements in one C function, beyond which a block is cut
BY_VALUE = 40  # captured values passed as C arguments; more go through the workspace
ON_STACK = 64  # results of an integral kept in arrays on the C stack
BREAKS_ON_STACK = 256
ARITY = 16  # operands in one C expression
LITERALS = 24  # captured literals; a routine with more keeps them in its text

INFIX = {"add": " + ", "sub": " - ", "mul": " * ", "div": " / ", "and": " && ", "or": " || "}
NEUTRAL = {"add": "0.0", "mul": "1.0", "and": "1", "or": "0"}
COMPARISON = {"gt0": ">", "ge0": ">=", "lt0": "<", "le0": "<="}
RENAMED = {"abs": "fabs", "mod": "teg_mod"}
RESERVED = re.compile(
    "auto|break|case|char|class|const|continue|default|do|double|element|else|enum|extern|float|for|free|goto|if|"
    "inline|int|integral_.*|long|main|malloc|register|restrict|return|short|signed|sizeof|static|struct|switch|"
    "teg_.*|typedef|union|unsigned|void|volatile|while"
)


class CKernel:
    """A compiled program. `source` is its C text; pickling keeps the program and compiles it again."""

    def __init__(self, program: Program, threads: int = 1) -> None:
        """`threads` share the batch; 0 is one for each processor. Results are the same for any number."""
        if threads < 0:
            raise OptionError("threads must be 0 (one for each processor) or positive", threads)
        self.program = program
        self.threads = threads
        self.source = print_kernel(program)
        library = load_library(self.source, optimise=_optimisation(self.source), openmp=threads != 1)
        self._function = library.teg_kernel
        self._function.restype = ctypes.c_int
        self._function.argtypes = [ctypes.c_long, *[ctypes.c_void_p] * 3, ctypes.c_int]

    def __call__(self, columns: Sequence[np.ndarray], n: int) -> np.ndarray:
        """The outputs on a batch of n, shape (outputs, n), float64.

        A column is float64, of shape (n,) with any stride, or () for one value shared by the batch.
        """
        parameters = self.program.parameters
        if len(columns) != len(parameters):
            raise ParameterError(f"{len(parameters)} columns are needed, not {len(columns)}")
        kept = [_column(column, n, name) for column, name in zip(columns, parameters, strict=True)]
        pointers = np.array([column.__array_interface__["data"][0] for column in kept], dtype=np.uintp)
        strides = np.array([column.strides[0] // 8 if column.ndim else 0 for column in kept], dtype=np.dtype(ctypes.c_long))
        out = np.empty((len(self.program.outputs), n))
        threads = min(self.threads or os.cpu_count() or 1, max(n, 1))
        if out.size and self._function(n, pointers.ctypes.data, strides.ctypes.data, out.ctypes.data, threads):
            raise BackendError("there is no memory for the kernel's workspace")
        return out

    def __reduce__(self) -> tuple[object, ...]:
        return (CKernel, (self.program, self.threads))


def compile_c(program: Program, *, threads: int = 1) -> CKernel:
    """The program as a compiled C kernel (from the cache on disk if it was compiled before)."""
    return CKernel(program, threads)


def standalone_c(program: Program, name: str) -> tuple[str, str]:
    """The texts of `name`.c and `name`.h, for use without Python: `cc -std=c99 -O2 name.c … -lm`."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name) or RESERVED.fullmatch(name):
        raise OptionError("not usable as the name of a C function", name, "letters, digits and _, no C keyword, not teg_…")
    header = f"""\
{_title(program)}

#ifndef {name.upper()}_H
#define {name.upper()}_H

#ifdef __cplusplus
extern "C" {{
#endif

/* Evaluate the program at n points. Parameter i at point k is p[i][k * stride[i]]; stride 0 shares one value.
   Output j at point k is written to out[j * n + k]. Compiled with OpenMP, `threads` threads share the points.
   Returns 0, or 1 if there was no memory for the workspace, and then `out` is not complete.
   Nothing is kept between calls: several threads may call at once. */
int {name}(long n, const double *const *p, const long *stride, double *out, int threads);

#ifdef __cplusplus
}}
#endif

#endif
"""
    return print_kernel(program, name), header


def print_kernel(program: Program, name: str = "teg_kernel") -> str:
    """The translation unit: constants, runtime, Gauss tables, integrals inside out, element, batch loop."""
    printer = Printer(any(isinstance(s, Assign) and s.op == "tie" for s in statements(program.body)))
    element = printer.element(program)
    defines = [
        ("PIECE_EPS", PIECE_EPS),
        ("TIE_EPS", TIE_EPS),
        ("ABSOLUTE_FLOOR", ABSOLUTE_FLOOR),
        ("ROUNDING", ROUNDING),
    ]
    switches = [("MAX_DEPTH", MAX_DEPTH), ("MAX_INTERVALS", MAX_INTERVALS)]
    head = [f"#define TEG_{key} {value!r}" for key, value in (*defines, *switches)]
    head += ["#define TEG_TIES"] * printer.ties + ["#define TEG_ADAPTIVE"] * printer.adaptive
    runtime = Path(__file__).with_name("teg_runtime.h").read_text(encoding="ascii").rstrip()
    tables = [_gauss_table(order) for order in sorted(printer.orders)]
    batch = "\n".join(_batch_loop(program, name, element, printer.ties))
    return "\n\n".join([_title(program), "\n".join(head), runtime, *tables, *printer.texts, batch]) + "\n"


@dataclass(frozen=True, slots=True)
class Routine:
    """A C function that needs `workspace` doubles at `w`; if `indirect`, captured values come first there."""

    name: str
    indirect: bool
    workspace: int


@dataclass(frozen=True, slots=True)
class Step:
    """C lines, given a Scope that spells names; `area` doubles are used beyond the frame's own workspace."""

    defines: tuple[str, ...]
    uses: tuple[Arg, ...]
    lines: Callable[[Scope], list[str]]
    weight: int = 1
    area: int = 0


@dataclass(frozen=True, slots=True)
class Scope:
    """How names and literals are spelled at one place; the workspace of called routines begins at `free`."""

    names: dict[Arg, str]
    free: int

    def __call__(self, arg: Arg) -> str:
        if isinstance(arg, str):
            return self.names[arg]
        if isinstance(arg, bool):
            return str(int(arg))
        return self.names.get(float(arg)) or literal(float(arg))


class Printer:
    """Prints routines, each text once, inner integrals before outer ones."""

    def __init__(self, ties: bool) -> None:
        self.ties = ties
        self.adaptive = False
        self.orders: set[int] = set()
        self.texts: list[str] = []
        self._known: dict[str, Routine] = {}

    def element(self, program: Program) -> Routine:
        """The routine of the whole program at one point: from the parameters it writes the outputs to `f`."""
        steps = [*self._steps(program.body), *_yields(program.outputs)]
        frame = Frame([f"p{i}" for i in range(len(program.parameters))], [steps], (), self.ties, prefix="p")
        inside = [*frame.opening(), *frame.block(0)]
        return self._routine("element", frame, f"static void {frame.signature('f')}", inside)

    def _steps(self, block: Iterable[Stmt]) -> Iterator[Step]:
        for stmt in block:
            if isinstance(stmt, Integrate):
                if stmt.results:
                    yield self._call(stmt)
            else:
                yield from _assignments(stmt)

    def _call(self, stmt: Integrate) -> Step:
        """The call of an integral's routine; many results or captured values go through the workspace."""
        routine, captured = self._integral(stmt)
        count = len(stmt.results)
        stacked = count if count > ON_STACK else 0

        def lines(scope: Scope) -> list[str]:
            names, values = [scope(name) for name in stmt.results], [scope(arg) for arg in captured]
            below = scope.free + stacked
            place = f"(w + {scope.free})" if stacked else f"r{names[0]}"
            passed = ([] if routine.indirect else values) + [place] * (count > 1)
            passed += [f"w + {below}"] * (routine.workspace > 0) + ["ctx"] * self.ties
            call = f"{routine.name}({', '.join(passed)})"
            before = [f"w[{below + i}] = {value};" for i, value in enumerate(values) if routine.indirect]
            if count == 1:
                guarded = call if stmt.when is None else f"{scope(stmt.when)} ? {call} : 0.0"
                return [*before, f"const double {names[0]} = {guarded};"]
            if stmt.when is not None:
                call = f"if ({scope(stmt.when)}) {call}; else teg_fill({place}, {count}, 0.0)"
            loads = [f"const double {name} = {place}[{j}];" for j, name in enumerate(names)]
            return [*before, *([] if stacked else [f"double {place}[{count}];"]), f"{call};", *loads]

        uses = captured if stmt.when is None else (*captured, stmt.when)
        weight = 4 + (len(captured) if routine.indirect else len(captured) // 4) + (count if count > 1 else 0)
        return Step(stmt.results, uses, lines, weight, stacked + routine.workspace)

    def _integral(self, stmt: Integrate) -> tuple[Routine, tuple[Arg, ...]]:
        """The routine of an integral, and what this occurrence passes to it."""
        flags, body = list(self._steps(stmt.flags)), [*self._steps(stmt.body), *_yields(stmt.values)]
        own = (stmt.lo, stmt.hi, *stmt.breaks, *(() if stmt.need is None else (stmt.need,)))
        captured = _captured(own, [*flags, *body], stmt.var)
        count, pieces = len(stmt.values), len(stmt.breaks) + 1
        frame = Frame(captured, [flags, body], own, self.ties, stmt.var)
        names = ("f", "kronrod", "gauss", "size", "whole") if isinstance(stmt.rule, Adaptive) else ("f",)
        arrays = [line for name in names for line in frame.array(name, count)]
        arrays += frame.array("ends", pieces + 1, BREAKS_ON_STACK)
        spell = frame.scope()
        inside = [
            *arrays,
            *frame.opening(),
            f"const double lo = {spell(stmt.lo)}, hi = {spell(stmt.hi)};",
            "if (lo != lo || hi != hi) " + ("return NAN;" if count == 1 else f"{{ teg_fill(sum, {count}, NAN); return; }}"),
            "const double a = lo <= hi ? lo : hi, b = lo <= hi ? hi : lo, sign = lo <= hi ? 1.0 : -1.0;",
            "ends[0] = a;",
            *(f"ends[{i}] = teg_clamp({spell(arg)}, a, b);" for i, arg in enumerate(stmt.breaks, 1)),
            f"ends[{pieces}] = b;",
            *([f"teg_sort(ends + 1, {pieces - 1});"] if pieces > 2 else []),
            "double sum[1] = {0.0};" if count == 1 else f"teg_fill(sum, {count}, 0.0);",
            f"for (int i = 0; i < {pieces}; i++) {{",
            *_indent(
                "const double p = ends[i], q = ends[i + 1];",
                "if (!teg_is_piece(p, q)) continue;",
                "double x = 0.5 * (p + q);",
                *frame.block(0),
                *([] if stmt.need is None else [f"if (!{spell(stmt.need)}) continue;"]),
                *self._piece(stmt.rule, frame, count),
            ),
            "}",
            "return sign * sum[0];" if count == 1 else _each(count, "sum[j] *= sign;"),
        ]
        head = f"static double {frame.signature()}" if count == 1 else f"static void {frame.signature('sum')}"
        return self._routine("integral", frame, head, inside), tuple(captured)

    def _piece(self, rule: Rule, frame: Frame, count: int) -> list[str]:
        match rule:
            case Gauss(nodes):
                self.orders.add(nodes)
                return _gauss_piece(frame, nodes, count)
            case Adaptive():
                self.adaptive = True
                return _adaptive_piece(frame, rule, count)

    def _routine(self, kind: str, frame: Frame, signature: str, inside: list[str]) -> Routine:
        """The routine of this text, which is printed unless it is known. '@' stands for its name."""
        text = "\n\n".join([*frame.parts, "\n".join([signature, "{", *_indent(*inside), "}"])])
        if text not in self._known:
            name = kind if kind == "element" else f"{kind}_{len(self._known) + 1}"
            self._known[text] = Routine(name, frame.indirect, frame.workspace)
            self.texts.append(text.replace("@", name))
        return self._known[text]


class Frame:
    """One C function in the making: how names are spelled, which live in the workspace, and the parts.

    A part is a C function of its own that runs a stretch of a long block; part 0 is the function itself.
    """

    def __init__(
        self,
        captured: Sequence[Arg],
        blocks: list[list[Step]],
        own: Sequence[Arg],
        ties: bool,
        var: str | None = None,
        prefix: str = "c",
    ) -> None:
        steps = [step for block in blocks for step in block]
        self.captured, self.blocks, self.ties, self.var = captured, blocks, ties, var
        self.indirect = len(captured) > BY_VALUE
        self.below = max((step.area for step in steps), default=0)
        defined = [name for step in steps for name in step.defines]
        self.names: dict[Arg, str] = {arg: f"{prefix}{i}" for i, arg in enumerate(captured)}
        self.names |= {name: f"{'b' if name[0] == 'b' else 'v'}{i}" for i, name in enumerate(defined, 1)}
        if var is not None:
            self.names[var] = "x"
        self.parts: list[str] = []  # their texts
        self._cuts = _cut(blocks)
        self._home: dict[Arg, int] = {}  # the part that defines a name, if it is not part 0
        for number, part in ((number, part) for cut in self._cuts for number, part in cut):
            self._home |= dict.fromkeys((name for step in part if number for name in step.defines), number)
        self._slots: dict[Arg, int] = {arg: i for i, arg in enumerate(captured)} if self.indirect else {}
        self._uses = {0: dict.fromkeys(arg for arg in own if arg in self.names)}  # by part
        for number, part in ((number, part) for cut in self._cuts for number, part in cut):
            uses = self._uses.setdefault(number, {})
            uses |= dict.fromkeys(arg for step in part for arg in step.uses if arg in self.names)
        for number, uses in self._uses.items():
            for arg in uses:
                if self._home.get(arg, 0) != number:
                    self._slots.setdefault(arg, len(self._slots))
        self.size = len(self._slots)

    @property
    def workspace(self) -> int:
        return self.size + self.below

    def array(self, name: str, count: int, on_stack: int = ON_STACK) -> list[str]:
        """Declare an array, before any block: on the C stack if it is short, else in the workspace."""
        if count <= on_stack:
            return [f"double {name}[{count}];"]
        self.size += count
        return [f"double *const {name} = w + {self.size - count};"]

    def scope(self) -> Scope:
        """Names as they are spelled in the function itself."""
        elsewhere = {arg: self._load(arg) for arg in self._uses[0] if arg in self._home}
        return Scope({**self.names, **elsewhere}, self.size)

    def signature(self, *pointers: str) -> str:
        """Name and C parameters of the function."""
        values = [] if self.indirect else [f"{_type(arg)} {self.names[arg]}" for arg in self.captured]
        values += [f"double *{pointer}" for pointer in (*pointers, *["w"] * (self.workspace > 0))]
        return f"@({', '.join(values + ['teg_context *ctx'] * self.ties) or 'void'})"

    def opening(self) -> list[str]:
        """Captured values out of the workspace where the function needs them, or into it where parts do."""
        if self.indirect:
            return [self._declaration(arg) for arg in self.captured if arg in self._uses[0]]
        return [f"w[{self._slots[arg]}] = {self.names[arg]};" for arg in self.captured if arg in self._slots]

    def block(self, index: int) -> list[str]:
        """The lines that run a block at the variable's present value."""
        lines = [] if self.var not in self._slots else [f"w[{self._slots[self.var]}] = x;"]
        for number, part in self._cuts[index]:
            lines += self._call(number, part) if number else self._lines(part, self.scope())
        return lines

    def _call(self, number: int, part: list[Step]) -> list[str]:
        """Print a part; the line that calls it."""
        passed = ["double *w"] * (self.workspace > 0) + ["double *f"] + ["teg_context *ctx"] * self.ties
        loads = [self._declaration(arg) for arg in self._uses[number] if self._home.get(arg, 0) != number]
        inside = _indent(*loads, *self._lines(part, Scope(self.names, self.size)))
        self.parts.append("\n".join([f"static void @_part_{number}({', '.join(passed)})", "{", *inside, "}"]))
        return [f"@_part_{number}({', '.join(parameter.split('*')[1] for parameter in passed)});"]

    def _lines(self, steps: list[Step], scope: Scope) -> list[str]:
        lines = []
        for step in steps:
            lines += step.lines(scope)
            kept = (name for name in step.defines if name in self._slots)
            lines += [f"w[{self._slots[name]}] = {self.names[name]};" for name in kept]
        return lines

    def _declaration(self, arg: Arg) -> str:
        return f"const {_type(arg)} {self.names[arg]} = {self._load(arg)};"

    def _load(self, arg: Arg) -> str:
        slot = f"w[{self._slots[arg]}]"
        return f"({slot} != 0.0)" if _type(arg) == "int" else slot


def literal(x: float) -> str:
    """A C constant of exactly this value, safe as an operand."""
    if isnan(x):
        return "NAN"
    text = "INFINITY" if isinf(x) else repr(abs(x))
    return text if str(x)[0] != "-" else f"(-{text})"


def _type(arg: Arg) -> str:
    return "int" if isinstance(arg, str) and arg[0] == "b" else "double"


def _cut(blocks: list[list[Step]]) -> list[list[tuple[int, list[Step]]]]:
    """Each block as numbered parts of bounded weight; a block that stays whole has number 0."""
    long = sum(step.weight for block in blocks for step in block) > PART
    cuts: list[list[tuple[int, list[Step]]]] = []
    number = 0
    for block in blocks:
        if not long or sum(step.weight for step in block) <= PART:
            cuts.append([(0, block)])
            continue
        cut: list[tuple[int, list[Step]]] = []
        room = 0
        for step in block:
            if step.weight > room:
                number += 1
                cut.append((number, []))
                room = PART
            cut[-1][1].append(step)
            room -= step.weight
        cuts.append(cut)
    return cuts


def _captured(own: Sequence[Arg], steps: list[Step], var: str) -> list[Arg]:
    """What an integral takes from outside, in order of first use: names, and literals that are not simple."""
    defined = {name for step in steps for name in step.defines} | {var}
    uses = dict.fromkeys((*own, *(arg for step in steps for arg in step.uses)))
    names = [arg for arg in uses if isinstance(arg, str) and arg not in defined]
    numbers = [float(arg) for arg in uses if not isinstance(arg, (str, bool))]
    literals = [x for x in numbers if abs(x) < float("inf") and not (abs(x) <= 64 and (4 * x).is_integer())]
    return [*names, *(literals if len(literals) <= LITERALS else ())]


def _yields(values: Sequence[Arg]) -> Iterator[Step]:
    """The values of a block, written to `f`."""
    for j, value in enumerate(values):
        yield Step((), (value,), partial(_yielded, j, value))


def _yielded(j: int, value: Arg, scope: Scope) -> list[str]:
    return [f"f[{j}] = {scope(value)};"]


def _assignments(stmt: Assign) -> Iterator[Step]:
    """An assignment; a sum or product of many operands as a chain of short ones."""
    args, name = stmt.args, stmt.name
    if stmt.op in NEUTRAL:
        for link in range(1, -(-(len(args) - 1) // (ARITY - 1))):
            yield _assignment(Assign(f"{name}+{link}", stmt.op, args[:ARITY]))
            args = (f"{name}+{link}", *args[ARITY:])
    yield _assignment(Assign(name, stmt.op, args))


def _assignment(stmt: Assign) -> Step:
    """One line of C."""
    operands = {"powi": 1, "tie": 3}.get(stmt.op, len(stmt.args))
    uses = stmt.args[:operands]

    def lines(scope: Scope) -> list[str]:
        value = _expression(stmt.op, [scope(arg) for arg in uses], stmt.args[operands:])
        return [f"const {_type(stmt.name)} {scope(stmt.name)} = {value};"]

    return Step((stmt.name,), uses, lines)


def _expression(op: str, args: list[str], rest: Sequence[Arg]) -> str:
    """An operation in C; `rest` is a power's exponent, or a tie's number."""
    match op, args:
        case ("const", [x]):
            return x
        case ("neg", [x]):
            return f"-{x}"
        case ("not", [b]):
            return f"!{b}"
        case ("ok", [x]):
            return f"{x} == {x}"
        case ("select", [b, x, y]):
            return f"{b} ? {x} : {y}"
        case ("powi", [x]):
            n = rest[0]
            return f"{x} * {x}" if n == 2 else f"teg_powi({x}, {n})"
        case ("tie", [g, scale, r]):
            return f"teg_tie(ctx, {g}, {scale}, {r})"
        case (_, [x]) if op in COMPARISON:
            return f"{x} {COMPARISON[op]} 0.0"
    if op in INFIX:
        return INFIX[op].join(args) or NEUTRAL[op]
    return f"{RENAMED.get(op, op)}({', '.join(args)})"


def _gauss_piece(frame: Frame, nodes: int, count: int) -> list[str]:
    """Add a Gauss-Legendre rule over (p, q) to `sum`."""
    return [
        "const double middle = 0.5 * (p + q), half = 0.5 * (q - p);",
        f"for (int k = 0; k < {nodes}; k++) {{",
        *_indent(
            f"const double weight = half * teg_gauss_{nodes}[k].weight;",
            f"x = middle + half * teg_gauss_{nodes}[k].node;",
            *frame.block(1),
            _each(count, "sum[j] += weight * f[j];"),
        ),
        "}",
    ]


def _adaptive_piece(frame: Frame, rule: Adaptive, count: int) -> list[str]:
    """Add the adaptive rule over (p, q) to `sum`, from the left; `waiting` is a stack of intervals."""
    place = "x = p + (q - p) * u;"
    slope = "half * (q - p)"
    if rule.smooth:
        place, slope = "x = p + (q - p) * (u * u * (3.0 - 2.0 * u));", f"{slope} * (6.0 * u * (1.0 - u))"
    good = f"teg_accepts({count}, kronrod, gauss, size, whole, {literal(rule.tol)})"
    return [
        "teg_interval waiting[TEG_MAX_DEPTH + 2];",
        "waiting[0] = (teg_interval){0.0, 1.0, 0};",
        "for (int n = 1, used = 1; n > 0; used++) {",
        *_indent(
            "const teg_interval here = waiting[--n];",
            "const double middle = 0.5 * (here.from + here.to), half = 0.5 * (here.to - here.from);",
            *(f"teg_fill({name}, {count}, 0.0);" for name in ("kronrod", "gauss", "size")),
            "for (int k = 0; k < 21; k++) {",
            *_indent(
                "const double u = middle + half * teg_pair[k].node;",
                f"const double slope = {slope};",
                place,
                *frame.block(1),
                f"for (int j = 0; j < {count}; j++) {{",
                *_indent(
                    "const double y = slope * f[j];",
                    "kronrod[j] += teg_pair[k].kronrod * y;",
                    "gauss[j] += teg_pair[k].gauss * y;",
                    "size[j] += teg_pair[k].kronrod * fabs(y);",
                ),
                "}",
            ),
            "}",
            f"if (used == 1) {_each(count, 'whole[j] = size[j];')}",
            f"if (here.depth >= TEG_MAX_DEPTH || used >= TEG_MAX_INTERVALS || {good}) {{",
            *_indent(_each(count, "sum[j] += kronrod[j];")),
            "} else {",
            *_indent(
                "waiting[n++] = (teg_interval){middle, here.to, here.depth + 1};",
                "waiting[n++] = (teg_interval){here.from, middle, here.depth + 1};",
            ),
            "}",
        ),
        "}",
    ]


def _batch_loop(program: Program, name: str, element: Routine, ties: bool) -> Iterator[str]:
    """The exported function: every point by itself; where ties were met, the mean of the two orders."""
    inputs, outputs = len(program.parameters), len(program.outputs)
    values = [f"p[{i}][i * stride[{i}]]" for i in range(inputs)]
    space, results = element.workspace, ["result", "other"] if ties else ["result"]
    arrays = [f"double *const {array} = w + {space + k * outputs};" for k, array in enumerate(results)]
    run = [*([] if element.indirect else values), "result", *["w"] * (space > 0), *["&ctx"] * ties]
    call = f"element({', '.join(run)});"
    again = call.replace("result", "other")
    gather = f"for (int j = 0; j < {inputs}; j++) w[j] = p[j][i * stride[j]];"
    both = f"for (int j = 0; j < {outputs}; j++) result[j] = 0.5 * (result[j] + other[j]);"
    yield from (
        f"TEG_EXPORT int {name}(",
        "    long n, const double *const *p, const long *stride, double *out, int threads)",
        "{",
        *_indent(
            "const int team = threads > 1 ? threads : 1;",
            "const long share = n / (32L * team) + 1;",
            "int failed = 0;",
            "(void)p, (void)stride, (void)share;",
        ),
        "#ifdef _OPENMP",
        "#pragma omp parallel num_threads(team) if (team > 1)",
        "#endif",
        *_indent(
            "{",
            *_indent(
                f"double *const w = malloc({space + len(results) * outputs + 1} * sizeof *w);",
                *arrays,
            ),
        ),
        "#ifdef _OPENMP",
        "#pragma omp for schedule(dynamic, share)",
        "#endif",
        *_indent(
            *_indent(
                "for (long i = 0; i < n; i++) {",
                *_indent(
                    "if (!w) {",
                    *_indent("failed = 1;", "continue;"),
                    "}",
                    *([gather] if element.indirect else []),
                    *(["teg_context ctx = {+1, 0};"] if ties else []),
                    call,
                    *(["if (ctx.tied) {", *_indent("ctx.order = -1;", again, both), "}"] if ties else []),
                    f"for (int j = 0; j < {outputs}; j++) out[j * n + i] = result[j];",
                ),
                "}",
                "free(w);",
            ),
            "}",
            "return failed;",
        ),
        "}",
    )


@lru_cache(maxsize=64)
def _gauss_table(nodes: int) -> str:
    """Nodes and weights of n-point Gauss-Legendre to the last digit: Newton's method on Pₙ with 40 digits."""
    half: list[tuple[float, float]] = []  # the nodes x > 0, the largest first
    with localcontext() as context:
        context.prec = 40
        for i in range(nodes // 2):
            x, step, slope = Decimal(cos(pi * (i + 0.75) / (nodes + 0.5))), Decimal(1), Decimal(1)
            while abs(step) > Decimal("1e-25"):
                before, value = _legendre(nodes, x)
                slope = nodes * (before - x * value) / (1 - x * x)
                step = value / slope
                x -= step
            half.append((float(x), float(2 / ((1 - x * x) * slope * slope))))
        middle = [(0.0, float(2 / (nodes * _legendre(nodes, Decimal(0))[0]) ** 2))] if nodes % 2 else []
    rule = [*((-x, weight) for x, weight in half), *middle, *reversed(half)]
    rows = [f"    {{{node!r}, {weight!r}}}," for node, weight in rule]
    kind = "static const struct {\n    double node, weight;\n}"
    return "\n".join([f"{kind} teg_gauss_{nodes}[{nodes}] = {{", *rows, "};"])


def _legendre(n: int, x: Decimal) -> tuple[Decimal, Decimal]:
    """The Legendre polynomials of degree n - 1 and n at x."""
    before, value = Decimal(1), x
    for k in range(2, n + 1):
        before, value = value, ((2 * k - 1) * x * value - (k - 1) * before) / k
    return before, value


def _title(program: Program) -> str:
    """The comment at the top; of the users' names only harmless characters."""
    shown = program.parameters[:20]
    names = [f"p{i} = {re.sub(r'[^A-Za-z0-9_ ]', '_', name)[:40]}" for i, name in enumerate(shown)]
    names += ["..."] * (len(shown) < len(program.parameters))
    return "/* Generated by teg. {} outputs of {} parameters:\n * {}\n */".format(
        len(program.outputs), len(program.parameters), "\n * ".join(names or ["none"])
    )


def _each(count: int, line: str) -> str:
    """A line for every j below `count`."""
    return line.replace("[j]", "[0]") if count == 1 else f"for (int j = 0; j < {count}; j++) {line}"


def _indent(*lines: str) -> list[str]:
    return [line if line.startswith("#") else "    " + line for line in lines]


def _optimisation(source: str) -> str:
    """How hard the compiler should try, so that no size takes it minutes."""
    lines = source.count("\n")
    return "-O3" if lines <= 6_000 else "-O1" if lines <= 250_000 else "-O0"


def _column(column: np.ndarray, n: int, name: str) -> np.ndarray:
    """The column as the kernel reads it: itself, or a copy if it is not aligned to whole doubles."""
    if column.dtype != np.float64 or column.shape not in ((), (n,)):
        raise ParameterError(f"a float64 array of shape () or ({n},) is needed, not {column.dtype} {column.shape}", name)
    plain = column.dtype.isnative and column.flags.aligned and all(stride % 8 == 0 for stride in column.strides)
    return column if plain else np.array(column, dtype=np.float64)
