"""The main demonstration: a photograph in triangles, by gradient descent on an exact integral.

photo → pixels → mesh → (gradient of the compiled program → step → best colours) × steps → pictures
"""

from __future__ import annotations

import hashlib
import os
import time
from dataclasses import asdict, dataclass
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np

from teg.errors import InputError, MissingPackageError
from teg.examples.descent_record import RecordedDescent
from teg.examples.harness import default_backend, demo_command, machine, ratio, require_packages, result_folder, versions, write_report
from teg.examples.triangulation.descent import State, first_state, next_state
from teg.examples.triangulation.image_loss import ImageLoss, PictureLoss
from teg.examples.triangulation.mesh import make_mesh, signed_areas
from teg.examples.triangulation.scene import compile_scene

STEPS = 120
SIZES = (8, 4096)
PACKAGES = {"PIL": "pillow", "matplotlib": "matplotlib", "tqdm": "tqdm"}
PICTURES = ("target.png", "before.png", "after.png", "loss.png", "mesh.svg")
NOTHING_MOVES = (
    "the gradient by the vertices is exactly 0: automatic differentiation does not see that an edge moves, "
    "so no vertex did (with --discontinuities exact, the default, they do)"
)


@dataclass(frozen=True)
class Options:
    """All options of a run except the picture itself."""

    photo: str | None
    triangles: int
    size: int
    steps: int
    discontinuities: str
    backend: str
    seed: int
    shared_by: str | None

    def check(self) -> None:
        """Raises InputError for numbers that make no picture."""
        if not SIZES[0] <= self.size <= SIZES[1]:
            raise InputError(f"a picture of {self.size} pixels a side is not possible", None, f"between {SIZES[0]} and {SIZES[1]}")
        if not 2 <= self.triangles <= self.size**2:
            raise InputError(
                f"a mesh of {self.triangles} triangles for {self.size}² pixels is not possible", None, "at least 2, at most one a pixel"
            )
        if self.steps < 0:
            raise InputError(f"{self.steps} steps are not possible", None, "0 or more")
        if self.seed < 0:
            raise InputError(f"the seed {self.seed} is negative", None, "0, 1, 2, …")
        if self.shared_by and self.backend != "jax":
            raise InputError(f"a picture is shared between JAX's devices, not in the backend {self.backend!r}", None, "backend jax")


def run_triangulation(
    photo: str | Path | None = None,
    triangles: int = 300,
    size: int = 256,
    steps: int = STEPS,
    out: str | Path = "out/triangulation",
    discontinuities: str = "exact",
    backend: str | None = None,
    progress: bool = True,
    resume: bool = False,
    seed: int = 0,
    shared_by: str | None = None,
) -> dict[str, Any]:
    """Approximates a photo by triangles of constant colour; writes pictures to `out`, returns the contents of run.json.

    `photo` is any file that Pillow reads (None: scikit-image's astronaut), cropped and resized to size² pixels. `backend` None is "c" if
    there is a C compiler, else "numpy". `discontinuities="ignore"` differentiates like plain automatic differentiation. `shared_by`
    "pairs" or "faces" computes on all devices of JAX, each of which has some of the pairs of a triangle and a pixel, or of the
    triangles. `resume` continues the run whose checkpoint is in `out`, up to `steps` in all. Ctrl-C ends the descent, not the writing:
    the report says "interrupted".

    Raises InputError for a photo, number, folder or checkpoint that cannot be used, MissingPackageError.
    """
    require_packages("triangulation", PACKAGES, progress)
    from teg.examples.photo import read_target

    chosen = backend or ("jax" if shared_by else default_backend())
    name = None if photo is None else str(photo)
    options = Options(name, triangles, size, steps, discontinuities, chosen, seed, shared_by)
    options.check()
    target = read_target(photo, size)
    folder = result_folder(Path(out))
    started = time.perf_counter()
    target = np.ascontiguousarray(target, dtype=float)
    mesh = make_mesh(triangles, size, seed)
    image = _loss(options, target, mesh.triangles)
    identity = {k: getattr(options, k) for k in ("triangles", "size", "seed", "discontinuities")}
    identity["target"] = hashlib.sha256(target.tobytes()).hexdigest()
    start = first_state(mesh, image)
    run = RecordedDescent(start, lambda s: next_state(mesh, image, s), folder / "checkpoint.npz", identity, resume)
    image.gradient(mesh.vertices, start.colours)  # derived and compiled now, as part of the set-up
    image.pairs, image.seconds = 0, 0.0
    setup = time.perf_counter() - started
    interrupted = run.descend(steps, progress)

    _draw(folder, run, mesh.triangles, target)
    report = _outcome(run, mesh.triangles, discontinuities) | {
        "interrupted": interrupted,
        "seconds": {"setup": setup, "descent": run.seconds, "kernels": image.seconds},
        "pairs_per_second": image.pairs / image.seconds,
        "options": asdict(options),
        "target_sha256": identity["target"],
        "command": _command(options, out),
        "versions": versions(),
        "machine": machine(),
        "pictures": [str(folder / picture) for picture in PICTURES],
        "losses": run.losses,
    }
    write_report(folder / "run.json", report)
    return report


def _draw(folder: Path, run: RecordedDescent[State], triangles: np.ndarray, target: np.ndarray) -> None:
    """Draws the mesh before and after, the target and the loss."""
    from teg.examples.triangulation import pictures

    size = len(target)
    for picture, shown in (("before.png", run.start), ("after.png", run.state)):
        pictures.draw_mesh(folder / picture, shown.vertices, triangles, shown.colours, size)
    pictures.draw_target(folder / "target.png", target)
    pictures.draw_loss(folder / "loss.png", run.losses)
    pictures.write_svg(folder / "mesh.svg", run.state.vertices, triangles, run.state.colours, size)


def _outcome(run: RecordedDescent[State], triangles: np.ndarray, discontinuities: str) -> dict[str, Any]:
    """Returns the part of the report on the loss and the mesh."""
    state = run.state
    moved = np.linalg.norm(state.vertices - run.start.vertices, axis=1)
    return {
        "loss": {"start": run.losses[0], "end": run.losses[-1], "ratio": ratio(run.losses[-1], run.losses[0])},
        "steps": len(run.losses) - 1,
        "converged": state.stuck,
        "note": NOTHING_MOVES if state.stuck and discontinuities == "ignore" else "",
        "mesh": {
            "triangles": len(triangles),
            "vertices": len(state.vertices),
            "largest_movement": float(moved.max()),
            "smallest_area": float(signed_areas(state.vertices, triangles).min()),
        },
    }


def _loss(options: Options, target: np.ndarray, triangles: np.ndarray) -> PictureLoss:
    if options.shared_by:
        if util.find_spec("jax") is None:
            raise MissingPackageError("a picture is computed on the devices of JAX", None, 'pip install "teg[jax]"')
        from teg.examples.triangulation.sharded import ShardedLoss

        return ShardedLoss(options.shared_by, target, triangles, discontinuities=options.discontinuities)
    return ImageLoss(compile_scene(options.backend, options.discontinuities, threads=os.cpu_count() or 1), target, triangles)


def _command(options: Options, out: str | Path) -> str:
    names = ("triangles", "size", "steps", "seed", "discontinuities", "backend")
    shared = ["--shared-by", options.shared_by] if options.shared_by else []
    return demo_command("triangulation", options.photo, {n: getattr(options, n) for n in names}, out, *shared)
