"""Functions compiled by themselves: the same numbers from every backend, and nothing done twice when a body is swapped."""

from __future__ import annotations

import ctypes
import gc
import pickle
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest

import teg
from teg.analysis import bodies
from teg.backends.c import build as c_build
from teg.backends.c import functions as c_functions
from teg.backends.c.standalone import standalone_c
from teg.backends.numpy import printer as numpy_printer
from teg.evaluator import derivation
from teg.ir.expr import Expr, Param
from teg.ir.function import Function
from teg.passes.program import link as linking
from tests.bench.scenes import shaded_brackets

x, y = teg.vars("x y")
u, v, k, t, a = teg.params("u v k t a")
WAVES = teg.sin(3 * u) * teg.cos(2 * v) + k * u
AT = {"t": 0.6, "a": 0.45, "k": 0.3}
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

SHADERS: dict[str, Expr] = {
    "waves": WAVES,
    "quadratic": u * v - k * u * u + 1,
    "constant": k + 0 * u,
    "number": 0 * u + 2.5,
    "rational": k * u / (1 + v * v + u * u),
    "roots": teg.sqrt(2 + teg.sin(u)) * teg.log(3 + v * v) ** 3 - k**-2,
}


def loss(shade: Function) -> Expr:
    """A half-plane in a box, its shade compared with a number."""
    return teg.integral(teg.bracket(x + a * y < t) * (shade(x, y * t) - 0.3) ** 2, (x, 0, 1), (y, 0, 1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("backend", "shader"),
    [
        *(("numpy", shader) for shader in SHADERS),
        pytest.param("c", "quadratic", marks=needs_compiler),
        *(pytest.param("c", shader, marks=[needs_compiler, pytest.mark.slow]) for shader in SHADERS if shader != "quadratic"),
    ],
)
def test_backends_agree_with_what_is_written_out(backend: str, shader: str) -> None:
    linked, plain = (loss(teg.function("shade", [u, v], SHADERS[shader], inline=i)) for i in (None, True))
    f, g = teg.compile(linked, [t, a, k], backend=backend), teg.compile(plain, [t, a, k])
    batch = {"t": np.array([0.2, 0.6, 1.3]), "a": 0.45, "k": np.array([0.3, -0.4, 1.0])}
    found, expected = f.value_and_grad(batch), g.value_and_grad(batch)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-12, atol=1e-14)
    for name in expected[1]:
        np.testing.assert_allclose(found[1][name], expected[1][name], rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(f.hessian(AT)["t", "a"], g.hessian(AT)["t", "a"], rtol=1e-10)
    value, error = f.value_and_error(AT)
    assert error < 1e-10 * max(1.0, abs(value))
    copy = pickle.loads(pickle.dumps(f))
    assert copy(AT) == f(AT)


@pytest.mark.slow
@pytest.mark.parametrize("shader", ["quadratic", "number"])
def test_jax_agrees_with_what_is_written_out(shader: str, x64: None) -> None:
    linked, plain = (loss(teg.function("shade", [u, v], SHADERS[shader], inline=i)) for i in (None, True))
    batch = {"t": np.array([0.2, 0.6, 1.3]), "a": 0.45, "k": np.array([0.3, -0.4, 1.0])}
    found, expected = (teg.compile(e, [t, a, k], backend=b).grad(batch) for e, b in ((linked, "jax"), (plain, "numpy")))
    for name in expected:
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-11, atol=1e-13)


def test_jax_in_one_variable(x64: None) -> None:
    f = teg.compile(teg.integral(teg.function("shade", [u], teg.sin(u) * k)(x), (x, 0, t)), [t, k], backend="jax")
    assert f.grad(t=1.0, k=2.0)["t"] == pytest.approx(2 * np.sin(1.0), rel=1e-14)
    assert "function_0" in f.source


