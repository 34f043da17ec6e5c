"""Error estimates of moments of ellipses."""

from __future__ import annotations

from dataclasses import replace

from teg.passes.lower.intrinsic import LEAST, ROUNDINGS, Errors
from teg.program import Arg, Ellipse, HalfPlane, Moments, Stmt

STEP = 2.0**-42
"""How far an ellipse is moved at least, relative to its size: far enough that the roundings of the moments themselves do not count."""
Key = tuple[str, tuple[int, int], int, int]
"""The kind of a moment, the powers along the axes, and those of u and v."""
BEYOND = 4.0
"""How far it is moved, relative to how far it may be off: its place has no digits below."""


def with_errors(errors: Errors, stmt: Ellipse, out: list[Stmt]) -> None:
    """Appends the statement with its errors: roundings of the terms, errors of the coefficients and of the place.

    How far errors of the place move a moment is shown by the same moment of an ellipse that is a step larger and to the side, and how far
    those of the half-planes do by the same moment in half-planes that are STEP wider.
    """
    kinds: dict[Key, str] = {}
    for m in stmt.moments:
        for j, k, _ in m.terms:
            kinds.setdefault((m.kind, m.axes, j, k), errors.fresh("v"))
    single = tuple(Moments(kind, ((j, k, 1.0),), axes) for kind, axes, j, k in kinds)
    out.append(replace(stmt, moments=stmt.moments + single, results=(*stmt.results, *kinds.values())))
    u, v, radius, width, height, least = stmt.place
    size: Arg = LEAST
    for number in (u, v, radius):
        size = errors.op(out, "max", size, errors.op(out, "abs", number))
    relative = _relative(errors, stmt, size, out)
    far = errors.op(out, "max", STEP, errors.op(out, "mul", BEYOND, relative))
    step = errors.op(out, "mul", far, size)
    moved = tuple(errors.fresh("v") for _ in kinds)
    place = (errors.op(out, "add", u, step), errors.op(out, "sub", v, step), errors.op(out, "add", radius, step), width, height, least)
    out.append(replace(stmt, place=place, moments=single, results=moved))
    spread: dict[Key, Arg] = {}
    for (key, name), other in zip(kinds.items(), moved, strict=True):
        apart = _apart(errors, errors.op(out, "div", relative, far), name, other, out)
        spread[key] = errors.sum_of((apart, errors.op(out, "mul", ROUNDINGS, errors.op(out, "abs", name))), out)
    if stmt.half_planes:
        wider = tuple(errors.fresh("v") for _ in kinds)
        planes, off = _moved_planes(errors, stmt, out)
        out.append(replace(stmt, half_planes=planes, moments=single, results=wider))
        for (key, name), other in zip(kinds.items(), wider, strict=True):
            spread[key] = errors.sum_of((spread[key], _apart(errors, errors.op(out, "mul", 1.0 / STEP, off), name, other, out)), out)
    for result, m in zip(stmt.results, stmt.moments, strict=True):
        parts: list[Arg] = []
        for j, k, c in m.terms:
            key = (m.kind, m.axes, j, k)
            parts.append(errors.op(out, "mul", errors.op(out, "abs", c), spread[key]))
            parts.append(errors.times(out, kinds[key], errors.uncertainty(c, out)))
        errors.errors[result] = errors.sum_of(parts, out)


def _apart(errors: Errors, steps: Arg, name: Arg, other: Arg, out: list[Stmt]) -> Arg:
    """Returns how far a moment is off, by that of a place that is a step further, and by how many steps the place may be off."""
    return errors.op(out, "mul", steps, errors.op(out, "abs", errors.op(out, "sub", name, other)))


def _moved_planes(errors: Errors, stmt: Ellipse, out: list[Stmt]) -> tuple[tuple[HalfPlane, ...], Arg]:
    """Returns half-planes that are STEP wider, relative to their terms on the box, and how far any of them may be off, likewise."""
    planes: list[HalfPlane] = []
    relative: Arg = ROUNDINGS
    for g in stmt.half_planes:
        size = errors.op(out, "max", LEAST, errors.op(out, "abs", g.c))
        off: list[Arg] = [errors.error(g.c)]
        for slope, extent in ((g.a, stmt.place[3]), (g.b, stmt.place[4])):
            size = errors.op(out, "max", size, errors.op(out, "abs", errors.op(out, "mul", slope, extent)))
            off.append(errors.times(out, extent, errors.uncertainty(slope, out)))
        total = errors.sum_of(off, out)
        if total != 0.0:
            relative = errors.op(out, "add", relative, errors.op(out, "div", total, size))
        planes.append(replace(g, c=errors.op(out, "add", g.c, errors.op(out, "mul", STEP, size))))
    return tuple(planes), relative


def _relative(errors: Errors, stmt: Ellipse, size: Arg, out: list[Stmt]) -> Arg:
    """Returns how far the curve may be off, relative to the size of its place: roundings by the condition of its matrix, and the errors of
    its numbers."""
    a, b, c, d = stmt.matrix
    squares = [errors.op(out, "mul", e, e) for e in stmt.matrix]
    sum_of_squares = errors.op(out, "max", errors.op(out, "add", *squares), LEAST)
    whole = errors.op(out, "abs", errors.op(out, "sub", errors.op(out, "mul", a, d), errors.op(out, "mul", b, c)))
    relative = errors.op(out, "mul", ROUNDINGS, errors.op(out, "div", sum_of_squares, errors.op(out, "max", whole, LEAST)))
    off = errors.sum_of([errors.uncertainty(e, out) for e in stmt.place], out)
    if off != 0.0:
        relative = errors.op(out, "add", relative, errors.op(out, "div", off, size))
    turned = errors.sum_of([errors.uncertainty(e, out) for e in stmt.matrix], out)
    if turned != 0.0:
        relative = errors.op(out, "add", relative, errors.op(out, "div", turned, errors.op(out, "sqrt", sum_of_squares)))
    return relative


def numbers_of(stmt: Ellipse) -> tuple[Arg, ...]:
    """Returns the numbers whose roundings move the domain or change the integrand."""
    planes = tuple(arg for g in stmt.half_planes for arg in (g.a, g.b, g.c))
    return (*planes, *stmt.place, *stmt.matrix, *(c for m in stmt.moments for _, _, c in m.terms))
