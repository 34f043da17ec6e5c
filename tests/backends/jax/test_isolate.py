"""Roots and sums over them in the JAX backend: exact values, agreement with NumPy, purity, and polynomials at random."""

from __future__ import annotations

import numpy as np
import pytest

from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from tests.backends.isolate_programs import EXTREMES, ROOTS, SUMS
from tests.backends.isolate_surfaces import cubic, isolate, kink, line, root, sum_over, wave
from tests.backends.numpy.test_isolate import polynomial, polynomials_at_random, roots
from tests.backends.programs import INF, Case, columns, expected, let, program

QUICK = (*EXTREMES, *ROOTS[::3], *SUMS)
CASES = (*QUICK, *(pytest.param(case, marks=pytest.mark.slow) for case in ROOTS[1::3]))
"""JAX takes half a second to compile each of them: two thirds, and NumPy has them all."""


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_value_and_agreement_with_numpy(case: Case) -> None:
    found = compile_jax(case.program)(columns(case), case.n)
    reference = compile_numpy(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, reference, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.usefixtures("x64")
def test_where_roots_are_not_asked_for_there_are_none() -> None:
    asked = let("b0", "gt0", "p0")
    found = compile_jax(program(1, (asked, isolate("vr0 vr1", line(1.0, 0.5), 0.0, 1.0, when="b0")), "vr0", "vr1"))
    np.testing.assert_array_equal(found([np.array([1.0, -1.0])], 2), [[0.5, INF], [INF, INF]])


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("degree", [2, 3, 8])
def test_polynomials_at_random(degree: int) -> None:
    kernel_program, coefficients, table = polynomials_at_random(degree, 200)
    found = compile_jax(kernel_program)(coefficients, 200)
    np.testing.assert_allclose(found, table, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found, compile_numpy(kernel_program)(coefficients, 200), rtol=1e-12, atol=1e-12)


@pytest.mark.usefixtures("x64")
def test_function_is_pure() -> None:
    """jit and vmap over `function` give the batch."""
    import jax

    case = SUMS[0]
    kernel = compile_jax(case.program)
    found = jax.jit(jax.vmap(lambda *scalars: kernel.function(scalars), out_axes=1))(*columns(case))
    np.testing.assert_allclose(found, expected(case), rtol=1e-14, atol=1e-15)


@pytest.mark.usefixtures("x64")
def test_only_the_crowded_element_is_nan() -> None:
    kernel_program = roots(wave("p0"), 1, lo=0.5, hi=3.5)
    at = [np.array([1.0, 1e4, 2.0])]
    np.testing.assert_allclose(compile_jax(kernel_program)(at, 3), compile_numpy(kernel_program)(at, 3), rtol=1e-15)


@pytest.mark.usefixtures("x64")
def test_roots_at_box_ends_and_rounded_tangencies_are_those_of_numpy() -> None:
    """Which boxes are kept hangs on rounded values, and those are the same: products are not fused with sums."""
    a, c = (v.ravel() / 20 for v in np.mgrid[1:20, 1:20])
    kernel_program = roots(kink("p0", "p1"), 2, 2, -1e-9, 1 + 1e-9)
    np.testing.assert_array_equal(compile_jax(kernel_program)([a, c], a.size), compile_numpy(kernel_program)([a, c], a.size))
    a = np.arange(1, 100) / 100
    kernel_program = roots(polynomial(["p0", "p1", 1.0]), 2, 16, -1e-9, 1 + 1e-9)
    at = [a * a, -2 * a]
    np.testing.assert_array_equal(compile_jax(kernel_program)(at, a.size), compile_numpy(kernel_program)(at, a.size))


@pytest.mark.usefixtures("x64")
def test_the_border_of_the_domain_is_no_root() -> None:
    for results in (1, 2):
        found = compile_jax(roots(root("p0", strict=True), 1, results, -1.0, 4.0))([np.array([1.0, 3.0])], 2)
        np.testing.assert_allclose(found, [[1.0, INF], [INF, INF]][:results])


@pytest.mark.usefixtures("x64")
def test_forward_derivatives_are_those_of_the_roots_and_not_nan() -> None:
    """Newton's last step carries the derivative; a point that is not there adds nothing."""
    import jax

    found = roots(cubic("p0"), 1)
    total = sum_over("vs", "x1", found.outputs, (let("v2", "powi", "x1", 2), let("vl", "log", "v2"), let("vt", "mul", "x1", "vl")), "vt")
    kernel = compile_jax(program(1, (*found.body, total), *found.outputs, "vs"))
    lone = compile_jax(program(1, (*roots(cubic("p0"), 1, lo=0.5).body, total), "vs"))
    value, rate = jax.jvp(lambda p: kernel.function([p]), (2.25,), (1.0,))
    np.testing.assert_allclose(value[:4], [-1.5, 0.0, 1.5, INF], atol=1e-15)
    np.testing.assert_allclose(rate[:4], [-1 / 3, 0.0, 1 / 3, 0.0], rtol=1e-14, atol=1e-15)
    value, rate = jax.jvp(lambda p: lone.function([p]), (2.25,), (1.0,))
    np.testing.assert_allclose([value[0], rate[0]], [1.5 * np.log(2.25), (np.log(2.25) + 2) / 3], rtol=1e-14)
