"""The statements of a flat program, each with its fields' roles (`teg.program.fields`), and what a program consists of besides.

The docstrings say what is not obvious from the meaning, which is `teg.program.interpreter`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

from teg.program.fields import CONDITION, NUMBER, Block, Operand, Part, Result, Variable
from teg.program.limits import ISOLATE_WIDTH
from teg.program.rules import Adaptive, Rule

if TYPE_CHECKING:
    import numpy as np


Arg = str | float | int | bool


@dataclass(frozen=True, slots=True)
class Assign:
    """name = op(args…), by the operations of `teg.program.operations`.

    `tie(g, scale, r, k)` is g > 0, but where |g| <= TIE_EPS·scale and g is finite the point lies on two surfaces at once and the
    program's run-time input `order` (+1 or -1) decides: r if order = +1, not r if order = -1. A program with ties is run with order = +1;
    if any tie was met it is run again with order = -1 and the outputs are averaged. `k` numbers the tie in `Program.ties`.
    """

    name: Annotated[str, Result("any")]
    op: str
    args: Annotated[tuple[Arg, ...], Operand("any")]


@dataclass(frozen=True, slots=True)
class Bend:
    """A place where the integrand turns into another branch, or has a pole: the zeros of D = c₀ + c₁·w + c₂·w², w = v - base of its
    integral.

    A bend counts on a piece where its `when` holds and its coefficients are finite. With P, Q the ends as w, y the zeros of D (with c₂·W²
    <= 1e-13·(|c₁|·W + |c₀|), W = max(|P|, |Q|), D is linear; it has no zero if c₁·W <= 1e-13·|c₀|), and for complex y = m ± i·h its size
    is

        s = 2·(|y - P| + |y - Q|)/L           (the sum of the distances from the foci of [-1, 1]; 2 on the piece, 2 + small near it)

    a bend's s is that of its nearest zero; FAR zeros beside another one do not count. Two real zeros closer than 1e-12·L are none, nor
    complex ones with h < 1e-100·L; nor is a "root" or "end" with a real zero inside of the piece, which should be a break; one that is
    inside by at most 1e-9·L is moved to the end there. The place of u on a piece is the first of these that applies, t being linear in u;
    nodes are kept within (p, q), one that is not becomes the next normal number inside:

        a tail, q infinite           p + scale·u/(1 - u)
          with a reach R             p + scale·sinh(min(R, R·u/(AT_REACH·(1 - u))))
                                     beyond the reach dv/du goes on as 1/(BEYOND·(1 - u))
        a tail, p infinite           q - the same of 1 - u
        the nearest bend with s < NEAR:
        "root", one zero             y ± t²                      √D is t
        "root", two real zeros       m + h·sin t  between them,  m ± h·cosh t  beyond them
        "root", complex zeros        m + h·sinh t
        "pole"                       y ± eᵗ,  y the nearest real zero; none within POLE·M of the piece; complex zeros as for a "root"
        "end"                        p + L·u⁶ if a zero is within 1e-9·L of p, q - L·(1 - u)⁶ if of q, not of both; else it is a "root"
        `cubic`                      p + L·u²·(3 - 2u)           √-like behaviour at both ends becomes analytic
        else                         p + L·u

    If two different bends have a zero within 1e-9·L of p and of q, one at either end, the place is the cubic's.
    """

    kind: str  # "root", "pole" or "end"
    coefficients: Annotated[tuple[Arg, Arg, Arg], NUMBER]
    when: Annotated[Arg, Operand("condition", at="flags")] = True


@dataclass(frozen=True, slots=True)
class Guard:
    """Finds what lies between all nodes of an `Adaptive` rule: its block computes for left <= v <= right, on one piece, a bound `sizes` of
    each tested |value|, and bounds `lower` <= s <= `upper` of *sharp* values, which the body computes at the nodes as `seen`.

    A₀ of an interval is the largest A among those of the interval itself and of the intervals it came from. An interval that would be
    accepted because its errors are small, all being finite, and in which no watched sign changes, is accepted only if nothing there
    is hidden. With

        a box (left, right) *matters* if one of the tested values does not have
            size·(right - left) <= max(tol·(A₀ + floor), ROUNDING·A), or size = 0 if right - left is not finite
        s is *unseen* in it, S being the value of s at nodes, if  upper > UNSEEN·max(S, FAINT)  or  upper > HIDDEN·max(lower, FAINT);
            but not if change·(right - left) is at most the least of the errors above. The `change` of s is how much of a tested
            |value| may come from s, as long as it is at most `upper`

    nothing is hidden if the whole interval does not matter, or no s is unseen in it, S being the least at its nodes (of all that are
    numbers); or if in none of the gaps between neighbouring nodes, and between ends and nodes, that matter, an s is unseen, S being the
    larger of its two nodes' (at an end the one's). An infinite upper bound counts as seen in a finite gap at an end of the piece, and in
    every finite gap if the interval came from GUARD_DEPTH or more bisections: where the integrand is singular the nodes decide. At the
    ends of a piece left and right are p and q themselves. In a gap to infinity an infinite upper bound always counts, and the lower bound
    never: what falls there falls for good. Nor does the lower bound count in a finite gap at an end of the piece after DEEP bisections.
    """

    left: Annotated[str, Variable(("block",))]
    right: Annotated[str, Variable(("block",))]
    block: Annotated[tuple[Stmt, ...], Block(sees=("flags",))]
    sizes: Annotated[tuple[Arg, ...], Operand(at="block", each=True)]
    upper: Annotated[tuple[Arg, ...], Operand(at="block")]
    lower: Annotated[tuple[Arg, ...], Operand(at="block")]
    change: Annotated[tuple[Arg, ...], Operand(at="block")]
    seen: Annotated[tuple[Arg, ...], Operand(at="body")]

    @property
    def bounds(self) -> tuple[Arg, ...]:
        """What the block computes."""
        return (*self.sizes, *self.upper, *self.lower, *self.change)


@dataclass(frozen=True, slots=True)
class Integrate:
    """results = ∫ values over `var` from lo to hi by `rule`, piece by piece between the breaks.

    If lo or hi is NaN, or infinite in an integral that is not `infinite`, every result is NaN. Each
    break is clamped to the interval (one that is NaN is absent), and pieces (p, q) thinner than PIECE_EPS·max(|p|, |q|) are skipped.
    `flags`, what is constant on an open piece, is run with var at its part INSIDE and `ends`, if there are any, at p and q; the piece is
    skipped if `need` then fails. `scale` is the length of a tail, where q - p is infinite. The `reach`, a positive number, is for values
    that fall off like a power of v that is no integer, or is not known: in the logarithm of v they fall off like an exponential. It is
    the logarithm of the largest place, in units of the scale, at which the values are looked at; the literal 0 for tails without it.

    `tested` of the values decide how fine the pieces are cut, and have `estimates` of their errors. `watch` names signs in `body`, of
    conditions that may change where no break is known (rule Adaptive only). On an interval `body` is then also run at the two ends; of
    these two runs only the watched signs count, no value and no tie. If one of them is positive at one place and negative at another, it
    *changes*, and the error does not matter: the interval is halved, unless it is at most WATCH_WIDTH wide in u. An interval that will be
    halved anyway need not be evaluated further, but the first one is, for A₀.
    """

    var: Annotated[str, Variable(("flags", "body"))]
    lo: Annotated[Arg, NUMBER]
    hi: Annotated[Arg, NUMBER]
    breaks: Annotated[tuple[Arg, ...], NUMBER]
    flags: Annotated[tuple[Stmt, ...], Block()]
    need: Annotated[str | None, Operand("condition", at="flags")]
    body: Annotated[tuple[Stmt, ...], Block(sees=("flags",))]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    rule: Rule
    when: Annotated[str | None, CONDITION] = None
    watch: Annotated[tuple[Arg, ...], Operand(at="body")] = ()
    bends: Annotated[tuple[Bend, ...], Part()] = ()
    base: Annotated[Arg, NUMBER] = 0.0
    infinite: bool = False
    scale: Annotated[Arg, NUMBER] = 1.0
    estimates: Annotated[tuple[str, ...], Result(each=True)] = ()
    guard: Annotated[Guard | None, Part()] = None
    ends: Annotated[tuple[str, ...], Variable(("flags",))] = ()
    reach: Annotated[Arg, NUMBER] = 0.0

    @property
    def tested(self) -> int:
        """Returns the number of the values that count for the error: those with estimates, or all."""
        return len(self.estimates) or len(self.values)

    @property
    def is_slow(self) -> bool:
        """Returns whether the tails have a reach."""
        return self.infinite and self.reach != 0.0

    @property
    def at_nodes(self) -> tuple[Arg, ...]:
        """Returns the arguments that `body` computes at a node: values, watched signs, sharp values."""
        watch = self.watch if isinstance(self.rule, Adaptive) else ()
        return (*self.values, *watch, *(self.guard.seen if self.guard is not None else ()))


@dataclass(frozen=True, slots=True)
class Isolate:
    """results = the roots of g between lo and hi, ascending, +inf for those that are not there; `errors`: how far each may be off.

    g is a smooth function of `var`. `point` computes g, its `slope` and its `curvature` (NaN where that is not known); `enclosure`
    computes `bounds` (g₋, g₊, d₋, d₊) and `curving` (c₋, c₊) with g₋ <= g <= g₊, d₋ <= g′ <= d₊ and c₋ <= g″ <= c₊ for all left <= v <=
    right, and `noise`, how far rounding may move g at ½(left + right). Where `when` fails, or lo = hi, every result is +inf; an infinite
    or NaN bound makes every result NaN.

    The box (lo, hi) is halved up to ISOLATE_DEPTH times. A box that changes sign is kept, whatever rounded bounds say, unless g is constant
    there, d₋ = d₊ = 0, or 0, g₋ = g₊ = 0; another one is dropped if its bounds, or the mean value theorem, exclude a root, or if g is not
    defined there. A monotone box has one root if it changes sign, else none, unless it may hold a pole where g changes its sign: g₋, g₊ and
    one of d₋, d₊ are infinite. So has a convex or concave one, unless g₋ or g₊ and both d₋ and d₊ are infinite, or it turns between its
    ends, towards 0; then, t being where g′ = 0, it has the root t twice (a tangency) if |g(t)| <= noise, two roots if g(t) lies beyond 0,
    else none. A box in which g cannot be told from 0, |g(m)| + h·|g′(m)| + ½h²·max(|c₋|, |c₊|) <= noise, or that was halved so often, is
    *undecided*: those that share an end are joined, and give the root in the middle, once if g changes sign, twice if not, and none at the
    border of where g is defined.

    Roots are found by Newton's method, kept inside by bisection, to a step of 2⁻⁵²·|v| or ISOLATE_STEPS steps. The error of a root is
    half of a joined box, √(2·noise/|g″(t)|) for a tangency, else 0; if one is more than tol·|hi - lo| the tolerance was missed. At roots
    that are `soft` an integrand is taken to be continuous, with √-like behaviour behind: an error e matters as e^1.5. More than
    `width` boxes on a level, or more roots than results, make every result NaN: the search is *crowded*, and the same program with more
    room has the answer.
    """

    var: Annotated[str, Variable(("point",))]
    lo: Annotated[Arg, NUMBER]
    hi: Annotated[Arg, NUMBER]
    left: Annotated[str, Variable(("enclosure",))]
    right: Annotated[str, Variable(("enclosure",))]
    enclosure: Annotated[tuple[Stmt, ...], Block()]
    bounds: Annotated[tuple[Arg, Arg, Arg, Arg], Operand(at="enclosure")]
    point: Annotated[tuple[Stmt, ...], Block()]
    value: Annotated[Arg, Operand(at="point")]
    slope: Annotated[Arg, Operand(at="point")]
    results: Annotated[tuple[str, ...], Result(fixed=True, absent=math.inf)]
    when: Annotated[str | None, CONDITION] = None
    curving: Annotated[tuple[Arg, Arg], Operand(at="enclosure")] = (-math.inf, math.inf)
    noise: Annotated[Arg, Operand(at="enclosure")] = 0.0
    curvature: Annotated[Arg, Operand(at="point")] = math.nan
    tol: Annotated[float, NUMBER] = math.inf
    width: int = ISOLATE_WIDTH
    errors: Annotated[tuple[str, ...], Result(each=True, absent=math.inf)] = ()
    soft: bool = False


@dataclass(frozen=True, slots=True)
class Locate:
    """results = where in (lo, hi) f and g have a common zero over (low, high), ascending, +inf for those that are not there.

    f and g are functions of v, between `lo` and `hi`, and u, between `low` and `high`. `enclosure` computes `bounds` (f₋, f₊, g₋, g₊) for
    all left <= v <= right and bottom <= u <= top; where they are known also such bounds of ∂f/∂v, ∂f/∂u, ∂g/∂v and ∂g/∂u. At a point,
    left = right and bottom = top, the lower bounds are values and slopes. Where `when` fails, or an end is not finite, or lo = hi, or low
    = high, every result is +inf and nothing is lost.

    The rectangle is halved, all rectangles of a level in one direction: by turns, but again in one that is of use (20n <= 11m of m
    rectangles were left) while the other is not (50n >= 49m). One is dropped if its bounds, the mean value theorem or Krawczyk's test
    exclude a common zero; if Krawczyk's test says that there is exactly one, Newton's method finds it. The rectangles that are left are
    given up after LOCATE_HALVINGS halvings in both directions, or if there are more than LOCATE_WIDTH on the next level, or LOCATE_MOST
    in all.

    The intervals of v of the rectangles given up, and v ± LOCATE_SAME·|hi - lo| of zeros, are joined where they overlap or touch. An
    interval gives one place, its middle, if it is at most LOCATE_NARROW·|hi - lo| wide, else two, its ends, and its rectangles are lost.
    `lost` names the part of the area that is lost, with what is behind the last result if there are more places than results; more than
    LOCATE_ZEROS zeros lose all. If lost > LOCATE_LOST the tolerance was missed.
    """

    lo: Annotated[Arg, NUMBER]
    hi: Annotated[Arg, NUMBER]
    low: Annotated[Arg, NUMBER]
    high: Annotated[Arg, NUMBER]
    left: Annotated[str, Variable(("enclosure",))]
    right: Annotated[str, Variable(("enclosure",))]
    bottom: Annotated[str, Variable(("enclosure",))]
    top: Annotated[str, Variable(("enclosure",))]
    enclosure: Annotated[tuple[Stmt, ...], Block()]
    bounds: Annotated[tuple[Arg, ...], Operand(at="enclosure")]
    results: Annotated[tuple[str, ...], Result(fixed=True, absent=math.inf)]
    when: Annotated[str | None, CONDITION] = None
    lost: Annotated[str | None, Result(fixed=True)] = None


@dataclass(frozen=True, slots=True)
class SumOver:
    """results = Σ values with `var` at each of the points that is finite, in their order; NaN if a point is, 0 where `when` fails."""

    var: Annotated[str, Variable(("body",))]
    points: Annotated[tuple[Arg, ...], NUMBER]
    body: Annotated[tuple[Stmt, ...], Block()]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    when: Annotated[str | None, CONDITION] = None


@dataclass(frozen=True, slots=True)
class Sample:
    """results = the means of the values over `count` points of the unit cube, whose coordinates are called `points`; 0 where `when`
    fails.

    The points are those of `teg.numerics.sobol` for `kind`, `seed` and their number: R = 8 replicates of n = ⌈count/8⌉ points for "qmc",
    R = 1 of n = count for "montecarlo". With mᵣ the mean over replicate r, results are m = (m₁ + … + m_R)/R, and `estimates` of the first
    of them their standard errors: √(Σᵣ(mᵣ - m)²/(R(R - 1))) for "qmc", √(Σᵢ(fᵢ - m)²/(n(n - 1))) for "montecarlo" (relative to f₁, so
    that nothing cancels); NaN where m is not finite, or n = 1 there. Means over replicates that are equal to `SAME_MEANS`, relative to
    √(m² + s²), tell no error, as those of a jump along one coordinate, where all replicates may count the same points: it is s/n at
    least then, s² = Σᵢ(fᵢ - m)²/(R·n).
    """

    points: Annotated[tuple[str, ...], Variable(("body",))]
    count: int
    kind: str  # "montecarlo" or "qmc"
    seed: int
    body: Annotated[tuple[Stmt, ...], Block()]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    estimates: Annotated[tuple[str, ...], Result(each=True)] = ()
    when: Annotated[str | None, CONDITION] = None


@dataclass(frozen=True, slots=True)
class HalfPlane:
    """c + a·u + b·v > 0, or >= 0 if it is closed, which is True or False here, and a name only in rows of statements."""

    a: Annotated[Arg, NUMBER]
    b: Annotated[Arg, NUMBER]
    c: Annotated[Arg, NUMBER]
    closed: Annotated[bool, CONDITION] = False


@dataclass(frozen=True, slots=True)
class Polygon:
    """results = factors · ∫∫ values over the part of a box that is in all half-planes, 0 where `when` fails.

    The `variables` u and v are offsets from a corner of the box, which is 0 and `width` apart in u, 0 and `height` in v (either may be
    negative: then so is the area). On the box a half-plane's least value is c + min(a·width, 0) + min(b·height, 0), its largest likewise;
    it *fails* if the largest is <= 0, unless it is closed and the least is >= 0. If one fails every result is 0 and nothing is run; if
    width, height, or a least or largest value is NaN or infinite, every result is NaN. The box is clipped by each half-plane whose least
    value is < 0 (Sutherland and Hodgman); results are sums of `teg.numerics.quadrature.triangle_rule(degree)`, exact to that degree in
    both variables together, over the triangles (vertex 0, vertex k, vertex k + 1). With degree 0 one node, vertex 0, counts for all of
    them.

    With `corners`, three points p₀, p₁, p₂, half-plane k of the first three is 0 at two of them, and `across` at p_k; `variables` has two
    names more, a node's barycentric coordinates, 1 at p₁ and 1 at p₂ and 0 at the others. If `across` <= 0 every result is 0. With s the
    largest difference of largest and least of the three, the polygon is *thin* if across < THIN·s: then instead of the box the triangle
    is clipped, by the sides of the box, where an edge that is cut has exactly the side's coordinate, and by the half-planes from number 3
    on; a new vertex divides the coordinates of an edge as it does u and v. Else they are the values of half-planes 1 and 2, times
    1/across.

    `met` names a condition that fails only where a half-plane fails; backends make branches of it, and it is in no program that
    is printed.
    """

    variables: Annotated[tuple[str, ...], Variable(("body",))]
    width: Annotated[Arg, NUMBER]
    height: Annotated[Arg, NUMBER]
    half_planes: Annotated[tuple[HalfPlane, ...], Part()]
    setup: Annotated[tuple[Stmt, ...], Block(receives=True)]
    body: Annotated[tuple[Stmt, ...], Block(sees=("setup",))]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    factors: Annotated[tuple[Arg, ...], Operand(at="setup", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    degree: int
    when: Annotated[str | None, CONDITION] = None
    met: Annotated[Arg, Operand("condition", hint=True)] = True
    corners: Annotated[tuple[tuple[Arg, Arg], ...], NUMBER] = ()
    across: Annotated[Arg, NUMBER] = 0.0


@dataclass(frozen=True, slots=True)
class HalfSpace:
    """d + a·u + b·v + c·w > 0, or >= 0 if it is closed; `slopes` are a, b and c, `offset` is d."""

    slopes: Annotated[tuple[Arg, ...], NUMBER]
    offset: Annotated[Arg, NUMBER]
    closed: Annotated[bool, CONDITION] = False


@dataclass(frozen=True, slots=True)
class Polyhedron:
    """results = factors · ∫∫∫ values over the part of a box that is in all half-spaces, 0 where `when` fails.

    The `variables` u, v and w are offsets from a corner of the box, 0 and an extent apart (one may be negative: then the volume changes
    its sign). A half-space fails, and numbers that are not finite give NaN, as those of a `Polygon`. The box is clipped by each half-space
    whose least value is < 0. A corner is outside if the value there is < -CLIP_EPS·scale, with scale = |d| + |a·width| + |b·height| +
    |c·depth|. An edge with one end outside is cut where the value is 0, and at its other end if the value is negative there too, but for
    rounding. Where a face is cut, the cut is an edge of it and of the new face: whichever corners rounding puts outside, faces stay closed.

    With `degree` 0 or 1 the node is the centroid. Else results are sums of `teg.numerics.quadrature.tetrahedron_rule(degree)` over
    tetrahedra, one for each edge of each face: the mean of all ends of edges, that of the face, and the edge. The corner of the rule at
    the origin is the first of these.
    """

    variables: Annotated[tuple[str, ...], Variable(("body",))]
    extents: Annotated[tuple[Arg, ...], NUMBER]
    half_spaces: Annotated[tuple[HalfSpace, ...], Part()]
    setup: Annotated[tuple[Stmt, ...], Block(receives=True)]
    body: Annotated[tuple[Stmt, ...], Block(sees=("setup",))]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    factors: Annotated[tuple[Arg, ...], Operand(at="setup", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    degree: int
    when: Annotated[str | None, CONDITION] = None


@dataclass(frozen=True, slots=True)
class HalfLine:
    """g > 0, or >= 0 if it is closed, by the values at both ends; one that may be a tie has a number k, a resolution, the size of its
    terms and, in `scales`, the scale of its rounding errors."""

    first: Annotated[Arg, Operand(at="setup")]
    last: Annotated[Arg, Operand(at="setup")]
    closed: Annotated[bool, Operand("condition", at="setup")] = False
    k: int | None = None
    resolution: Annotated[Arg, Operand("condition", at="setup")] = True
    size: Annotated[Arg, Operand(at="setup")] = 0.0
    scale: Annotated[Arg, Operand(at="scales")] = 0.0


@dataclass(frozen=True, slots=True)
class Segment:
    """results = factors · ∫ values over the part of (0, 1) that is in all half-lines, by Gauss-Legendre with `nodes` nodes; 0 where
    `when` fails.

    A half-line that may tie is *near* if |first| and |last| are at most NEARLY·size and finite; `scales` is run if one is. A near one
    *ties* if both are at most TIE_EPS·scale: then it holds where `resolution` does if the program's run-time input `order` is +1, where
    it does not if that is -1, and a tie was met. If a half-line that does not tie has first <= 0 and last <= 0, unless it is closed and
    both are 0, or one ties and does not hold, every result is 0; else, if first - last of one that does not tie is NaN or infinite, NaN.
    """

    var: Annotated[str, Variable(("body",))]
    half_lines: Annotated[tuple[HalfLine, ...], Part()]
    setup: Annotated[tuple[Stmt, ...], Block(receives=True)]
    scales: Annotated[tuple[Stmt, ...], Block(sees=("setup",), receives=True)]
    body: Annotated[tuple[Stmt, ...], Block(sees=("setup",))]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    factors: Annotated[tuple[Arg, ...], Operand(at="setup", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    nodes: int
    when: Annotated[str | None, CONDITION] = None


@dataclass(frozen=True, slots=True)
class Moments:
    """Σ c·∫∫ uʲvᵏ w du dv over (j, k, c), with the weight w by its kind: "above", [g > 0], "below", [g <= 0], or "border", δ(g).

    With `axes` (m, n), which a border of an `Ellipse` may have, the weight is pᵐqⁿ·δ(g), (p, q) = A·((u, v) - c).
    """

    kind: str
    terms: Annotated[tuple[tuple[int, int, Arg], ...], NUMBER]
    axes: tuple[int, int] = (0, 0)


@dataclass(frozen=True, slots=True)
class Hyperbola:
    """results = moments of a bilinear g on the unit square, by `teg.numerics.moments`; 0 where `when` fails.

    g is affine in u and in v, with the values `corners` at (0, 0), (1, 0), (1, 1), (0, 1); side i begins at corner i. With a border,
    `ties` are the numbers of its four sides in `Program.ties`, and `scale` the scales of the rounding errors of its corners, known in
    `scales`, which is run if the |g| at the ends of a side add up to at most NEAR_SIDE times those of all corners. A side *ties* if |g|
    is at most TIE_EPS·scale at both of its ends. Unless all corners are ends of such sides, these are then set to 0, they count as g > 0
    if the program's run-time input `order` is +1 and as g <= 0 if it is -1, and a tie was met.

    If a corner is NaN or infinite every result is NaN. If g > 0 at all corners, or at none, only the results of the region that is not
    empty look at their coefficients. Where a border's curve crosses itself on the square, |g| <= SADDLE·Σ|g in the middles of the sides|
    at the saddle, and the polynomial there is more than NO_FLUX times the sum of its sizes in the middles of the sides, the result is an
    infinity of its sign.

    `turn` is g₀g₂ - g₁g₃ of the corners gᵢ, which is a small difference near a crossing; NaN where it is to be computed from them, as it is
    where corners are set to 0.
    """

    corners: Annotated[tuple[Arg, ...], NUMBER]
    scales: Annotated[tuple[Stmt, ...], Block(receives=True)]
    scale: Annotated[tuple[Arg, ...], Operand(at="scales")]
    ties: tuple[int, ...]
    moments: Annotated[tuple[Moments, ...], Part(each=True)]
    results: Annotated[tuple[str, ...], Result()]
    when: Annotated[str | None, CONDITION] = None
    turn: Annotated[Arg, NUMBER] = math.nan


@dataclass(frozen=True, slots=True)
class Ellipse:
    """results = moments of g = r² - |A·((u, v) - c)|² on the part of the box from (0, 0) to (width, height) that is in all half-planes; 0
    where `when` fails.

    The box is clipped to a convex polygon as that of a `Polygon`, with its results where a half-plane fails or has numbers that are not
    finite; without half-planes the polygon is the box. `matrix` is A by rows, `place` has both numbers of the centre c, the radius r, the
    width and the height, which may be negative, and the least radius at which a border is taken. A polygon without area has no moments. If
    r is infinite the polygon is inside, if c is the polygon is outside; if both are, or a number of `place` is NaN, or det A is 0 or NaN,
    every result is NaN.

    A corner is in the ellipse or not, |w| < r, and a side of which no end is in it has a chord if both ends of this lie on it. An arc of
    the circle from where it leaves the polygon to where it enters it again has almost no length, or almost that of the whole circle, if
    its ends are closer than CLOSE_ENDS·r: the latter where the lines of all sides are further than (1 - TANGENT)·r from the centre, on its
    outer side, and if all arcs are such for the one whose end is furthest behind its begin.
    """

    matrix: Annotated[tuple[Arg, ...], NUMBER]
    place: Annotated[tuple[Arg, ...], NUMBER]
    moments: Annotated[tuple[Moments, ...], Part(each=True)]
    results: Annotated[tuple[str, ...], Result()]
    when: Annotated[str | None, CONDITION] = None
    half_planes: Annotated[tuple[HalfPlane, ...], Part()] = ()


@dataclass(frozen=True, slots=True)
class When:
    """Run `body`, which gives the results their values, if `when` holds; else they are 0.

    Nothing else in it is known outside. It stands in the outermost block or in another `When`; backends in which many points run together
    have it written out (`without_branches`).
    """

    when: Annotated[str, CONDITION]
    body: Annotated[tuple[Stmt, ...], Block()]
    results: Annotated[tuple[str, ...], Result(made_in="body")]


Stmt = Assign | Integrate | Isolate | Locate | SumOver | Sample | Polygon | Polyhedron | Segment | Hyperbola | Ellipse | When


class Outcome(NamedTuple):
    """The results of a run of a program: its outputs, (outputs, n); whether a tolerance was missed anywhere; the number of evaluations of
    integrands without integrals inside (0 if the kernel was not asked to count); whether a search found more roots than it has room
    for; and whether ties were met, of all elements together or of each, (n,)."""

    values: np.ndarray
    missed: bool
    evaluations: int
    crowded: bool = False
    tied: bool | np.ndarray = False


@dataclass(frozen=True, slots=True)
class Tie:
    """The two surfaces, printed, that a `tie` operation compares, and whether it compares them at one place, not along a curve. They are
    for diagnosis, and for second derivatives on both sides of such a place."""

    surfaces: tuple[str, str]
    at_place: bool = False


@dataclass(frozen=True, slots=True)
class Called:
    """A function that a program calls: whose it is, how often it is differentiated by each input, and its body, a program with one output
    and a parameter an input; None until it is bound."""

    callee: object
    derivative: tuple[int, ...]
    body: Program | None = None


@dataclass(frozen=True, slots=True)
class Program:
    """A scheduled program: parameters (in order), statements, one output name or literal per result.

    Of a program that `weighs_ties` an outcome need tell of a tie only where it matters: where results differ between the two orders, or, if
    these are the same, with all resolutions true (order +2) and all false (-2).
    """

    parameters: tuple[str, ...]  # the user's names, any text; in the program parameter i is called 'p{i}'
    body: tuple[Stmt, ...]
    outputs: tuple[Arg, ...]
    ties: tuple[Tie, ...] = ()
    functions: tuple[Called, ...] = ()
    weighs_ties: bool = False


TEXTS = 256
"""Texts that a backend keeps, of programs that call functions and of the bodies of these."""


@dataclass(frozen=True, slots=True, eq=False)
class Unbound:
    """A program without the bodies of its functions: the key of the text that is printed once for all bodies.

    Programs are equal here if they have the same statements, not only equal ones: none is visited to find out.
    """

    program: Program

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Unbound):
            return NotImplemented
        mine, theirs = self.program, other.program
        return mine.body is theirs.body and mine.parameters == theirs.parameters and repr(mine.outputs) == repr(theirs.outputs)

    def __hash__(self) -> int:
        return hash((id(self.program.body), self.program.outputs))
