"""Is a program well formed? Run after passes with TEG_VERIFY=1, as all tests are.

Each name is given once, and before it is read, in a block that knows it; what stands for a number, a condition or an integer is one;
operations exist and have as many operands as they take; and the fields of a statement fit together. All but the last follows from the
declarations of the statements (`teg.program.fields`).
"""

from __future__ import annotations

import os
from typing import get_args

from teg.program.arrays import ArrayProgram, Integers, Like, Load, Loop, Run, Scatter, Step
from teg.program.fields import Kind, Operand, Part, Result, Variable, declared, flat, inner_blocks, leaves
from teg.program.limits import MAX_CUTS
from teg.program.names import is_condition
from teg.program.operations import INTEGER_OPERATIONS, OPERATIONS
from teg.program.rules import Adaptive, Rational
from teg.program.statements import (
    Assign,
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
    When,
)

Known = dict[str, Kind]
"""The names that are known at a place, and what each stands for."""


ASSIGNED = Result("any")
_NOTHING_MADE: dict[str, Known] = {}
OPERANDS: dict[Kind, Operand] = {kind: Operand(kind) for kind in get_args(Kind)}
_KINDS: dict[Kind, str] = {"number": "a number", "condition": "a condition", "integer": "an integer"}


class MalformedProgram(AssertionError):
    """A fault of the compiler: `what` is wrong with which statement (None: with the program as a whole), after which pass."""

    def __init__(self, what: str, statement: object = None, stage: str = "") -> None:
        self.what, self.statement, self.stage = what, statement, stage
        shown = "" if statement is None else f"\n    in {str(statement)[:400]}"
        super().__init__(f"{stage + ': ' if stage else ''}{what}{shown}")


def verified(program: Program, stage: str) -> Program:
    """Returns the program, verified after a pass if the environment asks for it (TEG_VERIFY=1)."""
    if os.environ.get("TEG_VERIFY"):
        verify_program(program, stage)
    return program


def verified_arrays(program: ArrayProgram, stage: str) -> ArrayProgram:
    """Returns the program with arrays, verified after a pass if the environment asks for it (TEG_VERIFY=1)."""
    if os.environ.get("TEG_VERIFY"):
        verify_array_program(program, stage)
    return program


def verify_program(program: Program, stage: str = "") -> None:
    """Raises MalformedProgram if a flat program, or the body of a function that it calls, is not well formed."""
    _Flat(program, stage).run()


def verify_array_program(program: ArrayProgram, stage: str = "") -> None:
    """Raises MalformedProgram if a program with arrays, or one of its flat programs, is not well formed."""
    _Arrays(program, stage).run()


