"""A scheduled program run statement by statement, and what it did written down: the pieces of its integrals, and the points it looked at.

This is `teg.program` read literally, one number at a time; the printed programs do the same, faster. What is not known here, a statement,
a part of one, a rule or an operation, raises NotImplementedError.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from itertools import pairwise
from typing import Any, cast

import numpy as np

from teg.backends.numpy import adaptive, isolate, lanes, locate
from teg.backends.numpy import runtime as numpy_runtime
from teg.backends.numpy.arrays import NUMPY, places_of
from teg.backends.shared.bends import Bends, Substitution, substitution
from teg.backends.shared.error_function import erf, erfc
from teg.backends.shared.poles import pole_weights
from teg.numerics.quadrature import gauss_legendre
from teg.program import (
    ABSOLUTE_FLOOR,
    INSIDE,
    MAX_DEPTH,
    MAX_INTERVALS,
    PIECE_EPS,
    ROUNDING,
    TIE_EPS,
    WATCH_WIDTH,
    Adaptive,
    Assign,
    Bend,
    Gauss,
    Integrate,
    Isolate,
    Locate,
    Program,
    Rational,
    Stmt,
    SumOver,
    assigned,
    statements,
)  # fmt: skip

SHIFT = 64.0
"""The mark of a point (x, y) in an integrand is atan2(y + SHIFT, x + SHIFT)."""
Values = dict[str, Any]

KNOWN: dict[type, frozenset[str]] = {
    kind: frozenset(names.split())
    for kind, names in (
        (Assign, "name op args"),
        (Integrate, "var lo hi breaks flags need body values results rule when watch bends base ends"),
        (Isolate, "var lo hi left right enclosure bounds point value slope results when curving noise curvature tol width"),
        (Locate, "lo hi low high left right bottom top enclosure bounds results when lost"),
        (SumOver, "var points body values results when"),
        (Gauss, "nodes"),
        (Rational, "nodes power"),
        (Bend, "kind coefficients when"),
        (Adaptive, "tol first order cubic"),
    )
}
"""The statements and rules that a recorded run knows, and their parts."""


@dataclass
class Piece:
    """One piece (p, q) of an integral, the values of the variables outside, and its nodes; none if it was skipped."""

    around: tuple[float, ...]
    p: float
    q: float
    nodes: list[float] = field(default_factory=list)


@dataclass
class Mark:
    """A point of the plane that an integrand was evaluated at, with the variables of the integrals around, the innermost one last, and what
    multiplies the integrand there."""

    around: tuple[float, ...]
    x: float
    y: float
    weight: float


class RecordedRun:
    """One run, for numbers; `outputs`, `pieces` and `marks` are what came of it."""

    def __init__(self, program: Program, parameters: Mapping[str, float]) -> None:
        self.pieces: list[Piece] = []
        self.marks: list[Mark] = []
        self._marked: dict[str, tuple[Mark, float]] = {}
        self._around: list[float] = []
        names: Values = {f"p{i}": np.float64(parameters[p]) for i, p in enumerate(program.parameters)}
        with np.errstate(all="ignore"):
            self._run(program.body, names)
        self.outputs = [float(_get(names, a)) for a in program.outputs]

    # -- statements ----------------------------------------------------------------------------------------------------

    def _run(self, block: Sequence[Stmt], names: Values) -> None:
        for stmt in block:
            _check(stmt)
            if isinstance(stmt, Assign):
                names[stmt.name] = _operation(stmt, names)
                self._mark(stmt, names)
            elif stmt.when is not None and not names[stmt.when]:
                names.update(dict.fromkeys(assigned(stmt), np.float64(0.0)))
                if isinstance(stmt, Isolate | Locate):
                    names.update(dict.fromkeys(stmt.results, np.float64(np.inf)))
            else:
                names.update(zip(assigned(stmt), self._results(stmt, names), strict=True))

    def _results(self, stmt: Integrate | Isolate | Locate | SumOver, names: Values) -> Sequence[Any]:
        match stmt:
            case Integrate():
                return list(self._integrate(stmt, names))
            case Isolate():
                return self._isolate(stmt, names)
            case Locate():
                return self._locate(stmt, names)
            case SumOver():
                return list(self._sum(stmt, names))
            case _:
                raise NotImplementedError(f"a recorded run does not know {type(stmt).__name__}")

    def _sum(self, stmt: SumOver, names: Values) -> np.ndarray:
        total = np.zeros(len(stmt.values))
        points = [_get(names, p) for p in stmt.points]
        if np.isnan(points).any():
            return total * np.nan
        for point in points:
            if np.isfinite(point):
                inner = {**names, stmt.var: point}
                self._run(stmt.body, inner)
                total += [_get(inner, v) for v in stmt.values]
        return total

    def _isolate(self, stmt: Isolate, names: Values) -> tuple[Any, ...]:
        def enclosure(_: object, p: Any, q: Any) -> tuple[Any, ...]:
            inner = {**names, stmt.left: p, stmt.right: q}
            self._run(stmt.enclosure, inner)
            return tuple(np.broadcast_to(_get(inner, b), p.shape) for b in (*stmt.bounds, *stmt.curving, stmt.noise))

        def point(_: object, v: Any) -> tuple[Any, ...]:
            inner = {**names, stmt.var: v}
            self._run(stmt.point, inner)
            return tuple(np.broadcast_to(_get(inner, b), v.shape) for b in (stmt.value, stmt.slope, stmt.curvature))

        blocks = lanes.Sized(enclosure, 7, 1), lanes.Sized(point, 3, 1)
        search = isolate.Isolation(*blocks, len(stmt.results), False, stmt.tol, stmt.width)
        return search(lanes.Run(1, 2**20), (_get(names, stmt.lo), _get(names, stmt.hi)), (), ())

    def _locate(self, stmt: Locate, names: Values) -> list[Any]:
        def enclosure(_run: object, left: Any, right: Any, bottom: Any, top: Any) -> tuple[Any, ...]:
            inner = {**names, stmt.left: left, stmt.right: right, stmt.bottom: bottom, stmt.top: top}
            self._run(stmt.enclosure, inner)
            return tuple(np.broadcast_to(_get(inner, b), left.shape) for b in stmt.bounds)

        search = locate.Location(lanes.Sized(enclosure, len(stmt.bounds), 1), len(stmt.results), stmt.lost is not None)
        limits = tuple(_get(names, e) for e in (stmt.lo, stmt.hi, stmt.low, stmt.high))
        return list(search(lanes.Run(1, 2**20), limits, ()))

    # -- integrals -----------------------------------------------------------------------------------------------------

    def _integrate(self, stmt: Integrate, names: Values) -> np.ndarray:
        lo, hi = (float(_get(names, b)) for b in (stmt.lo, stmt.hi))
        if lo != lo or hi != hi:
            return np.full(len(stmt.values), np.nan)
        a, b = min(lo, hi), max(lo, hi)
        breaks = [float(_get(names, r)) for r in stmt.breaks]
        ends = [a, *sorted(a if r != r else min(max(r, a), b) for r in breaks), b]
        total = np.zeros(len(stmt.values))
        for p, q in pairwise(ends):
            if q - p > PIECE_EPS * max(abs(p), abs(q)):
                total += self._piece(stmt, names, p, q)
        return total if lo <= hi else -total

    def _piece(self, stmt: Integrate, names: Values, p: float, q: float) -> np.ndarray:
        middle = {**names, stmt.var: np.float64(p + INSIDE * (q - p)), **dict(zip(stmt.ends, (p, q), strict=False))}
        self._run(stmt.flags, middle)
        piece = Piece(tuple(self._around), p, q)
        self.pieces.append(piece)
        if stmt.need is not None and not middle[stmt.need]:
            return np.zeros(len(stmt.values))

        def at(v: float) -> Values:
            inner = {**middle, stmt.var: np.float64(v)}
            self._around.append(v)
            self._run(stmt.body, inner)
            self._around.pop()
            return inner

        def values(v: float) -> list[float]:
            inner = at(v)
            return [float(_get(inner, name)) for name in stmt.values]

        _check(stmt.rule)
        match stmt.rule:
            case Gauss():
                xs, weights = gauss_legendre(stmt.rule.nodes)
                piece.nodes = [0.5 * (p + q) + 0.5 * (q - p) * x for x in xs]
                return 0.5 * (q - p) * np.array(weights) @ np.array([values(v) for v in piece.nodes])
            case Rational():
                piece.nodes = [0.5 * (p + q) + 0.5 * (q - p) * x for x in gauss_legendre(stmt.rule.nodes)[0]]
                weights = _rational_weights(stmt, stmt.rule, middle, p, q)
                return 0.5 * (q - p) * weights @ np.array([values(v) for v in piece.nodes])
            case Adaptive():
                return self._adaptive(stmt, stmt.rule, piece, self._places(stmt, stmt.rule, middle, p, q), at)
            case _:
                raise NotImplementedError(f"a recorded run does not know the rule {type(stmt.rule).__name__}")

    def _places(self, stmt: Integrate, rule: Adaptive, names: Values, p: float, q: float) -> Substitution:
        """Where on the piece the coordinate u in (0, 1) is."""
        bends = []
        for bend in stmt.bends:
            _check(bend)
            bends.append((bend.kind, *(_get(names, c) for c in bend.coefficients), _get(names, bend.when)))
        return substitution(NUMPY, (np.array([p]), np.array([q])), Bends(_get(names, stmt.base), bends), rule.cubic, None)

    def _adaptive(self, stmt: Integrate, rule: Adaptive, piece: Piece, places: Substitution, at: Any) -> np.ndarray:
        total, enough, used = np.zeros(len(stmt.values)), np.empty(0), 0
        waiting = [(0.0, 1.0, rule.order if stmt.watch else rule.first)]
        while waiting:
            left, width, nodes = waiting.pop(0)
            used += 1
            u = left + 0.5 * width * (1.0 + np.array(gauss_legendre(nodes)[0])[:, None])
            place, rate = (column[:, 0] for column in places_of(places, u))
            marks, runs = len(self.marks), [at(v) for v in place]
            found = np.array([[float(_get(r, v)) for v in stmt.values] for r in runs]) * (0.5 * width * rate)[:, None]
            whole, size, error = adaptive.measure(found, nodes)
            enough = enough if enough.size else rule.tol * (size + ABSOLUTE_FLOOR)
            seen = len(self.marks)
            ends = places_of(places, np.array([[left], [left + width]]))[0][:, 0] if stmt.watch else ()
            watched = [[bool(_get(r, w)) for w in stmt.watch] for r in (*runs, *map(at, ends))]
            del self.marks[seen:]
            changed = any(any(column) and not all(column) for column in zip(*watched, strict=True))
            fine = bool(np.all((error <= np.maximum(enough, ROUNDING * size)) | ~np.isfinite(error)))
            if (width <= WATCH_WIDTH if changed else fine) or used >= MAX_INTERVALS or width <= 2.0**-MAX_DEPTH:
                total += whole
                piece.nodes += list(place)
                continue
            del self.marks[marks:]
            if used == 1 and not stmt.watch:
                waiting.append((left, width, rule.order))
            else:
                waiting += [(left, 0.5 * width, rule.order), (left + 0.5 * width, 0.5 * width, rule.order)]
        return total

    # -- marks ---------------------------------------------------------------------------------------------------------

    def _mark(self, stmt: Assign, names: Values) -> None:
        """Follow the mark of a point through what it is multiplied by."""
        if stmt.op == "atan2":
            y, x = (_get(names, a) - SHIFT for a in stmt.args)
            if np.ndim(x) == 0 and np.ndim(y) == 0 and abs(x) < 0.5 * SHIFT and abs(y) < 0.5 * SHIFT:
                mark = Mark(tuple(self._around), float(x), float(y), 1.0)
                self.marks.append(mark)
                self._marked[stmt.name] = (mark, float(names[stmt.name]))
            return
        self._marked.pop(stmt.name, None)
        for a in stmt.args if stmt.op in ("mul", "div", "select", "neg") else ():
            if isinstance(a, str) and a in self._marked:
                mark, angle = self._marked[a]
                mark.weight = abs(float(names[stmt.name])) / angle
                self._marked[stmt.name] = (mark, angle)


def _rational_weights(stmt: Integrate, rule: Rational, names: Values, p: float, q: float) -> np.ndarray:
    """The weights of a rational integrand's nodes on a piece that does not meet its pole."""
    (bend,) = stmt.bends
    _check(bend)
    c0, c1, _ = (float(_get(names, c)) for c in bend.coefficients)
    low, high = (c0 + c1 * (end - float(_get(names, stmt.base))) for end in (p, q))
    if not bool(_get(names, bend.when)):
        return np.array(gauss_legendre(rule.nodes)[1])
    if not low * high > 0.0:
        raise NotImplementedError("a recorded run does not know a pole on a piece")
    return pole_weights(np, rule.nodes, rule.power, np.array([low]), np.array([high]))[:, 0]


