"""Searches in which g is bent, lost in rounding, or has more roots than there is room for: roots, errors and notes, in every backend."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from teg.program import Arg, Isolate, Program
from tests.backends.isolate_surfaces import cubic, isolate, numbered, wave
from tests.backends.programs import INF, let, program

BACKENDS = ("numpy", "c", "jax")


def kernel(whole: Program, backend: str) -> Any:
    if backend == "c":
        from teg.backends.c.kernel import compile_c

        return compile_c(whole)
    if backend == "jax":
        from teg.backends.jax.kernel import compile_jax

        return compile_jax(whole)
    from teg.backends.numpy.kernel import compile_numpy

    return compile_numpy(whole)


def parabola(results: str, noise: Arg) -> Isolate:
    """p2·((x - p0)² - p1) with bounds that tell nothing but how it is bent."""
    point = (
        let("vx", "sub", "x0", "p0"),
        let("vx2", "powi", "vx", 2),
        let("vh", "sub", "vx2", "p1"),
        let("vg", "mul", "p2", "vh"),
        let("vd", "mul", 2.0, "p2", "vx"),
        let("vc", "mul", 2.0, "p2"),
    )
    enclosure = (let("vb", "mul", 2.0, "p2"),)
    names = tuple(results.split())
    found = Isolate("x0", -1.0, 2.0, "x0l", "x0r", enclosure, (-100.0, 100.0, -100.0, 100.0), point, "vg", "vd", names)
    return replace(found, curving=("vb", "vb"), curvature="vc", noise=noise)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_bent_function_is_decided_where_it_turns(sign: float, backend: str, x64: None) -> None:
    """Roots as near to each other as numbers are; nothing is halved forty times."""
    run = kernel(program(3, (parabola("vr0 vr1", 0.0),), "vr0", "vr1"), backend)
    for gap in (0.25, 1e-4, 1e-9, 0.0, -1e-30, -1e-3):
        out = run.outcome([np.array([0.3, -0.7]), np.array(math.copysign(gap * gap, gap)), np.array(sign)], 2)
        expected = [[INF, INF]] * 2 if gap < 0 else [[0.3 - gap, -0.7 - gap], [0.3 + gap, -0.7 + gap]]
        np.testing.assert_allclose(out.values, expected, rtol=4e-16, atol=1e-15)
        assert not out.crowded


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_tangency_to_rounding_says_how_far_it_may_be_off(backend: str, x64: None) -> None:
    search = replace(parabola("vr0 vr1", 1e-12), errors=("ve0", "ve1"), tol=1e-9)
    run = kernel(program(3, (search,), "vr0", "vr1", "ve0", "ve1"), backend)
    for c in (0.0, 5e-13, -5e-13):
        out = run.outcome([np.array(0.3), np.array(c), np.array(1.0)], 1)
        np.testing.assert_allclose(out.values[:, 0], [0.3, 0.3, 1e-6, 1e-6], rtol=1e-9)
        assert out.missed
    out = run.outcome([np.array(0.3), np.array(4e-12), np.array(1.0)], 1)
    np.testing.assert_allclose(out.values[:, 0], [0.3 - 2e-6, 0.3 + 2e-6, 0.0, 0.0], rtol=1e-9)
    assert not out.missed


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_cluster_that_is_lost_in_rounding_is_one_place(backend: str, x64: None) -> None:
    """x³ where 1e-9 is lost: a root somewhere between -1e-3 and 1e-3."""
    search = isolate("vr0 vr1", cubic(0.0), -1.0, 1.3)
    search = replace(search, curving=(-8.0, 8.0), noise=1e-9, errors=("ve0", "ve1"), tol=1e-9)
    bent = replace(search, point=(*search.point, let("vc", "mul", 6.0, "x0")), curvature="vc")
    out = kernel(program(0, (bent,), "vr0", "vr1", "ve0", "ve1"), backend).outcome([], 1)
    root, absent, error, none = out.values[:, 0]
    assert abs(root) <= error < 1e-2
    assert (absent, none) == (INF, 0.0)
    assert out.missed


@pytest.mark.parametrize("backend", BACKENDS)
def test_too_little_room_is_said(backend: str, x64: None) -> None:
    """Of roots, and of boxes on a level; more room has the answer."""
    for count, width, crowded in ((8, 128, True), (9, 128, False), (16, 8, True)):
        names = numbered(count)
        search = replace(isolate(names, wave("p0"), 0.1, 10.0), width=width)
        out = kernel(program(1, (search,), *names.split()), backend).outcome([np.array([3.0, 0.01])], 2)
        assert out.crowded is crowded
        assert np.isnan(out.values[:, 0]).all() == crowded
        assert (out.values[:, 1] == INF).all()
        if not crowded:
            np.testing.assert_allclose(out.values[:, 0], [math.pi * j / 3 for j in range(1, 10)], rtol=1e-15)


def test_backends_agree_on_random_clusters() -> None:
    """NumPy and C, on parabolas whose roots are at random distances, with noise and without."""
    rng = np.random.default_rng(5)
    centre, gap = rng.uniform(-0.8, 1.8, 500), rng.choice([1.0, -1.0], 500) * 10.0 ** rng.uniform(-24, -1, 500)
    for noise in (0.0, 1e-13):
        whole = program(3, (replace(parabola("vr0 vr1", noise), errors=("ve0", "ve1")),), "vr0", "vr1", "ve0", "ve1")
        columns = [centre, gap, rng.choice([1.0, -1.0], 500)]
        one, other = (kernel(whole, backend)(columns, 500) for backend in ("numpy", "c"))
        np.testing.assert_allclose(one, other, rtol=1e-14, atol=1e-15)
