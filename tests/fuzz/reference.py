"""Values of integrals by brute force, in 80-bit floating point. Nothing here is shared with the compiler.

`Reference.value` evaluates a tree at many points at once. An integral is cut where a condition changes, an argument of |·|, of a power or
of a function is 0, or a floor jumps: those functions are sampled, changes of sign are bisected, and local extrema without one are looked
into. Between the cuts stands a double-exponential rule, whose nodes crowd at both ends. Of integrals inside each other the outer one
is also cut where the number or the order of the inner one's cuts changes; that is bisected too. `answer.py` has derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.fuzz.operations import Array, Real, result_of
from tests.fuzz.switches import depth_of, has, switches_in
from tests.fuzz.syntax import Program, Term, grounded, plain, walk

EPS = float(np.finfo(Real).eps)
CHUNK = 2**19
"""Points that are evaluated at once."""
HALVINGS = 90
SECTIONS = 12
"""Parts of a bracket that are looked at together: the arrays are short, a call costs more than its numbers."""
DIPS, SIGNATURES = 12, 11


class NoReferenceError(Exception):
    """The reference does not know."""


@dataclass(frozen=True)
class Resolution:
    """Samples of a variable in which changes of sign are looked for, and steps of the double-exponential rule, of the
    outermost and of the innermost integral."""

    samples: int
    step: float
    inner_step: float
    points: int = 2 * 10**7
    """Evaluations of an innermost integrand after which it gives up."""


PAIRS: dict[int, tuple[tuple[Resolution, Resolution], ...]] = {
    1: (
        (Resolution(61, 1 / 24, 1 / 24), Resolution(97, 1 / 36, 1 / 36)),
        (Resolution(197, 1 / 60, 1 / 60), Resolution(397, 1 / 90, 1 / 90)),
    ),
    2: ((Resolution(61, 1 / 9, 1 / 9), Resolution(97, 1 / 13, 1 / 13)), (Resolution(97, 1 / 22, 1 / 50), Resolution(149, 1 / 31, 1 / 75))),
}
"""For integrals in one and in two variables: two resolutions that must agree; finer ones where they do not."""


@dataclass
class Points:
    """Values of variables and parameters at n points. A variable may be known as anchor + offset, exactly."""

    n: int
    values: dict[str, Array]
    anchors: dict[str, tuple[Array, Array]] = field(default_factory=dict)

    def take(self, rows: Array) -> Points:
        return Points(
            len(rows), {k: v[rows] for k, v in self.values.items()}, {k: (a[rows], o[rows]) for k, (a, o) in self.anchors.items()}
        )

    def with_variable(self, name: str, value: Array, anchor: tuple[Array, Array] | None = None) -> Points:
        anchors = {k: v for k, v in self.anchors.items() if k != name}
        if anchor is not None:
            anchors[name] = anchor
        return Points(self.n, {**self.values, name: value}, anchors)


def rule(step: float, least: float) -> tuple[Array, Array, Array]:
    """The double-exponential rule on (0, 1): distances from the nearer end, whether that is the left one, weights."""
    k = np.arange(-int(4.3 / step), int(4.3 / step) + 1)
    t = (k.astype(Real) + Real(0.31)) * Real(step)  # no node in the middle, where the tip of a thin region may be
    s = Real(np.pi) / 2 * np.sinh(np.abs(t))
    near = np.exp(-s) / (2 * np.cosh(s))
    weight = Real(step) * Real(np.pi) / 4 * np.cosh(t) / np.cosh(s) ** 2
    keep = weight > least
    return near[keep], (t <= 0)[keep], (weight / weight.sum())[keep]


class Reference:
    """Evaluates one program."""

    def __init__(self, program: Program, resolution: Resolution) -> None:
        self.tree = grounded(plain(program.tree))
        self.resolution = resolution
        self.names: dict[str, tuple[str, int] | None] = {}
        for name, value in program.values.items():
            if isinstance(value, tuple):
                self.names.update({f"{name}[{k}]": (name, k) for k in range(len(value))})
            else:
                self.names[name] = None
        self.spent = 0
        self.switches: dict[Term, list[tuple[str, Term]]] = {}
        self.literals = sorted({abs(n.data) for n in walk(self.tree) if n.op == "number"})
        self.depth = depth_of(self.tree)
        least = 1e-24 if self.depth > 1 else 0.0
        self.rules = rule(resolution.step, least), rule(resolution.inner_step, least)
        self.size = max((n.data for n in walk(self.tree) if n.op == "number" and n.data < 1e7), default=1.0)

    def value(self, values: Mapping[str, Any]) -> Any:
        """The value at parameters: numbers by name, `V[0]` for entries."""
        return self.batch({k: np.array([v], Real) for k, v in values.items()})[0]

    def batch(self, values: Mapping[str, Array]) -> Array:
        """Values at several points."""
        n = max((len(v) for v in values.values()), default=1)
        with np.errstate(all="ignore"):
            return self._at(self.tree, Points(n, dict(values)), 0)

    # -- evaluation -----------------------------------------------------------------------------------------------------

    def _at(self, node: Term, at: Points, depth: int) -> Array:
        match node.op:
            case "number":
                return np.full(at.n, Real(node.data))
            case "variable" | "parameter":
                return at.values[node.data]
            case "integral":
                return self._integral(node, at, depth)
            case "where":
                c = self._at(node.parts[0], at, depth)
                return np.where(c, self._at(node.parts[1], at, depth), self._at(node.parts[2], at, depth))
            case "<" | "<=" | ">" | ">=":  # beside a singularity the sides may be equal to rounding, their difference is known
                gap = self._at(node.parts[0] - node.parts[1], at, depth)
                return result_of(node, (gap, np.zeros_like(gap)))
            case "-":
                gap = _exact_gap(node, at, lambda p: self._at(p, at, depth))
                if gap is not None:
                    return gap
        return result_of(node, [self._at(p, at, depth) for p in node.parts])

    def _integral(self, node: Term, at: Points, depth: int) -> Array:
        lo, hi = (self._at(p, at, depth) for p in node.parts[1:])
        width = max(1, CHUNK // (64 * 4 ** min(2, depth_of(node.parts[0]))))
        result = np.zeros(at.n, Real)
        for start in range(0, at.n, width):
            rows = np.arange(start, min(at.n, start + width))
            result[rows] = self._integrals(node, at.take(rows), lo[rows], hi[rows], depth)
        return result

    def _integrals(self, node: Term, at: Points, lo: Array, hi: Array, depth: int) -> Array:
        sign = np.where(hi < lo, Real(-1), Real(1))
        lo, hi = np.minimum(lo, hi), np.maximum(lo, hi)
        rows, left, right = self._pieces(node, at, lo, hi, depth)
        near, from_left, weights = self.rules[depth == self.depth - 1]
        result = np.zeros(at.n, Real)
        if not len(rows):
            return result
        k = len(near)
        self.spent += len(rows) * k
        if self.spent > self.resolution.points:
            raise NoReferenceError("too many points")
        length = right - left
        offset = np.where(from_left[None, :], length[:, None] * near[None, :], -length[:, None] * near[None, :])
        anchor = np.where(from_left[None, :], left[:, None], right[:, None])
        points = at.take(np.repeat(rows, k)).with_variable(
            node.data, (anchor + offset).ravel(), (np.broadcast_to(anchor, offset.shape).ravel(), offset.ravel())
        )
        f = self._at(node.parts[0], points, depth + 1).reshape(len(rows), k)
        np.add.at(result, rows, (f * weights[None, :]).sum(axis=1) * length)
        return result * sign

    # -- cuts -----------------------------------------------------------------------------------------------------------

    def _pieces(self, node: Term, at: Points, lo: Array, hi: Array, depth: int) -> tuple[Array, Array, Array]:
        """Rows, left and right ends of the pieces of an integral at every point."""
        row, place, *_ = self._cuts(node, at, lo, hi, depth)
        rows = np.concatenate([np.arange(at.n), np.arange(at.n), row])
        places = np.concatenate([lo, hi, place])
        order = np.lexsort((places, rows))
        rows, places = rows[order], places[order]
        piece = (rows[1:] == rows[:-1]) & (places[1:] > places[:-1])
        return rows[:-1][piece], places[:-1][piece], places[1:][piece]

    def _cuts(self, node: Term, at: Points, lo: Array, hi: Array, depth: int) -> tuple[Array, Array, Array, Array]:
        """Cuts of an integral: rows, places, and which switch each is of; and for every point the state at its lower bound."""
        body, var = node.parts[0], node.data
        if node not in self.switches:
            self.switches[node] = switches_in(body, var)
        found: list[tuple[Array, Array, Array]] = []
        starts = np.zeros(at.n, np.uint64)
        samples = self._samples(at, lo, hi, depth)
        for number, (kind, switch) in enumerate(self.switches[node]):
            if kind == "cuts":
                row, place, start = self._changes(switch, var, at, samples, depth)
            else:
                row, place, start = self._roots(switch, var, at, samples, depth)
            found.append((row, place, np.full(len(row), number + 1)))
            with np.errstate(over="ignore"):
                starts = starts * np.uint64(0x100000001B3) + start
        if not found:
            return np.zeros(0, int), np.zeros(0, Real), np.zeros(0, int), starts
        rows, places, numbers = (np.concatenate(c) for c in zip(*found, strict=True))
        order = np.lexsort((numbers, places, rows))
        return rows[order], places[order], numbers[order], starts

    def _samples(self, at: Points, lo: Array, hi: Array, depth: int) -> Array:
        """Places where switches are looked at, for every point: (n, m), rising."""
        n = self.resolution.samples
        u = (np.arange(n).astype(Real) + Real(0.5) + Real(0.2) * np.sin(np.arange(n).astype(Real) * 7)) / n
        ends = Real(10.0) ** np.linspace(-14, -2.2, 14).astype(Real)
        grid = np.concatenate([np.zeros(1, Real), ends, u, 1 - ends, np.ones(1, Real)])
        places = lo[:, None] + (hi - lo)[:, None] * grid[None, :]
        places[:, -1] = hi
        if depth < self.depth - 1 or self.depth == 1:
            places = np.concatenate([places, self._candidates(at, lo, hi)], axis=1)
        return np.sort(places, axis=1)

    def _candidates(self, at: Points, lo: Array, hi: Array) -> Array:
        """Literals and parameters, and their neighbours, as places that are worth a look."""
        numbers = [*self.literals, *(abs(float(v[0])) for k, v in at.values.items() if k in self.names)]
        numbers = sorted(set(numbers))[:16]
        numbers += [-v for v in numbers]
        near = [Real(10) ** -k * s for k in range(1, 8) for s in (-1, 1)]
        extra = [np.zeros(1, Real)[0], *(e * Real(self.size) for e in near)]
        extra += [Real(v) * (1 + Real(e)) for v in numbers for e in (-1e-3, 1e-3)]
        extra += [Real(a) + Real(b) * Real(0.999) for a in numbers for b in numbers if abs(b) <= abs(a)][:60]
        columns = np.broadcast_to(np.array(extra, Real)[None, :], (at.n, len(extra)))
        return np.clip(columns, lo[:, None], hi[:, None])

    def _roots(self, switch: Term, var: str, at: Points, samples: Array, depth: int) -> tuple[Array, Array, Array]:
        """Roots of a function of one variable at every point."""
        n, m = samples.shape

        def g(rows: Array, places: Array) -> Array:
            return self._at(switch, at.take(rows).with_variable(var, places), depth + 1)

        rows = np.repeat(np.arange(n), m)
        values = g(rows, samples.ravel()).reshape(n, m)
        i, left, right, low, high = _dips(values, samples, g)
        change = (np.sign(values[:, 1:]) != np.sign(values[:, :-1])) & ~np.isnan(values[:, 1:]) & ~np.isnan(values[:, :-1])
        r, c = np.nonzero(change)
        i = np.concatenate([r, i])
        left, right = np.concatenate([samples[r, c], left]), np.concatenate([samples[r, c + 1], right])
        low, high = np.concatenate([values[r, c], low]), np.concatenate([values[r, c + 1], high])
        largest = np.nanmax(np.abs(values), axis=1, initial=0.0)
        start = np.where(np.abs(values[:, 0]) > 1e-16 * largest, np.sign(values[:, 0]), Real(0)) + 2
        return i, _bisected(g, i, left, right, low, high), np.nan_to_num(start, nan=7.0).astype(np.uint64)

    def _changes(self, inner: Term, var: str, at: Points, samples: Array, depth: int) -> tuple[Array, Array, Array]:
        """Where the cuts of an integral inside change their number or order."""
        n, m = samples.shape

        def signature(rows: Array, places: Array) -> Array:
            points = at.take(rows).with_variable(var, places)
            return self._signature(inner, points, depth + 1)

        values = signature(np.repeat(np.arange(n), m), samples.ravel()).reshape(n, m)
        r, c = np.nonzero(values[:, 1:] != values[:, :-1])
        left, right = samples[r, c], samples[r, c + 1]
        first, last = values[r, c], values[r, c + 1]
        rows, places = [np.zeros(0, int)], [np.zeros(0, Real)]
        for _ in range(6):  # several changes may lie between two samples: the first one, then what is left
            if not len(r):
                break
            a, b = left, right
            grid, many, lanes = np.arange(1, SECTIONS).astype(Real) / SECTIONS, np.repeat(r, SECTIONS - 1), np.arange(len(r))
            for _ in range(SIGNATURES):
                inside = a[:, None] + (b - a)[:, None] * grid[None, :]
                other = signature(many, inside.ravel()).reshape(inside.shape) != first[:, None]
                k = np.where(other.any(axis=1), np.argmax(other, axis=1), SECTIONS - 1)
                a, b = (
                    np.where(k > 0, inside[lanes, k - 1], a),
                    np.where(k < SECTIONS - 1, inside[lanes, np.minimum(k, SECTIONS - 2)], b),
                )
            rows.append(r)
            places.append(b)
            now = signature(r, b)
            more = (now != last) & (b < right)
            r, left, right, first, last = r[more], b[more], right[more], now[more], last[more]
        return np.concatenate(rows), np.concatenate(places), values[:, 0]

    def _signature(self, inner: Term, at: Points, depth: int) -> Array:
        """A number that says which cuts an integral has, in which order."""
        result = np.zeros(at.n, np.uint64)
        width = max(1, CHUNK // 256)
        for start in range(0, at.n, width):
            piece = at.take(np.arange(start, min(at.n, start + width)))
            lo, hi = (self._at(p, piece, depth) for p in inner.parts[1:])
            self.spent += piece.n * 4
            if self.spent > self.resolution.points:
                raise NoReferenceError("too many points")
            result[start : start + width] = self._order(inner, piece, lo, hi, depth)
        return result

    def _order(self, inner: Term, at: Points, lo: Array, hi: Array, depth: int) -> Array:
        swapped = hi < lo
        lo, hi = np.minimum(lo, hi), np.maximum(lo, hi)
        rows, places, numbers, starts = self._cuts(inner, at, lo, hi, depth)
        size = np.maximum(np.abs(lo), np.abs(hi)) + (hi - lo)
        inside = (places > lo[rows]) & (places < hi[rows])
        rows, places, numbers = rows[inside], places[inside], numbers[inside]
        result = np.where(swapped, np.uint64(17), np.uint64(3)) + starts * np.uint64(0xD6E8FEB86659FD93)
        if len(rows):
            near = np.zeros(len(rows), bool)
            near[1:] = (rows[1:] == rows[:-1]) & (places[1:] - places[:-1] <= 1e-14 * size[rows[1:]])
            cluster = np.cumsum(~near) - 1
            head = rows[~near]
            with np.errstate(over="ignore"):
                weights = (np.uint64(0x9E3779B97F4A7C15) * (numbers.astype(np.uint64) + np.uint64(5))) >> np.uint64(7)
                sums = np.zeros(len(head), np.uint64)
                np.add.at(sums, cluster, weights)
                first = np.searchsorted(head, head)
                position = (np.arange(len(head)) - first).astype(np.uint64)
                mixed = (sums ^ (sums >> np.uint64(29))) * (position * np.uint64(2) + np.uint64(0x632BE59BD9B4E019))
                np.add.at(result, head, mixed)
        return result


def _dips(values: Array, samples: Array, g: Any) -> tuple[Array, Array, Array, Array, Array]:
    """Pairs of roots between neighbours of one sign: rows, ends and values of brackets; found where |g| has a least value among samples
    and falls through 0 between its neighbours."""
    size = np.abs(values)
    s = np.sign(values)
    middle = (s[:, 1:-1] == s[:, :-2]) & (s[:, 1:-1] == s[:, 2:]) & (size[:, 1:-1] <= size[:, :-2]) & (size[:, 1:-1] <= size[:, 2:])
    middle &= (size[:, 1:-1] < size[:, :-2]) | (size[:, 1:-1] < size[:, 2:])
    middle &= s[:, 1:-1] != 0
    r, c = np.nonzero(middle)
    if not len(r):
        none = np.zeros(0, Real)
        return r, none, none, none, none
    a, b = samples[r, c], samples[r, c + 2]
    left, right, sign = a, b, s[r, c + 1]
    best, least = samples[r, c + 1], size[r, c + 1]
    grid, rows, lanes = np.arange(1, SECTIONS).astype(Real) / SECTIONS, np.repeat(r, SECTIONS - 1), np.arange(len(r))
    for _ in range(DIPS):
        if not (least > 0).any():
            break
        places = a[:, None] + (b - a)[:, None] * grid[None, :]
        heights = (np.repeat(sign, SECTIONS - 1) * g(rows, places.ravel())).reshape(places.shape)
        k = np.argmin(np.where(np.isnan(heights), np.inf, heights), axis=1)
        better = heights[lanes, k] < least
        best, least = np.where(better, places[lanes, k], best), np.where(better, heights[lanes, k], least)
        a, b = np.where(k > 0, places[lanes, k - 1], a), np.where(k < SECTIONS - 2, places[lanes, (k + 1) % (SECTIONS - 1)], b)
    through = least < 0
    r, left, right, best, sign, least = (v[through] for v in (r, left, right, best, sign, least))
    rows = np.concatenate([r, r])
    return (
        rows,
        np.concatenate([left, best]),
        np.concatenate([best, right]),
        np.concatenate([sign, sign * least]),
        np.concatenate([sign * least, sign]),
    )


def _bisected(g: Any, rows: Array, left: Array, right: Array, low: Array, high: Array) -> Array:
    """Roots in brackets, by sections that are even at first and then chosen by interpolation (Chandrupatla 1997)."""
    if not len(rows):
        return np.zeros(0, Real)
    b, a, fb, fa = left, right, low, high
    c, fc = a, fa
    t = np.full(len(rows), Real(0.5))
    for _ in range(HALVINGS):  # quotients may be 0/0 where a lane is done
        x = a + t * (b - a)
        fx = g(rows, x)
        fx = np.where(np.isnan(fx), fa, fx)
        same = np.sign(fx) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        closer = np.abs(fa) < np.abs(fb)
        best = np.where(closer, a, b)
        limit = EPS * np.abs(best) / np.abs(b - c)
        if ((limit > 0.5) | (fa == 0) | (fb == 0) | (b == c)).all():
            break
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        inverse = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        quadratic = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        t = np.where(inverse & np.isfinite(quadratic), quadratic, Real(0.5))
        t = np.clip(t, np.minimum(limit, 0.5), 1 - np.minimum(limit, 0.5))
    return np.where(low == 0, left, np.where(high == 0, right, np.where(np.abs(fa) < np.abs(fb), a, b)))


def _exact_gap(node: Term, at: Points, value: Any) -> Array | None:
    """u - v where one of the two is a variable that is known as anchor + offset: nothing cancels near the anchor."""
    first, second = node.parts
    for k, (one, other) in enumerate(((first, second), (second, first))):
        if one.op == "variable" and one.data in at.anchors and not has(other, one.data):
            anchor, offset = at.anchors[one.data]
            c = value(other)
            gap = anchor - c
            gap = np.where(np.abs(gap) <= 8 * EPS * (np.abs(anchor) + np.abs(c)), Real(0), gap) + offset
            return gap if k == 0 else -gap
    return None
