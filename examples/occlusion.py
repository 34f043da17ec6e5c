"""The pose of a mesh from one picture, with its parts in front of each other.

    teg demo occlusion
    teg demo occlusion --size 1024 --triangles 100000

A torus of flat grey triangles is seen in perspective. A pixel is the integral of the colour of the nearest triangle, one `teg.nearest` over
the pixel's list of candidates: exact antialiasing, and exact derivatives by the pose, those of the borders where one part hides another
among them. From a turned and shifted pose a quasi-Newton method descends to the pose of the picture. Without the derivatives of the borders
(plain automatic differentiation) the gradient of flat colours is 0, and nothing moves.

On the screen 1/depth is affine in a triangle, as are barycentric coordinates: guards and keys are affine, whatever the pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.bins import binned
from teg.examples.fit import Fit, draw_losses, draw_pictures, fit, lines_of
from teg.examples.meshes import Array, Faces, grid_of, normals_of, torus
from teg.examples.replay import Keep, Replay, not_kept
from teg.ir.expr import Expr

FOCAL = 1.6
BACKGROUND = 0.05
POSE = ("turn", "tilt", "roll", "right", "up", "far")
TRUE = dict(zip(POSE, (0.5, 0.9, 0.2, 0.1, -0.05, 4.2), strict=True))
START = dict(zip(POSE, (0.72, 0.7, 0.05, -0.05, 0.08, 4.6), strict=True))

x, y = teg.vars("x y")
P, C, T = teg.array("P", 2), teg.array("C"), teg.array("T", 2)
F, RANGES, LIST = teg.indices("F", 2), teg.indices("R", 2), teg.indices("L")
i, j, k = teg.index("i"), teg.index("j"), teg.index("k")


def scene_of(triangles: int) -> tuple[Array, Faces, Array]:
    """Returns vertices, faces, and a grey for each face, of a torus of about so many triangles."""
    along, around = grid_of(triangles)
    vertices, faces = torus(along, around)
    row = np.arange(len(faces)) % (along * around) // around
    stripes = 0.25 * (row * 12 // along % 2)
    return vertices, faces, 0.45 + 0.3 * normals_of(vertices, faces) @ np.array([0.6, -0.3, 0.74]) + stripes


def seen(point: tuple[Any, Any, Any], pose: dict[str, Any], of: Any) -> tuple[Any, Any, Any]:
    """Returns the place of a point on the screen and its depth, by the functions of a module: `teg` or `numpy`."""
    px, py, pz = point
    px, py = of.cos(pose["roll"]) * px - of.sin(pose["roll"]) * py, of.sin(pose["roll"]) * px + of.cos(pose["roll"]) * py
    py, pz = of.cos(pose["tilt"]) * py - of.sin(pose["tilt"]) * pz, of.sin(pose["tilt"]) * py + of.cos(pose["tilt"]) * pz
    pz, px = of.cos(pose["turn"]) * pz - of.sin(pose["turn"]) * px, of.sin(pose["turn"]) * pz + of.cos(pose["turn"]) * px
    depth = pose["far"] - pz
    return FOCAL * (px + pose["right"]) / depth, FOCAL * (py + pose["up"]) / depth, depth


def loss() -> Expr:
    """Returns the sum of squares of the differences between pixels and those of a picture T, on the screen [-1, 1]²."""
    pose = {name: teg.param(name) for name in POSE}
    face, size = LIST[k], teg.length(T)
    corners = [seen((P[F[face, n], 0], P[F[face, n], 1], P[F[face, n], 2]), pose, teg) for n in range(3)]

    def across(a: Any, b: Any, px: Any, py: Any) -> Any:
        return (b[0] - a[0]) * (py - a[1]) - (b[1] - a[1]) * (px - a[0])

    area = across(corners[0], corners[1], corners[2][0], corners[2][1])
    weights = [across(corners[(n + 1) % 3], corners[(n + 2) % 3], x, y) / area for n in range(3)]
    key = -(weights[0] / corners[0][2] + weights[1] / corners[1][2] + weights[2] / corners[2][2])
    inside = (area > 0) & (weights[0] > 0) & (weights[1] > 0) & (weights[2] > 0)
    row = i * size + j
    colour = teg.nearest(C[face], key, (k, RANGES[row, 0], RANGES[row, 1]), where=inside, otherwise=BACKGROUND)
    pixel = (x, 2 * j / size - 1, 2 * (j + 1) / size - 1), (y, 2 * i / size - 1, 2 * (i + 1) / size - 1)
    mean = teg.integral(colour, *pixel) * size * size / 4
    return teg.sum((mean - T[i, j]) ** 2, (j, 0, size), (i, 0, size))


def candidates(vertices: Array, faces: Faces, pose: dict[str, float], size: int) -> dict[str, Any]:
    """Returns the faces whose bounding boxes meet a pixel, for each pixel; those that turn away are hidden by others."""
    px, py, _ = seen((vertices[:, 0], vertices[:, 1], vertices[:, 2]), pose, np)
    places = (np.stack([px, py], axis=-1)[faces] + 1) * size / 2
    (ux, uy), (vx, vy) = (places[:, 1] - places[:, 0]).T, (places[:, 2] - places[:, 0]).T
    (front,) = np.nonzero(ux * vy - uy * vx > 0)
    first = np.clip(np.floor(places[front].min(axis=1) - 1e-6), 0, size).astype(int)
    last = np.clip(np.ceil(places[front].max(axis=1) + 1e-6), 0, size).astype(int)
    ranges, owners = binned(front, first, last, (1, size))
    return {"R": ranges, "L": owners}


class Scene:
    """The compiled program and the mesh."""

    def __init__(self, size: int, triangles: int, backend: Backend, discontinuities: Discontinuities = "sift") -> None:
        self.size = size
        self.vertices, self.faces, self.colours = scene_of(triangles)
        wanted: list[Any] = [*(teg.param(name) for name in POSE), T]
        self.evaluator = teg.compile(loss(), wanted, backend=backend, discontinuities=discontinuities)

    def loss_and_slopes(self, pose: dict[str, float], picture: Array) -> tuple[float, dict[str, Any]]:
        """Returns the loss and its derivatives."""
        lists = candidates(self.vertices, self.faces, pose, self.size)
        value, slopes = self.evaluator.value_and_grad(P=self.vertices, F=self.faces, C=self.colours, T=picture, **lists, **pose)
        return float(value), slopes

    def picture(self, pose: dict[str, float]) -> Array:
        """Returns the pixels, as the derivative by those of a black picture."""
        slopes = self.loss_and_slopes(pose, np.zeros((self.size, self.size)))[1]
        return np.asarray(-0.5 * slopes["T"])


@dataclass
class Settings:
    """How large, how long, in what."""

    size: int = 48
    triangles: int = 480
    steps: int = 60
    backend: Backend = "c"


def descend(settings: Settings, discontinuities: Discontinuities = "sift", keep: Keep = not_kept) -> Fit:
    """Returns the descent from one pose to that of a picture; `keep` keeps its evaluations."""
    scene = Scene(settings.size, settings.triangles, settings.backend, discontinuities)
    target = scene.picture(TRUE)
    found = fit(lambda pose: scene.loss_and_slopes(pose, target), START, settings.steps, keep, f"loss, {discontinuities}")
    found.pictures = {"start": scene.picture(START), "end": scene.picture(found.numbers[-1]), "picture": target}
    return found


def draw(found: Fit, path: Path) -> None:
    """Writes the pictures of the first, the last and the true pose, and the losses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 3.2), layout="constrained")
    axes = figure.subplots(1, 4)
    draw_pictures(axes, found)
    draw_losses(axes[3], found)
    figure.savefig(path, dpi=100)


