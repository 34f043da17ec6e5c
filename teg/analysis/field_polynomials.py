"""Polynomials in one variable over the prime field GF(P): division, common factors, roots.

A polynomial is the list of its coefficients, the constant first. The last coefficient is not 0; the zero polynomial is the empty list.
Source: von zur Gathen and Gerhard, Modern Computer Algebra, chapters 3 and 14.
"""

from __future__ import annotations

from functools import lru_cache

from teg.analysis.polynomial import Poly
from teg.numerics.field import P, inverse, residue

Coefficients = list[int]
HALF = (P + 1) // 2


def coefficients(poly: Poly) -> Coefficients:
    """A polynomial of `teg.analysis.polynomial` in one variable as a list."""
    result = [0] * (max((i for (i,) in poly), default=-1) + 1)
    for (i,), c in poly.items():
        result[i] = c
    return _trimmed(result)


def derivative(p: Coefficients) -> Coefficients:
    """p′."""
    return _trimmed([i * c % P for i, c in enumerate(p)][1:])


def product(p: Coefficients, q: Coefficients) -> Coefficients:
    """p·q."""
    result = [0] * (len(p) + len(q) - 1) if p and q else []
    for i, c in enumerate(p):
        for j, d in enumerate(q):
            result[i + j] += c * d
    return _trimmed([c % P for c in result])


def quotient_and_remainder(p: Coefficients, q: Coefficients) -> tuple[Coefficients, Coefficients]:
    """p divided by q, which is not 0."""
    remainder, lead, above = list(p), inverse(q[-1]), len(p) - len(q)
    quotient = [0] * max(above + 1, 0)
    lower = [(i, c) for i, c in enumerate(q[:-1]) if c]
    for shift in range(above, -1, -1):
        factor = quotient[shift] = remainder[shift + len(q) - 1] * lead % P
        if factor:
            for i, c in lower:
                remainder[shift + i] -= factor * c
    return _trimmed(quotient), _trimmed([c % P for c in remainder[: len(q) - 1]])


def monic(p: Coefficients) -> Coefficients:
    """p divided by its leading coefficient."""
    if not p or p[-1] == 1:
        return p
    lead = inverse(p[-1])
    return [c * lead % P for c in p]


def common_factor(p: Coefficients, q: Coefficients) -> Coefficients:
    """The greatest common divisor, monic (Euclid's algorithm)."""
    while q:
        p, q = q, quotient_and_remainder(p, q)[1]
    return monic(p)


def one_root(p: Coefficients) -> int | None:
    """Returns a root of p in the field, or None if it has none there. Kept for the next time: one surface is asked about many others."""
    return _one_root(tuple(p))


@lru_cache(maxsize=256)
def _one_root(coefficients_of_p: tuple[int, ...]) -> int | None:
    """Returns a root, or None.

    gcd(p, v^P - v) is the product of (v - root) over the distinct roots; random shifts of (v + s)^((P-1)/2) - 1 split it
    (Cantor and Zassenhaus 1981). Costs about 521 products of polynomials of the degree of p. A quadratic has a formula.
    """
    p = monic(list(coefficients_of_p))
    if len(p) < 2:
        return None
    if len(p) == 3:
        return _root_of_square(p[1] * HALF % P, p[0])
    split = common_factor(p, _difference(_power([0, 1], P, p), [0, 1]))
    trial = 0
    while len(split) > 2:
        trial += 1
        half = _power([residue("shift", trial, split[0]), 1], (P - 1) // 2, split)
        factor = common_factor(split, _difference(half, [1]))
        if 1 < len(factor) < len(split):
            split = min(factor, quotient_and_remainder(split, factor)[0], key=len)
    return -split[0] * inverse(split[1]) % P if len(split) == 2 else None


def _root_of_square(b: int, c: int) -> int | None:
    """Returns a root of v² + 2b·v + c. P + 1 is a multiple of 4, so D^((P + 1)/4) is a root of D if there is one."""
    d = (b * b - c) % P
    root = pow(d, (P + 1) // 4, P)
    return (root - b) % P if root * root % P == d else None


def _power(p: Coefficients, k: int, modulus: Coefficients) -> Coefficients:
    """p^k modulo a polynomial, by squaring."""
    result: Coefficients = [1]
    for bit in bin(k)[2:]:
        result = quotient_and_remainder(product(result, result), modulus)[1]
        if bit == "1":
            result = quotient_and_remainder(product(result, p), modulus)[1]
    return result


def _difference(p: Coefficients, q: Coefficients) -> Coefficients:
    longer = max(len(p), len(q))
    pairs = zip(p + [0] * (longer - len(p)), q + [0] * (longer - len(q)), strict=True)
    return _trimmed([(a - b) % P for a, b in pairs])


def _trimmed(p: Coefficients) -> Coefficients:
    while p and p[-1] == 0:
        p.pop()
    return p
