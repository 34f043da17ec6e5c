"""Meshes in files: PLY with the colours' coefficients, written and read, and SVG, written."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from teg.errors import InputError
from teg.examples.triangulation.colour_fit import colours_at
from teg.examples.triangulation.mesh import Mesh, extent, inner, signed_areas

PIECES = 4  # per edge: a triangle whose colour is not constant is drawn in PIECES² flat ones
BORDER = 1e-6  # relative: vertices so near to the border are put on it


def write_ply(path: Path, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, size: tuple[int, int]) -> None:
    """Writes vertices, in pixels, and triangles with the coefficients of their colours (scene.py) as PLY 1.0 in ASCII."""
    names = [f"{channel}_{term}" for term in range(colours.shape[1] // 3) for channel in ("red", "green", "blue")]
    lines = ["ply", "format ascii 1.0", f"comment picture {size[0]} {size[1]}", f"element vertex {len(vertices)}"]
    lines += [f"property double {axis}" for axis in "xyz"]
    lines += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    lines += [*(f"property double {name}" for name in names), "end_header"]
    lines += [f"{x!r} {y!r} 0" for x, y in vertices.tolist()]
    lines += [" ".join(map(str, [3, *face, *colour])) for face, colour in zip(triangles.tolist(), colours.tolist(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def read_ply(path: Path, size: tuple[int, int]) -> Mesh:
    """Returns the mesh of a PLY file in ASCII, whose vertices fill the picture after scaling to `size`.

    Raises InputError if the file is missing or another, or its triangles do not cover a rectangle once.
    """
    try:
        vertices, triangles = _elements(path.read_text(encoding="ascii").splitlines())
    except OSError as problem:
        raise InputError(f"cannot read {str(path)!r}", None, str(problem.strerror)) from None
    except (ValueError, IndexError, StopIteration) as problem:
        raise InputError(
            f"{str(path)!r} is not a mesh of triangles in ASCII PLY: {problem}", None, "name the mesh.ply that an earlier run wrote"
        ) from None
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    unit = (vertices - low) / np.where(high > low, high - low, 1)
    unit = np.where(unit < BORDER, 0.0, np.where(unit > 1 - BORDER, 1.0, unit))
    points = unit * np.array(size)
    areas = signed_areas(points, triangles)
    if areas.sum() < 0:
        triangles, areas = triangles[:, ::-1].copy(), -areas
    if areas.min() <= 0 or abs(areas.sum() / (size[0] * size[1]) - 1) > 1e-6:
        raise InputError(f"the triangles of {str(path)!r} do not cover a rectangle once", None, "all of one orientation, none folded over")
    return Mesh(points, triangles, inner(points, size), size)


def _elements(lines: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Returns vertices (n, 2) and triangles (m, 3)."""
    if lines[0].strip() != "ply" or lines[1].split()[:2] != ["format", "ascii"]:
        raise ValueError("not ASCII")
    header = lines.index("end_header")
    counts = {words[1]: int(words[2]) for words in map(str.split, lines[:header]) if words[:1] == ["element"]}
    n, m = counts.get("vertex", 0), counts.get("face", 0)
    rows = lines[header + 1 : header + 1 + n + m]
    if len(rows) != n + m or n < 3 or m < 1:
        raise ValueError("lines are missing")
    vertices = np.array([[float(word) for word in row.split()[:2]] for row in rows[:n]])
    faces = [row.split() for row in rows[n:]]
    if any(face[0] != "3" for face in faces):
        raise ValueError("a face is no triangle")
    triangles = np.array([[int(word) for word in face[1:4]] for face in faces], dtype=np.intp)
    if triangles.min() < 0 or triangles.max() >= n or not np.isfinite(vertices).all():
        raise ValueError("a vertex is not there")
    return vertices, triangles


def write_svg(path: Path, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, size: int | tuple[int, int]) -> None:
    """Writes the triangles with their colours, and their edges as thin lines, as an SVG."""
    width, height = extent(size)
    faces = []
    for corners, values in zip(*_flat_pieces(vertices, triangles, colours), strict=True):
        a, b, c = corners
        red, green, blue = np.rint(np.clip(values, 0, 1) * 255).astype(int)
        colour = f"#{red:02x}{green:02x}{blue:02x}"  # the stroke closes the seams of antialiasing
        faces.append(f'<path d="M{_point(a)}L{_point(b)}L{_point(c)}z" fill="{colour}" stroke="{colour}"/>')
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]))
    edges = "".join(f"M{_point(vertices[a])}L{_point(vertices[b])}" for a, b in np.unique(pairs, axis=0))
    line, scale = max(width, height) / 1000, 1024 / max(width, height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width * scale:g}" height="{height * scale:g}">',
        f'<g id="faces" stroke-width="{line:g}" stroke-linejoin="round">',
        *faces,
        "</g>",
        f'<path id="edges" d="{edges}" fill="none" stroke="#fff" stroke-opacity="0.25" stroke-width="{line:g}"/>',
        "</svg>",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _flat_pieces(vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners of flat triangles, (p, 3, 2), and their colours, (p, 3): those at their centroids."""
    corners = vertices[triangles]
    pieces = PIECES if colours.shape[1] > 3 else 1
    grid = [(i, j) for i in range(pieces) for j in range(pieces - i)]
    upward = [[(i, j), (i + 1, j), (i, j + 1)] for i, j in grid]
    downward = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in grid if i + j < pieces - 1]
    steps = np.array(upward + downward) / pieces
    sides = corners[:, 1:] - corners[:, :1]
    places = corners[:, None, :1] + np.einsum("ptk,mkd->mptd", steps, sides)
    values = colours_at(places.mean(axis=2), np.repeat(np.arange(len(corners))[:, None], len(steps), axis=1), corners, colours)
    return places.reshape(-1, 3, 2), values.reshape(-1, 3)


def _point(p: np.ndarray) -> str:
    return f"{p[0]:.2f} {p[1]:.2f}"
