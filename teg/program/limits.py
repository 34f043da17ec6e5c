"""The numbers by which the meaning of a program is pinned: tolerances, depths and widths."""

from __future__ import annotations

# -- pieces and ties ---------------------------------------------------------------------------------------------------

PIECE_EPS = 4 * 2.0**-52
"""A piece is skipped that is thinner than this, relative to the larger of its ends."""
TIE_EPS = 4 * 2.0**-52
"""A number is a tie that is at most this times the scale of its rounding errors."""
WEIGHED = 1e-11
"""Results that differ by no more than this, relative to the largest of a run, are the same where ties are weighed."""
INSIDE = 0.4854101966249685
"""Where in a piece its conditions are decided: not in its middle, where by symmetry two surfaces may touch."""

# -- adaptive integration ----------------------------------------------------------------------------------------------

ABSOLUTE_FLOOR = 1e-6
"""The tolerance is relative to the integral of |value|, and to this where that is smaller."""
ROUNDING = 64 * 2.0**-52
"""Errors below this part of the integral of |value| are roundings, which more nodes do not mend."""
MAX_DEPTH = 48
"""Bisections of an interval, at most."""
MAX_INTERVALS = 2**17
"""Intervals of a piece that are measured, at most."""
MAX_EVALUATIONS = 2**28
"""Of integrands, that one point may take: some seconds of a compiled kernel."""
BOX_COST = 8
"""A box in which roots are isolated counts as so many evaluations."""
WATCH_WIDTH = 2.0**-44
"""An interval so narrow, in parts of its piece, is not halved because a watched sign changes in it."""
NOISE = 10 * 2.0**-52
"""Coefficients of null rules below this part of the integral of |value| are roundings: the error is 0."""
EDGE = 4 * 2.0**-52
"""How far an end of a piece may be off, relative to its distance from 0: of a thin piece that is much."""
PLACED = 2.0**-52
"""How far a node may be off, relative to its distance from 0: in a narrow interval that is much."""
SPENT = 10.0
"""The errors of all intervals of a piece may add up to so many times what the error of one may be."""
CANCELS = 1e-3
"""Where the values of a piece cancel, its errors count relative to their integral, or to this if the integral is smaller."""
CANCELLED = 1e3
"""They may add up to so many times the tolerance of what is left. Estimates are bounds, and often far too large."""
DEEP = 40
"""After so many bisections a value that does not settle may diverge."""
DIVERGENT = 2.0**-10
"""It does where such an interval holds more than this part of the piece's integral of |value|."""
UNSEEN = 1e3
"""A sharp value that may be so many times larger in a gap than at the nodes beside it was not seen by them."""
HIDDEN = 1e13
"""Where a sharp value falls by such a factor in one gap, a product with one that rises there may have a peak between the nodes."""
FAINT = 1e-87
"""A sharp value below which no peak is looked for: that of exp(-200)."""
END_INSIDE = 2.0**-24
"""How far inside of an interval its ends are looked at, in parts of it: at a break a value may be that of the other side."""
END_DECAY = 8.0
"""A value at an end may be so many times as far from the polynomial through the nodes as the coefficients that were not seen are large."""
GUARD_DEPTH = 12
"""After so many bisections a bound that is infinite hides nothing in a finite gap: where the integrand is singular the nodes decide."""

# -- bends and poles ---------------------------------------------------------------------------------------------------

POLE = 16 * 2.0**-52
"""A pole that near to a piece, relative to its distance from 0, may be on it."""
RESIDUE = 1e-8
"""An integrand whose highest coefficient is less than that, relative to its size, has no pole."""
AT_END = 1e-9
"""A zero within this part of a piece's length of its end is at its end."""
NEIGHBOUR = 2.0**-4
"""A break beyond an end of a piece, within this part of its length, is a neighbour: if it is a branch point, the nodes do not see it."""
FAR = 64.0
"""The size of a zero that is too far to count beside another one: what it costs is less than the rounding of large numbers."""
AT_REACH = 128.0
"""A slow tail goes with the logarithm of its places up to u = AT_REACH/(1 + AT_REACH), where that is the reach."""
BEYOND = 16.0
"""The weight of all that lies beyond is smaller by this factor: what falls off is not spoilt, what does not diverges."""
NEAR = 6.0 + 1.0 / 6.0
"""The size of a bend whose ellipse is ρ = 6: Gauss-Legendre with 12 nodes errs there by 6⁻²⁴."""

# -- searches ----------------------------------------------------------------------------------------------------------

ISOLATE_DEPTH = 40
"""Bisections of an interval in which roots are isolated, at most."""
ISOLATE_WIDTH = 128
"""Boxes of a level for which there is room, unless the statement says otherwise."""
ISOLATE_STEPS = 100
"""Steps of Newton's method with bisection, at most."""
LOCATE_HALVINGS = 36
"""Halvings of a rectangle in each direction, at most."""
LOCATE_WIDTH = 4096
"""Rectangles of a level, at most."""
LOCATE_MOST = 2**15
"""Rectangles of all levels together, at most."""
LOCATE_ZEROS = 512
"""Zeros that Newton's method finds, at most: where there are more the search has found nothing."""
LOCATE_STEPS = 6
"""Steps of Newton's method: the first one leaves a quarter of the rectangle at most, and each doubles the digits."""
LOCATE_NARROW = 2.0**-30
"""An interval that is at most so wide, in parts of the whole, is one place."""
LOCATE_SAME = 2.0**-40
"""Zeros that are at most twice so far apart, in parts of the whole, are one place."""
LOCATE_LOST = 2.0**-40
"""A smaller part of the rectangle may be given up."""

# -- polygons, segments, hyperbolas, ellipses --------------------------------------------------------------------------

MAX_HALF_PLANES = 64
"""Of more a `Polygon` would be long: they share the pieces of two integrals instead."""
MAX_CUTS = 8
"""Of the half-planes beside an ellipse."""
MAX_HALF_SPACES = 24
"""Of more a `Polyhedron` would be long."""
CLIP_EPS = 2.0**-49
"""A corner of a polyhedron that is no farther outside of a half-space, compared with its terms, is on its border but for rounding."""
THIN = 2.0**-5
"""A triangle so thin, compared with how much its half-planes change over a box, is clipped by the box, and not the box by it."""
NEARLY = 2.0**-20
"""A half-line whose values are so small, compared with its terms, may be a tie: only then is it worth knowing how much rounding did."""
NEAR_SIDE = 2.0**-10
"""A side at whose ends a bilinear function is so small, compared with all corners, may be a tie."""
SMALLEST = 1e-140
"""The products of numbers that are smaller, or larger than its inverse, may be lost: they are divided first."""
INFINITE = 1.7e308
"""Numbers that are larger are infinite."""
LARGEST_RATIO = 1e24
"""Of the slopes at both ends of a branch that begins or ends on an asymptote, to rounding."""
SADDLE = 8 * 2.0**-52
"""The value at a saddle that is 0 to rounding, relative to those on the sides of the box."""
NO_FLUX = 1e-12
"""A boundary term's factor that is smaller than this at a saddle, in parts of its values on the box, is 0 there."""
CLOSE_ENDS = 1e-6
"""Ends of an arc that are so close, in parts of the radius: it is nothing, or the whole circle, as far as the directions of them tell."""
TANGENT = 1e-10
"""A side that is closer to the circle than this, in parts of the radius, may touch it."""

# -- samples -----------------------------------------------------------------------------------------------------------

SAME_MEANS = 2.0**-40
"""Means over replicates of samples are equal to rounding if they differ by less, relative to the root of the mean square."""
