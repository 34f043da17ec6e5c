"""Second derivatives of choices among data, in symbols: they are those of the compiled program, and there are no third ones."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.errors import NotDifferentiableError
from teg.evaluator.options import Backend

x, t = teg.var("x"), teg.param("t")
k, S, D = teg.index("k"), teg.array("S", 2), teg.array("D", 2)
CHOICE = teg.integral(teg.nearest(x * S[k, 1], (x - S[k, 0] * (1 + t)) ** 2, (k, 0, teg.length(S))) ** 2, (x, 0, 1))
AT = {"S": np.array([[0.2, 1.0], [0.5, 2.0], [0.8, -1.0]]), "t": 0.1}
ALONG = np.array([[0.3, 0.1], [-0.2, 0.5], [0.1, 0.7]])


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_second_derivatives_in_symbols(backend: Backend) -> None:
    product = teg.compile(CHOICE, [S, t], backend=backend).hvp(AT, {"S": ALONG, "t": 0.4})
    once = teg.jvp(CHOICE, {S: D, t: 0.4})
    given = {**AT, "D": ALONG}
    twice = teg.compile(teg.jvp(once, {S: D, t: 0.4}), backend=backend)
    assert float(twice(given)) == pytest.approx((product["S"] * ALONG).sum() + 0.4 * product["t"], abs=1e-13)
    slope = teg.compile(teg.jvp(teg.grad(CHOICE, [t])[0], {S: D, t: 0.4}), backend=backend)
    assert float(slope(given)) == pytest.approx(product["t"], abs=1e-13)
    gradient = teg.compile(once, [S, t], backend=backend).grad(given)
    np.testing.assert_allclose(gradient["S"], product["S"], atol=1e-13)


def written_out() -> tuple[teg.Expr, teg.Expr]:
    """A choice of three, and the same with its conditions in the text."""
    keys, values = zip(*(((x - 0.4 * i - t * (i + 1)) ** 2, x * t * (i + 1)) for i in range(3)), strict=True)
    text = teg.where((keys[0] <= keys[1]) & (keys[0] <= keys[2]), values[0], teg.where(keys[1] <= keys[2], values[1], values[2]))
    choice = teg.nearest(x * t * (k + 1), (x - 0.4 * k - t * (k + 1)) ** 2, (k, 0, 3))
    return teg.integral(choice, (x, 0, 1)), teg.integral(text, (x, 0, 1))


def test_the_ways_out_of_a_third_derivative() -> None:
    choice, text = written_out()
    second = teg.diff(teg.diff(choice, t), t)
    assert teg.evaluate(second, t=0.07) == pytest.approx(-5.385, abs=1e-12)
    with pytest.raises(NotDifferentiableError, match="first and second derivatives only") as error:
        teg.diff(second, t)
    assert "f.hvp" in str(error.value)
    third = teg.evaluate(teg.diff(teg.diff(teg.diff(text, t), t), t), t=0.07)
    f = teg.compile(choice, [t])
    ahead, behind = (f.hvp({"t": 0.07 + h}, {"t": 1.0})["t"] for h in (1e-4, -1e-4))
    assert (ahead - behind) / 2e-4 == pytest.approx(third, abs=1e-8)


def test_a_gradient_has_derivatives_along_directions_only() -> None:
    with pytest.raises(NotDifferentiableError, match=r"no gradient in symbols") as error:
        teg.grad(teg.grad(CHOICE, [t])[0], [t])
    assert "teg.jvp" in str(error.value)
