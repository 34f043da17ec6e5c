"""Integrals of the polynomial of the nearest candidate (`teg.numerics.cells`) on lanes.

Lanes in which nothing cuts the square (one candidate covers it and hides the others, or there is none) are found and computed together;
the other ones are cut one by one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.numerics.cells import EPSILON, ROUNDING, Layout, integrals, monomials

Array = npt.NDArray[Any]


class Results(NamedTuple):
    """Values and sizes, (results, lanes), and a table for each result with the rows of all lanes one below the other."""

    values: Array
    sizes: Array
    tables: list[Array]


def cells_of_lanes(shape: Layout, candidates: Array, counts: Array, otherwise: Array, slopes: bool) -> Results:
    """Returns the integrals of lanes.

    `candidates` has the rows of all lanes one below the other, `counts` of each lane; `otherwise` has a row for each lane.
    """
    lanes = len(counts)
    ends = np.cumsum(counts)
    half = otherwise.shape[1] // (1 + shape.order)
    bodies = half // shape.coefficients
    values, sizes = np.empty((bodies, lanes)), np.empty((bodies, lanes))
    columns = shape.columns * (1 + shape.order)
    tables = [np.zeros((int(ends[-1]) + lanes if lanes else 0, columns)) for _ in range(bodies if slopes else 0)]
    whole, owner = _uncut(shape, candidates[: int(ends[-1]) if lanes else 0], counts)
    _fill(shape, (candidates, otherwise), (whole, owner, ends), Results(values, sizes, tables))
    for lane in np.flatnonzero(~whole):
        rows = candidates[ends[lane] - counts[lane] : ends[lane]].tolist()
        found = integrals(shape, rows, otherwise[lane].tolist(), slopes)
        values[:, lane], sizes[:, lane] = found.values, found.sizes
        for table, part in zip(tables, found.tables, strict=False):
            table[ends[lane] - counts[lane] + lane : ends[lane] + lane + 1] = part
    return Results(values, sizes, tables)


def _uncut(shape: Layout, rows: Array, counts: Array) -> tuple[Array, Array]:
    """Returns whether nothing cuts the square of a lane, and the row of its owner; -1 if it has none."""
    lane = np.repeat(np.repeat(np.arange(len(counts)), counts), shape.parts)
    row = np.repeat(np.arange(len(rows)), shape.parts)
    guards = rows[:, : shape.forms - 3].reshape(len(row), shape.guards, 3)
    key = rows[row, shape.forms - 3 : shape.forms]
    with np.errstate(all="ignore"):
        size = np.hypot(guards[..., 1], guards[..., 2])
        most, least = _range(guards)
        absent = ((most < -EPSILON * size) | ((size == 0.0) & (guards[..., 0] < 0.0))).any(axis=1)
        lost = ~absent & ~(np.isfinite(guards).all(axis=(1, 2)) & np.isfinite(key).all(axis=1))
        cutting = ((least <= EPSILON * size) & (size > 0.0)).any(axis=1)
        covering = np.flatnonzero(~absent & ~cutting & ~lost)
        covering = covering[np.lexsort((covering, _range(key[covering])[0], lane[covering]))]
        covered, first = np.unique(lane[covering], return_index=True)
        base = np.full(len(counts), -1)
        base[covered] = covering[first]
        behind = key[base[lane]] if len(key) else key
        difference = key - behind
        tolerance = EPSILON * np.hypot(difference[:, 1], difference[:, 2]) + ROUNDING * np.maximum(np.abs(key[:, 0]), np.abs(behind[:, 0]))
        hidden = (base[lane] >= 0) & (_range(difference)[1] > tolerance)
    inserted = ~absent & ~hidden & (np.arange(len(row)) != base[lane])
    whole = np.ones(len(counts), dtype=bool)
    whole[lane[inserted | lost]] = False
    return whole, np.where(base >= 0, row[base] if len(row) else -1, -1)


def _range(forms: Array) -> tuple[Array, Array]:
    """Returns the largest and the least value of forms on the square."""
    c, a, b = forms[..., 0], forms[..., 1], forms[..., 2]
    return c + np.maximum(a, 0.0) + np.maximum(b, 0.0), c + np.minimum(a, 0.0) + np.minimum(b, 0.0)


def _fill(shape: Layout, given: tuple[Array, Array], uncut: tuple[Array, Array, Array], results: Results) -> None:
    """Computes the lanes that are not cut."""
    (candidates, otherwise), (whole, owner, ends) = given, uncut
    moments = np.array([1.0 / ((i + 1) * (j + 1)) for i, j in monomials(shape.degree)])
    half = otherwise.shape[1] // (1 + shape.order)
    (lanes,) = np.nonzero(whole)
    owners = owner[lanes]
    seen = owners >= 0
    polynomials = otherwise[lanes]
    for order in range(1 + shape.order):
        first = shape.forms + order * (shape.forms + half)
        polynomials[seen, order * half : (order + 1) * half] = candidates[owners[seen], first : first + half]
    for body, (value, size) in enumerate(zip(results.values, results.sizes, strict=True)):
        own = polynomials[:, body * len(moments) : (body + 1) * len(moments)]
        moving = polynomials[:, half * shape.order + body * len(moments) :][:, : len(moments)]
        value[lanes], size[lanes] = moving @ moments, np.abs(own).sum(axis=1)
    rows = np.where(seen, owners, ends[lanes]) + lanes
    last = shape.order * shape.columns + shape.forms
    for table in results.tables:
        table[rows, last : last + len(moments)] = moments
