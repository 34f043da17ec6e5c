"""Jumps of functions that have no condition: the cut of atan2, and functions with other limits on the other side of a pole."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import pytest

import teg
from teg.passes.normalise.cuts import with_cuts

pytestmark = pytest.mark.usefixtures("x64_for_jax")

x = teg.var("x")
a, b = teg.params("a b")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
Number = mpmath.mpf
PROGRAMS: dict[str, tuple[teg.Expr, Callable[[Number, Number, Number], Number]]] = {
    "a cut that moves": (teg.atan2(x - a, b - 1) * x, lambda s, p, q: mpmath.atan2(s - p, q - 1) * s),
    "a cut that ends": (teg.atan2(x - a, x - b) * x, lambda s, p, q: mpmath.atan2(s - p, s - q) * s),
    "no cut": (teg.atan2(x - a, b) * x, lambda s, p, q: mpmath.atan2(s - p, q) * s),
    "an angle by a quotient": (teg.atan(b / (x - a)) * x, lambda s, p, q: mpmath.atan(q / (s - p)) * s),
    "an angle of a tangent": (teg.atan(teg.tan(3 * x - a - 1)), lambda s, p, q: mpmath.atan(mpmath.tan(3 * s - p - 1))),
    "an error function of a pole": (teg.erf(1 / (x - a)), lambda s, p, q: mpmath.erf(1 / (s - p))),
    "a peak of a pole": (teg.exp(-1 / (x - a) ** 2) * x, lambda s, p, q: mpmath.exp(-1 / (s - p) ** 2) * s),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", PROGRAMS)
def test_jumps_of_functions_move(name: str, backend: str) -> None:
    """References integrate between the jumps, and difference the integrals."""
    e, f = PROGRAMS[name]
    at = (0.4, 0.75)

    def integral(p: Number, q: Number) -> Number:
        pole = (p + 1 + mpmath.pi / 2) / 3
        ends = sorted({Number(0), Number(1), *(u for u in (p, q, pole) if 0 < u < 1)})
        return mpmath.quad(lambda s: f(s, p, q), ends)

    with mpmath.workdps(30):
        h = mpmath.mpf(10) ** -7
        p, q = map(Number, at)
        exact = integral(p, q)
        slopes = [
            (integral(p + h, q) - integral(p - h, q)) / (2 * h),
            (integral(p, q + h) - integral(p, q - h)) / (2 * h),
        ]
    evaluator = teg.compile(teg.integral(e + 0 * b, (x, 0, 1)), [a, b], backend=backend)
    value, gradient = evaluator.value_and_grad(a=at[0], b=at[1])
    assert value == pytest.approx(float(exact), rel=1e-11)
    assert gradient["a"] == pytest.approx(float(slopes[0]), rel=1e-9)
    assert gradient["b"] == pytest.approx(float(slopes[1]), rel=1e-9, abs=1e-12)


def test_the_pass_is_idempotent_and_leaves_what_has_no_jump_that_moves() -> None:
    e = teg.integral(teg.atan2(x - a, b) + teg.erf(1 / (x - a)), (x, 0, 1))
    once = with_cuts(e)
    assert once is not e
    assert with_cuts(once) is once
    for u in (teg.atan2(x, b), teg.atan2(x - a, 2.0), teg.atan(x - a), teg.atan2(a, b), teg.exp(-1 / (x - a) ** 2)):
        assert with_cuts(teg.integral(u, (x, 0, 1))) is teg.integral(u, (x, 0, 1))
    condition = teg.bracket(teg.atan2(x - a, b) < 1)
    assert with_cuts(teg.integral(condition, (x, 0, 1))) is teg.integral(condition, (x, 0, 1))
