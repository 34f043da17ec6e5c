"""Fitting a shader: two colours, a threshold and the gradients of a noise, by gradient descent on an exact integral.

photo → pixels → lattice → (corner values → compiled kernel → chain rule → step) × steps → pictures
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from teg.errors import InputError
from teg.examples.descent_record import RecordedDescent
from teg.examples.harness import default_backend, demo_command, machine, ratio, require_packages, result_folder, versions, write_report
from teg.examples.perlin.descent import first_state, next_state
from teg.examples.perlin.scene import compile_scene
from teg.examples.perlin.shader_loss import AFTER_GRADIENTS, ShaderLoss

if TYPE_CHECKING:
    from teg.examples.perlin.noise import Noise

STEPS = 300
SIZES = (8, 2048)
PACKAGES = {"PIL": "pillow", "matplotlib": "matplotlib", "scipy": "scipy", "tqdm": "tqdm"}
SHEET = "perlin.png"
PICTURES = ("target.png", "before.png", "after.png", "ignore.png")
BUNDLED = "chelsea"
LABELS = {"exact": "exact gradient", "ignore": "plain automatic differentiation"}
NOTHING_MOVES = (
    "the gradient by the noise and the threshold is exactly 0: automatic differentiation does not see that the border of the "
    "colours moves, so only the colours changed (with --discontinuities exact, the default, the noise does too)"
)


@dataclass(frozen=True)
class Options:
    """All options of a run except the picture itself."""

    photo: str | None
    cells: int
    octaves: int
    size: int
    steps: int
    discontinuities: str
    backend: str
    seed: int

    def check(self) -> None:
        """Raises InputError for numbers that make no picture."""
        if not SIZES[0] <= self.size <= SIZES[1]:
            raise InputError(f"a picture of {self.size} pixels a side is not possible", None, f"between {SIZES[0]} and {SIZES[1]}")
        if self.steps < 0:
            raise InputError(f"{self.steps} steps are not possible", None, "0 or more")
        if self.seed < 0:
            raise InputError(f"the seed {self.seed} is negative", None, "0, 1, 2, …")


def run_perlin(
    photo: str | Path | None = None,
    cells: int = 8,
    octaves: int = 3,
    size: int = 128,
    steps: int = STEPS,
    out: str | Path = "out/perlin",
    discontinuities: str = "exact",
    compare: bool = True,
    backend: str | None = None,
    progress: bool = True,
    resume: bool = False,
    seed: int = 0,
) -> dict[str, Any]:
    """Fits a thresholded noise to a photo; writes pictures to `out`, returns the contents of run.json.

    `photo` is any file that Pillow reads (None: scikit-image's cat), cropped and resized to size² pixels. The noise has `octaves`, the
    coarsest of `cells` lattice cells a side. `backend` None is "c" if there is a C compiler, else "numpy". `discontinuities="ignore"`
    differentiates like plain automatic differentiation; unless that is chosen, the same descent is run that way too and shown beside
    (`compare`). `resume` continues the run whose checkpoint is in `out`, up to `steps` in all. Ctrl-C ends the descent, not the writing:
    the report says "interrupted".

    Raises InputError for a photo, number, folder or checkpoint that cannot be used, MissingPackageError.
    """
    require_packages("Perlin shader", PACKAGES, progress)
    from teg.examples.perlin.noise import make_noise
    from teg.examples.photo import read_target

    name = None if photo is None else str(photo)
    options = Options(name, cells, octaves, size, steps, discontinuities, backend or default_backend(), seed)
    options.check()
    noise, gradients = make_noise(size, cells, octaves, seed)
    target = read_target(photo, size, BUNDLED)
    folder = result_folder(Path(out))
    fits = [Fit(options, noise, gradients, target, folder / "checkpoint.npz", resume)]
    if compare and discontinuities != "ignore":
        checkpoint = folder / "checkpoint-ignore.npz"
        plain = replace(options, discontinuities="ignore")
        fits.append(Fit(plain, noise, gradients, target, checkpoint, resume and checkpoint.exists()))
    interrupted = False
    for fit in fits:
        interrupted = interrupted or fit.descent.descend(steps, progress, fit.label)

    fit, marks = fits[0], simple_approximations(target)
    drawn = _draw(folder, target, fits, marks)
    report = fit.report() | {
        "beside": fits[1].report() if len(fits) > 1 else None,
        "interrupted": interrupted,
        "simple_approximations": marks,
        "options": asdict(options),
        "target_sha256": fit.descent.identity["target"],
        "command": _command(options, compare, out),
        "versions": versions(),
        "machine": machine(),
        "pictures": [str(folder / picture) for picture in (SHEET, *drawn)],
    }
    write_report(folder / "run.json", report)
    return report


def _draw(folder: Path, target: np.ndarray, fits: Sequence[Fit], marks: Mapping[str, float]) -> list[str]:
    """Draws the photo, the first noise and the end of each fit, and a sheet of them; returns the files of the single pictures."""
    from teg.examples.perlin import pictures

    fit, factor = fits[0], pictures.enlargement(len(target))
    start, *ends = (f.shader.picture(p, factor) for f, p in [(fit, fit.descent.start.parameters), *((f, f.end) for f in fits)])
    drawn = dict(zip(PICTURES, (target, start, *ends), strict=False))
    for file, picture in drawn.items():
        pictures.draw(folder / file, picture)
    captions = ["the photo", "noise at the start", *(f"{f.label}, step {f.steps}" for f in fits)]
    shown = dict(zip(captions, drawn.values(), strict=True))
    pictures.draw_sheet(folder / SHEET, shown, {f.label: f.descent.losses for f in fits}, marks)
    return list(drawn)


class Fit:
    """One descent: the compiled loss, its state, and its report."""

    def __init__(self, options: Options, noise: Noise, gradients: np.ndarray, target: np.ndarray, checkpoint: Path, resume: bool) -> None:
        begun = time.perf_counter()
        self.discontinuities = options.discontinuities
        self.label = LABELS.get(self.discontinuities, self.discontinuities)
        scene = compile_scene(options.backend, options.discontinuities, threads=os.cpu_count() or 1)
        self.shader = ShaderLoss(scene, noise, target)
        identity = {k: getattr(options, k) for k in ("cells", "octaves", "size", "seed", "discontinuities")}
        identity["target"] = hashlib.sha256(target.tobytes()).hexdigest()
        start = first_state(self.shader, gradients, target)
        self.descent = RecordedDescent(start, lambda s: next_state(self.shader, s), checkpoint, identity, resume)
        self.setup = time.perf_counter() - begun

    @property
    def end(self) -> np.ndarray:
        """Returns the final parameters."""
        return self.descent.state.parameters

    @property
    def steps(self) -> int:
        """Returns the number of steps made."""
        return len(self.descent.losses) - 1

    def report(self) -> dict[str, Any]:
        """Returns the results as a dict."""
        descent = self.descent
        losses, start, end = descent.losses, descent.start.parameters, self.end
        moved = np.abs(end - start)[:-AFTER_GRADIENTS].reshape(-1, 2)
        note = NOTHING_MOVES if self.discontinuities == "ignore" and not moved.any() and self.steps else ""
        return {
            "loss": {"start": losses[0], "end": losses[-1], "ratio": ratio(losses[-1], losses[0])},
            "steps": self.steps,
            "converged": descent.state.stuck,
            "note": note,
            "shader": {
                "lattice_nodes": len(moved),
                "largest_movement": float(np.linalg.norm(moved, axis=1).max()),
                "threshold": float(end[-AFTER_GRADIENTS]),
                "above": end[-6:-3].tolist(),
                "below": end[-3:].tolist(),
            },
            "seconds": {"setup": self.setup, "descent": descent.seconds, "kernels": self.shader.seconds},
            "pixels_per_second": self.shader.pixels / self.shader.seconds,
            "losses": losses,
        }


def simple_approximations(target: np.ndarray) -> dict[str, float]:
    """Returns losses to compare with: of one colour for the whole picture, and of two where each pixel may choose (from 2-means)."""
    from scipy.cluster.vq import ClusterError, kmeans2

    pixels = target.reshape(-1, 3)
    mean, deviation = pixels.mean(axis=0), pixels.std(axis=0)
    one = float(np.sum(deviation**2))
    try:
        centres, nearest = kmeans2(pixels, np.array([mean + deviation, mean - deviation]), iter=50, minit="matrix", missing="raise")
    except ClusterError:  # a picture of one colour
        return {"one colour": one}
    return {"one colour": one, "two, each pixel free to choose": float(np.mean(np.sum((pixels - centres[nearest]) ** 2, axis=1)))}


def _command(options: Options, compare: bool, out: str | Path) -> str:
    names = ("cells", "octaves", "size", "steps", "seed", "discontinuities", "backend")
    return demo_command("perlin", options.photo, {n: getattr(options, n) for n in names}, out, *([] if compare else ["--alone"]))
