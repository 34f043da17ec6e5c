"""A network that turns photos into triangles, trained through an exact integral.

photos → crops → network → vertices → (areas of pixels' parts, compiled) → loss → gradient by the weights → epochs → another photo
"""

from __future__ import annotations

import hashlib
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from teg.errors import InputError
from teg.examples.descent_record import RecordedDescent
from teg.examples.harness import demo_command, machine, ratio, require_packages, result_folder, versions, write_report
from teg.examples.mesh_network.mesh import make_mesh, signed_areas

if TYPE_CHECKING:
    from teg.examples.mesh_network.training import State, Trainer

EPOCHS = 60
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


@dataclass(frozen=True)
class Options:
    """All options of a run except the picture itself."""

    photo: str | None
    cells: int
    epochs: int
    discontinuities: str
    seed: int

    def check(self) -> None:
        """Raises InputError for numbers that make no picture."""
        if not CELLS[0] <= self.cells <= CELLS[1]:
            raise InputError(f"a mesh of {self.cells} cells a side is not possible", None, f"between {CELLS[0]} and {CELLS[1]}")
        if self.epochs < 0:
            raise InputError(f"{self.epochs} epochs are not possible", None, "0 or more")
        if self.seed < 0:
            raise InputError(f"the seed {self.seed} is negative", None, "0, 1, 2, …")


def run_mesh_network(
    photo: str | Path | None = None,
    cells: int = 24,
    epochs: int = EPOCHS,
    out: str | Path = "out/mesh-network",
    discontinuities: str = "exact",
    progress: bool = True,
    resume: bool = False,
    seed: int = 0,
) -> dict[str, Any]:
    """Trains a network to move the vertices of meshes and applies it to a photo it has not seen; writes pictures to `out`.

    Returns the contents of run.json; "sampled" has the gradient of the same loss with sampled areas, by the same weights at the start.
    `photo` is any file that Pillow reads (None: scikit-image's astronaut), resized to `cells` cells of 4 pixels a side. The network
    learns from crops of four other photos of scikit-image's. `discontinuities="ignore"` differentiates like plain automatic
    differentiation. `resume` continues the run whose checkpoint is in `out`, up to `epochs` in all. Ctrl-C ends the training after the
    epoch, not the writing: the report says "interrupted".

    Raises InputError for a photo, number, folder or checkpoint that cannot be used, MissingPackageError.
    """
    require_packages("mesh network", PACKAGES, progress, extra="network")
    from teg.examples.mesh_network.coverage import exact_cover, sampled_cover
    from teg.examples.mesh_network.crops import training_photos
    from teg.examples.mesh_network.training import Trainer
    from teg.examples.photo import read_target

    options = Options(None if photo is None else str(photo), cells, epochs, discontinuities, seed)
    options.check()
    mesh = make_mesh(cells)
    target = read_target(photo, mesh.size, BUNDLED).astype(np.float32)
    folder = result_folder(Path(out))
    begun = time.perf_counter()
    trainer = Trainer(exact_cover(discontinuities), training_photos(), target, mesh, seed)
    identity = _identity(options, trainer, target)
    start = trainer.first_state()
    sampled_slope = trainer.largest_slope(start, sampled_cover)
    run = RecordedDescent(start, trainer.next_state, folder / "checkpoint.npz", identity, resume)
    setup = time.perf_counter() - begun
    interrupted = run.descend(epochs, progress)

    drawings = [(vertices, trainer.colours(vertices)) for vertices in map(trainer.vertices, (run.start, run.state))]
    _draw(folder, target, mesh.triangles, drawings, run, _lines(run.losses, discontinuities, sampled_slope))
    report = _progress(run, discontinuities) | {
        "interrupted": interrupted,
        "sampled": {"largest_slope": sampled_slope},
        "mesh": _movement(drawings[0][0], drawings[1][0], mesh.triangles),
        "seconds": {"setup": setup, "training": run.seconds},
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


def _identity(options: Options, trainer: Trainer, target: np.ndarray) -> dict[str, Any]:
    """Returns the settings that a checkpoint must agree with."""
    settings = {k: getattr(options, k) for k in ("cells", "seed", "discontinuities")}
    return settings | {"crops": trainer.crops, "batch": trainer.batch, "target": hashlib.sha256(target.tobytes()).hexdigest()}


def _lines(losses: list[float], discontinuities: str, sampled_slope: float) -> dict[str, list[float]]:
    """Returns the losses to draw, by label. A sampled loss with slope 0 stays where it began."""
    label = EXACT if discontinuities == "exact" else discontinuities
    return {label: losses} | ({SAMPLED: losses[:1]} if sampled_slope == 0 else {})


def _progress(run: RecordedDescent[State], discontinuities: str) -> dict[str, Any]:
    """Returns the part of the report on the training."""
    return {
        "loss": {"start": run.losses[0], "end": run.losses[-1], "ratio": ratio(run.losses[-1], run.losses[0])},
        "training": run.state.training.tolist(),
        "epochs": len(run.state.training),
        "note": NOTHING_LEARNT if run.state.stuck and discontinuities == "ignore" else "",
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
    from teg.examples.triangulation.pictures import draw_mesh, draw_target, write_svg

    size = len(target)
    for name, (vertices, colours) in zip(("before.png", "after.png"), drawings, strict=True):
        draw_mesh(folder / name, vertices, triangles, colours, size)
    draw_target(folder / "target.png", target)
    vertices, colours = drawings[1]
    write_svg(folder / "mesh.svg", vertices, triangles, colours, size)
    captions = ("the grid in its best colours", f"the network's mesh, epoch {len(run.state.training)}")
    draw_sheet(folder / SHEET, target, triangles, dict(zip(captions, drawings, strict=True)), lines, run.state.training)


def _command(options: Options, out: str | Path) -> str:
    names = ("cells", "epochs", "seed", "discontinuities")
    return demo_command("mesh-network", options.photo, {n: getattr(options, n) for n in names}, out)
