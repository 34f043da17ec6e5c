"""Error estimates of moments of hyperbolas."""

from __future__ import annotations

from dataclasses import replace

from teg.passes.lower.intrinsic import LEAST, ROUNDINGS, Errors
from teg.program import Arg, Hyperbola, Moments, Stmt
from teg.program.names import is_parameter

THINNEST = 1e30
"""The inverse of a moment that is not rounded to 0; and a border that is not infinite."""
STEP = 2.0**-42
"""How far corners are moved, relative to their sizes: far enough that the roundings of the border itself do not count."""


def with_errors(errors: Errors, stmt: Hyperbola, out: list[Stmt]) -> None:
    """Appends the statement with its errors: roundings of the terms, errors of the coefficients, and of the corners relative to the
    largest. Moments of a region are differences of terms as large as those of the whole square.

    Near a crossing the value of g at its saddle is a small difference of corners, so roundings of these move a border. By how much, the
    same border of corners that are off by STEP shows. A corner that is a parameter is exact.
    """
    kinds: dict[tuple[str, int, int], str] = {}
    for m in stmt.moments:
        for j, k, _ in m.terms:
            kinds.setdefault((m.kind, j, k), errors.fresh("v"))
    kinds.setdefault(("border", 0, 0), errors.fresh("v"))
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
    length = _length_of_terms(errors, stmt, kinds["border", 0, 0], out)
    for result, m in zip(stmt.results, stmt.moments, strict=True):
        parts: list[Arg] = []
        for j, k, c in m.terms:
            moment = errors.op(out, "abs", kinds[m.kind, j, k])
            parts.append(errors.op(out, "mul", relative, errors.op(out, "abs", c), moment))
            if m.kind != "border":
                parts.append(errors.op(out, "mul", errors.op(out, "abs", c), _of_terms(errors, out, (m.kind, j, k), moment, length)))
            if (j, k) in moved and m.kind == "border":
                parts.append(errors.op(out, "mul", ROUNDINGS / STEP, errors.op(out, "abs", c), moved[j, k]))
            parts.append(errors.times(out, moment, errors.uncertainty(c, out)))
        errors.errors[result] = errors.sum_of(parts, out)


def _length_of_terms(errors: Errors, stmt: Hyperbola, border: str, out: list[Stmt]) -> Arg:
    """Returns the size of (a + c·v) along the border, a and a + c the corners on u = 0: a region is the difference of this and of a part
    of a side."""
    first, _, _, last = (errors.op(out, "abs", c) for c in stmt.corners)
    size = errors.op(out, "add", errors.op(out, "mul", 2.0, first), last)
    return errors.op(out, "mul", size, errors.op(out, "min", border, THINNEST))


def _of_terms(errors: Errors, out: list[Stmt], what: tuple[str, int, int], moment: Arg, length: Arg) -> Arg:
    """Returns the roundings of a moment of a region, which may be a small difference of its terms."""
    kind, j, k = what
    whole = 1.0 / ((j + 1) * (k + 1))
    error: Arg = errors.op(out, "mul", ROUNDINGS, errors.op(out, "min", whole, errors.op(out, "mul", 1.0 / (j + 1), length)))
    if kind == "below":  # the whole square without the rest; nothing, where that is all
        there = errors.op(out, "min", whole, errors.op(out, "mul", THINNEST, moment))
        error = errors.op(out, "add", error, errors.op(out, "mul", ROUNDINGS, there))
    return error


def _moved_borders(errors: Errors, stmt: Hyperbola, kinds: dict[tuple[str, int, int], str], out: list[Stmt]) -> dict[tuple[int, int], Arg]:
    """Returns how far each moment of the border moves with the corners."""
    borders = {(j, k): kinds["border", j, k] for m in stmt.moments for j, k, _ in m.terms if m.kind == "border"}
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
