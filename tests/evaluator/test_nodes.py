"""Points and weights of the quadrature of a program."""

from __future__ import annotations

import math

import numpy as np
import pytest

import teg
from teg.errors import ArrayIndexError, OperandError, ParameterError

x, y, z = teg.vars("x y z")
t, a = teg.params("t a")
SQUARE = (x, -1, 1), (y, -1, 1)
DISK = teg.integral(teg.bracket(x * x + y * y < t), *SQUARE)
TRIANGLE = teg.integral(teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1))


def test_they_integrate_any_smooth_function_over_a_disk() -> None:
    f = teg.compile(DISK, [t], backend="numpy")
    points, weights = f.nodes(t=0.5)
    assert points.shape == (len(weights), 2)
    assert (weights > 0).all()
    assert ((points**2).sum(axis=1) < 0.5).all()
    assert weights.sum() == pytest.approx(math.pi / 2, rel=1e-14)
    truth = teg.evaluate(teg.integral(teg.bracket(x * x + y * y < t) * teg.exp(x - 2 * y), *SQUARE), t=0.5)
    assert weights @ np.exp(points[:, 0] - 2 * points[:, 1]) == pytest.approx(truth, rel=1e-11)


def test_by_a_parameter_they_lie_on_the_boundary() -> None:
    points, weights = teg.compile(DISK, [t], backend="numpy").nodes(t=0.5, by="t")
    np.testing.assert_allclose((points**2).sum(axis=1), 0.5, rtol=1e-14)
    assert weights.sum() == pytest.approx(math.pi, rel=1e-12)
    assert weights @ points[:, 0] ** 2 == pytest.approx(math.pi * 0.25, rel=1e-12)  # of cos² over the circle, times ds/|∇|
    f = teg.compile(TRIANGLE, [t, a], backend="numpy")
    for name in ("t", "a"):
        points, weights = f.nodes(t=0.5, a=2.0, by=name)
        np.testing.assert_allclose(points[:, 0] + 2 * points[:, 1], 0.5, rtol=1e-13)
        assert weights.sum() == pytest.approx(f.grad(t=0.5, a=2.0)[name], rel=1e-12)


def test_an_integrand_and_factors_enter_the_weights() -> None:
    e = a * teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)) - teg.integral(teg.sin(x), (x, 0, t))
    f = teg.compile(e, backend="numpy")
    points, weights = f.nodes(t=0.5, a=2.0)
    assert points.shape == (len(weights), 1)
    assert weights.sum() == pytest.approx(f(t=0.5, a=2.0), rel=1e-13)
    for name, slope in f.grad(t=0.5, a=2.0).items():
        points, weights = f.nodes(t=0.5, a=2.0, by=name)
        assert weights.sum() == pytest.approx(slope, rel=1e-13)
    points, weights = f.nodes(t=0.5, a=2.0, by="t")
    assert points.tolist() == [[0.5]]  # both integrals end there


def test_a_rule_gives_its_own_nodes() -> None:
    f = teg.compile(TRIANGLE, [t, a], backend="numpy", rule="gauss", order=4)
    points, weights = f.nodes(t=0.5, a=2.0)
    assert len(weights) == 16
    truth = teg.evaluate(teg.integral(x**3 * y**2 * teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1)), t=0.5, a=2.0)
    assert weights @ (points[:, 0] ** 3 * points[:, 1] ** 2) == pytest.approx(truth, rel=1e-12)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_batch_is_filled_up_with_weights_of_zero(backend: str) -> None:
    f = teg.compile(DISK, [t], backend=backend)
    points, weights = f.nodes(t=[[0.0, 0.1], [0.5, 1.2]])
    assert points.shape == (2, 2, weights.shape[2], 2)
    np.testing.assert_allclose(weights.sum(axis=-1), f(t=[[0.0, 0.1], [0.5, 1.2]]), rtol=1e-11, atol=1e-14)
    one, _ = f.nodes(t=0.5)
    np.testing.assert_array_equal(points[1, 0, : len(one)], one)
    assert (points[1, 0, len(one) :] == one[-1]).all()
    assert (weights[1, 0, len(one) :] == 0).all()


def test_where_two_surfaces_coincide_both_orders_count() -> None:
    e = teg.integral(teg.bracket(x + y < t) * teg.bracket(x + y < a), (x, 0, 1), (y, 0, 1))
    f = teg.compile(e, [t, a], backend="numpy")
    assert f.nodes(t=0.5, a=0.5)[1].sum() == pytest.approx(0.125, rel=1e-13)
    assert f.nodes(t=0.5, a=0.5, by="t")[1].sum() == pytest.approx(f.grad(t=0.5, a=0.5)["t"], rel=1e-13)


