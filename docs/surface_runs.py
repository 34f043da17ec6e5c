"""What the compiled programs of docs/surfaces.md do: recorded runs of their values and derivatives, and their errors."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from recorded_run import SHIFT, RecordedRun, integrals_of
from surface_families import FAMILIES, LINES, Family, x, y

import teg
from teg.analysis.settings import Integration
from teg.pipeline import flatten, normal_form, program_for
from teg.program import Program, Stmt, blocks

TOL = 1e-4
"""Of the pictures, so that they have fewer points."""

GROUPS = (
    ("half-plane, triangle, stripes", "half-plane triangle stripes"),
    ("graphs: wave, parabola", "graph parabola"),
    ("one variable: cubic, wave", "cubic wave"),
    ("bilinear", "bilinear"),
    ("disk, ellipse, hyperbola, sphere", "disk ellipse hyperbola sphere"),
    ("pair of lines", "lines"),
    ("superellipse", "superellipse"),
    ("heart", "heart"),
    ("polygon Σ\\|x - aᵢ\\| + \\|y - bᵢ\\| < t", "polygon"),
)
"""The rows of the table of errors."""


def value_run(family: Family) -> RecordedRun:
    """The program of the area, run."""
    e, parameters = family.integral()
    f = teg.compile(e, parameters, tol=TOL, rule=_drawn(family), intrinsics=not _is_ellipse(family))
    run = RecordedRun(f.program(0), family.values)
    if not math.isclose(run.outputs[0], f(family.values), rel_tol=1e-9):
        raise AssertionError(f"{family.name}: {run.outputs[0]} is not {f(family.values)}")
    return run


def _drawn(family: Family) -> str:
    """What is clipped polygons or in closed form by default is drawn as the rule "gauss" integrates it, piece by piece."""
    closed = any(word in rules_of(family) for word in ("clipped", "closed form"))
    return "gauss" if closed and not _is_ellipse(family) else "auto"


def _is_ellipse(family: Family) -> bool:
    """Whether its moments are in closed form by default; they are drawn as without intrinsics."""
    return rules_of(family).startswith("ellipse")


def gradient_run(family: Family) -> RecordedRun:
    """The program of the area's derivative by t, run in charts, with a mark at the points it looks at. The mark is no polynomial; the rules
    are those of the derivative without it."""
    mark = teg.atan2(y + SHIFT, x + SHIFT) if family.dimensions == 2 else teg.atan2(SHIFT, x + SHIFT)
    programs = []
    for integrand in (1, mark):
        e, parameters = family.integral(integrand)
        gradient = normal_form(teg.grad(e, [parameters[0]]))
        how = Integration(tol=TOL, rule=_drawn(family), intrinsics=not _is_ellipse(family))
        programs.append(program_for(flatten(gradient), list(family.values), how))
    plain, marked = programs
    rules = [s.rule for s in integrals_of(plain)]
    if len(rules) != len(list(integrals_of(marked))):
        raise AssertionError(f"{family.name}: the mark changes the program")
    left = iter(rules)
    return RecordedRun(Program(marked.parameters, _with_rules(marked.body, left), marked.outputs), family.values)


def _with_rules(block: tuple[Stmt, ...], rules: Any) -> tuple[Stmt, ...]:
    """The statements, their integrals (in the order of `integrals_of`) with other rules."""
    changed: list[Any] = []
    for stmt in block:
        if hasattr(stmt, "rule"):
            stmt = replace(stmt, rule=next(rules))
        inner = [_with_rules(b, rules) for b in blocks(stmt)]
        changed.append(replace(stmt, **dict(zip(_BLOCKS.get(type(stmt).__name__, ()), inner, strict=True))))
    return tuple(changed)


_BLOCKS = {"Integrate": ("flags", "body"), "Isolate": ("enclosure", "point"), "Locate": ("enclosure",), "SumOver": ("body",)}


# -- errors --------------------------------------------------------------------------------------------------------------


def errors_of(family: Family) -> tuple[float, float]:
    """Of the value and of its derivative by t, at the default tolerance: relative, or absolute where the exact number is 0."""
    e, parameters = family.integral()
    value, gradient = teg.compile(e, parameters).value_and_grad(family.values)
    value_error, slope_error = (
        abs(float(exact - float(found))) / abs(float(exact) or 1.0)
        for found, exact in zip((value, gradient["t"]), family.exact_pair(), strict=True)
    )
    return value_error, slope_error


def rules_of(family: Family) -> str:
    """The rules of value and derivative, one name for both if they are the same; inner integrals that are exact are not named."""
    e, parameters = family.integral()
    data = teg.explain(e, parameters).data
    value, slope = (_rule_name([i["rule"] for i in data[kind] if i["kind"] == "integral"]) for kind in ("integrals", "boundary"))
    return value if value == slope or not slope else f"value {value}, derivative {slope}"


def _rule_name(rules: Sequence[str]) -> str:
    """Without their tolerances."""
    adaptive = {re.sub(r" to [^,]*", "", rule) for rule in rules if rule.startswith("adaptive")}
    return " and ".join(sorted(adaptive)) or next(iter(rules), "")


def table() -> str:
    """The table of docs/surfaces.md: the largest errors of the families of each row, and their rules."""
    families = {f.name: f for f in (*FAMILIES, *LINES)}
    lines = ["| family | error of the value | of the derivative | rule |", "|---|---|---|---|"]
    for label, names in GROUPS:
        members = [families[name] for name in names.split()]
        value, slope = (max(column) for column in zip(*map(errors_of, members), strict=True))
        rules = {f.name: rules_of(f) for f in members}
        text = rules[members[0].name] if len(set(rules.values())) == 1 else "; ".join(f"{name}: {rule}" for name, rule in rules.items())
        lines.append(f"| {label} | {value:.0e} | {slope:.0e} | {text} |")
    return "\n".join(lines)
