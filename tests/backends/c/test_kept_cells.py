"""Cells that are kept in C: the table of a weighted sum of values is the weighted sum of the tables that the plain routine makes."""

from __future__ import annotations

import ctypes
import itertools
import platform
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

import teg
from teg.backends.c.build import load_library
from teg.backends.c.runtime import runtime
from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import Layout
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program.arrays import Cells, Combined, SeenLoop, Take, steps
from teg.program.interpreter.arrays import interpret_arrays
from tests.backends.c.test_cells import SCENES, guards, keys
from tests.bench.rasteriser import Ours, overlapping, waves

pytestmark = pytest.mark.usefixtures("for_this_machine")
Array = np.ndarray[Any, Any]
ENTRY = """
int kept(const int *s, const double *rule, const double *gauss, int64_t n, const double *rows, const double *otherwise,
         const double *weights, double *values, double *moments, double *table, unsigned char *seen)
{
    const teg_shape shape = {s[0], s[1], s[2], s[3], s[4], s[5], s[6], rule, gauss};
    teg_kept cells;
    cells.state = TEG_NO_CELLS;
    int failed = teg_keep_cells(&cells, &shape, n, rows, otherwise, values, moments, seen), state = cells.state;
    failed |= teg_pull_back(&cells, otherwise, weights, table, seen);
    teg_let_go(&cells);
    return failed ? -1 : state;
}
"""
ONE_OWNER, CELLS, TWO_PARTS, TABLES, UNDEFINED, SIGNED = range(6)
"""What becomes of the cells of a square."""


class Found(NamedTuple):
    """Values; moments, the table of forms and which candidates are seen, with a last row for what is outside; the state of the cells."""

    values: Array
    moments: Array
    table: Array
    seen: Array
    state: int


