"""The pose of a mesh from one picture, with its parts in front of each other.

    teg demo occlusion                      (python -m teg.examples.occlusion runs it without pictures)

A torus of flat grey triangles is seen in perspective. A pixel is the integral of the colour of the nearest triangle, one `teg.nearest` over
the pixel's list of candidates: exact antialiasing, and exact derivatives by the pose, those of the borders where one part hides another
among them. From a turned and shifted pose a quasi-Newton method descends to the pose of the picture. Without the derivatives of the borders
(plain automatic differentiation) the gradient of flat colours is 0, and nothing moves.

On the screen 1/depth is affine in a triangle, as are barycentric coordinates: guards and keys are affine, whatever the pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import teg
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.replay import Keep, Replay, not_kept
from teg.ir.expr import Expr

Array = npt.NDArray[np.float64]
AROUND, ALONG = 10, 24
"""Vertices around the tube, and along it."""
FOCAL = 1.6
BACKGROUND = 0.05
POSE = ("turn", "tilt", "roll", "right", "up", "far")
TRUE = dict(zip(POSE, (0.5, 0.9, 0.2, 0.1, -0.05, 4.2), strict=True))
START = dict(zip(POSE, (0.72, 0.7, 0.05, -0.05, 0.08, 4.6), strict=True))

x, y = teg.vars("x y")
P, C, T = teg.array("P", 2), teg.array("C"), teg.array("T", 2)
F, RANGES, LIST = teg.indices("F", 2), teg.indices("R", 2), teg.indices("L")
i, j, k = teg.index("i"), teg.index("j"), teg.index("k")


def torus() -> tuple[Array, npt.NDArray[np.int64], Array]:
    """Returns vertices, faces that turn to the left when they are seen from outside, and a grey for each face."""
    a, b = (2 * np.pi * np.arange(n) / n for n in (ALONG, AROUND))
    ring = 1 + 0.42 * np.cos(b)
    points = np.stack([np.outer(np.cos(a), ring), np.outer(np.sin(a), ring), np.tile(0.42 * np.sin(b), (ALONG, 1))], axis=-1)
    number = np.arange(ALONG * AROUND).reshape(ALONG, AROUND)
    one, two = np.roll(number, -1, 0), np.roll(number, -1, 1)
    both = np.roll(one, -1, 1)
    faces = np.concatenate([np.stack([number, one, both], -1).reshape(-1, 3), np.stack([number, both, two], -1).reshape(-1, 3)])
    vertices = points.reshape(-1, 3)
    u, v = (vertices[faces[:, n]] - vertices[faces[:, 0]] for n in (1, 2))
    normals = np.cross(u, v)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    stripes = 0.25 * (np.arange(len(faces)) % (ALONG * AROUND) // (2 * AROUND) % 2)
    return vertices, faces, 0.45 + 0.3 * normals @ np.array([0.6, -0.3, 0.74]) + stripes


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


def candidates(vertices: Array, faces: npt.NDArray[np.int64], pose: dict[str, float], size: int) -> dict[str, Any]:
    """Returns the faces whose bounding boxes meet a pixel, for each pixel; those that turn away are hidden by others."""
    px, py, _ = seen((vertices[:, 0], vertices[:, 1], vertices[:, 2]), pose, np)
    places = (np.stack([px, py], axis=-1)[faces] + 1) * size / 2
    (ux, uy), (vx, vy) = (places[:, 1] - places[:, 0]).T, (places[:, 2] - places[:, 0]).T
    (front,) = np.nonzero(ux * vy - uy * vx > 0)
    first = np.clip(np.floor(places[front].min(axis=1) - 1e-6), 0, size).astype(int)
    last = np.clip(np.ceil(places[front].max(axis=1) + 1e-6), 0, size).astype(int)
    pixels, owners = [np.zeros(0, dtype=int)], [np.zeros(0, dtype=int)]
    for face, (left, low), (right, high) in zip(front, first, last, strict=True):
        met = (np.arange(low, high)[:, None] * size + np.arange(left, right)).ravel()
        pixels.append(met)
        owners.append(np.full(len(met), face))
    where, who = np.concatenate(pixels), np.concatenate(owners)
    order = np.argsort(where, kind="stable")
    ends = np.cumsum(np.bincount(where, minlength=size * size))
    return {"R": np.stack([np.concatenate([[0], ends[:-1]]), ends], axis=1), "L": who[order]}


@dataclass
class Descent:
    """Poses and losses, one for each evaluation, and pictures of the first, the last and the true pose."""

    poses: list[dict[str, float]] = field(default_factory=list)
    losses: list[float] = field(default_factory=list)
    pictures: list[Array] = field(default_factory=list)


class Scene:
    """The compiled program and the mesh."""

    def __init__(self, size: int, backend: Backend, discontinuities: Discontinuities) -> None:
        self.size = size
        self.vertices, self.faces, self.colours = torus()
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


def descend(
    size: int = 48, steps: int = 60, backend: Backend = "c", discontinuities: Discontinuities = "sift", keep: Keep = not_kept
) -> Descent:
    """Returns the descent from one pose to that of a picture; `keep` keeps its evaluations."""
    from scipy.optimize import minimize

    scene, found = Scene(size, backend, discontinuities), Descent()
    target = scene.picture(TRUE)

    def evaluated(numbers: Array) -> Array:
        value, slopes = scene.loss_and_slopes(dict(zip(POSE, map(float, numbers), strict=True)), target)
        return np.array([value, *(float(slopes[name]) for name in POSE)])

    kept = keep(f"loss, {discontinuities}", evaluated)

    def objective(numbers: Array) -> tuple[float, Array]:
        value, *slopes = kept(numbers)
        found.poses.append(dict(zip(POSE, map(float, numbers), strict=True)))
        found.losses.append(float(value))
        return float(value), np.array(slopes)

    start = np.array([START[name] for name in POSE])
    end = minimize(objective, start, jac=True, method="L-BFGS-B", options={"maxiter": steps, "ftol": 1e-16, "gtol": 1e-9})
    best = dict(zip(POSE, map(float, end.x), strict=True))
    found.poses.append(best)
    found.losses.append(float(end.fun))
    found.pictures = [scene.picture(START), scene.picture(best), target]
    return found


def draw(found: Descent, path: Path) -> None:
    """Writes the pictures of the first, the last and the true pose, and the losses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 3.2), layout="constrained")
    for n, (title, picture) in enumerate(zip(("start", "end", "picture"), found.pictures, strict=True)):
        axes = figure.add_subplot(1, 4, n + 1)
        axes.imshow(picture, origin="lower", cmap="gray", vmin=0, vmax=1, interpolation="nearest")
        axes.set_title(title)
        axes.axis("off")
    axes = figure.add_subplot(1, 4, 4)
    axes.semilogy(np.maximum(found.losses, 1e-16))
    axes.set_title("loss, by evaluation")
    figure.savefig(path, dpi=100)


