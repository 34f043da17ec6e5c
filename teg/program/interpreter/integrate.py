"""The meaning of `Integrate`: pieces between breaks, and the rules on a piece."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, assert_never

from teg.numerics.quadrature import decay_power, end_rule, gauss_legendre, null_rules, pole_table
from teg.program.interpreter.bends import POWER, Substitution, substitution, tail, tail_place
from teg.program.limits import (
    AT_END,
    CANCELLED,
    CANCELS,
    DEEP,
    DIVERGENT,
    EDGE,
    END_DECAY,
    END_INSIDE,
    FAINT,
    GUARD_DEPTH,
    HIDDEN,
    INSIDE,
    MAX_DEPTH,
    MAX_INTERVALS,
    NEIGHBOUR,
    NOISE,
    PIECE_EPS,
    PLACED,
    POLE,
    RESIDUE,
    ROUNDING,
    SPENT,
    UNSEEN,
    WATCH_WIDTH,
)
from teg.program.operations import divide, largest, power
from teg.program.rules import Adaptive, Gauss, Midpoint, Rational
from teg.program.statements import Guard, Integrate, Polygon, Polyhedron, Sample, Segment
from teg.program.walk import compound

if TYPE_CHECKING:
    from teg.program.interpreter.machine import Machine


def integrate(machine: Machine, stmt: Integrate) -> list[float]:
    """Returns the results, then the estimates."""
    piece = _Piece(machine, stmt)
    lo, hi = machine.numbers((stmt.lo, stmt.hi))
    if lo != lo or hi != hi or not (stmt.infinite or (math.isfinite(lo) and math.isfinite(hi))):
        return [math.nan] * (len(stmt.results) + len(stmt.estimates))
    a, b = (lo, hi) if lo <= hi else (hi, lo)
    breaks = machine.numbers(stmt.breaks)
    points = sorted([a, *((x if x < b else b) if x > a else a for x in breaks), b])
    pieces = [(p, q) for p, q in pairwise(points) if q - p > PIECE_EPS * max(abs(p), abs(q)) or (math.isinf(q - p) and p < q)]
    for p, q in pieces:
        piece.add(p, q, (any(_is_neighbour(p - x, p, q) for x in breaks), any(_is_neighbour(x - q, p, q) for x in breaks)))
    if lo > hi:
        piece.sums = [-s for s in piece.sums]
    return [*piece.sums, *piece.errors[: len(stmt.estimates)]]


def _is_neighbour(distance: float, p: float, q: float) -> bool:
    """Returns whether a break at that distance from an end of the piece (p, q) is a neighbour."""
    least = max(AT_END * (q - p), PIECE_EPS * max(abs(p), abs(q)))
    return least < distance < NEIGHBOUR * (q - p) and math.isfinite(q - p)


@dataclass
class _Measured:
    """Measurements of an interval: K of every value, A and E of those tested, whether a watched sign changes, and the sharp values at
    the nodes."""

    total: list[float]
    size: list[float]
    error: list[float]
    changed: bool
    hidden: bool
    seen: list[list[float]]


class _Piece:
    """The sums so far, and the rules that add a piece to them."""

    def __init__(self, machine: Machine, stmt: Integrate) -> None:
        self.machine, self.stmt = machine, stmt
        self.sums, self.errors = [0.0] * len(stmt.values), [0.0] * stmt.tested
        self.leaf = is_leaf(stmt)

    def add(self, p: float, q: float, neighbours: tuple[bool, bool]) -> None:
        """Add the integrals over one piece, and their estimates; `neighbours`: whether it has one at its first end, and at its last."""
        m, stmt = self.machine, self.stmt
        scale = m.number(stmt.scale)
        m.values.update({stmt.var: tail_place(p, q, INSIDE, scale) if math.isinf(q - p) else p + INSIDE * (q - p)})
        m.values.update(zip(stmt.ends, (p, q), strict=False))
        m.run(stmt.flags)
        if not m.holds(stmt.need):
            return
        match stmt.rule:
            case Gauss(nodes):
                self._gauss(p, q, nodes)
            case Rational(nodes, order):
                self._rational(p, q, nodes, order)
            case Midpoint(nodes):
                self._midpoint(p, q, nodes)
            case Adaptive() as rule:
                bends = [(b.kind, m.numbers(b.coefficients)) for b in stmt.bends if m.holds(b.when)]
                if math.isfinite(q - p):
                    way = substitution(p, q, m.number(stmt.base), bends, rule.cubic)
                else:
                    way = tail(p, q, scale, m.number(stmt.reach) if stmt.is_slow else None)
                self._adaptive(way, rule, neighbours)
            case _:
                assert_never(stmt.rule)

    def _values(self, x: float) -> list[float]:
        """Returns the values that the body computes at a node."""
        self.machine.evaluations += self.leaf
        return self.machine.at(self.stmt.body, self.stmt.at_nodes, **{self.stmt.var: x})

    def _take(self, totals: Sequence[float], errors: Sequence[float]) -> None:
        self.sums = [s + t for s, t in zip(self.sums, totals, strict=True)]
        self.errors = [s + e for s, e in zip(self.errors, errors, strict=True)]

    def _gauss(self, p: float, q: float, n: int) -> None:
        nodes, weights = gauss_legendre(n)
        middle, half = 0.5 * (p + q), 0.5 * (q - p)
        rows = [self._values(middle + half * u) for u in nodes]
        totals = [half * sum(w * row[j] for w, row in zip(weights, rows, strict=True)) for j in range(len(self.sums))]
        sizes = [half * sum(w * abs(row[j]) for w, row in zip(weights, rows, strict=True)) for j in range(len(self.errors))]
        self._take(totals, [rounding(p, q) * a for a in sizes])

    def _midpoint(self, p: float, q: float, n: int) -> None:
        rows = [self._values(p + (q - p) * ((k + 0.5) / n)) for k in range(n)]
        width = (q - p) / n
        totals = [width * sum(row[j] for row in rows) for j in range(len(self.sums))]
        errors = []
        for j in range(len(self.errors)):
            steps = sum(abs(after[j] - before[j]) for before, after in pairwise(rows))
            errors.append(0.5 * width * steps + 0.5 * ROUNDING * width * sum(abs(row[j]) for row in rows))
        self._take(totals, errors)

    def _rational(self, p: float, q: float, n: int, order: int) -> None:
        """Gauss-Legendre with weights that know the pole, where it counts and is not on the piece."""
        m = self.machine
        (bend,) = self.stmt.bends
        c0, c1, _ = m.numbers(bend.coefficients)
        first, last = (x - m.number(self.stmt.base) for x in (p, q))
        low, high = c0 + c1 * first, c0 + c1 * last
        counts = m.holds(bend.when) and math.isfinite(c0) and math.isfinite(c1)
        nearest = min(abs(low), abs(high))
        clear = counts and low * high > 0.0 and nearest > POLE * max(abs(p), abs(q)) * abs(c1)
        nodes, plain = gauss_legendre(n)
        weights = pole_weights(n, order, low, high) if clear else plain
        loss = order * EDGE * (abs(c0) + abs(c1) * max(abs(first), abs(last))) / nearest if clear else 0.0
        middle, half = 0.5 * (p + q), 0.5 * (q - p)
        rows = [self._values(middle + half * u) for u in nodes]
        totals = [half * sum(w * row[j] for w, row in zip(weights, rows, strict=True)) for j in range(len(self.sums))]
        for j, total in enumerate(totals if counts and not clear else ()):
            highest = abs(sum(w * row[j] for w, row in zip(null_rules(n)[0], rows, strict=True)))
            if highest > RESIDUE * sum(w * abs(row[j]) for w, row in zip(plain, rows, strict=True)):
                totals[j] = math.copysign(math.inf, total)
                m.missed = True
        sizes = [half * sum(abs(w * row[j]) for w, row in zip(weights, rows, strict=True)) for j in range(len(self.errors))]
        self._take(totals, [(rounding(p, q) + loss) * a for a in sizes])

    def _adaptive(self, way: Substitution, rule: Adaptive, neighbours: tuple[bool, bool]) -> None:
        """Bisection until every interval is accepted, from the left."""
        stmt, m, tested = self.stmt, self.machine, range(self.stmt.tested)
        whole = [0.0] * stmt.tested
        spent, totals = [0.0] * stmt.tested, [0.0] * stmt.tested
        waiting = [(0.0, 1.0, 0, [0.0] * stmt.tested)]  # ends, how often halved, the largest A of what it came from
        used = 0
        while waiting:
            left, right, depth, above = waiting.pop()
            used += 1
            first = used == 1 and not stmt.watch and not rule.closed
            smooth = way.kind != POWER and not (neighbours[0] and left == 0.0) and not (neighbours[1] and right == 1.0)
            found = self._measure(way, left, right, rule.first if first else rule.order, smooth, rule.closed)
            above = [_larger(a, s) for a, s in zip(above, found.size, strict=True)]
            if used == 1:
                whole = list(found.size)
            elif stmt.guard is not None:
                whole = [_larger(a, s) for a, s in zip(whole, found.size, strict=True)]
            known = whole if stmt.guard is None else above
            wanted = [max(rule.tol * (known[j] + rule.floor), ROUNDING * found.size[j]) for j in tested]
            fine = all(e <= w or not math.isfinite(e) for e, w in zip(found.error, wanted, strict=True))
            good = right - left <= WATCH_WIDTH if found.changed else fine
            hides = False
            if good and stmt.guard is not None and not found.changed and all(map(math.isfinite, found.error)):
                hides = self._hides(stmt.guard, way, (left, right, depth), found.seen, wanted)
                good = not hides
            if not good and depth < MAX_DEPTH and used < MAX_INTERVALS:
                middle = 0.5 * (left + right)
                if first:
                    waiting.append((left, right, depth, above))
                else:
                    waiting += [(middle, right, depth + 1, above), (left, middle, depth + 1, above)]
                continue
            if not good:
                m.missed = True
                for j in tested if depth >= DEEP and not found.changed and not found.hidden else ():
                    if math.isfinite(found.error[j]) and found.size[j] > DIVERGENT * known[j]:
                        found.total[j] = math.copysign(math.inf, found.total[j])
                if hides and stmt.guard is not None:
                    found.error = [_larger(e, h) for e, h in zip(found.error, self._hidden(stmt.guard, way, left, right), strict=True)]
            m.missed |= any(math.isinf(found.total[j]) for j in tested)
            totals = [t + k for t, k in zip(totals, found.total, strict=False)]
            if not found.changed:
                spent = [s + e for s, e in zip(spent, found.error, strict=True)]
            factor = max(rounding(way.p, way.q), 0.5 * ROUNDING + _placed(way, left, right))
            self._take(found.total, [e + factor * a for e, a in zip(found.error, found.size, strict=True)])
        kept = [CANCELLED * rule.tol * (abs(t) + CANCELS) for t in totals]
        most = [max(min(SPENT * rule.tol * (a + rule.floor), k), SPENT * ROUNDING * a) for a, k in zip(whole, kept, strict=True)]
        m.missed |= any(s > w for s, w in zip(spent, most, strict=True))

    def _measure(self, way: Substitution, left: float, right: float, n: int, smooth: bool, closed: bool) -> _Measured:
        """Returns the measurements of the interval (left, right) of u by n nodes; see `measure`."""
        stmt, m = self.stmt, self.machine
        half, count, watched = 0.5 * (right - left), len(stmt.values), len(stmt.watch)
        rows, signs, seen = [], [], []
        for node in gauss_legendre(n)[0]:
            x, rate = way(left + half * (1.0 + node))
            row = self._values(x)
            rows.append([v * (rate * half) for v in row[:count]])
            signs.append(row[count : count + watched])
            seen.append(row[count + watched :])
        aside: list[list[float]] = []
        if watched or closed:
            met, missed, crowded = set(m.met), m.missed, m.crowded
            for u in (left + END_INSIDE * (right - left), right - END_INSIDE * (right - left)) if closed else (left, right):
                x, rate = way(u)
                row = self._values(x)
                aside.append([v * (rate * half) for v in row[:count]])
                signs.append(row[count : count + watched])
            m.met, m.missed, m.crowded = met, missed, crowded  # what happens at the ends does not count
        changed = any(any(s > 0.0 for s in column) and any(s < 0.0 for s in column) for column in zip(*signs, strict=True))
        hidden = any(s == 0.0 for row in signs for s in row)
        totals, sizes, errors = [], [], []
        for j in range(count):
            column = [row[j] for row in rows]
            total, size, error = measure(column, smooth, closed)
            totals.append(total)
            if j < stmt.tested:
                sizes.append(size)
                errors.append(error + 4.0 * unseen_at_ends(column, [row[j] for row in aside]) if closed else error)
        return _Measured(totals, sizes, errors, changed, hidden, seen)

    def _hidden(self, guard: Guard, way: Substitution, start: float, stop: float) -> list[float]:
        """Returns bounds of the integrals of |tested value| over an interval, infinite where they are not known; 0 where a value has no
        finite bound on a finite interval, as beside integrable singularities."""
        left, right = _place(way, start), _place(way, stop)
        sizes = self.machine.at(guard.block, guard.sizes, **{guard.left: left, guard.right: right})
        bounds = [0.0 if math.isinf(size) and math.isfinite(right - left) else size * (right - left) for size in sizes]
        return [math.inf if math.isnan(bound) else bound for bound in bounds]

    def _hides(
        self, guard: Guard, way: Substitution, interval: tuple[float, float, int], seen: list[list[float]], wanted: list[float]
    ) -> bool:
        """Returns whether something may be hidden between the nodes of an interval (from, to), halved so often; `seen` are the sharp values
        there, `wanted` what the error of each tested value may be."""
        (start, stop, depth), n, sharp = interval, len(seen), range(len(guard.seen))
        at = [start, *(start + 0.5 * (stop - start) * (1.0 + node) for node in gauss_legendre(n)[0]), stop]
        points = [_place(way, u) for u in at]

        def unseen(left: float, right: float, largest_seen: list[float], endless_counts: bool, gap: bool, last: bool = False) -> bool:
            bounds = self.machine.at(guard.block, guard.bounds, **{guard.left: left, guard.right: right})
            length, first = right - left, len(guard.sizes)
            endless = not math.isfinite(length)
            if all(s == 0.0 if endless else s * length <= w for s, w in zip(bounds, wanted, strict=False)):
                return False
            for i in sharp:
                upper, lower = bounds[first + i], bounds[first + len(sharp) + i]
                large = upper > UNSEEN * _larger(largest_seen[i], FAINT)
                large |= upper > HIDDEN * _larger(lower, FAINT) and not (gap and endless) and not last
                large &= not all(bounds[first + 2 * len(sharp) + i] * length <= w for w in wanted)
                if large and (endless_counts or upper != math.inf):
                    return True
            return False

        if not unseen(points[0], points[-1], [_least(row[i] for row in seen) for i in sharp], True, False):
            return False
        for gap, (left, right) in enumerate(pairwise(points)):
            nodes = [seen[k] for k in (gap - 1, gap) if 0 <= k < n]
            at_end = math.isfinite(right - left) and ((gap == 0 and start <= 0.0) or (gap == n and stop >= 1.0))
            most = [_larger(nodes[0][i], nodes[-1][i]) for i in sharp]
            endless_counts = not at_end and (depth < GUARD_DEPTH or math.isinf(right - left))
            if unseen(left, right, most, endless_counts, True, at_end and depth >= DEEP):
                return True
        return False


def _place(way: Substitution, u: float) -> float:
    """Returns the place of u; the ends of a piece are its own."""
    return way.p if u <= 0.0 else way.q if u >= 1.0 else way(u)[0]


def is_leaf(stmt: Integrate | Sample) -> bool:
    """Returns whether there is no integral inside: the evaluations of its integrand are counted."""
    return not any(isinstance(s, Integrate | Sample | Polygon | Polyhedron | Segment) for s in compound(stmt.body))


def _placed(way: Substitution, left: float, right: float) -> float:
    """Returns the effect of the rounding of places on the integral over an interval, relative to the integral of |values|. An end that is
    infinite is replaced by the middle."""
    middle = _place(way, 0.5 * (left + right))
    p, q = (place if math.isfinite(place) else middle for place in (_place(way, left), _place(way, right)))
    return min(1.0, PLACED * max(abs(p), abs(q)) / (q - p)) if q > p else 1.0


def rounding(p: float, q: float) -> float:
    """Returns the effect of rounding on the integral over (p, q), relative to the integral of |values|: that of the values, and that of the
    ends."""
    return 0.5 * ROUNDING + (EDGE * max(abs(p), abs(q)) / (q - p) if math.isfinite(q - p) else 0.0)


def measure(values: Sequence[float], smooth: bool, closed: bool = False) -> tuple[float, float, float]:
    """Returns K, A and E of the values at Gauss nodes; where they are not known to be `smooth` no decay is counted on."""
    n = len(values)
    weights = gauss_legendre(n)[1]
    total = sum(w * v for w, v in zip(weights, values, strict=True))
    size = sum(w * abs(v) for w, v in zip(weights, values, strict=True))
    tail, ratio = _decay(values)
    error = 4.0 * tail * power(ratio if smooth else 1.0, decay_power(n, closed))
    return total, size, 0.0 if tail <= NOISE * size else error


def unseen_at_ends(values: Sequence[float], ends: Sequence[float]) -> float:
    """Returns what the values at the two ends show that those at the nodes do not."""
    gap, rows = end_rule(len(values), END_INSIDE)
    tail, ratio = _decay(values)
    size = sum(w * abs(v) for w, v in zip(gauss_legendre(len(values))[1], values, strict=True))
    found = 0.0
    for row, value in zip(rows, ends, strict=True):
        apart = abs(value - sum(w * v for w, v in zip(row, values, strict=True)))
        found += gap * apart if math.isfinite(apart) and apart > END_DECAY * tail * ratio else 0.0
    return found if found > NOISE * size else 0.0


def _decay(values: Sequence[float]) -> tuple[float, float]:
    """Returns the largest coefficients that the null rules give, and their decay, 1 where there is none."""
    e = [abs(sum(w * v for w, v in zip(row, values, strict=True))) for row in null_rules(len(values))]
    a, b, c = largest(e[0], e[1]), largest(e[2], e[3]), largest(e[4], e[5])
    tail = largest(a, b) if b > c else a
    last, before = divide(a, b), divide(b, c)
    ratio = largest(last, before) * power(largest(1.0, divide(last, before)), 3)
    ratio = largest(ratio, (15.0 * ratio - 2.0) / 7.0)
    return tail, ratio if ratio < 1.0 else 1.0


def pole_weights(n: int, order: int, low: float, high: float) -> list[float]:
    """Returns the weights of n Gauss nodes for polynomials over a power of a linear function that goes from low to high."""
    table, nodes = pole_table(n, order), gauss_legendre(n)[0]
    z = (high - low) / (high + low)
    moments = [2.0 / (j + 1) if j % 2 == 0 else 0.0 for j in range(n)]
    for level in range(1, order + 1):
        if abs(z) < table.border:  # downwards from a series
            top = 0.0
            for c in reversed(table.series[level - 1]):
                top = top * (z * z) + c
            now = [-z * top if n % 2 == 0 else top]
            for known in reversed(moments[:-1]):
                now.insert(0, known - z * now[0])
        else:  # upwards from a logarithm
            k, mean = level - 1, 0.5 * (high + low)
            first = math.log(high / low) if k == 0 else ((mean / low) ** k - (mean / high) ** k) / k
            now = [first / z]
            for known in moments[:-1]:
                now.append((known - now[-1]) / z)
        moments = now
    rows = [sum(c * moment for c, moment in zip(row, moments, strict=True)) for row in table.lagrange]
    return [row * (1.0 + z * u) ** order for row, u in zip(rows, nodes, strict=True)]


def _larger(x: float, y: float) -> float:
    """Returns the larger of two numbers, or the one that is a number."""
    return y if x != x or y > x else x


def _least(values: object) -> float:
    """Returns the least of those that are numbers; NaN if there are none."""
    numbers = [v for v in values if v == v]  # type: ignore[attr-defined]
    return min(numbers, default=math.nan)
