"""Prints the faults that the quick run passes over."""

from __future__ import annotations

import pytest

from tests.fuzz.open_faults import OPEN


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if OPEN:
        terminalreporter.section("random programs: open faults")
        for seed, cause in sorted(OPEN.items()):
            terminalreporter.line(f"seed {seed}: {cause}")
