"""The value of a program by `reference.py`, and its derivative along a direction.

A value counts only if two resolutions agree. Derivatives are central differences of such values, extrapolated (Richardson).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.fuzz.operations import Real
from tests.fuzz.reference import PAIRS, NoReferenceError, Reference
from tests.fuzz.switches import depth_of
from tests.fuzz.syntax import Program, Term, walk


@dataclass(frozen=True)
class Answer:
    """What is known of a program: its value, the derivative along a direction, and how well."""

    value: float
    error: float
    slope: float | None = None
    slope_error: float = 0.0
    direction: dict[str, float] = field(default_factory=dict)


ORDER = 3
STEPS = (8e-3, 8e-4, 6e-5)


def parameters_of(program: Program) -> dict[str, float]:
    """Entries of arrays are parameters of their own."""
    flat: dict[str, float] = {}
    for name, value in program.values.items():
        if isinstance(value, tuple):
            flat.update({f"{name}[{k}]": v for k, v in enumerate(value)})
        else:
            flat[name] = value
    return flat


def direction_of(program: Program, wrt: Sequence[str] | None = None) -> dict[str, float]:
    """A direction in which every parameter moves, each by a part of its scale."""
    flat = parameters_of(program)
    parts = (0.71, -0.59, 0.83, 0.67, -0.79, 0.61, 0.97, -0.53)
    direction = {}
    for k, name in enumerate(flat):
        if wrt is None or name in wrt:
            direction[name] = parts[k % len(parts)] * program.scale(name.split("[")[0])
    return direction


def answer(program: Program, wrt: Sequence[str] | None = None, slopes: bool = True, tolerance: float = 1e-10) -> Answer:
    """The value, and the derivative along a direction. Raises NoReferenceError where two resolutions do not agree."""
    flat = parameters_of(program)
    if any(n.op == "/" and n.parts[1] == Term("number", (), 0.0) for n in walk(program.tree)):
        raise NoReferenceError("a division by 0")
    coarse, other, error = _agreeing(program, flat, tolerance)
    direction = direction_of(program, wrt)
    if not slopes or not direction:
        return Answer(float(other), error)
    slope, slope_error = _slope(coarse, flat, direction, tolerance * 10)
    return Answer(float(other), error, slope, slope_error, direction)


def _agreeing(program: Program, flat: Mapping[str, float], tolerance: float) -> tuple[Reference, Any, float]:
    """The coarser of two resolutions that agree, the value of the finer one, and their difference."""
    depth = depth_of(program.tree)
    if depth > 2:
        raise NoReferenceError("three variables")
    for pair in PAIRS[max(1, depth)]:
        coarse, fine = (Reference(program, resolution) for resolution in pair)
        one, other = coarse.value(flat), fine.value(flat)
        error = float(abs(one - other)) + 1e-16 * float(abs(other))
        if np.isfinite(other) and error <= tolerance * max(float(abs(other)), 1e-6):
            return coarse, other, error
    raise NoReferenceError(f"two resolutions: {one} and {other}")


def _slope(reference: Reference, flat: Mapping[str, float], direction: Mapping[str, float], tolerance: float) -> tuple[float | None, float]:
    best: tuple[float | None, float] = (None, np.inf)
    for step in STEPS:
        reference.spent = 0
        steps = [Real(step) / 2**k for k in range(ORDER)]
        moves = np.array([sign * h for h in steps for sign in (1, -1)], Real)
        values = reference.batch({name: Real(v) + moves * Real(direction.get(name, 0.0)) for name, v in flat.items()})
        table: list[list[Any]] = []
        for k, h in enumerate(steps):
            row = [(values[2 * k] - values[2 * k + 1]) / (2 * h)]
            for j, before in enumerate(table[-1] if table else []):
                row.append(row[-1] + (row[-1] - before) / (4 ** (j + 1) - 1))
            table.append(row)
        slope, error = float(table[-1][-1]), float(abs(table[-1][-1] - table[-2][-1])) * 2
        if np.isfinite(slope) and error < best[1]:
            best = slope, error
        if error <= tolerance * abs(slope) or (slope == 0 and error == 0):
            break
    return best
