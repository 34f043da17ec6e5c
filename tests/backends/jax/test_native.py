"""Compiled C kernels inside of programs of JAX: the bits of the C backend, batches on several devices, warnings, errors, threads."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import CompilerError, OptionError

jax = pytest.importorskip("jax")
jnp = jax.numpy
pytestmark = [
    pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler"),
    pytest.mark.usefixtures("x64"),
]

x, y = teg.vars("x y")
t, a = teg.params("t a")
HALF_PLANE = teg.integral(teg.bracket(x + a * y < t) * teg.exp(a * x), (x, 0, 1), (y, 0, 1))
DISK = teg.integral(teg.bracket(x * x + y * y < t) * teg.exp(a * x), (x, -1, 1), (y, -1, 1))
OFTEN = teg.integral(teg.sin(t * x) ** 2, (x, 0, 1))
V, F, k = teg.array("V", 2), teg.indices("F", 2), teg.index("k")
FACES = teg.sum(teg.integral(teg.bracket(x * V[F[k, 0], 0] + y < V[F[k, 1], 1]) * (1 + k), (x, 0, 1), (y, 0, 1)), (k, 0, teg.length(F, 0)))
AT = {"V": np.array([[0.3, 0.7], [1.1, 0.5], [0.6, 0.9]]), "F": np.array([[0, 1], [1, 2], [2, 0], [1, 0]])}


def calls() -> int:
    from teg.backends.jax.native import calls
    from teg.evaluator.accuracy import AccuracyWarning

    return calls(AccuracyWarning)


@pytest.mark.parametrize("e", [HALF_PLANE, DISK], ids=["half-plane", "disk"])
@pytest.mark.parametrize("shape", [(), (1,), (5,), (300,), (3, 4)], ids=str)
def test_bits_are_those_of_the_c_backend(e: Any, shape: tuple[int, ...]) -> None:
    f, exact = teg.jax_function(e, kernel="c"), teg.compile(e, backend="c")
    at = {"t": np.linspace(0.2, 0.8, int(np.prod(shape))).reshape(shape), "a": 0.7}
    before = calls()
    value, slopes = jax.block_until_ready(jax.jit(jax.value_and_grad(lambda p: f(p).sum()))(at))
    assert calls() == before + 1, "value and gradient are one call, of the whole batch"
    wanted, gradient = exact.value_and_grad(at)
    np.testing.assert_allclose(value, np.sum(wanted), rtol=1e-15)
    assert np.array_equal(slopes["t"], gradient["t"])
    assert np.array_equal(jax.jit(f)(at), exact(at))
    assert np.array_equal(f(at), exact(at))


def test_arrays_and_known_indices() -> None:
    f, exact = teg.jax_function(FACES, indices={"F": AT["F"]}, kernel="c"), teg.compile(FACES, backend="c")
    before = calls()
    value, slopes = jax.block_until_ready(jax.jit(jax.value_and_grad(f))({"V": AT["V"]}))
    assert calls() == before + 1
    wanted, gradient = exact.value_and_grad(AT)
    assert value == wanted
    assert np.array_equal(slopes["V"], gradient["V"])
    many = AT["V"] * np.array([1.0, 0.9, 1.1])[:, None, None]
    mapped = jax.vmap(jax.grad(f))({"V": many})["V"]
    for v, slope in zip(many, mapped, strict=True):
        assert np.array_equal(slope, exact.value_and_grad({**AT, "V": v})[1]["V"])


def test_traced_indices_are_left_to_xla_which_looks_at_their_range() -> None:
    f = teg.jax_function(teg.sum(V[F[k, 0], 0] * t, (k, 0, 4)), kernel="c")
    before = calls()
    at = {"V": AT["V"], "F": AT["F"], "t": 2.0}
    assert jax.jit(f)(at) == 2.0 * AT["V"][AT["F"][:, 0], 0].sum()
    assert np.isnan(jax.jit(f)({**at, "F": AT["F"] + 2}))
    assert calls() == before
    with pytest.raises(teg.ArrayIndexError):
        f({**at, "F": AT["F"] + 2})


def test_a_missed_tolerance_warns_from_inside_of_a_compiled_program() -> None:
    f = jax.jit(teg.jax_function(OFTEN, kernel="c"))
    f({"t": 3.0}).block_until_ready()  # this one does not
    with pytest.warns(teg.AccuracyWarning, match="may miss the tolerance 1e-10"):
        f({"t": 1e7}).block_until_ready()


def test_warnings_that_are_errors_are_raised() -> None:
    f = jax.jit(teg.jax_function(OFTEN, kernel="c"))
    with pytest.raises(teg.AccuracyWarning, match="may miss"):
        f({"t": 1e7}).block_until_ready()


def test_a_missed_tolerance_may_be_an_error_or_nothing() -> None:
    with pytest.raises(Exception, match="may miss the tolerance"):
        jax.jit(teg.jax_function(OFTEN, kernel="c", inaccurate="raise"))({"t": 1e7}).block_until_ready()
    assert abs(jax.jit(teg.jax_function(OFTEN, kernel="c", inaccurate="ignore"))({"t": 1e7}) - 0.5) < 0.2


def test_options() -> None:
    with pytest.raises(OptionError, match="kernel='C'"):
        teg.jax_function(DISK, kernel="C")
    # in the given order: another file may have made a before t
    assert repr(teg.jax_function(DISK, [t, a])).startswith("<teg.jax_function(t, a) of ∫[y: -1..1]")
    copy = pickle.loads(pickle.dumps(teg.jax_function(DISK, kernel="c")))
    before = calls()
    assert copy(t=0.5, a=0.3) == teg.compile(DISK, backend="c")(t=0.5, a=0.3)
    assert calls() == before + 1


def test_without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setattr("teg.backends.c.build.zig_of_wheel", tuple)
    with pytest.raises(CompilerError, match="no C compiler"):
        teg.jax_function(HALF_PLANE, kernel="c")(t=0.5, a=0.3)
    assert teg.jax_function(HALF_PLANE)._kernel == "xla"


def test_a_version_of_jax_with_another_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is said, and programs are those of XLA, unless C was asked for."""

    from teg.backends.jax import native

    def rejected(category: Any) -> Any:
        raise CompilerError("the C compiler rejected the generated text", None, "unknown type name")

    monkeypatch.setattr(native, "_library", rejected)
    monkeypatch.setattr(native, "what_is_wrong", native.what_is_wrong.__wrapped__)
    with pytest.warns(RuntimeWarning, match="unknown type name") as caught:
        f = teg.jax_function(HALF_PLANE)
    assert caught[0].filename == __file__
    assert f._kernel == "xla"
    with pytest.raises(CompilerError, match="rejected"):
        teg.jax_function(HALF_PLANE, kernel="c")(t=0.5, a=0.3)


