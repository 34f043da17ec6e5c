"""Checkpoints of a run: written whole or not at all, and resumed only by a run with the same identity."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from teg.errors import InputError

S = TypeVar("S")


def save_checkpoint(path: Path, identity: Mapping[str, Any], state: Any, losses: list[float], seconds: float) -> None:
    """Replaces the checkpoint in one step: a crash leaves the old one or the new one.

    `state` is a dataclass of arrays, numbers and booleans.
    """
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as file:
        arrays: dict[str, Any] = {f.name: getattr(state, f.name) for f in fields(state)}
        np.savez(file, identity=json.dumps(identity), losses=losses, seconds=seconds, **arrays)
    os.replace(partial, path)


def load_checkpoint(path: Path, identity: Mapping[str, Any], kind: type[S]) -> tuple[S, list[float], float]:
    """Returns the state (of the dataclass `kind`), the losses so far and the seconds they took. `identity` must equal the stored one.

    Raises InputError if there is no checkpoint, it is damaged, or belongs to another run.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            stored = dict(archive)
        before = json.loads(str(stored["identity"]))
        state = kind(**{f.name: _plain(stored[f.name]) for f in fields(kind)})  # type: ignore[arg-type]
        losses, seconds = [float(loss) for loss in stored["losses"]], float(stored["seconds"])
    except FileNotFoundError:
        hint = "leave --resume out, or name the folder of an earlier run with -o"
        raise InputError(f"there is nothing to resume: no {str(path)!r}", None, hint) from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as problem:
        hint = f"start again without --resume ({problem})"
        raise InputError(f"the checkpoint {str(path)!r} cannot be read", None, hint) from None
    changed = [f"{k} was {before.get(k)!r}, is {v!r}" for k, v in identity.items() if before.get(k) != v]
    if changed:
        raise InputError(
            f"the checkpoint {str(path)!r} is of another run: " + "; ".join(changed),
            None,
            "give the same options, or start again without --resume",
        )
    return state, losses, seconds


def _plain(array: np.ndarray) -> Any:
    return array if array.ndim else array.item()
