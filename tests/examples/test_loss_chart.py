"""The chart of losses: labels apart, and no empty axes."""

from __future__ import annotations

from itertools import pairwise

import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from teg.examples.loss_chart import draw_losses


def test_labels_of_equal_losses_do_not_overlap_and_tiny_losses_have_an_axis() -> None:
    axes = Figure().subplots()
    draw_losses(axes, {"one": [0.5, 1e-300], "other": [0.5]}, {"mark": 0.5})
    assert len(axes.lines) == 3
    assert axes.get_ylim()[0] > 1e-14
    places = sorted(text.xyann[1] if hasattr(text, "xyann") else text.xy[1] for text in axes.texts)
    assert min(b - a for a, b in pairwise(places)) > 0.1


def test_a_picture_of_one_colour_has_a_sentence_instead_of_axes() -> None:
    axes = Figure().subplots()
    draw_losses(axes, {"one": [1e-17, 1e-30]}, {"mark": 0.0})
    assert not axes.axison
    assert "one colour" in axes.texts[0].get_text()
