"""Parameters that do not move: the value of the parameter, the derivative 0."""

from __future__ import annotations

import math

import pytest
import scipy.integrate

import teg
from teg.ir.still import has_still, released, with_still_conditions, with_still_parameters

x = teg.var("x")
a, t = teg.params("a t")
E = teg.integral(teg.bracket(x < t) * a * x, (x, 0, 1))


def test_releasing_is_the_inverse() -> None:
    still = with_still_parameters(E)
    assert still is not E
    assert has_still(still)
    assert not has_still(E)
    assert released(still) is E
    assert released(E) is E


def test_the_value_is_that_of_the_parameters() -> None:
    assert teg.evaluate(released(with_still_parameters(E)), t=0.5, a=2.0) == teg.evaluate(E, t=0.5, a=2.0)


def test_conditions_stay_and_other_places_move() -> None:
    still = with_still_conditions(E)
    assert has_still(still)
    f = teg.compile(still, [t, a])
    value, gradient = f.value_and_grad(t=0.5, a=2.0)
    assert (value, gradient) == (pytest.approx(0.25), {"t": 0.0, "a": pytest.approx(0.125)})


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("g", [t - x, t - x - x**3, t - x * x - teg.sin(x)], ids=["line", "cubic", "wave"])
def test_a_surface_that_moves_beside_the_same_one_that_does_not(backend: str, g: teg.Expr) -> None:
    edge = teg.bracket(g > 0)
    still = teg.stop_delta(edge)
    programs = [edge, still, edge + 3 * still, still * edge, 1 - (1 - still) * (1 - edge)]
    f = teg.compile(teg.tuple(*(teg.integral((1 + x) * e, (x, 0, 1)) for e in programs)), backend=backend)
    values, gradient = f.value_and_grad(t=0.4)
    full, rate = values[0], gradient["t"][0]
    assert [float(v) for v in values] == pytest.approx([full, full, 4 * full, full, full])
    assert rate > 0.5
    # where both surfaces meet, as they do everywhere, the mean over both orders counts
    assert [float(r) for r in gradient["t"]] == pytest.approx([rate, 0.0, rate, 0.5 * rate, 0.5 * rate])


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_cuts_of_functions_stay(backend: str) -> None:
    parts = [teg.atan2(x - t, -1), teg.atan(1 / (x - t)), teg.exp(1 / (x - t)) * teg.bracket(x > 2 * t)]
    f = teg.compile(teg.tuple(*(teg.integral(teg.stop_delta(e), (x, 0, 1)) for e in parts)), backend=backend)
    _, gradient = f.value_and_grad(t=0.25)
    smooth = math.atan(0.75) + math.atan(0.25)
    beyond = scipy.integrate.quad(lambda u: math.exp(1 / u) / u**2, 0.25, 0.75)[0]
    assert [float(r) for r in gradient["t"]] == pytest.approx([smooth, smooth, beyond])
