"""The flat, scheduled program that every backend receives.

    stmt ::= name = op(args…)                                              Assign: one scalar, float64 or boolean
           | results = ∫ v in (lo, breaks…, hi) by rule: flags; body       Integrate: pieces between breaks, nodes in a piece
           | results = roots of g in v in [lo, hi]                         Isolate: interval bisection, then Newton's method
           | results = places v where f = g = 0 in a rectangle            Locate: interval bisection; hints where to break
           | results = Σ v in points: body                                 SumOver: the roots found by an Isolate

A program is closed and free of δ. Every name is assigned exactly once in the whole program, and a statement uses only names of
its own block assigned earlier, of the enclosing blocks, or parameters. Floats are named 'v…', booleans 'b…', variables of
integration 'x…', parameters 'p…'; a `str` argument is a name, a `float`, `int` or `bool` argument is a literal.

Semantics of `Integrate` (the three printers share it to the letter):

    if `when` names a boolean that is false, every result is 0 and nothing below is evaluated
    if lo or hi is NaN every result is NaN
    s, a, b = +1, lo, hi  if lo <= hi  else  -1, hi, lo
    each break is clamped to [a, b] (a break that is NaN is absent: it is clamped to a); the breaks are sorted
    for neighbouring points p < q of a, breaks…, b with q - p > PIECE_EPS·max(|p|, |q|)        (thinner pieces are skipped)
        v := p + INSIDE·(q - p); run `flags`                              (everything constant on the open piece)
        skip the piece if `need` names a boolean that is false
        add to each value's sum its integral over (p, q) by `rule`, `body` being run at every node v
    results = s · sums

`Gauss(n)`: n-point Gauss-Legendre on each piece.

`Adaptive(tol, smooth)`: on each piece, in a coordinate u in (0, 1) with v = p + (q-p)·u, or v = p + (q-p)·u²(3-2u) if `smooth`
(which makes √-like behaviour at both ends of a piece analytic), the (10, 21) Gauss-Kronrod pair with bisection. On an interval
K, G and A are the Kronrod sum, the Gauss sum and the Kronrod sum of |value|; A₀ is A of the whole piece, before any bisection.
An interval is accepted if for every value  |K - G| <= max(tol·(A₀ + ABSOLUTE_FLOOR), ROUNDING·A), or |K - G| is not finite,
or it was bisected MAX_DEPTH times, or the piece has used MAX_INTERVALS intervals; else it is halved.

`watch` names booleans of `body` that may change where no break is known (rule Adaptive only; by Gauss it is ignored). On an interval
`body` is then also run at the two ends, whose v come from u like a node's; of these two runs only the watched booleans count, no value,
NaN or not, and no tie. If at the 23 points a watched boolean is not always the same, the error does not matter: the interval is halved,
unless it is at most WATCH_WIDTH wide in u, or MAX_DEPTH or MAX_INTERVALS was reached; then it is accepted, its K counts as any other.
An interval that will be halved anyway need not be evaluated further, but the first one is, for A₀.

Semantics of `Isolate`: g is a smooth function of `var`, given twice. The block `point` computes `value` = g and `slope` = g′ at `var`; the
block `enclosure` computes `bounds` = (g₋, g₊, d₋, d₊) with g₋ <= g <= g₊ and d₋ <= g′ <= d₊ for all v with left <= v <= right.

    if `when` names a boolean that is false, every result is +inf
    if lo or hi is NaN or infinite every result is NaN; if lo = hi every result is +inf; lo > hi are exchanged
    level 0 is the box (lo, hi). For each level 0, 1, …, ISOLATE_DEPTH, for each box (p, q) of it, with m = ½(p + q), h = ½(q - p):
        run `enclosure` at left := p, right := q; run `point` at m; g(p) and g(q) are known likewise
        the box is dropped if  d₋ = d₊ = 0:  g is constant there, and if it is 0 that is no isolated root
        the box *changes sign* if  g(p) <= 0 < g(q)  or  g(q) <= 0 < g(p); then it is kept, whatever rounded bounds say
        another box is dropped, for there is no root in it, if   g₋ > 0  or  g₊ < 0,
            or d₋ and d₊ are finite and  g(m) - h·max(|d₋|, |d₊|) > 0  or  g(m) + h·max(|d₋|, |d₊|) < 0     (mean value theorem),
            or g₋, g₊ and g(m) are all NaN                                                                     (g is not defined there)
        else if  d₋ > 0  or  d₊ < 0,  and g(p) and g(q) are numbers  (monotone): one root if it changes sign, else none
        else if this is level ISOLATE_DEPTH: the box is *undecided*
        else it is halved, (p, m) and (m, q) go to the next level, or (p, q) itself if m is not strictly between p and q
    more than ISOLATE_WIDTH boxes on a level make every result NaN
    undecided boxes that share an end are joined; a joined box (p, q) gives one root ½(p + q) if it changes sign; else none if g(p) or g(q)
        is NaN (the border of where g is defined), else that root twice (a tangency)
    a root in a monotone box is found by Newton's method from v = m, kept in [p, q]: at each iterate v, if g = 0 it stops; else v replaces
        q if g > 0 is as at the box's right end, else p; a step -g/g′ that is 0 or not a number, leaves [p, q], or is longer than half of
        the step before the last one (if there was one), is replaced by a bisection, to ½(p + q). It stops after a step of at most 2⁻⁵²
        times |v|, v being where it arrived, or after ISOLATE_STEPS steps; the last step is taken
    results = the roots in ascending order, then +inf; more roots than results make every result NaN

Semantics of `Locate`: f and g are functions of v, between `lo` and `hi`, and of u, between `low` and `high`. The block `enclosure` computes
`bounds` = (f₋, f₊, g₋, g₊), which hold f and g for all left <= v <= right and bottom <= u <= top.

    if `when` names a boolean that is false, or lo, hi, low or high is not finite, or lo = hi, or low = high, every result is +inf
    lo > hi are exchanged, and low > high
    level 0 is the rectangle (lo, hi) × (low, high). For each level 0, 1, …, LOCATE_DEPTH, for each rectangle of it run `enclosure`;
        it is dropped if  f₋ > 0  or  f₊ < 0  or  g₋ > 0  or  g₊ < 0,  or f₋ and f₊ are both NaN,  or g₋ and g₊ are
        else if this is level LOCATE_DEPTH it is kept
        else it is halved, in v on an even level and in u on an odd one, and both halves go to the next level
    more than LOCATE_WIDTH rectangles on a level make every result +inf
    the intervals of v of the rectangles that are kept are sorted, and joined where they overlap or touch;
    results = the middles of the joined intervals in ascending order, then +inf; more of them than results make every result +inf

Semantics of `SumOver`: if `when` names a boolean that is false, every result is 0; else if a point is NaN every result is NaN; else `body`
is run with `var` at each point that is finite, and each result is the sum of its value, in the order of the points.

Operations (arithmetic is plain IEEE double, without contraction to fused multiply-add):

    floats    const(x)  add(x, y, …)  sub(x, y)  mul(x, y, …)  div(x, y)  neg(x)  powi(x, n)  pow(x, y)  abs(x)  floor(x)  mod(x, y)
              sin cos tan asin acos atan sinh cosh tanh exp log sqrt (x)   atan2(y, x)   select(b, x, y)   min(x, y)  max(x, y)
    booleans  gt0 ge0 lt0 le0 (x)   ok(x)   and(b, …)  or(b, …)  not(b)   tie(g, scale, r, k)

`add` and `mul` associate to the left. `powi` has an integer literal, negative ones are 1/powi(x, -n). `mod` has the sign of its second
argument (x - y·floor(x/y)). `min` and `max` are NaN if an argument is. `select` takes x where b holds and never lets the other value
through. `ok(x)` is x == x: not NaN.

`tie(g, scale, r, k)` is g > 0, but where |g| <= TIE_EPS·scale and g is finite the point lies on two surfaces at once and the program's
run-time input `order` (+1 or -1) decides: r if order = +1, not r if order = -1. A program with ties is run with order = +1; if any tie
was met it is run again with order = -1 and the outputs are averaged. `k` numbers the tie in `Program.ties`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

PIECE_EPS = 4 * 2.0**-52
TIE_EPS = 4 * 2.0**-52
INSIDE = 0.4854101966249685
"""Where in a piece its conditions are decided: not in its middle, where by symmetry two surfaces may touch."""
ABSOLUTE_FLOOR = 1e-6
ROUNDING = 64 * 2.0**-52
MAX_DEPTH = 48
MAX_INTERVALS = 4000
WATCH_WIDTH = 2.0**-44
ISOLATE_DEPTH = 40
ISOLATE_WIDTH = 128
ISOLATE_STEPS = 100
LOCATE_DEPTH = 72
LOCATE_WIDTH = 1024

Arg = str | float | int | bool


@dataclass(frozen=True, slots=True)
class Gauss:
    """Gauss-Legendre with `nodes` nodes a piece: exact to degree 2·nodes - 1."""

    nodes: int


@dataclass(frozen=True, slots=True)
class Adaptive:
    """Gauss-Kronrod (10, 21) with bisection, to a relative tolerance on each piece."""

    tol: float
    smooth: bool = False


Rule = Gauss | Adaptive


@dataclass(frozen=True, slots=True)
class Assign:
    """name = op(args…)."""

    name: str
    op: str
    args: tuple[Arg, ...]


@dataclass(frozen=True, slots=True)
class Integrate:
    """results = ∫ values over `var` from lo to hi, piece by piece between the breaks."""

    var: str
    lo: Arg
    hi: Arg
    breaks: tuple[Arg, ...]
    flags: tuple[Stmt, ...]
    need: str | None
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    results: tuple[str, ...]
    rule: Rule
    when: str | None = None
    watch: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Isolate:
    """results = the roots of g between lo and hi, ascending, +inf for those that are not there."""

    var: str
    lo: Arg
    hi: Arg
    left: str
    right: str
    enclosure: tuple[Stmt, ...]
    bounds: tuple[Arg, Arg, Arg, Arg]
    point: tuple[Stmt, ...]
    value: Arg
    slope: Arg
    results: tuple[str, ...]
    when: str | None = None


@dataclass(frozen=True, slots=True)
class Locate:
    """results = where in (lo, hi) f and g have a common zero over (low, high), ascending, +inf for those that are not there."""

    lo: Arg
    hi: Arg
    low: Arg
    high: Arg
    left: str
    right: str
    bottom: str
    top: str
    enclosure: tuple[Stmt, ...]
    bounds: tuple[Arg, Arg, Arg, Arg]
    results: tuple[str, ...]
    when: str | None = None


@dataclass(frozen=True, slots=True)
class SumOver:
    """results = Σ values with `var` at each of the points that is finite."""

    var: str
    points: tuple[Arg, ...]
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    results: tuple[str, ...]
    when: str | None = None


Stmt = Assign | Integrate | Isolate | Locate | SumOver


def blocks(stmt: Stmt) -> tuple[tuple[Stmt, ...], ...]:
    """The blocks inside a statement, in the order they are run."""
    match stmt:
        case Integrate():
            return (stmt.flags, stmt.body)
        case Isolate():
            return (stmt.enclosure, stmt.point)
        case Locate():
            return (stmt.enclosure,)
        case SumOver():
            return (stmt.body,)
        case Assign():
            return ()


@dataclass(frozen=True, slots=True)
class Tie:
    """What a `tie` operation compares, for diagnosis: two surfaces, printed."""

    surfaces: tuple[str, str]


@dataclass(frozen=True, slots=True)
class Program:
    """A scheduled program: parameters (in order), statements, one output name or literal per result."""

    parameters: tuple[str, ...]  # the user's names, any text; in the program parameter i is called 'p{i}'
    body: tuple[Stmt, ...]
    outputs: tuple[Arg, ...]
    ties: tuple[Tie, ...] = ()


def statements(block: tuple[Stmt, ...]) -> Iterator[Stmt]:
    """Every statement of a block and of the blocks inside it, outermost first."""
    stack = list(reversed(block))
    while stack:
        stmt = stack.pop()
        yield stmt
        for inner in reversed(blocks(stmt)):
            stack.extend(reversed(inner))


def size(program: Program) -> int:
    """Number of statements, nested ones included."""
    return sum(1 for _ in statements(program.body))


def without_dead_code(program: Program) -> Program:
    """The program without statements whose results nobody uses."""
    live: set[Arg] = set(program.outputs)
    return Program(program.parameters, _live_part(program.body, live), program.outputs, program.ties)


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
        if not wanted:
            continue
        if isinstance(stmt, Isolate):  # the number of results is part of its meaning
            live.update((*stmt.bounds, stmt.value, stmt.slope))
            point, enclosure = _live_part(stmt.point, live), _live_part(stmt.enclosure, live)
            live.update((stmt.lo, stmt.hi))
            if stmt.when is not None:
                live.add(stmt.when)
            kept.append(replace(stmt, enclosure=enclosure, point=point))
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
        values = tuple(stmt.values[i] for i in wanted)
        live.update((*values, *stmt.watch))
        body = _live_part(stmt.body, live)
        if stmt.need is not None:
            live.add(stmt.need)
        flags = _live_part(stmt.flags, live)
        live.update((stmt.lo, stmt.hi, *stmt.breaks))
        if stmt.when is not None:
            live.add(stmt.when)
        results = tuple(stmt.results[i] for i in wanted)
        kept.append(replace(stmt, flags=flags, body=body, values=values, results=results))
    return tuple(reversed(kept))
