"""The list of passes: what is dumped and checked after each."""

from __future__ import annotations

from typing import Any

import pytest

import teg
from teg import pipeline
from teg.ir.expr import Add, Expr
from teg.passes.differentiate.estimators.exact import Exact
from teg.passes.normalise.canonicalise import Canonical
from teg.pipeline import begun, compiled_outputs, eliminations, normal_form, run_pass, to_atoms, to_finished

x, y = teg.vars("x y")
t, a = teg.params("t a")
E = teg.integral(teg.bracket(x + a * y < t) * x, (x, 0, 1), (y, 0, 1))


def after(text: str) -> list[str]:
    """The passes whose programs a text has, each once."""
    return list(dict.fromkeys(line[9:-3] for line in text.splitlines() if line.startswith("-- after ")))


def test_every_pass_can_be_dumped(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("TEG_DUMP", "all")
    teg.compile(teg.diff(E, t) + E).grad_and_error(t=0.4, a=0.5)
    seen = set(after(capsys.readouterr().err))
    named = [*to_atoms(True, (), Canonical()), *eliminations(True, (), Canonical()), *to_finished(errors=True)]
    assert {name for name, _ in named} | {"around poles", "adjoint", "differentiate", "exact", "centre", "exponents", "lower"} == seen


def test_one_pass_is_dumped_where_it_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("TEG_DUMP", "sink")
    teg.compile(E)(t=0.4, a=0.5)
    text = capsys.readouterr().err
    assert after(text) == ["sink"]
    assert "= Polygon(" in text
    assert "outputs v" in text
    monkeypatch.setenv("TEG_DUMP", "canonicalise")
    teg.eliminate(teg.diff(E, a))
    assert after(capsys.readouterr().err) == ["canonicalise"]


def test_a_pass_that_makes_a_malformed_expression_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(e: Expr) -> Expr:
        return Add.make(None, (e,))

    with pytest.raises(AssertionError, match="after broken: a Add of fewer than two"):
        run_pass("broken", broken, E)
    monkeypatch.delenv("TEG_VERIFY")
    assert run_pass("broken", broken, E).children == (E,)


def test_a_beginning_serves_several_derivations() -> None:
    """Values and derivatives that share the normal form are those that do not, however often it serves."""
    for e in (E, teg.diff(E, t), E * teg.integral(teg.bracket(x * x + y < a) * teg.exp(x), (x, 0, 1), (y, 0, 1))):
        beginning = begun(e)
        for orders in (1, 0, 2, 1):
            assert compiled_outputs(e, [t, a], orders, Exact(), beginning=beginning) == compiled_outputs(e, [t, a], orders, Exact())


def test_a_gradient_takes_one_normal_form(monkeypatch: pytest.MonkeyPatch) -> None:
    """The values, of which its integrals are to be derivatives, begin with the same one."""
    seen: list[Expr] = []

    def counted(e: Expr, *args: Any, **options: Any) -> Expr:
        seen.append(e)
        return normal_form(e, *args, **options)

    monkeypatch.setattr(pipeline, "normal_form", counted)
    value, gradient = teg.compile(E, [t]).value_and_grad(t=0.4, a=0.5)
    assert value == pytest.approx((0.4**3 - 0.0) / (6 * 0.5) - max(0.0, 0.4 - 0.5) ** 3 / (6 * 0.5))
    assert gradient["t"] == pytest.approx(0.4**2 / (2 * 0.5))
    assert seen == [E]
