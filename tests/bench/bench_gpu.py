"""Measure gradients on a CUDA device: of whole pictures, and of batches of integrals.

python tests/bench/bench_gpu.py [--sizes 512 4096] [--triangles 2048 1000000] [--batches 1024 1048576] [--json FILE] [--device gpu|cpu]

A picture is a mesh over random pixels, with constant colours: the loss and its gradients by all vertices and colours, operands and results
on the device, the median of several calls. The floor is the time in which what must be read and written at least (vertices, faces, colours,
picture; both gradients) moves at the bandwidth of a copy, measured in the same run. A batch is one of the programs of `jax_kernels` at many
points, its value and gradient; beside it stands the time of an element in C on one thread. Errors are the largest ones over the largest
entry of the gradient, that by the vertices for a picture, against the C backend in double precision on the same numbers: on all of a
picture, and on the first elements of a batch. The file of `--json` is written after each row.
Without a CUDA device it says so, and measures only if told --device cpu.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.bench.jax_kernels import batched, programs
from tests.bench.rows import median_time

MISSING = "no CUDA device: the figures of a GPU are missing (--device cpu measures on the processor)"
COPIED = 2**28
COMPARED = 2**12
"""Elements of a batch that C evaluates: a million of the probit's take it a minute."""
WAYS = (("pairs", "float32"), ("pairs", "float64"), ("faces", "float32"))


def find_device(kind: str) -> Any:
    """JAX's first device of a kind, or None."""
    import jax

    try:
        return jax.devices(kind)[0]
    except RuntimeError:
        return None


def bandwidth(device: Any, length: int = COPIED) -> float:
    """Bytes a second that a copy of an array reads and writes."""
    import jax
    import jax.numpy as jnp

    whole = jax.device_put(jnp.zeros(length // 4, jnp.float32), device)
    copy = jax.jit(lambda v: v + 1)
    return 2 * length / median_time(lambda: copy(whole).block_until_ready(), warm=True)


def picture_row(device: Any, by: str, size: int, triangles: int, dtype: str, speed: float) -> dict[str, Any]:
    """One row of the table."""
    from teg.examples.triangulation.image_loss import ImageLoss
    from teg.examples.triangulation.mesh import make_mesh
    from teg.examples.triangulation.scene import compile_scene
    from teg.examples.triangulation.sharded import ShardedLoss

    mesh, random = make_mesh(triangles, size), np.random.default_rng(0)
    target, colours = random.uniform(size=(size, size, 3)), random.uniform(size=(len(mesh.triangles), 3))
    target, colours, vertices = (v.astype(dtype).astype(float) for v in (target, colours, mesh.vertices))
    loss = ShardedLoss(by, target, mesh.triangles, [device], dtype)
    operands, window, pairs = loss.operands(vertices, colours)
    start = time.perf_counter()
    _, (slopes, _) = loss.step(*operands, window=window)
    first = time.perf_counter() - start
    warm = median_time(lambda: loss.step(*operands, window=window))
    wanted = ImageLoss(compile_scene("c", threads=0), target, mesh.triangles).gradient(vertices, colours)
    width = np.dtype(dtype).itemsize
    least = width * (2 * mesh.vertices.size + 2 * colours.size + target.size) + 4 * mesh.triangles.size
    return {
        "picture": f"{size}²",
        "triangles": len(mesh.triangles),
        "shared by": by,
        "dtype": dtype,
        "pairs": pairs,
        "first call, s": first,
        "ms": 1e3 * warm,
        "ns a pair": 1e9 * warm / pairs,
        "over the floor": warm * speed / least,
        "error": float(np.max(np.abs(np.asarray(slopes) - wanted)) / np.max(np.abs(wanted))),
    }


def batch_row(device: Any, name: str, size: int) -> dict[str, Any]:
    """One row of the table of batches."""
    import jax

    import teg

    e, at, _ = programs()[name]
    wrt = [teg.param(k) for k in at]
    points = batched(at, size)
    own = {k: jax.device_put(v, device) for k, v in points.items()}
    f = teg.jax_function(e, wrt, kernel="xla")
    both = jax.jit(jax.value_and_grad(lambda p: f(p).sum()))
    start = time.perf_counter()
    _, slopes = jax.block_until_ready(both(own))
    first = time.perf_counter() - start
    warm = median_time(lambda: jax.block_until_ready(both(own)))
    evaluator = teg.compile(e, wrt, backend="c", threads=1)
    evaluator.value_and_grad(at)
    some = {k: v[:COMPARED] for k, v in points.items()}
    start = time.perf_counter()
    _, wanted = evaluator.value_and_grad(some)
    by_c = time.perf_counter() - start
    errors = [np.max(np.abs(np.asarray(slopes[k])[:COMPARED] - wanted[k])) / np.max(np.abs(wanted[k])) for k in at]
    return {
        "program": name,
        "batch": size,
        "first call, s": first,
        "ms": 1e3 * warm,
        "ns an element": 1e9 * warm / size,
        "C on one thread, ns": 1e9 * by_c / min(size, COMPARED),
        "error": float(max(errors)),
    }


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="*", default=[512, 4096])
    parser.add_argument("--triangles", type=int, nargs="+", default=[2048, 65536, 1_000_000])
    parser.add_argument("--batches", type=int, nargs="*", default=[1024, 2**20])
    parser.add_argument("--device", choices=["gpu", "cpu"], default="gpu")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    device = find_device(options.device)
    if device is None:
        print(MISSING)
        return 0
    from teg.backends.jax.precision import in_double_precision
    from tests.bench.run import table

    speed = bandwidth(device)
    print(f"{device.device_kind}: a copy moves {speed / 1e9:.0f} GB/s\n")
    found: dict[str, Any] = {"device": device.device_kind, "bytes a second": speed, "rows": [], "batches": []}

    def keep(kind: str, row: dict[str, Any]) -> None:
        found[kind].append(row)
        print(*row.values(), file=sys.stderr, flush=True)
        if options.json:
            options.json.write_text(json.dumps(found, indent=1))

    for size in options.sizes:
        for triangles in options.triangles:
            if triangles * 4 <= size**2:
                for by, dtype in WAYS:
                    keep("rows", picture_row(device, by, size, triangles, dtype, speed))
    with in_double_precision():
        for name in programs():
            for n in options.batches:
                keep("batches", batch_row(device, name, n))
    print("\n\n".join(table(rows) for rows in (found["rows"], found["batches"]) if rows), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
