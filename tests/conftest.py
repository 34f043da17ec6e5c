"""Fixtures of all tests: the IR is verified between passes; C is compiled without optimisation, into one cache for all workers.

Compilers take most of the time of a test run, and most programs in tests are called for a few points. No result depends on the
flags. Tests of the C backend itself, of its lanes and of its threads compile as users do: the fixture `as_users_compile`; those of
convex pieces, whose text asks for the processor's vectors, compile for this machine: the fixture `for_this_machine`.
"""

from __future__ import annotations

import gc
import os
import sys
import weakref
from collections.abc import Generator, Iterator
from importlib import metadata
from math import inf
from pathlib import Path
from typing import Any

import pytest

from teg.backends.c import build, kernel
from teg.evaluator import derivation, kernels

os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")  # read when JAX is imported
EMITTERS = "xla_cpu_use_fusion_emitters"
"""XLA's way by MLIR to LLVM's text, that the options of a function of JAX turn off (`teg.backends.jax.options`). Programs of tests that
users would jit without these compile in half of the time so; `make thorough` compiles them as users do."""


def _with_jax_of(first: tuple[int, int], last: tuple[int, int]) -> bool:
    """Returns whether JAX is there, in a version from `first` to `last`: XLA ends the process at a flag that it does not know."""
    try:
        version = metadata.version("jaxlib")
    except metadata.PackageNotFoundError:
        return False
    return first <= tuple(int(part) for part in version.split(".")[:2]) <= last


if _with_jax_of((0, 8), (0, 10)):
    os.environ.setdefault("XLA_FLAGS", f"--{EMITTERS}=false")  # read when JAX compiles for the first time
QUICK_IN_JAX = (
    "backends/jax/test_kernel.py",
    "backends/jax/test_isolate.py::test_where_roots_are_not_asked_for_there_are_none",
    "interop/test_jax.py",
    "interop/test_jax_arguments.py",
    "test_references.py::test_jax[",
    "test_floors.py",
)
"""Where JAX is tested in the quick run too: XLA takes half a second to some seconds for each program."""


def _names(file: str) -> frozenset[str]:
    return frozenset(line for line in (Path(__file__).parent / file).read_text().splitlines() if not line.startswith("#"))


THOROUGH, SLOW = _names("thorough.txt"), _names("slow.txt")
"""The tests that only `make thorough` runs, and those that `make fast` leaves out: tests, or functions for all of their cases."""

AS_RELEASED = kernel.OPTIMISATION, build.OPTIMISE, build.MACHINE
"""The C compiler's flags when no test has changed them."""
QUICKLY = ("-O0", "-fno-asynchronous-unwind-tables", "-pipe", *(("-nostdlib",) if sys.platform == "linux" else ()))
"""Flags with which GCC and clang take the least time. On Linux the process itself has the C library: a linker that need not look for
it saves a tenth."""


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Thousands of tests that stay: the garbage collector looks for none of them, while they are collected and afterwards."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(50_000, 20, 50)  # expressions and JAX's programs make many objects that stay: a twentieth of a run is saved
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is compiled by XLA is slow, but for the tests of the backend itself; so is what is listed, and all that is thorough."""
    for item in items:
        name = item.nodeid.removeprefix("tests/")
        names = {name, name.partition("[")[0]}
        if not names.isdisjoint(THOROUGH):
            item.add_marker(pytest.mark.thorough)
        in_jax = "jax" in name.lower() and not any(part in name for part in QUICK_IN_JAX)
        if in_jax or not names.isdisjoint(SLOW) or item.get_closest_marker("thorough"):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True, scope="session")
def verified() -> Iterator[None]:
    """TEG_VERIFY=1 in all tests (for the session, as property tests allow no fixtures of one function)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEG_VERIFY", "1")
        yield


@pytest.fixture(autouse=True, scope="session")
def one_cache(pytestconfig: pytest.Config, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One cache of compiled C for all workers and runs: TEG_CACHE_DIR, or a folder in pytest's cache, which `--cache-clear` empties."""
    with pytest.MonkeyPatch.context() as patch:
        if not os.environ.get("TEG_CACHE_DIR"):
            cache = getattr(pytestconfig, "cache", None)  # None: pytest runs without its cache
            folder = cache.mkdir("kernels") if cache else tmp_path_factory.mktemp("kernels")
            folder.chmod(0o700)
            patch.setenv("TEG_CACHE_DIR", str(folder))
        yield


@pytest.fixture(autouse=True, scope="session")
def quickly_compiled() -> Iterator[None]:
    """C without optimisation, and for any processor: the instructions of new ones take GCC a sixth of its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel, "OPTIMISATION", ((inf, QUICKLY),))
        patch.setattr(build, "OPTIMISE", QUICKLY)
        patch.setattr(build, "MACHINE", ())
        yield


@pytest.fixture(scope="module")
def as_users_compile(quickly_compiled: None) -> Iterator[None]:
    """The flags that users' programs are compiled with, for the tests of a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel, "OPTIMISATION", AS_RELEASED[0])
        patch.setattr(build, "OPTIMISE", AS_RELEASED[1])
        patch.setattr(build, "MACHINE", AS_RELEASED[2])
        yield


@pytest.fixture(scope="module")
def for_this_machine(quickly_compiled: None) -> Iterator[None]:
    """C with all instructions of this processor, for the tests of a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "MACHINE", AS_RELEASED[2])
        yield


@pytest.fixture(autouse=True, scope="module")
def derived_once() -> Iterator[None]:
    """Equal programs of a module's tests are derived once: no backend has a part in that."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(derivation, "_derivations", {})
        yield


@pytest.fixture(autouse=True, scope="module")
def compiled_once() -> Iterator[None]:
    """A program that several tests of a module share, at other points for instance, is printed and compiled once for a backend."""
    built: dict[tuple[object, ...], tuple[object, object]] = {}
    build = kernels.build_kernel

    def once(program: object, options: Any, dtype: str = "float64", counted: bool = False) -> object:
        key = id(program), options.backend, options.threads, options.memory, options.dtype, dtype, counted
        if key not in built:
            built[key] = build(program, options, dtype, counted), program  # which is kept, so that its number stays its own
        return built[key][0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernels, "build_kernel", once)
        yield


@pytest.fixture(autouse=True)
def derived_anew(request: pytest.FixtureRequest) -> Iterator[None]:
    """A test that changes something, or reads the log, derives its own programs."""
    with pytest.MonkeyPatch.context() as patch:
        if not {"monkeypatch", "caplog"}.isdisjoint(request.fixturenames):
            patch.setattr(derivation, "_derivations", weakref.WeakValueDictionary())
        yield


@pytest.fixture(autouse=True)
def jax_as_before() -> Iterator[None]:
    """The precision of JAX again after a test that changed it, an example that a user would run for instance."""
    jax = sys.modules.get("jax")
    before = bool(jax and jax.config.jax_enable_x64)
    yield
    if jax := sys.modules.get("jax"):
        jax.config.update("jax_enable_x64", before)


@pytest.fixture
def x64() -> Iterator[None]:
    """JAX in 64-bit mode during a test; the test is skipped without JAX."""
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.fixture(scope="session")
def as_users_jit() -> dict[str, bool]:
    """Options of XLA with which a test that looks at the text of compiled programs has those of users."""
    return {EMITTERS: True} if os.environ.get("XLA_FLAGS") == f"--{EMITTERS}=false" else {}


@pytest.fixture
def x64_for_jax(request: pytest.FixtureRequest) -> None:
    """The fixture `x64` in tests whose name says that JAX is the backend."""
    if "jax" in request.node.name:
        request.getfixturevalue("x64")
