"""Measure the gradient of a whole picture on a CUDA device: time, how far above the bandwidth of the memory, and error.

python tests/bench/bench_gpu.py [--sizes 512 4096] [--triangles 2048 1000000] [--json FILE] [--device gpu|cpu]

A mesh over a random picture, constant colours: the loss and its gradients by all vertices and colours, operands and results on the device,
the median of several calls. The floor is the time in which what must be read and written at least (vertices, faces, colours, picture; both
gradients) moves at the bandwidth of a copy, measured in the same run. The error is the largest one of the gradient by the vertices over its
largest entry, against the C backend in double precision. Without a CUDA device it says so, and measures only if told --device cpu.
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

from tests.bench.rows import median_time

MISSING = "no CUDA device: the figures of a GPU are missing (--device cpu measures on the processor)"
COPIED = 2**28


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


def row(device: Any, by: str, size: int, triangles: int, dtype: str, speed: float) -> dict[str, Any]:
    """One row of the table."""
    from teg.examples.triangulation.image_loss import ImageLoss
    from teg.examples.triangulation.mesh import make_mesh
    from teg.examples.triangulation.scene import compile_scene
    from teg.examples.triangulation.sharded import ShardedLoss

    mesh, random = make_mesh(triangles, size), np.random.default_rng(0)
    target, colours = random.uniform(size=(size, size, 3)), random.uniform(size=(len(mesh.triangles), 3))
    loss = ShardedLoss(by, target, mesh.triangles, [device], dtype)
    operands, window, pairs = loss.operands(mesh.vertices, colours)
    start = time.perf_counter()
    _, (slopes, _) = loss.step(*operands, window=window)
    first = time.perf_counter() - start
    warm = median_time(lambda: loss.step(*operands, window=window))
    wanted = ImageLoss(compile_scene("c", threads=0), target, mesh.triangles).gradient(mesh.vertices, colours)
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


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[512, 4096])
    parser.add_argument("--triangles", type=int, nargs="+", default=[2048, 65536, 1_000_000])
    parser.add_argument("--device", choices=["gpu", "cpu"], default="gpu")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    device = find_device(options.device)
    if device is None:
        print(MISSING)
        return 0
    from tests.bench.run import table

    speed = bandwidth(device)
    print(f"{device.device_kind}: a copy moves {speed / 1e9:.0f} GB/s\n")
    rows = []
    for size in options.sizes:
        for triangles in options.triangles:
            if triangles * 4 <= size**2:
                rows += [row(device, by, size, triangles, d, speed) for by in ("pairs", "faces") for d in ("float32", "float64")]
                print(f"{size}², {triangles} triangles", file=sys.stderr, flush=True)
    print(table(rows))
    if options.json:
        options.json.write_text(json.dumps({"device": device.device_kind, "bytes a second": speed, "rows": rows}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
