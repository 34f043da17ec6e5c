"""Smoothed derivatives in the demonstrations: near the exact ones, with exact values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import teg
from teg.errors import InputError
from teg.examples.options import DEMOS, resolved
from teg.examples.treatments import LABELS, compiled


def test_smoothed_slopes_are_near_the_exact_ones_and_values_are_exact() -> None:
    x, y, t = teg.var("x"), teg.var("y"), teg.param("t")
    e = teg.integral(teg.bracket(x + y * y < t), (x, 0, 1), (y, 0, 1))
    values = {"t": 0.6}
    exact, smooth, plain = (compiled(e, [t], "numpy", kind) for kind in ("exact", "smooth", "ignore"))
    value, slope = exact.value_and_grad(values)
    same, near = smooth.value_and_grad(values)
    assert smooth.parameters == exact.parameters
    assert same == value
    assert near == smooth.grad(values)
    assert near["t"] != slope["t"]
    assert near["t"] == pytest.approx(slope["t"], rel=0.05)
    assert plain.grad(values)["t"] == 0


def test_a_demo_refuses_treatments_that_it_does_not_have() -> None:
    assert resolved("perlin", {"discontinuities": "smooth"})["discontinuities"] == "smooth"
    with pytest.raises(InputError, match="no --discontinuities smooth"):
        resolved("billiards", {"discontinuities": "smooth"})
    assert {kind for demo in DEMOS.values() for kind in demo.treatments} <= set(LABELS)


def test_a_ball_is_found_by_smoothed_derivatives_but_for_their_bias(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("scipy")
    from teg.examples.bouncing_ball.run import run_bouncing_ball

    report = run_bouncing_ball(out=tmp_path, contacts=1, discontinuities="smooth", backend="numpy", progress=False)
    assert report["beside"] is None
    assert 1e-9 < report["largest_time_error"] < 1e-2
    assert np.isfinite(report["action"])
