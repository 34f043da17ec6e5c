"""Common zeros in the JAX backend: values, agreement with NumPy to the bit, purity, derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from tests.backends.locate_pairs import locate, point
from tests.backends.locate_programs import NESTS, PLACES
from tests.backends.numpy.test_locate import circles_at_random
from tests.backends.programs import INF, Case, columns, expected, program

pytestmark = pytest.mark.slow  # XLA compiles every program

QUICK = (*PLACES[::6], NESTS[0])
CASES = (*QUICK, *(pytest.param(case, marks=pytest.mark.slow) for case in (*PLACES[3::6], *NESTS[1:])))
"""JAX takes half a second to compile each of them: a third of the places, and NumPy has them all."""


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_value_and_agreement_with_numpy(case: Case) -> None:
    found = compile_jax(case.program)(columns(case), case.n)
    reference = compile_numpy(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, reference, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.usefixtures("x64")
def test_circles_at_random_are_those_of_numpy() -> None:
    """Which rectangles are kept hangs on rounded bounds, and those are the same: products are not fused with sums."""
    kernel_program, at, _ = circles_at_random(300)
    np.testing.assert_array_equal(compile_jax(kernel_program)(at, 300), compile_numpy(kernel_program)(at, 300))


@pytest.mark.usefixtures("x64")
def test_function_is_pure() -> None:
    """jit and vmap over `function` give the batch."""
    import jax

    case = PLACES[0]
    kernel = compile_jax(case.program)
    found = jax.jit(jax.vmap(lambda *scalars: kernel.function(scalars), out_axes=1))(*columns(case))
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.usefixtures("x64")
def test_forward_derivatives_are_not_nan() -> None:
    """A place is a part of the range: only the range moves it."""
    import jax

    kernel = compile_jax(program(2, (locate("va vb", point("p1", 0.5), 0.0, "p0", 0.0, 1.0),), "va", "vb"))
    value, rate = jax.jit(lambda *at: jax.jvp(lambda p, q: kernel.function([p, q]), at, (1.0, 1.0)))(1.0, 0.25)
    np.testing.assert_array_equal(value, [0.25, INF])
    np.testing.assert_array_equal(rate, [0.25, 0.0])
