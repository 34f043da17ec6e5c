"""Checkpoints: what was saved is loaded, and a broken file is told as such."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from teg.errors import InputError
from teg.examples.checkpoint import load_checkpoint, save_checkpoint


@dataclass
class State:
    points: np.ndarray
    step: int


IDENTITY = {"size": 4}


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "checkpoint.npz"
    save_checkpoint(path, IDENTITY, State(np.linspace(0, 1, 1000), 7), [2.0, 1.0], 0.5, {3: State(np.zeros(2), 3)})
    return path


def test_what_was_saved_is_loaded(saved: Path) -> None:
    state, losses, seconds, frames = load_checkpoint(saved, IDENTITY, State)
    assert list(frames) == [3]
    np.testing.assert_array_equal(frames[3].points, np.zeros(2))
    np.testing.assert_array_equal(state.points, np.linspace(0, 1, 1000))
    assert (state.step, losses, seconds) == (7, [2.0, 1.0], 0.5)


@pytest.mark.parametrize("length", [0, 1, 100, 5000, -1])
def test_a_file_that_was_cut_is_damaged(saved: Path, length: int) -> None:
    saved.write_bytes(saved.read_bytes()[:length])
    with pytest.raises(InputError, match="damaged, cut short") as caught:
        load_checkpoint(saved, IDENTITY, State)
    assert "pickle" not in str(caught.value)
    assert "--resume" in caught.value.hint


def test_a_changed_byte_is_damage(saved: Path) -> None:
    content = bytearray(saved.read_bytes())
    content[content.index(np.linspace(0, 1, 1000)[500:].tobytes()[:64])] ^= 255
    saved.write_bytes(bytes(content))
    with pytest.raises(InputError, match="damaged"):
        load_checkpoint(saved, IDENTITY, State)


def test_other_files_are_no_checkpoints(saved: Path) -> None:
    for arrays in ({"x": np.ones(2)}, {"identity": np.array("[1]"), "losses": [1.0], "seconds": 1.0, "points": [1.0], "step": 1}):
        np.savez(saved, **arrays)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="no checkpoint"):
            load_checkpoint(saved, IDENTITY, State)
    np.savez(saved, identity=np.array([{}], dtype=object))  # would run code if it were unpickled
    with pytest.raises(InputError):
        load_checkpoint(saved, IDENTITY, State)
    saved.unlink()
    with pytest.raises(InputError, match="nothing to resume"):
        load_checkpoint(saved, IDENTITY, State)
    saved.mkdir()
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        load_checkpoint(saved, IDENTITY, State)
