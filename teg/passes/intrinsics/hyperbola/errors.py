"""Error estimates of moments of hyperbolas."""

from __future__ import annotations

from dataclasses import replace

from teg.passes.lower.intrinsic import LEAST, ROUNDINGS, Errors
from teg.program import Arg, Hyperbola, Moments, Stmt


def with_errors(errors: Errors, stmt: Hyperbola, out: list[Stmt]) -> None:
    """Roundings of the terms, what the coefficients are off by, and what the corners are, relative to the largest of them."""
    kinds: dict[tuple[str, int, int], str] = {}
    for m in stmt.moments:
        for j, k, _ in m.terms:
            kinds.setdefault((m.kind, j, k), errors.fresh("v"))
    single = tuple(Moments(kind, ((j, k, 1.0),)) for kind, j, k in kinds)
    out.append(replace(stmt, scales=errors.block(stmt.scales), moments=stmt.moments + single, results=(*stmt.results, *kinds.values())))
    relative: Arg = ROUNDINGS
    off = errors.sum_of((errors.error(c) for c in stmt.corners), out)
    if off != 0.0:
        largest: Arg = LEAST
        for c in stmt.corners:
            largest = errors.op(out, "max", largest, errors.op(out, "abs", c))
        relative = errors.op(out, "add", relative, errors.op(out, "div", off, largest))
    for result, m in zip(stmt.results, stmt.moments, strict=True):
        parts: list[Arg] = []
        for j, k, c in m.terms:
            moment = errors.op(out, "abs", kinds[m.kind, j, k])
            parts.append(errors.op(out, "mul", relative, errors.op(out, "abs", c), moment))
            if errors.error(c) != 0.0:
                parts.append(errors.op(out, "mul", errors.error(c), moment))
        errors.errors[result] = errors.sum_of(parts, out)
