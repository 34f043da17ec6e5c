"""Choices over an interval in C: the lower hull of their keys gives what cells of the square give, and leaves ties to these."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.c.build import load_library
from teg.backends.c.runtime import runtime
from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import Layout, monomials
from tests.backends.c_checks import in_c

pytestmark = in_c

Array = np.ndarray[Any, Any]
Found = tuple[Array, Array, Array]
ENTRY = """
int envelope(const int *s, int64_t n, const double *rows, double *values, double *sizes, double *tables)
{
    const teg_shape shape = {s[0], s[1], s[2], s[3], s[4], 0, 0, NULL, NULL};
    return teg_envelope(&shape, n, rows, values, sizes, tables);
}
"""


@pytest.fixture(scope="module")
def envelope() -> Callable[[Layout, Array], Found | None]:
    library = load_library("\n\n".join([*runtime(["teg_envelope"]), ENTRY]), optimise=("-O1",))

    def found(shape: Layout, rows: Array) -> Found | None:
        bodies = (rows.shape[1] - shape.forms) // shape.coefficients
        values, sizes = np.zeros(bodies), np.zeros(bodies)
        tables = np.full((bodies, len(rows) + 1, shape.columns), np.nan)
        given = [np.array([*shape[:4], bodies], dtype=np.int32), np.ascontiguousarray(rows), values, sizes, tables]
        at = [ctypes.c_void_p(a.ctypes.data) for a in given]
        done = library.envelope(at[0], ctypes.c_int64(len(rows)), *at[1:])
        return (values, sizes, tables) if done else None

    return found


def candidates(keys: Array, shape: Layout, bodies: int, random: np.random.Generator, absent: float = 0.0) -> Array:
    """Returns rows of candidates over an interval, with keys (n, 2) and any polynomials; a share of them is absent."""
    n = len(keys)
    guards = np.zeros((n, shape.guards, 3))
    guards[..., 0] = np.where(random.uniform(size=(n, shape.guards)) < absent, -1.0, 1.0)
    guards[..., 1] = random.uniform(-0.5, 0.5, (n, shape.guards))
    along = np.array([v == 0 for _, v in monomials(shape.degree)])
    polynomials = random.normal(size=(n, bodies, shape.coefficients)) * along
    return np.concatenate([guards.reshape(n, -1), keys, np.zeros((n, 1)), polynomials.reshape(n, -1)], axis=1)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 8, 16, 17, 40, 65, 300])
@pytest.mark.parametrize("degree", [0, 1, 3])
def test_as_cells_of_the_square(envelope: Callable[[Layout, Array], Found | None], n: int, degree: int) -> None:
    """Random keys, tangents of a parabola, and bundles of nearly parallel keys."""
    random = np.random.default_rng(100 * n + degree)
    shape = Layout(1, 2, degree)
    places = random.uniform(-0.3, 1.3, n)
    for keys in (
        random.normal(size=(n, 2)),
        np.stack([places**2, -2.0 * places], axis=1),
        np.stack([1e3 + random.normal(size=n) * 1e-3, 7.0 + random.normal(size=n) * 1e-3], axis=1),
        np.stack([np.arange(n) % 3 + random.normal(size=n), np.arange(n) % 2.0], axis=1),
    ):
        rows = candidates(keys, shape, 2, random, absent=0.1 if n > 3 else 0.0)
        expected = integrals(shape, rows, [0.0] * 2 * shape.coefficients, True)
        found = envelope(shape, rows)
        assert found is not None
        scale = 1.0 + 1e-10 / np.diff(np.sort(keys[:, 1])).min(initial=1.0, where=np.diff(np.sort(keys[:, 1])) > 0.0)
        for got, wanted in zip(found, (expected.values, expected.sizes, expected.tables), strict=True):
            np.testing.assert_allclose(got, wanted, rtol=1e-11 * scale, atol=1e-11 * scale * np.abs(wanted).max())


def test_equal_keys_belong_to_the_first(envelope: Callable[[Layout, Array], Found | None]) -> None:
    random = np.random.default_rng(1)
    shape = Layout(1, 1, 1)
    keys = np.array([[0.5, 1.0], [0.9, -0.5], [0.5, 1.0], [0.9, -0.5], [2.0, 1.0]])
    rows = candidates(keys, shape, 1, random)
    found = envelope(shape, rows)
    assert found is not None
    np.testing.assert_allclose(found[2], integrals(shape, rows, [0.0] * 3, True).tables, rtol=1e-13, atol=1e-14)
    assert not found[2][0, 2:].any()


@pytest.mark.parametrize(
    "keys",
    [
        [[0.5, -1.0], [0.0, 0.0], [-0.5, 1.0]],
        [[0.5, -1.0], [1e-12, 0.0], [-0.5, 1.0]],
        [[0.0, 1.0], [0.0, 0.0]],
        [[1.0, -1.0], [0.0, 0.0], [-0.3, 0.4]],
        [[1.0, 1.0], [1.0 + 1e-15, 1.0]],
        [[0.0, np.nan], [0.0, 1.0]],
        [[np.inf, 0.0], [0.0, 1.0]],
    ],
    ids=["three at a point", "nearly", "at the left end", "at the right end", "nearly equal", "no number", "not finite"],
)
def test_ties_are_left_to_cells(envelope: Callable[[Layout, Array], Found | None], keys: list[list[float]]) -> None:
    rows = candidates(np.array(keys), Layout(1, 1, 1), 1, np.random.default_rng(0))
    assert envelope(Layout(1, 1, 1), rows) is None


def test_guards_that_cut_are_left_to_cells(envelope: Callable[[Layout, Array], Found | None]) -> None:
    rows = candidates(np.array([[0.2, 1.0], [0.7, -0.4]]), Layout(1, 1, 0), 1, np.random.default_rng(0))
    rows[1, :2] = 0.5, -1.0
    assert envelope(Layout(1, 1, 0), rows) is None


def program() -> teg.Evaluator:
    """∫ of a polynomial of the candidate whose key is least, over an interval; the rows of K are rates, constants, and polynomials."""
    x, k = teg.var("x"), teg.index("k")
    a, b = teg.params("a b")
    keys = teg.array("K", 2)
    chosen = teg.nearest(keys[k, 2] + keys[k, 3] * x + x**2, keys[k, 0] * x + keys[k, 1], (k, 0, teg.length(keys)))
    return teg.compile(teg.integral(chosen, (x, a, b)), [keys, a, b], backend="c")


@pytest.mark.parametrize("ties", [False, True])
def test_programs_as_in_closed_form(ties: bool) -> None:
    """Two keys that meet at one place, moved by the parameters; with a third one through it and others that are equal."""
    f = program()
    rows = np.array([[1.0, -0.3, 2.0, 1.0], [-1.0, 0.5, -1.0, 0.5]])  # equal at x = 0.4
    if ties:
        rows = np.concatenate([rows, [[1.0, -0.3, 9.0, 9.0], [3.0, 2.0, 7.0, 7.0]]])
    lo, hi, at = -0.5, 1.2, 0.4

    def of(row: Array, p: float, q: float) -> float:
        return float(row[2] * (q - p) + row[3] * (q**2 - p**2) / 2 + (q**3 - p**3) / 3)

    value, slopes = f.value_and_grad(K=rows, a=lo, b=hi)
    np.testing.assert_allclose(value, of(rows[0], lo, at) + of(rows[1], at, hi), rtol=1e-14)
    jump = (rows[0, 2] + rows[0, 3] * at) - (rows[1, 2] + rows[1, 3] * at)
    moved = -jump / 2.0  # the keys' rates differ by 2
    expected = np.zeros_like(rows)
    expected[0] = [moved * at, moved, at - lo, (at**2 - lo**2) / 2]
    expected[1] = [-moved * at, -moved, hi - at, (hi**2 - at**2) / 2]
    np.testing.assert_allclose(slopes["K"], expected, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(slopes["b"], rows[1, 2] + rows[1, 3] * hi + hi**2, rtol=1e-13)


def test_the_second_variable_needs_cells() -> None:
    x, y, k = teg.var("x"), teg.var("y"), teg.index("k")
    keys = teg.array("K", 2)
    over = (k, 0, teg.length(keys))
    line = teg.compile(teg.integral(teg.minimum_of(keys[k, 0] + keys[k, 1] * x, over), (x, 0, 1)), [keys], backend="c")
    plane = teg.integral(teg.minimum_of(keys[k, 0] + keys[k, 1] * x - keys[k, 0] * y, over), (x, 0, 1), (y, 0, 1))
    assert "teg_envelope(" in line.source
    assert "teg_envelope(" not in teg.compile(plane, [keys], backend="c").source


@pytest.mark.parametrize("end", [0.0, 1.0])
def test_ties_at_an_end_among_many(envelope: Callable[[Layout, Array], Found | None], end: float) -> None:
    """Keys that are far above are left out at once; one that only touches the least one at an end is not."""
    random = np.random.default_rng(3)
    shape = Layout(1, 1, 1)
    high = np.stack([random.uniform(3.0, 4.0, 30), random.uniform(-1.0, 1.0, 30)], axis=1)
    low = np.array([[0.0, 1.0], [0.25, 0.5], [0.9, -0.3]])
    touching = np.array([[low[0, 0], 1.5]] if end == 0.0 else [[low[2].sum() + 0.8, -0.8]])
    keys = random.permutation(np.concatenate([high, low, touching]))
    assert envelope(shape, candidates(random.permutation(np.concatenate([high, low])), shape, 1, random)) is not None
    assert envelope(shape, candidates(keys, shape, 1, random)) is None


def test_lattices_of_keys() -> None:
    """Keys with few different rates and constants, of which many meet: where a key may move both ways, as differences of values."""
    f = program()
    random = np.random.default_rng(0)
    step, smooth = 1e-6, 0
    for n in (3, 8, 20, 40):
        for _ in range(6):
            rows = np.concatenate([np.round(4.0 * random.uniform(-1.0, 1.0, (n, 2))) / 2.0, random.normal(size=(n, 2))], axis=1)
            at = {"a": -1.0, "b": 0.5}
            slopes = f.grad(K=rows, **at)["K"]
            moved = np.repeat(rows[None], 2 * n, axis=0)
            moved[np.arange(n), np.arange(n), 1] += step
            moved[n + np.arange(n), np.arange(n), 1] -= step
            values, here = f(K=moved, **at), f(K=rows, **at)
            up, down = (values[:n] - here) / step, (here - values[n:]) / step
            both = np.abs(up - down) < 1e-3
            smooth += both.sum()
            np.testing.assert_allclose(slopes[both, 1], 0.5 * (up + down)[both], atol=1e-4)
    assert smooth > 300
