"""The order of creation, and positional arguments without a list of parameters."""

from __future__ import annotations

import pickle
import uuid

import pytest

import teg
from teg import errors
from teg.ir.creation import in_order_of_creation, is_order_certain
from teg.ir.expr import Param


def fresh(letters: str) -> list[str]:
    """Names that no other test has used."""
    mark = uuid.uuid4().hex
    return [f"{letter}_{mark}" for letter in letters]


def test_the_order_is_that_of_creation_and_not_that_of_appearance() -> None:
    t, a, b = teg.params(" ".join(fresh("tab")))
    f = teg.compile(b + 10 * a + 100 * t)
    assert f.parameters == (t.name, a.name, b.name)
    assert f(1.0, 2.0, 3.0) == 123.0
    assert list(f.grad(1.0, 2.0, 3.0)) == [t.name, a.name, b.name]


def test_arrays_and_integers_are_in_that_order_too() -> None:
    f_name, t_name, v_name = fresh("ftv")
    F, t, V, k = teg.indices(f_name), teg.param(t_name), teg.array(v_name), teg.index("k")
    f = teg.compile(teg.sum(t * V[F[k]], (k, 0, teg.length(F))))
    assert f.parameters == (f_name, t_name, v_name)
    assert f([1, 1, 0], 10.0, [1.0, 2.0]) == 50.0
    assert [p.name for p in f.wrt] == [t_name, v_name]


def test_a_list_comes_first_and_the_others_follow() -> None:
    t, a, b = teg.params(" ".join(fresh("tab")))
    f = teg.compile(t + 10 * a + 100 * b, [b])
    assert f.parameters == (b.name, t.name, a.name)
    assert f(3.0, 1.0, 2.0) == 321.0


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_two_orders_are_refused_by_position_and_nowhere_else(backend: str) -> None:
    names = fresh("ta")
    t, a = teg.params(" ".join(names))
    teg.params(" ".join(reversed(names)))  # another place of the program made them in the other order
    e = t + 10 * a
    f = teg.compile(e, backend=backend)  # type: ignore[arg-type]
    with pytest.raises(errors.ParameterError, match="is not certain") as caught:
        f(1.0, 2.0)
    assert f"[{names[0]}, {names[1]}]" in caught.value.hint
    with pytest.raises(errors.ParameterError):
        f.grad(1.0, **{names[1]: 2.0})
    with pytest.raises(errors.ParameterError, match="3 values for 2"):
        f(1.0, 2.0, 3.0)
    assert f({t: 1.0, a: 2.0}) == f(**dict(zip(names, (1.0, 2.0), strict=True))) == 21.0
    assert teg.compile(e, [t, a], backend=backend)(1.0, 2.0) == 21.0  # type: ignore[arg-type]
    assert teg.compile(e, [t], backend=backend)(1.0, 2.0) == 21.0  # type: ignore[arg-type]


def test_one_order_used_again_stays_certain() -> None:
    names = " ".join(fresh("ta"))
    t, a = teg.params(names)
    teg.params(names)
    assert is_order_certain([t, a])
    assert not is_order_certain([a, t])
    assert in_order_of_creation([a, t, a]) == [t, a]


def test_parameters_that_no_user_made_have_no_order() -> None:
    t, a = (Param.make(name, ()) for name in fresh("ta"))
    assert in_order_of_creation([a, t]) == [a, t]
    assert is_order_certain([a])
    assert not is_order_certain([a, t])


def test_an_evaluator_keeps_its_order_when_it_is_pickled() -> None:
    names = fresh("tab")
    t, a, b = teg.params(" ".join(names))
    f = pickle.loads(pickle.dumps(teg.compile(b + 10 * a + 100 * t)))
    teg.params(" ".join(reversed(names)))
    assert f(1.0, 2.0, 3.0) == pickle.loads(pickle.dumps(f))(1.0, 2.0, 3.0) == 123.0
