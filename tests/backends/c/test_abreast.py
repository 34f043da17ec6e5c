"""Integrands at eight nodes side by side: against node by node, against 30 digits, and where there are exceptions."""

from __future__ import annotations

import ctypes
import math
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg.backends.c import integrals
from teg.backends.c.abreast import is_abreast
from teg.backends.c.build import load_library
from teg.backends.c.kernel import compile_c
from teg.backends.c.runtime import runtime
from teg.backends.numpy.kernel import compile_numpy
from teg.program import Adaptive, Assign, Integrate, Program, Tie, statements
from tests.backends.c_checks import in_c

pytestmark = in_c
x, y = teg.vars("x y")
a, b, t = teg.params("a b t")
BODIES = {
    "quotient": 1 / (1 + a * x * x),
    "root": teg.sqrt(1 + a * x) * teg.bracket(x < t),
    "exponential of a square": teg.exp(-a * x * x) * teg.bracket(x < t),
    "waves": teg.sin(a * x * x) * teg.cos(b + x**3) * teg.bracket(x < t),
    "a choice by the place": teg.exp(a * teg.minimum(x * x, b)) / (2 + teg.maximum(x, t)),
    "a choice by a parameter": teg.where(a < b, teg.exp(x * x), teg.sin(x * x)) * teg.bracket(x < t),
    "logarithm": teg.log(1 + a * x * x) * teg.bracket(x < t),
    "powers": (1 + a * x**2) ** -3 + (b + x) ** 2.5,
    "several values": teg.tuple(teg.exp(a * x * x), teg.sin(b * x * x), x / (1 + x)),
}
AT = {"a": np.array([0.4, 1.7, -0.3]), "b": np.array([0.9, 0.2, 1.3]), "t": np.array([0.3, 0.8, 2.0])}


def integral(body: teg.Expr, *domain: object) -> teg.Expr:
    return teg.integral(body, domain or (x, 0, 1))


def compiled(e: teg.Expr, side_by_side: bool, monkeypatch: pytest.MonkeyPatch) -> teg.Evaluator:
    with monkeypatch.context() as only:
        if not side_by_side:
            only.setattr(integrals, "is_abreast", lambda stmt: False)
        f = teg.compile(e, [a, b, t], backend="c")
        f.value_and_grad({name: v[:1] for name, v in AT.items()})
    return f


