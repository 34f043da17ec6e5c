"""Checkpoints of a run: written whole or not at all, and resumed only by a run with the same identity."""

from __future__ import annotations

import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from teg.errors import InputError

S = TypeVar("S")
UNREADABLE = (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)


def save_checkpoint(
    path: Path, identity: Mapping[str, Any], state: Any, losses: list[float], seconds: float, frames: Mapping[int, Any]
) -> None:
    """Replaces the checkpoint in one step: a crash leaves the old one or the new one.

    `state` is a dataclass of arrays, numbers and booleans; `frames` are earlier ones, by step.
    """
    arrays = {name: value for step, frame in frames.items() for name, value in _arrays(frame, f"{step}:").items()}
    save_arrays(path, identity, {"losses": losses, "seconds": seconds, "frames": sorted(frames), **_arrays(state, ""), **arrays})


def save_arrays(path: Path, identity: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Replaces a file of arrays in one step."""
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as file:
        np.savez(file, identity=json.dumps(identity), **arrays)
    os.replace(partial, path)


def load_arrays(path: Path, identity: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Returns the arrays of a file. Raises InputError if there is none, it is damaged, or its identity is another one."""
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            stored = {name.removesuffix(".npy"): _array_of(archive, name) for name in archive.namelist()}
        before = dict(json.loads(str(stored["identity"])))
    except FileNotFoundError:
        hint = "leave --resume out, or name the folder of an earlier run with -o"
        raise InputError(f"there is nothing to resume: no {str(path)!r}", None, hint) from None
    except UNREADABLE as problem:
        raise _damaged(path, problem) from problem
    _check_identity(path, before, identity)
    return stored


def load_checkpoint(path: Path, identity: Mapping[str, Any], kind: type[S]) -> tuple[S, list[float], float, dict[int, S]]:
    """Returns the state (of the dataclass `kind`), the losses so far, the seconds they took, and earlier states by their step.

    `identity` must equal the stored one. Raises InputError if there is no checkpoint, it is damaged, or belongs to another run.
    """
    stored = load_arrays(path, identity)
    try:
        losses, seconds = [float(loss) for loss in stored["losses"]], float(stored["seconds"])
        frames = {int(step): _state(stored, kind, f"{step}:") for step in stored["frames"]}
        return _state(stored, kind, ""), losses, seconds, frames
    except UNREADABLE as problem:
        raise _damaged(path, problem) from problem


def _damaged(path: Path, problem: Exception) -> InputError:
    cause = problem.strerror if isinstance(problem, OSError) else "it is damaged, cut short, or no checkpoint"
    return InputError(f"the checkpoint {str(path)!r} cannot be read: {cause}", None, "start again without --resume")


def _check_identity(path: Path, before: Mapping[str, Any], identity: Mapping[str, Any]) -> None:
    changed = [f"{k} was {before.get(k)!r}, is {v!r}" for k, v in identity.items() if before.get(k) != v]
    if changed:
        what = f"the checkpoint {str(path)!r} is of another run: " + "; ".join(changed)
        raise InputError(what, None, "give the same options, or start again without --resume")


def _arrays(state: Any, prefix: str) -> dict[str, Any]:
    return {prefix + f.name: getattr(state, f.name) for f in fields(state)}


def _state(stored: Mapping[str, np.ndarray], kind: type[S], prefix: str) -> S:
    return kind(**{f.name: _plain(stored[prefix + f.name]) for f in fields(kind)})  # type: ignore[arg-type]


def _array_of(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    """Returns an array of a file of arrays, read whole, so that damage to it is seen."""
    return np.lib.format.read_array(io.BytesIO(archive.read(name)), allow_pickle=False)


def _plain(array: np.ndarray) -> Any:
    return array if array.ndim else array.item()
