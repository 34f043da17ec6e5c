"""Gauss-Legendre nodes for trigonometric polynomials along an arc of a circle.

The moments of a part of a disk, and of an arc of its circle, are integrals of trigonometric polynomials over arcs. A closed form in the
angles at both ends would lose the digits of a short arc of a large circle; a rule whose nodes lie on the arc loses none.

On an arc of half-width h, a polynomial of degree k in cosine and sine is a sum of waves exp(i·w·ξ), |w| <= k·h, on -1 <= ξ <= 1. The
error of n Gauss nodes for such a wave is at most C_n·w^(2n), C_n = 2^(2n+1)·(n!)⁴/((2n+1)·(2n)!³): 16 nodes are enough for the area of
a whole circle.
Source: Davis and Rabinowitz, Methods of Numerical Integration, 1984, section 2.7.
"""

from __future__ import annotations

import math

FEW, MANY = 8, 16
"""The nodes of the two rules, for short arcs and for others."""
NEGLIGIBLE = 2.0**-54
"""An error that is lost in rounding, relative to the length of the arc."""


def longest_arc(nodes: int, degree: int) -> float:
    """Returns the angle of the longest arc on which that many nodes integrate trigonometric polynomials of a degree to rounding."""
    n = nodes
    size = (2 * n + 1) * math.log(2.0) + 4.0 * math.lgamma(n + 1) - math.log(2 * n + 1) - 3.0 * math.lgamma(2 * n + 1)
    wave = math.exp((math.log(NEGLIGIBLE) - size) / (2 * n))
    return 2.0 * wave / max(degree, 1)


def parts_of_a_circle(degree: int) -> int:
    """Returns into how many equal arcs a circle is divided for MANY nodes on each."""
    return math.ceil(2.0 * math.pi / longest_arc(MANY, degree))
