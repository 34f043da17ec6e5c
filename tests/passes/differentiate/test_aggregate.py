"""SoftRas's aggregate by depth: its weights, its bias, its limits, and where it does not apply."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import EstimatorError, OptionError
from teg.ir.expr import Expr

x, y = teg.vars("x y")
t, a = teg.params("t a")
k, V = teg.index("k"), teg.array("V", 2)
RECTANGLES = np.array([[0.4, 0.4, 0.3, 1.0], [0.6, 0.55, 0.5, 0.5]])
"""Centre, depth and colour of squares, the first in front."""


def squares(otherwise: float = 0.125) -> Expr:
    inside = (abs(x - V[k, 0]) < 0.3) & (abs(y - V[k, 1]) < 0.3)
    seen = teg.nearest(V[k, 3], V[k, 2], (k, 0, 2), where=inside, otherwise=otherwise)
    return teg.integral(seen * teg.exp(x), (x, 0, 1), (y, 0, 1))


def gradient(e: Expr, sigma: float, gamma: float, **more: Any) -> Any:
    f = teg.compile(e, [V], discontinuities="smooth", samples=2**15, rule="qmc", sigma=sigma, estimator={"gamma": gamma, **more})
    return f.grad(V=RECTANGLES)["V"]


def test_the_order_of_two_depths_is_a_sigmoid_of_their_difference() -> None:
    colour = teg.nearest(1 - k, t * k * x, (k, 0, 2))  # w of the first is 1/(1 + exp(-t·x/γ))
    f = teg.compile(teg.integral(colour, (x, 0, 1)), [t], discontinuities="smooth", rule="adaptive", estimator={"gamma": 0.25})
    s = 1 / (1 + math.exp(-0.5 / 0.25))
    area = 0.25 / 0.5 * (math.log(1 + math.exp(2)) - math.log(2))  # ∫ of the weight, at t = 1/2
    assert f.grad(t=0.5)["t"] == pytest.approx((s - area) / 0.5, rel=1e-6)  # d/dt of ∫₀¹ w(t·x) dx


def test_depth_behind_a_background_is_weighted_by_exp() -> None:
    """A candidate that covers all, at depth z: ∂/∂z of w·v + (1 - w)·o, w = 1/(1 + exp((z - far)/γ))."""
    key = V[k, 2] + 0 * x
    seen = teg.nearest(V[k, 3], key, (k, 0, 1), where=x > V[k, 0] - 9, otherwise=0.25)
    e = teg.integral(seen, (x, 0, 1))
    options: Any = {"gamma": 0.25, "far": 0.75}
    slopes = teg.compile(e, [V], discontinuities="smooth", sigma=0.01, rule="adaptive", estimator=options).grad(V=RECTANGLES)["V"]
    w = 1 / (1 + math.exp((0.3 - 0.75) / 0.25))
    assert slopes[0, 3] == pytest.approx(w, rel=1e-9)
    assert slopes[0, 2] == pytest.approx(-w * (1 - w) / 0.25 * (1.0 - 0.25), rel=1e-9)


def test_the_aggregate_converges_as_both_widths_vanish() -> None:
    truth = teg.compile(squares(), [V]).grad(V=RECTANGLES)["V"]
    errors = [np.abs(gradient(squares(), s, g) - truth).max() for s, g in ((0.02, 0.2), (0.0005, 0.025))]
    assert errors[1] < errors[0] / 3


def test_a_border_is_seen_too_far_out_by_the_step_of_depth() -> None:
    """The colour's derivative is the area seen, which a border at distance Δ·σ/γ outside of each side makes larger."""
    sigma, gamma = 0.004, 0.05
    area = gradient(squares(), sigma, gamma)[0, 3]
    moved = [(1.0 - 0.3) * sigma / gamma, (0.5 - 0.3) * sigma / gamma]  # towards the background, towards the other square
    low, high = ((math.exp(0.7 + m) - math.exp(0.1 - m)) * (0.6 + 2 * m) for m in sorted(moved))
    assert low < area < high


def test_the_value_is_not_softened() -> None:
    f = teg.compile(squares(), [V], discontinuities="smooth", rule="qmc", samples=2**12, estimator={"gamma": 0.2})
    assert f(V=RECTANGLES) == pytest.approx(teg.compile(squares(), [V])(V=RECTANGLES), rel=2e-3)


def test_backends_agree() -> None:
    found = [
        teg.compile(squares(), [V], backend=b, discontinuities="smooth", samples=500, estimator={"gamma": 0.2}).grad(V=RECTANGLES)["V"]
        for b in ("numpy", "c")
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def test_where_it_does_not_apply_is_an_error() -> None:
    half_plane = teg.integral(teg.bracket(x < t), (x, 0, 1))
    with pytest.raises(EstimatorError, match="of which this program has none"):
        teg.compile(half_plane, [t], discontinuities="smooth", estimator={"gamma": 0.1})
    with pytest.raises(EstimatorError) as raised:
        teg.compile(squares(), [V], discontinuities="smooth").grad(V=RECTANGLES)
    assert "gamma" in raised.value.hint
    for options in ({"gamma": 0.0}, {"gamma": -1.0}, {"gamma": "soft"}, {"gamma": 0.1, "far": math.inf}, {"gamma": 0.1, "far": "away"}):
        with pytest.raises(OptionError):
            teg.compile(squares(), [V], discontinuities="smooth", estimator=options)
