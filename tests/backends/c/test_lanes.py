"""Eight points at once in C: what the straight line is, that it agrees with the other backends, that points do not see each other."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import teg
from teg.backends.branches import with_branches
from teg.backends.c import kernel as c_backend
from teg.backends.c import lanes as c_packed
from teg.backends.c.kernel import CKernel, compile_c, print_kernel
from teg.backends.c.lanes import Packed, packed
from teg.backends.c.loops import print_arrays
from teg.backends.numpy.kernel import NumpyKernel, compile_numpy
from teg.ir.expr import Param
from teg.program import Arg, Assign, Program, Stmt
from tests.backends.c_checks import in_c, text_compiles_without_warnings
from tests.backends.programs import Case
from tests.bench.scenes import bilinear_pixel, half_planes, picture, triangle_pixel

pytestmark = [*in_c, pytest.mark.usefixtures("as_users_compile"), pytest.mark.filterwarnings("error")]

Array = npt.NDArray[np.float64]
x, y = teg.vars("x y")
a, b, c, s = teg.params("a b c s")


def two_wedges() -> tuple[teg.Expr, list[Param]]:
    """A wedge times one of two colours: a branch inside of the branch that gives everything."""
    inside = teg.bracket((x + a * y > b) & (y - x > c))
    return teg.integral(inside * (s * x + a * y) ** 7, (x, 0, 1), (y, 0, b)), [a, b, c, s]


def power() -> tuple[teg.Expr, list[Param]]:
    """Powers other than squares, positive and negative, of what is constant over the box."""
    inside = teg.bracket((x + a * y > b) & (y - x > c))
    return teg.integral(inside * (x * s**5 + y * s**-3), (x, 0, 1), (y, 0, 1)), [a, b, c, s]


def borders() -> tuple[teg.Expr, list[Param]]:
    """A derivative of a triangle's area: segments, and no branch that gives everything."""
    e, wrt = triangle_pixel(0)
    return teg.diff(e, wrt[0]), []


SCENES: dict[str, tuple[teg.Expr, list[Param]]] = {
    "constant": triangle_pixel(0),
    "linear": triangle_pixel(1),
    "quadratic": triangle_pixel(2),
    "half-planes": half_planes(3),
    "wedges": two_wedges(),
    "powers": power(),
    "bilinear": bilinear_pixel(),
    "borders": borders(),
}


@cache
def program_of(name: str) -> Program:
    e, wrt = SCENES[name]
    program = teg.compile(e, wrt, backend="numpy").program(1)
    assert isinstance(program, Program)
    return program


@cache
def in_numpy(name: str) -> NumpyKernel:
    return compile_numpy(program_of(name))


@cache
def compiled(name: str) -> CKernel:
    return compile_c(program_of(name))


def points(program: Program, n: int, seed: int = 0) -> list[Array]:
    """Columns for the parameters: triangles around a unit box, in and beside it; some touch it, some have the box's corners."""
    rng = np.random.default_rng(seed)
    named = {p: rng.uniform(-2.0, 2.0, n) for p in program.parameters}
    if "x0" in named:
        size = np.exp(rng.uniform(-1.0, 2.0, n))
        middle = 0.5 + size * rng.uniform(-1.2, 1.2, (2, n))
        for k, angle in enumerate(rng.uniform(0.0, 2.1, n) + 2.1 * np.arange(3)[:, None]):
            named |= {f"x{k}": middle[0] + size * np.cos(angle), f"y{k}": middle[1] + size * np.sin(angle)}
        named |= {"left": np.zeros(n), "right": np.ones(n), "bottom": np.zeros(n), "top": np.ones(n)}
        for name in (f"{v}{k}" for v in "xy" for k in range(3)):
            named[name][::7] = np.round(2.0 * named[name][::7]) / 2.0
    else:
        for column in named.values():
            column[::5] = np.round(column[::5])
            column[1::5] *= 0.05
        if "s" in named:
            named["s"] += np.where(named["s"] < 0.0, -0.5, 0.5)
    return [named[p] for p in program.parameters]


