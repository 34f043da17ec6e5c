"""Findings and decisions of the compiler: owner and family of every surface, breaks and rule of every integral, loops, and cost.

A program with arrays is explained cell by cell, each as a scalar program.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from teg.analysis.remarks import Remarks
from teg.analysis.settings import Integration
from teg.backends.shared.cells import most_candidates
from teg.errors import TegError
from teg.ir.arrays import Gather, Ranged, StillGather, arrays_of
from teg.ir.cells import Symbols, cells_of
from teg.ir.expr import Expr, Param
from teg.ir.function import Function
from teg.ir.index import IndexArray
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.traverse import parameters
from teg.ir.traverse import size as nodes
from teg.passes.differentiate.estimators.estimator import Estimator
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.differentiate.estimators.ignore import Ignore
from teg.passes.differentiate.through_sums import Parameter
from teg.passes.eliminate.families import closing, families_with
from teg.passes.intrinsics import boundary_terms
from teg.passes.lower.integrals import About
from teg.passes.normalise.canonicalise import canonicalise
from teg.passes.normalise.inline import reasons, write_out
from teg.passes.normalise.runs import listed_sums
from teg.passes.normalise.steps import enumerate_steps
from teg.pipeline import Elimination, Maps, compiled_outputs, flatten, normal_form, program_for
from teg.program import size
from teg.program.arrays import (
    CHUNKS,
    LEAST,
    Arg,
    ArrayProgram,
    Cells,
    Integers,
    Load,
    Loop,
    Rows,
    Run,
    Scatter,
    Step,
    array_size,
    steps,
    work,
)
from teg.report.explanation import ArrayExplanation, Explanation
from teg.report.integrals import Integrals, cost_of
from teg.report.inventory import Forms, Inventory, text_of

SIGNS = {"add": "{} + {}", "sub": "{} - {}", "mul": "{}·{}", "floordiv": "{} // {}", "mod": "{} % {}"}
T = TypeVar("T")


@dataclass(frozen=True)
class Asked:
    """The options of a compilation, and the order of `derivatives` of which all integrals are listed.

    Also the assumed length of arrays, if the program must be known for lengths and none are given.
    """

    integration: Integration
    estimator: Estimator
    maps: Maps
    derivatives: int
    assumed_length: int | None = None

    @property
    def options(self) -> dict[str, Any]:
        """Returns the options as data."""
        how = self.integration
        named = {"tol": how.tol, "rule": how.rule, "order": how.order}
        return {**named, "discontinuities": self.estimator.name, "max_roots": how.max_roots, "intrinsics": how.intrinsics}


def explain_cell(e: Expr, chosen: Sequence[Param], asked: Asked) -> Explanation:
    """Returns the explanation of a program without sums, or of one cell."""
    how, maps, estimator = asked.integration, asked.maps, asked.estimator
    functions, shown, number, e = _functions(e), text_of(e), nodes(e), write_out(e)
    before = canonicalise(enumerate_steps(e))
    remarks = Remarks()
    normal, value_error = _attempted(lambda: normal_form(e, maps=maps, remarks=remarks))
    closed = boundary_terms() if how.closed_forms else ()
    families = closing(families_with(maps), closed) if how.closed_forms else families_with(maps)
    final = before if normal is None else normal
    forms = Forms(e, before, final)
    inventory = Inventory(forms, chosen, estimator=estimator.name, families=families, closed=closed, max_roots=how.max_roots)
    names = list(dict.fromkeys(p.name for p in (*chosen, *parameters(e), *(p for m in maps for p in m.parameters))))
    integrals = Integrals(how)
    data: dict[str, Any] = {
        "expression": shown,
        "nodes": number,
        "functions": functions,
        "options": asked.options,
        "surfaces": inventory.surfaces(),
        "dropped": inventory.dropped(),
        "integrals": [] if normal is None else integrals.of([normal]),
        "boundary": [],
        "interior": [],
        "remarks": [],
        "cost": {},
        "value_statements": None,
        "gradient_statements": None,
        "value_error": value_error,
        "gradient_error": "",
    }  # fmt: skip
    if normal is None:
        return Explanation(data)
    program = program_for(flatten(normal), names, how, remarks=remarks)
    data["remarks"] = _told(remarks)
    data["value_statements"], data["cost"]["value"] = size(program), cost_of(program)
    if not chosen:
        return Explanation(data)
    outputs, data["gradient_error"] = _attempted(
        lambda: compiled_outputs(e, chosen, 1, estimator, Elimination(maps, how.closed_forms, remarks))
    )
    if outputs is not None:
        program = program_for(
            [leaf for o in outputs for leaf in flatten(o)], names, how, remarks=remarks, about=About(differentiated=flatten(outputs[0]))
        )
        data["remarks"] = _told(remarks)
        data["gradient_statements"], data["cost"]["value and gradient"] = size(program), cost_of(program)
        interior = compiled_outputs(e, chosen, 1, Ignore())[1]
        integrals = Integrals(how, flatten(outputs[0]))
        data["boundary"] = integrals.of([outputs[1]], but=[normal, outputs[0], interior])
        if asked.derivatives:
            data["interior"] = integrals.of([interior], but=[normal, outputs[0]])
    return Explanation(data)


def _told(remarks: Remarks) -> list[dict[str, Any]]:
    """Returns the decisions of the passes, each once: the pass, the surface or the integral, the choice, and the reason."""

    def about(e: Expr) -> str:
        return f"∫ d{e.var.name} from {text_of(e.lo)} to {text_of(e.hi)}" if isinstance(e, Integral) else f"{text_of(e)} = 0"

    rows = [(r.stage, about(r.subject), r.choice, r.reason) for r in remarks]
    return [dict(zip(("pass", "about", "choice", "reason"), row, strict=True)) for row in dict.fromkeys(rows)]


def _functions(e: Expr) -> list[dict[str, Any]]:
    """Returns each applied function with the number of its applications, and of those written out, with the reasons."""
    rows: dict[Function, dict[str, Any]] = {}
    for node, why in reasons(e).items():
        function = cast(Function, node.callee)
        formals = ", ".join(f.name for f in function.formals)
        row = rows.setdefault(function, {"function": f"{function.title}({formals})", "applications": 0, "written out": 0, "why": []})
        row["applications"] += 1
        row["written out"] += bool(why)
        if why and why not in row["why"]:
            row["why"].append(why)
    return [{**row, "why": "; ".join(row["why"])} for row in rows.values()]


def _attempted(work: Callable[[], T]) -> tuple[T | None, str]:
    """Returns a result, or the mistake in the program."""
    try:
        return work(), ""
    except TegError as problem:
        what, listing, _ = problem.what.partition("%0 = ")  # an expression that is too long for a line
        return None, f"{what.rstrip()} …" if listing else what


# -- cells ---------------------------------------------------------------------------------------------------------------

_TABLES = ("surfaces", "dropped", "integrals", "boundary", "interior", "remarks")


def _active(leaf: Node, wrt: set[Node]) -> bool:
    """Returns whether an entry or a sum depends on a parameter by which derivatives are taken."""
    return any(n in wrt or (isinstance(n, Gather) and not isinstance(n, StillGather) and n.array in wrt) for n in postorder([leaf]))


def _explain_cell(data: dict[str, Any], path: tuple[Ranged, ...], body: Expr, wrt: Sequence[Parameter], asked: Asked) -> None:
    """Adds the explanation of a cell to that of the program."""
    symbols = Symbols()
    (cell,) = symbols.into([body])
    given = set[Node](wrt)
    moving = [p for p in parameters(cell) if (_active(symbols.meaning[p], given) if p in symbols.meaning else p in given)]
    found = explain_cell(cell, moving, asked).data
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


def explain_loops(
    e: Expr, plain: Expr, wrt: Sequence[Parameter], asked: Asked, program_of: Callable[[int], ArrayProgram]
) -> ArrayExplanation:
    """Returns the loops of the programs of the value (`program_of(0)`) and of value and gradient (`program_of(1)`); surfaces and integrals
    by cell.

    `plain` is the program with its sums outside of integrals. `data` has the keys of a scalar program's, in which each surface and
    integral has its "cell", the number of an entry of data["cells"]; data["loops"] are the loops of both programs, data["choices"] has
    the most candidates of a box that XLA takes, by their index, data["lists"] the entries of lists that are looked up for runs, by the
    index of their sum. A sum inside an integral that has to be written out is written out for arrays of length 2.
    """
    data: dict[str, Any] = {
        "expression": text_of(e),
        "nodes": nodes(e),
        "options": asked.options,
        "assumed_length": asked.assumed_length,
        "arrays": [{"name": a.name, "dimensions": a.dimensions, "integers": isinstance(a, IndexArray)} for a in arrays_of(e)],
        "cells": [],
        "loops": {},
        "choices": {},
        "lists": {},
        "cost": {},
        "value_statements": None,
        "gradient_statements": None,
        "value_error": "",
        "gradient_error": "",
        **{key: [] for key in _TABLES},
    }
    for path, cell in cells_of(plain):
        _explain_cell(data, path, cell, wrt, asked)
    if data["value_error"]:
        return ArrayExplanation(data)
    if asked.integration.closed_forms and isinstance(asked.estimator, Exact) and not asked.maps:
        data["lists"] = {listed.title: listed.written for listed in listed_sums(plain)}
    data["value_statements"] = _add_program(data, "value", program_of(0))
    if wrt and not data["gradient_error"]:
        try:
            program = program_of(1)
        except TegError as problem:
            data["gradient_error"] = problem.what
        else:
            data["gradient_statements"] = _add_program(data, "value and gradient", program)
    return ArrayExplanation(data)


def _add_program(data: dict[str, Any], name: str, program: ArrayProgram) -> int:
    """Adds the loops and the cost of a program; returns its size."""
    texts: dict[Arg, str] = {f"p{k}": p for k, p in enumerate(program.parameters)}
    rows = [_row(None, program.body, 0, program, texts)]
    waiting: list[tuple[Step, int]] = [(s, 0) for s in reversed(program.body)]
    while waiting:
        step, depth = waiting.pop()
        if isinstance(step, Integers):
            texts[step.name] = _text(step, program, texts)
        elif isinstance(step, Loop):
            texts[step.index] = step.title
            rows.append(_row(step, step.body, depth + 1, program, texts))
            if isinstance(step, Cells):
                data["choices"][step.title] = most_candidates(step.shape)
            waiting.extend((s, depth + 1) for s in reversed(step.body))
    data["loops"][name] = rows
    every = [cost_of(s.program) for s in steps(program.body) if isinstance(s, Run)]
    data["cost"][name] = {
        "statements": array_size(program),
        "integrals": sum(c["integrals"] for c in every),
        "isolations": sum(c["isolations"] for c in every),
        "evaluations": sum(c["evaluations"] for c in every),
        "least": sum(c["least"] for c in every),
        "adaptive": any(c["adaptive"] for c in every),
    }
    return array_size(program)


def _row(loop: Loop | None, block: Sequence[Step], depth: int, program: ArrayProgram, texts: Mapping[Arg, str]) -> dict[str, Any]:
    """Returns the contents of one iteration of a loop, without inner loops; for None those of the whole call."""
    costs = [cost_of(s.program) for s in block if isinstance(s, Run)]
    least = 1 + LEAST // max(work(tuple(block)), 1)
    return {
        "index": "" if loop is None else loop.title,
        "lower": "" if loop is None else _named(loop.lo, texts),
        "upper": "" if loop is None else _named(loop.hi, texts),
        "depth": depth,
        "loads": sum(isinstance(s, Load) for s in block),
        "scatters": [program.arrays[s.array].name for s in block if isinstance(s, Scatter)],
        "results": 0 if loop is None else len(loop.results),
        "kept": len(loop.values) if isinstance(loop, Rows) else 0,
        "listed": "" if loop is None or loop.listed < 0 else program.arrays[loop.listed].name,
        "statements": sum(1 for s in block if not isinstance(s, Run | Loop)) + sum(c["statements"] for c in costs),
        "integrals": sum(c["integrals"] for c in costs),
        "evaluations": sum(c["evaluations"] for c in costs),
        "least": sum(c["least"] for c in costs),
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