@pytest.mark.parametrize("name", BODIES)
def test_as_node_by_node(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    e = integral(BODIES[name])
    eight, one = (compiled(e, flag, monkeypatch) for flag in (True, False))
    loops = [s for s in statements(eight.program(1).body) if isinstance(s, Integrate)]
    assert any(map(is_abreast, loops))
    (value, slopes), (other, others) = eight.value_and_grad(AT), one.value_and_grad(AT)
    np.testing.assert_allclose(value, other, rtol=1e-14)
    for key, slope in slopes.items():
        np.testing.assert_allclose(slope, others[key], rtol=1e-12, atol=1e-14)


def test_the_batch_does_not_matter() -> None:
    f = teg.compile(integral(BODIES["waves"]), [a, b, t], backend="c")
    together = f(AT)
    assert [f({name: float(v[i]) for name, v in AT.items()}) for i in range(3)] == list(together)


@pytest.mark.parametrize("rate", [1e5, 3e7, 1e300, math.inf])
def test_large_angles_are_those_of_the_library(rate: float) -> None:
    """∫ sin(b + (1 + x)⁻¹) dx: angles of any size, of which the computed ones are exact numbers."""
    f, g = (teg.compile(integral(teg.sin(b + 1 / (1 + x))), [b], backend=name, inaccurate="ignore") for name in ("c", "numpy"))
    assert f(b=rate) == pytest.approx(g(b=rate), rel=1e-9, nan_ok=True)


def test_ties_are_noted() -> None:
    """∫₀¹ [p > 1]·eˣ dx, the condition at every node: it counts half where p is 1."""
    body = (
        Assign("v1", "sub", ("p0", 1.0)),
        Assign("b2", "tie", ("v1", 1.0, True, 0)),
        Assign("v3", "exp", ("x0",)),
        Assign("v4", "select", ("b2", "v3", 0.0)),
    )
    loop = Integrate("x0", 0.0, 1.0, (), (), None, body, ("v4",), ("v5",), Adaptive(1e-10, 8, 16))
    assert is_abreast(loop)
    program = Program(("p",), (loop,), ("v5",), (Tie(("p = 1", "all")),))
    places = np.array([0.5, 1.0, 1.5])
    for compiled in (compile_c, compile_numpy):
        np.testing.assert_allclose(compiled(program)([places], 3)[0], (math.e - 1) * np.array([0.0, 0.5, 1.0]), rtol=1e-13)


def test_a_side_along_a_side_counts_half() -> None:
    """One side of y⁴ < t runs along a side of the rectangle where t = 1."""
    e = teg.integral(teg.bracket(a * x**4 + y**4 < t) * (1 + x * x), (x, -1, 1), (y, -2, 1))
    f, g = (teg.compile(e, [a, t], backend=name, inaccurate="ignore") for name in ("c", "numpy"))
    for place, slope in ((0.999, 4 / 3 * 0.999**-0.75), (1.0, 1.0), (1.001, 2 / 3 * 1.001**-0.75)):
        assert f.grad(a=0.0, t=place) == pytest.approx(g.grad(a=0.0, t=place), abs=1e-12)
        assert f.grad(a=0.0, t=place)["t"] == pytest.approx(slope, abs=1e-12)
    assert str(f.diagnose(a=0.0, t=1.0)) == str(g.diagnose(a=0.0, t=1.0))


def random_places() -> dict[str, np.ndarray]:
    """Where each function is compared: usual places, and those where formulas meet or numbers are extreme."""
    rng = np.random.default_rng(0)
    quarters = np.arange(-700, 700) * (math.pi / 2)
    small = 10.0 ** rng.uniform(-300, 0, 99)
    turns = np.concatenate([rng.uniform(-10, 10, 999), rng.uniform(-1e6, 1e6, 999), quarters, np.nextafter(quarters, 9e9), small])
    numbers = np.concatenate([10.0 ** rng.uniform(-308, 308, 999), rng.uniform(0.5, 2, 999), 1 + small, [5e-324, 1e-310, 1.7e308]])
    return {"sine": turns, "cosine": turns, "log": numbers}


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    loops = [
        f"TEG_EXPORT void many_{name}(long n, const double *x, double *y) {{ for (long k = 0; k < n; k++) y[k] = teg_{name}(x[k]); }}"
        for name in random_places()
    ]
    first, *needed = runtime(loops)
    return load_library("\n".join([first, *needed, *loops]))


def at_all(library: ctypes.CDLL, name: str, places: np.ndarray) -> np.ndarray:
    found = np.empty_like(places)
    doubles = ctypes.POINTER(ctypes.c_double)
    getattr(library, f"many_{name}")(ctypes.c_long(places.size), *(v.ctypes.data_as(doubles) for v in (places, found)))
    return found


@pytest.mark.parametrize(
    ("name", "exact", "ulps"),
    [("sine", mpmath.sin, 1.5), ("cosine", mpmath.cos, 1.5), ("log", mpmath.log, 1.5)],
)
def test_the_functions_of_the_runtime(library: ctypes.CDLL, name: str, exact: Any, ulps: float) -> None:
    places = random_places()[name]
    found = at_all(library, name, places)
    with mpmath.workdps(40):
        true = [exact(mpmath.mpf(float(v))) for v in places]
        errors = [abs(float((mpmath.mpf(float(v)) - w) / w)) for v, w in zip(found, true, strict=True) if abs(w) > 1e-300]
    assert max(errors) < ulps * 2.0**-52


def test_the_functions_of_the_runtime_where_numbers_end(library: ctypes.CDLL) -> None:
    places = np.array([0.0, -0.0, math.inf, -math.inf, math.nan, -1.0])
    np.testing.assert_array_equal(at_all(library, "log", places), [-math.inf, -math.inf, math.inf, math.nan, math.nan, math.nan])
    np.testing.assert_array_equal(at_all(library, "sine", places[:2]), [0.0, 0.0])
