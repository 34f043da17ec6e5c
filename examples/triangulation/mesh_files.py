"""Meshes in files: PLY with the colours' coefficients and OBJ with colours as materials, written and read, and SVG, written."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teg.errors import InputError
from teg.examples.triangulation.colour_fit import TERMS, colours_at
from teg.examples.triangulation.mesh import Mesh, extent, inner, signed_areas

CHANNELS = ("red", "green", "blue")
TERMS_OF_COLOURS = range(max(TERMS))
PIECES = 8  # at most, per edge: a triangle whose colour is not constant is drawn in so many² flat ones …
STEP = 0.08  # … with colours that differ by about so much
BORDER = 1e-6  # relative: vertices so near to the border are put on it


def write_ply(
    path: Path,
    vertices: np.ndarray,
    triangles: np.ndarray,
    colours: np.ndarray,
    size: tuple[int, int],
    pinned: np.ndarray | None = None,
) -> None:
    """Writes vertices, in pixels, and triangles with the coefficients of their colours (scene.py) as PLY 1.0 in ASCII.

    The property `pinned` of a vertex is 1 if it stays where it is (default: none).
    """
    names = [f"{channel}_{term}" for term in range(colours.shape[1] // 3) for channel in CHANNELS]
    pins = np.zeros(len(vertices), dtype=bool) if pinned is None else pinned
    lines = ["ply", "format ascii 1.0", f"comment picture {size[0]} {size[1]}", f"element vertex {len(vertices)}"]
    lines += [*(f"property double {axis}" for axis in "xyz"), "property uchar pinned"]
    lines += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    lines += [*(f"property double {name}" for name in names), "end_header"]
    lines += [f"{x!r} {y!r} 0 {pin}" for (x, y), pin in zip(vertices.tolist(), pins.astype(int).tolist(), strict=True)]
    lines += [" ".join(map(str, [3, *face, *colour])) for face, colour in zip(triangles.tolist(), colours.tolist(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def write_obj(path: Path, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray) -> None:
    """Writes vertices, in pixels, and triangles as OBJ, and beside it the colours at their centroids, a material each, as MTL."""
    means = colours_at(vertices[triangles].mean(axis=1), np.arange(len(triangles)), vertices[triangles], colours).tolist()
    materials = path.with_suffix(".mtl")
    blocks = [f"newmtl face_{k}\nKd {red!r} {green!r} {blue!r}" for k, (red, green, blue) in enumerate(means)]
    materials.write_text("\n".join(blocks) + "\n", encoding="ascii")
    lines = [f"mtllib {materials.name}", *(f"v {x!r} {y!r} 0" for x, y in vertices.tolist())]
    lines += [f"usemtl face_{k}\nf {a} {b} {c}" for k, (a, b, c) in enumerate((triangles + 1).tolist())]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def read_mesh(path: Path, size: tuple[int, int]) -> Mesh:
    """Returns the mesh of a PLY file in ASCII, or of an OBJ file, whose vertices fill the picture after scaling to `size`.

    Vertices with a property `pinned` that is not 0 stay. Colours are those of the faces: coefficients `red_0`, … or `red`, … in a PLY,
    the diffuse colours of the materials of an OBJ. Raises InputError if the file is missing or another, or its triangles do not cover a
    rectangle once.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        parts = _obj_parts(path, lines) if path.suffix.lower() == ".obj" else _ply_parts(lines)
        parts.check()
    except OSError as problem:
        raise InputError(f"cannot read {problem.filename!r}", None, str(problem.strerror)) from None
    except (ValueError, IndexError, KeyError, StopIteration) as problem:
        raise InputError(
            f"{str(path)!r} is not a mesh of triangles in ASCII PLY or OBJ: {problem}", None, "name the mesh.ply that an earlier run wrote"
        ) from None
    vertices, triangles = parts.vertices, parts.triangles
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    unit = (vertices - low) / np.where(high > low, high - low, 1)
    unit = np.where(unit < BORDER, 0.0, np.where(unit > 1 - BORDER, 1.0, unit))
    points = unit * np.array(size)
    areas = signed_areas(points, triangles)
    if areas.sum() < 0:
        triangles, areas = triangles[:, ::-1].copy(), -areas
    if areas.min() <= 0 or abs(areas.sum() / (size[0] * size[1]) - 1) > 1e-6:
        raise InputError(f"the triangles of {str(path)!r} do not cover a rectangle once", None, "all of one orientation, none folded over")
    return Mesh(points, triangles, inner(points, size) & ~parts.pinned[:, None], size, parts.colours)


