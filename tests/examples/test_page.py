"""The page of a run: its pictures are inside, large ones smaller, and letters are as large on telephones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

Image = pytest.importorskip("PIL.Image")

from teg.examples import page  # noqa: E402
from teg.examples.page import write_page  # noqa: E402


def report_of(*pictures: Path) -> dict[str, Any]:
    """The report of a run with these pictures."""
    parts = {"demo": "perlin", "summary": ["a < b", "done"], "command": "teg demo perlin", "options": {"size": 8}}
    return parts | {"versions": {"python": "3"}, "machine": {"processors": 2}, "pictures": [str(picture) for picture in pictures]}


def test_everything_is_inside_and_wide_pictures_have_a_row(tmp_path: Path) -> None:
    for name, shape in (("first.png", (20, 20, 3)), ("wide.png", (20, 900, 3)), ("photo.png", (20, 60, 3))):
        Image.fromarray(np.zeros(shape, dtype=np.uint8)).save(tmp_path / name)
    (tmp_path / "mesh.svg").write_text("<svg/>", encoding="ascii")
    write_page(tmp_path / "index.html", report_of(*(tmp_path / name for name in ("first.png", "wide.png", "photo.png", "mesh.svg"))))
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert text.count("<figure class=wide>") == 2
    assert text.count("<figure>") == 2
    assert text.count('src="data:image/') == 4
    assert "a &lt; b" in text
    assert "width=device-width" in text
    assert "http" not in text


def test_large_pictures_are_smaller_and_heavy_drawings_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "LARGEST", 1000)
    monkeypatch.setattr(page, "SIDE", 40)
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (90, 60, 3)).astype(np.uint8)).save(tmp_path / "noise.png")
    (tmp_path / "mesh.svg").write_text("<svg/>" * 1000, encoding="ascii")
    write_page(tmp_path / "index.html", report_of(tmp_path / "noise.png", tmp_path / "mesh.svg"))
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert text.count("data:image/jpeg") == 1
    assert "svg" not in text.split("<main>")[1]
