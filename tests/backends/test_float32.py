"""`dtype="float32"`: what goes in and comes out is single, what is between is not."""

from __future__ import annotations

import math
import pickle
import shutil
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import AccuracyError, OptionError
from tests.references import REFERENCES, Reference

COMPILER = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
BACKENDS = ["numpy", pytest.param("c", marks=COMPILER), pytest.param("jax", marks=pytest.mark.slow)]
x, y = teg.vars("x y")
t, a = teg.params("t a")
AREA = teg.integral(teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1))
CHOSEN = [r for r in REFERENCES if r.params][::7]


@pytest.fixture(autouse=True)
def needs_jax(request: pytest.FixtureRequest) -> None:
    if "jax" in request.node.name:
        pytest.importorskip("jax")


def as_list(values: Any) -> list[Any]:
    return [leaf for entry in values for leaf in as_list(entry)] if isinstance(values, tuple) else [values]


@pytest.mark.parametrize("backend", BACKENDS)
def test_scalars_and_arrays_are_single(backend: str) -> None:
    f = teg.compile(AREA, [t, a], backend=backend, dtype="float32")
    assert f.dtype == "float32"
    for at in ({"t": 0.5, "a": 0.25}, {"t": np.linspace(0.1, 0.9, 7), "a": 0.25}, {"t": np.float32([[0.1], [0.7]]), "a": [0.2, 0.3]}):
        value, gradient = f.value_and_grad(at)
        exact, slopes = teg.compile(AREA, [t, a]).value_and_grad({k: np.float32(v) for k, v in at.items()})
        for found, wanted in ((value, exact), (gradient["t"], slopes["t"]), (gradient["a"], slopes["a"]), (f(at), exact)):
            assert found.dtype == np.float32
            assert np.shape(found) == np.shape(wanted)
            np.testing.assert_array_equal(found, np.float32(wanted))
        hessian = f.hessian(at)
        assert {h.dtype for h in hessian.values()} == {np.dtype(np.float32)}


@pytest.mark.parametrize("backend", BACKENDS[:2])
@pytest.mark.parametrize("reference", CHOSEN, ids=lambda r: r.id)
def test_references(reference: Reference, backend: str) -> None:
    """Value and gradient to 1e-4 of those in double precision; in truth to the rounding of arguments and results."""
    e = reference.build()
    at = reference.params
    names = [teg.param(k) for k in at]
    if any(math.isnan(v) for v in at.values()):
        pytest.skip("nothing to compare")
    single = {k: float(np.float32(v)) for k, v in at.items()}
    f = teg.compile(e, names, backend=backend, dtype=np.float32, inaccurate="ignore")
    g = teg.compile(e, names, inaccurate="ignore")
    (value, slopes), (exact, gradient) = f.value_and_grad(at), g.value_and_grad(single)
    for found, wanted in ((value, exact), (tuple(slopes.values()), tuple(gradient.values()))):
        for one, other in zip(as_list(found), as_list(wanted), strict=True):
            assert one.dtype == np.float32
            np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_slivers_keep_their_digits(backend: str) -> None:
    """A strip of 1e-6 at coordinate 100 is 8 steps of single precision from its own width; inside all is double."""
    strip = teg.integral(teg.bracket((x > t) & (x < t + a)), (x, 0, 200))
    f = teg.compile(strip, [t, a], backend=backend, dtype="float32")
    value, gradient = f.value_and_grad(t=100.0, a=1e-6)
    assert value == pytest.approx(1e-6, rel=1e-6)
    assert gradient["a"] == 1.0
    assert gradient["t"] == 0.0


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_a_tie_is_one_of_the_rounded_numbers(backend: str) -> None:
    """0.1 and 0.1f are two numbers; both arguments are rounded before they are compared."""
    e = teg.integral(teg.bracket(x < t) * teg.bracket(x < a), (x, 0, 1))
    f = teg.compile(e, [t, a], backend=backend, dtype="float32")
    assert f.grad(t=0.1, a=float(np.float32(0.1))) == {"t": 0.5, "a": 0.5}
    assert f.grad(t=np.array([0.1]), a=float(np.float32(0.1)))["t"] == [0.5]
    assert teg.compile(e, [t, a]).grad(t=0.1, a=float(np.float32(0.1))) == {"t": 1.0, "a": 0.0}


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_too_large_for_single_precision_is_infinite(backend: str) -> None:
    f = teg.compile(t * t, [t], backend=backend, dtype="float32")
    assert f(t=1e30) == math.inf
    assert f(t=np.array([1e30, 1e10]))[0] == np.inf
    assert f(t=1e300) == math.inf
    assert f(t=np.array([1e300, 1.0]))[1] == 1.0
    assert math.isnan(f(t=math.nan))


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_columns_of_any_type_and_stride(backend: str) -> None:
    f = teg.compile(AREA, [t, a], backend=backend, dtype="float32")
    wanted = np.float32(f(t=np.float32([0.2, 0.4, 0.6]), a=0.5))
    table = np.linspace(0.0, 1.2, 13).astype(np.float32)
    for given in (table[2:7:2], table[6:1:-2][::-1], table[2:7:2].astype(">f4"), table[2:7:2].astype(np.float64), [0.2, 0.4, 0.6]):
        np.testing.assert_array_equal(f(t=given, a=0.5), f(t=np.float32(given), a=0.5))
        np.testing.assert_allclose(f(t=given, a=0.5), wanted, rtol=1e-6)


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_the_estimate_holds_the_rounding(backend: str) -> None:
    e = teg.integral(teg.exp(a * x) * teg.bracket(x < t), (x, 0, 1))
    f = teg.compile(e, [t, a], backend=backend, dtype="float32")
    at = {"t": np.float32(np.linspace(0.1, 0.9, 50)), "a": np.float32(0.7)}
    value, error = f.value_and_error(at)
    assert value.dtype == error.dtype == np.float32
    exact = np.expm1(0.7 * 0 + float(np.float32(0.7)) * at["t"].astype(float)) / float(np.float32(0.7))
    assert (np.abs(value.astype(float) - exact) <= error).all()
    assert (error < 2e-6).all()


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_reports_work(backend: str) -> None:
    f = teg.compile(AREA, [t, a], backend=backend, dtype="float32")
    assert f.diagnose(t=0.5, a=0.5) == []
    assert f.diagnose(t=0.0, a=0.0)
    assert f.evaluations(t=0.5, a=0.5) > 0
    assert "integral" in str(f.explain())
    copy = pickle.loads(pickle.dumps(f))
    assert copy.dtype == "float32"
    assert copy(t=0.5, a=0.25).dtype == np.float32
    with pytest.raises(OptionError):
        teg.check_gradient(f, t=0.5, a=0.5)
    g = teg.compile(teg.integral(x**a, (x, 0, 1)), backend=backend, dtype="float32", inaccurate="raise")
    with pytest.raises(AccuracyError):
        g(a=-1.5)
    assert g(a=1.0) == 0.5


