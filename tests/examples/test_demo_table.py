"""The table of the demonstrations."""

from __future__ import annotations

import resource
from pathlib import Path
from typing import Any

import pytest

from teg.examples import demo_table
from teg.examples.options import DEMOS


def test_a_row_has_steps_times_and_the_end_of_each_treatment(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def measured(name: str, treatment: str, fast: bool, folder: Path) -> tuple[dict[str, Any], float]:
        end = {"exact": 0.25, "ignore": 1.0, "smooth": 0.5}[treatment]
        if treatment == "ignore":
            return {"loss": {"end": end}, "failure": "stopped"}, 1.0
        return {"loss": {"end": end}, "steps": 4, "seconds": {"descent": 0.5}}, 100.0

    monkeypatch.setattr(demo_table, "measured", measured)
    assert demo_table.main(["triangulation", "--fast"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "| triangulation | loss | 4 | 125 | 0.25 | 1, not converged | 0.5 | 100 MB |"
    assert set(demo_table.MEASURES) == set(DEMOS)


def test_steps_are_counted_in_any_report() -> None:
    assert demo_table.steps_of({"epochs": 3, "losses": [1, 2]}) == 3
    assert demo_table.steps_of({"errors": [1.0, 0.1, 0.01]}) == 2
    assert demo_table.steps_of({}) == 0


def test_an_unknown_demo_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        demo_table.main(["sharders"])
    assert end.value.code == 2
    assert "none of" in capsys.readouterr().err


def test_a_run_is_measured_in_a_process_of_its_own(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    report, memory = demo_table.measured("auction", "exact", True, tmp_path)
    assert report["demo"] == "auction"
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # a new process begins as a copy of this one
    assert 20 < memory < max(2000, 1.1 * own)