def kept_cells(first: str = "") -> Callable[[Layout, Array, Array, Array], Found]:
    """Returns the routine of the runtime, compiled with a text in front of it."""
    always, *parts = runtime(["teg_keep_cells", "teg_pull_back", "teg_let_go"])
    library = load_library("\n\n".join([first, always, *parts, ENTRY]), optimise=("-O1",))

    def cells(shape: Layout, rows: Array, otherwise: Array, weights: Array) -> Found:
        nodes, parts = gauss_legendre((shape.degree + 1) // 2 + 1)
        rule, gauss = np.array(triangle_rule(shape.degree)), np.stack([0.5 + 0.5 * np.array(nodes), 0.5 * np.array(parts)], axis=1)
        numbers = np.array([*shape[:4], len(weights), len(rule), len(gauss)], dtype=np.int32)
        values, moments = np.full(len(weights), 7.0), np.full((len(rows) + 1, shape.coefficients), 7.0)
        table, seen = np.full((len(rows) + 1, shape.forms), 7.0), np.full(len(rows) + 1, 7, dtype=np.uint8)
        given = [np.ascontiguousarray(a) for a in (numbers, rule, gauss, rows, otherwise, weights, values, moments, table, seen)]
        at = [ctypes.c_void_p(a.ctypes.data) for a in given]
        state = library.kept(*at[:3], ctypes.c_int64(len(rows)), *at[3:])
        assert state >= 0
        return Found(*given[6:], state)

    return cells


@pytest.fixture(scope="module")
def kept() -> Callable[[Layout, Array, Array, Array], Found]:
    return kept_cells()


def check(kept: Any, shape: Layout, rows: Array, otherwise: Array, weights: Array, tolerance: float = 1e-12) -> int:
    """Compares with the plain routine, moments to a tenth of the tolerance; returns what has become of the cells."""
    found = kept(shape, rows, otherwise, weights)
    plain = integrals(shape, rows.tolist(), otherwise.tolist(), True)
    tables = np.array(plain.tables).reshape(len(weights), len(rows) + 1, shape.columns)
    whole = np.tensordot(weights, tables[..., : shape.forms], axes=1)
    size = max(1.0, np.abs(weights).max() * np.abs(tables[..., : shape.forms]).max(initial=0.0))
    np.testing.assert_allclose(found.values, plain.values, rtol=1e-14, atol=0.1 * tolerance)
    np.testing.assert_allclose(found.moments, tables[0, :, shape.forms :], rtol=0, atol=0.1 * tolerance)
    np.testing.assert_allclose(found.table, whole, rtol=0, atol=tolerance * size)
    nothing = (found.table == 0.0).all(axis=1) & (found.moments == 0.0).all(axis=1)
    assert np.isin(found.seen, (0, 1, 3)).all()
    assert (nothing | (found.seen > 0)).all()
    assert not found.table[found.seen < 3].any()
    return int(found.state)


def numbers_of(shape: Layout, forms: Array, key: Array, bodies: int, random: np.random.Generator) -> tuple[Array, Array, Array]:
    """Returns rows, polynomials outside of all, and weights."""
    n = len(forms)
    polynomials = random.normal(size=(n + 1, bodies * shape.coefficients))
    return np.concatenate([forms.reshape(n, -1), key, polynomials[:-1]], axis=1), polynomials[-1], random.normal(size=bodies)


@pytest.mark.parametrize("kind", ["equal", "ties", "crossing"])
@pytest.mark.parametrize("scene", sorted(set(SCENES) - {"thin"}))
def test_weighted_tables_of_scenes(kept: Any, scene: str, kind: str) -> None:
    """Meshes, T-junctions, coincident triangles, corners on a grid; a few triangles of each, and all of them."""
    states = set()
    for seed, shape in enumerate((Layout(1, 3, 0), Layout(1, 3, 1), Layout(1, 3, 2))):
        random = np.random.default_rng([seed, len(scene)])
        triangles = SCENES[scene](random)
        for count in (1, 2, 2, 3, 4, 6, len(triangles)):
            some = random.permutation(len(triangles))[:count]
            rows, otherwise, weights = numbers_of(shape, guards(triangles[some]), keys(kind, len(some), random), 1 + seed, random)
            states.add(check(kept, shape, rows, otherwise, weights))
    assert not states.isdisjoint({CELLS, SIGNED})
    assert scene in ("a bent mesh", "coincident", "of all sizes") or TABLES in states  # edges on sides of the square


@pytest.mark.parametrize("constant", [0.0, 0.5, -0.5])
def test_guards_without_a_line(kept: Any, constant: float) -> None:
    """A number in the place of a guard holds on all of the square, also if it is 0, or on none of it."""
    random, shape = np.random.default_rng(7), Layout(1, 3, 1)
    forms = np.array([[[1.0, 0.25, -0.5], [constant, 0.0, 0.0], [0.75, 0.0, 0.0]]])
    rows, otherwise, weights = numbers_of(shape, forms, random.normal(size=(1, 3)), 2, random)
    assert (check(kept, shape, rows, otherwise, weights) == ONE_OWNER) == (constant >= 0.0)
    check(kept, shape, np.concatenate([rows, rows]), otherwise, weights)


@pytest.mark.parametrize("slope", [0.0, 1.0, -1.0])
@pytest.mark.parametrize("gap", [0.0, 1e-13, 1e-12, 1e-9, 0.25, -1e-12, -0.25])
def test_keys_that_nearly_touch_that_of_the_base(kept: Any, gap: float, slope: float) -> None:
    """One or two triangles before what covers the square, but for a gap at a corner of the square or on all of it."""
    random, shape = np.random.default_rng(8), Layout(1, 3, 1)
    corners = np.array(
        [[[-9.0, -9.0], [9.0, -9.0], [0.0, 20.0]], [[0.2, 0.1], [0.9, 0.3], [0.4, 0.8]], [[0.1, 0.5], [0.7, 0.15], [0.8, 0.9]]]
    )
    key = np.array([[1.0, 0.5, 0.25], [1.0 - gap, 0.5 - slope, 0.25 - slope], [1.0 - 3.0 * gap, 0.5 - 2.0 * slope, 0.25 - slope]])
    for count in (2, 3):
        check(kept, shape, *numbers_of(shape, guards(corners[:count]), key[:count], 2, random))


def test_which_rows_are_listed_is_found_once() -> None:
    """A table of rows and the sums over its rows read the same list."""
    source = Ours(overlapping(3, 4), waves(4)).evaluator.source
    assert source.count("= teg_listed(") == 1
    assert len(re.findall(r"free\(\w+_listed\);", source)) == 1


def halves(random: np.random.Generator, through: Array) -> Array:
    """Returns two triangles with a common edge that goes through a point of the square, and cover it all but for rounding."""
    angle = random.uniform(0.0, 2 * np.pi)
    way = 9.0 * np.array([np.cos(angle), np.sin(angle)])
    p, q, side = through - way, through + way, 9.0 * np.array([-way[1], way[0]])
    return np.stack([[p, q, through + side], [q, p, through - side]])


@pytest.mark.parametrize("kind", ["equal", "ties", "crossing"])
def test_one_line_cuts_the_square(kept: Any, kind: str) -> None:
    """Two triangles with a common edge, one alone, and one in front of, behind or across another one that covers the square."""
    random, shape, states = np.random.default_rng(5), Layout(1, 3, 1), []
    far = 99.0 * np.stack([np.cos([0.1, 2.2, 4.3]), np.sin([0.1, 2.2, 4.3])], axis=-1)
    for k in range(300):
        two = halves(random, random.uniform(size=2))
        for triangles in (two, two[::-1], two[:1], np.stack([two[0], far]), np.stack([far, two[1]]), np.stack([two[0], two[1], far])):
            key = keys(kind, len(triangles), random)
            if k % 3 == 0:
                key[:, 1:] *= 1e-3  # does not cross
            states.append(check(kept, shape, *numbers_of(shape, guards(triangles), key, 3, random)))
    assert 0.2 < states.count(TWO_PARTS) / len(states) < 0.9


def test_where_one_line_is_at_a_corner_or_on_a_side(kept: Any) -> None:
    """An edge through corners of the square, along a side, to rounding or to 1e-12 and 1e-9 beside it; and edges that nearly coincide."""
    random, shape = np.random.default_rng(6), Layout(1, 3, 1)
    lines = [
        ((0.0, 0.0), (1.0, 1.0)),
        ((0.0, 0.0), (1.0, 0.3)),
        ((0.0, 0.0), (0.0, 1.0)),
        ((0.0, 1.0), (1.0, 1.0)),
        ((0.5, 0.0), (0.5, 1.0)),
    ]
    for p, q in lines:
        for shift in (0.0, 1e-15, -1e-13, 3e-13, -1e-11, 1e-9):
            for apart in (0.0, 1e-14, 1e-13, -1e-11, 1e-9):
                start, way = np.array(p) + shift, 9.0 * (np.array(q) - p)
                side = 9.0 * np.array([-way[1], way[0]])
                one = [start - way, start + way, start + side]
                other = [start + way + apart, start - way + apart, start - side]
                rows, otherwise, weights = numbers_of(shape, guards(np.array([one, other])), keys("ties", 2, random), 2, random)
                for some in ([0], [1], [0, 1], [1, 0]):
                    check(kept, shape, rows[some], otherwise, weights, 1e-11)


def fan(random: np.random.Generator, count: int, centre: Array) -> Array:
    """Returns triangles with a common corner, which go around it and beyond the square."""
    angles = np.sort(random.uniform(0.0, 2 * np.pi) + 2 * np.pi * (np.arange(count) + random.uniform(-0.3, 0.3, count)) / count)
    ring = centre + 9.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.stack([np.broadcast_to(centre, ring.shape), ring, np.roll(ring, -1, axis=0)], axis=1)


AROUND = [
    ("nothing", "ties"),
    *itertools.product(["nothing", "a triangle", "a fan", "a fan and a triangle"], ["equal", "crossing", "one over the other"]),
]


@pytest.mark.parametrize(("behind", "kind"), AROUND)
def test_triangles_around_a_corner(kept: Any, behind: str, kind: str) -> None:
    """Fans, whole and in part, before and across other ones and a triangle that covers the square: cells with signs."""
    random, states = np.random.default_rng(11), []
    far = 99.0 * np.stack([np.cos([0.1, 2.2, 4.3]), np.sin([0.1, 2.2, 4.3])], axis=-1)
    for k in range(80):
        shape = Layout(1, 3, k % 3)
        front = fan(random, int(random.integers(3, 7)), random.uniform(size=2))
        front = front[random.permutation(len(front))[: len(front) - k % 2]]
        back = fan(random, int(random.integers(3, 5)), random.uniform(-0.5, 1.5, size=2))
        parts = [front, *([back] if "fan" in behind else []), *([far[None]] if "triangle" in behind else [])]
        triangles = np.concatenate(parts)
        key = keys(kind if kind != "one over the other" else "crossing", len(triangles), random)
        if kind == "one over the other":
            key = 0.1 * key + np.repeat(np.arange(len(parts)), [len(p) for p in parts])[:, None] * np.array([3.0, 0.0, 0.0])
        states.append(check(kept, shape, *numbers_of(shape, guards(triangles), key, 3, random)))
    assert behind != "nothing" or states.count(SIGNED) > 25


def test_what_hidden_candidates_hold_does_not_matter(kept: Any) -> None:
    """A triangle behind a fan, or behind one triangle of it, has a polynomial that is not a number."""
    random, shape = np.random.default_rng(12), Layout(1, 3, 1)
    for k in range(40):
        front = fan(random, 5, random.uniform(0.2, 0.8, size=2))
        back = front[0] + 0.1 * (front[0].mean(axis=0) - front[0]) if k % 2 else fan(random, 3, random.uniform(size=2))[0]
        key = np.zeros((6, 3))
        key[5, 0] = 1.0
        rows, otherwise, weights = numbers_of(shape, guards(np.concatenate([front, back[None]])), key, 2, random)
        rows[5, 12:] = np.nan
        found = kept(shape, rows, otherwise, weights)
        assert np.isfinite(found.values).all()
        assert np.isfinite(found.table).all()


def test_parts_of_one_candidate_are_no_two_owners(kept: Any) -> None:
    random, shape = np.random.default_rng(7), Layout(2, 3, 1)
    for _ in range(20):
        two = guards(halves(random, random.uniform(size=2)))
        alone = np.tile([-1.0, 0.0, 0.0], (3, 1))
        for parts in ([two[0], two[1]], [two[0], alone], [alone, two[1]]):
            check(kept, shape, *numbers_of(shape, np.stack([np.stack(parts)]), keys("crossing", 1, random), 2, random))


def test_what_is_not_a_number(kept: Any) -> None:
    """A key that is none; nothing outside; a weight that is infinite where polynomials do not differ."""
    random, shape = np.random.default_rng(8), Layout(1, 3, 1)
    rows, otherwise, weights = numbers_of(shape, guards(halves(random, np.array([0.4, 0.7]))), keys("crossing", 2, random), 2, random)
    assert check(kept, shape, rows, np.full(6, np.nan), weights) == TWO_PARTS
    assert np.isnan(kept(shape, rows[:1], np.full(6, np.nan), weights).values).all()
    rows[1, 12:15] = rows[0, 12:15] = otherwise[:3]
    found = kept(shape, rows, otherwise, np.array([np.inf, 2.0]))
    assert np.isfinite(found.table).all()
    assert found.table.any()
    rows[0, 9] = np.nan
    found = kept(shape, rows, otherwise, weights)
    assert found.state == UNDEFINED
    assert np.isnan(found.values).all()
    assert np.isnan(found.table).all()


# -- programs ----------------------------------------------------------------------------------------------------------


def scene() -> tuple[teg.Expr, list[Any]]:
    """Returns two losses of three channels of triangles in 3 × 3 squares: one of all channels, one of the first."""
    x, y = teg.vars("x y")
    V, C = teg.array("V", 3), teg.array("C", 2)
    i, j, k = teg.index("i"), teg.index("j"), teg.index("k")
    p = [(V[k, n, 0], V[k, n, 1]) for n in range(3)]

    def across(a: Any, b: Any) -> Any:
        return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])

    inside = (across(p[0], p[1]) > 0) & (across(p[1], p[2]) > 0) & (across(p[2], p[0]) > 0)
    colours = tuple(C[k, c] + (x if c == 1 else 0) for c in range(3))
    seen = teg.nearest(
        colours, V[k, 0, 2] * x + V[k, 1, 2] * y + V[k, 2, 2], (k, 0, teg.length(V)), where=inside, otherwise=(0.1, 0.2, 0.3)
    )
    means = [teg.integral(c, (x, j, j + 1), (y, i, i + 1)) for c in seen]
    whole = teg.sum(means[0] ** 2 + teg.exp(means[1]) * means[2], (j, 0, 3), (i, 0, 3))
    return teg.tuple(whole, teg.sum(teg.sin(means[0]), (j, 0, 3), (i, 0, 3))), [V, C]


