"""`teg.any` of smooth regions, followed along edges: against slices and arcs of NumPy, closed forms, and the same written by hand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg.evaluator import derivation
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, p, t, x, y
from tests.references.disks import integral_over_union, slopes_of_union


def in_disk(row: Callable[[int], Any]) -> teg.Cond:
    return (x - row(0)) ** 2 + (y - row(1)) ** 2 < row(2) ** 2


def any_of(condition: Callable[[Callable[[int], Any]], teg.Cond]) -> teg.Cond:
    return teg.any(condition(lambda i: D[k, i]), ALL)


def by_hand(condition: Callable[[Callable[[int], Any]], teg.Cond], rows: int) -> teg.Cond:
    found = condition(lambda i: D[0, i])
    for j in range(1, rows):
        found = found | condition(lambda i, j=j: D[j, i])  # type: ignore[misc]
    return found


def some(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(-0.2, 1.2, (n, 2)), rng.uniform(0.1, 1.2, n) / np.sqrt(max(n, 1))]


AREA = teg.bracket(any_of(in_disk))


@pytest.mark.parametrize("backend", BACKENDS)
def test_any_number_of_disks(backend: str) -> None:
    """One program for all numbers of disks, none of them included."""
    f = teg.compile(teg.integral(AREA * teg.exp(x * y), *BOX), [D], backend=backend)
    assert follows_edges(f)
    for n in (0, 1, 2, 7, 40):
        disks = some(n, seed=n)
        value, slopes = f.value_and_grad(D=disks)
        assert value == pytest.approx(integral_over_union(disks, lambda u, v: np.exp(u * v)), abs=1e-10)
        assert slopes["D"] == pytest.approx(slopes_of_union(disks, lambda u, v: np.exp(u * v)), abs=1e-12)


@pytest.mark.parametrize("kernel", ["c", "xla"])
def test_a_union_in_jax(x64_for_jax: Any, kernel: str) -> None:
    import jax

    f = teg.jax_function(teg.integral(AREA, *BOX), [D], kernel=kernel)
    disks = some(3, seed=3)
    value, slopes = jax.jit(jax.value_and_grad(lambda d: f(D=d)))(disks)
    assert value == pytest.approx(integral_over_union(disks, lambda u, v: 1 + 0 * u), abs=1e-10)
    assert np.asarray(slopes) == pytest.approx(slopes_of_union(disks, lambda u, v: 1 + 0 * u), abs=1e-12)


def test_each_cell_is_derived_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether edges can be followed is found by the derivation that values, gradients and estimates of all backends share."""
    cells: Counter[object] = Counter()
    derive = derivation.compiled_outputs

    def counted(cell: teg.Expr, wrt: Any, *others: Any, **options: Any) -> list[teg.Expr]:
        cells[cell, tuple(wrt)] += 1
        return derive(cell, wrt, *others, **options)

    monkeypatch.setattr(derivation, "compiled_outputs", counted)
    programs = [teg.compile(teg.integral(AREA * teg.exp(x + y), *BOX), [D], backend=backend) for backend in BACKENDS]
    for f in programs:
        assert follows_edges(f)
        f.program(1)
        f.program(1, errors=True)
    assert set(cells.values()) == {1}


def test_the_program_is_as_long_for_many() -> None:
    f = teg.compile(teg.integral(AREA, *BOX), [D])
    many = some(80, seed=1)
    f.value_and_grad(D=many[:2])
    before = f.source
    value, slopes = f.value_and_grad(D=many)
    assert f.source == before
    assert value == pytest.approx(integral_over_union(many, lambda u, v: 1 + 0 * u), abs=1e-9)
    assert slopes["D"][:, 2].sum() == pytest.approx(slopes_of_union(many, lambda u, v: 1 + 0 * u)[:, 2].sum(), abs=1e-10)