def run_occlusion(out: str | Path = "out/occlusion", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Descends and draws the pose; writes to `out`, returns the contents of run.json.

    The options are those of `teg demo occlusion` (`examples/options.py`); nothing is random, so any `seed` gives the same. Raises
    InputError for options and checkpoints that cannot be used, MissingPackageError. A checkpoint is written every two seconds.
    """
    from teg.examples.harness import evaluations_shown, finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("occlusion demo", {"matplotlib": "matplotlib", "scipy": "scipy", "tqdm": "tqdm"}, progress)
    settings = resolved("occlusion", {"out": out, **options})
    folder = result_folder(Path(out))
    chosen = {k: settings[k] for k in ("size", "triangles", "backend")}
    replay = Replay(folder / "checkpoint.npz", chosen, settings["resume"])
    kind = settings["discontinuities"]
    try:
        with evaluations_shown(progress, replay.kept, "occlusion") as keep:
            found, plain = (descend(Settings(steps=settings["steps"], **chosen), how, keep) for how in (kind, "ignore"))
    finally:
        replay.save()
    draw(found, folder / "pose.png")
    report = {
        "summary": [*lines_of(found, TRUE), f"without the derivatives of borders the loss stays {plain.losses[-1]:.6g}"],
        "losses": found.losses,
        "seconds": {"descent": found.seconds},
        "pose": found.numbers[-1],
        "pictures": ["pose.png"],
    }
    return finish(folder, "occlusion", settings, report)
