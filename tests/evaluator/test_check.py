"""The check of gradients: it passes what is right and finds what is wrong."""

from __future__ import annotations

import pytest

import teg

x, y = teg.vars("x y")
t, a = teg.params("t a")
AREA = teg.integral(teg.bracket(x + a * y < t) * teg.exp(x), (x, 0, 1), (y, 0, 1))


def test_a_right_gradient_passes() -> None:
    report = teg.check_gradient(teg.compile(AREA, [t, a]), t=0.7, a=0.4)
    assert report
    assert report.ok
    assert set(report.rows) == {"t", "a"}
    assert all(error < 1e-8 for _, _, error in report.rows.values())
    assert "ok" in str(report)


def test_a_wrong_gradient_is_found() -> None:
    report = teg.check_gradient(teg.compile(AREA, [t, a], discontinuities="ignore"), t=0.7, a=0.4)
    assert not report
    assert report.rows["t"][0] == 0.0
    assert report.rows["t"][1] == pytest.approx(teg.compile(AREA, [t, a]).grad(t=0.7, a=0.4)["t"], rel=1e-8)
    assert "WRONG" in str(report)


def test_the_tolerance() -> None:
    f = teg.compile(AREA, [t, a])
    assert not teg.check_gradient(f, t=0.7, a=0.4, tol=1e-18)


def test_a_tuple() -> None:
    f = teg.compile(teg.tuple(AREA, t * AREA), [t, a])
    assert teg.check_gradient(f, t=0.7, a=0.4)


def test_calls_as_an_evaluator() -> None:
    f = teg.compile(AREA, [t, a])
    assert teg.check_gradient(f, 0.7, 0.4)
    assert teg.check_gradient(f, {"t": 0.7, "a": 0.4})
    with pytest.raises(teg.TegError):
        teg.check_gradient(f, t=0.7)
    with pytest.raises(teg.TegError, match=r"teg\.compile\(e\)"):
        teg.check_gradient(AREA, t=0.7, a=0.4)  # type: ignore[arg-type]
