"""Fixtures of all tests: the IR is verified between passes; C is compiled without optimisation, into one cache for all workers.

Compilers take most of the time of a test run, and most programs in tests are called for a few points. No result depends on the
flags. Tests of the C backend itself, of its lanes and of its threads compile as users do: the fixture `as_users_compile`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from math import inf

import pytest

from teg.backends.c import build, kernel

os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")  # read when JAX is imported
QUICK_IN_JAX = ("backends/jax/test_kernel.py", "interop/test_jax.py", "test_references.py::test_jax[", "test_floors.py")
"""Where JAX is tested in the quick run too: XLA takes half a second to some seconds for each program."""

THOROUGH = (
    "examples/test_mesh_network.py::test_the_network_learns",
    "end_to_end/test_conics.py::test_conics_without_a_gradient[an ellipse born in the square]",
    "end_to_end/test_conics.py::test_more_conics_at_random",
    "end_to_end/test_growth.py::test_thousands_of_brackets",
    "report/test_array_reports.py::test_a_one_sided_derivative",
    "report/test_array_reports.py::test_float32[jax]",
    "backends/c/test_frame.py::test_every_reference_compiles_in_parts",
    "backends/c/test_evaluator.py::test_a_thousand_brackets_are_right_whatever_the_flags",
    "backends/c/test_locate.py::test_no_undefined_behaviour",
    "backends/c/test_isolate.py::test_no_undefined_behaviour",
    "backends/test_bends.py::test_no_undefined_behaviour",
    "backends/test_hyperbola.py::test_behaviour_is_defined",
    "backends/test_any_roots.py::test_any_number_of_roots[jax]",
    "backends/test_float32.py::test_scalars_and_arrays_are_single[jax]",
    "backends/test_polygon.py::test_jax_agrees",
    "examples/test_sharded.py::test_eight_devices_give_what_numpy_gives[pairs]",
    "examples/test_sharded.py::test_a_descent_on_shares_is_the_same",
    "examples/test_charts.py::test_a_quick_chart_and_what_a_second_run_does",
    "passes/eliminate/test_steep.py::test_tiny_and_huge_literals_in_jax",
    "passes/normalise/test_corners.py::test_a_disk_far_away_in_jax",
    "passes/normalise/test_centre.py::test_value_and_gradient_in_jax[arcsine law]",
    "passes/normalise/test_steps.py::test_second_derivatives_where_cells_are_many",
    "passes/normalise/test_steps.py::test_deep_expressions",
    "passes/normalise/test_self_comparison.py::test_things_chosen_by_an_index_array[jax]",
    "analysis/test_singularities.py::test_the_gradient_in_jax[both bounds]",
    "end_to_end/test_properties.py::test_jax_agrees_with_numpy",
    "interop/test_jax.py::test_against_c[a hyperbola-xla]",
    "end_to_end/test_growth.py::test_an_expression_20_000_deep",
    "ir/test_pickle_and_threads.py::test_a_deep_sum_evaluates_and_differentiates",
    "backends/test_classification.py::test_exactly_touching[1-jax]",
    "passes/normalise/test_self_comparison.py::test_planes_over_a_box[jax]",
    "passes/normalise/test_self_comparison.py::test_a_thing_does_not_hide_itself[a quotient-jax]",
    "passes/eliminate/test_mapped.py::test_a_moving_centre",
    "end_to_end/test_conics.py::test_conics_without_a_gradient[two lines, one horizontal]",
    "backends/c/test_evaluator.py::test_any_number_of_threads_gives_the_same_bits[disk]",
    "examples/test_sharded.py::test_eight_devices_give_what_numpy_gives[faces]",
    "backends/jax/test_locate.py::test_value_and_agreement",
    "backends/jax/test_isolate.py::test_value_and_agreement",
    "examples/test_mesh_network.py::test_loss_gradient",
    "examples/test_mesh_network.py::test_without_the_motion",
)
"""The tests that take longest: `make thorough` runs them too."""

AS_RELEASED = kernel.OPTIMISATION, build.OPTIMISE
"""The C compiler's flags when no test has changed them."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is compiled by XLA is slow, but for the tests of the backend itself."""
    for item in items:
        if "jax" in item.nodeid.lower() and not any(name in item.nodeid for name in QUICK_IN_JAX):
            item.add_marker(pytest.mark.slow)
        if any(name in item.nodeid for name in THOROUGH):
            item.add_marker(pytest.mark.slow)
            item.add_marker(pytest.mark.thorough)


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
    """C without optimisation."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel, "OPTIMISATION", ((inf, ("-O0",)),))
        patch.setattr(build, "OPTIMISE", ("-O0",))
        yield


@pytest.fixture(scope="module")
def as_users_compile(quickly_compiled: None) -> Iterator[None]:
    """The flags that users' programs are compiled with, for the tests of a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel, "OPTIMISATION", AS_RELEASED[0])
        patch.setattr(build, "OPTIMISE", AS_RELEASED[1])
        yield


@pytest.fixture
def x64() -> Iterator[None]:
    """JAX in 64-bit mode during a test; the test is skipped without JAX."""
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)
