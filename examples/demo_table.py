"""The table of the demonstrations: steps, time and memory, and where each ends with exact, plain and smoothed derivatives.

    python -m teg.examples.demo_table                  (all of them with their defaults; --fast: in the small; or the names of some)

Every run is a process of its own; its peak memory is that which the operating system counted for it, which is at least that of the process
that starts it.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from subprocess import DEVNULL, Popen
from tempfile import TemporaryDirectory
from typing import Any

from teg.examples.options import DEMOS

Report = dict[str, Any]
Measure = tuple[str, Callable[[Report], float]]


def _greek_error(option: Report) -> float:
    """Returns the largest difference from a closed form, relative to Greeks above 1."""
    worst: float = max(abs(value - option["closed form"][name]) / max(1.0, abs(value)) for name, value in option["exact"].items())
    return worst


LOSS: Measure = ("loss", lambda r: r["loss"]["end"])
PICTURE: Measure = ("loss", lambda r: r["losses"][-1])
MEASURES: dict[str, Measure] = {
    "triangulation": LOSS,
    "perlin": LOSS,
    "mesh-network": LOSS,
    "bouncing-ball": ("error of a contact, s", lambda r: r["largest_time_error"]),
    "billiards": ("error of a contact, s, m, rad", lambda r: r["largest_error"]),
    "springs": ("loss", lambda r: r["loss"]),
    "occlusion": PICTURE,
    "soft-shadow": PICTURE,
    "motion-blur": PICTURE,
    "depth-of-field": PICTURE,
    "voronoi": ("error of a mass", lambda r: r["errors"][-1]),
    "greeks": ("relative error of a Greek", lambda r: max(map(_greek_error, r["options_found"].values()))),
    "cut-cells": ("error of a disk's energy and shape derivative", lambda r: max(r["disk_errors"])),
    "shaders": ("error of a light or its derivative", lambda r: max(row["error"] for row in r["rows"])),
    "auction": ("error of a reserve price", lambda r: max(row["error"] for row in r["rows"])),
}
"""What each demonstration makes small, or the error of what it computes: its name, and its value in a report."""
HEADER = "| demo | measured | steps | ms a step | exact | plain AD | smoothed | peak memory |\n|---|---|---|---|---|---|---|---|"


def measured(name: str, treatment: str, fast: bool, folder: Path) -> tuple[Report, float]:
    """Returns the report of a run, and its peak memory in MB; the report is empty if the run failed."""
    words = [sys.executable, "-m", "teg", "demo", name, "--quiet", "-o", str(folder), *(["--fast"] if fast else [])]
    defaults = DEMOS[name].defaults
    words += ["--discontinuities", treatment] if "discontinuities" in defaults else []
    words += ["--alone"] if "alone" in defaults else []
    with Popen(words, stdout=DEVNULL, stderr=DEVNULL) as child:
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    path = folder / "run.json"
    report: Report = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return report, used.ru_maxrss / (1024 if sys.platform != "darwin" else 1024**2)


def steps_of(report: Report) -> int:
    """Returns the number of steps, epochs or evaluations of a run, 0 if it has none."""
    for key in ("steps", "epochs"):
        if key in report:
            return int(report[key])
    return max((len(report[key]) - 1 for key in ("losses", "errors") if key in report), default=0)


def row(name: str, fast: bool) -> str:
    """Returns the line of a demonstration."""
    label, value = MEASURES[name]
    treatments = DEMOS[name].treatments if "discontinuities" in DEMOS[name].defaults else ("exact",)
    ends = dict.fromkeys(("exact", "ignore", "smooth"), "–")
    first: Report = {}
    memory = 0.0
    for treatment in treatments:
        with TemporaryDirectory() as folder:
            report, peak = measured(name, treatment, fast, Path(folder))
        stopped = ", not converged" if report.get("failure") else ""
        ends[treatment] = f"{value(report):.4g}{stopped}" if report else "failed"
        if treatment == "exact":
            first, memory = report, peak
    steps = steps_of(first)
    seconds = first.get("seconds", {})
    pace = seconds.get("descent", seconds.get("training"))
    times = f"{steps} | {1000 * pace / steps:.3g}" if pace is not None and steps > 0 else f"{steps if steps > 0 else '–'} | –"
    return f"| {name} | {label} | {times} | {' | '.join(ends.values())} | {memory:.0f} MB |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table in Markdown, row by row."""
    parser = argparse.ArgumentParser(prog="python -m teg.examples.demo_table", description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="DEMO", help="which (all)")
    parser.add_argument("--fast", action="store_true", help="each demonstration with --fast")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in MEASURES]
    if unknown:
        parser.error(f"{unknown[0]!r} is none of " + ", ".join(MEASURES))
    print(HEADER, flush=True)
    for name in options.names or MEASURES:
        print(row(name, options.fast), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
