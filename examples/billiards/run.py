"""Colliding balls by least action: times and places of all contacts, by Newton's method on an integral whose integrand jumps.

scene → order of the contacts and the end → even start → (compiled gradient and Hessian → Newton step) × steps → pictures, animation
"""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from teg.errors import InputError
from teg.evaluator.options import Discontinuities
from teg.examples.billiards.newton import OfUnknowns, Search, even_start, search
from teg.examples.billiards.paths import energies, paths
from teg.examples.billiards.scene import compile_action, unknowns
from teg.examples.billiards.table import Flight, Scene, fly, read_scene
from teg.examples.billiards.table import scene as scene_of
from teg.examples.harness import finish, require_packages, result_folder
from teg.examples.options import resolved
from teg.examples.replay import Replay
from teg.examples.treatments import LABELS

PACKAGES = {"matplotlib": "matplotlib", "PIL": "pillow"}
SAME = 1e-6  # s, m and radians
ANOTHER = "another true path: balls that start like this touch in the same order, and end in the same places"
PICTURES = ("billiards.png", "billiards.gif")


def run_billiards(out: str | Path = "out/billiards", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Finds the contacts of balls by the action alone; writes pictures to `out`, returns the contents of run.json. It has no progress bar.

    The options are those of `teg demo billiards` (`examples/options.py`): scene, balls (a file with another scene), duration, steps,
    discontinuities, alone, seed, backend, resume. The search knows where the balls start and end, and the order of their contacts, which
    are those of a flight by the laws of collisions; the laws it does not know, and the report compares with them. "failure" says that
    Newton's method did not converge, "note" that it found another path that obeys them. With `discontinuities="exact"` the same search is
    run beside it like plain automatic differentiation, unless `alone`. Ctrl-C ends it: the report says "interrupted".

    Raises InputError for options, folders and checkpoints that cannot be used, MissingPackageError.
    """
    require_packages("billiards demo", PACKAGES, False)
    settings = resolved("billiards", {"out": out, **options})
    scene = scene_of(settings["scene"], settings["seed"]) if settings["balls"] is None else read_scene(Path(settings["balls"]))
    if settings["duration"] is not None:
        if settings["duration"] <= 0:
            raise InputError(f"--duration is {settings['duration']:g}", None, "more than 0 s")
        scene = replace(scene, duration=settings["duration"])
    flight = fly(scene)
    folder = result_folder(Path(out))
    identity = {k: settings[k] for k in ("scene", "duration", "seed", "discontinuities", "backend")} | {"balls": repr(scene.balls)}
    replay = Replay(folder / "checkpoint.npz", identity, settings["resume"])
    chosen = settings["discontinuities"]
    found: dict[str, Search] = {}
    for kind in [chosen] if chosen == "ignore" or settings["alone"] else [chosen, "ignore"]:
        begun = time.perf_counter()
        derivatives = _derivatives(scene, flight, settings, kind, replay)
        derivatives(even_start(scene, flight))  # compiled now
        setup = time.perf_counter() - begun
        end = search(scene, flight, derivatives, settings["steps"], settings["seed"])
        found[kind] = end
        end.seconds = {"setup": setup, "descent": time.perf_counter() - begun - setup}
        replay.save()
        if end.interrupted:
            break
    _draw(folder, scene, flight, found)
    parts = {kind: _report(scene, flight, end) for kind, end in found.items()}
    return finish(
        folder,
        "billiards",
        settings,
        parts[chosen]
        | {
            "summary": [f"{len(scene.balls)} balls, {len(flight.contacts)} contacts", *(_line(k, part) for k, part in parts.items())],
            "beside": parts.get("ignore") if chosen == "exact" else None,
            "balls": [{name: list(v) if isinstance(v, tuple) else v for name, v in asdict(ball).items()} for ball in scene.balls],
            "interrupted": any(end.interrupted for end in found.values()),
            "pictures": list(PICTURES),
        },
    )


def _derivatives(scene: Scene, flight: Flight, settings: dict[str, Any], kind: Discontinuities, replay: Replay) -> OfUnknowns:
    """Returns the function from the unknowns to gradient and Hessian of the action."""
    f = compile_action(scene.balls, flight.contacts, scene.gravity, settings["backend"], kind)
    names = unknowns(flight.contacts)
    ends = {f"end_{axis}_{i}": end[k] for i, end in enumerate(flight.ends.tolist()) for k, axis in enumerate("xy")}
    fixed = {name: value for name, value in ({"duration": scene.duration} | ends).items() if name in f.parameters}

    def both(z: np.ndarray) -> np.ndarray:
        values = dict(zip(names, z.tolist(), strict=True)) | fixed
        slopes, bends = f.grad(values), f.hessian(values)
        return np.array([[float(slopes[n]) for n in names], *([float(bends[a, b]) for b in names] for a in names)])

    kept = replay.kept(kind, both)

    def split(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        table = kept(z)
        return table[0], table[1:]

    return split


def _report(scene: Scene, flight: Flight, end: Search) -> dict[str, Any]:
    own, t = paths(scene, flight, end.z), np.linspace(0, scene.duration, 999)
    error = float(np.abs(end.z - flight.unknowns).max())
    total = energies(scene, own, t).sum(axis=0)
    return {
        "converged": not end.failure,
        "failure": "" if end.interrupted else end.failure,
        "steps": len(end.steps),
        "starts": end.starts,
        "newton_steps": end.steps,
        "gradients": end.gradients,
        "unknowns": dict(zip(unknowns(flight.contacts), end.z.tolist(), strict=True)),
        "largest_error": error,
        "note": ANOTHER if error > SAME >= _flown_error(scene, flight, end.z) else "",
        "energy_error": float(np.ptp(total) / np.abs(total).max()),
        "velocities": [path.velocity(np.array([0.0, scene.duration])).tolist() for path in own],
        "seconds": end.seconds,
    }


def _flown_error(scene: Scene, flight: Flight, z: np.ndarray) -> float:
    """Returns how far the unknowns are from those of a flight that begins as their paths do, inf if it has other contacts."""
    begin = np.zeros(1)
    velocities = [tuple(path.velocity(begin)[0].tolist()) for path in paths(scene, flight, z)]
    balls = tuple(replace(ball, velocity=v) for ball, v in zip(scene.balls, velocities, strict=True))
    try:
        flown = fly(replace(scene, balls=balls))
    except InputError:
        return float("inf")
    return float(np.abs(flown.unknowns - z).max()) if flown.contacts == flight.contacts else float("inf")


def _line(kind: str, part: dict[str, Any]) -> str:
    """Returns the line to print on a search."""
    line = f"{kind}: contacts off by {part['largest_error']:.1e}, energy by {part['energy_error']:.1e}, after {part['steps']} Newton steps"
    starts = f" from start {part['starts']}" if part["starts"] > 1 and not part["failure"] else ""
    starts += f"; {part['note']}" if part["note"] else ""
    return line + starts + (f"; {part['failure']}, from each of {part['starts']} starts" if part["failure"] else "")


def _draw(folder: Path, scene: Scene, flight: Flight, found: dict[str, Search]) -> None:
    from teg.examples.billiards.pictures import draw_animation, draw_sheet

    draw_sheet(folder / PICTURES[0], scene, flight, {LABELS[kind]: end for kind, end in found.items()})
    draw_animation(folder / PICTURES[1], scene, paths(scene, flight, next(iter(found.values())).z))
