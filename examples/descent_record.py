"""A descent with its record: cost and gain of every step, checkpoints, interrupts without loss."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from teg.examples.checkpoint import load_checkpoint, save_checkpoint
from teg.examples.harness import progress_bar, ratio

CHECKPOINT_SECONDS = 5.0
FRAMES = 12


class State(Protocol):
    """The state of a descent, a dataclass with all data that its next step depends on. `stuck` says that no step lowers the loss."""

    @property
    def loss(self) -> float: ...

    @property
    def stuck(self) -> bool: ...


S = TypeVar("S", bound=State)


def keep_freed_memory() -> None:
    """Makes the C library keep the memory of freed arrays for the next ones, in Linux.

    It would give it back, and get it page by page again in each step, which takes as long as the arithmetic. The limits from which on it
    gives memory back follow the largest block that was freed, up to 32 MB.
    """
    np.empty(31 << 20, dtype=np.uint8)


class RecordedDescent(Generic[S]):
    """Start, present state, the losses from the start on, states on the way by their step, and the seconds of all parts of the run.

    `advance` makes one step. `identity` must be the same for `resume`, which continues from the checkpoint. Raises InputError if it
    cannot. At most 2·FRAMES states on the way are kept, those at the multiples of a power of two, and of each what `shown` returns.
    """

    def __init__(
        self,
        start: S,
        advance: Callable[[S], S],
        checkpoint: Path,
        identity: Mapping[str, Any],
        resume: bool,
        shown: Callable[[S], S] = lambda state: state,
    ) -> None:
        self.advance, self.shown, self.checkpoint, self.identity = advance, shown, checkpoint, identity
        self.start = self.state = start
        self.losses, self.seconds = [start.loss], 0.0
        self.frames: dict[int, S] = {0: shown(start)}
        if resume:
            self.state, self.losses, self.seconds, self.frames = load_checkpoint(checkpoint, identity, type(start))

    @property
    def steps(self) -> int:
        """Returns the number of steps made."""
        return len(self.losses) - 1

    def descend(self, steps: int, progress: bool, label: str = "") -> bool:
        """Steps until `steps` are done in all or no step lowers the loss. Returns True if Ctrl-C came before that."""
        keep_freed_memory()
        saved = begun = time.perf_counter()
        before = self.seconds
        try:
            with progress_bar(progress, steps, self.steps, label) as bar:
                while self.steps < steps and not self.state.stuck:
                    state = self.advance(self.state)
                    losses = self.losses if state.stuck else [*self.losses, state.loss]
                    self.state, self.losses = state, losses  # together: Ctrl-C must not come between
                    self._keep()
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

    def _keep(self) -> None:
        stride = 1
        while self.steps // stride > 2 * FRAMES:
            stride *= 2
        frames = self.frames if self.steps % stride else {**self.frames, self.steps: self.shown(self.state)}
        self.frames = {step: state for step, state in frames.items() if step % stride == 0}

    def animation(self) -> list[S]:
        """Returns states on the way, evenly spaced, with the first and the last one."""
        return [*(state for step, state in self.frames.items() if step < self.steps), self.state]

    def save(self) -> None:
        """Writes the checkpoint."""
        save_checkpoint(self.checkpoint, self.identity, self.state, self.losses, self.seconds, self.frames)
