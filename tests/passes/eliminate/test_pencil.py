"""Conics whose coefficients are data, followed along their edges: against arcs of NumPy, closed forms, slices and differences."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import teg
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, t, x, y
from tests.references import hyperbolas
from tests.references.ellipses import integral_over_union, random_ellipses, slopes, slopes_of_union
from tests.references.hyperbolas import crossing_rows, random_rows, slope_of_union

U, V = x - D[k, 0], y - D[k, 1]
A, B, C = (D[k, i] for i in (2, 3, 4))
Q = A * U**2 + B * U * V + C * V**2
AREA = teg.bracket(teg.any(Q < 1, ALL))
ROOT = (np.sqrt(5.0) - 1) / 2


def weight(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 1 + u * v


def primitive(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u + 0.5 * u * u * v


WRITTEN: dict[str, teg.Cond] = {
    "about the middle": Q < 1,
    "with other signs": -2 * Q > -2,
    "turned": A * (D[k, 0] - x) ** 2 + B * (D[k, 0] - x) * (D[k, 1] - y) + C * (D[k, 1] - y) ** 2 < 1,
    "expanded": A * x**2 + B * x * y + C * y**2 - (2 * A * D[k, 0] + B * D[k, 1]) * x - (2 * C * D[k, 1] + B * D[k, 0]) * y
    < 1 - (A * D[k, 0] ** 2 + B * D[k, 0] * D[k, 1] + C * D[k, 1] ** 2),
    "by sum and difference": A * U**2 + 0.25 * B * ((U + V) ** 2 - (U - V) ** 2) + C * V**2 < 1,
}


@pytest.mark.parametrize(("name", "backend"), [*((name, "c") for name in WRITTEN), ("about the middle", "numpy"), ("expanded", "numpy")])
def test_however_they_are_written(name: str, backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(teg.any(WRITTEN[name], ALL)) * (1 + x * y), *BOX), [D], backend=backend)
    assert follows_edges(f)
    for n in (0, 1, 9):
        rows = random_ellipses(n, seed=n)
        value, gradient = f.value_and_grad(D=rows)
        assert value == pytest.approx(integral_over_union(rows, weight, primitive), abs=1e-11)
        assert gradient["D"] == pytest.approx(slopes_of_union(rows, weight), abs=1e-10)


@pytest.mark.parametrize("kernel", ["c", "xla"])
def test_in_jax(x64_for_jax: Any, kernel: str) -> None:
    import jax

    f = teg.jax_function(teg.integral(AREA, *BOX), [D], kernel=kernel)
    rows = random_ellipses(4, seed=5)
    value, gradient = jax.value_and_grad(lambda d: f(D=d))(rows)
    assert value == pytest.approx(integral_over_union(rows, lambda u, v: 1 + 0 * u, lambda u, v: u), abs=1e-11)
    assert np.asarray(gradient) == pytest.approx(slopes_of_union(rows, lambda u, v: 1 + 0 * u), abs=1e-10)


def test_splats_with_depths() -> None:
    """Painted from the nearest to the farthest: an edge counts by the colour inside of it less the one behind."""
    depths, colours = np.array([3.0, 1.0, 2.0, 5.0, 4.0]), np.array([0.3, 0.8, -0.4, 0.1, 1.2])
    rows = random_ellipses(5, seed=2)
    shade = teg.nearest(D[k, 6], D[k, 5], ALL, where=Q < 1, otherwise=0.25)
    f = teg.compile(teg.integral(shade, *BOX), [D])
    gradient = f.grad(D=np.c_[rows, depths, colours])["D"]

    def step(j: int, u: float, v: float) -> float:
        p, q = u - rows[:, 0], v - rows[:, 1]
        there = rows[:, 2] * p * p + rows[:, 3] * p * q + rows[:, 4] * q * q < 1
        there[j] = False
        if (there & (depths < depths[j])).any():
            return 0.0
        behind = colours[np.where(there, depths, np.inf).argmin()] if there.any() else 0.25
        return float(colours[j] - behind)

    assert gradient[:, :5] == pytest.approx(slopes(rows, lambda u, v: 1 + 0 * u, step), abs=1e-10)
    assert gradient[:, 5] == pytest.approx(np.zeros(5), abs=1e-12)


def test_products_with_the_hessian() -> None:
    rows, moved = random_ellipses(6, seed=3), np.random.default_rng(0).normal(size=(6, 5)) * [0.1, 0.1, 1.0, 1.0, 1.0]
    f = teg.compile(teg.integral(AREA * (1 + x * y), *BOX), [D], backend="c")
    assert follows_edges(f, 2)
    h = 1e-3
    around = [slopes_of_union(rows + s * h * moved, weight) - slopes_of_union(rows - s * h * moved, weight) for s in (1, 2, 3)]
    expected = (45 * around[0] - 9 * around[1] + around[2]) / (60 * h)
    assert f.hvp({"D": rows}, {"D": moved})["D"] == pytest.approx(expected, abs=1e-8)


FORM = D[k, 0] * x * x + D[k, 1] * x * y + D[k, 2] * y * y + D[k, 3] * x + D[k, 4] * y + D[k, 5]
KINDS: dict[str, tuple[list[float], float, dict[int, float]]] = {
    "hyperbola": ([0.0, -1.0, 0.0, 0.0, 0.0, 0.3], 0.3 - 0.3 * np.log(0.3), {5: -np.log(0.3), 1: -0.3 * np.log(0.3)}),
    "hyperbola with both branches": (
        [1.0, 0.0, -1.0, -1.0, 1.0, -0.0625],
        np.sqrt(3.0) / 4 - np.arccosh(2.0) / 8,
        {5: 2 * np.arccosh(2.0)},
    ),
    "parabola": ([-0.5, 0.0, 0.0, 0.0, 1.0, 0.0], 1 - 0.5 / 3, {0: 1 / 3, 5: 1.0, 4: 0.5 / 3}),
    "parabola that leans": ([-1.0, 2.0, -1.0, 0.0, 1.0, 0.0], ROOT**4 / 2 + 2 * ROOT**3 / 3 + 1 - ROOT**2, {}),
    "strip": ([-1.0, 0.0, 0.0, 1.0, 0.0, 0.04 - 0.25], 0.4, {5: 5.0, 3: 2.5}),
    "strip that leans": ([-1.0, -2.0, -1.0, 2.0, 2.0, 0.04 - 1.0], 0.36, {5: 0.8 / 0.4 * 2}),
    "outside of a disk": ([1.0, 0.0, 1.0, -1.0, -1.0, 0.5 - 0.09], 1 - 0.09 * np.pi, {5: np.pi}),
    "half-plane": ([0.0, 0.0, 0.0, 1.0, 1.0, -1.0], 0.5, {5: 1.0, 3: 0.5, 4: 0.5}),
    "line and line": ([0.0, 1.0, 0.0, -0.6, -0.3, 0.18], 0.46, {}),
    "nothing": ([0.0] * 6, 0.0, dict.fromkeys(range(6), 0.0)),
    "everything": ([0.0] * 5 + [1.0], 1.0, dict.fromkeys(range(6), 0.0)),
}


@pytest.mark.parametrize("backend", BACKENDS)
def test_conics_of_every_kind(backend: str) -> None:
    """One program for all of them. A hyperbola x·y < t has the area t - t·log t; where two lines cross, derivatives are infinite."""
    f = teg.compile(teg.integral(teg.bracket(teg.any(FORM > 0, ALL)), *BOX), [D], backend=backend)
    assert follows_edges(f)
    for name, (row, area, slopes_of_row) in KINDS.items():
        assert f(D=[row]) == pytest.approx(area, abs=1e-12), name
        assert f(D=[[-e for e in row]]) == pytest.approx(0.0 if name == "nothing" else 1 - area, abs=1e-12), name
        if slopes_of_row:
            gradient = f.grad(D=[row])["D"][0]
            assert [gradient[i] for i in slopes_of_row] == pytest.approx(list(slopes_of_row.values()), abs=1e-10), name
    cross, disk = [0.0, 1.0, 0.0, -0.5, -0.5, 0.25], [-1.0, 0.0, -1.0, 1.0, 1.0, 0.1 - 0.5]
    assert f.grad(D=[cross])["D"].tolist() == [[np.inf] * 6]
    assert f.grad(D=[cross, disk])["D"][0, 5] == pytest.approx(2 * np.log(2.5))  # the disk hides where the lines cross
    corner, disk = [0.0, -1.0, 0.0, 0.0, 0.0, 0.01], [-1.0, 0.0, -1.0, 1.4, 1.4, 0.04 - 0.98]
    both = 0.01 - 0.01 * np.log(0.01) + 0.04 * np.pi
    assert f(D=[corner, KINDS["nothing"][0], disk]) == pytest.approx(both, abs=1e-12)


SIDED = D[k, 3] * (U * V - D[k, 2]) > 0
SIDED_MEAN = teg.integral(teg.bracket(teg.any(SIDED, ALL)) * (1 + x * y), *BOX)


@pytest.mark.parametrize("backend", BACKENDS)
def test_hyperbolas_with_axes_along_the_box(backend: str) -> None:
    f = teg.compile(SIDED_MEAN, [D], backend=backend)
    assert follows_edges(f)
    for n in (1, 2, 4):
        rows, direction = random_rows(n, n), np.random.default_rng(n).normal(size=(n, 4)) * [1, 1, 1, 0]
        value, gradient = f.value_and_grad(D=rows)
        assert value == pytest.approx(hyperbolas.integral_over_union(rows), abs=1e-11)
        assert (gradient["D"] * direction).sum() == pytest.approx(slope_of_union(rows, direction), abs=1e-8)


@pytest.mark.filterwarnings("ignore:the derivative by D.*, 2. does not converge")
@pytest.mark.parametrize("backend", BACKENDS)
def test_lines_that_cross(backend: str) -> None:
    """A hyperbola whose level is 0: derivatives by its middle are finite, that by the level is infinite where the crossing is seen."""
    f = teg.compile(SIDED_MEAN, [D], backend=backend)
    for seed in range(8):
        rows = crossing_rows(1 + seed % 3, seed)
        direction = np.random.default_rng(seed).normal(size=rows.shape) * [1, 1, 0, 0]
        value, gradient = f.value_and_grad(D=rows)
        assert value == pytest.approx(hyperbolas.integral_over_union(rows), abs=1e-13)
        assert (gradient["D"][:, :2] * direction[:, :2]).sum() == pytest.approx(slope_of_union(rows, direction), abs=1e-8)
        assert len(rows) > 1 or gradient["D"][0, 2] == -rows[0, 3] * np.inf


@pytest.mark.filterwarnings("ignore:the derivative by D.*, 2. does not converge")
def test_lines_on_the_sides_of_the_box() -> None:
    """The mean of moving such a line inwards and outwards: half of the strip's."""
    f = teg.compile(teg.integral(teg.bracket(teg.any(SIDED, ALL)), *BOX), [D])
    for a in (0.0, 1.0):
        for b in (-0.2, 0.4, 1.0):
            inside = min(max(b, 0.0), 1.0)
            value, gradient = f.value_and_grad(D=[[a, b, 0.0, 1.0]])
            assert value == pytest.approx(a * inside + (1 - a) * (1 - inside), abs=1e-13)
            assert gradient["D"][0, 0] == pytest.approx(0.5 * (2 * inside - 1), abs=1e-12)


