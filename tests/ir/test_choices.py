"""teg.any, all, prod, nearest, minimum_of, maximum_of: what they mean, their derivatives in every backend, and their errors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import ArrayIndexError, ConditionError, NotDifferentiableError, OperandError, ScopeError, TegError

K, J = teg.index("k"), teg.index("j")
V, W, F = teg.array("V"), teg.array("W"), teg.indices("F")
T = teg.param("t")
X = teg.var("x")
N = teg.length(V)
BACKENDS = ["c", "numpy", "jax"]
VALUES = np.array([3.0, -1.0, 2.0, -1.0])


@pytest.fixture(autouse=True)
def double_precision() -> Any:
    import jax

    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.mark.parametrize("backend", BACKENDS)
def test_values(backend: str) -> None:
    over = (K, 0, N)
    programs = {
        "any": (teg.bracket(teg.any(V[K] > T, over)), 1.0),
        "all": (teg.bracket(teg.all(V[K] > -T, over)), 1.0),
        "not all": (teg.bracket(teg.all(V[K] > T, over)), 0.0),
        "prod": (teg.prod(V[K] + T, over), 5.5 * 1.5 * 4.5 * 1.5),
        "least": (teg.minimum_of(V[K], over), -1.0),
        "largest": (teg.maximum_of(V[K], over), 3.0),
        "least positive": (teg.minimum_of(V[K], over, where=V[K] > 0), 2.0),
        "lower index of a tie": (teg.nearest(K, V[K], over), 1.0),
        "nothing": (teg.nearest(K, V[K], over, where=V[K] > 10, otherwise=-7), -7.0),
        "any of nothing": (teg.bracket(teg.any(V[K] > T, (K, 2, 2))), 0.0),
        "all of nothing": (teg.bracket(teg.all(V[K] > T, (K, 2, 2))), 1.0),
        "prod of nothing": (teg.prod(V[K], (K, 2, 2)), 1.0),
        "inside a function": (teg.exp(teg.minimum_of(V[K], over)) * T, 2.5 * math.exp(-1.0)),
        "one in another": (teg.minimum_of(teg.maximum_of(V[K] * V[J], over), (J, 0, N)), 1.0),
    }
    f = teg.compile(teg.tuple(*(e for e, _ in programs.values())), backend=backend)
    found = dict(zip(programs, map(float, f(V=VALUES, t=2.5)), strict=True))
    assert found == pytest.approx({name: value for name, (_, value) in programs.items()})


@pytest.mark.parametrize("backend", BACKENDS)
def test_derivatives_of_products_with_zeros(backend: str) -> None:
    f = teg.compile(teg.prod(V[K] * T, (K, 0, N)), backend=backend)
    for zeros in range(3):
        v = np.array([2.0, 3.0, 5.0])
        v[:zeros] = 0.0
        gradient = f.grad(V=v, t=2.0)["V"]
        np.testing.assert_allclose(gradient, [8.0 * np.prod(np.delete(v, i)) for i in range(3)])
        direction = np.array([1.0, -2.0, 0.5])
        second = [sum(8.0 * direction[j] * np.prod(np.delete(v, [i, j])) for j in range(3) if j != i) for i in range(3)]
        np.testing.assert_allclose(f.hvp({"V": v, "t": 2.0}, {"V": direction})["V"], second)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_derivative_is_that_of_the_winner(backend: str) -> None:
    f = teg.compile(teg.nearest((V[K] ** 3, W[K] * T), (V[K] - T) ** 2, (K, 0, N)), backend=backend)
    given = {"V": VALUES, "W": np.arange(4.0), "t": 2.4}
    values, gradient = f.value_and_grad(**given)
    assert list(map(float, values)) == [8.0, 2.0 * 2.4]
    np.testing.assert_allclose(gradient["V"][0], [0, 0, 12.0, 0])
    np.testing.assert_allclose(gradient["W"][1], [0, 0, 2.4, 0])
    assert float(gradient["t"][1]) == 2.0
    _, along = f.jvp(given, {"V": np.ones(4), "t": 1.0})
    np.testing.assert_allclose(along, [12.0, 2.0])
    _, back = f.vjp(given, (2.0, 1.0))
    np.testing.assert_allclose(back["V"], [0, 0, 24.0, 0])
    second = f.hvp(given, {"V": np.ones(4), "t": 1.0, "W": np.ones(4)})
    np.testing.assert_allclose(second["V"][0], [0, 0, 12.0, 0])
    np.testing.assert_allclose(second["W"][1], [0, 0, 1.0, 0])


@pytest.mark.parametrize("backend", BACKENDS)
def test_ranges_are_data(backend: str) -> None:
    R, p = teg.indices("R", 2), teg.index("p")
    e = teg.sum(teg.minimum_of(V[F[K]], (K, R[p, 0], R[p, 1]), otherwise=T) ** 2, (p, 0, teg.length(R)))
    f = teg.compile(e, backend=backend)
    given = {"V": VALUES, "F": np.array([2, 0, 1]), "R": np.array([[0, 2], [1, 1], [1, 3]]), "t": 0.5}
    value, gradient = f.value_and_grad(**given)
    assert float(value) == 2.0**2 + 0.5**2 + 1.0
    np.testing.assert_allclose(gradient["V"], [0, -2.0, 4.0, 0])
    assert float(gradient["t"]) == 1.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_to_choose_from_and_keys_that_are_not_numbers_warn(backend: str) -> None:
    f = teg.compile(teg.nearest(T, V[K], (K, 0, N), where=V[K] > 10), backend=backend)
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(f(V=VALUES, t=1.0))
    f = teg.compile(teg.nearest(T, teg.log(V[K]), (K, 0, N)), backend=backend)
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(f(V=VALUES, t=1.0))
    f = teg.compile(teg.nearest(teg.log(V[K]), V[K], (K, 0, N), where=V[K] > 0), backend=backend)
    assert float(f(V=VALUES)) == math.log(2.0)  # a value that is not chosen does not matter, nor its derivative
    np.testing.assert_allclose(f.grad(V=VALUES)["V"], [0, 0, 0.5, 0])


@pytest.mark.parametrize("backend", BACKENDS)
def test_estimates_of_errors(backend: str) -> None:
    f = teg.compile(teg.tuple(teg.prod(V[K], (K, 0, N)), teg.minimum_of(V[K], (K, 0, N))), backend=backend)
    v = np.array([1.1, 2.3, 3.7, 0.9])
    _, errors = f.value_and_error(V=v)
    assert 0 < float(errors[0]) < 1e-12
    assert float(errors[1]) < 1e-14


@pytest.mark.parametrize("backend", BACKENDS)
def test_short_ranges_are_written_out_where_there_are_no_loops(backend: str) -> None:
    least = teg.integral(teg.exp(teg.minimum_of((X - V[K]) ** 2, (K, 0, 2))), (X, 0, 1))
    plain = teg.integral(teg.exp(teg.minimum((X - V[0]) ** 2, (X - V[1]) ** 2)), (X, 0, 1))
    f, g = teg.compile(least, backend=backend), teg.compile(plain, backend=backend)
    given = {"V": np.array([0.2, 0.7])}
    (value, slopes), (expected, others) = f.value_and_grad(**given), g.value_and_grad(**given)
    assert float(value) == pytest.approx(float(expected), abs=1e-12)
    np.testing.assert_allclose(slopes["V"], others["V"], atol=1e-10)
    f = teg.compile(teg.integral(teg.exp(X) * teg.prod(X - V[K], (K, 0, N)), (X, 0, 1)), backend=backend)
    np.testing.assert_allclose(f.grad(V=[0.25, 0.5])["V"], [-(1 - 0.5 * (math.e - 1)), -(1 - 0.25 * (math.e - 1))], atol=1e-10)


MISTAKES: dict[str, tuple[type[TegError], Any]] = {
    "no range": (ScopeError, lambda: teg.any(V[K] > 0)),
    "no triple": (ScopeError, lambda: teg.nearest(V[K], V[K], (K, 0))),
    "a variable as index": (ScopeError, lambda: teg.prod(X, (X, 0, 3))),
    "a number as condition": (ConditionError, lambda: teg.all(V[K], (K, 0, 3))),
    "a truth value as condition": (ConditionError, lambda: teg.nearest(V[K], V[K], (K, 0, 3), where=True)),
    "a negative length": (ArrayIndexError, lambda: teg.any(V[K] > 0, (K, 3, 2))),
    "an empty range": (ArrayIndexError, lambda: teg.minimum_of(V[K], (K, 3, 3))),
    "a range of itself": (ScopeError, lambda: teg.prod(V[K], (K, 0, K))),
    "otherwise depends on the index": (ScopeError, lambda: teg.nearest(V[K], V[K], (K, 0, 3), otherwise=V[K])),
    "too few of otherwise": (OperandError, lambda: teg.nearest((V[K], 1), V[K], (K, 0, 3), otherwise=(0, 1, 2))),
    "an index outside": (ScopeError, lambda: teg.compile(teg.nearest(V[K], V[J], (K, 0, 3)))),
    "a real bound": (ArrayIndexError, lambda: teg.prod(V[K], (K, 0, T + 1))),
    "too many to be written out": (
        ArrayIndexError,
        lambda: teg.compile(teg.integral(teg.minimum_of(teg.sin(X * V[K]), (K, 0, 100)), (X, 0, 1))),
    ),
    "a third derivative": (
        NotDifferentiableError,
        lambda: teg.grad(teg.grad(teg.integral(teg.minimum_of(X * V[K], (K, 0, N)), (X, 0, 1)), [V])[0], [V]),
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes(mistake: str) -> None:
    kind, build = MISTAKES[mistake]
    with pytest.raises(kind):
        build()


def test_a_range_of_negative_length_at_run_time() -> None:
    f = teg.compile(teg.minimum_of(V[K], (K, F[0], F[1]), otherwise=0))
    with pytest.raises(ArrayIndexError, match="negative length"):
        f(V=VALUES, F=[2, 1])


def test_text_and_latex() -> None:
    e = teg.nearest(V[K], W[K], (K, 0, 3), where=teg.any(V[J] > W[K], (J, 0, N)), otherwise=0)
    assert str(e) == "nearest[k: 0..3](V[k]; W[k] | any[j: 0..length(V, 0)](W[k] < V[j]); 0)"
    assert r"\operatorname{nearest}_{k = 0}^{2}" in teg.latex(e)
    assert str(teg.prod(V[K], (K, 0, 3))) == "Π[k: 0..3] V[k]"
    assert teg.latex(teg.prod(V[K], (K, 0, 3))) == r"\prod_{k = 0}^{2} V_{k}"


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_does_not_depend_on_the_index(backend: str) -> None:
    f = teg.compile(teg.nearest(T, T, (K, 0, N), where=T > 0, otherwise=-1), backend=backend)
    assert [float(f(V=VALUES, t=t)) for t in (2.0, -2.0)] == [2.0, -1.0]


def test_two_values_of_one_choice_of_which_one_holds_a_sum() -> None:
    """The index of the inner sum must not be taken for that of the candidates."""
    plain = teg.nearest(V[K], W[K] * X, (K, 0, N))
    summed = teg.nearest(teg.sum(V[K] * V[J], (J, 0, N)) * X, W[K] * X, (K, 0, N))
    f = teg.compile(teg.integral(plain * summed, (X, 0, 1)))
    given = {"V": np.array([2.0, 3.0, 4.0]), "W": np.array([5.0, 1.0, 6.0])}
    assert float(f(**given)) == pytest.approx(3.0 * 3.0 * 9.0 / 2, abs=1e-12)


def test_sums_of_choices_in_one_integral() -> None:
    C, B, c, y = teg.array("C", 2), teg.array("B"), teg.index("c"), teg.var("y")
    colour = teg.nearest(C[K, c], V[K] * X + W[K] * y, (K, 0, N))
    f = teg.compile(teg.integral(teg.sum((colour - B[c]) ** 2, (c, 0, 2)), (X, 0, 1), (y, 0, 1)))
    given = {"V": np.array([1.0, 0.0]), "W": np.array([0.0, 1.0]), "C": np.array([[1.0, 2.0], [3.0, 5.0]]), "B": np.array([0.0, 1.0])}
    value, gradient = f.value_and_grad(**given)
    assert float(value) == pytest.approx(0.5 * (1 + 1) + 0.5 * (9 + 16), abs=1e-12)
    np.testing.assert_allclose(gradient["C"], [[1.0, 1.0], [3.0, 4.0]], atol=1e-12)
    np.testing.assert_allclose(gradient["V"], [23 / 2, -23 / 2], atol=1e-12)  # the border V0·x = V1·x + y turns: ∓(f₀ - f₁)·∫x dx
