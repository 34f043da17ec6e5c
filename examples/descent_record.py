"""A descent with its record: cost and gain of every step, checkpoints, interrupts without loss."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from teg.examples.checkpoint import load_checkpoint, save_checkpoint
from teg.examples.harness import progress_bar, ratio

CHECKPOINT_SECONDS = 5.0


class State(Protocol):
    """The state of a descent, a dataclass with all data that its next step depends on. `stuck` says that no step lowers the loss."""

    @property
    def loss(self) -> float: ...

    @property
    def stuck(self) -> bool: ...


S = TypeVar("S", bound=State)


class RecordedDescent(Generic[S]):
    """Start, present state, the losses from the start on, and the seconds of all parts of the run.

    `advance` makes one step. `identity` must be the same for `resume`, which continues from the checkpoint. Raises InputError if it
    cannot.
    """

    def __init__(self, start: S, advance: Callable[[S], S], checkpoint: Path, identity: Mapping[str, Any], resume: bool) -> None:
        self.advance, self.checkpoint, self.identity = advance, checkpoint, identity
        self.start = self.state = start
        self.losses, self.seconds = [start.loss], 0.0
        if resume:
            self.state, self.losses, self.seconds = load_checkpoint(checkpoint, identity, type(start))

    def descend(self, steps: int, progress: bool, label: str = "") -> bool:
        """Steps until `steps` are done in all or no step lowers the loss. Returns True if Ctrl-C came before that."""
        saved = begun = time.perf_counter()
        before = self.seconds
        try:
            with progress_bar(progress, steps, len(self.losses) - 1, label) as bar:
                while len(self.losses) <= steps and not self.state.stuck:
                    state = self.advance(self.state)
                    losses = self.losses if state.stuck else [*self.losses, state.loss]
                    self.state, self.losses = state, losses  # together: Ctrl-C must not come between
                    now = time.perf_counter()
                    self.seconds = before + now - begun
                    if bar is not None:
                        bar.update(0 if state.stuck else 1)
                        bar.set_postfix_str(f"loss {state.loss:.5f}, {ratio(state.loss, losses[0]):.1%} of start")
                    if now - saved > CHECKPOINT_SECONDS:
                        self.save()
                        saved = now
        except KeyboardInterrupt:
            return True
        finally:
            self.save()
        return False

    def save(self) -> None:
        """Writes the checkpoint."""
        save_checkpoint(self.checkpoint, self.identity, self.state, self.losses, self.seconds)
