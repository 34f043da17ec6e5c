"""Fitting a shader: two or three colours, thresholds and the gradients of a noise, by gradient descent on an exact integral.

photo → pixels → lattice → (corner values → compiled kernel → chain rule → step) × steps → pictures
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from teg.errors import InputError
from teg.examples.animation import write_film
from teg.examples.descent_record import RecordedDescent
from teg.examples.harness import finish, ratio, require_packages, result_folder
from teg.examples.options import resolved
from teg.examples.perlin.descent import first_state, next_state, shown_state
from teg.examples.perlin.scene import compile_scene
from teg.examples.perlin.shader_loss import ShaderLoss
from teg.examples.treatments import LABELS

if TYPE_CHECKING:
    from teg.examples.perlin.noise import Noise

PACKAGES = {"PIL": "pillow", "matplotlib": "matplotlib", "scipy": "scipy", "tqdm": "tqdm"}
SHEET, ANIMATION, SLOPES = "perlin.png", "descent.gif", "derivatives.png"
IDENTITY = ("cells", "octaves", "noise", "levels", "colour_cells", "size", "seed", "discontinuities")
PICTURES = ("target.png", "before.png", "after.png", "ignore.png")
BUNDLED = "astronaut"
NOTHING_MOVES = (
    "the gradient by the noise and the threshold is exactly 0: automatic differentiation does not see that the border of the "
    "colours moves, so only the colours changed (with --discontinuities exact, the default, the noise does too)"
)


def run_perlin(photo: str | Path | None = None, out: str | Path = "out/perlin", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Fits a thresholded noise to a photo; writes pictures to `out`, returns the contents of run.json.

    `photo` is any file that Pillow reads (None: scikit-image's astronaut), of any shape, resized to `size` pixels on its longer side. The
    options are those of `teg demo perlin` (`examples/options.py`): cells, octaves, noise, levels, colour_cells, node, size, steps,
    discontinuities, alone, seed, backend, resume. The noise has `octaves`, the coarsest of `cells` lattice cells on the longer side, and
    `levels` colours, each of which is a map with `colour_cells` cells if that is not 0. With `discontinuities="exact"` the same descent is
    run beside it like plain automatic differentiation, unless `alone`. Ctrl-C ends the descent, not the writing: the report says
    "interrupted".

    Raises InputError for a photo, option, folder or checkpoint that cannot be used, MissingPackageError.
    """
    require_packages("Perlin shader", PACKAGES, progress)
    from teg.examples.perlin.noise import make_noise
    from teg.examples.photo import read_target

    settings = resolved("perlin", {"photo": photo, "out": out, **options})
    target = read_target(photo, settings["size"], BUNDLED, square=False)
    shape = target.shape[1], target.shape[0]
    noise, gradients = make_noise(shape, settings["cells"], settings["octaves"], settings["seed"], settings["noise"])
    node = chosen_node(noise, settings["node"])
    folder = result_folder(Path(out))
    fits = [Fit(settings, noise, gradients, target, folder / "checkpoint.npz", settings["resume"])]
    if settings["discontinuities"] == "exact" and not settings["alone"]:
        checkpoint = folder / "checkpoint-ignore.npz"
        plain = settings | {"discontinuities": "ignore"}
        fits.append(Fit(plain, noise, gradients, target, checkpoint, settings["resume"] and checkpoint.exists()))
    interrupted = False
    for fit in fits:
        interrupted = interrupted or fit.descent.descend(settings["steps"], progress, fit.label)
    marks = simple_approximations(target, settings["levels"])
    drawn = _draw(folder, target, fits, marks)
    _draw_slopes(folder / SLOPES, fits[0], node)
    report = fits[0].report() | {
        "summary": [line for fit in fits for line in fit.summary()],
        "beside": fits[1].report() if len(fits) > 1 else None,
        "interrupted": interrupted,
        "simple_approximations": marks,
        "target_sha256": fits[0].descent.identity["target"],
        "pictures": [SHEET, ANIMATION, SLOPES, *drawn],
    }
    return finish(folder, "perlin", settings, report)


def _draw(folder: Path, target: np.ndarray, fits: Sequence[Fit], marks: Mapping[str, float]) -> list[str]:
    """Draws the photo, the first noise and the end of each fit, and a sheet of them; returns the files of the single pictures."""
    from teg.examples.perlin import pictures

    fit, factor = fits[0], pictures.enlargement(max(target.shape[:2]))
    start, *ends = (f.shader.picture(p, factor) for f, p in [(fit, fit.descent.start.parameters), *((f, f.end) for f in fits)])
    drawn = dict(zip(PICTURES, (target, start, *ends), strict=False))
    for file, picture in drawn.items():
        pictures.draw(folder / file, picture)
    captions = ["the photo", "noise at the start", *(f"{f.label}, step {f.steps}" for f in fits)]
    shown = dict(zip(captions, drawn.values(), strict=True))
    frames = [pictures.to_bytes(fit.shader.picture(state.parameters, factor)) for state in fit.descent.animation()]
    write_film(folder / ANIMATION, frames, pictures.FILM_MILLISECONDS, pictures.FILM_LAST)
    pictures.draw_sheet(folder / SHEET, shown, {f.label: f.descent.losses for f in fits}, marks)
    return list(drawn)


