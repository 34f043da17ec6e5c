"""Integrals, as routines: pieces between breaks, and the rule on each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from teg.backends.c.abreast import Abreast, Nodes, eight_at_once, is_abreast
from teg.backends.c.frame import Frame, Routine, Scope, Spelling, Step, captured_by
from teg.backends.c.poles import rational_piece
from teg.backends.c.quadrature import GuardText, Places, Sums, adaptive_piece, bent_piece, gauss_piece, middle_of_piece, midpoint_piece
from teg.backends.c.routines import Routines, array_of_places, heading, is_long, needs_context, not_a_number, spelled, stop, yields
from teg.backends.c.text import each, indent, packed
from teg.program import MAX_DEPTH, Adaptive, Arg, Assign, Gauss, Integrate, Midpoint, Rational, Stmt, assigned

ABREAST_ON_STACK = 128
"""Values at nodes side by side that stand on the C stack."""
SHORT = 40
"""Statements of an integral that is compared with others."""
MANY = 8
"""Of more breaks those outside of the interval are left out before the others are sorted."""


class Integrals:
    """Prints integrals; those that differ in names only share a routine. `steps` prints a block."""

    def __init__(self, routines: Routines, steps: Callable[[Sequence[Stmt]], Iterator[Step]]) -> None:
        self.routines, self._steps = routines, steps
        self._patterns: dict[object, tuple[Routine, list[tuple[int, Arg]]]] = {}

    def routine(self, stmt: Integrate) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of an integral, and the arguments of its call. Short integrals that differ in names only share a routine,
        because a sum may have thousands of them."""
        pattern = _pattern(stmt)
        if pattern is None:
            return self._integral(stmt)
        key, names = pattern
        if key not in self._patterns:
            routine, captured = self._integral(stmt)
            number = {name: i for i, name in enumerate(names)}
            self._patterns[key] = routine, [(number[a], 0.0) if isinstance(a, str) else (-1, a) for a in captured]
        routine, places = self._patterns[key]
        return routine, tuple(literal if i < 0 else names[i] for i, literal in places)

    def _integral(self, stmt: Integrate) -> tuple[Routine, tuple[Arg, ...]]:
        """Returns the routine of an integral, and what this occurrence passes to it."""
        at_nodes = stmt.at_nodes
        flags, body = list(self._steps(stmt.flags)), [*self._steps(stmt.body), *yields(at_nodes)]
        abreast = eight_at_once(stmt) if is_abreast(stmt) else None
        blocks, variables = [flags, body if abreast is None or abreast.has_exceptions else abreast.steps], {stmt.var: "x"}
        bounds: tuple[Arg, ...] = ()
        if stmt.guard is not None:
            bounds = stmt.guard.bounds
            blocks.append([*self._steps(stmt.guard.block), *yields(bounds)])
            variables |= {stmt.guard.left: "left", stmt.guard.right: "right"}
        if abreast is not None:
            variables |= abreast.variables
            if abreast.has_exceptions:
                blocks.append(abreast.steps)
        own = spelled(stmt, "flags")
        variables |= dict(zip(stmt.ends, "pq", strict=False))
        captured = captured_by(own, [step for block in blocks for step in block], variables)
        values, count, pieces = len(stmt.values), len(assigned(stmt)), len(stmt.breaks) + 1
        whole = () if abreast is None else (1, len(blocks) - 1)
        frame = Frame(captured, blocks, own, needs_context((stmt,), self.routines.counted), variables, Spelling(whole=whole))
        arrays = _arrays_of(stmt, frame, abreast, max(len(at_nodes), len(bounds)))
        arrays += array_of_places(frame, "ends", pieces + 1)
        spell = frame.scope()
        ends, number_of_pieces = _ends(stmt, spell)
        nothing = not_a_number("sum", count)
        inside = [
            *arrays,
            *frame.opening(),
            f"const double lo = {spell(stmt.lo)}, hi = {spell(stmt.hi)};",
            ("if (lo != lo || hi != hi) " if stmt.infinite else "if (!isfinite(lo) || !isfinite(hi)) ") + nothing,
            *([stop("sum", count)] if isinstance(stmt.rule, Adaptive) else []),
            "const double a = lo <= hi ? lo : hi, b = lo <= hi ? hi : lo, sign = lo <= hi ? 1.0 : -1.0;",
            *ends,
            "double sum[1] = {0.0};" if count == 1 else f"teg_fill(sum, {count}, 0.0);",
            f"for (int i = 0; i < {number_of_pieces}; i++) {{",
            *indent(
                "const double p = ends[i], q = ends[i + 1];",
                "if (!teg_is_piece(p, q)) continue;",
                middle_of_piece(stmt.infinite, spell(stmt.scale) if stmt.infinite else ""),
                *([] if any(stmt.var in (*step.uses, *step.stored) for step in (*flags, *body)) else ["(void)x;"]),
                *frame.block(0),
                *([] if stmt.need is None else [f"if (!{spell(stmt.need)}) continue;"]),
                *self._piece(stmt, frame, spell, abreast),
            ),
            "}",
            "return sign * sum[0];" if count == 1 else each(values, "sum[j] *= sign;"),
        ]
        return self.routines.routine("integral", frame, heading(frame, "sum", count), inside), tuple(captured)

    def _piece(self, stmt: Integrate, frame: Frame, spell: Scope, abreast: Abreast | None) -> list[str]:
        """Add the integrals over the piece (p, q) to `sum`."""
        count, tested, estimated = len(stmt.values), stmt.tested, bool(stmt.estimates)
        block = [*([stop("sum", len(assigned(stmt)))] if is_long(stmt) else []), *frame.block(1)]
        nodes = None if abreast is None else Nodes(abreast, block, frame.block(len(frame.blocks) - 1) if abreast.has_exceptions else block)
        counted = self.routines.is_counted(stmt)
        match stmt.rule:
            case Midpoint(points):
                return midpoint_piece(block, points, count, tested if estimated else 0, counted)
            case Gauss(n):
                self.routines.orders.add(n)
                return gauss_piece(nodes or block, n, count, len(stmt.estimates), counted)
            case Rational() as rule:
                self.routines.poles.add((rule.nodes, rule.power))
                (bend,) = stmt.bends
                at = spell(bend.when), [spell(c) for c in bend.coefficients]
                return rational_piece(block, rule, at, spell(stmt.base), Sums(count, len(stmt.estimates), 0, estimated, counted))
            case Adaptive() as rule:
                self.routines.measured |= {rule.order} if stmt.watch or rule.closed else {rule.first, rule.order}
                self.routines.closed |= {rule.order} if rule.closed else set()
                bent = bool(stmt.bends) or stmt.infinite
                way: list[str] = []
                if bent:
                    bends = [(b, spell(b.when), [spell(c) for c in b.coefficients]) for b in stmt.bends]
                    tail = [spell(stmt.scale)] * stmt.infinite + [spell(stmt.reach)] * stmt.is_slow
                    way = bent_piece(bends, spell(stmt.base), rule.cubic, tail)
                total = Sums(count, tested, len(stmt.watch), estimated, counted)
                ends, noted = any(b.kind == "end" for b in stmt.bends), needs_context(stmt.body, False)
                places = Places(bent, ends, noted, len(stmt.breaks) if _asks_neighbours(stmt) else 0)
                guard = None if stmt.guard is None else GuardText(frame.block(2), len(stmt.guard.seen))
                return [*way, *adaptive_piece(nodes or block, rule, total, places, guard)]


