"""Films: a GIF always, an MP4 where PyAV is installed, and a line that says so where it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main

Image = pytest.importorskip("PIL.Image")
pytest.importorskip("matplotlib")

from teg.examples import animation, harness  # noqa: E402
from teg.examples.animation import NO_VIDEO, write_film  # noqa: E402


def frames() -> list[np.ndarray]:
    """Four pictures with odd sides, of a bar that moves."""
    pictures = [np.full((31, 45, 3), 240, dtype=np.uint8) for _ in range(4)]
    for k, picture in enumerate(pictures):
        picture[:, 10 * k : 10 * k + 10] = (200, 30, 60)
    return pictures


def test_a_film_is_a_gif_that_waits_at_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation, "can_write_video", lambda: False)
    write_film(tmp_path / "bar.gif", frames(), 100, 700)
    assert [file.name for file in tmp_path.iterdir()] == ["bar.gif"]
    with Image.open(tmp_path / "bar.gif") as film:
        assert film.n_frames == 4
        assert film.size == (45, 31)
        film.seek(3)
        assert film.info["duration"] == 700
        assert np.abs(np.asarray(film.convert("RGB"))[15, 35].astype(int) - (200, 30, 60)).max() < 8


def test_with_pyav_there_is_an_mp4_of_the_same_pictures(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    write_film(tmp_path / "bar.gif", frames(), 100, 700)
    with av.open(str(tmp_path / "bar.mp4")) as film:
        stream = film.streams.video[0]
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
        assert (stream.codec_context.width, stream.codec_context.height) == (46, 32)
        assert float(stream.average_rate) == pytest.approx(10)
    assert len(shown) == 3 + 7
    for k, picture in enumerate(frames()):
        assert np.abs(shown[k][10:20, 10 * k + 3 : 10 * k + 7].astype(int) - picture[10:20, 10 * k + 3 : 10 * k + 7]).max() < 30


@pytest.mark.parametrize("installed", [True, False])
def test_a_run_names_its_films_or_says_what_makes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], installed: bool
) -> None:
    pytest.importorskip("scipy")
    if installed:
        pytest.importorskip("av")
    monkeypatch.setattr(animation, "can_write_video", lambda: installed)
    monkeypatch.setattr(harness, "can_write_video", lambda: installed)
    monkeypatch.setattr(animation, "FRAMES", 3)
    assert main(["demo", "bouncing-ball", "--contacts", "1", "--steps", "20", "--alone", "--backend", "numpy", "-o", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / "bouncing_ball.mp4").exists() == installed
    assert ("bouncing_ball.mp4" in printed) == installed
    assert (NO_VIDEO in printed) == (not installed)
