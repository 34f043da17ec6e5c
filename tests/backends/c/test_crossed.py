"""Points that surfaces cross, eight at once: which programs have such a line, and that it agrees with clipping corner by corner."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import teg
from teg.backends.branches import with_branches
from teg.backends.c import crossed as c_crossed
from teg.backends.c.crossed import Crossed, crossed, lines_apart
from teg.backends.c.items import Nodes
from teg.backends.c.kernel import CKernel, compile_c, print_kernel
from teg.backends.numpy.kernel import NumpyKernel, compile_numpy
from teg.ir.expr import Param
from teg.program import Assign, Program
from tests.backends.c_checks import in_c
from tests.bench.scenes import bilinear_pixel, half_planes, triangle_pixel

pytestmark = [*in_c, pytest.mark.usefixtures("as_users_compile"), pytest.mark.filterwarnings("error")]

Array = npt.NDArray[np.float64]
x, y = teg.vars("x y")
a, b, c, s = teg.params("a b c s")


def cubic() -> tuple[teg.Expr, list[Param]]:
    """A cubic polynomial on two half-planes of a box whose size is a parameter."""
    inside = teg.bracket((x + a * y > b) & (y - x > c))
    return teg.integral(inside * (s * x + y) ** 3, (x, 0, 1), (y, 0, 2)), [a, b, c, s]


SCENES: dict[str, tuple[teg.Expr, list[Param]]] = {
    "constant": triangle_pixel(0),
    "linear": triangle_pixel(1),
    "quadratic": triangle_pixel(2),
    "half-planes": half_planes(4),
    "cubic": cubic(),
}


@cache
def program_of(name: str, order: int = 1) -> Program:
    e, wrt = SCENES[name]
    program = teg.compile(e, wrt, backend="numpy").program(order)
    assert isinstance(program, Program)
    return program


@cache
def in_numpy(name: str) -> NumpyKernel:
    return compile_numpy(program_of(name))


@cache
def compiled(name: str) -> CKernel:
    return compile_c(program_of(name))


def triangles(program: Program, n: int, size: float, thin: float = 1.0) -> list[Array]:
    """Columns of triangles around the unit box: `thin` squeezes them towards a line; every fifth has corners on the box's grid."""
    rng = np.random.default_rng(11)
    angle = rng.uniform(0.0, 2.1, n) + 2.1 * np.arange(3)[:, None]
    turn = rng.uniform(0.0, 6.3, n)
    u, v = size * np.cos(angle), thin * size * np.sin(angle)
    named = {f"x{k}": 0.5 + u[k] * np.cos(turn) - v[k] * np.sin(turn) for k in range(3)}
    named |= {f"y{k}": 0.5 + u[k] * np.sin(turn) + v[k] * np.cos(turn) for k in range(3)}
    for column in named.values():
        column[::5] = np.round(2.0 * column[::5]) / 2.0
    named |= {"left": np.zeros(n), "right": np.ones(n), "bottom": np.zeros(n), "top": np.ones(n)}
    return [named[p] if p in named else rng.random(n) for p in program.parameters]


def is_good(program: Program, columns: list[Array]) -> npt.NDArray[np.bool_]:
    """Where the line of points that surfaces cross is taken to be right, by NumPy."""
    found = crossed(with_branches(program))
    assert found is not None
    return by_numpy(found, program, columns)[0]


def by_numpy(found: Crossed, program: Program, columns: list[Array]) -> tuple[npt.NDArray[np.bool_], npt.NDArray[Any]]:
    """Where a straight line is taken to be right, and its outputs."""
    steps: list[Assign] = []
    for item in found.items:
        if isinstance(item, Assign):
            steps.append(item)
            continue
        terms: dict[str, list[str]] = {name: [] for name in item.sums}
        for n, weight in enumerate(item.weights):
            steps += [Assign(name, "const", (at[n],)) for name, at in item.places.items()]
            own = {name: f"{name}x{n}" for name in [line.name for line in item.body]}
            for line in item.body:
                steps.append(Assign(own[line.name], line.op, tuple(own.get(str(arg), arg) for arg in line.args)))
            for name, value in zip(item.sums, item.values, strict=True):
                terms[name].append(f"{name}x{n}")
                steps.append(Assign(terms[name][-1], "mul", (weight, own.get(str(value), value))))
        steps += [Assign(name, "add", tuple(parts)) for name, parts in terms.items()]
    lines = [Assign(line.name, {"lower": "min", "upper": "max"}.get(line.op, line.op), line.args) for line in steps]
    flag = Assign("v10000000", "select", (found.good, 1.0, 0.0))
    with np.errstate(all="ignore"):
        results = compile_numpy(Program(program.parameters, (*lines, flag), (*found.outputs, "v10000000")))(columns, len(columns[0]))
    return np.asarray(results[-1] == 1.0), np.asarray(results[:-1])