def test_three_variables_and_a_surface_without_a_formula() -> None:
    inside = teg.bracket(x + teg.exp(x * y) / 4 + y < t)
    f = teg.compile(teg.integral(inside, (x, 0, 1), (y, 0, 1)), [t], backend="numpy")
    points, weights = f.nodes(t=0.9)
    assert weights.sum() == pytest.approx(f(t=0.9), rel=1e-11)
    points, weights = f.nodes(t=0.9, by="t")
    np.testing.assert_allclose(points[:, 0] + np.exp(points.prod(axis=1)) / 4 + points[:, 1], 0.9, rtol=1e-12)
    cone = teg.compile(teg.integral(teg.bracket(x + y + z < t), (x, 0, 1), (y, 0, 1), (z, 0, 1)), rule="gauss", order=3)
    points, weights = cone.nodes(t=0.9)
    assert points.shape == (27, 3)
    assert weights @ points[:, 2] == pytest.approx(0.9**4 / 24, rel=1e-13)


@pytest.mark.parametrize(
    "e",
    [
        teg.integral(x, (x, 0, t)) ** 2,
        teg.exp(teg.integral(x, (x, 0, t))),
        1 + teg.integral(x, (x, 0, t)),
        teg.tuple(teg.integral(x, (x, 0, t)), t),
        t * t,
        teg.integral(x, (x, 0, t)) + teg.integral(y, (y, 0, t)),
    ],
)
def test_what_is_no_sum_of_integrals_has_none(e: teg.Expr) -> None:
    with pytest.raises(OperandError) as caught:
        teg.compile(e, [t], backend="numpy").nodes(t=0.5)
    assert caught.value.hint


def test_derivatives_that_move_the_nodes_and_unknown_names_are_refused() -> None:
    with pytest.raises(OperandError, match="moves the nodes"):
        teg.compile(teg.integral(1 / teg.sqrt(abs(x - t)), (x, 0, 1)), [t], backend="numpy").nodes(t=0.3, by="t")
    with pytest.raises(ParameterError, match="no parameter 'b'"):
        teg.compile(DISK, [t], backend="numpy").nodes(t=0.3, by="b")


# -- programs with arrays ----------------------------------------------------------------------------------------------

V, W = teg.array("V", 2), teg.array("W")
k = teg.index("k")
ROWS = np.array([[2.0, 1.0], [1.0, 3.0], [0.5, -0.5]])  # slopes and factors
HALF_PLANES = teg.sum(
    V[k, 1] * teg.integral(teg.bracket(x + V[k, 0] * y < t) * teg.exp(a * x), (x, 0, 1), (y, 0, 1)), (k, 0, teg.length(V, 0))
)


def moment(nodes: tuple[np.ndarray, np.ndarray]) -> float:
    """Returns the integral of cos(xy) over nodes."""
    points, weights = nodes
    return float(weights @ np.cos(points[:, 0] * points[:, 1]))


@pytest.mark.parametrize("by", [None, "t", "a"])
def test_a_sum_over_data_has_the_nodes_of_all_its_terms(by: str | None) -> None:
    f = teg.compile(HALF_PLANES, [t, a], backend="numpy")
    points, weights = f.nodes(t=0.5, a=0.3, V=ROWS, by=by)
    expected = f(t=0.5, a=0.3, V=ROWS) if by is None else f.grad(t=0.5, a=0.3, V=ROWS)[by]
    assert weights.sum() == pytest.approx(expected, rel=1e-11)
    if by == "t":  # on one of the three lines
        assert (np.abs(points[:, :1] + ROWS[:, 0] * points[:, 1:] - 0.5).min(axis=1) < 1e-14).all()
    whole = 0.0
    for slope, factor in ROWS.tolist():
        term = factor * teg.integral(teg.bracket(x + slope * y < t) * teg.exp(a * x), (x, 0, 1), (y, 0, 1))
        whole += moment(teg.compile(term, [t, a], backend="numpy").nodes(t=0.5, a=0.3, by=by))
    assert moment((points, weights)) == pytest.approx(whole, rel=1e-11)


def test_by_an_entry_of_an_array_they_are_those_of_its_term() -> None:
    f = teg.compile(HALF_PLANES, [t, V], backend="numpy")
    slopes = f.grad(t=0.5, a=0.3, V=ROWS)["V"]
    for row, column in np.ndindex(ROWS.shape):
        points, weights = f.nodes(t=0.5, a=0.3, V=ROWS, by=V[row, column])
        assert weights.sum() == pytest.approx(slopes[row, column], rel=1e-11)
        assert weights.all()
        if column == 0:  # the line of this row
            np.testing.assert_allclose(points[:, 0] + ROWS[row, 0] * points[:, 1], 0.5, rtol=1e-13)
    many = f.nodes(t=0.5, a=0.3, V=np.stack([ROWS, 2 * ROWS]), by=V[1, 0])[1]
    np.testing.assert_allclose(many.sum(axis=1), [slopes[1, 0], f.grad(t=0.5, a=0.3, V=2 * ROWS)["V"][1, 0]], rtol=1e-11)
    np.testing.assert_array_equal(f.nodes(t=0.5, a=0.3, V=ROWS, by=t)[1], f.nodes(t=0.5, a=0.3, V=ROWS, by="t")[1])


