"""Points of sampled integrals: the three backends' and the reference's are equal to the last bit, well distributed, and unbiased."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from teg.backends.c.build import load_library
from teg.backends.c.runtime import runtime
from teg.backends.c.samples import sobol_table
from teg.backends.numpy import samples as numpy_sampling
from teg.numerics.sobol import (
    BITS,
    DIMENSIONS,
    REPLICATES,
    directions,
    key,
    mix,
    random_coordinate,
    replicated,
    reverse,
    scramble,
    sobol_coordinate,
    unit,
)

Array = npt.NDArray[np.float64]
KINDS = ("montecarlo", "qmc")
SEEDS = (0, 1, 12345, 2**63 + 11)

C_POINTS = """
TEG_EXPORT void points(int sobol, uint64_t seed, int dimensions, int replicates, long each, double *out)
{
    for (int d = 0; d < dimensions; d++) {
        for (int r = 0; r < replicates; r++) {
            const uint64_t key = teg_key(seed, r, d);
            uint32_t x = 0;
            for (long i = 0; i < each; i++) {
                *out++ = sobol ? teg_scrambled(key, x) : teg_random(key, i);
                x ^= teg_sobol[32 * d + teg_column(i)];
            }
        }
    }
}
"""


@pytest.fixture(scope="module")
def c_points() -> Callable[[str, int, int, int], Array]:
    library = load_library("\n\n".join([*runtime([C_POINTS]), sobol_table(DIMENSIONS), C_POINTS]))
    library.points.argtypes = [ctypes.c_int, ctypes.c_uint64, ctypes.c_int, ctypes.c_int, ctypes.c_long, ctypes.c_void_p]

    def points(kind: str, seed: int, dimensions: int, count: int) -> Array:
        replicates, each = replicated(kind, count)
        out = np.empty((dimensions, replicates * each))
        library.points(kind == "qmc", seed, dimensions, replicates, each, out.ctypes.data)
        return out

    return points


def by_numpy(kind: str, seed: int, dimensions: int, count: int) -> Array:
    replicates, each = replicated(kind, count)
    return numpy_sampling.points(kind, seed, dimensions, count, 0, replicates * each)


def by_definition(kind: str, seed: int, dimension: int, number: int, count: int) -> float:
    replicate, index = divmod(number, replicated(kind, count)[1])
    return sobol_coordinate(seed, replicate, index, dimension) if kind == "qmc" else random_coordinate(seed, index, dimension)


# -- the same numbers everywhere ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", KINDS)
def test_numpy_has_the_numbers_of_the_reference(kind: str, seed: int) -> None:
    count = 300
    found = by_numpy(kind, seed, DIMENSIONS, count)
    assert found.shape == (DIMENSIONS, 304 if kind == "qmc" else 300)
    wanted = [[by_definition(kind, seed, d, i, count) for i in range(found.shape[1])] for d in range(DIMENSIONS)]
    assert np.array_equal(found, np.array(wanted))


@pytest.mark.parametrize("kind", KINDS)
def test_any_stretch_of_points_can_be_had(kind: str) -> None:
    whole = by_numpy(kind, 5, 3, 1000)
    assert np.array_equal(numpy_sampling.points(kind, 5, 3, 1000, 117, 730), whole[:, 117:730])
    far = 2**31 + 77
    at = numpy_sampling.points(kind, 5, 2, 2**36, far, far + 3)
    assert [by_definition(kind, 5, 1, far + i, 2**36) for i in range(3)] == list(at[1])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", KINDS)
def test_c_has_the_numbers_of_numpy(kind: str, seed: int, c_points: Callable[..., Array]) -> None:
    assert np.array_equal(c_points(kind, seed, DIMENSIONS, 5000), by_numpy(kind, seed, DIMENSIONS, 5000))


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("seed", [SEEDS[0], SEEDS[-1]])
@pytest.mark.parametrize("kind", KINDS)
def test_jax_has_the_numbers_of_numpy(kind: str, seed: int) -> None:
    import jax

    from teg.backends.jax import samples as jax_sampling

    replicates, each = replicated(kind, 5000)

    def points(numbers: Any) -> Any:
        return jax_sampling.points(kind, seed, DIMENSIONS, 5000, numbers // each, numbers % each)

    found = np.asarray(jax.jit(points)(np.arange(replicates * each)))
    assert np.array_equal(found, by_numpy(kind, seed, DIMENSIONS, 5000))


# -- what the numbers are ----------------------------------------------------------------------------------------------


def test_direction_numbers_are_joe_and_kuos() -> None:
    qmc = pytest.importorskip("scipy.stats").qmc
    published = qmc.Sobol(DIMENSIONS, scramble=False, bits=BITS)
    published.fast_forward(1)  # its first point is 0
    numbers = np.zeros(DIMENSIONS, dtype=np.uint64)
    for i, row in enumerate(published.random(4095), 1):
        column = (i & -i).bit_length() - 1  # where the Gray codes of i - 1 and i differ
        numbers ^= np.array([directions(d)[column] for d in range(DIMENSIONS)], dtype=np.uint64)
        assert np.array_equal(row * 2.0**BITS, numbers.astype(np.float64))


def test_every_direction_number_has_its_leading_bit_in_place() -> None:
    for d in range(DIMENSIONS):
        assert [v & -v for v in directions(d)] == [1 << (BITS - 1 - j) for j in range(BITS)]


def test_mix_is_the_finaliser_of_splitmix64() -> None:
    """The first numbers of SplitMix64 from the state 1234567, as published with its C code (Vigna 2015)."""
    state, found = 1234567, []
    for _ in range(5):
        state = (state + 0x9E3779B97F4A7C15) % 2**64
        found.append(mix(state))
    assert found == [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431, 16408922859458223821]


def test_coordinates_are_never_0_or_1() -> None:
    assert unit(0) == 2.0**-53
    assert unit(2**64 - 1) == 1.0 - 2.0**-53


def test_reverse_is_its_own_inverse() -> None:
    for x in (0, 1, 0x80000000, 0x12345678, 2**32 - 1):
        assert reverse(reverse(x)) == x
    assert reverse(1) == 0x80000000


def test_a_scramble_is_nested() -> None:
    """Points that share their first m bits share them afterwards, and no others do: a bijection on every number of bits."""
    k = key(3, 1, 4)
    for m in range(1, 9):
        images = {scramble(x, k) % 2**m for x in range(2**m)}
        assert len(images) == 2**m
        for x in range(0, 2**m, 3):
            assert scramble(x + (0x5A5A5A << m) % 2**32, k) % 2**m == scramble(x, k) % 2**m


@pytest.mark.parametrize("m", [4, 7, 10])
def test_replicates_are_nets(m: int) -> None:
    """2ᵐ points in two dimensions: one in every elementary interval of area 2⁻ᵐ (a (0, m, 2)-net); in one, a Latin hypercube of all."""
    count = REPLICATES * 2**m
    found = by_numpy("qmc", 9, DIMENSIONS, count).reshape(DIMENSIONS, REPLICATES, 2**m)
    for r in range(REPLICATES):
        for d in range(DIMENSIONS):
            assert np.array_equal(np.sort(np.floor(found[d, r] * 2**m)), np.arange(2**m))
        x, y = found[0, r], found[1, r]
        for k in range(m + 1):
            boxes = np.floor(x * 2**k) * 2 ** (m - k) + np.floor(y * 2 ** (m - k))
            assert np.array_equal(np.sort(boxes), np.arange(2**m))


def test_replicates_and_seeds_differ() -> None:
    found = [by_numpy("qmc", seed, 2, 64).reshape(2, REPLICATES, 8)[:, r].tobytes() for seed in range(20) for r in range(REPLICATES)]
    assert len(set(found)) == len(found)


# -- what they are good for --------------------------------------------------------------------------------------------


def smooth(points: Array) -> Array:
    """A function of three variables whose integral is (e - 1)³."""
    result: Array = np.exp(points.sum(axis=0))
    return result


EXACT = (math.e - 1.0) ** 3


def spread(kind: str, count: int, seeds: int = 40) -> float:
    """The root mean square error of a rule over seeds."""
    errors = [smooth(by_numpy(kind, seed, 3, count)).mean() - EXACT for seed in range(seeds)]
    return float(np.sqrt(np.mean(np.square(errors))))


def test_rates_of_convergence() -> None:
    few, many = 2**8, 2**14
    random = math.log(spread("montecarlo", few) / spread("montecarlo", many), many / few)
    scrambled = math.log(spread("qmc", few) / spread("qmc", many), many / few)
    assert 0.4 < random < 0.6
    assert scrambled > 1.2  # Owen 1997: 3/2, but for logarithms


def test_scrambles_are_unbiased() -> None:
    """One point of a scrambled replicate is uniform: its mean over many seeds is ½ and its variance 1/12; of any low bits too."""
    found = np.array([by_numpy("qmc", seed, 3, 32) for seed in range(4000)])  # (seeds, dimensions, points)
    n = found.shape[0]
    assert np.abs(found.mean(axis=0) - 0.5).max() < 5 * math.sqrt(1 / 12 / n)
    assert np.abs(found.var(axis=0) - 1 / 12).max() < 5 * math.sqrt(1 / 180 / n)
    low = found * 2.0**32 % 1.0
    assert np.abs(low.mean(axis=0) - 0.5).max() < 5 * math.sqrt(1 / 12 / n)


def test_a_scramble_has_the_variance_of_a_random_one() -> None:
    """In one dimension 2ᵐ points, one uniform in each cell: the variance of the mean of u is 8⁻ᵐ/12 (Owen 1997)."""
    for m in (2, 4, 6, 8):
        means = [by_numpy("qmc", seed, 2, REPLICATES * 2**m).reshape(2, REPLICATES, -1).mean(axis=2) - 0.5 for seed in range(400)]
        wanted = 8.0**-m / 12.0
        assert np.mean(np.square(means), axis=(0, 2)) == pytest.approx(wanted, rel=0.12)