@dataclass(frozen=True)
class Parts:
    """What a file says: vertices (n, 2), triangles (m, 3), which vertices are pinned (n,), colours (m, 3·terms) or None."""

    vertices: np.ndarray
    triangles: np.ndarray
    pinned: np.ndarray
    colours: np.ndarray | None

    def check(self) -> None:
        """Raises ValueError for a mesh that cannot be."""
        if len(self.vertices) < 3 or len(self.triangles) < 1:
            raise ValueError("lines are missing")
        if self.triangles.min() < 0 or self.triangles.max() >= len(self.vertices) or not np.isfinite(self.vertices).all():
            raise ValueError("a vertex is not there")
        if self.colours is not None and not np.isfinite(self.colours).all():
            raise ValueError("a colour is no number")


def _ply_parts(lines: list[str]) -> Parts:
    if lines[0].strip() != "ply" or lines[1].split()[:2] != ["format", "ascii"]:
        raise ValueError("not ASCII")
    header = lines.index("end_header")
    counts: dict[str, int] = {}
    kinds: dict[str, dict[str, str]] = {}  # of the properties of each element
    for words in map(str.split, lines[2:header]):
        if words[0] == "element":
            counts[words[1]], kinds[words[1]] = int(words[2]), {}
        elif words[0] == "property":
            kinds[next(reversed(kinds))][words[-1]] = words[1]
    n, m = counts.get("vertex", 0), counts.get("face", 0)
    rows = lines[header + 1 : header + 1 + n + m]
    if list(counts)[:2] != ["vertex", "face"] or len(rows) != n + m:
        raise ValueError("lines are missing")
    of_vertex = list(kinds["vertex"])
    numbers = np.array([[float(word) for word in row.split()] for row in rows[:n]])
    faces = [row.split() for row in rows[n:]]
    if any(face[0] != "3" for face in faces):
        raise ValueError("a face is no triangle")
    triangles = np.array([[int(word) for word in face[1:4]] for face in faces], dtype=np.intp)
    pinned = numbers[:, of_vertex.index("pinned")] != 0 if "pinned" in of_vertex else np.zeros(n, dtype=bool)
    vertices = numbers[:, [of_vertex.index("x"), of_vertex.index("y")]]
    return Parts(vertices, triangles, pinned, _ply_colours(kinds["face"], faces))


def _ply_colours(kinds: Mapping[str, str], faces: list[list[str]]) -> np.ndarray | None:
    """Returns the colours of faces from their properties, the first of which is the list of vertices; bytes are divided by 255."""
    order = list(kinds)
    numbered = [f"{channel}_{term}" for term in TERMS_OF_COLOURS for channel in CHANNELS if f"{channel}_{term}" in kinds]
    names = numbered or [channel for channel in CHANNELS if channel in kinds]
    if not names or len(names) // 3 not in TERMS or len(names) % 3:
        return None
    columns = [order.index(name) + 3 for name in names]  # after the number of vertices and three of them
    unit = 255 if kinds[names[0]] in ("uchar", "uint8") else 1
    return np.array([[float(face[k]) / unit for k in columns] for face in faces])


def _obj_parts(path: Path, lines: list[str]) -> Parts:
    vertices, triangles, colours = [], [], []
    materials: dict[str, list[float]] = {}
    material = ""
    for words in map(str.split, lines):
        match words:
            case ["v", x, y, *_]:
                vertices.append([float(x), float(y)])
            case ["f", *corners]:
                if len(corners) != 3:
                    raise ValueError("a face is no triangle")
                numbers = [int(corner.split("/")[0]) for corner in corners]
                triangles.append([number - 1 if number > 0 else len(vertices) + number for number in numbers])
                colours.append(materials.get(material, [np.nan] * 3))
            case ["mtllib", *names]:
                materials |= _materials(path.with_name(" ".join(names)))
            case ["usemtl", *names]:
                material = " ".join(names)
    known = np.array(colours).reshape(-1, 3)
    pinned = np.zeros(len(vertices), dtype=bool)
    shades = known if len(known) and np.isfinite(known).all() else None
    return Parts(np.array(vertices).reshape(-1, 2), np.array(triangles, dtype=np.intp).reshape(-1, 3), pinned, shades)


