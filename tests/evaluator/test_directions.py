"""Directions of products: unit directions, names, and the components that are added to the values of a call."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.errors import ParameterError
from teg.evaluator.directions import Directions, shape_of, units

a, t = teg.params("a t")
V = teg.array("V", 2)
GIVEN = {"t": 0.5, "a": 2.0, "V": np.zeros((5, 2, 3))}


def test_shapes_without_the_batch() -> None:
    assert shape_of(t, GIVEN) == ()
    assert shape_of(V, GIVEN) == (2, 3)


def test_a_unit_direction_an_entry() -> None:
    found = list(units(V, GIVEN))
    assert len(found) == 6
    assert all(d.sum() == 1.0 for d in found)
    np.testing.assert_array_equal(sum(found), np.ones((2, 3)))
    assert [float(d) for d in units(t, GIVEN)] == [1.0]


def test_only_what_is_differentiated_by_moves() -> None:
    directions = Directions([t], [t, a])
    assert directions.named({t: 1.0}) == directions.named({"t": 1.0}) == {"t": 1.0}
    with pytest.raises(ParameterError, match="no derivative is taken by 'a'"):
        directions.named({"a": 1.0})


def test_the_components_stand_beside_the_values() -> None:
    wanted, values = Directions([t, a], [t, a]).moved({"t": 0.5, "a": 2.0}, {"t": 3.0})
    assert wanted.along == ((t,),)
    assert values == {"t": 0.5, "a": 2.0, "∂t": 3.0}