class _Verifier:
    """The common part of the verifiers of flat programs and of programs with arrays."""

    def __init__(self, stage: str) -> None:
        self.stage = stage
        self.given: set[str] = set()  # all results so far, anywhere

    def fail(self, what: str, statement: object = None) -> None:
        raise MalformedProgram(what, statement, self.stage)

    def check(self, holds: bool, what: str, statement: object = None) -> None:
        if not holds:
            self.fail(what, statement)

    def own(self, stmt: object, known: Known) -> None:
        """Checks the conditions of one class of statements. Subclasses override it."""

    def block(self, block: tuple[object, ...], around: Known) -> Known:
        """Check the statements of a block; returns the names they give. Recursion is as deep as blocks are in each other."""
        known, mine = dict(around), Known()
        for stmt in block:
            for name, kind in self.statement(stmt, known).items():
                known[name] = mine[name] = kind
        return mine

    def statement(self, stmt: object, known: Known) -> Known:
        """Check one statement, before which some names are known; returns the names it gives."""
        scopes: dict[str, Known] = {"": known}
        made: dict[str, Known] = {}
        names = list(leaves(stmt))
        variables = [(r, v) for r, v in names if isinstance(r, Variable)]
        for name, role, block in inner_blocks(stmt):
            own = {v: r.kind for r, v in variables if name in r.blocks}
            for v in own:
                self.check(v not in known and v not in self.given, f"the variable {v} has another meaning here", stmt)
            outside = known | own
            for other in role.sees:
                outside |= made[other]
            made[name] = self.block(block, outside)
            scopes[name] = outside | made[name]
        for operand, arg in names:
            if isinstance(operand, Operand):
                self.operand(arg, operand, scopes[operand.at], stmt)
        self.lengths(stmt)
        self.own(stmt, known)
        results = [(name, result) for result, name in names if isinstance(result, Result)]
        return {name: self.result(name, result, known, made, stmt) for name, result in results}

    def result(self, name: str, role: Result, known: Known, made: dict[str, Known], stmt: object) -> Kind:
        """Check a name that a statement gives; returns what it stands for."""
        if role.made_in:
            kind = made[role.made_in].get(name)
            self.check(kind == role.kind, f"{name} is no {role.kind} that its block gives", stmt)
            return role.kind
        if name in self.given or name in known:
            self.fail(f"{name} is given twice", stmt)
        self.given.add(name)
        kind = self.kind_of(stmt) if role.kind == "any" else role.kind
        if is_condition(name) != (kind == "condition"):
            self.fail(f"{name} is no name of {_KINDS[kind]}", stmt)
        return kind

    def kind_of(self, stmt: object) -> Kind:
        """Returns the kind of the result of a statement whose operation decides it."""
        raise NotImplementedError

    def operand(self, arg: object, role: Operand, known: Known, stmt: object) -> None:
        """Checks that a name is known where it is read, and that it has the right kind."""
        if isinstance(arg, str):
            if arg not in known:
                self.fail(f"{arg} is not known where it is read", stmt)
            elif role.kind not in ("any", known[arg]):
                self.fail(f"{arg} is {_KINDS[known[arg]]}, and is read as {_KINDS[role.kind]}", stmt)
        elif role.kind != "any" and not _is(arg, role.kind):
            self.fail(f"the literal {arg!r} is no {role.kind}", stmt)

    def lengths(self, node: object, results: int = -1) -> None:
        """Check that there is an entry for each result where the declaration says so; a guard has as many as are tested."""
        if results < 0:
            results = len(getattr(node, "results", ()))
        for field in declared(type(node)):
            value, role = getattr(node, field.name), field.role
            if isinstance(role, Part):
                parts = list(flat(value))
                self.check(not role.each or len(parts) == results, f"{field.name}: {len(parts)} for {results} results", node)
                for part in parts:
                    self.lengths(part, results)
            elif isinstance(role, Operand) and role.each:
                fits = len(value) == results if hasattr(node, "results") else len(value) <= results
                self.check(fits, f"{field.name}: {len(value)} for {results} results", node)
            elif isinstance(role, Result) and role.each:
                self.check(len(value) <= results, f"{field.name}: {len(value)} for {results} results", node)


def _is(literal: object, kind: Kind) -> bool:
    """Returns whether a literal may stand for that."""
    match kind:
        case "condition":
            return isinstance(literal, bool)
        case "integer":
            return isinstance(literal, int) and not isinstance(literal, bool)
        case _:
            return isinstance(literal, int | float) and not isinstance(literal, bool)


