"""Order of integrals: waves over infinite ranges have few roots in the outer variable."""

from __future__ import annotations

import math

import mpmath
import pytest

import teg
from teg.passes.normalise.order import with_few_roots

x, y = teg.vars("x y")
t, a = teg.params("t a")
WHOLE = (-math.inf, math.inf)


def test_integrals_are_exchanged_where_waves_have_few_roots() -> None:
    body = teg.bracket(y < t * teg.sin(x)) * teg.exp(-(x**2) - y**2)
    exchanged = with_few_roots(teg.integral(body, (x, *WHOLE), (y, *WHOLE)))
    assert exchanged is teg.integral(body, (y, *WHOLE), (x, *WHOLE))
    assert with_few_roots(exchanged) is exchanged


@pytest.mark.parametrize(
    "program",
    [
        teg.integral(teg.bracket(y < t * teg.sin(x)) * teg.exp(-(y**2)), (x, 0, 1), (y, *WHOLE)),  # a finite range
        teg.integral(teg.bracket(y**3 + y < teg.sin(x)) * teg.exp(-(x**2)), (x, *WHOLE), (y, 0, 1)),  # no root by formula
        teg.integral(teg.bracket(y < t * teg.sin(x)) * teg.exp(-(x**2)), (x, y, math.inf), (y, 0, 1)),  # bounds that move
        teg.integral(teg.bracket(y < t * x) * teg.exp(-(x**2) - y**2), (x, *WHOLE), (y, *WHOLE)),  # no wave
    ],
)
def test_other_integrals_stay(program: teg.Expr) -> None:
    assert with_few_roots(program) is program


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("inner_first", [True, False])
def test_a_wave_over_the_plane(inner_first: bool, backend: str) -> None:
    ranges = [(x, *WHOLE), (y, *WHOLE)]
    body = teg.bracket(y < t * teg.sin(x)) * teg.exp(-((x - a) ** 2) - y**2)
    f = teg.compile(teg.integral(body, *(ranges if inner_first else reversed(ranges))), [t, a], backend=backend, inaccurate="raise")
    value, gradient = f.value_and_grad(t=0.7, a=1.0)

    def over(density: object) -> float:
        return float(mpmath.quad(density, range(-8, 11)))  # type: ignore[no-untyped-call]

    def bell(u: float) -> mpmath.mpf:
        return mpmath.exp(-((u - 1) ** 2))

    def side(u: float) -> mpmath.mpf:
        return mpmath.sqrt(mpmath.pi) / 2 * (1 + mpmath.erf(0.7 * mpmath.sin(u)))

    assert value == pytest.approx(over(lambda u: bell(u) * side(u)), rel=1e-11)
    assert gradient["t"] == pytest.approx(over(lambda u: bell(u) * mpmath.sin(u) * mpmath.exp(-((0.7 * mpmath.sin(u)) ** 2))), rel=1e-11)
    assert gradient["a"] == pytest.approx(over(lambda u: 2 * (u - 1) * bell(u) * side(u)), rel=1e-11)
