"""Error estimates of polygons and segments."""

from __future__ import annotations

from dataclasses import replace

from teg.passes.lower.intrinsic import LEAST, Errors
from teg.program import EDGE, ROUNDING, Arg, Polygon, Segment, Stmt, clipped_by
from teg.program.names import is_condition


def with_errors(errors: Errors, stmt: Polygon | Segment, out: list[Stmt]) -> None:
    """Appends the statement with its errors: roundings of the sum and of the corners (large for a sliver), errors of the integrand and the
    domain.

    The error of the domain is relative to the numbers that decide it.
    """
    setup, body = errors.block(stmt.setup), list(errors.block(stmt.body))
    sizes = {v: errors.op(body, "abs", v) if isinstance(v, str) else abs(v) for v in stmt.values}
    companions = [errors.error(v) for v in stmt.values]
    inexact = [i for i, c in enumerate(companions) if c != 0.0]
    names = {v: errors.fresh("v") for v in sizes}
    extent, more = errors.fresh("v"), {i: errors.fresh("v") for i in inexact}
    values = (*stmt.values, *sizes.values(), 1.0, *(companions[i] for i in inexact))
    factors = (*stmt.factors, *(1.0 for _ in (*sizes, extent, *inexact)))
    results = (*stmt.results, *names.values(), extent, *more.values())
    out.append(replace(stmt, setup=setup, body=tuple(body), values=values, factors=factors, results=results))
    box: Arg = 1.0
    if isinstance(stmt, Polygon):
        box = errors.op(out, "abs", errors.op(out, "mul", stmt.width, stmt.height))
    thin = errors.op(out, "div", box, errors.op(out, "max", errors.op(out, "abs", extent), LEAST))
    relative = errors.op(out, "add", 0.5 * ROUNDING, errors.op(out, "mul", EDGE, thin))
    for arg in clipped_by(stmt):
        if isinstance(arg, str) and not is_condition(arg) and errors.error(arg) != 0.0:
            size = errors.op(out, "max", errors.op(out, "abs", arg), LEAST)
            relative = errors.op(out, "add", relative, errors.op(out, "div", errors.error(arg), size))
    for i, (result, value, factor) in enumerate(zip(stmt.results, stmt.values, stmt.factors, strict=True)):
        size = errors.op(out, "abs", names[value])
        parts = [errors.op(out, "mul", relative, size)]
        if i in more:
            parts.append(errors.op(out, "abs", more[i]))
        total = errors.times(out, factor, errors.sum_of(parts, out)) if factor != 1.0 else errors.sum_of(parts, out)
        spread = errors.error(factor)
        errors.errors[result] = total if spread == 0.0 else errors.sum_of((total, errors.op(out, "mul", spread, size)), out)
