"""The place of a mesh from its soft shadow.

    teg demo soft-shadow

A knot of triangles hangs between a light, a pentagon, and a ground with a hill. Each receiver on the ground sees a share of the light; the
shares are exact, and so are their derivatives by the light, the mesh and the receivers. From another place and turn a quasi-Newton method
descends to those of a given shadow.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import teg
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.bins import binned
from teg.examples.fit import Fit, draw_losses, draw_pictures, fit, lines_of
from teg.examples.meshes import grid_of, knot
from teg.examples.replay import Keep, Replay, not_kept
from teg.examples.soft_shadow.scene import LIGHT, PLANE, POSE, RECEIVERS, SIDES, TARGET, VERTICES, loss, placed

Array = npt.NDArray[np.float64]
TRUE = dict(zip(POSE, (0.1, -0.05, 1.2, 0.4), strict=True))
START = dict(zip(POSE, (-0.2, 0.2, 1.4, 0.1), strict=True))
GROUND = 1.9
"""Half of the side of the ground."""


class Scene:
    """The compiled program, the light, the mesh and the ground with size² receivers.

    Derivatives are those by the pose of the mesh and by `arrays`: "L" and "G" for the light, "P" for the mesh, "Q" for the receivers.
    """

    def __init__(self, size: int, triangles: int, backend: Backend, arrays: str = "", kind: Discontinuities = "exact") -> None:
        self.size = size
        angles = 0.3 + 2 * np.pi * np.arange(SIDES) / SIDES
        light = 0.9 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        plane = np.array([[-0.3, 0.2, 3.0], [0.5, 0.0, 0.1], [0.0, 0.5, -0.05]])
        vertices, self.faces = knot(*grid_of(triangles))
        ticks = GROUND * ((np.arange(size) + 0.5) * 2 / size - 1)
        across, along = np.meshgrid(ticks, ticks)
        hill = 0.25 * np.exp(-2 * ((across - 0.7) ** 2 + (along - 0.5) ** 2))
        ground = np.stack([across.ravel(), along.ravel(), hill.ravel()], axis=1)
        self.arrays = {"L": light, "G": plane, "P": 0.6 * vertices, "Q": ground}
        named = {"L": LIGHT, "G": PLANE, "P": VERTICES, "Q": RECEIVERS}
        wanted: list[Any] = [*(teg.param(name) for name in POSE), TARGET, *(named[name] for name in arrays)]
        self.evaluator = teg.compile(loss(), wanted, backend=backend, discontinuities=kind)

    def candidates(self, pose: dict[str, float]) -> dict[str, Any]:
        """Returns the triangles that may hide a part of a tile of the light from a receiver, for each of both.

        They turn to it (the mesh is closed, so the others hide nothing more), and their boxes in the plane of the light meet the tile and
        the light's box. There are as many more tiles as triangles.
        """
        vertices = np.stack(placed(self.arrays["P"].T, pose, np), axis=-1)
        origin, *axes = self.arrays["G"]
        normal, dual = np.cross(*axes), np.linalg.pinv(np.stack(axes, axis=1))
        low, high = self.arrays["L"].min(axis=0), self.arrays["L"].max(axis=0)
        count, size = max(1, round(len(self.faces) ** 0.5 / 12)), len(self.arrays["Q"])
        who, receivers, first, last = [], [], [], []
        for at, row in enumerate(self.arrays["Q"].reshape(-1, self.size, 3)):
            rays = vertices - row[:, None]
            away = (origin - row) @ normal
            with np.errstate(divide="ignore", invalid="ignore"):
                stretch = away[:, None] / (rays @ normal)
                places = (row[:, None] + stretch[..., None] * rays - origin) @ dual.T
            boxed = (stretch >= 1).all(axis=1)  # else a part of the mesh is beyond the light, or behind the receiver
            a, b, c = (rays[:, self.faces[:, n]] for n in range(3))
            kept = np.einsum("rfi,rfi->rf", a, np.cross(b, c)) < -1e-12
            corners = np.where(boxed[:, None, None, None], places[:, self.faces], [[-9.0, -9.0], [9.0, 9.0], [0.0, 0.0]])
            least, most = corners.min(axis=2), corners.max(axis=2)
            kept &= ((least < high) & (most > low)).all(axis=2)
            seen, faces = np.nonzero(kept)
            who.append(faces)
            receivers.append(seen + at * self.size)
            first.append(np.floor((least[kept] + 1) * count / 2 - 1e-6))
            last.append(np.ceil((most[kept] + 1) * count / 2 + 1e-6))
        start, end = (np.concatenate(ends).clip(0, count).astype(np.int64) for ends in (first, last))
        ranges, owners = binned(np.concatenate(who), start, end, (size, count), np.concatenate(receivers))
        return {"F": self.faces, "E": np.linspace(-1, 1, count + 1), "R": ranges.reshape(size, count, count, 2), "I": owners}

    def loss_and_slopes(self, pose: dict[str, float], picture: Array) -> tuple[float, dict[str, Any]]:
        """Returns the loss and its derivatives."""
        value, slopes = self.evaluator.value_and_grad(T=picture.ravel(), **self.arrays, **self.candidates(pose), **pose)
        return float(value), slopes

    def picture(self, pose: dict[str, float]) -> Array:
        """Returns the shares, of shape (size, size), as the derivative by those of a black picture."""
        slopes = self.loss_and_slopes(pose, np.zeros((self.size, self.size)))[1]
        return np.asarray(-0.5 * slopes["T"]).reshape(self.size, self.size)


@dataclass
class Settings:
    """How large, how long, in what."""

    size: int = 32
    triangles: int = 400
    steps: int = 60
    backend: Backend = "c"
    discontinuities: Discontinuities = "exact"


def descend(settings: Settings, keep: Keep = not_kept) -> tuple[Scene, Fit]:
    """Returns the descent from one place of the mesh to that of a given shadow."""
    scene = Scene(settings.size, settings.triangles, settings.backend, kind=settings.discontinuities)
    target = scene.picture(TRUE)
    found = fit(lambda pose: scene.loss_and_slopes(pose, target), START, settings.steps, keep)
    found.pictures = {"start": scene.picture(START), "end": scene.picture(found.numbers[-1]), "the shadow": target}
    return scene, found


def draw(scene: Scene, found: Fit, path: Path) -> None:
    """Writes the scene, the first, the last and the given shadow, and the losses."""
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    figure = Figure(figsize=(15, 3.4), layout="constrained")
    space = figure.add_subplot(1, 5, 1, projection="3d", computed_zorder=False)
    across, along, height = scene.arrays["Q"].reshape(scene.size, scene.size, 3).transpose(2, 0, 1)
    shares = np.repeat(found.pictures["the shadow"][..., None], 3, axis=-1).clip(0, 1)
    space.plot_surface(across, along, height, facecolors=0.15 + 0.8 * shares, rstride=1, cstride=1, shade=False, zorder=0)
    vertices = np.stack(placed(scene.arrays["P"].T, TRUE, np), axis=-1)
    space.add_collection3d(Poly3DCollection(vertices[scene.faces], facecolors="tab:orange", shade=True, zorder=1))
    light = scene.arrays["G"][0] + scene.arrays["L"] @ scene.arrays["G"][1:]
    space.add_collection3d(Poly3DCollection([light], facecolors="gold", edgecolors="0.3", zorder=2))
    space.set(xlim=(-GROUND, GROUND), ylim=(-GROUND, GROUND), zlim=(0, 3.1), title="light, mesh, ground")
    space.set_box_aspect((1, 1, 0.82), zoom=1.2)
    space.set_axis_off()
    draw_pictures([figure.add_subplot(1, 5, n) for n in (2, 3, 4)], found)
    draw_losses(figure.add_subplot(1, 5, 5), found)
    figure.savefig(path, dpi=100)


def run_soft_shadow(out: str | Path = "out/soft-shadow", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Descends, draws the shadows; writes to `out`, returns the contents of run.json.

    The options are those of `teg demo soft-shadow` (`examples/options.py`); nothing is random, so any `seed` gives the same. Raises
    InputError for options and checkpoints that cannot be used, MissingPackageError. A checkpoint is written every two seconds.
    """
    from teg.examples.harness import evaluations_shown, finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("soft-shadow demo", {"matplotlib": "matplotlib", "scipy": "scipy", "tqdm": "tqdm"}, progress)
    settings = resolved("soft-shadow", {"out": out, **options})
    folder = result_folder(Path(out))
    chosen = {k: settings[k] for k in ("size", "triangles", "backend", "discontinuities")}
    replay = Replay(folder / "checkpoint.npz", chosen, settings["resume"])
    try:
        with evaluations_shown(progress, replay.kept, "soft shadow") as keep:
            scene, found = descend(Settings(steps=settings["steps"], **chosen), keep)
    finally:
        replay.save()
    draw(scene, found, folder / "shadow.png")
    shown = {"summary": lines_of(found, TRUE), "losses": found.losses, "pose": found.numbers[-1], "pictures": ["shadow.png"]}
    shown["seconds"] = {"descent": found.seconds}
    return finish(folder, "soft-shadow", settings, shown)
