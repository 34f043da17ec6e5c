"""The statements of a flat program, and what a program consists of besides."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from teg.program.limits import ISOLATE_WIDTH

if TYPE_CHECKING:
    import numpy as np

Arg = str | float | int | bool


@dataclass(frozen=True, slots=True)
class Gauss:
    """Gauss-Legendre with `nodes` nodes a piece: exact to degree 2·nodes - 1."""

    nodes: int


@dataclass(frozen=True, slots=True)
class Rational:
    """Gauss-Legendre with weights that know a pole, `nodes` nodes a piece: exact for polynomials of lower degree over D^power."""

    nodes: int
    power: int


@dataclass(frozen=True, slots=True)
class Adaptive:
    """Gauss-Legendre with bisection, to a relative tolerance on each piece: `first` nodes, then `order` nodes."""

    tol: float
    first: int = 10
    order: int = 18
    cubic: bool = False


@dataclass(frozen=True, slots=True)
class Midpoint:
    """The composite midpoint rule with `nodes` nodes a piece."""

    nodes: int


Rule = Gauss | Rational | Adaptive | Midpoint


@dataclass(frozen=True, slots=True)
class Assign:
    """name = op(args…)."""

    name: str
    op: str
    args: tuple[Arg, ...]


@dataclass(frozen=True, slots=True)
class Bend:
    """Where the integrand turns into another branch, or has a pole: the zeros of c₀ + c₁·w + c₂·w², w = v - base of its integral."""

    kind: str  # "root", "pole" or "end"
    coefficients: tuple[Arg, Arg, Arg]
    when: Arg = True


@dataclass(frozen=True, slots=True)
class Guard:
    """Bounds over left <= v <= right: of the sizes of tested values, and of sharp values, which are `seen` at nodes."""

    left: str
    right: str
    block: tuple[Stmt, ...]
    sizes: tuple[Arg, ...]
    upper: tuple[Arg, ...]
    lower: tuple[Arg, ...]
    seen: tuple[Arg, ...]


@dataclass(frozen=True, slots=True)
class Integrate:
    """results = ∫ values over `var` from lo to hi, piece by piece between the breaks.

    `tested` of the values decide how fine the pieces are cut; `infinite`: a bound may be, and tails have the length `scale`.
    """

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
    bends: tuple[Bend, ...] = ()
    base: Arg = 0.0
    infinite: bool = False
    scale: Arg = 1.0
    estimates: tuple[str, ...] = ()
    guard: Guard | None = None
    ends: tuple[str, ...] = ()

    @property
    def tested(self) -> int:
        """How many of the values count for the error: all, or those that have estimates."""
        return len(self.estimates) or len(self.values)

    @property
    def at_nodes(self) -> tuple[Arg, ...]:
        """The arguments that `body` computes at a node: values, watched booleans, sharp values."""
        watch = self.watch if isinstance(self.rule, Adaptive) else ()
        return (*self.values, *watch, *(self.guard.seen if self.guard is not None else ()))


@dataclass(frozen=True, slots=True)
class Isolate:
    """results = the roots of g between lo and hi, ascending, +inf for those that are not there; `errors`: how far each may be off."""

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
    curving: tuple[Arg, Arg] = (-math.inf, math.inf)
    noise: Arg = 0.0
    curvature: Arg = math.nan
    tol: float = math.inf
    width: int = ISOLATE_WIDTH
    errors: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Locate:
    """results = where in (lo, hi) f and g have a common zero over (low, high), ascending, +inf for those that are not there.

    `bounds` are those of f and g, then, if they are known, those of ∂f/∂v, ∂f/∂u, ∂g/∂v and ∂g/∂u; `lost` names the part of the rectangle
    that was given up.
    """

    lo: Arg
    hi: Arg
    low: Arg
    high: Arg
    left: str
    right: str
    bottom: str
    top: str
    enclosure: tuple[Stmt, ...]
    bounds: tuple[Arg, ...]
    results: tuple[str, ...]
    when: str | None = None
    lost: str | None = None


@dataclass(frozen=True, slots=True)
class SumOver:
    """results = Σ values with `var` at each of the points that is finite."""

    var: str
    points: tuple[Arg, ...]
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    results: tuple[str, ...]
    when: str | None = None


@dataclass(frozen=True, slots=True)
class Sample:
    """results = the means of the values over `count` points of the unit cube, whose coordinates are called `points`."""

    points: tuple[str, ...]
    count: int
    kind: str  # "montecarlo" or "qmc"
    seed: int
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    results: tuple[str, ...]
    estimates: tuple[str, ...] = ()
    when: str | None = None


@dataclass(frozen=True, slots=True)
class HalfPlane:
    """c + a·u + b·v > 0, or >= 0 if it is closed."""

    a: Arg
    b: Arg
    c: Arg
    closed: bool = False


@dataclass(frozen=True, slots=True)
class Polygon:
    """results = factors · ∫∫ values over the part of a box that is in all half-planes; exact to `degree` in both variables together."""

    variables: tuple[str, ...]
    width: Arg
    height: Arg
    half_planes: tuple[HalfPlane, ...]
    setup: tuple[Stmt, ...]
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    factors: tuple[Arg, ...]
    results: tuple[str, ...]
    degree: int
    when: str | None = None
    met: Arg = True
    corners: tuple[tuple[Arg, Arg], ...] = ()
    across: Arg = 0.0


@dataclass(frozen=True, slots=True)
class HalfLine:
    """g > 0, or >= 0 if it is closed, by the values at both ends; one that may be a tie has a number k, a resolution, the size of its terms
    and, in `scales`, the scale of its rounding errors."""

    first: Arg
    last: Arg
    closed: bool = False
    k: int | None = None
    resolution: Arg = True
    size: Arg = 0.0
    scale: Arg = 0.0


@dataclass(frozen=True, slots=True)
class Segment:
    """results = factors · ∫ values over the part of (0, 1) that is in all half-lines, by Gauss-Legendre with `nodes` nodes."""

    var: str
    half_lines: tuple[HalfLine, ...]
    setup: tuple[Stmt, ...]
    scales: tuple[Stmt, ...]
    body: tuple[Stmt, ...]
    values: tuple[Arg, ...]
    factors: tuple[Arg, ...]
    results: tuple[str, ...]
    nodes: int
    when: str | None = None


@dataclass(frozen=True, slots=True)
class Moments:
    """Σ c·uʲvᵏ over (j, k, c), on a region or along its border: "above", "below" or "border"."""

    kind: str
    terms: tuple[tuple[int, int, Arg], ...]


@dataclass(frozen=True, slots=True)
class Hyperbola:
    """results = moments of a bilinear g on the unit square; with a border, `ties` are the numbers of its four sides in `Program.ties`,
    and `scale` the scales of the rounding errors of its corners, known in `scales`."""

    corners: tuple[Arg, ...]
    scales: tuple[Stmt, ...]
    scale: tuple[Arg, ...]
    ties: tuple[int, ...]
    moments: tuple[Moments, ...]
    results: tuple[str, ...]
    when: str | None = None


@dataclass(frozen=True, slots=True)
class When:
    """Run `body`, which gives the results their values, if `when` holds; else they are 0."""

    when: str
    body: tuple[Stmt, ...]
    results: tuple[str, ...]


Stmt = Assign | Integrate | Isolate | Locate | SumOver | Sample | Polygon | Segment | Hyperbola | When


class Outcome(NamedTuple):
    """What a run of a program gives: its outputs, (outputs, n), whether a tolerance was missed anywhere, the number of evaluations of
    integrands without integrals inside (0 if the kernel was not asked to count), and whether a search found more roots than it has room
    for."""

    values: np.ndarray
    missed: bool
    evaluations: int
    crowded: bool = False


@dataclass(frozen=True, slots=True)
class Tie:
    """What a `tie` operation compares, for diagnosis: two surfaces, printed."""

    surfaces: tuple[str, str]


class Printed(dict[object, Any]):
    """What backends printed of a program, but for the bodies of its functions: every binding of these shares it. It is not pickled."""

    def __reduce__(self) -> tuple[object, ...]:
        return (Printed, ())


@dataclass(frozen=True, slots=True)
class Called:
    """A function that a program calls: whose it is, how often it is differentiated by each input, and its body, a program with one output
    and a parameter an input; None until it is bound."""

    callee: object
    derivative: tuple[int, ...]
    body: Program | None = None


@dataclass(frozen=True, slots=True)
class Program:
    """A scheduled program: parameters (in order), statements, one output name or literal per result."""

    parameters: tuple[str, ...]  # the user's names, any text; in the program parameter i is called 'p{i}'
    body: tuple[Stmt, ...]
    outputs: tuple[Arg, ...]
    ties: tuple[Tie, ...] = ()
    functions: tuple[Called, ...] = ()
    printed: Printed = field(init=False, default_factory=Printed, compare=False, repr=False)  # `dataclasses.replace` begins a new one
