"""Checkpoints of an optimiser that is not ours: the results of the functions that it calls.

An optimiser of SciPy keeps its state to itself, but it is deterministic: started again, it asks for the same points in the same order. A
checkpoint holds what was computed at each of them, and a resumed run gets as far as the first one in no time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from teg.examples.checkpoint import load_arrays, save_arrays

CHECKPOINT_SECONDS = 2.0

OfVector = Callable[[np.ndarray], np.ndarray]
Keep = Callable[[str, OfVector], OfVector]
"""From a name and a function of a vector to this function with its results kept, or just to the function."""


def not_kept(name: str, function: OfVector) -> OfVector:
    """Returns the function."""
    return function


class Replay:
    """The results of functions at the points where they were called, written to `checkpoint` every two seconds and by `save`.

    `identity` must be the same for `resume`. Raises InputError if the checkpoint cannot be read.
    """

    def __init__(self, checkpoint: Path, identity: Mapping[str, Any], resume: bool) -> None:
        self.checkpoint, self.identity = checkpoint, identity
        self.results: dict[str, dict[bytes, np.ndarray]] = {}
        self.replayed = self.computed = 0
        self._saved = time.perf_counter()
        if resume:
            stored = load_arrays(checkpoint, identity)
            for name in (key.removesuffix(":points") for key in stored if key.endswith(":points")):
                points, values = stored[f"{name}:points"], stored[f"{name}:values"]
                self.results[name] = {p.tobytes(): v for p, v in zip(points, values, strict=True)}

    def kept(self, name: str, function: OfVector) -> OfVector:
        """Returns a function of a vector with its results kept. All its points have one length, all its results one shape."""
        results = self.results.setdefault(name, {})

        def call(point: np.ndarray) -> np.ndarray:
            key = np.ascontiguousarray(point, dtype=float).tobytes()
            if key in results:
                self.replayed += 1
                return results[key].copy()
            value = np.asarray(function(point), dtype=float)
            results[key] = value.copy()
            self.computed += 1
            if time.perf_counter() - self._saved > CHECKPOINT_SECONDS:
                self.save()
            return value

        return call

    def save(self) -> None:
        """Writes the checkpoint."""
        arrays = {}
        for name, results in self.results.items():
            if results:
                arrays[f"{name}:points"] = np.array([np.frombuffer(key) for key in results])
                arrays[f"{name}:values"] = np.array(list(results.values()))
        save_arrays(self.checkpoint, self.identity, arrays)
        self._saved = time.perf_counter()
