"""What the compiler found and did: every surface with its owner and its family, every integral with its breaks and its rule, the cost."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from typing import Any, TypeVar, cast

from teg.analysis.bodies import write_all_out
from teg.analysis.isolation import MAX_ROOTS, max_roots
from teg.analysis.remarks import Remarks
from teg.analysis.roots import solve
from teg.analysis.settings import Integration
from teg.errors import OptionError, TegError
from teg.ir.arrays import Array, has_arrays
from teg.ir.expr import Expr, Param, Tuple, as_number
from teg.ir.function import Function
from teg.ir.integral import Integral, masses_of
from teg.ir.traverse import parameters
from teg.ir.traverse import size as nodes
from teg.language import check_parameters, check_program
from teg.maps.diffeomorphism import Diffeomorphism
from teg.numerics.sobol import replicated
from teg.passes.differentiate.through_sums import parameters_and_arrays
from teg.passes.eliminate.families import closing, families_with
from teg.passes.intrinsics import STATEMENTS, boundary_terms, intrinsics_for
from teg.passes.lower.intrinsic import Description
from teg.passes.lower.rules import Rules
from teg.passes.lower.samples import MIDPOINTS, SAMPLES
from teg.passes.normalise.canonicalise import canonicalise
from teg.passes.normalise.inline import reasons, write_out
from teg.passes.normalise.steps import enumerate_steps
from teg.pipeline import compiled_outputs, flatten, normal_form, program_for
from teg.program import (
    Adaptive,
    Arg,
    Integrate,
    Isolate,
    Locate,
    Program,
    Rule,
    Sample,
    Stmt,
    SumOver,
    When,
    size,
    statements,
)
from teg.report.array_explain import explain_arrays
from teg.report.explanation import Explanation
from teg.report.inventory import Inventory, nests, text_of

__all__ = ["Explanation", "explain"]

T = TypeVar("T")


def explain(
    expression: object,
    wrt: Sequence[Param | Array] | Param | Array | None = None,
    tol: float = 1e-10,
    *,
    rule: str = "auto",
    order: int | None = None,
    seed: int = 0,
    discontinuities: str = "sift",
    derivatives: int = 0,
    maps: Sequence[Diffeomorphism] = (),
    max_roots: int = MAX_ROOTS,
    intrinsics: bool = True,
) -> Explanation:
    """For each surface its owner and how its δ is eliminated, or why it has none; for each integral its breaks, rule and nodes; the cost.

    `wrt` are the parameters that the program is differentiated by (default: all); `tol`, `rule`, `order`, `seed`, `discontinuities`,
    `maps`, `max_roots` and `intrinsics` are those of `compile`, and `f.explain()` fills them in. The integrals are those of the value and,
    of the gradient, those over surfaces (`derivatives=0`) or all (`derivatives=1`). The evaluations of the integrand are an estimate:
    every break inside the bounds, adaptive integrals as smooth as they can be (`f.evaluations(…)` counts those of a call).

    A program with arrays is explained cell by cell (`explanation.ArrayExplanation`): the parts between its sums are scalar programs of the
    entries they read, and of the sums inside; and its loops are listed.

    Raises OptionError for a `derivatives` that is not 0 or 1, and what `compile` raises for an expression that is not closed.
    """
    if derivatives not in (0, 1):
        raise OptionError(f"derivatives={derivatives!r} is not known", None, "0: value and boundary integrals; 1: all of the gradient")
    e = expression if isinstance(expression, Tuple) else as_number(expression)
    check_program(e)
    how = Integration(tol, rule, order, seed, max_roots, intrinsics)
    if has_arrays(e):
        e = write_all_out(e)

        def on_cell(cell: Expr, moving: Sequence[Param]) -> Explanation:
            return _explain(cell, moving, how, discontinuities, derivatives, maps)

        listed = None if wrt is None else parameters_and_arrays(wrt)
        return explain_arrays(e, listed, how, discontinuities, maps, on_cell, cost_of)
    return _explain(e, wrt, how, discontinuities, derivatives, maps)


def _explain(e: Expr, wrt: Any, how: Integration, discontinuities: str, derivatives: int, maps: Sequence[Diffeomorphism]) -> Explanation:
    """The explanation of a scalar program."""
    chosen = parameters(e) if wrt is None else check_parameters(wrt)
    functions, shown, number, e = _functions(e), text_of(e), nodes(e), write_out(e)
    before = canonicalise(enumerate_steps(e))
    remarks = Remarks()
    normal, value_error = _attempted(lambda: normal_form(e, maps=maps, remarks=remarks))
    closed = boundary_terms() if how.closed_forms else ()
    families = closing(families_with(maps), closed) if how.closed_forms else families_with(maps)
    final = before if normal is None else normal
    ignoring = discontinuities == "ignore"
    inventory = Inventory(e, before, final, chosen, ignoring=ignoring, families=families, closed=closed, max_roots=how.max_roots)
    names = list(dict.fromkeys(p.name for p in (*chosen, *parameters(e), *(p for m in maps for p in m.parameters))))
    integrals = _Integrals(how)
    data: dict[str, Any] = {
        "expression": shown,
        "nodes": number,
        "functions": functions,
        "options": {
            "tol": how.tol, "rule": how.rule, "order": how.order, "discontinuities": discontinuities, "max_roots": how.max_roots,
            "intrinsics": how.intrinsics,
        },
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
    closed_forms = how.closed_forms
    outputs, data["gradient_error"] = _attempted(lambda: compiled_outputs(e, chosen, 1, discontinuities, maps, closed_forms, remarks))
    if outputs is not None:
        program = program_for([leaf for o in outputs for leaf in flatten(o)], names, how, remarks=remarks)
        data["remarks"] = _told(remarks)
        data["gradient_statements"], data["cost"]["value and gradient"] = size(program), cost_of(program)
        interior = compiled_outputs(e, chosen, 1, "ignore")[1]
        data["boundary"] = integrals.of([outputs[1]], but=[normal, outputs[0], interior])
        if derivatives:
            data["interior"] = integrals.of([interior], but=[normal, outputs[0]])
    return Explanation(data)


def _told(remarks: Remarks) -> list[dict[str, Any]]:
    """What the passes decided, each once: the pass, the surface or the integral, the choice, and the reason."""

    def about(e: Expr) -> str:
        return f"∫ d{e.var.name} from {text_of(e.lo)} to {text_of(e.hi)}" if isinstance(e, Integral) else f"{text_of(e)} = 0"

    rows = [(r.stage, about(r.subject), r.choice, r.reason) for r in remarks]
    return [dict(zip(("pass", "about", "choice", "reason"), row, strict=True)) for row in dict.fromkeys(rows)]


def _functions(e: Expr) -> list[dict[str, Any]]:
    """Each function that is applied: how often, and how often it is written out for which reasons."""
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
    """A result, or what is wrong with the program."""
    try:
        return work(), ""
    except TegError as problem:
        what, listing, _ = problem.what.partition("%0 = ")  # an expression that is too long for a line
        return None, f"{what.rstrip()} …" if listing else what


# -- integrals -----------------------------------------------------------------------------------------------------------


class _Integrals:
    """Breaks and rules, as the scheduler has them."""

    def __init__(self, how: Integration) -> None:
        self.how = how
        self.intrinsics = intrinsics_for(how)
        self.rules = Rules(how, [i.rule for i in self.intrinsics if i.rule is not None])
        self.analysis = self.rules.analysis
        self._described: dict[Integral, Description | None] = {}

    def of(self, roots: Sequence[Expr], but: Sequence[Expr] = ()) -> list[dict[str, Any]]:
        """The integrals of expressions, outer ones first, without those of others; those that look the same are counted together."""
        known = {node for root in but for node in nests(root)}
        rows: dict[tuple[object, ...], dict[str, Any]] = {}
        for root in roots:
            depths: dict[Integral, int] = {}
            for node, around in nests(root).items():
                if not isinstance(node, Integral) or any(node in d.inside for d in map(self._describe, around[:-1]) if d):
                    continue
                depths[node] = next((depths[i] + 1 for i in reversed(around[:-1]) if i.var in node.free), 0)
                if node not in known:
                    row = self._row(node, depths[node])
                    same = rows.setdefault(tuple(row.values()), {**row, "count": 0})
                    same["count"] += 1
        return list(rows.values())

    def _describe(self, node: Integral) -> Description | None:
        """What an intrinsic makes of an integral; None if none computes it."""
        if node not in self._described:
            found = (intrinsic.describe(node) for intrinsic in self.intrinsics)
            self._described[node] = next((d for d in found if d is not None), None)
        return self._described[node]

    def _row(self, node: Integral, depth: int) -> dict[str, Any]:
        row = {"variable": node.var.name, "lower": text_of(node.lo), "upper": text_of(node.hi), "depth": depth}
        masses = masses_of(node.body, node.var)
        if masses is None and self.how.rule in SAMPLES_OF:
            text = f"{SAMPLES_OF[self.how.rule]}, {self.how.order or SAMPLES} in all"
            return {**row, **_unbroken(text), "nodes": None}
        if masses is None and self.how.rule == "midpoint":
            return {**row, **_unbroken("midpoint"), "nodes": self.how.order or MIDPOINTS}
        if masses is not None:
            roots = solve(masses.g, node.var, node.lo, node.hi)
            formula = len(roots.found) if roots is not None and roots.certain else 0
            isolated = 0 if formula else max_roots(masses.g, node.var, self.how.max_roots)
            kind = {"kind": "sum over roots", "surface": f"{text_of(masses.g)} = 0", "rule": "sum", "nodes": None, "degree": None}
            return {**row, **kind, "formula": formula, "isolated": isolated, "located": 0, "searched": False, "breaks": 0, "pieces": 0}
        described = self._describe(node)
        if described is not None:
            counts = {"nodes": described.nodes, "degree": described.degree, "pieces": described.pieces}
            return {**row, **_unbroken(described.rule), **counts}
        rule, breaks = self.rules.of(node, depth), self.analysis.of(node)
        formula, isolated, located = len(breaks.points), sum(i.count for i in breaks.isolated), MAX_ROOTS * len(breaks.located)
        return {
            **row,
            "kind": "integral",
            "surface": "",
            "rule": self.rules.title(rule),
            "nodes": _nodes_a_piece(rule),
            "degree": self.analysis.degree(node),
            "formula": formula,
            "isolated": isolated,
            "located": located,
            "searched": not breaks.complete,
            "breaks": formula + isolated + located,
            "pieces": formula + isolated + located + 1,
        }


SAMPLES_OF = {"montecarlo": "Monte Carlo samples", "qmc": "scrambled Sobol' points"}
"""What the rules take that sample."""


def _unbroken(rule: str) -> dict[str, Any]:
    """An integral without breaks."""
    counts = dict.fromkeys(("formula", "isolated", "located", "breaks"), 0)
    return {"kind": "integral", "surface": "", "rule": rule, "degree": None, **counts, "searched": False, "pieces": 1}


def _nodes_a_piece(rule: Rule) -> int:
    """How many nodes a piece has, if it is not cut further."""
    return rule.first if isinstance(rule, Adaptive) else rule.nodes


# -- cost ----------------------------------------------------------------------------------------------------------------


def cost_of(program: Program) -> dict[str, Any]:
    """The size of a program, and how often integrands are evaluated in one run: pieces × nodes, times those of the integral around."""
    every = list(statements(program.body))
    integrals = [s for s in every if isinstance(s, Integrate)]
    hints = {r for s in every if isinstance(s, Locate) for r in s.results}
    return {
        "statements": len(every),
        "integrals": len(integrals) + sum(isinstance(s, Sample) or type(s) in STATEMENTS for s in every),
        "isolations": sum(isinstance(s, Isolate | Locate) for s in every),
        "evaluations": _evaluations(program.body, hints),
        "adaptive": any(isinstance(s.rule, Adaptive) for s in integrals),
    }


def _evaluations(block: Iterable[Stmt], hints: Container[Arg]) -> int:
    """Of integrands without integrals inside, with all breaks inside the bounds, but for the hints, of which few are there. A search for
    roots evaluates no integrand, nor does a sum over them."""
    total = 0
    for stmt in block:
        match stmt:
            case Integrate():
                once = _evaluations(stmt.flags, hints) + _nodes_a_piece(stmt.rule) * (_evaluations(stmt.body, hints) or 1)
                total += (1 + sum(b not in hints for b in stmt.breaks)) * once
            case When():
                total += _evaluations(stmt.body, hints)
            case SumOver():
                total += len(stmt.points) * _evaluations(stmt.body, hints)
            case Sample():
                replicates, points = replicated(stmt.kind, stmt.count)
                total += replicates * points * (_evaluations(stmt.body, hints) or 1)
            case _ if type(stmt) in STATEMENTS:
                total += STATEMENTS[type(stmt)].evaluations(stmt)
            case _:
                continue
    return total
