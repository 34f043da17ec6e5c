"""Integrals whose values cancel: their errors count relative to what is left, not to what cancelled."""

from __future__ import annotations

import math
import warnings

import pytest

import teg
from teg.evaluator.accuracy import AccuracyWarning
from teg.program.interpreter import interpret

x = teg.var("x")
t, w = teg.params("t w")
IN_ALL = pytest.mark.parametrize("backend", ["c", "numpy", "jax"])
PEAK = teg.integral(w / ((x - t) ** 2 + w**2), (x, 0, 1))
"""atan((1 - t)/w) + atan(t/w), of which the derivative by t is about w, and by w about -1, while the integrands are as large as 1/w²."""


def _slopes(centre: float, width: float) -> dict[str, float]:
    ends = (1.0 - centre, centre)
    return {
        "t": sum(sign * width / (width**2 + end**2) for sign, end in zip((-1, 1), ends, strict=True)),
        "w": -sum(end / (width**2 + end**2) for end in ends),
    }


@IN_ALL
def test_a_wrong_gradient_says_so(x64: None, backend: str) -> None:
    f = teg.compile(PEAK, [t, w], backend=backend)
    for width in (1e-2, 1e-4, 1e-5, 1e-6, 1e-7):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", AccuracyWarning)
            got = f.grad(t=0.3, w=width)
        error = max(abs(got[k] - v) for k, v in _slopes(0.3, width).items())
        assert error < 1e-8 or any("misses the tolerance" in str(s.message) for s in said), (width, error)
        assert width < 1e-4 or not said


@IN_ALL
def test_what_cancels_exactly_is_silent(x64: None, backend: str) -> None:
    """The mass of a peak inside of the range does not depend on where it is; of a sine nothing is left."""
    mass = teg.integral(teg.exp(-(((x - t) / w) ** 2)), (x, -2, 3))
    f = teg.compile(teg.tuple(mass, teg.integral(teg.sin(math.pi * x) * teg.exp(-x * x), (x, -1, 1))), [t, w], backend=backend)
    for width in (0.3, 0.03):
        with warnings.catch_warnings():
            warnings.simplefilter("error", AccuracyWarning)
            assert f(t=0.5, w=width) == pytest.approx([math.sqrt(math.pi) * width, 0.0], rel=1e-10, abs=1e-15)
            assert f.grad(t=0.5, w=width)["t"] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_the_interpreter_says_so() -> None:
    program = teg.compile(PEAK, [t, w], backend="numpy").program(1)
    assert [interpret(program, [0.3, width]).missed for width in (1e-2, 1e-6)] == [False, True]
