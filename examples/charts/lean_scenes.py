"""Scenes of every kind with the least work that is known for them: nodes that the degree needs, and nanoseconds by hand.

Scene.build()      the program, and what it is differentiated by
Scene.draw(rng)    parameter values: columns of a batch, or the arrays of one program with sums
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import teg
from teg.examples import occlusion
from teg.ir.expr import Expr

Built = tuple[Expr, list[Any]]
Values = dict[str, Any]
Random = np.random.Generator
Range = tuple[float, float]
N = 16384
"""Elements of a batch: so many that the call itself does not count."""

x, y, z = teg.vars("x y z")
t, a, b, s, m, k = teg.params("t a b s m k")
LANES = (
    "a prototype in C: linear colours, moments by Green's theorem, eight pixels in lanes, AVX-512, begun and ended once a triangle; its "
    "error grows as the inverse square of the height"
)
ARCS = "a prototype in C: arcs between what cuts them, Gauss nodes in the angle"


@dataclass(frozen=True)
class Least:
    """The least known: evaluations of the integrand, 0 for a closed form; a function of by_hand.c, measured in the same run, or else
    nanoseconds of an element measured before, and how."""

    evaluations: int
    by_hand: str = ""
    nanoseconds: float = math.nan
    source: str = ""


@dataclass(frozen=True)
class Scene:
    """A scene. `share` is the number of elements in one call of a program with sums; `small` is the same with fewer, for counting."""

    name: str
    build: Callable[[], Built]
    draw: Callable[[Random], Values]
    least: Least
    share: int = 1
    small: tuple[Callable[[Random], Values], int] | None = None


def nodes_in_a_plane(degree: int) -> int:
    """Returns the least nodes of any rule in two variables of a degree: the polynomials of half of it are as many (Stroud 1971)."""
    return math.comb(degree // 2 + 2, 2)


def nodes_on_a_line(degree: int) -> int:
    """Returns the least nodes of a rule in one variable."""
    return degree // 2 + 1


def uniform(n: int = N, /, **ranges: Range) -> Callable[[Random], Values]:
    """Returns independent uniform columns of n."""
    return lambda rng: {name: rng.uniform(lo, hi, n) for name, (lo, hi) in ranges.items()}


def over_square(body: Any) -> Expr:
    result: Expr = teg.integral(body, (x, 0, 1), (y, 0, 1))
    return result


# -- pixels ------------------------------------------------------------------------------------------------------------

VERTICES = [name for i in range(3) for name in (f"x{i}", f"y{i}")]
TARGETS = ["t0", "t1", "t2"]


def triangle_pixel(order: int) -> Built:
    """Returns ∫ over a pixel of [in a counterclockwise triangle]·Σ (colour - target)², colours constant (order 0) or linear (1)."""
    px, py = [teg.param(f"x{i}") for i in range(3)], [teg.param(f"y{i}") for i in range(3)]
    left, bottom, *target = (teg.param(name) for name in ("left", "bottom", *TARGETS))

    def edge(i: int, j: int) -> Expr:
        return (px[j] - px[i]) * (y - py[i]) - (py[j] - py[i]) * (x - px[i])

    edges = [edge(1, 2), edge(2, 0), edge(0, 1)]
    inside = (edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0)
    colours = [teg.param(name) for name in colour_names(order)]
    shown: list[Any] = list(colours)
    if order:
        area = edges[0] + edges[1] + edges[2]
        shown = [sum((e / area * colours[3 * i + c] for i, e in enumerate(edges)), start=0 * x) for c in range(3)]
    loss = teg.bracket(inside) * sum(((c - q) ** 2 for c, q in zip(shown, target, strict=True)), start=0 * x)
    return teg.integral(loss, (x, left, left + 1), (y, bottom, bottom + 1)), [*(teg.param(name) for name in VERTICES), *colours]


def colour_names(order: int) -> list[str]:
    return [f"c{i}{c}" for i in range(3) for c in range(3)] if order else ["c0", "c1", "c2"]


def triangles(order: int, kind: str) -> Callable[[Random], Values]:
    """Returns triangles of about ten pixels and a pixel that they cover, miss or cross with at least one side."""

    def draw(rng: Random) -> Values:
        kept = np.empty((0, 8))
        while len(kept) < N:
            corner = rng.integers(0, 512, (4 * N, 2)).astype(float)
            v = corner[:, None] + 0.5 + (30.0 if kind == "covering" else 10.0) * rng.standard_normal((4 * N, 3, 2))
            first, second = v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]
            clockwise = first[:, 0] * second[:, 1] < first[:, 1] * second[:, 0]
            v[clockwise] = v[clockwise][:, ::-1]
            side = np.roll(v, -1, axis=1) - v
            there = corner[:, None] + 0.5 - v
            at = side[..., 0] * there[..., 1] - side[..., 1] * there[..., 0]
            reach = 0.5 * np.abs(side).sum(axis=2)
            beside, covering = (at < -reach).any(axis=1), (at > reach).all(axis=1)
            near = (v.min(axis=1) < corner + 1).all(axis=1) & (v.max(axis=1) > corner).all(axis=1)
            chosen = {"beside": beside & near, "covering": covering, "crossing": near & ~beside & ~covering}[kind]
            kept = np.concatenate([kept, np.concatenate([v.reshape(-1, 6), corner], axis=1)[chosen]])
        columns = dict(zip([*VERTICES, "left", "bottom"], kept[:N].T.copy(), strict=True))
        return columns | {name: rng.random(N) for name in (*colour_names(order), *TARGETS)}

    return draw


def bilinear_pixel() -> Built:
    """Returns ∫ over the unit square of (colour - target)², the colour above or below as interpolated corner values exceed t or not."""
    corners = teg.params("c00 c10 c01 c11")
    above, below, target = teg.params("above below target")
    value = (corners[0] * (1 - x) + corners[1] * x) * (1 - y) + (corners[2] * (1 - x) + corners[3] * x) * y
    return over_square(teg.where(value > t, (above - target) ** 2, (below - target) ** 2)), [*corners, t, above, below]


def mesh_pixel(size: int, faces: int) -> Callable[[Random], Values]:
    """Returns the arrays of a torus of so many triangles in size² pixels."""

    def draw(rng: Random) -> Values:
        vertices, sides, colours = occlusion.scene_of(faces)
        lists = occlusion.candidates(vertices, sides, occlusion.TRUE, size)
        given = {"P": vertices, "F": sides, "C": colours, "T": np.full((size, size), 0.3)}
        return {**given, **lists, **occlusion.TRUE}

    return draw


def mesh_program() -> Built:
    return occlusion.loss(), [*(teg.param(name) for name in occlusion.POSE), occlusion.T]


def picture() -> Built:
    """Returns the loss of a picture: a sum over faces, and the pixels of their boxes, of `triangle_pixel`, linear colours."""
    vertices, colours, target = teg.array("V", 2), teg.array("C", 2), teg.array("T", 3)
    faces, boxes = teg.indices("F", 2), teg.indices("B", 2)
    face, column, row = teg.index("k"), teg.index("i"), teg.index("j")
    corners = [(vertices[faces[face, i], 0], vertices[faces[face, i], 1]) for i in range(3)]

    def edge(i: int, j: int) -> Expr:
        (ax, ay), (bx, by) = corners[i], corners[j]
        return (bx - ax) * (y - ay) - (by - ay) * (x - ax)

    edges = [edge(1, 2), edge(2, 0), edge(0, 1)]
    area = edges[0] + edges[1] + edges[2]
    shown = [sum((e / area * colours[face, 3 * i + c] for i, e in enumerate(edges)), start=0 * x) for c in range(3)]
    inside = teg.bracket((edges[0] > 0) & (edges[1] > 0) & (edges[2] > 0))
    loss = inside * sum(((c - target[row, column, i]) ** 2 for i, c in enumerate(shown)), start=0 * x)
    pixel = teg.integral(loss, (x, column, column + 1), (y, row, row + 1))
    columns, rows = (column, boxes[face, 0], boxes[face, 1]), (row, boxes[face, 2], boxes[face, 3])
    return teg.sum(pixel, columns, rows, (face, 0, teg.length(faces, 0))), [vertices, colours]


def mesh_of(size: int, cells: int) -> Callable[[Random], Values]:
    """Returns the arrays of a jittered grid of 2·cells² triangles over size² pixels."""

    def draw(rng: Random) -> Values:
        width = size / cells
        vertices = np.stack(np.meshgrid(*[np.arange(cells + 1) * width] * 2), axis=-1).reshape(-1, 2)
        movable = (vertices > 0) & (vertices < size)
        vertices = vertices + np.where(movable, width * rng.uniform(-0.25, 0.25, vertices.shape), 0.0)
        corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
        right, above = corner + 1, corner + cells + 1
        faces = np.concatenate([np.stack([corner, right, above + 1], axis=1), np.stack([corner, above + 1, above], axis=1)])
        first, last = np.floor(vertices[faces].min(axis=1)).astype(int), np.ceil(vertices[faces].max(axis=1)).astype(int)
        boxes = np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], axis=1)
        return {"V": vertices, "F": faces, "B": boxes, "C": rng.random((len(faces), 9)), "T": rng.random((size, size, 3))}

    return draw


# -- lines and curves --------------------------------------------------------------------------------------------------


def half_plane() -> Built:
    return over_square(teg.bracket(x + a * y < t)), [t, a]


def disk(body: Any = 1) -> Built:
    return over_square(teg.bracket((x - a) ** 2 + (y - b) ** 2 < t) * body), [t, a, b]


def brackets() -> Built:
    places, heights = ([teg.param(f"{name}{i}") for i in range(50)] for name in "tc")
    total = sum((c * teg.bracket(x < p) for p, c in zip(places, heights, strict=True)), start=0 * x)
    return teg.integral(teg.exp(a * x) * total, (x, 0, 1)), [*places, *heights, a]


def greatest() -> Built:
    slopes, heights = ([teg.param(f"{name}{i}") for i in range(10)] for name in "sh")
    return teg.integral(teg.maximum(*(p * x + q for p, q in zip(slopes, heights, strict=True))), (x, 0, 1)), [*slopes, *heights]


def payoff() -> Built:
    bell = teg.exp(-(x**2) / 2) / math.sqrt(2 * math.pi)
    return teg.integral(teg.maximum(teg.exp(s * x + m) - k, 0) * bell, (x, -math.inf, math.inf)), [s, m, k]


def ball() -> Built:
    inside = teg.bracket((x - a) ** 2 + (y - b) ** 2 + z * z < t)
    return teg.integral(inside, (x, -1, 1), (y, -1, 1), (z, -1, 1)), [t, a, b]


def many(n: int, lo: float, hi: float, *letters: str) -> dict[str, Range]:
    return {f"{letter}{i}": (lo, hi) for letter in letters for i in range(n)}


LINEAR = Least(nodes_in_a_plane(2) + nodes_on_a_line(3), "", 7.3, LANES)
ROUND = {"t": (0.21, 0.3), "a": (0.45, 0.55), "b": (0.45, 0.55)}
SCENES = (
    Scene("half-plane beside the pixel", half_plane, uniform(t=(-2, -1), a=(0.3, 1)), Least(0, "half_plane")),
    Scene("half-plane across", half_plane, uniform(t=(0.2, 1.2), a=(0.3, 1)), Least(0, "half_plane")),
    Scene("triangle beside, constant", lambda: triangle_pixel(0), triangles(0, "beside"), Least(0, "flat_triangle")),
    Scene("triangle covering, constant", lambda: triangle_pixel(0), triangles(0, "covering"), Least(0, "flat_triangle")),
    Scene("triangle crossing, constant", lambda: triangle_pixel(0), triangles(0, "crossing"), Least(0, "", 7.3, LANES)),
    Scene("triangle covering, linear", lambda: triangle_pixel(1), triangles(1, "covering"), Least(nodes_in_a_plane(2), "", 1.5, LANES)),
    Scene("triangle crossing, linear", lambda: triangle_pixel(1), triangles(1, "crossing"), LINEAR),
    Scene(
        "bilinear pixel",
        bilinear_pixel,
        uniform(**dict.fromkeys(("c00", "c10", "c01", "c11", "t", "above", "below", "target"), (0.0, 1.0))),
        Least(0, "", 3.3, "a prototype in C: closed form, one logarithm a branch, eight pixels in lanes, AVX-512"),
    ),
    Scene("disk across four sides, area", disk, uniform(4096, **{**ROUND, "t": (0.303, 0.35)}), Least(0, "disk")),
    Scene("disk × exp·cos", lambda: disk(teg.exp(x) * teg.cos(y)), uniform(2048, **ROUND), Least(65, "", 5200, ARCS)),
    Scene(
        "ball in a box",
        ball,
        uniform(256, t=(0.5, 1.2), a=(-0.3, 0.3), b=(-0.3, 0.3)),
        Least(0, "", 10_000, "an estimate, not a run: slices whose arcs have closed forms"),
    ),
    Scene("[x < t]·exp(ax)", lambda: (teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), [t, a]),
          uniform(t=(0.1, 0.9), a=(0.2, 2)), Least(0, "bracket_exp")),
    Scene("payoff, Gaussian", payoff, uniform(s=(0.1, 0.9), m=(0.1, 0.9), k=(0.1, 0.9)), Least(0, "payoff")),
    Scene("50 brackets × exp", brackets, uniform(2048, **many(50, 0.05, 0.95, "t", "c"), a=(0.2, 2)), Least(0, "brackets")),
    Scene("maximum of 10 lines", greatest, uniform(4096, **many(10, 0.1, 0.9, "s", "h")), Least(0, "greatest")),
    Scene(
        "superellipse",
        lambda: (teg.integral(teg.bracket(x**4 + a * y**4 < t), (x, -1, 1), (y, -1, 1)), [t, a]),
        uniform(512, t=(0.3, 0.6), a=(1, 1.5)),
        Least(0, "superellipse"),
    ),
    Scene("exp·cos, nothing jumps", lambda: (over_square(teg.exp(a * x) * teg.cos(b * y)), [a, b]),
          uniform(a=(0.3, 2), b=(0.3, 2)), Least(0, "exp_cos")),
    Scene(
        "exp(x)·cos(x), a line beside",
        lambda: (over_square(teg.bracket(x + a * y < t) * teg.exp(x) * teg.cos(x)), [t, a]),
        uniform(4096, t=(2, 3), a=(0.3, 0.9)),
        Least(0),
    ),
    Scene(
        "mesh pixel, nearest of 2000",
        mesh_program,
        mesh_pixel(512, 2000),
        Least(0, "", 69, "a prototype in C++: cells cut nearest first, a closed mesh of 2000 faces in 512² pixels"),
        512 * 512,
        (mesh_pixel(48, 60), 48 * 48),
    ),
    Scene(
        "picture, 2048 triangles",
        picture,
        mesh_of(512, 32),
        Least(0, "", 2.3, "a prototype in C: every edge once, prefix sums of the rows' moments; a pixel of the picture"),
        512 * 512,
        (mesh_of(32, 2), 32 * 32),
    ),
)  # fmt: skip
