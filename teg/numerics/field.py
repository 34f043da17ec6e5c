"""The prime field GF(P), P = 2⁵²¹ - 1, in which structure is decided."""

from __future__ import annotations

import hashlib
import math
from functools import lru_cache

P = 2**521 - 1


@lru_cache(maxsize=4096)
def inverse(x: int) -> int:
    """Returns 1/x in the field. Cached: the same inverses are needed again and again, and each costs as much as a hundred products."""
    return pow(x, -1, P)


def divided(x: int, y: int) -> int:
    """x/y in the field."""
    return x * inverse(y) % P


@lru_cache(maxsize=4096, typed=True)
def residue(*key: object) -> int:
    """A random element of the field that stands for `key`. Cached: most keys are names of parameters."""
    return int.from_bytes(hashlib.blake2b(repr(key).encode(), digest_size=64).digest(), "little") % P


def residue_of_float(value: float) -> int | None:
    if not math.isfinite(value):
        return None
    numerator, denominator = value.as_integer_ratio()
    return numerator % P if denominator == 1 else divided(numerator, denominator)


_LARGEST = 2**200


def sign_of_residue(value: int) -> int | None:
    """Returns the sign of the fraction p/q with |p|, q < 2²⁰⁰ that a residue stands for (Wang 1981); None if there is none.

    There are 2⁴⁰⁰ such fractions among 2⁵²¹ residues, so the probability of a fraction by chance is below 1e-36.
    """
    r0, r1, s0, s1 = P, value % P, 0, 1
    while r1 > _LARGEST:
        quotient = r0 // r1
        r0, r1, s0, s1 = r1, r0 - quotient * r1, s1, s0 - quotient * s1
    if r1 == 0 or s1 == 0 or abs(s1) > _LARGEST:
        return None
    return 1 if s1 > 0 else -1
