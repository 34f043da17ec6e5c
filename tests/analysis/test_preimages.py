"""Roots of f(u) = c where u = f⁻¹(c): how many there are between bounds, and where f has no such value."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.analysis.roots import solve
from teg.ir.expr import const

x = teg.var("x")
t = teg.param("t")


def test_zeros_of_a_wave_whose_phase_is_a_parameter_are_counted() -> None:
    """An interval that is half a period long has two at most, wherever it begins; of a wave whose frequency is a parameter that is open."""
    phase, pitch = teg.params("phase pitch")
    known = solve(teg.sin(2 * x + phase) - 0.3, x, const(0.0), const(1.5))
    assert known is not None
    assert known.certain
    assert len(known.found) == 4
    for at in (-7.0, 0.2, 1.3, 2.9):
        places = [float(teg.evaluate(r.point, phase=at)) for r in known.found]
        found = [v for v in places if 0.0 <= v <= 1.5]
        expected = [(u - at) / 2 + turn * np.pi for u in (np.arcsin(0.3), np.pi - np.arcsin(0.3)) for turn in range(-9, 10)]
        assert sorted(found) == pytest.approx(sorted(v for v in expected if 0.0 <= v <= 1.5), abs=1e-12)
    unknown = solve(teg.sin(pitch * x) - 0.3, x, const(0.0), const(1.5))
    assert unknown is not None
    assert not unknown.certain


BEYOND = {
    "an angle of a pole": (teg.atan(-1.1 / x) < t, 0.0, [4.73, 5.0, -4.0]),
    "an angle": (teg.atan2(-1.1, x) < t, -1.0, [3.5, 4.73, 6.0]),
    "times a parameter": (t * teg.atan2(-1.1, x) < 2, -1.0, [0.4, 0.43, -0.6]),
}
"""Conditions that hold for all x up to 1 or for none, the lower bound of x, and values of t: the level of the angle is beyond ±π."""


@pytest.mark.parametrize("name", BEYOND)
def test_no_direction_has_an_angle_beyond_a_half_turn(name: str) -> None:
    """4.73 and 4.73 - 2π are one half-line, on which the angle is the second of them."""
    condition, least, values = BEYOND[name]
    f = teg.compile(teg.integral(teg.bracket(condition), (x, least, 1)), [t])
    for value in values:
        found, slopes = f.value_and_grad(t=value)
        assert found in (0.0, 1.0 - least)
        assert slopes["t"] == 0.0