class _Flat(_Verifier):
    """The verifier of a flat program."""

    def __init__(self, program: Program, stage: str) -> None:
        super().__init__(stage)
        self.program = program

    def run(self) -> None:
        program = self.program
        known: Known = {f"p{i}": "number" for i in range(len(program.parameters))}
        self._branches(program.body, False)
        known |= self.block(program.body, known)
        for output in program.outputs:
            self.operand(output, Operand("number"), known, None)
        for k, f in enumerate(program.functions):
            if f.body is not None:
                stage = f"{self.stage}: function {k}".removeprefix(": ")
                verify_program(f.body, stage)
                self.check(len(f.body.outputs) == 1, f"function {k} has {len(f.body.outputs)} outputs")

    def statement(self, stmt: object, known: Known) -> Known:
        """Check one statement. An assignment, which most statements are, is read without its declaration."""
        if not isinstance(stmt, Assign):
            return super().statement(stmt, known)
        self._assignment(stmt, known)
        return {stmt.name: self.result(stmt.name, ASSIGNED, known, _NOTHING_MADE, stmt)}

    def kind_of(self, stmt: object) -> Kind:
        assert isinstance(stmt, Assign)
        return OPERATIONS[stmt.op].result

    def own(self, stmt: object, known: Known) -> None:
        match stmt:
            case Integrate():
                self._integral(stmt)
            case Isolate():
                self.check(len(stmt.errors) in (0, len(stmt.results)), "errors of some roots only", stmt)
            case Locate():
                self.check(len(stmt.bounds) in (4, 12), f"{len(stmt.bounds)} bounds of two functions", stmt)
            case Sample():
                self.check(stmt.kind in ("montecarlo", "qmc"), f"there are no samples of the kind {stmt.kind!r}", stmt)
                self.check(stmt.count > 0, f"{stmt.count} points", stmt)
            case Polygon():
                count = 4 if stmt.corners else 2
                self.check(len(stmt.variables) == count, f"{len(stmt.variables)} variables, not {count}", stmt)
                self.check(len(stmt.corners) in (0, 3), f"{len(stmt.corners)} corners of a triangle", stmt)
                self.check(not stmt.corners or len(stmt.half_planes) >= 3, "a triangle of fewer than three half-planes", stmt)
            case Polyhedron():
                self.check(len(stmt.variables) == 3, f"{len(stmt.variables)} variables, not 3", stmt)
                self.check(len(stmt.extents) == 3, f"{len(stmt.extents)} extents, not 3", stmt)
                self.check(all(len(g.slopes) == 3 for g in stmt.half_spaces), "a half-space has three slopes", stmt)
            case Segment():
                for k in (g.k for g in stmt.half_lines if g.k is not None):
                    self._tie(k, stmt)
            case Hyperbola():
                self._moments(stmt)
            case Ellipse():
                self._ellipse(stmt)

    def _assignment(self, stmt: Assign, known: Known) -> None:
        operation = OPERATIONS.get(stmt.op)
        if operation is None:
            raise MalformedProgram(f"there is no operation {stmt.op!r}", stmt, self.stage)
        kinds, count = operation.operands, len(stmt.args)
        if operation.repeated and count > len(kinds):
            kinds = kinds + kinds[-1:] * (count - len(kinds))
        least = 1 if operation.repeated else len(kinds)  # a function may have no inputs
        if not least <= count <= len(kinds):
            self.fail(f"{stmt.op} of {count} operands", stmt)
        for arg, kind in zip(stmt.args, kinds, strict=False):
            if not isinstance(arg, str) or known.get(arg) != kind:
                self.operand(arg, OPERANDS[kind], known, stmt)
        if stmt.op == "call":
            k = stmt.args[0]
            self.check(isinstance(k, int) and 0 <= k < len(self.program.functions), f"there is no function {k}", stmt)
            body = self.program.functions[int(k)].body
            self.check(body is None or len(body.parameters) == count - 1, f"function {k} of {count - 1} inputs", stmt)
        elif stmt.op == "tie":
            self._tie(stmt.args[3], stmt)
        elif stmt.op == "powi":
            self.check(isinstance(stmt.args[1], int), "a power that is no literal", stmt)

    def _tie(self, k: object, stmt: object) -> None:
        self.check(isinstance(k, int) and 0 <= k < len(self.program.ties), f"there is no tie {k}", stmt)

    def _integral(self, stmt: Integrate) -> None:
        if isinstance(stmt.rule, Rational):
            self.check([b.kind for b in stmt.bends] == ["pole"], "a rational rule needs one pole", stmt)
        self.check(all(b.kind in ("root", "pole", "end") for b in stmt.bends), "a bend of an unknown kind", stmt)
        self.check(not stmt.infinite or isinstance(stmt.rule, Adaptive), "infinite bounds need an adaptive rule", stmt)
        self.check(len(stmt.ends) in (0, 2), f"a piece has two ends, not {len(stmt.ends)}", stmt)
        if stmt.guard is not None:
            sharp = {len(bounds) for bounds in (stmt.guard.upper, stmt.guard.lower, stmt.guard.change, stmt.guard.seen)}
            self.check(isinstance(stmt.rule, Adaptive), "a guard needs an adaptive rule", stmt)
            self.check(len(sharp) == 1, "sharp values without a bound or a value", stmt)
            self.check(len(stmt.guard.sizes) >= stmt.tested, f"{len(stmt.guard.sizes)} sizes of {stmt.tested} tested values", stmt)

    def _moments(self, stmt: Hyperbola) -> None:
        self.check(len(stmt.corners) == 4, f"{len(stmt.corners)} corners of a square", stmt)
        self.check(len(stmt.ties) in (0, 4), f"{len(stmt.ties)} ties of four sides", stmt)
        self.check(len(stmt.scale) == len(stmt.ties), "ties without a scale", stmt)
        kinds = {m.kind for m in stmt.moments}
        self.check(kinds <= {"above", "below", "border"}, f"moments of the kinds {kinds}", stmt)
        for k in stmt.ties:
            self._tie(k, stmt)

    def _ellipse(self, stmt: Ellipse) -> None:
        self.check(len(stmt.matrix) == 4, f"{len(stmt.matrix)} numbers of the matrix of an ellipse", stmt)
        self.check(len(stmt.place) == 6, f"{len(stmt.place)} numbers of the place of an ellipse", stmt)
        self.check(all(m.axes == (0, 0) for m in stmt.moments if m.kind != "border"), "powers along axes inside of an ellipse", stmt)
        self.check(len(stmt.half_planes) <= MAX_CUTS, f"{len(stmt.half_planes)} half-planes beside an ellipse", stmt)
        kinds = {m.kind for m in stmt.moments}
        self.check(kinds <= {"above", "below", "border"}, f"moments of the kinds {kinds}", stmt)

    def _branches(self, block: tuple[Stmt, ...], inside: bool) -> None:
        """Check that branches stand in the outermost block, or in each other."""
        for stmt in block:
            if isinstance(stmt, When):
                self.check(not inside, "a branch in a loop", stmt)
                self._branches(stmt.body, False)
            else:
                for _, _, inner in inner_blocks(stmt):
                    self._branches(inner, True)