def main(size: int = 48, steps: int = 60, backend: Backend = "c", out: Path | None = None, keep: Keep = not_kept) -> Descent:
    """Descends and prints; writes the picture to a folder."""
    found, plain = descend(size, steps, backend, keep=keep), descend(size, steps, backend, "ignore", keep)
    print(f"{size}² pixels, {2 * AROUND * ALONG} triangles, backend {backend}, {len(found.losses) - 1} evaluations")
    print(f"loss {found.losses[0]:.6g} -> {found.losses[-1]:.3g}; without the derivatives of borders {plain.losses[-1]:.6g}")
    for name in POSE:
        print(f"{name:<6}{START[name]:>8.3f} -> {found.poses[-1][name]:>12.8f}   picture {TRUE[name]:>6.3f}")
    if out is not None:
        draw(found, out / "pose.png")
    return found


def run_occlusion(out: str | Path = "out/occlusion", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Descends, prints the pose and draws it; writes to `out`, returns the contents of run.json. It has no progress bar.

    The options are those of `teg demo occlusion` (`examples/options.py`); nothing is random, so any `seed` gives the same. Raises
    InputError for options and checkpoints that cannot be used, MissingPackageError. A checkpoint is written every two seconds.
    """
    from teg.examples.harness import finish, require_packages, result_folder
    from teg.examples.options import resolved

    require_packages("occlusion demo", {"matplotlib": "matplotlib", "scipy": "scipy"}, progress=False)
    settings = resolved("occlusion", {"out": out, **options})
    folder = result_folder(Path(out))
    replay = Replay(folder / "checkpoint.npz", {k: settings[k] for k in ("size", "backend")}, settings["resume"])
    try:
        found = main(settings["size"], settings["steps"], settings["backend"], folder, replay.kept)
    finally:
        replay.save()
    report = {
        "summary": [f"descent: loss {found.losses[0]:.3g} → {found.losses[-1]:.3g} after {len(found.losses) - 1} evaluations"],
        "losses": found.losses,
        "pose": found.poses[-1],
        "pictures": ["pose.png"],
    }
    return finish(folder, "occlusion", settings, report)


if __name__ == "__main__":
    main()
