"""One run of a chart: its folder, the page of its tables, what earlier runs measured. It can be interrupted, and continues from there."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypedDict

from teg.errors import InputError
from teg.evaluator.options import Backend
from teg.examples.charts.tables import read_page, write_page
from teg.examples.harness import machine, progress_bar, result_folder, versions, write_report
from teg.examples.options import default_backend


class Options(TypedDict, total=False):
    """The options of every chart.

    `quick` measures little; `fresh` measures again even if the folder has results; `backend` None is "c" if there is a C compiler, else
    "numpy"; `progress` shows a bar.
    """

    quick: bool
    fresh: bool
    backend: Backend | None
    progress: bool


class ChartRun:
    """Keeps the results of a chart in `name`.json of a folder. Raises InputError for a folder or a page that cannot be used.

    `interrupted` is true until the block of `interruptible` has ended without Ctrl-C, and so is that of every report saved before.
    """

    def __init__(self, name: str, out: str | Path, page: str | Path | None, options: Options) -> None:
        self.name, self.page, self.folder = name, page, result_folder(Path(out))
        self.quick, self.fresh, self.progress = options.get("quick", False), options.get("fresh", False), options.get("progress", True)
        self.backend = options.get("backend") or default_backend()
        self.interrupted = True
        self._store = self.folder / f"{name}.json"
        self._settings = {"quick": self.quick, "backend": self.backend}
        read_page(page)  # an error before the work, not after it

    def stored(self, part: str) -> Any:
        """Returns the results of an earlier run with the same settings, or {}. Raises InputError for a file of another kind."""
        if self.fresh or not self._store.exists():
            return {}
        try:
            stored = json.loads(self._store.read_text(encoding="utf-8"))
            return stored[part] if stored["settings"] == self._settings else {}
        except (ValueError, KeyError, TypeError, OSError):
            hint = "--fresh writes it anew, or name another folder"
            raise InputError(f"{str(self._store)!r} is not a report of this command", None, hint) from None

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Ends the block at Ctrl-C."""
        try:
            yield
            self.interrupted = False
        except KeyboardInterrupt:
            pass

    def bar(self, total: int, label: str) -> Any:
        """Returns the context manager of a progress bar."""
        return progress_bar(self.progress, total, 0, label)

    def save(self, **parts: Any) -> dict[str, Any]:
        """Writes a report with these parts, and returns it."""
        report = {"settings": self._settings, "interrupted": self.interrupted, **parts, "versions": versions(), "machine": machine()}
        write_report(self._store, report)
        return report

    def write_table(self, table: str, command: str = "") -> None:
        """Writes a table to the page, if there is one; `command` is the command that writes it, if that is not `teg chart name`."""
        if self.page is not None:
            write_page(self.page, read_page(self.page), self.name, table, command)
