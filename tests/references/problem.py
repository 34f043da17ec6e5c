"""What a reference is, and the names that all of them are written with.

Every value comes from a closed form, or from mpmath with the breaks given, in 40 digits, at exactly the float64 parameters that are written
with it; the compiler itself, by another way, confirms it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from teg import Expr, params, vars


@dataclass(frozen=True)
class Reference:
    """A program, parameter values, and what value, gradient and Hessian are there (decimal strings)."""

    id: str
    build: Callable[[], Expr]
    params: dict[str, float]
    value: str
    grad: dict[str, str]
    hess: dict[tuple[str, str], str]
    tags: tuple[str, ...]
    source: str
    tolerance: float = 1e-11
    """Relative, or absolute where the exact number is 0; larger where the rounding of the input alone, or `tol`, allows no better."""


x, y, z = vars("x y z")
A, a, ax, ay, b, bx, by, c, ca, cb, cc, cd, ce, cf, cx, cy = params("A a ax ay b bx by c ca cb cc cd ce cf cx cy")
d, dx, dy, e, g, gap, h, k, k0, k1, k2, m = params("d dx dy e g gap h k k0 k1 k2 m")
q, q0, q1, q2, q3, q4, q5, r, r1, r2, s, sy, t, th, u, v, w = params("q q0 q1 q2 q3 q4 q5 r r1 r2 s sy t th u v w")
v00, v01, v10, v11 = params("v00 v01 v10 v11")


def bilinear(u: Expr, v: Expr) -> Expr:
    """Interpolation between the corner values of the unit square."""
    return v00 * (1 - u) * (1 - v) + v10 * u * (1 - v) + v01 * (1 - u) * v + v11 * u * v
