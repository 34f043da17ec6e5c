"""Many candidates in one square in C: cells are found by the cuts that made them, and are those that comparing with every cell gives."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest

from teg.backends.c.build import load_library
from teg.backends.c.runtime import LIMITS, runtime
from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import Layout
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from tests.backends.parted import assert_right, is_parted

pytestmark = pytest.mark.usefixtures("for_this_machine")
Array = np.ndarray[Any, Any]
CLIP, VISIT = "teg_clip_cell(r, k, region, extra);", "const int cut = r->pending[--waiting];"
ENTRY = """
int cells(const int *s, const double *rule, const double *gauss, int64_t n, const double *rows, const double *otherwise, double *values,
          double *sizes, double *tables, int64_t *counts)
{
    const teg_shape shape = {s[0], s[1], s[2], s[3], s[4], s[5], s[6], rule, gauss};
    clips = visits = 0;
    const int failed = teg_cells(&shape, n, rows, otherwise, values, sizes, tables);
    counts[0] = clips, counts[1] = visits;
    return failed;
}
"""


class Found(NamedTuple):
    """Values, sizes and tables; how many pairs of a candidate and a cell were clipped, and how many cuts were looked at."""

    values: Array
    sizes: Array
    tables: Array
    clips: int
    visits: int


def cells_where_many_are(many: int) -> Callable[[Layout, Array, Array], Found]:
    """Returns the routine of the runtime, that counts, with another number of cells from which on they are found by cuts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(LIMITS, "TEG_MANY_CELLS", many)
        always, *parts = runtime(["teg_cells"])
    text = "\n\n".join([always, "static int64_t clips, visits;", *parts, ENTRY])
    assert text.count(CLIP) == text.count(VISIT) == 1
    library = load_library(text.replace(CLIP, f"clips++; {CLIP}").replace(VISIT, f"visits++; {VISIT}"), optimise=("-O1",))

    def cells(shape: Layout, rows: Array, otherwise: Array) -> Found:
        bodies = (rows.shape[1] // (1 + shape.order) - shape.forms) // shape.coefficients
        nodes, weights = gauss_legendre((shape.degree + 1) // 2 + 1)
        rule, gauss = np.array(triangle_rule(shape.degree)), np.stack([0.5 + 0.5 * np.array(nodes), 0.5 * np.array(weights)], axis=1)
        numbers = np.array([*shape[:4], bodies, len(rule), len(gauss)], dtype=np.int32)
        values, sizes, counts = np.zeros(bodies), np.zeros(bodies), np.zeros(2, dtype=np.int64)
        tables = np.zeros((bodies, len(rows) + 1, shape.columns * (1 + shape.order)))
        given = [np.ascontiguousarray(a) for a in (numbers, rule, gauss, rows, otherwise, values, sizes, tables, counts)]
        at = [ctypes.c_void_p(a.ctypes.data) for a in given]
        assert library.cells(*at[:3], ctypes.c_int64(len(rows)), *at[3:]) == 0
        return Found(*given[5:8], *map(int, given[8]))

    return cells


@pytest.fixture(scope="module")
def by_cuts() -> Callable[[Layout, Array, Array], Found]:
    return cells_where_many_are(2)


@pytest.fixture(scope="module")
def with_each() -> Callable[[Layout, Array, Array], Found]:
    return cells_where_many_are(1 << 30)


def guards(triangles: Array) -> Array:
    """Returns three forms (c, a, b) for each triangle (n, 3, 2), >= 0 inside of it."""
    p, q = triangles, np.roll(triangles, -1, axis=1)
    a, b = p[..., 1] - q[..., 1], q[..., 0] - p[..., 0]
    forms = np.stack([-a * p[..., 0] - b * p[..., 1], a, b], axis=-1)
    turn = np.cross(np.pad(p[:, 1] - p[:, 0], ((0, 0), (0, 1))), np.pad(p[:, 2] - p[:, 0], ((0, 0), (0, 1))))[:, 2]
    return forms * np.where(turn < 0.0, -1.0, 1.0)[:, None, None]


# -- growth ------------------------------------------------------------------------------------------------------------


def apart(side: int, random: np.random.Generator) -> Array:
    """Returns side² triangles on a grid, turned at random, that do not meet."""
    centres = (np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 1, 2) + 0.5) / side
    angles = random.uniform(0.0, 7.0, (side * side, 1)) + np.array([0.0, 2.1, 4.2])
    return centres + 0.45 / side * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def scattered(side: int, random: np.random.Generator) -> Array:
    """Returns side² small triangles, of which a few meet."""
    return random.uniform(size=(side * side, 1, 2)) + random.normal(0.0, 0.5 / side, (side * side, 3, 2))


@pytest.mark.parametrize("nearest", [False, True], ids=["union", "nearest"])
@pytest.mark.parametrize("scene", [apart, scattered])
def test_clipped_pairs_grow_linearly(scene: Callable[..., Array], nearest: bool) -> None:
    """A candidate is clipped with the few cells around it, however many there are; finding them looks at some 20 cuts."""
    cells = cells_where_many_are(LIMITS["TEG_MANY_CELLS"])
    clips, visits = [], []
    for side in (15, 30, 60):
        random = np.random.default_rng(side)
        n = side * side
        key = np.stack([random.uniform(size=n) * nearest, *np.zeros((2, n))], axis=1)
        rows = np.concatenate([guards(scene(side, random)).reshape(n, 9), key, np.ones((n, 1))], axis=1)
        found = cells(Layout(1, 3, 0), rows, np.zeros(1))
        clips.append(found.clips / n)
        visits.append(found.visits / n)
    assert max(clips) < 8
    assert clips[2] < 1.6 * clips[0]
    assert visits[2] < 12 * visits[0]  # 16 times as many candidates
    assert max(visits) < 400


# -- the same as with every cell ---------------------------------------------------------------------------------------


def mesh(side: int, bend: float, random: np.random.Generator) -> Array:
    """Returns triangles with common edges; their sides are those of the square, or lie beyond where `bend` is not 0."""
    ticks = np.linspace(0.0, 1.0, side + 1)
    v = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1)
    v += bend * random.normal(size=v.shape) / side
    a, b, c, d = v[:-1, :-1], v[1:, :-1], v[1:, 1:], v[:-1, 1:]
    return np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 2)