def test_the_tolerance_is_that_of_the_type() -> None:
    e = teg.integral(teg.exp(teg.sin(a * x)), (x, 0, 1))
    double, single = (teg.compile(e, dtype=d) for d in ("float64", "float32"))
    assert single.evaluations(a=9.0) < double.evaluations(a=9.0)
    assert teg.compile(e, dtype="float32", tol=1e-10).evaluations(a=9.0) == double.evaluations(a=9.0)


@pytest.mark.parametrize(
    "dtype", ["float64", "float", np.float64, float, "d", np.dtype("float64"), "float32", np.float32, "f", "single", "f4"]
)
def test_names_of_the_types(dtype: object) -> None:
    assert teg.compile(AREA, dtype=dtype).dtype == np.dtype(dtype).name  # type: ignore[call-overload]


@pytest.mark.parametrize("dtype", ["float16", "longdouble", int, "complex64", None, 32, "", object(), "float128x", [np.float32]])
def test_other_types_are_refused(dtype: object) -> None:
    with pytest.raises(OptionError) as error:
        teg.compile(AREA, dtype=dtype)
    assert "'float64', 'float32'" in error.value.hint


@pytest.mark.slow
def test_jax_needs_no_flag() -> None:
    """JAX computes in double precision although the process is set to single, which it still is afterwards."""
    pytest.importorskip("jax")
    script = """
import jax, numpy as np, teg
x, t = teg.var("x"), teg.param("t")
e = teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, 1))
f, g = (teg.compile(e, dtype=d, backend=b) for d, b in (("float32", "jax"), ("float64", "numpy")))
at = np.float32(np.linspace(0.1, 0.9, 9))
value, gradient = f.value_and_grad(t=at)
assert value.dtype == gradient["t"].dtype == np.float32
assert (value == np.float32(g(t=at))).all()
assert not jax.config.jax_enable_x64
assert jax.numpy.ones(3).dtype == np.float32
try:
    teg.compile(e, backend="jax")
except teg.TegError as error:
    assert "jax_enable_x64" in error.hint
else:
    raise AssertionError
"""
    subprocess.run([sys.executable, "-W", "error", "-c", script], check=True)
