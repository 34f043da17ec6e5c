"""Evaluators on the C backend: pickling, threads, one point and a batch, what a call keeps and what it refuses."""

from __future__ import annotations

import ctypes
import pickle
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from decimal import Decimal
from fractions import Fraction
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.c import build as c_build
from teg.backends.c import kernel as c_kernel
from teg.backends.c.kernel import optimisation
from teg.errors import CompilerError, OptionError, ParameterError
from tests.backends.c_checks import in_c
from tests.bench import scenes

pytestmark = [*in_c, pytest.mark.usefixtures("as_users_compile")]
x, y = teg.vars("x y")
t, a = teg.params("t a")
DISK = teg.integral(teg.bracket((x - a) ** 2 + y * y < t) * teg.exp(x * y), (x, -1, 1), (y, -1, 1))
AREA = teg.integral(teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1))
BATCH = {"t": np.linspace(-0.2, 1.9, 1001), "a": np.linspace(0.4, -0.3, 1001)}


def same(one: Any, other: Any) -> bool:
    """To the last bit, NaN included."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return np.asarray(one).tobytes() == np.asarray(other).tobytes()


# Pickling


def value_and_grad(f: teg.Evaluator, at: dict[str, Any]) -> Any:
    return f.value_and_grad(at)


@pytest.mark.parametrize("options", [{}, {"dtype": "float32"}, {"threads": 2}, {"tol": 1e-6, "rule": "adaptive"}], ids=str)
def test_a_copy_has_its_options_and_results(options: dict[str, Any]) -> None:
    f = teg.compile(DISK, [t], backend="c", **options)
    f.hessian(t=0.5, a=0.1)
    g = pickle.loads(pickle.dumps(f))
    assert g.parameters == f.parameters
    assert repr(g) == repr(f)
    assert g.dtype == f.dtype
    assert g.kernel(1).source == f.kernel(1).source
    assert g.kernel(1).threads == f.kernel(1).threads == options.get("threads", 1)
    assert same(g.value_and_grad(BATCH), f.value_and_grad(BATCH))
    assert same(g.hessian(t=0.5, a=0.1), f.hessian(t=0.5, a=0.1))


@pytest.mark.slow
def test_in_other_processes() -> None:
    """A pool of fresh processes is sent the evaluator."""
    f = teg.compile(AREA, backend="c")
    wanted = f.value_and_grad(BATCH)
    parts = [{k: v[i::4] for k, v in BATCH.items()} for i in range(4)]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(value_and_grad, [f] * 4, parts))
    for i, (value, gradient) in enumerate(found):
        assert same(value, wanted[0][i::4])
        assert same(gradient["t"], wanted[1]["t"][i::4])


@pytest.mark.slow
def test_a_copy_in_another_process_is_not_compiled_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It comes from the cache: there is no compiler any more that could run."""
    monkeypatch.setenv("TEG_CACHE_DIR", str(tmp_path / "cache"))
    f = teg.compile(AREA, backend="c")
    f.grad(t=0.5, a=0.5)
    c_build.load_library(__import__("teg.backends.c.signals", fromlist=["SOURCE"]).SOURCE, optimise=("-O2",))
    (tmp_path / "f").write_bytes(pickle.dumps(f))
    (tmp_path / "cc").write_text('#!/bin/sh\n[ "$1" = --version ] && exec "$REAL" --version\nexit 1\n')
    script = (
        "import pickle, sys; import teg.backends.c.build as b;"
        "b.compile_library = lambda *_: sys.exit('compiled');"
        "f = pickle.load(open(sys.argv[1], 'rb')); print(f.grad(t=0.5, a=0.5)['t'])"
    )
    done = subprocess.run([sys.executable, "-c", script, str(tmp_path / "f")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert float(done.stdout) == f.grad(t=0.5, a=0.5)["t"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="fork")
@pytest.mark.parametrize("threads", [1, 2])
def test_after_a_fork(threads: int) -> None:
    """A child that a process with loaded kernels and used threads forks can call them: OpenMP's threads are not there any more."""
    script = """
import os, sys, numpy as np, teg
x, t = teg.var("x"), teg.param("t")
f = teg.compile(teg.integral(teg.bracket(x < t), (x, 0, 1)), backend="c", threads=int(sys.argv[1]))
many = np.linspace(0, 1, 100000)
wanted = f(t=many)
child = os.fork()
if child == 0:
    os._exit(0 if (f(t=many) == wanted).all() and f(t=0.5) == 0.5 else 1)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    subprocess.run([sys.executable, "-c", script, str(threads)], check=True, timeout=60)


# Threads


SCENES = {
    "triangle": (lambda: scenes.triangle_pixel(1), {}),
    "bilinear pixel": (scenes.bilinear_pixel, {}),
    "disk": (scenes.disk, {}),
    "half-planes": (lambda: scenes.half_planes(3), {}),
    "samples": (scenes.disk, {"rule": "qmc", "order": 64}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_any_number_of_threads_gives_the_same_bits(name: str) -> None:
    make, options = SCENES[name]
    e, wrt = make()
    options = {**options, "inaccurate": "ignore"}
    programs = {n: teg.compile(e, wrt, backend="c", threads=n, **options) for n in (1, 0, 2, 3, 8)}  # type: ignore[arg-type]
    rng = np.random.default_rng(7)
    at = {k: np.round(rng.uniform(-0.2, 1.2, 203), 2) for k in programs[1].parameters}  # round: ties too
    one = programs[1].value_and_grad(at)
    for n, f in programs.items():
        assert same(f.value_and_grad(at), one), n
        assert same(f.value_and_grad(at), one), n
    few = {k: v[:3] for k, v in at.items()}  # fewer points than threads
    assert same(programs[8].value_and_grad(few)[0], one[0][:3])
    assert same(programs[0](**{k: v[0] for k, v in at.items()}), one[0][0])


def test_evaluators_keep_their_own_number_of_threads() -> None:
    f, g = (teg.compile(AREA, backend="c", threads=n) for n in (1, 3))
    assert f.kernel(0).threads == 1  # type: ignore[attr-defined]
    assert g.kernel(0).threads == 3  # type: ignore[attr-defined]


def test_evaluators_with_threads_from_threads() -> None:
    fs = [teg.compile(DISK, backend="c", threads=n) for n in (1, 2, 0)]
    wanted = fs[0].value_and_grad(BATCH)
    assert same(fs[1].value_and_grad(BATCH), wanted)  # its library is the one of the third, whose kernel is made from threads
    with ThreadPoolExecutor(6) as pool:
        for found in pool.map(lambda i: fs[i % 3].value_and_grad(BATCH), range(12)):
            assert same(found, wanted)


@pytest.mark.parametrize("threads", [-1, 1.5, "2", True, None])
def test_other_numbers_of_threads_are_refused(threads: Any) -> None:
    with pytest.raises(OptionError) as error:
        teg.compile(AREA, backend="c", threads=threads)
    assert "0 for one a processor" in error.value.hint


# One point and a batch


NUMBERS = [0.5, 1, np.float64(0.5), np.float32(0.5), np.int64(1), np.array(0.5), Fraction(1, 2), Decimal("0.5"), True, np.bool_(True)]


@pytest.mark.parametrize("number", NUMBERS, ids=lambda v: type(v).__name__)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_point_is_a_batch_of_one(number: Any, dtype: str) -> None:
    f = teg.compile(AREA, [t, a], backend="c", dtype=dtype)
    one, batch = f.value_and_grad(number, a=0.3), f.value_and_grad(t=[float(number)], a=0.3)
    assert type(one[0]) is {"float64": float, "float32": np.float32}[dtype]
    assert same(one[0], batch[0][0])
    assert same(one[1]["t"], batch[1]["t"][0])
    assert f(number, 0.3) == f(t=number, a=0.3) == f({"t": number, a: 0.3}) == f({"t": number}, a=0.3) == one[0]


@pytest.mark.parametrize(
    ("args", "named"),
    [
        ((), {"t": 0.5}), ((0.5,), {}), ((0.5, 0.5, 0.5), {}), ((), {"t": 0.5, "b": 0.5}), ((), {"t": 0.5, "a": 0.5, "b": 1.0}),
        ((0.5,), {"t": 0.5}), ((0.5, 0.5), {"a": 0.5}), ((), {"t": "x", "a": 0.5}), ((), {"t": None, "a": 0.5}), ((0.5, 1j), {}),
        (({"t": 0.5},), {}), ((), {"t": 10**400, "a": 0.5}),
    ],
)  # fmt: skip
def test_calls_that_are_wrong(args: Any, named: dict[str, Any]) -> None:
    for dtype in ("float64", "float32"):
        with pytest.raises(ParameterError):
            teg.compile(AREA, [t, a], backend="c", dtype=dtype)(*args, **named)


@pytest.mark.filterwarnings("ignore::teg.evaluator.accuracy.AccuracyWarning")
def test_nan_and_infinity_at_a_point() -> None:
    f = teg.compile(AREA, [t, a], backend="c")
    g = teg.compile(AREA, [t, a])
    for number in (np.nan, np.inf, -np.inf, 10**18, 10**30, -1e300):
        assert same(f(number, 0.5), g(float(number), 0.5))
        assert same(f(np.array([number], dtype=float), 0.5)[0], g(float(number), 0.5))


def test_results_of_a_point_do_not_change_with_the_next() -> None:
    f = teg.compile(AREA, [t, a], backend="c")
    first = f.value_and_grad(0.5, 0.25)
    kept = pickle.loads(pickle.dumps(first))
    f.value_and_grad(0.75, 0.5)
    assert same(first, kept)


def test_a_missed_tolerance_is_told_of_a_point_too() -> None:
    p = teg.param("p")
    f = teg.compile(teg.integral(x**p, (x, 0, 1)), backend="c")
    with pytest.warns(teg.AccuracyWarning, match="p = -1.5"):
        f(p=-1.5)
    assert f(p=1.0) == 0.5


def test_maps_are_verified_at_a_point() -> None:
    r, p, c = *teg.vars("r p"), teg.param("c")
    e = teg.integral(teg.bracket(x * x + y * y < t), (x, -1, 1), (y, -1, 1))
    m = teg.Diffeomorphism({x: c * r, y: p}, inverse={r: x / c, p: y})
    f = teg.compile(e, maps=[m], backend="c")
    assert f(t=0.25, c=1.0) == pytest.approx(np.pi / 4)
    with pytest.raises(teg.DiffeomorphismError):
        f(t=0.25, c=0.0)


def test_columns_are_read_in_place() -> None:
    """Strided, reversed and broadcast ones; the caller's arrays stay as they are."""
    f = teg.compile(AREA, [t, a], backend="c")
    table = np.linspace(0, 1, 60).reshape(10, 6)
    before = table.copy()
    wanted = [f(u, v) for u, v in zip(table[::-2, 1], table[:5, 4], strict=True)]
    assert f(table[::-2, 1], table[:5, 4]).tolist() == wanted
    assert f(table[:, 1:2], table[0]).shape == (10, 6)
    assert f(table[:, 1:2], table[0])[3, 2] == f(table[3, 1], table[0, 2])
    assert f(table.T, 0.5).T.tolist() == f(table, 0.5).tolist()
    assert (table == before).all()
    table.setflags(write=False)
    assert f(table, table).shape == (10, 6)


def test_many_parameters_at_a_point() -> None:
    """More than there is room for on the C stack."""
    many = teg.params(" ".join(f"q{i}" for i in range(200)))
    f = teg.compile(sum((k * q for k, q in enumerate(many)), start=0 * many[0]), list(many), backend="c")
    value, gradient = f.value_and_grad(*([0.5] * 200))
    assert value == 0.5 * 199 * 100
    assert gradient["q7"] == 7.0


# The compiler


def test_long_texts_are_compiled_lightly() -> None:
    assert optimisation("x" * 1000) == ("-O3",)
    assert optimisation("x" * 400_000) == ("-O1",)
    assert optimisation("x" * 600_000)[0] == "-O1"
    assert set(c_build.LIGHT) < set(optimisation("x" * 600_000))
    assert optimisation("x" * 10_000_000) == ("-O0",)


@pytest.mark.slow
@pytest.mark.parametrize("flags", [("-O3",), ("-O1",), ("-O1", *c_build.LIGHT), ("-O0",)], ids=" ".join)
def test_results_are_right_whatever_the_flags(flags: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(c_kernel, "OPTIMISATION", ((float("inf"), flags),))
    e, wrt = scenes.tetrahedron()
    c, numpy = (teg.compile(e, wrt, backend=b) for b in ("c", "numpy"))
    found, wanted = c.value_and_grad(scenes.TETRAHEDRON), numpy.value_and_grad(scenes.TETRAHEDRON)
    assert found[0] == pytest.approx(wanted[0], rel=1e-13)
    assert found[1] == pytest.approx(wanted[1], rel=1e-12)
    assert ctypes.sizeof(ctypes.c_double) == 8


# When kernels are compiled


def test_a_kernel_is_compiled_when_it_is_first_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEG_CACHE_DIR", str(tmp_path))
    f = teg.compile(AREA, [t, a], backend="c")
    assert not [*tmp_path.glob("*/*.so")]
    f.grad(t=0.3, a=0.5)
    first = {*tmp_path.glob("*/*.so")}
    assert len(first) == 1
    f(t=0.3, a=0.5)
    assert {*tmp_path.glob("*/*.so")} > first


def test_a_missing_compiler_is_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> tuple[str, ...]:
        raise CompilerError("no C compiler", "cc")

    monkeypatch.setattr(c_build, "find_compiler", missing)
    with pytest.raises(CompilerError, match="no C compiler"):
        teg.compile(AREA, [t, a], backend="c")
