"""Error estimates through the loops of a program with arrays, to first order.

    s = Σ_k v_k                 Δs = Σ_k (Δv_k + ε·(16 + √n)·|v_k|),    n iterations; of entries Σ_k ε·√(n - 1)·|v_k|
    w = kernel(u, v, …)         Δw by the flat program's own estimates, in which Δu, Δv, … are parameters (`errors.py`)
    V̄[i] += w                   an array of errors, V̄[i] += Δw + ε·(16 + √n)·|w|,    n iterations of all loops around

Entries of arrays and integers are exact. A number without an error costs nothing but the rounding where it enters a sum. The roundings
of an ordinary sum grow like √n; the bound would be n, and is not attained. Cost: a small multiple of the program's; a program is
transformed once, before it is printed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from teg.passes.lower.intrinsic import ROUNDINGS
from teg.passes.program.errors import with_errors_of
from teg.passes.program.link import with_bodies
from teg.passes.program.sink import sink
from teg.program import Arg as FlatArg
from teg.program import Assign, Program
from teg.program.arrays import Arg, ArrayProgram, Cells, Factors, Gaps, Least, Load, Loop, Number, Run, Scatter, Step, Take, steps
from teg.program.dce import without_dead_code
from teg.program.fields import renamed, result_names, variables
from teg.program.verify import verified_arrays

EPSILON = 2.0**-52
TOUCHING = 4e-6
"""The error of a sum over gaps where borders nearly touch, relative to the sizes of its terms on both halves of the line: crossings are off
by the square root of a rounding."""
TOUCHING_RATE = 0.1
"""The same of its derivative, relative to the sizes of its terms on the gaps: so little is known of how fast these crossings move."""
CORNERS = 1e-12
"""The error of the corners of cells, relative to the side of the box."""


def with_array_error_estimates(program: ArrayProgram) -> ArrayProgram:
    """Returns the program with twice the outputs: the old ones, then an error estimate of each, of the same shape.

    Its flat programs are as they were lowered; those of the result are finished.
    """
    return verified_arrays(_ArrayEstimator(program).run(), "after array error estimates")


class _ArrayEstimator:
    def __init__(self, program: ArrayProgram) -> None:
        self.program = program
        self.errors: dict[Arg, Arg] = {}
        self._made: dict[tuple[int, tuple[int, ...]], Program] = {}
        self._count = _last_number(program)
        self._sizes: dict[str, tuple[Arg, float]] = {}  # of the values that a table belongs to, and what they are multiplied by

    def run(self) -> ArrayProgram:
        program = self.program
        body = self._block(program.body, 1.0, ROUNDINGS)
        numbers = [o for o in program.outputs if isinstance(o, str)]
        last, found = self._rounded([(n, ROUNDINGS) for n in numbers])
        errors = dict(zip(numbers, found, strict=True))
        more = tuple(errors[o] if isinstance(o, str) else 0.0 if isinstance(o, int | float) else o for o in program.outputs)
        return replace(program, body=(*body, *last), outputs=(*program.outputs, *more))

    def _fresh(self) -> str:
        self._count += 1
        return f"v{self._count}"

    def _block(self, block: Sequence[Step], iterations: Arg, roundings: Arg) -> list[Step]:
        """Returns a block with the errors of its numbers. The recursion is as deep as loops are nested.

        `iterations` are those of the loops around; `roundings` is the error of a scattered number, in units of its value.
        """
        out: list[Step] = []
        places: list[Scatter] = []
        for step in block:
            match step:
                case Run():
                    out.append(self._kernel(step))
                case Least() | Factors() | Cells():
                    self._folded(step, iterations, out)
                case Gaps():
                    self._gaps(step, iterations, out)
                case Loop():
                    self._loop(step, iterations, out)
                case Take():
                    out.append(step)
                    self._of_take(step, out)
                case Scatter():
                    out.append(step)
                    places.append(step)
                case _:
                    out.append(step)
        before, errors = self._rounded([(s.value, roundings) for s in places])
        out += before
        first = len(self.program.outputs)
        out += [replace(s, output=first + s.output, value=e) for s, e in zip(places, errors, strict=True)]
        return out

    def _kernel(self, step: Run) -> Run:
        """Returns a flat program whose results have errors."""
        inexact = tuple(i for i, a in enumerate(step.inputs) if a in self.errors)
        key = id(step.program), inexact
        if key not in self._made:
            self._made[key] = with_errors_of(step.program, inexact)
        program = self._made[key]
        count = len(step.results)
        names: list[str] = []
        outputs: list[FlatArg] = list(program.outputs[:count])
        for result, error in zip(step.results, program.outputs[count:], strict=True):
            if isinstance(error, str):
                self.errors[result] = self._fresh()
                names.append(str(self.errors[result]))
                outputs.append(error)
            elif error:
                self.errors[result] = float(error)
        if not names:
            return replace(step, program=_finished(step.program))
        inputs = (*step.inputs, *(self.errors[step.inputs[i]] for i in inexact))
        whole = without_dead_code(replace(program, outputs=tuple(outputs)))
        return Run(_finished(whole), inputs, (*step.results, *names))

    def _loop(self, step: Loop, iterations: Arg, out: list[Step]) -> None:
        ends = self._fresh(), self._fresh()
        own, both, total, additions = (self._fresh() for _ in range(4))
        out += [Number(name, end) for name, end in zip(ends, (step.lo, step.hi), strict=True)]
        out.append(Run(_ROUNDINGS_OF_A_LOOP, (*ends, iterations), (own, both, total, additions)))
        body = self._block(step.body, total, both)
        entries = {s.name for s in step.body if isinstance(s, Load | Number)}
        last, errors = self._rounded([(v, additions if v in entries else own) for v in step.values])
        results = tuple(self._fresh() for _ in step.results)
        self.errors.update(zip(step.results, results, strict=True))
        values, names = (*step.values, *errors), (*step.results, *results)
        out.append(replace(step, body=(*body, *last), values=values, results=names))

    def _gaps(self, step: Gaps, iterations: Arg, out: list[Step]) -> None:
        """Appends a sum over gaps, whose ends are exact to rounding but where borders nearly touch, and its errors."""
        halves = [] if step.moving else self._on_whole_line(step, out)
        inside = self._block(step.inside, iterations, ROUNDINGS)
        last, errors = self._rounded([(t, ROUNDINGS) for t in step.terms])
        sizes = tuple(self._fresh() for _ in step.terms) if step.moving else ()
        last += [Run(_SIZE, (t,), (size,)) for t, size in zip(step.terms, sizes, strict=False)]
        body = tuple(replace(s, program=_finished(s.program)) if isinstance(s, Run) else s for s in step.body)
        own, added, doubtful = tuple(self._fresh() for _ in step.results), tuple(self._fresh() for _ in sizes), self._fresh()
        terms, names = (*step.terms, *errors, *sizes), (*step.results, *own, *added)
        out.append(replace(step, body=body, inside=(*inside, *last), terms=terms, results=names, doubtful=(doubtful,)))
        doubted: Sequence[tuple[Arg, ...]] = [(size,) for size in added] if step.moving else halves
        for result, error, parts in zip(step.results, own, doubted, strict=True):
            self.errors[result] = self._fresh()
            out.append(Run(_DOUBTED_RATE if step.moving else _DOUBTED, (error, *parts, doubtful), (str(self.errors[result]),)))

    def _on_whole_line(self, step: Gaps, out: list[Step]) -> list[tuple[Arg, Arg]]:
        """Appends the terms of both halves of a line, which may cancel on the whole of it. Returns their names."""
        middle = self._fresh()
        out.append(Run(_MIDDLE, (step.first, step.last), (middle,)))
        halves: list[tuple[Arg, ...]] = []
        for left, right in ((step.first, middle), (middle, step.last)):
            names: dict[str, Arg] = {name: self._fresh() for s in steps(step.inside) for name in (*result_names(s), *variables(s))}
            names |= {step.left: left, step.right: right}
            block = [renamed(s, names) for s in step.inside]
            out += [replace(s, program=_finished(s.program)) if isinstance(s, Run) else s for s in block]
            halves.append(tuple(names.get(t, t) if isinstance(t, str) else t for t in step.terms))
        return list(zip(*halves, strict=True))

    def _folded(self, step: Least | Factors | Cells, iterations: Arg, out: list[Step]) -> None:
        """Appends a loop that adds nothing up. An index has no error; a product that of the product of larger factors."""
        body = tuple(self._block(step.body, iterations, ROUNDINGS))
        match step:
            case Least():
                out.append(replace(step, body=body))
            case Factors():
                last, errors = self._rounded([(v, ROUNDINGS) for v in step.values])
                factors = tuple(self._fresh() for _ in step.values)
                last += [Run(_LARGER, (v, e), (name,)) for v, e, name in zip(step.values, errors, factors, strict=True)]
                larger = tuple(self._fresh() for _ in step.results)
                out.append(replace(step, body=(*body, *last), values=(*step.values, *factors), results=(*step.results, *larger)))
                for result, most in zip(step.results, larger, strict=True):
                    self.errors[result] = self._fresh()
                    out.append(Run(_BEYOND, (most, result), (str(self.errors[result]),)))
            case Cells():
                sizes = tuple(self._fresh() for _ in step.results)
                out.append(replace(step, body=body, sizes=sizes))
                inexact = any(self.errors.get(v, 0.0) != 0.0 for v in (*step.values, *step.otherwise))
                for k, (result, size) in enumerate(zip(step.results, sizes, strict=True)):
                    self.errors[result] = self._fresh()
                    factor = math.inf if inexact else CORNERS  # the errors of numbers of candidates are not carried on
                    out.append(Run(_SCALED, (size, factor, result), (str(self.errors[result]),)))
                    if step.tables:
                        self._sizes[step.tables[k]] = (size, factor)

    def _of_take(self, step: Take, out: list[Step]) -> None:
        size, factor = self._sizes[step.table]
        self.errors[step.name] = self._fresh()
        out.append(Run(_SCALED, (size, factor, step.name), (str(self.errors[step.name]),)))

    def _rounded(self, pairs: Sequence[tuple[Arg, Arg]]) -> tuple[list[Step], list[Arg]]:
        """Returns the errors of numbers that leave a block, with so many roundings of each."""
        if not pairs:
            return [], []
        body: list[Assign] = []
        inputs: list[Arg] = []
        outputs: list[FlatArg] = []
        for i, (value, roundings) in enumerate(pairs):
            inputs += [value, roundings, self.errors.get(value, 0.0)]
            v, r, e = (f"p{3 * i + j}" for j in range(3))
            body += [Assign(f"v{3 * i}", "abs", (v,)), Assign(f"v{3 * i + 1}", "mul", (r, f"v{3 * i}"))]
            body.append(Assign(f"v{3 * i + 2}", "add", (f"v{3 * i + 1}", e)))
            outputs.append(f"v{3 * i + 2}")
        names = tuple(self._fresh() for _ in pairs)
        titles = tuple(f"{what} {i}" for i in range(len(pairs)) for what in ("value", "roundings", "error"))
        return [Run(Program(titles, tuple(body), tuple(outputs)), tuple(inputs), names)], list(names)


def _finished(program: Program) -> Program:
    return with_bodies(sink(program))


def _roundings_of_a_loop() -> Program:
    """Returns a program from the ends of a range and the iterations of the loops around to roundings.

    Its results are the roundings of a sum over the range, the roundings of a number scattered in it, the iterations of all these loops,
    and the roundings of a sum of entries: one entry has none.
    """
    body = (
        Assign("v0", "sub", ("p1", "p0")),
        Assign("v1", "max", ("v0", 0.0)),
        Assign("v2", "mul", ("v1", "p2")),
        Assign("v3", "sqrt", ("v1",)),
        Assign("v4", "sqrt", ("v2",)),
        Assign("v5", "mul", (EPSILON, "v3")),
        Assign("v6", "mul", (EPSILON, "v4")),
        Assign("v7", "add", (ROUNDINGS, "v5")),
        Assign("v8", "add", (ROUNDINGS, "v6")),
        Assign("v9", "sub", ("v1", 1.0)),
        Assign("v10", "max", ("v9", 0.0)),
        Assign("v11", "sqrt", ("v10",)),
        Assign("v12", "mul", (EPSILON, "v11")),
    )
    return Program(("first", "end", "iterations"), body, ("v7", "v8", "v2", "v12"))


_ROUNDINGS_OF_A_LOOP = _roundings_of_a_loop()
_LARGER = Program(("factor", "error"), (Assign("v0", "abs", ("p0",)), Assign("v1", "add", ("v0", "p1"))), ("v1",))
_BEYOND = Program(("larger", "product"), (Assign("v0", "abs", ("p1",)), Assign("v1", "sub", ("p0", "v0"))), ("v1",))
_MIDDLE = Program(("first", "last"), (Assign("v0", "add", ("p0", "p1")), Assign("v1", "mul", (0.5, "v0"))), ("v1",))
_SIZE = Program(("term",), (Assign("v0", "abs", ("p0",)),), ("v0",))
_DOUBTED_RATE = Program(
    ("error", "sizes", "doubtful"),
    (Assign("v0", "mul", (TOUCHING_RATE, "p2", "p1")), Assign("v1", "add", ("p0", "v0"))),
    ("v1",),
)
_DOUBTED = Program(
    ("error", "one half", "other half", "doubtful"),
    (
        Assign("v0", "abs", ("p1",)),
        Assign("v1", "abs", ("p2",)),
        Assign("v2", "add", ("v0", "v1")),
        Assign("v3", "mul", (TOUCHING, "p3", "v2")),
        Assign("v4", "add", ("p0", "v3")),
    ),
    ("v4",),
)
_SCALED = Program(
    ("size", "factor", "value"),
    (Assign("v0", "abs", ("p2",)), Assign("v1", "add", ("p0", "v0")), Assign("v2", "mul", ("p1", "v1"))),
    ("v2",),
)


def _last_number(program: ArrayProgram) -> int:
    """Returns the largest number in the names of a program."""
    names = [name for step in steps(program.body) for name in (*result_names(step), *variables(step))]
    return max((int(name[1:]) for name in names), default=0)
