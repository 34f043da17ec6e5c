"""The numbers by which the meaning of a program is pinned: tolerances, depths and widths."""

from __future__ import annotations

PIECE_EPS = 4 * 2.0**-52
TIE_EPS = 4 * 2.0**-52
INSIDE = 0.4854101966249685
"""Where in a piece its conditions are decided: not in its middle, where by symmetry two surfaces may touch."""
ABSOLUTE_FLOOR = 1e-6
ROUNDING = 64 * 2.0**-52
MAX_DEPTH = 48
MAX_INTERVALS = 2**17
MAX_EVALUATIONS = 2**28
"""Of integrands, that one point may take: some seconds of a compiled kernel."""
WATCH_WIDTH = 2.0**-44
NOISE = 10 * 2.0**-52
EDGE = 4 * 2.0**-52
"""How far an end of a piece may be off, relative to its distance from 0: of a thin piece that is much."""
SPENT = 10.0
DIVERGENT = 2.0**-10
UNSEEN = 1e3
"""A sharp value that may be so many times larger in a gap than at the nodes beside it was not seen by them."""
HIDDEN = 1e13
"""Where a sharp value falls by such a factor in one gap, a product with one that rises there may have a peak between the nodes."""
FAINT = 1e-87
"""A sharp value below which no peak is looked for: that of exp(-200)."""
GUARD_DEPTH = 12
DEEP = 40
POLE = 16 * 2.0**-52
"""A pole that near to a piece, relative to its distance from 0, may be on it."""
RESIDUE = 1e-8
"""An integrand whose highest coefficient is less than that, relative to its size, has no pole."""
FAR = 64.0
"""The size of a zero that is too far to count beside another one: what it costs is less than the rounding of large numbers."""
NEAR = 6.0 + 1.0 / 6.0
"""The size of a bend whose ellipse is ρ = 6: Gauss-Legendre with 12 nodes errs there by 6⁻²⁴."""
ISOLATE_DEPTH = 40
ISOLATE_WIDTH = 128
ISOLATE_STEPS = 100
LOCATE_HALVINGS = 36
LOCATE_WIDTH = 4096
LOCATE_MOST = 2**15
LOCATE_ZEROS = 512
LOCATE_STEPS = 6
"""Steps of Newton's method: the first one leaves a quarter of the rectangle at most, and each doubles the digits."""
LOCATE_NARROW = 2.0**-30
LOCATE_SAME = 2.0**-40
LOCATE_LOST = 2.0**-40
"""A smaller part of the rectangle may be given up."""
MAX_HALF_PLANES = 64
"""Of more a `Polygon` would be long: they share the pieces of two integrals instead."""
THIN = 2.0**-5
"""A triangle so thin, compared with how much its half-planes change over a box, is clipped by the box, and not the box by it."""
NEARLY = 2.0**-20
"""A half-line whose values are so small, compared with its terms, may be a tie: only then is it worth knowing how much rounding did."""

NEAR_SIDE = 2.0**-10
"""A side at whose ends a bilinear function is so small, compared with all corners, may be a tie."""
SMALLEST = 1e-140
"""The products of numbers that are smaller, or larger than its inverse, may be lost: they are divided first."""
LARGEST_RATIO = 1e24
"""Of the slopes at both ends of a branch that begins or ends on an asymptote, to rounding."""
SADDLE = 8 * 2.0**-52
"""The value at a saddle that is 0 to rounding, relative to those on the sides of the box."""
NO_FLUX = 1e-12
"""A boundary term's factor that is smaller than this at a saddle, in parts of its values on the box, is 0 there."""
