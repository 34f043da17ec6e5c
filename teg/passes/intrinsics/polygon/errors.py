"""Error estimates of polyhedra, polygons and segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

from teg.passes.lower.intrinsic import LEAST, Errors
from teg.program import CLIP_EPS, EDGE, ROUNDING, Arg, HalfLine, HalfPlane, HalfSpace, Polygon, Polyhedron, Segment, Stmt
from teg.program.names import is_condition

Domain = Polyhedron | Polygon | Segment


def with_errors(errors: Errors, stmt: Domain, out: list[Stmt]) -> None:
    """Appends the statement with its errors: roundings of the sum and of the corners (large for a sliver), errors of the integrand, and
    strips of the domain.

    A border that is off by δ moves the domain by a strip, where the integrand is as large as its mean. Where the domain is empty, but no
    condition fails by more than δ, the strip may be all of it; then the integrand is taken to be 1.
    """
    setup, body = errors.block(stmt.setup), list(errors.block(stmt.body))
    sizes = {v: errors.op(body, "abs", v) if isinstance(v, str) else abs(v) for v in stmt.values}
    companions = [errors.uncertainty(v, body) for v in stmt.values]
    inexact = [i for i, c in enumerate(companions) if c != 0.0]
    names = {v: errors.fresh("v") for v in sizes}
    extent, more = errors.fresh("v"), {i: errors.fresh("v") for i in inexact}
    values = (*stmt.values, *sizes.values(), 1.0, *(companions[i] for i in inexact))
    factors = (*stmt.factors, *(1.0 for _ in (*sizes, extent, *inexact)))
    results = (*stmt.results, *names.values(), extent, *more.values())
    out.append(replace(stmt, setup=setup, body=tuple(body), values=values, factors=factors, results=results))
    box: Arg = 1.0 if isinstance(stmt, Segment) else errors.op(out, "abs", errors.op(out, "mul", *_extents(stmt)))
    thin = errors.op(out, "div", box, errors.op(out, "max", errors.op(out, "abs", extent), LEAST))
    relative = errors.op(out, "add", 0.5 * ROUNDING, errors.op(out, "mul", EDGE, thin))
    strip, nearly = _strips(errors, stmt, out)
    area = errors.op(out, "mul", strip, box)
    moved = errors.op(out, "mul", strip, thin)
    relative = errors.sum_of((relative, moved, _of_extent(errors, stmt, out)), out)
    empty = errors.op(out, "and", nearly, errors.op(out, "le0", errors.op(out, "abs", extent)))
    least = errors.op(out, "select", empty, area, 0.0)
    for i, (result, value, factor) in enumerate(zip(stmt.results, stmt.values, stmt.factors, strict=True)):
        size = errors.op(out, "abs", names[value])
        parts = [errors.op(out, "mul", relative, size), least]
        if i in more:
            parts.append(errors.op(out, "abs", more[i]))
        total = errors.times(out, factor, errors.sum_of(parts, out)) if factor != 1.0 else errors.sum_of(parts, out)
        spread = errors.uncertainty(factor, out)
        errors.errors[result] = total if spread == 0.0 else errors.sum_of((total, errors.op(out, "mul", spread, size)), out)


def _extents(stmt: Polyhedron | Polygon) -> tuple[Arg, ...]:
    return stmt.extents if isinstance(stmt, Polyhedron) else (stmt.width, stmt.height)


def _strips(errors: Errors, stmt: Domain, out: list[Stmt]) -> tuple[Arg, Arg]:
    """Returns the part of the box in which borders may be, and whether no condition fails by more than its error."""
    strips: list[Arg] = []
    nearly: list[Arg] = []
    borders: list[tuple[HalfSpace | HalfPlane | HalfLine, Arg, Sequence[Arg]]]
    match stmt:
        case Polyhedron():
            borders = [(g, *_of_plane(errors, g.slopes, g.offset, stmt, out)) for g in stmt.half_spaces]
        case Polygon():
            borders = [(g, *_of_plane(errors, (g.a, g.b), g.c, stmt, out)) for g in stmt.half_planes]
        case Segment():
            borders = [(g, *_of_line(errors, g, out)) for g in stmt.half_lines]
    for half, off, ends in borders:
        if off == 0.0:
            continue
        least, most = (reduce(lambda u, v: errors.op(out, op, u, v), ends) for op in ("min", "max"))
        reaches = errors.op(out, "ge0", errors.op(out, "add", most, off))
        leaves = errors.op(out, "ge0", errors.op(out, "sub", off, least))
        change = errors.op(out, "max", errors.op(out, "sub", most, least), LEAST)
        part = errors.op(out, "min", 1.0, errors.op(out, "div", off, change))
        crosses = errors.op(out, "and", reaches, leaves)
        if isinstance(half, HalfLine) and half.k is not None:  # a tie is no error
            apart = errors.op(out, "max", errors.op(out, "abs", half.first), errors.op(out, "abs", half.last))
            crosses = errors.op(out, "and", crosses, errors.op(out, "gt0", errors.op(out, "sub", apart, off)))
        strips.append(errors.op(out, "select", crosses, part, 0.0))
        nearly.append(reaches)
    if not strips:
        return 0.0, False
    return errors.sum_of(strips, out), nearly[0] if len(nearly) == 1 else errors.op(out, "and", *nearly)


def _of_plane(errors: Errors, slopes: Sequence[Arg], offset: Arg, stmt: Polyhedron | Polygon, out: list[Stmt]) -> tuple[Arg, Sequence[Arg]]:
    """Returns how far the values of a half-plane in the box may be off, and its values at the corners of the box."""
    off = [errors.uncertainty(offset, out)]
    steps: list[Arg] = []
    ends: list[Arg] = [offset]
    for slope, extent in zip(slopes, _extents(stmt), strict=True):
        step = errors.op(out, "mul", slope, extent)
        off.append(errors.times(out, extent, errors.uncertainty(slope, out)))
        steps.append(step)
        ends += [errors.op(out, "add", end, step) for end in ends]
    if isinstance(stmt, Polyhedron):  # corners that are outside by so little stay
        terms = [errors.op(out, "abs", term) for term in (offset, *steps)]
        off.append(errors.op(out, "mul", CLIP_EPS, errors.sum_of(terms, out)))
    return errors.sum_of(off, out), ends


def _of_line(errors: Errors, half: HalfLine, out: list[Stmt]) -> tuple[Arg, Sequence[Arg]]:
    """Returns how far the values of a half-line may be off, and its values at the ends."""
    return errors.sum_of([errors.uncertainty(end, out) for end in (half.first, half.last)], out), (half.first, half.last)


def _of_extent(errors: Errors, stmt: Domain, out: list[Stmt]) -> Arg:
    """Returns the errors of the box, and of the corners of a triangle, relative to them."""
    if isinstance(stmt, Segment):
        return 0.0
    known = (stmt.across, *(arg for p in stmt.corners for arg in p)) if isinstance(stmt, Polygon) and stmt.corners else ()
    parts: list[Arg] = []
    for arg in dict.fromkeys((*_extents(stmt), *known)):
        if isinstance(arg, str) and not is_condition(arg) and errors.error(arg) != 0.0:
            size = errors.op(out, "max", errors.op(out, "abs", arg), LEAST)
            parts.append(errors.op(out, "div", errors.error(arg), size))
    return errors.sum_of(parts, out)


def numbers_of(stmt: Domain) -> tuple[Arg, ...]:
    """Returns the numbers whose roundings move the domain or change the integrand."""
    match stmt:
        case Polyhedron():
            borders = tuple(arg for g in stmt.half_spaces for arg in (*g.slopes, g.offset))
        case Polygon():
            borders = tuple(arg for g in stmt.half_planes for arg in (g.a, g.b, g.c))
        case Segment():
            borders = tuple(arg for g in stmt.half_lines for arg in (g.first, g.last))
    return (*borders, *stmt.values, *stmt.factors)
