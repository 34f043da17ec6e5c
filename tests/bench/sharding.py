"""Measure how programs in JAX scale with devices: python tests/bench/sharding.py [--json FILE] [--small]. Some minutes.

Each row is a process of its own, bound to so many processors, in which JAX has so many devices; the last one is two processes, joined
by `jax.distributed`, each with a processor and a device. Columns are the medians of the time of: the loss of a picture and its gradient by
vertices and colours, shared out by pairs and by triangles (`teg.examples.triangulation.sharded`), and a batch of areas of disks under a
threshold, with their gradients. Speed-ups are over the first row, one device on one processor.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

RUNS = 5
PICTURE, BATCH = (192, 256), 2**12
SMALL = (24, 20), 2**6


def measured(small: bool, whole_picture: bool) -> dict[str, Any]:
    """The times in this process, in ms; a batch is that of all processes."""
    import jax
    from jax.sharding import AxisType, NamedSharding, PartitionSpec

    import teg
    from teg.examples.triangulation.mesh import make_mesh
    from teg.examples.triangulation.sharded import ShardedLoss
    from tests.bench.rows import median_time
    from tests.bench.scenes import disk

    jax.config.update("jax_enable_x64", True)
    (size, triangles), batch = SMALL if small else (PICTURE, BATCH)
    found: dict[str, Any] = {}
    if whole_picture:
        mesh, random = make_mesh(triangles, size), np.random.default_rng(0)
        target, colours = random.uniform(size=(size, size, 3)), random.uniform(size=(len(mesh.triangles), 3))
        for by in ("pairs", "faces"):
            loss = ShardedLoss(by, target, mesh.triangles)
            operands, window, _ = loss.operands(mesh.vertices, colours)
            found[f"picture by {by}, ms"] = 1e3 * median_time(
                lambda loss=loss, o=operands, w=window: loss.step(*o, window=w), RUNS, warm=True
            )
    e, _ = disk()
    area = teg.jax_function(e)
    mesh = jax.make_mesh((jax.device_count(),), ("batch",), axis_types=(AxisType.Auto,))
    thresholds = np.random.default_rng(1).uniform(0.2, 1.5, batch)
    t = jax.make_array_from_callback(thresholds.shape, NamedSharding(mesh, PartitionSpec("batch")), lambda i: thresholds[i])
    step = jax.jit(jax.value_and_grad(lambda a, b, t: (area(t=t, a=a, b=b) ** 2).sum(), (0, 1, 2)))
    found["batch of disks, ms"] = 1e3 * median_time(lambda: step(0.1, -0.2, t)[0].block_until_ready(), RUNS, warm=True)
    return found


def child(devices: int, processors: list[int], small: bool, rank: int = -1, port: int = 0) -> subprocess.Popen[str]:
    """A process that measures, bound to processors; of two if it has a rank."""
    flags = {"XLA_FLAGS": f"--xla_force_host_platform_device_count={devices}", "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, __file__, "--child", str(rank), str(port), *(["--small"] if small else [])]
    bind = (lambda: os.sched_setaffinity(0, processors)) if hasattr(os, "sched_setaffinity") else None
    return subprocess.Popen(command, env=os.environ | flags, stdout=subprocess.PIPE, text=True, preexec_fn=bind)


def answer(process: subprocess.Popen[str]) -> dict[str, Any]:
    out, _ = process.communicate(timeout=900)
    if process.returncode:
        raise SystemExit(process.returncode)
    return dict(json.loads(out.splitlines()[-1]))


def rows(small: bool) -> list[dict[str, Any]]:
    """The table."""
    every = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    shapes = [(1, 1), (1, len(every)), (len(every), len(every)), (4 * len(every), len(every))]
    shapes = [s for k, s in enumerate(shapes) if s not in shapes[:k]]
    found = []
    for devices, count in shapes:
        found.append({"devices": devices, "processors": count, **answer(child(devices, every[:count], small))})
    if len(every) > 1:
        with socket.socket() as chosen:
            chosen.bind(("127.0.0.1", 0))
            port = chosen.getsockname()[1]
        pair = [child(1, [every[rank]], small, rank, port) for rank in range(2)]
        times = [answer(process) for process in pair]
        both = {key: max(t[key] for t in times) for key in times[0]}
        found.append({"devices": "1 in each of 2 processes", "processors": 2, **both})
    columns = [key for key in found[0] if key.endswith("ms")]
    for row in found:
        row.update({key.replace("ms", "×"): found[0][key] / row[key] for key in columns if key in row})
        row.update({key: "" for k in columns for key in (k, k.replace("ms", "×")) if key not in row})
    heads = ["devices", "processors", *(h for k in columns for h in (k, k.replace("ms", "×")))]
    return [{h: row[h] for h in heads} for row in found]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="seconds a row, for a test")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--child", nargs=2, type=int, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.child:
        rank, port = options.child
        if rank >= 0:
            import jax

            jax.config.update("jax_cpu_collectives_implementation", "gloo")
            jax.distributed.initialize(f"127.0.0.1:{port}", num_processes=2, process_id=rank)
        print(json.dumps(measured(options.small, rank < 0)))
        return 0
    from tests.bench.run import table

    found = rows(options.small)
    print(table(found))
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
