"""Refinement of a mesh: edges are flipped, bad triangles are split, useless vertices are removed, by what each change gains exactly.

The gain of a change is the loss of the triangles that it removes, less that of those that it makes, each in its best colours; one call of
the compiled program measures all candidates. Changes are taken from the best on, none at a triangle that another one has changed, so their
gains add up. A split is made if it gains more than a removal that pays for it loses: the number of triangles stays about the same.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from teg.examples.triangulation.descent import State, fresh_memory
from teg.examples.triangulation.image_loss import ImageLoss
from teg.examples.triangulation.mesh import Mesh, inner, pin_border, signed_areas

WORTH = 1.2  # a split must gain this much more than a removal loses
LARGEST_SHARE = 0.1  # of the triangles, changed by splits in one refinement
LEAST = 4.0  # areas of new triangles, in least areas of the mesh


@dataclass(frozen=True)
class Change:
    """Faces that go, and the corners of those that come; a vertex that is new has the number -1 and stands at `middle`."""

    kind: str
    faces: tuple[int, ...]
    corners: tuple[tuple[int, int, int], ...]
    middle: tuple[float, float] = (0.0, 0.0)


def refine(image: ImageLoss, state: State, size: tuple[int, int], pinned_border: bool = False) -> State:
    """Returns the state after one refinement: never with a larger loss. Vertices that cannot move stay, and do so afterwards."""
    mesh = state.mesh(size)
    image.triangles = mesh.triangles
    losses, _ = image.fit(state.vertices, state.colours)
    changes = [change for change in candidates(mesh) if change.corners]
    corners, owners = _corners(mesh, changes)
    sound = _are_sound(mesh, changes, corners, owners)
    changes = [change for change, fine in zip(changes, sound, strict=True) if fine]
    if not changes:
        return state
    corners, owners = _corners(mesh, changes)
    gains = np.array([losses[list(change.faces)].sum() for change in changes])
    gains -= np.bincount(owners, image.fit_apart(corners), len(changes))
    chosen = choose(changes, gains, len(mesh.triangles))
    if not chosen:
        return state
    refined = _applied(image, state, mesh, chosen)
    return replace(refined, movable=pin_border(refined.mesh(size)).movable) if pinned_border else refined


def candidates(mesh: Mesh) -> Iterator[Change]:
    """Yields all flips of an edge, splits of the longest edges of triangles, and removals of a vertex into a neighbour."""
    points = mesh.vertices
    faces = [tuple(map(int, face)) for face in mesh.triangles]
    beside: dict[tuple[int, int], list[int]] = defaultdict(list)
    around: dict[int, list[int]] = defaultdict(list)
    longest = set()
    for number, face in enumerate(faces):
        edges = [_edge(face[k], face[k - 2]) for k in range(3)]
        longest.add(max(edges, key=lambda e: float(np.sum((points[e[0]] - points[e[1]]) ** 2))))
        for edge, corner in zip(edges, face, strict=True):
            beside[edge].append(number)
            around[corner].append(number)
    for edge, owners in beside.items():
        if len(owners) == 2:
            yield _flip(faces, edge, owners)
        if edge in longest:
            yield _split(faces, points, edge, owners)
    neighbours: dict[int, set[int]] = defaultdict(set)
    for a, b in beside:
        neighbours[a].add(b)
        neighbours[b].add(a)
    for vertex, numbers in around.items():
        for other in sorted(neighbours[vertex]):
            if _may_merge(mesh, vertex, other):
                kept = [faces[n] for n in numbers if other not in faces[n]]
                merged = tuple((_swap(a, vertex, other), _swap(b, vertex, other), _swap(c, vertex, other)) for a, b, c in kept)
                yield Change("remove", tuple(numbers), merged)


def choose(changes: list[Change], gains: np.ndarray, count: int) -> list[Change]:
    """Returns the changes to make: every flip that gains, and pairs of a split and a removal that gain together."""
    locked: set[int] = set()
    chosen: list[Change] = []

    def take(change: Change) -> None:
        locked.update(change.faces)
        chosen.append(change)

    order = np.argsort(-gains, kind="stable").tolist()
    queues = {kind: [k for k in order if changes[k].kind == kind] for kind in ("flip", "split", "remove")}
    for removal in queues["remove"]:
        around = set(changes[removal].faces)
        if not locked.isdisjoint(around):
            continue
        split = next((k for k in queues["split"] if (locked | around).isdisjoint(changes[k].faces)), None)
        if split is None or len(locked) > LARGEST_SHARE * count or gains[split] + WORTH * gains[removal] <= 0:
            break
        take(changes[split])
        take(changes[removal])
    for flip in queues["flip"]:
        if gains[flip] > 0 and locked.isdisjoint(changes[flip].faces):
            take(changes[flip])
    return chosen


def _applied(image: ImageLoss, state: State, mesh: Mesh, chosen: list[Change]) -> State:
    """Returns the state with the changes made, and its vertices numbered anew."""
    gone = {n for change in chosen for n in change.faces}
    points = [*mesh.vertices.tolist()]
    faces = [face for n, face in enumerate(mesh.triangles.tolist()) if n not in gone]
    for change in chosen:
        if change.kind == "split":
            points.append(list(change.middle))
        faces += [[len(points) - 1 if corner < 0 else corner for corner in corners] for corners in change.corners]
    used, numbers = np.unique(np.array(faces), return_inverse=True)
    vertices, triangles = np.array(points)[used], numbers.reshape(-1, 3).astype(np.intp)
    added = len(points) - len(mesh.vertices)
    memory = np.concatenate([state.memory, fresh_memory(added, mesh.cell)])[used]
    gradient = np.concatenate([state.gradient, np.zeros((added, 2))])[used]
    image.triangles = triangles
    loss, colours = image.best_colours(vertices, np.full((len(triangles), state.colours.shape[1]), 0.1))
    movable = np.concatenate([mesh.movable, np.ones((added, 2), dtype=bool)])[used] & inner(vertices, mesh.size)
    changed = replace(state, vertices=vertices, triangles=triangles, movable=movable, colours=colours)
    return replace(changed, gradient=gradient, memory=memory, loss=loss)


def _flip(faces: list[tuple[int, ...]], edge: tuple[int, int], owners: list[int]) -> Change:
    a, b, c = _turned(faces[owners[0]], edge)
    d = next(corner for corner in faces[owners[1]] if corner not in edge)
    return Change("flip", tuple(owners), ((a, d, c), (d, b, c)))


def _split(faces: list[tuple[int, ...]], points: np.ndarray, edge: tuple[int, int], owners: list[int]) -> Change:
    halves = []
    for owner in owners:
        a, b, c = _turned(faces[owner], edge)
        halves += [(a, -1, c), (-1, b, c)]
    x, y = (points[edge[0]] + points[edge[1]]) / 2
    return Change("split", tuple(owners), tuple(halves), (float(x), float(y)))


def _may_merge(mesh: Mesh, vertex: int, other: int) -> bool:
    """Returns whether a vertex may be moved onto a neighbour: the corners never, vertices of the border along it."""
    fixed = ~mesh.movable[vertex]
    same = mesh.vertices[vertex] == mesh.vertices[other]
    return not fixed.all() and bool((same & ~mesh.movable[other])[fixed].all())


def _corners(mesh: Mesh, changes: list[Change]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the places of the corners of all new triangles, (s, 3, 2), and the number of the change that each belongs to."""
    points = np.concatenate([mesh.vertices, [change.middle for change in changes]])
    owners = np.repeat(np.arange(len(changes)), [len(change.corners) for change in changes])
    numbers = np.array([corners for change in changes for corners in change.corners])
    return points[np.where(numbers < 0, len(mesh.vertices) + owners[:, None], numbers)], owners


def _are_sound(mesh: Mesh, changes: list[Change], corners: np.ndarray, owners: np.ndarray) -> np.ndarray:
    """Returns which changes have no small or turned triangle, and cover the same area as before."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    smallest = np.full(len(changes), np.inf)
    np.minimum.at(smallest, owners, areas)
    old = signed_areas(mesh.vertices, mesh.triangles)
    before = np.array([old[list(change.faces)].sum() for change in changes])
    same = np.abs(np.bincount(owners, areas, len(changes)) - before) < 1e-9 * mesh.area
    return np.asarray((smallest > LEAST * mesh.floor) & same)


def _turned(face: tuple[int, ...], edge: tuple[int, int]) -> tuple[int, int, int]:
    """Returns the corners of a face, turned so that its first two are an edge."""
    for k in range(3):
        a, b, c = face[k], face[k - 2], face[k - 1]
        if _edge(a, b) == edge:
            return a, b, c
    raise AssertionError((face, edge))


def _edge(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _swap(corner: int, before: int, after: int) -> int:
    return after if corner == before else corner
