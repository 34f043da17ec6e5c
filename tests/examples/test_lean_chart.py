"""The chart of what scenes take beside the least known: by hand and generated agree, a run continues, the page shows what is stored."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import teg
from teg.__main__ import main
from teg.examples.charts import lean, run_lean
from teg.examples.charts.lean_scenes import SCENES, Scene, nodes_in_a_plane, nodes_on_a_line

pytest.importorskip("matplotlib")

PAGE = Path(__file__).parents[2] / "docs" / "lean.md"
MARKS = "<!-- begin lean: written by `teg chart lean` -->\n<!-- end lean -->\n"
BY_HAND = [s for s in SCENES if s.least.by_hand]


def values_of(scene: Scene, n: int) -> dict[str, Any]:
    return {name: column[:n].copy() for name, column in scene.draw(np.random.default_rng(2)).items()}


@pytest.mark.parametrize("scene", BY_HAND, ids=lambda s: s.name)
def test_by_hand_and_generated_agree(scene: Scene) -> None:
    e, wrt = scene.build()
    f = teg.compile(e, wrt, backend="numpy")
    values = values_of(scene, 4)
    hand = lean.ByHand(scene.least.by_hand, values, lean.columns_by_hand(scene, wrt), len(wrt))
    assert hand.difference(f, values, wrt) < 1e-10


def test_counts_are_those_of_the_program_that_runs() -> None:
    scenes = {s.name: s for s in SCENES}
    for name in ("triangle crossing, linear", "disk × exp·cos"):
        scene = scenes[name]
        f = teg.compile(*scene.build(), backend="numpy")
        values = scene.draw(np.random.default_rng(lean.SEED))
        n = max(map(np.size, values.values()))
        chosen = {k: v[:: -(-n // lean.COUNTED)] for k, v in values.items()}
        assert lean.counted(f, scene)[0].evaluations == f.evaluations(chosen, derivatives=1) / lean.COUNTED
    brackets = scenes["50 brackets × exp"]
    means, statements = lean.counted(teg.compile(*brackets.build(), backend="numpy"), brackets)
    assert means.decisions >= 50
    assert statements < 500  # of one term, and a loop


def test_the_least_nodes_of_a_degree() -> None:
    assert [nodes_in_a_plane(d) for d in (0, 1, 2, 3, 4)] == [1, 1, 3, 3, 6]
    assert [nodes_on_a_line(d) for d in (0, 1, 2, 3)] == [1, 1, 2, 2]
    assert all(s.least.by_hand or s.least.source or s.least.nanoseconds != s.least.nanoseconds for s in SCENES)


def test_a_run_continues_and_writes_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    page.write_text(MARKS, encoding="utf-8")
    command = ["chart", "lean", "-o", str(tmp_path), "--page", str(page), "--quick", "--quiet", "--backend", "numpy"]
    assert main(command) == 0
    assert "3 scenes" in capsys.readouterr().out
    text = page.read_text(encoding="utf-8")
    assert all(f"| {name} |" in text for name in run_lean.QUICK)
    assert (tmp_path / "lean.png").is_file()

    def never(*_: Any) -> None:
        raise AssertionError("measured again")

    monkeypatch.setattr(lean, "measure", never)
    assert main(command) == 0
    assert page.read_text(encoding="utf-8") == text


def test_the_page_shows_what_was_measured() -> None:
    text = PAGE.read_text(encoding="utf-8")
    stored = json.loads((PAGE.with_suffix("") / "lean.json").read_text(encoding="utf-8"))["rows"]
    assert list(stored) == [s.name for s in SCENES]
    rows = [lean.Row(**row) for row in stored.values()]
    assert run_lean.lean_table(rows) in text
    for row, scene in zip(rows, SCENES, strict=True):
        assert row.least_evaluations == scene.least.evaluations
        assert row.measured == bool(scene.least.by_hand)
        assert row.difference is None or row.difference < 1e-9
    assert "lean/lean.png" in text
    assert (PAGE.with_suffix("") / "lean.png").is_file()
