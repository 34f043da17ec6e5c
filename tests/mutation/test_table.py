"""The table of wrong changes fits the tree: nearly all of them can be made, and each test is there."""

from __future__ import annotations

from pathlib import Path

from tests.mutation.table import MUTANTS

ROOT = Path(__file__).resolve().parents[2]


def test_nearly_all_changes_can_be_made() -> None:
    """Their texts stand once; where the tree has moved on, a few may be behind it."""
    fitting = [m for m in MUTANTS if (ROOT / m.file).is_file() and (ROOT / m.file).read_text().count(m.old) == 1]
    assert len(fitting) >= 0.9 * len(MUTANTS) >= 140, sorted({m.name for m in MUTANTS} - {m.name for m in fitting})


def test_each_has_a_name_and_tests_that_are_there() -> None:
    assert len({m.name for m in MUTANTS}) == len(MUTANTS)
    for mutant in MUTANTS:
        assert mutant.old != mutant.new
        assert all((ROOT / test.split("::")[0]).is_file() for test in mutant.tests)
