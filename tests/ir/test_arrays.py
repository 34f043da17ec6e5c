"""Arrays, indices and sums as users write them: what they build, print, and what is said of mistakes."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import teg
from teg.ir.arrays import Gather, Sum
from teg.ir.index import Index, IndexConst
from teg.program.arrays import ArrayProgram, Load, Loop

V, W = teg.array("V", 2), teg.array("W")
F = teg.indices("F", 2)
k, j = teg.index("k"), teg.index("j")
x, t, n = teg.var("x"), teg.param("t"), teg.param("n")


def test_one_name_is_one_array() -> None:
    assert teg.array("V", 2) is V
    assert teg.array("V", 1) is not V
    assert V[k, 0] is V[k, 0]
    assert isinstance(V[F[k, 0], 1], Gather)
    assert isinstance(F[k, 0], Index)


def test_index_arithmetic() -> None:
    assert str(k + 1) == "k + 1"
    assert str(2 * k % 3) == "(2·k) % 3"
    assert isinstance(teg.minimum(3, teg.maximum(k, 0)), Index)
    assert (k + 0) is k
    assert isinstance(teg.length(V, 0) - teg.length(V, 0) % 2, Index)
    seven = F[0, 0] * 0 + 7
    assert isinstance(seven, Index)


def test_an_index_converts_to_a_number() -> None:
    e = teg.sum(k * 0.5 + k / 4 + k**2, (k, 0, 4))
    assert teg.evaluate(e) == 6 * 0.5 + 6 / 4 + 14


def test_printing_and_pickling() -> None:
    e = teg.sum(V[F[k, 0], 1] * t, (k, 0, teg.length(F, 0)))
    assert str(e) == "Σ[k: 0..length(F, 0)] V[F[k, 0], 1]·t"
    assert pickle.loads(pickle.dumps(e)) is e
    assert str(teg.grad(teg.sum(W[k] ** 2, (k, 0, 3)), [W])) == "(Σ[k: 0..3] 2·W[k]·1[W; k],)"
    assert teg.size(e) == 4


def test_sums_nest_and_the_first_range_is_innermost() -> None:
    e = teg.sum(V[j, k], (k, 0, j + 1), (j, 0, 3))
    assert isinstance(e, Sum)
    assert teg.evaluate(e, {"V": np.arange(9.0).reshape(3, 3)}) == 0 + 3 + 4 + 6 + 7 + 8


MISTAKES: dict[str, tuple[Callable[[], Any], type[teg.TegError], str]] = {
    "a float as an index": (lambda: V[0.5, 0], teg.ArrayIndexError, "0.5 is not an integer"),
    "a number of the program as an index": (lambda: V[teg.sin(t), 0], teg.ArrayIndexError, "real number"),
    "too few indices": (lambda: V[0], teg.ArrayIndexError, "2 dimensions"),
    "too many": (lambda: W[0, 1], teg.ArrayIndexError, "1 dimensions"),
    "a negative index": (lambda: V[-1, 0], teg.ArrayIndexError, "negative"),
    "a slice": (lambda: W[1:2], teg.ArrayIndexError, "no slices"),
    "an array as an index": (lambda: W[F], teg.ArrayIndexError, "F is an array"),
    "a truth value": (lambda: W[True], teg.ArrayIndexError, "True"),
    "arithmetic on an array": (lambda: V * 2, teg.TegError, "arithmetic is on its entries"),
    "an array as a number": (lambda: teg.sin(V), teg.TegError, "arithmetic is on its entries"),
    "an index of the program in a list": (lambda: [1, 2][k], teg.ArrayIndexError, "not a number yet"),
    "a bound that is no integer": (lambda: teg.sum(W[k], (k, 0, 2.5)), teg.ArrayIndexError, "2.5"),
    "a sum over a variable": (lambda: teg.sum(W[k], (x, 0, 2)), teg.TegError, "runs over an index"),
    "a sum over nothing": (lambda: teg.sum(W[k]), teg.TegError, "needs an index"),
    "a range that ends before it begins": (lambda: teg.sum(W[k], (k, 3, 0)), teg.ArrayIndexError, "negative length"),
    "a range that depends on its index": (lambda: teg.sum(W[k], (k, 0, k)), teg.TegError, "depends on k itself"),
    "an index outside its sum": (lambda: teg.compile(W[k]), teg.TegError, "outside its sum: k"),
    "no dimensions": (lambda: teg.array("V", 0), teg.ArrayIndexError, "0 dimensions"),
    "an axis that is not there": (lambda: teg.length(V, 2), teg.ArrayIndexError, "axes 0 to 1"),
    "the length of a parameter": (lambda: teg.length(t), teg.ArrayIndexError, "takes an array"),
    "division by zero": (lambda: k % 0, teg.ArrayIndexError, "divided by 0"),
    "one name twice": (lambda: teg.compile(W[0] + teg.array("W", 2)[0, 0]), teg.TegError, "two different arrays"),
    "an array and a parameter": (lambda: teg.compile(W[0] + teg.param("W")), teg.TegError, "an array and a parameter"),
    "the derivative by an index array": (lambda: teg.grad(W[F[0, 0]], [F]), teg.TegError, "nothing is differentiable"),
    "diff by an array": (lambda: teg.diff(W[0], W), teg.TegError, "teg.grad"),
    "a symbolic Hessian": (lambda: teg.hessian(W[0] ** 2, [W]), teg.TegError, "hvp"),
    "listed twice": (lambda: teg.grad(W[0], [W, W]), teg.TegError, "twice"),
    "if on an index": (lambda: 1 if k < 3 else 2, teg.TegError, "teg.where"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_of_writing(name: str) -> None:
    mistake, kind, said = MISTAKES[name]
    with pytest.raises(kind, match=said):
        mistake()


TOTAL = teg.sum(V[F[k, 0], 1], (k, 0, teg.length(F, 0)))
GIVEN = {"V": np.ones((3, 2)), "F": np.array([[0], [2]])}
CALLS: dict[str, tuple[Any, dict[str, Any], str]] = {
    "out of range": (TOTAL, {**GIVEN, "F": np.array([[0], [3]])}, r"index 3 is out of range: axis 0 of 'V' has length 3.*V\[3, 1\]"),
    "negative": (TOTAL, {**GIVEN, "F": np.array([[0], [-1]])}, "index -1 is out of range"),
    "the second axis": (TOTAL, {**GIVEN, "V": np.ones((3, 1))}, "axis 1 of 'V' has length 1"),
    "no integers": (TOTAL, {**GIVEN, "F": np.array([[0.0], [1.0]])}, "are indices, and float64"),
    "too few dimensions": (TOTAL, {**GIVEN, "V": np.ones(3)}, r"2 dimensions, and an array of shape \(3,\)"),
    "no numbers": (TOTAL, {**GIVEN, "V": [["a", "b"]]}, "not an array of real numbers"),
    "missing": (TOTAL, {"V": np.ones((3, 2))}, "no value for 'F'"),
    "unknown": (TOTAL, {**GIVEN, "Z": 1.0}, "no parameter named 'Z'"),
    "off by one": (teg.sum(W[k + 1], (k, 0, teg.length(W))), {"W": np.ones(4)}, "index 4 is out of range"),
    "a length that is no integer": (teg.sum(W[k], (k, 0, n)), {"W": np.ones(4), "n": 2.5}, "'n' is used as an integer.*2.5"),
    "a negative length": (teg.sum(W[k], (k, 0, n)), {"W": np.ones(4), "n": -2}, "negative length: from 0 to -2"),
    "a length that is NaN": (teg.sum(W[k], (k, 0, n)), {"W": np.ones(4), "n": np.nan}, "'n' is used as an integer"),
    "in an index array": (teg.sum(W[F[k, 1]], (k, 0, 2)), {"W": np.ones(4), "F": np.zeros((2, 1), int)}, "axis 1 of 'F'"),
    "in the second element of a batch": (TOTAL, {**GIVEN, "F": np.array([[[0], [1]], [[1], [99]]])}, "index 99 is out of range"),
    "in the last element, with padding that is not read": (
        teg.sum(W[F[k, 0]], (k, 0, n)),
        {"W": np.ones(2), "F": np.array([[[0], [-1]], [[1], [5]]]), "n": np.array([1, 2])},
        "index 5 is out of range",
    ),
    "batches that do not fit": (TOTAL, {"V": np.ones((4, 3, 2)), "F": np.zeros((5, 1, 1), int)}, "do not broadcast"),
}


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", CALLS)
def test_mistakes_of_calling(name: str, backend: str) -> None:
    e, given, said = CALLS[name]
    f = teg.compile(e, backend=backend)
    with pytest.raises(teg.TegError, match=said):
        f(given)


def test_padding_that_is_never_read_is_no_mistake() -> None:
    e = teg.sum(W[F[k, 0]], (k, 0, n))
    assert teg.evaluate(e, {"W": [1.0, 2.0, 4.0], "F": np.array([[0], [2], [-1]]), "n": 2}) == 5.0
    e = teg.sum(W[j], (j, F[k, 0], F[k, 1]), (k, 0, teg.length(F, 0)))
    assert teg.evaluate(e, {"W": [1.0, 2.0, 4.0], "F": np.array([[0, 2], [3, 3]])}) == 3.0


def test_an_empty_sum_is_nothing() -> None:
    e = teg.sum(W[k] ** 2, (k, 0, teg.length(W)))
    f = teg.compile(e, [W])
    value, slopes = f.value_and_grad(W=np.zeros(0))
    assert value == 0.0
    assert slopes["W"].shape == (0,)


def test_integers_are_constants_of_the_program() -> None:
    assert isinstance(teg.sum(W[k], (k, 0, 3)).lo, IndexConst)  # type: ignore[attr-defined]
    f = teg.compile(teg.sum(W[k], (k, 0, n)) / n, [W, n])
    value, slopes = f.value_and_grad(W=[1.0, 2.0, 6.0], n=3)
    assert value == 3.0
    assert slopes["n"] == pytest.approx(-1.0)  # of the quotient: a length has no derivative
    np.testing.assert_allclose(slopes["W"], 1 / 3)


def test_numbers_that_are_read_alone_are_read_in_the_order_in_which_they_are_wanted() -> None:
    """The text of a program is the same in every process: its compiled form is found in the cache."""
    V, k = teg.array("V", 2), teg.index("k")
    columns = [5, 2, 7, 0, 6, 1, 4, 3]
    entries = [teg.sum(V[k, c], (k, 0, 3)) + V[0, c] * 0 for c in columns] + [V[1, c] + 0 * V[2, c] for c in columns]
    program = teg.compile(teg.tuple(*entries, *(V[1, c] for c in columns)), []).program(0)
    assert isinstance(program, ArrayProgram)
    loop = next(step for step in program.body if isinstance(step, Loop))
    assert [step.subscripts[1] for step in loop.body if isinstance(step, Load)] == columns
