"""Integrals to any number of digits, without this project's compiler. The stored reference values are computed with it.

The conditions of a body are found by evaluating it with numbers that record their comparisons. Polynomial conditions are interpolated;
resultants of pairs, discriminants and values at the bounds, again polynomials in the outer variable by interpolation (determinants of
Sylvester matrices), give the outer breaks, roots of the conditions the inner ones (cylindrical algebraic decomposition, Collins 1975).
Between breaks Gauss-Legendre or tanh-sinh rules of mpmath. Slow: seconds an integral.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import combinations, pairwise
from types import SimpleNamespace
from typing import Any

from mpmath import mp

from teg.examples.charts.problem import Problem, bound_at

Polynomial = list[Any]  # coefficients, lowest first
LARGEST_DEGREE = 30
SCAN = 4000


class Recorder:
    """A number that records its comparisons with others, as the difference of both sides."""

    def __init__(self, value: Any, notes: list[Any]) -> None:
        self.value, self.notes = mp.mpf(value) if not isinstance(value, mp.mpf) else value, notes

    def _other(self, other: Any) -> Any:
        return other.value if isinstance(other, Recorder) else other

    def _compared(self, difference: Any) -> bool:
        self.notes.append(difference)
        return bool(difference > 0)

    def __add__(self, other: Any) -> Recorder:
        return Recorder(self.value + self._other(other), self.notes)

    def __sub__(self, other: Any) -> Recorder:
        return Recorder(self.value - self._other(other), self.notes)

    def __rsub__(self, other: Any) -> Recorder:
        return Recorder(self._other(other) - self.value, self.notes)

    def __mul__(self, other: Any) -> Recorder:
        return Recorder(self.value * self._other(other), self.notes)

    def __truediv__(self, other: Any) -> Recorder:
        return Recorder(self.value / self._other(other), self.notes)

    def __rtruediv__(self, other: Any) -> Recorder:
        return Recorder(self._other(other) / self.value, self.notes)

    def __pow__(self, power: int) -> Recorder:
        return Recorder(self.value**power, self.notes)

    def __neg__(self) -> Recorder:
        return Recorder(-self.value, self.notes)

    __radd__, __rmul__ = __add__, __mul__

    def __lt__(self, other: Any) -> bool:
        return self._compared(self._other(other) - self.value)

    def __gt__(self, other: Any) -> bool:
        return self._compared(self.value - self._other(other))

    def __le__(self, other: Any) -> bool:
        return self.__lt__(other)

    def __ge__(self, other: Any) -> bool:
        return self.__gt__(other)


def _function(name: str) -> Callable[[Any], Any]:
    f = getattr(mp, name)
    return lambda x: Recorder(f(x.value), x.notes) if isinstance(x, Recorder) else f(x)


def _where_positive(name: str) -> Callable[[Any], Any]:
    f = _function(name)
    return lambda x: Recorder(mp.nan, x.notes) if isinstance(x, Recorder) and x.value < 0 else f(x)


def _floor(x: Recorder) -> Recorder:
    x.notes.append(mp.sinpi(x.value))  # changes its sign at every step
    return Recorder(mp.floor(x.value), x.notes)


def _where(c: bool, a: Any, b: Any) -> Any:
    return a if c else b


EXACT = SimpleNamespace(
    **{name: _function(name) for name in ["sin", "cos", "exp"]},
    sqrt=_where_positive("sqrt"),
    log=_where_positive("log"),
    floor=_floor,
    where=_where,
    bracket=lambda c: mp.mpf(1) if c else mp.mpf(0),
    abs=lambda x: _where(x > 0, x, -x),
    minimum=lambda a, b: _where(a < b, a, b),
    maximum=lambda a, b: _where(a > b, a, b),
)


def evaluate(problem: Problem, parameters: Mapping[str, Any], point: Sequence[Any]) -> tuple[Any, list[Any]]:
    """Returns the body at a point, innermost variable first, and the differences whose signs its conditions are."""
    notes: list[Any] = []
    value = problem.body(EXACT, *(Recorder(x, notes) for x in point), **parameters)
    return (value.value if isinstance(value, Recorder) else mp.mpf(value)), notes


# -- polynomials -------------------------------------------------------------------------------------------------------


def interpolate(f: Callable[[Any], Any], degree: int) -> Polynomial | None:
    """Returns the polynomial f of at most that degree, or None. Highest coefficients that are rounding errors are dropped."""
    nodes = [mp.cos(mp.pi * (2 * k + 1) / (2 * degree + 2)) for k in range(degree + 1)]
    values = [f(x) for x in nodes]
    # Chebyshev coefficients by the discrete cosine sum, then the three-term recurrence
    n = degree + 1
    series = [(2 if j else 1) * mp.fsum(v * mp.cos(j * mp.pi * (2 * k + 1) / (2 * n)) for k, v in enumerate(values)) / n for j in range(n)]
    before, now, total = [mp.mpf(1)], [mp.mpf(0), mp.mpf(1)], [series[0]]
    for c in series[1:]:
        total = _plus(total, [c * a for a in now])
        before, now = now, _plus([mp.mpf(0)] + [2 * a for a in now], [-a for a in before])
    size = max(map(abs, total))
    at = mp.mpf("0.7310585786300049")
    if abs(f(at) - mp.polyval(total[::-1], at)) > size * _rounding():
        return None
    return _trimmed(total, size)


def _plus(a: Polynomial, b: Polynomial) -> Polynomial:
    return [(a[i] if i < len(a) else 0) + (b[i] if i < len(b) else 0) for i in range(max(len(a), len(b)))]


def _trimmed(p: Polynomial, size: Any) -> Polynomial:
    while p and abs(p[-1]) <= size * _rounding():
        p = p[:-1]
    return p


def _rounding() -> Any:
    """Returns the rounding error of numbers of size 1."""
    return mp.mpf(10) ** (-mp.dps * 9 // 10)


def real_roots(p: Polynomial, lo: Any, hi: Any, double: bool) -> list[Any]:
    """Returns the roots in [lo, hi], ascending: p is monotone between the roots of its derivative. `double`: also where p touches 0."""
    size = mp.fsum(abs(c) * max(abs(lo), abs(hi), 1) ** i for i, c in enumerate(p))
    p = _trimmed(p, size)
    if len(p) <= 1:
        return []
    if len(p) == 2:
        return [r for r in [-p[0] / p[1]] if lo <= r <= hi]
    if len(p) == 3:
        c, b, a = p
        inside = b * b - 4 * a * c
        if inside < (-(size**2) * _rounding() if double else 0):
            return []
        q = -(b + (1 if b >= 0 else -1) * mp.sqrt(max(inside, 0))) / 2
        return sorted(r for r in {q / a, c / q if q else mp.mpf(0)} if lo <= r <= hi)
    slope = [i * c for i, c in enumerate(p)][1:]
    turns = real_roots(slope, lo, hi, double=True)
    roots = [c for c in turns if double and abs(mp.polyval(p[::-1], c)) <= size * _rounding()]
    for a, b in pairwise([lo, *turns, hi]):
        u, v = (mp.polyval(p[::-1], x) for x in (a, b))
        if a not in roots and b not in roots and u * v <= 0:
            roots.append(_bracketed(p, slope, a, b, u))
    return sorted(roots)


def _bracketed(p: Polynomial, slope: Polynomial, a: Any, b: Any, at_a: Any) -> Any:
    """Returns the root between a and b, by Newton's method, halving where that leaves the interval."""
    x, least = (a + b) / 2, (b - a) * mp.eps
    for _ in range(20 * mp.dps):
        value = mp.polyval(p[::-1], x)
        if value * at_a > 0:
            a = x
        else:
            b = x
        steep = mp.polyval(slope[::-1], x)
        newton = x - value / steep if steep else a
        following = newton if a < newton < b else (a + b) / 2
        if abs(following - x) <= least + abs(x) * mp.eps:
            return following
        x = following
    return x