MIDDLES = np.array([[0.35, 0.4, 0.25], [0.6, 0.55, 0.3]])
SHAPES: dict[str, tuple[Callable[..., teg.Cond], Callable[[teg.Cond], Any]]] = {
    "half disks": (lambda r: in_disk(r) & (x + y * r(0) < r(1) + r(0)), teg.bracket),
    "ellipses": (lambda r: (x - r(0)) ** 2 + 3 * (y - r(1)) ** 2 + (x - r(0)) * (y - r(1)) < r(2) ** 2, teg.bracket),
    "ellipses by their axes": (lambda r: ((x - r(0)) / r(2)) ** 2 + ((y - r(1)) / (r(0) - 0.2)) ** 2 < 1, teg.bracket),
    "moved by a parameter": (lambda r: (x - r(0) - t) ** 2 + (y - r(1) * t) ** 2 < r(2) ** 2, teg.bracket),
    "outside": (lambda r: ~in_disk(r), teg.bracket),
    "of no disk": (in_disk, lambda c: teg.bracket(~c) * y),
    "disks and bands": (lambda r: in_disk(r) | (abs(y - r(0)) < 0.05), teg.bracket),
    "two values": (in_disk, lambda c: teg.where(c, x * y, t * teg.sin(x))),
    "a body that moves": (in_disk, lambda c: teg.bracket(c) * teg.exp(t * x + y)),
    "beside a line": (in_disk, lambda c: teg.bracket(c & (x + y < t + 0.8))),
}


@pytest.mark.parametrize("name", SHAPES)
def test_as_written_by_hand(name: str) -> None:
    condition, integrand = SHAPES[name]
    results = []
    for covered in (any_of(condition), by_hand(condition, len(MIDDLES))):
        f = teg.compile(teg.integral(integrand(covered), *BOX), [D, t])
        assert follows_edges(f) == (not results)
        value, slopes = f.value_and_grad(D=MIDDLES, t=0.3)
        results.append(np.r_[value, slopes["t"], slopes["D"].ravel()])
    assert results[0] == pytest.approx(results[1], abs=1e-11)


DISK = [0.5, 0.5, 0.3]
ROUND, ASLANT = 2 * np.pi * 0.3, 0.3 + 0.4 * np.sqrt(0.5)
TIES: dict[str, tuple[list[list[float]], float, list[float]]] = {  # disks, their area, derivatives by the radii
    "twice": ([DISK, DISK], np.pi * 0.09, [ROUND, 0.0]),
    "three times": ([DISK] * 3, np.pi * 0.09, [ROUND, 0.0, 0.0]),
    "inside": ([DISK, [0.5, 0.5, 0.1]], np.pi * 0.09, [ROUND, 0.0]),
    "touching from inside": ([[0.6, 0.5, 0.2], DISK], np.pi * 0.09, [0.0, ROUND]),
    "touching": ([[0.3, 0.5, 0.2], [0.7, 0.5, 0.2]], 2 * np.pi * 0.04, [0.4 * np.pi] * 2),
    "touching aslant": ([[0.3, 0.3, 0.25], [ASLANT, ASLANT, 0.15]], np.pi * 0.085, [0.5 * np.pi, 0.3 * np.pi]),
    "touching a side": ([[0.3, 0.5, 0.3]], np.pi * 0.09, [ROUND]),
    "touching the far side": ([[0.7, 0.5, 0.3]], np.pi * 0.09, [ROUND]),
    "touching all sides": ([[0.5, 0.5, 0.5]], np.pi * 0.25, [np.pi]),
    "touching the far side, less a rounding": ([[0.7 + 1e-15, 0.5, 0.3]], np.pi * 0.09, [ROUND]),
    "around a corner": ([[0.0, 0.0, 0.5]], np.pi / 16, [np.pi / 4]),
    "a point": ([[0.5, 0.5, 0.0], DISK], np.pi * 0.09, [0.0, ROUND]),
    "all of the box": ([[0.5, 0.5, 2.0], DISK], 1.0, [0.0, 0.0]),
}