def chosen_node(noise: Noise, node: int | None) -> int:
    """Returns the number of the lattice node whose derivative is drawn; by default the one that the noise amid the picture depends on most.

    Raises InputError if there is none of that number.
    """
    if node is None:
        middle = np.zeros((noise.size[1] + 1, noise.size[0] + 1))
        middle[noise.size[1] // 2, noise.size[0] // 2] = 1
        return int(np.argmax(np.abs(noise.pull_back(middle)).reshape(-1, 2).sum(axis=1)))
    if node >= noise.nodes:
        raise InputError(f"--node is {node}", None, f"less than {noise.nodes}, the number of the nodes")
    return node


def _draw_slopes(path: Path, fit: Fit, node: int) -> None:
    """Draws the exact derivatives of the last picture by the first threshold, and by the gradient of a node, to the right."""
    from teg.examples.perlin import pictures

    shader, factor = fit.shader, pictures.enlargement(max(fit.shader.noise.size))
    by_threshold, by_node = np.zeros((2, len(fit.end)))
    by_threshold[2 * shader.noise.nodes] = 1
    by_node[2 * node] = 1
    directions = {"dI / d(first threshold)": by_threshold, f"dI / d(gradient of node {node}, to the right)": by_node}
    slopes = {title: shader.slope_picture(fit.end, direction, factor) for title, direction in directions.items()}
    pictures.draw_slopes(path, shader.picture(fit.end, factor), slopes)


class Fit:
    """One descent: the compiled loss, its state, and its report."""

    def __init__(
        self, settings: Mapping[str, Any], noise: Noise, gradients: np.ndarray, target: np.ndarray, checkpoint: Path, resume: bool
    ) -> None:
        begun = time.perf_counter()
        self.discontinuities, self.levels = settings["discontinuities"], settings["levels"]
        self.label = LABELS[self.discontinuities]
        scene = compile_scene(settings["backend"], self.discontinuities, os.cpu_count() or 1, self.levels)
        self.shader = ShaderLoss(scene, noise, target, settings["colour_cells"])
        identity = {k: settings[k] for k in IDENTITY}
        identity["target"] = hashlib.sha256(target.tobytes()).hexdigest()
        start = first_state(self.shader, gradients, target)
        self.descent = RecordedDescent(start, lambda s: next_state(self.shader, s), checkpoint, identity, resume, shown_state)
        self.setup = time.perf_counter() - begun

    @property
    def end(self) -> np.ndarray:
        """Returns the final parameters."""
        return self.descent.state.parameters

    @property
    def steps(self) -> int:
        """Returns the number of steps made."""
        return len(self.descent.losses) - 1

    def summary(self) -> list[str]:
        """Returns the lines to print."""
        losses = self.descent.losses
        change = f"loss {losses[0]:.5f} → {losses[-1]:.5f}, {ratio(losses[-1], losses[0]):.1%}"
        note = self.report()["note"]
        return [f"{self.label}: {change}, after {self.steps} steps in {self.descent.seconds:.1f} s", *([note] if note else [])]

    def report(self) -> dict[str, Any]:
        """Returns the results as a dict."""
        descent = self.descent
        losses, (start, _, _), (end, thresholds, colours) = descent.losses, *map(self.shader.split, (descent.start.parameters, self.end))
        moved = np.abs(end - start).reshape(-1, 2)
        note = NOTHING_MOVES if self.discontinuities == "ignore" and not moved.any() and self.steps else ""
        return {
            "loss": {"start": losses[0], "end": losses[-1], "ratio": ratio(losses[-1], losses[0])},
            "steps": self.steps,
            "converged": descent.state.stuck,
            "note": note,
            "shader": {
                "lattice_nodes": len(moved),
                "largest_movement": float(np.linalg.norm(moved, axis=1).max()),
                "thresholds": thresholds.tolist(),
                "colours": (colours[..., 0] if self.shader.nodes == 1 else colours).tolist(),
            },
            "seconds": {"setup": self.setup, "descent": descent.seconds, "kernels": self.shader.seconds},
            "pixels_per_second": self.shader.pixels / self.shader.seconds if self.shader.seconds > 0 else None,
            "losses": losses,
        }


def simple_approximations(target: np.ndarray, levels: int) -> dict[str, float]:
    """Returns losses to compare with: of one colour for the whole picture, and of some where each pixel may choose (from k-means)."""
    from scipy.cluster.vq import ClusterError, kmeans2

    pixels = target.reshape(-1, 3)
    one = float(np.sum(pixels.std(axis=0) ** 2))
    ordered = np.array_split(pixels[np.argsort(pixels.sum(axis=1))], levels)
    try:
        centres, nearest = kmeans2(pixels, np.array([part.mean(axis=0) for part in ordered]), iter=50, minit="matrix", missing="raise")
    except ClusterError:  # a picture of one colour
        return {"one colour": one}
    label = f"{levels} colours, each pixel free to choose"
    return {"one colour": one, label: float(np.mean(np.sum((pixels - centres[nearest]) ** 2, axis=1)))}
