"""A job for each of many items, in as many processes as there are processors."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

from teg.examples.harness import progress_bar


def in_parallel(job: Callable[[Any], None], items: list[Any], progress: bool, label: str) -> None:
    """Runs the job for each item."""
    for _ in results(job, items, progress, label):
        pass


def results(job: Callable[[Any], Any], items: list[Any], progress: bool, label: str) -> Iterator[tuple[Any, Any]]:
    """Yields (item, job(item)) in the order of completion, with as many processes as there are processors."""
    workers = min(os.cpu_count() or 1, len(items) // 4)
    with progress_bar(progress, len(items), 0, label) as bar:
        for item, result in _pooled(job, items, workers) if workers > 1 else ((i, job(i)) for i in items):
            if bar is not None:
                bar.update()
            yield item, result


def _pooled(job: Callable[[Any], Any], items: list[Any], workers: int) -> Iterator[tuple[Any, Any]]:
    with _pool(workers) as pool:
        jobs = {pool.submit(job, item): item for item in items}
        for done in as_completed(jobs):
            yield jobs[done], done.result()


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Yields processes that leave Ctrl-C to their parent, and start nothing new after it."""
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_ignore_interrupts)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
