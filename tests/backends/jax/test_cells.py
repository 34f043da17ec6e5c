"""Cells of choices in programs of XLA: values and derivatives as in C, transformations, devices, and where the host is called."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import teg
from teg.numerics.cells import Layout
from tests.end_to_end.test_nearest_scenes import mesh_program, random_mesh

jax = pytest.importorskip("jax")
pytestmark = pytest.mark.usefixtures("x64")


def split(given: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The real arrays, and those of indices."""
    return {n: np.asarray(given[n]) for n in "PDCB"}, {"F": given["F"]}


@pytest.fixture(scope="module")
def mesh() -> Any:
    return teg.compile(mesh_program(), backend="c")


@pytest.fixture(scope="module")
def in_xla() -> Any:
    return teg.jax_function(mesh_program(), kernel="xla")


def test_a_batch_under_jit_and_vmap(mesh: Any, in_xla: Any) -> None:
    """The axis of the map becomes lanes."""
    real, indices = split(random_mesh(1, 3))
    both = {name: np.stack([real[name], v]) for name, v in split(random_mesh(4, 3))[0].items()}
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(lambda p: in_xla({**p, **indices}))))(both)
    for i in range(2):
        value, expected = mesh.value_and_grad(**{n: v[i] for n, v in both.items()}, **indices)
        assert float(values[i]) == pytest.approx(float(value), abs=1e-13)
        for name in real:
            np.testing.assert_allclose(slopes[name][i], expected[name], atol=1e-12)


def test_products_with_the_hessian(mesh: Any, in_xla: Any) -> None:
    given = random_mesh(2, 4)
    real, indices = split(given)
    rng = np.random.default_rng(0)
    direction = {name: rng.normal(size=v.shape) for name, v in real.items()}
    product = jax.jit(lambda p, d: jax.jvp(jax.grad(lambda q: in_xla({**q, **indices})), (p,), (d,))[1])(real, direction)
    for name, expected in mesh.hvp(given, direction).items():
        np.testing.assert_allclose(product[name], expected, atol=1e-10 * max(1.0, np.abs(expected).max()))


def test_lists_of_candidates_and_power_cells() -> None:
    """Each box has its own list, and their lengths differ; the cells of one meet in a point."""
    k, p = teg.index("k"), teg.index("p")
    x, y = teg.vars("x y")
    S, F, R = teg.array("S", 2), teg.indices("F"), teg.indices("R")
    key = (x - S[F[k], 0]) ** 2 + (y - S[F[k], 1]) ** 2
    nearest = teg.minimum_of(key, (k, R[p], R[p + 1]), otherwise=0.7) * (1 + x)
    e = teg.sum(teg.integral(nearest, (x, p * 0.5, p * 0.5 + 0.5), (y, 0, 1)) ** 2, (p, 0, teg.length(R) - 1))
    given = {
        "S": np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75], [0.4, 0.1]]),
        "F": np.array([0, 1, 2, 3, 1, 4]),
        "R": np.array([0, 4, 6, 6]),
    }
    f = teg.jax_function(e, kernel="xla", indices={"F": given["F"], "R": given["R"]})
    value, slope = jax.jit(jax.value_and_grad(lambda sites: f(S=sites)))(given["S"])
    expected, gradient = teg.compile(e, backend="c").value_and_grad(**given)
    assert float(value) == pytest.approx(float(expected), abs=1e-13)
    np.testing.assert_allclose(slope, gradient["S"], atol=1e-13)


def test_no_second_derivative_where_four_cells_meet() -> None:
    """Lines through one point that separate as they move: NaN, as nothing says which pieces they leave. Moved together, they stay."""
    from teg.backends.jax.cells import cells_with_most

    sites = np.array([[0.25, 0.2], [0.75, 0.2], [0.25, 0.6], [0.75, 0.6]])
    shape = Layout(1, 0, 1, order=1)
    keys = np.column_stack([(sites**2).sum(axis=1), -2 * sites])
    together = np.column_stack([2 * sites[:, 0], np.full(4, -2.0), np.zeros(4)])  # all to the right
    apart = together * [[1], [0], [0], [0]]
    for rates, is_known in ((together, True), (apart, False)):
        rows = np.hstack([keys, np.eye(4, 3), rates, np.zeros((4, 3))])
        values, tables = jax.jit(lambda r: cells_with_most(shape, r, np.array([4]), np.zeros((1, 6)), 4))(rows)
        assert np.isfinite(values).all() == is_known
        assert np.isfinite(tables).all() == is_known


def lowered(count: int, in_xla: Any) -> str:
    """The value and gradient of a mesh of so many triangles, lowered for CUDA."""
    export = pytest.importorskip("jax.export")
    real, indices = split(random_mesh(0, count))
    exported = export.export(jax.jit(jax.value_and_grad(lambda p: in_xla({**p, **indices}))), platforms=["cuda"])(real)
    return str(exported.mlir_module())


def test_nothing_is_called_on_the_host(in_xla: Any) -> None:
    text = lowered(6, in_xla)
    assert "stablehlo.sort" in text
    assert not any(word in text for word in ("custom_call", "infeed", "outfeed", "stablehlo.send"))


def test_many_candidates_are_cut_on_the_host(mesh: Any, in_xla: Any) -> None:
    given = random_mesh(3, 20)
    real, indices = split(given)
    assert float(jax.jit(lambda p: in_xla({**p, **indices}))(real)) == pytest.approx(float(mesh(**given)), abs=1e-12)
    with pytest.raises((ValueError, NotImplementedError)):  # a callback is exported nowhere
        lowered(20, in_xla)


def test_a_report_says_how_many() -> None:
    explanation = teg.compile(mesh_program(), backend="jax").explain()
    assert explanation.data["choices"] == {"k": 11}
    assert "at most 11 candidates" in str(explanation)


DEVICES = """
import jax, numpy as np, teg
from jax.sharding import AxisType, PartitionSpec as P

jax.config.update("jax_enable_x64", True)
x, y = teg.vars("x y")
k, S = teg.index("k"), teg.array("S", 2)
key = (x - S[k, 0]) ** 2 + (y - S[k, 1]) ** 2
e = teg.integral(teg.minimum_of(key, (k, 0, 3)), (x, 0, 1), (y, 0, 1))
f, exact = teg.jax_function(e, kernel="xla"), teg.compile(e, backend="numpy")
mesh = jax.make_mesh((2,), ("batch",), axis_types=(AxisType.Auto,))
sites = np.random.default_rng(0).uniform(size=(8, 3, 2))
loss = lambda s: jax.lax.psum((f(S=s) ** 2).sum(), "batch")
total = jax.shard_map(loss, mesh=mesh, in_specs=P("batch"), out_specs=P())
value, slopes = jax.jit(jax.value_and_grad(total))(sites)
values, gradient = exact.value_and_grad(S=sites)
np.testing.assert_allclose(value, (values**2).sum(), rtol=1e-13)
np.testing.assert_allclose(slopes, 2 * values[:, None, None] * gradient["S"], rtol=1e-11, atol=1e-13)
"""


def test_two_devices() -> None:
    flags = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2", "JAX_PLATFORMS": "cpu"}
    subprocess.run([sys.executable, "-c", DEVICES], check=True, env={**os.environ, **flags})
