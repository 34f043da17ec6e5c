"""Check `teg.jax_function(kernel="xla")` on every reference: python tests/bench/jax_references.py [--every N] [--only ID …] [--json FILE].
About 20 minutes.

Value and gradient, by `jax.jit(jax.value_and_grad(f))`: in double precision against the exact digits and against the C backend (NumPy's
where there is no compiler), and in single precision, with JAX's 64-bit mode off, against the double ones at the rounded parameters. Errors
are relative to max(1, |exact|). A reference's own tolerance holds for double precision, 1e-4 for single; exit 1 where one is missed.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
import teg
from tests.references import REFERENCES, Reference

SINGLE = 1e-4
EXACT = "c" if any(map(shutil.which, ("cc", "gcc", "clang"))) else "numpy"


def distance(found: float, wanted: float) -> float:
    """Relative to max(1, |wanted|); 0 where both are the same infinity or no number."""
    if found == wanted or (math.isnan(found) and math.isnan(wanted)):
        return 0.0
    return abs(found - wanted) / max(1.0, abs(wanted)) if math.isfinite(wanted) else math.inf


def evaluated(f: Any, at: dict[str, Any]) -> tuple[float, dict[str, float], tuple[float, float, float]]:
    """Value and gradient of a jitted function; the seconds of tracing and lowering, of compiling, and of a call after the first."""
    import jax

    start = time.perf_counter()
    lowered = jax.jit(jax.value_and_grad(f) if at else lambda p: (f(p), {})).lower(at)
    traced = time.perf_counter()
    compiled = lowered.compile()
    seconds = traced - start, time.perf_counter() - traced
    jax.block_until_ready(compiled(at))
    start = time.perf_counter()
    value, slopes = jax.block_until_ready(compiled(at))
    return float(value), {name: float(v) for name, v in slopes.items()}, (*seconds, time.perf_counter() - start)


def checked(reference: Reference) -> dict[str, Any]:
    """One row: the largest errors, and the seconds of tracing, of compiling and of a call in double precision."""
    import jax

    e, names = reference.build(), [teg.param(k) for k in reference.params]
    exact = teg.compile(e, names, backend=EXACT, inaccurate="ignore")
    digits = {"": reference.value, **reference.grad}
    with jax.enable_x64(True):
        value, slopes, seconds = evaluated(
            teg.jax_function(e, names, kernel="xla"), {k: np.float64(v) for k, v in reference.params.items()}
        )
    found = {"": value, **slopes}
    same = {"": exact(reference.params), **exact.grad(reference.params)}
    rounded = {k: np.float32(v) for k, v in reference.params.items()}
    with jax.enable_x64(False):
        value, slopes, _ = evaluated(teg.jax_function(e, names, kernel="xla"), rounded)
    single = {"": value, **slopes}
    near = {"": exact(rounded), **exact.grad(rounded)}
    return {
        "id": reference.id,
        "double": max(distance(found[k], float(v)) for k, v in digits.items()),
        "against C": max(distance(found[k], float(v)) for k, v in same.items()),
        "single": max(distance(single[k], float(v)) for k, v in near.items()),
        "trace": seconds[0],
        "compile": seconds[1],
        "call": seconds[2],
        "tolerance": reference.tolerance,
    }


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only each N-th reference")
    parser.add_argument("--only", nargs="*", metavar="ID", help="these references")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    rows = []
    for reference in [r for r in REFERENCES if not options.only or r.id in options.only][:: options.every]:
        row = checked(reference)
        rows.append(row)
        if row["double"] > row["tolerance"] or row["single"] > SINGLE:
            print(f"missed: {row}", flush=True)
    missed = [r["id"] for r in rows if r["double"] > r["tolerance"] or r["single"] > SINGLE]
    print(f"{len(rows) - len(missed)} of {len(rows)} references")
    for name in ("double", "against C", "single"):
        worst = max(rows, key=lambda r: r[name])
        print(f"{name}: worst {worst[name]:.2g} ({worst['id']})")
    for name in ("trace", "compile"):
        seconds = sorted(rows, key=lambda r: r[name])
        longest = ", ".join(f"{r['id']} {r[name]:.2g} s" for r in seconds[:-6:-1])
        print(f"{name}: median {seconds[len(rows) // 2][name]:.2g} s, longest {longest}")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
