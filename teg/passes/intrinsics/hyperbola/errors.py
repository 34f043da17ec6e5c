"""Error estimates of moments of hyperbolas."""

from __future__ import annotations

from dataclasses import replace

from teg.passes.lower.intrinsic import LEAST, ROUNDINGS, Errors
from teg.program import Arg, Hyperbola, Moments, Stmt
from teg.program.names import is_parameter

STEP = 2.0**-42
"""How far corners are moved, relative to their sizes: far enough that the roundings of the border itself do not count."""


def with_errors(errors: Errors, stmt: Hyperbola, out: list[Stmt]) -> None:
    """Appends the statement with its errors: roundings of the terms, errors of the coefficients, and of the corners relative to the
    largest.

    Near a crossing the value of g at its saddle is a small difference of corners, so roundings of these move a border. By how much, the
    same border of corners that are off by STEP shows. A corner that is a parameter is exact.
    """
    kinds: dict[tuple[str, int, int], str] = {}
    for m in stmt.moments:
        for j, k, _ in m.terms:
            kinds.setdefault((m.kind, j, k), errors.fresh("v"))
    single = tuple(Moments(kind, ((j, k, 1.0),)) for kind, j, k in kinds)
    out.append(replace(stmt, scales=errors.block(stmt.scales), moments=stmt.moments + single, results=(*stmt.results, *kinds.values())))
    moved = _moved_borders(errors, stmt, kinds, out)
    relative: Arg = ROUNDINGS
    off = errors.sum_of([errors.uncertainty(c, out) for c in stmt.corners], out)
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
            if (j, k) in moved and m.kind == "border":
                parts.append(errors.op(out, "mul", ROUNDINGS / STEP, errors.op(out, "abs", c), moved[j, k]))
            parts.append(errors.times(out, moment, errors.uncertainty(c, out)))
        errors.errors[result] = errors.sum_of(parts, out)


def _moved_borders(errors: Errors, stmt: Hyperbola, kinds: dict[tuple[str, int, int], str], out: list[Stmt]) -> dict[tuple[int, int], Arg]:
    """Returns how far each moment of the border moves with the corners."""
    borders = {(j, k): name for (kind, j, k), name in kinds.items() if kind == "border"}
    computed = [isinstance(c, str) and not is_parameter(c) for c in stmt.corners]
    if not borders or not any(computed):
        return {}
    factors = [1.0 + (-STEP if i % 2 else STEP) for i in range(4)]
    corners = tuple(errors.op(out, "mul", f, c) if off else c for f, c, off in zip(factors, stmt.corners, computed, strict=True))
    names = tuple(errors.fresh("v") for _ in borders)
    moments = tuple(Moments("border", ((j, k, 1.0),)) for j, k in borders)
    turn = stmt.turn if not isinstance(stmt.turn, str) else errors.op(out, "mul", 1.0 + STEP, stmt.turn)
    out.append(replace(stmt, corners=corners, turn=turn, scales=errors.block(stmt.scales), moments=moments, results=names))
    distances = (errors.op(out, "abs", errors.op(out, "sub", a, b)) for a, b in zip(borders.values(), names, strict=True))
    return dict(zip(borders, distances, strict=True))


def numbers_of(stmt: Hyperbola) -> tuple[Arg, ...]:
    """Returns the numbers whose roundings move the domain or change the integrand."""
    return (*stmt.corners, *(c for m in stmt.moments for _, _, c in m.terms))
