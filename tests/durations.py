"""Chooses the tests of the quick run by what they take, and writes the others to `tests/slow.txt`.

    python -m pytest -n auto -m "not thorough" -p tests.durations

Quick are tests of less than EACH seconds, and of those that take more the shortest of each function and backend, if it takes less than
FIRST; the shortest two of a file are quick in any case, and so are those of `mutation/alone.txt`. A line of the list is a test, or a
function whose tests are all slow.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

EACH, FIRST = 0.1, 0.3
LEAST = 2
LIST = Path(__file__).parent / "slow.txt"
ALONE = frozenset((Path(__file__).parent / "mutation" / "alone.txt").read_text().splitlines())
HEADER = """\
# Tests that `make test` runs and `make fast` leaves out, for what they take: `tests/durations.py` writes this list. Tests with the mark
# `slow` and those of `thorough.txt` are left out as well.
"""


def shortest_first(durations: Mapping[str, float]) -> list[str]:
    return sorted(durations, key=lambda name: (durations[name], name))


def quick(durations: Mapping[str, float]) -> set[str]:
    """Returns the tests of the quick run."""
    chosen = {name for name, seconds in durations.items() if seconds < EACH or name in ALONE}
    files: dict[str, list[str]] = defaultdict(list)
    families: set[tuple[str, str]] = set()
    for name in shortest_first(durations):
        function, _, case = name.partition("[")
        backend = re.search(r"\b(c|jax|numpy)\b", case)
        family = function, backend[0] if backend else ""
        if family not in families and durations[name] < FIRST:
            chosen.add(name)
        families.add(family)
        files[name.partition("::")[0]].append(name)
    return chosen.union(*(names[:LEAST] for names in files.values()))


def lines(durations: Mapping[str, float]) -> Iterator[str]:
    """Yields the lines of the list: tests that are not quick, and functions of which no test is."""
    chosen = quick(durations)
    partly = {name.partition("[")[0] for name in chosen}
    slow = [name for name in durations if name not in chosen]
    yield from sorted({name if name.partition("[")[0] in partly else name.partition("[")[0] for name in slow})


_durations: dict[str, float] = defaultdict(float)
_slow: set[str] = set()
"""Tests that are slow by a mark."""
_listed = set(LIST.read_text().splitlines()) if LIST.exists() else set()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    name = report.nodeid.removeprefix("tests/")
    _durations[name] += report.duration
    if "slow" in report.keywords and _listed.isdisjoint((name, name.partition("[")[0])):
        _slow.add(name)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if not hasattr(session.config, "workerinput"):
        LIST.write_text(HEADER + "".join(f"{line}\n" for line in lines({n: t for n, t in _durations.items() if n not in _slow})))
