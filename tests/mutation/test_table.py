"""The table of wrong changes fits the tree: each text stands once, and each test is there."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.mutation.table import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda m: m.name)
def test_a_change_can_be_made(mutant: Mutant) -> None:
    assert (ROOT / mutant.file).read_text().count(mutant.old) == 1
    assert mutant.old != mutant.new
    for test in mutant.tests:
        assert (ROOT / test.split("::")[0]).is_file()


def test_there_are_sixty_with_a_name_each() -> None:
    assert len({m.name for m in MUTANTS}) == len(MUTANTS) >= 60
