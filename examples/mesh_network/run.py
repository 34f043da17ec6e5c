"""A network that turns photos into triangles, trained through an exact integral.

photos → crops → network → vertices → (areas of pixels' parts, compiled) → loss → gradient by the weights → epochs → another photo
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from teg.errors import InputError
from teg.evaluator.options import Discontinuities
from teg.examples.descent_record import RecordedDescent
from teg.examples.harness import finish, ratio, require_packages, result_folder
from teg.examples.mesh_network.mesh import make_mesh, signed_areas
from teg.examples.options import resolved

if TYPE_CHECKING:
    from teg.examples.mesh_network.training import State, Trainer

CELLS = (4, 128)
BUNDLED = "astronaut"
PACKAGES = {"jax": "jax", "optax": "optax", "PIL": "pillow", "skimage": "scikit-image", "matplotlib": "matplotlib", "tqdm": "tqdm"}
SHEET = "mesh_network.png"
PICTURES = (SHEET, "target.png", "before.png", "after.png", "mesh.svg")
EXACT, SAMPLED = "exact gradient", "jax.grad of sampled triangles, which is 0"
NOTHING_LEARNT = (
    "the gradient by the weights is exactly 0: automatic differentiation does not see that an edge moves, "
    "so the network learns nothing (with --discontinuities exact, the default, it does)"
)


def run_mesh_network(
    photo: str | Path | None = None, out: str | Path = "out/mesh-network", progress: bool = True, **options: Any
) -> dict[str, Any]:
    """Trains a network to move the vertices of meshes and applies it to a photo it has not seen; writes pictures to `out`.

    Returns the contents of run.json; "sampled" has the gradient of the same loss with sampled areas, by the same weights at the start.
    `photo` is any file that Pillow reads (None: scikit-image's astronaut), cropped to a square and resized to `cells` cells of 4 pixels a
    side. The network learns from crops of four other photos of scikit-image's. The options are those of `teg demo mesh-network`
    (`examples/options.py`): cells, epochs, discontinuities, seed, resume. Ctrl-C ends the training after the epoch, not the writing: the
    report says "interrupted".

    Raises InputError for a photo, option, folder or checkpoint that cannot be used, MissingPackageError.
    """
    require_packages("mesh network", PACKAGES, progress, extra="network")
    from teg.examples.mesh_network.coverage import exact_cover, sampled_cover
    from teg.examples.mesh_network.crops import training_photos
    from teg.examples.mesh_network.training import Trainer
    from teg.examples.photo import read_target

    settings = resolved("mesh-network", {"photo": photo, "out": out, **options})
    if not CELLS[0] <= settings["cells"] <= CELLS[1]:
        raise InputError(f"a mesh of {settings['cells']} cells a side is not possible", None, f"between {CELLS[0]} and {CELLS[1]}")
    discontinuities = settings["discontinuities"]
    mesh = make_mesh(settings["cells"])
    target = read_target(photo, mesh.size, BUNDLED).astype(np.float32)
    folder = result_folder(Path(out))
    begun = time.perf_counter()
    trainer = Trainer(exact_cover(discontinuities), training_photos(), target, mesh, settings["seed"])
    identity = _identity(settings, trainer, target)
    start = trainer.first_state()
    sampled_slope = trainer.largest_slope(start, sampled_cover)
    run = RecordedDescent(start, trainer.next_state, folder / "checkpoint.npz", identity, settings["resume"])
    setup = time.perf_counter() - begun
    interrupted = run.descend(settings["epochs"], progress)

    drawings = [(vertices, trainer.colours(vertices)) for vertices in map(trainer.vertices, (run.start, run.state))]
    _draw(folder, target, mesh.triangles, drawings, run, _lines(run.losses, discontinuities, sampled_slope))
    report = _progress(run, discontinuities) | {
        "interrupted": interrupted,
        "sampled": {"largest_slope": sampled_slope},
        "mesh": _movement(drawings[0][0], drawings[1][0], mesh.triangles),
        "seconds": {"setup": setup, "training": run.seconds},
        "target_sha256": identity["target"],
        "pictures": PICTURES,
        "losses": run.losses,
    }
    return finish(folder, "mesh-network", settings, report)


def _identity(options: Mapping[str, Any], trainer: Trainer, target: np.ndarray) -> dict[str, Any]:
    """Returns the settings that a checkpoint must agree with."""
    settings = {k: options[k] for k in ("cells", "seed", "discontinuities")}
    return settings | {"crops": trainer.crops, "batch": trainer.batch, "target": hashlib.sha256(target.tobytes()).hexdigest()}


def _lines(losses: list[float], discontinuities: Discontinuities, sampled_slope: float) -> dict[str, list[float]]:
    """Returns the losses to draw, by label. A sampled loss with slope 0 stays where it began."""
    label = EXACT if discontinuities == "exact" else discontinuities
    return {label: losses} | ({SAMPLED: losses[:1]} if sampled_slope == 0 else {})


def _progress(run: RecordedDescent[State], discontinuities: Discontinuities) -> dict[str, Any]:
    """Returns the part of the report on the training."""
    start, end, epochs = run.losses[0], run.losses[-1], len(run.state.training)
    note = NOTHING_LEARNT if run.state.stuck and discontinuities == "ignore" else ""
    change = f"loss of a photo not seen in training {start:.5f} → {end:.5f}, {ratio(end, start):.1%} of the grid in its best colours"
    return {
        "summary": [f"{change}, after {epochs} epochs in {run.seconds:.1f} s", *([note] if note else [])],
        "loss": {"start": run.losses[0], "end": run.losses[-1], "ratio": ratio(run.losses[-1], run.losses[0])},
        "training": run.state.training.tolist(),
        "epochs": epochs,
        "note": note,
    }


def _movement(start: np.ndarray, end: np.ndarray, triangles: np.ndarray) -> dict[str, Any]:
    """Returns the part of the report on the mesh, whose vertices moved from `start` to `end`."""
    moved = np.linalg.norm(end - start, axis=1)
    return {
        "triangles": len(triangles),
        "vertices": len(start),
        "largest_movement": float(moved.max()),
        "mean_movement": float(moved.mean()),
        "turned_over": int(np.sum(signed_areas(end, triangles) < 0)),
    }


def _draw(
    folder: Path,
    target: np.ndarray,
    triangles: np.ndarray,
    drawings: list[tuple[np.ndarray, np.ndarray]],
    run: RecordedDescent[Any],
    lines: dict[str, list[float]],
) -> None:
    from teg.examples.mesh_network.pictures import draw_sheet
    from teg.examples.triangulation.mesh_files import write_svg
    from teg.examples.triangulation.pictures import draw_mesh, draw_target

    size = len(target)
    for name, (vertices, colours) in zip(("before.png", "after.png"), drawings, strict=True):
        draw_mesh(folder / name, vertices, triangles, colours, size)
    draw_target(folder / "target.png", target)
    vertices, colours = drawings[1]
    write_svg(folder / "mesh.svg", vertices, triangles, colours, size)
    captions = ("the grid in its best colours", f"the network's mesh, epoch {len(run.state.training)}")
    draw_sheet(folder / SHEET, target, triangles, dict(zip(captions, drawings, strict=True)), lines, run.state.training)
