"""What the compiler found and did, in words and as data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from teg.build import check_program
from teg.dump import show
from teg.errors import TegError
from teg.expr import Expr, Param, Tuple, as_number
from teg.integral import Integral
from teg.node import postorder
from teg.passes.breaks import BreakAnalysis
from teg.passes.jumps import jump, vanishes_on
from teg.passes.reparameterize import find_family
from teg.passes.schedule import rule_for
from teg.pipeline import compiled_outputs, flatten, normal_form, program_for
from teg.program import Gauss, size
from teg.surfaces import atoms_of, binders_inside, owned_surfaces
from teg.traverse import parameters
from teg.traverse import size as nodes


@dataclass
class Explanation:
    """Surfaces, integrals and sizes; `str()` is a report, `data` the same as plain dicts and lists."""

    data: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        lines = [self.data["expression"], ""]
        if self.data["surfaces"]:
            lines.append("surfaces")
            width = max(len(s["surface"]) for s in self.data["surfaces"])
            for s in self.data["surfaces"]:
                lines.append(f"  {s['surface']:<{width}}  {s['owner']:<12} {s['treatment']}")
        if self.data["integrals"]:
            lines.append("integrals of the value")
            for i in self.data["integrals"]:
                lines.append(f"  over {i['variable']:<4} {i['breaks']:>3} breaks  {i['rule']}")
        lines.append(
            f"size: {self.data['nodes']} nodes, value {self.data['value_statements']} statements"
            + (f", value and gradient {self.data['gradient_statements']}" if self.data["gradient_statements"] else "")
        )
        if self.data["gradient_error"]:
            lines.append("gradient: " + self.data["gradient_error"])
        return "\n".join(lines)

    __repr__ = __str__


def explain(expression: object, wrt: Sequence[Param] | None = None, tol: float = 1e-10) -> Explanation:
    """For each surface its owner and how its δ is eliminated, or why it has none; for each integral its breaks, rule and nodes."""
    e = expression if isinstance(expression, Tuple) else as_number(expression)
    check_program(e)
    chosen = parameters(e) if wrt is None else wrt
    normal = normal_form(e)
    variables = list(dict.fromkeys(n.var for n in postorder([normal]) if isinstance(n, Integral)))
    surfaces = []
    for node in postorder([normal]):
        if isinstance(node, Integral):
            for g in owned_surfaces(node.body, node.var):
                surfaces.append(
                    {"surface": f"{show(g, 120)} = 0", "owner": f"∫ d{node.var.name}", "treatment": _treatment(g, node, variables)}
                )
    inner = binders_inside(normal)
    for a in atoms_of(normal):
        if not a.g.free & inner and not a.g.free:
            surfaces.append(
                {
                    "surface": f"{show(a.g, 120)} = 0",
                    "owner": "nobody",
                    "treatment": "parameters only: no δ, the derivative is one-sided there",
                }
            )
    names = [p.name for p in parameters(e)]
    program = program_for(flatten(normal), names, tol)
    gradient, error = None, ""
    try:
        outputs = compiled_outputs(e, chosen, 1, "sift")
        gradient = size(program_for([leaf for o in outputs for leaf in flatten(o)], names, tol))
    except TegError as problem:
        error = str(problem).splitlines()[0]
    analysis = BreakAnalysis()
    integrals = [n for n in postorder([normal]) if isinstance(n, Integral)]
    return Explanation(
        {
            "expression": show(e, 400),
            "surfaces": list({(s["surface"], s["owner"]): s for s in surfaces}.values()),
            "integrals": [
                {
                    "variable": n.var.name,
                    "breaks": len(analysis.of(n).points),
                    "degree": analysis.degree(n),
                    "rule": _rule(n, analysis, tol),
                }
                for n in integrals
            ],
            "nodes": nodes(e),
            "value_statements": size(program),
            "gradient_statements": gradient,
            "gradient_error": error,
        }
    )


def _treatment(g: Expr, node: Integral, variables: list[Any]) -> str:
    if not parameters(g):
        return "does not move: no δ"
    j = jump(node.body, g)
    if vanishes_on(j, g):
        return "a kink: the integrand does not jump, no δ"
    found = find_family(g, [v for v in variables if v in g.free])
    if found is None:
        return "no reparameterisation: its δ cannot be eliminated"
    data = found[0]
    names = ", ".join(v.name for v in data.variables)
    how = f"eliminated over {names}" if len(data.variables) == 1 else f"eliminated over the dominant one of {names}"
    return f"{data.name}, {how}"


def _rule(n: Integral, analysis: BreakAnalysis, tol: float) -> str:
    rule = rule_for(n, analysis, tol, 0)
    if isinstance(rule, Gauss):
        return f"degree {analysis.degree(n)}: Gauss, {rule.nodes} node{'s' * (rule.nodes > 1)} a piece, exact"
    breaks = analysis.of(n)
    text = f"adaptive Gauss-Kronrod to {tol:.0e}"
    if not breaks.complete:
        text += ", some breaks have no formula and are searched for"
    return text + (", √-ends smoothed" if breaks.rooted else "")
