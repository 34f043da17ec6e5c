"""Two bungee cords for a quick jump with a gentle stop: design under constraints, on derivatives of integrals whose integrand jumps.

cords → (time, acceleration, energy and their derivatives, compiled → step of SciPy's SLSQP) × steps → pictures, beside other derivatives
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.evaluator.options import Backend, Discontinuities
from teg.examples.harness import evaluations_shown, finish, require_packages, result_folder
from teg.examples.options import resolved
from teg.examples.replay import Replay
from teg.examples.springs.design import Jump, OfDesign, Optimum, optimise, violation
from teg.examples.springs.scene import DESIGN, GRAVITY, compile_fall, published_loss
from teg.examples.treatments import LABELS

PACKAGES = {"scipy": "scipy", "matplotlib": "matplotlib", "tqdm": "tqdm"}
PICTURES = ("springs.png",)


def run_springs(out: str | Path = "out/springs", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Designs two cords for a jump; writes pictures to `out`, returns the contents of run.json.

    The options are those of `teg demo springs` (`examples/options.py`): apex, mass, weight, steps, discontinuities, alone, backend, resume;
    nothing is random, so any `seed` gives the same. With `discontinuities="exact"` the same optimiser also runs on the derivatives of plain
    automatic differentiation and on finite differences, unless `alone`. "failure" says if a constraint is violated at the end, or the
    gradient along the constraints is not zero. A checkpoint is written every two seconds. Ctrl-C ends it: the report says "interrupted".

    Raises InputError for options, folders and checkpoints that cannot be used, MissingPackageError.
    """
    require_packages("springs demo", PACKAGES, progress)
    import scipy.integrate  # now, as times are measured below
    import scipy.optimize  # noqa: F401

    settings = resolved("springs", {"out": out, **options})
    folder = result_folder(Path(out))
    chosen = settings["discontinuities"]
    kinds = [chosen, *(["ignore", "differences"] if chosen == "exact" and not settings["alone"] else [])]
    jump = Jump(settings["apex"], settings["mass"], settings["weight"], compile_fall(settings["backend"]))
    start = jump.start()
    identity = {k: settings[k] for k in ("apex", "mass", "weight", "discontinuities", "backend")}
    replay = Replay(folder / "checkpoint.npz", identity, settings["resume"])
    published = _published(jump, settings["backend"])
    optima: dict[str, Optimum] = {}
    for kind in kinds:
        derivatives = _derivatives(jump, kind, settings["backend"])
        derivatives(start)  # compiled now
        begun = time.perf_counter()
        with evaluations_shown(progress, replay.kept, LABELS[kind]) as keep:
            kept = keep("values", jump.values), keep(f"derivatives, {kind}", derivatives)
            optima[LABELS[kind]] = optimum = optimise(jump, *kept, settings["steps"])
        optimum.seconds = time.perf_counter() - begun
        replay.save()
        if optimum.interrupted:
            break
    _draw(folder, jump, start, optima)
    parts = {label: _report(jump, optimum) for label, optimum in optima.items()}
    first = parts[LABELS[chosen]]
    report = first | {
        "summary": [*_lines_of(published), *_table(_before(jump, start), parts)],
        "beside": {label: part for label, part in parts.items() if part is not first},
        "start": _before(jump, start),
        "published": published,
        "interrupted": any(optimum.interrupted for optimum in optima.values()),
        "pictures": PICTURES,
    }
    return finish(folder, "springs", settings, report)


def _derivatives(jump: Jump, kind: Discontinuities, backend: Backend) -> OfDesign:
    """Returns the function from a design to the derivatives of loss and constraints."""
    if kind == "differences":
        return jump.differences
    other = Jump(jump.apex, jump.mass, jump.weight, jump.fall if kind == "exact" else compile_fall(backend, kind))
    return lambda design: other.outcome(design)[1]


def _published(jump: Jump, backend: Backend) -> dict[str, Any]:
    """Returns the published loss and its gradient at the start."""
    start = dict(zip(DESIGN, jump.start().tolist(), strict=True))
    loss, gradient = teg.compile(published_loss(jump.apex, jump.mass), list(teg.params(" ".join(DESIGN))), backend=backend).value_and_grad(
        start
    )
    return {"start": start, "loss": float(loss), "gradient": {name: float(slope) for name, slope in gradient.items()}}


def _lines_of(published: dict[str, Any]) -> list[str]:
    slopes = ", ".join(f"{slope:.6f}" for slope in published["gradient"].values())
    return [f"the published loss at the start: {published['loss']:.11f}, its gradient {slopes}"]


def _before(jump: Jump, design: np.ndarray) -> dict[str, Any]:
    """Returns what a design is, and what an independent simulation of the jump gives."""
    flight = jump.simulated(design)
    values = jump.values(design)
    return {
        "design": dict(zip(DESIGN, design.tolist(), strict=True)),
        "loss": float(values[0]),
        "violation": violation(values),
        "simulated": {
            "lowest": float(flight["way"][-1]),
            "time": float(flight["time"][-1]),
            "acceleration_at_the_end": float(GRAVITY - flight["force"][-1] / jump.mass),
        },
    }


def _report(jump: Jump, optimum: Optimum) -> dict[str, Any]:
    return _before(jump, optimum.design) | {
        "converged": not optimum.failure and not optimum.interrupted,
        "failure": optimum.failure,
        "steps": len(optimum.outcomes) - 1,
        "evaluations": optimum.evaluations,
        "seconds": {"descent": optimum.seconds},
        "losses": [float(outcome[0]) for outcome in optimum.outcomes],
        "violations": [violation(outcome) for outcome in optimum.outcomes],
    }


def _table(start: dict[str, Any], parts: dict[str, dict[str, Any]]) -> list[str]:
    """Returns the lines to print."""
    lines = []
    for label, part in {"before": start, **parts}.items():
        seen = part["simulated"]
        text = f"{label}: loss {part['loss']:.6f}, {seen['time']:.3f} s, lowest point {seen['lowest']:.4f} m"
        steps = f", {part['steps']} steps in {1000 * part['seconds']['descent']:.0f} ms" if "steps" in part else ""
        lines.append(text + steps + (f"; {part['failure']}" if part.get("failure") else ""))
    return lines


def _draw(folder: Path, jump: Jump, start: np.ndarray, optima: dict[str, Optimum]) -> None:
    from teg.examples.springs.pictures import draw_sheet

    draw_sheet(folder / PICTURES[0], jump, start, optima)
