"""Integrands at eight nodes side by side: against node by node, against 30 digits, and where there are exceptions."""

from __future__ import annotations

import ctypes
import math

import mpmath
import numpy as np
import pytest

import teg
from teg.backends.c import printer
from teg.backends.c.abreast import is_abreast
from teg.backends.c.build import load_library
from teg.backends.c.runtime import runtime
from teg.program import Integrate, statements
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
    "powers": (1 + a * x**2) ** -3 + (b + x) ** 2.5,
    "several values": teg.tuple(teg.exp(a * x * x), teg.sin(b * x * x), x / (1 + x)),
}
AT = {"a": np.array([0.4, 1.7, -0.3]), "b": np.array([0.9, 0.2, 1.3]), "t": np.array([0.3, 0.8, 2.0])}


def integral(body: teg.Expr, *domain: object) -> teg.Expr:
    return teg.integral(body, domain or (x, 0, 1))


def compiled(e: teg.Expr, side_by_side: bool, monkeypatch: pytest.MonkeyPatch) -> teg.Evaluator:
    with monkeypatch.context() as only:
        if not side_by_side:
            only.setattr(printer, "is_abreast", lambda stmt: False)
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
    """[y·(t - ½) > 0] is a tie at every node where t = ½."""
    e = teg.integral(teg.bracket(y * (t - 0.5) > 0) / (1 + y * y), (y, 0, 1))
    f, g = (teg.compile(e, [t], backend=name, inaccurate="ignore") for name in ("c", "numpy"))
    for place in (0.4, 0.5, 0.6):
        assert f(t=place) == pytest.approx(g(t=place), abs=1e-15)
        assert str(f.diagnose(t=place)) == str(g.diagnose(t=place))


def test_the_sine_and_cosine_of_the_runtime() -> None:
    loop = """
    TEG_EXPORT void waves(long n, const double *x, double *sine, double *cosine)
    {
        for (long k = 0; k < n; k++) sine[k] = teg_sine(x[k]), cosine[k] = teg_cosine(x[k]);
    }
    """
    first, *needed = runtime([loop])
    waves = load_library("\n".join([first, *needed, loop])).waves
    rng = np.random.default_rng(0)
    quarters = np.arange(-700, 700) * (math.pi / 2)
    places = np.concatenate(
        [
            rng.uniform(-10, 10, 2000),
            rng.uniform(-1e6, 1e6, 2000),
            quarters,
            np.nextafter(quarters, 9e9),
            10.0 ** rng.uniform(-300, 0, 99),
            [0.0],
        ]
    )
    found = np.empty((2, places.size))
    doubles = ctypes.POINTER(ctypes.c_double)
    waves(ctypes.c_long(places.size), *(v.ctypes.data_as(doubles) for v in (places, found[0], found[1])))
    with mpmath.workdps(40):
        for wave, values in zip((mpmath.sin, mpmath.cos), found, strict=True):
            exact = [wave(mpmath.mpf(float(v))) for v in places]
            errors = [abs(float((mpmath.mpf(float(v)) - w) / w)) for v, w in zip(values, exact, strict=True) if w]
            assert max(errors) < 3e-16
