"""A flat program together with those of the loops around it, where it is computed long after these.

What is kept for later is written once and read once; arithmetic costs less than that. So a point that waits keeps its indices and data, and
what the loops around it had computed from them is computed again. What the numbers of a loop have to do with each other is seen, too.

    joined(run, makers)  ->  Run         the flat program of `run`, in which those of some `makers` are inlined
    input_residues(...)  ->  residues    of what a flat program in an array program is given
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from teg.program.arrays import Integers, Load, Number, Run, Step, steps
from teg.program.fields import renamed
from teg.program.names import of_kind, unused_numbers
from teg.program.residues import P, Residues, random_residue, residue_of
from teg.program.statements import Arg, Assign, Program
from teg.program.walk import assigned, statements

ARITHMETIC = {"const", "add", "sub", "mul", "div", "neg", "powi", "abs", "min", "max", "select"}
ARITHMETIC |= {"gt0", "ge0", "lt0", "le0", "and", "or", "not", "ok"}
LONGEST = 200
"""Statements of a program that is computed again."""
SAVED = 3
"""So many numbers less must wait, at least."""


def joined(run: Run, makers: Sequence[Run]) -> Run:
    """Returns a flat program with the makers of its inputs inlined, in the order in which they are run; `run` itself if fewer inputs do not
    come of it."""
    wanted = set(run.inputs)
    kept: list[Run] = []
    for maker in reversed(makers):
        if not wanted.isdisjoint(maker.results) and _is_short(maker.program):
            kept.append(maker)
            wanted = (wanted - set(maker.results)) | set(maker.inputs)
    if len({a for a in wanted if isinstance(a, str)}) + SAVED > len({a for a in run.inputs if isinstance(a, str)}):
        return run
    numbers = unused_numbers(n for s in statements(run.program.body) for n in assigned(s))
    inputs: dict[Arg, str] = {}
    spelled: dict[Arg, Arg] = {}

    def place(arg: Arg) -> Arg:
        if not isinstance(arg, str):
            return arg
        return spelled[arg] if arg in spelled else inputs.setdefault(arg, f"p{len(inputs)}")

    body: list[Assign] = []
    for maker in reversed(kept):
        names: dict[Any, Any] = {f"p{i}": place(a) for i, a in enumerate(maker.inputs)}
        for s in maker.program.body:
            assert isinstance(s, Assign)
            names[s.name] = of_kind(s.name, next(numbers))
            body.append(replace(s, name=names[s.name], args=tuple(names.get(a, a) for a in s.args)))
        spelled |= {r: names.get(o, o) for r, o in zip(maker.results, maker.program.outputs, strict=True)}
    own: dict[str, Any] = {f"p{i}": place(a) for i, a in enumerate(run.inputs)}
    rest = tuple(renamed(s, own) for s in run.program.body)
    outputs = tuple(own.get(o, o) if isinstance(o, str) else o for o in run.program.outputs)
    program = replace(run.program, parameters=tuple(map(str, inputs)), body=(*body, *rest), outputs=outputs)
    return Run(program, tuple(inputs), run.results)


def _is_short(program: Program) -> bool:
    return len(program.body) <= LONGEST and all(isinstance(s, Assign) and s.op in ARITHMETIC for s in program.body)


def input_residues(body: tuple[Step, ...], runs: Sequence[Run], point: int) -> dict[int, dict[str, int | None]]:
    """Returns residues of the parameters of flat programs, by the identity of each, at a random point of the data: what the array program
    computes connects them."""
    known: dict[Arg, int | None] = {}

    def of(arg: Arg) -> int | None:
        return residue_of(float(arg)) if not isinstance(arg, str) else known.setdefault(arg, random_residue(point, arg))

    for step in steps(body):
        match step:
            case Number():
                known[step.name] = of(step.integer)
            case Load():
                known[step.name] = random_residue(point, step.array, step.subscripts)
            case Integers(op="add" | "sub" | "mul"):
                a, b = map(of, step.args)
                if a is not None and b is not None:
                    known[step.name] = (a + b if step.op == "add" else a - b if step.op == "sub" else a * b) % P
            case Run():
                residues = Residues({f"p{i}": of(a) for i, a in enumerate(step.inputs)})
                residues.follow(step.program.body)
                known |= {r: residues.of(o) for r, o in zip(step.results, step.program.outputs, strict=True)}
            case _:
                pass
    return {id(run): {f"p{i}": of(a) for i, a in enumerate(run.inputs)} for run in runs}
