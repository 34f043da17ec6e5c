"""The ball over an uneven, moving floor: its formula, and its path against a simulation of elastic rebounds."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import teg
from teg.__main__ import main
from teg.errors import InputError

pytest.importorskip("scipy")

from teg.examples.bouncing_ball.floor import GRAVITY, Flight, Search, find_path, make_flight, read_floor

SETTINGS: dict[str, Any] = {"backend": "numpy", "seed": 0, "steps": 200}
FLOOR = "0.15*sin(2*x) + 0.3*t"


def simulated(flight: Flight, search: Search) -> list[tuple[float, float]]:
    """Times and places of the contacts of a ball that starts as the path does and rebounds elastically; by bisection."""
    t, x, y = (float(knot[0]) for knot in flight.knots(search.moving))
    times, places, heights = flight.knots(search.moving)
    length = times[1] - times[0]
    velocity = np.array([(places[1] - places[0]) / length, (heights[1] - heights[0]) / length + GRAVITY * length / 2])
    contacts = []
    for _ in range(flight.contacts):

        def gap(s: float, start: tuple[float, float, float] = (t, x, y), v: np.ndarray = velocity) -> float:
            place = start[1] + v[0] * s
            return start[2] + v[1] * s - GRAVITY / 2 * s * s - (0.15 * math.sin(2 * place) + 0.3 * (start[0] + s))

        low, high = 0.05, 0.05
        while gap(high) > 0:
            low, high = high, high + 0.01
        for _ in range(80):
            low, high = (low, (low + high) / 2) if gap((low + high) / 2) < 0 else ((low + high) / 2, high)
        t, x, y = t + low, x + velocity[0] * low, y + velocity[1] * low - GRAVITY / 2 * low * low
        velocity = velocity - np.array([0, GRAVITY * low])
        normal = np.array([-0.3 * math.cos(2 * x), 1.0])
        velocity = velocity - 2 * normal * ((velocity - np.array([0, 0.3])) @ normal) / (normal @ normal)
        contacts.append((t, x))
    return contacts


def test_a_floor_that_takes_energy() -> None:
    flight = make_flight(FLOOR, 2, None, "numpy", 0.8)
    search = find_path(flight, FLOOR, SETTINGS, "exact")
    assert search.failure == ""
    assert flight.rebound_error(search.moving) < 1e-9
    assert flight.depth(search.moving) < 1e-9
    level = make_flight("0", 3, None, "numpy", 0.7)
    found = find_path(level, "0", SETTINGS, "exact")
    assert found.failure == ""
    energies = level.energies(found.moving)
    times, places, _ = level.knots(found.moving)
    across = (places[1] / times[1]) ** 2 / 2  # of the horizontal velocity nothing is lost
    np.testing.assert_allclose(energies[1:] - across, 0.7**2 * (energies[:-1] - across), rtol=1e-8)


def test_the_path_is_that_of_elastic_rebounds() -> None:
    flight = make_flight(FLOOR, 2, None, "numpy")
    search = find_path(flight, FLOOR, SETTINGS, "exact")
    assert search.failure == ""
    assert flight.rebound_error(search.moving) < 1e-9
    assert flight.depth(search.moving) < 1e-9
    contacts = np.array(simulated(flight, search))
    np.testing.assert_allclose(contacts.T.ravel(), search.moving, atol=1e-7)


def test_without_jumps_the_rebounds_are_wrong() -> None:
    flight = make_flight(FLOOR, 1, None, "numpy")
    assert find_path(flight, FLOOR, SETTINGS, "exact").failure == ""
    plain = find_path(flight, FLOOR, SETTINGS, "ignore")
    assert plain.failure or flight.rebound_error(plain.moving) > 1e-3


def test_formulas() -> None:
    x, t = teg.params("x t")
    read = teg.compile(read_floor("-0.1*sin(3*x)**2/(1 + t) + pi - minimum(x, 2)", x, t), [], backend="numpy")
    assert read(x=0.7, t=1.5) == pytest.approx(-0.1 * math.sin(2.1) ** 2 / 2.5 + math.pi - 0.7)
    for text in ("x +", "y", "__import__('os')", "x.real", "sin(x", "sin()", "1/0", "9**9**9", "'x'", "x if t else 1", "True"):
        with pytest.raises(InputError) as error:
            read_floor(text, x, t)
        assert repr(text) in error.value.what


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    quick = ["--backend", "numpy", "--contacts", "1", "--alone", "-o", str(tmp_path)]
    assert main(["demo", "bouncing-ball", "--floor", "0.1*x", *quick]) == 0
    assert (tmp_path / "bouncing_ball.png").stat().st_size > 5000
    assert main(["demo", "bouncing-ball", "--floor", "0.1*x", "--steps", "1", *quick]) == 3
    assert main(["demo", "bouncing-ball", "--speed", "1e9", *quick, "--contacts", "2"]) == 3
    assert "did not converge" in capsys.readouterr().err


@pytest.mark.parametrize(("floor", "code"), [("1/(x - 2.5)", 2), ("exp(50*x)", 2), ("log(x - 50)", 2), ("sqrt(5 - x)", 3)])
def test_a_floor_that_is_not_finite_everywhere_is_one_line(
    floor: str, code: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    assert main(["demo", "bouncing-ball", "--floor", floor, "--backend", "numpy", "--steps", "3", "-o", str(tmp_path)]) == code
    assert capfd.readouterr().err.count("\n") == 1
