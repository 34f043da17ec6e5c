"""Results in the structure of an expression and the shapes of a call."""

from __future__ import annotations

import numpy as np

import teg
from teg.evaluator.results import along_direction, in_shape, nested, places, plain, stacked, weighted

t = teg.param("t")
PAIR = teg.tuple(t, teg.tuple(t, 2 * t))


def test_one_point_gives_numbers_of_python() -> None:
    assert type(plain(np.float64(2.0))) is float
    assert type(plain(np.float32(2.0))) is np.float32
    assert type(in_shape(np.array([2.0]), ())) is float


def test_a_batch_keeps_its_shape_and_the_axes_behind() -> None:
    assert in_shape(np.arange(6.0), (2, 3)).shape == (2, 3)
    assert in_shape(np.zeros((6, 4)), (2, 3)).shape == (2, 3, 4)


def test_tuples_keep_their_structure() -> None:
    rows = iter(np.array([[1.0], [2.0], [3.0]]))
    assert nested(PAIR, rows, ()) == (1.0, (2.0, 3.0))
    assert places(PAIR, "value") == ["value[0]", "value[1][0]", "value[1][1]"]
    assert places(t, "value") == ["value"]


def test_derivatives_along_a_direction() -> None:
    slopes = [(2.0, 3.0, 0), (np.array([1.0, 2.0]), np.array([10.0, 20.0]), 1)]
    assert along_direction(0.0, slopes) == 56.0
    assert along_direction(0.0, []) == 0.0


def test_a_batch_of_cotangents_weights_arrays_from_the_front() -> None:
    found = weighted(np.ones((2, 3)), np.array([1.0, 5.0]), 1)
    np.testing.assert_array_equal(found, [[1.0] * 3, [5.0] * 3])


def test_products_with_unit_directions_become_a_block() -> None:
    columns = [np.full((4,), float(k)) for k in range(6)]
    block = stacked(columns, (4,), (2, 3))
    assert block.shape == (4, 2, 3)
    np.testing.assert_array_equal(block[0], [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
