"""The lists of tests that are left out of runs: what is quick, and that the lists name tests that are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.durations import ALONE, lines, quick

TESTS = Path(__file__).parents[1]


def test_short_tests_are_quick_and_the_shortest_of_a_function_and_a_backend() -> None:
    durations = {
        "a.py::f[1-c]": 0.2,
        "a.py::f[2-c]": 0.4,
        "a.py::f[1-numpy]": 0.25,
        "a.py::f[1-jax]": 0.6,
        "a.py::g": 0.01,
        "a.py::h": 0.02,
    }
    assert quick(durations) == {"a.py::f[1-c]", "a.py::f[1-numpy]", "a.py::g", "a.py::h"}
    assert list(lines(durations)) == ["a.py::f[1-jax]", "a.py::f[2-c]"]


def test_a_file_has_two_quick_tests_and_a_slow_function_one_line() -> None:
    durations = {"a.py::f": 3.0, "a.py::g": 2.0, "a.py::h[0]": 4.0, "a.py::h[1]": 5.0}
    assert quick(durations) == {"a.py::f", "a.py::g"}
    assert list(lines(durations)) == ["a.py::h"]


@pytest.mark.parametrize("name", ["slow.txt", "thorough.txt"])
def test_no_list_has_a_test_that_alone_notices_a_change(name: str) -> None:
    """Neither by itself nor by its function."""
    listed = set((TESTS / name).read_text().splitlines())
    cases = {line for line in ALONE if not line.startswith("#")}
    assert not (cases | {case.partition("[")[0] for case in cases}) & listed


@pytest.mark.parametrize("name", ["slow.txt", "thorough.txt", "mutation/alone.txt"])
def test_listed_tests_are_there(name: str) -> None:
    listed = [line for line in (TESTS / name).read_text().splitlines() if not line.startswith("#")]
    assert listed == sorted(set(listed))
    texts = {file: (TESTS / file).read_text() for file in {line.partition("::")[0] for line in listed}}
    for line in listed:
        file, *_, function = line.partition("[")[0].split("::")
        assert re.search(rf"def {function}\(", texts[file]), line
