"""The flat, scheduled program that every backend receives.

    stmt ::= name = op(args…)                                              Assign: one scalar, float64 or boolean
           | results = ∫ v in (lo, breaks…, hi) by rule: flags; body       Integrate: pieces between breaks, nodes in a piece

A program is closed and free of δ. Every name is assigned exactly once in the whole program, and a statement uses only names of
its own block assigned earlier, of the enclosing blocks, or parameters. Floats are named 'v…', booleans 'b…', variables of
integration 'x…', parameters 'p…'; a `str` argument is a name, a `float`, `int` or `bool` argument is a literal.

Semantics of `Integrate` (the three printers share it to the letter):

    if `when` names a boolean that is false, every result is 0 and nothing below is evaluated
    if lo or hi is NaN every result is NaN
    s, a, b = +1, lo, hi  if lo <= hi  else  -1, hi, lo
    each break is clamped to [a, b] (a break that is NaN is absent: it is clamped to a); the breaks are sorted
    for neighbouring points p < q of a, breaks…, b with q - p > PIECE_EPS·max(|p|, |q|)        (thinner pieces are skipped)
        v := ½(p + q); run `flags`                                        (everything constant on the open piece)
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

Operations (arithmetic is plain IEEE double, without contraction to fused multiply-add):

    floats    const(x)  add(x, y, …)  sub(x, y)  mul(x, y, …)  div(x, y)  neg(x)  powi(x, n)  pow(x, y)  abs(x)  floor(x)  mod(x, y)
              sin cos tan asin acos atan sinh cosh tanh exp log sqrt (x)   atan2(y, x)   select(b, x, y)
    booleans  gt0 ge0 lt0 le0 (x)   ok(x)   and(b, …)  or(b, …)  not(b)   tie(g, scale, r, k)

`add` and `mul` associate to the left. `powi` has an integer literal, negative ones are 1/powi(x, -n). `mod` has the sign of its second
argument (x - y·floor(x/y)). `select` takes x where b holds and never lets the other value through. `ok(x)` is x == x: not NaN.

`tie(g, scale, r, k)` is g > 0, but where |g| <= TIE_EPS·scale and g is finite the point lies on two surfaces at once and the program's
run-time input `order` (+1 or -1) decides: r if order = +1, not r if order = -1. A program with ties is run with order = +1; if any tie
was met it is run again with order = -1 and the outputs are averaged. `k` numbers the tie in `Program.ties`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

PIECE_EPS = 4 * 2.0**-52
TIE_EPS = 4 * 2.0**-52
ABSOLUTE_FLOOR = 1e-6
ROUNDING = 64 * 2.0**-52
MAX_DEPTH = 48
MAX_INTERVALS = 4000
WATCH_WIDTH = 2.0**-44

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


Stmt = Assign | Integrate


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
        if isinstance(stmt, Integrate):
            stack.extend(reversed(stmt.body))
            stack.extend(reversed(stmt.flags))


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
