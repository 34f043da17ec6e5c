"""What conditions are on a surface: at random points of the surface, they hold as before."""

from __future__ import annotations

import math

import numpy as np
import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.analysis.implied import decided_on, factors_beside_squares
from teg.ir.expr import Compare, Where, const
from teg.ir.node import postorder

x, y = teg.vars("x y")
t, c = teg.params("t c")
B = teg.bracket
U = 1 - x * x - y * y
V = 2 * x + y - t
NORM = U - 4 * V**2


def atoms(e: teg.Expr) -> set[teg.Expr]:
    return {n.g for n in postorder([e]) if isinstance(n, Compare)}


def test_a_square_decides_what_it_was_made_of() -> None:
    on_norm = decided_on(B((U > 0) & (V < 0)), NORM)
    assert atoms(on_norm) == atoms(B(V < 0))
    assert decided_on(B((NORM > 0) | (V > 0)), U) == B(V > 0)
    assert decided_on(B((U > 0) & ~(NORM > 0)), V) == const(0.0)
    assert decided_on(B(x > 0), NORM) == B(x > 0)


def test_a_positive_square_has_the_other_sign() -> None:
    assert decided_on(B(U > 0), U + 4 * V**2) == const(0.0)
    assert decided_on(B(U + 4 * V**2 > 0), U) == const(1.0)


@pytest.mark.parametrize("factor", [1.0, c * c])
def test_a_root_on_its_square(factor: teg.Expr | float) -> None:
    """√u on k²·u - s·v² = 0, where u is positive but to rounding, at points of that curve."""
    norm = factor * U - 4 * V**2
    e = teg.where(U > 0, teg.sqrt(U), 0)
    new = decided_on(e, norm)
    assert not any(isinstance(n, Where) for n in postorder([new]))
    turn = np.linspace(0.0, 2.0 * math.pi, 50)
    size = 0.7 if isinstance(factor, float) else 0.7 / 1.3
    radius = math.sqrt(1.0 - size * size)
    point = {x: radius * np.cos(turn), y: radius * np.sin(turn), c: 1.3}
    point[t] = 2 * point[x] + point[y] + 0.35 * np.where(turn > 3.0, 1.0, -1.0)
    before, after, zero = values_of([e, new, norm], point)
    assert np.abs(zero).max() < 1e-12
    assert after == pytest.approx(before, abs=1e-12)


def test_the_other_one_of_two_roots() -> None:
    """On √u - √w = c both u and w are squares: (w - u - c²)²/4c² and (w - u + c²)²/4c²."""
    w = 0.7 - (x - t) ** 2 - y * y
    surface = 4 * c * c * U - (w - U - c * c) ** 2
    assert decided_on(B((U > 0) & (w > 0) & (x > 0)), surface) == B(x > 0)
    assert decided_on(B(surface > 0), w) == const(0.0)
    root = decided_on(teg.where(w > 0, teg.sqrt(w), 0), surface)
    # at y = 0, t = 0.2, c = 0.3, √u - √w = ±c for x with (w - u - c²)² = 4c²u
    places = np.roots(np.polyadd(np.polymul([0.4, 0.7 - 0.04 - 1.0 - 0.09], [0.4, 0.7 - 0.04 - 1.0 - 0.09]), [0.36, 0.0, -0.36]))
    point = {x: places.real, y: 0.0, t: 0.2, c: 0.3}
    expected, found, zero = values_of([teg.sqrt(w), root, surface], point)
    assert np.abs(zero).max() < 1e-12
    assert found == pytest.approx(expected, abs=1e-12)


def test_factors_beside_squares() -> None:
    assert factors_beside_squares(c * c * U - V**2) == [c * c]
    assert factors_beside_squares(4 * U - V**2) == []
    assert factors_beside_squares(c * c - V**2) == []  # two lines
    assert factors_beside_squares(c * U - V**2) == []
