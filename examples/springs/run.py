"""Two bungee cords for a quick jump with a gentle stop: design under constraints, on derivatives of integrals whose integrand jumps.

cords → (time, force, energy and their derivatives, compiled → step of SciPy's SLSQP) × steps → pictures, beside other derivatives
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from teg.evaluator.options import Backend, Discontinuities
from teg.examples.harness import finish, require_packages, result_folder
from teg.examples.options import resolved
from teg.examples.springs.design import Jump, Optimum, optimise, violation
from teg.examples.springs.scene import DESIGN, GRAVITY, compile_fall

PACKAGES = {"scipy": "scipy", "matplotlib": "matplotlib"}
PICTURES = ("springs.png",)
LABELS = {"exact": "exact gradient", "ignore": "plain automatic differentiation", "differences": "finite differences"}


def run_springs(out: str | Path = "out/springs", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Designs two cords for a jump; writes pictures to `out`, returns the contents of run.json. It has no progress bar.

    The options are those of `teg demo springs` (`examples/options.py`): drop, mass, weight, steps, discontinuities, alone, backend; nothing
    is random, so any `seed` gives the same. With `discontinuities="exact"` the same optimiser also runs on the derivatives of plain
    automatic differentiation and on finite differences, unless `alone`. "failure" says if a constraint is violated at the end.

    Raises InputError for options and folders that cannot be used, MissingPackageError.
    """
    require_packages("springs demo", PACKAGES, False)
    import scipy.integrate  # now, as times are measured below
    import scipy.optimize  # noqa: F401

    settings = resolved("springs", {"out": out, **options})
    folder = result_folder(Path(out))
    chosen = settings["discontinuities"]
    kinds = [chosen, *(["ignore", "differences"] if chosen == "exact" and not settings["alone"] else [])]
    jump = Jump(settings["drop"], settings["mass"], settings["weight"], compile_fall(settings["backend"]))
    start = jump.start()
    found: dict[str, Optimum] = {}
    for kind in kinds:
        derivatives = _derivatives(jump, kind, settings["backend"])
        derivatives(start)  # compiled now
        begun = time.perf_counter()
        found[LABELS[kind]] = optimise(jump, derivatives, settings["steps"], start)
        found[LABELS[kind]].seconds = time.perf_counter() - begun
    _draw(folder, jump, start, found)
    parts = {label: _report(jump, optimum) for label, optimum in found.items()}
    first = parts[LABELS[chosen]]
    report = first | {
        "summary": _table(_before(jump, start), parts),
        "beside": {label: part for label, part in parts.items() if part is not first},
        "start": _before(jump, start),
        "gradient_at_start": {LABELS[kind]: _derivatives(jump, kind, settings["backend"])(start)[:2].tolist() for kind in kinds},
        "pictures": PICTURES,
    }
    return finish(folder, "springs", settings, report)


def _derivatives(jump: Jump, kind: Discontinuities, backend: Backend) -> Callable[[np.ndarray], np.ndarray]:
    """Returns the function from a design to the derivatives of loss and constraints."""
    if kind == "differences":
        return jump.differences
    other = Jump(jump.drop, jump.mass, jump.weight, jump.fall if kind == "exact" else compile_fall(backend, kind))
    return lambda design: other.outcome(design)[1]


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
            "largest_acceleration_in_g": float(flight["force"].max() / (jump.mass * GRAVITY) - 1),
            "hits_the_ground": bool(flight["way"][-1] >= jump.drop * (1 - 1e-9)),
        },
    }


def _report(jump: Jump, optimum: Optimum) -> dict[str, Any]:
    return _before(jump, optimum.design) | {
        "converged": not optimum.failure,
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
        text = f"{label}: {seen['time']:.3f} s, {seen['largest_acceleration_in_g']:.3f} g, lowest point {seen['lowest']:.3f} m"
        steps = f", {part['steps']} steps in {1000 * part['seconds']['descent']:.0f} ms" if "steps" in part else ""
        trouble = (
            f"; {part['failure']}" if part.get("failure") else "; the design ends the fall elsewhere" if part["violation"] > 1e-6 else ""
        )
        lines.append(text + steps + trouble)
    return lines


def _draw(folder: Path, jump: Jump, start: np.ndarray, found: dict[str, Optimum]) -> None:
    from teg.examples.springs.pictures import draw_sheet

    draw_sheet(folder / PICTURES[0], jump, start, found)
