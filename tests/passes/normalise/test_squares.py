"""Roots of sums that are squares on some of their branches."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.passes.normalise.squares import with_squares_apart

pytestmark = pytest.mark.usefixtures("x64_for_jax")

x = teg.var("x")
t, a = teg.params("t a")
S, k = teg.array("S"), teg.index("k")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]


def hinge(u: teg.Expr) -> teg.Expr:
    return teg.where(u > 0, u, 0)


def size(u: teg.Expr) -> teg.Expr:
    return teg.where(u > 0, u, -u)


def test_normal_form() -> None:
    u, v = x - t, x - a
    written = teg.sqrt(hinge(u) ** 2 + hinge(v) ** 2)
    both = teg.where(v > 0, teg.sqrt(u**2 + v**2), size(u))
    expected = teg.where(u > 0, both, teg.where(v > 0, size(v), 0))
    sides = [with_squares_apart(written), with_squares_apart(expected)]
    for at in ({"t": 0.3, "a": 0.8}, {"t": 0.8, "a": 0.3}):
        values = [teg.evaluate(teg.integral(e, (x, 0, 1)), at) for e in (written, *sides)]
        assert values[1:] == pytest.approx([values[0]] * 2, rel=1e-13)
    assert sides[0] is not written
    assert with_squares_apart(sides[0]) is sides[0]


@pytest.mark.parametrize(
    "e",
    [
        teg.sqrt(x - t),
        teg.sqrt((x - t) ** 2),
        teg.sqrt(hinge(x - t) ** 2),  # its factor is seen
        teg.sqrt(1 + hinge(x - t)),
        teg.sqrt(size(x - t) + size(x - a)),
        teg.exp(hinge(x - t) ** 2 + hinge(x - a) ** 2),  # no root
        teg.sqrt(sum(hinge(x - teg.param(n)) ** 2 for n in "bcdef")),  # type: ignore[arg-type]  # too many
    ],
    ids=str,
)
def test_what_stays(e: teg.Expr) -> None:
    assert with_squares_apart(e) is e


HESSIANS = {
    "a hinge beside another": (teg.sqrt(hinge(x - t) ** 2 + hinge(x - a) ** 2), "t", 1.0092416921),
    "a square on one side": (teg.sqrt((x - t) ** 2 + teg.where(x < 0.5, 0, (x - a) ** 2)), "t", 2.1977266293),
    "brackets that overlap": (teg.sqrt(teg.bracket(x < 0.5) * (x - t) ** 2 + teg.bracket(x > 0.4) * (x - a) ** 2), "a", 2.0438262267),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("case", HESSIANS)
def test_second_derivatives_have_the_kink_of_each_branch(case: str, backend: str) -> None:
    """A kink was missing, 1 or 2, without a warning. The numbers are central differences of mpmath's integrals in 40 digits."""
    e, name, expected = HESSIANS[case]
    f = teg.compile(teg.integral(e, (x, 0, 1)), [t, a], backend=backend)  # type: ignore[arg-type]
    assert f.hessian(t=0.3, a=0.8)[name, name] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_root_of_a_least_square(backend: str) -> None:
    """∫ min |x - s| over (0, 1), s = 0.3 and 0.8: s₀²/2 + (s₁ - s₀)²/4 + (1 - s₁)²/2. Kinks at s₀ and s₁ were missing."""
    least = teg.minimum_of((x - S[k]) ** 2, (k, 0, teg.length(S)))
    f = teg.compile(teg.integral(teg.sqrt(least), (x, 0, 1)), backend=backend)  # type: ignore[arg-type]
    sites = {"S": np.array([0.3, 0.8])}
    product = f.hvp(sites, {"S": np.array([1.0, 0.0])})["S"]
    assert np.asarray(product) == pytest.approx([1.5, -0.5], abs=1e-9)