def double_lines(number: int, seed: int) -> np.ndarray:
    """Returns rows of (p·x + q·y - r)², lines through the box, with the rounding of each coefficient."""
    generator = np.random.default_rng(seed)
    p, q = generator.normal(size=(2, number))
    p[::4], q[::4] = 1.0, -1.0
    r = p * generator.uniform(0.2, 0.8, number) + q * generator.uniform(0.2, 0.8, number)
    return np.stack([p * p, 2 * p * q, q * q, -2 * p * r, -2 * q * r, r * r], axis=1)


def points(number: int, seed: int) -> np.ndarray:
    """Returns rows of definite forms about points of the box."""
    m, n, a, b, c = random_ellipses(number, seed).T
    return np.stack([a, b, c, -2 * a * m - b * n, -2 * c * n - b * m, a * m * m + b * m * n + c * n * n], axis=1)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("number", range(5))
@pytest.mark.parametrize("rows", [double_lines, points])
def test_curves_that_are_double_lines_or_points(rows: Any, number: int, backend: str) -> None:
    """Where the square of a line is positive is everything, where it is negative nothing; a call that finds no number says so."""
    disk, area = [-1.0, 0.0, -1.0, 0.9, 1.1, 0.09 - 0.505], 0.09 * np.pi
    union = teg.compile(teg.integral(teg.bracket(teg.any(FORM > 0, ALL)), *BOX), [D], backend=backend)
    row = rows(5, seed=1)[number]
    for scene, expected in (([-row, disk], area), ([disk, -row], area), ([row, disk], 1.0), ([row], 1.0), ([-row], 0.0)):
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always", teg.AccuracyWarning)
            value = union(D=scene)
        assert warned or value == pytest.approx(expected, abs=1e-9)
        assert not warned or (rows, number) == (double_lines, 1)  # the only line that rounding makes a strip


