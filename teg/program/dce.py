"""What of a program matters: statements whose results nobody uses are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from teg.program.statements import (
    Arg,
    Assign,
    Guard,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Polygon,
    Program,
    Sample,
    Segment,
    Stmt,
    SumOver,
    When,
)
from teg.program.walk import assigned, clipped_by


def without_dead_code(program: Program) -> Program:
    """The program without statements whose results nobody uses."""
    live: set[Arg] = set(program.outputs)
    return Program(program.parameters, _live_part(program.body, live), program.outputs, program.ties, program.functions)


def _live_part(block: tuple[Stmt, ...], live: set[Arg]) -> tuple[Stmt, ...]:
    """The statements of a block that matter, given the names used after it; the names they use are added to `live`."""
    kept: list[Stmt] = []
    for stmt in reversed(block):
        if isinstance(stmt, Assign):
            if stmt.name in live:
                live.update(stmt.args)
                kept.append(stmt)
            continue
        wanted = [i for i, r in enumerate(stmt.results) if r in live]
        if not wanted and not live.intersection(assigned(stmt)):
            continue
        if isinstance(stmt, Isolate):  # the number of results is part of its meaning
            live.update((*stmt.bounds, *stmt.curving, stmt.noise, stmt.value, stmt.slope, stmt.curvature))
            point, enclosure = _live_part(stmt.point, live), _live_part(stmt.enclosure, live)
            errors = stmt.errors if live.intersection(stmt.errors) else ()
            live.update((stmt.lo, stmt.hi))
            if stmt.when is not None:
                live.add(stmt.when)
            kept.append(replace(stmt, enclosure=enclosure, point=point, errors=errors))
            continue
        if isinstance(stmt, Locate):
            live.update(stmt.bounds)
            enclosure = _live_part(stmt.enclosure, live)
            live.update((stmt.lo, stmt.hi, stmt.low, stmt.high))
            if stmt.when is not None:
                live.add(stmt.when)
            kept.append(replace(stmt, enclosure=enclosure))
            continue
        if isinstance(stmt, SumOver):
            values = tuple(stmt.values[i] for i in wanted)
            live.update(values)
            body = _live_part(stmt.body, live)
            live.update(stmt.points)
            if stmt.when is not None:
                live.add(stmt.when)
            kept.append(replace(stmt, body=body, values=values, results=tuple(stmt.results[i] for i in wanted)))
            continue
        if isinstance(stmt, Polygon | Segment):
            kept.append(_live_clipped(stmt, live))
            continue
        if isinstance(stmt, Hyperbola):
            kept.append(_live_moments(stmt, wanted, live))
            continue
        if isinstance(stmt, When):
            body = _live_part(stmt.body, live)
            live.add(stmt.when)
            kept.append(replace(stmt, body=body, results=tuple(stmt.results[i] for i in wanted)))
            continue
        kept.append(_live_sample(stmt, live) if isinstance(stmt, Sample) else _live_integral(stmt, live))
    return tuple(reversed(kept))


def _live_results(stmt: Integrate | Sample, live: set[Arg]) -> tuple[list[int], tuple[str, ...]]:
    """Which of the results matter, and their estimates; what has an estimate that does matters too."""
    tested = len(stmt.estimates)
    wanted = [i for i, r in enumerate(stmt.results) if r in live or (i < tested and stmt.estimates[i] in live)]
    estimates = tuple(stmt.estimates[i] for i in wanted if i < tested)
    return wanted, estimates if any(e in live for e in estimates) else ()


def _live_clipped(stmt: Polygon | Segment, live: set[Arg]) -> Polygon | Segment:
    """A polygon or a segment with those of its values that matter."""
    wanted = [i for i, r in enumerate(stmt.results) if r in live]
    values, results = tuple(stmt.values[i] for i in wanted), tuple(stmt.results[i] for i in wanted)
    factors = tuple(stmt.factors[i] for i in wanted)
    live.update((*values, *factors))
    body = _live_part(stmt.body, live)
    if isinstance(stmt, Segment):
        live.update(g.scale for g in stmt.half_lines if g.k is not None)
        scales = _live_part(stmt.scales, live)
        live.update(clipped_by(stmt))
        setup = _live_part(stmt.setup, live)
    else:
        setup = _live_part(stmt.setup, live)
        live.update((*clipped_by(stmt), stmt.met))
    if stmt.when is not None:
        live.add(stmt.when)
    if isinstance(stmt, Segment):
        return replace(stmt, setup=setup, scales=scales, body=body, values=values, factors=factors, results=results)
    return replace(stmt, setup=setup, body=body, values=values, factors=factors, results=results)


def _live_moments(stmt: Hyperbola, wanted: Sequence[int], live: set[Arg]) -> Hyperbola:
    """A hyperbola with those of its moments that matter."""
    moments = tuple(stmt.moments[i] for i in wanted)
    if not any(m.kind == "border" for m in moments):
        stmt = replace(stmt, scales=(), scale=(), ties=())
    live.update(stmt.scale)
    scales = _live_part(stmt.scales, live)
    live.update((*stmt.corners, *(c for m in moments for _, _, c in m.terms)))
    if stmt.when is not None:
        live.add(stmt.when)
    return replace(stmt, scales=scales, moments=moments, results=tuple(stmt.results[i] for i in wanted))


def _live_sample(stmt: Sample, live: set[Arg]) -> Sample:
    """A sample with those of its values that matter."""
    wanted, estimates = _live_results(stmt, live)
    values = tuple(stmt.values[i] for i in wanted)
    live.update(values)
    body = _live_part(stmt.body, live)
    if stmt.when is not None:
        live.add(stmt.when)
    return replace(stmt, body=body, values=values, results=tuple(stmt.results[i] for i in wanted), estimates=estimates)


def _live_integral(stmt: Integrate, live: set[Arg]) -> Integrate:
    """An integral with those of its values that matter; what has an estimate that does matters too."""
    wanted, estimates = _live_results(stmt, live)
    values = tuple(stmt.values[i] for i in wanted)
    guard = None if stmt.guard is None else _live_guard(stmt.guard, wanted, live)
    live.update((*values, *stmt.watch))
    body = _live_part(stmt.body, live)
    live.update(b.when for b in stmt.bends)
    if stmt.need is not None:
        live.add(stmt.need)
    flags = _live_part(stmt.flags, live)
    live.update((stmt.lo, stmt.hi, *stmt.breaks, stmt.base, stmt.scale, *(c for b in stmt.bends for c in b.coefficients)))
    if stmt.when is not None:
        live.add(stmt.when)
    results = tuple(stmt.results[i] for i in wanted)
    return replace(stmt, flags=flags, body=body, values=values, results=results, estimates=estimates, guard=guard)


def _live_guard(guard: Guard, wanted: Sequence[int], live: set[Arg]) -> Guard:
    """A guard with the sizes of those values that matter."""
    sizes = tuple(guard.sizes[i] for i in wanted if i < len(guard.sizes))
    live.update((*sizes, *guard.upper, *guard.lower))
    block = _live_part(guard.block, live)
    live.update(guard.seen)
    return replace(guard, block=block, sizes=sizes)