def test_second_and_third_derivatives() -> None:
    f, exact = teg.jax_function(HALF_PLANE, kernel="c"), teg.compile(HALF_PLANE, backend="c")
    at = {"t": 0.6, "a": 0.8}
    second = jax.jit(jax.hessian(f))(at)
    for (i, j), entry in exact.hessian(at).items():
        np.testing.assert_allclose(second[i][j], entry, rtol=1e-13)
    third = jax.jit(jax.jacfwd(jax.hessian(f)))(at)["t"]["t"]["a"]
    step = 1e-4
    around = [exact.hessian(t=0.6, a=0.8 + s)["t", "t"] for s in (step, -step)]
    np.testing.assert_allclose(third, (around[0] - around[1]) / (2 * step), rtol=1e-6)


def test_threads_share_one_function() -> None:
    f, exact = jax.jit(teg.jax_function(DISK, kernel="c")), teg.compile(DISK, backend="c")
    found: dict[int, Any] = {}
    places = np.linspace(0.1, 0.9, 200)

    def work(i: int) -> None:
        found[i] = [f({"t": places + 0.001 * i, "a": 0.3}) for _ in range(5)][-1]

    workers = [threading.Thread(target=work, args=(i,)) for i in range(6)]
    for w in workers:
        w.start()
    for w in workers:
        w.join()
    for i, values in found.items():
        assert np.array_equal(values, exact(t=places + 0.001 * i, a=0.3))


DEVICES = """
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
import teg
from jax.sharding import Mesh, NamedSharding, PartitionSpec as P
from teg.backends.jax.native import calls
x, y = teg.vars("x y"); t, a = teg.params("t a")
e = teg.integral(teg.bracket(x + a * y < t) * teg.exp(a * x), (x, 0, 1), (y, 0, 1))
f, exact = teg.jax_function(e, kernel="c"), teg.compile(e, backend="c")
assert jax.device_count() == 4
mesh = Mesh(np.array(jax.devices()), ("b",))
places = np.linspace(0.2, 0.8, 64)
shared = jax.device_put(places, NamedSharding(mesh, P("b")))
slopes = jax.jit(jax.grad(lambda s: f(t=s, a=0.7).sum()))
compiled = slopes.lower(shared).compile()
assert "all-gather" not in compiled.as_text()
before = calls(teg.AccuracyWarning)
found = jax.block_until_ready(compiled(shared))
assert calls(teg.AccuracyWarning) - before == 4, calls(teg.AccuracyWarning) - before
assert np.array_equal(found, exact.grad(t=places, a=0.7)["t"])
assert len(found.sharding.device_set) == 4
"""


def run(code: str, **environment: str) -> None:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **environment}, check=False)
    assert done.returncode == 0, done.stderr


def test_each_device_computes_its_share_of_a_batch() -> None:
    run(DEVICES, XLA_FLAGS="--xla_force_host_platform_device_count=4")


CACHED = """
import jax
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_compilation_cache_dir", {folder!r})
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
import teg
x, t = teg.var("x"), teg.param("t")
f = jax.jit(teg.jax_function(teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), kernel="c"))
assert abs(f(dict(t=0.5)) - 0.125) < 1e-15
"""


def test_a_second_process_uses_the_cache_of_jax(tmp_path: Path) -> None:
    code = CACHED.format(folder=str(tmp_path))
    run(code)
    kept = sorted(p.name for p in tmp_path.iterdir() if p.name.endswith("-cache"))
    run(code)
    assert kept == sorted(p.name for p in tmp_path.iterdir() if p.name.endswith("-cache"))


def test_other_platforms_get_programs_of_xla() -> None:
    from jax import export

    f = jax.jit(teg.jax_function(HALF_PLANE, kernel="c"))
    text = export.export(f, platforms=["cuda"])({"t": jnp.float64(0.5), "a": jnp.float64(0.3)}).mlir_module()
    assert "teg_native" not in text
