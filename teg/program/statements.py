"""The statements of a flat program, and what a program consists of besides."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from teg.program.fields import CONDITION, NUMBER, Block, Operand, Part, Result, Variable
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

    name: Annotated[str, Result("any")]
    op: str
    args: Annotated[tuple[Arg, ...], Operand("any")]


@dataclass(frozen=True, slots=True)
class Bend:
    """Where the integrand turns into another branch, or has a pole: the zeros of c₀ + c₁·w + c₂·w², w = v - base of its integral."""

    kind: str  # "root", "pole" or "end"
    coefficients: Annotated[tuple[Arg, Arg, Arg], NUMBER]
    when: Annotated[Arg, Operand("condition", at="flags")] = True


@dataclass(frozen=True, slots=True)
class Guard:
    """Bounds over left <= v <= right: of the sizes of tested values, and of sharp values, which are `seen` at nodes."""

    left: Annotated[str, Variable(("block",))]
    right: Annotated[str, Variable(("block",))]
    block: Annotated[tuple[Stmt, ...], Block()]
    sizes: Annotated[tuple[Arg, ...], Operand(at="block", each=True)]
    upper: Annotated[tuple[Arg, ...], Operand(at="block")]
    lower: Annotated[tuple[Arg, ...], Operand(at="block")]
    seen: Annotated[tuple[Arg, ...], Operand(at="body")]


@dataclass(frozen=True, slots=True)
class Integrate:
    """results = ∫ values over `var` from lo to hi, piece by piece between the breaks.

    `tested` of the values decide how fine the pieces are cut; `infinite`: a bound may be, and tails have the length `scale`.
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
    watch: Annotated[tuple[str, ...], Operand("condition", at="body")] = ()
    bends: Annotated[tuple[Bend, ...], Part()] = ()
    base: Annotated[Arg, NUMBER] = 0.0
    infinite: bool = False
    scale: Annotated[Arg, NUMBER] = 1.0
    estimates: Annotated[tuple[str, ...], Result(of="results")] = ()
    guard: Annotated[Guard | None, Part()] = None
    ends: Annotated[tuple[str, ...], Variable(("flags",))] = ()

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
    results: Annotated[tuple[str, ...], Result(fixed=True)]
    when: Annotated[str | None, CONDITION] = None
    curving: Annotated[tuple[Arg, Arg], Operand(at="enclosure")] = (-math.inf, math.inf)
    noise: Annotated[Arg, Operand(at="enclosure")] = 0.0
    curvature: Annotated[Arg, Operand(at="point")] = math.nan
    tol: float = math.inf
    width: int = ISOLATE_WIDTH
    errors: Annotated[tuple[str, ...], Result(of="results")] = ()


@dataclass(frozen=True, slots=True)
class Locate:
    """results = where in (lo, hi) f and g have a common zero over (low, high), ascending, +inf for those that are not there.

    `bounds` are those of f and g, then, if they are known, those of ∂f/∂v, ∂f/∂u, ∂g/∂v and ∂g/∂u; `lost` names the part of the rectangle
    that was given up.
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
    results: Annotated[tuple[str, ...], Result(fixed=True)]
    when: Annotated[str | None, CONDITION] = None
    lost: Annotated[str | None, Result(fixed=True)] = None


@dataclass(frozen=True, slots=True)
class SumOver:
    """results = Σ values with `var` at each of the points that is finite."""

    var: Annotated[str, Variable(("body",))]
    points: Annotated[tuple[Arg, ...], NUMBER]
    body: Annotated[tuple[Stmt, ...], Block()]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    when: Annotated[str | None, CONDITION] = None


@dataclass(frozen=True, slots=True)
class Sample:
    """results = the means of the values over `count` points of the unit cube, whose coordinates are called `points`."""

    points: Annotated[tuple[str, ...], Variable(("body",))]
    count: int
    kind: str  # "montecarlo" or "qmc"
    seed: int
    body: Annotated[tuple[Stmt, ...], Block()]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    results: Annotated[tuple[str, ...], Result()]
    estimates: Annotated[tuple[str, ...], Result(of="results")] = ()
    when: Annotated[str | None, CONDITION] = None


@dataclass(frozen=True, slots=True)
class HalfPlane:
    """c + a·u + b·v > 0, or >= 0 if it is closed."""

    a: Annotated[Arg, NUMBER]
    b: Annotated[Arg, NUMBER]
    c: Annotated[Arg, NUMBER]
    closed: bool = False


@dataclass(frozen=True, slots=True)
class Polygon:
    """results = factors · ∫∫ values over the part of a box that is in all half-planes; exact to `degree` in both variables together."""

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
class HalfLine:
    """g > 0, or >= 0 if it is closed, by the values at both ends; one that may be a tie has a number k, a resolution, the size of its terms
    and, in `scales`, the scale of its rounding errors."""

    first: Annotated[Arg, Operand(at="setup")]
    last: Annotated[Arg, Operand(at="setup")]
    closed: bool = False
    k: int | None = None
    resolution: Annotated[Arg, Operand("condition", at="setup")] = True
    size: Annotated[Arg, Operand(at="setup")] = 0.0
    scale: Annotated[Arg, Operand(at="scales")] = 0.0


@dataclass(frozen=True, slots=True)
class Segment:
    """results = factors · ∫ values over the part of (0, 1) that is in all half-lines, by Gauss-Legendre with `nodes` nodes."""

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
    """Σ c·uʲvᵏ over (j, k, c), on a region or along its border: "above", "below" or "border"."""

    kind: str
    terms: Annotated[tuple[tuple[int, int, Arg], ...], NUMBER]


@dataclass(frozen=True, slots=True)
class Hyperbola:
    """results = moments of a bilinear g on the unit square; with a border, `ties` are the numbers of its four sides in `Program.ties`,
    and `scale` the scales of the rounding errors of its corners, known in `scales`."""

    corners: Annotated[tuple[Arg, ...], NUMBER]
    scales: Annotated[tuple[Stmt, ...], Block(receives=True)]
    scale: Annotated[tuple[Arg, ...], Operand(at="scales")]
    ties: tuple[int, ...]
    moments: Annotated[tuple[Moments, ...], Part(each=True)]
    results: Annotated[tuple[str, ...], Result()]
    when: Annotated[str | None, CONDITION] = None


@dataclass(frozen=True, slots=True)
class When:
    """Run `body`, which gives the results their values, if `when` holds; else they are 0."""

    when: Annotated[str, CONDITION]
    body: Annotated[tuple[Stmt, ...], Block()]
    results: Annotated[tuple[str, ...], Result(made_in="body")]


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