@pytest.mark.parametrize("backend", BACKENDS)
def test_bounds_with_parameters(backend: str) -> None:
    """Of bounds it is not known which is the lower one: reversed, they change the sign."""
    f = teg.compile(teg.integral(teg.bracket(teg.any(FORM > 0, ALL)), (x, t, 1), (y, 0, 1 - t)), [D, t], backend=backend)
    assert follows_edges(f)
    for name, (row, area, slopes_of_row) in KINDS.items():
        assert f(D=[row], t=0.0) == pytest.approx(area, abs=2e-11 if name == "line and line" else 1e-12), name
        gradient = f.grad(D=[row], t=0.0)["D"][0] if slopes_of_row else {}
        assert [gradient[i] for i in slopes_of_row] == pytest.approx(list(slopes_of_row.values()), abs=1e-10), name
    row = KINDS["hyperbola"][0]  # below x·y < 0.3 in (t, 1)×(0, 1 - t)
    for at in (0.1, 0.2):
        corner = 0.3 / (1 - at)
        inside = (corner - at) * (1 - at) + 0.3 * np.log(1 / corner)
        assert f(D=[row], t=at) == pytest.approx(inside, abs=1e-12)
    reversed_ = teg.compile(teg.integral(teg.bracket(teg.any(FORM > 0, ALL)), (x, 1, t), (y, 0, 1 - t)), [D, t], backend=backend)
    assert reversed_(D=[row], t=0.1) == pytest.approx(-f(D=[row], t=0.1), abs=1e-12)