# -- work that is not done twice -----------------------------------------------------------------------------------------


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Counter[str]:
    """What was done: derivations, schedules of programs and of bodies, texts printed, runs of the compiler by the kind of result."""
    done: Counter[str] = Counter()
    gc.collect()  # programs of earlier tests
    for kept in (linking.body_program, bodies.body_of):
        kept.cache_clear()

    def counting(module: Any, name: str, what: Callable[..., str]) -> None:
        real = getattr(module, name)

        def counted(*args: Any, **options: Any) -> Any:
            done[what(*args)] += 1
            return real(*args, **options)

        monkeypatch.setattr(module, name, counted)

    counting(derivation, "compiled_outputs", lambda *_: "derived")
    counting(derivation, "program_for", lambda *_: "scheduled")
    counting(linking, "schedule", lambda *_: "bodies")
    counting(c_functions, "print_kernel", lambda *_: "printed")
    counting(numpy_printer, "_Printer", lambda program: "printed" if program.functions else "bodies printed")
    counting(c_build, "compile_library", lambda text, target, *_: f"{target.suffix} {'kernel' if 'teg_kernel' in text else 'body'}")
    monkeypatch.setenv("TEG_CACHE_DIR", str(tmp_path))
    return done


def shaders(n: int, swapped: int | None = None) -> list[Function]:
    """n different ones; another one in the place of the swapped one."""
    wave = [teg.sin((i + 1) * u) + k * v * teg.exp(u) for i in range(n)]
    if swapped is not None:
        wave[swapped] = teg.cos(u * v) * k - teg.tanh(u)
    return [teg.function(f"shader {i}", [u, v], body) for i, body in enumerate(wave)]


def several(functions: list[Function]) -> Expr:
    """Brackets, each with a shader of its own."""
    terms = [teg.bracket(x < t * (i + 1) / 11) * f(x, a) for i, f in enumerate(functions)]
    return teg.integral(sum(terms[1:], start=terms[0]), (x, 0, 1))


def load(f: teg.Evaluator) -> None:
    """Compiles the kernels of value and gradient, which are compiled when they are called."""
    for order in (0, 1):
        f.kernel(order)


