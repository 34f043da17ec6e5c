"""Every intrinsic against the general path, `intrinsics=False`: value, gradient and estimates; that it is taken, and that it can be
turned off."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import teg
from teg import Expr
from teg.errors import OptionError
from teg.ir.expr import Param
from teg.ir.traverse import parameters
from teg.passes.intrinsics import INTRINSICS
from teg.program import Ellipse, Hyperbola, Integrate, Polygon, Rational, Segment, Stmt, statements
from tests.backends import test_ellipse as ellipses
from tests.backends import test_hyperbola as hyperbolas
from tests.backends import test_polygon as polygons
from tests.bench.scenes import bilinear_pixel, triangle_pixel

pytestmark = [pytest.mark.usefixtures("one_cache"), pytest.mark.filterwarnings("error")]
needs_c = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
x, y = teg.vars("x y")
a, b, t = teg.params("a b t")
TOL = 1e-12
"""Of the general path."""


@dataclass(frozen=True)
class Case:
    """A program of one intrinsic, and points."""

    intrinsic: str
    name: str
    program: Expr
    wrt: list[Param]
    at: dict[str, Any]

    def __str__(self) -> str:
        return f"{self.intrinsic}, {self.name}"


def pixel(order: int) -> Case:
    """A triangle over a pixel, with colours of a degree."""
    e, wrt = triangle_pixel(order)
    at = {p.name: 0.3 + 0.05 * i for i, p in enumerate(parameters(e))}
    at |= {"x0": 0.2, "y0": -0.3, "x1": 1.2, "y1": 0.4, "x2": 0.1, "y2": 0.9, "left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0}
    return Case("polygon", f"a pixel of degree {order}", e, wrt[:6], at)


def polygon_of(n: int, degree: int) -> Case:
    """Convex polygons about a box."""
    e, wrt = polygons.n_gon(n, polygons.COLOUR[degree]())
    return Case("polygon", f"{n} corners, degree {degree}", e, wrt[: 2 * n : n], polygons.places(n, 6))


def hyperbola(name: str) -> Case:
    """The programs of the test of hyperbolas."""
    e = hyperbolas.PROGRAMS[name]
    return Case("hyperbola", name, e, parameters(e), {p.name: hyperbolas.AT[p.name] for p in parameters(e)})


def image() -> Case:
    """A pixel of thresholded bilinear values."""
    e, wrt = bilinear_pixel()
    rng = np.random.default_rng(8)
    return Case("hyperbola", "a pixel", e, wrt[:5], {p.name: rng.random(8) for p in parameters(e)})


def ellipse(name: str) -> Case:
    """The programs of the test of ellipses."""
    e = ellipses.integral(name)
    return Case("ellipse", name, e, parameters(e), {p.name: ellipses.AT[p.name] for p in parameters(e)})


def pole(name: str, integrand: Expr) -> Case:
    e = teg.integral(integrand, (x, 0, 1))
    at = {"a": np.array([0.01, 0.3, 2.0]), "b": np.array([0.7, 1.1, -0.4]), "t": 0.6}
    return Case("pole", name, e, parameters(e), {p.name: at[p.name] for p in parameters(e)})


CASES = [
    *(pixel(order) for order in (0, 1, 2)),
    polygon_of(3, 2),
    polygon_of(5, 1),
    Case("polygon", "half a plane", teg.integral(teg.bracket(a * x + b * y < t) * x, (x, 0, 1), (y, 0, 1)), [a, b, t],
         {"a": 0.8, "b": np.array([0.3, -0.5, 1.0]), "t": 0.4}),
    *map(hyperbola, hyperbolas.PROGRAMS),
    image(),
    *map(ellipse, ellipses.PROGRAMS),
    pole("one over a line", 1 / (x + a)),
    pole("a quadratic over a line", (1 + x) ** 2 / (x + a)),
    pole("a cube below", x / (b * x + 1 + a) ** 3),
    pole("two integrands that share a loop", 1 / (x + a) + x / (x + a) ** 2),
    pole("a bracket beside it", teg.bracket(x < t) / teg.abs(x + a)),
]  # fmt: skip
SOME = [CASES[5], CASES[6], CASES[-7], CASES[-2]]
"""One case of each, for what is slow to compile."""
SLOW = [CASES[0], CASES[2], CASES[4], CASES[8], CASES[10]]
"""For C, by pieces."""
FAST = {"polygon": (Polygon, Segment), "hyperbola": (Hyperbola,), "ellipse": (Ellipse,), "pole": (Rational,)}


def kinds(f: teg.Evaluator) -> set[type[Any]]:
    """The statements of value and gradient, and the rules of its integrals."""

    def kind(s: Stmt) -> type[Any]:
        return type(s.rule) if isinstance(s, Integrate) else type(s)

    return {kind(s) for s in statements(f.program(1).body)}


def compiled(case: Case, backend: str, **options: Any) -> teg.Evaluator:
    return teg.compile(case.program, case.wrt, backend=backend, **options)


def close(value: Any, expected: Any, error: Any = 1e-11, doubt: Any = 0.0) -> None:
    """The same up to the estimates of both."""
    assert np.all(np.abs(value - expected) <= error + doubt)
    assert np.all(np.abs(value - expected) <= 1e-11 * np.maximum(1.0, np.abs(expected)))


def test_every_intrinsic_has_cases() -> None:
    assert {i.name for i in INTRINSICS} == {case.intrinsic for case in CASES} == FAST.keys()


@pytest.mark.parametrize("case", CASES, ids=str)
def test_it_is_taken_and_can_be_turned_off(case: Case) -> None:
    fast = {kind for some in FAST.values() for kind in some}
    assert kinds(compiled(case, "numpy")) & set(FAST[case.intrinsic])
    off = compiled(case, "numpy", intrinsics=False)
    assert not kinds(off) & fast
    for f, on in ((compiled(case, "numpy"), True), (off, False)):
        report = f.explain()
        assert report.data["options"]["intrinsics"] is on
        assert ("intrinsics=False" in str(report)) is not on
        rules = {row["rule"] for key in ("integrals", "boundary") for row in report.data[key]}
        assert on == any(rule.startswith("clipped") or rule.endswith(("closed form", "with a pole, exact")) for rule in rules)


@pytest.mark.parametrize(
    ("case", "backend"),
    [(c, "numpy") for c in CASES] + [pytest.param(c, "c", marks=[needs_c, *([pytest.mark.slow] if c in SLOW else [])]) for c in CASES],
    ids=str,
)
def test_the_general_path_agrees(case: Case, backend: str) -> None:
    f, g = compiled(case, backend), compiled(case, backend, intrinsics=False, tol=TOL)
    (value, slopes), (expected, others) = f.value_and_grad(case.at), g.value_and_grad(case.at)
    close(value, expected, 1e-11 * np.maximum(1.0, np.abs(expected)))
    assert slopes.keys() == others.keys() == {p.name for p in case.wrt}
    for name in slopes:
        close(slopes[name], others[name], 1e-11 * np.maximum(1.0, np.abs(others[name])))


@pytest.mark.parametrize(
    ("case", "backend"), [*((c, "numpy") for c in CASES), *(pytest.param(c, "c", marks=needs_c) for c in SOME)], ids=str
)
def test_the_general_path_is_within_the_estimates(case: Case, backend: str) -> None:
    f, g = compiled(case, backend), compiled(case, backend, intrinsics=False, tol=TOL)
    (value, error), (expected, doubt) = f.value_and_error(case.at), g.value_and_error(case.at)
    close(value, expected, error, doubt)
    assert np.all(error <= 1e-11 * np.maximum(1.0, np.abs(expected)))
    (slopes, errors), (others, doubts) = f.grad_and_error(case.at), g.grad_and_error(case.at)
    for name in slopes:
        close(slopes[name], others[name], errors[name], doubts[name])
        assert np.all(errors[name] <= 1e-10 * np.maximum(1.0, np.abs(others[name])))


@pytest.mark.parametrize("case", SOME, ids=str)
def test_the_general_path_agrees_in_jax(case: Case, x64: None) -> None:
    on, off = compiled(case, "jax"), compiled(case, "numpy", intrinsics=False, tol=TOL)
    (value, slopes), (expected, others) = on.value_and_grad(case.at), off.value_and_grad(case.at)
    np.testing.assert_allclose(value, expected, rtol=1e-11, atol=1e-12)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, others[name], rtol=1e-11, atol=1e-12)


def test_it_is_off_in_sums_and_in_other_libraries() -> None:
    pytest.importorskip("jax")
    k, array = teg.index("k"), teg.array("A", 1)
    area = teg.integral(teg.bracket(x + array[k] * y < t), (x, 0, 1), (y, 0, 1))
    e = teg.sum(area, (k, 0, teg.length(array, 0)))
    at = {"A": np.array([0.5, -0.3]), "t": 0.4}
    on, off = (teg.compile(e, [array, t], intrinsics=flag) for flag in (True, False))
    assert "Polygon" in repr(on.program(1))
    assert "Polygon" not in repr(off.program(1))
    assert off.explain().data["options"]["intrinsics"] is False
    value, slopes = on.value_and_grad(at)
    expected, others = off.value_and_grad(at)
    assert value == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(slopes["A"], others["A"], rtol=1e-11)
    plain = teg.integral(teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1))
    assert teg.evaluate(plain, {a: 0.5, t: 0.4}, intrinsics=False) == pytest.approx(0.16, rel=1e-12)
    f = teg.jax_function(plain, dtype="float32", intrinsics=False)
    assert float(f({"a": 0.5, "t": 0.4})) == pytest.approx(0.16, rel=1e-5)
    fun, _ = teg.scipy_function(plain, [a, t], intrinsics=False)
    assert fun(np.array([0.5, 0.4])) == pytest.approx(0.16, rel=1e-12)


def test_what_the_switch_may_be() -> None:
    with pytest.raises(OptionError, match="intrinsics="):
        teg.compile(teg.integral(x * t, (x, 0, 1)), intrinsics="no")  # type: ignore[arg-type]


THIN = [1e-4, 1e-8, 1e-12]
CORNERS = {"x·y": x * y, "x·(1 - y)": x * (1 - y), "(1 - x)·y": (1 - x) * y, "(1 - x)·(1 - y)": (1 - x) * (1 - y)}


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=needs_c), pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", CORNERS)
def test_a_region_between_a_hyperbola_and_two_sides(name: str, backend: str, request: pytest.FixtureRequest) -> None:
    """{XY < t} in the unit square has the area t·(1 + L), L = log(1/t), and ∫∫ XY = t²/4 + t²·L/2, ∫∫ X = t - t²/2. Areas beside u = 0
    have all digits, and others lack as many as the estimate says."""
    if backend == "jax":
        request.getfixturevalue("x64")
    thin = teg.bracket(CORNERS[name] < t)
    box = ((x, 0, 1), (y, 0, 1))
    area, moment = (teg.compile(teg.integral(e, *box), [t], backend=backend) for e in (thin, thin * x * y))
    for level in THIN:
        log = -np.log(level)
        exact, first, product = level * (1 + log), level - level**2 / 2, level**2 / 4 + level**2 * log / 2
        mixed = {"x·y": product, "(1 - x)·(1 - y)": exact - 2 * first + product}.get(name, first - product)
        for f, expected in ((area, exact), (moment, mixed)):
            value, error = f.value_and_error(t=level)
            assert abs(value - expected) <= 4 * error + 1e-15 * expected
        if name.startswith("x"):
            assert area(t=level) == pytest.approx(exact, rel=1e-14)
            assert area.value_and_error(t=level)[1] < 1e-13 * exact


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=needs_c)])
def test_a_hyperbola_in_a_long_box(backend: str) -> None:
    """{x·y < ½} over (0, a)×(0, 1) has the area ½·(1 + log(2a)): it was 4e-6 off at a = 1e10, with an estimate of 1e-13."""
    f = teg.compile(teg.integral(teg.bracket(x * y < 0.5), (x, 0, a), (y, 0, 1)), [a], backend=backend)
    for long in (1e4, 1e8, 1e12):
        value, error = f.value_and_error(a=long)
        exact = 0.5 * (1 + np.log(2 * long))
        assert value == pytest.approx(exact, rel=1e-14)
        assert error < 1e-12