def decided(found: Packed, program: Program, columns: list[Array]) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Which points are live, and which of these fast, by NumPy."""

    def holds(flag: Arg, needed: tuple[Assign, ...]) -> npt.NDArray[np.bool_]:
        number = Assign("v1000000", "select", (flag, 1.0, 0.0))
        return np.asarray(compile_numpy(Program(program.parameters, (*needed, number), (number.name,)))(columns, len(columns[0]))[0] == 1.0)

    live = holds(found.live, found.settling)
    return live, live & holds(found.fast, found.deciding)


def plain(straight: tuple[Stmt, ...]) -> Iterator[Stmt]:
    """The straight line in words that NumPy knows."""
    for i, stmt in enumerate(straight):
        if isinstance(stmt, Assign) and stmt.op == "choose":
            yield Assign(f"b{10**6 + i}", "gt0", stmt.args[:1])
            yield Assign(stmt.name, "select", (f"b{10**6 + i}", *stmt.args[1:]))
        else:
            yield stmt


@pytest.mark.parametrize("name", SCENES)
def test_the_straight_line_is_the_program_where_points_are_fast(name: str) -> None:
    """Points are of all three kinds; what is not live is 0; on the straight line, with whole boxes, outputs are the program's."""
    program = program_of(name)
    found = packed(with_branches(program))
    assert found is not None
    columns = points(program, 4000)
    live, fast = decided(found, program, columns)
    assert (live & ~fast).sum() > 40
    assert found.live is True or (~live).sum() > 40
    assert found.fast is not False
    assert name in ("borders", "wedges") or fast.sum() > 40  # no branch gives everything there
    expected = in_numpy(name)(columns, 4000)
    assert not expected[:, ~live].any()
    with np.errstate(all="ignore"):  # where it is not to be taken it may be anything
        line = compile_numpy(Program(program.parameters, tuple(plain(found.straight)), found.outputs))(columns, 4000)
    np.testing.assert_allclose(line[:, fast], expected[:, fast], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_as_numpy(name: str) -> None:
    program = program_of(name)
    columns = points(program, 3000, 1)
    found, expected = compiled(name)(columns, 3000), in_numpy(name)(columns, 3000)
    np.testing.assert_allclose(found, expected, rtol=3e-12, atol=3e-12)


@pytest.mark.parametrize("name", SCENES)
def test_what_is_not_finite(name: str) -> None:
    program = program_of(name)
    columns = points(program, 64 * len(program.parameters), 2)
    for i, column in enumerate(columns):
        for j, value in enumerate((np.nan, np.inf, -np.inf, 1e300, 1e-320)):
            column[64 * i + 8 * j : 64 * i + 8 * j + 8] = value
    with np.errstate(all="ignore"):
        expected = in_numpy(name)(columns, len(columns[0]))
    found = compiled(name)(columns, len(columns[0]))
    finite = np.isfinite(expected)
    assert np.isfinite(found[finite]).all()
    finite &= np.abs(expected) < 1e100
    np.testing.assert_allclose(found[finite], expected[finite], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", SCENES)
def test_points_do_not_see_their_neighbours(name: str) -> None:
    """Every output has the same bits alone, in batches of any size, in any order, shared or strided, with any number of threads."""
    program = program_of(name)
    n = 700
    columns = points(program, n, 3)
    kernel = compiled(name)
    whole = kernel(columns, n)
    for threads in (2, 3):
        np.testing.assert_array_equal(compile_c(program, threads=threads)(columns, n), whole)
    order = np.random.default_rng(4).permutation(n)
    np.testing.assert_array_equal(kernel([column[order] for column in columns], n), whole[:, order])
    for first, last in ((0, 1), (5, 6), (3, 10), (8, 16), (1, 66), (64, 129), (2, 3)):
        np.testing.assert_array_equal(kernel([column[first:last] for column in columns], last - first), whole[:, first:last])
        point = kernel.at_point([float(column[first]) for column in columns])
        np.testing.assert_array_equal(point.values[:, 0], whole[:, first])
    apart = [np.repeat(column, 3)[::3] if i % 2 else column[::-1].copy()[::-1] for i, column in enumerate(columns)]
    np.testing.assert_array_equal(kernel(apart, n), whole)
    shared = [np.array(column[9]) if i % 3 else column for i, column in enumerate(columns)]
    full = [np.full(n, column[9]) if i % 3 else column for i, column in enumerate(columns)]
    np.testing.assert_array_equal(kernel(shared, n), kernel(full, n))


def moment(c: teg.Expr | float, a: teg.Expr | float) -> teg.Expr:
    """An integral that is not needed where c <= 0."""
    u = teg.var("u")
    return teg.integral(teg.bracket(u < c) * u * a, (u, 0, 1))


def wedge(body: teg.Expr | float, above: teg.Expr = b, width: teg.Expr | float = 1.0) -> teg.Expr:
    return teg.integral(teg.bracket((x + a * y > above) & (y - x > c - 0.5)) * body, (x, 0, width), (y, 0, 1))


@pytest.mark.parametrize(
    "e",
    [
        wedge(x, s + b * moment(c, a)),  # it decides whether anything is to be done
        wedge(x, s + b * moment(c + 0.25, a)) + wedge(y, b),
        wedge(x * s + moment(c, a) * y),
        wedge(x, b, moment(c, a)),
        teg.where(moment(c, a) > b, 1.0, 2.0) * wedge(x * s),
        teg.integral(teg.exp(-a * x), (x, 0, 1)) * wedge(x * s),
        wedge(x + teg.integral(teg.exp(-a * x), (x, 0, 1)) * y),
        wedge(x) * wedge(y, s),
    ],
    ids=["decides", "decides one of two", "factor", "bound", "branch", "adaptive", "adaptive inside", "product"],
)
def test_integrals_that_other_points_need(e: teg.Expr) -> None:
    """What the straight line leaves out is not left out at points that do not take it."""
    n = 400
    rng = np.random.default_rng(6)
    at = {p: rng.uniform(-1.0, 2.0, n) for p in "abcs"}
    at["b"][::3] *= -6.0
    (value, slopes), (expected, others) = (teg.compile(e, [a, b, c, s], backend=k).value_and_grad(at) for k in ("c", "numpy"))
    np.testing.assert_allclose(value, expected, rtol=1e-11, atol=1e-11)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, others[name], rtol=1e-10, atol=1e-10)


def test_sums_with_the_same_body() -> None:
    """One function for all of them, also where others come between."""
    t = teg.param("t")
    arrays = [teg.array(name, 2) for name in "UVW"]

    def total(array: teg.Array, power: int) -> teg.Expr:
        k = teg.index("k")
        inside = teg.bracket((x + array[k, 0] * y > array[k, 1]) & (y - x > array[k, 2]))
        return teg.sum(teg.integral(inside * (x**power * array[k, 3] + y), (x, 0, 1), (y, 0, 1)), (k, 0, teg.length(array, 0)))

    e = sum((t**i * total(array, 1 + i % 2) for i, array in enumerate(arrays)), start=0 * t)
    rng = np.random.default_rng(7)
    at: dict[str, Any] = {str(array.name): rng.uniform(-1.0, 1.0, (9 + i, 4)) for i, array in enumerate(arrays)} | {"t": 0.75}
    (value, slopes), (expected, others) = (teg.compile(e, [*arrays, t], backend=k).value_and_grad(at) for k in ("c", "numpy"))
    assert value == pytest.approx(expected, rel=1e-13)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, others[name], rtol=1e-11, atol=1e-12)