class _Arrays(_Verifier):
    """The verifier of a program with arrays."""

    def __init__(self, program: ArrayProgram, stage: str) -> None:
        super().__init__(stage)
        self.program = program
        self._flat: set[int] = set()

    def run(self) -> None:
        program = self.program
        known: Known = {f"p{i}": "number" for i in range(len(program.parameters))}
        known |= self.block(program.body, known)
        for output in program.outputs:
            if isinstance(output, Like):
                self._array(output.array, False, None)
            else:
                self.operand(output, Operand("number"), known, None)

    def own(self, stmt: object, known: Known) -> None:
        match stmt:
            case Integers():
                self._integers(stmt)
            case Load():
                self._array(stmt.array, False, stmt, len(stmt.subscripts))
            case Run():
                self._run(stmt)
            case Loop() if stmt.listed >= 0:
                self.check(stmt.listed < len(self.program.arrays), f"there is no array {stmt.listed}", stmt)
                self.check(self.program.arrays[stmt.listed].integers, "rows are listed in an array of indices", stmt)
            case Scatter():
                self._array(stmt.array, False, stmt, len(stmt.subscripts))
                outputs = self.program.outputs
                fits = stmt.output < len(outputs) and outputs[stmt.output] == Like(stmt.array)
                self.check(fits, f"output {stmt.output} is not like array {stmt.array}", stmt)

    def _array(self, k: int, integers: bool, stmt: Step | None, dimensions: int | None = None) -> None:
        self.check(0 <= k < len(self.program.arrays), f"there is no array {k}", stmt)
        array = self.program.arrays[k]
        kind = "integers" if integers else "numbers"
        self.check(array.integers == integers, f"{array.name} is no array of {kind}", stmt)
        if dimensions is not None:
            self.check(array.dimensions == dimensions, f"{dimensions} subscripts of {array.name}, which has {array.dimensions}", stmt)

    def _integers(self, stmt: Integers) -> None:
        match stmt.op:
            case "gather":
                self._array(stmt.array, True, stmt, len(stmt.args))
            case "length":
                self.check(0 <= stmt.array < len(self.program.arrays), f"there is no array {stmt.array}", stmt)
                (axis,) = stmt.args
                dimensions = self.program.arrays[stmt.array].dimensions
                self.check(isinstance(axis, int) and 0 <= axis < dimensions, f"there is no axis {axis}", stmt)
            case "param":
                (k,) = stmt.args
                self.check(isinstance(k, int) and 0 <= k < len(self.program.parameters), f"there is no parameter {k}", stmt)
            case _:
                self.check(stmt.op in INTEGER_OPERATIONS, f"there is no operation {stmt.op!r} of integers", stmt)
                self.check(len(stmt.args) == 2, f"{stmt.op} of {len(stmt.args)} operands", stmt)

    def _run(self, stmt: Run) -> None:
        if id(stmt.program) not in self._flat:
            verify_program(stmt.program, f"{self.stage}: a kernel".removeprefix(": "))
            self._flat.add(id(stmt.program))
        inputs, results = len(stmt.program.parameters), len(stmt.program.outputs)
        self.check(len(stmt.inputs) == inputs, f"{len(stmt.inputs)} inputs of a kernel with {inputs} parameters", stmt)
        self.check(len(stmt.results) == results, f"{len(stmt.results)} results of a kernel with {results} outputs", stmt)
