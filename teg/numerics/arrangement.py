"""The cells of one square: convex polygons with one owner each, made by inserting candidates nearest first (`cells.py`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from teg.numerics.cells import BESIDE, BOX, EPSILON, NO_OWNER, NUDGE, ROUNDING, SIDES, Form, Layout, Point, Row, apart
from teg.numerics.key_edges import assign_key_edges, flat


class Line(NamedTuple):
    """The line of a form, divided by |(a, b)|; which numbers the form consists of: (+1 or -1, candidate, first column).

    An edge is `late` that got this line after another one: how its ends move is not known.
    """

    unit: Form
    size: float
    of: tuple[tuple[int, int, int], ...]
    late: bool = False


class Cell(NamedTuple):
    """A convex polygon: the region that owns it, its corners, and the label of the edge behind each: 2·line, + 1 on the negative side."""

    owner: int
    corners: list[Point]
    labels: list[int]


def split(cell: Cell, line: int, unit: Form) -> tuple[Cell | None, Cell | None, list[bool]]:
    """Returns the parts of a cell on the sides g >= 0 and g <= 0 of a line, the cell itself where all of it is on one; and, where it is not
    cut, which corners are on the line."""
    c, a, b = unit
    d = [c + a * x + b * y for x, y in cell.corners]
    d = [0.0 if abs(v) < EPSILON else v for v in d]
    if max(d) <= 0.0 or min(d) >= 0.0:
        on = [v == 0.0 for v in d]
        return (None, cell, on) if max(d) <= 0.0 else (cell, None, on)
    return _half(cell, d, 1.0, 2 * line), _half(cell, d, -1.0, 2 * line + 1), [False] * len(d)


def _half(cell: Cell, d: Sequence[float], side: float, label: int) -> Cell:
    corners: list[Point] = []
    labels: list[int] = []
    n = len(d)
    for i, (x, y) in enumerate(cell.corners):
        j = (i + 1) % n
        di, dj = side * d[i], side * d[j]
        if di >= 0.0:
            corners.append((x, y))
            labels.append(label if di == 0.0 and dj < 0.0 else cell.labels[i])
        if di * dj < 0.0:
            t = d[i] / (d[i] - d[j])
            u, v = cell.corners[j]
            corners.append((x + t * (u - x), y + t * (v - y)))
            labels.append(label if di > 0.0 else cell.labels[i])
    return Cell(cell.owner, corners, labels)


def _sides_at(at: Point) -> int:
    """Returns on how many sides of the square a place lies."""
    return sum(abs(d) <= EPSILON for d in (at[0], 1.0 - at[0], at[1], 1.0 - at[1]))


class Arrangement:
    """The cells of the square, moved by `shift`. Regions are parts of candidates: part j of candidate k is region k·parts + j. Keys are
    taken apart by `nudge`, in units of NUDGE of the largest of them."""

    def __init__(self, shape: Layout, candidates: Sequence[Row], shift: Point = (0.0, 0.0), nudge: float = 0.0) -> None:
        self.shape, self.candidates, self.shift = shape, candidates, shift
        self.nudge = nudge * NUDGE * max((sum(map(abs, row[shape.forms - 3 : shape.forms])) for row in candidates), default=0.0)
        self.concurrent = 0  # whether more keys are equal at one place than have a second derivative there: 1, 2 if it has no two sides
        self.lines = [Line(side, 1.0, ()) for side in SIDES]
        self.guards: dict[int, list[int]] = {}  # of a line that is one: all lines of its region
        self.touching = False
        self.undefined = False
        self.tied = False  # whether something else has the line of an edge on which two keys are equal
        self.ambiguous = False  # whether such an edge has no derivative
        present: list[tuple[int, list[int]]] = []
        for region in range(len(candidates) * shape.parts):
            cutting = self._cutting(region)
            if cutting is not None:
                present.append((region, cutting))
                self.undefined |= not all(map(math.isfinite, self._key(region)))
        if self.undefined:
            present = []
        self.present = [region for region, _ in present]
        base = min((self._most(r), r) for r, cutting in present if not cutting)[1] if any(not c for _, c in present) else NO_OWNER
        box = Cell(base, [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], [2 * 2, 2 * 1, 2 * 3, 2 * 0])
        self.cells = [box]
        self.key_lines: dict[tuple[int, int], int] = {}
        rest = [(self._middle(r), r, cutting) for r, cutting in present if r != base and not self._is_hidden(r, base)]
        self.guarded = any(cutting for _, _, cutting in rest)
        self.inserted: list[int] = []  # the lines of guards, nearest region first
        for _, region, cutting in sorted(rest, key=lambda entry: entry[:2]):
            self.inserted += cutting
            self._insert(region, cutting)
        if self.tied:
            assign_key_edges(self, present)
        self.concurrent = 2 if self.concurrent and (self.touching or self.ambiguous) else self.concurrent

    def form(self, candidate: int, column: int) -> Form:
        """Returns a form of a candidate in the coordinates of the square."""
        c, a, b = self.candidates[candidate][column : column + 3]
        return c + a * self.shift[0] + b * self.shift[1], a, b

    def _cutting(self, region: int) -> list[int] | None:
        """Returns the lines of the guards that may cut the square; None if the region is outside of it."""
        candidate, part = divmod(region, self.shape.parts)
        columns = range(3 * part * self.shape.guards, 3 * (part + 1) * self.shape.guards, 3)
        forms = [self.form(candidate, column) for column in columns]
        lines: list[Line] = []
        for (c, a, b), column in zip(forms, columns, strict=True):
            size = math.hypot(a, b)
            most = c + max(a, 0.0) + max(b, 0.0)
            least = c + min(a, 0.0) + min(b, 0.0)
            if most < -EPSILON * size or (size == 0.0 and c < 0.0):
                return None  # whatever the other guards are
            if least <= EPSILON * size and 0.0 < size < math.inf:
                lines.append(Line((c / size, a / size, b / size), size, ((1, candidate, column),)))
        self.undefined |= not all(math.isfinite(v) for form in forms for v in form)
        self.lines += lines
        cutting = list(range(len(self.lines) - len(lines), len(self.lines)))
        self.guards.update(dict.fromkeys(cutting, cutting))
        return cutting

    def _key(self, region: int) -> Form:
        candidate = region // self.shape.parts
        c, a, b = self.form(candidate, self.shape.forms - 3)
        return (c + self.nudge * apart(candidate) if self.nudge else c), a, b

    def _most(self, region: int) -> float:
        c, a, b = self._key(region)
        return c + max(a, 0.0) + max(b, 0.0)

    def _middle(self, region: int) -> float:
        c, a, b = self._key(region)
        return c + 0.5 * a + 0.5 * b

    def difference(self, behind: int, before: int) -> tuple[Form, float]:
        """Returns key - key, and the value below which it counts as 0."""
        (c, a, b), (d, e, f) = self._key(behind), self._key(before)
        g = (c - d, a - e, b - f)
        return g, EPSILON * math.hypot(g[1], g[2]) + ROUNDING * max(abs(c), abs(d))

    def flat(self, one: int, other: int) -> float:
        """Returns the slope below which two keys, equal at an edge, are equal on both sides of it."""
        return flat(self._key(one), self._key(other))

    def is_level(self, one: int, other: int) -> bool:
        """Returns whether two keys are straight lines over an interval: neither has the second variable."""
        return self._key(one)[2] == 0.0 and self._key(other)[2] == 0.0

    def is_key_line(self, line: int) -> bool:
        """Returns whether two keys are equal on a line."""
        return len(self.lines[line].of) == 2

    def _is_hidden(self, region: int, base: int) -> bool:
        """Returns whether the base is nearer than a region everywhere."""
        if base == NO_OWNER:
            return False
        (c, a, b), tolerance = self.difference(region, base)
        return c + min(a, 0.0) + min(b, 0.0) > tolerance

    def _insert(self, region: int, cutting: Sequence[int]) -> None:
        for number in range(len(self.cells)):
            cell = self.cells[number]
            needed: int | None = None
            if cell.owner != NO_OWNER:
                if cell.owner // self.shape.parts == region // self.shape.parts:
                    continue  # another part of the same candidate
                g, tolerance = self.difference(cell.owner, region)
                d = [g[0] + g[1] * x + g[2] * y for x, y in cell.corners]
                most, least = max(d), min(d)
                if (most > tolerance) != (least < -tolerance):
                    self._note(cell, [abs(v) <= tolerance for v in d], cutting)
                if self.shape.order and not self.guarded and max(most, -least) > tolerance:
                    self._note_concurrent(cell, [abs(v) <= tolerance for v in d])
                if most <= tolerance and (least < -tolerance or region > cell.owner):
                    continue
                if most > tolerance and least < -tolerance:
                    needed = self._key_line(cell.owner, region, g)
            self._clip(number, region, cutting, needed)

    def _note_concurrent(self, cell: Cell, on: Sequence[bool]) -> None:
        """Notes that a further key is equal to the owner's at corners of a cell, those that are `on` its line; not along a side of the
        square."""
        along = [label < 2 * BOX and on[i] and on[(i + 1) % len(on)] for i, label in enumerate(cell.labels)]
        for i, (x, y) in enumerate(cell.corners):
            if on[i] and not along[i] and not along[i - 1]:
                equal = 0
                for region in self.present:
                    g, tolerance = self.difference(cell.owner, region)
                    equal += abs(g[0] + g[1] * x + g[2] * y) <= tolerance
                self.concurrent = max(self.concurrent, 2 if equal + _sides_at((x, y)) > 4 else 1)

    def _note(self, cell: Cell, on: Sequence[bool], lines: Sequence[int]) -> None:
        """Notes whether a region has a line on an edge, both ends of which are `on` it: a side of the square, or a line of equal keys."""
        self.touching |= self._is_touching(cell, on, lines)
        n = len(on)
        self.tied |= any(on[i] and on[(i + 1) % n] and self.is_key_line(label >> 1) for i, label in enumerate(cell.labels))

    def _is_touching(self, cell: Cell, on: Sequence[bool], lines: Sequence[int]) -> bool:
        """Returns whether a region is at an edge of a cell on a side of the square, both ends of which are `on` a line."""
        n = len(on)
        edges = [i for i in range(n) if cell.labels[i] < 2 * BOX and on[i] and on[(i + 1) % n]]
        return any(self._is_at((cell.corners[i], cell.corners[(i + 1) % n]), lines) for i in edges)

    def _is_at(self, ends: tuple[Point, Point], lines: Sequence[int]) -> bool:
        first, last = 0.0, 1.0
        for line in lines:
            c, a, b = self.lines[line].unit
            d, e = (c + BESIDE + a * x + b * y for x, y in ends)
            if d < 0.0 and e < 0.0:
                return False
            first = max(first, d / (d - e)) if d < 0.0 else first
            last = min(last, d / (d - e)) if e < 0.0 else last
        return first <= last

    def _key_line(self, owner: int, region: int, g: Form) -> int:
        """Returns the line on which two keys are equal, of the form that is positive where `region` is nearer."""
        parts, column = self.shape.parts, self.shape.forms - 3
        pair = owner // parts, region // parts
        if pair not in self.key_lines:
            self.key_lines[pair] = len(self.lines)
            size = math.hypot(g[1], g[2])
            unit = (g[0] / size, g[1] / size, g[2] / size)
            self.lines.append(Line(unit, size, ((1, pair[0], column), (-1, pair[1], column))))
        return self.key_lines[pair]

    def late_line(self, owner: int, other: int, g: Form) -> int:
        """Returns a line like `_key_line`, for edges that had another one."""
        size, column = math.hypot(g[1], g[2]), self.shape.forms - 3
        unit = (g[0] / size, g[1] / size, g[2] / size)
        self.lines.append(Line(unit, size, ((1, owner, column), (-1, other, column)), True))
        return len(self.lines) - 1

    def _clip(self, number: int, region: int, cutting: Sequence[int], needed: int | None) -> None:
        """Gives a region its part of a cell; what is cut off stays with the owner."""
        cell, outside = self.cells[number], []
        for line in [*cutting, *([] if needed is None else [needed])]:
            inside, other, on = split(cell, line, self.lines[line].unit)
            self._note(cell, on, cutting)
            if inside is None:
                return
            if other is not None:
                outside.append(other)
            cell = inside
        self.cells[number] = cell._replace(owner=region)
        self.cells += outside