def with_t_junctions(random: np.random.Generator) -> Array:
    """Every other triangle of a mesh is halved, so that corners lie on edges."""
    whole = mesh(5, 0.0, random)
    p, q, r = whole[::2].transpose(1, 0, 2)
    middle = 0.5 * (p + q)
    return np.concatenate([whole[1::2], np.stack([middle, q, r], axis=1), np.stack([p, middle, r], axis=1)])


def coincident(random: np.random.Generator) -> Array:
    some = scattered(5, random) * 0.9
    return np.concatenate([some, np.roll(some, 1, axis=1), some[:5, ::-1]])


def thin(random: np.random.Generator) -> Array:
    """Slivers across the square, down to a width of 1e-14."""
    p, along, across = random.uniform(size=(40, 2)), random.normal(size=(40, 2)), random.normal(size=(40, 2))
    return np.stack([p, p + along, p + 0.5 * along + across * 10.0 ** random.uniform(-14, -1, (40, 1))], axis=1)


SCENES: dict[str, Callable[[np.random.Generator], Array]] = {
    "a mesh up to the border": lambda random: mesh(5, 0.0, random),
    "a bent mesh": lambda random: mesh(5, 0.3, random),
    "two meshes": lambda random: np.concatenate([mesh(4, 0.3, random), mesh(4, 0.0, random)]),
    "T-junctions": with_t_junctions,
    "coincident": coincident,
    "corners on a grid": lambda random: np.round(8 * random.uniform(size=(50, 1, 2)) + 1.5 * random.normal(size=(50, 3, 2))) / 8,
    "thin": thin,
    "of all sizes": lambda random: (
        random.uniform(size=(40, 1, 2)) + random.normal(size=(40, 3, 2)) * 10 ** random.uniform(-2, 0, (40, 1, 1))
    ),
}


def keys(kind: str, n: int, random: np.random.Generator) -> Array:
    found = random.normal(size=(n, 3))
    if kind == "equal":
        return 0.0 * found
    return np.round(found) if kind == "ties" else found


def tables_of(way: Any, shape: Layout, rows: Array, otherwise: Array) -> Array:
    return way(shape, rows, otherwise).tables


@pytest.mark.parametrize("kind", ["equal", "ties", "crossing"])
@pytest.mark.parametrize("scene", SCENES)
def test_cells_that_are_not_looked_at_do_not_matter(by_cuts: Any, with_each: Any, scene: str, kind: str) -> None:
    for seed, shape in enumerate((Layout(1, 3, 0), Layout(1, 3, 1), Layout(2, 3, 1), Layout(1, 3, 1, 1))):
        random = np.random.default_rng([seed, len(scene)])
        triangles = SCENES[scene](random)
        n = len(triangles)
        parts = [guards(triangles[random.permutation(n)] if part or seed else triangles).reshape(n, 9) for part in range(shape.parts)]
        bodies = random.normal(size=(n + 1, shape.coefficients))
        rows = np.concatenate([*parts, keys(kind, n, random), bodies[:-1]], axis=1)
        otherwise = bodies[-1]
        if shape.order:
            rows = np.concatenate([rows, random.normal(size=rows.shape)], axis=1)
            otherwise = np.concatenate([otherwise, random.normal(size=otherwise.shape)])
        found, expected = by_cuts(shape, rows, otherwise), with_each(shape, rows, otherwise)
        assert 0 < found.clips < expected.clips
        tables = max(1.0, np.nanmax(np.abs(expected.tables)))  # not numbers at second derivatives where edges lie on one line
        np.testing.assert_allclose(found.values, expected.values, rtol=0, atol=1e-15 * (tables if shape.order else 4.0))
        np.testing.assert_allclose(found.sizes, expected.sizes, rtol=0, atol=1e-14)
        if is_parted(shape, rows, otherwise):
            for way, result in ((by_cuts, found), (with_each, expected)):
                assert_right(result.tables, partial(tables_of, way, shape._replace(order=0)), rows, otherwise)
        else:
            np.testing.assert_allclose(found.tables, expected.tables, rtol=0, atol=1e-13 * tables)
        if seed == 1 and scene != "thin":  # where the last bits of lines move their crossings by more
            plain = integrals(shape, rows.tolist(), otherwise.tolist(), True)
            np.testing.assert_allclose(found.values, plain.values, rtol=0, atol=1e-14)
            np.testing.assert_allclose(found.tables, plain.tables, rtol=0, atol=1e-12 * tables)


