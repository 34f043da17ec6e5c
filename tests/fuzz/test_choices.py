"""Some random choices among rows of data, beside the same written out; `python -m tests.fuzz.choices -n 50` looks at more."""

from __future__ import annotations

import pytest

from tests.fuzz.choices import Scene, complaints


@pytest.mark.parametrize("seed", [0, 6, 10, 11])
def test_with_products(seed: int) -> None:
    assert complaints(seed, "numpy") == []


@pytest.mark.parametrize("seed", [9, 14, 19])
def test_values_and_gradients(seed: int) -> None:
    assert complaints(seed, "c", products=False) == []


def test_wrong_answers_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    right = Scene.written_out

    def larger(scene: Scene) -> object:
        e, names = right(scene)
        return 1.001 * e, names

    monkeypatch.setattr(Scene, "written_out", larger)
    monkeypatch.setattr(Scene, "on_grid", lambda scene: 9.0)
    told = complaints(10, "numpy", products=False)
    assert len(told) == 3
    assert "written out" in told[0]
    assert "on a grid" in told[1]
    assert "gradient" in told[2]
