"""What notebooks show of an evaluator."""

from __future__ import annotations

import pytest

import teg
from teg import pipeline
from teg.report.notebook import card_of

x, y = teg.vars("x y")
t, a, n = teg.params("t a n")
V, F, k = teg.array("V", 2), teg.indices("F"), teg.index("k")
SCENE = teg.integral(teg.bracket(x < t) * teg.bracket(y < a) * x, (x, 0, 1), (y, 0, 1)) + teg.sum(V[F[k], 0], (k, 0, n))


def test_formula_parameters_and_surfaces() -> None:
    f = teg.compile(SCENE, [t, V])
    html, markdown = f._repr_html_(), f._repr_markdown_()
    for text in (html, markdown):
        assert r"\int_{0}^{1}" in text
        assert "teg.Evaluator on numpy" in text
        assert "t - x = 0" in text
        assert "a - y = 0 (does not move)" in text
        assert "number, differentiated by" in text
        assert "array of 2 dimensions, differentiated by" in text
        assert "array of 1 dimension, integers" in text
    assert "<table>" in html
    assert "x &lt; t" in html
    assert "| `t` |" in markdown


def test_a_long_program_is_shown_in_short_and_nothing_is_derived(monkeypatch: pytest.MonkeyPatch) -> None:
    e = sum((teg.bracket(x < teg.param(f"p{i}")) * x**i for i in range(200)), start=x)
    f = teg.compile(teg.integral(e, (x, 0, 1)))
    monkeypatch.setattr(pipeline, "run_pass", lambda *_: pytest.fail("a pass was run"))
    card = card_of(f.expression, [], [], "c")
    assert card.count == 200
    assert len(card.surfaces) == 16
    assert card.more == "… and 184 more"
    assert "nodes" in card.formula
    assert len(f._repr_html_()) < 30_000