@pytest.mark.parametrize("name", SCENES)
def test_which_programs_have_the_line(name: str) -> None:
    """Polygons and segments have one, with the loops over their nodes; it is in the text."""
    program = program_of(name)
    found = crossed(with_branches(program))
    assert found is not None
    assert any(isinstance(item, Nodes) for item in found.items)
    assert "crossed_" in print_kernel(program)


def test_without_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not without the intrinsic, without polygons, with estimates of errors, in a kernel that counts, or beyond the limits."""
    e, wrt = SCENES["linear"]
    plain = teg.compile(e, wrt, backend="numpy", intrinsics=False).program(1)
    assert isinstance(plain, Program)
    assert crossed(with_branches(plain)) is None
    smooth = teg.compile(*bilinear_pixel(), backend="numpy").program(1)
    assert isinstance(smooth, Program)
    assert crossed(with_branches(smooth)) is None
    program = program_of("linear")
    assert "crossed_" not in print_kernel(program, counted=True)
    for limit in ("LONGEST", "MOST", "MOST_DEGREE", "MOST_LINES"):
        with monkeypatch.context() as patch:
            patch.setattr(c_crossed, limit, 1)
            assert crossed(with_branches(program)) is None, limit


@pytest.mark.parametrize("name", ["constant", "linear", "quadratic"])
@pytest.mark.parametrize(("size", "thin"), [(10.0, 1.0), (1.0, 1.0), (0.3, 1.0), (3.0, 0.1), (3.0, 1e-2), (3.0, 1e-4), (3.0, 1e-6)])
def test_triangles_of_all_kinds(name: str, size: float, thin: float) -> None:
    """As NumPy, which clips corner by corner: large, small, thin, with corners and edges on the sides of the box."""
    program = program_of(name)
    columns = triangles(program, 1000, size, thin)
    found, expected = compiled(name)(columns, 1000), in_numpy(name)(columns, 1000)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


def test_which_points_are_good() -> None:
    """Nearly all of the stout triangles are; thin ones with shades are not, thin ones of one colour are."""
    for name, size, thin, least, most in (
        ("linear", 3.0, 1.0, 0.6, 1.0),
        ("linear", 3.0, 1e-3, 0.0, 0.05),
        ("constant", 0.3, 1.0, 0.5, 1.0),
    ):
        program = program_of(name)
        columns = triangles(program, 1000, size, thin)
        live = in_numpy(name)(columns, 1000).any(axis=0)
        share = is_good(program, columns)[live].mean()
        assert least <= share <= most, (name, size, thin, share)


@pytest.mark.parametrize("name", ["half-planes", "cubic"])
def test_half_planes_of_all_kinds(name: str) -> None:
    """Slopes of 0, lines through corners, lines on sides, lines that coincide, no line at all."""
    program = program_of(name)
    rng = np.random.default_rng(12)
    n = 2000
    named = {p: rng.standard_normal(n) for p in program.parameters}
    for column in named.values():
        column[::3] = rng.integers(-2, 3, len(column[::3]))
        column[1::9] = 0.0
    if "a1" in named:
        for k in "abc":
            named[f"{k}1"][2::9] = named[f"{k}0"][2::9]
    columns = [named[p] for p in program.parameters]
    with np.errstate(all="ignore"):
        expected = in_numpy(name)(columns, n)
    found = compiled(name)(columns, n)
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
    finite = np.isfinite(expected)
    np.testing.assert_allclose(found[finite], expected[finite], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", SCENES)
def test_what_is_not_a_number_stays_so(name: str) -> None:
    program = program_of(name)
    n = 64 * len(program.parameters)
    shapes = "x0" in program.parameters
    columns = triangles(program, n, 2.0) if shapes else list(np.random.default_rng(13).random((len(program.parameters), n)))
    for i, column in enumerate(columns):
        for j, value in enumerate((np.nan, np.inf, -np.inf)):
            column[64 * i + 8 * j : 64 * i + 8 * j + 8] = value
    with np.errstate(all="ignore"):
        expected = in_numpy(name)(columns, n)
    found = compiled(name)(columns, n)
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))


def test_far_from_the_origin() -> None:
    """A scene moved by a power of two has the same results to the rounding of its coordinates."""
    program = program_of("linear")
    columns = triangles(program, 500, 3.0)
    places = [i for i, p in enumerate(program.parameters) if p[0] in "xylrb" or p == "top"]
    for i in places:
        columns[i] = np.round(columns[i] * 2**20) / 2**20
    moved = [column + 2.0**20 if i in places else column for i, column in enumerate(columns)]
    kernel = compiled("linear")
    np.testing.assert_allclose(kernel(moved, 500), kernel(columns, 500), rtol=1e-12, atol=1e-12)


def test_an_edge_on_a_side_is_the_mean_of_both_orders() -> None:
    """A tie is not for the line: the derivative is the mean of those on either side."""
    program = program_of("constant")
    at: dict[str, Any] = {"x0": 0.0, "y0": -1.0, "x1": 3.0, "y1": 0.5, "x2": 0.0, "y2": 2.0, "left": 0.0, "right": 1.0}
    at |= {"bottom": 0.0, "top": 1.0} | {f"c{k}": 1.0 for k in range(3)} | {f"t{k}": 0.0 for k in range(3)}
    columns = [np.full(9, at[p]) for p in program.parameters]
    index = program.parameters.index("x0"), program.parameters.index("x2")
    slopes = []
    for offset in (-1e-9, 0.0, 1e-9):
        for i in index:
            columns[i] = np.full(9, offset)
        slopes.append(compiled("constant")(columns, 9))
    np.testing.assert_allclose(slopes[1], 0.5 * (slopes[0] + slopes[2]), atol=1e-7)
    assert (slopes[1] != slopes[0]).any()


@pytest.mark.parametrize("name", ["constant", "linear", "quadratic"])
def test_lines_of_one_half_plane_alone(name: str) -> None:
    """Right where they are taken to be, edges on sides of the box among them: as NumPy, which clips few points corner by corner."""
    program = program_of(name)
    lines = lines_apart(with_branches(program), None)
    assert len(lines) == 3
    n = 40
    good, ties = 0, 0
    for size in (3.0, 8.0):
        columns = triangles(program, 25 * n, size)
        at = dict(zip(program.parameters, columns, strict=True))
        for k in range(5 * n):  # the edge from corner 0 to corner 1 on a side
            at["x0"][k], at["x1"][k], at["y0"][k], at["y1"][k] = 0.0, 0.0, 2.0 + at["y0"][k] % 1.0, -1.0 - at["y1"][k] % 1.0
            at["x2"][k], at["y2"][k] = 4.0, 0.5
        expected = np.concatenate([in_numpy(name)([c[k : k + n] for c in columns], n) for k in range(0, 25 * n, n)], axis=1)
        for line in lines:
            right, found = by_numpy(line, program, columns)
            np.testing.assert_allclose(found[:, right], expected[:, right], rtol=1e-11, atol=1e-11)
            good, ties = good + int(right.sum()), ties + int(right[: 5 * n].sum())
    assert good > 500
    assert ties == 2 * 5 * n


def test_one_line_on_a_side() -> None:
    """As NumPy, which clips few points corner by corner: on all sides, the box on either side of the line; also a rounding beside it."""
    e, wrt = half_planes(1)
    program = teg.compile(e, wrt, backend="numpy").program(1)
    assert isinstance(program, Program)
    turns = np.array([(1.5, 0.0, 0.0), (1.5, 0.0, 1.5), (0.0, 0.7, 0.0), (0.0, 0.7, 0.7)])
    moved = [turns + np.array([0.0, 0.0, distance]) for distance in (1e-16, -1e-9, 0.3)]
    a, b, c = np.concatenate([turns, -turns, *moved]).T
    columns = [{"a": a, "b": b, "c": c}[p[0]] for p in program.parameters]
    n = len(a)
    assert n < 64
    np.testing.assert_allclose(compile_c(program)(columns, n), compile_numpy(program)(columns, n), rtol=1e-12, atol=1e-12)


def test_which_half_planes_have_lines_of_their_own() -> None:
    """Two to four, the same in all polygons."""
    counts = {name: len(lines_apart(with_branches(program_of(name)), None)) for name in SCENES}
    assert counts == {"constant": 3, "linear": 3, "quadratic": 3, "half-planes": 4, "cubic": 2}
    for number in (1, 5):
        e, wrt = half_planes(number)
        program = teg.compile(e, wrt, backend="numpy").program(1)
        assert isinstance(program, Program)
        assert lines_apart(with_branches(program), None) == []


def test_estimates_are_those_of_the_clipped_polygon() -> None:
    """A call with an error has a value within it."""
    e, wrt = SCENES["linear"]
    f = teg.compile(e, wrt, backend="c")
    program = program_of("linear")
    at = dict(zip(program.parameters, triangles(program, 300, 1.0), strict=True))
    value, error = f.value_and_error(at)
    expected = teg.compile(e, wrt, backend="numpy")(at)
    assert (np.abs(value - expected) <= error + 1e-15).all()
    np.testing.assert_allclose(f(at), value, rtol=1e-11, atol=1e-12)
