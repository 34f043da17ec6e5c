"""The path of a bouncing ball by least action: contacts and heights, by descent of an integral whose integrand jumps.

throw → straight lines → (times of contacts → best heights → compiled gradient) × steps → pictures, against the exact path
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from teg.evaluator.options import Discontinuities
from teg.examples.bouncing_ball.descent import ActionDescent, State
from teg.examples.bouncing_ball.scene import compile_scene
from teg.examples.bouncing_ball.throw import Throw, exact, make_throw
from teg.examples.harness import finish, progress_bar, require_packages, result_folder
from teg.examples.options import resolved
from teg.examples.replay import OfVector, Replay
from teg.examples.treatments import LABELS

PACKAGES = {"scipy": "scipy", "matplotlib": "matplotlib", "tqdm": "tqdm"}
OUTSIDE = 1e-6  # of the room: how far a path may be outside of the lift
SHEET, ANIMATION = "bouncing_ball.png", "bouncing_ball.gif"
LIFT_AT_REST = (
    "in a lift at rest automatic differentiation finds the same contacts: what it gives is then twice the gradient, "
    "which is zero in the same place (with --speed 1.5, the default, it is not)"
)
HALF_SPEED = "without the jumps of the integrand the ball rebounds as if the lift moved at half its speed"
ELSEWHERE = "without the jumps of the integrand the contacts go to wrong places"


def run_bouncing_ball(out: str | Path = "out/bouncing-ball", progress: bool = True, **options: Any) -> dict[str, Any]:
    """Finds the path of a ball by least action; writes a picture to `out`, returns the contents of run.json.

    The options are those of `teg demo bouncing-ball` (`examples/options.py`): contacts, speed, duration, floor, restitution, steps,
    discontinuities, alone, seed, backend, resume. The ball makes that many `contacts` with floor and ceiling, by turns, of a lift that
    rises with `speed` in m/s; with `floor`, a formula of x and t such as "0.1*sin(3*x) + 0.3*t", with this floor alone. It leaves at
    `restitution` times the speed of its approach. `duration` is in s. The descent ends after `steps` steps, or when the gradient is zero to
    rounding, and "failure" says if it is not. With `discontinuities="exact"` the same search is run beside it like plain automatic
    differentiation, unless `alone`. A checkpoint is written every two seconds. Ctrl-C ends it: the report says "interrupted".

    Raises InputError for an impossible throw, option, folder or checkpoint, MissingPackageError.
    """
    require_packages("bouncing ball", PACKAGES, progress)
    settings = resolved("bouncing-ball", {"out": out, **options})
    chosen: Discontinuities = settings["discontinuities"]
    kinds: list[Discontinuities] = [chosen] if chosen != "exact" or settings["alone"] else [chosen, "ignore"]
    report = (_in_a_lift if settings["floor"] is None else _over_a_floor)(settings, kinds, progress)
    return finish(Path(out), "bouncing-ball", settings, report)


def _in_a_lift(settings: Mapping[str, Any], kinds: list[Discontinuities], progress: bool) -> dict[str, Any]:
    """Returns the report of throws in a lift, one for each treatment of discontinuities."""
    throw = make_throw(settings["contacts"], settings["speed"], settings["duration"], settings["restitution"])
    folder = result_folder(Path(settings["out"]))
    replay = _replay(folder, settings)
    times, heights, least = exact(throw)
    runs, reports, interrupted = {}, [], False
    for kind in kinds:
        begun = time.perf_counter()
        with np.errstate(all="ignore"):  # of numbers beyond all measure; the report says that it did not converge
            keep = partial(_kept, replay, kind)
            descent = ActionDescent(throw, compile_scene(throw.contacts, settings["backend"], kind, throw.duration), keep)
            setup = time.perf_counter() - begun
            interrupted = interrupted or descend(descent, settings["steps"], progress, LABELS[kind])
            seconds = {"setup": setup, "descent": time.perf_counter() - begun - setup}
            replay.save()
            reports.append(_report(descent, kind, times, least) | {"seconds": seconds})
        runs[LABELS[kind]] = descent.states
    _draw(folder, throw, (times, heights), runs)
    failure = "" if reports[0]["converged"] else f"the gradient is {reports[0]['gradient']:.1e} after {reports[0]['steps']} steps"
    if not failure and kinds[0] == "exact" and reports[0]["outside"] > OUTSIDE * throw.room:
        failure = f"the path found is {reports[0]['outside']:.2g} m outside of the lift between contacts: a shorter --duration"
    return reports[0] | {
        "summary": [line for part in reports for line in _summary(part)],
        "failure": "" if interrupted else failure,
        "beside": reports[1] if len(reports) > 1 else None,
        "interrupted": interrupted,
        "exact": {"times": times.tolist(), "heights": heights.tolist(), "action": least},
        "throw": asdict(throw),
        "pictures": [SHEET, ANIMATION],
    }


def _replay(folder: Path, settings: Mapping[str, Any]) -> Replay:
    """Returns the evaluations of the run before, if it is resumed."""
    identity = {k: settings[k] for k in ("contacts", "speed", "duration", "floor", "restitution", "seed", "discontinuities", "backend")}
    return Replay(folder / "checkpoint.npz", identity, settings["resume"])


def _kept(replay: Replay, kind: str, name: str, function: OfVector) -> OfVector:
    return replay.kept(f"{name}, {kind}", function)


def _summary(part: Mapping[str, Any]) -> list[str]:
    """Returns the lines to print on one throw."""
    error, above = part["largest_time_error"], part["action_above_exact"]
    line = f"{part['discontinuities']}: contacts off by {error:.2g} s, action by {above:.2g} J·s, after {part['steps']} steps"
    return [line + ("" if part["converged"] else ", not converged"), *([part["note"]] if part["note"] else [])]


def _over_a_floor(settings: Mapping[str, Any], kinds: list[Discontinuities], progress: bool) -> dict[str, Any]:
    """Returns the report of flights over an uneven floor, one for each treatment of discontinuities."""
    from teg.examples.bouncing_ball.floor import find_path, make_flight
    from teg.examples.bouncing_ball.floor_pictures import draw_animation, draw_flights

    with np.errstate(all="ignore"):
        flight = make_flight(settings["floor"], settings["contacts"], settings["duration"], settings["backend"], settings["restitution"])
        folder = result_folder(Path(settings["out"]))
        replay = _replay(folder, settings)
        try:
            searches = {kind: find_path(flight, settings["floor"], dict(settings), kind, partial(_kept, replay, kind)) for kind in kinds}
        finally:
            replay.save()
    labelled = {LABELS[kind]: search for kind, search in searches.items()}
    with np.errstate(all="ignore"):  # a floor may have poles beside the path
        draw_flights(folder / SHEET, labelled)
        draw_animation(folder / ANIMATION, labelled)
    reports = []
    for kind, search in searches.items():
        places = search.moving.reshape(2, -1).tolist()
        reports.append(
            {
                "discontinuities": kind,
                "converged": not search.failure,
                "failure": search.failure,
                "times": places[0],
                "places": places[1],
                "action": search.action,
                "gradients": search.gradients,
                "energies": flight.energies(search.moving).tolist(),
                "rebound_error": flight.rebound_error(search.moving),
            }
        )
    return reports[0] | {
        "summary": [
            f"{r['discontinuities']}: rebounds off by {r['rebound_error']:.2g} m/s" + (f"; {r['failure']}" if r["failure"] else "")
            for r in reports
        ],
        "beside": reports[1] if len(reports) > 1 else None,
        "pictures": [SHEET, ANIMATION],
    }


def _draw(folder: Path, throw: Throw, true: tuple[np.ndarray, np.ndarray], runs: Mapping[str, Sequence[State]]) -> None:
    """Draws the true path (times of contacts, heights of arcs), and those of the runs, with the errors of their contacts."""
    from teg.examples.bouncing_ball import pictures

    first = next(iter(runs.values()))[0]
    ends = {label: (states[-1].times, states[-1].heights) for label, states in runs.items()}
    pictures.draw_sheet(
        folder / SHEET,
        throw,
        true,
        (first.times, first.heights),
        ends,
        {label: [_error(s, true[0]) for s in states] for label, states in runs.items()},
    )
    pictures.draw_animation(folder / ANIMATION, throw, {"true path": true, **ends})


def descend(descent: ActionDescent, steps: int, progress: bool, label: str = "") -> bool:
    """Steps until the gradient is zero to rounding, or all steps are done. Returns True if Ctrl-C came before that."""
    try:
        with progress_bar(progress, steps, 0, label) as bar:
            while len(descent.states) <= steps and not (descent.converged and len(descent.states) > 1) and descent.finite:
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
        # for a wall that moves so; (v₋ + v₊)/2 where nothing is lost
        "speed_of_lift_by_rebounds": ((throw.restitution * before + after) / (1 + throw.restitution)).tolist(),
        "gradient": float(np.abs(end.gradient).max()),
        "errors": [_error(s, times) for s in states],
        "actions": [s.action for s in states],
        "outside": throw.depth(end.times, end.heights),
        "note": "",
    }
    if kind == "ignore":
        elastic = throw.restitution == 1
        halved = elastic and np.allclose(report["speed_of_lift_by_rebounds"], throw.speed / 2, atol=1e-6)
        report["note"] = LIFT_AT_REST if elastic and throw.speed == 0 else HALF_SPEED if halved else ELSEWHERE
    elif kind == "exact" and throw.restitution == 1:
        report["smallest_curvature"] = _smallest(descent.hessian())  # positive: the action is a minimum
    return report


def _error(state: State, times: np.ndarray) -> float:
    return float(np.abs(state.times - times).max())


def _smallest(hessian: np.ndarray) -> float | None:
    """Returns the smallest eigenvalue, None of a matrix that is not finite."""
    return float(np.linalg.eigvalsh(hessian)[0]) if np.isfinite(hessian).all() else None
