"""The main demonstration: a photograph in triangles, by descent on an exact integral.

photo → pixels → mesh → (gradient of the compiled program → step → best colours, now and then a refinement) × steps → pictures
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Mapping
from dataclasses import replace
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np

from teg.errors import InputError, MissingPackageError
from teg.examples.descent_record import RecordedDescent
from teg.examples.harness import finish, ratio, require_packages, result_folder
from teg.examples.options import resolved
from teg.examples.treatments import LABELS
from teg.examples.triangulation.baselines import ROUNDING, best_loss, psnr, random_delaunay
from teg.examples.triangulation.colour_fit import DEGREES, TERMS
from teg.examples.triangulation.descent import State, first_state, next_state
from teg.examples.triangulation.image_loss import ImageLoss, PictureLoss
from teg.examples.triangulation.mesh import Mesh, make_mesh, pin_border, signed_areas
from teg.examples.triangulation.regularisers import Penalty
from teg.examples.triangulation.scene import compile_scene

PACKAGES = {"PIL": "pillow", "matplotlib": "matplotlib", "scipy": "scipy", "tqdm": "tqdm"}
IDENTITY = ("triangles", "size", "seed", "colours", "optimiser", "refine", "smoothness", "keep_area", "keep_colours", "discontinuities")
PICTURES = ("sheet.png", "descent.gif", "loss.png", "target.png", "before.png", "after.png", "error.png", "mesh.svg")
PATIENCE, SLOW = 20, 1e-5  # it has converged when so many steps gain less than this part of the loss
NOTHING_MOVES = (
    "the gradient by the vertices is exactly 0: automatic differentiation does not see that an edge moves, "
    "so no vertex did (with --discontinuities exact, the default, they do)"
)


def run_triangulation(
    photo: str | Path | None = None, out: str | Path = "out/triangulation", progress: bool = True, **options: Any
) -> dict[str, Any]:
    """Approximates a photo by triangles whose colours are polynomials; writes pictures to `out`, returns the contents of run.json.

    `photo` is any file that Pillow reads, of any shape (None: scikit-image's astronaut), resized to `size` pixels on its longer side. The
    options are those of `teg demo triangulation` (`examples/options.py`): triangles, size, steps, colours, optimiser, refine, smoothness,
    keep_area, mesh, pin, keep_colours, discontinuities, alone, shared_by, seed, backend, resume.
    With `discontinuities="exact"` the same descent is run beside it like plain automatic differentiation, unless `alone`. Ctrl-C ends the
    descent, not the writing: the report says "interrupted".

    Raises InputError for a photo, option, folder or checkpoint that cannot be used, MissingPackageError.
    """
    require_packages("triangulation", PACKAGES, progress)
    from teg.examples.photo import read_target

    settings = resolved("triangulation", {"photo": photo, "out": out, **options})
    target = np.ascontiguousarray(read_target(photo, settings["size"], square=False))
    mesh = _first_mesh(settings, (target.shape[1], target.shape[0]))
    folder = result_folder(Path(out))
    fits = [Fit(settings, mesh, target, folder / "checkpoint.npz", settings["resume"])]
    if settings["discontinuities"] == "exact" and not settings["alone"]:
        plain = settings | {"discontinuities": "ignore"}
        path = folder / "checkpoint-ignore.npz"
        fits.append(Fit(plain, mesh, target, path, settings["resume"] and path.exists()))
    interrupted = False
    for fit in fits:
        interrupted = interrupted or fit.descent.descend(settings["steps"], progress, fit.label)
    marks = _comparisons(fits[0], mesh, target, settings)
    _draw(folder, fits, target, marks)
    report = fits[0].report() | {
        "summary": _summary(fits, marks),
        "beside": fits[1].report() if len(fits) > 1 else None,
        "comparisons": {label: {"loss": loss, "psnr": psnr(loss)} for label, loss in marks.items()},
        "interrupted": interrupted,
        "target_sha256": hashlib.sha256(target.tobytes()).hexdigest(),
        "pictures": PICTURES,
    }
    return finish(folder, "triangulation", settings, report)


class Fit:
    """One descent: the compiled loss, its state, and its report."""

    def __init__(self, settings: Mapping[str, Any], mesh: Mesh, target: np.ndarray, checkpoint: Path, resume: bool) -> None:
        begun = time.perf_counter()
        self.settings, self.size = settings, mesh.size
        self.label = LABELS[settings["discontinuities"]]
        self.image = _loss(settings, target, mesh)
        identity = {k: settings[k] for k in IDENTITY}
        start_of = mesh.vertices.tobytes() + mesh.movable.tobytes()
        identity |= {"target": hashlib.sha256(target.tobytes()).hexdigest(), "mesh": hashlib.sha256(start_of).hexdigest()}
        start = first_state(mesh, self.image, TERMS[DEGREES[settings["colours"]]])
        self.descent = RecordedDescent(start, self.advance, checkpoint, identity, resume)
        self.image.gradient(mesh.vertices, start.colours)  # derived and compiled now, as part of the set-up
        self.image.pairs, self.image.seconds = 0, 0.0
        self.setup = time.perf_counter() - begun

    def advance(self, state: State) -> State:
        """Returns the state after one step, and every `refine` steps after a refinement. A loss of 0 to rounding is not descended."""
        every = self.settings["refine"]
        if state.loss <= ROUNDING or self._has_converged(state.loss, max(PATIENCE, 2 * every)):
            return replace(state, stuck=True)
        state = next_state(self.image, state, self.size, self.settings["optimiser"])
        if every and isinstance(self.image, ImageLoss) and state.step and state.step % every == 0 and not state.stuck:
            from teg.examples.triangulation.refinement import refine

            return refine(self.image, state, self.size, self.settings["pin"] == "border")
        return state

    def _has_converged(self, loss: float, steps: int) -> bool:
        """Returns whether so many steps have gained next to nothing. With Adam's the loss need not fall."""
        losses = self.descent.losses
        return self.settings["optimiser"] != "adam" and len(losses) > steps and losses[-1 - steps] - loss <= SLOW * loss

    def penalty(self, state: State) -> float:
        """Returns the part of the loss that is a penalty on shapes."""
        if not isinstance(self.image, ImageLoss):
            return 0.0
        self.image.triangles = state.triangles
        return float(self.image.penalties(state.vertices).sum())

    def report(self) -> dict[str, Any]:
        """Returns the results as a dict."""
        descent, state, start = self.descent, self.descent.state, self.descent.start
        losses, steps = descent.losses, descent.steps
        same = state.vertices.shape == start.vertices.shape and np.array_equal(state.triangles, start.triangles)
        penalties = [self.penalty(state) for state in (start, state)]
        moved = np.linalg.norm(state.vertices - start.vertices, axis=1) if same else np.array([np.nan])
        return {
            "loss": {"start": losses[0], "end": losses[-1], "ratio": ratio(losses[-1], losses[0])},
            "penalty": {"start": penalties[0], "end": penalties[1]},  # a part of the loss
            "psnr": {"start": psnr(losses[0] - penalties[0]), "end": psnr(losses[-1] - penalties[1])},
            "steps": steps,
            "converged": state.stuck,
            "note": NOTHING_MOVES
            if state.stuck and losses[0] > ROUNDING and self.settings["discontinuities"] == "ignore" and same and not moved.any()
            else "",
            "mesh": {
                "triangles": len(state.triangles),
                "vertices": len(state.vertices),
                "same_triangles": bool(same),
                "largest_movement": float(moved.max()) if same else None,
                "smallest_area": float(signed_areas(state.vertices, state.triangles).min()),
            },
            "seconds": {"setup": self.setup, "descent": descent.seconds, "kernels": self.image.seconds},
            "pairs_per_second": self.image.pairs / self.image.seconds if self.image.seconds > 0 else None,
            "milliseconds_a_step": 1000 * descent.seconds / steps if steps else None,
            "losses": losses,
        }


def _first_mesh(settings: Mapping[str, Any], size: tuple[int, int]) -> Mesh:
    if settings["triangles"] > size[0] * size[1]:
        what = f"a mesh of {settings['triangles']} triangles for {size[0]} × {size[1]} pixels is not possible"
        raise InputError(what, None, "at most one a pixel")
    if settings["shared_by"]:
        _check_shared(settings)
    if settings["mesh"] is None:
        mesh = make_mesh(settings["triangles"], size, settings["seed"])
    else:
        from teg.examples.triangulation.mesh_files import read_mesh

        mesh = read_mesh(Path(settings["mesh"]), size)
    if settings["keep_colours"]:
        _check_colours(mesh, settings)
    return pin_border(mesh) if settings["pin"] == "border" else mesh


def _check_shared(settings: Mapping[str, Any]) -> None:
    """Raises InputError for options that a picture on several devices does not have."""
    if settings["backend"] != "jax" or settings["colours"] != "constant" or settings["refine"]:
        what = "a picture that JAX's devices share has constant colours and is not refined"
        raise InputError(what, None, "--backend jax --colours constant --refine 0, or no --shared-by")
    if settings["smoothness"] or settings["keep_area"] or settings["keep_colours"]:
        raise InputError("a picture that JAX's devices share has no penalties, and the best colours", None, "no --shared-by")


def _check_colours(mesh: Mesh, settings: Mapping[str, Any]) -> None:
    """Raises InputError unless a mesh has constant colours that can be kept."""
    if mesh.colours is None:
        raise InputError("there are no colours to keep", None, "--mesh FILE.ply with the colours of its faces")
    if mesh.colours.shape[1] > 3 or settings["colours"] != "constant" or settings["refine"]:
        raise InputError("--keep-colours is for constant colours, and no refinement", None, "--colours constant --refine 0")


def _loss(settings: Mapping[str, Any], target: np.ndarray, mesh: Mesh) -> PictureLoss:
    if settings["shared_by"]:
        if util.find_spec("jax") is None:
            raise MissingPackageError("a picture is computed on the devices of JAX", None, 'pip install "teg-compiler[jax]"')
        from teg.examples.triangulation.sharded import ShardedLoss

        return ShardedLoss(settings["shared_by"], target, mesh.triangles, discontinuities=settings["discontinuities"])
    degree, threads = DEGREES[settings["colours"]], os.cpu_count() or 1
    scene = compile_scene(settings["backend"], settings["discontinuities"], threads, degree)
    weights = settings["smoothness"], settings["keep_area"]
    penalty = Penalty(mesh, *weights, settings["backend"]) if any(weights) else None
    return ImageLoss(scene, target, mesh.triangles, penalty, settings["keep_colours"])


def _comparisons(fit: Fit, mesh: Mesh, target: np.ndarray, settings: Mapping[str, Any]) -> dict[str, float]:
    """Returns the losses of other meshes in their best colours."""

    if not isinstance(fit.image, ImageLoss):
        return {}
    count = len(fit.descent.state.triangles)
    return {"Delaunay of random points": best_loss(fit.image, random_delaunay(count, mesh.size, settings["seed"]))}


def _draw(folder: Path, fits: list[Fit], target: np.ndarray, marks: Mapping[str, float]) -> None:
    """Draws the mesh before and after, target, error, loss, the sheet and the animation; writes the mesh as PLY, OBJ and SVG."""
    from teg.examples.animation import write_film
    from teg.examples.triangulation import pictures
    from teg.examples.triangulation.mesh_files import write_obj, write_ply, write_svg

    run, size = fits[0].descent, fits[0].size

    def render(state: State, side: int) -> np.ndarray:
        return pictures.render(state.vertices, state.triangles, state.colours, size, side)

    longest, side, end = max(size), pictures.shown_side(size), run.state
    small = {"undeformed mesh": render(run.start, longest), **{fit.label: render(fit.descent.state, longest) for fit in reversed(fits)}}
    for picture, shown, drawn in (("before.png", run.start, "undeformed mesh"), ("after.png", end, fits[0].label)):
        pictures.draw_picture(folder / picture, small[drawn] if side == longest else render(shown, side))
    pictures.draw_target(folder / "target.png", target)
    losses = {"undeformed mesh": run.losses[0], **{fit.label: fit.descent.losses[-1] for fit in reversed(fits)}}
    pictures.draw_error(folder / "error.png", small[fits[0].label], target)
    pictures.draw_sheet(folder / "sheet.png", target, small, losses)
    pictures.draw_loss(folder / "loss.png", {fit.label: fit.descent.losses for fit in fits}, marks)
    frames = [pictures.to_bytes(render(state, pictures.FILM_SIDE)) for state in run.animation()]
    write_film(folder / "descent.gif", frames, pictures.FILM_MILLISECONDS, pictures.FILM_LAST)
    write_svg(folder / "mesh.svg", end.vertices, end.triangles, end.colours, size)
    write_ply(folder / "mesh.ply", end.vertices, end.triangles, end.colours, size, np.logical_not(end.movable.any(axis=1)))
    write_obj(folder / "mesh.obj", end.vertices, end.triangles, end.colours)


def _summary(fits: list[Fit], marks: Mapping[str, float]) -> list[str]:
    if fits[0].descent.losses[0] <= ROUNDING:
        return ["the undeformed mesh equals the picture to rounding: there is nothing to descend"]
    lines = []
    for fit in fits:
        run = fit.descent
        change = f"loss {run.losses[0]:.5f} → {run.losses[-1]:.5f}, {ratio(run.losses[-1], run.losses[0]):.1%} of the undeformed mesh"
        which = "the colours of its file" if fit.settings["keep_colours"] else "its best colours"
        penalty, end = fit.penalty(run.state), ", converged" if run.state.stuck and run.steps else ""
        change += f" in {which}" + (f" (penalties: {penalty:.5f} of it)" if penalty else "")
        lines.append(f"{fit.label}: {change}, {psnr(run.losses[-1] - penalty):.2f} dB, after {run.steps} steps in {run.seconds:.1f} s{end}")
    lines += [f"{label}: loss {loss:.5f}, {psnr(loss):.2f} dB" for label, loss in marks.items()]
    return lines + [note for note in (fit.report()["note"] for fit in fits) if note]
