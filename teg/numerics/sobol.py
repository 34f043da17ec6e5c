"""Points in the unit cube for sampled integrals: plain pseudo-random ones, and scrambled Sobol' points.

Every coordinate is a function of (seed, number of the point, dimension) in integer arithmetic modulo 2³² and 2⁶⁴: the backends, which
have it vectorised, give the same numbers to the last bit. The functions here are the reference, in plain Python.

    mix(z)             the finaliser of SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014; its
                       constants are Stafford's variant 13 of MurmurHash3's), a bijection of 64 bits
    key(seed, r, d)    64 bits for the replicate r of dimension d:  mix(mix(seed + γ) xor (2³²·r + d))
    unit(w)            the centre of the cell of width 2⁻⁵² that the upper 52 bits of w name:  (2·⌊w/2¹²⌋ + 1)·2⁻⁵³, never 0 or 1

Monte Carlo. Point i of dimension d is unit(mix(key(seed, 0, d) + i·γ)): the stream of SplitMix64 that begins at the key, entered anywhere.

Quasi-Monte Carlo. Sobol' points with the direction numbers of Joe and Kuo ("Constructing Sobol' sequences with better two-dimensional
projections", SIAM J. Sci. Comput. 30, 2635-2654, 2008; their file new-joe-kuo-6), 32 bits, in the order of Gray's code (Antonov, Saleev
1979): point i is the sum modulo 2 of the direction numbers where i xor ⌊i/2⌋ has a bit. Owen's nested uniform scrambling by a hash
(Laine, Karras, "Stratified sampling for stochastic transparency", CGF 30, 2011; Burley, "Practical hash-based Owen scrambling", JCGT 9(4),
2020): on reversed bits, operations that move information from low bits to high ones only. Which: Vegdahl's ("Building a better LK hash",
2021), with half the key added and the other half, made odd, a factor; the variance is then that of a true scramble, while with
Burley's own, which only adds, it depends on the integrand (a quarter of it for exp on 2⁸ points). The bits beyond the 32nd, 0 in Sobol'
points of so small numbers, are scrambled into 20 independent ones: mix(key + y·γ), y being the 32 bits.
"""

from __future__ import annotations

from functools import cache

GAMMA = 0x9E3779B97F4A7C15
"""The odd 64 bits of the golden ratio, SplitMix64's increment."""
MIX = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1))
"""z xor z/2ˢ, then times a factor: the three steps of `mix`."""
SCRAMBLE = (0x3D20ADEA, 0x05526C56, 0x53A22864)
"""Vegdahl's factors: the first before the key, the others after it."""
BITS = 32
"""The number of bits of a Sobol' point, and of the number of a point: at most 2³² points a replicate."""
LOW_BITS = 20
"""The number of bits below those of a Sobol' point."""
REPLICATES = 8
"""The number of independent scrambles of a quasi-Monte Carlo rule. The spread of their means estimates the error."""

_M32, _M64 = 2**32 - 1, 2**64 - 1

# Of dimensions 2, 3, …: the primitive polynomial as bits, the first direction integers m₁, m₂, … (dimension 1 has all mⱼ = 1).
_JOE_KUO = (
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
    (41, (1, 1, 5, 5, 5)),
    (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)),
    (59, (1, 1, 1, 3, 11)),
    (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)),
    (91, (1, 1, 1, 15, 21, 21)),
    (97, (1, 3, 1, 13, 27, 49)),
    (103, (1, 1, 1, 15, 7, 5)),
    (109, (1, 3, 1, 15, 13, 25)),
    (115, (1, 1, 5, 5, 19, 61)),
    (131, (1, 3, 7, 11, 23, 15, 103)),
    (137, (1, 3, 7, 13, 13, 15, 69)),
)

DIMENSIONS = len(_JOE_KUO) + 1
"""The largest number of dimensions of Sobol' points."""


@cache
def directions(dimension: int) -> tuple[int, ...]:
    """Returns the 32 direction numbers vⱼ = mⱼ·2³²⁻ʲ of a dimension (0, 1, …), as 32-bit integers.

    mⱼ = 2a₁mⱼ₋₁ ⊕ 2²a₂mⱼ₋₂ ⊕ … ⊕ 2ˢmⱼ₋ₛ ⊕ mⱼ₋ₛ for the polynomial xˢ + a₁xˢ⁻¹ + … + 1 (Bratley, Fox 1988).
    """
    if dimension == 0:
        return tuple(1 << (BITS - j) for j in range(1, BITS + 1))
    polynomial, first = _JOE_KUO[dimension - 1]
    degree = len(first)
    m = list(first)
    for j in range(degree, BITS):
        term = m[j - degree]
        for k in range(1, degree + 1):
            if polynomial >> (degree - k) & 1:
                term ^= m[j - k] << k
        m.append(term)
    return tuple(value << (BITS - j) for j, value in enumerate(m, 1))


@cache
def reversed_directions(dimension: int) -> tuple[int, ...]:
    """Returns the direction numbers with their bits in reverse, as the scrambling needs them."""
    return tuple(reverse(v) for v in directions(dimension))


def mix(z: int) -> int:
    """Returns a bijective mix of 64 bits."""
    for shift, factor in MIX:
        z = (z ^ z >> shift) * factor & _M64
    return z


def key(seed: int, replicate: int, dimension: int) -> int:
    """Returns the 64 bits that identify one replicate of one dimension; `seed` is taken modulo 2⁶⁴."""
    return mix(mix((seed + GAMMA) & _M64) ^ (replicate << 32 | dimension))


def unit(word: int) -> float:
    """Returns a number in (0, 1) from the upper 52 of 64 bits."""
    return (2 * (word >> 12) + 1) * 2.0**-53


def reverse(x: int) -> int:
    """Returns 32 bits in reverse."""
    return int(f"{x:032b}"[::-1], 2)


def scramble(x: int, k: int) -> int:
    """Returns a nested uniform scramble, by the key k, of reversed bits: k and the bits below bit j decide whether bit j is flipped."""
    before, *after = SCRAMBLE
    x ^= x * before & _M32
    x = (x + k) * (k >> 32 | 1) & _M32
    for factor in after:
        x ^= x * factor & _M32
    return x


def random_coordinate(seed: int, index: int, dimension: int) -> float:
    """Returns the coordinate of a pseudo-random point, in (0, 1)."""
    return unit(mix((key(seed, 0, dimension) + index * GAMMA) & _M64))


def sobol_coordinate(seed: int, replicate: int, index: int, dimension: int) -> float:
    """Returns the coordinate of a scrambled Sobol' point, in (0, 1)."""
    x, columns, k = 0, reversed_directions(dimension), key(seed, replicate, dimension)
    for j in range(BITS):
        if (index ^ index >> 1) >> j & 1:
            x ^= columns[j]
    y = reverse(scramble(x, k))
    low = mix((k + y * GAMMA) & _M64) >> (64 - LOW_BITS)
    return unit((y << LOW_BITS | low) << 12)


def replicated(kind: str, count: int) -> tuple[int, int]:
    """Returns the number of replicates of a rule, and the points in each: `count` points in all, or, for "qmc", a few more, to divide
    evenly."""
    return (REPLICATES, -(-count // REPLICATES)) if kind == "qmc" else (1, count)