@pytest.mark.parametrize("backend", BACKENDS)
def test_borders_on_each_other(backend: str) -> None:
    f = teg.compile(teg.integral(AREA, *BOX), [D], backend=backend)
    for name, (disks, area, slopes) in TIES.items():
        value, found = f.value_and_grad(D=disks)
        assert value == pytest.approx(area, abs=1e-14), name
        assert found["D"][:, 2] == pytest.approx(slopes, abs=1e-7), name  # where disks touch, the root of a rounding is hidden


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("overlap", [1e-15, 1e-14, 1e-13, 1e-12, 1e-9, 1e-6])
def test_borders_that_nearly_touch(backend: str, overlap: float, recwarn: pytest.WarningsRecorder) -> None:
    """A small disk looks out of a larger one, by so much: right to the tolerance, or the call says that it may not be."""
    f = teg.compile(teg.integral(AREA, *BOX), [D], backend=backend)
    for angle in (0.3, 1.1, 2.5):
        apart = 0.08 + overlap
        disks = np.array([[0.45, 0.55, 0.2], [0.45 + apart * np.cos(angle), 0.55 + apart * np.sin(angle), 0.12]])
        recwarn.clear()
        value = f(D=disks)
        warned = any(issubclass(w.category, teg.AccuracyWarning) for w in recwarn)
        assert warned or value == pytest.approx(float(area_of_two(disks)), abs=1e-10)


def area_of_two(disks: np.ndarray) -> mpmath.mpf:
    """The area of two disks whose borders cross, if they do."""
    with mpmath.workdps(40):
        (a, b, r), (c, d, s) = ([mpmath.mpf(float(v)) for v in row] for row in disks)
        apart = mpmath.hypot(a - c, b - d)
        if apart <= abs(r - s):
            return mpmath.pi * max(r, s) ** 2
        halves = [mpmath.acos((apart**2 + u * u - v * v) / (2 * apart * u)) for u, v in ((r, s), (s, r))]
        common = sum(u * u * (half - mpmath.sin(2 * half) / 2) for u, half in zip((r, s), halves, strict=True))
        return mpmath.pi * (r * r + s * s) - common


@pytest.mark.parametrize(
    "condition",
    [
        lambda r: in_disk(r) & (x + y < r(0) + r(1)),
        lambda r: in_disk(r) & (x < r(0)),
        lambda r: in_disk(r) & ~(y <= r(1)),
    ],
    ids=["aslant", "upright", "level"],
)
@pytest.mark.parametrize("backend", BACKENDS)
def test_half_disks_on_a_grid(condition: Any, backend: str) -> None:
    """Many of their edges lie on each other, and on the sides of the box: values are those of places nearby."""
    f = teg.compile(teg.integral(teg.bracket(any_of(condition)) * (1 + x * y), *BOX), [D], backend=backend)
    assert follows_edges(f)
    rng = np.random.default_rng(0)
    for _ in range(100 if backend == "c" else 12):
        n = int(rng.integers(1, 5))
        disks = np.c_[rng.integers(0, 11, (n, 2)) / 10, rng.integers(1, 6, n) / 10]
        nearby = disks + rng.uniform(-1e-7, 1e-7, disks.shape)
        assert f(D=disks) == pytest.approx(f(D=nearby), abs=3e-6), disks.tolist()


