"""Integrals of the polynomial of the nearest candidate over the unit square, and their derivatives by every number of every candidate.

    V = Σ_k ∫∫ over R_k of f_k,        R_k: where the guards of k are >= 0 and its key is less than those of others that are present there

*Forms in, derivatives of forms out.* A candidate is a few affine forms c + a·u + b·v: the guards of its parts, its key; and a polynomial.
The square is cut into convex cells with one owner each. Candidates are inserted one by one, nearest first: a cell behind its owner all over
is left alone; else it is clipped by the guards, and by the line on which both keys are equal. Both sides of a cut share its points, so the
cells tile the square. Every edge knows the line it lies on.

    ∂V/∂(coefficient of f_k)  =  ∫∫ of its monomial over R_k                                         moments
    ∂V/∂(c, a, b) of a form   =  Σ over edges on its line of ±∫ f_owner·(1, u, v) ds/|(a, b)|         + on the side g >= 0, - on the other

The jump across an edge is never looked up: the cells on both sides give their shares, and cuts that separate nothing cancel. Where an edge
of another region lies on such a cut, as in a regular mesh, what is there is that region's, the nearest one's of several (second derivatives
there are NaN). Edges of several candidates that lie on each other have the derivative of moving together. The line of
two keys belongs to the key of one with + and to that of the other with -; where several pairs have one line, each edge to the owners of its
two sides (`key_edges.py`; second derivatives are NaN there, unless keys are taken apart as below, and all derivatives are where a third key
is equal to theirs along an edge).

Along a direction (`order` 1) the corners of the cells move as the intersections of the lines of their edges do, and with them everything
above, by the product rule. Second derivatives jump where four keys are equal at one place, or three on a side of the square, or two at its
corner, as among sites on a grid. Where no guard has a line in the square they are the mean of two arrangements, of keys that are taken
apart a little and of the opposite; with still more keys at one place they are NaN. They jump, too, where a corner of a cell lies on another
line, a side or a guard's for one, from which the direction parts it: there they are the mean of both sides, M(h) = ½(H(h) + H(-h)) with all
numbers moved by ±h times the direction, as 2·M(h) - M(2h); NaN where M has no limit, as where a line turns on another one.

A candidate is absent where one of its guards is below 0 on all of the square, whatever its other numbers are; a guard or a key of another
one that is not finite makes everything NaN. Equal keys: the lower index. A corner nearer than EPSILON to a line lies on it: common edges of
a mesh then cut nothing off. A line on a side of the square has one derivative for moving inwards and another one outwards: the mean counts
where the candidate is there, not farther than BESIDE from that side of a cell, and each line counts as moving by itself (`side_lines.py`).
Cost: linear in the candidates, for those that are not hidden or outside the square of their number at worst; C compares these with the few
cells around them only, NumPy cuts the square into tiles first. Method: cells with owners (a planar arrangement built by insertion; there a
binary space partition finds them); derivatives by Reynolds' transport theorem.

The meaning, in plain Python numbers, is `cell_integrals.py`, with `arrangement.py` and `measured.py`; the backends compute the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

EPSILON = 1e-12
"""The distance within which a point lies on a line; the side of the square is 1."""
BESIDE = 1e-9
"""The distance from which on a cell is beside a candidate, whatever is rounded."""
SHIFT = 1e-11
"""The distance by which the square is moved where a line lies on its side."""
SKEW = 0.7
"""The second coordinate of that step, in units of the first."""
NUDGE = 1e-10
"""The size of what is added to keys where more of them are equal at one place than have a second derivative there, relative to theirs."""
PARALLEL = 1e-9
"""The sine of an angle below which lines through one place are one."""
PARTING = 1e-8
"""How far lines through one place are moved apart along the direction, where they part."""
PARTED = 1e-7
"""The speed of a corner beyond a line that is no rounding, relative to how fast anything in the square moves."""
LIMIT = 1e-5
"""How far second derivatives with a limit change from one such distance to the double of it, relative to the largest of them."""
SLOW = 1e-3
"""The relative speed below which lines through one place part too slowly for a mean of both sides, which is NaN then."""
ROUNDING = 1e-13
"""The rounding of a key, relative to its constant."""
SAME, PLACES = 1e-10, 8
"""The distance within which lines of different regions are one, and the decimal places in which their angles are."""
TILE_AT = (0.4871, 0.5119)
"""Where backends cut a square with many candidates into tiles, and these again: lines of a regular mesh lie on none of these."""
NO_OWNER = -1
MOST_DEGREE = 8
"""The largest degree of a polynomial."""
MOST_GUARDS = 16
"""The largest number of guards of a part."""
BOX = 4
"""Lines 0 to 3 are the sides of the square: u = 0, u = 1, v = 0, v = 1."""
SIDES = ((0.0, 1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, -1.0))

Form = tuple[float, float, float]
Point = tuple[float, float]
Row = Sequence[float]


def apart(candidate: int) -> float:
    """Returns what is added to the key of a candidate, in [-1, 1): numbers without an order, so that no few of them cancel."""
    h = candidate * 2654435761 & 0xFFFFFFFF
    h = (h ^ h >> 15) * 2246822519 & 0xFFFFFFFF
    return (h ^ h >> 13) / 2.0**31 - 1.0


class Layout(NamedTuple):
    """The numbers of one candidate of a partition: `parts` times `guards` affine forms, one for the key, a polynomial of a degree.

    Forms are (c, a, b) for c + a·u + b·v. A polynomial has its coefficients in the order 1, u, v, u², uv, v², …. With `order` 1 the node
    is the derivative of a partition along a direction, whose components follow the numbers. With `touching`, parts have corners in
    common, as those of (x - a)·(y - b) > 0: there are no second derivatives.
    """

    parts: int
    guards: int
    degree: int
    order: int = 0
    touching: bool = False

    @property
    def forms(self) -> int:
        """Returns the count of the numbers of forms."""
        return 3 * self.parts * self.guards + 3

    @property
    def coefficients(self) -> int:
        """Returns the count of the coefficients of a polynomial."""
        return (self.degree + 1) * (self.degree + 2) // 2

    @property
    def columns(self) -> int:
        """Returns the count of the numbers of a candidate, without directions."""
        return self.forms + self.coefficients


def monomials(degree: int) -> list[tuple[int, int]]:
    """Returns the exponents of u and v in the order of coefficients."""
    return [(total - j, j) for total in range(degree + 1) for j in range(total + 1)]
