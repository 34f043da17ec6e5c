"""Moments of bilinear half-spaces and of their borders, in every backend: as statements, and as the programs that become them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg.backends.c.kernel import compile_c
from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from teg.ir.traverse import parameters
from teg.program import Assign, Hyperbola, Moments, Program, size, statements
from tests.backends.c_checks import (
    LIMITS,
    any_number_of_threads_gives_the_same,
    behaviour_is_defined,
    in_c,
    limits_change_no_bit,
    lines_are_short,
    text_compiles_without_warnings,
)
from tests.backends.programs import Case, Row, columns, expected, let, program
from tests.bench.scenes import bilinear_pixel

needs_c = in_c[0]
jax_is_slow = pytest.mark.slow  # to compile
BACKENDS = ["numpy", pytest.param("c", marks=needs_c), pytest.param("jax", marks=jax_is_slow)]
pytestmark = pytest.mark.usefixtures("x64")

POWERS = [(0, 0), (1, 0), (0, 1), (1, 1), (2, 1), (2, 2)]
BORDERS = [*POWERS, (0, 3), (3, 2), (3, 3)]
Corners = tuple[float, float, float, float]


@cache
def exact(corners: Corners, kind: str, j: int, k: int) -> float:
    """∫∫ uʲvᵏ w over the unit square to 20 digits, by pieces in v; corners counterclockwise."""
    if corners[0] == corners[1] and corners[2] == corners[3]:  # a function of v
        return exact((corners[0], corners[3], corners[2], corners[1]), kind, k, j)
    with mpmath.workdps(24):
        f0, f1, f2, f3 = map(mpmath.mpf, corners)
        b, c, d = f1 - f0, f3 - f0, f0 - f1 + f2 - f3
        cuts = {mpmath.mpf(0), mpmath.mpf(1)}
        cuts |= {-n / s for n, s in ((f0, c), (f1, f2 - f1), (b, d)) if s != 0 and 0 < -n / s < 1}
        total = mpmath.mpf(0)
        ends = sorted(cuts)
        for low, high in pairwise(ends):
            middle = (low + high) / 2
            root = -(f0 + c * middle) / (b + d * middle)
            meets = 0 < root < 1
            if kind == "border":
                if meets:
                    total += mpmath.quad(lambda v: (-(f0 + c * v) / (b + d * v)) ** j * v**k / abs(b + d * v), [low, middle, high])
                continue
            whole = (high ** (k + 1) - low ** (k + 1)) / ((j + 1) * (k + 1))
            left = f0 + c * middle > 0 if meets else f0 + c * middle + (b + d * middle) / 2 > 0
            part = whole
            if meets:
                part = mpmath.quad(lambda v: (-(f0 + c * v) / (b + d * v)) ** (j + 1) * v**k / (j + 1), [low, middle, high])
            above = part if left else whole - part if meets else mpmath.mpf(0)
            total += above if kind == "above" else whole - above
        return float(total)


ROWS: list[Corners] = [
    (1.0, 0.5, 0.25, 2.0),
    (-1.0, -0.5, -0.25, -2.0),
    (-0.3, 0.5, 0.9, 0.1),
    (0.3, -0.5, -0.9, 0.1),
    (0.8, 0.1, -0.4, 0.6),
    (0.4, -0.7, 0.3, -0.2),
    (-0.4, 0.7, -0.1, 0.2),
    (-0.4, 0.2, -0.5, 0.7),
    (-0.5, 0.5, 0.5 + 1e-9, -0.5),
    (-0.5, 0.25, 1.0, 0.25),
    (-0.5, 0.25, 1.0 + 2.0**-40, 0.25),
    (-0.25, -0.25, 0.75, 0.75),
    (0.5 + 2.0**-20, -0.5, 0.5, -0.5),
    (0.5, -0.5, 0.5 - 2.0**-30, -0.5),
    (0.0, 1.0, 0.5, 0.25),
    (0.0, -1.0, 0.5, 0.25),
    (1e-9, 1.0, 0.5, -1e-9),
]


def moments(kind: str, powers: Sequence[tuple[int, int]]) -> list[Moments]:
    """Each power alone."""
    return [Moments(kind, ((j, k, 1.0),)) for j, k in powers]


def of_corners(asked: Sequence[Moments], before: tuple[Any, ...] = (), scale: float | str = 1.0, when: str | None = None) -> Program:
    """Moments of the function with p0, p1, p2, p3 at the corners."""
    results = tuple(f"v{i}" for i in range(len(asked)))
    border = any(m.kind == "border" for m in asked)
    scales, ties = ((scale,) * 4, (0, 1, 2, 3)) if border else ((), ())
    inside = (let("vs", "const", 1.0),) if scale == "vs" else ()
    corners = ("p0", "p1", "p2", "p3")
    return program(4, (*before, Hyperbola(corners, inside, scales, ties, tuple(asked), results, when)), *results, ties=len(ties))


def case_of(name: str, rows: Sequence[Corners], asked: Sequence[Moments], tolerance: float) -> Case:
    """All of these functions in one batch."""

    @cache  # when a test asks, not when it is collected
    def answers() -> tuple[Row, ...]:
        return tuple(tuple(exact(row, m.kind, *m.terms[0][:2]) for row in rows) for m in asked)

    given: list[Row] = [tuple(row[i] for row in rows) for i in range(4)]
    return Case(name, of_corners(asked), tuple(given), answers, len(rows), tolerance)


NAN, INF, LOG = math.nan, math.inf, math.log(2.0)
CROSS = (0.25, -0.25, 0.25, -0.25)
ABOVE, BELOW, LINE = (Moments(kind, ((0, 0, 1.0),)) for kind in ("above", "below", "border"))
SPECIAL = (
    Case("a side on the curve", of_corners([ABOVE, LINE, *moments("border", [(1, 0), (0, 1)])], (), "vs"), (0.0, 0.0, 0.5, 0.25),
         (1.0, 2 * LOG, 2 * (1 - LOG), 0.0), 1, 4e-15, (0,)),
    Case("another side, from outside", of_corners([BELOW, LINE]), (-0.5, 0.0, 0.0, -0.25), (1.0, 2 * LOG), 1, 4e-15, (1,)),
    Case("nearly on the curve", of_corners([ABOVE, LINE]), (1e-17, -2e-17, 0.5, 0.25), (1.0, 2 * LOG), 1, 4e-15, (0,)),
    Case("nothing but rounding errors", of_corners([ABOVE, LINE]), (0.0, 0.0, 0.0, 0.0), (0.0, 0.0)),
    Case("a corner on the curve", of_corners([ABOVE, LINE]), (0.0, 0.5, 0.75, 0.25), (1.0, 0.0)),
    Case("two lines that cross", of_corners([ABOVE, LINE, Moments("border", ((1, 0, -2.0), (0, 1, 1.0))),
         Moments("border", ((1, 0, 1.0), (0, 0, -0.5))), Moments("border", ((2, 0, 1.0), (1, 0, -1.0), (0, 0, 0.25)))]),
         CROSS, (0.5, INF, -INF, 0.0, 0.25), 1, 4e-15),
    Case("lines that cross outside", of_corners([ABOVE, LINE]), (-0.5, -1.0, 1.0, 0.5), (0.5, LOG), 1, 4e-15),
    Case("not a number", of_corners([ABOVE, BELOW, LINE]), (NAN, 1.0, 1.0, (1.0, -1.0)), (NAN,) * 3, 2),
    Case("infinite", of_corners([ABOVE, LINE]), ((INF, -INF), 1.0, 1.0, 1.0), (NAN, NAN), 2),
    Case("coefficients of what is empty do not matter",
         program(5, (Hyperbola(("p0", "p1", "p2", "p3"), (), (1.0,) * 4, (0, 1, 2, 3), tuple(Moments(kind, ((0, 0, "p4"),))
                 for kind in ("above", "below", "border")), ("v0", "v1", "v2")),), "v0", "v1", "v2", ties=4),
         ((1.0, -1.0), (2.0, -2.0), (3.0, -3.0), (4.0, -4.0), (NAN, NAN)), ((NAN, 0.0), (0.0, NAN), 0.0), 2),
    Case("huge and tiny", of_corners([ABOVE, LINE]), ((-1e250, -1e-250), (2e250, 2e-250), (2e250, 2e-250), (-1e250, -1e-250)),
         (2 / 3, (1e-250 / 3, 1e250 / 3)), 2, 4e-15),
    Case("as large as numbers are", of_corners([ABOVE, LINE]), (-4e307, 8e307, 8e307, -4e307), (2 / 3, 0.0), 1, 4e-15),
    Case("behind a guard", of_corners([ABOVE, LINE], (let("b0", "gt0", "p0"),), when="b0"), ((-1.0, 1.0), 1.0, 1.0, (1.0, -1.0)),
         ((0.0, 0.5 + 0.5 * LOG), (0.0, 0.5 * LOG)), 2),
)  # fmt: skip
CASES = (
    case_of("regions", ROWS, [*moments("above", POWERS), *moments("below", POWERS)], 4e-15),
    case_of("one region", ROWS, moments("above", [(1, 2)]), 4e-15),
    case_of("borders", ROWS, moments("border", BORDERS), 1e-14),
    case_of("border and area", ROWS, [ABOVE, BELOW, *moments("border", POWERS[:4])], 4e-15),
    *SPECIAL,
)
by_name = pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)


def check_values(case: Case, found: np.ndarray) -> None:
    """The exact answers, to the tolerance of the case."""
    want = expected(case)
    np.testing.assert_array_equal(found[~np.isfinite(want)], want[~np.isfinite(want)])
    found, want = found[np.isfinite(want)], want[np.isfinite(want)]
    assert np.max(np.abs(found - want) / np.maximum(1.0, np.abs(want)), initial=0.0) <= case.tolerance


@by_name
@pytest.mark.parametrize("compiled", [pytest.param(compile_numpy, id="numpy"), pytest.param(compile_c, id="c", marks=needs_c)])
def test_values(case: Case, compiled: Callable[[Program], Any]) -> None:
    kernel = compiled(case.program)
    found = kernel(columns(case), case.n)
    check_values(case, found)
    if compiled is compile_numpy:
        assert kernel.met_ties(columns(case), case.n) == case.ties
    for i in range(case.n):
        alone = kernel([c[i : i + 1] if c.ndim else c for c in columns(case)], 1)
        np.testing.assert_allclose(alone[:, 0], found[:, i], rtol=4e-15, atol=1e-15)


@pytest.mark.parametrize("case", [pytest.param(c, marks=jax_is_slow if c.name != "a corner on the curve" else ()) for c in CASES],
                         ids=lambda c: c.name)  # fmt: skip
def test_values_in_jax(case: Case) -> None:
    check_values(case, compile_jax(case.program)(columns(case), case.n))


@pytest.mark.parametrize("case", CASES[2:5], ids=lambda c: c.name)
@pytest.mark.parametrize("limits", LIMITS, ids=str)
@needs_c
def test_limits_change_no_bit(case: Case, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    limits_change_no_bit(case, limits, monkeypatch)


@needs_c
def test_threads_change_no_bit() -> None:
    any_number_of_threads_gives_the_same(CASES[3], 40)


@needs_c
def test_the_text_is_c99_without_warnings(tmp_path: Path) -> None:
    lines_are_short(CASES)
    text_compiles_without_warnings(tmp_path, CASES)


@needs_c
@pytest.mark.slow
def test_behaviour_is_defined(tmp_path: Path) -> None:
    behaviour_is_defined(tmp_path, CASES)


# -- programs ------------------------------------------------------------------------------------------------------------

x, y = teg.vars("x y")
t, a, b, c, d, w, h, low = teg.params("t a b c d w h low")
G = a + b * x + c * y + d * x * y
AT = {"a": 0.3, "b": -0.9, "c": -0.7, "d": 1.1, "t": 0.1, "w": 0.8, "h": 1.3, "low": -0.2}
PROGRAMS = {
    "area": teg.integral(teg.bracket(t < G), (x, 0, 1), (y, 0, 1)),
    "two polynomials": teg.integral(teg.where(t < G, (1 + x * a) * (y - b) ** 2, x * y * c), (x, low, w), (y, -1, h)),
    "reversed bounds": teg.integral(teg.where(t < G, (1 + x * a) * (y - b) ** 2, x * y * c), (x, w, low), (y, -1, h)),
    "a factor in the outer variable": teg.integral(y * teg.integral(teg.bracket(t > G) * x, (x, 0, 1)), (y, 0, w)),
    "a function of it": 3 * c * teg.integral(teg.where(t < G, 1, 2) * y + 2 * x, (x, low, w), (y, -1, h)) ** 2,
}
OTHERS = {
    "a high degree": teg.integral(teg.where(t < G, x**4, 2), (x, low, w), (y, -1, h)),
    "two surfaces": teg.integral(teg.where(t < G, x, 2) * teg.bracket(x + y < t), (x, low, w), (y, -1, h)),
    "no polynomial": teg.integral(teg.where(t < G, teg.exp(x), 2), (x, low, w), (y, -1, h)),
    "bounds that are not a box": teg.integral(teg.bracket(t < G), (x, 0, y), (y, 0, 1)),
    "three variables": teg.integral(teg.bracket(t * teg.var("z") < G), (x, 0, 1), (y, 0, 1), (teg.var("z"), 0, 1)),
}


def kinds_of(p: Program) -> set[type]:
    return {type(s) for s in statements(p.body)}


def in_charts(e: teg.Expr, at: dict[str, float]) -> tuple[float, dict[str, float]]:
    """Value and gradient by pieces and charts."""
    wrt = [teg.param(name) for name in at]
    gradient = teg.eliminate(teg.grad(e, wrt))
    f = teg.compile(e, wrt, rule="adaptive", tol=1e-13)
    slopes = {}
    for p, slope in zip(wrt, gradient.children, strict=True):
        s = teg.compile(slope)
        slopes[p.name] = s({name: at[name] for name in s.parameters})
    return f(at), slopes


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", PROGRAMS)
def test_value_and_gradient(name: str, backend: str) -> None:
    e = PROGRAMS[name]
    at = {p: v for p, v in AT.items() if p in {q.name for q in parameters(e)}}
    f = teg.compile(e, [teg.param(p) for p in at], backend=backend)
    assert Hyperbola in kinds_of(f.program(0))
    value, slopes = f.value_and_grad(at)
    wanted, gradient = in_charts(e, at)
    assert value == pytest.approx(wanted, rel=1e-13, abs=1e-13)
    assert slopes == pytest.approx(gradient, rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("name", OTHERS)
def test_what_has_no_closed_form(name: str) -> None:
    e = OTHERS[name]
    at = {p.name: AT[p.name] for p in parameters(e)}
    f = teg.compile(e, [teg.param(p) for p in at])
    assert Hyperbola not in kinds_of(f.program(0))
    assert teg.check_gradient(f, at)


def test_other_rules_integrate_by_pieces() -> None:
    e = PROGRAMS["two polynomials"]
    at = {p.name: AT[p.name] for p in parameters(e)}
    value = teg.compile(e)(at)
    for options in ({"rule": "gauss"}, {"rule": "adaptive"}, {"order": 12}):
        f = teg.compile(e, **options)  # type: ignore[arg-type]
        assert Hyperbola not in kinds_of(f.program(0))
        assert f(at) == pytest.approx(value, rel=1e-8)


def test_value_and_gradient_are_one_statement() -> None:
    e, wrt = bilinear_pixel()
    f = teg.compile(e, wrt)
    assert kinds_of(f.program(0)) == kinds_of(f.program(1)) == {Assign, Hyperbola}
    assert [len(s.moments) for s in statements(f.program(1).body) if isinstance(s, Hyperbola)] == [9]
    ((alone,),) = [[s for s in statements(f.program(0).body) if isinstance(s, Hyperbola)]]
    assert (alone.ties, alone.scales) == ((), ())  # a region is no tie


def test_programs_grow_linearly() -> None:
    sizes = []
    for n in (4, 8, 16):
        terms = [teg.integral(teg.bracket(teg.param(f"a{i}") + b * x + c * y + d * x * y > t), (x, 0, 1), (y, 0, 1)) for i in range(n)]
        e = sum(terms, start=0 * t)
        f = teg.compile(e, list(parameters(e)))
        sizes.append(size(f.program(1)))
        assert sum(isinstance(s, Hyperbola) for s in statements(f.program(1).body)) == n
    assert sizes[2] - sizes[1] == 2 * (sizes[1] - sizes[0])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_border_on_a_side_is_the_mean_of_both_sides(backend: str) -> None:
    """Along x = 1 the curve leaves the box as t grows; and what is said of it."""
    e = teg.integral(teg.bracket((1 - x) * (1 + y) > t) * (1 + y), (x, 0, 1), (y, 0, 1))
    f = teg.compile(e, [t], backend=backend)
    assert f.grad(t=1e-13)["t"] == pytest.approx(-1.0, rel=1e-12)
    assert f.grad(t=-1e-13)["t"] == 0.0
    assert f.grad(t=0.0)["t"] == pytest.approx(-0.5, rel=1e-14)
    (met,) = f.diagnose(t=0.0)
    assert met.kind == "tie"
    assert "the bound x = 1" in met.surfaces


def test_estimates_hold() -> None:
    e = PROGRAMS["two polynomials"]
    f = teg.compile(e, [a, t])
    at = {p.name: AT[p.name] for p in parameters(e)}
    value, error = f.value_and_error(at)
    assert abs(value - in_charts(e, at)[0]) <= error <= 1e-12 * max(1.0, abs(value))


@pytest.mark.parametrize("backend", BACKENDS)
def test_pixels_of_an_image(backend: str) -> None:
    """A sum over an array of corner values is what its terms are, ties included."""
    corners = teg.array("C", 2)
    i, j = teg.index("i"), teg.index("j")

    def pixel(c00: Any, c10: Any, c01: Any, c11: Any) -> teg.Expr:
        value = (c00 * (1 - x) + c10 * x) * (1 - y) + (c01 * (1 - x) + c11 * x) * y
        return teg.integral(teg.where(value > t, x, 2 * y), (x, 0, 1), (y, 0, 1))

    n = 5
    whole = pixel(corners[i, j], corners[i + 1, j], corners[i, j + 1], corners[i + 1, j + 1])
    e = teg.sum(teg.sum(whole, (j, 0, teg.length(corners, 1) - 1)), (i, 0, teg.length(corners, 0) - 1))
    table = np.random.default_rng(2).random((n, n))
    table[2, :3], table[1, :4], table[3, :4] = 0.45, 0.3, 0.9
    value, slopes = teg.compile(e, [corners, t], backend=backend).value_and_grad({"C": table, "t": 0.45})
    names = teg.params("c00 c10 c01 c11")
    one = teg.compile(pixel(*names), [*names, t])
    total, by_corner, by_t = 0.0, np.zeros((n, n)), 0.0
    for p in range(n - 1):
        for q in range(n - 1):
            places = [(p, q), (p + 1, q), (p, q + 1), (p + 1, q + 1)]
            found, gradient = one.value_and_grad(dict(zip(("c00", "c10", "c01", "c11"), (table[k] for k in places), strict=True)), t=0.45)
            total, by_t = total + found, by_t + gradient["t"]
            for name, k in zip(("c00", "c10", "c01", "c11"), places, strict=True):
                by_corner[k] += gradient[name]
    assert value == pytest.approx(total, rel=1e-13)
    np.testing.assert_allclose(slopes["C"], by_corner, rtol=1e-12, atol=1e-12)
    assert slopes["t"] == pytest.approx(by_t, rel=1e-12)


def test_second_derivatives_keep_their_charts() -> None:
    """A boundary term in closed form is never differentiated: derivatives of the gradient are those of δ."""
    e = PROGRAMS["area"]
    f = teg.compile(e, [a, d, t])
    at = {p.name: AT[p.name] for p in parameters(e)}
    step = 1e-5
    hessian = f.hessian(at)
    for name in ("a", "d", "t"):
        ends = [f.grad(at | {name: at[name] + s}) for s in (step, -step)]
        for other in ("a", "d", "t"):
            assert hessian[other, name] == pytest.approx((ends[0][other] - ends[1][other]) / (2 * step), rel=1e-7)
    assert not any("border" in str(n) for n in teg.eliminate(teg.grad(e, t)).children)


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=needs_c), pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("level", [1e-3, 1e-9, -1e-12, 1e-15])
def test_a_border_beside_its_crossing_keeps_its_digits(level: float, backend: str) -> None:
    """The corners 1 - t and -1 - t have lost the digits of t: the derivative was off by 7e-5 at 1e-12."""
    x, y = teg.vars("x y")
    t = teg.param("t")
    f = teg.compile(teg.integral(teg.bracket(x * y > t), (x, -1, 1), (y, -1, 1)), [t], backend=backend)
    assert f.grad(t=level)["t"] == pytest.approx(2 * math.log(abs(level)), rel=1e-14)


@pytest.mark.parametrize("level", [1e-9, 1e-12])
def test_the_estimate_of_a_border_beside_its_crossing(level: float) -> None:
    """Where rounded corners have lost the digits, the estimate says so: the surface is (x - ⅓)·(y - ⅓) = t."""
    x, y = teg.vars("x y")
    t, a = teg.params("t a")
    f = teg.compile(teg.integral(teg.bracket((x - a) * (y - a) > t), (x, 0, 1), (y, 0, 1)), [t, a], backend="numpy")
    slopes, errors = f.grad_and_error(t=level, a=1 / 3)
    mpmath.mp.dps = 40
    low, high = mpmath.mpf(1 / 3), 1 - mpmath.mpf(1 / 3)
    exact = mpmath.log(level / high) - mpmath.log(high) + mpmath.log(level / low) - mpmath.log(low)
    assert abs(slopes["t"] - float(exact)) < errors["t"] < 1e10 * abs(slopes["t"] - float(exact)) + 1e-3
