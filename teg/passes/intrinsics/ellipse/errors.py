"""Error estimates of moments of ellipses."""

from __future__ import annotations

from dataclasses import replace

from teg.passes.lower.intrinsic import LEAST, ROUNDINGS, Errors
from teg.program import Arg, Ellipse, Moments, Stmt

STEP = 2.0**-42
"""How far an ellipse is moved, relative to its size: far enough that the roundings of the moments themselves do not count."""


def with_errors(errors: Errors, stmt: Ellipse, out: list[Stmt]) -> None:
    """Appends the statement with its errors: roundings of the terms, errors of the coefficients and of the place.

    How far errors of the place move a moment is shown by the same moment of an ellipse that is STEP larger and to the side.
    """
    kinds: dict[tuple[str, int, int], str] = {}
    for m in stmt.moments:
        for j, k, _ in m.terms:
            kinds.setdefault((m.kind, j, k), errors.fresh("v"))
    single = tuple(Moments(kind, ((j, k, 1.0),)) for kind, j, k in kinds)
    out.append(replace(stmt, moments=stmt.moments + single, results=(*stmt.results, *kinds.values())))
    u, v, radius, width, height, least = stmt.place
    size: Arg = LEAST
    for number in (u, v, radius):
        size = errors.op(out, "max", size, errors.op(out, "abs", number))
    step = errors.op(out, "mul", STEP, size)
    moved = tuple(errors.fresh("v") for _ in kinds)
    place = (errors.op(out, "add", u, step), errors.op(out, "sub", v, step), errors.op(out, "add", radius, step), width, height, least)
    out.append(replace(stmt, place=place, moments=single, results=moved))
    relative = _relative(errors, stmt, size, out)
    relative = errors.op(out, "mul", 1.0 / STEP, relative)
    spread: dict[tuple[str, int, int], Arg] = {}
    for (key, name), other in zip(kinds.items(), moved, strict=True):
        apart = errors.op(out, "mul", relative, errors.op(out, "abs", errors.op(out, "sub", name, other)))
        spread[key] = errors.sum_of((apart, errors.op(out, "mul", ROUNDINGS, errors.op(out, "abs", name))), out)
    for result, m in zip(stmt.results, stmt.moments, strict=True):
        parts: list[Arg] = []
        for j, k, c in m.terms:
            key = (m.kind, j, k)
            parts.append(errors.op(out, "mul", errors.op(out, "abs", c), spread[key]))
            if errors.error(c) != 0.0:
                parts.append(errors.op(out, "mul", errors.error(c), errors.op(out, "abs", kinds[key])))
        errors.errors[result] = errors.sum_of(parts, out)


def _relative(errors: Errors, stmt: Ellipse, size: Arg, out: list[Stmt]) -> Arg:
    """Returns how far the curve may be off, relative to the size of its place: roundings by the condition of its matrix, and the errors of
    its numbers."""
    a, b, c, d = stmt.matrix
    squares = [errors.op(out, "mul", e, e) for e in stmt.matrix]
    sum_of_squares = errors.op(out, "max", errors.op(out, "add", *squares), LEAST)
    whole = errors.op(out, "abs", errors.op(out, "sub", errors.op(out, "mul", a, d), errors.op(out, "mul", b, c)))
    relative = errors.op(out, "mul", ROUNDINGS, errors.op(out, "div", sum_of_squares, errors.op(out, "max", whole, LEAST)))
    off = errors.sum_of((errors.error(e) for e in stmt.place), out)
    if off != 0.0:
        relative = errors.op(out, "add", relative, errors.op(out, "div", off, size))
    turned = errors.sum_of((errors.error(e) for e in stmt.matrix), out)
    if turned != 0.0:
        relative = errors.op(out, "add", relative, errors.op(out, "div", turned, errors.op(out, "sqrt", sum_of_squares)))
    return relative