def test_colours_that_are_not_looked_at() -> None:
    """A colour that is nowhere may be anything; one that is somewhere may not."""
    f = teg.compile(*bilinear_pixel(), backend="c")
    corners = dict.fromkeys(("c00", "c10", "c01", "c11"), 1.0)
    colours = {f"above{k}": 0.5 for k in range(3)} | {f"target{k}": 0.0 for k in range(3)}
    for nothing in (np.nan, np.inf):
        at = corners | colours | {f"below{k}": nothing for k in range(3)}
        assert f(at | {"t": 0.0}) == 0.75
        assert not np.isfinite(f(at | {"t": 2.0}))


def test_single_precision_is_the_same_line() -> None:
    program = program_of("linear")
    columns = [column.astype(np.float32) for column in points(program, 500, 5)]
    found = compile_c(program, dtype="float32")(columns, 500)
    expected = compiled("linear")([column.astype(np.float64) for column in columns], 500)
    np.testing.assert_array_equal(found, expected.astype(np.float32))


def test_a_tie_is_not_for_the_straight_line() -> None:
    """Two edges that coincide on the border of the box: in a batch the mean of both sides, as alone."""
    f = teg.compile(*triangle_pixel(0), backend="c")
    corners = dict(zip(("x0", "y0", "x1", "y1", "x2", "y2"), (0.0, -5.0, 10.0, 0.5, 0.0, 6.0), strict=True))
    box = {"left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0}
    colours = {f"c{k}": 1.0 for k in range(3)} | {f"t{k}": 0.0 for k in range(3)}
    at: dict[str, Any] = {**corners, **box, **colours}
    value, slopes = f.value_and_grad(at | {"x0": np.linspace(-0.5, 0.5, 101)})
    np.testing.assert_allclose(value[50], 3.0, rtol=1e-14)
    _, alone = f.value_and_grad(at)
    assert slopes["x0"][50] == alone["x0"] != 0.0
    assert slopes["x0"][0] == 0.0


def test_long_programs_have_no_straight_line(monkeypatch: pytest.MonkeyPatch) -> None:
    program = program_of("linear")
    assert "straight_" in print_kernel(program)
    monkeypatch.setattr(c_packed, "LONGEST", 20)
    assert packed(program) is None
    text = print_kernel(program)
    assert "straight_" not in text
    assert "decision_" not in text


def test_a_program_that_counts_counts_every_point() -> None:
    assert "decision_" not in print_kernel(program_of("linear"), counted=True)


@pytest.mark.parametrize("name", ["linear", "powers", "bilinear"])
def test_compilers_without_vectors(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The text for other compilers than gcc and clang, where a lane is one number."""
    program = program_of(name)
    columns = points(program, 300, 8)
    expected = compiled(name)(columns, 300)
    print_it = c_backend.print_kernel
    monkeypatch.setattr(c_backend, "print_kernel", lambda *a, **k: print_it(*a, **k).replace("__GNUC__", "NO_VECTORS"))
    kernel = compile_c(program)
    assert "__GNUC__" not in kernel.source
    np.testing.assert_allclose(kernel(columns, 300), expected, rtol=1e-12, atol=1e-12)


def test_no_warnings(tmp_path: Any) -> None:
    for name in SCENES:
        program = program_of(name)
        text_compiles_without_warnings(tmp_path, [Case(name, program, (), ())])


@cache
def picture_in(backend: str) -> teg.Evaluator:
    return teg.compile(*picture(), backend=backend)


@pytest.mark.parametrize("wide", [1, 7, 8, 9, 40])
def test_pictures_of_any_width(wide: int) -> None:
    """Sums over pixels, a few at a time: as NumPy, for rows that are no multiple of eight, empty ones too."""
    f, plain = picture_in("c"), picture_in("numpy")
    assert "covered_" in print_arrays(f.program(1))
    rng = np.random.default_rng(wide)
    at = {
        "V": np.array([[-3.0, -2.0], [wide + 2.0, 1.0], [wide / 2, 9.0], [0.25, 0.25]]),
        "F": np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3]]),
        "B": np.array([[0, wide, 0, 6], [0, 0, 0, 6], [0, wide, 3, 6]]),
        "C": rng.random((3, 9)),
        "T": rng.random((6, wide, 3)),
    }
    value, slopes = f.value_and_grad(at)
    expected, others = plain.value_and_grad(at)
    assert value == pytest.approx(expected, rel=1e-13)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, others[name], rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("a_from", [0.2, -2.0], ids=["growing", "both signs"])
def test_choices_that_only_some_points_make(a_from: float) -> None:
    """Exponentials whose rates are positive, negative, 0 and no number: each point makes its own choice on the straight line."""
    t = teg.param("t")
    e = teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1))
    f, plain = (teg.compile(e, [t, a], backend=backend) for backend in ("c", "numpy"))
    found = packed(with_branches(f.kernel(1).program))
    assert found is not None
    assert found.wide
    rng = np.random.default_rng(4)
    at = {"t": rng.uniform(-0.2, 1.2, 400), "a": rng.uniform(a_from, 2.0, 400)}
    at["a"][::50], at["t"][7::90] = 0.0, 1.0  # no change, and a tie
    _, fast = decided(found, with_branches(f.kernel(1).program), [at["t"], at["a"]])
    assert fast.sum() == 400 - len(at["t"][7::90])
    value, slopes = f.value_and_grad(at)
    expected, others = plain.value_and_grad(at)
    np.testing.assert_allclose(value, expected, rtol=1e-14, atol=1e-15)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, others[name], rtol=1e-13, atol=1e-14)
    rates = np.where(at["a"] == 0.0, 1.0, at["a"])
    clipped = np.clip(at["t"], 0.0, 1.0)
    np.testing.assert_allclose(value, np.where(at["a"] == 0.0, clipped, np.expm1(rates * clipped) / rates), rtol=1e-13)
