"""Motion and focus from one blurred picture.

    teg demo motion-blur
    teg demo depth-of-field

A pixel of a picture is an integral over its square and over a third variable: the time while the shutter is open, or the place on a lens.
The integrand jumps at the moving edges of a triangle, and nothing else of it depends on velocity, spin, focus and radius of the lens. A
quasi-Newton method descends from other values of these to those of a given picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import teg
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.blur import lens, motion
from teg.examples.fit import Fit, draw_losses, draw_pictures, fit, lines_of
from teg.examples.replay import Keep, Replay, not_kept

Array = npt.NDArray[np.float64]
Numbers = dict[str, float]
MOVED: Numbers = dict(zip(motion.MOTION, (-0.5, -0.35, 0.5, 0.25, 1.0), strict=True))
MOVED_START: Numbers = dict(zip(motion.MOTION, (-0.35, -0.2, 0.3, 0.1, 0.6), strict=True))
SEEN: Numbers = {"focus": 2.4, "radius": 0.9}
SEEN_START: Numbers = {"focus": 3.0, "radius": 0.6}
SLITS = 12


class Blur:
    """A compiled loss of named numbers and a picture, and what else it takes."""

    def __init__(self, demo: str, size: int, backend: Backend, discontinuities: Discontinuities = "exact") -> None:
        self.size = size
        self.given: dict[str, Any] = {}
        self.names: tuple[str, ...]
        if demo == "motion-blur":
            e, self.names, self.true, self.start = motion.loss(), motion.MOTION, MOVED, MOVED_START
        else:
            e, self.names, self.true, self.start = lens.loss(), lens.LENS, SEEN, SEEN_START
            self.given = {"S": lens.slits(SLITS)}
        wanted: list[Any] = [*(teg.param(name) for name in self.names), motion.TARGET]
        self.evaluator = teg.compile(e, wanted, backend=backend, discontinuities=discontinuities)

    def loss_and_slopes(self, numbers: Numbers, picture: Array) -> tuple[float, dict[str, Any]]:
        """Returns the loss and its derivatives."""
        value, slopes = self.evaluator.value_and_grad(T=picture, **self.given, **numbers)
        return float(value), slopes

    def picture(self, numbers: Numbers, finer: int = 1) -> Array:
        """Returns the pixels, `finer` times as many a side, as the derivative by those of a black picture."""
        side = finer * self.size
        return np.asarray(-0.5 * self.loss_and_slopes(numbers, np.zeros((side, side)))[1]["T"])


def descend(
    demo: str, size: int, steps: int, backend: Backend = "c", keep: Keep = not_kept, discontinuities: Discontinuities = "exact"
) -> Fit:
    """Returns the descent from other numbers to those of a given picture, with pictures of simpler ones."""
    scene = Blur(demo, size, backend, discontinuities)
    target = scene.picture(scene.true)
    found = fit(lambda numbers: scene.loss_and_slopes(numbers, target), scene.start, steps, keep)
    if demo == "motion-blur":
        shown = {"it moves": scene.true | {"spin": 0.0}, "it turns": scene.true | {"across": 0.0, "along": 0.0}}
    else:
        shown = {"focus on the near corner": scene.true | {"focus": 2.0}, "on the far one": scene.true | {"focus": 5.0}}
    found.pictures = {title: scene.picture(numbers, 4) for title, numbers in shown.items()}
    found.pictures |= {"start": scene.picture(found.numbers[0]), "end": scene.picture(found.numbers[-1]), "the picture": target}
    return found


def draw(found: Fit, path: Path) -> None:
    """Writes pictures and losses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16, 3), layout="constrained")
    axes = figure.subplots(1, 6)
    draw_pictures(axes, found)
    draw_losses(axes[5], found)
    figure.savefig(path, dpi=100)


def _run(demo: str, out: str | Path, progress: bool, options: dict[str, Any]) -> dict[str, Any]:
    from teg.examples.harness import evaluations_shown, finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages(f"{demo} demo", {"matplotlib": "matplotlib", "scipy": "scipy", "tqdm": "tqdm"}, progress)
    settings = resolved(demo, {"out": out, **options})
    folder = result_folder(Path(out))
    replay = Replay(folder / "checkpoint.npz", {k: settings[k] for k in ("size", "backend", "discontinuities")}, settings["resume"])
    try:
        with evaluations_shown(progress, replay.kept, demo) as keep:
            found = descend(demo, settings["size"], settings["steps"], settings["backend"], keep, settings["discontinuities"])
    finally:
        replay.save()
    draw(found, folder / "blur.png")
    true = MOVED if demo == "motion-blur" else SEEN
    shown = {"summary": lines_of(found, true), "losses": found.losses, "numbers": found.numbers[-1], "pictures": ["blur.png"]}
    shown["seconds"] = {"descent": found.seconds}
    return finish(folder, demo, settings, shown)


def run_motion_blur(out: str | Path = "out/motion-blur", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Recovers a motion from a picture and draws it; writes to `out`, returns the contents of run.json.

    The options are those of `teg demo motion-blur` (`examples/options.py`); nothing is random, so any `seed` gives the same. Raises
    InputError for options and checkpoints that cannot be used, MissingPackageError. A checkpoint is written every two seconds.
    """
    return _run("motion-blur", out, progress, options)


def run_depth_of_field(out: str | Path = "out/depth-of-field", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Recovers focus and radius of a lens from a picture and draws it, as `run_motion_blur` does with a motion.

    The options are those of `teg demo depth-of-field` (`examples/options.py`).
    """
    return _run("depth-of-field", out, progress, options)