def by_slices(rows: np.ndarray) -> float:
    """The mean value of the site of least A·u² + B·u·v + C·v²: exact along x, at Gauss nodes of many strips along y."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    total = 0.0
    for low in np.arange(400) / 400:
        for height, weight in zip(low + (nodes + 1) / 800, weights / 800, strict=True):
            u, (a, b, c), v = rows[:, 3], rows[:, :3].T, height - rows[:, 4]
            keys = np.stack([a, b * v - 2 * a * u, a * u * u - b * u * v + c * v * v], axis=1)
            differences = (keys[i] - keys[j] for i in range(len(rows)) for j in range(i))
            roots = [r.real for p in differences for r in np.roots(p) if abs(r.imag) < 1e-12 and 0 < r.real < 1]
            ends = np.unique([0.0, 1.0, *roots])
            middle = 0.5 * (ends[1:] + ends[:-1])
            winner = (keys @ np.stack([middle**2, middle, np.ones_like(middle)])).argmin(axis=0)
            total += weight * float(np.diff(ends) @ rows[winner, 5])
    return total


OWN = D[k, 0] * (x - D[k, 3]) ** 2 + D[k, 1] * (x - D[k, 3]) * (y - D[k, 4]) + D[k, 2] * (y - D[k, 4]) ** 2
WINNER = teg.integral(teg.nearest(D[k, 5], OWN, ALL), *BOX)


def random_metrics(n: int, seed: int) -> np.ndarray:
    """Rows (A, B, C, x, y, value) of sites with definite matrices."""
    rng = np.random.default_rng(seed)
    a, c = rng.uniform(0.5, 3.0, (2, n))
    return np.c_[a, rng.uniform(-1.8, 1.8, n) * np.sqrt(a * c), c, rng.uniform(0.0, 1.0, (n, 2)), rng.normal(size=n)]


@pytest.mark.parametrize("backend", BACKENDS)
def test_sites_with_their_own_metric(backend: str) -> None:
    """Their borders are ellipses and hyperbolas. Values beside slices, derivatives beside differences of the value."""
    f = teg.compile(WINNER, [D], backend=backend)
    assert follows_edges(f)
    for n in (2, 5):
        rows, moved = random_metrics(n, seed=n), np.random.default_rng(n).normal(size=(n, 6))
        assert f(D=rows) == pytest.approx(by_slices(rows), abs=3e-6)
        h = 2e-5
        around = [f(D=rows + s * h * moved) - f(D=rows - s * h * moved) for s in (1, 2, 3)]
        expected = (45 * around[0] - 9 * around[1] + around[2]) / (60 * h)
        assert (f.grad(D=rows)["D"] * moved).sum() == pytest.approx(expected, abs=1e-6)


def test_symmetric_sites() -> None:
    """Their borders are two lines that cross."""
    f = teg.compile(WINNER, [D])
    mirrored = [[1.0, 0.5, 4.0, 0.2, 0.4, 1.0], [4.0, 0.5, 1.0, 0.4, 0.2, -3.0]]
    assert f(D=mirrored) == pytest.approx(-1.0, abs=1e-12)
    concentric = [[1.0, 0.0, 4.0, 0.5, 0.5, 1.0], [4.0, 0.0, 1.0, 0.5, 0.5, -3.0]]
    value, gradient = f.value_and_grad(D=concentric)
    assert value == pytest.approx(-1.0, abs=1e-12)
    assert gradient["D"] == pytest.approx(np.array([[-1.0, 0.0, -1.0, 0.0, 0.0, 1.5], [1.0, 0.0, 1.0, 0.0, 0.0, 1.5]]) / 3, abs=1e-12)


def test_second_derivatives_of_metrics() -> None:
    """All sites move along y, and all metrics lean more."""
    u, v = x - D[k, 3], y - D[k, 4] - t
    key = D[k, 0] * u**2 + (1 + t) * D[k, 1] * u * v + D[k, 2] * v**2
    f = teg.compile(teg.integral(teg.nearest(D[k, 5], key, ALL), *BOX), [t])
    assert follows_edges(f, 2)
    rows, h = random_metrics(3, seed=5), 1e-3
    around = [f.grad(D=rows, t=s * h)["t"] - f.grad(D=rows, t=-s * h)["t"] for s in (1, 2, 3)]
    expected = (45 * around[0] - 9 * around[1] + around[2]) / (60 * h)
    assert f.hvp({"D": rows, "t": 0.0}, {"t": 1.0})["t"] == pytest.approx(expected, abs=1e-7)


def test_products_with_the_hessian_of_metrics() -> None:
    f = teg.compile(WINNER, [D], backend="c")
    assert follows_edges(f, 2)
    rows, moved = random_metrics(3, seed=5), np.random.default_rng(5).normal(size=(3, 6))
    h = 1e-4
    around = [f.grad(D=rows + s * h * moved)["D"] - f.grad(D=rows - s * h * moved)["D"] for s in (1, 2, 3)]
    expected = (45 * around[0] - 9 * around[1] + around[2]) / (60 * h)
    assert f.hvp({"D": rows}, {"D": moved})["D"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("aspect", [30.0, 300.0])
def test_thin_ones(aspect: float) -> None:
    f = teg.compile(teg.integral(AREA * (1 + x * y), *BOX), [D])
    rows = random_ellipses(6, seed=9, aspect=aspect)
    value, gradient = f.value_and_grad(D=rows)
    assert value == pytest.approx(integral_over_union(rows, weight, primitive), abs=1e-12)
    assert gradient["D"] == pytest.approx(slopes_of_union(rows, weight), abs=1e-10)


def test_far_from_the_origin() -> None:
    """Written about their middles, ellipses keep their digits wherever the box is."""
    far = teg.integral(AREA, (x, t, t + 1), (y, t, t + 1))
    f = teg.compile(far, [D])
    rows = random_ellipses(5, seed=4)
    moved = rows.copy()
    moved[:, :2] += 65536.0
    rows[:, :2] = moved[:, :2] - 65536.0
    value, gradient = f.value_and_grad(D=moved, t=65536.0)
    assert value == pytest.approx(integral_over_union(rows, lambda u, v: 1 + 0 * u, lambda u, v: u), abs=1e-10)
    assert gradient["D"] == pytest.approx(slopes_of_union(rows, lambda u, v: 1 + 0 * u), abs=1e-9)