def _pattern(stmt: Integrate) -> tuple[object, list[str]] | None:
    """Returns the shape of a short integral without its names, and the names in the order in which they are met; None for other
    integrals."""
    lines = (*stmt.flags, *stmt.body)
    plain = isinstance(stmt.rule, Gauss) and not (stmt.bends or stmt.watch or stmt.infinite or stmt.estimates or stmt.ends)
    if not plain or len(lines) > SHORT or not all(isinstance(s, Assign) and s.op != "call" for s in lines):
        return None
    number: dict[str, int] = {stmt.var: 0}
    parts: list[object] = [stmt.rule, len(stmt.flags), len(stmt.results), len(stmt.breaks), len(stmt.values)]

    def note(args: Sequence[Arg | None]) -> None:
        for arg in args:
            parts.append(f"{arg[0]}{number.setdefault(arg, len(number))}" if isinstance(arg, str) else repr(arg))

    note((stmt.lo, stmt.hi, *stmt.breaks, stmt.need, *stmt.values))
    for line in lines:
        assert isinstance(line, Assign)
        parts += [line.op, len(line.args)]
        note((line.name, *line.args))
    return tuple(parts), list(number)


def _ends(stmt: Integrate, spell: Scope) -> tuple[list[str], str]:
    """Returns lines that write the ends of the pieces of (a, b), and the number of pieces. Those inside are picked
    out where there are many breaks, and where an adaptive rule asks for neighbours, which may be outside."""
    breaks = stmt.breaks
    count, picked = len(breaks), len(breaks) > MANY or _asks_neighbours(stmt)
    lines = packed(
        ["ends[0] = a;", *(f"ends[{i}] = {spell(t) if picked else f'teg_clamp({spell(t)}, a, b)'};" for i, t in enumerate(breaks, 1))]
    )
    if picked:
        return [*lines, f"const int pieces = teg_breaks(ends, {count}, b);"], "pieces"
    return [*lines, f"ends[{count + 1}] = b;", *([f"teg_sort(ends + 1, {count});"] if count > 1 else [])], str(count + 1)


def _asks_neighbours(stmt: Integrate) -> bool:
    """Returns whether the rule wants to know of a piece's neighbours."""
    return isinstance(stmt.rule, Adaptive) and bool(stmt.breaks)


def _arrays_of(stmt: Integrate, frame: Frame, abreast: Abreast | None, most: int) -> list[str]:
    """Returns the declarations of what the nodes of an integral need; a block has so many values at most."""
    arrays = frame.array("f", most)
    if abreast is not None:
        arrays += [*frame.array("values", abreast.capacity * abreast.count, ABREAST_ON_STACK), *abreast.arrays()]
    if isinstance(stmt.rule, Midpoint) and stmt.estimates:
        arrays += frame.array("last", stmt.tested)
    if isinstance(stmt.rule, Rational):
        arrays += frame.array("sizes", 3 * len(stmt.values))
    if isinstance(stmt.rule, Adaptive):
        arrays += frame.array("measured", 8 * stmt.tested)
        arrays += frame.array("plain", len(stmt.values) - stmt.tested) if len(stmt.values) > stmt.tested else []
        arrays += frame.array("whole", stmt.tested)
        arrays += frame.array("spent", stmt.tested)
        arrays += frame.array("total", stmt.tested)
        arrays += frame.array("apart", 2 * stmt.tested) if stmt.rule.closed else []
    if stmt.guard is not None and isinstance(stmt.rule, Adaptive):
        arrays += frame.array("above", (MAX_DEPTH + 1) * stmt.tested)
        arrays += frame.array("seen_at", len(stmt.guard.seen) * max(stmt.rule.first, stmt.rule.order))
    return arrays
