"""The midpoint rule, which knows no breaks: its sums, its estimates, and that chunks do not matter."""

from __future__ import annotations

import numpy as np
import pytest

from teg.backends.c.kernel import compile_c
from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from teg.program import Integrate, Midpoint
from tests.backends.test_sampled import BACKENDS, DISK, let, program, run, scheduled

pytestmark = pytest.mark.usefixtures("x64")


@pytest.mark.parametrize("backend", BACKENDS)
def test_midpoints(backend: str) -> None:
    body = (let("v1", "exp", "x1"), let("v2", "sub", 1.3, "x1"), let("b1", "gt0", "v2"), let("v3", "select", "b1", "v1", 0.0))
    integral = Integrate("x1", "p0", 2.0, (), (), None, body, ("v3", "v1"), ("v5", "v6"), Midpoint(100), estimates=("v7", "v8"))
    starts = np.array([-1.0, 0.25, 2.5])
    found = run(program(integral, outputs=("v5", "v6", "v7", "v8")), starts, backend=backend)
    for i, start in enumerate(starts):
        at = start + (2.0 - start) * ((np.arange(100) + 0.5) / 100)
        values = np.array([np.where(at < 1.3, np.exp(at), 0.0), np.exp(at)])
        width = (2.0 - start) / 100
        assert found[:2, i] == pytest.approx(values.sum(axis=1) * width, rel=1e-13)
        assert found[2:, i] == pytest.approx(np.abs(np.diff(values)).sum(axis=1) * abs(width) / 2, rel=1e-9)


def test_midpoint_estimates_hold() -> None:
    """[x < t]·exp(x) for 500 places of the jump: never off by more than the variation allows."""
    body = (let("v1", "exp", "x1"), let("v2", "sub", "p0", "x1"), let("b1", "gt0", "v2"), let("v3", "select", "b1", "v1", 0.0))
    integral = Integrate("x1", 0.0, 1.0, (), (), None, body, ("v3",), ("v5",), Midpoint(37), estimates=("v7",))
    places = np.linspace(0.02, 0.98, 500)
    value, estimate = run(program(integral, outputs=("v5", "v7")), places)
    assert (np.abs(value - np.expm1(places)) <= estimate * (1 + 1e-12)).all()


def test_midpoints_in_chunks_are_the_same() -> None:
    body = (let("v1", "mul", "x1", "p0"), let("v2", "sin", "v1"))
    integral = Integrate("x1", 0.0, 1.0, (), (), None, body, ("v2",), ("v5",), Midpoint(50000), estimates=("v7",))
    p, columns = program(integral, outputs=("v5", "v7")), [np.linspace(1.0, 9.0, 5)]
    assert compile_numpy(p, memory=2**16)(columns, 5) == pytest.approx(compile_numpy(p)(columns, 5), rel=1e-11)
    assert compile_c(p)(columns, 5)[0] == pytest.approx((1 - np.cos(columns[0])) / columns[0], rel=1e-8)
    assert compile_jax(p)(columns, 5) == pytest.approx(compile_numpy(p)(columns, 5), rel=1e-11)


def test_midpoint_evaluations_are_counted() -> None:
    p = scheduled(DISK, "midpoint", "t", order=20)
    assert compile_numpy(p).outcome([np.asarray(0.5)], 1).evaluations == 400
    assert compile_c(p, counted=True).outcome([np.asarray(0.5)], 1).evaluations == 400
