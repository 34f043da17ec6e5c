"""Functions of JAX on several devices, and on those of several processes."""

from __future__ import annotations

import os
import socket
import subprocess
import sys

import pytest

jax = pytest.importorskip("jax")
pytest.importorskip("jax.extend")

SHARDED = """
import jax, numpy as np, teg
import jax.numpy as jnp
from jax.sharding import AxisType, NamedSharding, PartitionSpec as P

jax.config.update("jax_enable_x64", True)
assert jax.device_count() == 8
x, (t, a) = teg.var("x"), teg.params("t a")
f = teg.jax_function(teg.integral(teg.bracket(x < t) * teg.exp(teg.sin(a * x)), (x, 0, 1)))
at = {"t": jnp.linspace(-0.1, 1.1, 32), "a": jnp.asarray(1.3)}
loss = lambda p: (f(p) ** 2).sum()
wanted, second = jax.jit(jax.value_and_grad(loss))(at), jax.jit(jax.grad(jax.grad(lambda a: loss({**at, "a": a}))))(at["a"])

def same(found):
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-15)

for kind in (AxisType.Auto, AxisType.Explicit):
    mesh = jax.make_mesh((8,), ("batch",), axis_types=(kind,))
    with jax.set_mesh(mesh):
        split = {"t": jax.device_put(at["t"], NamedSharding(mesh, P("batch"))), "a": jax.device_put(at["a"], NamedSharding(mesh, P()))}
        compiled = jax.jit(jax.value_and_grad(loss)).lower(split).compile()
        same(compiled(split))
        assert "all-gather(" not in compiled.as_text() and "all-to-all(" not in compiled.as_text(), "the batch is moved between devices"
        assert jax.jit(f)(split).sharding.spec == P("batch")
mesh = jax.make_mesh((8,), ("batch",), axis_types=(AxisType.Auto,))
for checked in (True, False):
    parts = jax.shard_map(
        lambda p: jax.lax.psum(loss(p), "batch"), mesh=mesh, in_specs=({"t": P("batch"), "a": P()},), out_specs=P(), check_vma=checked
    )
    same(jax.jit(jax.value_and_grad(parts))(at))
np.testing.assert_allclose(jax.jit(jax.grad(jax.grad(lambda a: parts({**at, "a": a}))))(at["a"]), second, rtol=1e-13)
slopes = jax.shard_map(jax.grad(loss), mesh=mesh, in_specs=({"t": P("batch"), "a": P()},), out_specs={"t": P("batch"), "a": P()})
same((wanted[0], jax.jit(slopes)(at)))
mapped = jax.pmap(jax.vmap(lambda s: jax.grad(lambda s: loss({"t": s, "a": 1.3}))(s)))(at["t"].reshape(8, 4))
same((wanted[0], {"t": mapped.reshape(-1), "a": wanted[1]["a"]}))

k, V, F = teg.index("k"), teg.array("V", 2), teg.indices("F", 2)
term = teg.integral(teg.bracket(x * V[F[k, 0], 0] < V[F[k, 1], 1]) * (x + 1), (x, 0, 1))
g = teg.jax_function(teg.sum(term, (k, 0, teg.length(F, 0))))
random = np.random.default_rng(0)
points, pairs = jnp.asarray(random.uniform(0.2, 1.5, (6, 2))), jnp.asarray(random.integers(0, 6, (24, 2)))
wanted = jax.jit(jax.value_and_grad(lambda v, f: g(V=v, F=f)))(points, pairs)
along = lambda call: jax.jit(jax.grad(lambda v: (jax.grad(call)(v, pairs) * jnp.cos(v)).sum()))(points)
second = along(lambda v, f: g(V=v, F=f))
for checked in (True, False):  # terms are split, points are not
    parts = jax.shard_map(
        lambda v, f: jax.lax.psum(g(V=v, F=f), "batch"), mesh=mesh, in_specs=(P(), P("batch")), out_specs=P(), check_vma=checked
    )
    same(jax.jit(jax.value_and_grad(parts))(points, pairs))
np.testing.assert_allclose(along(parts), second, rtol=1e-12, atol=1e-13)
"""

PROCESSES = """
import sys
import jax, numpy as np, teg
from jax.sharding import AxisType, NamedSharding, PartitionSpec as P

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_cpu_collectives_implementation", "gloo")
jax.distributed.initialize(f"127.0.0.1:{sys.argv[2]}", num_processes=2, process_id=int(sys.argv[1]))
assert jax.device_count() == 4 and jax.local_device_count() == 2
x, (t, a) = teg.var("x"), teg.params("t a")
e = teg.integral(teg.bracket(x < t) * (1 + a * x) ** 2, (x, 0, 1))
f, exact = teg.jax_function(e), teg.compile(e, [t, a])
mesh = jax.make_mesh((4,), ("batch",), axis_types=(AxisType.Auto,))
many = np.linspace(-0.1, 1.1, 16)
split = jax.make_array_from_callback(many.shape, NamedSharding(mesh, P("batch")), lambda i: many[i])
value, slope = jax.jit(jax.value_and_grad(lambda a, s: (f(t=s, a=a) ** 2).sum()))(1.3, split)
values, slopes = exact.value_and_grad(t=many, a=1.3)
np.testing.assert_allclose(value, (values**2).sum(), rtol=1e-13)
np.testing.assert_allclose(slope, (2 * values * slopes["a"]).sum(), rtol=1e-13)
"""


def devices(count: int) -> dict[str, str]:
    """The environment of a process with so many devices."""
    return {**os.environ, "XLA_FLAGS": f"--xla_force_host_platform_device_count={count}", "JAX_PLATFORMS": "cpu"}


@pytest.mark.slow
def test_eight_devices() -> None:
    """jit with automatic and explicit shardings, shard_map, pmap; batches and terms of sums: all is as on one device."""
    subprocess.run([sys.executable, "-c", SHARDED], check=True, env=devices(8))


@pytest.mark.slow
def test_two_processes() -> None:
    """A batch on the devices of two processes, which are joined on the loopback."""
    with socket.socket() as chosen:
        chosen.bind(("127.0.0.1", 0))
        port = str(chosen.getsockname()[1])
    running = [subprocess.Popen([sys.executable, "-c", PROCESSES, str(rank), port], env=devices(2)) for rank in range(2)]
    try:
        assert [process.wait(timeout=120) for process in running] == [0, 0]
    finally:
        for process in running:
            process.kill()
            process.wait()