def _materials(path: Path) -> dict[str, list[float]]:
    """Returns the diffuse colours of an MTL file by the names of the materials; none if there is no such file."""
    if not path.exists():
        return {}
    shades: dict[str, list[float]] = {}
    name = ""
    for words in map(str.split, path.read_text(encoding="utf-8").splitlines()):
        match words:
            case ["newmtl", *names]:
                name = " ".join(names)
            case ["Kd", red, green, blue]:
                shades[name] = [float(red), float(green), float(blue)]
    return shades


def write_svg(path: Path, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, size: int | tuple[int, int]) -> None:
    """Writes the triangles with their colours, and their edges as thin lines, as an SVG.

    Where two neighbours each cover a part of a pixel, what is behind them shows through. A line of their own colour around them closes
    these seams in a large picture, and in a small one that they are drawn twice, on their mean colour.
    """
    width, height = extent(size)
    corners, values = _flat_pieces(vertices, triangles, colours)
    shades = [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in np.rint(np.clip(values, 0, 1) * 255).astype(int)]
    faces = [
        f'<path d="M{_point(a)}L{_point(b)}L{_point(c)}z" fill="{shade}" stroke="{shade}"/>'
        for (a, b, c), shade in zip(corners, shades, strict=True)
    ]
    areas = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    red, green, blue = np.rint(np.average(np.clip(values, 0, 1), axis=0, weights=areas) * 255).astype(int)
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]))
    edges = "".join(f"M{_point(vertices[a])}L{_point(vertices[b])}" for a, b in np.unique(pairs, axis=0))
    cell = math.sqrt(width * height / len(triangles))
    line, scale = min(max(width, height) / 1000, cell / 30), 1024 / max(width, height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width * scale:g}" height="{height * scale:g}">',
        f'<rect width="{width}" height="{height}" fill="#{red:02x}{green:02x}{blue:02x}"/>',
        f'<g id="faces" stroke-width="{line:g}" stroke-linejoin="round">',
        *faces,
        "</g>",
        '<use href="#faces"/>',
        f'<path id="edges" d="{edges}" fill="none" stroke="#808080" stroke-opacity="0.3" stroke-width="{line:g}"/>',
        "</svg>",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _flat_pieces(vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners of flat triangles, (p, 3, 2), and their colours, (p, 3): those at their centroids."""
    corners = vertices[triangles]
    faces = np.arange(len(corners))
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    known = colours_at(np.concatenate([corners, middles], axis=1), np.repeat(faces[:, None], 6, axis=1), corners, colours)
    pieces = np.clip(np.ceil(np.ptp(np.clip(known, 0, 1), axis=1).max(axis=1) / STEP), 1, PIECES).astype(int)
    parts = []
    for count in np.unique(pieces):
        which = np.flatnonzero(pieces == count)
        places = _divided(corners[which], int(count))
        shades = colours_at(places.mean(axis=2), np.repeat(which[:, None], count**2, axis=1), corners, colours)
        parts.append((places.reshape(-1, 3, 2), shades.reshape(-1, 3)))
    places, shades = (np.concatenate(each) for each in zip(*parts, strict=True))
    return places, shades


def _divided(corners: np.ndarray, pieces: int) -> np.ndarray:
    """Returns the corners of pieces² triangles of equal area that make up each triangle, (m, pieces², 3, 2)."""
    grid = [(i, j) for i in range(pieces) for j in range(pieces - i)]
    upward = [[(i, j), (i + 1, j), (i, j + 1)] for i, j in grid]
    downward = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in grid if i + j < pieces - 1]
    steps = np.array(upward + downward) / pieces
    return np.asarray(corners[:, None, :1] + np.einsum("ptk,mkd->mptd", steps, corners[:, 1:] - corners[:, :1]))


def _point(p: np.ndarray) -> str:
    return f"{p[0]:.2f} {p[1]:.2f}"