@needs_compiler
@pytest.mark.parametrize("n", [2, pytest.param(10, marks=pytest.mark.slow)])
def test_swapping_one_of_several_shaders_does_only_that_shader(n: int, work: Counter[str]) -> None:
    first = teg.compile(several(shaders(n)), [t, a, k], backend="c")
    load(first)
    once = Counter(work)
    assert (once["derived"], once["scheduled"], once["printed"], once[".o kernel"], once[".o body"]) == (2, 2, 2, 2, 2 * n)
    work.clear()
    second = teg.compile(several(shaders(n, swapped=n // 2)), [t, a, k], backend="c")
    load(second)
    assert work["derived"] == work["scheduled"] == work["printed"] == work[".o kernel"] == 0
    assert work[".o body"] == work[".so body"] == 2  # of the value, of value and gradient: the new body, and linking
    assert work["bodies"] == once["bodies"] // n
    plain = teg.compile(several(shaders(n, swapped=n // 2)), [t, a, k], functions="inlined")
    for name, expected in plain.grad(AT).items():
        assert second.grad(AT)[name] == pytest.approx(expected, rel=1e-12)
    assert first.grad(AT)["t"] != pytest.approx(second.grad(AT)["t"], rel=1e-3)


def test_swapping_costs_no_printing_of_the_rest(work: Counter[str]) -> None:
    first = teg.compile(several(shaders(10)), [t, a, k])
    load(first)
    once = Counter(work)
    second = teg.compile(several(shaders(10, swapped=0)), [t, a, k])
    load(second)
    assert (work["derived"], work["scheduled"], work["printed"]) == (once["derived"], once["scheduled"], once["printed"]) == (2, 2, 2)
    assert work["bodies printed"] - once["bodies printed"] == once["bodies printed"] // 10


def test_work_grows_with_what_is_new(work: Counter[str]) -> None:
    """The microbenchmark: 90 brackets, the shader swapped four times."""
    kept = []
    for _, e, wrt in shaded_brackets(90, 4):
        kept.append(teg.compile(e, wrt))
        load(kept[-1])
    assert (work["derived"], work["scheduled"], work["printed"]) == (2, 2, 2)


def test_what_nobody_uses_is_forgotten(work: Counter[str]) -> None:
    f = teg.compile(loss(teg.function("shade", [u, v], WAVES)), [t])
    del f
    teg.compile(loss(teg.function("shade", [u, v], WAVES * 2)), [t])
    assert work["derived"] == 2


def test_another_question_is_another_derivation(work: Counter[str]) -> None:
    e = loss(teg.function("shade", [u, v], WAVES))
    kept = [teg.compile(e, [t]), teg.compile(e, [a]), teg.compile(e, [t], tol=1e-8), teg.compile(e, [t], discontinuities="ignore")]
    assert work["derived"] == len(kept)
    kept.append(teg.compile(e, [t], memory=2**24))
    assert work["derived"] == len(kept) - 1


def test_threads_derive_once(work: Counter[str]) -> None:
    kept: list[Any] = []
    one = teg.compile(loss(teg.function("shade", [u, v], WAVES)), [t, a, k])
    work.clear()
    threads = [Thread(target=lambda f=f: kept.append(f.grad(AT))) for f in [one, *(pickle.loads(pickle.dumps(one)) for _ in range(3))]]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert work["derived"] == 1
    assert all(g == kept[0] for g in kept[1:])


# -- C -------------------------------------------------------------------------------------------------------------------


@needs_compiler
@pytest.mark.parametrize("options", [{"threads": 2}, {"dtype": "float32", "tol": 1e-6}, {"functions": "inlined"}])
def test_options(options: dict[str, Any]) -> None:
    f = teg.compile(loss(teg.function("shade", [u, v], WAVES)), [t, a, k], backend="c", **options)
    plain = teg.compile(loss(teg.function("shade", [u, v], WAVES, inline=True)), [t, a, k])
    batch = {"t": np.linspace(0.1, 1.4, 40), "a": 0.45, "k": 0.3}
    rtol = 1e-5 if "dtype" in options else 1e-12
    np.testing.assert_allclose(f.value_and_grad(batch)[1]["t"], plain.value_and_grad(batch)[1]["t"], rtol=rtol, atol=rtol / 100)
    if "dtype" not in options:  # then the tolerance is another one
        assert f.evaluations(AT) == plain.evaluations(AT)


@needs_compiler
def test_a_damaged_object_is_built_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEG_CACHE_DIR", str(tmp_path))
    e = loss(teg.function("shade", [u, v], WAVES))
    value = teg.compile(e, [t, a, k], backend="c")(AT)
    for file in tmp_path.rglob("*.so"):
        file.unlink()
    for file in tmp_path.rglob("*.o"):
        file.write_bytes(file.read_bytes()[:100])
    assert teg.compile(e, [t, a, k], backend="c")(AT) == value


@needs_compiler
def test_standalone_text_holds_the_functions(tmp_path: Path) -> None:
    shade = teg.function("shade", [u, v], WAVES)
    f = teg.compile(loss(shade), [t, a, k], backend="c")
    text, header = standalone_c(f.program(1), "scene")
    (tmp_path / "scene.c").write_text(text)
    (tmp_path / "scene.h").write_text(header)
    library = tmp_path / "scene.so"
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-ffp-contract=off"]
    subprocess.run(["cc", *flags, "-o", str(library), str(tmp_path / "scene.c"), "-lm"], check=True)
    values = [(ctypes.c_double * 1)(AT[name]) for name in f.parameters]
    pointers = (ctypes.POINTER(ctypes.c_double) * 3)(*values)
    results = [ctypes.c_double() for _ in range(4)]
    out = (ctypes.POINTER(ctypes.c_double) * 4)(*map(ctypes.pointer, results))
    assert ctypes.CDLL(str(library)).scene(ctypes.c_long(1), pointers, (ctypes.c_long * 3)(), None, out, None, 1) == 0
    value, gradient = f.value_and_grad(AT)
    assert [r.value for r in results] == pytest.approx([value, *(gradient[p.name] for p in f.wrt)], rel=1e-13)


@needs_compiler
def test_long_bodies_and_many_inputs() -> None:
    weights: list[Param] = [teg.param(f"w{i}") for i in range(60)]
    body = sum((w * teg.sin((i + 1) * u) * teg.cos(u * w) for i, w in enumerate(weights)), start=0 * u)
    f, g = (
        teg.compile(teg.integral(teg.function("long", [u], body)(x), (x, 0, t)), [t], backend="c", functions=h)
        for h in ("linked", "inlined")
    )
    at = {"t": 0.7, **{w.name: 0.1 + 0.01 * i for i, w in enumerate(weights)}}
    (value, slopes), (expected, others) = f.value_and_grad(at), g.value_and_grad(at)
    assert value == pytest.approx(float(expected), rel=1e-12)
    assert slopes["t"] == pytest.approx(float(others["t"]), rel=1e-12)
