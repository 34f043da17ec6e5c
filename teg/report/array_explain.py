"""What the compiler found and did in a program with arrays: its loops, and each cell as the scalar program that it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from teg.analysis.settings import Integration
from teg.errors import TegError
from teg.ir.arrays import Array, Gather, Sum, arrays_of, integer_parameters, integers_of
from teg.ir.cells import Symbols, cells_of, check_indices, replace_integers
from teg.ir.expr import Expr, Param, tuple_of
from teg.ir.index import Index, IndexArray, Length, index_const, index_leaves
from teg.ir.node import Node, postorder
from teg.ir.traverse import parameters
from teg.ir.traverse import size as nodes
from teg.passes.differentiate.through_sums import Parameter, gradient, on_cells, outlined
from teg.passes.lower.loops import Output, output_of, schedule_arrays
from teg.passes.normalise.canonicalise import canonicalise
from teg.passes.normalise.sums import NeedsLengths
from teg.pipeline import Maps, cell_program, compiled_outputs, flatten, normal_form
from teg.program import Program
from teg.program.arrays import CHUNKS, LEAST, Arg, ArrayProgram, Integers, Load, Loop, Run, Scatter, Step, array_size, steps, work
from teg.report.explanation import ArrayExplanation, Explanation
from teg.report.inventory import text_of

ASSUMED = 2
"""The length of every array, where the program must be known for lengths and none are given."""
SIGNS = {"add": "{} + {}", "sub": "{} - {}", "mul": "{}·{}", "floordiv": "{} // {}", "mod": "{} % {}"}

OnCell = Callable[[Expr, Sequence[Param]], Explanation]
"""The explanation of a scalar program that is differentiated by some parameters."""
Cost = Callable[[Program], dict[str, Any]]


def explain_arrays(
    e: Expr, wrt: Sequence[Parameter] | None, how: Integration, discontinuities: str, maps: Maps, on_cell: OnCell, cost: Cost
) -> ArrayExplanation:
    """The loops of the program of the value, and of that of value and gradient; surfaces and integrals cell by cell.

    `data` has the keys of a scalar program's, in which each surface and integral has its "cell", the number of an entry of data["cells"];
    data["loops"] are the loops of both programs. A sum inside an integral that has to be written out is so for arrays of length 2.
    """
    check_indices(e)
    counted = set(integer_parameters(e))
    default: list[Parameter] = [p for p in parameters(e) if p not in counted]
    chosen = [*default, *(a for a in arrays_of(e) if isinstance(a, Array))] if wrt is None else list(wrt)
    plain, assumed = _outlined(e)
    data: dict[str, Any] = {
        "expression": text_of(e),
        "nodes": nodes(e),
        "options": {
            "tol": how.tol, "rule": how.rule, "order": how.order, "discontinuities": discontinuities, "max_roots": how.max_roots,
            "intrinsics": how.intrinsics,
        },
        "assumed_length": assumed,
        "arrays": [{"name": a.name, "dimensions": a.dimensions, "integers": isinstance(a, IndexArray)} for a in arrays_of(e)],
        "cells": [],
        "loops": {},
        "cost": {},
        "value_statements": None,
        "gradient_statements": None,
        "value_error": "",
        "gradient_error": "",
        **{key: [] for key in _TABLES},
    }  # fmt: skip
    for path, cell in cells_of(plain):
        _explain_cell(data, path, cell, chosen, on_cell)
    if not data["value_error"]:
        _explain_loops(data, plain, chosen, _Passes(how, discontinuities, maps), cost)
    return ArrayExplanation(data)


_TABLES = ("surfaces", "dropped", "integrals", "boundary", "interior", "remarks")


def _outlined(e: Expr) -> tuple[Expr, int | None]:
    """The program with its sums outside of integrals; for assumed lengths where they must be known."""
    try:
        return outlined(e), None
    except NeedsLengths:
        lengths = [n for node in postorder([e]) for n in index_leaves(integers_of(node)) if isinstance(n, Length)]
        assumed: dict[Index, Index] = {n: index_const(ASSUMED) for n in lengths}
        return outlined(replace_integers(e, assumed)), ASSUMED


# -- cells ---------------------------------------------------------------------------------------------------------------


def _active(leaf: Node, wrt: set[Node]) -> bool:
    """Whether an entry or a sum depends on what is differentiated by."""
    return any(n in wrt or (isinstance(n, Gather) and n.array in wrt) for n in postorder([leaf]))


def _explain_cell(data: dict[str, Any], path: tuple[Sum, ...], body: Expr, wrt: Sequence[Parameter], on_cell: OnCell) -> None:
    """Add the explanation of a cell to that of the program."""
    symbols = Symbols()
    (cell,) = symbols.into([body])
    given = set[Node](wrt)
    moving = [p for p in parameters(cell) if (_active(symbols.meaning[p], given) if p in symbols.meaning else p in given)]
    found = on_cell(cell, moving).data
    number = len(data["cells"])
    data["cells"].append({
        "sums": [f"{s.index.name}: {s.lo} .. {s.hi}" for s in path],
        "expression": found["expression"],
        "nodes": found["nodes"],
        "depends_on": [p.name for p in parameters(cell)],
        "value_error": found["value_error"],
        "gradient_error": found["gradient_error"],
    })  # fmt: skip
    for key in _TABLES:
        data[key] += [{**row, "cell": number} for row in found[key]]
    data["value_error"] = data["value_error"] or found["value_error"]
    data["gradient_error"] = data["gradient_error"] or found["gradient_error"]


# -- loops ---------------------------------------------------------------------------------------------------------------


class _Passes:
    """The passes of a compilation, on cells."""

    def __init__(self, how: Integration, discontinuities: str, maps: Maps) -> None:
        self.how, self.discontinuities, self.maps = how, discontinuities, maps

    def normal(self, cell: Expr) -> Expr:
        return normal_form(cell, maps=self.maps)

    def derive(self, cell: Expr, wrt: Sequence[Param]) -> list[Expr]:
        return flatten(compiled_outputs(cell, wrt, 1, self.discontinuities, self.maps, self.how.closed_forms)[1])

    def flat(self, cells: Sequence[Expr], names: Sequence[str]) -> Program:
        return cell_program(flatten(canonicalise(tuple_of(*cells))), names, self.how)


def _explain_loops(data: dict[str, Any], e: Expr, wrt: Sequence[Parameter], passes: _Passes, cost: Cost) -> None:
    scalars = list(dict.fromkeys(p.name for p in (*wrt, *parameters(e), *integer_parameters(e)) if isinstance(p, Param)))
    arrays = list(dict.fromkeys([*(a for a in wrt if isinstance(a, Array)), *arrays_of(e)]))
    leaves = flatten(e)
    outputs: list[Output] = [output_of(on_cells(leaf, passes.normal)) for leaf in leaves]
    data["value_statements"] = _add_program(data, "value", schedule_arrays(outputs, scalars, arrays, passes.flat), cost)
    if not wrt or data["gradient_error"]:
        return
    try:
        for leaf in leaves:
            slopes = gradient(leaf, wrt, passes.derive)
            outputs += [(p, slope) if isinstance(p, Array) else slope for p, slope in zip(wrt, slopes, strict=True)]
    except TegError as problem:
        data["gradient_error"] = problem.what
        return
    program = schedule_arrays(outputs, scalars, arrays, passes.flat)
    data["gradient_statements"] = _add_program(data, "value and gradient", program, cost)


def _add_program(data: dict[str, Any], name: str, program: ArrayProgram, cost: Cost) -> int:
    """Add the loops and the cost of a program; its size."""
    texts: dict[Arg, str] = {f"p{k}": p for k, p in enumerate(program.parameters)}
    rows = [_row(None, program.body, 0, program, texts, cost)]
    waiting: list[tuple[Step, int]] = [(s, 0) for s in reversed(program.body)]
    while waiting:
        step, depth = waiting.pop()
        if isinstance(step, Integers):
            texts[step.name] = _text(step, program, texts)
        elif isinstance(step, Loop):
            texts[step.index] = step.title
            rows.append(_row(step, step.body, depth + 1, program, texts, cost))
            waiting.extend((s, depth + 1) for s in reversed(step.body))
    data["loops"][name] = rows
    every = [cost(s.program) for s in steps(program.body) if isinstance(s, Run)]
    data["cost"][name] = {
        "statements": array_size(program),
        "integrals": sum(c["integrals"] for c in every),
        "isolations": sum(c["isolations"] for c in every),
        "evaluations": sum(c["evaluations"] for c in every),
        "adaptive": any(c["adaptive"] for c in every),
    }
    return array_size(program)


def _row(
    loop: Loop | None, block: Sequence[Step], depth: int, program: ArrayProgram, texts: Mapping[Arg, str], cost: Cost
) -> dict[str, Any]:
    """What a loop does in one iteration, without the loops inside; for None what is done once a call."""
    costs = [cost(s.program) for s in block if isinstance(s, Run)]
    least = 1 + LEAST // max(work(tuple(block)), 1)
    return {
        "index": "" if loop is None else loop.title,
        "lower": "" if loop is None else _named(loop.lo, texts),
        "upper": "" if loop is None else _named(loop.hi, texts),
        "depth": depth,
        "loads": sum(isinstance(s, Load) for s in block),
        "scatters": [program.arrays[s.array].name for s in block if isinstance(s, Scatter)],
        "results": 0 if loop is None else len(loop.results),
        "statements": sum(1 for s in block if not isinstance(s, Run | Loop)) + sum(c["statements"] for c in costs),
        "integrals": sum(c["integrals"] for c in costs),
        "evaluations": sum(c["evaluations"] for c in costs),
        "adaptive": any(c["adaptive"] for c in costs),
        "chunks": CHUNKS if depth == 1 else 1,
        "iterations_a_chunk": least if depth == 1 else None,
    }


def _named(arg: Arg, texts: Mapping[Arg, str]) -> str:
    return texts.get(arg, str(arg))


def _text(step: Integers, program: ArrayProgram, texts: Mapping[Arg, str]) -> str:
    args = [_named(a, texts) for a in step.args]
    match step.op:
        case "length":
            return f"length({program.arrays[step.array].name}, {args[0]})"
        case "param":
            return program.parameters[int(step.args[0])]
        case "gather":
            return f"{program.arrays[step.array].name}[{', '.join(args)}]"
        case "min" | "max":
            return f"{step.op}({', '.join(args)})"
        case _:
            return SIGNS[step.op].format(*(f"({a})" if " " in a else a for a in args))
