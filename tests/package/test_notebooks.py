"""The notebooks of the site run, and hold no outputs: the site runs them when it is built."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "docs" / "notebooks").glob("*.ipynb"))
WIDEST = 92
"""The longest line of code that a page shows without scrolling."""


def cells_of(notebook: Path) -> list[dict[str, Any]]:
    """The cells of code, whose source is a list of lines."""
    return [cell for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_runs_without_a_warning(notebook: Path) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    if "scipy" in notebook.read_text(encoding="utf-8"):
        pytest.importorskip("scipy")
    matplotlib.use("agg")
    names: dict[str, Any] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "FigureCanvasAgg is non-interactive")  # plt.show()
        for cell in cells_of(notebook):
            exec(compile("".join(cell["source"]), notebook.name, "exec"), names)
    matplotlib.pyplot.close("all")
    if notebook.stem == "picture":
        np.testing.assert_allclose([names["guess"][k] for k in ("cx", "cy", "radius", "light")], [9.3, 7.1, 4.6, 0.8], atol=0.01)
    if notebook.stem == "reliability":
        assert names["best"].success
        assert names["f"](*names["best"].x) == pytest.approx(1e-4, rel=1e-5)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_is_stored_without_outputs_and_fits_a_page(notebook: Path) -> None:
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells_of(notebook))
    assert [line for cell in cells_of(notebook) for line in cell["source"] if len(line.rstrip()) > WIDEST] == []


def test_there_are_three() -> None:
    assert [notebook.stem for notebook in NOTEBOOKS] == ["picture", "reliability", "threshold"]