def given(seed: int) -> dict[str, Array]:
    random = np.random.default_rng(seed)
    corners = random.uniform(0, 3, (6, 1, 2)) + random.normal(size=(6, 3, 2))
    turn = np.cross(np.pad(corners[:, 1] - corners[:, 0], ((0, 0), (0, 1))), np.pad(corners[:, 2] - corners[:, 0], ((0, 0), (0, 1))))[:, 2]
    corners[turn < 0] = corners[turn < 0, ::-1]
    return {"V": np.concatenate([corners, random.normal(size=(6, 3, 1))], axis=2), "C": random.normal(size=(6, 3))}


@pytest.mark.usefixtures("x64_for_jax")
@pytest.mark.parametrize("backend", ["c", "numpy", "jax"])
def test_losses_of_all_channels_and_of_one(backend: str) -> None:
    """Cells that two losses read in different ways are measured for each channel, and of one loss they are kept: both are the same."""
    losses, wrt = scene()
    both = teg.compile(losses, wrt, backend=backend)
    readers = [s for s in steps(both.program(1).body) if isinstance(s, Combined)]
    assert sorted(len(s.of) for s in readers) == [1, 3]
    values, slopes = both.value_and_grad(given(1))
    for k, loss in enumerate(losses.children):
        value, exact = teg.compile(loss, wrt, backend="c" if backend != "c" else "numpy").value_and_grad(given(1))
        np.testing.assert_allclose(values[k], value, rtol=1e-12)
        for name, slope in exact.items():
            np.testing.assert_allclose(slopes[name][k], slope, rtol=0, atol=1e-11 * np.abs(slope).max())