def test_the_same_disk_on_both_sides_is_everything() -> None:
    """A disk and what is outside of the same disk: no border is left."""
    sign = D[k, 3]
    covered = teg.any(sign * ((x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2 - D[k, 2] ** 2) < 0, ALL)
    f = teg.compile(teg.integral(teg.bracket(covered) * (1 + x), *BOX), [D])
    value, slopes = f.value_and_grad(D=[[*DISK, 1.0], [*DISK, -1.0]])
    assert value == pytest.approx(1.5, abs=1e-14)
    assert slopes["D"] == pytest.approx(np.zeros((2, 4)), abs=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_picture_by_lists(backend: str) -> None:
    """Σ over pixels of (covered area - target)², with the list of the disks that reach into each pixel."""
    first, listed = teg.indices("first", 1), teg.indices("listed", 1)
    within = in_disk(lambda i: D[listed[k], i])
    cell = (x, (p % 4) / 4, (p % 4 + 1) / 4), (y, (p // 4) / 4, (p // 4 + 1) / 4)
    covered = teg.integral(teg.bracket(teg.any(within, (k, first[p], first[p + 1]))), *cell)
    f = teg.compile(teg.sum((16 * covered - 0.5) ** 2, (p, 0, 16)), [D], backend=backend)
    disks = np.array([[0.31, 0.36, 0.2], [0.56, 0.41, 0.25], [0.7, 0.82, 0.15]])
    reached = [[j for j, (a, b, r) in enumerate(disks) if _reaches(q, a, b, r)] for q in range(16)]
    lists = {"first": np.cumsum([0, *map(len, reached)]), "listed": np.concatenate(reached).astype(int)}

    def loss(rows: np.ndarray) -> float:
        areas = [integral_over_union((rows - [(q % 4) / 4, (q // 4) / 4, 0]) * 4, lambda u, v: 1 + 0 * u) for q in range(16)]
        return float(sum((area - 0.5) ** 2 for area in areas))

    value, slopes = f.value_and_grad(D=disks, **lists)
    assert value == pytest.approx(loss(disks), abs=1e-9)
    along = np.array([[0.3, -0.2, 0.5], [0.1, 0.7, -0.4], [-0.6, 0.2, 0.3]])
    step = 1e-3
    difference = sum(w * (loss(disks + s * step * along) - loss(disks - s * step * along)) for s, w in ((1, 8), (2, -1))) / (12 * step)
    assert np.vdot(slopes["D"], along) == pytest.approx(difference, abs=1e-7)


def _reaches(pixel: int, a: float, b: float, r: float) -> bool:
    corner = np.array([pixel % 4, pixel // 4]) / 4
    away = np.maximum(np.maximum(corner - [a, b], [a, b] - corner - 0.25), 0)
    return bool(away @ away < r * r)


def test_second_derivatives_are_those_of_candidates_written_out() -> None:
    f = teg.compile(teg.integral(AREA, *BOX), [D])
    disks, along = np.array([[0.4, 0.5, 0.25], [0.6, 0.55, 0.2]]), np.array([[0.1, -0.3, 0.2], [0.4, 0.2, -0.1]])
    product = f.hvp({"D": disks}, {"D": along})["D"]
    slopes = [slopes_of_union(disks + s * 1e-4 * along, lambda u, v: 1 + 0 * u) for s in (1, -1)]
    assert product == pytest.approx((slopes[0] - slopes[1]) / 2e-4, abs=1e-6)


@pytest.mark.parametrize(
    "condition",
    [
        lambda r: (x - r(0)) ** 4 + (y - r(1)) ** 4 < r(2) ** 4,  # its edge has no formula
        lambda r: teg.floor(3 * x + r(0)) + y < r(2),
    ],
)
def test_others_are_written_out(condition: Any) -> None:
    f = teg.compile(teg.integral(teg.bracket(any_of(condition)), *BOX), [D])
    g = teg.compile(teg.integral(teg.bracket(by_hand(condition, 2)), *BOX), [D])
    assert not follows_edges(f)
    (value, slopes), (same, others) = (h.value_and_grad(D=MIDDLES) for h in (f, g))
    assert value == pytest.approx(same, abs=1e-10)
    assert slopes["D"] == pytest.approx(others["D"], abs=1e-9)


def test_not_a_number_stays_one() -> None:
    f = teg.compile(teg.integral(AREA, *BOX), [D])
    assert np.isnan(f(D=[[np.nan, 0.5, 0.3], DISK]))
