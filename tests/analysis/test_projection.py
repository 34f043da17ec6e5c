"""Slices of solids: where two of their curves meet on a side of the box is found to the last digit, so no call warns.

References: mpmath with 30 digits, areas of slices in closed form.
"""

from __future__ import annotations

import math

import pytest

import teg
from teg.ir.expr import Expr
from tests.backends.c_checks import in_c

pytestmark = pytest.mark.filterwarnings("error")

x, y, z = teg.vars("x y z")
t, d, a, b, c, p, q = teg.params("t d a b c p q")
CUBE = ((x, 0, 1), (y, 0, 1), (z, 0, 1))


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("backend", ["numpy", "jax", pytest.param("c", marks=in_c)])
def test_a_ball_and_a_plane(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket((x * x + y * y + z * z < t) & (x + y - z > d - 0.4)), *CUBE), [t, d], backend=backend)
    value, slopes = f.value_and_grad(t=0.45, d=0.37)
    assert value == pytest.approx(0.12780226891100108, rel=1e-14)
    assert slopes == pytest.approx({"t": 0.42178719238926490, "d": -0.12661111942216020}, rel=1e-11)
    _, estimate = f.value_and_error(t=0.45, d=0.37)
    assert estimate < 1e-13


@pytest.mark.parametrize(
    "inside",
    [
        (x * x + y * y + z * z < t) & (a * x + b * y + c * z > d),
        ((x - p) ** 2 + (y - q) ** 2 + z * z < t) & (a * x + b * y + c * z > d),
        (x * x + y * y < t) & (a * x + b * y + c * z > d),
        (x * x + y * y < z * z * t) & (a * x + b * y + c * z > d),
        (x * x + y * y + z * z < t) & (a * x + b * y > d) & (x - c * z < 0.4),
    ],
    ids=["ball", "ball elsewhere", "cylinder", "cone", "two planes"],
)
def test_planes_with_coefficients(inside: Expr) -> None:
    f = teg.compile(teg.integral(teg.bracket(inside), *CUBE), [t], backend="numpy")
    given = {"t": [0.3, 0.45, 0.7], "d": [0.37, 0.4, 0.6], "a": 0.9, "b": [0.7, 1.2, 1.1], "c": [0.35, -0.2, 0.8], "p": 0.2, "q": 0.31}
    _, estimates = f.value_and_error({name: given[name] for name in f.parameters})
    assert max(estimates) < 1e-10


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=in_c)])
def test_two_balls(backend: str) -> None:
    """Where their slices touch is found as a double root, to half of its digits, but the area of a slice is continuous there. Reference:
    the volume of a lens."""
    first, second, r = (0.4, 0.4, 0.45), (0.6, 0.55, 0.5), 0.3
    balls = [(x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2 < t for u, v, w in (first, second)]
    f = teg.compile(teg.integral(teg.bracket(balls[0] & balls[1]), *CUBE), [t], backend=backend)
    apart = math.dist(first, second)
    value, estimate = f.value_and_error(t=r * r)
    assert value == pytest.approx(math.pi * (4 * r + apart) * (2 * r - apart) ** 2 / 12, rel=1e-14)
    assert estimate < 1e-9
    slope = math.pi * ((2 * r - apart) ** 2 + (4 * r + apart) * (2 * r - apart)) / (6 * r)
    assert f.grad(t=r * r)["t"] == pytest.approx(slope, rel=1e-10)
