"""Where a surface meets a line: its roots in one variable, as expressions of everything else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from teg import expr as ex
from teg.calculus import slope
from teg.errors import NotDifferentiableError
from teg.expr import MINUS_ONE, ZERO, Expr, Var, add, call, const, div, mul, positive, sub, where
from teg.polynomial import Shadow, expanded
from teg.traverse import substitute


@dataclass(frozen=True)
class Roots:
    """Roots of a surface in one variable (NaN or infinite where there is none), its degree, and its discriminant if it has one."""

    points: tuple[Expr, ...]
    degree: int
    discriminant: Expr = ex.ONE


def roots_in(g: Expr, x: Var, origin: Expr) -> Roots | None:
    """The roots of g in x where a formula is known: g affine or quadratic in x.

    `origin` is a bound of the domain: the roots of an affine g are taken from its value there, as the user wrote it.
    """
    degree = Shadow((x,)).degree(g)
    if degree == 0:
        return Roots((), 0)
    try:
        if degree == 1:
            return Roots((affine_root(g, x, origin),), 1)
        if degree == 2:
            return quadratic_roots(g, x, origin)
    except NotDifferentiableError:
        return None
    return None


def affine_root(g: Expr, x: Var, origin: Expr) -> Expr:
    """The root of an affine surface: origin - g(origin)/g′."""
    at = cast(Expr, substitute(g, {x: origin}))
    rate = cast(Expr, substitute(slope(g, x), {x: origin}))
    return sub(origin, div(at, rate))


def quadratic_coefficients(g: Expr, x: Var) -> tuple[Expr, Expr, Expr]:
    """A, B, C of g = A·x² + B·x + C."""
    first = slope(g, x)
    second = slope(first, x)
    parts = mul(const(0.5), second), first, g
    a, b, c = (cast(Expr, substitute(e, {x: ZERO})) for e in parts)
    return tidy(a), tidy(b), tidy(c)


def tidy(e: Expr) -> Expr:
    """The shorter of an expression and its exact normal form."""
    from teg.traverse import size

    normal = expanded(e)
    return normal if normal is not None and size(normal) <= size(e) else e


def discriminant(a: Expr, b: Expr, c: Expr) -> Expr:
    """B² - 4AC, from the exact normal form where that is short."""
    raw = sub(ex.integer_power(b, 2), mul(const(4), a, c))
    normal = expanded(raw)
    return normal if normal is not None else raw


def quadratic_roots(g: Expr, x: Var, origin: Expr) -> Roots:
    """Both roots, by the formulas that do not cancel."""
    a, b, c = quadratic_coefficients(g, x)
    d = discriminant(a, b, c)
    root = call("sqrt", d)
    if b is ZERO:
        half = div(root, mul(const(2), call("magnitude", a)))
        return Roots((mul(MINUS_ONE, half), half), 2, d)
    signed = where(positive(b, strict=False), root, mul(MINUS_ONE, root))
    q = mul(const(-0.5), add(b, signed))
    return Roots((div(q, a), div(c, q)), 2, d)
