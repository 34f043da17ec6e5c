"""Edges on which the keys of several pairs are equal, in many squares at once, beside `teg.numerics.key_edges` for each."""

from __future__ import annotations

import numpy as np

from teg.backends.numpy.cells import cells_of_lanes
from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import Layout


def test_every_square_is_as_by_itself() -> None:
    shape, random = Layout(1, 0, 1), np.random.default_rng(2)
    lanes = []
    for count in (2, 3, 4, 2, 3):
        places = (np.arange(count) + 0.5) / count
        x, y = random.permutation(np.stack(np.meshgrid(places, places), axis=2).reshape(-1, 2)).T
        lanes.append(np.column_stack([x * x + y * y, -2 * x, -2 * y, random.normal(size=(len(x), 3))]))
    counts = np.array([len(rows) for rows in lanes])
    found = cells_of_lanes(shape, np.concatenate(lanes), counts, np.zeros((len(lanes), 3)), True)
    end = 0
    for lane, rows in enumerate(lanes):
        one = integrals(shape, rows.tolist(), [0.0, 0.0, 0.0], True)
        np.testing.assert_allclose(found.values[:, lane], one.values, atol=1e-13)
        np.testing.assert_allclose(found.tables[0][end + lane : end + len(rows) + lane + 1], one.tables[0], atol=1e-12)
        end += len(rows)
