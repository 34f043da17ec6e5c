"""Random meshes, Voronoi cells and auctions against integration by slices, which shares nothing with the compiler.

The reference cuts the box at every height at which two of all lines meet (guards, and pairs of keys), and looks at each piece of a slice
for the candidate with the least key; a rule of Gauss and Legendre on slices and pieces is exact for linear colours. Gradients are
compared with its central differences, which at a kink are the mean of both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest

import teg
from teg.program.interpreter.arrays import interpret_arrays
from teg.program.verify import verified_arrays

Form = tuple[Any, Any, Any]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)
BOX = (0.1, 1.1, -0.2, 0.8)
FACES = np.array([[0, 1, 2], [3, 4, 5], [6, 7, 8], [9, 10, 11]])


def sliced(guards: list[list[Form]], keys: list[Form], bodies: list[Callable[[Any, Any], Any]], other: float, box: Any = BOX) -> float:
    """∫∫ of the body of the candidate with the least key among those whose guards are all >= 0; `other` where there is none."""
    x0, x1, y0, y1 = box
    lines = [g for candidate in guards for g in candidate]
    lines += [tuple(a - b for a, b in zip(p, q, strict=True)) for p, q in combinations(keys, 2)]
    sides = [(-x0, 1.0, 0.0), (-x1, 1.0, 0.0)]
    heights = [y0, y1]
    for (c, a, b), (d, e, f) in combinations([*lines, *sides], 2):
        across = a * f - b * e
        if across != 0.0:
            heights.append((c * e - a * d) / across)
    for c, a, b in lines:
        if a == 0.0 and b != 0.0:
            heights.append(-c / b)
    cuts = np.unique([h for h in heights if y0 <= h <= y1])
    total = 0.0
    for low, high in pairwise(cuts):
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            y = 0.5 * (low + high) + 0.5 * (high - low) * node
            xs = [-(c + b * y) / a for c, a, b in lines if a != 0.0]
            ends = np.unique([x0, x1, *(x for x in xs if x0 < x < x1)])
            total += 0.5 * (high - low) * weight * _slice(ends, y, guards, keys, bodies, other)
    return total


def _slice(ends: Any, y: float, guards: Any, keys: Any, bodies: Any, other: float) -> float:
    middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * (ends[1:] - ends[:-1])
    depth = np.full((len(keys), len(middle)), np.inf)
    for k, candidate in enumerate(guards):
        inside = np.all([c + a * middle + b * y >= 0 for c, a, b in candidate], axis=0) if candidate else np.ones(len(middle), bool)
        c, a, b = keys[k]
        depth[k] = np.where(inside, c + a * middle + b * y, np.inf)
    first = np.argmin(depth, axis=0)
    total = 0.0
    for node, weight in zip(NODES, WEIGHTS, strict=True):
        x = middle + half * node
        values = np.stack([np.broadcast_to(body(x, y), x.shape) for body in bodies])
        chosen = np.where(np.isfinite(depth.min(axis=0)), values[first, np.arange(len(x))], other)
        total += float((half * weight * chosen).sum())
    return total


# -- meshes ------------------------------------------------------------------------------------------------------------


def mesh_program(pixels: int = 0) -> teg.Expr:
    """The integral of the colour of the nearest triangle: positions, depths and colours at the corners; the sum of its squares over so many
    pixels a side."""
    k = teg.index("k")
    x, y = teg.vars("x y")
    P, D, C, F, B = teg.array("P", 2), teg.array("D"), teg.array("C", 2), teg.indices("F", 2), teg.array("B")
    p, q, r = ((P[F[k, i], 0], P[F[k, i], 1]) for i in range(3))

    def across(a: Any, b: Any, at: Any) -> Any:
        return (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0])

    area = across(p, q, r)
    weights = [across(q, r, (x, y)) / area, across(r, p, (x, y)) / area, across(p, q, (x, y)) / area]
    depth = sum(w * D[F[k, i]] for i, w in enumerate(weights))
    colour = sum(w * C[k, i] for i, w in enumerate(weights))
    inside = (weights[0] > 0) & (weights[1] > 0) & (weights[2] > 0)
    nearest = teg.nearest(colour, depth, (k, 0, teg.length(F)), where=inside, otherwise=B[4])
    if not pixels:
        return teg.integral(nearest, (x, B[0], B[1]), (y, B[2], B[3]))
    i, j = teg.index("i"), teg.index("j")
    width, height = (B[1] - B[0]) / pixels, (B[3] - B[2]) / pixels
    pixel = (x, B[0] + i * width, B[0] + (i + 1) * width), (y, B[2] + j * height, B[2] + (j + 1) * height)
    return teg.sum(teg.integral(nearest, *pixel) ** 2, (i, 0, pixels), (j, 0, pixels))


def mesh_reference(given: dict[str, Any]) -> float:
    P, D, C, F, B = (given[n] for n in "PDCFB")
    guards, keys, bodies = [], [], []
    for k, corners in enumerate(F):
        matrix = np.linalg.inv(np.vstack([np.ones(3), P[corners].T]))  # barycentric coordinates = matrix · (1, x, y)
        guards.append([tuple(row) for row in matrix])
        keys.append(tuple(D[corners] @ matrix))
        bodies.append(lambda x, y, f=C[k] @ matrix: f[0] + f[1] * x + f[2] * y)
    return sliced(guards, keys, bodies, B[4], B[:4])


def random_mesh(seed: int, count: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    P = rng.uniform(0.35, 0.75, (count, 1, 2)) + rng.normal(0, 0.35, (count, 3, 2)) - [0.0, 0.3]
    return {
        "P": P.reshape(-1, 2),
        "D": rng.uniform(size=3 * count),
        "C": rng.uniform(size=(count, 3)),
        "F": np.arange(3 * count).reshape(-1, 3),
        "B": np.array([*BOX, 0.3]),
    }


def strip(count: int) -> dict[str, Any]:
    """Triangles with common edges and corners, some on the border of the box; no two depths."""
    rng = np.random.default_rng(count)
    P = np.array([[0.1 + 0.25 * (i // 2), -0.2 + 0.5 * (i % 2)] for i in range(count + 2)])
    F = np.array([[i, i + 1, i + 2] if i % 2 else [i, i + 2, i + 1] for i in range(count)])
    return {"P": P, "D": rng.uniform(size=len(P)), "C": rng.uniform(size=(count, 3)), "F": F, "B": np.array([*BOX, 0.3])}


def slope_along(f: Callable[[dict[str, Any]], float], given: dict[str, Any], direction: dict[str, Any], h: float) -> float:
    def at(s: float) -> float:
        return f({**given, **{name: given[name] + s * d for name, d in direction.items()}})

    return (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)


@pytest.fixture(scope="module")
def meshes() -> dict[str, Any]:
    return {backend: teg.compile(mesh_program(), backend=backend) for backend in ("c", "numpy")}


def check_gradient(
    f: Any, reference: Callable[[dict[str, Any]], float], given: dict[str, Any], seed: int, names: str, h: float = 1e-4
) -> None:
    """Compares the gradient along a direction with differences, to what two steps of these agree to."""
    rng = np.random.default_rng(seed)
    _, gradient = f.value_and_grad(**given)
    for name in names:
        direction = {name: rng.normal(size=given[name].shape)}
        exact = float((gradient[name] * direction[name]).sum())
        one, two = (slope_along(reference, given, direction, step) for step in (h, h / 4))
        assert exact == pytest.approx(two, abs=1e-7 + 3 * abs(one - two)), name


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize(("seed", "count"), [(s, 2 + s % 3) for s in range(6)])
def test_random_meshes(meshes: dict[str, Any], backend: str, seed: int, count: int) -> None:
    given = random_mesh(seed, count)
    assert float(meshes[backend](**given)) == pytest.approx(mesh_reference(given), abs=2e-11)
    if backend == "c":
        check_gradient(meshes["c"], mesh_reference, given, seed, "PDCB")
    else:
        for name, slope in meshes["c"].grad(**given).items():
            np.testing.assert_allclose(meshes["numpy"].grad(**given)[name], slope, rtol=1e-12, atol=1e-12)


@pytest.mark.thorough
def test_many_random_meshes_have_their_values(meshes: dict[str, Any]) -> None:
    for seed in range(100, 160):
        given = random_mesh(seed, 2 + seed % 5)
        assert float(meshes["c"](**given)) == pytest.approx(mesh_reference(given), abs=2e-11), seed


def test_products_with_the_hessian(meshes: dict[str, Any]) -> None:
    for seed in range(4):
        given = random_mesh(seed, 3)
        rng = np.random.default_rng(seed)
        direction = {name: rng.normal(size=given[name].shape) for name in "PDCB"}
        for backend in ("c", "numpy"):
            product = meshes[backend].hvp(given, direction)
            ahead, behind = (meshes["c"].grad(**{**given, **{n: given[n] + s * d for n, d in direction.items()}}) for s in (1e-6, -1e-6))
            for name in "PDCB":
                expected = (ahead[name] - behind[name]) / 2e-6
                np.testing.assert_allclose(product[name], expected, atol=2e-6 * max(1.0, np.abs(expected).max()))


# -- degenerate placements ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_common_edges_and_corners_and_sides_on_the_border(meshes: dict[str, Any], count: int) -> None:
    given = strip(count)
    for f in meshes.values():
        assert float(f(**given)) == pytest.approx(mesh_reference(given), abs=2e-11)
        check_gradient(f, mesh_reference, given, count, "PDC", h=1e-6)


def coincident() -> dict[str, Any]:
    """Two triangles in one place at one depth, and one that crosses them."""
    given = random_mesh(5, 3)
    given["P"][3:6], given["D"][3:6] = given["P"][0:3], given["D"][0:3]
    return given


def test_of_equal_triangles_the_first_is_seen(meshes: dict[str, Any]) -> None:
    given = coincident()
    alone = {**given, "F": given["F"][[0, 2]], "C": given["C"][[0, 2]]}
    for f in meshes.values():
        assert float(f(**given)) == pytest.approx(mesh_reference(alone), abs=2e-11)
        assert np.abs(f.grad(**given)["C"][1]).max() == 0.0
        check_gradient(f, lambda v: mesh_reference({**v, "F": v["F"][[0, 2]], "C": v["C"][[0, 2]]}), given, 1, "C")


def test_the_order_of_candidates_does_not_matter(meshes: dict[str, Any]) -> None:
    for given in (random_mesh(3, 5), strip(6)):
        order = np.random.default_rng(0).permutation(len(given["F"]))
        other = {**given, "F": given["F"][order], "C": given["C"][order]}
        first, second = (meshes["c"].value_and_grad(**v) for v in (given, other))
        assert float(first[0]) == pytest.approx(float(second[0]), abs=1e-13)
        np.testing.assert_allclose(first[1]["P"], second[1]["P"], atol=1e-9)
        np.testing.assert_allclose(first[1]["C"][order], second[1]["C"], atol=1e-12)


def test_a_coarse_pixel_is_the_sum_of_fine_ones(meshes: dict[str, Any]) -> None:
    """Corners and edges of the strip lie on borders of the fine pixels: what one loses on a border another one has to gain."""
    given = strip(6)
    given["B"] = np.array([0.1, 1.1, -0.2, 0.8, 0.3])
    value, gradient = meshes["c"].value_and_grad(**given)
    total, slopes = 0.0, np.zeros_like(gradient["P"])
    for i, j in np.ndindex(8, 8):
        pixel = {**given, "B": np.array([0.1 + i / 8, 0.1 + (i + 1) / 8, -0.2 + j / 8, -0.2 + (j + 1) / 8, 0.3])}
        part, slope = meshes["c"].value_and_grad(**pixel)
        total, slopes = total + float(part), slopes + slope["P"]
    assert total == pytest.approx(float(value), abs=1e-11)
    np.testing.assert_allclose(slopes, gradient["P"], atol=1e-8)


# -- Voronoi cells and auctions ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_power_cells(backend: str) -> None:
    k = teg.index("k")
    x, y = teg.vars("x y")
    S, W = teg.array("S", 2), teg.array("W")
    key = (x - S[k, 0]) ** 2 + (y - S[k, 1]) ** 2 - W[k]
    f = teg.compile(teg.integral(teg.minimum_of(key, (k, 0, teg.length(W))) * (1 + x * y), (x, 0, 1), (y, 0, 1)), backend=backend)

    def reference(given: dict[str, Any]) -> float:
        forms = [(s @ s - w, -2 * s[0], -2 * s[1]) for s, w in zip(given["S"], given["W"], strict=True)]
        bodies = [
            lambda x, y, s=s, w=w: ((x - s[0]) ** 2 + (y - s[1]) ** 2 - w) * (1 + x * y)
            for s, w in zip(given["S"], given["W"], strict=True)
        ]
        return sliced([[]] * len(forms), forms, bodies, 0.0, (0.0, 1.0, 0.0, 1.0))

    for seed in range(6):
        rng = np.random.default_rng(seed)
        given = {"S": rng.uniform(size=(5, 2)), "W": 0.1 * rng.uniform(size=5)}
        assert float(f(**given)) == pytest.approx(reference(given), abs=2e-12)
        if seed < 2:
            check_gradient(f, reference, given, seed, "SW", h=1e-3)
    grid = {"S": np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]]), "W": np.zeros(4)}  # four cells meet in a point
    assert float(f(**grid)) == pytest.approx(reference(grid), abs=2e-12)
    check_gradient(f, reference, grid, 1, "SW", h=1e-4)


def test_second_price_auction() -> None:
    """Two bidders with values uniform on (0, 1): the revenue with reserve r is 1/3 + r² - 4r³/3 (Myerson 1981)."""
    x, y = teg.vars("x y")
    r = teg.param("r")
    k = teg.index("k")
    A = teg.array("A", 2)  # bids A·(x, y): any number of bidders
    bid = A[k, 0] * x + A[k, 1] * y
    sold = teg.bracket(teg.any(bid > r, (k, 0, teg.length(A))))
    low = teg.minimum_of(bid, (k, 0, teg.length(A)))
    bids = np.eye(2)
    f = teg.compile(teg.integral(sold, (x, 0, 1), (y, 0, 1)), [r])
    g = teg.compile(teg.integral(teg.nearest(teg.where(k < 1, y, x), -bid, (k, 0, 2), where=bid > r, otherwise=0.0), (x, 0, 1), (y, 0, 1)))
    least = teg.compile(teg.integral(low, (x, 0, 1), (y, 0, 1)), [A])
    for reserve in (0.1, 0.5, 0.8):
        value, slope = f.value_and_grad(r=reserve, A=bids)
        assert float(value) == pytest.approx(1 - reserve**2, abs=1e-12)
        assert float(slope["r"]) == pytest.approx(-2 * reserve, abs=1e-12)
        other = g.value_and_grad(r=reserve, A=bids)  # the other's value, where the winner's is above the reserve
        assert float(other[0]) == pytest.approx(1 / 3 - reserve**3 / 3, abs=1e-12)
        assert float(other[1]["r"]) == pytest.approx(-(reserve**2), abs=1e-12)
    assert float(least(A=bids)) == pytest.approx(1 / 3, abs=1e-13)
    np.testing.assert_allclose(least.grad(A=bids)["A"], [[1 / 6, 1 / 3], [1 / 3, 1 / 6]], atol=1e-12)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_one_variable(backend: str) -> None:
    k, x = teg.index("k"), teg.var("x")
    A, B = teg.array("A"), teg.array("B")
    f = teg.compile(teg.integral(teg.maximum_of(A[k] * x + B[k], (k, 0, teg.length(A))) ** 3, (x, 0, 2)), backend=backend)
    rng = np.random.default_rng(3)
    given = {"A": rng.normal(size=6), "B": rng.normal(size=6)}

    def reference(v: dict[str, Any]) -> float:
        a, b = v["A"], v["B"]
        cuts = [(b[j] - b[i]) / (a[i] - a[j]) for i, j in combinations(range(6), 2)]
        ends = np.unique([0.0, 2.0, *(c for c in cuts if 0 < c < 2)])
        middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * (ends[1:] - ends[:-1])
        at = middle[:, None] + half[:, None] * NODES
        return float((((a * at[..., None] + b).max(axis=-1) ** 3) * half[:, None] * WEIGHTS).sum())

    assert float(f(**given)) == pytest.approx(reference(given), rel=1e-12)
    check_gradient(f, reference, given, 0, "AB", h=1e-3)


def test_the_text_does_not_grow_with_the_candidates() -> None:
    f = teg.compile(mesh_program(), backend="c")
    before = f.source
    for count in (1, 10, 200):
        f(**random_mesh(count, count))
    assert f.source == before
    own = before[before.index("TEG_INLINE void run_1(") :]  # behind the runtime, which is the same for all programs with choices
    assert len(own.splitlines()) < 500


def test_plain_automatic_differentiation_leaves_the_regions_where_they_are() -> None:
    f = teg.compile(mesh_program(), discontinuities="ignore")
    given = random_mesh(7, 3)
    gradient, right = f.grad(**given), teg.compile(mesh_program()).grad(**given)
    assert np.abs(gradient["D"]).max() == 0.0
    assert np.abs(right["P"] - gradient["P"]).max() > 1e-3
    np.testing.assert_allclose(gradient["C"], right["C"], atol=1e-14)
    product = f.hvp(given, {"P": given["P"], "C": given["C"]})
    assert np.abs(product["D"]).max() == 0.0


def test_the_interpreter_says_the_same() -> None:
    f = teg.compile(mesh_program())
    given = random_mesh(2, 3)
    program = f.program(1)
    arrays = [given[a.name] for a in program.arrays]
    value, *slopes = interpret_arrays(program, [], arrays).outputs
    expected, gradient = f.value_and_grad(**given)
    assert value == pytest.approx(float(expected), abs=1e-14)
    for name, entries in zip(gradient, slopes, strict=True):
        assert entries == pytest.approx({i: gradient[name][i] for i in entries}, abs=1e-12), name
    assert program.outputs[0] == verified_arrays(program, "test").outputs[0]


def test_missing_numbers_say_so() -> None:
    f = teg.compile(mesh_program())
    given = random_mesh(1, 2)
    given["C"][0] = np.nan
    given["P"][:3] += 10.0  # outside of the box: its colour does not matter
    assert np.isfinite(f(**given))
    given = random_mesh(1, 2)
    given["D"][:] = np.inf
    with pytest.warns(teg.AccuracyWarning):
        f(**given)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_a_candidate_that_is_absent_may_hold_anything(backend: str) -> None:
    k, x, y = teg.index("k"), *teg.vars("x y")
    A = teg.array("A")
    slope = 1 / A[k]
    e = teg.integral(
        teg.nearest(A[k], slope * x, (k, 0, teg.length(A)), where=(A[k] > 0) & (slope * x < y + 1), otherwise=0), (x, 0, 1), (y, 0, 1)
    )
    f = teg.compile(e, backend=backend)
    value, gradient = f.value_and_grad(A=[0.0, 2.0])
    assert float(value) == pytest.approx(2.0, abs=1e-12)
    np.testing.assert_allclose(gradient["A"], [0.0, 1.0], atol=1e-12)


def test_pixels_that_nothing_cuts() -> None:
    """NumPy computes these together, C leaves the cells of the owner of the box out: both give what the plain routine gives."""
    program = mesh_program(10)
    f, g = (teg.compile(program, backend=backend) for backend in ("c", "numpy"))
    for seed, count in ((1, 2), (2, 4), (3, 0)):
        given = random_mesh(seed, count)
        (one, first), (two, second) = f.value_and_grad(**given), g.value_and_grad(**given)
        flat = f.program(1)
        three, *_ = interpret_arrays(flat, [], [given[a.name] for a in flat.arrays]).outputs
        assert float(one) == pytest.approx(float(two), rel=1e-13)
        assert float(one) == pytest.approx(float(three), rel=1e-13)
        direction = {name: np.cos(np.arange(given[name].size)).reshape(given[name].shape) for name in "PDCB"}
        products = f.hvp(given, direction), g.hvp(given, direction)
        for name in "PDCB":
            np.testing.assert_allclose(first[name], second[name], atol=1e-12)
            np.testing.assert_allclose(products[0][name], products[1][name], atol=1e-9)


TWO_ON_A_LINE = {
    "P": np.array([[0.25, 0.25], [0.25, 0.0], [0.5, 0.25], [0.25, 0.25], [0.25, 0.75], [0.0, 0.25]]),
    "D": np.array([0.3, 0.3, 0.3, 0.2, 0.2, 0.2]),
    "C": np.array([[2.0, 2.0, 2.0], [5.0, 5.0, 5.0]]),
    "B": np.array([0.0, 1.0, 0.0, 1.0, 0.3]),
}
"""Two triangles on both sides of u = 1/4 that share a corner only: an edge of each lies on that line."""


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_edges_of_different_triangles_on_one_line(backend: str) -> None:
    """The derivative by the first triangle's edge does not depend on the corner that the second one begins with."""
    f = teg.compile(mesh_program(), backend=backend)
    for second in ([3, 4, 5], [5, 3, 4]):
        gradient = f.grad(**TWO_ON_A_LINE, F=np.array([[0, 1, 2], second]))
        assert gradient["P"][0:2, 0].sum() == pytest.approx(-0.2125, abs=1e-12)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_regular_grids(backend: str) -> None:
    """All edges lie on few lines; triangles begin with any corner and turn either way. Against differences in a random direction."""
    f = teg.compile(mesh_program(), backend=backend)
    rng = np.random.default_rng(5)
    for count in (3, 4):
        places = np.linspace(-0.2, 1.2, count)
        points = np.stack([axis.ravel() for axis in np.meshgrid(places, places)], axis=1)
        corners = [(i * count + j) for i in range(count - 1) for j in range(count - 1)]
        faces = [face for k in corners for face in ((k, k + 1, k + count + 1), (k, k + count + 1, k + count))]
        some = [list(np.roll(face, rng.integers(3)))[:: rng.choice([1, -1])] for face in faces if count == 3 or rng.random() < 0.7]
        given = {
            "P": points,
            "D": rng.uniform(0.1, 1.0, len(points)),
            "C": rng.uniform(0.0, 5.0, (len(some), 3)),
            "F": np.array(some),
            "B": TWO_ON_A_LINE["B"],
        }
        direction, step = rng.normal(size=points.shape), 1e-6
        beside = [float(f(**{**given, "P": points + sign * step * direction})) for sign in (1.0, -1.0)]
        assert (f.grad(**given)["P"] * direction).sum() == pytest.approx((beside[0] - beside[1]) / (2.0 * step), abs=1e-5)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_second_derivatives_where_two_edges_on_one_line_meet_at_a_side(backend: str) -> None:
    """A corner on a side of the box leaves edges as short as the step from that side: what rounding makes of their parts does not count."""
    corners = [[0.5, 1.0], [1.0, 1.0], [1.5, -0.5], [1.0, -0.5], [0.0, 1.5], [0.5, 1.0]]
    corners += [[1.0, 0.0], [1.0, -0.5], [1.5, 1.5], [0.5, -0.5], [0.0, 1.5], [1.5, 0.0]]
    given = {
        "P": np.array(corners),
        "D": np.repeat([0.50546274, 0.52678345, 0.00753684, 0.54986085], 3),
        "C": np.random.default_rng(0).uniform(size=(4, 3)),
        "F": np.arange(12).reshape(4, 3),
        "B": TWO_ON_A_LINE["B"],
    }
    product = teg.compile(mesh_program(), backend=backend).hvp(given, {"P": np.sin(np.arange(24.0)).reshape(12, 2)})
    assert np.isfinite(product["P"]).all()


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("faces", [[[0, 1, 2], [2, 0, 1]], [[2, 0, 1], [0, 1, 2]], [[0, 1, 2], [0, 1, 3]], [[0, 1, 3], [0, 1, 2]]])
def test_a_triangle_behind_another_one_with_the_same_edge(backend: str, faces: list[list[int]]) -> None:
    """The same triangle twice, or one inside of another one: the edge in front may be found as that of the one that nobody sees."""
    points, depths = np.array([[0.5, 0.9], [0.5, 0.1], [0.1, 0.4], [0.3, 0.5]]), np.array([0.6, 0.4, 0.2, 0.9])
    given = {"P": points, "D": depths, "C": np.array([[1.0, 2.0, 0.5], [3.0, 0.2, 1.0]]), "F": np.array(faces), "B": TWO_ON_A_LINE["B"]}
    front = given if [0, 1, 3] not in faces else {**given, "F": np.array([[0, 1, 2]]), "C": given["C"][[faces.index([0, 1, 2])]]}
    first = {**front, "F": front["F"][:1], "C": front["C"][:1]}
    gradient, expected = (teg.compile(mesh_program(), backend=backend).grad(**v) for v in (given, first))
    np.testing.assert_allclose(gradient["P"], expected["P"], atol=1e-12)
    np.testing.assert_allclose(gradient["D"], expected["D"], atol=1e-12)


LAYERS = {
    "P": np.array([[0.1, 0.405], [0.68, 0.405], [0.9, 0.405], [0.5, 0.9], [0.15, 0.405], [0.8, 0.405], [0.5, 0.65]]),
    "D": np.array([0.2, 0.2, 0.2, 0.2, 0.8, 0.8, 0.8]),
    "C": np.array([[1.0] * 3, [2.0] * 3, [5.0] * 3]),
    "F": np.array([[3, 0, 1], [3, 1, 2], [6, 4, 5]]),
    "B": TWO_ON_A_LINE["B"],
}
"""Two triangles side by side above a line, and a third one behind them, hidden, with an edge on that line."""


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_where_edges_of_layers_lie_on_each_other_the_nearest_counts(backend: str) -> None:
    f = teg.compile(mesh_program(), backend=backend)
    expected = f.grad(**{**LAYERS, "F": LAYERS["F"][:2], "C": LAYERS["C"][:2]})
    for order in ([0, 1, 2], [2, 0, 1], [2, 1, 0], [1, 2, 0]):
        gradient = f.grad(**{**LAYERS, "F": LAYERS["F"][order], "C": LAYERS["C"][order]})
        np.testing.assert_allclose(gradient["P"], expected["P"], atol=1e-12)
