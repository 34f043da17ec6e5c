"""Routines of a translation unit: each text once, with the tables that they use, and what all of them begin and end with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from teg.backends.c import ellipse as c_ellipse
from teg.backends.c.frame import RESULTS, Frame, Routine, Scope, Step
from teg.backends.c.hyperbola import along_function
from teg.backends.c.poles import plain_table, weights_function
from teg.backends.c.polygon import triangle_table, unit_table
from teg.backends.c.polyhedron import tetrahedron_table
from teg.backends.c.quadrature import end_table, gauss_table, node_table
from teg.backends.c.samples import sobol_table
from teg.backends.c.text import indent, packed, wrapped
from teg.program import (
    Adaptive,
    Arg,
    Integrate,
    Isolate,
    Locate,
    Midpoint,
    Polygon,
    Polyhedron,
    Rational,
    Sample,
    Segment,
    Stmt,
    compound,
    has_ties,
)
from teg.program.fields import Operand, leaves

BREAKS_ON_STACK = 256
"""Breaks, or points of a sum, that stand on the C stack."""
WHOLE = 120
"""Values passed to a polygon or a segment that is compiled where it stands."""
MANY = 1024
"""Points of a midpoint rule that are no matter of milliseconds, whatever the integrand."""


class Routines:
    """The texts of routines, inner integrals before outer ones, and notes of what they need beside them."""

    def __init__(self, counted: bool = False) -> None:
        self.counted = counted
        self.orders: set[int] = set()
        self.measured: set[int] = set()  # orders whose null rules are used
        self.closed: set[int] = set()  # and of closed rules
        self.poles: set[tuple[int, int]] = set()  # nodes and powers
        self.inlined = False  # whether polygons and segments are written where they are called
        self.triangles: set[int] = set()  # degrees of rules on triangles
        self.tetrahedra: set[int] = set()  # and on tetrahedra
        self.units: set[tuple[int, int]] = set()  # nodes of segments, and how many of them are taken side by side
        self.branches: set[tuple[tuple[int, int], ...]] = set()  # sets of moments of hyperbolas
        self.ellipses: set[c_ellipse.Wanted] = set()  # sets of moments of ellipses
        self.dimensions = 0  # of Sobol' points
        self.texts: list[str] = []
        self._known: dict[str, Routine] = {}

    @property
    def by_value(self) -> int | None:
        """Returns how many values a clipped integral is given by value: all if it is written where it is called."""
        return WHOLE if self.inlined else None

    def tables(self) -> list[str]:
        """Returns the tables that the routines use, and functions made of tables."""
        found = [*map(gauss_table, sorted(self.orders)), *map(node_table, sorted(self.measured)), *map(end_table, sorted(self.closed))]
        found += [*map(triangle_table, sorted(self.triangles)), *map(tetrahedron_table, sorted(self.tetrahedra))]
        found += (unit_table(*key) for key in sorted(self.units))
        found += [*map(plain_table, sorted({n for n, _ in self.poles})), *(weights_function(*pole) for pole in sorted(self.poles))]
        found += map(along_function, sorted(self.branches))
        found += map(c_ellipse.moments_function, sorted(self.ellipses))
        return found + ([sobol_table(self.dimensions)] if self.dimensions else [])

    def is_counted(self, stmt: Integrate | Sample) -> bool:
        return self.counted and not any(isinstance(s, Integrate | Sample | Polyhedron | Polygon | Segment) for s in compound(stmt.body))

    def routine(self, kind: str, frame: Frame, signature: str, inside: list[str]) -> Routine:
        """Returns the routine of this text, in which '@' stands for its name."""
        text = "\n\n".join([*frame.parts, wrapped([signature, "{", *indent(*inside), "}"])])
        return self.once(kind, text, frame.indirect, frame.workspace, frame.context)

    def once(self, kind: str, text: str, indirect: bool = False, workspace: int = 0, context: bool = False) -> Routine:
        """Returns the routine of this text, which is printed unless it is known."""
        if text not in self._known:
            name = kind if kind == "element" else f"{kind}_{len(self._known) + 1}"
            self._known[text] = Routine(name, indirect, workspace, context)
            self.texts.append(text.replace("@", name))
        return self._known[text]


def array_of_places(frame: Frame, name: str, count: int) -> list[str]:
    """Returns the declaration of an array of places: breaks, or points of a sum."""
    return frame.array(name, count, BREAKS_ON_STACK)


def spelled(stmt: Stmt, *blocks: str) -> tuple[Arg, ...]:
    """Returns the arguments that a routine spells between its blocks: the numbers that a statement reads around it, and what it reads in
    some blocks. Its condition is spelled where the routine is called."""
    roles = ((role, arg) for role, arg in leaves(stmt) if isinstance(role, Operand))
    return tuple(arg for role, arg in roles if role.at in blocks or (not role.at and role.kind == "number"))


def needs_context(block: tuple[Stmt, ...], counted: bool) -> bool:
    """Returns whether a run can meet a tie, miss a tolerance, have too little room, take long, or count."""
    return has_ties(block) or any(
        isinstance(s, Sample | Isolate | Locate)
        or (isinstance(s, Polyhedron | Polygon | Segment) and counted)
        or (isinstance(s, Integrate) and (counted or isinstance(s.rule, Adaptive | Rational) or is_long(s)))
        for s in compound(block)
    )


def is_long(stmt: Integrate) -> bool:
    """Returns whether at a node so much is done that a call may have to be stopped before it, or there are very many."""
    inside = (s for s in compound(stmt.body) if isinstance(s, Integrate | Sample))
    deep = any(isinstance(s, Sample) or any(isinstance(other, Integrate) for other in compound(s.body)) for s in inside)
    return deep or (isinstance(stmt.rule, Midpoint) and stmt.rule.nodes > MANY)


def stop(results: str, count: int) -> str:
    """Leave a routine if the call was stopped."""
    return f"if (teg_stopped(ctx->pace)) {not_a_number(results, count)}"


def not_a_number(results: str, count: int) -> str:
    return "return NAN;" if count == 1 else f"{{ teg_fill({results}, {count}, NAN); return; }}"


def heading(frame: Frame, results: str, count: int) -> str:
    """Returns the head of a routine: one result is returned, more are written to an array."""
    return f"static double {frame.signature()}" if count == 1 else f"static void {frame.signature(results)}"


def yields(values: Sequence[Arg], place: int = 0) -> Iterator[Step]:
    """Yields the values of a block, written to `f` from there on, a few a step."""
    for first in range(0, len(values), 8):
        some = values[first : first + 8]
        yield Step((), tuple(some), lines=partial(_yielded, place + first, some), weight=len(some), locals=(RESULTS,))


def _yielded(first: int, values: Sequence[Arg], scope: Scope) -> list[str]:
    return packed(f"f[{j}] = {scope(value)};" for j, value in enumerate(values, first))