def test_one_loss_is_swept_once() -> None:
    losses, wrt = scene()
    program = teg.compile(losses.children[0], wrt, backend="c").program(1)
    every = list(steps(program.body))
    assert sum(isinstance(s, Cells) for s in every) == sum(isinstance(s, Combined) for s in every) == 1
    (loop,) = (s for s in every if isinstance(s, SeenLoop))
    read = {s.table for s in every if isinstance(s, Take)}
    assert read == {loop.table}


def test_the_interpreter_says_the_same() -> None:
    losses, wrt = scene()
    f, arguments = teg.compile(losses.children[0], wrt, backend="c"), given(2)
    found = interpret_arrays(f.program(1), [], [arguments[a.name] for a in f.program(1).arrays])
    value, slopes = f.value_and_grad(arguments)
    assert found.outputs[0] == pytest.approx(value, rel=1e-13)
    for name, entries in zip("VC", found.outputs[1:], strict=True):
        whole = np.zeros_like(slopes[name])
        for place, number in entries.items():
            whole[place] = number
        np.testing.assert_allclose(whole, slopes[name], rtol=0, atol=1e-12 * np.abs(whole).max())


@pytest.mark.parametrize("outside", ["numbers", "a parameter", "a parameter that is differentiated"])
def test_squares_without_candidates_are_computed_apart(outside: str) -> None:
    """Lists of candidates, most of them empty; what is outside is known, given, or has derivatives, for which its moments are needed."""
    x, y = teg.vars("x y")
    V, R, L, T, B = teg.array("V", 2), teg.indices("R", 2), teg.indices("L"), teg.array("T", 2), teg.array("B")
    i, j, k = teg.index("i"), teg.index("j"), teg.index("k")
    inside = (x > V[L[k], 0]) & (y > V[L[k], 1]) & (x + y < V[L[k], 2])
    otherwise = (0.25 - 0.5 * x, x * y) if outside == "numbers" else (B[0] + 0.5 * B[1] * x, B[1] - y)
    seen = teg.nearest(
        (V[L[k], 3] * x, V[L[k], 3] + y), V[L[k], 2] * x, (k, R[4 * i + j, 0], R[4 * i + j, 1]), where=inside, otherwise=otherwise
    )
    means = [teg.integral(c, (x, j, j + 1), (y, i, i + 1)) for c in seen]
    loss = teg.sum((means[0] * means[1] - T[i, j]) ** 2, (j, 0, 4), (i, 0, 4))
    wrt = [V, T, *([B] if "differentiated" in outside else [])]
    random = np.random.default_rng(4)
    counts = np.array([0, 2, 0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 0, 0, 1, 0])
    ends = np.cumsum(counts)
    places = np.repeat(np.arange(16), counts)
    corners = np.stack([places % 4, places // 4], axis=1) + random.uniform(-0.3, 0.3, (7, 2))
    rows = np.column_stack([corners, corners.sum(axis=1) + random.uniform(0.7, 2.0, 7), random.normal(size=7)])
    given = {"V": rows, "R": np.stack([ends - counts, ends], axis=1), "L": np.arange(7), "T": random.normal(size=(4, 4))}
    given |= {} if outside == "numbers" else {"B": random.normal(size=2)}
    compiled = {backend: teg.compile(loss, wrt, backend=backend) for backend in ("c", "numpy")}
    results = {backend: f.value_and_grad(given) for backend, f in compiled.items()}
    assert results["c"][0] == pytest.approx(results["numpy"][0], rel=1e-13)
    for name, slope in results["numpy"][1].items():
        np.testing.assert_allclose(results["c"][1][name], slope, rtol=0, atol=1e-12 * np.abs(slope).max())
    apart = re.search(r"if \(i\d+ <= i\d+\) \{", compiled["c"].source) is not None
    assert apart == ("differentiated" not in outside)
    given["L"], given["R"] = given["L"][:0], np.zeros_like(given["R"])
    assert compiled["c"](given) == pytest.approx(compiled["numpy"](given), rel=1e-14)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other allocators have rules of their own")
def test_memory_of_tables_stays_in_the_process() -> None:
    """Calls after the first ones have no page faults for the rows of 20 000 triangles, which would be thousands."""
    import resource

    whole = overlapping(20_000, 64)
    corners = whole.places.reshape(-1, 3, 2)
    middles = corners.mean(axis=1, keepdims=True)
    ours = Ours(whole._replace(places=(middles + 0.04 * (corners - middles)).reshape(-1, 2)), waves(64))
    faults = []
    for _ in range(4):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        ours()
        faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    assert min(faults[2:]) < 500, faults
