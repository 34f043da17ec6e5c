"""The main job: a photograph in triangles, by gradient descent on an exact integral.

photo → pixels → mesh → (gather → compiled kernel → scatter → step) × steps → pictures
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import metadata, util
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from teg.errors import CompilerError, InputError, MissingPackageError
from teg.examples.triangulation.checkpoint import load_checkpoint, save_checkpoint
from teg.examples.triangulation.descent import first_state, next_state
from teg.examples.triangulation.image_loss import ImageLoss
from teg.examples.triangulation.mesh import Mesh, make_mesh, signed_areas
from teg.examples.triangulation.scene import compile_scene

STEPS = 120
CHECKPOINT_SECONDS = 5.0
SIZES = (8, 4096)
PACKAGES = {"PIL": "pillow", "matplotlib": "matplotlib", "tqdm": "tqdm"}
PICTURES = ("target.png", "before.png", "after.png", "loss.png", "mesh.svg")
NOTHING_MOVES = (
    "the gradient by the vertices is exactly 0: automatic differentiation does not see that an edge moves, "
    "so no vertex did (with --discontinuities sift, the default, they do)"
)


@dataclass(frozen=True)
class Options:
    """All that a run depends on but the picture itself."""

    photo: str | None
    triangles: int
    size: int
    steps: int
    discontinuities: str
    backend: str
    seed: int

    def check(self) -> None:
        """Raise InputError for numbers that make no picture."""
        if not SIZES[0] <= self.size <= SIZES[1]:
            raise InputError(f"a picture of {self.size} pixels a side", None, f"between {SIZES[0]} and {SIZES[1]}")
        if not 2 <= self.triangles <= self.size**2:
            raise InputError(f"{self.triangles} triangles for {self.size}² pixels", None, "at least 2, at most one a pixel")
        if self.steps < 0:
            raise InputError(f"{self.steps} steps", None, "0 or more")
        if self.seed < 0:
            raise InputError(f"the seed {self.seed} is negative", None, "0, 1, 2, …")


def run_triangulation(
    photo: str | Path | None = None,
    triangles: int = 300,
    size: int = 256,
    steps: int = STEPS,
    out: str | Path = "out/triangulation",
    discontinuities: str = "sift",
    backend: str | None = None,
    progress: bool = True,
    resume: bool = False,
    seed: int = 0,
) -> dict[str, Any]:
    """Approximate a photo by triangles of constant colour; write pictures to `out`, return what run.json holds.

    `photo` is any file that Pillow reads (None: scikit-image's astronaut), cropped and resized to size²
    pixels. `backend` None is "c" if there is a C compiler, else "numpy". `discontinuities="ignore"`
    differentiates as plain automatic differentiation does. `resume` continues the run whose checkpoint is in
    `out`, up to `steps` in all. Ctrl-C ends the descent, not the writing: the report says "interrupted".

    Raises InputError for a photo, number, folder or checkpoint that cannot be used, MissingPackageError.
    """
    _require_packages(progress)
    from teg.examples.triangulation import pictures
    from teg.examples.triangulation.photo import read_target

    chosen = backend or _default_backend()
    name = None if photo is None else str(photo)
    options = Options(name, triangles, size, steps, discontinuities, chosen, seed)
    options.check()
    target = read_target(photo, size)
    folder = _folder(Path(out))
    started = time.perf_counter()
    scene = compile_scene(chosen, discontinuities, threads=os.cpu_count() or 1)
    mesh = make_mesh(triangles, size, seed)
    image = ImageLoss(scene, target, mesh.triangles)
    run = Run(mesh, image, options, folder / "checkpoint.npz", resume)
    setup = time.perf_counter() - started
    interrupted = run.descend(progress)

    state = run.state
    for picture, shown in (("before.png", run.start), ("after.png", state)):
        pictures.draw_mesh(folder / picture, shown.vertices, mesh.triangles, shown.colours, size)
    pictures.draw_target(folder / "target.png", target)
    pictures.draw_loss(folder / "loss.png", run.losses)
    pictures.write_svg(folder / "mesh.svg", state.vertices, mesh.triangles, state.colours, size)
    moved = np.linalg.norm(state.vertices - run.start.vertices, axis=1)
    report = {
        "loss": {"start": run.losses[0], "end": run.losses[-1], "ratio": _ratio(run.losses[-1], run.losses[0])},
        "steps": len(run.losses) - 1,
        "interrupted": interrupted,
        "converged": state.stuck,
        "note": NOTHING_MOVES if state.stuck and discontinuities == "ignore" else "",
        "mesh": {
            "triangles": len(mesh.triangles),
            "vertices": len(mesh.vertices),
            "largest_movement": float(moved.max()),
            "smallest_area": float(signed_areas(state.vertices, mesh.triangles).min()),
        },
        "seconds": {"setup": setup, "descent": run.seconds, "kernels": image.seconds},
        "pairs_per_second": image.pairs / image.seconds,
        "options": asdict(options),
        "target_sha256": run.identity["target"],
        "command": _command(options, out),
        "versions": _versions(),
        "machine": {"platform": platform.platform(), "processors": os.cpu_count()},
        "pictures": [str(folder / picture) for picture in PICTURES],
        "losses": run.losses,
    }
    _write(folder / "run.json", json.dumps(report, indent=1, ensure_ascii=False) + "\n")
    return report


class Run:
    """A descent with its record: start, present state, the losses from the start on, seconds of all its parts."""

    def __init__(self, mesh: Mesh, image: ImageLoss, options: Options, checkpoint: Path, resume: bool) -> None:
        self.mesh, self.image, self.options, self.checkpoint = mesh, image, options, checkpoint
        same = {k: getattr(options, k) for k in ("triangles", "size", "seed", "discontinuities")}
        self.identity = same | {"target": hashlib.sha256(image.target.tobytes()).hexdigest()}
        self.start = self.state = first_state(mesh, image)
        self.losses, self.seconds = [self.state.loss], 0.0
        if resume:
            self.state, self.losses, self.seconds = load_checkpoint(checkpoint, self.identity)
        image.scene.loss.kernel(1)  # derived and compiled now, as part of the set-up

    def descend(self, progress: bool) -> bool:
        """Step until all steps are done or none lowers the loss; True if Ctrl-C came before that."""
        saved = begun = time.perf_counter()
        before = self.seconds
        try:
            with _bar(progress, self.options.steps, len(self.losses) - 1) as bar:
                while len(self.losses) <= self.options.steps and not self.state.stuck:
                    state = next_state(self.mesh, self.image, self.state)
                    losses = self.losses if state.stuck else [*self.losses, state.loss]
                    self.state, self.losses = state, losses  # together: Ctrl-C must not come between
                    now = time.perf_counter()
                    self.seconds = before + now - begun
                    if bar is not None:
                        bar.update(0 if state.stuck else 1)
                        bar.set_postfix_str(f"loss {state.loss:.5f}, {_ratio(state.loss, losses[0]):.1%} of start")
                    if now - saved > CHECKPOINT_SECONDS:
                        self.save()
                        saved = now
        except KeyboardInterrupt:
            return True
        finally:
            self.save()
        return False

    def save(self) -> None:
        """Write the checkpoint."""
        save_checkpoint(self.checkpoint, self.identity, self.state, self.losses, self.seconds)


@contextmanager
def _bar(progress: bool, total: int, done: int) -> Iterator[Any]:
    if not progress:
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, initial=done, unit="step", file=sys.stderr, dynamic_ncols=True) as bar:
        yield bar


def _default_backend() -> str:
    from teg.backends.c_build import find_compiler

    try:
        find_compiler()
    except CompilerError:
        return "numpy"
    return "c"


def _require_packages(progress: bool) -> None:
    wanted = [k for k in PACKAGES if k != "tqdm" or progress]
    missing = [PACKAGES[k] for k in wanted if util.find_spec(k) is None]
    if missing:
        raise MissingPackageError(f"the triangulation needs {', '.join(missing)}", None, 'pip install "teg[demo]"')


def _folder(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
        TemporaryFile(dir=path).close()
    except OSError as problem:
        raise InputError(f"cannot write to {str(path)!r}", None, f"{problem.strerror}; name another folder") from None
    return path


def _write(path: Path, text: str) -> None:
    partial = path.with_name(path.name + ".partial")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, path)


def _ratio(end: float, start: float) -> float:
    return end / start if start > 0 else 1.0


def _command(options: Options, out: str | Path) -> str:
    words = ["teg", "demo", "triangulation", *([options.photo] if options.photo else [])]
    for name in ("triangles", "size", "steps", "seed", "discontinuities", "backend"):
        words += [f"--{name}", str(getattr(options, name))]
    return shlex.join([*words, "-o", str(out)])


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in ("teg", "numpy", "pillow", "scikit-image", "matplotlib"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
