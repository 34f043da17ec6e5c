"""The path of a bouncing ball by least action: contacts and heights, by descent of an integral whose integrand jumps.

throw → straight lines → (times of contacts → best heights → compiled gradient) × steps → pictures, against the exact path
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from teg.errors import InputError
from teg.examples.bouncing_ball.descent import ActionDescent, State
from teg.examples.bouncing_ball.scene import compile_scene
from teg.examples.bouncing_ball.throw import Throw, exact, make_throw
from teg.examples.harness import (
    default_backend,
    demo_command,
    machine,
    progress_bar,
    require_packages,
    result_folder,
    versions,
    write_report,
)

STEPS = 300
PACKAGES = {"scipy": "scipy", "matplotlib": "matplotlib", "tqdm": "tqdm"}
LABELS = {"exact": "exact gradient", "ignore": "plain automatic differentiation"}
SHEET = "bouncing_ball.png"
LIFT_AT_REST = (
    "in a lift at rest automatic differentiation finds the same contacts: what it gives is then twice the gradient, "
    "which is zero in the same place (with --speed 1.5, the default, it is not)"
)
HALF_SPEED = "without the jumps of the integrand the ball rebounds as if the lift moved at half its speed"
ELSEWHERE = "without the jumps of the integrand the contacts go to wrong places"


def run_bouncing_ball(
    contacts: int = 5,
    speed: float = 1.5,
    duration: float | None = None,
    steps: int = STEPS,
    out: str | Path = "out/bouncing-ball",
    discontinuities: str = "exact",
    compare: bool = True,
    backend: str | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Finds the path of a ball thrown in a rising lift; writes a picture to `out`, returns the contents of run.json.

    The ball makes that many `contacts` with the lift's floor and ceiling, by turns; `speed` is the lift's, in m/s, and `duration` in s
    (None: 0.7 of the longest that allows so many contacts). At most `steps` steps; the descent ends when the gradient is zero to
    rounding. `backend` None is "c" if there is a C compiler, else "numpy". `discontinuities="ignore"` differentiates like plain
    automatic differentiation; unless that is chosen, the same descent is run that way too and shown beside (`compare`). Ctrl-C ends it:
    the report says "interrupted".

    Raises InputError for an impossible throw or folder, MissingPackageError.
    """
    require_packages("bouncing ball", PACKAGES, progress)
    throw = make_throw(contacts, speed, duration)
    if steps < 1:
        raise InputError(f"{steps} steps are not possible", None, "1 or more")
    chosen = backend or default_backend()
    folder = result_folder(Path(out))
    times, heights, least = exact(throw)
    runs, reports, interrupted = {}, [], False
    for kind in dict.fromkeys([discontinuities, "ignore"] if compare else [discontinuities]):
        begun = time.perf_counter()
        descent = ActionDescent(throw, compile_scene(contacts, chosen, kind))
        setup = time.perf_counter() - begun
        interrupted = interrupted or descend(descent, steps, progress, LABELS.get(kind, kind))
        seconds = {"setup": setup, "descent": time.perf_counter() - begun - setup}
        runs[LABELS.get(kind, kind)] = descent.states
        reports.append(_report(descent, kind, times, least) | {"seconds": seconds})
    _draw(folder, throw, (times, heights), runs)
    report = reports[0] | {
        "beside": reports[1] if len(reports) > 1 else None,
        "interrupted": interrupted,
        "exact": {"times": times.tolist(), "heights": heights.tolist(), "action": least},
        "throw": asdict(throw),
        "options": {"steps": steps, "discontinuities": discontinuities, "backend": chosen},
        "command": _command(throw, steps, discontinuities, chosen, compare, out),
        "versions": versions(),
        "machine": machine(),
        "pictures": [str(folder / SHEET)],
    }
    write_report(folder / "run.json", report)
    return report


def _draw(folder: Path, throw: Throw, true: tuple[np.ndarray, np.ndarray], runs: Mapping[str, Sequence[State]]) -> None:
    """Draws the true path (times of contacts, heights of arcs), and those of the runs, with the errors of their contacts."""
    from teg.examples.bouncing_ball import pictures

    first = next(iter(runs.values()))[0]
    pictures.draw_sheet(
        folder / SHEET,
        throw,
        true,
        (first.times, first.heights),
        {label: (states[-1].times, states[-1].heights) for label, states in runs.items()},
        {label: [_error(s, true[0]) for s in states] for label, states in runs.items()},
    )


def descend(descent: ActionDescent, steps: int, progress: bool, label: str = "") -> bool:
    """Steps until the gradient is zero to rounding, or all steps are done. Returns True if Ctrl-C came before that."""
    try:
        with progress_bar(progress, steps, 0, label) as bar:
            while len(descent.states) <= steps and not (descent.converged and len(descent.states) > 1):
                descent.step()
                if bar is not None:
                    bar.update()
                    bar.set_postfix_str(f"action {descent.states[-1].action:.6f} J·s")
    except KeyboardInterrupt:
        return True
    return False


def _report(descent: ActionDescent, kind: str, times: np.ndarray, least: float) -> dict[str, Any]:
    throw, states = descent.throw, descent.states
    end = states[-1]
    before, after = throw.contact_speeds(end.times, end.heights)
    report: dict[str, Any] = {
        "discontinuities": kind,
        "steps": len(states) - 1,
        "converged": descent.converged,
        "times": end.times.tolist(),
        "heights": end.heights.tolist(),
        "action": end.action,
        "action_above_exact": end.action - least,
        "largest_time_error": _error(end, times),
        "speed_of_lift_by_rebounds": ((before + after) / 2).tolist(),  # for a wall that moves at (v₋ + v₊)/2
        "gradient": float(np.abs(end.gradient).max()),
        "errors": [_error(s, times) for s in states],
        "actions": [s.action for s in states],
        "note": "",
    }
    if kind == "ignore":
        halved = np.allclose(report["speed_of_lift_by_rebounds"], throw.speed / 2, atol=1e-6)
        report["note"] = LIFT_AT_REST if throw.speed == 0 else HALF_SPEED if halved else ELSEWHERE
    elif kind == "exact":
        report["smallest_curvature"] = float(np.linalg.eigvalsh(descent.hessian())[0])  # positive: the action is a minimum
    return report


def _error(state: State, times: np.ndarray) -> float:
    return float(np.abs(state.times - times).max())


def _command(throw: Throw, steps: int, discontinuities: str, backend: str, compare: bool, out: str | Path) -> str:
    values = {"contacts": throw.contacts, "speed": throw.speed, "duration": repr(throw.duration), "steps": steps}
    values |= {"discontinuities": discontinuities, "backend": backend}
    return demo_command("bouncing-ball", None, values, out, *([] if compare else ["--alone"]))
