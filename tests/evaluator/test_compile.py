"""`teg.evaluate` and the options of `teg.compile` as users give them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg import errors

x = teg.var("x")
t, a = teg.params("t a")
AREA = teg.integral(teg.bracket(x < t) * (1 + a * x), (x, 0, 1))  # t + ½at²


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_values_by_name_in_a_dict_or_both(backend: Any) -> None:
    for found in (
        teg.evaluate(AREA, t=0.5, a=2.0, backend=backend),
        teg.evaluate(AREA, {t: 0.5}, a=2, backend=backend),
        teg.evaluate(AREA, {"t": 0.5, a: 2}, backend=backend, tol=1e-8),
    ):
        assert type(found) is float
        assert found == 0.75
    assert teg.evaluate(AREA, t=np.array([0.5, 1.0]), a=2.0).tolist() == [0.75, 2.0]
    assert teg.evaluate(teg.tuple(t, (a, 1)), t=0.5, a=2.0) == (0.5, (2.0, 1.0))
    assert teg.evaluate(2 * teg.integral(x, (x, 0, 1))) == 1.0


def test_values_that_a_derivative_has_lost_are_ignored() -> None:
    assert teg.evaluate(teg.diff(t * a, t), t=0.5, a=2.0) == 2.0
    assert teg.evaluate(teg.diff(t * a, t), {t: 0.5, "a": 2.0, "unknown": 1}) == 2.0


def test_a_parameter_with_the_name_of_an_option() -> None:
    tol = teg.param("tol")
    assert teg.evaluate(tol * 2, {tol: 0.5}) == teg.evaluate(tol * 2, {tol: 0.5}, tol=1e-6) == 1.0
    with pytest.raises(errors.ParameterError, match="an option and a parameter"):
        teg.evaluate(tol * 2, tol=0.5)


@pytest.mark.parametrize(
    ("args", "named", "hint"),
    [
        ((), {"t": 0.5, "bakend": "c"}, "'backend'"),
        ((), {"t": 0.5}, "the parameters are"),
        (({t: 0.5},), {"t": 1.0, "a": 1.0}, "by name, or in the dict"),
        (([0.5, 1.0],), {}, "teg.evaluate(e, t=0.5)"),
        ((0.5,), {"a": 1.0}, "teg.evaluate(e, t=0.5)"),
        (({"scene": {"t": 0.5, "a": 1.0}},), {}, "values['scene']"),
        ((), {"t": {"x": 1.0}, "a": 1.0}, "the parameters are"),
    ],
)
def test_mistakes_say_what_to_write(args: tuple[Any, ...], named: dict[str, Any], hint: str) -> None:
    with pytest.raises(errors.ParameterError) as caught:
        teg.evaluate(AREA, *args, **named)
    assert hint in caught.value.hint


def test_nested_dicts_of_arguments() -> None:
    f = teg.compile(AREA, [t, a])
    for nested in ({"scene": {"t": 0.5, "a": 1.0}}, {"t": {"value": 0.5}, "a": 1.0}):
        with pytest.raises(errors.ParameterError, match="one flat dict"):
            f(nested)
    with pytest.raises(errors.ParameterError, match="one flat dict"):
        f(t={"value": 0.5}, a=1.0)


def test_texts_of_the_objects() -> None:
    f = teg.compile(AREA, [t, a])
    assert repr(f) == "<teg.Evaluator(t, a) of ∫[x: 0..1] [x < t]·(a·x + 1) on numpy>"
    assert repr(teg.scipy_function(AREA, [t], fixed={"a": 1.0})).startswith("<teg.scipy_function of the vector (t), for ∫")
    assert len(repr(teg.compile(sum((t**k * a for k in range(300)), start=t)))) < 300
    (found,) = f.diagnose(t=1.0, a=1.0)
    text = str(found)
    assert text.startswith("At t = 1, a = 1, t - x = 0 coincides with the bound x = 1; ")
    assert text.endswith("their mean.")
    assert repr([found]) == f"[<teg.Diagnosis tie: {text}>]"
    assert str(teg.compile(t * AREA).diagnose(t=np.array([0.5, 1.0]), a=1.0)[0]).startswith("In element 1 of the batch, at ")


def test_texts_of_functions_of_jax() -> None:
    pytest.importorskip("jax")
    assert repr(teg.jax_function(AREA, [t, a])) == "<teg.jax_function(t, a) of ∫[x: 0..1] [x < t]·(a·x + 1)>"


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("gone", ["never written", "a condition and its opposite"])
def test_an_array_that_a_program_does_not_read(gone: str, backend: Any) -> None:
    """Parameters may be listed that a program does not have, and so may arrays, also where it has no others."""
    V, k, s, z = teg.array("V"), teg.index("k"), teg.param("s"), teg.var("z")
    inside = teg.any(z < V[k], (k, 0, teg.length(V)))
    e = teg.integral(s * z + (teg.bracket(inside & ~inside) if gone != "never written" else 0.0), (z, 0, 1))
    f = teg.compile(e, [V, s], backend=backend)
    at = {"V": [0.2, 0.7], "s": 3.0}
    value, gradient = f.value_and_grad(at)
    assert value == pytest.approx(1.5)
    assert gradient["V"].tolist() == [0.0, 0.0]
    assert gradient["s"] == pytest.approx(0.5)
    assert f.hvp(at, at)["V"].tolist() == [0.0, 0.0]
    assert f.jvp(at, at) == (pytest.approx(1.5), pytest.approx(1.5))
    assert f.nodes(at)[1].sum() == pytest.approx(1.5)
    assert "V" in f.parameters
    assert str(teg.explain(e, [V, s]))
    assert teg.compile(e, V, backend=backend).grad(at)["V"].tolist() == [0.0, 0.0]
