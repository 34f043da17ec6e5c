"""Do the error estimates hold? `python tests/bench/estimates.py [--programs N] [--seed S] [--tol T …] [--json]`; and what conics cost.

Some forty shapes of programs, each compiled once a tolerance and run on a batch of random parameters. What is true is computed twice, at
tol = 1e-14: by the program itself, and by another program of the same value (the order of integration exchanged, or the integral in two
parts). Where the two differ by more than a tenth of the estimate, nothing is known of the element: it is discarded, and counted. Where they
differ by more than their own two estimates, one of these is wrong, and it is counted as a *contradiction*. Both programs of a gradient may
come to the same charts, so gradients are also compared with differences of the value: those that are off by more than 1e-4 are *wrong*.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
import teg
from teg import Expr
from teg.analysis.settings import Integration
from teg.backends.c.kernel import CKernel, compile_c
from teg.pipeline import flatten, program_for
from tests.bench.shapes import Shape, Values, shapes, systems

Row = dict[str, Any]

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
TIGHT = 1e-14


def kernel(e: Expr, shape: Shape, tol: float) -> CKernel:
    """The value, or the gradient, with estimates and counts."""
    f = teg.compile(e, list(shape.wrt), tol=tol)
    part = f.outputs(1)[1] if shape.wrt else f.outputs(0)[0]
    return compile_c(program_for(list(flatten(part)), f.parameters, Integration(tol), errors=True), counted=True)


def run(made: CKernel, values: Values) -> tuple[np.ndarray, np.ndarray, int]:
    """Values and estimates, (results, n), and the evaluations of all."""
    n = len(next(iter(values.values())))
    outcome = made.outcome([values[name] for name in made.program.parameters], n)
    half = len(outcome.values) // 2
    return outcome.values[:half], outcome.values[half:], outcome.evaluations


@dataclass(frozen=True)
class Judgement:
    """Of one shape at one tolerance, entries (results, n): the value, its estimate and its error (NaN where it is not known), and of the
    batch the evaluations."""

    shape: Shape
    tol: float
    values: Values
    found: np.ndarray
    estimate: np.ndarray
    error: np.ndarray
    evaluations: int


@dataclass(frozen=True)
class Truth:
    """The values by both programs at TIGHT, the sum of their estimates; gradients by differences (NaN where these are too rough)."""

    first: np.ndarray
    second: np.ndarray
    estimates: np.ndarray
    differences: np.ndarray

    @property
    def contradictions(self) -> np.ndarray:
        """Where the two differ by more than they admit."""
        return np.abs(self.first - self.second) > self.estimates

    @property
    def wrong(self) -> np.ndarray:
        """Where a gradient is not the slope of the value."""
        return np.abs(self.first - self.differences) > 1e-4 * (np.abs(self.differences) + ROUGH)


ROUGH = 1e-2


def differences(shape: Shape, values: Values) -> np.ndarray:
    """The gradient by central differences of order 6, (results, n); NaN where two steps do not agree."""
    value = kernel(shape.program, replace(shape, wrt=()), TIGHT)

    def slope(name: str, step: np.ndarray) -> np.ndarray:
        total = np.zeros_like(step)
        for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
            ahead, behind = (run(value, {**values, name: values[name] + sign * k * step})[0][0] for sign in (1, -1))
            total += weight * (ahead - behind)
        return total / (60 * step)

    rows = []
    for p in shape.wrt:
        step = 1e-3 * np.abs(values[p.name]) + 1e-5
        coarse, fine = slope(p.name, step), slope(p.name, 0.5 * step)
        rows.append(np.where(np.abs(coarse - fine) <= 1e-6 * (np.abs(fine) + ROUGH), fine, np.nan))
    return np.array(rows)


def judge(shape: Shape, values: Values, tolerances: Sequence[float]) -> tuple[Truth, list[Judgement]]:
    """Compile, run, compare."""
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        jobs = [(shape.program, TIGHT), (shape.again, TIGHT), *((shape.program, tol) for tol in tolerances)]
        made = list(pool.map(lambda job: kernel(job[0], shape, job[1]), jobs))
    with np.errstate(all="ignore"):
        (first, e1, _), (second, e2, _) = run(made[0], values), run(made[1], values)
        truth = Truth(first, second, e1 + e2, differences(shape, values) if shape.wrt else np.full_like(first, np.nan))
        judged = []
        for tol, one in zip(tolerances, made[2:], strict=True):
            found, estimate, evaluations = run(one, values)
            error = np.minimum(np.abs(found - first), np.abs(found - second))
            known = np.isfinite(first) & (np.abs(first - second) <= 0.1 * estimate)
            judged.append(Judgement(shape, tol, values, found, estimate, np.where(known, error, np.nan), evaluations))
    return truth, judged


def worst(judgements: Sequence[Judgement], count: int) -> list[Row]:
    """The elements with the largest error/estimate."""
    rows: list[Row] = []
    for j in judgements:
        with np.errstate(all="ignore"):
            ratio = np.where(j.error > 0, j.error / j.estimate, 0.0)
        for i in np.argsort(-ratio.max(axis=0))[:count]:
            r = int(ratio[:, i].argmax())
            given = {name: float(column[i]) for name, column in j.values.items()}
            rows.append({"ratio": float(ratio[r, i]), "shape": j.shape.name, "kind": j.shape.kind, "tol": j.tol, "result": r, "at": given})
    return sorted(rows, key=lambda row: -row["ratio"])[:count]


def summary(judgements: Sequence[Judgement]) -> Row:
    """One row of the table, of judgements at one tolerance."""
    error, estimate, found = (np.concatenate([getattr(j, part).ravel() for j in judgements]) for part in ("error", "estimate", "found"))
    known = ~np.isnan(error)
    error, estimate, size = error[known], estimate[known], np.abs(found[known])
    ratio = np.divide(error, estimate, out=np.zeros_like(error), where=error > 0)
    over = estimate[error > 0] / error[error > 0]
    programs = sum(j.found.shape[1] for j in judgements)
    return {
        "tol": judgements[0].tol,
        "numbers": int(known.sum()),
        "discarded": int((~known).sum()),
        "violations": int((ratio > 1).sum()),
        "worst ratio": float(ratio.max(initial=0.0)),
        "error <= tol": float((error <= judgements[0].tol * np.maximum(size, 1e-6)).mean()),
        "median overestimation": float(np.median(over)) if over.size else 1.0,
        "evaluations": sum(j.evaluations for j in judgements) / programs,
    }


def measure(every: Sequence[Shape], programs: int, seed: int, tolerances: Sequence[float]) -> tuple[list[Row], list[Row], list[Row]]:
    """Rows of kinds and tolerances; what is doubtful, by kind; and the worst elements."""
    rng = np.random.default_rng(seed)
    judged: list[Judgement] = []
    doubts: dict[str, Row] = {}
    for shape in every:
        truth, judgements = judge(shape, shape.draw(rng, max(1, programs // len(every))), tolerances)
        judged += judgements
        row = doubts.setdefault(shape.kind, {"kind": shape.kind, "numbers": 0, "contradictions at 1e-14": 0, "wrong gradients": 0})
        for name, count in zip(list(row)[1:], (truth.first.size, truth.contradictions.sum(), truth.wrong.sum()), strict=True):
            row[name] += int(count)
    kinds = list(dict.fromkeys(shape.kind for shape in every))
    rows = []
    for tol in tolerances:
        of_tol = [j for j in judged if j.tol == tol]
        rows += [{"kind": kind, **summary([j for j in of_tol if j.shape.kind == kind])} for kind in kinds]
        rows.append({"kind": "all", **summary(of_tol)})
    return rows, list(doubts.values()), worst(judged, 12)


def random_systems(count: int, seed: int, tol: float) -> Row:
    """Relative errors of random systems of 1-3 conics whose region is not tiny, and evaluations."""
    rng = np.random.default_rng(seed)
    errors, evaluations, programs = [], 0, 0
    for shape in systems():
        values = shape.draw(rng, count // 2)
        sizes = run(kernel(shape.program, shape, 1e-4), values)[0][0]
        kept = np.flatnonzero(sizes > 1e-3)[: -(-count // 3)]
        values = {name: column[kept] for name, column in values.items()}
        truth, (found,) = judge(shape, values, [tol])
        known = np.abs(truth.first - truth.second) <= 1e-12 * np.abs(truth.first)
        errors.append((np.abs(found.found - truth.first) / np.abs(truth.first))[known])
        evaluations, programs = evaluations + found.evaluations, programs + kept.size
    error = np.concatenate(errors)
    return {
        "tol": tol,
        "systems": programs,
        "references agree": error.size,
        "error < 1e-12": float((error < 1e-12).mean()),
        "99 % below": float(np.quantile(error, 0.99)),
        "worst": float(error.max()),
        "evaluations": evaluations / programs,
    }


def table(rows: Sequence[Row]) -> str:
    """Rows as Markdown."""
    heads = list(rows[0])
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for row in rows:
        lines.append("| " + " | ".join(f"{row[n]:.3g}" if isinstance(row[n], float) else str(row[n]) for n in heads) + " |")
    return "\n".join(lines)


def main() -> None:
    """The tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--programs", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tol", type=float, nargs="+", default=list(TOLERANCES))
    parser.add_argument("--json", action="store_true", help="all of it as JSON")
    chosen = parser.parse_args()
    rows, doubts, cases = measure(shapes(), chosen.programs, chosen.seed, chosen.tol)
    systems_rows = [random_systems(1000, chosen.seed, tol) for tol in dict.fromkeys((*chosen.tol, 1e-10))]
    if chosen.json:
        text = json.dumps({"estimates": rows, "doubts": doubts, "worst": cases, "conics": systems_rows}, indent=1)
    else:
        listed = "\n".join(f"{c['ratio']:.2f}  {c['kind']}: {c['shape']}, tol {c['tol']:g}, result {c['result']}, {c['at']}" for c in cases)
        text = "\n\n".join((table(rows), table(doubts), "Largest error/estimate:\n\n" + listed, table(systems_rows)))
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
