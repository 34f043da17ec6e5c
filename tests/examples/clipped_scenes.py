"""What the scenes of the demonstrations are to be: numbers of an independent clipper, and brute force over time and lens."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from teg.examples import occlusion
from teg.examples.blur import lens, motion
from teg.examples.soft_shadow import run as shadow
from tests.examples.clipper import Form, area, box, region, within, without

Numbers = dict[str, float]


def clipped_pixel(scene: occlusion.Scene, lists: Mapping[str, Any], pose: Numbers, pixel: int) -> float:
    """A pixel of the picture by the clipper: of every candidate, the part that no nearer one hides."""
    size = scene.size
    row, column = divmod(pixel, size)
    square = box(2 * column / size - 1, 2 * (column + 1) / size - 1, 2 * row / size - 1, 2 * (row + 1) / size - 1)
    shown: list[tuple[float, list[Form], Form]] = []
    for face in lists["L"][slice(*lists["R"][pixel])].tolist():
        px, py, depth = occlusion.seen(tuple(scene.vertices[scene.faces[face]].T), pose, np)  # type: ignore[arg-type]
        plane = np.linalg.solve(np.stack([np.ones(3), px, py], axis=1), 1 / depth)
        c, a, b = plane.tolist()
        shown.append((float(scene.colours[face]), region(np.stack([px, py], axis=1).tolist()), (c, a, b)))
    total, covered = 0.0, 0.0
    for n, (grey, forms, near) in enumerate(shown):
        parts = [within(square, forms)]
        for m, (_, others, other) in enumerate(shown):
            if m != n and len(parts[0] if parts else []) > 2:
                nearer: Form = (other[0] - near[0], other[1] - near[1], other[2] - near[2])
                parts = without(parts, [*others, nearer])
        total += grey * area(parts)
        covered += area(parts)
    whole = area([square])
    return (total + occlusion.BACKGROUND * (whole - covered)) / whole


def clipped_share(scene: shadow.Scene, arrays: Mapping[str, Any], pose: Numbers, receiver: int) -> float:
    """The share, as the area of the light without the projections of all triangles, whichever way they turn."""
    origin, *axes = arrays["G"]
    basis, normal = np.linalg.pinv(np.stack(axes, axis=1)), np.cross(*axes)
    eye = arrays["Q"][receiver]
    rays = np.stack(shadow.placed(arrays["P"].T, pose, np), axis=-1) - eye
    stretch = (origin - eye) @ normal / (rays @ normal)
    assert (stretch > 1).all()
    places = (eye + stretch[:, None] * rays - origin) @ basis.T
    seen = whole = [[(float(p), float(q)) for p, q in arrays["L"]]]
    for face in scene.faces:
        forms = region(places[face].tolist())
        if len(within(whole[0], forms)) > 2:
            seen = without(seen, forms)
    return area(seen) / area(whole)


def mean(size: int, corners: Any, row: int, column: int) -> float:
    """The part of a pixel that is in a triangle."""
    side = 2 / size
    left, bottom = column * side - 1, row * side - 1
    return area([within(box(left, left + side, bottom, bottom + side), region(corners))]) / side**2


def over_time(size: int, numbers: Numbers, row: int, column: int, count: int) -> float:
    """The exposure of a pixel by the midpoint rule, whose error falls with the square of `count`."""
    times = (np.arange(count) + 0.5) / count
    return math.fsum(2 * s * mean(size, motion.corners_at(s, numbers, np), row, column) for s in times.tolist()) / count


def over_lens(size: int, numbers: Numbers, row: int, column: int, count: int, slits: int = 12) -> float:
    """A pixel by the midpoint rule in each slit."""
    total = 0.0
    for v, half, weight in lens.slits(slits).tolist():
        places = half * ((np.arange(count) + 0.5) * 2 / count - 1)
        total += 2 * half * weight * math.fsum(mean(size, lens.corners_from((s, v), numbers), row, column) for s in places.tolist()) / count
    return total