def resultant_at(f: Polynomial, g: Polynomial) -> Any:
    """Returns the resultant of two polynomials, by the determinant of their Sylvester matrix."""
    m, n = len(f) - 1, len(g) - 1
    if m < 1 or n < 1:
        return mp.mpf(1)
    rows = mp.zeros(m + n)
    for i in range(n):
        for j, a in enumerate(reversed(f)):
            rows[i, i + j] = a
    for i in range(m):
        for j, a in enumerate(reversed(g)):
            rows[n + i, i + j] = a
    return mp.det(rows)


# -- integrals ---------------------------------------------------------------------------------------------------------


def conditions(problem: Problem, parameters: Mapping[str, Any], outer: Sequence[Any], degree: int) -> list[Polynomial] | None:
    """Returns the conditions as polynomials in the innermost variable, the others being fixed; None if one is not a polynomial."""
    count = len(evaluate(problem, parameters, [mp.mpf("0.37"), *outer])[1])
    polynomials = [interpolate(partial(_condition, problem, parameters, outer, k), degree) for k in range(count)]
    return None if None in polynomials else [p for p in polynomials if p is not None]


def _condition(problem: Problem, parameters: Mapping[str, Any], outer: Sequence[Any], k: int, x: Any) -> Any:
    return evaluate(problem, parameters, [x, *outer])[1][k]


def inner_breaks(problem: Problem, parameters: Mapping[str, Any], outer: Sequence[Any], degree: int) -> list[Any]:
    """Returns the bounds of the innermost integral and the roots of conditions between them, ascending."""
    lo, hi = (mp.mpf(bound_at(b, EXACT, outer, parameters)) for b in problem.bounds[0])
    lo, hi = min(lo, hi), max(lo, hi)
    polynomials = conditions(problem, parameters, outer, degree)
    if polynomials is None:
        roots = _scanned_roots(problem, parameters, outer, lo, hi)
    else:
        roots = [r for p in polynomials for r in real_roots(p, lo, hi, double=False)]
    return sorted({lo, hi, *(r for r in roots if lo < r < hi)})