def motion(triangles: Array, random: np.random.Generator) -> Array:
    """Returns how the guards change as an affine map moves all corners: corners and edges that are together stay together."""
    step, moved = 2.0**-12, triangles @ random.normal(size=(2, 2)) + random.normal(size=2)
    return (guards(triangles + step * moved) - guards(triangles - step * moved)) / (2.0 * step)


@pytest.mark.parametrize("scene", [scene for scene in SCENES if scene != "thin"])
def test_second_derivatives_along_motions_are_those_of_the_plain_routine(with_each: Any, scene: str) -> None:
    """Which of two coincident lines an edge belongs to may differ, hence single entries; not what a motion makes of all of them."""
    shape, known = Layout(1, 3, 1, 1), 0
    for seed in range(3):
        random = np.random.default_rng([seed, len(scene)])
        triangles = np.asarray(SCENES[scene](random))
        n = len(triangles)
        first, second = (motion(triangles, random).reshape(n, 9) for _ in range(2))
        changes = [random.normal(size=(n, 3)), random.normal(size=(n, shape.coefficients))]
        bodies = random.normal(size=(n, shape.coefficients))
        rows = np.concatenate([guards(triangles).reshape(n, 9), keys("crossing", n, random), bodies, first, *changes], axis=1)
        otherwise = random.normal(size=2 * shape.coefficients)
        found, expected = with_each(shape, rows, otherwise), integrals(shape, rows.tolist(), otherwise.tolist(), True)
        for part in (0, shape.columns):
            here, there = (np.sum(np.asarray(t.tables)[0, :n, part : part + 9] * second) for t in (found, expected))
            known += bool(np.isfinite(there))
            if np.isfinite(there):
                np.testing.assert_allclose(here, there, rtol=1e-9, atol=1e-9)
    assert known


@pytest.mark.parametrize("shape", [Layout(1, 3, 0), Layout(1, 3, 1), Layout(1, 3, 2), Layout(1, 0, 1), Layout(2, 3, 1)], ids=str)
def test_a_square_of_one_owner_needs_no_cells(with_each: Any, shape: Layout) -> None:
    """No candidate, and one that covers the square, or touches its side, or ends in it, or is not a number: as the plain routine."""
    random = np.random.default_rng(3)
    far = 9.0 * np.stack([np.cos([0.1, 2.2, 4.3]), np.sin([0.1, 2.2, 4.3])], axis=-1)
    triangles = [far, far + 4.0, [[0.0, -3.0], [9.0, 0.5], [0.0, 9.0]], [[-1e-13, -3.0], [9.0, 0.5], [-1e-13, 9.0]], [[-9, -9]] * 3]
    looked_at = []
    for triangle in triangles:
        forms = np.tile(guards(np.array([triangle]))[0, : shape.guards].ravel(), shape.parts)
        row = np.concatenate([forms, random.normal(size=3 + shape.coefficients)])
        for column in (None, 0, len(forms)):
            rows = row[None].copy()
            if column is not None:
                rows[0, column] = np.nan
            otherwise = random.normal(size=shape.coefficients)
            for given in (rows, rows[:0]):
                found, expected = with_each(shape, given, otherwise), integrals(shape, given.tolist(), otherwise.tolist(), True)
                looked_at.append(found.clips)
                np.testing.assert_allclose(found.values, expected.values, rtol=1e-14, atol=1e-14)
                if not np.isnan(found.values).any():
                    np.testing.assert_allclose(found.tables, expected.tables, rtol=0, atol=1e-12)
    assert min(looked_at) == 0


def test_power_cells_are_cut_in_tiles(by_cuts: Callable[..., Found]) -> None:
    """Candidates without guards meet each other: tiles see few of them. Beside the plain routine, and by counting."""
    shape, clips = Layout(1, 0, 1), []
    for count in (60, 960):
        random = np.random.default_rng(count)
        sites, weights = random.uniform(size=(count, 2)), random.uniform(size=count) / count
        rows = np.column_stack([(sites**2).sum(axis=1) - weights, -2 * sites, random.normal(size=(count, 3))])
        found = by_cuts(shape, rows, np.zeros(3))
        clips.append(found.clips)
        if count == 60:
            one = integrals(shape, rows.tolist(), [0.0] * 3, True)
            np.testing.assert_allclose(found.values, one.values, atol=1e-13)
            np.testing.assert_allclose(found.sizes, one.sizes, atol=1e-13)
            np.testing.assert_allclose(np.ravel(found.tables), np.ravel(one.tables), atol=1e-11)
    assert clips[1] < 1.8 * 16 * clips[0]
