"""Results in the structure of an expression and the shapes of a call."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.errors import ParameterError
from teg.evaluator.results import along_direction, cotangents_of, in_shape, nested, places, plain, stacked, weighted

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


def test_cotangents_have_the_structure_of_the_value() -> None:
    value = (1.0, (2.0, 3.0))
    assert cotangents_of(value, 4, "float64") == (4.0, (4.0, 4.0))
    assert cotangents_of(value, [1, (2, 3)], "float64") == (1.0, (2.0, 3.0))
    assert weighted((1.0, (10.0, 100.0)), (1.0, (2.0, 3.0)), 0) == 321.0


AT = {"t": [0.5, 0.6], "V": [1.0, 2.0]}


@pytest.mark.parametrize("cotangent", [[1.0, 2.0, 3.0], "1", None, 1j, [1.0, [2.0]], np.ones((2, 3))], ids=str)
def test_cotangents_of_another_kind_are_refused(cotangent: object) -> None:
    f = teg.compile(t * teg.array("V")[0])
    with pytest.raises(ParameterError):
        f.vjp(AT, cotangent)
    with pytest.raises(ParameterError, match="3 cotangents for a tuple of 2 entries"):
        teg.compile(teg.tuple(t, t)).vjp({"t": 1.0}, (1.0, 2.0, 3.0))


@pytest.mark.parametrize("direction", [{"t": [1.0, 2.0, 3.0]}, {"t": "1"}, {"t": None}, [1.0], {"V": 1.0}, {"V": [1.0, 2.0, 3.0]}], ids=str)
def test_directions_of_another_kind_are_refused(direction: dict[str, object]) -> None:
    f = teg.compile(t * teg.array("V")[0])
    with pytest.raises(ParameterError):
        f.jvp(AT, direction)


def test_lists_are_directions_and_cotangents() -> None:
    f = teg.compile(t * t)
    np.testing.assert_array_equal(f.jvp({"t": 3.0}, {"t": [1.0, 2.0]})[1], [6.0, 12.0])
    np.testing.assert_array_equal(f.vjp({"t": 3.0}, [1.0, 2.0])[1]["t"], [6.0, 12.0])