def _scanned_roots(problem: Problem, parameters: Mapping[str, Any], outer: Sequence[Any], lo: Any, hi: Any) -> list[Any]:
    grid = [lo + (hi - lo) * k / SCAN for k in range(SCAN + 1)]
    notes = [evaluate(problem, parameters, [x, *outer])[1] for x in grid]
    roots = []
    for (a, left), (b, right) in pairwise(zip(grid, notes, strict=True)):
        for k, (u, v) in enumerate(zip(left, right, strict=True)):
            if u * v < 0:
                roots.append(mp.findroot(partial(_condition, problem, parameters, outer, k), (a, b), solver="anderson"))
    return roots


def inner_integral(problem: Problem, parameters: Mapping[str, Any], outer: Sequence[Any], degree: int) -> Any:
    lo, hi = (mp.mpf(bound_at(b, EXACT, outer, parameters)) for b in problem.bounds[0])
    points = inner_breaks(problem, parameters, outer, degree)

    def body(x: Any) -> Any:
        return evaluate(problem, parameters, [x, *outer])[0]

    return (1 if lo <= hi else -1) * mp.fsum(mp.quad(body, [a, b]) for a, b in pairwise(points))


def outer_breaks(problem: Problem, parameters: Mapping[str, Any], degree: int) -> list[Any]:
    """Returns the outer bounds and the places where the roots of a problem in two variables with polynomial conditions change their order.

    Multiple roots lose digits; they are computed with four times as many.
    """
    with mp.workdps(4 * mp.dps):
        return _outer_breaks(problem, parameters, degree)


def _outer_breaks(problem: Problem, parameters: Mapping[str, Any], degree: int) -> list[Any]:
    lo, hi = (mp.mpf(bound_at(b, EXACT, (), parameters)) for b in problem.bounds[1])
    lo, hi = min(lo, hi), max(lo, hi)
    middle = (lo + hi) / 2

    def bound(k: int, y: Any) -> Any:
        return mp.mpf(bound_at(problem.bounds[0][k], EXACT, (y,), parameters))

    def atoms_at(y: Any) -> list[Polynomial]:
        polynomials = conditions(problem, parameters, [y], degree)
        assert polynomials is not None, "a condition is not a polynomial"
        return polynomials

    degrees = [max(len(p) for p in column) for column in zip(*(atoms_at(lo + (hi - lo) * k / 7) for k in range(1, 7)), strict=True)]

    def padded(y: Any) -> list[Polynomial]:
        return [(p + [mp.mpf(0)] * n)[:n] for p, n in zip(atoms_at(y), degrees, strict=True)]

    def at_bound(k: int, side: int, y: Any) -> Any:
        return evaluate(problem, parameters, [bound(side, y), y])[1][k]

    def leading(k: int, y: Any) -> Any:
        return padded(y)[k][-1]

    def discriminant(k: int, y: Any) -> Any:
        p = padded(y)[k]
        return resultant_at(p, [j * c for j, c in enumerate(p)][1:])

    def resultant(i: int, j: int, y: Any) -> Any:
        p = padded(y)
        return resultant_at(p[i], p[j])

    functions: list[Callable[[Any], Any]] = [lambda y: bound(0, y) - bound(1, y)]
    for k, n in enumerate(degrees):
        functions += [partial(at_bound, k, 0), partial(at_bound, k, 1)]
        functions += [partial(leading, k)] * (n > 0) + [partial(discriminant, k)] * (n > 2)
    functions += [partial(resultant, i, j) for i, j in combinations(range(len(degrees)), 2)]
    breaks = {lo, hi}
    half = (hi - lo) / 2
    for f in functions:
        p = interpolate(partial(_scaled, f, middle, half), LARGEST_DEGREE)
        if p is not None:
            breaks |= {middle + half * r for r in real_roots(p, mp.mpf(-1), mp.mpf(1), double=True) if -1 < r < 1}
    return _merged(sorted(breaks))


def _scaled(f: Callable[[Any], Any], middle: Any, half: Any, s: Any) -> Any:
    return f(middle + half * s)


def _merged(points: list[Any]) -> list[Any]:
    """Returns the points without repetitions up to rounding (multiple roots)."""
    least = (points[-1] - points[0]) * mp.mpf(10) ** (-mp.dps // 4)
    kept = points[:1]
    for p in points[1:-1]:
        if p - kept[-1] > least and points[-1] - p > least:
            kept.append(p)
    return [*kept, points[-1]]


def integrate(problem: Problem, parameters: Mapping[str, Any], degree: int = 4) -> Any:
    """Returns the value, in one or two variables; `degree` bounds that of the conditions in the inner variable."""
    if problem.dimension == 1:
        return inner_integral(problem, parameters, (), degree)
    lo, hi = (mp.mpf(bound_at(b, EXACT, (), parameters)) for b in problem.bounds[1])
    points = outer_breaks(problem, parameters, degree)
    whole = mp.fsum(mp.quad(lambda y: inner_integral(problem, parameters, (y,), degree), [a, b]) for a, b in pairwise(points))
    return whole if lo <= hi else -whole