@pytest.mark.parametrize("by", [V, "V", V[k, 0], teg.array("U")[0], W, x])
def test_by_an_array_or_what_is_no_parameter_is_refused(by: object) -> None:
    with pytest.raises(ParameterError) as caught:
        teg.compile(HALF_PLANES, [t], backend="numpy").nodes(t=0.5, a=0.3, V=ROWS, by=by)
    assert "V[3, 0]" in caught.value.hint or "entries of V" in caught.value.hint


def test_an_entry_beyond_the_end_is_refused() -> None:
    with pytest.raises(ArrayIndexError, match="no V\\[3, 0\\]"):
        teg.compile(HALF_PLANES, [t], backend="numpy").nodes(t=0.5, a=0.3, V=ROWS, by=V[3, 0])


def test_a_batch_of_arrays_has_a_row_of_nodes_for_each() -> None:
    f = teg.compile(HALF_PLANES, [t], backend="numpy")
    many = np.stack([ROWS, 2 * ROWS])
    points, weights = f.nodes(t=0.5, a=0.3, V=many)
    assert points.shape == (2, weights.shape[1], 2)
    np.testing.assert_allclose(weights.sum(axis=1), f(t=0.5, a=0.3, V=many), rtol=1e-11)


def test_a_sum_inside_of_the_integral_is_made_for_the_lengths_of_a_call() -> None:
    steps = teg.sum(V[k, 1] * teg.bracket(x < V[k, 0]), (k, 0, teg.length(V, 0)))
    f = teg.compile(teg.integral(steps * steps, (x, 0, 1)), backend="numpy")
    for count in (3, 2):
        points, weights = f.nodes(V=ROWS[:count] / 3)
        assert weights.sum() == pytest.approx(f(V=ROWS[:count] / 3), rel=1e-13)
        assert points.shape == (len(weights), 1)


def test_a_choice_among_data_has_nodes_in_the_cells_of_all_candidates() -> None:
    distance = (x - V[k, 0]) ** 2 + (y - V[k, 1]) ** 2
    f = teg.compile(teg.integral(teg.minimum_of(distance, (k, 0, teg.length(V))), (x, 0, 1), (y, 0, 1)), backend="numpy")
    sites = np.array([[0.2, 0.3], [0.7, 0.8]])
    points, weights = f.nodes(V=sites)
    assert weights.sum() == pytest.approx(f(V=sites), rel=1e-12)
    assert set(np.argmin(((points[:, None] - sites) ** 2).sum(axis=-1), axis=1)) == {0, 1}


def test_a_choice_from_no_data_has_the_nodes_of_what_stands_there() -> None:
    e = teg.integral(teg.nearest(V[k, 1], (x - V[k, 0]) ** 2, (k, 0, teg.length(V)), otherwise=3.0), (x, 0, 1))
    points, weights = teg.compile(e, backend="numpy").nodes(V=np.zeros((0, 2)))
    assert weights.sum() == pytest.approx(3.0, rel=1e-13)
    assert weights @ points[:, 0] == pytest.approx(1.5, rel=1e-13)


def test_what_is_computed_outside_of_a_loop_keeps_its_origin_and_ties_have_both_orders() -> None:
    inner = teg.integral(teg.bracket(x < t) * teg.bracket(x < a), (x, 0, 1))
    f = teg.compile(teg.sum(W[k] * inner, (k, 0, teg.length(W, 0))), [t], backend="numpy")
    assert f.nodes(t=0.5, a=0.5, W=[1.0, 2.0])[1].sum() == pytest.approx(1.5, rel=1e-13)
    points, weights = f.nodes(t=0.5, a=0.5, W=[1.0, 2.0], by="t")
    assert weights.sum() == pytest.approx(f.grad(t=0.5, a=0.5, W=[1.0, 2.0])["t"], rel=1e-13)
    np.testing.assert_allclose(points, 0.5)


def test_of_arrays_products_of_sums_of_integrals_and_indices_out_of_range_are_refused() -> None:
    f = teg.compile(HALF_PLANES**2, [t], backend="numpy")
    with pytest.raises(OperandError, match="no sum of integrals"):
        f.nodes(t=0.5, a=0.3, V=ROWS)
    with pytest.raises(ArrayIndexError):
        teg.compile(teg.sum(teg.integral(W[k] * x, (x, 0, 1)), (k, 0, 3)), backend="numpy").nodes(W=np.ones(2))