def _check(part: object) -> None:
    """Raises NotImplementedError for a kind that is not known, or a known one that says more than it did."""
    if type(part) not in KNOWN:
        raise NotImplementedError(f"a recorded run does not know {type(part).__name__}")
    for f in fields(cast(Any, part)):
        default = f.default if f.default_factory is MISSING else f.default_factory()
        if f.name not in KNOWN[type(part)] and getattr(part, f.name) != default:
            raise NotImplementedError(f"a recorded run does not know {f.name} of {type(part).__name__}")


def _get(names: Values, a: Any) -> Any:
    return names[a] if isinstance(a, str) else np.float64(a) if isinstance(a, float) else a


def _operation(stmt: Assign, names: Values) -> Any:
    v = [_get(names, a) for a in stmt.args]
    match stmt.op:
        case "const":
            return v[0]
        case "add" | "mul" | "and" | "or":
            total = v[0]
            for u in v[1:]:
                total = _FOLDED[stmt.op](total, u)
            return total
        case "sub":
            return v[0] - v[1]
        case "div":
            return np.divide(v[0], v[1])
        case "neg":
            return -v[0]
        case "mod":
            return v[0] - v[1] * np.floor(v[0] / v[1])
        case "powi":
            return numpy_runtime.powi(np.asarray(v[0], dtype=np.float64)[()], v[1])
        case "gt0" | "ge0" | "lt0" | "le0":
            return _COMPARED[stmt.op](v[0], 0.0)
        case "ok":
            return v[0] == v[0]
        case "not":
            return np.logical_not(v[0])
        case "select":
            return np.where(v[0], v[1], v[2])[()]
        case "tie":
            g, scale, r, _ = v
            return np.where((np.abs(g) <= TIE_EPS * scale) & np.isfinite(g), r, g > 0.0)[()]
        case op if op in _FUNCTIONS:
            return _FUNCTIONS[op](*v)
        case op:
            raise NotImplementedError(f"a recorded run does not know the operation {op!r}")


_FOLDED = {"add": np.add, "mul": np.multiply, "and": np.logical_and, "or": np.logical_or}
_COMPARED = {"gt0": np.greater, "ge0": np.greater_equal, "lt0": np.less, "le0": np.less_equal}
_SAME = ("abs", "floor", "sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "expm1", "log", "log1p", "sqrt")
_FUNCTIONS = {op: getattr(np, op) for op in _SAME} | {
    "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "atan2": np.arctan2, "pow": np.power, "min": np.minimum, "max": np.maximum,
    "erf": lambda x: erf(NUMPY, x), "erfc": lambda x: erfc(NUMPY, x),
}  # fmt: skip


def integrals_of(program: Program) -> Iterator[Integrate]:
    """The integrals of a program, in the order of their numbers."""
    return (s for s in statements(program.body) if isinstance(s, Integrate))
