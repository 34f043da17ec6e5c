"""The rules of an `Integrate` on each piece: their nodes, weights and estimates of errors."""

from __future__ import annotations

from dataclasses import dataclass

from teg.program.limits import ABSOLUTE_FLOOR


@dataclass(frozen=True, slots=True)
class Gauss:
    """Gauss-Legendre with `nodes` nodes on each piece, in v, of a finite piece: exact to degree 2·nodes - 1, and chosen where it is
    exact.

    The estimate is that of roundings: (½·ROUNDING + EDGE·M/L)·A, with L the length of a piece (p, q), M = max(|p|, |q|), and A the
    integral of |value| by the rule.
    """

    nodes: int


@dataclass(frozen=True, slots=True)
class Rational:
    """Gauss-Legendre in v with weights that know a pole: exact for polynomials of degree < `nodes` over D^`power`, D the linear function
    of the only bend, which has the kind "pole", where that counts; for polynomials of degree < `nodes` elsewhere.

    With u in (-1, 1) the nodes of a piece, D₋ and D₊ the values of D at its ends, M as for `Gauss` and z = (D₊ - D₋)/(D₊ + D₋): where the
    bend counts and D₋·D₊ > 0 and min(|D₋|, |D₊|) > POLE·M·|c₁| the weights are (1 + z·u)^power·∫ ℓ(t)/(1 + z·t)^power dt over (-1, 1), ℓ
    the Lagrange polynomials of the nodes, and power·EDGE·(|c₀| + |c₁|·W)/min(|D₋|, |D₊|) times A is added to the estimate, W the larger
    of |p| and |q| as w. If the bend counts and this does not hold, the pole is on the piece, and a value diverges if the first null rule
    gives more than RESIDUE·Σ w|f|: then it is an infinity of its sign, and the tolerance was missed.
    """

    nodes: int
    power: int


@dataclass(frozen=True, slots=True)
class Adaptive:
    """Gauss-Legendre with bisection on each piece, in a coordinate u in (0, 1), whose place is that of `Bend`.

    The whole of (0, 1) is measured with `first` nodes (not if there is something to watch, or the rule is closed); then, if it was not
    accepted, with `order` nodes, and so is every interval that comes of halving one. Measuring gives for every value K, the sum, A, the
    sum of |value|, and an error E by the null rules of `teg.numerics.quadrature`; A₀ is the first A of the piece. An interval is
    accepted if for each of the `tested` first values

        E <= max(tol·(A₀ + floor), ROUNDING·A), or E is not finite

    and if it was bisected MAX_DEPTH times, or the piece has used MAX_INTERVALS measurements. But then the tolerance was *missed*, as it
    is where K is infinite, or where the errors of a piece (but for intervals in which a watched sign changes) add up to more than
    SPENT times what one of them may be, or to more than both CANCELLED·tol·(|the integral| + CANCELS) and
    SPENT·ROUNDING·A₀. After DEEP bisections a value with A > DIVERGENT·A₀ diverges, where no watched sign is 0: its K is an infinity
    of its sign.

    The error is 4·t·min(1, max(r, (15·r - 2)/7))^decay_power, t the largest coefficients that the null rules give and r the decay from
    one pair of them to the next. No decay is counted on where r is NaN, at an "end", and in intervals that touch an end of their piece
    where it has a *neighbour*: another break, which may lie outside of the bounds, farther from this end than AT_END of the piece's
    length and PIECE_EPS·M, and nearer than NEIGHBOUR of the length. The error is 0 if t <= NOISE·A. The estimate is E plus that of
    `Gauss`, in which PLACED·m/l, one at most, of the interval counts where it is more than EDGE·M/L, the middle for an infinite end;
    where only a guard objects to the last interval, E is at least the guard's bound of the integral of |value| there, infinite where
    that is not known; a bound that is infinite on a finite interval, as beside integrable singularities, is left out.

    A `closed` rule is one of an integrand that may be not smooth at places that are no breaks. There is no first look, and `body` is
    run at the two ends of an interval too, END_INSIDE of it inside; of these runs only values and watched signs count, and no tie.
    Where a finite value y at an end is farther from p, what the polynomial through the values at the nodes has there, than
    END_DECAY·t·min(1, r), with t and r as above, 1 for an r that is NaN, 4·g·|y - p| is added to E, if these g·|y - p| together are
    more than NOISE·A; g is the distance in (-1, 1) from an end to the outermost node.

    The `floor` is 0 where an error counts however small the integral is, as in a logarithm or a denominator.

    Once the intervals of a run have been measured with more than MAX_EVALUATIONS nodes a point of the batch, or an iteration of a loop,
    each that is still to be measured is accepted, and the tolerance was missed. A box in which roots are isolated counts as
    BOX_COST nodes. Which these are, and which nodes count, is for a backend to say; JAX and the interpreter have no such limit.
    """

    tol: float
    first: int = 10
    order: int = 18
    cubic: bool = False
    closed: bool = False
    floor: float = ABSOLUTE_FLOOR


@dataclass(frozen=True, slots=True)
class Midpoint:
    """The composite midpoint rule with `nodes` nodes on each piece, a finite one. The estimate is ½·(q - p)/nodes times Σ|fₖ₊₁ - fₖ|,
    what a function of that total variation can be off by, plus ½·ROUNDING·A.
    """

    nodes: int


Rule = Gauss | Rational | Adaptive | Midpoint
